//! Somebody who watches a city over UDP, and what can be told from its poses.

use city3d_network::link::{Client, ClientEvent};
use city3d_protocol::wire::{Authenticator, Body, ObservedVehicle, Poses};
use std::path::Path;
use std::time::{Duration, Instant};

/// Somebody who watches a city.
pub struct Watcher {
    client: Client,
    renewed: Option<Instant>,
}

impl Watcher {
    pub fn new(city: &str) -> Self {
        let client = Client::new(city, 0, Authenticator::Checksum).unwrap();
        Self { client, renewed: None }
    }

    pub fn next(&mut self) -> Poses {
        let begun = Instant::now();
        loop {
            if self.renewed.is_none_or(|renewed| renewed.elapsed() > Duration::from_secs(1)) {
                self.client.reset_session();
                self.client.send(&Body::Subscribe { request: 1, every_ticks: 1, lease_s: 60.0 });
                self.renewed = Some(Instant::now());
            }
            if let Some(ClientEvent::Body(Body::Poses(poses))) =
                self.client.receive(Duration::from_millis(500))
            {
                self.renewed = Some(Instant::now());
                return poses;
            }
            assert!(begun.elapsed() < Duration::from_secs(100), "no poses come");
        }
    }

    /// Watches until something is so of the vehicles; what has been seen until then.
    pub fn until(&mut self, what: &str, is_so: impl Fn(&Poses) -> bool) -> Vec<Poses> {
        let begun = Instant::now();
        let mut seen = Vec::new();
        loop {
            let poses = self.next();
            let is_over = is_so(&poses);
            seen.push(poses);
            if is_over {
                return seen;
            }
            assert!(begun.elapsed() < Duration::from_secs(100), "never {what}: {:?}", seen.last());
        }
    }
}

/// The hardest deceleration of any vehicle of those that count, full scale, over so many ticks that follow one another:
/// poses have speeds by their differences alone.
pub fn hardest_braking(seen: &[Poses], ticks: usize, counts: impl Fn(&ObservedVehicle) -> bool) -> f64 {
    let (mut hardest, half) = (0.0f64, ticks / 2);
    for some in seen.windows(2 * half + 1).filter(|all| all[2 * half].tick == all[0].tick + 2 * half as u64) {
        let dt_s = (some[2 * half].time_s - some[0].time_s) / 2.0;
        let at = |k: usize| {
            some[k].vehicles.iter().filter(|seen| counts(seen)).map(|seen| seen.pose.position * 25.0)
        };
        for ((a, b), c) in at(0).zip(at(half)).zip(at(2 * half)) {
            let (early, late) = ((b - a).length() / dt_s, (c - b).length() / dt_s);
            hardest = hardest.max((early - late) / dt_s);
        }
    }
    hardest
}

/// Whether nothing has moved between the last poses.
pub fn stand(seen: &[Poses]) -> bool {
    seen.len() > 60
        && seen[seen.len() - 50]
            .vehicles
            .iter()
            .zip(&seen[seen.len() - 1].vehicles)
            .all(|(a, b)| (a.pose.position - b.pose.position).length() * 25.0 < 0.02)
}

/// Until when a killed process had written its log: it stays readable so far.
pub fn torn_s(log: &Path) -> f64 {
    let bytes = std::fs::read(log).unwrap_or_else(|error| panic!("{}: {error}", log.display()));
    let torn =
        mcap::MessageStream::new_with_options(&bytes, mcap::read::Options::IgnoreEndMagic.into()).unwrap();
    torn.map_while(Result::ok).map(|message| message.log_time as f64 * 1e-9).last().unwrap()
}
