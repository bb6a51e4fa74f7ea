//! Plans of coordinated vehicles at one instant, as a window shows them. They are read from the control framework of this
//! process; nothing of them is in a snapshot, a log or the digest of the state.

use city3d_control::coordination::{Passage, ZoneCounts};
use city3d_control::{Cav, Mainframe, Role, STANDS_MPS, heeds_nobody};
use city3d_geometry::Pose2;
use city3d_protocol::snapshot::VehicleId;
use city3d_simulation::scenario::Experiment;

/// The vehicles in control zones, with their plans.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CoordinationState {
    /// What has happened in each control zone so far, in the order of the scenario.
    pub counts: Vec<ZoneCounts>,
    /// Vehicles that are inside control zones, in id order.
    pub vehicles: Vec<ZoneVehicle>,
}

/// A vehicle inside a control zone.
#[derive(Clone, Debug, PartialEq)]
pub struct ZoneVehicle {
    /// Its id.
    pub id: VehicleId,
    /// Index of the control zone.
    pub zone: usize,
    /// Simulated time at which it entered the zone, seconds.
    pub entered_s: f64,
    /// Whether it stands.
    pub is_standing: bool,
    /// Its plan, or why it has none.
    pub plan: Result<PlannedPassage, NoPlan>,
}

/// Why a vehicle in a control zone has no plan: it drives by the rules of the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoPlan {
    /// It is not coordinated: a human driver, or one that keeps its speed.
    NotCoordinated,
    /// It has left its plans several times in a row, as where a person drives it.
    LeftItsPlans,
    /// Vehicles that are not coordinated are in its zone.
    AmongUncoordinated,
    /// No plan keeps bounds and gaps; it asks again.
    Infeasible,
}

/// A planned way through a control zone. Times are simulated seconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlannedPassage {
    /// When the front bumper enters the first conflict.
    pub enters_s: f64,
    /// When the rear bumper leaves the last conflict.
    pub leaves_s: f64,
    /// Where the front bumper enters the first conflict, city frame.
    pub entry: Pose2,
    /// Where the front bumper will be: now and every [`PLACE_STEP_S`] until the vehicle leaves.
    pub places: Vec<PlannedPlace>,
}

/// Where a vehicle will be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedPlace {
    /// Seconds from now.
    pub in_s: f64,
    /// The front bumper, heading along the route; city frame.
    pub pose: Pose2,
}

/// Time between two places of a plan.
pub const PLACE_STEP_S: f64 = 0.5;
/// A plan is told for so long ahead.
const LONGEST_S: f64 = 30.0;

impl CoordinationState {
    /// The present plans of a control framework; `None` where it coordinates nobody.
    pub fn of(mainframe: &Mainframe, experiment: &Experiment, now_s: f64) -> Option<Self> {
        let coordination = mainframe.coordination()?;
        let inside = |cav: &Cav| {
            let (_, entered_s) = cav.coordination.inside?;
            let passage = cav.coordination.passage()?;
            Some(ZoneVehicle {
                id: cav.id,
                zone: passage.zone,
                entered_s,
                is_standing: cav.speed_mps() < STANDS_MPS,
                plan: planned(cav, passage, experiment, now_s).ok_or_else(|| reason(cav, experiment)),
            })
        };
        let vehicles = mainframe.cavs().iter().filter_map(inside).collect();
        Some(Self { counts: coordination.counts().to_vec(), vehicles })
    }

    /// A vehicle, where it is in a control zone.
    pub fn vehicle(&self, id: VehicleId) -> Option<&ZoneVehicle> {
        self.vehicles.iter().find(|vehicle| vehicle.id == id)
    }
}

fn planned(cav: &Cav, passage: &Passage, experiment: &Experiment, now_s: f64) -> Option<PlannedPassage> {
    let plan = cav.coordination.plan.as_ref()?;
    let scale = experiment.scale;
    let pose_at =
        |front_s: f64| cav.route.at(&experiment.lab_map, front_s.min(cav.route.length())).pose.to_city(scale);
    let leaves_s = plan.time_at(passage.end_axle_s(cav.body));
    let count = ((leaves_s - now_s).clamp(0.0, LONGEST_S) / PLACE_STEP_S).floor() as u32;
    let places = (0..=count).map(|k| f64::from(k) * PLACE_STEP_S).map(|in_s| {
        let front_s = plan.at(now_s + in_s).position_m + cav.body.overhang_m();
        PlannedPlace { in_s, pose: pose_at(front_s) }
    });
    Some(PlannedPassage {
        enters_s: plan.time_at(cav.body.axle_of_front(passage.from_s)),
        leaves_s,
        entry: pose_at(passage.from_s),
        places: places.collect(),
    })
}

fn reason(cav: &Cav, experiment: &Experiment) -> NoPlan {
    let planned = experiment.planned(cav.id);
    let heeds_nobody = planned.is_some_and(|planned| heeds_nobody(&planned.controller));
    if cav.role == Role::Human || heeds_nobody {
        NoPlan::NotCoordinated
    } else if cav.coordination.is_distrusted {
        NoPlan::LeftItsPlans
    } else if cav.coordination.is_among_uncoordinated {
        NoPlan::AmongUncoordinated
    } else {
        NoPlan::Infeasible
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use std::sync::Arc;

    fn coordinated(change: impl Fn(&str) -> String) -> Run {
        let (text, library) = Library::scenario("roundabout-coordinated").unwrap();
        let experiment = read_experiment("test", &change(&text), &library, Overrides::default()).unwrap();
        Run::new(Arc::new(experiment)).unwrap()
    }

    fn state(run: &Run) -> Option<CoordinationState> {
        CoordinationState::of(run.mainframe(), run.experiment(), run.snapshot().time_s)
    }

    /// How far the front bumper of a vehicle is from a place of the city.
    fn distance_m(run: &Run, id: VehicleId, place: &PlannedPlace) -> f64 {
        let (vehicle, info) = run.snapshot().iter().find(|(vehicle, _)| vehicle.id == id).unwrap();
        let front = vehicle.pose().point_at(info.dimensions.length_m / 2.0, 0.0);
        front.distance(place.pose.position)
    }

    #[test]
    fn vehicles_come_where_and_when_their_plans_say() {
        let mut run = coordinated(str::to_owned);
        while run.snapshot().time_s < 8.0 {
            run.step();
        }
        let then = state(&run).unwrap();
        let planned: Vec<_> =
            then.vehicles.iter().filter_map(|v| Some((v.id, v.plan.clone().ok()?))).collect();
        assert!(planned.len() >= 2, "{then:?}");
        for _ in 0..200 {
            run.step();
        }
        let mut checked = 0;
        for (id, plan) in &planned {
            assert!(plan.leaves_s > plan.enters_s);
            let Some(place) = plan.places.iter().find(|place| place.in_s == 2.0) else { continue };
            let miss_m = distance_m(&run, *id, place);
            assert!(miss_m < 2.0, "vehicle {id} is {miss_m} m from its plan");
            checked += 1;
        }
        assert!(checked >= 2, "{planned:?}");
    }

    #[test]
    fn without_coordination_there_is_no_state_and_who_cruises_has_no_plan() {
        let none = coordinated(|text| text.replace("algorithm = \"insert\"", "algorithm = \"none\""));
        assert_eq!(state(&none), None);
        let mut run = coordinated(|text| text.replace("controller = \"idm\"", "controller = \"cruise\""));
        while run.snapshot().time_s < 8.0 {
            run.step();
        }
        let state = state(&run).unwrap();
        let reasons: Vec<_> = state.vehicles.iter().map(|vehicle| vehicle.plan.clone().err()).collect();
        assert!(!reasons.is_empty());
        assert!(reasons.iter().all(|why| *why == Some(NoPlan::NotCoordinated)), "{reasons:?}");
    }
}
