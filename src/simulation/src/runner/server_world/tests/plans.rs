//! Who may tell plans of whom, and for how long they hold.

use super::{GUEST, LEADER, LED, OWN, PHYSICAL, STRANGER, city, operate};
use crate::runner::{HeldControl, ServerWorld};
use city3d_geometry::lab::Pose2;
use city3d_geometry::{City, Lab, LengthScale};
use city3d_protocol::snapshot::{
    CoordinationUpdate, NoPlan, PlanPoint, PlannedPassage, VehicleId, ZoneCounts, ZoneState, ZoneVehicle,
};
use city3d_protocol::wire::{Body, DropReason, ExperimentAction, Plans};

type Update = CoordinationUpdate<Lab>;

fn tell(world: &mut ServerWorld, sender: u32, time_s: f64, update: Update) -> Vec<DropReason> {
    let told = Body::Plans(Plans { time_s, update });
    assert_eq!(world.take(sender, 0.0, told), None, "plans are not acknowledged");
    world.drain_dropped().collect()
}

fn zone(plans: u64) -> Update {
    let counts = ZoneCounts { plans, ..ZoneCounts::default() };
    Update { zones: vec![ZoneState { number: 3, name: "west".to_owned(), counts }], ..Update::default() }
}

/// A vehicle with a plan that begins now.
fn planned(id: VehicleId, now_s: f64) -> Update {
    let point = PlanPoint { time_s: now_s, pose: Pose2::new(1.0, -2.0, 0.5), speed_mps: 0.25 };
    let plan = PlannedPassage {
        enters_s: now_s + 2.0,
        leaves_s: now_s + 4.0,
        entry: Pose2::new(1.5, -2.0, 0.5),
        motion: vec![point],
    };
    let vehicle = ZoneVehicle { id, zone: 3, entered_s: 0.0, is_standing: false, plan: Ok(plan) };
    Update { vehicles: vec![vehicle], ..Update::default() }
}

fn left(id: VehicleId) -> Update {
    Update { left: vec![id], ..Update::default() }
}

/// A city whose clock runs, and its time.
fn running() -> (ServerWorld, f64) {
    let mut world = city();
    operate(&mut world, ExperimentAction::Start);
    world.tick();
    let now_s = world.snapshot().time_s;
    (world, now_s)
}

#[test]
fn owners_tell_plans_of_their_vehicles_and_the_leader_of_zones() {
    let (mut world, now_s) = running();
    let before = world.snapshot().state_hash;
    let without = |id| {
        let mut update = planned(id, now_s);
        update.vehicles[0].plan = Err(NoPlan::NotCoordinated);
        update
    };
    assert_eq!(tell(&mut world, LEADER, now_s, zone(5)), []);
    assert_eq!(tell(&mut world, LEADER, now_s, planned(LED, now_s)), []);
    assert_eq!(tell(&mut world, GUEST, now_s, without(OWN)), []);
    assert_eq!(tell(&mut world, GUEST, now_s, zone(9)), [DropReason::NotYours]);
    assert_eq!(tell(&mut world, STRANGER, now_s, without(LED)), [DropReason::NotYours]);
    assert_eq!(tell(&mut world, STRANGER, now_s, left(LED)), [DropReason::NotYours]);
    assert_eq!(tell(&mut world, LEADER, now_s, without(PHYSICAL)), [DropReason::NotYours]);
    let unknown = VehicleId(77);
    assert_eq!(tell(&mut world, LEADER, now_s, without(unknown)), [DropReason::UnknownVehicle]);
    assert_eq!(tell(&mut world, LEADER, now_s, left(unknown)), [DropReason::UnknownVehicle]);
    let told = world.heard().plans.at(now_s).unwrap();
    assert_eq!(told.zones, zone(5).zones);
    assert_eq!(told.vehicles.iter().map(|vehicle| vehicle.id).collect::<Vec<_>>(), [LED, OWN]);
    let point = told.vehicles[0].plan.as_ref().unwrap().motion[0];
    assert_eq!(point.pose, city3d_geometry::Pose2::<City>::new(25.0, -50.0, 0.5), "full scale");
    assert_eq!(point.speed_mps, LengthScale::TESTBED.city_from_lab(0.25));
    assert_eq!(told.vehicles[1].plan, Err(NoPlan::NotCoordinated));
    // They are shown to people, and nothing else.
    assert!(!world.has_pending());
    assert_eq!(world.snapshot().state_hash, before);
}

#[test]
fn plans_hold_for_a_while_and_what_comes_late_is_dropped() {
    let (mut world, now_s) = running();
    let vehicles = |world: &ServerWorld| {
        let told = world.heard().plans.at(world.snapshot().time_s);
        told.map_or(0, |told| told.vehicles.len())
    };
    assert_eq!(tell(&mut world, LEADER, now_s + 0.6, planned(LED, now_s)), [DropReason::Ahead]);
    assert_eq!(tell(&mut world, LEADER, now_s, planned(LED, now_s)), []);
    (0..215).for_each(|_| _ = world.tick());
    assert_eq!(vehicles(&world), 1);
    (0..10).for_each(|_| _ = world.tick());
    assert_eq!(vehicles(&world), 0, "it was told too long ago");
    assert_eq!(world.heard(), &HeldControl::default(), "nothing is kept of it");
    let now_s = world.snapshot().time_s;
    assert_eq!(tell(&mut world, LEADER, 0.0, planned(LED, 0.0)), [DropReason::Stale]);
    assert_eq!(tell(&mut world, LEADER, now_s, planned(LED, now_s)), []);
    assert_eq!(tell(&mut world, LEADER, now_s, left(LED)), []);
    assert_eq!(tell(&mut world, LEADER, now_s - 0.5, planned(LED, now_s)), [DropReason::Reordered]);
    assert_eq!(vehicles(&world), 0, "it has left");
    // A vehicle that is removed, and a reset.
    assert_eq!(tell(&mut world, LEADER, now_s, planned(LED, now_s)), []);
    assert_eq!(vehicles(&world), 1);
    world.take(LEADER, 0.0, Body::Remove { request: 9, vehicle: LED }).unwrap();
    assert_eq!(vehicles(&world), 0);
    assert_eq!(tell(&mut world, LEADER, now_s, zone(5)), []);
    operate(&mut world, ExperimentAction::Reset);
    world.tick();
    assert_eq!(world.heard(), &HeldControl::default());
}
