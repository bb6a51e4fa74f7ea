//! A source that keeps what its city answers to orders: the window would show it.

use crate::lab::Desk;
use city3d_control::Mainframe;
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_protocol::wire::ExperimentPhase;
use city3d_session::{Inputs, LinkStatus, Now, Order, Orders, Pace, RunPhase, SessionError, Source, Step};
use city3d_simulation::runner::{HeldControl, LinkSummary};
use city3d_simulation::scenario::Experiment;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Any source, unchanged.
pub struct Answering<S> {
    pub source: S,
    pub desk: Arc<Mutex<Desk>>,
}

impl<S: Source> Source for Answering<S> {
    fn experiment(&self) -> &Arc<Experiment> {
        self.source.experiment()
    }

    fn snapshot(&self) -> &FrameSnapshot {
        self.source.snapshot()
    }

    fn origin(&self) -> LogOrigin {
        self.source.origin()
    }

    fn mainframe(&self) -> Option<&Mainframe> {
        self.source.mainframe()
    }

    fn heard(&self) -> Option<&HeldControl> {
        self.source.heard()
    }

    fn pace(&self) -> Pace {
        self.source.pace()
    }

    fn is_running(&self) -> bool {
        self.source.is_running()
    }

    fn is_ready(&self) -> bool {
        self.source.is_ready()
    }

    fn is_beginning(&self) -> bool {
        self.source.is_beginning()
    }

    fn opens_files(&self) -> bool {
        self.source.opens_files()
    }

    fn lingers(&self) -> bool {
        self.source.lingers()
    }

    fn phase(&self) -> RunPhase {
        self.source.phase()
    }

    fn experiment_phase(&self) -> ExperimentPhase {
        self.source.experiment_phase()
    }

    fn order(&mut self, order: &Order) -> Result<(), String> {
        let answer = self.source.order(order);
        self.desk.lock().unwrap().answers.push((order.clone(), answer.clone()));
        answer
    }

    fn wait(&mut self, orders: &mut Orders, most: Duration) {
        self.source.wait(orders, most);
    }

    fn receive(&mut self, now: &Now) -> Result<(), SessionError> {
        self.source.receive(now)
    }

    fn step(&mut self) -> Result<Step, SessionError> {
        self.source.step()
    }

    fn told(&mut self) {
        self.source.told();
    }

    fn wants_still(&mut self) -> bool {
        self.source.wants_still()
    }

    fn inputs(&self) -> Inputs<'_> {
        self.source.inputs()
    }

    fn setups(&self) -> Inputs<'_> {
        self.source.setups()
    }

    fn is_over(&self) -> bool {
        self.source.is_over()
    }

    fn link(&self) -> Option<LinkSummary> {
        self.source.link()
    }

    fn link_status(&self) -> Option<LinkStatus> {
        self.source.link_status()
    }
}
