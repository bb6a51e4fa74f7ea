//! One physics step of the world.
//!
//! A vehicle that is near no other goes through all of its step at once, while it is in the processor's cache: it takes its
//! trajectory, decides, moves and describes itself. For the others the physics moves the bodies in between.

use super::collision::{Collisions, Place};
use super::vehicle::SimVehicle;
use super::{World, WorldState, describe_vehicles};
use city3d_dynamics::physics::{Impetus, Physics};
use city3d_geometry::digest::StateHash;
use city3d_protocol::snapshot::{Event, EventKind, FrameSnapshot, Trajectory};
use city3d_workers::{prefetch, prefetch_slice};
use std::ops::Range;

/// What lasts for a step: not state.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers {
    /// By vehicle.
    places: Vec<Place>,
    /// By vehicle.
    sequels: Vec<Sequel>,
    /// Whether all bodies stay in the physics, in tests.
    pub(super) holds_all: bool,
}

/// What few vehicles have of a step: events, or a body in the physics.
type Sequel = Option<Box<StepSequel>>;

#[derive(Clone, Debug)]
struct StepSequel {
    /// Whether all of its step is done.
    is_over: bool,
    impetus: Option<Impetus>,
    /// Before and after the physics.
    events: [Vec<Event>; 2],
}

/// Times of a step, seconds.
#[derive(Clone, Copy)]
struct StepTimes {
    before_s: f64,
    after_s: f64,
    dt_s: f64,
    link_timeout_s: f64,
}

impl World {
    /// Advances by one physics step; vehicles begin it with their trajectories, which are in the order of ids. Writes events and
    /// vehicles into a snapshot, and returns the digest of the vehicles.
    pub(super) fn step(&mut self, trajectories: &[&Trajectory], out: &mut FrameSnapshot) -> StateHash {
        let Self { experiment, state, buffers, solids, .. } = self;
        let (rates, workers) = (&experiment.rates, &experiment.workers);
        let times = StepTimes {
            before_s: rates.time_s(state.tick),
            after_s: rates.time_s(state.tick + 1),
            dt_s: rates.dt_s(),
            link_timeout_s: experiment.link_timeout_s,
        };
        state.tick += 1;
        let WorldState { tick, physics, vehicles, collisions, .. } = state;
        let FrameSnapshot { events, vehicles: states, .. } = out;
        let Buffers { places, sequels, .. } = buffers;
        sequels.clear();
        sequels.resize_with(vehicles.len(), || None);
        let before = &*collisions;
        places.resize(vehicles.len(), Place::default());
        let beginning = Beginning { physics, trajectories, times, contacts: before };
        workers.each_group_of_three((vehicles, places, sequels), |first, vehicles, places, sequels| {
            beginning.begin(first, vehicles, places, sequels);
        });

        let of_few =
            |((vehicle, place), sequel)| Sequel::as_mut(sequel).map(|sequel| (vehicle, place, sequel));
        let mut few: Vec<(&mut SimVehicle, &mut Place, &mut Box<StepSequel>)> =
            vehicles.iter_mut().zip(&mut *places).zip(sequels).filter_map(of_few).collect();
        for (vehicle, _, sequel) in &mut few {
            if let Some(impetus) = sequel.impetus.as_ref().filter(|_| !sequel.is_over) {
                vehicle.hold_if(true, physics);
                physics.impel(vehicle.body(), impetus);
            }
            events.append(&mut sequel.events[0]);
        }
        physics.step();
        workers.each(&mut few, |_, (vehicle, place, sequel)| {
            if !sequel.is_over {
                vehicle.read_back(physics, (times.after_s, times.dt_s), before, &mut sequel.events[1]);
                **place = vehicle.place(times.dt_s);
            }
        });
        few.iter_mut().for_each(|(_, _, sequel)| events.append(&mut sequel.events[1]));

        let first = events.len();
        // A digest is a chain of multiplications that wait for each other: it is made while collisions are looked for.
        let ((), mut hash) = workers.both(
            || collisions.find((vehicles, places), solids, times.after_s, events),
            || describe_vehicles(*tick, (vehicles, physics), states),
        );
        let collided = &events[first..];
        if !collided.is_empty() {
            note_collisions(collided, vehicles);
            hash = describe_vehicles(*tick, (vehicles, physics), states);
        }
        for (vehicle, place) in vehicles.iter_mut().zip(&*places) {
            let is_near = place.is_near || buffers.holds_all;
            if is_near != place.is_held {
                vehicle.hold_if(is_near, physics);
            }
        }
        hash
    }
}

fn note_collisions(collided: &[Event], vehicles: &mut [SimVehicle]) {
    for event in collided {
        for vehicle in &mut *vehicles {
            let is_hit = matches!(event.kind, EventKind::Collision { with } if with == vehicle.state.id);
            if is_hit || event.vehicle == vehicle.state.id {
                vehicle.collide();
            }
        }
    }
}

/// So many bodies move side by side.
const SIDE_BY_SIDE: usize = 4;
/// So many vehicles before its turn a vehicle's path and trajectory are asked for, which its own memory leads to.
const PLANS_AHEAD: usize = 8;

/// The part of a step before the physics, which is all of it for vehicles whose bodies are free.
struct Beginning<'s> {
    physics: &'s Physics,
    /// In the order of ids.
    trajectories: &'s [&'s Trajectory],
    times: StepTimes,
    contacts: &'s Collisions,
}

impl Beginning<'_> {
    /// Of neighbours in the list of vehicles, the first of which has an index. What a vehicle reads is fetched while the ones
    /// before it are worked on: of thousands none is at hand.
    fn begin(&self, first: usize, vehicles: &mut [SimVehicle], places: &mut [Place], sequels: &mut [Sequel]) {
        self.fetch(first, vehicles, 0..PLANS_AHEAD);
        let mut index = first;
        let (mut places, mut sequels) = (places.chunks_mut(SIDE_BY_SIDE), sequels.chunks_mut(SIDE_BY_SIDE));
        let mut rest = vehicles;
        while let (Some(places), Some(sequels)) = (places.next(), sequels.next()) {
            self.fetch(index, rest, PLANS_AHEAD..PLANS_AHEAD + SIDE_BY_SIDE);
            let (group, next) = rest.split_at_mut(places.len());
            self.begin_side_by_side(index, group, places, sequels);
            (index, rest) = (index + places.len(), next);
        }
    }

    /// Asks for the plans of the vehicles at these places, the first of which has an index, and for the vehicles themselves that
    /// far again beyond them.
    fn fetch(&self, first: usize, vehicles: &[SimVehicle], places: Range<usize>) {
        for place in places {
            let beyond = place + PLANS_AHEAD;
            if beyond < vehicles.len() {
                prefetch(&vehicles[beyond]);
                // With one for each vehicle, it is its own.
                self.trajectories.get(first + beyond).into_iter().for_each(|own| prefetch(*own));
            }
            let Some(vehicle) = vehicles.get(place) else { continue };
            let own = self.trajectories.get(first + place);
            vehicle.fetch(own.is_some());
            own.into_iter().for_each(|own| prefetch_slice(&own.points));
        }
    }

    /// Of at most [`SIDE_BY_SIDE`].
    fn begin_side_by_side(
        &self,
        first: usize,
        vehicles: &mut [SimVehicle],
        places: &mut [Place],
        sequels: &mut [Sequel],
    ) {
        let StepTimes { before_s, after_s, dt_s, link_timeout_s } = self.times;
        let mut events: [[Vec<Event>; 2]; SIDE_BY_SIDE] = Default::default();
        let mut impetus = [None; SIDE_BY_SIDE];
        for (k, vehicle) in vehicles.iter_mut().enumerate() {
            follow_own((first + k, vehicle), self.trajectories, before_s, link_timeout_s);
            impetus[k] = vehicle.actuate(self.physics, before_s, dt_s, link_timeout_s, &mut events[k][0]);
        }
        let mut bodies = vehicles.iter_mut().zip(&impetus);
        let is_over = self.physics.advance(std::array::from_fn::<_, SIDE_BY_SIDE, _>(|_| {
            let (vehicle, impetus) = bodies.next()?;
            vehicle.free_body_mut().zip(*impetus)
        }));
        for (k, ((vehicle, place), sequel)) in vehicles.iter_mut().zip(places).zip(sequels).enumerate() {
            if is_over[k] {
                vehicle.read_back(self.physics, (after_s, dt_s), self.contacts, &mut events[k][1]);
                *place = vehicle.place(dt_s);
            }
            if !is_over[k] || events[k].iter().any(|events| !events.is_empty()) {
                let events = std::mem::take(&mut events[k]);
                *sequel = Some(Box::new(StepSequel { is_over: is_over[k], impetus: impetus[k], events }));
            }
        }
    }
}

/// Gives the vehicle at an index its own of many trajectories, which are in the order of ids.
pub(super) fn follow_own(
    (index, vehicle): (usize, &mut SimVehicle),
    trajectories: &[&Trajectory],
    time_s: f64,
    timeout_s: f64,
) {
    let id = vehicle.state.id;
    // As a rule each vehicle has one.
    let is_before = |trajectory: &&Trajectory| trajectory.vehicle < id;
    let is_there = index <= trajectories.len()
        && trajectories[..index].last().is_none_or(is_before)
        && trajectories.get(index).is_none_or(|trajectory| !is_before(trajectory));
    let first = if is_there { index } else { trajectories.partition_point(is_before) };
    for trajectory in trajectories[first..].iter().take_while(|trajectory| trajectory.vehicle == id) {
        vehicle.follow(trajectory, time_s, timeout_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Library, Overrides, read_experiment};
    use city3d_protocol::snapshot::{ModelKind, Pedals, SimCommand, VehicleId};
    use std::sync::Arc;

    fn world(scenario: &str, model: ModelKind) -> World {
        let (text, library) = Library::scenario(scenario).unwrap();
        let overrides = Overrides { model: Some(model), ..Overrides::default() };
        World::new(Arc::new(read_experiment(scenario, &text, &library, overrides).unwrap()))
    }

    /// Vehicles in all hands, that run into each other and into houses and go on.
    fn wild_drives(tick: u64, ids: &[VehicleId]) -> Vec<SimCommand> {
        let mut state = tick + 1;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / (1_u64 << 31) as f64
        };
        let pedals = |random: &mut dyn FnMut() -> f64| Pedals {
            gas: random(),
            brake: (2.0 * random() - 1.3).max(0.0),
            steering_rad: random() - 0.5,
            reverse: random() < 0.3,
            ..Pedals::default()
        };
        let mut ids = ids.to_vec();
        ids.sort();
        ids.iter().map(|id| SimCommand::Drive(*id, pedals(&mut random))).collect()
    }

    /// Where a body has several contacts at once, the solver takes them in the order of its pairs' history, and the last bits
    /// can be others: these drives have collisions one by one.
    #[test]
    fn vehicles_that_move_by_themselves_have_the_bits_of_those_in_the_physics() {
        for (scenario, model, ticks, hit) in [
            ("city", ModelKind::Raycast, 1800, 60),
            ("student", ModelKind::Raycast, 3000, 5),
            ("city", ModelKind::Bicycle, 3000, 60),
        ] {
            let mut worlds = [world(scenario, model), world(scenario, model)];
            worlds[1].buffers.holds_all = true;
            let ids: Vec<_> = worlds[0].snapshot().vehicles.iter().map(|vehicle| vehicle.id).collect();
            let mut shots = [FrameSnapshot::default(), FrameSnapshot::default()];
            let (mut collisions, mut free) = (0, 0);
            for tick in 0..ticks {
                let mut commands = Vec::new();
                if tick == 0 {
                    commands.push(SimCommand::Start);
                }
                if tick % 150 == 0 {
                    commands.extend(wild_drives(tick, &ids));
                }
                for (world, shot) in worlds.iter_mut().zip(&mut shots) {
                    world.tick_into(&commands, shot);
                }
                let [one, other] = &shots;
                assert_eq!(one.state_hash, other.state_hash, "{scenario}, {model:?}: tick {tick}");
                assert_eq!(one.events, other.events);
                collisions += one.events.iter().filter(|event| event.kind.is_collision()).count();
                free += worlds[0].state.vehicles.iter().filter(|vehicle| vehicle.is_free()).count();
            }
            assert!(collisions >= hit, "{scenario}, {model:?}: {collisions}");
            let share = free as f64 / (ticks as f64 * ids.len() as f64);
            assert!(share > 0.3, "{scenario}, {model:?}: {share}");
            assert!(worlds[1].state.vehicles.iter().all(|vehicle| !vehicle.is_free()));
        }
    }
}
