//! The simulation's thread.

use super::pace::Rate;
use super::{Clock, LiveError, Moment, Order, Phase, Recording, Slot, Speed};
use crate::runner::Run;
use crate::snapshot::{FrameSnapshot, SimCommand, VehicleId};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// So long it simulates before it looks at its orders again.
const ROUND: Duration = Duration::from_millis(4);
/// Without a clock, moments follow one another no faster than this.
const NEWS_EVERY: Duration = Duration::from_millis(8);
/// A run that stands looks up this often although every order wakes it.
const IDLE: Duration = Duration::from_secs(3600);

type OnNews = Option<Box<dyn Fn() + Send>>;

pub(super) struct Engine {
    run: Run,
    recording: Recording,
    slot: Arc<Slot>,
    on_news: OnNews,
    phase: Phase,
    speed: Speed,
    clock: Option<Clock>,
    rate: Rate,
    /// Of persons, for the next tick.
    commands: BTreeMap<VehicleId, SimCommand>,
    latest: Arc<FrameSnapshot>,
    news_at: Instant,
}

impl Engine {
    pub(super) fn new(run: Run, recording: Recording, (slot, on_news): (Arc<Slot>, OnNews)) -> Self {
        let now = Instant::now();
        Self {
            latest: Arc::new(run.snapshot().clone()),
            rate: Rate::new(now, run.snapshot().time_s),
            run,
            recording,
            slot,
            on_news,
            phase: Phase::Ready,
            speed: Speed::default(),
            clock: None,
            commands: BTreeMap::new(),
            news_at: now,
        }
    }

    /// Runs until it is told to stop, or nobody is left to tell it anything.
    pub(super) fn live(mut self, inbox: &Receiver<Order>) -> Result<Vec<PathBuf>, LiveError> {
        loop {
            let mut wait = self.wait();
            loop {
                match inbox.recv_timeout(wait) {
                    Ok(Order::Stop) | Err(RecvTimeoutError::Disconnected) => {
                        self.recording.finish(&self.run)?;
                        return Ok(self.recording.folders().to_vec());
                    }
                    Ok(order) => self.obey(order),
                    Err(RecvTimeoutError::Timeout) => break,
                }
                wait = Duration::ZERO;
            }
            if self.phase == Phase::Running {
                self.advance();
            }
        }
    }

    /// How long it may wait for orders before the next tick is due.
    fn wait(&self) -> Duration {
        match (&self.phase, self.clock) {
            (Phase::Running, None) => Duration::ZERO,
            (Phase::Running, Some(clock)) => clock.until(Instant::now(), self.run.snapshot().time_s),
            _ => IDLE,
        }
    }

    fn obey(&mut self, order: Order) {
        match order {
            Order::Start => {
                if !matches!(self.phase, Phase::Failed(_)) {
                    self.phase = Phase::Running;
                    self.set_clock();
                }
            }
            Order::Pause => {
                if self.phase == Phase::Running {
                    self.stand(Phase::Paused);
                }
            }
            Order::Step => {
                if !matches!(self.phase, Phase::Failed(_)) {
                    self.stand(Phase::Paused);
                    self.tick();
                }
            }
            Order::Reset => self.reset(),
            Order::Speed(speed) => {
                self.speed = speed;
                self.set_clock();
            }
            Order::Command(command) => {
                if let Some(vehicle) = command.vehicle() {
                    self.commands.insert(vehicle, command);
                }
                return;
            }
            Order::Stop => return,
        }
        self.publish(Instant::now());
    }

    fn set_clock(&mut self) {
        let (now, time_s) = (Instant::now(), self.run.snapshot().time_s);
        self.rate = Rate::new(now, time_s);
        self.clock = match self.speed {
            Speed::Times(factor) if self.phase == Phase::Running => Some(Clock::new(now, time_s, factor)),
            _ => None,
        };
    }

    fn stand(&mut self, phase: Phase) {
        self.phase = phase;
        self.set_clock();
    }

    fn reset(&mut self) {
        self.commands.clear();
        let outcome = self.recording.finish(&self.run).and_then(|()| Ok(self.run.reset()?));
        self.recording.next(self.recording.run() + 1);
        self.latest = Arc::new(self.run.snapshot().clone());
        self.stand(outcome.map_or_else(|error| Phase::Failed(error.to_string()), |()| Phase::Ready));
    }

    /// Simulates what is due, for a round at most.
    fn advance(&mut self) {
        let start = Instant::now();
        while self.phase == Phase::Running {
            let now = Instant::now();
            let is_due = self.clock.is_none_or(|clock| self.run.snapshot().time_s <= clock.simulated_s(now));
            if !is_due || now.duration_since(start) > ROUND {
                break;
            }
            self.tick();
            if self.clock.is_some() || now.duration_since(self.news_at) >= NEWS_EVERY {
                self.publish(now);
            }
        }
        if let Some(clock) = &mut self.clock {
            clock.let_go(Instant::now(), self.run.snapshot().time_s);
        }
    }

    /// One tick: recorded, with the commands of persons.
    fn tick(&mut self) {
        let commands: Vec<SimCommand> = std::mem::take(&mut self.commands).into_values().collect();
        if let Err(error) = self.recording.step(&mut self.run, &commands) {
            self.stand(Phase::Failed(error.to_string()));
            self.publish(Instant::now());
            return;
        }
        if self.run.snapshot().tick == self.run.experiment().ticks() {
            self.stand(Phase::Over);
            self.publish(Instant::now());
        }
    }

    fn publish(&mut self, now: Instant) {
        let snapshot = self.run.snapshot();
        self.rate.note(now, snapshot.time_s);
        let before = if snapshot.tick == self.latest.tick {
            Arc::clone(&self.slot.get().before)
        } else {
            let next = Arc::new(snapshot.clone());
            std::mem::replace(&mut self.latest, next)
        };
        // A reset goes back in time: nothing lies between.
        let before = if before.tick < self.latest.tick { before } else { Arc::clone(&self.latest) };
        let is_running = self.phase == Phase::Running;
        self.slot.put(Moment {
            before,
            now: Arc::clone(&self.latest),
            phase: self.phase.clone(),
            speed: self.speed,
            clock: self.clock,
            real_time_factor: if is_running { self.rate.factor() } else { 0.0 },
            run: self.recording.run(),
            folder: self.recording.folder().map(Into::into),
        });
        self.news_at = now;
        if let Some(tell) = &self.on_news {
            tell();
        }
    }
}
