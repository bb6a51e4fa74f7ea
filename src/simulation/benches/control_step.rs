//! Times the control step on grid maps with inflows: coordinated vehicles beside those that yield, and ten times as many
//! on ten times as many junctions. Every row is the same simulated interval of the same demand, and ends with its digest.
#![allow(clippy::disallowed_types, reason = "measures time")]
#![allow(clippy::unwrap_used, reason = "a bench may end where it finds something wrong")]

use city3d_control::Mainframe;
use city3d_dynamics::vehicle::ModelKind;
use city3d_protocol::snapshot::{SimCommand, Status};
use city3d_protocol::wire::Measurement;
use city3d_roadmap::{Grid, GridArm, LabMap, load_map};
use city3d_simulation::demand::Demand;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use city3d_simulation::sim::World;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Until the grid has filled.
const WARM_UP_S: f64 = 150.0;
const MEASURED_S: f64 = 60.0;
/// Each run is made so often; of each step its least time counts, without what else the machine did meanwhile.
const REPEATS: usize = 3;

/// A grid map as `city3d generate map --grid` draws it, with as many vehicles an hour from each of its arms to all others
/// within a distance.
struct Demanded {
    grid: &'static str,
    rate_veh_h: f64,
    within_m: f64,
}

/// About 50 vehicles on 10 junctions; six times as many on six times as many junctions, with the same traffic at each; and
/// 430 on 100 junctions, where the ways of all meet in the middle.
const DEMANDED: [Demanded; 3] = [
    Demanded { grid: "2x5", rate_veh_h: 125.0, within_m: f64::INFINITY },
    Demanded { grid: "2x30", rate_veh_h: 150.0, within_m: 20.0 },
    Demanded { grid: "10x10", rate_veh_h: 250.0, within_m: f64::INFINITY },
];

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
    Arc::new(read_experiment("grid", &text, &library, overrides).unwrap_or_else(|error| panic!("{error}")))
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
        assert_eq!(self.digest, other.digest);
        self.steps.iter_mut().zip(other.steps).for_each(|(time, again)| *time = again.min(*time));
        self
    }

    fn mean(&self) -> Duration {
        self.steps.iter().sum::<Duration>() / self.steps.len() as u32
    }

    fn quantile(&self, share: f64) -> Duration {
        let mut sorted = self.steps.clone();
        sorted.sort_unstable();
        sorted[((sorted.len() - 1) as f64 * share) as usize]
    }
}

/// Runs world and control framework in lockstep without errors between them, and times [`Mainframe::step`] alone.
fn measure(experiment: &Arc<Experiment>) -> Spent {
    let (scale, ticks_per_control) = (experiment.scale, experiment.rates.ticks_per_control());
    let mut world = World::new(Arc::clone(experiment));
    let mut snapshot = world.snapshot();
    let map = Arc::clone(&experiment.lab_map);
    let mut mainframe = Mainframe::new(map, experiment.cav_setups(), experiment.rules()).unwrap();
    let mut demand = Demand::new(experiment).unwrap();
    let (mut commands, mut seen, mut messages) = (vec![SimCommand::Start], Vec::new(), Vec::new());
    let (mut steps, mut vehicles) = (Vec::new(), 0);
    let mut before = None;
    while world.time_s() < experiment.duration_s {
        let time_s = world.time_s();
        demand.begin_step();
        if world.tick().is_multiple_of(ticks_per_control) {
            seen.clear();
            let visible = snapshot.vehicles.iter().filter(|state| state.status != Status::Unseen);
            seen.extend(visible.map(|state| Measurement::of(state, time_s, scale)));
            demand.step(time_s, &seen, &mut mainframe, &mut messages);
            if time_s >= WARM_UP_S {
                before.get_or_insert_with(|| work_of(&mainframe));
            }
            let begun = Instant::now();
            mainframe.step(time_s, &seen, &mut messages);
            let took = begun.elapsed();
            if time_s >= WARM_UP_S {
                steps.push(took);
                vehicles += seen.len();
            }
        }
        commands.extend(messages.drain(..).map(|message| message.into_command(scale)));
        let entering = demand.entering().iter().map(|vehicle| vehicle.setup(&experiment.city_map, scale));
        commands.extend(entering.map(|setup| SimCommand::Spawn(Box::new(setup))));
        commands.sort_by_key(SimCommand::order);
        world.tick_into(&commands, &mut snapshot);
        commands.clear();
    }
    let ([pairs, asked], [pairs_before, asked_before]) = (work_of(&mainframe), before.unwrap_or_default());
    Spent {
        mean_vehicles: vehicles as f64 / steps.len() as f64,
        pairs: (pairs - pairs_before) as f64 / vehicles as f64,
        asked: (asked - asked_before) as f64 / (vehicles as f64 / steps.len() as f64) / MEASURED_S,
        steps,
        digest: snapshot.state_hash,
    }
}

/// Pairs compared, and plans given or refused, so far.
fn work_of(mainframe: &Mainframe) -> [u64; 2] {
    let Some(coordination) = mainframe.coordination() else { return [0; 2] };
    let asked = coordination.counts().iter().map(|counts| counts.plans + counts.infeasible).sum();
    [coordination.compared_pairs(), asked]
}

fn main() {
    // `cargo bench` passes options of its own; every other argument names an algorithm.
    let chosen: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let algorithms = ["none", "fifo", "insert", "priority", "replan"];
    println!(
        "| algorithm | grid | vehicles | mean step | for a vehicle | median | 99 % | pairs | plans asked for | digest |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for demanded in &DEMANDED {
        for algorithm in algorithms {
            if !chosen.is_empty() && !chosen.iter().any(|name| name == algorithm) {
                continue;
            }
            let experiment = experiment(demanded, algorithm);
            let spent = (0..REPEATS).map(|_| measure(&experiment)).reduce(Spent::least).unwrap();
            let micros = |time: Duration| time.as_secs_f64() * 1e6;
            println!(
                "| `{algorithm}` | {} | {:.1} | {:.0} us | {:.2} us | {:.0} us | {:.0} us | {:.2} | {:.2} | {:016x} |",
                demanded.grid,
                spent.mean_vehicles,
                micros(spent.mean()),
                micros(spent.mean()) / spent.mean_vehicles,
                micros(spent.quantile(0.5)),
                micros(spent.quantile(0.99)),
                spent.pairs,
                spent.asked,
                spent.digest
            );
        }
    }
}
