//! Times one tick of the world: vehicles that follow trajectories sent at the control rate, and the whole
//! lockstep of the city. `THREADS=N` in the environment sets the threads; all processors otherwise.
#![allow(clippy::disallowed_types, reason = "measures time")]

mod common;

use city3d_dynamics::vehicle::ModelKind;
use city3d_protocol::snapshot::{FrameSnapshot, SimCommand, Trajectory, TrajectoryPoint, VehicleId};
use city3d_roadmap::dxf::{Drawing, EntityShape};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use city3d_simulation::sim::World;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec2;
use std::fmt::Write;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

const CARS_PER_LANE: usize = 50;
/// Full scale.
const SPEED_MPS: f64 = 8.0;
const SPACING_M: f64 = 16.0;
/// A map holds a kilometre of lanes at laboratory scale: at this scale that is room for all cars.
const SCALE: f64 = 100.0;
const CONTROL_TICKS: u64 = 2;
const HORIZON_POINTS: u32 = 13;

/// Parallel straight lanes, long enough for the bench, with cars one behind the other on each.
fn parade(cars: usize, model: ModelKind) -> Arc<Experiment> {
    let lanes = cars.div_ceil(CARS_PER_LANE);
    let mut drawing = Drawing::default();
    let mut text = format!(
        "name = \"parade\"\nduration_s = 100.0\nmap = \"parade.dxf\"\nlength_scale = {SCALE}\n\
         [driver.default]\nmax_acceleration_mps2 = 0.03\nmin_acceleration_mps2 = -0.05\n\
         lateral_acceleration_mps2 = 0.03\n"
    );
    for lane in 0..lanes {
        let y = lane as f64 * 0.3;
        drawing.add("LANES", EntityShape::Line { from: DVec2::new(0.0, y), to: DVec2::new(9.0, y) });
        let at = DVec2::new(1.0, y);
        drawing.add("NAMES", EntityShape::Text { at, height: 0.05, text: format!("lane{lane}") });
    }
    for car in 0..cars {
        let at_m = 0.4 + (car % CARS_PER_LANE) as f64 * SPACING_M / SCALE;
        let _ = write!(
            text,
            "[[vehicle]]\nroute = [\"lane{}\"]\nat_m = {at_m}\nspeed_mps = {}\n",
            car / CARS_PER_LANE,
            SPEED_MPS / SCALE
        );
    }
    let folder = tempfile::tempdir().expect("a folder for the map");
    std::fs::write(folder.path().join("parade.dxf"), drawing.to_dxf()).expect("a file for the map");
    let library = Library::beside(&folder.path().join("parade.toml"));
    let overrides = Overrides { model: Some(model), ..Overrides::default() };
    let read =
        read_experiment("parade", &text, &library, overrides).unwrap_or_else(|error| panic!("{error}"));
    Arc::new(Experiment { workers: common::workers(), ..read })
}

/// A world in motion and what drives it on.
struct Parade {
    world: World,
    snapshot: FrameSnapshot,
    commands: Vec<SimCommand>,
    /// Front axles at the start.
    starts: Vec<(VehicleId, f64, f64)>,
}

impl Parade {
    fn new(experiment: Arc<Experiment>) -> Self {
        let scale = experiment.scale;
        let starts = experiment
            .vehicles
            .iter()
            .map(|v| {
                let curve = &experiment.city_map.lane(v.start.lane).curve;
                let front = curve.at(scale.city_from_lab(v.start.at_m)).pose.position;
                (v.id, front.x, front.y)
            })
            .collect();
        let world = World::new(experiment);
        let snapshot = world.snapshot();
        Self { world, snapshot, commands: vec![SimCommand::Start], starts }
    }

    /// The commands of the next tick, as the control framework would send them.
    fn command(&mut self) {
        let (tick, now_s) = (self.world.tick(), self.world.time_s());
        if !tick.is_multiple_of(CONTROL_TICKS) {
            return;
        }
        for &(vehicle, x, y) in &self.starts {
            let point = |k: u32| {
                let time_s = now_s + 0.25 * f64::from(k);
                let pose = city3d_geometry::Pose2::new(x + SPEED_MPS * time_s, y, 0.0);
                TrajectoryPoint { time_s, pose, speed_mps: SPEED_MPS }
            };
            let points = (0..HORIZON_POINTS).map(point).collect();
            let sequence = tick as u32;
            self.commands.push(SimCommand::Follow(Trajectory {
                vehicle,
                sequence,
                points,
                ..Trajectory::default()
            }));
        }
    }

    fn tick(&mut self) {
        self.world.tick_into(&self.commands, &mut self.snapshot);
        self.commands.clear();
    }
}

fn ticks(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("tick");
    group.warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(4)).sample_size(10);
    for (name, model) in [("raycast", ModelKind::Raycast), ("bicycle", ModelKind::Bicycle)] {
        for cars in [1, 50, 500, 5000, 10_000] {
            let mut parade = Parade::new(parade(cars, model));
            group.throughput(Throughput::Elements(cars as u64));
            group.bench_function(BenchmarkId::new(name, cars), |bencher| {
                // Time of the ticks alone: making the messages is the sender's.
                bencher.iter_custom(|count| {
                    let mut spent = Duration::ZERO;
                    for _ in 0..count {
                        parade.command();
                        let start = std::time::Instant::now();
                        parade.tick();
                        spent += start.elapsed();
                        if parade.world.time_s() > 90.0 {
                            parade = Parade::new(Arc::clone(parade.world.experiment()));
                        }
                    }
                    spent
                });
            });
            assert!(parade.snapshot.events.iter().all(|event| !event.kind.is_collision()));
        }
    }
    group.finish();
}

fn city(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("lockstep");
    group.warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(5)).sample_size(10);
    let (text, library) = Library::scenario("city").expect("a shipped scenario");
    for (name, model) in [("raycast", ModelKind::Raycast), ("bicycle", ModelKind::Bicycle)] {
        let overrides = Overrides { model: Some(model), ..Overrides::default() };
        let experiment = read_experiment("city", &text, &library, overrides).expect("a shipped scenario");
        let mut run = Run::new(Arc::new(experiment)).expect("a shipped scenario");
        // Past the start, when all are on their way.
        for _ in 0..2000 {
            run.step();
        }
        group.throughput(Throughput::Elements(run.snapshot().vehicles.len() as u64));
        group.bench_function(BenchmarkId::new("city", name), |bencher| {
            bencher.iter(|| {
                if run.world().time_s() > 290.0 {
                    run.reset().expect("a shipped scenario");
                }
                black_box(run.step().state_hash)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, ticks, city);
criterion_main!(benches);
