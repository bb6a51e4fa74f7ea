//! ROS as an end of a city: poses as motion capture publishes them, over ROS 1, rosbridge or ROS 2, and poses from there.

use super::Moment;
use super::end::{End, EndFailure, EndHealth};
use super::remote::PoseFeedback;
use super::robots::CaptureEnd;
use super::served::MotionCapture;
use city3d_network::link::exchange::{
    EPOCH_S, ExchangeCounters, PictureQueue, PoseExchange, ReceivedPose, Subject, wall_s,
};
use city3d_network::link::feedback::ViconFeedback;
use city3d_network::link::{Client, ClientEvent};
use city3d_protocol::snapshot::{VehicleId, VehicleInfo};
use city3d_protocol::wire::{MAX_AHEAD_S, Measurement};
use city3d_simulation::runner::RosSummary;
use city3d_simulation::scenario::{Experiment, PlannedVehicle};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use thiserror::Error;

/// The vehicles of an experiment as VICON subjects.
pub fn subjects_of(experiment: &Experiment) -> Vec<Subject> {
    let name = |planned: &PlannedVehicle| match &planned.physical {
        Some(physical) => physical.subject.clone(),
        None => planned.name.clone(),
    };
    let subject = |planned: &PlannedVehicle| Subject { vehicle: planned.id, name: name(planned) };
    experiment.vehicles.iter().map(subject).collect()
}

/// The physical vehicles of an experiment as VICON subjects.
pub fn physical_subjects_of(experiment: &Experiment) -> Vec<Subject> {
    subjects_of(experiment).into_iter().filter(|subject| experiment.is_physical(subject.vehicle)).collect()
}

/// The exchange of a served city, which publishes the poses of its vehicles and hears those of physical ones.
#[derive(Clone, Debug)]
pub struct RosNode {
    exchange: Arc<Mutex<Box<dyn PoseExchange>>>,
    /// Name of the end in messages and in `summary.json`.
    name: &'static str,
    /// Stamps are simulated time.
    has_clock: bool,
}

impl RosNode {
    /// Serves a city over an exchange; `name` is that of the end.
    pub fn new(exchange: Box<dyn PoseExchange>, name: &'static str, has_clock: bool) -> Self {
        Self { exchange: Arc::new(Mutex::new(exchange)), name, has_clock }
    }

    /// The queue for pictures of its cameras.
    pub fn pictures(&self) -> Arc<dyn PictureQueue> {
        self.exchange().pictures()
    }

    /// Whether stamps are simulated time.
    pub fn has_clock(&self) -> bool {
        self.has_clock
    }

    /// The end that publishes poses.
    pub fn poses(&self) -> RosPoses {
        RosPoses {
            node: self.clone(),
            emulated: BTreeMap::new(),
            roster: Arc::default(),
            subjects: Arc::default(),
        }
    }

    /// The end that publishes poses of a city without a laboratory: those of its emulated physical vehicles too, under
    /// the names of their subjects.
    pub fn all_poses(&self, experiment: &Experiment) -> RosPoses {
        let physical = physical_subjects_of(experiment).into_iter();
        let emulated = physical.map(|subject| (subject.vehicle, subject.name)).collect();
        RosPoses { emulated, ..self.poses() }
    }

    /// What hears the poses of physical vehicles.
    pub fn capture(&self) -> RosCapture {
        RosCapture(self.clone())
    }

    fn exchange(&self) -> MutexGuard<'_, Box<dyn PoseExchange>> {
        self.exchange.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The master or the rosbridge server of a node does not answer.
#[derive(Clone, Copy, Debug, Error)]
#[error("its master or server is away")]
pub struct RosAway;

/// The end that publishes the poses of a city over ROS.
#[derive(Debug)]
pub struct RosPoses {
    node: RosNode,
    /// Subjects of physical vehicles that are emulated in this city.
    emulated: BTreeMap<VehicleId, String>,
    roster: Arc<Vec<VehicleInfo>>,
    subjects: Arc<Vec<Subject>>,
}

impl End for RosPoses {
    fn name(&self) -> &'static str {
        self.node.name
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if moment.kind == super::MomentKind::First {
            return;
        }
        let snapshot = moment.snapshot;
        if !Arc::ptr_eq(&self.roster, &snapshot.roster) {
            self.roster = Arc::clone(&snapshot.roster);
            let subject = |info: &VehicleInfo| {
                // Vehicles that are measured in a laboratory are published by VICON itself.
                let name = match self.emulated.get(&info.id) {
                    Some(name) => name,
                    None if info.is_physical() => return None,
                    None => &info.name,
                };
                Some(Subject { vehicle: info.id, name: name.clone() })
            };
            self.subjects = Arc::new(self.roster.iter().filter_map(subject).collect());
        }
        let poses = Measurement::all(snapshot, moment.scale()).collect();
        let stamp_s = if self.node.has_clock { snapshot.time_s } else { moment.unix_s };
        self.node.exchange().publish(stamp_s, &self.subjects, poses);
    }

    fn health(&self) -> EndHealth {
        let ExchangeCounters { published, dropped, slow, is_registered, .. } =
            self.node.exchange().counters();
        let failure = (!is_registered).then(|| EndFailure::new(RosAway));
        EndHealth { delivered: published, dropped: dropped + slow, failure }
    }

    fn says_failures(&self) -> bool {
        true
    }
}

/// Poses of physical vehicles that motion capture publishes over ROS.
#[derive(Debug)]
pub struct RosCapture(RosNode);

impl MotionCapture for RosCapture {
    fn next(&mut self, time_s: f64, is_running: bool) -> Option<Measurement> {
        let mut exchange = self.0.exchange();
        loop {
            let ReceivedPose { pose, .. } = exchange.receive(Duration::ZERO)?;
            let stamp_s = match is_running {
                _ if pose.stamp_s < EPOCH_S => pose.stamp_s,
                true => (time_s + pose.stamp_s - wall_s()).max(0.0),
                false => time_s,
            };
            if !is_running || stamp_s <= time_s + MAX_AHEAD_S {
                return Some(Measurement { stamp_s, ..pose });
            }
            exchange.drop_ahead(pose.vehicle, stamp_s - time_s);
        }
    }

    fn summary(&self) -> RosSummary {
        let counters = self.0.exchange().counters();
        RosSummary {
            published: counters.published,
            dropped: counters.dropped,
            dropped_for_slow: counters.slow,
            heard: counters.received,
            invalid: counters.invalid,
            ahead: counters.ahead,
            master_is_there: counters.is_registered,
            master_returns: counters.returns,
            pictures: None,
        }
    }
}

/// Pose feedback for the control framework, from motion capture over ROS.
#[derive(Debug)]
pub struct RosFeedback(ViconFeedback);

impl RosFeedback {
    /// Feedback by an exchange that hears all vehicles of an experiment.
    pub fn new(exchange: Box<dyn PoseExchange>, experiment: &Experiment) -> Self {
        let (vehicles, per_control) = (experiment.vehicles.len(), experiment.rates.ticks_per_control());
        Self(ViconFeedback::new(exchange, vehicles, per_control))
    }
}

impl PoseFeedback for RosFeedback {
    fn begin_session(&mut self) {
        self.0.begin_session();
    }

    fn receive(&mut self, city: &mut Client) -> Option<ClientEvent> {
        self.0.receive(city)
    }
}

/// Motion capture of the emulated robots, published over ROS.
#[derive(Debug)]
pub struct RosMotionCapture {
    exchange: Box<dyn PoseExchange>,
    subjects: Arc<Vec<Subject>>,
}

impl RosMotionCapture {
    /// Publishes the physical vehicles of an experiment by an exchange.
    pub fn new(exchange: Box<dyn PoseExchange>, experiment: &Experiment) -> Self {
        let subjects = Arc::new(physical_subjects_of(experiment));
        Self { exchange, subjects }
    }
}

impl CaptureEnd for RosMotionCapture {
    fn publish(&mut self, latency_s: f64, poses: Vec<Measurement>) {
        // As motion capture stamps them: now, less its latency.
        self.exchange.publish(wall_s() - latency_s, &self.subjects, poses);
    }
}
