//! A city whose vehicles and commands come from outside, over the laboratory's link: who may do what, what
//! becomes of each message, and the world that they change. Without sockets, clocks of the wall or threads.

mod setup;

use crate::scenario::Experiment;
use crate::sim::World;
use crate::snapshot::{FrameSnapshot, ModelKind, SimCommand, Status, Trajectory, VehicleId};
use crate::wire::{
    Action, Body, Build, Clock, DropReason, MOST_POSES, Measurement, Message, Outcome, Phase, Poses, Seen,
    VehicleSetup,
};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

/// A sender in one of its sessions.
pub type Sender = u32;

/// Stands for motion capture, which is no sender.
pub const MOTION_CAPTURE: Sender = 0;

/// Who may do what.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rules {
    /// The world waits at each tick for a barrier of who leads.
    pub is_lockstep: bool,
    /// Senders beside the one who leads that may set up vehicles.
    pub guests: usize,
}

/// Something of a sender that a tick has applied, as a log keeps it.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    pub sender: Sender,
    pub body: Body,
}

impl Applied {
    fn is_setup_of(&self, id: VehicleId) -> bool {
        matches!(&self.body, Body::Setup { setup, .. } if setup.id == id)
    }
}

/// A vehicle that was set up.
#[derive(Clone, Debug)]
struct Owned {
    owner: Sender,
    setup: VehicleSetup,
    /// Of the newest trajectory since its owner has set it up.
    sequence: Option<u32>,
}

#[derive(Clone, Debug, Default)]
struct Known {
    /// Seconds of the clock on the wall.
    heard_s: f64,
    /// The latest answers, by request.
    answers: VecDeque<(u32, Body)>,
}

/// What waits for the next tick.
#[derive(Clone, Debug)]
struct Pending {
    sender: Sender,
    body: Body,
    command: SimCommand,
}

/// Answers that are remembered for a sender that asks again.
const ANSWERS: usize = 64;
/// Commands that may wait for a tick.
const MOST_PENDING: usize = 8192;
/// Senders that are remembered although they neither lead nor have vehicles.
const MOST_KNOWN: usize = 64;
/// Who leads and is silent for longer leads no more, seconds of the clock on the wall.
const LEAST_SILENCE_S: f64 = 1.0;

/// A world under the command of senders.
#[derive(Debug)]
pub struct Served {
    world: World,
    rules: Rules,
    snapshot: FrameSnapshot,
    pending: Vec<Pending>,
    applied: Vec<Applied>,
    /// Setups of the vehicles that are there, in the order in which they came.
    brought: Vec<Applied>,
    commands: Vec<SimCommand>,
    vehicles: BTreeMap<VehicleId, Owned>,
    /// Senders that have led or set up vehicles: nobody else is worth any memory.
    known: BTreeMap<Sender, Known>,
    leader: Option<Sender>,
    dropped: Vec<DropReason>,
}

impl Served {
    /// The world of an experiment without its vehicles, which are to come as setups.
    pub fn new(experiment: Experiment, rules: Rules) -> Self {
        let world = World::new(Arc::new(experiment.without_vehicles()));
        Self {
            snapshot: world.snapshot(),
            world,
            rules,
            pending: Vec::new(),
            applied: Vec::new(),
            brought: Vec::new(),
            commands: Vec::new(),
            vehicles: BTreeMap::new(),
            known: BTreeMap::new(),
            leader: None,
            dropped: Vec::new(),
        }
    }

    pub fn experiment(&self) -> &Arc<Experiment> {
        self.world.experiment()
    }

    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    /// Takes what a sender has sent, at a time of the clock on the wall, and gives what answers it.
    pub fn take(&mut self, sender: Sender, now_s: f64, body: Body) -> Option<Body> {
        self.hear(sender, now_s);
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
            Body::Setup { setup, .. } => self.set_up(sender, now_s, *setup),
            Body::Remove { request, vehicle } => self.remove(sender, now_s, request, vehicle),
            Body::Command { request, action } => self.command(sender, now_s, request, action),
            Body::Subscribe { .. } => (Outcome::Done, String::new()),
            Body::Barrier { .. } | Body::Clock(_) | Body::Ack { .. } | Body::Poses(_) => return None,
        };
        let answer = Body::Ack { request: request?, outcome, tick: self.snapshot.tick, detail };
        // What was not done can be asked for again.
        if outcome == Outcome::Done
            && let Some(known) = self.known.get_mut(&sender)
        {
            known.answers.truncate(ANSWERS - 1);
            known.answers.push_front((request?, answer.clone()));
        }
        Some(answer)
    }

    fn hear(&mut self, sender: Sender, now_s: f64) {
        if let Some(known) = self.known.get_mut(&sender) {
            known.heard_s = now_s;
        }
        if self.leader.is_some_and(|leader| self.is_silent(leader, now_s)) {
            self.leader = None;
        }
    }

    /// Remembers a sender, and forgets those who no longer matter where they become many.
    fn know(&mut self, sender: Sender, now_s: f64) {
        self.known.entry(sender).or_default().heard_s = now_s;
        if self.known.len() > MOST_KNOWN {
            let owners: BTreeSet<Sender> = self.vehicles.values().map(|owned| owned.owner).collect();
            let leader = self.leader;
            self.known
                .retain(|known, _| *known == sender || Some(*known) == leader || owners.contains(known));
        }
    }

    fn is_silent(&self, sender: Sender, now_s: f64) -> bool {
        let silence_s = self.experiment().link_timeout_s.max(LEAST_SILENCE_S);
        self.known.get(&sender).is_none_or(|known| now_s - known.heard_s > silence_s)
    }

    /// Whether a sender leads the experiment; the first who acts does, until it is silent.
    fn leads(&mut self, sender: Sender, now_s: f64) -> bool {
        if self.leader.is_none() {
            self.leader = Some(sender);
            self.know(sender, now_s);
        }
        self.leader == Some(sender)
    }

    /// Who leads the experiment, if anybody does.
    pub fn leader(&self) -> Option<Sender> {
        self.leader
    }

    fn not_yours(&mut self, what: &str) -> (Outcome, String) {
        self.dropped.push(DropReason::NotYours);
        (Outcome::Busy, format!("another sender {what}"))
    }

    fn follow(&mut self, sender: Sender, trajectory: Trajectory) {
        match self.vehicles.get(&trajectory.vehicle) {
            None => self.dropped.push(DropReason::UnknownVehicle),
            Some(owned) if owned.owner != sender => self.dropped.push(DropReason::NotYours),
            Some(_) => {
                let scale = self.experiment().scale;
                let command = Message::Follow(trajectory.clone()).into_command(scale);
                self.push(Pending { sender, body: Body::Trajectories(vec![trajectory]), command });
            }
        }
    }

    fn push(&mut self, pending: Pending) {
        if self.pending.len() < MOST_PENDING {
            self.pending.push(pending);
        } else {
            self.dropped.push(DropReason::Full);
        }
    }

    fn remove(&mut self, sender: Sender, now_s: f64, request: u32, vehicle: VehicleId) -> (Outcome, String) {
        let Some(owned) = self.vehicles.get(&vehicle) else {
            self.dropped.push(DropReason::UnknownVehicle);
            return (Outcome::Refused, format!("there is no vehicle {vehicle}"));
        };
        let owner = owned.owner;
        if owner != sender && !(self.leads(sender, now_s) && self.is_silent(owner, now_s)) {
            return self.not_yours(&format!("has set up vehicle {vehicle}"));
        }
        self.vehicles.remove(&vehicle);
        let body = Body::Remove { request, vehicle };
        self.push(Pending { sender, body, command: SimCommand::Remove(vehicle) });
        (Outcome::Done, String::new())
    }

    fn command(&mut self, sender: Sender, now_s: f64, request: u32, action: Action) -> (Outcome, String) {
        if !self.leads(sender, now_s) {
            return self.not_yours("leads the experiment");
        }
        let command = match action {
            Action::Start => SimCommand::Start,
            Action::Pause => SimCommand::Pause,
            Action::Reset => {
                self.vehicles.values_mut().for_each(|owned| owned.sequence = None);
                SimCommand::Reset
            }
        };
        self.push(Pending { sender, body: Body::Command { request, action }, command });
        (Outcome::Done, String::new())
    }

    /// Takes in where a vehicle of the laboratory was measured to be, on the city's clock; of others motion
    /// capture says nothing here.
    pub fn measure(&mut self, pose: Measurement) {
        let is_measured = |owned: &Owned| match &owned.setup.build {
            Build::Spec(spec) => spec.model == ModelKind::Measured,
            Build::Type(_) => false,
        };
        if self.vehicles.get(&pose.vehicle).is_none_or(|owned| !is_measured(owned)) {
            return;
        }
        let poses = Poses {
            tick: self.snapshot.tick,
            time_s: pose.stamp_s,
            state_hash: 0,
            phase: self.phase(),
            part: 0,
            parts: 1,
            vehicles: vec![Seen { pose, status: Status::Physical }],
        };
        let command = pose.into_command(self.experiment().scale);
        self.push(Pending { sender: MOTION_CAPTURE, body: Body::Poses(poses), command });
    }

    /// Whether the next tick makes a physics step: the clock runs, or will by then.
    pub fn is_running(&self) -> bool {
        let last = self.pending.iter().rev().find_map(|pending| match pending.command {
            SimCommand::Start => Some(true),
            SimCommand::Pause | SimCommand::Reset => Some(false),
            _ => None,
        });
        last.unwrap_or(self.world.is_running())
    }

    /// Whether anything waits for a tick.
    pub fn has_pending(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Applies what has come, and makes a physics step if the clock runs.
    pub fn tick(&mut self) -> &FrameSnapshot {
        let (time_s, timeout_s) = (self.snapshot.time_s, self.experiment().link_timeout_s);
        self.applied.clear();
        self.commands.clear();
        // As the world applies them, so that of two trajectories that have changed places both count.
        let mut pending = std::mem::take(&mut self.pending);
        pending.sort_by_key(|pending| pending.command.order());
        for Pending { sender, body, command } in pending.drain(..) {
            if let SimCommand::Follow(trajectory) = &command {
                let refusal = match self.vehicles.get_mut(&trajectory.vehicle) {
                    None => Some(DropReason::UnknownVehicle),
                    Some(_) if trajectory.is_over(time_s - timeout_s) => Some(DropReason::Stale),
                    Some(owned) if owned.sequence.is_some_and(|last| last == trajectory.sequence) => {
                        Some(DropReason::Duplicate)
                    }
                    Some(owned) if owned.sequence.is_some_and(|last| !trajectory.follows(last)) => {
                        Some(DropReason::Reordered)
                    }
                    Some(owned) => {
                        owned.sequence = Some(trajectory.sequence);
                        None
                    }
                };
                if let Some(reason) = refusal {
                    self.dropped.push(reason);
                    continue;
                }
            }
            let is_there = |id| self.brought.iter().any(|applied| applied.is_setup_of(id));
            match &command {
                SimCommand::Spawn(setup) if !is_there(setup.id) => {
                    self.brought.push(Applied { sender, body: body.clone() });
                }
                SimCommand::Remove(id) => self.brought.retain(|applied| !applied.is_setup_of(*id)),
                _ => {}
            }
            self.applied.push(Applied { sender, body });
            self.commands.push(command);
        }
        self.pending = pending;
        self.world.tick_into(&self.commands, &mut self.snapshot);
        &self.snapshot
    }

    /// What the last tick has applied.
    pub fn applied(&self) -> &[Applied] {
        &self.applied
    }

    /// The setups of the vehicles that are there, in the order in which they came: a reset keeps them.
    pub fn brought(&self) -> &[Applied] {
        &self.brought
    }

    /// Why things were dropped since the last call.
    pub fn drain_dropped(&mut self) -> impl Iterator<Item = DropReason> + '_ {
        self.dropped.drain(..)
    }

    pub fn phase(&self) -> Phase {
        match (self.world.is_running(), self.snapshot.tick) {
            (true, _) => Phase::Running,
            (false, 0) => Phase::Ready,
            (false, _) => Phase::Paused,
        }
    }

    fn clock(&self, token: u64) -> Clock {
        let experiment = self.experiment();
        Clock {
            token,
            tick: self.snapshot.tick,
            time_s: self.snapshot.time_s,
            physics_hz: experiment.rates.physics_hz,
            length_scale: experiment.scale.factor(),
            phase: self.phase(),
            is_lockstep: self.rules.is_lockstep,
        }
    }

    /// The present poses, for subscribers.
    pub fn poses(&self) -> Vec<Body> {
        let scale = self.experiment().scale;
        let statuses = self.snapshot.vehicles.iter().map(|vehicle| vehicle.status);
        let seen: Vec<Seen> = Measurement::all(&self.snapshot, scale)
            .zip(statuses)
            .map(|(pose, status)| Seen { pose, status })
            .collect();
        let parts = seen.len().div_ceil(MOST_POSES).max(1);
        let part = |part: usize| {
            let vehicles = seen.iter().skip(part * MOST_POSES).take(MOST_POSES).copied().collect();
            Body::Poses(Poses {
                tick: self.snapshot.tick,
                time_s: self.snapshot.time_s,
                state_hash: self.snapshot.state_hash,
                phase: self.phase(),
                part: part as u8,
                parts: parts as u8,
                vehicles,
            })
        };
        (0..parts).map(part).collect()
    }
}
