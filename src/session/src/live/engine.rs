//! The simulation thread: command loop, pacing and publication.

use super::pace::RealTimeFactorMeter;
use super::{LatestState, LiveError, PacingClock, Recording, RunCommand, RunPhase, RunState, Speed};
use city3d_protocol::snapshot::{FrameSnapshot, SimCommand, VehicleId};
use city3d_simulation::runner::Run;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Longest simulation batch between two checks of the command channel.
const BATCH_TIME: Duration = Duration::from_millis(4);
/// Least time between two published states while the speed is unlimited.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(8);
/// Wait for commands while paused; every command wakes the thread.
const IDLE_WAIT: Duration = Duration::from_secs(3600);

type OnUpdate = Option<Box<dyn Fn() + Send>>;

pub(super) struct Engine {
    run: Run,
    recording: Recording,
    latest_state: Arc<LatestState>,
    on_update: OnUpdate,
    phase: RunPhase,
    speed: Speed,
    clock: Option<PacingClock>,
    rate: RealTimeFactorMeter,
    /// Commands of persons for the next tick.
    commands: BTreeMap<VehicleId, SimCommand>,
    latest: Arc<FrameSnapshot>,
    published_at: Instant,
}

impl Engine {
    pub(super) fn new(
        run: Run,
        recording: Recording,
        (latest_state, on_update): (Arc<LatestState>, OnUpdate),
    ) -> Self {
        let now = Instant::now();
        Self {
            latest: Arc::new(run.snapshot().clone()),
            rate: RealTimeFactorMeter::new(now, run.snapshot().time_s),
            run,
            recording,
            latest_state,
            on_update,
            phase: RunPhase::Ready,
            speed: Speed::default(),
            clock: None,
            commands: BTreeMap::new(),
            published_at: now,
        }
    }

    /// Runs until a stop command, or until the channel is closed.
    pub(super) fn run_loop(mut self, commands: &Receiver<RunCommand>) -> Result<Vec<PathBuf>, LiveError> {
        loop {
            let mut wait = self.wait();
            loop {
                match commands.recv_timeout(wait) {
                    Ok(RunCommand::Stop) | Err(RecvTimeoutError::Disconnected) => {
                        self.recording.finish(&self.run)?;
                        return Ok(self.recording.folders().to_vec());
                    }
                    Ok(command) => self.apply(command),
                    Err(RecvTimeoutError::Timeout) => break,
                }
                wait = Duration::ZERO;
            }
            if self.phase == RunPhase::Running {
                self.advance();
            }
        }
    }

    /// Longest wait for commands before the next tick is due.
    fn wait(&self) -> Duration {
        match (&self.phase, self.clock) {
            (RunPhase::Running, None) => Duration::ZERO,
            (RunPhase::Running, Some(clock)) => clock.until(Instant::now(), self.run.snapshot().time_s),
            _ => IDLE_WAIT,
        }
    }

    fn apply(&mut self, command: RunCommand) {
        match command {
            RunCommand::Start => {
                if !matches!(self.phase, RunPhase::Failed(_)) {
                    self.phase = RunPhase::Running;
                    self.set_clock();
                }
            }
            RunCommand::Pause => {
                if self.phase == RunPhase::Running {
                    self.hold(RunPhase::Paused);
                }
            }
            RunCommand::Step => {
                if !matches!(self.phase, RunPhase::Failed(_)) {
                    self.hold(RunPhase::Paused);
                    self.tick();
                }
            }
            RunCommand::Reset => self.reset(),
            RunCommand::Speed(speed) => {
                self.speed = speed;
                self.set_clock();
            }
            RunCommand::Vehicle(command) => {
                if let Some(vehicle) = command.vehicle() {
                    self.commands.insert(vehicle, command);
                }
                return;
            }
            RunCommand::Stop => return,
        }
        self.publish(Instant::now());
    }

    fn set_clock(&mut self) {
        let (now, time_s) = (Instant::now(), self.run.snapshot().time_s);
        self.rate = RealTimeFactorMeter::new(now, time_s);
        self.clock = match self.speed {
            Speed::Times(factor) if self.phase == RunPhase::Running => {
                Some(PacingClock::new(now, time_s, factor))
            }
            _ => None,
        };
    }

    fn hold(&mut self, phase: RunPhase) {
        self.phase = phase;
        self.set_clock();
    }

    fn reset(&mut self) {
        self.commands.clear();
        let outcome = self.recording.finish(&self.run).and_then(|()| Ok(self.run.reset()?));
        self.recording.next(self.recording.run() + 1);
        self.latest = Arc::new(self.run.snapshot().clone());
        self.hold(outcome.map_or_else(|error| RunPhase::Failed(error.to_string()), |()| RunPhase::Ready));
    }

    /// Simulates the ticks that are due, for one batch at most.
    fn advance(&mut self) {
        let start = Instant::now();
        while self.phase == RunPhase::Running {
            let now = Instant::now();
            let is_due = self.clock.is_none_or(|clock| self.run.snapshot().time_s <= clock.simulated_s(now));
            if !is_due || now.duration_since(start) > BATCH_TIME {
                break;
            }
            self.tick();
            if self.clock.is_some() || now.duration_since(self.published_at) >= PUBLISH_INTERVAL {
                self.publish(now);
            }
        }
        if let Some(clock) = &mut self.clock {
            clock.resync(Instant::now(), self.run.snapshot().time_s);
        }
    }

    /// One recorded tick with the commands of persons.
    fn tick(&mut self) {
        let commands: Vec<SimCommand> = std::mem::take(&mut self.commands).into_values().collect();
        if let Err(error) = self.recording.step(&mut self.run, &commands) {
            self.hold(RunPhase::Failed(error.to_string()));
            self.publish(Instant::now());
            return;
        }
        if self.run.snapshot().tick == self.run.experiment().ticks() {
            self.hold(RunPhase::Over);
            self.publish(Instant::now());
        }
    }

    fn publish(&mut self, now: Instant) {
        let snapshot = self.run.snapshot();
        self.rate.record(now, snapshot.time_s);
        let before = if snapshot.tick == self.latest.tick {
            Arc::clone(&self.latest_state.get().before)
        } else {
            let next = Arc::new(snapshot.clone());
            std::mem::replace(&mut self.latest, next)
        };
        // After a reset there is nothing to interpolate between.
        let before = if before.tick < self.latest.tick { before } else { Arc::clone(&self.latest) };
        let is_running = self.phase == RunPhase::Running;
        self.latest_state.put(RunState {
            before,
            now: Arc::clone(&self.latest),
            phase: self.phase.clone(),
            speed: self.speed,
            clock: self.clock,
            real_time_factor: if is_running { self.rate.factor() } else { 0.0 },
            run: self.recording.run(),
            folder: self.recording.folder().map(Into::into),
        });
        self.published_at = now;
        if let Some(tell) = &self.on_update {
            tell();
        }
    }
}
