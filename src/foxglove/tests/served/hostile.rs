//! Hostile and slow clients.

use crate::peer::{City, LONG, Peer, START, city, city_with, open};
use city3d_foxglove::PATIENCE;
use city3d_network::listener::Patience;
use futures_util::SinkExt;
use serde_json::json;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::Message as Packet;

const PROTOCOL: (&str, &str) = ("sec-websocket-protocol", "foxglove.sdk.v1");

/// Waits until the server has counted so many.
async fn counted(city: &City, count: impl Fn(&City) -> u64, expected: u64) {
    let begun = Instant::now();
    while count(city) != expected {
        assert!(begun.elapsed() < LONG, "{} counted, {expected} expected", count(city));
        tokio::task::yield_now().await;
    }
}

#[tokio::test]
async fn strangers_are_refused_and_counted() {
    let city = city("roundabout");
    let url = city.foxglove.url();
    for origin in ["http://evil.example", "null", "https://app.foxglove.dev.evil.example"] {
        assert!(open(&url, &[PROTOCOL, ("origin", origin)]).await.is_err(), "{origin}");
    }
    assert!(open(&url, &[]).await.is_err(), "no subprotocol");
    assert!(open(&url, &[("sec-websocket-protocol", "foxglove.sdk.v9")]).await.is_err());
    let mut stream = TcpStream::connect(city.foxglove.address()).await.unwrap();
    stream.write_all(b"\x16\x03\x01 garbage\r\n\r\n").await.unwrap();
    let mut answer = Vec::new();
    // Closed, or reset.
    let _ = timeout(LONG, stream.read_to_end(&mut answer)).await.unwrap();
    counted(&city, |city| city.foxglove.counts().peers.refused, 6).await;
    for origin in ["http://localhost:8080", "https://app.foxglove.dev"] {
        let mut peer = open(&url, &[PROTOCOL, ("origin", origin)]).await.unwrap();
        peer.text(|text| text["op"] == "serverInfo").await;
    }
    city.session.stop().unwrap();
}

#[tokio::test]
async fn nonsense_ends_a_connection() {
    let city = city("roundabout");
    let huge = Packet::text("x".repeat(70 << 10));
    let flood = Packet::text(json!({ "op": "getParameters", "parameterNames": [] }).to_string());
    let calls: Vec<u8> = [&[2][..], &START.to_le_bytes(), &[0; 3]].concat();
    let garbage = [
        vec![Packet::text("{")],
        vec![Packet::text(json!({ "op": "launch" }).to_string())],
        vec![Packet::binary(vec![255, 2, 3])],
        vec![Packet::binary(calls)],
        vec![huge],
        vec![flood; 300],
    ];
    let count = garbage.len() as u64;
    for packets in garbage {
        let mut peer = Peer::new(&city.foxglove.url()).await;
        for packet in packets {
            // The server may have closed already.
            let _ = peer.socket.feed(packet).await;
        }
        let _ = peer.socket.flush().await;
        peer.closed().await;
    }
    counted(&city, |city| city.foxglove.counts().peers.invalid, count).await;
    // What a city does not offer is no nonsense.
    let mut peer = Peer::new(&city.foxglove.url()).await;
    peer.send(json!({ "op": "advertise", "channels": [{ "id": 1, "topic": "/x" }] })).await;
    peer.text(|text| text["op"] == "status").await;
    city.session.stop().unwrap();
}

#[tokio::test]
async fn there_are_no_more_than_so_many_connections() {
    let city = city("roundabout");
    let mut peers = Vec::new();
    for _ in 0..32 {
        let mut peer = Peer::new(&city.watched()).await;
        peer.text(|text| text["op"] == "serverInfo").await;
        peers.push(peer);
    }
    assert!(open(&city.watched(), &[PROTOCOL]).await.is_err());
    counted(&city, |city| city.foxglove.counts().peers.refused, 1).await;
    peers.pop();
    counted(&city, |city| city.foxglove.counts().peers.connected, 31).await;
    city.session.stop().unwrap();
}

#[tokio::test]
async fn a_client_that_does_not_read_delays_nobody_and_is_disconnected() {
    let city = city("roundabout");
    let mut stalled = Peer::new(&city.foxglove.url()).await;
    for topic in ["/city3d/scene", "/tf", "/city3d/snapshot", "/city3d/trajectory"] {
        stalled.subscribe(topic).await;
    }
    stalled.call(START, json!({})).await;
    let mut peer = Peer::new(&city.watched()).await;
    peer.subscribe("/tf").await;
    let (from_s, _) = peer.message("/tf").await;
    let begun = Instant::now();
    let mut now_s = from_s;
    // Until the server's patience with the other one is over.
    while city.foxglove.counts().peers.slow == 0 {
        now_s = peer.message("/tf").await.0;
        assert!(begun.elapsed() < LONG, "{:?}", city.foxglove.counts());
    }
    let rate = (now_s - from_s) / begun.elapsed().as_secs_f64();
    assert!(rate > 0.8, "{rate} times real time with a client that does not read");
    let counts = city.foxglove.counts();
    assert!(counts.skipped > 0 && counts.lost_moments == 0, "{counts:?}");
    city.session.stop().unwrap();
}

#[tokio::test]
async fn who_makes_no_whole_request_is_disconnected() {
    let request = Duration::from_millis(200);
    let city = city_with("straight", Patience { request, ..PATIENCE });
    let begun = Instant::now();
    for said in ["", "GET / HTTP/1.1\r\nHost: lab\r\n"] {
        let mut stream = TcpStream::connect(city.foxglove.address()).await.unwrap();
        stream.write_all(said.as_bytes()).await.unwrap();
        let mut answer = Vec::new();
        timeout(LONG, stream.read_to_end(&mut answer)).await.unwrap().unwrap();
        assert!(answer.is_empty(), "{answer:?}");
    }
    assert!(begun.elapsed() >= 2 * request, "{:?}", begun.elapsed());
    counted(&city, |city| city.foxglove.counts().peers.refused, 2).await;
    city.session.stop().unwrap();
}

#[tokio::test]
async fn who_does_not_answer_pings_is_disconnected_and_who_does_stays() {
    let silence = Duration::from_millis(600);
    let city = city_with("straight", Patience { silence, ..PATIENCE });
    // Without subscriptions it is sent too little to be slow. It answers pings where it is read, and says nothing else.
    let mut alive = Peer::new(&city.watched()).await;
    let silent = Peer::new(&city.watched()).await;
    counted(&city, |city| city.foxglove.counts().peers.connected, 2).await;
    let begun = Instant::now();
    while begun.elapsed() < 2 * silence {
        // What it hears does not matter.
        let _ = timeout(Duration::from_millis(20), alive.heard()).await;
    }
    assert_eq!(city.foxglove.counts().peers.slow, 1);
    assert_eq!(city.foxglove.counts().peers.connected, 1);
    drop(silent);
    city.session.stop().unwrap();
}
