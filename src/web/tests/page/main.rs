//! The page's server with real clients: who may do what, and what hostile and slow ones come to.

#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(clippy::disallowed_types, reason = "connects to a server on this machine")]

mod guest;
mod log;
mod peer;
mod slow;

use futures_util::SinkExt;
use peer::{City, Page, asked, city, open};
use serde_json::json;
use tokio_tungstenite::tungstenite::Message as Packet;

#[tokio::test]
async fn a_page_is_told_the_city_and_starts_it() {
    let City { web, token, session } = city();
    let mut page = Page::new(web.address(), Some(&token)).await;
    assert_eq!(page.hear_of("welcome").await["may_order"], true);
    let map = page.hear_of("map").await;
    assert_eq!(map["scenario"], "roundabout");
    assert!(map["lanes"].as_array().unwrap().len() > 20);
    assert_eq!(page.hear_of("roster").await["vehicles"].as_array().unwrap().len(), 6);
    assert_eq!(page.hear_of("state").await["phase"], "ready");
    page.send(json!({ "t": "start" })).await;
    let running = page.hear(|m| m["t"] == "state" && m["tick"].as_u64() > Some(20)).await;
    assert_eq!(running["phase"], "running");
    page.send(json!({ "t": "pause" })).await;
    page.hear(|m| m["phase"] == "paused").await;
    page.send(json!({ "t": "reset" })).await;
    page.hear(|m| m["phase"] == "ready" && m["tick"] == 0).await;
    assert_eq!(web.counts().peers.dropped(), 0);
    session.stop().unwrap();
}

#[tokio::test]
async fn one_page_drives_a_vehicle_until_it_is_silent() {
    let City { web, token, session } = city();
    let mut page = Page::new(web.address(), Some(&token)).await;
    let mut other = Page::new(web.address(), Some(&token)).await;
    page.send(json!({ "t": "start" })).await;
    let pedals = json!({ "gas": 1.0, "brake": 0.0, "handbrake": 0.0, "steering_rad": 0.0 });
    let drive = json!({ "t": "drive", "vehicle": 1, "pedals": pedals });
    page.send(drive.clone()).await;
    page.hear(|m| m["t"] == "state" && m["vehicles"][0][5] == "manual").await;
    other.send(drive).await;
    assert!(other.hear_of("notice").await["text"].as_str().unwrap().contains("somebody else"));
    // No more pedals come.
    page.hear(|m| m["t"] == "state" && m["vehicles"][0][5] != "manual").await;
    session.stop().unwrap();
}

#[tokio::test]
async fn without_the_token_a_page_watches() {
    let City { web, session, .. } = city();
    let mut page = Page::new(web.address(), None).await;
    assert_eq!(page.hear_of("welcome").await["may_order"], false);
    page.send(json!({ "t": "start" })).await;
    assert!(page.hear_of("notice").await["text"].as_str().unwrap().contains("watches"));
    assert_eq!((web.counts().peers.forbidden, session.run_state().now.tick), (1, 0));
    let mut wrong = Page::new(web.address(), Some("0123456789abcdef0123456789abcdef")).await;
    assert_eq!(wrong.closed().await, Some(4401));
    assert_eq!(web.counts().peers.wrong_tokens, 1);
    session.stop().unwrap();
}

#[tokio::test]
async fn hostile_clients_are_disconnected_and_counted() {
    let City { web, token, session } = city();
    let address = web.address();
    assert!(open(address, "http://evil.example").await.is_err());
    let rebound = asked(address, "GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n").await;
    assert!(rebound.starts_with("HTTP/1.1 421"), "{rebound}");
    assert!(asked(address, "\x16\x03\x01 garbage\r\n\r\n").await.starts_with("HTTP/1.1 400"));
    assert_eq!(web.counts().peers.refused, 3);
    let page = asked(address, &format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n")).await;
    assert!(page.contains("default-src 'none'") && page.contains("<title>City3D</title>"));

    let huge = Packet::text("x".repeat(5000));
    let flood = Packet::text(json!({ "t": "ping", "sent_ms": 1.0 }).to_string());
    let garbage =
        [vec![Packet::text("{")], vec![Packet::binary(vec![1, 2, 3])], vec![huge], vec![flood; 300]];
    let count = garbage.len() as u64;
    for packets in garbage {
        let mut page = Page::new(address, Some(&token)).await;
        for packet in packets {
            // The server may have closed already.
            let _ = page.0.feed(packet).await;
        }
        let _ = page.0.flush().await;
        page.closed().await;
    }
    assert_eq!(web.counts().peers.invalid, count);
    // The city is there for others.
    Page::new(address, Some(&token)).await.hear_of("state").await;
    session.stop().unwrap();
}

#[tokio::test]
async fn a_page_that_does_not_read_delays_nobody() {
    let City { web, token, session } = city();
    let mut stalled = Page::new(web.address(), Some(&token)).await;
    stalled.send(json!({ "t": "start" })).await;
    let mut page = Page::new(web.address(), None).await;
    let first = page.hear(|m| m["t"] == "state" && m["phase"] == "running").await;
    let (begun, from_s) = (std::time::Instant::now(), first["time"].as_f64().unwrap());
    let later = page.hear(|m| m["t"] == "state" && m["time"].as_f64().unwrap() > from_s + 2.0).await;
    let passed_s = later["time"].as_f64().unwrap() - from_s;
    let rate = passed_s / begun.elapsed().as_secs_f64();
    assert!(rate > 0.8, "{rate} times real time with a page that does not read");
    drop(stalled);
    session.stop().unwrap();
}
