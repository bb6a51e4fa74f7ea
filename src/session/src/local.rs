//! A city with its control framework in this process.

use super::guests::NO_GUESTS;
use super::source::{Source, Step};
use super::{Inputs, Order, Orders, RunPhase, SessionError};
use city3d_control::Mainframe;
use city3d_logbook::record::LogOrigin;
use city3d_network::host::Host;
use city3d_protocol::snapshot::{FrameSnapshot, SimCommand, VehicleId};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// A run of the world in lockstep with its control framework.
pub struct LocalCity {
    run: Run,
    experiment: Arc<Experiment>,
    host: Host,
    phase: RunPhase,
    /// Commands of persons for the next tick.
    commands: BTreeMap<VehicleId, SimCommand>,
    pending: Pending,
    /// The last step has made a tick, whose commands are those of the run.
    has_ticked: bool,
}

/// What waits for the next step besides the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Pending {
    #[default]
    Nothing,
    SingleStep,
    Reset,
}

impl LocalCity {
    /// A city at its initial conditions, which waits for its start.
    ///
    /// # Errors
    /// When the control framework cannot take a vehicle.
    pub fn new(experiment: Arc<Experiment>, host: Host) -> Result<Self, SessionError> {
        Ok(Self::on(Run::new(Arc::clone(&experiment))?, experiment, host))
    }

    /// A city on a run that may have come somewhere already, and goes on by another experiment, such as a longer one.
    pub fn on(run: Run, experiment: Arc<Experiment>, host: Host) -> Self {
        let commands = BTreeMap::new();
        let (phase, pending) = (RunPhase::Ready, Pending::Nothing);
        Self { run, experiment, host, phase, commands, pending, has_ticked: false }
    }

    /// The city with its clock started.
    #[must_use]
    pub fn started(mut self) -> Self {
        self.phase = RunPhase::Running;
        self
    }

    fn tick(&mut self) -> Step {
        for command in std::mem::take(&mut self.commands).into_values() {
            self.run.inject(command);
        }
        self.run.step();
        self.has_ticked = true;
        if self.run.snapshot().tick == self.experiment.ticks() {
            self.phase = RunPhase::Over;
        }
        Step::Tick
    }

    fn reset(&mut self) -> Step {
        let last = Box::new(self.run.snapshot().clone());
        self.commands.clear();
        self.has_ticked = false;
        self.phase = match self.run.reset() {
            Ok(()) => RunPhase::Ready,
            Err(error) => RunPhase::Failed(error.to_string()),
        };
        Step::Reset(last)
    }
}

impl Source for LocalCity {
    fn experiment(&self) -> &Arc<Experiment> {
        &self.experiment
    }

    fn snapshot(&self) -> &FrameSnapshot {
        self.run.snapshot()
    }

    fn origin(&self) -> LogOrigin {
        LogOrigin::Run
    }

    fn mainframe(&self) -> Option<&Mainframe> {
        Some(self.run.mainframe())
    }

    fn is_running(&self) -> bool {
        self.phase == RunPhase::Running
    }

    fn is_ready(&self) -> bool {
        self.pending != Pending::Nothing
    }

    fn is_beginning(&self) -> bool {
        self.pending != Pending::Reset && self.run.snapshot().tick == 0
    }

    fn opens_files(&self) -> bool {
        self.pending != Pending::Reset
    }

    fn phase(&self) -> RunPhase {
        self.phase.clone()
    }

    fn order(&mut self, order: &Order) -> Result<(), String> {
        let has_failed = matches!(self.phase, RunPhase::Failed(_));
        match order {
            Order::Start if !has_failed => self.phase = RunPhase::Running,
            Order::Pause if self.phase == RunPhase::Running => self.phase = RunPhase::Paused,
            Order::Step if !has_failed => {
                self.phase = RunPhase::Paused;
                self.pending = Pending::SingleStep;
            }
            Order::Reset => self.pending = Pending::Reset,
            Order::Start | Order::Step => return Err("the run has failed: reset it first".to_owned()),
            Order::Drive(vehicle, _) if self.experiment.is_physical(*vehicle) => {
                return Err(format!("vehicle {vehicle} is in the laboratory: nobody drives it from here"));
            }
            Order::Guest(..) => return Err(NO_GUESTS.to_owned()),
            Order::Drive(..) | Order::Release(_) => {
                self.commands.extend(order.vehicle().zip(order.vehicle_command()));
            }
            // The session stops the clock at a goal.
            Order::Pause
            | Order::Speed(_)
            | Order::RunUntil(_)
            | Order::TellPlans(_)
            | Order::TellDecisions(_) => {}
        }
        Ok(())
    }

    fn wait(&mut self, orders: &mut Orders, most: Duration) {
        orders.wait(&self.host, most);
    }

    fn step(&mut self) -> Result<Step, SessionError> {
        Ok(match std::mem::take(&mut self.pending) {
            Pending::Reset => self.reset(),
            Pending::Nothing | Pending::SingleStep => self.tick(),
        })
    }

    fn inputs(&self) -> Inputs<'_> {
        if self.has_ticked { Inputs::Commands(self.run.commands()) } else { Inputs::None }
    }
}
