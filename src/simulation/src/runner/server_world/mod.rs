//! World of a served city, whose vehicles and commands come from senders over the link: permissions, idempotent
//! requests, the heartbeat timeouts of the leader and of drivers, and the commands of each tick. Without sockets, threads
//! or wall-clock time.

mod decisions;
mod drive;
mod plans;
mod role;
mod setup;
#[cfg(test)]
mod tests;

use self::drive::Driver;
use self::role::Act;
use super::{HeldControl, pose_bodies};
use crate::scenario::Experiment;
use crate::sim::World;
use city3d_geometry::Lab;
use city3d_protocol::snapshot::{
    FrameSnapshot, ModelKind, SignalAspects, SimCommand, Status, Trajectory, VehicleId, is_newer,
};
use city3d_protocol::wire::{
    Body, CityClock, DropReason, ExperimentAction, ExperimentPhase, MAX_AHEAD_S, Measurement, Message,
    ObservedVehicle, Poses, RequestOutcome, VehicleBuild, VehicleSetup,
};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

/// Number of a sender in one of its sessions: that of `SenderId` in the link.
pub type SenderNumber = u32;

/// Number that stands for motion capture.
pub const MOTION_CAPTURE: SenderNumber = 0;

/// Number that stands for the person at the city's own window.
pub const OPERATOR: SenderNumber = SenderNumber::MAX;

/// Number that stands for a control framework whose trajectories come by topics, such as over ROS 2.
pub const TOPICS: SenderNumber = SenderNumber::MAX - 1;

/// Guests of the city's own web page have the numbers from here up to [`TOPICS`].
pub const FIRST_PAGE_GUEST: SenderNumber = TOPICS - 65_536;

/// Permissions of senders.
#[derive(Clone, Copy, Debug, Default)]
pub struct ServerRules {
    /// Lockstep: the world waits at each tick for a barrier of the leader.
    pub is_lockstep: bool,
    /// Number of senders besides the leader that may set up vehicles.
    pub guests: usize,
}

/// A body that a tick has applied, with its sender, as a log keeps it.
#[derive(Clone, Debug, PartialEq)]
pub struct AppliedBody {
    /// [`MOTION_CAPTURE`] for measured poses, [`OPERATOR`] for the city's own window, [`TOPICS`] for topics, from
    /// [`FIRST_PAGE_GUEST`] on for guests of the city's own web page.
    pub sender: SenderNumber,
    /// As it was carried out: a setup may have been moved back to free space.
    pub body: Body,
}

impl AppliedBody {
    fn is_setup_of(&self, id: VehicleId) -> bool {
        matches!(&self.body, Body::Setup { setup, .. } if setup.id == id)
    }

    /// Whether it has set up a vehicle of an inflow.
    fn is_arrival_of(&self, experiment: &Experiment) -> bool {
        matches!(&self.body, Body::Setup { setup, .. } if experiment.is_arrival(setup.id, &setup.name))
    }
}

/// A vehicle with its owner, the sender that has set it up.
#[derive(Clone, Debug)]
struct OwnedVehicle {
    owner: SenderNumber,
    setup: VehicleSetup,
    /// Sequence number of the newest trajectory of the present owner.
    sequence: Option<u32>,
    /// That of the owner's newest pedals.
    drive_sequence: Option<u32>,
    /// Who holds the steering wheel, while a person drives it.
    driver: Option<Driver>,
}

impl OwnedVehicle {
    fn new(owner: SenderNumber, setup: VehicleSetup) -> Self {
        Self { owner, setup, sequence: None, drive_sequence: None, driver: None }
    }

    fn is_physical(&self) -> bool {
        matches!(&self.setup.build, VehicleBuild::Spec(spec) if spec.model == ModelKind::Measured)
    }
}

/// What is remembered of a sender.
#[derive(Clone, Debug, Default)]
struct SenderRecord {
    /// Wall-clock time of its last datagram, seconds.
    last_heard_s: f64,
    /// The latest answers by request number, so that a repeated request is carried out once.
    answers: VecDeque<(u32, Body)>,
}

/// A command that waits for the next tick.
#[derive(Clone, Debug)]
struct PendingCommand {
    sender: SenderNumber,
    body: Body,
    command: SimCommand,
}

/// Answers that are remembered of each sender.
const MAX_ANSWERS: usize = 64;
/// Capacity of the queue of commands for a tick.
const MAX_PENDING: usize = 8192;
/// Senders that are remembered although they neither lead nor own vehicles.
const MAX_REMEMBERED: usize = 64;
/// Resets over the link: each begins new files.
const RESETS_PER_S: f64 = 1.0;
const RESETS_AT_ONCE: f64 = 10.0;
/// Shortest heartbeat timeout of a leader, an owner or a driver, wall-clock seconds.
const MIN_HEARTBEAT_TIMEOUT_S: f64 = 1.0;

/// Leaky bucket of resets.
#[derive(Clone, Copy, Debug, Default)]
struct ResetLimit {
    level: f64,
    at_s: f64,
}

impl ResetLimit {
    /// Takes a reset; `false` when there were too many.
    fn take(&mut self, now_s: f64) -> bool {
        self.level = (self.level - (now_s - self.at_s).max(0.0) * RESETS_PER_S).max(0.0);
        self.at_s = now_s;
        let passes = self.level <= RESETS_AT_ONCE - 1.0;
        self.level += f64::from(u8::from(passes));
        passes
    }
}

/// Notes the sequence number of a vehicle's trajectory or pedals as the newest one, if it is.
fn note_sequence(newest: &mut Option<u32>, sequence: u32) -> Result<(), DropReason> {
    match *newest {
        Some(last) if last == sequence => Err(DropReason::Duplicate),
        Some(last) if !is_newer(sequence, last) => Err(DropReason::Reordered),
        _ => {
            *newest = Some(sequence);
            Ok(())
        }
    }
}

/// A world under the control of senders. The first sender that sets up a vehicle leads until its heartbeat times out.
#[derive(Debug)]
pub struct ServerWorld {
    world: World,
    rules: ServerRules,
    snapshot: FrameSnapshot,
    pending: Vec<PendingCommand>,
    applied: Vec<AppliedBody>,
    /// Setups of the present vehicles, in the order of their arrival.
    spawned: Vec<AppliedBody>,
    commands: Vec<SimCommand>,
    vehicles: BTreeMap<VehicleId, OwnedVehicle>,
    /// Senders that have led or set up vehicles; others take no memory.
    known: BTreeMap<SenderNumber, SenderRecord>,
    leader: Option<SenderNumber>,
    dropped: Vec<DropReason>,
    resets: ResetLimit,
    /// Decisions and plans, as the senders of the vehicles tell them.
    heard: HeldControl,
}

impl ServerWorld {
    /// Creates the world of an experiment without its vehicles, which come as setups.
    pub fn new(experiment: Experiment, rules: ServerRules) -> Self {
        let world = World::new(Arc::new(experiment.without_vehicles()));
        Self {
            snapshot: world.snapshot(),
            world,
            rules,
            pending: Vec::new(),
            applied: Vec::new(),
            spawned: Vec::new(),
            commands: Vec::new(),
            vehicles: BTreeMap::new(),
            known: BTreeMap::new(),
            leader: None,
            dropped: Vec::new(),
            resets: ResetLimit::default(),
            heard: HeldControl::default(),
        }
    }

    /// The served experiment, without vehicles.
    pub fn experiment(&self) -> &Arc<Experiment> {
        self.world.experiment()
    }

    /// Snapshot after the last tick, or of the initial conditions.
    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    /// Handles a body of a sender at a wall-clock time, and returns the answer.
    pub fn take(&mut self, sender: SenderNumber, now_s: f64, body: Body) -> Option<Body> {
        self.note_activity(sender, now_s);
        let request = body.request();
        if let (Some(request), Some(known)) = (request, self.known.get(&sender))
            && let Some((_, answer)) = known.answers.iter().find(|(number, _)| *number == request)
        {
            return Some(answer.clone());
        }
        let (outcome, detail) = match body {
            Body::Hello { token } => return Some(Body::Clock(self.clock(token))),
            Body::Trajectories(list) => {
                list.into_iter().for_each(|trajectory| self.follow(sender, trajectory));
                return None;
            }
            Body::Signals(aspects) => {
                self.show_signals(sender, aspects);
                return None;
            }
            Body::Decisions(told) => {
                self.hear_decisions(sender, &told);
                return None;
            }
            Body::Plans(told) => {
                self.hear_plans(sender, &told);
                return None;
            }
            Body::Drive { vehicle, sequence, pedals } => {
                let refusal = self.drive(sender, now_s, vehicle, sequence, pedals).err();
                self.dropped.extend(refusal);
                return None;
            }
            Body::Setup { setup, .. } => self.set_up(sender, now_s, *setup),
            Body::Remove { request, vehicle } => self.remove(sender, now_s, request, vehicle),
            Body::Command { request, action } => self.command(sender, now_s, request, action),
            Body::Subscribe { .. } => (RequestOutcome::Done, String::new()),
            // Who keeps the pace leads, although all its vehicles may have yet to come.
            Body::Barrier { .. } => {
                if self.rules.is_lockstep {
                    self.claim_lead(sender, now_s);
                }
                return None;
            }
            Body::Describe { .. }
            | Body::Clock(_)
            | Body::Ack { .. }
            | Body::Poses(_)
            | Body::Description(_)
            | Body::ShownSignals(_)
            | Body::ShownDecisions(_)
            | Body::ShownPlans(_)
            | Body::Challenge { .. } => return None,
        };
        let answer = Body::Ack { request: request?, outcome, tick: self.snapshot.tick, detail };
        // A request that was not carried out may be repeated.
        if outcome == RequestOutcome::Done
            && let Some(known) = self.known.get_mut(&sender)
        {
            known.answers.truncate(MAX_ANSWERS - 1);
            known.answers.push_front((request?, answer.clone()));
        }
        Some(answer)
    }

    /// Carries out what the person at the city's own window asks for: to start, pause or reset the experiment, whoever
    /// leads it, or to drive a vehicle that is not physical. The numbers of requests and of pedals do not matter, for
    /// nothing is lost or repeated on the way.
    ///
    /// # Errors
    /// Why it is not carried out, in words.
    pub fn operate(&mut self, now_s: f64, body: Body) -> Result<(), String> {
        match body {
            Body::Command { action, .. } => match self.command(OPERATOR, now_s, 0, action) {
                (RequestOutcome::Done, _) => Ok(()),
                (_, detail) => Err(detail),
            },
            Body::Drive { vehicle, sequence, pedals } => {
                self.drive(OPERATOR, now_s, vehicle, sequence, pedals).map_err(|reason| match reason {
                    DropReason::UnknownVehicle => format!("there is no vehicle {vehicle}"),
                    DropReason::NotYours => {
                        format!("vehicle {vehicle} is physical: nobody can drive it from here")
                    }
                    reason => format!("the pedals of vehicle {vehicle} are {}", reason.label()),
                })
            }
            _ => Err("the city's own window may only start, pause, reset and drive".to_owned()),
        }
    }

    /// The leader, and whoever has set up a vehicle that is here.
    pub fn holders(&self) -> impl Iterator<Item = SenderNumber> + '_ {
        self.leader.into_iter().chain(self.vehicles.values().map(|owned| owned.owner))
    }

    /// Notes that a sender is there at a wall-clock time, as each of its bodies does.
    pub fn note_activity(&mut self, sender: SenderNumber, now_s: f64) {
        if let Some(known) = self.known.get_mut(&sender) {
            known.last_heard_s = now_s;
        }
        if self.leader.is_some_and(|leader| self.has_timed_out(leader, now_s)) {
            self.leader = None;
        }
    }

    /// Remembers a sender, and forgets senders without role when there are too many.
    fn remember(&mut self, sender: SenderNumber, now_s: f64) {
        self.known.entry(sender).or_default().last_heard_s = now_s;
        if self.known.len() > MAX_REMEMBERED {
            let owners: BTreeSet<SenderNumber> = self.vehicles.values().map(|owned| owned.owner).collect();
            let leader = self.leader;
            self.known
                .retain(|known, _| *known == sender || Some(*known) == leader || owners.contains(known));
        }
    }

    fn has_timed_out(&self, sender: SenderNumber, now_s: f64) -> bool {
        let silence_s = self.heartbeat_timeout_s();
        self.known.get(&sender).is_none_or(|known| now_s - known.last_heard_s > silence_s)
    }

    fn heartbeat_timeout_s(&self) -> f64 {
        self.experiment().link_timeout_s.max(MIN_HEARTBEAT_TIMEOUT_S)
    }

    /// Makes a sender the leader of the experiment when there is none. The operator needs no lead.
    fn claim_lead(&mut self, sender: SenderNumber, now_s: f64) {
        if self.leader.is_none() && sender != OPERATOR {
            self.leader = Some(sender);
            self.remember(sender, now_s);
        }
    }

    /// The leader of the experiment.
    pub fn leader(&self) -> Option<SenderNumber> {
        self.leader
    }

    /// The sender that has set up a vehicle.
    pub fn owner(&self, vehicle: VehicleId) -> Option<SenderNumber> {
        self.vehicles.get(&vehicle).map(|owned| owned.owner)
    }

    /// Whether a vehicle is there and is one of the laboratory, whose poses motion capture measures.
    pub fn is_physical(&self, vehicle: VehicleId) -> bool {
        self.vehicles.get(&vehicle).is_some_and(OwnedVehicle::is_physical)
    }

    fn refuse_not_owner(&mut self, what: &str) -> (RequestOutcome, String) {
        self.dropped.push(DropReason::NotYours);
        (RequestOutcome::Busy, format!("another sender {what}"))
    }

    fn follow(&mut self, sender: SenderNumber, trajectory: Trajectory<Lab>) {
        let Some(owned) = self.vehicles.get(&trajectory.vehicle) else {
            return self.dropped.push(DropReason::UnknownVehicle);
        };
        if !self.role(sender, Some(owned)).may(Act::Follow) {
            return self.dropped.push(DropReason::NotYours);
        }
        let command = Message::Follow(trajectory.clone()).into_command(self.experiment().scale);
        self.push(PendingCommand { sender, body: Body::Trajectories(vec![trajectory]), command });
    }

    fn show_signals(&mut self, sender: SenderNumber, aspects: SignalAspects) {
        if !self.role(sender, None).may(Act::Command { has_leader: self.leader.is_some() }) {
            return self.dropped.push(DropReason::NotYours);
        }
        let command = SimCommand::Signals(aspects.clone());
        self.push(PendingCommand { sender, body: Body::Signals(aspects), command });
    }

    fn push(&mut self, pending: PendingCommand) {
        let refusal = self.queue(pending).err();
        self.dropped.extend(refusal);
    }

    fn queue(&mut self, pending: PendingCommand) -> Result<(), DropReason> {
        if self.pending.len() >= MAX_PENDING {
            return Err(DropReason::Full);
        }
        self.pending.push(pending);
        Ok(())
    }

    fn remove(
        &mut self,
        sender: SenderNumber,
        now_s: f64,
        request: u32,
        vehicle: VehicleId,
    ) -> (RequestOutcome, String) {
        let Some(owned) = self.vehicles.get(&vehicle) else {
            self.dropped.push(DropReason::UnknownVehicle);
            return (RequestOutcome::Refused, format!("there is no vehicle {vehicle}"));
        };
        let owner = owned.owner;
        if owner != sender {
            self.claim_lead(sender, now_s);
        }
        let act = Act::Remove { is_orphaned: self.has_timed_out(owner, now_s) };
        if !self.role(sender, self.vehicles.get(&vehicle)).may(act) {
            return self.refuse_not_owner(&format!("has set up vehicle {vehicle}"));
        }
        self.vehicles.remove(&vehicle);
        self.heard.forget(vehicle);
        let body = Body::Remove { request, vehicle };
        self.push(PendingCommand { sender, body, command: SimCommand::Remove(vehicle) });
        (RequestOutcome::Done, String::new())
    }

    fn command(
        &mut self,
        sender: SenderNumber,
        now_s: f64,
        request: u32,
        action: ExperimentAction,
    ) -> (RequestOutcome, String) {
        self.remember(sender, now_s);
        if !self.role(sender, None).may(Act::Command { has_leader: self.leader.is_some() }) {
            return self.refuse_not_owner("leads the experiment");
        }
        let command = match action {
            ExperimentAction::Start => SimCommand::Start,
            ExperimentAction::Pause => SimCommand::Pause,
            ExperimentAction::Reset if sender != OPERATOR && !self.resets.take(now_s) => {
                let detail = "over the link the city is reset once a second at most; ask again".to_owned();
                return (RequestOutcome::Busy, detail);
            }
            ExperimentAction::Reset => {
                self.forget_arrivals();
                self.vehicles.values_mut().for_each(|owned| owned.sequence = None);
                self.forget_drivers();
                SimCommand::Reset
            }
        };
        self.push(PendingCommand { sender, body: Body::Command { request, action }, command });
        (RequestOutcome::Done, String::new())
    }

    /// Vehicles of inflows are gone after a reset, and come again when their time comes.
    fn forget_arrivals(&mut self) {
        let experiment = Arc::clone(self.experiment());
        self.vehicles.retain(|id, owned| !experiment.is_arrival(*id, &owned.setup.name));
        let is_arrival = |pending: &PendingCommand| matches!(&pending.command, SimCommand::Spawn(setup) if experiment.is_arrival(setup.id, &setup.name));
        self.pending.retain(|pending| !is_arrival(pending));
    }

    /// Queues the measured pose of a physical vehicle, stamped with the city's clock; ignores other vehicles. While the
    /// clock runs, a pose that is measured later than now is dropped and counted.
    pub fn measure(&mut self, pose: Measurement) {
        if !self.is_physical(pose.vehicle) {
            return;
        }
        if self.is_running() && pose.stamp_s > self.snapshot.time_s + MAX_AHEAD_S {
            return self.dropped.push(DropReason::Ahead);
        }
        let poses = Poses {
            tick: self.snapshot.tick,
            time_s: pose.stamp_s,
            state_hash: 0,
            phase: self.phase(),
            part: 0,
            parts: 1,
            vehicles: vec![ObservedVehicle { pose, status: Status::Physical }],
        };
        let command = pose.into_command(self.experiment().scale);
        self.push(PendingCommand { sender: MOTION_CAPTURE, body: Body::Poses(poses), command });
    }

    /// Whether the next tick makes a physics step: the clock runs, or a waiting command starts it.
    pub fn is_running(&self) -> bool {
        let last = self.pending.iter().rev().find_map(|pending| match pending.command {
            SimCommand::Start => Some(true),
            SimCommand::Pause | SimCommand::Reset => Some(false),
            _ => None,
        });
        last.unwrap_or(self.world.is_running())
    }

    /// Whether commands wait for a tick.
    pub fn has_pending(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Whether the next tick resets the experiment.
    pub fn will_reset(&self) -> bool {
        self.pending.iter().any(|pending| pending.command == SimCommand::Reset)
    }

    /// Applies the waiting commands, and makes a physics step if the clock runs.
    pub fn tick(&mut self) -> &FrameSnapshot {
        let (time_s, timeout_s) = (self.snapshot.time_s, self.experiment().link_timeout_s);
        self.applied.clear();
        self.commands.clear();
        // In the order of the world, so that two trajectories that were reordered on their way both count.
        let mut pending = std::mem::take(&mut self.pending);
        pending.sort_by_key(|pending| pending.command.order());
        for PendingCommand { sender, body, command } in pending.drain(..) {
            if let SimCommand::Follow(trajectory) = &command {
                let refusal = match self.vehicles.get_mut(&trajectory.vehicle) {
                    None => Some(DropReason::UnknownVehicle),
                    Some(_) if trajectory.is_over(time_s - timeout_s) => Some(DropReason::Stale),
                    Some(owned) => note_sequence(&mut owned.sequence, trajectory.sequence).err(),
                };
                if let Some(reason) = refusal {
                    self.dropped.push(reason);
                    continue;
                }
            }
            let is_there = |id| self.spawned.iter().any(|applied| applied.is_setup_of(id));
            match &command {
                SimCommand::Spawn(setup) if !is_there(setup.id) => {
                    self.spawned.push(AppliedBody { sender, body: body.clone() });
                }
                SimCommand::Remove(id) => self.spawned.retain(|applied| !applied.is_setup_of(*id)),
                SimCommand::Reset => {
                    let experiment = self.world.experiment();
                    self.spawned.retain(|applied| !applied.is_arrival_of(experiment));
                    self.heard.clear();
                }
                _ => {}
            }
            self.applied.push(AppliedBody { sender, body });
            self.commands.push(command);
        }
        self.pending = pending;
        self.world.tick_into(&self.commands, &mut self.snapshot);
        self.heard.expire(self.snapshot.time_s);
        &self.snapshot
    }

    /// The bodies that the last tick has applied.
    pub fn applied(&self) -> &[AppliedBody] {
        &self.applied
    }

    /// Setups of the present vehicles, in the order of their arrival; a reset keeps them.
    pub fn spawned(&self) -> &[AppliedBody] {
        &self.spawned
    }

    /// Reasons of the drops since the last call.
    pub fn drain_dropped(&mut self) -> impl Iterator<Item = DropReason> + '_ {
        self.dropped.drain(..)
    }

    /// Phase after the last tick: `Running`, or with a stopped clock `Ready` at tick 0 and `Paused` later.
    pub fn phase(&self) -> ExperimentPhase {
        match (self.world.is_running(), self.snapshot.tick) {
            (true, _) => ExperimentPhase::Running,
            (false, 0) => ExperimentPhase::Ready,
            (false, _) => ExperimentPhase::Paused,
        }
    }

    fn clock(&self, token: u64) -> CityClock {
        let experiment = self.experiment();
        CityClock {
            token,
            tick: self.snapshot.tick,
            time_s: self.snapshot.time_s,
            physics_hz: experiment.rates.physics_hz,
            length_scale: experiment.scale.factor(),
            phase: self.phase(),
            is_lockstep: self.rules.is_lockstep,
        }
    }

    /// The present poses as bodies for subscribers.
    pub fn poses(&self) -> Vec<Body> {
        pose_bodies(&self.snapshot, self.phase(), self.experiment().scale)
    }
}
