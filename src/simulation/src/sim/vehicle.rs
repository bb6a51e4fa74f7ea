//! One vehicle of the world: dynamics, tracking control and state.

use super::collision::{Collisions, Place};
use crate::scenario::Experiment;
use city3d_dynamics::physics::{BodyId, BodyState, FreeBody, Impetus, Physics};
use city3d_dynamics::vehicle::{
    Actuation, Dynamics, Motion, Tracker, VehicleModel, VehicleSpec, clears_ground,
};
use city3d_estimation::{LEFT_M, MotionSample, STANDS_MPS, StandstillChange, StandstillDetector};
use city3d_geometry::digest::{Digest, StateHash};
use city3d_protocol::snapshot::{
    Event, EventKind, Indicator, MeasuredPose, Pedals, Setup, Status, Trajectory, VehicleState,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The driving mode of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum DriveMode {
    Algorithm,
    Human(Pedals),
}

/// A vehicle that follows trajectories, the pedals of a person, or measured poses.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SimVehicle {
    /// State as snapshots show it.
    pub state: VehicleState,
    /// One for all that are built alike: what a tick reads of a large city should be little.
    spec: Arc<VehicleSpec>,
    dynamics: Dynamics,
    tracker: Tracker,
    driver: DriveMode,
    /// Time of the last trajectory; `None` before the first.
    last_trajectory_s: Option<f64>,
    sequence: Option<u32>,
    is_link_lost: bool,
    has_collided: bool,
    /// Odometer at the last collision.
    collided_at_m: f64,
    /// Standstill of a simulated vehicle; a physical one has its own detector.
    stand: StandstillDetector,
    /// As in the last trajectory.
    is_yielding: bool,
    /// The yield event has been reported.
    has_reported_yield: bool,
    is_finished: bool,
}

impl Digest for SimVehicle {
    fn digest(&self, hash: &mut StateHash) {
        let state = &self.state;
        hash.word(u64::from(state.id.0) << 8 | state.status as u64);
        state.position.digest(hash);
        state.orientation.digest(hash);
        state.velocity_mps.digest(hash);
        hash.numbers([state.yaw_rate_radps, state.steering_rad, state.gas, state.brake, state.handbrake]);
        hash.numbers([state.distance_m, self.collided_at_m]);
        self.dynamics.digest(hash);
        self.stand.digest(hash);
    }
}

impl SimVehicle {
    /// Adds the state that comes from commands, without the motion.
    pub fn digest_commands(&self, hash: &mut StateHash) {
        self.tracker.digest(hash);
        hash.optional(self.last_trajectory_s);
        hash.word(self.sequence.map_or(u64::MAX, u64::from));
        if let DriveMode::Human(pedals) = &self.driver {
            hash.numbers([pedals.gas, pedals.brake, pedals.handbrake, pedals.steering_rad]);
            hash.flags([pedals.reverse]);
        }
        let is_by_hand = matches!(self.driver, DriveMode::Human(_));
        hash.flags([is_by_hand, self.is_link_lost, self.has_collided, self.is_finished]);
        hash.flags([self.is_yielding, self.has_reported_yield, self.state.reverse]);
    }
}

/// Pedal travel at which brake lights come on.
const BRAKE_LIGHT_TRAVEL: f64 = 0.02;
/// Distance after a collision at which a manual vehicle is clear.
const CLEAR_AFTER_M: f64 = 5.0;
/// Around the upright box of a body within which the physics has no pairs of it: twice the skin of its broad phase and half
/// its prediction (0.04 and 0.02 m), and what a level body may be tilted over its outline.
const NEAR_M: f64 = 0.25;
/// So much farther from others a body is let go.
const KEPT_M: f64 = 0.3;

impl SimVehicle {
    /// Adds a vehicle to the physics, at the pose and the speed of its setup. `like` may be built alike.
    pub fn spawn(setup: &Setup, physics: &mut Physics, experiment: &Experiment, like: Option<&Self>) -> Self {
        let (spec, start) = (&setup.spec, (setup.pose, setup.speed_mps));
        let shared = like.map(|like| &like.spec).filter(|shared| ***shared == *spec);
        let mut dynamics = Dynamics::spawn(physics, spec, start, experiment.scale);
        let motion = dynamics.read_back(physics, spec, experiment.rates.dt_s());
        let mut vehicle = Self {
            state: VehicleState { id: setup.id, ..VehicleState::default() },
            spec: shared.map_or_else(|| Arc::new(spec.clone()), Arc::clone),
            dynamics,
            tracker: Tracker::default(),
            driver: DriveMode::Algorithm,
            last_trajectory_s: None,
            sequence: None,
            is_link_lost: false,
            has_collided: false,
            collided_at_m: 0.0,
            stand: StandstillDetector::default(),
            is_yielding: false,
            has_reported_yield: false,
            is_finished: false,
        };
        vehicle.describe(&motion);
        vehicle
    }

    /// Its body in the physics.
    pub fn body(&self) -> BodyId {
        self.dynamics.body()
    }

    /// Pose and velocity of its body.
    pub fn body_state(&self, physics: &Physics) -> Option<BodyState> {
        self.dynamics.body_state(physics)
    }

    /// Whether its body moves by itself.
    pub fn is_free(&self) -> bool {
        self.dynamics.is_free()
    }

    /// Gives its body to the physics in the next step, where it `is_near` others, or lets it move by itself.
    pub fn hold_if(&mut self, is_near: bool, physics: &mut Physics) {
        if is_near {
            self.dynamics.hold(physics);
        } else {
            self.dynamics.release(physics);
        }
    }

    /// Its body while that moves by itself.
    pub fn free_body_mut(&mut self) -> Option<&mut FreeBody> {
        self.dynamics.free_body_mut()
    }

    /// Brings what the next step reads of its path to the processor's cache; of all of it, where a trajectory has come.
    pub fn fetch(&self, has_trajectory: bool) {
        self.tracker.fetch(has_trajectory);
    }

    /// Where it is. Its body needs the physics in any case where it may come down on the ground.
    pub fn place(&self, dt_s: f64) -> Place {
        let outline = self.state.outline(&self.spec.dimensions);
        // Who is held stays so a little longer than needed to begin: to change over takes time.
        let is_held = !self.is_free();
        let kept_m = if is_held { KEPT_M } else { 0.0 };
        Place {
            outline,
            radius_m: outline.radius(),
            margin_m: NEAR_M + kept_m + 2.0 * dt_s * self.state.speed_mps.abs(),
            gives_way: self.dynamics.gives_way(),
            is_held,
            is_near: !clears_ground(&self.spec, &Motion::of(&self.state), dt_s),
        }
    }

    /// Removes its body from the physics.
    pub fn leave(mut self, physics: &mut Physics) {
        self.dynamics.remove(physics);
    }

    /// Resets the sequence number: its sender has restarted.
    pub fn reset_sequence(&mut self) {
        self.sequence = None;
    }

    /// Accepts a newer trajectory. Older, repeated and outdated ones (ended before the link timeout) are
    /// dropped.
    pub fn follow(&mut self, trajectory: &Trajectory, time_s: f64, link_timeout_s: f64) {
        let is_new = self.sequence.is_none_or(|last| trajectory.follows(last));
        if !is_new || trajectory.is_over(time_s - link_timeout_s) {
            return;
        }
        self.sequence = Some(trajectory.sequence);
        self.last_trajectory_s = Some(time_s);
        self.is_finished = trajectory.finished;
        self.is_yielding = trajectory.yielding;
        if self.state.status != Status::Unseen {
            self.state.indicator = trajectory.indicator;
        }
        self.tracker.follow(trajectory);
    }

    /// Adds a measured pose of a physical vehicle. While the clock is stopped it applies at once.
    pub fn measure(&mut self, pose: &MeasuredPose, physics: &Physics, time_s: f64, is_running: bool) {
        let Dynamics::Measured(measured) = &mut self.dynamics else { return };
        // A clock that is ahead must not lock out later poses.
        measured.take(&MeasuredPose { stamp_s: pose.stamp_s.min(time_s), ..*pose });
        if !is_running {
            measured.carry_to(time_s, &self.spec, 0.0);
            let motion = self.dynamics.read_back(physics, &self.spec, 0.0);
            self.describe(&motion);
        }
    }

    /// Whether it is a physical vehicle.
    fn is_physical(&self) -> bool {
        matches!(self.dynamics, Dynamics::Measured(_))
    }

    /// Whether a physical vehicle is measured. `None` before its first pose.
    fn is_seen(&self) -> Option<bool> {
        if let Dynamics::Measured(measured) = &self.dynamics { measured.is_seen() } else { None }
    }

    /// Starts in manual mode with released pedals.
    pub fn start_manual(&mut self) {
        self.drive(Some(Pedals::default()), &Collisions::default());
        self.update_status();
    }

    /// Switches to manual mode or back. A person may continue after a collision; who still touches something has collided until
    /// it is clear.
    pub fn drive(&mut self, pedals: Option<Pedals>, contacts: &Collisions) {
        let was_human = matches!(self.driver, DriveMode::Human(_));
        match pedals {
            Some(pedals) => {
                self.has_collided &= was_human || contacts.hold(self.state.id);
                self.driver = DriveMode::Human(pedals);
            }
            // The tracked path is where the person took over.
            None if was_human => {
                self.driver = DriveMode::Algorithm;
                self.tracker = Tracker::default();
            }
            None => {}
        }
    }

    /// Notes a collision: without a person the vehicle brakes to a standstill and stays. A physical one feels nothing of it, and
    /// its status goes on telling what it does: the event tells of the collision.
    pub fn collide(&mut self) {
        if self.is_physical() {
            return;
        }
        self.has_collided = true;
        self.collided_at_m = self.state.distance_m;
        self.update_status();
    }

    /// Before the physics step: what its actuation does to its body.
    pub fn actuate(
        &mut self,
        physics: &Physics,
        time_s: f64,
        dt_s: f64,
        link_timeout_s: f64,
        events: &mut Vec<Event>,
    ) -> Option<Impetus> {
        self.watch_link(time_s, link_timeout_s, events);
        let tracking = self.tracker.step(&self.spec, &Motion::of(&self.state), time_s, dt_s);
        self.state.lateral_error_m = tracking.lateral_error_m;
        let actuation = match self.driver {
            DriveMode::Human(pedals) => {
                self.state.indicator = pedals.indicator;
                Actuation {
                    gas: pedals.gas.clamp(0.0, 1.0),
                    brake: pedals.brake.clamp(0.0, 1.0),
                    handbrake: pedals.handbrake.clamp(0.0, 1.0),
                    steering_rad: pedals.steering_rad,
                    reverse: pedals.reverse,
                }
            }
            DriveMode::Algorithm if self.has_collided => {
                Actuation { brake: 0.8, steering_rad: self.state.steering_rad, ..Actuation::default() }
            }
            DriveMode::Algorithm => tracking.actuation,
        };
        self.state.gas = actuation.gas;
        self.state.brake = actuation.brake;
        self.state.handbrake = actuation.handbrake;
        self.state.reverse = actuation.reverse;
        self.state.brake_lights =
            actuation.brake > BRAKE_LIGHT_TRAVEL || actuation.handbrake > BRAKE_LIGHT_TRAVEL;
        if let Dynamics::Measured(measured) = &mut self.dynamics {
            measured.carry_to(time_s + dt_s, &self.spec, dt_s);
        }
        self.dynamics.actuate(physics, &self.spec, &actuation, dt_s)
    }

    fn watch_link(&mut self, time_s: f64, link_timeout_s: f64, events: &mut Vec<Event>) {
        let Some(last_trajectory_s) = self.last_trajectory_s else { return };
        // Manual vehicles need no link, and physical ones have their own.
        if matches!(self.driver, DriveMode::Human(_)) || self.is_physical() {
            return;
        }
        let is_lost = time_s - last_trajectory_s > link_timeout_s;
        if is_lost {
            self.tracker.stop_on_path();
        }
        if is_lost != self.is_link_lost {
            self.is_link_lost = is_lost;
            let kind = if is_lost { EventKind::LinkLost } else { EventKind::LinkBack };
            events.push(Event { time_s, vehicle: self.state.id, kind });
        }
    }

    /// After the physics step.
    pub fn read_back(
        &mut self,
        physics: &Physics,
        (time_s, dt_s): (f64, f64),
        contacts: &Collisions,
        events: &mut Vec<Event>,
    ) {
        let before = self.state.status;
        let motion = self.dynamics.read_back(physics, &self.spec, dt_s);
        self.state.distance_m = match &self.dynamics {
            Dynamics::Measured(measured) => measured.distance_m(),
            _ => self.state.distance_m + motion.speed_mps.abs() * dt_s,
        };
        let is_clear = self.state.distance_m - self.collided_at_m > CLEAR_AFTER_M;
        let may_go_on = matches!(self.driver, DriveMode::Human(_));
        if self.has_collided && is_clear && may_go_on && !contacts.hold(self.state.id) {
            self.has_collided = false;
        }
        self.describe(&motion);
        self.note_standing(time_s, events);
        self.note_status(before, time_s, events);
    }

    fn describe(&mut self, motion: &Motion) {
        let state = &mut self.state;
        state.position = motion.position;
        state.orientation = motion.orientation;
        state.velocity_mps = motion.velocity_mps;
        state.speed_mps = motion.speed_mps;
        state.acceleration_mps2 = motion.acceleration_mps2;
        state.yaw_rate_radps = motion.yaw_rate_radps;
        state.steering_rad = motion.steering_rad;
        state.wheels = motion.wheels;
        self.update_status();
    }

    fn note_standing(&mut self, time_s: f64, events: &mut Vec<Event>) {
        let change = match &self.dynamics {
            Dynamics::Measured(measured) => measured.stand_change(),
            _ => {
                let seen = MotionSample::exact(self.state.speed_mps, self.state.position.truncate());
                self.stand.update(time_s, &seen)
            }
        };
        let kind = match change {
            Some(StandstillChange::Stopped) => EventKind::Stop,
            Some(StandstillChange::MovedOff { stood_s }) => EventKind::Go { stood_s },
            None => return,
        };
        events.push(Event { time_s, vehicle: self.state.id, kind });
    }

    fn note_status(&mut self, before: Status, time_s: f64, events: &mut Vec<Event>) {
        self.update_status();
        let (vehicle, after) = (self.state.id, self.state.status);
        let mut happened = |kind| events.push(Event { time_s, vehicle, kind });
        // A yield interrupted for a while is still the same.
        if !self.is_yielding {
            self.has_reported_yield = false;
        } else if after == Status::Yielding && !self.has_reported_yield {
            self.has_reported_yield = true;
            happened(EventKind::Yield);
        }
        if before == after {
            return;
        }
        // A vehicle shown where it has not been measured flashes all indicators.
        if before == Status::Unseen {
            self.state.indicator = Indicator::Off;
            happened(EventKind::SeenAgain);
        }
        match after {
            Status::Unseen => {
                self.state.indicator = Indicator::Hazard;
                happened(EventKind::Unseen);
            }
            Status::Finished => happened(EventKind::Finish),
            _ => {}
        }
    }

    fn stands(&self) -> bool {
        match &self.dynamics {
            // One that has not left its start stands.
            Dynamics::Measured(measured) => measured.is_standing() || measured.distance_m() < LEFT_M,
            _ => self.stand.is_standing() && !self.stand.is_moving_off(),
        }
    }

    fn moves(&self) -> bool {
        self.state.speed_mps.abs() >= STANDS_MPS
    }

    fn update_status(&mut self) {
        self.state.status = match self.driver {
            _ if self.has_collided => Status::Collided,
            // A physical vehicle has a link and a driver of its own.
            _ if self.is_physical() => match self.is_seen() {
                None => Status::Waiting,
                Some(false) => Status::Unseen,
                Some(true) => self.driven_status(),
            },
            DriveMode::Human(_) => Status::Manual,
            // One that was spawned in motion drives until it stands.
            DriveMode::Algorithm if self.last_trajectory_s.is_none() && !self.moves() => Status::Waiting,
            DriveMode::Algorithm if self.is_link_lost => Status::LinkLost,
            DriveMode::Algorithm => self.driven_status(),
        };
    }

    /// Status of a vehicle that follows trajectories.
    fn driven_status(&self) -> Status {
        if self.is_finished {
            Status::Finished
        } else if self.is_yielding {
            Status::Yielding
        } else if self.stands() {
            Status::Stopped
        } else {
            Status::Driving
        }
    }
}
