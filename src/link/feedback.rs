//! Pose feedback by VICON in place of the city's own: poses of one instant are put together, and put on the city's
//! clock.

use super::vicon::{Vicon, wall_s};
use super::{Client, Heard};
use crate::snapshot::{Status, VehicleId};
use crate::wire::{Body, Clock, Measurement, Phase, Poses, Seen};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// So often the city is asked for its clock, while it runs and while it stands.
const ASK_RUNNING: Duration = Duration::from_millis(200);
const ASK_STANDING: Duration = Duration::from_millis(20);
/// Whoever has not come by then is not seen at this instant.
const HOLD: Duration = Duration::from_millis(8);
/// Waits of one look for poses.
const LOOK: Duration = Duration::from_millis(4);
/// Instants that are put together at once.
const MOST_INSTANTS: usize = 16;
/// Stamps below are simulated seconds, those above seconds since the epoch.
const EPOCH_S: f64 = 1e8;
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

/// Poses of one stamp.
#[derive(Debug)]
struct Gathering {
    begun: Instant,
    poses: BTreeMap<VehicleId, Measurement>,
}

/// Listens to VICON for the poses of a city, and to the city for its clock.
#[derive(Debug)]
pub struct ViconFeedback {
    vicon: Vicon,
    /// Vehicles that are waited for at each instant.
    vehicles: usize,
    ticks_per_control: u64,
    /// By stamp, in nanoseconds.
    gathered: BTreeMap<u64, Gathering>,
    reading: Option<Reading>,
    /// The question that was asked last, and when.
    asked: (u64, Option<(Instant, f64)>),
    /// Of the poses that were given last.
    last_tick: u64,
}

impl ViconFeedback {
    pub fn new(vicon: Vicon, vehicles: usize, ticks_per_control: u64) -> Self {
        Self {
            vicon,
            vehicles,
            ticks_per_control,
            gathered: BTreeMap::new(),
            reading: None,
            asked: (0, None),
            last_tick: 0,
        }
    }

    pub fn vicon(&self) -> &Vicon {
        &self.vicon
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
            let stamp_ns = (heard.pose.stamp_s * 1e9).round() as u64;
            let begun = Instant::now();
            let gathering =
                self.gathered.entry(stamp_ns).or_insert_with(|| Gathering { begun, poses: BTreeMap::new() });
            gathering.poses.insert(heard.pose.vehicle, heard.pose);
            if gathering.poses.len() >= self.vehicles {
                return self.give(stamp_ns);
            }
        }
        let mut waiting = self.gathered.iter();
        let due = waiting.find(|(_, gathering)| gathering.begun.elapsed() > HOLD).map(|(stamp, _)| *stamp);
        let crowded = self.gathered.first_key_value().map(|(stamp, _)| *stamp);
        due.or(crowded.filter(|_| self.gathered.len() > MOST_INSTANTS))
            .and_then(|stamp_ns| self.give(stamp_ns))
    }

    fn ask(&mut self, client: &mut Client) {
        let is_running = self.reading.is_some_and(|reading| reading.clock.phase == Phase::Running);
        let every = if is_running { ASK_RUNNING } else { ASK_STANDING };
        let (token, asked) = self.asked;
        if asked.is_none_or(|(when, _)| when.elapsed() >= every) {
            self.asked = (token + 1, Some((Instant::now(), wall_s())));
            client.send(&Body::Hello { token: token + 1 });
        }
    }

    fn read(&mut self, clock: Clock) {
        let (token, Some((when, asked_s))) = self.asked else { return };
        if clock.token != token {
            return;
        }
        let round_trip_s = when.elapsed().as_secs_f64();
        let reading = Reading { clock, wall_s: asked_s + round_trip_s / 2.0, round_trip_s };
        if self.reading.is_none_or(|old| old.is_worse_than(&reading)) {
            self.reading = Some(reading);
        }
    }

    /// Gives the poses of an instant, and forgets those before it.
    fn give(&mut self, stamp_ns: u64) -> Option<Heard> {
        let gathering = self.gathered.remove(&stamp_ns)?;
        self.gathered.retain(|stamp, _| *stamp > stamp_ns);
        let reading = self.reading?;
        let Clock { physics_hz, phase, .. } = reading.clock;
        let stamp_s = gathering.poses.values().next()?.stamp_s;
        let time_s = reading.time_s(stamp_s);
        let tick = self.tick_at(time_s * f64::from(physics_hz));
        let status = if phase == Phase::Running { Status::Driving } else { Status::Waiting };
        let seen = |pose: Measurement| Seen { pose: Measurement { stamp_s: time_s, ..pose }, status };
        let vehicles = gathering.poses.into_values().map(seen).collect();
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
