//! ROS as an end of a city: poses as VICON publishes them, over ROS 1 or rosbridge, and poses from there.

use super::Moment;
use super::end::{End, EndFailure, EndHealth};
use super::remote::PoseFeedback;
use super::robots::CaptureEnd;
use super::served::MotionCapture;
use city3d_network::link::feedback::ViconFeedback;
use city3d_network::link::onboard::PictureSender;
use city3d_network::link::vicon::{
    EPOCH_S, ReceivedPose, Subject, Vicon, ViconCounters, ViconOptions, wall_s,
};
use city3d_network::link::{Client, ClientEvent};
use city3d_network::ros::RosError;
use city3d_protocol::snapshot::VehicleInfo;
use city3d_protocol::wire::{MAX_AHEAD_S, Measurement};
use city3d_simulation::runner::RosSummary;
use city3d_simulation::scenario::{Experiment, PlannedVehicle};
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

/// The node of a served city, which publishes the poses of its vehicles and hears those of physical ones.
#[derive(Clone, Debug)]
pub struct RosNode {
    vicon: Arc<Mutex<Vicon>>,
    /// Stamps are simulated time.
    has_clock: bool,
}

impl RosNode {
    /// Starts the node, which looks for its master or server; that may start later.
    ///
    /// # Errors
    /// When the node cannot be started.
    pub fn start(options: ViconOptions) -> Result<Self, RosError> {
        let has_clock = options.has_clock;
        Ok(Self { vicon: Arc::new(Mutex::new(Vicon::start(options)?)), has_clock })
    }

    /// The queue for pictures of its cameras.
    pub fn pictures(&self) -> PictureSender {
        self.vicon().pictures()
    }

    /// Whether stamps are simulated time.
    pub fn has_clock(&self) -> bool {
        self.has_clock
    }

    /// The end that publishes poses.
    pub fn poses(&self) -> RosPoses {
        RosPoses { node: self.clone(), roster: Arc::default(), subjects: Arc::default() }
    }

    /// What hears the poses of physical vehicles.
    pub fn capture(&self) -> RosCapture {
        RosCapture(self.clone())
    }

    fn vicon(&self) -> MutexGuard<'_, Vicon> {
        self.vicon.lock().unwrap_or_else(PoisonError::into_inner)
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
    roster: Arc<Vec<VehicleInfo>>,
    subjects: Arc<Vec<Subject>>,
}

impl End for RosPoses {
    fn name(&self) -> &'static str {
        "ros"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if moment.kind == super::MomentKind::First {
            return;
        }
        let snapshot = moment.snapshot;
        if !Arc::ptr_eq(&self.roster, &snapshot.roster) {
            self.roster = Arc::clone(&snapshot.roster);
            let subject = |info: &VehicleInfo| Subject { vehicle: info.id, name: info.name.clone() };
            // Measured vehicles are published by VICON itself.
            let simulated = self.roster.iter().filter(|info| !info.is_physical());
            self.subjects = Arc::new(simulated.map(subject).collect());
        }
        let poses = Measurement::all(snapshot, moment.scale()).collect();
        let stamp_s = if self.node.has_clock { snapshot.time_s } else { moment.unix_s };
        self.node.vicon().publish(stamp_s, &self.subjects, poses);
    }

    fn health(&self) -> EndHealth {
        let ViconCounters { published, dropped, slow, is_registered, .. } = self.node.vicon().counters();
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
        let mut vicon = self.0.vicon();
        loop {
            let ReceivedPose { pose, .. } = vicon.receive(Duration::ZERO)?;
            let stamp_s = match is_running {
                _ if pose.stamp_s < EPOCH_S => pose.stamp_s,
                true => (time_s + pose.stamp_s - wall_s()).max(0.0),
                false => time_s,
            };
            if !is_running || stamp_s <= time_s + MAX_AHEAD_S {
                return Some(Measurement { stamp_s, ..pose });
            }
            vicon.drop_ahead(pose.vehicle, stamp_s - time_s);
        }
    }

    fn summary(&self) -> RosSummary {
        let counters = self.0.vicon().counters();
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

/// Pose feedback for the control framework, from VICON over ROS.
#[derive(Debug)]
pub struct RosFeedback(ViconFeedback);

impl RosFeedback {
    /// Starts a node that hears all vehicles of an experiment.
    ///
    /// # Errors
    /// When the node cannot be started.
    pub fn start(options: ViconOptions, experiment: &Experiment) -> Result<Self, RosError> {
        let (vehicles, per_control) = (experiment.vehicles.len(), experiment.rates.ticks_per_control());
        Ok(Self(ViconFeedback::new(Vicon::start(options)?, vehicles, per_control)))
    }
}

impl PoseFeedback for RosFeedback {
    fn receive(&mut self, city: &mut Client) -> Option<ClientEvent> {
        self.0.receive(city)
    }
}

/// Motion capture of the emulated robots, published over ROS.
#[derive(Debug)]
pub struct RosMotionCapture {
    vicon: Vicon,
    subjects: Arc<Vec<Subject>>,
}

impl RosMotionCapture {
    /// Starts a node that publishes the physical vehicles of an experiment.
    ///
    /// # Errors
    /// When the node cannot be started.
    pub fn start(options: ViconOptions, experiment: &Experiment) -> Result<Self, RosError> {
        let subjects = Arc::new(physical_subjects_of(experiment));
        Ok(Self { vicon: Vicon::start(options)?, subjects })
    }
}

impl CaptureEnd for RosMotionCapture {
    fn publish(&mut self, latency_s: f64, poses: Vec<Measurement>) {
        // As VICON's bridge stamps them: now, less the latency of the capture.
        self.vicon.publish(wall_s() - latency_s, &self.subjects, poses);
    }
}
