//! Surrogate measures of safety between followers: gap, time to collision, deceleration to avoid a crash.

use city3d_control::Route;
use city3d_roadmap::{LabMap, LaneId};

/// An encounter begins below this time to collision, seconds (SUMO's SSM device).
pub const TTC_S: f64 = 3.0;
/// An encounter begins above this deceleration to avoid a crash, m/s2 at full scale (SUMO's SSM device).
pub const DRAC_MPS2: f64 = 3.0;
/// How far ahead a leader is looked for, laboratory metres.
const SIGHT_M: f64 = 2.5;

/// Gap and speeds of a vehicle and the one ahead on its path, laboratory units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// From the own front bumper to the rear bumper of the leader.
    pub gap_m: f64,
    /// Own speed.
    pub speed_mps: f64,
    /// Speed of the leader.
    pub leader_mps: f64,
}

impl Following {
    /// Time to collision: gap / (v - v_l), where the gap closes; else `None` (Hayward 1972).
    pub fn ttc_s(&self) -> Option<f64> {
        let closing_mps = self.speed_mps - self.leader_mps;
        (closing_mps > 0.0).then(|| self.gap_m.max(0.0) / closing_mps)
    }

    /// Deceleration rate to avoid a crash: (v - v_l)^2 / (2 gap), where the gap closes; else 0 (Cooper and Ferguson
    /// 1976). Infinite without a gap.
    pub fn drac_mps2(&self) -> f64 {
        let closing_mps = (self.speed_mps - self.leader_mps).max(0.0);
        if closing_mps == 0.0 { 0.0 } else { closing_mps * closing_mps / (2.0 * self.gap_m.max(0.0)) }
    }
}

/// The least favourable values of a vehicle, laboratory units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Safety {
    /// Least time to collision; 0 once it has touched another vehicle.
    pub min_ttc_s: Option<f64>,
    /// Encounters with a time to collision below [`TTC_S`].
    pub ttc_encounters: u32,
    /// Largest deceleration to avoid a crash; infinite once it has touched another vehicle.
    pub max_drac_mps2: f64,
    /// Encounters above [`DRAC_MPS2`].
    pub drac_encounters: u32,
    /// Least gap to a vehicle ahead on its path; at most 0 once it has touched another vehicle.
    pub min_gap_m: Option<f64>,
    /// Least post-encroachment time of which it is the second vehicle; negative where both were in the zone.
    pub min_pet_s: Option<f64>,
    /// Passages with a post-encroachment time below [`PET_S`](super::PET_S).
    pub pet_encounters: u32,
    is_near: bool,
    brakes_hard: bool,
}

impl Safety {
    /// Takes the next sample; `drac_mps2` is the threshold in the laboratory.
    pub fn follow(&mut self, following: Option<Following>, drac_mps2: f64) {
        let ttc_s = following.and_then(|following| following.ttc_s());
        let drac = following.map_or(0.0, |following| following.drac_mps2());
        self.min_ttc_s = least(self.min_ttc_s, ttc_s);
        self.min_gap_m = least(self.min_gap_m, following.map(|following| following.gap_m));
        self.max_drac_mps2 = self.max_drac_mps2.max(drac);
        let was = (self.is_near, self.brakes_hard);
        (self.is_near, self.brakes_hard) = (ttc_s.is_some_and(|ttc_s| ttc_s < TTC_S), drac > drac_mps2);
        self.ttc_encounters += u32::from(self.is_near && !was.0);
        self.drac_encounters += u32::from(self.brakes_hard && !was.1);
    }

    /// Takes a collision with another vehicle: nothing was between them, from whatever side one came.
    pub fn touch(&mut self) {
        self.min_gap_m = least(self.min_gap_m, Some(0.0));
        self.min_ttc_s = least(self.min_ttc_s, Some(0.0));
        self.max_drac_mps2 = f64::INFINITY;
        self.ttc_encounters += u32::from(!self.is_near);
        self.is_near = true;
    }

    /// Takes a post-encroachment time.
    pub fn encroach(&mut self, pet_s: f64) {
        self.min_pet_s = least(self.min_pet_s, Some(pet_s));
        self.pet_encounters += u32::from(pet_s < super::PET_S);
    }

    /// The worse of two.
    #[must_use]
    pub fn with(self, other: &Self) -> Self {
        Self {
            min_ttc_s: least(self.min_ttc_s, other.min_ttc_s),
            ttc_encounters: self.ttc_encounters + other.ttc_encounters,
            max_drac_mps2: self.max_drac_mps2.max(other.max_drac_mps2),
            drac_encounters: self.drac_encounters + other.drac_encounters,
            min_gap_m: least(self.min_gap_m, other.min_gap_m),
            min_pet_s: least(self.min_pet_s, other.min_pet_s),
            pet_encounters: self.pet_encounters + other.pet_encounters,
            ..self
        }
    }
}

fn least(known: Option<f64>, found: Option<f64>) -> Option<f64> {
    match (known, found) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}

/// A vehicle on a lane: arc lengths of its bumpers along that lane, laboratory metres.
#[derive(Clone, Copy, Debug)]
struct LaneOccupant {
    vehicle: usize,
    front_m: f64,
    rear_m: f64,
    speed_mps: f64,
}

/// The vehicles on each lane at one instant.
#[derive(Clone, Debug, Default)]
pub struct LaneOccupants {
    on_lane: Vec<Vec<LaneOccupant>>,
    /// Lanes that have occupants.
    used: Vec<LaneId>,
}

impl LaneOccupants {
    /// Removes all vehicles.
    pub fn clear(&mut self, map: &LabMap) {
        self.on_lane.resize_with(map.lanes.len(), Vec::new);
        for lane in self.used.drain(..) {
            self.on_lane[lane.index()].clear();
        }
    }

    /// Adds a vehicle: on every lane that it covers.
    pub fn add(&mut self, vehicle: usize, route: &Route, (rear_s, front_s): (f64, f64), speed_mps: f64) {
        for index in route.index_at(rear_s)..=route.index_at(front_s) {
            let (lane, start_s) = (route.lanes()[index], route.lane_start(index));
            let on_lane = &mut self.on_lane[lane.index()];
            if on_lane.is_empty() {
                self.used.push(lane);
            }
            let (front_m, rear_m) = (front_s - start_s, rear_s - start_s);
            on_lane.push(LaneOccupant { vehicle, front_m, rear_m, speed_mps });
        }
    }

    /// The nearest vehicle ahead of a front bumper on a route.
    pub fn ahead(&self, own: usize, route: &Route, front_s: f64, speed_mps: f64) -> Option<Following> {
        let mut nearest: Option<Following> = None;
        for index in route.index_at(front_s)..route.lanes().len() {
            let start_s = route.lane_start(index);
            if start_s > front_s + SIGHT_M || nearest.is_some_and(|near| start_s > front_s + near.gap_m) {
                break;
            }
            for other in &self.on_lane[route.lanes()[index].index()] {
                let (gap_m, other_s) = (start_s + other.rear_m - front_s, start_s + other.front_m);
                let is_ahead = other_s > front_s || (other_s == front_s && other.vehicle < own);
                let is_nearer = nearest.is_none_or(|near| gap_m < near.gap_m);
                if other.vehicle != own && is_ahead && gap_m < SIGHT_M && is_nearer {
                    nearest = Some(Following { gap_m, speed_mps, leader_mps: other.speed_mps });
                }
            }
        }
        nearest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_decelerations_are_those_of_the_definitions() {
        let closing = Following { gap_m: 0.3, speed_mps: 0.35, leader_mps: 0.15 };
        assert!((closing.ttc_s().unwrap() - 1.5).abs() < 1e-12);
        assert!((closing.drac_mps2() - 0.04 / 0.6).abs() < 1e-12);
        let opening = Following { leader_mps: 0.36, ..closing };
        assert_eq!((opening.ttc_s(), opening.drac_mps2()), (None, 0.0));
        let touching = Following { gap_m: -0.01, ..closing };
        assert_eq!((touching.ttc_s(), touching.drac_mps2()), (Some(0.0), f64::INFINITY));
    }

    #[test]
    fn an_encounter_counts_once_until_it_is_over() {
        let mut safety = Safety::default();
        let near = Some(Following { gap_m: 0.3, speed_mps: 0.35, leader_mps: 0.15 });
        for following in [None, near, near, None, near] {
            safety.follow(following, DRAC_MPS2 / 25.0);
        }
        assert_eq!((safety.ttc_encounters, safety.drac_encounters), (2, 0));
        assert_eq!((safety.min_ttc_s.map(|s| (s * 1e6).round()), safety.min_gap_m), (Some(1.5e6), Some(0.3)));
        safety.touch();
        let touched = (safety.min_ttc_s, safety.min_gap_m, safety.max_drac_mps2);
        assert_eq!(touched, (Some(0.0), Some(0.0), f64::INFINITY));
        safety.encroach(2.5);
        safety.encroach(-0.5);
        assert_eq!((safety.pet_encounters, safety.min_pet_s), (1, Some(-0.5)));
    }
}
