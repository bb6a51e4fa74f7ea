//! Pose feedback by VICON in place of the city's own: the newest poses of all vehicles, put on the city's clock.

use super::vicon::{EPOCH_S, Vicon, wall_s};
use super::{Client, Heard};
use crate::snapshot::{Status, VehicleId};
use crate::wire::{Body, Clock, Measurement, Phase, Poses, Seen};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// So often the city is asked for its clock, while it runs and while it stands.
const ASK_RUNNING: Duration = Duration::from_millis(200);
const ASK_STANDING: Duration = Duration::from_millis(20);
/// A city that has not answered for so long may have been restarted.
const SILENT: Duration = Duration::from_secs(1);
/// Poses of one instant come by several connections: so long the others are waited for.
const HOLD: Duration = Duration::from_millis(2);
/// Waits of one look for poses.
const LOOK: Duration = Duration::from_millis(2);
/// A vehicle without a pose for so long counts as unseen, and after the second is forgotten.
const UNSEEN_S: f64 = 0.25;
const FORGOTTEN_S: f64 = 5.0;
/// By so much a reading of the clock gets worse each second, against the time that a question takes.
const AGEING: f64 = 0.01;

/// What the city's clock showed at an instant of this machine's.
#[derive(Clone, Copy, Debug)]
struct Reading {
    clock: Clock,
    wall_s: f64,
    /// How long the question and its answer took.
    round_trip_s: f64,
}

impl Reading {
    /// Simulated time of a stamp.
    fn time_s(&self, stamp_s: f64) -> f64 {
        match self.clock.phase {
            _ if stamp_s < EPOCH_S => stamp_s,
            Phase::Running => (self.clock.time_s + stamp_s - self.wall_s).max(0.0),
            Phase::Ready | Phase::Paused => self.clock.time_s,
        }
    }

    /// Whether another one tells the time better.
    fn is_worse_than(&self, other: &Self) -> bool {
        let age_s = other.wall_s - self.wall_s;
        self.clock.phase != other.clock.phase || other.round_trip_s <= self.round_trip_s + AGEING * age_s
    }
}

/// Listens to VICON for the poses of a city, and to the city for its clock.
#[derive(Debug)]
pub struct ViconFeedback {
    vicon: Vicon,
    /// Vehicles that are expected.
    vehicles: usize,
    ticks_per_control: u64,
    /// On the city's clock.
    newest: BTreeMap<VehicleId, Measurement>,
    /// The newest instant that was not given yet, and when its first pose came.
    coming: Option<(f64, Instant)>,
    /// Time of the poses that were given last.
    given_s: f64,
    last_tick: u64,
    reading: Option<Reading>,
    /// The question that was asked last, and when.
    asked: (u64, Option<(Instant, f64)>),
    /// When the city has answered last, or was asked first.
    answered: Option<Instant>,
}

impl ViconFeedback {
    pub fn new(vicon: Vicon, vehicles: usize, ticks_per_control: u64) -> Self {
        Self {
            vicon,
            vehicles,
            ticks_per_control,
            newest: BTreeMap::new(),
            coming: None,
            given_s: 0.0,
            last_tick: 0,
            reading: None,
            asked: (0, None),
            answered: None,
        }
    }

    /// The next thing that comes from the city or from VICON, whose poses come as if the city had sent them.
    pub fn receive(&mut self, client: &mut Client) -> Option<Heard> {
        self.ask(client);
        match client.receive(Duration::ZERO) {
            Some(Heard::Body(Body::Clock(clock))) => self.read(clock),
            Some(heard) => return Some(heard),
            None => {}
        }
        let mut wait = LOOK;
        while let Some(heard) = self.vicon.receive(wait) {
            wait = Duration::ZERO;
            self.take(heard.pose);
        }
        self.give()
    }

    fn is_running(&self) -> bool {
        self.reading.is_some_and(|reading| reading.clock.phase == Phase::Running)
    }

    fn ask(&mut self, client: &mut Client) {
        let every = if self.is_running() { ASK_RUNNING } else { ASK_STANDING };
        let (token, asked) = self.asked;
        if asked.is_none_or(|(when, _)| when.elapsed() >= every) {
            self.asked = (token + 1, Some((Instant::now(), wall_s())));
            client.send(&Body::Hello { token: token + 1 });
            // Poses of physical vehicles go on without a city.
            if self.answered.get_or_insert_with(Instant::now).elapsed() > SILENT {
                client.probe();
            }
        }
    }

    fn read(&mut self, clock: Clock) {
        self.answered = Some(Instant::now());
        let (token, Some((when, asked_s))) = self.asked else { return };
        if clock.token != token {
            return;
        }
        let round_trip_s = when.elapsed().as_secs_f64();
        let reading = Reading { clock, wall_s: asked_s + round_trip_s / 2.0, round_trip_s };
        if clock.phase == Phase::Ready {
            // A reset: what was before it lies in the future now.
            self.newest.retain(|_, pose| pose.stamp_s <= clock.time_s);
            (self.given_s, self.last_tick) = (0.0, 0);
        }
        if self.reading.is_none_or(|old| old.is_worse_than(&reading)) {
            self.reading = Some(reading);
        }
    }

    fn take(&mut self, pose: Measurement) {
        let Some(reading) = self.reading else { return };
        let time_s = reading.time_s(pose.stamp_s);
        let pose = Measurement { stamp_s: time_s, ..pose };
        let newest = self.newest.entry(pose.vehicle).or_insert(pose);
        if time_s >= newest.stamp_s {
            *newest = pose;
        }
        if time_s > self.given_s || !self.is_running() {
            let (latest_s, begun) = self.coming.unwrap_or((time_s, Instant::now()));
            self.coming = Some((latest_s.max(time_s), begun));
        }
    }

    /// Gives the newest instant, once all vehicles have come or have been waited for.
    fn give(&mut self) -> Option<Heard> {
        let (reading, (time_s, begun)) = (self.reading?, self.coming?);
        let is_whole =
            self.newest.len() >= self.vehicles && self.newest.values().all(|pose| pose.stamp_s == time_s);
        if !is_whole && begun.elapsed() < HOLD {
            return None;
        }
        (self.coming, self.given_s) = (None, time_s);
        let Clock { physics_hz, phase, .. } = reading.clock;
        let tick = self.tick_at(time_s * f64::from(physics_hz));
        self.newest.retain(|_, pose| time_s - pose.stamp_s < FORGOTTEN_S);
        let status = |pose: &Measurement| match phase {
            _ if time_s - pose.stamp_s > UNSEEN_S => Status::Unseen,
            Phase::Running => Status::Driving,
            Phase::Ready | Phase::Paused => Status::Waiting,
        };
        let vehicles = self.newest.values().map(|pose| Seen { pose: *pose, status: status(pose) }).collect();
        Some(Heard::Body(Body::Poses(Poses {
            tick,
            time_s,
            state_hash: 0,
            phase,
            part: 0,
            parts: 1,
            vehicles,
        })))
    }

    /// The tick of an instant. Stamps of the wall fall between ticks: no tick with a control step is stepped over.
    fn tick_at(&mut self, ticks: f64) -> u64 {
        let (tick, per) = (ticks.round() as u64, self.ticks_per_control.max(1));
        let is_due = tick / per > self.last_tick / per;
        self.last_tick = if is_due { tick - tick % per } else { tick };
        self.last_tick
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(phase: Phase, time_s: f64, wall_s: f64, round_trip_s: f64) -> Reading {
        let clock = Clock {
            token: 0,
            tick: 0,
            time_s,
            physics_hz: 100,
            length_scale: 25.0,
            phase,
            is_lockstep: false,
        };
        Reading { clock, wall_s, round_trip_s }
    }

    #[test]
    fn stamps_are_put_on_the_clock_of_the_city() {
        let running = reading(Phase::Running, 3.0, 1.7e9, 0.001);
        assert!((running.time_s(1.7e9 + 0.25) - 3.25).abs() < 1e-6);
        assert_eq!(running.time_s(7.5), 7.5);
        assert_eq!(reading(Phase::Paused, 3.0, 1.7e9, 0.001).time_s(1.7e9 + 9.0), 3.0);
    }

    #[test]
    fn a_quick_answer_tells_the_time_until_it_is_old() {
        let quick = reading(Phase::Running, 3.0, 100.0, 0.001);
        assert!(!quick.is_worse_than(&reading(Phase::Running, 3.2, 100.2, 0.02)));
        assert!(quick.is_worse_than(&reading(Phase::Running, 5.2, 102.2, 0.02)));
        assert!(quick.is_worse_than(&reading(Phase::Paused, 3.1, 100.1, 0.02)));
    }
}
