//! Emulator of the laboratory's robots and motion capture, without sockets or wall-clock time.
//!
//! Robots drive in full-scale metres as kinematic bicycles, with a first-order lag of pedals and steering
//! ([`EnvironmentSpec::actuator_lag_s`]). An [`Environment`] delays and disturbs their link.

use crate::environment::{Environment, EnvironmentSpec};
use crate::scenario::{Experiment, PlannedVehicle};
use city3d_dynamics::physics::Physics;
use city3d_dynamics::vehicle::{Actuation, Dynamics, Motion, Tracker, VehicleModel};
use city3d_geometry::{Lab, LengthScale, Pose2};
use city3d_protocol::snapshot::{ModelKind, SimCommand, Trajectory, VehicleId, VehicleSpec};
use city3d_protocol::wire::{Measurement, Message};
use std::collections::BTreeMap;

/// Actuation that holds a robot while the experiment does not run.
const HOLDING: Actuation =
    Actuation { gas: 0.0, brake: 1.0, handbrake: 1.0, steering_rad: 0.0, reverse: false };

/// Clock synchronisation: smaller offsets are slewed by this share at each update, larger ones are stepped.
const STEP_THRESHOLD_S: f64 = 0.05;
const SLEW_SHARE: f64 = 0.1;

/// The experiment's clock, as the controller has sent it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExperimentClock {
    /// Simulated time of the experiment, seconds.
    pub time_s: f64,
    /// Whether the experiment runs; robots hold while it does not.
    pub is_running: bool,
}

/// The emulated robots of an experiment.
#[derive(Debug)]
pub struct Testbed {
    scale: LengthScale,
    dt_s: f64,
    link_timeout_s: f64,
    lag_s: f64,
    physics: Physics,
    robots: BTreeMap<VehicleId, Robot>,
    environment: Environment,
    /// Steps since the start: the clock of delays.
    ticks: u64,
    clock: ExperimentClock,
    sent: Vec<Message>,
    delivered: Vec<Message>,
}

/// One emulated robot.
#[derive(Debug)]
struct Robot {
    spec: VehicleSpec,
    /// City metres.
    start: Pose2,
    dynamics: Dynamics,
    motion: Motion,
    tracker: Tracker,
    /// Actual pedals and steering, behind the requested ones.
    actuation: Actuation,
    /// Time of the last trajectory, by the experiment's clock.
    last_trajectory_s: Option<f64>,
    sequence: Option<u32>,
}

impl Testbed {
    /// Emulates the physical vehicles of an experiment, at their starts.
    pub fn new(experiment: &Experiment) -> Self {
        let dt_s = experiment.rates.dt_s();
        let mut physics = Physics::new(dt_s);
        let physical = experiment.vehicles.iter().filter(|planned| planned.physical.is_some());
        let robots =
            physical.map(|planned| (planned.id, Robot::new(planned, experiment, &mut physics))).collect();
        let spec: EnvironmentSpec = experiment.testbed;
        Self {
            scale: experiment.scale,
            dt_s,
            link_timeout_s: experiment.link_timeout_s,
            lag_s: spec.actuator_lag_s,
            physics,
            robots,
            // The lag is in the dynamics here, not in the trajectories.
            environment: Environment::new(EnvironmentSpec { actuator_lag_s: 0.0, ..spec }, experiment.seed),
            ticks: 0,
            clock: ExperimentClock::default(),
            sent: Vec::new(),
            delivered: Vec::new(),
        }
    }

    /// Seconds since the start of the emulation.
    pub fn time_s(&self) -> f64 {
        self.ticks as f64 * self.dt_s
    }

    /// The experiment's clock, as the robots continue it between two synchronisations.
    pub fn clock(&self) -> ExperimentClock {
        self.clock
    }

    /// Synchronises with the experiment's clock. A reset puts the robots back to their starts, as a person does in the
    /// laboratory.
    pub fn set_clock(&mut self, clock: ExperimentClock) {
        let is_reset = !clock.is_running && clock.time_s == 0.0 && self.clock.time_s > 0.0;
        let ahead_s = clock.time_s - self.clock.time_s;
        if clock.is_running && self.clock.is_running && ahead_s.abs() < STEP_THRESHOLD_S {
            // Jitter of the network: the offset is slewed, not stepped.
            self.clock.time_s += ahead_s * SLEW_SHARE;
        } else {
            self.clock = clock;
        }
        if is_reset {
            for robot in self.robots.values_mut() {
                robot.reset(&mut self.physics, self.scale, self.dt_s);
            }
        }
    }

    /// Accepts any sequence number next: another controller takes over.
    pub fn reset_sequence(&mut self, vehicle: VehicleId) {
        if let Some(robot) = self.robots.get_mut(&vehicle) {
            robot.sequence = None;
        }
    }

    /// Sends a trajectory; the environment delays or loses it.
    pub fn follow(&mut self, trajectory: &Trajectory<Lab>) {
        if self.robots.contains_key(&trajectory.vehicle) {
            self.sent.push(Message::Follow(trajectory.clone()));
        }
    }

    /// Makes one step; adds the poses that arrive from motion capture by then, stamped with the experiment's clock.
    pub fn step(&mut self, arrived: &mut Vec<Measurement>) {
        self.delivered.clear();
        self.environment.command(self.time_s(), self.sent.drain(..), &mut self.delivered);
        for message in self.delivered.drain(..) {
            if let SimCommand::Follow(trajectory) = message.into_command(self.scale)
                && let Some(robot) = self.robots.get_mut(&trajectory.vehicle)
            {
                robot.follow(&trajectory, self.clock.time_s, self.link_timeout_s);
            }
        }
        let share = if self.lag_s > 0.0 { (self.dt_s / self.lag_s).min(1.0) } else { 1.0 };
        for robot in self.robots.values_mut() {
            let requested = robot.requested_actuation(self.clock, self.dt_s, self.link_timeout_s);
            robot.apply_lag(&requested, share);
            let impetus = robot.dynamics.actuate(&self.physics, &robot.spec, &robot.actuation, self.dt_s);
            if let Some(impetus) = impetus {
                self.physics.impel(robot.dynamics.body(), &impetus);
            }
        }
        self.physics.step();
        self.ticks += 1;
        if self.clock.is_running {
            self.clock.time_s += self.dt_s;
        }
        for robot in self.robots.values_mut() {
            robot.motion = robot.dynamics.read_back(&self.physics, &robot.spec, self.dt_s);
        }
        let (now_s, stamp_s, scale) = (self.time_s(), self.clock.time_s, self.scale);
        let seen = self.robots.iter().map(|(id, robot)| Measurement {
            vehicle: *id,
            stamp_s,
            position: robot.motion.position / scale.factor(),
            orientation: robot.motion.orientation,
        });
        self.environment.measure(now_s, seen, arrived);
    }
}

impl Robot {
    fn new(planned: &PlannedVehicle, experiment: &Experiment, physics: &mut Physics) -> Self {
        let setup = planned.setup(&experiment.city_map, experiment.scale);
        let spec = VehicleSpec { model: ModelKind::Bicycle, ..setup.spec };
        let mut dynamics = Dynamics::spawn(physics, &spec, (setup.pose, 0.0), experiment.scale);
        let motion = dynamics.read_back(physics, &spec, experiment.rates.dt_s());
        Self {
            spec,
            start: setup.pose,
            dynamics,
            motion,
            tracker: Tracker::default(),
            actuation: HOLDING,
            last_trajectory_s: None,
            sequence: None,
        }
    }

    fn reset(&mut self, physics: &mut Physics, scale: LengthScale, dt_s: f64) {
        self.dynamics.remove(physics);
        self.dynamics = Dynamics::spawn(physics, &self.spec, (self.start, 0.0), scale);
        self.motion = self.dynamics.read_back(physics, &self.spec, dt_s);
        (self.tracker, self.actuation) = (Tracker::default(), HOLDING);
        (self.last_trajectory_s, self.sequence) = (None, None);
    }

    fn follow(&mut self, trajectory: &Trajectory, time_s: f64, link_timeout_s: f64) {
        let is_new = self.sequence.is_none_or(|last| trajectory.follows(last));
        if is_new && !trajectory.is_over(time_s - link_timeout_s) {
            (self.sequence, self.last_trajectory_s) = (Some(trajectory.sequence), Some(time_s));
            self.tracker.follow(trajectory);
        }
    }

    /// Tracks the trajectory: the requested pedals and steering.
    fn requested_actuation(&mut self, clock: ExperimentClock, dt_s: f64, link_timeout_s: f64) -> Actuation {
        let Some(last_trajectory_s) = self.last_trajectory_s.filter(|_| clock.is_running) else {
            return Actuation { steering_rad: self.actuation.steering_rad, ..HOLDING };
        };
        if clock.time_s - last_trajectory_s > link_timeout_s {
            self.tracker.stop_on_path();
        }
        self.tracker.step(&self.spec, &self.motion, clock.time_s, dt_s).actuation
    }

    /// First-order lag of the actuators.
    fn apply_lag(&mut self, requested: &Actuation, share: f64) {
        let now = &mut self.actuation;
        for (value, requested) in [
            (&mut now.gas, requested.gas),
            (&mut now.brake, requested.brake),
            (&mut now.handbrake, requested.handbrake),
            (&mut now.steering_rad, requested.steering_rad),
        ] {
            *value += (requested - *value) * share;
        }
        now.reverse = requested.reverse;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Library, Overrides, read_experiment};
    use city3d_geometry::{Segment, wrap_angle};
    use city3d_protocol::snapshot::TrajectoryPoint;

    /// Desired path of a robot's front axle, full scale: from a stand into an arc.
    struct Path {
        straight: Segment,
        arc: Segment,
    }

    const SPEED_MPS: f64 = 6.0;
    const GAINED_MPS2: f64 = 1.5;

    impl Path {
        fn from(start: Pose2) -> Self {
            let straight = Segment::new(start, 12.0, 0.0);
            Self { straight, arc: Segment::new(straight.end(), 120.0, 1.0 / 20.0) }
        }

        fn at(&self, s: f64) -> Pose2 {
            let beyond = s - self.straight.length;
            if beyond < 0.0 { self.straight.pose_at(s) } else { self.arc.pose_at(beyond) }
        }

        /// The trajectory at a time: two seconds ahead, of a vehicle that starts to move at 0.
        fn trajectory(
            &self,
            vehicle: VehicleId,
            sequence: u32,
            now_s: f64,
            scale: LengthScale,
        ) -> Trajectory<Lab> {
            let gaining_s = SPEED_MPS / GAINED_MPS2;
            let point = |k: u32| {
                let time_s = now_s + 0.1 * f64::from(k);
                let t = time_s.min(gaining_s);
                let s = 0.5 * GAINED_MPS2 * t * t + SPEED_MPS * (time_s - gaining_s).max(0.0);
                let pose = self.at(s).to_lab(scale);
                TrajectoryPoint { time_s, pose, speed_mps: GAINED_MPS2 * t / scale.factor() }
            };
            Trajectory { vehicle, sequence, points: (0..=20).map(point).collect(), ..Trajectory::default() }
        }

        fn distance(&self, point: glam::DVec2) -> f64 {
            (0..1320)
                .map(|k| self.at(0.1 * f64::from(k)).position.distance(point))
                .fold(f64::INFINITY, f64::min)
        }
    }

    #[test]
    fn robots_that_are_no_longer_driven_brake_to_a_stand_on_their_path() {
        let (text, library) = Library::scenario("mixed").unwrap();
        let experiment = read_experiment("mixed", &text, &library, Overrides::default()).unwrap();
        let mut testbed = Testbed::new(&experiment);
        let axle = |robot: &Robot| robot.start.advanced(robot.spec.dimensions.front_axle_m());
        let paths: BTreeMap<VehicleId, Path> =
            testbed.robots.iter().map(|(id, robot)| (*id, Path::from(axle(robot)))).collect();
        let id = *paths.keys().next().unwrap();
        assert!(paths.len() == 3);
        testbed.set_clock(ExperimentClock { time_s: 0.0, is_running: true });
        let (mut arrived, mut speeds, mut accelerations) = (Vec::new(), Vec::new(), Vec::new());
        let last_heard_s = 6.0;
        let mut sequence = 0;
        while testbed.clock().time_s < 12.0 {
            let now_s = testbed.clock().time_s;
            if now_s < last_heard_s {
                sequence += 1;
                for (id, path) in &paths {
                    testbed.follow(&path.trajectory(*id, sequence, now_s, experiment.scale));
                }
            }
            testbed.step(&mut arrived);
            for (id, robot) in &testbed.robots {
                let axle = robot.motion.position.truncate()
                    + robot.motion.forward() * robot.spec.dimensions.front_axle_m();
                let aside_m = paths[id].distance(axle);
                assert!(aside_m < 0.5, "{id} is {aside_m} m aside at {now_s} s");
            }
            let motion = &testbed.robots[&id].motion;
            speeds.push(motion.speed_mps);
            accelerations.push(motion.acceleration_mps2);
        }
        let dt_s = experiment.rates.dt_s();
        let at = |time_s: f64| speeds[(time_s / dt_s) as usize];
        assert!((at(last_heard_s) - SPEED_MPS).abs() < 0.5, "{} m/s where the link ends", at(last_heard_s));
        let turned =
            wrap_angle(testbed.robots[&id].motion.pose().yaw_rad - paths[&id].straight.start.yaw_rad);
        assert!(turned.abs() > 0.5, "it stops on the arc, {turned} rad on");
        // The last trajectory ends two seconds later; before that the robot counts the link as lost.
        let braked_s = (0..).find(|k| at(last_heard_s + 0.01 * f64::from(*k)) < SPEED_MPS - 1.0).unwrap();
        let waited_s = 0.01 * f64::from(braked_s);
        assert!(
            (experiment.link_timeout_s..experiment.link_timeout_s + 0.8).contains(&waited_s),
            "brakes after {waited_s} s"
        );
        assert!(at(11.9).abs() < 1e-3, "{} m/s at the end", at(11.9));
        let hardest = -accelerations.iter().copied().fold(0.0, f64::min);
        assert!((2.0..5.3).contains(&hardest), "{hardest} m/s2");
    }
}
