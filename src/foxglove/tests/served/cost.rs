//! What a client costs the city, and how late it hears.

use crate::peer::{Heard, Peer, START, city};
use city3d_session::{End, EndHealth, Moment, MomentKind};
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Keeps when the steps of ticks were done, and how late.
#[derive(Clone, Default)]
struct Stopwatch(Arc<Mutex<Ticks>>);

#[derive(Default)]
struct Ticks {
    done: BTreeMap<u64, Instant>,
    late: Vec<Duration>,
}

impl End for Stopwatch {
    fn name(&self) -> &'static str {
        "stopwatch"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if moment.kind == MomentKind::Tick {
            let mut ticks = self.0.lock().unwrap();
            ticks.done.insert(moment.snapshot.tick, Instant::now());
            ticks.late.push(moment.timing.begun.saturating_duration_since(moment.timing.due));
        }
    }

    fn health(&self) -> EndHealth {
        EndHealth::default()
    }
}

fn quantile<T: Copy + Ord>(values: &mut [T], part: f64) -> T {
    values.sort();
    values[((values.len() - 1) as f64 * part) as usize]
}

#[tokio::test]
async fn channels_without_subscribers_cost_nothing() {
    let city = city("roundabout", Vec::new());
    let mut peer = Peer::new(&city.foxglove.url()).await;
    peer.call(START, json!({})).await;
    let until = async |tick: u64| {
        while city.session.run_state().now.tick < tick {
            tokio::task::yield_now().await;
        }
    };
    until(20).await;
    let before = city.foxglove.counts().messages;
    until(70).await;
    assert_eq!(city.foxglove.counts().messages, before, "not even the time is told");
    city.session.stop().unwrap();
}

/// Prints figures: 50 vehicles at 100 Hz, without a client, with one that reads and with one that does not.
#[tokio::test]
#[ignore = "takes a minute; its figures are in docs/foxglove.md"]
async fn figures() {
    const TOPICS: [&str; 4] = ["/city3d/scene", "/tf", "/city3d/snapshot", "/city3d/metrics"];
    for case in ["nobody", "a reader", "a reader and one that does not read"] {
        let watch = Stopwatch::default();
        let city = city("city", vec![Box::new(watch.clone())]);
        let mut peer = Peer::new(&city.foxglove.url()).await;
        let mut stalled = Peer::new(&city.foxglove.url()).await;
        if case != "nobody" {
            for topic in TOPICS {
                peer.subscribe(topic).await;
            }
        }
        if case.contains("not read") {
            for topic in TOPICS {
                stalled.subscribe(topic).await;
            }
        }
        peer.call(START, json!({})).await;
        let begun = Instant::now();
        let mut delays = Vec::new();
        let mut bytes = 0;
        while begun.elapsed() < Duration::from_secs(15) {
            if case == "nobody" {
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            }
            if let Heard::Message { topic, stamp_ns, payload } = peer.heard().await {
                let now = Instant::now();
                bytes += payload.len();
                let tick = (stamp_ns + 5_000_000) / 10_000_000;
                let done = watch.0.lock().unwrap().done.get(&tick).copied();
                if let Some(done) = done.filter(|_| topic == "/city3d/scene") {
                    delays.push(now.saturating_duration_since(done));
                }
            }
        }
        let state = city.session.run_state();
        let mut late = std::mem::take(&mut watch.0.lock().unwrap().late);
        let [half, most] = [0.5, 0.99].map(|part| quantile(&mut late, part));
        println!(
            "{case}: {} vehicles, {} ticks, late {half:?} (p50) {most:?} (p99), {:.2} times real time; {:?}",
            state.now.vehicles.len(),
            late.len(),
            state.real_time_factor,
            city.foxglove.counts()
        );
        if !delays.is_empty() {
            let [half, most, worst] = [0.5, 0.99, 1.0].map(|part| quantile(&mut delays, part));
            println!(
                "  scenes {} in {half:?} (p50) {most:?} (p99) {worst:?} (most), {} KiB/s",
                delays.len(),
                bytes / 15 / 1024
            );
        }
        city.session.stop().unwrap();
    }
}
