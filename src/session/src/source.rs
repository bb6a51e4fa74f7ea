//! Sources: where the motion of a city comes from.

use super::{Inputs, LinkStatus, Order, Orders, RunPhase, SessionError};
use city3d_control::Mainframe;
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_protocol::wire::ExperimentPhase;
use city3d_simulation::runner::{HeldControl, LinkSummary};
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What decides when the next step is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// The session's clock.
    Clock,
    /// The source, as input arrives: a barrier in lockstep, or poses of a city elsewhere.
    Arrivals,
}

/// What a step has done.
#[derive(Clone, Debug)]
pub enum Step {
    /// The first snapshot of a run whose beginning is elsewhere.
    First,
    /// The simulated clock has advanced.
    Tick,
    /// Commands were carried out while it stood.
    Applied,
    /// The experiment was reset; its run had ended with this snapshot.
    Reset(Box<FrameSnapshot>),
}

/// The session's times, as a source needs them.
#[derive(Clone, Copy, Debug)]
pub struct Now {
    /// The session's clock.
    pub at: Instant,
    /// Simulated time that the pacing clock shows, or that of the snapshot while it stands.
    pub simulated_s: f64,
    /// Time until the next step is due, while the city is paced by the clock.
    pub until_due: Option<Duration>,
    /// The moment is about to be told again.
    pub is_still_due: bool,
}

/// Where the motion of a city comes from.
pub trait Source: Send {
    /// The experiment that runs.
    fn experiment(&self) -> &Arc<Experiment>;

    /// The present state.
    fn snapshot(&self) -> &FrameSnapshot;

    /// How logs of it are marked.
    fn origin(&self) -> LogOrigin;

    /// The control framework, where it is in this process.
    fn mainframe(&self) -> Option<&Mainframe> {
        None
    }

    /// What a control framework elsewhere has told of its decisions and plans.
    fn heard(&self) -> Option<&HeldControl> {
        None
    }

    /// What decides when the next step is made.
    fn pace(&self) -> Pace {
        Pace::Clock
    }

    /// Whether the next step advances the simulated clock.
    fn is_running(&self) -> bool;

    /// Whether there is a step to make that does not wait for the clock.
    fn is_ready(&self) -> bool;

    /// Whether the next step starts the clock from the initial conditions.
    fn is_beginning(&self) -> bool;

    /// Whether the next step is worth files.
    fn opens_files(&self) -> bool {
        true
    }

    /// Whether moments are told again while the clock stands, for those who have missed them.
    fn lingers(&self) -> bool {
        false
    }

    /// Phase in the window's words.
    fn phase(&self) -> RunPhase;

    /// Phase in the link's words.
    fn experiment_phase(&self) -> ExperimentPhase {
        match (self.phase(), self.snapshot().tick) {
            (RunPhase::Running, _) => ExperimentPhase::Running,
            (_, 0) => ExperimentPhase::Ready,
            _ => ExperimentPhase::Paused,
        }
    }

    /// Carries out an order, at once or with the next step.
    ///
    /// # Errors
    /// Why not, in words for who gave it.
    fn order(&mut self, order: &Order) -> Result<(), String>;

    /// Sleeps at most so long; an order, or input that cannot wait, ends the sleep.
    fn wait(&mut self, orders: &mut Orders, most: Duration);

    /// Takes the input that has come.
    ///
    /// # Errors
    /// When the source cannot go on.
    fn receive(&mut self, _now: &Now) -> Result<(), SessionError> {
        Ok(())
    }

    /// Makes a step.
    ///
    /// # Errors
    /// When the source cannot go on.
    fn step(&mut self) -> Result<Step, SessionError>;

    /// The moment was told.
    fn told(&mut self) {}

    /// Whether the moment shall be told again at once, for somebody who has just come.
    fn wants_still(&mut self) -> bool {
        false
    }

    /// The commands of the last step.
    fn inputs(&self) -> Inputs<'_>;

    /// What the city has been told before the present run, and keeps.
    fn setups(&self) -> Inputs<'_> {
        Inputs::None
    }

    /// Whether it has come to its own end.
    fn is_over(&self) -> bool {
        false
    }

    /// Statistics of its link.
    fn link(&self) -> Option<LinkSummary> {
        None
    }

    /// Its link in words, for people.
    fn link_status(&self) -> Option<LinkStatus> {
        None
    }
}
