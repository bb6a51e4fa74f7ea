//! Carries out setups of vehicles: validates them, and moves them back on their lane to free space.

use super::role::Act;
use super::{OwnedVehicle, PendingCommand, SenderNumber, ServerWorld};
use crate::scenario::{LARGEST_ID, is_topic_name, pose_on};
use city3d_geometry::{OrientedRect, Pose2, wrap_angle};
use city3d_protocol::snapshot::{BodyType, Dimensions, SimCommand, VehicleId, VehicleSpec};
use city3d_protocol::wire::{Body, MAX_DETAIL_BYTES, PERSON, RequestOutcome, VehicleBuild, VehicleSetup};
use city3d_roadmap::{CityMap, LaneId};
use std::collections::BTreeSet;

/// Limit of vehicles: more than any map has room for, and their poses fit in 255 parts.
const MAX_VEHICLES: usize = 2000;
/// Largest distance of a setup from the bounds of the map, city metres.
const AROUND_MAP_M: f64 = 25.0;
/// A vehicle is on a lane when its front axle is within this distance and its heading within this angle.
const ON_LANE_M: f64 = 2.5;
const ALONG_RAD: f64 = 0.8;
/// As for vehicles of a scenario: gap between bumpers, step of the search, its limit; city metres.
const GAP_M: f64 = 2.0;
const STEP_M: f64 = 0.25;
const FARTHEST_M: f64 = 400.0;

impl ServerWorld {
    pub(super) fn set_up(
        &mut self,
        sender: SenderNumber,
        now_s: f64,
        setup: VehicleSetup,
    ) -> (RequestOutcome, String) {
        if let Some(owned) = self.vehicles.get(&setup.id) {
            let (owner, name) = (owned.owner, owned.setup.name.clone());
            return self.take_over(sender, now_s, setup, owner, &name);
        }
        let is_guest = setup.controller == PERSON;
        if !is_guest {
            self.claim_lead(sender, now_s);
        }
        let act = Act::SetUp { has_room: self.has_room_for_guest(sender, now_s) };
        if !self.role(sender, None).may(act) {
            if is_guest {
                let why = "there is no room for a guest's car; city3d serve --guests N lets in N guests";
                return (RequestOutcome::Busy, why.to_owned());
            }
            return self
                .refuse_not_owner("leads the experiment; city3d serve --guests lets others set up vehicles");
        }
        match self.validate(setup) {
            Ok((setup, spec, detail)) => {
                self.remember(sender, now_s);
                let in_city = setup.in_city(self.experiment().scale, spec);
                self.vehicles.insert(setup.id, OwnedVehicle::new(sender, setup.clone()));
                self.queue_spawn(sender, setup, SimCommand::Spawn(Box::new(in_city)));
                (RequestOutcome::Done, detail)
            }
            Err(why) => (RequestOutcome::Refused, shortened(why)),
        }
    }

    fn queue_spawn(&mut self, sender: SenderNumber, setup: VehicleSetup, command: SimCommand) {
        self.push(PendingCommand {
            sender,
            body: Body::Setup { request: 0, setup: Box::new(setup) },
            command,
        });
    }

    /// Setup of a present vehicle: it stays where it is, and the last sender owns it.
    fn take_over(
        &mut self,
        sender: SenderNumber,
        now_s: f64,
        setup: VehicleSetup,
        owner: SenderNumber,
        name: &str,
    ) -> (RequestOutcome, String) {
        if name != setup.name {
            let why = format!("number {} belongs to \"{name}\"; choose another, or the same name", setup.id);
            return (RequestOutcome::Refused, shortened(why));
        }
        let act = Act::TakeOver { is_orphaned: self.has_timed_out(owner, now_s) };
        if !self.role(sender, self.vehicles.get(&setup.id)).may(act) {
            return self.refuse_not_owner(&format!("has set up vehicle {}", setup.id));
        }
        if setup.controller != PERSON {
            self.claim_lead(sender, now_s);
        }
        self.remember(sender, now_s);
        let spec = match self.spec_of(&setup) {
            Ok(spec) => spec,
            Err(why) => return (RequestOutcome::Refused, shortened(why)),
        };
        if let Some(owned) = self.vehicles.get_mut(&setup.id) {
            (owned.owner, owned.sequence, owned.drive_sequence) = (sender, None, None);
        }
        if owner != sender && self.driver(setup.id) == Some(owner) {
            self.release_lost(setup.id);
        }
        let command = SimCommand::Spawn(Box::new(setup.in_city(self.experiment().scale, spec)));
        self.queue_spawn(sender, setup, command);
        (RequestOutcome::Done, "the vehicle exists already and stays where it is".to_owned())
    }

    /// Whether fewer other senders than the rules allow have set up vehicles besides the leader.
    fn has_room_for_guest(&self, sender: SenderNumber, now_s: f64) -> bool {
        let leader = self.leader;
        let others = self.vehicles.values().map(|owned| owned.owner);
        let guests: BTreeSet<SenderNumber> = others
            .filter(|owner| Some(*owner) != leader && *owner != sender && !self.has_timed_out(*owner, now_s))
            .collect();
        guests.len() < self.rules.guests
    }

    fn spec_of(&self, setup: &VehicleSetup) -> Result<VehicleSpec, String> {
        let spec = setup.build.resolve(&self.experiment().vehicle_types)?;
        match spec.validate().first() {
            Some(error) => Err(error.to_string()),
            None => Ok(spec),
        }
    }

    /// Validates a setup: returns it as it is carried out, its specification, and a detail for the answer.
    fn validate(&self, mut setup: VehicleSetup) -> Result<(VehicleSetup, VehicleSpec, String), String> {
        if setup.id.0 == 0 || u64::from(setup.id.0) > LARGEST_ID {
            return Err(format!("number {}; it must be between 1 and {LARGEST_ID}", setup.id));
        }
        if !is_topic_name(&setup.name) {
            return Err("name: use at most 64 letters, digits and underscores, a letter first".to_owned());
        }
        if let Some((id, _)) = self.vehicles.iter().find(|(_, owned)| owned.setup.name == setup.name) {
            return Err(format!("the name \"{}\" belongs to vehicle {id}; choose another", setup.name));
        }
        if self.vehicles.len() >= MAX_VEHICLES {
            return Err(format!("there are {MAX_VEHICLES} vehicles already, and no room for more"));
        }
        let spec = self.spec_of(&setup)?;
        let experiment = self.experiment();
        if matches!(setup.appearance.body, BodyType::Own(_))
            && !experiment.models.vehicles.contains_key(&setup.appearance.body)
        {
            return Err("body: the city's scenario has no model of this number".to_owned());
        }
        let scale = experiment.scale;
        let pose = setup.pose.to_city(scale);
        let [low, high] = experiment.city_map.bounds();
        if pose.position.clamp(low - AROUND_MAP_M, high + AROUND_MAP_M) != pose.position {
            let [low, high] = [low, high].map(|corner| corner / scale.factor());
            return Err(format!(
                "x {}, y {} lies outside of the map, which reaches from {:.2}, {:.2} to {:.2}, {:.2} laboratory m",
                setup.pose.position.x, setup.pose.position.y, low.x, low.y, high.x, high.y
            ));
        }
        let mut detail = String::new();
        let outlines = self.outlines();
        if let Some(other) = overlapped(&outlines, &outline(&spec.dimensions, pose, 0.0)) {
            let free = |pose| overlapped(&outlines, &outline(&spec.dimensions, pose, GAP_M)).is_none();
            let (back, by_m) =
                free_pose_behind(&experiment.city_map, &spec.dimensions, pose, free).ok_or_else(|| {
                    format!(
                        "its place is taken by vehicle {other}, and the lane behind that one has no free place"
                    )
                })?;
            setup.pose = back.to_lab(scale);
            // Close behind another, nobody knows whether there is room to brake.
            setup.speed_mps = 0.0;
            detail =
                format!("its place is taken by vehicle {other}: it starts {by_m:.2} m (full scale) behind");
        }
        setup.build = VehicleBuild::Spec(Box::new(spec.clone()));
        Ok((setup, spec, detail))
    }

    /// Outlines of the present vehicles and of those that wait for the next tick.
    fn outlines(&self) -> Vec<(VehicleId, OrientedRect)> {
        let there = self.snapshot.iter().map(|(state, info)| (state.id, state.outline(&info.dimensions)));
        let coming = self.pending.iter().filter_map(|pending| match &pending.command {
            SimCommand::Spawn(setup) => Some((setup.id, outline(&setup.spec.dimensions, setup.pose, 0.0))),
            _ => None,
        });
        there.chain(coming).collect()
    }
}

/// Truncates a reason to what an answer holds.
fn shortened(mut why: String) -> String {
    while why.len() > MAX_DETAIL_BYTES {
        why.pop();
    }
    why
}

fn outline(size: &Dimensions, pose: Pose2, longer_m: f64) -> OrientedRect {
    OrientedRect::new(pose.advanced(longer_m / 2.0), size.length_m + longer_m, size.width_m)
}

fn overlapped(outlines: &[(VehicleId, OrientedRect)], outline: &OrientedRect) -> Option<VehicleId> {
    outlines.iter().find(|(_, other)| other.overlap(outline).is_some()).map(|(id, _)| *id)
}

/// The first free pose further back on the lane of a vehicle and its predecessors, and the distance.
fn free_pose_behind(
    map: &CityMap,
    size: &Dimensions,
    pose: Pose2,
    is_free: impl Fn(Pose2) -> bool,
) -> Option<(Pose2, f64)> {
    let axle = pose.point_at(size.front_axle_m(), 0.0);
    let under = |lane: &city3d_roadmap::Lane| {
        let foot = lane.curve.project(axle);
        let turn = wrap_angle(pose.yaw_rad - lane.curve.at(foot.s).pose.yaw_rad).abs();
        (foot.distance < ON_LANE_M && turn < ALONG_RAD).then_some((foot.distance, lane.id, foot.s))
    };
    let nearest = map.lanes.iter().filter_map(under).min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, mut lane, mut at_m): (f64, LaneId, f64) = nearest?;
    let mut by_m = 0.0;
    while by_m < FARTHEST_M {
        by_m += STEP_M;
        at_m -= STEP_M;
        if at_m < 0.0 {
            lane = *map.lane(lane).predecessors.first()?;
            at_m += map.lane(lane).curve.length();
        }
        let pose = pose_on(size, map, lane, at_m.max(0.0));
        if is_free(pose) {
            return Some((pose, by_m));
        }
    }
    None
}
