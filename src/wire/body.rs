//! The bodies of datagrams: all that goes over the link.

use super::bytes::{Reader, Writer};
use super::setup::VehicleSetup;
use super::{DecodeError, EncodeError, Fault, Header, LARGEST_M, LARGEST_S, Measurement, Seal, trajectories};
use crate::snapshot::{Status, Trajectory, VehicleId};
use glam::{DQuat, DVec3};

/// A reason in words is at most so long, in bytes.
pub const LONGEST_DETAIL: usize = 200;
/// Poses of a datagram, at most.
pub const MOST_POSES: usize = 17;
/// A subscription lasts at most so long without being renewed.
pub const LONGEST_LEASE_S: f64 = 60.0;

/// What is done with the experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Action {
    Start = 0,
    Pause = 1,
    Reset = 2,
}

const ACTIONS: [Action; 3] = [Action::Start, Action::Pause, Action::Reset];

/// What became of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Outcome {
    Done = 0,
    /// Not now: another sender leads. Asking again later may help.
    Busy = 1,
    /// Never, for the reason stated.
    Refused = 2,
}

const OUTCOMES: [Outcome; 3] = [Outcome::Done, Outcome::Busy, Outcome::Refused];

/// Where the experiment stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// At its beginning.
    Ready = 0,
    Running = 1,
    Paused = 2,
}

const PHASES: [Phase; 3] = [Phase::Ready, Phase::Running, Phase::Paused];

/// The city's clock, and what a sender has to know of the city.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// As in the question.
    pub token: u64,
    pub tick: u64,
    /// Seconds of simulated time since the start or the last reset: the clock of all stamps.
    pub time_s: f64,
    pub physics_hz: u32,
    /// City metres for one laboratory metre.
    pub length_scale: f64,
    pub phase: Phase,
    /// The city waits for a barrier at each tick.
    pub is_lockstep: bool,
}

/// A vehicle as the city's subscribers see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Its stamp is the time of all poses of the datagram.
    pub pose: Measurement,
    pub status: Status,
}

/// Poses of one tick, or some of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Poses {
    pub tick: u64,
    pub time_s: f64,
    /// Digest of the city's state at this tick.
    pub state_hash: u64,
    pub phase: Phase,
    /// Which of how many datagrams, from 0.
    pub part: u8,
    pub parts: u8,
    /// In id order.
    pub vehicles: Vec<Seen>,
}

/// All that goes over the link. Laboratory metres.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// Asks for a [`Clock`]; it is how a sender learns the city's session.
    Hello {
        token: u64,
    },
    Setup {
        request: u32,
        setup: Box<VehicleSetup>,
    },
    Trajectories(Vec<Trajectory>),
    Remove {
        request: u32,
        vehicle: VehicleId,
    },
    Command {
        request: u32,
        action: Action,
    },
    /// Poses of every so many ticks from now on, until the lease is over.
    Subscribe {
        request: u32,
        every_ticks: u16,
        lease_s: f64,
    },
    /// All commands for this tick have been sent, in so many datagrams from this sequence on.
    Barrier {
        tick: u64,
        first: u64,
        count: u32,
    },
    Clock(Clock),
    /// What became of the request of this number.
    Ack {
        request: u32,
        outcome: Outcome,
        tick: u64,
        detail: String,
    },
    Poses(Poses),
}

const HELLO: u8 = 1;
const SETUP: u8 = 2;
const TRAJECTORIES: u8 = 3;
const REMOVE: u8 = 4;
const COMMAND: u8 = 5;
const SUBSCRIBE: u8 = 6;
const BARRIER: u8 = 7;
const CLOCK: u8 = 65;
const ACK: u8 = 66;
const POSES: u8 = 67;

impl Body {
    pub(super) fn kind(&self) -> u8 {
        match self {
            Self::Hello { .. } => HELLO,
            Self::Setup { .. } => SETUP,
            Self::Trajectories(_) => TRAJECTORIES,
            Self::Remove { .. } => REMOVE,
            Self::Command { .. } => COMMAND,
            Self::Subscribe { .. } => SUBSCRIBE,
            Self::Barrier { .. } => BARRIER,
            Self::Clock(_) => CLOCK,
            Self::Ack { .. } => ACK,
            Self::Poses(_) => POSES,
        }
    }

    /// Whether it goes to the city.
    pub fn is_to_city(&self) -> bool {
        self.kind() < CLOCK
    }

    /// The number by which the answer is told from others; `None` for what is not answered by an
    /// acknowledgement.
    pub fn request(&self) -> Option<u32> {
        match self {
            Self::Setup { request, .. }
            | Self::Remove { request, .. }
            | Self::Command { request, .. }
            | Self::Subscribe { request, .. } => Some(*request).filter(|request| *request != 0),
            _ => None,
        }
    }

    /// The datagram that carries it. `header.kind` is that of the body, whatever it says.
    ///
    /// # Errors
    /// When a text, a list or the whole is too long for a datagram.
    pub fn encode(&self, header: Header, seal: &Seal) -> Result<Vec<u8>, EncodeError> {
        let mut out = Writer::default();
        self.write(&mut out)?;
        let (found, most) = (out.bytes.len(), super::LONGEST_BODY);
        if found > most {
            return Err(EncodeError { what: "body bytes", found, most });
        }
        Ok(seal.close(Header { kind: self.kind(), ..header }, &out.bytes))
    }

    /// The header and the body of a datagram.
    ///
    /// # Errors
    /// What is wrong with it, and where; nothing of it may be used then.
    pub fn decode(bytes: &[u8], seal: &Seal) -> Result<(Header, Self), DecodeError> {
        let (header, end) = seal.open(bytes)?;
        let mut from = Reader::new(&bytes[..end], super::HEADER_BYTES);
        let body = Self::read(header.kind, &mut from)?;
        from.finish()?;
        Ok((header, body))
    }

    /// Kind and body alone, as a log keeps them.
    ///
    /// # Errors
    /// As for [`Body::encode`].
    pub fn to_log(&self) -> Result<(u8, Vec<u8>), EncodeError> {
        let mut out = Writer::default();
        self.write(&mut out)?;
        Ok((self.kind(), out.bytes))
    }

    /// Whether a kind, as a log has it, is that of a vehicle's setup.
    pub fn is_setup(kind: u8) -> bool {
        kind == SETUP
    }

    /// What a log has kept.
    ///
    /// # Errors
    /// What is wrong with it, and where.
    pub fn from_log(kind: u8, bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut from = Reader::new(bytes, 0);
        let body = Self::read(kind, &mut from)?;
        from.finish()?;
        Ok(body)
    }

    fn write(&self, out: &mut Writer) -> Result<(), EncodeError> {
        if let Self::Setup { request, .. }
        | Self::Remove { request, .. }
        | Self::Command { request, .. }
        | Self::Subscribe { request, .. }
        | Self::Ack { request, .. } = self
        {
            out.u32(*request);
        }
        match self {
            Self::Hello { token } => out.u64(*token),
            Self::Setup { setup, .. } => setup.write(out)?,
            Self::Trajectories(list) => trajectories::write(list, out)?,
            Self::Remove { vehicle, .. } => out.u32(vehicle.0),
            Self::Command { action, .. } => out.u8(*action as u8),
            Self::Subscribe { every_ticks, lease_s, .. } => {
                out.u16(*every_ticks);
                out.f64(*lease_s);
            }
            Self::Barrier { tick, first, count } => {
                out.u64(*tick);
                out.u64(*first);
                out.u32(*count);
            }
            Self::Clock(clock) => clock.write(out),
            Self::Ack { outcome, tick, detail, .. } => {
                out.u8(*outcome as u8);
                out.u64(*tick);
                out.text("detail", detail, LONGEST_DETAIL)?;
            }
            Self::Poses(poses) => poses.write(out)?,
        }
        Ok(())
    }

    fn read(kind: u8, from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let request = match kind {
            SETUP | REMOVE | COMMAND | SUBSCRIBE | ACK => from.u32("request")?,
            _ => 0,
        };
        Ok(match kind {
            HELLO => Self::Hello { token: from.u64("token")? },
            SETUP => Self::Setup { request, setup: Box::new(VehicleSetup::read(from)?) },
            TRAJECTORIES => Self::Trajectories(trajectories::read(from)?),
            REMOVE => Self::Remove { request, vehicle: VehicleId(from.u32("vehicle id")?) },
            COMMAND => {
                let action = from.one_of("action", &ACTIONS, "0 (start), 1 (pause) and 2 (reset)")?;
                Self::Command { request, action }
            }
            SUBSCRIBE => {
                let every_ticks = from.u16("every ticks")?;
                let every_ticks = from.within("every ticks", every_ticks, (1, u16::MAX))?;
                Self::Subscribe { request, every_ticks, lease_s: from.number("lease", 0.0, LONGEST_LEASE_S)? }
            }
            BARRIER => Self::Barrier {
                tick: from.u64("tick")?,
                first: from.u64("first sequence")?,
                count: from.u32("datagrams")?,
            },
            CLOCK => Self::Clock(Clock::read(from)?),
            ACK => Self::Ack {
                request,
                outcome: from.one_of("outcome", &OUTCOMES, "0 (done), 1 (busy) and 2 (refused)")?,
                tick: from.u64("tick")?,
                detail: from.text("detail", LONGEST_DETAIL)?,
            },
            POSES => Self::Poses(Poses::read(from)?),
            found => {
                let fault = Fault::Unknown { found: found.into(), known: "1 to 7 and 65 to 67" };
                return Err(DecodeError { field: "kind", offset: 5, fault });
            }
        })
    }
}

const KNOWN_PHASES: &str = "0 (ready), 1 (running) and 2 (paused)";

impl Clock {
    fn write(&self, out: &mut Writer) {
        out.u64(self.token);
        out.u64(self.tick);
        out.f64(self.time_s);
        out.u32(self.physics_hz);
        out.f64(self.length_scale);
        out.u8(self.phase as u8);
        out.u8(u8::from(self.is_lockstep));
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            token: from.u64("token")?,
            tick: from.u64("tick")?,
            time_s: from.number("time", 0.0, LARGEST_S)?,
            physics_hz: from.u32("physics rate")?,
            length_scale: from.number("length scale", 0.0, 1e6)?,
            phase: from.one_of("phase", &PHASES, KNOWN_PHASES)?,
            is_lockstep: from.one_of("lockstep", &[false, true], "0 and 1")?,
        })
    }
}

impl Poses {
    fn write(&self, out: &mut Writer) -> Result<(), EncodeError> {
        out.u64(self.tick);
        out.f64(self.time_s);
        out.u64(self.state_hash);
        out.u8(self.phase as u8);
        out.u8(self.part);
        out.u8(self.parts);
        out.count("poses", self.vehicles.len(), MOST_POSES)?;
        for seen in &self.vehicles {
            out.u32(seen.pose.vehicle.0);
            out.u8(seen.status as u8);
            [0; 3].into_iter().for_each(|byte| out.u8(byte));
            let (position, turn) = (seen.pose.position.to_array(), seen.pose.orientation.to_array());
            position.into_iter().chain(turn).for_each(|number| out.f64(number));
        }
        Ok(())
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let tick = from.u64("tick")?;
        let time_s = from.number("time", 0.0, LARGEST_S)?;
        let state_hash = from.u64("state hash")?;
        let phase = from.one_of("phase", &PHASES, KNOWN_PHASES)?;
        let (part, parts) = (from.u8("part")?, from.u8("parts")?);
        let parts = from.within("parts", parts, (part.saturating_add(1), u8::MAX))?;
        let count = from.u8("poses")?;
        let count = from.within("poses", count, (0, MOST_POSES as u8))?;
        let vehicles = (0..count).map(|_| Seen::read(from, time_s)).collect::<Result<_, _>>()?;
        Ok(Self { tick, time_s, state_hash, phase, part, parts, vehicles })
    }
}

impl Seen {
    fn read(from: &mut Reader<'_>, stamp_s: f64) -> Result<Self, DecodeError> {
        let vehicle = VehicleId(from.u32("vehicle id")?);
        let status = from.one_of("status", &Status::ALL, "0 (waiting) to 9 (unseen)")?;
        for _ in 0..3 {
            let found = from.u8("reserved")?;
            from.within("reserved", found, (0, 0))?;
        }
        let mut position = DVec3::ZERO;
        for (field, metres) in ["x", "y", "z"].into_iter().zip(position.as_mut()) {
            *metres = from.number(field, -LARGEST_M, LARGEST_M)?;
        }
        let mut turn = [0.0; 4];
        for (field, part) in ["qx", "qy", "qz", "qw"].into_iter().zip(&mut turn) {
            *part = from.number(field, -1.001, 1.001)?;
        }
        let orientation = DQuat::from_array(turn);
        Ok(Self { pose: Measurement { vehicle, stamp_s, position, orientation }, status })
    }
}
