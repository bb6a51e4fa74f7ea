//! What ends do to a city that runs: whether they are slow, full, dead, or gone and back, it goes on as without them.

mod files;
mod link;
#[cfg(feature = "render")]
mod pictures;
#[cfg(feature = "ros")]
mod ros;
mod window;

use crate::compare::assert_same;
use crate::lab::scenario;
use city3d_control::Mainframe;
use city3d_logbook::record::LogOrigin;
use city3d_network::simulated::{SimulatedNetwork, SimulatedOptions};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleInfo, VehicleState};
use city3d_session::{
    End, EndFailure, EndHealth, FileOptions, Inputs, LocalCity, Moment, MomentKind, Now, Order, OrderSender,
    Orders, Pace, RunAccount, RunFiles, RunFolders, RunPhase, Session, SessionEnd, SessionError, Source,
    Step,
};
use city3d_simulation::runner::{EndSummary, Run};
use city3d_simulation::scenario::Experiment;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// An end may take this long for a moment.
const LONGEST_TAKE: Duration = Duration::from_millis(5);
/// A busy machine takes the processor away now and then: one call of so many may take longer, but none this long.
const CALLS_PER_OUTLIER: usize = 20;
const LONGEST_OUTLIER: Duration = Duration::from_millis(500);
/// On the average it takes less than this.
const MEAN_TAKE: Duration = Duration::from_millis(1);
/// A state of an end lasts this long, in the city's time, so that the session sees it.
const DWELL: Duration = Duration::from_millis(700);
/// Longest real time of a stage.
const PATIENCE: Duration = Duration::from_secs(30);

/// The city drives until the end is so, and for a while after that; then something happens.
struct Stage {
    what: &'static str,
    is_so: Box<dyn Fn(&EndHealth) -> bool + Send>,
    then: Box<dyn FnOnce(&OrderSender) + Send>,
}

impl Stage {
    fn new(what: &'static str, is_so: impl Fn(&EndHealth) -> bool + Send + 'static) -> Self {
        Self { what, is_so: Box::new(is_so), then: Box::new(|_| {}) }
    }

    fn then(self, then: impl FnOnce(&OrderSender) + Send + 'static) -> Self {
        Self { then: Box::new(then), ..self }
    }

    /// Gives an order after it.
    fn order(self, order: Order) -> Self {
        self.then(move |orders| assert!(orders.send(order)))
    }
}

/// What was seen of an end.
#[derive(Default)]
struct Probe {
    takes: Vec<Duration>,
    health: EndHealth,
    /// Tick and digest, of each run.
    runs: Vec<Vec<(u64, u64)>>,
    /// As the summary of each run has it.
    accounts: Vec<EndSummary>,
    orders: Option<OrderSender>,
}

/// An end whose calls are timed.
struct Timed {
    end: Box<dyn End>,
    /// The end is told of so many more vehicles.
    crowd: u32,
    probe: Arc<Mutex<Probe>>,
}

impl Timed {
    fn call(&mut self, moment: &Moment<'_>, call: impl FnOnce(&mut dyn End, &Moment<'_>)) {
        let crowded = (self.crowd > 0).then(|| crowded(moment.snapshot, self.crowd));
        let moment = Moment { snapshot: crowded.as_ref().unwrap_or(moment.snapshot), ..*moment };
        let begun = Instant::now();
        call(&mut *self.end, &moment);
        let took = begun.elapsed();
        let mut probe = self.probe.lock().unwrap();
        probe.takes.push(took);
        probe.health = self.end.health();
        drop(probe);
        // Simulated time is faster than the threads of an end.
        std::thread::yield_now();
    }
}

impl End for Timed {
    fn name(&self) -> &'static str {
        self.end.name()
    }

    fn prepare(&mut self, before: &Moment<'_>) {
        self.call(before, |end, moment| end.prepare(moment));
    }

    fn take(&mut self, moment: &Moment<'_>) {
        let snapshot = moment.snapshot;
        let mut probe = self.probe.lock().unwrap();
        match moment.kind {
            MomentKind::First => probe.runs.push(vec![(snapshot.tick, snapshot.state_hash)]),
            MomentKind::Tick => {
                probe.runs.last_mut().unwrap().push((snapshot.tick, snapshot.state_hash));
            }
            MomentKind::Applied | MomentKind::Still => {}
        }
        drop(probe);
        self.call(moment, |end, moment| end.take(moment));
    }

    fn finish_run(&mut self, last: &Moment<'_>, account: &RunAccount) {
        self.probe.lock().unwrap().accounts.extend(account.ends.get(self.name()).cloned());
        self.call(last, |end, last| end.finish_run(last, account));
    }

    fn close(&mut self) {
        self.end.close();
    }

    fn health(&self) -> EndHealth {
        self.end.health()
    }
}

/// The same city with more vehicles, which stand at the places of others.
fn crowded(snapshot: &FrameSnapshot, crowd: u32) -> FrameSnapshot {
    let (mut crowded, mut roster) = (snapshot.clone(), snapshot.roster.to_vec());
    let (state, info) = (snapshot.vehicles[0].clone(), roster[0].clone());
    for id in (0..crowd).map(|number| VehicleId(1000 + number)) {
        crowded.vehicles.push(VehicleState { id, ..state.clone() });
        roster.push(VehicleInfo { id, name: format!("more{id}"), ..info.clone() });
    }
    crowded.roster = Arc::new(roster);
    crowded
}

/// A local city that goes through stages, and is over after the last.
struct Staged {
    city: LocalCity,
    stages: Vec<Stage>,
    probe: Arc<Mutex<Probe>>,
    /// When the present stage began, on the real clock.
    begun: Instant,
    /// Since when the end is as the stage wants it, on the session's clock.
    since: Option<Instant>,
}

impl Source for Staged {
    fn experiment(&self) -> &Arc<Experiment> {
        self.city.experiment()
    }

    fn snapshot(&self) -> &FrameSnapshot {
        self.city.snapshot()
    }

    fn origin(&self) -> LogOrigin {
        self.city.origin()
    }

    fn mainframe(&self) -> Option<&Mainframe> {
        self.city.mainframe()
    }

    fn pace(&self) -> Pace {
        self.city.pace()
    }

    fn is_running(&self) -> bool {
        self.city.is_running()
    }

    fn is_ready(&self) -> bool {
        self.city.is_ready()
    }

    fn is_beginning(&self) -> bool {
        self.city.is_beginning()
    }

    fn opens_files(&self) -> bool {
        self.city.opens_files()
    }

    fn phase(&self) -> RunPhase {
        self.city.phase()
    }

    fn order(&mut self, order: &Order) -> Result<(), String> {
        self.city.order(order)
    }

    fn wait(&mut self, orders: &mut Orders, most: Duration) {
        self.city.wait(orders, most);
    }

    fn receive(&mut self, now: &Now) -> Result<(), SessionError> {
        let probe = self.probe.lock().unwrap();
        let Some(stage) = self.stages.first() else { return Ok(()) };
        assert!(self.begun.elapsed() < PATIENCE, "never: {}; it is {:?}", stage.what, probe.health);
        if !(stage.is_so)(&probe.health) {
            self.since = None;
        } else if now.at - *self.since.get_or_insert(now.at) >= DWELL {
            (self.since, self.begun) = (None, Instant::now());
            (self.stages.remove(0).then)(probe.orders.as_ref().unwrap());
        }
        Ok(())
    }

    fn step(&mut self) -> Result<Step, SessionError> {
        self.city.step()
    }

    fn inputs(&self) -> Inputs<'_> {
        self.city.inputs()
    }

    fn is_over(&self) -> bool {
        self.stages.is_empty()
    }
}

/// Asserts that a city drives in real time with this end as it does without, through all stages: no call of the end
/// takes long, and ticks and digests are the same. Gives the end as it was at last, and its account of each run.
fn passes(end: Box<dyn End>, crowd: u32, stages: Vec<Stage>) -> (EndHealth, Vec<EndSummary>) {
    // Long enough for PATIENCE to end first: simulated time runs fast, and an end is slow on a busy machine.
    let experiment = scenario("roundabout", 36_000.0);
    let probe = Arc::<Mutex<Probe>>::default();
    let (of_city, of_end, driven) = (Arc::clone(&probe), Arc::clone(&probe), Arc::clone(&experiment));
    // An end may be slow on a busy machine: the real clock limits each stage.
    let longest = Duration::from_secs(1_000_000);
    let lab = SimulatedNetwork::new(SimulatedOptions { longest, ..SimulatedOptions::default() });
    lab.spawn("city", move |host| {
        let city = LocalCity::new(driven, host.clone()).unwrap().started();
        let (begun, since) = (Instant::now(), None);
        let source = Staged { city, stages, probe: Arc::clone(&of_city), begun, since };
        let session = Session::new(source, host).with_end(Box::new(Timed { end, crowd, probe: of_end }));
        of_city.lock().unwrap().orders = session.orders();
        session.run().unwrap();
    });
    lab.run();
    let probe = std::mem::take(&mut *probe.lock().unwrap());
    assert_quick(&probe.takes);
    for run in &probe.runs {
        assert_same(run, &without_end(&experiment, run.len()), "city");
    }
    (probe.health, probe.accounts)
}

fn assert_quick(takes: &[Duration]) {
    let slow: Vec<&Duration> = takes.iter().filter(|took| **took > LONGEST_TAKE).collect();
    let outlier = slow.iter().find(|took| ***took > LONGEST_OUTLIER);
    assert!(
        slow.len() <= takes.len() / CALLS_PER_OUTLIER && outlier.is_none(),
        "{slow:?} of {} calls",
        takes.len()
    );
    let (sum, count) = (takes.iter().sum::<Duration>(), takes.len() as u32);
    assert!(sum < MEAN_TAKE * count, "{sum:?} for {count} calls");
}

/// Digests of the first ticks of a run that nobody is told.
fn without_end(experiment: &Arc<Experiment>, count: usize) -> Vec<(u64, u64)> {
    let mut run = Run::new(Arc::clone(experiment)).unwrap();
    let mut digests = vec![(0, run.snapshot().state_hash)];
    while digests.len() < count {
        run.step();
        digests.push((run.snapshot().tick, run.snapshot().state_hash));
    }
    digests
}

/// An end that has never worked.
struct Broken;

impl End for Broken {
    fn name(&self) -> &'static str {
        "broken"
    }

    fn take(&mut self, _moment: &Moment<'_>) {}

    fn health(&self) -> EndHealth {
        let failure = Some(EndFailure::new(std::io::Error::other("it is broken")));
        EndHealth { failure, ..EndHealth::default() }
    }
}

#[test]
fn the_failure_of_an_end_is_counted_in_the_shortest_run() {
    let files = RunFiles::new(RunFolders::None, LogOrigin::Run, FileOptions::default());
    let written = files.written();
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    lab.spawn("city", move |host| {
        let city = LocalCity::new(scenario("roundabout", 1.0), host.clone()).unwrap().started();
        let session = Session::new(city, host).until(SessionEnd::AtTick(10));
        session.with_end(Box::new(Broken)).with_end(Box::new(files)).run().unwrap();
    });
    lab.run();
    let summary = written.lock().unwrap().summary.clone().unwrap();
    let broken = &summary.ends["broken"];
    assert_eq!((broken.failures, broken.failure.as_deref()), (1, Some("it is broken")));
}
