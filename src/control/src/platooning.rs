//! Platoons of the vehicles under control: who may join, in which order members decide, what they are told.

use super::coordination::platoon::{Candidate, PlatoonParams, PlatoonRole, Platoons};
use super::strangers::Strangers;
use super::traffic::{Leader, Occupancy};
use super::{Cav, PlatoonBroadcast};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::LabMap;

/// The platoons, and the order of decisions that they ask for.
#[derive(Debug)]
pub(super) struct Platooning {
    platoons: Platoons,
    candidates: Vec<Candidate>,
    /// Indices of the vehicles: by id, but members directly after their predecessors.
    order: Vec<usize>,
}

impl Platooning {
    pub fn new(params: PlatoonParams) -> Self {
        Self { platoons: Platoons::new(params), candidates: Vec::new(), order: Vec::new() }
    }

    pub fn platoons(&self) -> &Platoons {
        &self.platoons
    }

    pub fn set_params(&mut self, params: PlatoonParams) {
        self.platoons.set_params(params);
    }

    /// The vehicle that decides as number `place` of this step.
    pub fn decides_at(&self, place: usize) -> usize {
        self.order[place]
    }

    /// Forms and splits platoons. Members, and those who catch up with them, may drive faster than they would alone.
    pub fn update(
        &mut self,
        time_s: f64,
        map: &LabMap,
        cavs: &mut [Cav],
        occupancy: &Occupancy,
        strangers: &Strangers,
    ) {
        let params = *self.platoons.params();
        let within_m = params.catch_up_distance_m.max(params.max_gap_m);
        self.candidates.clear();
        for (index, cav) in cavs.iter().enumerate() {
            let may_join = cav.is_on_route() && !cav.is_lost() && !cav.is_finished() && cav.can_platoon();
            let leader = may_join.then(|| occupancy.leader(cavs, index, within_m)).flatten();
            let ahead = leader.filter(|leader| {
                let stranger = strangers.leader(cav, within_m);
                stranger.is_none_or(|stranger| stranger.gap_m > leader.ahead.gap_m)
            });
            let ahead = ahead.map(|leader| (leader.id, leader.ahead.gap_m));
            self.candidates.push(Candidate { vehicle: cav.id, may_join, ahead });
        }
        self.platoons.update(time_s, &self.candidates);
        for cav in cavs.iter_mut() {
            let factor = match self.platoons.role(cav.id) {
                PlatoonRole::Alone | PlatoonRole::Leader => 1.0,
                PlatoonRole::Follower { .. } | PlatoonRole::CatchUp { .. } => params.catch_up_speed_factor,
            };
            cav.set_speed_factor(map, factor);
        }
        self.order.clear();
        let mut platoons = self.platoons.platoons().iter().peekable();
        for (index, cav) in cavs.iter().enumerate() {
            if let Some(members) = platoons.next_if(|members| members[0] == cav.id) {
                self.order.extend(members.iter().filter_map(|member| index_of(cavs, *member)));
            } else if !matches!(self.platoons.role(cav.id), PlatoonRole::Follower { .. }) {
                self.order.push(index);
            }
        }
    }

    /// What a member is told, if the vehicle ahead is its predecessor.
    pub fn broadcast(&self, cavs: &[Cav], own: usize, ahead: &Leader) -> Option<PlatoonBroadcast> {
        let PlatoonRole::Follower { predecessor, leader } = self.platoons.role(cavs[own].id) else {
            return None;
        };
        let before = &cavs[ahead.vehicle];
        if before.id != predecessor {
            return None;
        }
        let leader = &cavs[index_of(cavs, leader)?];
        let params = self.platoons.params();
        Some(PlatoonBroadcast {
            predecessor: ahead.ahead,
            predecessor_mps2: before.plan.acceleration_mps2,
            leader_mps: leader.speed_mps(),
            leader_mps2: leader.plan.acceleration_mps2,
            spacing_m: params.spacing_m,
            headway_s: params.headway_s,
        })
    }
}

fn index_of(cavs: &[Cav], id: VehicleId) -> Option<usize> {
    cavs.binary_search_by_key(&id, |cav| cav.id).ok()
}
