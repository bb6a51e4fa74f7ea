//! A city elsewhere as the source of a session.

use super::connection::ORDER_INTERVAL;
use super::{RemoteCity, Role, Stage};
use crate::guests::NO_GUESTS;
use crate::source::{Now, Pace, Source, Step};
use crate::{Inputs, LinkStatus, Order, Orders, RunPhase, SessionError};
use city3d_control::Mainframe;
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_protocol::wire::{ExperimentAction, ExperimentPhase};
use city3d_simulation::runner::{HeldControl, ObservedCity};
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;
use std::time::Duration;

impl Source for RemoteCity {
    fn experiment(&self) -> &Arc<Experiment> {
        &self.experiment
    }

    fn snapshot(&self) -> &FrameSnapshot {
        self.city.snapshot()
    }

    fn origin(&self) -> LogOrigin {
        LogOrigin::Mainframe
    }

    fn mainframe(&self) -> Option<&Mainframe> {
        if let Role::Control(control) = &self.role { Some(control.mainframe()) } else { None }
    }

    fn heard(&self) -> Option<&HeldControl> {
        Some(&self.heard)
    }

    fn pace(&self) -> Pace {
        Pace::Arrivals
    }

    fn is_running(&self) -> bool {
        self.experiment_phase() == ExperimentPhase::Running
    }

    fn is_ready(&self) -> bool {
        self.pending.is_some()
    }

    fn is_beginning(&self) -> bool {
        false
    }

    fn opens_files(&self) -> bool {
        !self.ends_run
    }

    fn phase(&self) -> RunPhase {
        match (&self.told, self.experiment_phase()) {
            (None, _) | (_, ExperimentPhase::Ready) => RunPhase::Ready,
            (_, ExperimentPhase::Running) => RunPhase::Running,
            (_, ExperimentPhase::Paused) => RunPhase::Paused,
        }
    }

    fn experiment_phase(&self) -> ExperimentPhase {
        self.told.as_ref().map_or(ExperimentPhase::Ready, |(head, _)| head.phase)
    }

    fn order(&mut self, order: &Order) -> Result<(), String> {
        match (order, &mut self.role) {
            (Order::Start, _) => self.request(ExperimentAction::Start),
            (Order::Pause, _) => self.request(ExperimentAction::Pause),
            (Order::Reset, _) => self.request(ExperimentAction::Reset),
            (Order::Step | Order::Speed(_), _) => Err("the city elsewhere keeps its own time".to_owned()),
            (Order::Drive(vehicle, pedals), Role::Visit(car)) if car.vehicle() == Some(*vehicle) => {
                car.drive(&mut self.connection, Some(*pedals));
                Ok(())
            }
            (Order::Release(vehicle), Role::Visit(car)) if car.vehicle() == Some(*vehicle) => {
                car.drive(&mut self.connection, None);
                Ok(())
            }
            (Order::Release(_) | Order::RunUntil(_) | Order::TellPlans(_) | Order::TellDecisions(_), _) => {
                Ok(())
            }
            (Order::Drive(vehicle, _), Role::Visit(_)) => {
                Err(format!("vehicle {vehicle} is not yours: you drive the car that you have brought"))
            }
            (Order::Guest(..), _) => Err(NO_GUESTS.to_owned()),
            (Order::Drive(..), _) => {
                Err("here you watch; city3d view --city ADDR --guest brings a car of your own".to_owned())
            }
        }
    }

    fn wait(&mut self, _orders: &mut Orders, most: Duration) {
        if self.event.is_some() || self.pending.is_some() || matches!(self.stage, Stage::Handshake { .. }) {
            return;
        }
        self.event = match &mut self.role {
            Role::Control(control) => control.receive(&mut self.connection, most),
            Role::Watch | Role::Visit(_) => self.connection.client.receive(most.min(ORDER_INTERVAL)),
        };
    }

    fn receive(&mut self, now: &Now) -> Result<(), SessionError> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        self.update_rate(now.at);
        if let Stage::Handshake { .. } = self.stage {
            return self.shake_hands();
        }
        self.keep_up();
        match self.event.take() {
            Some(event) => self.take(event),
            None => self.notice_silence(),
        }
        Ok(())
    }

    fn step(&mut self) -> Result<Step, SessionError> {
        if std::mem::take(&mut self.ends_run) {
            return Ok(Step::Reset(Box::new(self.city.snapshot().clone())));
        }
        let Some((head, vehicles)) = self.pending.take() else { return Ok(Step::Applied) };
        let is_first = !std::mem::replace(&mut self.has_begun, true);
        if is_first {
            self.city = ObservedCity::new(Arc::clone(&self.experiment));
            self.city.describe(self.infos.values().cloned());
        }
        let is_same = !is_first && self.city.snapshot().tick == head.tick;
        let snapshot = self.city.add_poses(&head, &vehicles);
        match &mut self.role {
            Role::Control(control) => control.remember(&snapshot.vehicles),
            Role::Visit(car) => car.remember(snapshot),
            Role::Watch => {}
        }
        (self.told, self.has_seen) = (Some((head, vehicles)), true);
        Ok(match (is_first, is_same) {
            (true, _) => Step::First,
            (false, true) => Step::Applied,
            (false, false) => Step::Tick,
        })
    }

    fn told(&mut self) {
        let Role::Control(control) = &mut self.role else { return };
        let Stage::Connected(link) = &self.stage else { return };
        let Some((head, vehicles)) = &self.told else { return };
        if self.pending.is_some() || !self.has_begun {
            return;
        }
        if let Err(error) = control.answer(&mut self.connection, (head, vehicles), link.clock.is_lockstep) {
            self.failure = Some(error);
        }
    }

    fn inputs(&self) -> Inputs<'_> {
        Inputs::None
    }

    fn is_over(&self) -> bool {
        matches!(&self.role, Role::Control(control) if control.is_over)
    }

    fn link_status(&self) -> Option<LinkStatus> {
        Some(LinkStatus {
            address: self.options.city.clone(),
            is_remote: true,
            trouble: self.trouble(),
            leader: self.leader.clone(),
            received_per_s: self.rate.2,
            scenario: self.scenario.clone(),
            own_vehicle: self.own_vehicle(),
            ..LinkStatus::default()
        })
    }
}
