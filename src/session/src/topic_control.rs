//! A control framework that sends its trajectories by topics instead of datagrams, such as a node of ROS 2. The city sets up
//! the vehicles of its scenario for it, and the first trajectory starts the experiment.

use super::remote::setup_of;
use city3d_geometry::Lab;
use city3d_network::link::exchange::{EPOCH_S, ReceivedTrajectory, TrajectoryExchange, wall_s};
use city3d_protocol::snapshot::{Trajectory, VehicleId};
use city3d_protocol::wire::{Body, ExperimentAction, ExperimentPhase};
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Trajectories that come by topics, as what a sender of the link would have sent.
#[derive(Debug)]
pub(super) struct TopicControl {
    exchange: Box<dyn TrajectoryExchange>,
    /// With its vehicles.
    experiment: Arc<Experiment>,
    has_set_up: bool,
    /// Requests so far.
    requests: u32,
    /// Number of the last trajectory of each vehicle.
    sequences: BTreeMap<VehicleId, u32>,
}

impl TopicControl {
    pub(super) fn new(exchange: Box<dyn TrajectoryExchange>, experiment: Arc<Experiment>) -> Self {
        Self { exchange, experiment, has_set_up: false, requests: 0, sequences: BTreeMap::new() }
    }

    fn request(&mut self) -> u32 {
        self.requests += 1;
        self.requests
    }

    /// What has come since the last call, at a simulated time.
    pub(super) fn due(&mut self, time_s: f64, phase: ExperimentPhase) -> Vec<Body> {
        let mut bodies = Vec::new();
        if !std::mem::replace(&mut self.has_set_up, true) {
            let experiment = Arc::clone(&self.experiment);
            for planned in &experiment.vehicles {
                let setup = Box::new(setup_of(&experiment, planned, None));
                bodies.push(Body::Setup { request: self.request(), setup });
            }
        }
        let is_running = phase == ExperimentPhase::Running;
        let mut is_started = phase != ExperimentPhase::Ready;
        while let Some(received) = self.exchange.next() {
            let Some(trajectory) = self.at_city_time(received, time_s, is_running) else { continue };
            if !std::mem::replace(&mut is_started, true) {
                bodies.push(Body::Command { request: self.request(), action: ExperimentAction::Start });
            }
            bodies.push(Body::Trajectories(vec![trajectory]));
        }
        bodies
    }

    /// Puts a trajectory on the clock of the city, and numbers it; `None` where it begins before the city does.
    fn at_city_time(
        &mut self,
        received: ReceivedTrajectory,
        time_s: f64,
        is_running: bool,
    ) -> Option<Trajectory<Lab>> {
        let ReceivedTrajectory { stamp_s, mut trajectory } = received;
        let begins_s = match is_running {
            _ if stamp_s < EPOCH_S => stamp_s,
            true => time_s + stamp_s - wall_s(),
            false => time_s,
        };
        trajectory.points.iter_mut().for_each(|point| point.time_s += begins_s);
        if trajectory.points.first().is_none_or(|first| first.time_s < 0.0) {
            return None;
        }
        let sequence = self.sequences.entry(trajectory.vehicle).or_default();
        *sequence = sequence.wrapping_add(1);
        trajectory.sequence = *sequence;
        Some(trajectory)
    }
}
