//! Pose feedback from VICON instead of the city: the newest poses of all vehicles, with stamps on the city's clock.
//!
//! Clock synchronisation is Cristian's algorithm (*Probabilistic clock synchronization*, Distributed Computing 3,
//! 1989): the city is asked for its time, and its answer is taken to be from the middle of the round trip. The sample
//! with the shortest round trip counts until it has aged.

use super::exchange::{EPOCH_S, PoseExchange, wall_s};
use super::{Client, ClientEvent};
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_protocol::wire::{
    Body, CityClock, ExperimentPhase, MAX_AHEAD_S, Measurement, ObservedVehicle, Poses,
};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Interval of clock requests while the experiment runs, and while it does not.
const SYNC_INTERVAL_RUNNING: Duration = Duration::from_millis(200);
const SYNC_INTERVAL_STOPPED: Duration = Duration::from_millis(20);
/// A city that has not answered for this long may have been restarted.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(1);
/// Poses of one instant come by several connections: the longest wait for the remaining ones.
const ALIGN_TIMEOUT: Duration = Duration::from_millis(2);
/// Longest wait for poses in one call.
const POLL_TIMEOUT: Duration = Duration::from_millis(2);
/// A vehicle without a pose for the first time counts as unseen; after the second it is dropped.
const UNSEEN_AFTER_S: f64 = 0.25;
const DROPPED_AFTER_S: f64 = 5.0;
/// Multiple of real time up to which stamps of simulated time are taken.
const MAX_SPEED: f64 = 20.0;
/// Growth of the uncertainty of a clock sample, seconds per second, compared with round-trip times.
const DRIFT: f64 = 0.01;

/// Sample of Cristian's algorithm: time of the city's clock at an instant of this machine's clock.
#[derive(Clone, Copy, Debug)]
struct ClockSample {
    clock: CityClock,
    wall_s: f64,
    /// Round-trip time of the request.
    round_trip_s: f64,
}

impl ClockSample {
    /// Converts a stamp of the wall clock into simulated time.
    fn time_s(&self, stamp_s: f64) -> f64 {
        match self.clock.phase {
            _ if stamp_s < EPOCH_S => stamp_s,
            ExperimentPhase::Running => (self.clock.time_s + stamp_s - self.wall_s).max(0.0),
            ExperimentPhase::Ready | ExperimentPhase::Paused => self.clock.time_s,
        }
    }

    /// How far ahead of this clock a stamp may be. Between two samples simulated time may run faster than this clock.
    fn most_ahead_s(&self, stamp_s: f64) -> f64 {
        match stamp_s < EPOCH_S {
            true => MAX_AHEAD_S + MAX_SPEED * SYNC_INTERVAL_RUNNING.as_secs_f64(),
            false => MAX_AHEAD_S,
        }
    }

    /// Whether another sample is more accurate.
    fn is_worse_than(&self, other: &Self) -> bool {
        let age_s = other.wall_s - self.wall_s;
        self.clock.phase != other.clock.phase || other.round_trip_s <= self.round_trip_s + DRIFT * age_s
    }
}

/// Receives poses from VICON and the clock from the city, and joins them into pose datagrams.
#[derive(Debug)]
pub struct ViconFeedback {
    vicon: Box<dyn PoseExchange>,
    /// Number of vehicles that VICON tracks.
    vehicles: usize,
    ticks_per_control: u64,
    /// Newest poses, stamped with the city's clock.
    newest: BTreeMap<VehicleId, Measurement>,
    /// The newest instant that is not complete yet, and when its first pose came.
    pending: Option<(f64, Instant)>,
    /// Time of the poses that were returned last.
    returned_s: f64,
    last_tick: u64,
    sample: Option<ClockSample>,
    /// Token of the last clock request, and when it was sent.
    asked: (u64, Option<(Instant, f64)>),
    /// When the city answered last, or was first asked.
    answered: Option<Instant>,
}

impl ViconFeedback {
    /// Feedback of so many tracked vehicles, before the first pose.
    /// A control step has `ticks_per_control` ticks.
    pub fn new(vicon: Box<dyn PoseExchange>, vehicles: usize, ticks_per_control: u64) -> Self {
        Self {
            vicon,
            vehicles,
            ticks_per_control,
            newest: BTreeMap::new(),
            pending: None,
            returned_s: 0.0,
            last_tick: 0,
            sample: None,
            asked: (0, None),
            answered: None,
        }
    }

    /// A session with a city begins. It may have been restarted: by the clock of the one before, robots whose poses never
    /// ceased would be hours ahead, and the city's own clock would look like a reset.
    pub fn begin_session(&mut self) {
        self.newest.clear();
        (self.pending, self.sample, self.answered) = (None, None, None);
        (self.returned_s, self.last_tick) = (0.0, 0);
    }

    /// Receives the next event of the city, or poses from VICON in the form that the city sends.
    pub fn receive(&mut self, client: &mut Client) -> Option<ClientEvent> {
        self.request_clock(client);
        match client.receive(Duration::ZERO) {
            Some(ClientEvent::Body(Body::Clock(clock))) => self.update_clock(clock),
            Some(event) => return Some(event),
            None => {}
        }
        let mut wait = POLL_TIMEOUT;
        while let Some(received) = self.vicon.receive(wait) {
            wait = Duration::ZERO;
            self.add(received.pose);
        }
        self.next_frame()
    }

    fn is_running(&self) -> bool {
        self.sample.is_some_and(|sample| sample.clock.phase == ExperimentPhase::Running)
    }

    fn request_clock(&mut self, client: &mut Client) {
        let every = if self.is_running() { SYNC_INTERVAL_RUNNING } else { SYNC_INTERVAL_STOPPED };
        let (token, asked) = self.asked;
        if asked.is_none_or(|(when, _)| when.elapsed() >= every) {
            self.asked = (token + 1, Some((Instant::now(), wall_s())));
            client.send(&Body::Hello { token: token + 1 });
            // Poses of physical vehicles keep pending without a city.
            if self.answered.get_or_insert_with(Instant::now).elapsed() > HEARTBEAT_TIMEOUT {
                client.probe();
            }
        }
    }

    /// Takes an answer of the city's clock (Cristian's algorithm).
    fn update_clock(&mut self, clock: CityClock) {
        self.answered = Some(Instant::now());
        let (token, Some((when, asked_s))) = self.asked else { return };
        if clock.token != token {
            return;
        }
        let round_trip_s = when.elapsed().as_secs_f64();
        let sample = ClockSample { clock, wall_s: asked_s + round_trip_s / 2.0, round_trip_s };
        if clock.phase == ExperimentPhase::Ready {
            // A reset: earlier poses have stamps in the future now.
            self.newest.retain(|_, pose| pose.stamp_s <= clock.time_s);
            (self.returned_s, self.last_tick) = (0.0, 0);
        }
        if self.sample.is_none_or(|old| old.is_worse_than(&sample)) {
            self.sample = Some(sample);
        }
    }

    fn add(&mut self, pose: Measurement) {
        let Some(sample) = self.sample else { return };
        let time_s = sample.time_s(pose.stamp_s);
        let ahead_s = time_s - sample.time_s(wall_s());
        if ahead_s > sample.most_ahead_s(pose.stamp_s) {
            return self.vicon.drop_ahead(pose.vehicle, ahead_s);
        }
        let pose = Measurement { stamp_s: time_s, ..pose };
        let newest = self.newest.entry(pose.vehicle).or_insert(pose);
        if time_s >= newest.stamp_s {
            *newest = pose;
        }
        if time_s > self.returned_s || !self.is_running() {
            let (latest_s, begun) = self.pending.unwrap_or((time_s, Instant::now()));
            self.pending = Some((latest_s.max(time_s), begun));
        }
    }

    /// Returns the newest instant once it has poses of all vehicles, or after [`ALIGN_TIMEOUT`].
    fn next_frame(&mut self) -> Option<ClientEvent> {
        let (sample, (time_s, begun)) = (self.sample?, self.pending?);
        let is_complete =
            self.newest.len() >= self.vehicles && self.newest.values().all(|pose| pose.stamp_s == time_s);
        if !is_complete && begun.elapsed() < ALIGN_TIMEOUT {
            return None;
        }
        (self.pending, self.returned_s) = (None, time_s);
        let CityClock { physics_hz, phase, .. } = sample.clock;
        let tick = self.tick_at(time_s * f64::from(physics_hz));
        self.newest.retain(|_, pose| time_s - pose.stamp_s < DROPPED_AFTER_S);
        let status = |pose: &Measurement| match phase {
            _ if time_s - pose.stamp_s > UNSEEN_AFTER_S => Status::Unseen,
            ExperimentPhase::Running => Status::Driving,
            ExperimentPhase::Ready | ExperimentPhase::Paused => Status::Waiting,
        };
        let vehicles =
            self.newest.values().map(|pose| ObservedVehicle { pose: *pose, status: status(pose) }).collect();
        Some(ClientEvent::Body(Body::Poses(Poses {
            tick,
            time_s,
            state_hash: 0,
            phase,
            part: 0,
            parts: 1,
            vehicles,
        })))
    }

    /// The tick of an instant. Wall-clock stamps fall between ticks: the tick of each control step is kept.
    fn tick_at(&mut self, ticks: f64) -> u64 {
        let (tick, per) = (ticks.round() as u64, self.ticks_per_control.max(1));
        let is_due = tick / per > self.last_tick / per;
        self.last_tick = if is_due { tick - tick % per } else { tick };
        self.last_tick
    }
}

#[cfg(test)]
mod tests {
    use super::super::exchange::{AheadLog, ExchangeCounters, PictureQueue, ReceivedPose, Subject};
    use super::*;
    use glam::{DQuat, DVec3};
    use std::sync::Arc;

    /// An exchange without peers.
    #[derive(Debug, Default)]
    struct Silence(AheadLog);

    impl PoseExchange for Silence {
        fn publish(&mut self, _: f64, _: &Arc<Vec<Subject>>, _: Vec<Measurement>) {}

        fn receive(&self, _: Duration) -> Option<ReceivedPose> {
            None
        }

        fn drop_ahead(&mut self, vehicle: VehicleId, ahead_s: f64) {
            self.0.note(vehicle, ahead_s);
        }

        fn counters(&self) -> ExchangeCounters {
            ExchangeCounters { ahead: self.0.count(), ..ExchangeCounters::default() }
        }

        fn pictures(&self) -> Arc<dyn PictureQueue> {
            unreachable!("it has no cameras")
        }
    }

    fn sample(phase: ExperimentPhase, time_s: f64, wall_s: f64, round_trip_s: f64) -> ClockSample {
        let clock = CityClock {
            token: 0,
            tick: 0,
            time_s,
            physics_hz: 100,
            length_scale: 25.0,
            phase,
            is_lockstep: false,
        };
        ClockSample { clock, wall_s, round_trip_s }
    }

    #[test]
    fn stamps_are_put_on_the_clock_of_the_city() {
        let running = sample(ExperimentPhase::Running, 3.0, 1.7e9, 0.001);
        assert!((running.time_s(1.7e9 + 0.25) - 3.25).abs() < 1e-6);
        assert_eq!(running.time_s(7.5), 7.5);
        assert_eq!(sample(ExperimentPhase::Paused, 3.0, 1.7e9, 0.001).time_s(1.7e9 + 9.0), 3.0);
    }

    #[test]
    fn the_sample_with_the_shortest_round_trip_counts_until_it_is_old() {
        let short = sample(ExperimentPhase::Running, 3.0, 100.0, 0.001);
        assert!(!short.is_worse_than(&sample(ExperimentPhase::Running, 3.2, 100.2, 0.02)));
        assert!(short.is_worse_than(&sample(ExperimentPhase::Running, 5.2, 102.2, 0.02)));
        assert!(short.is_worse_than(&sample(ExperimentPhase::Paused, 3.1, 100.1, 0.02)));
    }

    #[test]
    fn poses_after_a_restart_wait_for_the_clock_of_the_new_city() {
        let mut feedback = ViconFeedback::new(Box::new(Silence::default()), 1, 10);
        let pose = |stamp_s| Measurement {
            vehicle: VehicleId(1),
            stamp_s,
            position: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
        };
        let tick = |event: Option<ClientEvent>| match event {
            Some(ClientEvent::Body(Body::Poses(poses))) => Some(poses.tick),
            _ => None,
        };
        feedback.sample = Some(sample(ExperimentPhase::Running, 14.0, wall_s(), 0.001));
        feedback.add(pose(wall_s()));
        assert!(tick(feedback.next_frame()).is_some_and(|tick| tick >= 1400));
        feedback.begin_session();
        feedback.add(pose(wall_s()));
        assert_eq!(tick(feedback.next_frame()), None, "by a clock that is gone");
        feedback.sample = Some(sample(ExperimentPhase::Ready, 0.0, wall_s(), 0.001));
        feedback.add(pose(wall_s()));
        assert_eq!(tick(feedback.next_frame()), Some(0));
    }

    #[test]
    fn a_stamp_ahead_of_the_clock_ends_no_experiment() {
        let mut feedback = ViconFeedback::new(Box::new(Silence::default()), 1, 10);
        let (now_s, vehicle) = (wall_s(), VehicleId(1));
        feedback.sample = Some(sample(ExperimentPhase::Running, 3.0, now_s, 0.001));
        let mut add = |stamp_s: f64| {
            let (position, orientation) = (DVec3::ZERO, DQuat::IDENTITY);
            feedback.add(Measurement { vehicle, stamp_s, position, orientation });
            let newest_s = feedback.newest.get(&vehicle).map(|pose| pose.stamp_s);
            (newest_s.is_some_and(|stamp_s| stamp_s < 5.0), feedback.vicon.counters().ahead)
        };
        assert_eq!(add(now_s + 30.0), (false, 1));
        assert_eq!(add(4_294_967_295.0), (false, 2));
        assert_eq!(add(1e7), (false, 3), "of simulated time");
        assert_eq!(add(now_s), (true, 3));
        assert_eq!(add(now_s + 30.0), (true, 4));
    }
}
