//! A laboratory in simulated time: programs that exchange datagrams, and a director who starts, stops and watches them.

use crate::answers::Answering;
use crate::compare::digests;
use city3d_logbook::record::LogOrigin;
use city3d_network::simulated::{SimulatedNetwork, SimulatedOptions};
use city3d_protocol::snapshot::{FrameSnapshot, Status, VehicleId, VehicleState};
use city3d_protocol::wire::{Authenticator, ExperimentPhase};
use city3d_session::remote::{RemoteCity, RemoteOptions};
use city3d_session::robots::{TestbedOptions, TestbedServer};
use city3d_session::served::{ServeOptions, ServedCity};
use city3d_session::{
    End, EndHealth, FileOptions, FilesWritten, Host, LinkStatus, Moment, MomentKind, Order, OrderSender,
    Overwrite, PublishedState, RunFiles, RunFolders, RunState, Session, SessionEnd, SessionError, Source,
};
use city3d_simulation::runner::Summary;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// Where the city is served.
pub const CITY: &str = "127.0.0.1:9870";
/// Each program has ended this long after the director's last act, in virtual time.
const PATIENCE: Duration = Duration::from_secs(120);
/// The director looks this often.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);

/// A shipped scenario that lasts so long.
pub fn scenario(name: &str, duration_s: f64) -> Arc<Experiment> {
    with(name, Overrides { duration_s: Some(duration_s), ..Overrides::default() })
}

/// A shipped scenario that is changed.
pub fn with(name: &str, overrides: Overrides) -> Arc<Experiment> {
    let (text, library) = Library::scenario(name).unwrap();
    Arc::new(read_experiment(name, &text, &library, overrides).unwrap())
}

/// A network whose datagrams take so long, and some of which are lost.
pub fn network(delay_ms: u64, jitter_ms: u64, loss: f64) -> SimulatedOptions {
    let [delay, jitter] = [delay_ms, jitter_ms].map(Duration::from_millis);
    SimulatedOptions { seed: 1, delay, jitter, loss, ..SimulatedOptions::default() }
}

/// A city in real time for one mainframe.
pub fn serving() -> ServeOptions {
    ServeOptions::at(CITY)
}

/// Programs on one network.
#[derive(Clone)]
pub struct Lab {
    pub network: SimulatedNetwork,
    stops: Arc<Mutex<Vec<Arc<AtomicBool>>>>,
}

/// A moment that a session has told.
#[derive(Clone, Debug)]
pub struct Told {
    pub kind: MomentKind,
    pub phase: ExperimentPhase,
    pub snapshot: FrameSnapshot,
}

impl Told {
    /// Vehicles with this status.
    pub fn count(&self, status: Status) -> usize {
        self.snapshot.vehicles.iter().filter(|state| state.status == status).count()
    }

    /// Vehicles that drive by themselves, in a city whose clock runs.
    pub fn driving(&self) -> usize {
        let is_running = self.phase == ExperimentPhase::Running;
        if is_running { self.count(Status::Driving) + self.count(Status::Yielding) } else { 0 }
    }

    pub fn vehicle(&self, id: VehicleId) -> &VehicleState {
        self.snapshot.vehicle(id).unwrap()
    }
}

/// What is known of a program from outside.
#[derive(Default)]
pub struct Desk {
    pub told: Vec<Told>,
    pub answers: Vec<(Order, Result<(), String>)>,
    pub link: Option<LinkStatus>,
    orders: Option<OrderSender>,
    published: Option<PublishedState>,
    written: Arc<Mutex<FilesWritten>>,
    outcome: Option<Result<(), String>>,
}

/// A program of the laboratory.
#[derive(Clone)]
pub struct Program {
    name: String,
    stop: Arc<AtomicBool>,
    desk: Arc<Mutex<Desk>>,
}

/// The end that keeps each moment that changes something.
struct Witness(Arc<Mutex<Desk>>);

impl End for Witness {
    fn name(&self) -> &'static str {
        "witness"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        let (kind, phase, snapshot) = (moment.kind, moment.phase, moment.snapshot);
        if kind != MomentKind::Still {
            self.0.lock().unwrap().told.push(Told { kind, phase, snapshot: snapshot.clone() });
        }
    }

    fn health(&self) -> EndHealth {
        EndHealth::default()
    }
}

impl Lab {
    pub fn new(options: SimulatedOptions) -> Self {
        Self { network: SimulatedNetwork::new(options), stops: Arc::default() }
    }

    /// Runs the programs until they have ended by themselves.
    pub fn run(&self) {
        self.network.run();
    }

    /// Runs the programs while a director looks at them and acts, and ends them after that.
    pub fn direct(self, script: impl FnOnce(&Director) + Send + 'static) {
        let lab = self.clone();
        let direct = move |host: Host| {
            script(&Director { lab: lab.clone(), host });
            lab.stops.lock().unwrap().iter().for_each(|stop| stop.store(true, Ordering::Relaxed));
        };
        self.network.spawn("director", direct);
        self.network.run();
    }

    /// A served city, with its files in a folder where one is given.
    pub fn serve(
        &self,
        experiment: &Arc<Experiment>,
        options: ServeOptions,
        folder: Option<&Path>,
    ) -> Program {
        self.serve_until(SessionEnd::Never, experiment, options, folder)
    }

    /// A served city that ends by itself.
    pub fn serve_until(
        &self,
        end: SessionEnd,
        experiment: &Arc<Experiment>,
        options: ServeOptions,
        folder: Option<&Path>,
    ) -> Program {
        let experiment = Experiment::clone(experiment);
        self.start("city", (LogOrigin::Served, folder), end, move |host, _| {
            let city = ServedCity::open(options, experiment, None, host)?;
            let poses: Box<dyn End> = city.poses();
            Ok((city, Some(poses)))
        })
    }

    /// The control framework, which ends with the experiment.
    pub fn mainframe(&self, experiment: &Arc<Experiment>, folder: Option<&Path>) -> Program {
        let experiment = Arc::clone(experiment);
        self.start("mainframe", (LogOrigin::Mainframe, folder), SessionEnd::Never, move |host, stop| {
            Ok((RemoteCity::control(remote(stop), experiment, None, host)?, None))
        })
    }

    /// Somebody who looks at the city.
    pub fn watcher(&self, experiment: &Arc<Experiment>) -> Program {
        let experiment = Arc::clone(experiment);
        self.start("watcher", (LogOrigin::Mainframe, None), SessionEnd::Never, move |host, stop| {
            Ok((RemoteCity::watch(remote(stop), experiment, host)?, None))
        })
    }

    /// Somebody who comes with a car.
    pub fn guest(&self, name: &str, experiment: &Arc<Experiment>) -> Program {
        let (experiment, car) = (Arc::clone(experiment), name.to_owned());
        self.start(name, (LogOrigin::Mainframe, None), SessionEnd::Never, move |host, stop| {
            Ok((RemoteCity::visit(remote(stop), experiment, car, host)?, None))
        })
    }

    /// The emulated robots.
    pub fn testbed(&self, experiment: &Arc<Experiment>) -> Program {
        let (program, experiment) = (self.program("testbed"), Arc::clone(experiment));
        let stop = Arc::clone(&program.stop);
        self.network.spawn("testbed", move |host| {
            let options =
                TestbedOptions { world: 0, authenticator: Authenticator::Checksum, allowed: Vec::new() };
            let mut testbed = TestbedServer::open(&options, &experiment, None, host).unwrap();
            testbed.run(&stop, &mut |_| {});
        });
        program
    }

    fn program(&self, name: &str) -> Program {
        let (stop, desk) = (Arc::<AtomicBool>::default(), Arc::default());
        self.stops.lock().unwrap().push(Arc::clone(&stop));
        Program { name: name.to_owned(), stop, desk }
    }

    /// Starts a session of its own name, with an end that is told before the files.
    fn start<S: Source + 'static>(
        &self,
        name: &str,
        (origin, folder): (LogOrigin, Option<&Path>),
        end: SessionEnd,
        open: impl FnOnce(Host, Arc<AtomicBool>) -> Result<(S, Option<Box<dyn End>>), SessionError>
        + Send
        + 'static,
    ) -> Program {
        let program = self.program(name);
        let (folder, of_session) = (folder.map(Path::to_path_buf), program.clone());
        self.network.spawn(name, move |host| {
            let outcome = open(host.clone(), Arc::clone(&of_session.stop))
                .and_then(|opened| of_session.run(opened, host, (origin, folder), end));
            of_session.desk().outcome = Some(outcome.map_err(|error| error.to_string()));
        });
        program
    }
}

fn remote(stop: Arc<AtomicBool>) -> RemoteOptions {
    RemoteOptions { stop, ..RemoteOptions::to(CITY) }
}

impl Program {
    fn run<S: Source>(
        &self,
        (source, first): (S, Option<Box<dyn End>>),
        host: Host,
        (origin, folder): (LogOrigin, Option<PathBuf>),
        end: SessionEnd,
    ) -> Result<(), SessionError> {
        let options = FileOptions { log_hz: 100, overwrite: Overwrite::Replace, ..FileOptions::default() };
        let files = RunFiles::new(RunFolders::parts(folder), origin, options);
        self.desk().written = files.written();
        let desk = Arc::clone(&self.desk);
        let session = Session::new(Answering { source, desk: Arc::clone(&self.desk) }, host)
            .until(end)
            .stopped_by(Arc::clone(&self.stop))
            .reporting(Box::new(move |report| desk.lock().unwrap().link.clone_from(&report.link)));
        let session = first.into_iter().fold(session, Session::with_end);
        let session = session.with_end(Box::new(Witness(Arc::clone(&self.desk)))).with_end(Box::new(files));
        self.desk().orders = session.orders();
        let (session, published) = session.publishing();
        self.desk().published = Some(published);
        session.run().map(drop)
    }

    pub fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap()
    }

    /// Gives an order as a window does.
    pub fn order(&self, order: Order) {
        assert!(self.desk().orders.as_ref().unwrap().send(order), "the session takes no orders");
    }

    /// The state that its window would show.
    pub fn run_state(&self) -> Arc<RunState> {
        self.desk().published.as_ref().unwrap().run_state()
    }

    /// The moments that it has told.
    pub fn told(&self) -> Vec<Told> {
        self.desk().told.clone()
    }

    /// The last moment that it has told.
    pub fn last(&self) -> Told {
        self.desk().told.last().unwrap().clone()
    }

    /// Tick and digest of the first moment and of each tick after it.
    pub fn digests(&self) -> Vec<(u64, u64)> {
        digests(&self.desk().told)
    }

    /// Summary of its last run; it has to have ended well.
    pub fn summary(&self) -> Summary {
        let desk = self.desk();
        assert_eq!(desk.outcome, Some(Ok(())), "{}", self.name);
        let written = desk.written.lock().unwrap();
        assert!(written.failure.is_none(), "{:?}", written.failure);
        written.summary.clone().unwrap()
    }
}

/// Who looks at the programs and acts on them, in the same virtual time.
pub struct Director {
    pub lab: Lab,
    host: Host,
}

impl Director {
    /// Waits until a program's last moment is so.
    pub fn until(&self, program: &Program, what: &str, is_so: impl Fn(&Told) -> bool) -> Told {
        self.wait(what, || program.desk().told.last().filter(|told| is_so(told)).cloned())
    }

    /// Waits until a program's link is so, as its window shows it.
    pub fn until_link(
        &self,
        program: &Program,
        what: &str,
        is_so: impl Fn(&LinkStatus) -> bool,
    ) -> LinkStatus {
        self.wait(what, || program.desk().link.clone().filter(&is_so))
    }

    /// Waits until something is there.
    pub fn wait<T>(&self, what: &str, look: impl Fn() -> Option<T>) -> T {
        let until = self.host.clock.now() + PATIENCE;
        loop {
            if let Some(found) = look() {
                return found;
            }
            assert!(self.host.clock.now() < until, "never: {what}");
            self.host.clock.sleep(LOOK_INTERVAL);
        }
    }

    /// Lets virtual time go by.
    pub fn pass(&self, wait_s: f64) {
        self.host.clock.sleep(Duration::from_secs_f64(wait_s));
    }

    /// Ends a program at once, as by killing it.
    pub fn kill(&self, program: &Program) {
        self.lab.network.stop(&program.name);
    }

    /// Tells a program to end, as Ctrl-C does, and waits for that.
    pub fn end(&self, program: &Program) {
        program.stop.store(true, Ordering::Relaxed);
        self.until_end(program);
    }

    /// Waits until a program ends by itself, and well.
    pub fn until_end(&self, program: &Program) {
        let outcome = self.wait("the end of a program", || program.desk().outcome.clone());
        assert_eq!(outcome, Ok(()), "{}", program.name);
    }
}

/// The vehicle of a name.
pub fn named(experiment: &Experiment, name: &str) -> VehicleId {
    experiment.vehicles.iter().find(|planned| planned.name == name).unwrap().id
}
