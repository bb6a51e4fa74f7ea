//! Bodies of the datagrams, and their encoding.

use super::bytes::{ByteReader, ByteWriter};
use super::decisions::Decisions;
use super::description::CityDescription;
use super::drive;
use super::plans::Plans;
use super::setup::VehicleSetup;
use super::{
    Authenticator, DatagramHeader, DecodeError, DecodeFault, EncodeError, MAX_COORDINATE_M, MAX_TIME_S,
    Measurement, signals, trajectories,
};
use crate::snapshot::{Pedals, SignalAspects, Status, Trajectory, VehicleId};
use city3d_geometry::Lab;
use glam::{DQuat, DVec3};

/// Longest text of a reason, bytes.
pub const MAX_DETAIL_BYTES: usize = 200;
/// Most poses of a datagram.
pub const MAX_POSES: usize = 17;
/// Longest lease of a subscription.
pub const MAX_LEASE_S: f64 = 60.0;

/// Action on the experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ExperimentAction {
    /// The simulated clock runs, for the first time or after a pause.
    Start = 0,
    /// The simulated clock stops.
    Pause = 1,
    /// The clock returns to 0 and stops; the vehicles return to the poses of their setups.
    Reset = 2,
}

const ACTIONS: [ExperimentAction; 3] =
    [ExperimentAction::Start, ExperimentAction::Pause, ExperimentAction::Reset];

/// Outcome of a request, as its acknowledgement states it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum RequestOutcome {
    /// Carried out; changes of the city take effect at its next tick.
    Done = 0,
    /// Not now, because another sender leads; a later request may succeed.
    Busy = 1,
    /// Never, for the stated reason.
    Refused = 2,
}

const OUTCOMES: [RequestOutcome; 3] = [RequestOutcome::Done, RequestOutcome::Busy, RequestOutcome::Refused];

/// Phase of the experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ExperimentPhase {
    /// At its start, not running yet.
    Ready = 0,
    /// The simulated clock runs.
    Running = 1,
    /// Started before: the simulated clock stands at a later tick.
    Paused = 2,
}

const PHASES: [ExperimentPhase; 3] =
    [ExperimentPhase::Ready, ExperimentPhase::Running, ExperimentPhase::Paused];

/// Answer to a handshake: the city's clock and the settings that a sender must agree on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CityClock {
    /// The token of the request.
    pub token: u64,
    /// Physics steps since the start or the last reset.
    pub tick: u64,
    /// Simulated seconds since the start or the last reset: the clock of all stamps.
    pub time_s: f64,
    /// Physics steps per simulated second.
    pub physics_hz: u32,
    /// City metres for one laboratory metre.
    pub length_scale: f64,
    /// Whether the simulated clock runs.
    pub phase: ExperimentPhase,
    /// Lockstep: the city waits for a barrier at each tick.
    pub is_lockstep: bool,
}

/// Pose and status of a vehicle, as subscribers get them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObservedVehicle {
    /// Stamped with the time of the datagram.
    pub pose: Measurement,
    /// What it does, as the sender of the poses sees it.
    pub status: Status,
}

/// Poses of one tick, or one part of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Poses {
    /// Physics steps since the start or the last reset.
    pub tick: u64,
    /// Simulated time at this tick.
    pub time_s: f64,
    /// Digest of the city's state at this tick.
    pub state_hash: u64,
    /// Whether the simulated clock runs.
    pub phase: ExperimentPhase,
    /// Number of this part, from 0.
    pub part: u8,
    /// Number of parts with the poses of this tick.
    pub parts: u8,
    /// In id order.
    pub vehicles: Vec<ObservedVehicle>,
}

/// Body of a datagram. Laboratory metres.
///
/// ```
/// use city3d_protocol::wire::{Authenticator, Body, DatagramHeader};
///
/// let header = DatagramHeader { kind: 0, session: 1, peer: 0, world: 0, sequence: 1 };
/// let key = Authenticator::Key(b"sixteen bytes or more".to_vec());
/// let datagram = Body::Hello { token: 7 }.encode(header, &key)?;
/// let (_, body) = Body::decode(&datagram, &key)?;
/// assert_eq!(body, Body::Hello { token: 7 });
/// assert!(Body::decode(&datagram, &Authenticator::Checksum).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// Handshake and heartbeat: asks for a [`CityClock`]. A city that has not checked the sender's address answers with a
    /// [`Body::Challenge`] instead.
    Hello {
        /// Any number; the answer repeats it, so that the sender can measure the round-trip time.
        token: u64,
    },
    /// Adds a vehicle to the city, or takes over one whose sender is silent.
    Setup {
        /// Number of the request, unique in the session of the sender; 0 asks for no answer.
        request: u32,
        /// The vehicle: identity, start and build.
        setup: Box<VehicleSetup>,
    },
    /// Desired motions of 1 to [`MAX_TRAJECTORIES`](super::MAX_TRAJECTORIES) vehicles.
    Trajectories(Vec<Trajectory<Lab>>),
    /// Takes a vehicle out of the city.
    Remove {
        /// Number of the request, unique in the session of the sender; 0 asks for no answer.
        request: u32,
        /// The vehicle to remove.
        vehicle: VehicleId,
    },
    /// Starts, pauses or resets the experiment.
    Command {
        /// Number of the request, unique in the session of the sender; 0 asks for no answer.
        request: u32,
        /// What to do with the experiment.
        action: ExperimentAction,
    },
    /// Subscribes to the poses of every n-th tick until the lease ends; a repeated subscription renews it.
    Subscribe {
        /// Number of the request, unique in the session of the sender; 0 asks for no answer.
        request: u32,
        /// Physics steps from one pose to the next, at least 1.
        every_ticks: u16,
        /// Seconds of the wall clock, up to [`MAX_LEASE_S`]; 0 ends the subscription.
        lease_s: f64,
    },
    /// Lockstep barrier: all commands for this tick have been sent, in `count` datagrams from sequence number `first`
    /// on.
    Barrier {
        /// Tick of the poses that the commands answer.
        tick: u64,
        /// Sequence number of the first of these datagrams.
        first: u64,
        /// Number of these datagrams.
        count: u32,
    },
    /// Pedals and steering wheel of a person who drives a vehicle. Not acknowledged: a driver repeats it.
    Drive {
        /// The vehicle to drive.
        vehicle: VehicleId,
        /// Sequence number per vehicle, incremented by its driver; the city drops older ones than the newest.
        sequence: u32,
        /// Encoded [clamped](Pedals::clamped); `None` hands the vehicle back to its trajectories.
        pedals: Option<Pedals>,
    },
    /// Asks for a [`CityDescription`], which answers in place of an acknowledgement.
    Describe {
        /// Any number; the answer repeats it.
        request: u32,
    },
    /// Commands aspects of 1 to [`SignalAspects::MOST`] traffic signal heads. Not acknowledged: its sender repeats it.
    Signals(SignalAspects),
    /// Answers the [`Body::Hello`] of an address that has not been checked. It is as long as the question.
    Challenge {
        /// Token of the `Hello`, which only its sender and who reads its datagrams know.
        token: u64,
        /// What the sender has to name in the headers of all its datagrams, as `peer`; not 0.
        challenge: u64,
    },
    /// Answers [`Body::Hello`]; a physical vehicle also gets it from the sender that drives it.
    Clock(CityClock),
    /// Acknowledges the request of this number.
    Ack {
        /// Number that the request had.
        request: u32,
        /// Whether the request is carried out.
        outcome: RequestOutcome,
        /// Tick at which the city answers.
        tick: u64,
        /// Reason or remark in words, up to [`MAX_DETAIL_BYTES`]; empty if there is none.
        detail: String,
    },
    /// Poses of one tick for a subscriber.
    Poses(Poses),
    /// Answers [`Body::Describe`].
    Description(CityDescription),
    /// Aspects of traffic signal heads at the tick of the poses before it, for a subscriber.
    ShownSignals(SignalAspects),
    /// Why vehicles do what they do, by the sender that controls them. Not acknowledged; nothing in the city depends on it.
    Decisions(Decisions),
    /// The same as the city has heard it, for a subscriber.
    ShownDecisions(Decisions),
    /// Plans through control zones, by the sender that controls the vehicles. Not acknowledged; nothing in the city depends
    /// on them.
    Plans(Plans),
    /// The same as the city has heard it, for a subscriber.
    ShownPlans(Plans),
}

pub(super) const HELLO: u8 = 1;
const SETUP: u8 = 2;
const TRAJECTORIES: u8 = 3;
const REMOVE: u8 = 4;
const COMMAND: u8 = 5;
const SUBSCRIBE: u8 = 6;
const BARRIER: u8 = 7;
const DRIVE: u8 = 8;
const DESCRIBE: u8 = 9;
const SIGNALS: u8 = 10;
const DECISIONS: u8 = 11;
const PLANS: u8 = 12;
const CLOCK: u8 = 65;
const ACK: u8 = 66;
const POSES: u8 = 67;
const DESCRIPTION: u8 = 68;
// 69 is a denial.
const CHALLENGE: u8 = 70;
const SHOWN_SIGNALS: u8 = 71;
const SHOWN_DECISIONS: u8 = 72;
const SHOWN_PLANS: u8 = 73;

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
            Self::Drive { .. } => DRIVE,
            Self::Describe { .. } => DESCRIBE,
            Self::Clock(_) => CLOCK,
            Self::Ack { .. } => ACK,
            Self::Poses(_) => POSES,
            Self::Description(_) => DESCRIPTION,
            Self::Challenge { .. } => CHALLENGE,
            Self::Signals(_) => SIGNALS,
            Self::ShownSignals(_) => SHOWN_SIGNALS,
            Self::Decisions(_) => DECISIONS,
            Self::ShownDecisions(_) => SHOWN_DECISIONS,
            Self::Plans(_) => PLANS,
            Self::ShownPlans(_) => SHOWN_PLANS,
        }
    }

    /// Whether its direction is to the city.
    pub fn is_to_city(&self) -> bool {
        self.kind() < CLOCK
    }

    /// Number of a request, repeated in its acknowledgement; `None` for bodies that get none, as [`Body::Describe`].
    pub fn request(&self) -> Option<u32> {
        match self {
            Self::Setup { request, .. }
            | Self::Remove { request, .. }
            | Self::Command { request, .. }
            | Self::Subscribe { request, .. } => Some(*request).filter(|request| *request != 0),
            _ => None,
        }
    }

    /// Encodes the datagram. `header.kind` is ignored: the body determines it.
    ///
    /// # Errors
    /// When a text, a list or the body is too long for a datagram.
    pub fn encode(
        &self,
        header: DatagramHeader,
        authenticator: &Authenticator,
    ) -> Result<Vec<u8>, EncodeError> {
        let mut out = ByteWriter::default();
        self.write(&mut out)?;
        let (found, most) = (out.bytes.len(), super::MAX_BODY_BYTES);
        if found > most {
            return Err(EncodeError { what: "body bytes", found, most });
        }
        Ok(authenticator.seal(DatagramHeader { kind: self.kind(), ..header }, &out.bytes))
    }

    /// Verifies and decodes a datagram into its header and body.
    ///
    /// # Errors
    /// The fault and its place; nothing of the datagram may be used then.
    pub fn decode(
        bytes: &[u8],
        authenticator: &Authenticator,
    ) -> Result<(DatagramHeader, Self), DecodeError> {
        let (header, body) = Self::open(bytes, authenticator)?;
        Ok((header, body?))
    }

    /// Verifies a datagram, and decodes its body, which may have a fault in a datagram that is authentic.
    ///
    /// # Errors
    /// The fault and its place: the header must not be used either.
    pub fn open(
        bytes: &[u8],
        authenticator: &Authenticator,
    ) -> Result<(DatagramHeader, Result<Self, DecodeError>), DecodeError> {
        let (header, end) = authenticator.verify(bytes)?;
        let mut from = ByteReader::new(&bytes[..end], super::HEADER_BYTES);
        let body = Self::read(header.kind, &mut from).and_then(|body| from.finish().map(|()| body));
        Ok((header, body))
    }

    /// Encodes kind and body for a log.
    ///
    /// # Errors
    /// As for [`Body::encode`].
    pub fn to_log(&self) -> Result<(u8, Vec<u8>), EncodeError> {
        let mut out = ByteWriter::default();
        self.write(&mut out)?;
        Ok((self.kind(), out.bytes))
    }

    /// Whether a kind of a log is a vehicle's setup.
    pub fn is_setup(kind: u8) -> bool {
        kind == SETUP
    }

    /// Decodes a body from a log.
    ///
    /// # Errors
    /// The fault and its place.
    pub fn from_log(kind: u8, bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut from = ByteReader::new(bytes, 0);
        let body = Self::read(kind, &mut from)?;
        from.finish()?;
        Ok(body)
    }

    fn write(&self, out: &mut ByteWriter) -> Result<(), EncodeError> {
        if let Self::Setup { request, .. }
        | Self::Remove { request, .. }
        | Self::Command { request, .. }
        | Self::Subscribe { request, .. }
        | Self::Describe { request }
        | Self::Ack { request, .. } = self
        {
            out.u32(*request);
        }
        match self {
            Self::Hello { token } => {
                out.u64(*token);
                out.u64(HELLO_PADDING);
            }
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
            Self::Drive { vehicle, sequence, pedals } => {
                out.u32(vehicle.0);
                out.u32(*sequence);
                drive::write(*pedals, out);
            }
            Self::Describe { .. } => {}
            Self::Clock(clock) => clock.write(out),
            Self::Ack { outcome, tick, detail, .. } => {
                out.u8(*outcome as u8);
                out.u64(*tick);
                out.text("detail", detail, MAX_DETAIL_BYTES)?;
            }
            Self::Poses(poses) => poses.write(out)?,
            Self::Description(description) => description.write(out)?,
            Self::Signals(aspects) | Self::ShownSignals(aspects) => signals::write(aspects, out)?,
            Self::Decisions(told) | Self::ShownDecisions(told) => told.write(out)?,
            Self::Plans(told) | Self::ShownPlans(told) => told.write(out)?,
            Self::Challenge { token, challenge } => {
                out.u64(*token);
                out.u64(*challenge);
            }
        }
        Ok(())
    }

    fn read(kind: u8, from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        let request = match kind {
            SETUP | REMOVE | COMMAND | SUBSCRIBE | DESCRIBE | ACK => from.u32("request")?,
            _ => 0,
        };
        Ok(match kind {
            HELLO => {
                let token = from.u64("token")?;
                match from.u64("reserved")? {
                    HELLO_PADDING => Self::Hello { token },
                    found => {
                        return Err(from.error("reserved", 8, DecodeFault::Unknown { found, known: "0" }));
                    }
                }
            }
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
                Self::Subscribe { request, every_ticks, lease_s: from.number("lease", 0.0, MAX_LEASE_S)? }
            }
            BARRIER => Self::Barrier {
                tick: from.u64("tick")?,
                first: from.u64("first sequence")?,
                count: from.u32("datagrams")?,
            },
            DRIVE => Self::Drive {
                vehicle: VehicleId(from.u32("vehicle id")?),
                sequence: from.u32("drive sequence")?,
                pedals: drive::read(from)?,
            },
            DESCRIBE => Self::Describe { request },
            SIGNALS => Self::Signals(signals::read(from)?),
            SHOWN_SIGNALS => Self::ShownSignals(signals::read(from)?),
            DECISIONS => Self::Decisions(Decisions::read(from)?),
            SHOWN_DECISIONS => Self::ShownDecisions(Decisions::read(from)?),
            PLANS => Self::Plans(Plans::read(from)?),
            SHOWN_PLANS => Self::ShownPlans(Plans::read(from)?),
            CLOCK => Self::Clock(CityClock::read(from)?),
            ACK => Self::Ack {
                request,
                outcome: from.one_of("outcome", &OUTCOMES, "0 (done), 1 (busy) and 2 (refused)")?,
                tick: from.u64("tick")?,
                detail: from.text("detail", MAX_DETAIL_BYTES)?,
            },
            POSES => Self::Poses(Poses::read(from)?),
            DESCRIPTION => Self::Description(CityDescription::read(from)?),
            CHALLENGE => {
                let token = from.u64("token")?;
                match from.u64("challenge")? {
                    0 => {
                        let fault = DecodeFault::Unknown { found: 0, known: "those from 1 on" };
                        return Err(from.error("challenge", 8, fault));
                    }
                    challenge => Self::Challenge { token, challenge },
                }
            }
            found => {
                let fault =
                    DecodeFault::Unknown { found: found.into(), known: "1 to 12, 65 to 68, and 70 to 73" };
                return Err(DecodeError { field: "kind", offset: 5, fault });
            }
        })
    }
}

/// Makes a `Hello` as long as the challenge that may answer it.
const HELLO_PADDING: u64 = 0;

const KNOWN_PHASES: &str = "0 (ready), 1 (running) and 2 (paused)";

impl CityClock {
    fn write(&self, out: &mut ByteWriter) {
        out.u64(self.token);
        out.u64(self.tick);
        out.f64(self.time_s);
        out.u32(self.physics_hz);
        out.f64(self.length_scale);
        out.u8(self.phase as u8);
        out.u8(u8::from(self.is_lockstep));
    }

    fn read(from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            token: from.u64("token")?,
            tick: from.u64("tick")?,
            time_s: from.number("time", 0.0, MAX_TIME_S)?,
            physics_hz: from.u32("physics rate")?,
            length_scale: from.number("length scale", 0.0, 1e6)?,
            phase: from.one_of("phase", &PHASES, KNOWN_PHASES)?,
            is_lockstep: from.one_of("lockstep", &[false, true], "0 and 1")?,
        })
    }
}

impl Poses {
    fn write(&self, out: &mut ByteWriter) -> Result<(), EncodeError> {
        out.u64(self.tick);
        out.f64(self.time_s);
        out.u64(self.state_hash);
        out.u8(self.phase as u8);
        out.u8(self.part);
        out.u8(self.parts);
        out.count("poses", self.vehicles.len(), MAX_POSES)?;
        for observed in &self.vehicles {
            out.u32(observed.pose.vehicle.0);
            out.u8(observed.status as u8);
            [0; 3].into_iter().for_each(|byte| out.u8(byte));
            let (position, turn) = (observed.pose.position.to_array(), observed.pose.orientation.to_array());
            position.into_iter().chain(turn).for_each(|number| out.f64(number));
        }
        Ok(())
    }

    fn read(from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        let tick = from.u64("tick")?;
        let time_s = from.number("time", 0.0, MAX_TIME_S)?;
        let state_hash = from.u64("state hash")?;
        let phase = from.one_of("phase", &PHASES, KNOWN_PHASES)?;
        let (part, parts) = (from.u8("part")?, from.u8("parts")?);
        let parts = from.within("parts", parts, (part.saturating_add(1), u8::MAX))?;
        let count = from.u8("poses")?;
        let count = from.within("poses", count, (0, MAX_POSES as u8))?;
        let vehicles = (0..count).map(|_| ObservedVehicle::read(from, time_s)).collect::<Result<_, _>>()?;
        Ok(Self { tick, time_s, state_hash, phase, part, parts, vehicles })
    }
}

impl ObservedVehicle {
    fn read(from: &mut ByteReader<'_>, stamp_s: f64) -> Result<Self, DecodeError> {
        let vehicle = VehicleId(from.u32("vehicle id")?);
        let status = from.one_of("status", &Status::ALL, "0 (waiting) to 9 (unseen)")?;
        for _ in 0..3 {
            let found = from.u8("reserved")?;
            from.within("reserved", found, (0, 0))?;
        }
        let mut position = DVec3::ZERO;
        for (field, metres) in ["x", "y", "z"].into_iter().zip(position.as_mut()) {
            *metres = from.number(field, -MAX_COORDINATE_M, MAX_COORDINATE_M)?;
        }
        let mut turn = [0.0; 4];
        for (field, part) in ["qx", "qy", "qz", "qw"].into_iter().zip(&mut turn) {
            *part = from.number(field, -1.001, 1.001)?;
        }
        let orientation = DQuat::from_array(turn);
        let norm = orientation.length();
        if !super::UNIT_NORM.contains(&norm) {
            let (least, most) = (*super::UNIT_NORM.start(), *super::UNIT_NORM.end());
            let fault = DecodeFault::OutOfRange { found: norm, least, most };
            return Err(from.error("length of the quaternion", size_of_val(&turn), fault));
        }
        Ok(Self { pose: Measurement { vehicle, stamp_s, position, orientation }, status })
    }
}
