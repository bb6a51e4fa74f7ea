//! Platoons: vehicles that follow one another with what they tell one another. Who leads, joins at the back, catches up
//! and is split off.
//!
//! The states and parameters are those of Simpla, the platooning of SUMO (<https://sumo.dlr.de/docs/Simpla.html>), with
//! its lengths divided by 25. How a member keeps its gap is a [`Controller`](crate::Controller) such as `cacc` or `ploeg`.

use city3d_protocol::snapshot::VehicleId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Parameters of platoons, laboratory units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlatoonParams {
    /// Vehicles of the longest platoon (`maxVehicles`).
    pub max_vehicles: usize,
    /// Gap below which a vehicle joins, and above which it is split off after a time (`maxPlatoonGap`, 15 m).
    pub max_gap_m: f64,
    /// Gap below which a vehicle catches up with a platoon ahead (`catchupDist`, 50 m).
    pub catch_up_distance_m: f64,
    /// Share of its desired speed that a vehicle drives while it catches up (`speedFactor` of `catchup`).
    pub catch_up_speed_factor: f64,
    /// Time above the largest gap after which a member is split off (`platoonSplitTime`).
    pub split_time_s: f64,
    /// Constant spacing that CACC keeps between bumpers (Plexe `caccSpacing`, 5 m).
    pub spacing_m: f64,
    /// Time headway that Ploeg's controller keeps above the gap at standstill (Plexe `ploegH`).
    pub headway_s: f64,
}

impl Default for PlatoonParams {
    /// Those of Simpla and Plexe. Simpla leaves the speed factors to its user; its examples catch up with 1.2.
    fn default() -> Self {
        Self {
            max_vehicles: 8,
            max_gap_m: 0.6,
            catch_up_distance_m: 2.0,
            catch_up_speed_factor: 1.2,
            split_time_s: 3.0,
            spacing_m: 0.2,
            headway_s: 0.5,
        }
    }
}

/// What platoons are formed from: a vehicle, and the next one on its path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Id of the vehicle.
    pub vehicle: VehicleId,
    /// Whether it may be in a platoon now: its controller can, and it is seen.
    pub may_join: bool,
    /// The next vehicle on its path, whoever drives it, and the gap between bumpers.
    pub ahead: Option<(VehicleId, f64)>,
}

/// What a vehicle is to its platoon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlatoonRole {
    /// In no platoon.
    #[default]
    Alone,
    /// Its first vehicle.
    Leader,
    /// Behind its predecessor.
    Follower {
        /// The member ahead.
        predecessor: VehicleId,
        /// The first member.
        leader: VehicleId,
    },
    /// Behind a platoon or a vehicle that it will join, alone or with its followers.
    CatchUp {
        /// The last member ahead.
        target: VehicleId,
    },
}

/// Following of a member.
#[derive(Clone, Copy, Debug)]
struct Link {
    predecessor: VehicleId,
    /// Since when the gap has been too large.
    apart_since_s: Option<f64>,
}

/// The platoons of a city.
///
/// ```
/// use city3d_control::coordination::platoon::{Candidate, PlatoonParams, PlatoonRole, Platoons};
/// use city3d_protocol::snapshot::VehicleId;
///
/// let (first, second) = (VehicleId(1), VehicleId(2));
/// let mut platoons = Platoons::new(PlatoonParams::default());
/// platoons.update(0.0, &[
///     Candidate { vehicle: first, may_join: true, ahead: None },
///     Candidate { vehicle: second, may_join: true, ahead: Some((first, 0.4)) },
/// ]);
/// assert_eq!(platoons.role(first), PlatoonRole::Leader);
/// assert_eq!(platoons.role(second), PlatoonRole::Follower { predecessor: first, leader: first });
/// ```
#[derive(Clone, Debug)]
pub struct Platoons {
    params: PlatoonParams,
    /// By follower.
    links: BTreeMap<VehicleId, Link>,
    roles: BTreeMap<VehicleId, PlatoonRole>,
    /// Members from front to back; platoons by the id of their leader.
    platoons: Vec<Vec<VehicleId>>,
    joins: u64,
    splits: u64,
}

impl Platoons {
    /// No platoons yet.
    pub fn new(params: PlatoonParams) -> Self {
        Self {
            params,
            links: BTreeMap::new(),
            roles: BTreeMap::new(),
            platoons: Vec::new(),
            joins: 0,
            splits: 0,
        }
    }

    /// The parameters.
    pub fn params(&self) -> &PlatoonParams {
        &self.params
    }

    /// Other parameters from now on. Platoons that are too long for them are split at the next update.
    pub fn set_params(&mut self, params: PlatoonParams) {
        self.params = params;
    }

    /// The role of a vehicle.
    pub fn role(&self, vehicle: VehicleId) -> PlatoonRole {
        self.roles.get(&vehicle).copied().unwrap_or_default()
    }

    /// The platoons by the ids of their leaders, each with its members from front to back.
    pub fn platoons(&self) -> &[Vec<VehicleId>] {
        &self.platoons
    }

    /// How often a vehicle, or a platoon, has joined one ahead.
    pub fn joins(&self) -> u64 {
        self.joins
    }

    /// How often a member has been split off from its predecessor.
    pub fn splits(&self) -> u64 {
        self.splits
    }

    /// Splits, joins and catches up, for vehicles in id order.
    ///
    /// A member is split off at once when the next vehicle on its path is not its predecessor, for what it is told is of
    /// another one then, and after `split_time_s` when its gap is too large. Whoever is split off leads those behind it.
    pub fn update(&mut self, now_s: f64, candidates: &[Candidate]) {
        let mut chains = Chains::new(candidates);
        self.keep(now_s, candidates, &mut chains);
        self.roles.clear();
        for (index, own) in candidates.iter().enumerate().filter(|(_, own)| own.may_join) {
            if chains.ahead[index].is_some() {
                continue;
            }
            let Some((target, gap_m)) = self.target(candidates, &chains, index) else { continue };
            if gap_m <= self.params.max_gap_m {
                let predecessor = candidates[target].vehicle;
                chains.link(target, index);
                self.links.insert(own.vehicle, Link { predecessor, apart_since_s: None });
                self.joins += 1;
            } else {
                let target = candidates[target].vehicle;
                self.roles.insert(own.vehicle, PlatoonRole::CatchUp { target });
            }
        }
        self.tell(candidates, &chains);
    }

    /// Keeps the links that hold.
    fn keep(&mut self, now_s: f64, candidates: &[Candidate], chains: &mut Chains) {
        let params = self.params;
        let before = self.links.len();
        self.links.retain(|follower, link| {
            let Some(index) = index_of(candidates, *follower) else { return false };
            let own = &candidates[index];
            let Some((ahead, gap_m)) = own.ahead.filter(|(ahead, _)| *ahead == link.predecessor) else {
                return false;
            };
            let Some(predecessor) = index_of(candidates, ahead) else { return false };
            if !own.may_join || !candidates[predecessor].may_join {
                return false;
            }
            link.apart_since_s = (gap_m > params.max_gap_m).then(|| link.apart_since_s.unwrap_or(now_s));
            if link.apart_since_s.is_some_and(|since_s| now_s - since_s >= params.split_time_s) {
                return false;
            }
            chains.link(predecessor, index);
            true
        });
        for leader in 0..candidates.len() {
            if chains.ahead[leader].is_some() {
                continue;
            }
            let mut first = leader;
            loop {
                let first_too_many = chains.members(first).nth(params.max_vehicles.max(1));
                let Some(next) = first_too_many else { break };
                chains.unlink(next);
                self.links.remove(&candidates[next].vehicle);
                first = next;
            }
        }
        self.splits += (before - self.links.len()) as u64;
    }

    /// The last member of a platoon that a leader may join, and the gap to it.
    fn target(&self, candidates: &[Candidate], chains: &Chains, leader: usize) -> Option<(usize, f64)> {
        let (ahead, gap_m) = candidates[leader].ahead?;
        let target = index_of(candidates, ahead)?;
        if gap_m > self.params.catch_up_distance_m.max(self.params.max_gap_m)
            || !candidates[target].may_join
            || chains.behind[target].is_some()
        {
            return None;
        }
        // On a ring the vehicle ahead may be the own last one.
        let is_own = chains.members(leader).any(|member| member == target);
        let vehicles = chains.members(leader).count() + chains.up_to(target);
        (!is_own && vehicles <= self.params.max_vehicles).then_some((target, gap_m))
    }

    fn tell(&mut self, candidates: &[Candidate], chains: &Chains) {
        self.platoons.clear();
        for leader in 0..candidates.len() {
            if chains.ahead[leader].is_some() || chains.behind[leader].is_none() {
                continue;
            }
            let members: Vec<VehicleId> =
                chains.members(leader).map(|index| candidates[index].vehicle).collect();
            for pair in members.windows(2) {
                let role = PlatoonRole::Follower { predecessor: pair[0], leader: members[0] };
                self.roles.insert(pair[1], role);
            }
            self.roles.entry(members[0]).or_insert(PlatoonRole::Leader);
            self.platoons.push(members);
        }
    }
}

fn index_of(candidates: &[Candidate], vehicle: VehicleId) -> Option<usize> {
    candidates.binary_search_by_key(&vehicle, |candidate| candidate.vehicle).ok()
}

/// Who follows whom, by index in the list of candidates.
struct Chains {
    ahead: Vec<Option<usize>>,
    behind: Vec<Option<usize>>,
}

impl Chains {
    fn new(candidates: &[Candidate]) -> Self {
        Self { ahead: vec![None; candidates.len()], behind: vec![None; candidates.len()] }
    }

    fn link(&mut self, predecessor: usize, follower: usize) {
        self.ahead[follower] = Some(predecessor);
        self.behind[predecessor] = Some(follower);
    }

    fn unlink(&mut self, follower: usize) {
        if let Some(predecessor) = self.ahead[follower].take() {
            self.behind[predecessor] = None;
        }
    }

    /// From one vehicle to the last behind it.
    fn members(&self, first: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(first), |&index| self.behind[index])
    }

    /// Number of vehicles from the leader to this one.
    fn up_to(&self, member: usize) -> usize {
        std::iter::successors(Some(member), |&index| self.ahead[index]).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(number: u32) -> VehicleId {
        VehicleId(number)
    }

    /// Vehicles in a row from front to back, each with the gap to the one before it.
    fn row(gaps_m: &[(u32, f64)]) -> Vec<Candidate> {
        let mut ahead = None;
        let mut row = Vec::new();
        for &(number, gap_m) in gaps_m {
            row.push(Candidate {
                vehicle: id(number),
                may_join: true,
                ahead: ahead.map(|ahead| (ahead, gap_m)),
            });
            ahead = Some(id(number));
        }
        row.sort_by_key(|candidate| candidate.vehicle);
        row
    }

    fn formed(platoons: &Platoons) -> Vec<Vec<u32>> {
        platoons.platoons().iter().map(|members| members.iter().map(|id| id.0).collect()).collect()
    }

    #[test]
    fn platoons_are_in_the_order_of_the_road_and_no_longer_than_allowed() {
        let mut platoons = Platoons::new(PlatoonParams { max_vehicles: 3, ..PlatoonParams::default() });
        let road = row(&[(5, 9.0), (2, 0.3), (7, 0.3), (1, 0.3), (3, 0.3)]);
        // A vehicle joins in each step at least; later steps change nothing.
        platoons.update(0.0, &road);
        platoons.update(0.02, &road);
        let sizes: Vec<usize> = platoons.platoons().iter().map(Vec::len).collect();
        assert!(sizes.iter().all(|size| (2..=3).contains(size)), "{sizes:?}");
        let (before, joins) = (formed(&platoons), platoons.joins());
        platoons.update(0.04, &road);
        assert_eq!((formed(&platoons), platoons.joins()), (before.clone(), joins));
        for platoon in &before {
            let order = [5, 2, 7, 1, 3];
            let places: Vec<_> = platoon.iter().map(|n| order.iter().position(|o| o == n).unwrap()).collect();
            assert!(places.windows(2).all(|pair| pair[1] == pair[0] + 1), "{platoon:?}");
        }
        // A shorter limit splits them.
        platoons.set_params(PlatoonParams { max_vehicles: 2, ..*platoons.params() });
        platoons.update(0.06, &road);
        assert!(platoons.platoons().iter().all(|members| members.len() == 2), "{:?}", formed(&platoons));
    }

    #[test]
    fn a_vehicle_far_behind_catches_up_and_then_joins_at_the_back() {
        let mut platoons = Platoons::new(PlatoonParams::default());
        platoons.update(0.0, &row(&[(1, 0.0), (2, 0.2), (3, 2.5)]));
        assert_eq!((formed(&platoons), platoons.role(id(3))), (vec![vec![1, 2]], PlatoonRole::Alone));
        platoons.update(1.0, &row(&[(1, 0.0), (2, 0.2), (3, 1.5)]));
        assert_eq!(platoons.role(id(3)), PlatoonRole::CatchUp { target: id(2) });
        platoons.update(2.0, &row(&[(1, 0.0), (2, 0.2), (3, 0.6)]));
        assert_eq!(formed(&platoons), [[1, 2, 3]]);
        assert_eq!(platoons.role(id(3)), PlatoonRole::Follower { predecessor: id(2), leader: id(1) });
        assert_eq!((platoons.joins(), platoons.splits()), (2, 0));
    }

    #[test]
    fn a_gap_splits_after_its_time_and_not_if_it_closes_before() {
        let mut platoons = Platoons::new(PlatoonParams::default());
        let (near, far) = (row(&[(1, 0.0), (2, 0.3), (3, 0.3)]), row(&[(1, 0.0), (2, 0.8), (3, 0.3)]));
        for (time_s, road) in [(0.0, &near), (1.0, &far), (3.9, &far), (4.0, &near), (5.0, &far), (7.9, &far)]
        {
            platoons.update(time_s, road);
            assert_eq!(formed(&platoons), [[1, 2, 3]], "{time_s}");
        }
        platoons.update(8.0, &far);
        // The second one leads the third one, and is catching up again.
        assert_eq!(formed(&platoons), [[2, 3]]);
        assert_eq!(platoons.role(id(2)), PlatoonRole::CatchUp { target: id(1) });
        assert_eq!(platoons.splits(), 1);
    }

    #[test]
    fn another_vehicle_between_splits_at_once_and_so_does_one_that_may_not_join() {
        let road = row(&[(1, 0.0), (2, 0.3), (3, 0.3)]);
        let mut platoons = Platoons::new(PlatoonParams::default());
        platoons.update(0.0, &road);
        let mut cut_in = road.clone();
        cut_in[1].ahead = Some((id(9), 0.1));
        platoons.update(0.02, &cut_in);
        assert_eq!((formed(&platoons), platoons.role(id(1))), (vec![vec![2, 3]], PlatoonRole::Alone));
        platoons.update(0.04, &road);
        assert_eq!(formed(&platoons), [[1, 2, 3]]);
        let mut unseen = road.clone();
        unseen[1].may_join = false;
        platoons.update(0.06, &unseen);
        assert_eq!(formed(&platoons), Vec::<Vec<u32>>::new());
        // A member that has left the city.
        platoons.update(0.08, &road);
        platoons.update(0.1, &road[..1]);
        assert_eq!(platoons.role(id(1)), PlatoonRole::Alone);
    }

    #[test]
    fn on_a_ring_somebody_leads() {
        let ring: Vec<_> = (1..=4)
            .map(|n| Candidate { vehicle: id(n), may_join: true, ahead: Some((id(n % 4 + 1), 0.3)) })
            .collect();
        let mut platoons = Platoons::new(PlatoonParams::default());
        for step in 0..3 {
            platoons.update(f64::from(step), &ring);
        }
        assert_eq!(platoons.platoons().len(), 1);
        assert_eq!(platoons.platoons()[0].len(), 4);
        assert_eq!(platoons.joins(), 3);
    }
}
