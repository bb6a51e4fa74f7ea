//! Plans of coordinated vehicles at one instant, as a window, the link and logs tell them. They are read from the control
//! framework; nothing of them is in a snapshot or in the digest of the state.

use city3d_control::coordination::{ControlZone, Passage};
use city3d_control::{Cav, Mainframe, Role, STANDS_MPS, heeds_nobody};
use city3d_geometry::City;
use city3d_protocol::snapshot::{
    CoordinationState, NoPlan, PlanPoint, PlannedPassage, ZoneCounts, ZoneState, ZoneVehicle,
};
use city3d_simulation::scenario::Experiment;

/// A plan shorter than this is told by one point, seconds: the vehicle is about to leave.
const SHORTEST_S: f64 = 0.05;

/// The present plans of a control framework; `None` where it coordinates nobody.
pub fn coordination(mainframe: &Mainframe, experiment: &Experiment, now_s: f64) -> Option<CoordinationState> {
    let coordination = mainframe.coordination()?;
    let zones = coordination.zones().iter().zip(coordination.counts());
    let zone = |(number, (zone, counts)): (u16, (&ControlZone, &ZoneCounts))| ZoneState {
        number,
        name: zone.name.clone(),
        counts: *counts,
    };
    let inside = |cav: &Cav| {
        let (_, entered_s) = cav.coordination.inside?;
        let passage = cav.coordination.passage()?;
        Some(ZoneVehicle {
            id: cav.id,
            zone: u16::try_from(passage.zone).ok()?,
            entered_s,
            is_standing: cav.speed_mps() < STANDS_MPS,
            plan: planned(cav, passage, experiment, now_s).ok_or_else(|| reason(cav, experiment)),
        })
    };
    Some(CoordinationState {
        zones: (0..=u16::MAX).zip(zones).map(zone).collect(),
        vehicles: mainframe.cavs().iter().filter_map(inside).collect(),
    })
}

fn planned(cav: &Cav, passage: &Passage, experiment: &Experiment, now_s: f64) -> Option<PlannedPassage> {
    let plan = cav.coordination.plan.as_ref()?;
    let scale = experiment.scale;
    let pose_at =
        |front_s: f64| cav.route.at(&experiment.lab_map, front_s.min(cav.route.length())).pose.to_city(scale);
    let leaves_s = plan.time_at(passage.end_axle_s(cav.body));
    let point = |time_s: f64| {
        let state = plan.at(time_s);
        PlanPoint {
            time_s,
            pose: pose_at(state.position_m + cav.body.overhang_m()),
            speed_mps: scale.city_from_lab(state.speed_mps),
        }
    };
    Some(PlannedPassage {
        enters_s: plan.time_at(cav.body.axle_of_front(passage.from_s)),
        leaves_s,
        entry: pose_at(passage.from_s),
        motion: times(now_s, leaves_s).map(point).collect(),
    })
}

/// Times from now until a vehicle leaves, evenly and about a second apart: as many as a plan may have points.
fn times(now_s: f64, leaves_s: f64) -> impl Iterator<Item = f64> {
    const MOST_INTERVALS: f64 = (PlannedPassage::<City>::MAX_POINTS - 1) as f64;
    let span_s = (leaves_s - now_s).clamp(0.0, PlannedPassage::<City>::LONGEST_S);
    let intervals = if span_s < SHORTEST_S { 0.0 } else { span_s.ceil().min(MOST_INTERVALS) };
    (0..=intervals as u32).map(move |k| now_s + span_s * f64::from(k) / intervals.max(1.0))
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
    use city3d_protocol::snapshot::VehicleId;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use glam::DVec2;
    use std::sync::Arc;

    fn coordinated(change: impl Fn(&str) -> String) -> Run {
        let (text, library) = Library::scenario("roundabout-coordinated").unwrap();
        let experiment = read_experiment("test", &change(&text), &library, Overrides::default()).unwrap();
        Run::new(Arc::new(experiment)).unwrap()
    }

    fn state(run: &Run) -> Option<CoordinationState> {
        coordination(run.mainframe(), run.experiment(), run.snapshot().time_s)
    }

    /// How far the front bumper of a vehicle is from a place of the city.
    fn distance_m(run: &Run, id: VehicleId, place: DVec2) -> f64 {
        let (vehicle, info) = run.snapshot().iter().find(|(vehicle, _)| vehicle.id == id).unwrap();
        let front = vehicle.pose().point_at(info.dimensions.length_m / 2.0, 0.0);
        front.distance(place)
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
            let Some(place) = plan.position_at(run.snapshot().time_s) else { continue };
            let miss_m = distance_m(&run, *id, place);
            assert!(miss_m < 2.0, "vehicle {id} is {miss_m} m from its plan");
            checked += 1;
        }
        assert!(checked >= 2, "{planned:?}");
    }

    #[test]
    fn points_of_a_plan_show_it_within_centimetres_and_are_no_more_than_a_datagram_has_room_for() {
        let mut run = coordinated(str::to_owned);
        let mut checked = 0;
        while run.snapshot().time_s < 30.0 {
            (0..50).for_each(|_| _ = run.step());
            let (now_s, told) = (run.snapshot().time_s, state(&run).unwrap());
            for vehicle in &told.vehicles {
                let Ok(shown) = &vehicle.plan else { continue };
                assert!(shown.motion.len() <= PlannedPassage::<City>::MAX_POINTS);
                let cav = run.mainframe().cavs().iter().find(|cav| cav.id == vehicle.id).unwrap();
                let plan = cav.coordination.plan.as_ref().unwrap();
                let until_s = shown.motion[shown.motion.len() - 1].time_s;
                let most_s = shown.leaves_s.min(now_s + PlannedPassage::<City>::LONGEST_S);
                assert!((until_s - most_s.max(now_s)).abs() < 0.06, "{until_s} {most_s}");
                let times =
                    (0..).map(|k| now_s + 0.13 * f64::from(k)).take_while(|time_s| *time_s <= until_s);
                for time_s in times {
                    let front_s = plan.at(time_s).position_m + cav.body.overhang_m();
                    let exact = cav.route.at(&run.experiment().lab_map, front_s.min(cav.route.length()));
                    let exact = exact.pose.to_city(run.experiment().scale).position;
                    let miss_m = shown.position_at(time_s).unwrap().distance(exact);
                    assert!(miss_m < 0.25, "{miss_m} m at {time_s} s: {shown:?}");
                    checked += 1;
                }
            }
        }
        assert!(checked > 1000, "{checked}");
        let spread: Vec<f64> = times(10.0, 100.0).collect();
        assert_eq!((spread.len(), spread[0], spread[24]), (25, 10.0, 40.0));
        assert_eq!(times(10.0, 9.0).collect::<Vec<_>>(), [10.0], "it is late");
        assert_eq!(times(10.0, 12.5).collect::<Vec<_>>(), [10.0, 10.0 + 2.5 / 3.0, 10.0 + 5.0 / 3.0, 12.5]);
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
