//! Coordination algorithms by name: in which order vehicles of a control zone get plans.

use super::coordinator::{CoordinationRequest, Grant, ZoneView};
use super::motion_plan::MotionPlan;
use std::fmt::Debug;

/// An algorithm that coordinates the vehicles of control zones. It decides who gets a plan, in which order and not
/// before when; the framework finds plans that keep bounds and gaps, and admits their vehicles.
pub trait Coordinator: Debug + Send {
    /// Gives plans to vehicles that ask for one, and may revoke others. It is called for a zone when a vehicle asks there.
    fn schedule(&mut self, view: &mut ZoneView<'_>);

    /// Whether it wants to be called although nobody asks.
    fn is_due(&self, _now_s: f64) -> bool {
        false
    }
}

/// Names of the algorithms.
pub const COORDINATORS: [&str; 4] = ["fifo", "insert", "priority", "replan"];

/// An algorithm by name; `None` for an unknown one.
///
/// `fifo`: first come, first served at every conflict. `insert`: into the first gap of the schedule. `priority`: likewise, vehicles
/// on major roads before those behind yield and stop lines. `replan`: whenever a
/// vehicle asks, all that are not yet admitted are planned again, who can be first at the conflicts goes first.
pub fn coordinator(name: &str) -> Option<Box<dyn Coordinator>> {
    match name {
        "fifo" => Some(Box::new(Sequential { fills_gaps: false })),
        "insert" => Some(Box::new(Sequential { fills_gaps: true })),
        "priority" => Some(Box::new(MajorFirst)),
        "replan" => Some(Box::new(Replanning)),
        _ => None,
    }
}

/// Requests by entry into the zone, then by possible arrival.
fn in_order_of_entry(view: &ZoneView<'_>) -> Vec<CoordinationRequest> {
    let mut requests = view.requests().to_vec();
    requests.sort_by(|a, b| {
        a.entered_s
            .total_cmp(&b.entered_s)
            .then(a.earliest_s.total_cmp(&b.earliest_s))
            .then(a.vehicle.cmp(&b.vehicle))
    });
    requests
}

/// Plans each vehicle once, in the order of entry.
#[derive(Debug)]
struct Sequential {
    fills_gaps: bool,
}

impl Coordinator for Sequential {
    fn schedule(&mut self, view: &mut ZoneView<'_>) {
        for request in in_order_of_entry(view) {
            let grant = Grant { not_before_s: f64::NEG_INFINITY, fills_gaps: self.fills_gaps };
            // Without a plan it drives by the rules of the road and asks again.
            let _ = view.grant(request.vehicle, grant);
        }
    }
}

/// Plans vehicles on major roads first, so that those from minor roads take what they leave.
#[derive(Debug)]
struct MajorFirst;

impl Coordinator for MajorFirst {
    fn schedule(&mut self, view: &mut ZoneView<'_>) {
        let mut requests = in_order_of_entry(view);
        requests.sort_by_key(|request| view.rank(request.vehicle));
        for request in requests {
            let _ = view.grant(request.vehicle, INTO_GAPS);
        }
    }
}

/// Plans all again that are not yet admitted (Le and Malikopoulos 2025, replanning with resequencing).
#[derive(Debug)]
struct Replanning;

const INTO_GAPS: Grant = Grant { not_before_s: f64::NEG_INFINITY, fills_gaps: true };

impl Coordinator for Replanning {
    fn schedule(&mut self, view: &mut ZoneView<'_>) {
        let old: Vec<(usize, MotionPlan)> = view
            .replannable()
            .into_iter()
            .filter_map(|vehicle| view.revoke(vehicle).map(|plan| (vehicle, plan)))
            .collect();
        let mut requests = view.requests().to_vec();
        requests.sort_by(|a, b| a.earliest_s.total_cmp(&b.earliest_s).then(a.vehicle.cmp(&b.vehicle)));
        let mut new_s = 0.0;
        let is_old = |vehicle: usize| old.iter().any(|(other, _)| *other == vehicle);
        let mut has_all = true;
        for request in &requests {
            match view.grant(request.vehicle, INTO_GAPS) {
                Ok(plan) if is_old(request.vehicle) => new_s += plan.end().time_s,
                Ok(_) => {}
                Err(_) => has_all = false,
            }
        }
        let old_s: f64 = old.iter().map(|(_, plan)| plan.end().time_s).sum();
        if has_all && new_s <= old_s + WORTH_IT_S {
            return;
        }
        // The former schedule is better: newcomers go into its gaps.
        for request in &requests {
            view.revoke(request.vehicle);
        }
        for (vehicle, plan) in old {
            view.restore(vehicle, plan);
        }
        for request in in_order_of_entry(view) {
            let _ = view.grant(request.vehicle, INTO_GAPS);
        }
    }
}

/// A newcomer may cost the others this much in all, seconds: it would wait longer itself.
const WORTH_IT_S: f64 = 0.0;
