//! Post-encroachment times (PET) of the conflict zones of a map (Allen, Shin and Cooper 1978).
//!
//! The PET of two vehicles that pass a conflict zone on different sides is the time from when the first one's rear
//! bumper leaves the zone until the second one's front bumper enters it. It is negative where the second enters first:
//! then both are in the zone, though they need not touch, because a zone is the whole stretch on which vehicles
//! could.

use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::ZoneId;

/// An encounter counts below this post-encroachment time, seconds (SUMO's SSM device).
pub const PET_S: f64 = 2.0;

/// A vehicle's front enters a zone, or its rear leaves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZoneMove {
    /// Simulated time.
    pub time_s: f64,
    /// Who moves.
    pub vehicle: VehicleId,
    /// The conflict zone in its map.
    pub zone: ZoneId,
    /// Which of the zone's sides it passes, 0 or 1.
    pub side: usize,
    /// Whether it enters; otherwise it leaves.
    pub enters: bool,
}

/// The post-encroachment time of two vehicles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encroachment {
    /// The conflict zone in its map.
    pub zone: ZoneId,
    /// The vehicle that entered first.
    pub first: VehicleId,
    /// The vehicle that entered second.
    pub second: VehicleId,
    /// When the second one entered.
    pub entered_s: f64,
    /// From the exit of the first to the entry of the second.
    pub pet_s: f64,
}

/// One zone.
#[derive(Clone, Debug, Default)]
struct ZoneState {
    /// By side: vehicles inside with the times of their entries.
    inside: [Vec<(VehicleId, f64)>; 2],
    /// By side: the last exit, until somebody of the other side has entered.
    last_exit: [Option<(VehicleId, f64)>; 2],
}

/// The conflict zones of a map, and who is in them.
#[derive(Clone, Debug, Default)]
pub struct ZoneStates {
    zones: Vec<ZoneState>,
}

impl ZoneStates {
    /// So many zones, all free.
    pub fn new(count: usize) -> Self {
        Self { zones: vec![ZoneState::default(); count] }
    }

    /// A vehicle begins inside a zone.
    pub fn begin_inside(&mut self, zone: ZoneId, side: usize, vehicle: VehicleId, time_s: f64) {
        self.zones[zone.index()].inside[side].push((vehicle, time_s));
    }

    /// A vehicle is gone, or on another route: it no longer counts in a zone.
    pub fn forget(&mut self, zone: ZoneId, side: usize, vehicle: VehicleId) {
        self.zones[zone.index()].inside[side].retain(|(other, _)| *other != vehicle);
    }

    /// Takes the next move, in order of time, and adds the post-encroachment times that it decides.
    pub fn take(&mut self, by: &ZoneMove, found: &mut Vec<Encroachment>) {
        let zone = &mut self.zones[by.zone.index()];
        let other = 1 - by.side;
        if by.enters {
            if let Some((first, left_s)) = zone.last_exit[other].take()
                && zone.inside[other].is_empty()
            {
                let (zone, entered_s) = (by.zone, by.time_s);
                let pet_s = entered_s - left_s;
                found.push(Encroachment { zone, first, second: by.vehicle, entered_s, pet_s });
            }
            zone.inside[by.side].push((by.vehicle, by.time_s));
            return;
        }
        let Some(at) = zone.inside[by.side].iter().position(|(id, _)| *id == by.vehicle) else { return };
        let (first, since_s) = zone.inside[by.side].remove(at);
        zone.last_exit[by.side] = Some((first, by.time_s));
        // Whoever entered on the other side meanwhile encroached.
        for &(second, entered_s) in zone.inside[other].iter().filter(|(_, entered_s)| *entered_s >= since_s) {
            let pet_s = entered_s - by.time_s;
            found.push(Encroachment { zone: by.zone, first, second, entered_s, pet_s });
            zone.last_exit[by.side] = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moves as (time, vehicle, side, enters) in one zone.
    fn encroachments(moves: &[(f64, u32, usize, bool)]) -> Vec<(u32, u32, f64)> {
        let (mut zones, mut found) = (ZoneStates::new(1), Vec::new());
        for &(time_s, vehicle, side, enters) in moves {
            let by = ZoneMove { time_s, vehicle: VehicleId(vehicle), zone: ZoneId(0), side, enters };
            zones.take(&by, &mut found);
        }
        found.into_iter().map(|e| (e.first.0, e.second.0, e.pet_s)).collect()
    }

    #[test]
    fn the_second_enters_after_the_first_has_left() {
        let found = encroachments(&[(1.0, 1, 0, true), (3.0, 1, 0, false), (4.5, 2, 1, true)]);
        assert_eq!(found, [(1, 2, 1.5)]);
    }

    #[test]
    fn two_in_the_zone_have_a_negative_time() {
        let found = encroachments(&[
            (1.0, 1, 0, true),
            (2.5, 2, 1, true),
            (3.0, 1, 0, false),
            (4.0, 2, 1, false),
            (9.0, 3, 0, true),
        ]);
        assert_eq!(found, [(1, 2, -0.5), (2, 3, 5.0)]);
    }

    #[test]
    fn vehicles_of_one_side_follow_one_another_without_a_time() {
        let found = encroachments(&[
            (1.0, 1, 0, true),
            (2.0, 2, 0, true),
            (3.0, 1, 0, false),
            (4.0, 2, 0, false),
            (4.5, 3, 1, true),
            (5.0, 4, 1, true),
        ]);
        // Only the last of the platoon and the first of the other side meet.
        assert_eq!(found, [(2, 3, 0.5)]);
    }

    #[test]
    fn a_vehicle_that_crosses_a_platoon_meets_both_neighbours() {
        let found = encroachments(&[
            (1.0, 1, 0, true),
            (2.0, 1, 0, false),
            (2.5, 2, 1, true),
            (3.0, 3, 0, true),
            (3.25, 2, 1, false),
        ]);
        assert_eq!(found, [(1, 2, 0.5), (2, 3, -0.25)]);
    }
}
