//! A vehicle alone on the plane, driven by hand or along a route.

#![allow(dead_code, reason = "each test uses its own part")]

use city3d_dynamics::physics::Physics;
use city3d_dynamics::vehicle::{
    Actuation, Dynamics, ModelKind, Motion, Tracker, Tracking, VehicleModel, VehicleSpec,
};
use city3d_geometry::{Curve, LengthScale, Pose2, Segment};
use city3d_protocol::snapshot::{Indicator, Trajectory, TrajectoryPoint, VehicleId};
use serde::{Deserialize, Serialize};

pub const DT: f64 = 0.01;
pub const MODELS: [ModelKind; 2] = [ModelKind::Raycast, ModelKind::Bicycle];

pub fn spec(model: ModelKind) -> VehicleSpec {
    VehicleSpec { model, ..VehicleSpec::default() }
}

/// One vehicle and the physics around it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Rig {
    pub physics: Physics,
    pub spec: VehicleSpec,
    pub dynamics: Dynamics,
    pub tracker: Tracker,
    pub motion: Motion,
    pub tick: u64,
}

impl Rig {
    /// `pose` is the middle of the outline.
    pub fn new(spec: VehicleSpec, pose: Pose2, speed: f64) -> Self {
        assert_eq!(spec.validate(), []);
        let mut physics = Physics::new(DT);
        let mut dynamics = Dynamics::spawn(&mut physics, &spec, (pose, speed), LengthScale::TESTBED);
        let motion = dynamics.read_back(&physics, &spec, DT);
        Self { physics, spec, dynamics, tracker: Tracker::default(), motion, tick: 0 }
    }

    /// With the front axle at the start of a route, moved to its left.
    pub fn on(spec: VehicleSpec, route: &Curve, left: f64, speed: f64) -> Self {
        let start = route.start();
        let pose = Pose2::at(start.point_at(-spec.dimensions.front_axle_m(), left), start.yaw_rad);
        Self::new(spec, pose, speed)
    }

    pub fn time(&self) -> f64 {
        self.tick as f64 * DT
    }

    pub fn drive(&mut self, actuation: &Actuation) {
        let impetus = self.dynamics.actuate(&self.physics, &self.spec, actuation, DT);
        if let Some(impetus) = impetus {
            self.physics.impel(self.dynamics.body(), &impetus);
        }
        self.physics.step();
        self.motion = self.dynamics.read_back(&self.physics, &self.spec, DT);
        self.tick += 1;
    }

    pub fn track(&mut self) -> Tracking {
        let time = self.time();
        let tracking = self.tracker.step(&self.spec, &self.motion, time, DT);
        self.drive(&tracking.actuation);
        tracking
    }

    pub fn front(&self) -> Pose2 {
        self.motion.pose().advanced(self.spec.dimensions.front_axle_m())
    }
}

pub fn gas() -> Actuation {
    Actuation { gas: 1.0, ..Actuation::default() }
}

pub fn brake() -> Actuation {
    Actuation { brake: 1.0, ..Actuation::default() }
}

/// A front-axle route that begins at the origin: pieces of (length, curvature).
pub fn route(heading: f64, pieces: &[(f64, f64)]) -> Curve {
    let mut start = Pose2::new(0.0, 0.0, heading);
    let segments = pieces
        .iter()
        .map(|&(length, curvature)| {
            let segment = Segment::new(start, length, curvature);
            start = segment.end();
            segment
        })
        .collect();
    Curve::new(segments)
}

/// A plan: where on a route a vehicle shall be at a time, and how fast.
pub trait Plan {
    fn at(&self, time: f64) -> (f64, f64);
}

impl<F: Fn(f64) -> (f64, f64)> Plan for F {
    fn at(&self, time: f64) -> (f64, f64) {
        self(time)
    }
}

/// The next `horizon` seconds of a plan.
pub fn trajectory(route: &Curve, plan: &impl Plan, from: f64, horizon: f64, spacing: f64) -> Trajectory {
    let count = (horizon / spacing).round() as u32;
    let points = (0..=count)
        .map(|k| {
            let time_s = from + f64::from(k) * spacing;
            let (station, speed_mps) = plan.at(time_s);
            TrajectoryPoint { time_s, pose: route.at(station).pose, speed_mps }
        })
        .collect();
    Trajectory {
        vehicle: VehicleId(1),
        sequence: 0,
        points,
        yielding: false,
        finished: false,
        indicator: Indicator::Off,
    }
}

/// Largest lateral errors of a run along a route: by the tracker's own account, and measured against
/// the exact route.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    pub tracker: f64,
    pub exact: f64,
    pub last: f64,
    pub longitudinal: f64,
    pub least_throttle: f64,
}

/// Follows a plan, sent anew at 50 Hz, for some seconds; errors count after the first `settle` ones.
pub fn follow(rig: &mut Rig, route: &Curve, plan: &impl Plan, seconds: f64, settle: f64) -> Errors {
    let mut errors = Errors::default();
    let begin = rig.time();
    let steps = (seconds / DT).round() as u32;
    for k in 0..steps {
        if k % 2 == 0 {
            rig.tracker.follow(&trajectory(route, plan, rig.time(), 4.0, 0.1));
        }
        let tracking = rig.track();
        let front = rig.front().position;
        let (station, _) = plan.at(rig.time());
        let near = route.project_within(front, station - 6.0, station + 6.0);
        errors.least_throttle = errors.least_throttle.min(tracking.throttle);
        errors.last = near.lateral;
        if rig.time() - begin >= settle {
            errors.tracker = errors.tracker.max(tracking.lateral_error_m.abs());
            errors.exact = errors.exact.max(near.lateral.abs());
            errors.longitudinal = errors.longitudinal.max((near.s - station).abs());
        }
    }
    errors
}
