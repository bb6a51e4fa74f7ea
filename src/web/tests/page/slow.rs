//! Pages that read slowly, or not at all.

use crate::peer::{LONG, Page, city_with};
use city3d_network::listener::Patience;
use city3d_web::PATIENCE;
use serde_json::json;
use std::time::{Duration, Instant};
use tokio::io::AsyncReadExt;
use tokio::net::TcpSocket;

/// Receive buffer of a page that reads slowly, bytes.
const LITTLE: u32 = 4096;

#[tokio::test]
async fn a_slow_page_misses_states_and_one_that_stops_reading_is_disconnected() {
    let send = Duration::from_secs(2);
    let city = city_with("city", Patience { send, ..PATIENCE });
    let socket = TcpSocket::new_v4().unwrap();
    socket.set_recv_buffer_size(LITTLE).unwrap();
    let stream = socket.connect(city.web.address()).await.unwrap();
    let mut slow = Page::on(stream, city.web.address(), Some(&city.token)).await;
    slow.send(json!({ "t": "start" })).await;
    let mut other = Page::new(city.web.address(), None).await;
    let first = other.hear(|m| m["t"] == "state" && m["phase"] == "running").await;

    // It does not read, until nothing more has room on the way to it.
    let begun = Instant::now();
    loop {
        let before = city.web.counts().peers.messages;
        for _ in 0..10 {
            other.hear_of("state").await;
        }
        if city.web.counts().peers.messages - before < 15 {
            break;
        }
        assert!(begun.elapsed() < LONG, "{:?}", city.web.counts());
    }
    // It reads again: it has missed states, and is told the latest one.
    let mut piece = vec![0; LITTLE as usize];
    while city.web.counts().skipped_states == 0 {
        assert!(begun.elapsed() < LONG, "{:?}", city.web.counts());
        slow.0.get_mut().read_exact(&mut piece).await.unwrap();
    }
    let counts = city.web.counts();
    assert_eq!((counts.peers.slow, counts.peers.connected), (0, 2), "{counts:?}");

    // Then it stops for good.
    while city.web.counts().peers.slow == 0 {
        assert!(begun.elapsed() < LONG, "{:?}", city.web.counts());
        other.hear_of("state").await;
    }
    assert_eq!(city.web.counts().peers.connected, 1);
    let last = other.hear_of("state").await;
    let passed_s = last["time"].as_f64().unwrap() - first["time"].as_f64().unwrap();
    assert!(passed_s / begun.elapsed().as_secs_f64() > 0.8, "{passed_s} s in {:?}", begun.elapsed());
    city.session.stop().unwrap();
}

#[tokio::test]
async fn who_says_nothing_is_disconnected() {
    let soon = Duration::from_millis(200);
    let city = city_with("straight", Patience { request: soon, silence: 2 * soon, ..PATIENCE });
    let address = city.web.address();
    let asked = crate::peer::asked(address, "GET / HTTP/1.1\r\n").await;
    assert!(asked.starts_with("HTTP/1.1 408"), "{asked}");
    let origin = format!("http://{address}");
    let mut without_hello = crate::peer::open(address, &origin).await.unwrap();
    assert_eq!(without_hello.closed().await, None);
    let mut page = Page::new(address, None).await;
    page.hear_of("welcome").await;
    assert_eq!(page.closed().await, None);
    assert_eq!((city.web.counts().peers.slow, city.web.counts().peers.connected), (2, 0));
    city.session.stop().unwrap();
}
