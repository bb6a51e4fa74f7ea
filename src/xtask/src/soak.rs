//! A city that is served for hours, in simulated time, while its mainframe comes and goes: whether memory stays flat, nobody
//! collides, and nobody stands for ever.

use city3d_network::simulated::{SimulatedNetwork, SimulatedOptions};
use city3d_protocol::snapshot::{EventKind, VehicleId};
use city3d_session::remote::{RemoteCity, RemoteOptions};
use city3d_session::served::{ServeOptions, ServedCity};
use city3d_session::{
    End, EndHealth, FileOptions, Host, Moment, MomentKind, RunFiles, RunFolders, Session, SessionError,
    Source,
};
use city3d_simulation::scenario::{Experiment, Overrides, ScenarioRequest};
use clap::Args;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct SoakArgs {
    /// Simulated hours
    #[arg(long, default_value_t = 8.0)]
    hours: f64,
    /// Scenario
    #[arg(long, default_value = "city")]
    scenario: String,
    /// Seed of the network, and of when the mainframe goes and comes
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

const CITY: &str = "127.0.0.1:9870";
const HOUR_S: f64 = 3600.0;
/// Longest time without a mainframe, seconds: it is more often there than not.
const LONGEST_ABSENCE_S: f64 = 20.0;
/// A mainframe lives for a time between these, seconds.
const LIFE_S: [f64; 2] = [30.0, 600.0];
/// Nobody may stand for longer, seconds.
const LONGEST_STAND_S: f64 = 300.0;
/// A vehicle that has driven less than this stands.
const STANDSTILL_M: f64 = 0.05;
/// Memory may grow by this between the first hour and the last.
const MOST_GROWTH_KIB: u64 = 4096;

/// What has been seen of the city.
#[derive(Debug, Default)]
struct Seen {
    time_s: f64,
    vehicles: usize,
    collisions: usize,
    longest_stand_s: f64,
    /// The mainframe that came last, when it came, and when it went.
    mainframe: (u32, f64, Option<f64>),
    /// Distance of each vehicle when it last moved, and when that was.
    moved: BTreeMap<VehicleId, (f64, f64)>,
    /// Vehicles whose long stand was printed.
    told: BTreeSet<VehicleId>,
}

fn lock(seen: &Mutex<Seen>) -> MutexGuard<'_, Seen> {
    seen.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Watches the city from within.
struct Watch(Arc<Mutex<Seen>>);

impl End for Watch {
    fn name(&self) -> &'static str {
        "soak"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if moment.kind != MomentKind::Tick {
            return;
        }
        let (snapshot, mut seen) = (moment.snapshot, lock(&self.0));
        (seen.time_s, seen.vehicles) = (snapshot.time_s, snapshot.vehicles.len());
        for event in &snapshot.events {
            if matches!(event.kind, EventKind::Collision { .. } | EventKind::CollisionStatic { .. }) {
                seen.collisions += 1;
                let (number, came_s, went_s) = seen.mainframe;
                eprintln!("{event:?}; mainframe {number} came at {came_s:.1} s, went at {went_s:.1?} s");
            }
        }
        for state in &snapshot.vehicles {
            let (driven_m, since_s) =
                *seen.moved.entry(state.id).or_insert((state.distance_m, snapshot.time_s));
            if (state.distance_m - driven_m).abs() > STANDSTILL_M {
                seen.moved.insert(state.id, (state.distance_m, snapshot.time_s));
            } else {
                let stood_s = snapshot.time_s - since_s;
                if stood_s > LONGEST_STAND_S && seen.told.insert(state.id) {
                    let (at, status) = (state.position, state.status);
                    eprintln!("vehicle {} ({status:?}) stands at {at:.2} since {since_s:.2} s", state.id);
                }
                seen.longest_stand_s = seen.longest_stand_s.max(stood_s);
            }
        }
    }

    fn health(&self) -> EndHealth {
        EndHealth::default()
    }
}

/// Serves the city for hours.
///
/// # Errors
/// When memory grows, somebody collides or stands for ever, or a program ends.
pub fn soak(args: &SoakArgs) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let overrides = Overrides { duration_s: Some((args.hours + 1.0) * HOUR_S), ..Overrides::default() };
    let request = ScenarioRequest { scenario: args.scenario.clone(), overrides, changes: Vec::new() };
    let experiment = Arc::new(request.read()?);
    let longest = Duration::from_secs_f64((args.hours + 2.0) * HOUR_S);
    let lab =
        SimulatedNetwork::new(SimulatedOptions { seed: args.seed, longest, ..SimulatedOptions::default() });
    let (seen, stop) = (Arc::<Mutex<Seen>>::default(), Arc::<AtomicBool>::default());
    let (of_city, watch, ends) = (Arc::clone(&experiment), Watch(Arc::clone(&seen)), Arc::clone(&stop));
    let city =
        lab.spawn("city", move |host| serve(&of_city, host, watch, ends).map_err(|error| error.to_string()));
    let (hours, seed, director) = (args.hours, args.seed, lab.clone());
    let directed = lab.spawn("director", move |host| {
        let told = direct(&director, &host, &experiment, &seen, hours, seed);
        stop.store(true, Ordering::Relaxed);
        director.stop("mainframe");
        told
    });
    lab.run();
    city.join()?;
    Ok(directed.join()?)
}

fn serve(
    experiment: &Experiment,
    host: Host,
    watch: Watch,
    stop: Arc<AtomicBool>,
) -> Result<(), SessionError> {
    let city = ServedCity::open(ServeOptions::at(CITY), experiment.clone(), None, host.clone())?;
    let (poses, files) =
        (city.poses(), RunFiles::new(RunFolders::None, city.origin(), FileOptions::default()));
    let session = Session::new(city, host).stopped_by(stop);
    session.with_end(poses).with_end(Box::new(watch)).with_end(Box::new(files)).run().map(drop)
}

fn control(experiment: Arc<Experiment>, host: Host) -> Result<(), SessionError> {
    let far = RemoteCity::control(RemoteOptions::to(CITY), experiment, None, host.clone())?;
    Session::new(far, host).run().map(drop)
}

/// Lets mainframes come and go, and tells of each hour.
fn direct(
    lab: &SimulatedNetwork,
    host: &Host,
    experiment: &Arc<Experiment>,
    seen: &Mutex<Seen>,
    hours: f64,
    seed: u64,
) -> Result<(), String> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut between = |[least, most]: [f64; 2]| {
        let part = f64::from(random.next_u32()) / f64::from(u32::MAX);
        least + part * (most - least)
    };
    let (begun, real) = (host.clock.now(), Instant::now());
    let passed_s = || host.clock.now().duration_since(begun).as_secs_f64();
    let (mut mainframes, mut hour, mut memory_kib) = (0u32, 0.0, Vec::new());
    println!(
        "| hour | memory, KiB | vehicles | mainframes | collisions | longest stand, s | real time, s |\n|---|---|---|---|---|---|---|"
    );
    while hour < hours {
        let of_mainframe = Arc::clone(experiment);
        lab.spawn("mainframe", move |host| control(of_mainframe, host).map_err(|error| error.to_string()));
        mainframes += 1;
        lock(seen).mainframe = (mainframes, passed_s(), None);
        let until_s = passed_s() + between(LIFE_S);
        while passed_s() < until_s && hour < hours {
            host.clock.sleep(Duration::from_secs(1));
            if passed_s() >= (hour + 1.0) * HOUR_S {
                hour += 1.0;
                memory_kib.push(resident_kib());
                let seen = lock(seen);
                let Seen { vehicles, collisions, longest_stand_s, .. } = &*seen;
                println!(
                    "| {hour} | {} | {vehicles} | {mainframes} | {collisions} | {longest_stand_s:.1} | {:.0} |",
                    memory_kib[memory_kib.len() - 1],
                    real.elapsed().as_secs_f64(),
                );
            }
        }
        lab.stop("mainframe");
        lock(seen).mainframe.2 = Some(passed_s());
        host.clock.sleep(Duration::from_secs_f64(between([0.0, LONGEST_ABSENCE_S])));
    }
    let seen = lock(seen);
    let growth_kib = memory_kib.last().unwrap_or(&0).saturating_sub(*memory_kib.first().unwrap_or(&0));
    match &*seen {
        Seen { collisions: 1.., .. } => Err("vehicles have collided".to_owned()),
        Seen { longest_stand_s, .. } if *longest_stand_s > LONGEST_STAND_S => {
            Err(format!("a vehicle has stood for {longest_stand_s:.0} s"))
        }
        _ if growth_kib > MOST_GROWTH_KIB => Err(format!("memory has grown by {growth_kib} KiB")),
        _ => Ok(()),
    }
}

/// Resident memory of this process; 0 where the system does not tell it.
fn resident_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}
