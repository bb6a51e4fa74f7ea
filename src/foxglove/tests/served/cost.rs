//! What a client costs the city, and how late it hears.

use crate::peer::{Heard, Peer, START, city, city_with};
use city3d_session::{End, EndHealth, Moment, MomentKind};
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// What an end does in each tick.
#[derive(Default)]
struct Ticks {
    /// When a tick was handed over.
    taken: BTreeMap<u64, Instant>,
    /// How long that took.
    lasted: Vec<Duration>,
    /// How late the step began.
    late: Vec<Duration>,
}

/// Looks at an end with a stopwatch.
struct Timed(Box<dyn End>, Arc<Mutex<Ticks>>);

impl End for Timed {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn take(&mut self, moment: &Moment<'_>) {
        let begun = Instant::now();
        self.0.take(moment);
        if moment.kind == MomentKind::Tick {
            let mut ticks = self.1.lock().unwrap();
            ticks.lasted.push(begun.elapsed());
            ticks.taken.insert(moment.snapshot.tick, begun);
            ticks.late.push(moment.timing.begun.saturating_duration_since(moment.timing.due));
        }
    }

    fn health(&self) -> EndHealth {
        self.0.health()
    }
}

fn quantile<T: Copy + Ord>(values: &mut [T], part: f64) -> T {
    values.sort();
    values[((values.len() - 1) as f64 * part) as usize]
}

#[tokio::test]
async fn channels_without_subscribers_cost_nothing() {
    let city = city("roundabout");
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
        let ticks = Arc::<Mutex<Ticks>>::default();
        let city = city_with("city", |end| Box::new(Timed(end, Arc::clone(&ticks))));
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
                let taken = ticks.lock().unwrap().taken.get(&tick).copied();
                if let Some(taken) = taken.filter(|_| topic == "/city3d/scene") {
                    delays.push(now.saturating_duration_since(taken));
                }
            }
        }
        let state = city.session.run_state();
        let Ticks { mut late, mut lasted, .. } = std::mem::take(&mut *ticks.lock().unwrap());
        println!(
            "{case}: {} vehicles, {} ticks, {:.2} times real time; late {:?}, handed over in {:?} (p50, p99); {:?}",
            state.now.vehicles.len(),
            late.len(),
            state.real_time_factor,
            [0.5, 0.99].map(|part| quantile(&mut late, part)),
            [0.5, 0.99].map(|part| quantile(&mut lasted, part)),
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
