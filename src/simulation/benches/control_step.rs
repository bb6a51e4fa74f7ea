//! Times the control step on grid maps with inflows: coordinated vehicles beside those that yield, and ten times as many
//! on ten times as many junctions, in one city and in ten. Every row is the same simulated interval of the same demand, and ends with its digest.
//! Steps are timed twice: in lockstep with the world, as in a run, and alone, when the caches hold nothing but control.
//! `THREADS=N` in the environment sets the threads of control and world; all processors otherwise.
#![allow(clippy::disallowed_types, reason = "measures time")]
#![allow(clippy::unwrap_used, reason = "a bench may end where it finds something wrong")]

use city3d_control::Mainframe;
use city3d_dynamics::vehicle::ModelKind;
use city3d_protocol::snapshot::{SimCommand, Status};
use city3d_protocol::wire::{Measurement, Message};
use city3d_roadmap::{Grid, GridArm, LabMap, load_map};
use city3d_simulation::demand::Demand;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use city3d_simulation::sim::World;
use city3d_workers::Workers;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Until the grid has filled.
const WARM_UP_S: f64 = 150.0;
const MEASURED_S: f64 = 60.0;
/// Each run is made so often; of each step its least time counts, without what else the machine did meanwhile.
const REPEATS: usize = 5;
/// Runs of world and control in lockstep, likewise.
const RUNS: usize = 3;

/// Grid maps as `city3d generate map --grid` draws them, with as many vehicles an hour from each of the arms to all others
/// within a distance.
struct Demanded {
    grid: &'static str,
    /// So many cities without one another, stepped in turn: their state fills the caches as that of one large city does.
    cities: usize,
    rate_veh_h: f64,
    within_m: f64,
}

/// About 50 vehicles on 10 junctions; ten such cities; 260 and 480 vehicles on 60 and 120 junctions with about the same traffic at each;
/// and 430 on 100 junctions, where the ways of all meet in the middle.
const DEMANDED: [Demanded; 6] = [
    Demanded { grid: "2x5", cities: 1, rate_veh_h: 125.0, within_m: f64::INFINITY },
    Demanded { grid: "2x5", cities: 10, rate_veh_h: 125.0, within_m: f64::INFINITY },
    Demanded { grid: "2x30", cities: 1, rate_veh_h: 150.0, within_m: 20.0 },
    Demanded { grid: "2x60", cities: 1, rate_veh_h: 150.0, within_m: 20.0 },
    Demanded { grid: "4x30", cities: 1, rate_veh_h: 250.0, within_m: 24.0 },
    Demanded { grid: "10x10", cities: 1, rate_veh_h: 250.0, within_m: f64::INFINITY },
];

/// Threads of control and world.
fn workers() -> Workers {
    let threads = std::env::var("THREADS").map(|threads| threads.parse().unwrap());
    threads.map_or_else(|_| Workers::of_machine(), Workers::new)
}

fn distance_m(map: &LabMap, from: &GridArm, to: &GridArm) -> f64 {
    let curve = |name: &str| &map.lane_by_name(name).unwrap().curve;
    curve(&from.entry).start().position.distance(curve(&to.exit).end().position)
}

fn experiment(demanded: &Demanded, algorithm: &str) -> Arc<Experiment> {
    let grid = Grid { size: demanded.grid.parse().unwrap(), ..Grid::default() };
    let duration_s = WARM_UP_S + MEASURED_S;
    let mut text = format!(
        "name = \"grid\"\nmap = \"grid.dxf\"\nseed = 1\nduration_s = {duration_s}\n\
         [coordination]\nalgorithm = \"{algorithm}\"\n"
    );
    let (arms, drawing) = (grid.arms(), grid.to_dxf().unwrap().into_bytes());
    let map = load_map(&drawing).unwrap().map;
    for arm in &arms {
        let is_goal = |other: &&GridArm| *other != arm && distance_m(&map, arm, other) < demanded.within_m;
        let others = arms.iter().filter(is_goal).map(|other| format!("\"{}\"", other.exit));
        let goals = others.collect::<Vec<_>>().join(", ");
        let _ = write!(
            text,
            "[[inflow]]\nlane = \"{}\"\nrate_veh_h = {}\ndestinations = [{goals}]\n",
            arm.entry, demanded.rate_veh_h
        );
    }
    let library = Library::kept(drawing, BTreeMap::new());
    let overrides = Overrides { model: Some(ModelKind::Bicycle), ..Overrides::default() };
    let read = read_experiment("grid", &text, &library, overrides).unwrap_or_else(|error| panic!("{error}"));
    Arc::new(Experiment { workers: workers(), ..read })
}

/// What the control steps of a run took.
struct Spent {
    mean_vehicles: f64,
    /// Pairs of vehicles that coordination compared, for a vehicle and step.
    pairs: f64,
    /// Plans it gave and requests it refused, for a vehicle and second.
    asked: f64,
    /// Of each control step, in order of time.
    steps: Vec<Duration>,
    digest: u64,
}

impl Spent {
    /// The lesser time of each step of the same run, made twice.
    fn least(mut self, other: Self) -> Self {
        assert_eq!((self.pairs, self.asked), (other.pairs, other.asked));
        least(&mut self.steps, &other.steps);
        self
    }

    fn quantile(&self, share: f64) -> Duration {
        let mut sorted = self.steps.clone();
        sorted.sort_unstable();
        sorted[((sorted.len() - 1) as f64 * share) as usize]
    }
}

fn mean(steps: &[Duration]) -> Duration {
    steps.iter().sum::<Duration>() / steps.len() as u32
}

/// Keeps the lesser time of each step of the same run, made twice.
fn least(steps: &mut [Duration], again: &[Duration]) {
    steps.iter_mut().zip(again).for_each(|(time, again)| *time = *again.min(time));
}

/// What control saw in a run, by control step, and the digest of that run's end.
struct Seen {
    steps: Vec<(f64, Vec<Measurement>)>,
    /// What the measured steps took.
    took: Vec<Duration>,
    digest: u64,
}

impl Seen {
    /// The lesser time of each step of the same run, made twice.
    fn least(mut self, other: &Self) -> Self {
        assert_eq!(self.digest, other.digest);
        least(&mut self.took, &other.took);
        self
    }
}

/// Runs world and control framework in lockstep, without errors between them.
fn record(experiment: &Arc<Experiment>) -> Seen {
    let (scale, ticks_per_control) = (experiment.scale, experiment.rates.ticks_per_control());
    let mut world = World::new(Arc::clone(experiment));
    let mut snapshot = world.snapshot();
    let mut control = Control::new(experiment);
    let (mut commands, mut steps, mut took) = (vec![SimCommand::Start], Vec::new(), Vec::new());
    while world.time_s() < experiment.duration_s {
        let time_s = world.time_s();
        control.demand.begin_step();
        if world.tick().is_multiple_of(ticks_per_control) {
            let visible = snapshot.vehicles.iter().filter(|state| state.status != Status::Unseen);
            let seen: Vec<_> = visible.map(|state| Measurement::of(state, time_s, scale)).collect();
            let spent = control.step(time_s, &seen);
            if time_s >= WARM_UP_S {
                took.push(spent);
            }
            steps.push((time_s, seen));
        }
        commands.extend(control.messages.drain(..).map(|message| message.into_command(scale)));
        let entering =
            control.demand.entering().iter().map(|vehicle| vehicle.setup(&experiment.city_map, scale));
        commands.extend(entering.map(|setup| SimCommand::Spawn(Box::new(setup))));
        commands.sort_by_key(SimCommand::order);
        world.tick_into(&commands, &mut snapshot);
        commands.clear();
    }
    Seen { steps, took, digest: snapshot.state_hash }
}

/// The control framework with its demand, as `city3d mainframe` runs them.
struct Control {
    mainframe: Mainframe,
    demand: Demand,
    messages: Vec<Message>,
}

impl Control {
    fn new(experiment: &Experiment) -> Self {
        let map = Arc::clone(&experiment.lab_map);
        let mut mainframe = Mainframe::new(map, experiment.cav_setups(), experiment.rules()).unwrap();
        mainframe.set_workers(experiment.workers.clone());
        Self { mainframe, demand: Demand::new(experiment).unwrap(), messages: Vec::new() }
    }

    /// A control step; returns what [`Mainframe::step`] alone took.
    fn step(&mut self, time_s: f64, seen: &[Measurement]) -> Duration {
        self.demand.step(time_s, seen, &mut self.mainframe, &mut self.messages);
        let begun = Instant::now();
        self.mainframe.step(time_s, seen, &mut self.messages);
        begun.elapsed()
    }
}

/// Gives control the same measurements again, as in a process of its own, and times it; with several cities that of all together.
fn measure(experiment: &Experiment, cities: usize, seen: &Seen) -> Spent {
    let ticks_per_control = experiment.rates.ticks_per_control();
    let mut controls: Vec<_> = (0..cities).map(|_| Control::new(experiment)).collect();
    let (mut steps, mut vehicles, mut before) = (Vec::new(), 0, None);
    for (time_s, seen) in &seen.steps {
        if *time_s >= WARM_UP_S {
            before.get_or_insert_with(|| work_of(&controls[0].mainframe));
        }
        let mut took = Duration::ZERO;
        for control in &mut controls {
            (0..ticks_per_control).for_each(|_| control.demand.begin_step());
            took += control.step(*time_s, seen);
            control.messages.clear();
        }
        if *time_s >= WARM_UP_S {
            steps.push(took);
            vehicles += seen.len();
        }
    }
    let ([pairs, asked], [pairs_before, asked_before]) =
        (work_of(&controls[0].mainframe), before.unwrap_or_default());
    let mean_vehicles = vehicles as f64 / steps.len() as f64;
    Spent {
        mean_vehicles: mean_vehicles * cities as f64,
        pairs: (pairs - pairs_before) as f64 / vehicles as f64,
        asked: (asked - asked_before) as f64 / mean_vehicles / MEASURED_S,
        steps,
        digest: seen.digest,
    }
}

/// Pairs compared, and plans given or refused, so far.
fn work_of(mainframe: &Mainframe) -> [u64; 2] {
    let Some(coordination) = mainframe.coordination() else { return [0; 2] };
    let asked = coordination.counts().iter().map(|counts| counts.plans + counts.infeasible).sum();
    [coordination.compared_pairs(), asked]
}

fn main() {
    // `cargo bench` passes options of its own; every other argument names an algorithm or a grid.
    let (algorithms, grids) = (["none", "fifo", "insert", "priority", "replan"], DEMANDED.map(|of| of.grid));
    let chosen: Vec<String> = std::env::args().skip(1).collect();
    let is_chosen = |name: &str, all: &[&str]| {
        chosen.iter().any(|word| word == name) || !chosen.iter().any(|word| all.contains(&word.as_str()))
    };
    println!(
        "| algorithm | grid | vehicles | in a run, for a vehicle | alone, mean step | for a vehicle | median | 99 % | pairs | plans asked for | digest |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for demanded in DEMANDED.iter().filter(|demanded| is_chosen(demanded.grid, &grids)) {
        for algorithm in algorithms.into_iter().filter(|algorithm| is_chosen(algorithm, &algorithms)) {
            let experiment = experiment(demanded, algorithm);
            // Of several cities in turn there is no run to time.
            let runs = if demanded.cities == 1 { RUNS } else { 1 };
            let seen = (1..runs).fold(record(&experiment), |seen, _| seen.least(&record(&experiment)));
            let spent = (0..REPEATS)
                .map(|_| measure(&experiment, demanded.cities, &seen))
                .reduce(Spent::least)
                .unwrap();
            let micros = |time: Duration| time.as_secs_f64() * 1e6;
            let in_run = if demanded.cities == 1 {
                format!("{:.2} us", micros(mean(&seen.took)) / spent.mean_vehicles)
            } else {
                String::new()
            };
            println!(
                "| `{algorithm}` | {}{} | {:.1} | {} | {:.0} us | {:.2} us | {:.0} us | {:.0} us | {:.2} | {:.2} | {:016x} |",
                if demanded.cities > 1 { format!("{} times ", demanded.cities) } else { String::new() },
                demanded.grid,
                spent.mean_vehicles,
                in_run,
                micros(mean(&spent.steps)),
                micros(mean(&spent.steps)) / spent.mean_vehicles,
                micros(spent.quantile(0.5)),
                micros(spent.quantile(0.99)),
                spent.pairs,
                spent.asked,
                spent.digest
            );
        }
    }
}
