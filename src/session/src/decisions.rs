//! Decisions of the control framework at one instant, and the delays of its commands, as a window shows them. Decisions are
//! read from the control framework of this process, or from what one elsewhere tells; delays from the commands of each step,
//! wherever they come from.

use super::{Inputs, Moment, Source};
use city3d_control::{Cav, Mainframe};
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::{ControlDecision, SimCommand, VehicleId};
use city3d_protocol::wire::Body;
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;

/// What is known of control besides the snapshot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ControlInsight {
    /// Decisions of the last control step, or those that a control framework elsewhere or a log has told last, in id order;
    /// `None` where nobody tells any.
    pub decisions: Option<Vec<ControlDecision>>,
    /// From the control step of the last trajectory that a vehicle was given until it arrived, simulated seconds.
    pub command_delays_s: BTreeMap<VehicleId, f64>,
}

impl ControlInsight {
    /// The decision for a vehicle.
    pub fn decision(&self, id: VehicleId) -> Option<&ControlDecision> {
        let decisions = self.decisions.as_ref()?;
        decisions.binary_search_by_key(&id, |decision| decision.vehicle).ok().map(|index| &decisions[index])
    }
}

/// Collects what it tells, while somebody asks for it.
#[derive(Debug, Default)]
pub(crate) struct DecisionTeller {
    is_asked: bool,
    command_delays_s: BTreeMap<VehicleId, f64>,
}

impl DecisionTeller {
    /// Somebody asks from now on, or nobody does.
    pub fn ask(&mut self, is_asked: bool) {
        *self = Self { is_asked, ..Self::default() };
    }

    /// Takes the commands of a step.
    pub fn take(&mut self, moment: &Moment<'_>) {
        if !self.is_asked {
            return;
        }
        let (_, now_s) = moment.from;
        match moment.inputs {
            Inputs::None => {}
            Inputs::Commands(commands) => {
                for command in commands {
                    if let SimCommand::Follow(trajectory) = command {
                        let begins_s = trajectory.points.first().map(|point| point.time_s);
                        self.note(trajectory.vehicle, begins_s, now_s);
                    }
                }
            }
            Inputs::Network(applied, _) => {
                for applied in applied {
                    let Body::Trajectories(list) = &applied.body else { continue };
                    for trajectory in list {
                        let begins_s = trajectory.points.first().map(|point| point.time_s);
                        self.note(trajectory.vehicle, begins_s, now_s);
                    }
                }
            }
        }
    }

    fn note(&mut self, vehicle: VehicleId, begins_s: Option<f64>, now_s: f64) {
        if let Some(begins_s) = begins_s {
            self.command_delays_s.insert(vehicle, (now_s - begins_s).max(0.0));
        }
    }

    /// What is known of a source now; `None` while nobody asks.
    pub fn insight(&self, source: &impl Source) -> Option<ControlInsight> {
        let told = || source.heard()?.decisions.at(source.snapshot().time_s);
        self.is_asked.then(|| ControlInsight {
            decisions: match source.mainframe() {
                Some(mainframe) => Some(decisions(mainframe, source.experiment())),
                None => told(),
            },
            command_delays_s: self.command_delays_s.clone(),
        })
    }
}

/// The decisions of a control framework for all vehicles that it has seen, in id order.
pub fn decisions(mainframe: &Mainframe, experiment: &Experiment) -> Vec<ControlDecision> {
    mainframe.cavs().iter().filter_map(|cav| decision(mainframe, cav, experiment)).collect()
}

fn decision(mainframe: &Mainframe, cav: &Cav, experiment: &Experiment) -> Option<ControlDecision> {
    let limit = mainframe.limit_of(cav.id)?;
    let scale: LengthScale = experiment.scale;
    let place_at = |gap_m: f64| {
        let at_s = (cav.front_s() + gap_m).clamp(0.0, cav.route.length());
        cav.route.at(&experiment.lab_map, at_s).pose.to_city(scale).position
    };
    Some(ControlDecision {
        vehicle: cav.id,
        reason: limit.reason,
        other: limit.other,
        place: limit.gap_m.map(place_at),
        target_mps: scale.city_from_lab(cav.target_mps()),
        acceleration_mps2: scale.city_from_lab(cav.plan.acceleration_mps2),
        longitudinal_error_m: scale.city_from_lab(cav.plan.axle_s - cav.axle_s()),
        measured: Some(cav.pose.to_city(scale)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Host, LocalCity};
    use city3d_protocol::snapshot::{DecisionReason, Status};
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use std::collections::BTreeSet;
    use std::sync::Arc;

    fn run(name: &str) -> Run {
        let (text, library) = Library::scenario(name).unwrap();
        let experiment = read_experiment("test", &text, &library, Overrides::default()).unwrap();
        Run::new(Arc::new(experiment)).unwrap()
    }

    #[test]
    fn who_yields_is_told_to_whom_and_who_follows_whom() {
        let mut run = run("roundabout");
        let (mut reasons, mut yields, mut follows) = (BTreeSet::new(), 0, 0);
        for tick in 1..=3000_u64 {
            run.step();
            if tick % 20 != 0 {
                continue;
            }
            for told in decisions(run.mainframe(), run.experiment()) {
                reasons.insert(told.reason as u8);
                let vehicle = run.snapshot().vehicle(told.vehicle).unwrap();
                let other = told.other.and_then(|other| run.snapshot().vehicle(other));
                assert!(told.target_mps > 0.0 && told.target_mps < 15.0, "{told:?}");
                match (told.reason, other) {
                    (DecisionReason::Leader, Some(leader)) => {
                        // Its rear is where the place is, within the errors of the estimate.
                        let rear_m = leader.position.truncate().distance(told.place.unwrap());
                        assert!((0.5..5.0).contains(&rear_m), "{rear_m} m: {told:?}");
                        follows += 1;
                    }
                    (DecisionReason::YieldLine, Some(other)) if vehicle.status == Status::Yielding => {
                        let to_other_m = other.position.distance(vehicle.position);
                        assert!(to_other_m < 60.0, "{to_other_m} m: {told:?}");
                        yields += 1;
                    }
                    _ => {}
                }
            }
        }
        assert!(yields > 10 && follows > 50, "{yields} yield, {follows} follow: {reasons:?}");
        assert!(reasons.len() >= 4, "{reasons:?}");
    }

    #[test]
    fn delays_are_told_while_somebody_asks() {
        let mut run = run("straight");
        let experiment = Arc::clone(run.experiment());
        let mut teller = DecisionTeller::default();
        let mut step = |teller: &mut DecisionTeller| {
            let from = (run.snapshot().tick, run.snapshot().time_s);
            run.step();
            let inputs = Inputs::Commands(run.commands());
            teller.take(&Moment::tick(&experiment, run.snapshot(), inputs, Some(run.mainframe()), from));
        };
        let city = LocalCity::new(Arc::clone(&experiment), Host::system()).unwrap();
        (0..100).for_each(|_| step(&mut teller));
        assert_eq!(teller.insight(&city), None);
        teller.ask(true);
        (0..100).for_each(|_| step(&mut teller));
        let told = teller.insight(&city).unwrap();
        assert_eq!(told.decisions, Some(Vec::new()), "nobody has been measured there yet");
        let delays: Vec<f64> = told.command_delays_s.values().copied().collect();
        assert!(!delays.is_empty() && delays.iter().all(|s| (0.0..0.5).contains(s)), "{delays:?}");
    }
}
