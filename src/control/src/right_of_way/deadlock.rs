//! Deadlocks of the order of admissions: found as cycles of who waits for whom, resolved by a new number.
//!
//! Numbers that are given in lane order make no cycles. They come about where vehicles stand as no admission has led
//! them: after the control framework was away, or because of a person.

use super::inside::Inside;
use super::presence::Present;
use super::{ConstraintKind, RightOfWay, YieldConstraint};
use crate::Cav;
use crate::traffic::Occupancy;
use city3d_roadmap::LabMap;
use city3d_workers::Workers;
use std::collections::{BTreeMap, BTreeSet};

/// Who stands this long may be in a deadlock.
const STANDS_FOR_S: f64 = 3.0;
/// Who stands for a vehicle or at a place is closer to it than this.
const STANDS_BEFORE_M: f64 = 0.3;

/// Whether a vehicle stands so long that it may be in a deadlock.
pub(super) fn stands_long(now_s: f64, cav: &Cav) -> bool {
    cav.is_on_route() && cav.passage.stood_for_s(now_s) > STANDS_FOR_S && !cav.is_lost()
}

/// What vehicles wait for each other by.
#[derive(Clone, Copy)]
struct Standstill<'s> {
    now_s: f64,
    map: &'s LabMap,
    cavs: &'s [Cav],
    occupancy: &'s Occupancy,
}

impl RightOfWay {
    /// Lets a vehicle go first whose way is free, of each cycle of vehicles that stand and wait for each other.
    pub(super) fn resolve_deadlocks(
        &mut self,
        now_s: f64,
        map: &LabMap,
        cavs: &mut [Cav],
        occupancy: &Occupancy,
        (present, workers): (&Present, &Workers),
    ) {
        let around = Standstill { now_s, map, cavs, occupancy };
        // Those that were admitted in this step, too.
        let inside = present.inside.iter().map(|(vehicle, _)| *vehicle);
        let standing = present.standing.iter().copied();
        let standing = standing.chain(inside.filter(|vehicle| stands_long(now_s, &cavs[*vehicle])));
        let mut kept: Vec<(usize, bool)> = standing.map(|vehicle| (vehicle, false)).collect();
        workers.each(&mut kept, |_, (vehicle, is_kept)| {
            *is_kept = !self.waited_for_by_number(around, *vehicle).is_empty();
        });
        kept.retain(|(_, is_kept)| *is_kept);
        kept.sort_unstable();
        kept.dedup();
        let mut waits = BTreeMap::new();
        let found = kept.into_iter().map(|(vehicle, _)| vehicle).find(|vehicle| {
            self.is_in_cycle(around, *vehicle, &mut waits) && has_free_way(map, *vehicle, cavs)
        });
        if let Some(vehicle) = found {
            self.goes_first(vehicle, cavs);
        }
    }

    /// Whether a vehicle waits for others that wait for it. `waits` has those looked at before.
    fn is_in_cycle(
        &self,
        around: Standstill<'_>,
        vehicle: usize,
        waits: &mut BTreeMap<usize, Vec<usize>>,
    ) -> bool {
        let mut seen = BTreeSet::new();
        let mut open = vec![vehicle];
        while let Some(next) = open.pop() {
            let others = waits.entry(next).or_insert_with(|| self.waited_for(around, next));
            if others.contains(&vehicle) {
                return true;
            }
            open.extend(others.iter().filter(|other| seen.insert(**other)));
        }
        false
    }

    /// The vehicles that a vehicle waits for: none where it does not stand.
    fn waited_for(&self, around: Standstill<'_>, vehicle: usize) -> Vec<usize> {
        let Standstill { now_s, cavs, occupancy, .. } = around;
        if !stands_long(now_s, &cavs[vehicle]) {
            return Vec::new();
        }
        let mut others = self.waited_for_by_number(around, vehicle);
        others.extend(occupancy.leader(cavs, vehicle, STANDS_BEFORE_M).map(|leader| leader.vehicle));
        others
    }

    /// The vehicles that a standing vehicle waits for because of its number, not because of their bodies.
    fn waited_for_by_number(
        &self,
        Standstill { map, cavs, .. }: Standstill<'_>,
        vehicle: usize,
    ) -> Vec<usize> {
        let mut constraints = Vec::new();
        self.yield_constraints(map, vehicle, cavs, &mut constraints);
        let is_near = |constraint: &YieldConstraint| match constraint.kind {
            ConstraintKind::Stop { gap_m } => gap_m < STANDS_BEFORE_M,
            ConstraintKind::Merging { leader, wait_gap_m } => leader.gap_m.max(wait_gap_m) < STANDS_BEFORE_M,
        };
        let near = constraints.iter().filter(|constraint| is_near(constraint));
        near.filter_map(|constraint| constraint.other).collect()
    }

    /// Numbers the admissions of a vehicle before those of all others.
    fn goes_first(&mut self, vehicle: usize, cavs: &mut [Cav]) {
        let admissions = &mut cavs[vehicle].passage.admissions;
        self.before_all -= admissions.len() as u64;
        for (admission, order) in admissions.iter_mut().zip(self.before_all..) {
            admission.order = order;
        }
        for user in self.users.iter_mut().flatten().filter(|user| user.vehicle == vehicle) {
            user.order = cavs[vehicle].order_of(user.section);
        }
    }
}

/// Whether no body is in the way of a vehicle up to the end of the section that it is in.
fn has_free_way(map: &LabMap, vehicle: usize, cavs: &[Cav]) -> bool {
    let cav = &cavs[vehicle];
    let Some(admission) = cav.passage.admissions.first() else { return false };
    let way_m = cav.route.sections[admission.section].to_s - cav.rear_s();
    let own = Inside { cav, to_exit_m: way_m };
    let mut others = cavs.iter().enumerate().filter(|(other, cav)| *other != vehicle && cav.is_seen());
    !others.any(|(_, other)| own.is_obstructed(map, other))
}

#[cfg(test)]
mod tests {
    use super::super::{FIRST_INTRUDER, Reservation};
    use crate::{CavGeometry, CavSetup, DriverParams, Mainframe, Role, TrafficRules};
    use city3d_geometry::trig;
    use city3d_protocol::snapshot::VehicleId;
    use city3d_protocol::wire::Measurement;
    use city3d_roadmap::{Grid, GridControl, LabMap, ZoneSide, load_map};
    use glam::DQuat;
    use std::sync::Arc;

    const BODY: CavGeometry =
        CavGeometry { length_m: 0.19, width_m: 0.08, wheelbase_m: 0.11, min_turn_radius_m: 0.2 };
    const STEP_S: f64 = 0.1;
    const EAST: &str = "junction-1-1/west-to-east";
    const NORTH: &str = "junction-1-1/south-to-north";

    fn map() -> LabMap {
        let grid = Grid { control: GridControl::None, ..Grid::default() };
        load_map(grid.to_dxf().unwrap().as_bytes()).unwrap().map
    }

    /// A vehicle on a way through the junction, and its pose with the front bumper so far from the crossing of the two ways.
    fn vehicle(map: &LabMap, id: u32, heading: &str, to_zone_m: f64) -> (CavSetup, Measurement) {
        let (road, way) = if heading == "east" { ("street", EAST) } else { ("avenue", NORTH) };
        let names = [format!("{road}-1/{heading}/1"), way.to_owned(), format!("{road}-1/{heading}/2")];
        let route: Vec<_> = names.iter().map(|name| map.lane_by_name(name).unwrap().id).collect();
        let lanes = [route[0], route[1]].map(|lane| map.lane(lane));
        let other_way = if heading == "east" { NORTH } else { EAST };
        let across = |side: &ZoneSide| map.lane(side.lane).name == other_way;
        let zone = map.zones_on(route[1]).find(|zone| zone.sides.iter().any(across)).unwrap();
        let from_m = zone.sides.iter().find(|side| side.lane == route[1]).unwrap().from_m;
        let middle_m = from_m - to_zone_m - BODY.length_m / 2.0;
        let at = if middle_m < 0.0 {
            lanes[0].curve.at(lanes[0].curve.length() + middle_m).pose
        } else {
            lanes[1].curve.at(middle_m).pose
        };
        let setup = CavSetup {
            id: VehicleId(id),
            controller: "idm".to_owned(),
            driver: DriverParams::default(),
            body: BODY,
            route,
            speed_mps: 0.0,
            role: Role::Human,
            leaves: false,
        };
        let (sin, cos) = trig::sin_cos(at.yaw_rad / 2.0);
        let orientation = DQuat::from_xyzw(0.0, 0.0, sin, cos);
        (
            setup,
            Measurement {
                vehicle: VehicleId(id),
                stamp_s: 0.0,
                position: at.position.extend(0.0),
                orientation,
            },
        )
    }

    #[test]
    fn a_cycle_of_numbers_and_bodies_is_resolved_by_one_whose_way_is_free() {
        let map = Arc::new(map());
        // The second stands behind the first, the third comes from the side.
        let placed = [(1, "east", 0.05), (2, "east", 0.32), (3, "north", 0.05)]
            .map(|(id, heading, to_zone_m)| vehicle(&map, id, heading, to_zone_m));
        let setups = placed.iter().map(|(setup, _)| setup.clone()).collect();
        let mut mainframe = Mainframe::new(Arc::clone(&map), setups, TrafficRules::default()).unwrap();
        let step = |mainframe: &mut Mainframe, time_s: f64| {
            let seen: Vec<_> =
                placed.iter().map(|(_, seen)| Measurement { stamp_s: time_s, ..*seen }).collect();
            mainframe.step(time_s, &seen, &mut Vec::new());
        };
        step(&mut mainframe, 0.0);
        // The first waits for the third, the third for the second, and the second stands behind the first.
        for (cav, order) in mainframe.cavs.iter_mut().zip([3, 1, 2]) {
            cav.passage.admissions =
                vec![Reservation { section: 0, order: super::super::FIRST_ORDER + order }];
            cav.passage.next_section = 1;
        }
        let first_of_all = |mainframe: &Mainframe| {
            mainframe
                .cavs()
                .iter()
                .position(|cav| cav.passage.admissions.iter().any(|a| a.order < FIRST_INTRUDER))
        };
        let mut time_s = 0.0;
        while first_of_all(&mainframe).is_none() && time_s < 5.0 {
            time_s += STEP_S;
            step(&mut mainframe, time_s);
        }
        let freed = first_of_all(&mainframe).expect("a vehicle goes first");
        assert!((3.0..3.5).contains(&time_s), "{time_s}");
        assert_ne!(freed, 1, "the second has no free way");
        assert!(mainframe.cavs()[freed].plan.acceleration_mps2 > 0.0);
    }
}
