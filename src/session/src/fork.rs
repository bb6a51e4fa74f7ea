//! Forks of recorded runs: a log is replayed up to a tick, with the control framework beside it, and the run goes on from
//! there with another scenario.

use super::{Inputs, Moment, RunFiles, SessionError};
use city3d_control::SetupError;
use city3d_logbook::replay::{Replay, ReplayError};
use city3d_protocol::snapshot::{FrameSnapshot, SimCommand};
use city3d_protocol::wire::Measurement;
use city3d_simulation::runner::{ControlLoop, Run};
use city3d_simulation::scenario::{Experiment, PlannedArrival, PlannedVehicle};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

/// Why a run cannot be forked.
#[derive(Debug, Error)]
pub enum ForkError {
    /// The control framework rejects a vehicle.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The log cannot be replayed.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// The files of the fork cannot be written.
    #[error(transparent)]
    Files(#[from] SessionError),
    /// The log ends before the tick.
    #[error("the log ends at tick {tick}")]
    LogEnd {
        /// The last tick of the log.
        tick: u64,
    },
    /// The flag that stops the command was set.
    #[error("stopped at tick {tick}, before the run was continued", tick = last.tick)]
    Stopped {
        /// The last instant of the log that was simulated again and recorded.
        last: Box<FrameSnapshot>,
    },
    /// The replay has come to another state than the log.
    #[error("tick {tick} differs from the log when it is simulated again, so the run cannot be continued")]
    Diverged {
        /// The first tick that differs.
        tick: u64,
    },
}

/// A recorded run at the tick of its fork.
#[derive(Debug)]
pub struct Fork {
    replay: Replay,
    control: ControlLoop,
    is_same: bool,
}

impl Fork {
    /// Replays the log up to a tick, with the control framework beside it, which so reaches its state of then. The ticks
    /// are recorded in `files`.
    ///
    /// # Errors
    /// When the log ends before or cannot be replayed, when `stop` is set, or a file cannot be written.
    pub fn at(
        mut replay: Replay,
        fork_tick: u64,
        files: &mut RunFiles,
        stop: &AtomicBool,
    ) -> Result<Self, ForkError> {
        let original = &Arc::clone(replay.experiment());
        let mut control = ControlLoop::new(original)?;
        let (mut delivered, mut is_same) = (Vec::new(), true);
        loop {
            let (tick, time_s) = (replay.snapshot().tick, replay.snapshot().time_s);
            if stop.load(Ordering::Relaxed) {
                return Err(ForkError::Stopped { last: Box::new(replay.snapshot().clone()) });
            }
            let seen: Vec<Measurement> = Measurement::all(replay.snapshot(), original.scale).collect();
            let Some(ticked) = replay.step()? else { return Err(ForkError::LogEnd { tick }) };
            if !ticked.agrees() {
                return Err(ForkError::Diverged { tick: ticked.tick });
            }
            if ticked.tick == 0 {
                files.record_or_fail(&Moment::first(original, replay.snapshot()))?;
            } else {
                delivered.clear();
                control.step((tick, time_s), seen.into_iter(), &mut delivered);
                let mut commands: Vec<SimCommand> =
                    delivered.drain(..).map(|message| message.into_command(original.scale)).collect();
                commands.sort_by_key(SimCommand::order);
                let is_control =
                    |command: &&SimCommand| matches!(command, SimCommand::Follow(_) | SimCommand::Signals(_));
                is_same &= commands.iter().filter(is_control).eq(replay.applied().iter().filter(is_control));
                let inputs = Inputs::Commands(replay.applied());
                let (snapshot, mainframe) = (replay.snapshot(), Some(control.mainframe()));
                let moment = Moment::tick(original, snapshot, inputs, mainframe, (tick, time_s));
                files.record_or_fail(&moment)?;
            }
            if ticked.tick == fork_tick {
                break;
            }
        }
        Ok(Self { replay, control, is_same })
    }

    /// Whether the control framework, simulated again, has sent the trajectories of the log.
    pub fn control_agrees(&self) -> bool {
        self.is_same
    }

    /// The run that goes on from here with another experiment, which has no [`differences`] in its past.
    ///
    /// # Errors
    /// When the control framework rejects a vehicle.
    pub fn resume(mut self, changed: &Experiment) -> Result<Run, ForkError> {
        self.control.change(changed)?;
        Ok(Run::resume(self.replay.into_world(), self.control))
    }
}

/// Differences from the original that its past until a tick depends on, in words.
pub fn differences(original: &Experiment, changed: &Experiment, fork_tick: u64) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut check = |same: bool, what: &str| {
        if !same {
            wrong.push(what.to_owned());
        }
    };
    check(original.map_bytes == changed.map_bytes, "its map differs");
    check(original.scale == changed.scale, "its length_scale differs");
    let controls = |experiment: &Experiment| {
        let map = &experiment.lab_map;
        (experiment.signals.clone(), map.signals.clone(), map.lines.clone())
    };
    check(controls(original) == controls(changed), "its [[signal]] tables or all-way stops differ");
    check(original.rates == changed.rates, "its [rates] differ");
    check(original.link_timeout_s == changed.link_timeout_s, "its link_timeout_s differs");
    let ids =
        |experiment: &Experiment| experiment.vehicles.iter().map(|vehicle| vehicle.id).collect::<Vec<_>>();
    if ids(original) != ids(changed) {
        wrong.push("it has other vehicles".to_owned());
        return wrong;
    }
    for (a, b) in original.vehicles.iter().zip(&changed.vehicles) {
        let parts = [
            (a.name == b.name, "name"),
            (a.start == b.start, "start (route, at_m, speed_mps)"),
            (a.route == b.route, "route"),
            (a.spec == b.spec, "vehicle type"),
            (a.is_human == b.is_human, "person at the wheel"),
        ];
        let other: Vec<&str> = parts.into_iter().filter(|(same, _)| !same).map(|(_, what)| what).collect();
        if !other.is_empty() {
            wrong.push(format!("vehicle {} ({}) has another {}", a.id, a.name, other.join(", ")));
        }
    }
    let until_s = original.rates.time_s(fork_tick);
    let past = |experiment: &Experiment| -> Vec<PlannedArrival> {
        experiment.arrivals.iter().take_while(|arrival| arrival.time_s <= until_s).cloned().collect()
    };
    if original.inflows.len() != changed.inflows.len() || !same_arrivals(&past(original), &past(changed)) {
        let remedy = "give them a seed of their own if the seed is to change";
        wrong.push(format!("its inflows bring other vehicles before tick {fork_tick} ({remedy})"));
    }
    wrong
}

/// Whether the same vehicles arrive at the same times. Their drivers may be others.
fn same_arrivals(one: &[PlannedArrival], other: &[PlannedArrival]) -> bool {
    let is_same = |(a, b): (&PlannedArrival, &PlannedArrival)| {
        let (x, y) = (&a.vehicle, &b.vehicle);
        let start = |planned: &PlannedVehicle| (planned.start.lane, planned.start.at_m);
        (a.time_s, a.inflow, x.id, &x.name) == (b.time_s, b.inflow, y.id, &y.name)
            && x.route == y.route
            && x.spec == y.spec
            && start(x) == start(y)
    };
    one.len() == other.len() && one.iter().zip(other).all(is_same)
}
