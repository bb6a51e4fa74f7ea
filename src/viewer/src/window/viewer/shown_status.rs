//! Statuses as the window shows them. A status is part of the state of a run: it lasts for a while so that it does not
//! flicker, and changes with the next step. What the window shows fits what the control framework decides now, and who is in
//! the driver's seat.

use super::{ViewedRun, ViewerState};
use crate::ui::{CityKind, gives_way};
use city3d_protocol::snapshot::{DecisionReason, FrameSnapshot, Status, VehicleId, VehicleState};
use city3d_session::{ControlInsight, RunPhase, RunState};
use std::sync::Arc;

/// Slower vehicles stand, metres a second.
const MOVES_MPS: f64 = 0.1;

/// What the window knows besides the state of the run.
#[derive(Clone, Copy, Debug, Default)]
struct Known<'a> {
    insight: Option<&'a ControlInsight>,
    /// The vehicle that the user drives, from the next step on at the latest.
    driven: Option<VehicleId>,
    /// Vehicles that the user has released, before the step that hears of it.
    released: &'a [VehicleId],
}

impl Known<'_> {
    fn status(&self, vehicle: &VehicleState) -> Status {
        let moves = vehicle.speed_mps.abs() >= MOVES_MPS;
        let reason = || Some(self.insight?.decision(vehicle.id)?.reason);
        let driven = if moves { Status::Driving } else { Status::Stopped };
        match vehicle.status {
            Status::Manual if self.released.contains(&vehicle.id) => driven,
            Status::Driving | Status::Yielding | Status::Stopped | Status::Finished | Status::LinkLost
                if self.driven == Some(vehicle.id) =>
            {
                Status::Manual
            }
            // Its algorithm has no route and stops it.
            Status::Driving | Status::Yielding if reason() == Some(DecisionReason::OffRoute) => driven,
            // It has set off: the status lasts for a second at least.
            Status::Yielding if moves && reason().is_some_and(|reason| !gives_way(reason)) => Status::Driving,
            status => status,
        }
    }

    fn in_snapshot(&self, snapshot: &Arc<FrameSnapshot>) -> Arc<FrameSnapshot> {
        if snapshot.vehicles.iter().all(|vehicle| self.status(vehicle) == vehicle.status) {
            return Arc::clone(snapshot);
        }
        let mut shown = FrameSnapshot::clone(snapshot);
        shown.vehicles.iter_mut().for_each(|vehicle| vehicle.status = self.status(vehicle));
        Arc::new(shown)
    }
}

impl ViewerState {
    /// The state with the statuses that fit now; `is_present` where it is that of the present.
    pub(super) fn with_shown_statuses(
        &mut self,
        run_state: Arc<RunState>,
        is_present: bool,
    ) -> Arc<RunState> {
        if is_present {
            let is_manual = |id: &VehicleId| {
                run_state.now.vehicle(*id).is_some_and(|vehicle| vehicle.status == Status::Manual)
            };
            self.released.retain(is_manual);
        }
        // A city elsewhere decides who drives.
        let is_own = is_present
            && self.city == CityKind::Local
            && matches!(self.source, ViewedRun::Run(_) | ViewedRun::Ended(_));
        let known = Known {
            insight: run_state.insight.as_deref(),
            driven: self.state.driven().filter(|_| is_own),
            released: if is_own { &self.released } else { &[] },
        };
        let (before, now) = (known.in_snapshot(&run_state.before), known.in_snapshot(&run_state.now));
        if Arc::ptr_eq(&before, &run_state.before) && Arc::ptr_eq(&now, &run_state.now) {
            return run_state;
        }
        Arc::new(RunState { before, now, ..RunState::clone(&run_state) })
    }
}

/// The state as it is shown: at its start all vehicles wait, with the speeds that they will start with; in a log and in the
/// past of a run as before the run has begun.
pub(super) fn before_start(run_state: Arc<RunState>) -> Arc<RunState> {
    let is_at_start = run_state.phase == RunPhase::Ready || run_state.now.tick == 0;
    if !is_at_start || run_state.link.is_some() {
        return run_state;
    }
    let waiting = |snapshot: &FrameSnapshot| {
        let mut snapshot = snapshot.clone();
        let is_of_run =
            |vehicle: &&mut VehicleState| !matches!(vehicle.status, Status::Physical | Status::Unseen);
        for vehicle in snapshot.vehicles.iter_mut().filter(is_of_run) {
            vehicle.status = Status::Waiting;
        }
        Arc::new(snapshot)
    };
    let (before, now) = (waiting(&run_state.before), waiting(&run_state.now));
    Arc::new(RunState { before, now, ..RunState::clone(&run_state) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::ControlDecision;
    use city3d_session::decisions;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};

    #[test]
    fn who_has_set_off_no_longer_yields_and_who_gives_way_does() {
        let shown = |status, speed_mps, reason| {
            let vehicle = VehicleState { id: VehicleId(3), status, speed_mps, ..VehicleState::default() };
            let decision = ControlDecision { vehicle: VehicleId(3), reason, ..ControlDecision::default() };
            let insight = ControlInsight { decisions: Some(vec![decision]), ..ControlInsight::default() };
            Known { insight: Some(&insight), ..Known::default() }.status(&vehicle)
        };
        let yielding = Status::Yielding;
        assert_eq!(shown(yielding, 2.0, DecisionReason::Leader), Status::Driving);
        assert_eq!(shown(yielding, 2.0, DecisionReason::FreeRoad), Status::Driving);
        assert_eq!(shown(yielding, 2.0, DecisionReason::YieldLine), yielding, "it slows for the line");
        assert_eq!(shown(yielding, 0.0, DecisionReason::Leader), yielding, "it stands yet");
        assert_eq!(shown(Status::Driving, 2.0, DecisionReason::OffRoute), Status::Driving, "it still moves");
        assert_eq!(shown(Status::Driving, 0.0, DecisionReason::OffRoute), Status::Stopped, "it has no route");
        assert_eq!(shown(Status::Collided, 2.0, DecisionReason::FreeRoad), Status::Collided);
        let vehicle = VehicleState { status: yielding, speed_mps: 2.0, ..VehicleState::default() };
        assert_eq!(Known::default().status(&vehicle), yielding, "nobody tells why");
    }

    #[test]
    fn who_is_released_is_stopped_once_it_stands() {
        let released = [VehicleId(3)];
        let known = Known { released: &released, ..Known::default() };
        let at = |speed_mps| VehicleState {
            id: VehicleId(3),
            status: Status::Manual,
            speed_mps,
            ..VehicleState::default()
        };
        assert_eq!(known.status(&at(5.0)), Status::Driving);
        assert_eq!(known.status(&at(0.0)), Status::Stopped);
    }

    #[test]
    fn in_a_run_status_and_reason_agree_of_all_who_move() {
        let (text, library) = Library::scenario("roundabout").unwrap();
        let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
        let mut run = Run::new(Arc::new(experiment)).unwrap();
        let mut mended = 0;
        while run.snapshot().time_s < 30.0 {
            run.step();
            let told = decisions(run.mainframe(), run.experiment());
            let insight = ControlInsight { decisions: Some(told), ..ControlInsight::default() };
            let known = Known { insight: Some(&insight), ..Known::default() };
            for vehicle in run.snapshot().vehicles.iter().filter(|vehicle| vehicle.speed_mps > 0.5) {
                let Some(decision) = insight.decision(vehicle.id) else { continue };
                let shown = known.status(vehicle);
                assert!(shown != Status::Yielding || gives_way(decision.reason), "{vehicle:?}");
                mended += usize::from(shown != vehicle.status);
            }
        }
        assert!(mended > 50, "the status of the run lasts longer: {mended}");
    }
}
