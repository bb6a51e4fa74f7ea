//! A person who crosses a zone without heeding anybody: no vehicle under control runs into it where braking could have helped.

use crate::disturbed::{coordinated, lane_keeping};
use crate::support::shipped;
use city3d_control::{Cav, CavGeometry, DriverParams, Route};
use city3d_geometry::OrientedRect;
use city3d_protocol::snapshot::{EventKind, FrameSnapshot, Pedals, SimCommand, VehicleId};
use city3d_roadmap::LabMap;
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use glam::DVec2;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A person drives for this long.
const DRIVES_S: f64 = 25.0;

/// After a collision that there was, the person would have gone on for this long.
const GOES_ON_S: f64 = 2.0;

/// A plan that is kept for this long is what the others expect.
const KEPT_S: f64 = 1.0;

/// What a person's speed may differ from what it was told, laboratory m/s: it is told one near its own.
const OFF_MPS: f64 = 0.06;

/// Who is farther from the middle of its lane leaves it: a third of a metre at full scale.
const OFF_LANE_M: f64 = 0.013;

/// Pedals for a difference of speed, laboratory m/s.
const PEDALS_PER_MPS: f64 = 12.0;

/// The person slows down for bends this far ahead.
const LOOKS_AHEAD_M: f64 = 0.3;

/// A vehicle when the person first does what was not expected, or at its own first tick.
struct Start {
    step: usize,
    route: Arc<Route>,
    axle_s: f64,
    speed_mps: f64,
    body: CavGeometry,
    driver: DriverParams,
}

impl Start {
    /// Its outline later if it brakes as hard as it may, once it has responded.
    fn braking(&self, map: &LabMap, since_s: f64) -> OrientedRect {
        let limit = self.driver.min_acceleration_mps2.abs();
        let responding_s = since_s.min(self.driver.response_time_s);
        let t = (since_s - responding_s).min(self.speed_mps / limit);
        let axle_s = self.axle_s + self.speed_mps * (responding_s + t) - limit * t * t / 2.0;
        let front = self.route.at(map, axle_s).pose.position;
        let rear = self.route.at(map, axle_s - self.body.wheelbase_m).pose.position;
        let half = DVec2::new(self.body.length_m, self.body.width_m) / 2.0;
        OrientedRect { centre: (front + rear) / 2.0, axis: (front - rear).normalize_or(DVec2::X), half }
    }
}

/// The pairs that collide in a step.
fn collided(snapshot: &FrameSnapshot) -> impl Iterator<Item = (VehicleId, VehicleId)> + '_ {
    snapshot.events.iter().filter_map(|event| match event.kind {
        EventKind::Collision { with } => Some((event.vehicle, with)),
        _ => None,
    })
}

/// The vehicle that comes to the junction next after `from_s`, and is at least `away_m` from it.
fn next_one(run: &Run, away_m: f64) -> Option<VehicleId> {
    let to_line = |cav: &Cav| {
        let section = cav.route.sections.first()?;
        Some((section.hold_s - cav.front_s(), cav.id)).filter(|(left_m, _)| *left_m >= away_m)
    };
    let seen = run.mainframe().cavs().iter().filter(|cav| cav.is_on_route());
    seen.filter_map(to_line).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, id)| id)
}

/// Pedals that keep a speed on the lane, and that of the route in bends.
fn keeping(run: &Run, person: &Cav, speed_mps: f64) -> Pedals {
    let bend_mps = person.route.speed_at(person.axle_s() + LOOKS_AHEAD_M);
    let is_bend = bend_mps < person.driver.desired_speed_mps - 1e-3;
    let wanted_mps = if is_bend { speed_mps.min(bend_mps) } else { speed_mps };
    let pedal = PEDALS_PER_MPS * (wanted_mps - person.speed_mps());
    let steering_rad = lane_keeping(run, person.id);
    Pedals { gas: pedal.clamp(0.0, 1.0), brake: (-pedal).clamp(0.0, 1.0), steering_rad, ..Pedals::default() }
}

/// Whether the person does not do, or has not long done, what the others can expect: its plan is new, or it has none and does not
/// do what it is told.
fn is_unexpected(now_s: f64, person: &Cav) -> bool {
    match &person.coordination.plan {
        Some(plan) => now_s - plan.start().time_s < KEPT_S,
        None => {
            let off_mps = (person.plan.speed_mps - person.speed_mps()).abs();
            person.coordination.is_distrusted || off_mps > OFF_MPS
        }
    }
}

fn off_lane(run: &Run, person: &Cav) -> f64 {
    let axle = person.pose.point_at(person.body.front_axle_m(), 0.0);
    person.route.project(&run.experiment().lab_map, axle, 0.0, person.route.length()).distance
}

/// What became of a drive: up to the first collision.
struct Record {
    person: VehicleId,
    dt_s: f64,
    /// By step.
    person_outlines: Vec<OrientedRect>,
    /// From when on a vehicle under control could have braked.
    starts: BTreeMap<VehicleId, Start>,
    /// How far the person is from the middle of the lane in the end.
    off_lane_m: f64,
    /// Who collided, and their outlines.
    hit: Option<[(VehicleId, OrientedRect); 2]>,
}

impl Record {
    /// A person takes the next vehicle at `from_s`, keeps `speed_mps` on its lane and gives way to nobody.
    fn of(mut run: Run, from_s: f64, away_m: f64, speed_mps: f64) -> Self {
        while run.world().time_s() < from_s {
            run.step();
        }
        let person = next_one(&run, away_m).expect("somebody is on an approach");
        let (scale, dt_s) = (run.experiment().scale, 1.0 / f64::from(run.experiment().rates.physics_hz));
        let (person_outlines, starts) = (Vec::new(), BTreeMap::new());
        let mut record = Self { person, dt_s, person_outlines, starts, off_lane_m: 0.0, hit: None };
        let driven = |run: &Run| run.mainframe().cavs().iter().position(|cav| cav.id == person);
        for step in 0..(DRIVES_S / dt_s) as usize {
            let Some(index) = driven(&run) else { break };
            let cavs = run.mainframe().cavs();
            let is_visible = is_unexpected(run.world().time_s(), &cavs[index]);
            record.off_lane_m = off_lane(&run, &cavs[index]);
            if is_visible {
                record.note_starts(step, cavs);
            } else {
                record.starts.clear();
            }
            let pedals = keeping(&run, &cavs[index], speed_mps);
            run.inject(SimCommand::Drive(person, pedals));
            let snapshot = run.step().clone();
            let outline_of = |id: VehicleId| {
                let state = snapshot.vehicles.iter().find(|state| state.id == id)?;
                let body = run.mainframe().cavs().iter().find(|cav| cav.id == id)?.body;
                Some((id, OrientedRect::new(state.pose().to_lab(scale), body.length_m, body.width_m)))
            };
            let Some((_, outline)) = outline_of(person) else { break };
            record.person_outlines.push(outline);
            if let Some((one, other)) = collided(&snapshot).next() {
                record.hit = Some([one, other].map(|id| outline_of(id).expect("who collides is there")));
                break;
            }
        }
        record
    }

    fn note_starts(&mut self, step: usize, cavs: &[Cav]) {
        for cav in cavs.iter().filter(|cav| cav.is_on_route()) {
            self.starts.entry(cav.id).or_insert_with(|| Start {
                step,
                route: Arc::clone(&cav.route),
                axle_s: cav.axle_s(),
                speed_mps: cav.speed_mps(),
                body: cav.body,
                driver: cav.driver,
            });
        }
    }

    /// Whether a vehicle that brakes from its start on keeps clear of the person, who goes on straight ahead for a while.
    fn could_stop(&self, map: &LabMap, id: VehicleId) -> bool {
        // Nobody had to brake before anything could be seen.
        let Some(start) = self.starts.get(&id) else { return false };
        let mut outlines = self.person_outlines.clone();
        if let [.., before, last] = self.person_outlines[..] {
            let step = last.centre - before.centre;
            let goes_on = (1..=(GOES_ON_S / self.dt_s) as usize).map(|k| k as f64 * step);
            outlines.extend(goes_on.map(|way| OrientedRect { centre: last.centre + way, ..last }));
        }
        outlines.iter().enumerate().skip(start.step).all(|(step, outline)| {
            let since_s = (step - start.step) as f64 * self.dt_s;
            start.braking(map, since_s).overlap(outline).is_none()
        })
    }

    /// Whether a vehicle under control could have avoided the collision. Two of them have no excuse; and nobody can help being
    /// run into from behind, or by a person who leaves the lane.
    fn was_avoidable(&self, map: &LabMap) -> bool {
        let Some(hit) = self.hit else { return false };
        let [(_, person), (id, other)] = match hit {
            [one, other] if one.0 == self.person => [one, other],
            [one, other] if other.0 == self.person => [other, one],
            _ => return true,
        };
        let ahead_m = (other.centre - person.centre).dot(other.axis);
        let is_from_behind = person.axis.dot(other.axis) > 0.7 && ahead_m > other.half.x;
        !is_from_behind && self.off_lane_m < OFF_LANE_M && self.could_stop(map, id)
    }
}

fn intersection(seed: u64, environment: EnvironmentProfile) -> Run {
    let library = Library::scenario("intersection").unwrap().1;
    let overrides = Overrides { seed: Some(seed), environment: Some(environment), ..Overrides::default() };
    let experiment = read_experiment("test", &shipped("intersection"), &library, overrides).unwrap();
    Run::new(Arc::new(experiment)).unwrap()
}

/// One drive of a person: from when, how far from the line at least, and how fast.
type Drive = (f64, f64, f64);

/// Lets a person drive, and checks that whoever collides could not have stopped.
fn check(drives: impl Iterator<Item = (Run, Drive)>) {
    let (mut drives_count, mut collisions, mut avoidable) = (0, 0, Vec::new());
    for (run, drive) in drives {
        let (map, seed) = (run.experiment().lab_map.clone(), run.experiment().seed);
        let (from_s, away_m, speed_mps) = drive;
        let record = Record::of(run, from_s, away_m, speed_mps);
        drives_count += 1;
        collisions += usize::from(record.hit.is_some());
        if record.was_avoidable(&map) {
            avoidable.push(format!(
                "seed {seed}: {:?}, {} driven: {drive:?}",
                record.hit.map(|hit| hit.map(|of| of.0)),
                record.person
            ));
        }
    }
    println!("{collisions} collisions in {drives_count} drives, {} avoidable", avoidable.len());
    assert!(avoidable.is_empty(), "{avoidable:#?}");
}

/// Slow, as the others, and faster than they ever are.
const SPEEDS_MPS: [f64; 3] = [0.15, 0.35, 0.55];

#[test]
fn who_crosses_an_intersection_without_giving_way_is_hit_by_nobody_who_could_stop() {
    for environment in [EnvironmentProfile::Ideal, EnvironmentProfile::Testbed] {
        let drives =
            [2, 9, 14, 16].into_iter().flat_map(|seed| SPEEDS_MPS.map(|speed_mps| (seed, speed_mps)));
        check(drives.flat_map(|(seed, speed_mps)| {
            [0.6, 1.0, 3.0].map(|away_m| (intersection(seed, environment), (30.0, away_m, speed_mps)))
        }));
    }
}

#[test]
fn who_enters_the_roundabout_without_giving_way_is_hit_by_nobody_who_could_stop() {
    let from = [0.5, 3.0, 5.0, 8.0, 10.0, 12.0];
    let drives = SPEEDS_MPS.into_iter().flat_map(|speed_mps| from.map(|from_s| (from_s, speed_mps)));
    check(drives.map(|(from_s, speed_mps)| {
        let run = coordinated(&shipped("roundabout-coordinated"), Overrides::default());
        (run, (from_s, 0.1, speed_mps))
    }));
}
