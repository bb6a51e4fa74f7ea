//! Moments: what a session tells its ends, tick by tick.

use city3d_control::Mainframe;
use city3d_geometry::LengthScale;
use city3d_logbook::record::NetworkCommand;
use city3d_protocol::snapshot::{FrameSnapshot, SimCommand};
use city3d_protocol::wire::{EncodeError, ExperimentPhase};
use city3d_simulation::runner::{AppliedBody, HeldControl};
use city3d_simulation::scenario::Experiment;
use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What has changed since the moment before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MomentKind {
    /// A run begins at this snapshot; its clock is about to run.
    First,
    /// The simulated clock has advanced.
    Tick,
    /// Commands have been carried out while the clock stood, such as setups.
    Applied,
    /// Nothing; it is told again for those who have missed it.
    Still,
}

/// A city at one instant, with the commands that led there.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// What has changed.
    pub kind: MomentKind,
    /// The experiment that runs.
    pub experiment: &'a Arc<Experiment>,
    /// State of the city, full scale.
    pub snapshot: &'a FrameSnapshot,
    /// Phase of the experiment.
    pub phase: ExperimentPhase,
    /// The control framework, where it is in this process.
    pub mainframe: Option<&'a Mainframe>,
    /// What a control framework elsewhere has told of its decisions and plans.
    pub heard: Option<&'a HeldControl>,
    /// The commands of the step that led here.
    pub inputs: Inputs<'a>,
    /// Tick and simulated time at which that step began.
    pub from: (u64, f64),
    /// Wall-clock times of that step.
    pub timing: StepTiming,
    /// Time of the wall clock, seconds since 1970: a stamp for those who know no simulated time.
    pub unix_s: f64,
}

impl<'a> Moment<'a> {
    /// A tick outside of a session, such as one that a log makes again.
    pub fn tick(
        experiment: &'a Arc<Experiment>,
        snapshot: &'a FrameSnapshot,
        inputs: Inputs<'a>,
        mainframe: Option<&'a Mainframe>,
        from: (u64, f64),
    ) -> Self {
        let phase = ExperimentPhase::Running;
        let timing = StepTiming::at(Instant::now());
        Self {
            kind: MomentKind::Tick,
            experiment,
            snapshot,
            phase,
            mainframe,
            heard: None,
            inputs,
            from,
            timing,
            unix_s: 0.0,
        }
    }

    /// The first snapshot of a run, before its clock runs.
    pub fn first(experiment: &'a Arc<Experiment>, snapshot: &'a FrameSnapshot) -> Self {
        let from = (snapshot.tick, snapshot.time_s);
        Self { kind: MomentKind::First, ..Self::tick(experiment, snapshot, Inputs::None, None, from) }
    }

    /// City metres for one laboratory metre.
    pub fn scale(&self) -> LengthScale {
        self.experiment.scale
    }
}

/// Wall-clock times of a step.
#[derive(Clone, Copy, Debug)]
pub struct StepTiming {
    /// When the pacing clock wanted it.
    pub due: Instant,
    /// When its computation began.
    pub begun: Instant,
    /// When its computation ended.
    pub done: Instant,
}

impl StepTiming {
    /// Of a step that took no time.
    pub fn at(now: Instant) -> Self {
        Self { due: now, begun: now, done: now }
    }

    /// How long the step was computed.
    pub fn lasted(&self) -> Duration {
        self.done.saturating_duration_since(self.begun)
    }
}

/// The commands of a step, in the order in which they were carried out.
#[derive(Clone, Copy)]
pub enum Inputs<'a> {
    /// There are none.
    None,
    /// Of the control framework and of a person in this process.
    Commands(&'a [SimCommand]),
    /// Of senders over the link, with what tells their names.
    Network(&'a [AppliedBody], &'a dyn SenderLabels),
}

impl fmt::Debug for Inputs<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("None"),
            Self::Commands(commands) => f.debug_tuple("Commands").field(commands).finish(),
            Self::Network(applied, _) => f.debug_tuple("Network").field(applied).finish(),
        }
    }
}

/// Tells who the senders of commands are.
pub trait SenderLabels {
    /// A sender in words: its address, or `window`.
    fn label(&self, sender: city3d_simulation::runner::SenderNumber) -> String;
}

impl dyn SenderLabels + '_ {
    /// A command over the link, as a log keeps it.
    ///
    /// # Errors
    /// When its body cannot be encoded.
    pub(crate) fn logged(&self, tick: u64, applied: &AppliedBody) -> Result<NetworkCommand, EncodeError> {
        let (kind, body) = applied.body.to_log()?;
        Ok(NetworkCommand { tick, sender: self.label(applied.sender), kind, body })
    }
}
