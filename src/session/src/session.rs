//! A session: one source, one clock, and the ends that are told what happens.

mod handle;
mod publish;

pub use handle::{OnUpdate, PublishedState, SessionHandle, SessionStopper};

use super::clock::RealTimeFactorMeter;
use super::decisions::DecisionTeller;
use super::end::{Ends, RunAccount};
use super::event_feed::EventCollector;
use super::lateness::LatenessHistogram;
use super::playback::TimelineMark;
use super::source::{Now, Pace, Source, Step};
use super::state::{EndStatus, LatestState};
use super::{
    FilesWritten, Inputs, LinkStatus, Moment, MomentKind, Order, OrderSender, Orders, PacingClock, RunGoal,
    RunPhase, SessionError, Speed, StepTiming, orders,
};
use city3d_network::host::Host;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_simulation::runner::{LinkSummary, PicturesSummary, RosSummary};
use handle::UpdateSignal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Interval at which a moment is told again while the clock stands, for those who have missed it.
const STILL_INTERVAL: Duration = Duration::from_millis(100);
/// How long the last moment is told again after the end of the experiment.
const FINAL_DURATION: Duration = Duration::from_millis(300);
/// Least time between two published states while the speed is unlimited.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(8);
/// Least time between two copies of the measures of the traffic for a window, while the run goes on.
const MEASURE_INTERVAL: Duration = Duration::from_millis(100);
/// Interval at which failures of ends are looked for, and the link is described.
const REPORT_INTERVAL: Duration = Duration::from_millis(500);
/// Longest sleep while nothing is due; orders and input end it.
const IDLE_WAIT: Duration = Duration::from_secs(3600);

/// When a session ends by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SessionEnd {
    /// It does not: a person, or a signal, ends it.
    #[default]
    Never,
    /// After this tick.
    AtTick(u64),
}

/// A city that runs.
pub struct Session<S: Source> {
    source: S,
    ends: Ends,
    host: Host,
    orders: Orders,
    sender: Option<OrderSender>,
    stop: Arc<AtomicBool>,
    end: SessionEnd,
    speed: Speed,
    /// The pacing clock while the city is paced by it.
    clock: Option<PacingClock>,
    rate: RealTimeFactorMeter,
    /// Simulated time that was skipped because the machine fell behind.
    time_skipped_s: f64,
    /// How late the ticks of the present run have begun.
    lateness: LatenessHistogram,
    /// Number of the run, from 1; a reset begins the next one.
    run: u32,
    /// The first moment of the present run was told.
    has_begun: bool,
    told_at: Instant,
    reported_at: Instant,
    view: Option<View>,
    refusal: Option<(u64, Arc<str>)>,
    /// Where the run is to pause by itself.
    goal: Option<RunGoal>,
    /// Published states tell plans.
    tells_plans: bool,
    decisions: DecisionTeller,
    on_report: Option<OnReport>,
    /// A failure of an end ends the session.
    is_strict: bool,
}

/// Is told at intervals what a session does.
pub type OnReport = Box<dyn FnMut(&SessionReport) + Send>;

/// What a session does, for people.
#[derive(Clone, Debug)]
pub struct SessionReport {
    /// Simulated time, seconds.
    pub time_s: f64,
    /// Phase of the experiment.
    pub phase: RunPhase,
    /// Vehicles in the city.
    pub vehicles: usize,
    /// Measured real-time factor; 0 while the clock stands.
    pub real_time_factor: f64,
    /// Its link, where it has one.
    pub link: Option<LinkStatus>,
    /// Its ends.
    pub ends: Vec<EndStatus>,
}

/// What a window sees of a session: a mailbox of size one, and whom to tell.
struct View {
    latest_state: Arc<LatestState>,
    updates: UpdateSignal,
    /// The snapshot that was published last.
    latest: Arc<FrameSnapshot>,
    /// The city has changed since.
    is_stale: bool,
    published_at: Instant,
    measured_at: Instant,
    /// Where moments come as they arrive: a clock to interpolate by.
    arrival_clock: Option<PacingClock>,
    files: Option<Arc<Mutex<FilesWritten>>>,
    link: Option<Arc<LinkStatus>>,
    ends: Arc<Vec<EndStatus>>,
    events: EventCollector,
}

impl<S: Source> Session<S> {
    /// A session of a source, by the clock of a host; it has no ends yet.
    pub fn new(source: S, host: Host) -> Self {
        let (sender, orders) = orders();
        let now = host.clock.now();
        Self {
            rate: RealTimeFactorMeter::new(now, source.snapshot().time_s),
            source,
            ends: Ends::default(),
            orders,
            sender: Some(sender),
            stop: Arc::default(),
            end: SessionEnd::Never,
            speed: Speed::default(),
            clock: None,
            time_skipped_s: 0.0,
            lateness: LatenessHistogram::default(),
            run: 1,
            has_begun: false,
            told_at: now,
            reported_at: now,
            view: None,
            refusal: None,
            goal: None,
            tells_plans: false,
            decisions: DecisionTeller::default(),
            on_report: None,
            is_strict: false,
            host,
        }
    }

    /// Attaches an end; those that somebody waits for come first.
    #[must_use]
    pub fn with_end(mut self, end: Box<dyn super::End>) -> Self {
        self.ends.attach(end);
        self
    }

    /// Sets the target speed.
    #[must_use]
    pub fn at_speed(mut self, speed: Speed) -> Self {
        self.speed = speed;
        self
    }

    /// Sets when the session ends by itself.
    #[must_use]
    pub fn until(mut self, end: SessionEnd) -> Self {
        self.end = end;
        self
    }

    /// Ends the session when this flag is set.
    #[must_use]
    pub fn stopped_by(mut self, stop: Arc<AtomicBool>) -> Self {
        self.stop = stop;
        self
    }

    /// Calls this twice a second with what it does.
    #[must_use]
    pub fn reporting(mut self, on_report: OnReport) -> Self {
        self.on_report = Some(on_report);
        self
    }

    /// Ends with an error when an end fails: for a run whose files are all that is wanted of it.
    #[must_use]
    pub fn strictly(mut self) -> Self {
        self.is_strict = true;
        self
    }

    /// What gives it orders.
    pub fn orders(&self) -> Option<OrderSender> {
        self.sender.clone()
    }

    /// Runs until it is stopped, or over.
    ///
    /// # Errors
    /// When the source cannot go on.
    pub fn run(mut self) -> Result<S, SessionError> {
        // Only who asked for it gives orders.
        self.sender = None;
        let outcome = self.run_to_end();
        let finished = self.finish();
        self.publish(true);
        outcome.and(finished).map(|()| self.source)
    }

    fn run_to_end(&mut self) -> Result<(), SessionError> {
        while !self.stop.load(Ordering::Relaxed) && !self.is_over() {
            let most = self.wait_time();
            self.source.wait(&mut self.orders, most);
            if self.stop.load(Ordering::Relaxed) {
                break;
            }
            // An order that waits for a step comes before the next one.
            while !self.source.is_ready()
                && let Some(order) = self.orders.take()
            {
                self.carry_out(order);
            }
            self.source.receive(&self.now())?;
            self.advance()?;
            self.report()?;
        }
        if self.is_over() {
            self.tell_last()?;
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        let is_at_end = match self.end {
            SessionEnd::Never => false,
            SessionEnd::AtTick(tick) => self.source.snapshot().tick >= tick,
        };
        is_at_end || self.source.is_over()
    }

    /// The final poses may get lost, so they are told for a while.
    fn tell_last(&mut self) -> Result<(), SessionError> {
        if !self.source.lingers() {
            return Ok(());
        }
        let until = self.host.clock.now() + FINAL_DURATION;
        while let Some(left) =
            until.checked_duration_since(self.host.clock.now()).filter(|left| !left.is_zero())
        {
            self.source.wait(&mut self.orders, left.min(STILL_INTERVAL));
            self.source.receive(&self.now())?;
            self.tell(MomentKind::Still, self.standing());
        }
        Ok(())
    }

    /// Longest sleep before something is due.
    fn wait_time(&self) -> Duration {
        let now = self.host.clock.now();
        if self.source.is_ready() {
            return Duration::ZERO;
        }
        let until_still = STILL_INTERVAL.saturating_sub(now.saturating_duration_since(self.told_at));
        match (self.source.pace(), self.source.is_running(), self.clock) {
            (Pace::Clock, true, Some(clock)) => clock.until(now, self.source.snapshot().time_s),
            (Pace::Clock, true, None) => Duration::ZERO,
            _ if self.source.lingers() => until_still.max(Duration::from_micros(1)),
            _ => IDLE_WAIT,
        }
    }

    fn now(&self) -> Now {
        let (at, time_s) = (self.host.clock.now(), self.source.snapshot().time_s);
        Now {
            at,
            simulated_s: self.clock.map_or(time_s, |clock| clock.simulated_s(at)),
            until_due: self.clock.map(|clock| clock.until(at, time_s)),
            is_still_due: at.saturating_duration_since(self.told_at) >= STILL_INTERVAL,
        }
    }

    fn carry_out(&mut self, order: Order) {
        match order {
            Order::RunUntil(goal) => return self.run_until(goal),
            // Whoever takes the run in hand has another goal.
            Order::Start | Order::Pause | Order::Step | Order::Reset => self.goal = None,
            _ => {}
        }
        match (self.source.order(&order), order) {
            (Ok(()), Order::Speed(speed)) => {
                self.speed = speed;
                self.clock = None;
                self.rate = RealTimeFactorMeter::new(self.host.clock.now(), self.source.snapshot().time_s);
            }
            (Ok(()), Order::TellPlans(tells_plans)) => self.tells_plans = tells_plans,
            (Ok(()), Order::TellDecisions(is_asked)) => self.decisions.ask(is_asked),
            // Pedals come with every frame, and show with the next tick.
            (Ok(()), Order::Drive(..) | Order::Release(_)) => return,
            (Ok(()), _) => {}
            (Err(why), _) => self.refuse(why),
        }
        self.publish(true);
    }

    fn refuse(&mut self, why: String) {
        let count = self.refusal.as_ref().map_or(0, |(count, _)| *count);
        self.refusal = Some((count + 1, why.into()));
    }

    /// Lets the run go on until it has come to a goal.
    fn run_until(&mut self, goal: RunGoal) {
        let now_s = self.source.snapshot().time_s;
        let started = match goal {
            RunGoal::Time(time_s) if time_s <= now_s => Err(format!("the run is at {now_s:.2} s already")),
            _ if self.source.is_running() => Ok(()),
            _ => self.source.order(&Order::Start),
        };
        match started {
            Ok(()) => self.goal = Some(goal),
            Err(why) => self.refuse(why),
        }
        self.publish(true);
    }

    /// Pauses a run that has come to its goal.
    fn pause_at_goal(&mut self, marks: &[TimelineMark]) {
        let time_s = self.source.snapshot().time_s;
        if self.goal.take_if(|goal| goal.is_met(time_s, marks)).is_some()
            && let Err(why) = self.source.order(&Order::Pause)
        {
            self.refuse(why);
        }
    }

    /// Makes the step that is due.
    fn advance(&mut self) -> Result<(), SessionError> {
        let now = self.host.clock.now();
        let time_s = self.source.snapshot().time_s;
        let is_running = self.source.is_running();
        if !is_running {
            self.clock = None;
        }
        if self.source.is_ready() {
            self.step(now)?;
        } else if is_running && self.source.pace() == Pace::Clock {
            match self.speed {
                Speed::Unlimited => self.step(now)?,
                Speed::Times(factor) => {
                    let clock = *self.clock.get_or_insert_with(|| PacingClock::new(now, time_s, factor));
                    // The same rounding as that of the wait before it: else neither of them would go on.
                    if clock.until(now, time_s).is_zero() {
                        self.step(clock.at(time_s))?;
                    }
                    self.give_up_lost_time();
                }
            }
        }
        let is_still_due = now.saturating_duration_since(self.told_at) >= STILL_INTERVAL;
        if self.source.wants_still() || (is_still_due && self.source.lingers()) {
            self.tell(MomentKind::Still, self.standing());
        }
        Ok(())
    }

    /// A session far behind its clock does not hurry after it.
    fn give_up_lost_time(&mut self) {
        let (now, time_s) = (self.host.clock.now(), self.source.snapshot().time_s);
        if let Some(clock) = &mut self.clock {
            let before_s = clock.simulated_s(now);
            clock.resync(now, time_s);
            self.time_skipped_s += (before_s - clock.simulated_s(now)).max(0.0);
        }
    }

    fn standing(&self) -> ((u64, f64), StepTiming) {
        let snapshot = self.source.snapshot();
        ((snapshot.tick, snapshot.time_s), StepTiming::at(self.host.clock.now()))
    }

    fn step(&mut self, due: Instant) -> Result<(), SessionError> {
        let from = (self.source.snapshot().tick, self.source.snapshot().time_s);
        self.prepare(from);
        let begun = self.host.clock.now();
        let step = self.source.step()?;
        let timing = StepTiming { due, begun, done: self.host.clock.now() };
        match step {
            Step::First => {
                self.has_begun = true;
                self.tell(MomentKind::First, (from, timing));
            }
            Step::Tick => {
                if self.clock.is_some() {
                    self.lateness.take(begun.saturating_duration_since(due));
                }
                self.tell(MomentKind::Tick, (from, timing));
            }
            Step::Applied => self.tell(MomentKind::Applied, (from, timing)),
            Step::Reset(last) => {
                // A window hears of it with the number of the new run.
                self.tell_ends(MomentKind::Applied, (from, timing));
                self.end_run(&last, false);
            }
        }
        self.source.told();
        Ok(())
    }

    /// Tells the ends that a step comes, and that a run begins with it.
    fn prepare(&mut self, from: (u64, f64)) {
        let timing = StepTiming::at(self.host.clock.now());
        let moment = |kind, inputs| moment(&self.source, &self.host, (kind, inputs), (from, timing));
        if self.source.opens_files() {
            self.ends.prepare(&moment(MomentKind::Applied, self.source.setups()));
        }
        if !self.has_begun && self.source.is_beginning() {
            self.has_begun = true;
            let first = moment(MomentKind::First, Inputs::None);
            self.ends.take(&first);
            if let Some(view) = &mut self.view {
                view.events.take(&first);
            }
        }
    }

    fn tell(&mut self, kind: MomentKind, times: ((u64, f64), StepTiming)) {
        self.tell_ends(kind, times);
        self.publish(false);
    }

    fn tell_ends(&mut self, kind: MomentKind, (from, timing): ((u64, f64), StepTiming)) {
        let inputs = if kind == MomentKind::Still { Inputs::None } else { self.source.inputs() };
        let moment = moment(&self.source, &self.host, (kind, inputs), (from, timing));
        self.ends.take(&moment);
        self.decisions.take(&moment);
        if let (Some(view), true) = (&mut self.view, kind != MomentKind::Still) {
            let marks = view.events.take(&moment);
            view.is_stale = true;
            if kind == MomentKind::Tick {
                self.pause_at_goal(&marks);
            }
        }
        self.told_at = self.host.clock.now();
    }

    /// The present run ends with this snapshot; `is_stopped` where that is before its end.
    fn end_run(&mut self, last: &FrameSnapshot, is_stopped: bool) {
        if !self.is_strict {
            // A failure since the last report counts too.
            self.ends.say_failures();
        }
        let account = RunAccount { is_stopped, ..self.account() };
        self.lateness = LatenessHistogram::default();
        let times = ((last.tick, last.time_s), StepTiming::at(self.host.clock.now()));
        let moment = moment(&self.source, &self.host, (MomentKind::Still, Inputs::None), times);
        let moment = Moment { snapshot: last, ..moment };
        self.ends.finish_run(&moment, &account);
        self.run += 1;
        (self.has_begun, self.goal) = (false, None);
        if let Some(view) = &mut self.view {
            view.events.restart();
        }
        self.rate = RealTimeFactorMeter::new(self.host.clock.now(), self.source.snapshot().time_s);
        self.publish(true);
    }

    fn account(&self) -> RunAccount {
        let ends = self.ends.summary();
        let pictures = ends
            .get("pictures")
            .map(|end| PicturesSummary { published: end.delivered, dropped: end.dropped });
        let link = self.source.link().map(|link| LinkSummary {
            time_skipped_s: self.time_skipped_s,
            tick_lateness: self.lateness.summary(),
            ros: link.ros.map(|ros| RosSummary { pictures, ..ros }),
            ..link
        });
        RunAccount { link, ends, is_stopped: false }
    }

    fn finish(&mut self) -> Result<(), SessionError> {
        let last = self.source.snapshot().clone();
        let is_whole = self.is_over() || self.source.phase() == RunPhase::Over;
        self.end_run(&last, !is_whole);
        self.run -= 1;
        self.ends.close();
        self.check_ends()
    }

    /// Tells at intervals what it does, and what has failed.
    fn report(&mut self) -> Result<(), SessionError> {
        let now = self.host.clock.now();
        if now.saturating_duration_since(self.reported_at) < REPORT_INTERVAL {
            return Ok(());
        }
        self.reported_at = now;
        self.check_ends()?;
        if self.view.is_none() && self.on_report.is_none() {
            return Ok(());
        }
        let (snapshot, phase) = (self.source.snapshot(), self.source.phase());
        self.rate.record(now, snapshot.time_s);
        let real_time_factor = if phase == RunPhase::Running { self.rate.factor() } else { 0.0 };
        let report = SessionReport {
            time_s: snapshot.time_s,
            vehicles: snapshot.vehicles.len(),
            phase,
            real_time_factor,
            link: self.source.link_status(),
            ends: self.ends.status(),
        };
        if let Some(on_report) = &mut self.on_report {
            on_report(&report);
        }
        if let Some(view) = &mut self.view {
            (view.link, view.ends) = (report.link.map(Arc::new), Arc::new(report.ends));
            self.publish(true);
        }
        Ok(())
    }

    fn check_ends(&mut self) -> Result<(), SessionError> {
        if !self.is_strict {
            self.ends.say_failures();
            return Ok(());
        }
        self.ends.failure().map_or(Ok(()), |failure| Err(SessionError::End(failure)))
    }
}

/// The present moment of a source: what has changed and by which commands, and when that began.
fn moment<'a, S: Source>(
    source: &'a S,
    host: &Host,
    (kind, inputs): (MomentKind, Inputs<'a>),
    (from, timing): ((u64, f64), StepTiming),
) -> Moment<'a> {
    Moment {
        kind,
        experiment: source.experiment(),
        snapshot: source.snapshot(),
        phase: source.experiment_phase(),
        mainframe: source.mainframe(),
        heard: source.heard(),
        inputs,
        from,
        timing,
        unix_s: host.clock.unix_s(),
    }
}
