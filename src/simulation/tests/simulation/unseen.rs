//! A vehicle that motion capture loses for good, whatever it does meanwhile: nobody runs into it.

use city3d_control::Mainframe;
use city3d_geometry::lab::Pose2;
use city3d_geometry::{Lab, OrientedRect};
use city3d_protocol::snapshot::{MeasuredPose, SimCommand, Status, Trajectory, TrajectoryPoint, VehicleId};
use city3d_protocol::wire::{Measurement, Message};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use city3d_simulation::sim::World;
use glam::{DQuat, DVec3};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

const STEP_S: f64 = 0.02;
/// As hard as any of them brakes, laboratory metres.
const BRAKING_MPS2: f64 = 0.2;

/// What a vehicle does that nobody sees.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Blind {
    BrakesAtOnce,
    /// By the last thing that it heard, and brakes when it notices that it hears nothing.
    GoesOn {
        for_s: f64,
    },
    /// Hears everything all the time.
    Obeys,
}

struct Car {
    id: VehicleId,
    length_m: f64,
    width_m: f64,
    front_axle_m: f64,
    plan: Option<Trajectory<Lab>>,
    /// Of its front axle.
    pose: Pose2,
    speed_mps: f64,
    /// The latest of its speeds, and the hardest deceleration over all of them.
    speeds_mps: VecDeque<f64>,
    hardest_mps2: f64,
}

/// Steps over which a deceleration is taken: a single one has the corrections of the plan.
const STEPS: usize = 10;

impl Car {
    fn outline(&self) -> OrientedRect {
        OrientedRect::new(self.middle(), self.length_m, self.width_m)
    }

    fn middle(&self) -> Pose2 {
        self.pose.advanced(-self.front_axle_m)
    }

    fn measured(&self, stamp_s: f64) -> Measurement {
        let middle = self.middle();
        let orientation = DQuat::from_rotation_z(middle.yaw_rad);
        Measurement { vehicle: self.id, stamp_s, position: DVec3::from((middle.position, 0.0)), orientation }
    }

    /// Does exactly what its plan wants.
    fn follow(&mut self, time_s: f64) {
        let Some(plan) = &self.plan else { return };
        let point = at(&plan.points, |point| point.time_s, time_s);
        if self.speeds_mps.len() == STEPS {
            let before_mps = self.speeds_mps.pop_front().unwrap();
            let change_mps2 = (point.speed_mps - before_mps) / (STEPS as f64 * STEP_S);
            self.hardest_mps2 = self.hardest_mps2.min(change_mps2);
        }
        self.speeds_mps.push_back(point.speed_mps);
        (self.pose, self.speed_mps) = (point.pose, point.speed_mps);
    }

    /// Stays on the way of its plan and brakes.
    fn brake(&mut self) {
        let Some(plan) = &self.plan else { return };
        let after_mps = (self.speed_mps - BRAKING_MPS2 * STEP_S).max(0.0);
        let way_m = (self.speed_mps + after_mps) / 2.0 * STEP_S;
        self.speed_mps = after_mps;
        // Along the plan's poses, by the way from its first one.
        let mut ways = vec![0.0];
        for pair in plan.points.windows(2) {
            ways.push(ways[ways.len() - 1] + pair[0].pose.position.distance(pair[1].pose.position));
        }
        let nearest = |k: &usize| plan.points[*k].pose.position.distance_squared(self.pose.position);
        let k = (0..ways.len()).min_by(|a, b| nearest(a).total_cmp(&nearest(b))).unwrap();
        let ahead = (self.pose.position - plan.points[k].pose.position).dot(self.pose.forward());
        let points: Vec<(f64, TrajectoryPoint<Lab>)> =
            ways.into_iter().zip(plan.points.iter().copied()).collect();
        self.pose = at_way(&points, points[k].0 + ahead + way_m);
    }
}

fn between(a: Pose2, b: Pose2, share: f64) -> Pose2 {
    let turn = city3d_geometry::wrap_angle(b.yaw_rad - a.yaw_rad);
    Pose2::at(a.position.lerp(b.position, share), a.yaw_rad + turn * share)
}

fn at(
    points: &[TrajectoryPoint<Lab>],
    key: impl Fn(&TrajectoryPoint<Lab>) -> f64,
    wanted: f64,
) -> TrajectoryPoint<Lab> {
    let next = points.partition_point(|point| key(point) < wanted).clamp(1, points.len() - 1);
    let (a, b) = (&points[next - 1], &points[next]);
    let share = ((wanted - key(a)) / (key(b) - key(a))).clamp(0.0, 1.0);
    let speed_mps = a.speed_mps + (b.speed_mps - a.speed_mps) * share;
    TrajectoryPoint { time_s: wanted, pose: between(a.pose, b.pose, share), speed_mps }
}

fn at_way(points: &[(f64, TrajectoryPoint<Lab>)], wanted_m: f64) -> Pose2 {
    let next = points.partition_point(|(way_m, _)| *way_m < wanted_m).clamp(1, points.len() - 1);
    let ((a_m, a), (b_m, b)) = (points[next - 1], points[next]);
    let share = if b_m > a_m { ((wanted_m - a_m) / (b_m - a_m)).clamp(0.0, 1.0) } else { 0.0 };
    between(a.pose, b.pose, share)
}

/// The roundabout under control alone: vehicles are where their plans want them, all but one.
struct LabTwin {
    mainframe: Mainframe,
    cars: Vec<Car>,
    step: u32,
}

impl LabTwin {
    fn new(experiment: &Experiment) -> Self {
        let map = Arc::clone(&experiment.lab_map);
        let setups = experiment.cav_setups();
        let scale = experiment.scale.factor();
        let car = |planned: &city3d_simulation::scenario::PlannedVehicle| {
            let size = &planned.spec.dimensions;
            let pose = planned.pose_in_lab(&experiment.city_map, experiment.scale);
            let front_axle_m = size.front_axle_m() / scale;
            Car {
                id: planned.id,
                length_m: size.length_m / scale,
                width_m: size.width_m / scale,
                front_axle_m,
                plan: None,
                pose: pose.advanced(front_axle_m),
                speed_mps: planned.start.speed_mps,
                speeds_mps: VecDeque::new(),
                hardest_mps2: 0.0,
            }
        };
        let cars = experiment.vehicles.iter().map(car).collect();
        let mainframe = Mainframe::new(map, setups, experiment.rules()).unwrap();
        Self { mainframe, cars, step: 0 }
    }

    fn time_s(&self) -> f64 {
        f64::from(self.step) * STEP_S
    }

    fn step(&mut self, hidden: Option<(VehicleId, f64, Blind)>) {
        let time_s = self.time_s();
        let is_hidden = |id| hidden.is_some_and(|(hidden, ..)| hidden == id);
        let seen: Vec<Measurement> =
            self.cars.iter().filter(|car| !is_hidden(car.id)).map(|car| car.measured(time_s)).collect();
        let mut messages = Vec::new();
        self.mainframe.step(time_s, &seen, &mut messages);
        let plans: BTreeMap<VehicleId, Trajectory<Lab>> = messages
            .into_iter()
            .filter_map(|message| match message {
                Message::Follow(trajectory) => Some((trajectory.vehicle, trajectory)),
                Message::Remove(_) | Message::Signals(_) => None,
            })
            .collect();
        self.step += 1;
        let next_s = self.time_s();
        for car in &mut self.cars {
            let blind = hidden.filter(|(id, ..)| *id == car.id);
            let hears = blind.is_none_or(|(.., blind)| blind == Blind::Obeys);
            if hears && let Some(plan) = plans.get(&car.id) {
                car.plan = Some(plan.clone());
            }
            match blind {
                Some((_, since_s, Blind::GoesOn { for_s })) if time_s - since_s > for_s => car.brake(),
                Some((.., Blind::BrakesAtOnce)) => car.brake(),
                _ => car.follow(next_s),
            }
        }
    }

    fn collision(&self) -> Option<String> {
        let pairs =
            self.cars.iter().enumerate().flat_map(|(k, a)| self.cars[k + 1..].iter().map(move |b| (a, b)));
        let hit = pairs.into_iter().find(|(a, b)| a.outline().overlap(&b.outline()).is_some());
        hit.map(|(a, b)| format!("{} and {} at {:.2} s", a.id, b.id, self.time_s()))
    }
}

#[test]
fn nobody_runs_into_a_vehicle_that_is_lost() {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
    let ways = [Blind::BrakesAtOnce, Blind::GoesOn { for_s: 0.5 }, Blind::Obeys];
    let mut stood = 0;
    for vehicle in (1..=6).map(VehicleId) {
        for begins_s in [2, 4, 6, 8, 10, 12, 14].map(f64::from) {
            for blind in ways {
                let mut lab = LabTwin::new(&experiment);
                while lab.time_s() < begins_s {
                    lab.step(None);
                }
                lab.cars.iter_mut().for_each(|car| car.hardest_mps2 = 0.0);
                let hidden = Some((vehicle, begins_s, blind));
                while lab.time_s() < begins_s + 12.0 {
                    lab.step(hidden);
                    let hit = lab.collision();
                    assert!(hit.is_none(), "{vehicle} {blind:?} from {begins_s} s: {}", hit.unwrap());
                }
                let others = lab.cars.iter().filter(|car| car.id != vehicle);
                let hardest = others.map(|car| car.hardest_mps2).fold(0.0, f64::min);
                assert!(hardest > -1.05 * BRAKING_MPS2, "{vehicle} {blind:?} from {begins_s} s: {hardest}");
                let lost = lab.cars.iter().find(|car| car.id == vehicle).unwrap();
                assert!(lost.speed_mps < 0.01, "{vehicle} {blind:?} from {begins_s} s drives on");
                stood += usize::from(lab.cars.iter().filter(|car| car.speed_mps < 0.01).count() > 1);
                // It is found where it is, and all drive on.
                let found_m: Vec<_> = lab.cars.iter().map(|car| car.pose.position).collect();
                while lab.time_s() < begins_s + 32.0 {
                    lab.step(None);
                    let hit = lab.collision();
                    assert!(hit.is_none(), "{vehicle} {blind:?} from {begins_s} s, found: {}", hit.unwrap());
                }
                let k = lab.cars.iter().position(|car| car.id == vehicle).unwrap();
                let way_m = lab.cars[k].pose.position.distance(found_m[k]);
                let is_finished = lab.cars[k].plan.as_ref().is_some_and(|plan| plan.finished);
                assert!(way_m > 0.3 || is_finished, "{vehicle} {blind:?} from {begins_s} s stays: {way_m} m");
            }
        }
    }
    assert!(stood > 10, "others had to stop {stood} times");
}

/// It feels nothing of what it touches: its status goes on telling what it does, and that nobody measures it.
#[test]
fn a_rammed_vehicle_of_the_laboratory_has_the_status_of_what_it_does() {
    let (text, library) = Library::scenario("mixed").unwrap();
    let experiment = Arc::new(read_experiment("mixed", &text, &library, Overrides::default()).unwrap());
    let mut world = World::new(Arc::clone(&experiment));
    let mut snapshot = world.snapshot();
    world.tick_into(&[SimCommand::Start], &mut snapshot);
    let lab = experiment.physical().next().unwrap().0.id;
    // It is measured where a simulated one is, and moves with it.
    let other = snapshot.vehicles.iter().find(|vehicle| !experiment.is_physical(vehicle.id)).unwrap().clone();
    let pose = |time_s: f64| MeasuredPose {
        stamp_s: time_s,
        position: other.position + other.orientation * DVec3::X * (1.0 + 2.0 * time_s),
        orientation: other.orientation,
    };
    let mut tick = |world: &mut World, is_seen: bool| {
        let command = SimCommand::Measure(lab, pose(snapshot.time_s));
        world.tick_into(if is_seen { std::slice::from_ref(&command) } else { &[] }, &mut snapshot);
        let has_hit = snapshot.events.iter().any(|event| event.kind.is_collision());
        (snapshot.vehicle(lab).unwrap().status, snapshot.vehicle(other.id).unwrap().status, has_hit)
    };
    let seen: Vec<_> = (0..50).map(|_| tick(&mut world, true)).collect();
    assert!(seen.iter().any(|(.., has_hit)| *has_hit));
    assert_eq!((seen[49].0, seen[49].1), (Status::Driving, Status::Collided));
    let lost = (0..50).fold(None, |_, _| Some(tick(&mut world, false))).unwrap();
    assert_eq!(lost.0, Status::Unseen);
}
