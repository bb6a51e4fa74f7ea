//! Traffic signals: fixed time, Webster's times for counted flows, and actuated control. Their state depends on the
//! experiment's clock and the measured vehicles alone.

mod actuated;
mod counted;
mod passing;
mod plan;
#[cfg(test)]
mod tests;
mod webster;

pub use passing::{may_pass, revoke_admissions};
pub use plan::{
    ActuatedControl, CountedControl, SignalControl, SignalPhase, SignalPlan, all_red_time_s, yellow_time_s,
};
pub use webster::{WebsterLimits, WebsterTiming, webster};

use super::Cav;
use super::strangers::Strangers;
use actuated::Actuated;
use city3d_protocol::snapshot::{Aspect, SignalAspects, SignalHeadId};
use city3d_roadmap::LabMap;
use counted::Counted;

/// All aspects are told again after this time: a city may have been restarted, or a datagram lost.
const REPEAT_S: f64 = 0.5;

/// What a signal head shows, and for how long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadState {
    /// What it shows.
    pub aspect: Aspect,
    /// Since when.
    pub since_s: f64,
    /// Until the aspect may change; infinite where that depends on traffic.
    pub left_s: f64,
}

/// A vehicle on its way to a signal head, laboratory metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ApproachingVehicle {
    /// The head that it comes to next.
    pub head: SignalHeadId,
    /// From its front bumper to the line; negative beyond the line.
    pub to_line_m: f64,
    /// Length of its outline.
    pub length_m: f64,
    /// Along its lane.
    pub speed_mps: f64,
}

/// Control of one junction, with its state.
#[derive(Clone, Debug)]
enum Running {
    FixedTime,
    Counted(Counted),
    Actuated(Actuated),
}

/// The signals of a city.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    signals: Vec<(SignalPlan, Running)>,
    /// By id.
    heads: Vec<HeadState>,
    /// Buffer of the vehicles before the lines.
    approaching: Vec<ApproachingVehicle>,
    told_s: Option<f64>,
    /// The aspects of the last message, by id.
    told: Vec<Aspect>,
}

/// Vehicles farther from a line than this are not looked at, laboratory metres.
const SIGHT_M: f64 = 6.0;

impl Signals {
    /// Signals of a map before the first control step; every head of a plan is one of the map.
    pub fn new(plans: Vec<SignalPlan>, map: &LabMap) -> Self {
        let state = HeadState { aspect: Aspect::Dark, since_s: 0.0, left_s: 0.0 };
        let running = |plan: SignalPlan| {
            let state = match plan.control {
                SignalControl::FixedTime => Running::FixedTime,
                SignalControl::Counted(params) => Running::Counted(Counted::new(params, &plan)),
                SignalControl::Actuated(params) => Running::Actuated(Actuated::new(params, &plan)),
            };
            (plan, state)
        };
        Self {
            signals: plans.into_iter().map(running).collect(),
            heads: vec![state; map.signals.len()],
            approaching: Vec::new(),
            told_s: None,
            told: Vec::new(),
        }
    }

    /// Whether they follow these plans.
    pub fn follow(&self, plans: &[SignalPlan]) -> bool {
        self.signals.iter().map(|(plan, _)| plan).eq(plans)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.signals.is_empty()
    }

    /// What a head shows; one that nobody controls holds nobody.
    pub fn head(&self, id: SignalHeadId) -> HeadState {
        let open = HeadState { aspect: Aspect::Green, since_s: f64::NEG_INFINITY, left_s: f64::INFINITY };
        self.heads.get(id.index()).copied().unwrap_or(open)
    }

    /// The aspects of all heads for a control step, with vehicles where they are at that time.
    pub(super) fn update(&mut self, now_s: f64, map: &LabMap, cavs: &[Cav], strangers: &Strangers) {
        if self.is_empty() {
            return;
        }
        let mut approaching = std::mem::take(&mut self.approaching);
        approaching.clear();
        approaching.extend(cavs.iter().filter(|cav| cav.is_on_route()).filter_map(approach_of));
        for (index, head) in map.signals.iter().enumerate() {
            let head_id = SignalHeadId(index as u32);
            approaching.extend(strangers.on(head.lane).map(|(front_m, rear_m, speed_mps)| {
                let (to_line_m, length_m) = (head.at_m - front_m, front_m - rear_m);
                ApproachingVehicle { head: head_id, to_line_m, length_m, speed_mps }
            }));
        }
        approaching.retain(|vehicle| vehicle.to_line_m < SIGHT_M);
        self.step(now_s, &approaching);
        self.approaching = approaching;
    }

    /// `update` with the vehicles before the lines.
    pub fn step(&mut self, now_s: f64, approaching: &[ApproachingVehicle]) {
        for (plan, running) in &mut self.signals {
            let stage = match running {
                Running::FixedTime => plan.stage_at(now_s),
                Running::Counted(counted) => counted.step(now_s, plan, approaching),
                Running::Actuated(actuated) => actuated.step(now_s, plan, approaching),
            };
            for phase in &plan.phases {
                for &head in &phase.green {
                    let state = &mut self.heads[head.index()];
                    let aspect = plan.aspect(head, stage);
                    if aspect != state.aspect {
                        (state.aspect, state.since_s) = (aspect, now_s);
                    }
                    state.left_s = stage.left_s;
                }
            }
        }
    }

    /// What has to be told of the heads now: those that have changed, or all of them after a while. None of the
    /// messages has more than [`SignalAspects::MOST`].
    pub fn messages(&mut self, now_s: f64) -> impl Iterator<Item = SignalAspects> {
        let repeats = self.told_s.is_none_or(|told_s| now_s - told_s >= REPEAT_S - plan::SAME_TIME_S);
        let aspects = self.heads.iter().map(|head| head.aspect).enumerate();
        let told = &self.told;
        let new = aspects.filter(|(index, aspect)| repeats || told.get(*index) != Some(aspect));
        let new: Vec<_> = new.map(|(index, aspect)| (SignalHeadId(index as u32), aspect)).collect();
        if repeats && !new.is_empty() {
            self.told_s = Some(now_s);
        }
        self.told.clear();
        self.told.extend(self.heads.iter().map(|head| head.aspect));
        let parts: Vec<SignalAspects> = new
            .chunks(SignalAspects::MOST)
            .map(|heads| SignalAspects { stamp_s: now_s, heads: heads.to_vec() })
            .collect();
        parts.into_iter()
    }
}

/// Where a vehicle is before the next signal of its route whose line its rear has not passed.
fn approach_of(cav: &Cav) -> Option<ApproachingVehicle> {
    let (front_s, rear_s) = (cav.front_s(), cav.rear_s());
    let section = cav.route.sections.iter().find(|s| s.signal.is_some() && s.hold_s > rear_s)?;
    Some(ApproachingVehicle {
        head: section.signal?,
        to_line_m: section.hold_s - front_s,
        length_m: cav.body.length_m,
        speed_mps: cav.speed_mps(),
    })
}
