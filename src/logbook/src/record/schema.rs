//! Log messages: their schemas in the ROS 2 interface definition language, and their CDR encoding.

use city3d_geometry::Pose2;
use city3d_protocol::cdr::{CdrReader, CdrWriter};
use city3d_protocol::snapshot::{
    Aspect, Event, FrameSnapshot, Indicator, MeasuredPose, Pedals, Setup, SignalAspects, SignalHeadId,
    SimCommand, Status, Trajectory, TrajectoryPoint, VehicleId, VehicleState, WheelState,
};
use glam::{DQuat, DVec3};

/// Name of the ROS 2 type of snapshots.
pub const SNAPSHOT_TYPE: &str = "city3d_msgs/msg/Snapshot";
/// Definition of [`SNAPSHOT_TYPE`].
pub const SNAPSHOT_SCHEMA: &str = "\
# One instant of a run. City frame: full-scale metres, x east, y north, z up; SI units, radians.
uint64 tick
# Simulated time, seconds.
float64 time
# Digest of the state: equal at every tick when two runs are the same.
uint64 state_hash
# In id order.
city3d_msgs/VehicleState[] vehicles
================================================================================
MSG: city3d_msgs/VehicleState
uint32 id
# waiting 0, driving 1, yielding 2, stopped 3, manual 4, link lost 5, collided 6, finished 7, physical 8,
# unseen 9
uint8 status
# Bits: 1 reverse, 2 brake lights, 4 left indicator, 8 right indicator.
uint8 lights
# Middle of the outline, on the ground.
float64 x
float64 y
float64 z
# City from body; body axes forward, left, up.
float32 qx
float32 qy
float32 qz
float32 qw
# Along the heading.
float32 speed
float32 acceleration
float32 yaw_rate
# Front axle, left-positive.
float32 steering
# Pedals in [0, 1].
float32 gas
float32 brake
float32 handbrake
# Front-axle centre from the desired path, left-positive.
float32 lateral_error
float32 distance
# Rolled angle of each wheel: front left, front right, rear left, rear right.
float32[4] wheel_spin
";

/// [`SNAPSHOT_SCHEMA`] of a city with traffic signals.
pub fn snapshot_schema_with_signals() -> String {
    let vehicles = "city3d_msgs/VehicleState[] vehicles\n";
    let signals = "# Aspects of the signal heads by their numbers: dark 0, red 1, yellow 2, green 3.\nuint8[] signals\n";
    SNAPSHOT_SCHEMA.replacen(vehicles, &format!("{vehicles}{signals}"), 1)
}

/// Name of the ROS 2 type of events.
pub const EVENT_TYPE: &str = "city3d_msgs/msg/Event";
/// Definition of [`EVENT_TYPE`].
pub const EVENT_SCHEMA: &str = "\
# Something that happened to a vehicle.
# Simulated time, seconds.
float64 time
uint32 vehicle
# spawn, moved, stop, go, yield, merge, collision, collision_static, link_lost, link_back, finish, remove
string kind
# The whole event as JSON.
string json
";

/// The message of a snapshot, in a buffer whose old content is dropped. With signals it has one field more,
/// see [`LogTopic::schema`](super::LogTopic::schema).
pub fn encode_snapshot(snapshot: &FrameSnapshot, has_signals: bool, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::reusing(buffer);
    cdr.u64(snapshot.tick);
    cdr.f64(snapshot.time_s);
    cdr.u64(snapshot.state_hash);
    cdr.u32(snapshot.vehicles.len() as u32);
    for vehicle in &snapshot.vehicles {
        LoggedVehicle::of(vehicle).write(&mut cdr);
    }
    if has_signals {
        let aspects: Vec<u8> = snapshot.signals.iter().map(|aspect| *aspect as u8).collect();
        cdr.octets(&aspects);
    }
    cdr.into_bytes()
}

/// Bits of `lights`.
const REVERSE: u8 = 1;
const BRAKE_LIGHTS: u8 = 2;
/// Bits of the indicators in `lights` and `flags`.
const LEFT: u8 = 4;
const RIGHT: u8 = 8;

fn indicator_bits(indicator: Indicator) -> u8 {
    match indicator {
        Indicator::Off => 0,
        Indicator::Left => LEFT,
        Indicator::Right => RIGHT,
        Indicator::Hazard => LEFT | RIGHT,
    }
}

fn indicator_of(bits: u8) -> Indicator {
    match (bits & LEFT != 0, bits & RIGHT != 0) {
        (false, false) => Indicator::Off,
        (true, false) => Indicator::Left,
        (false, true) => Indicator::Right,
        (true, true) => Indicator::Hazard,
    }
}

/// The message of an event, in a buffer whose old content is dropped.
pub fn encode_event(event: &Event, buffer: Vec<u8>) -> Vec<u8> {
    let json = serde_json::to_value(event).unwrap_or_default();
    let mut cdr = CdrWriter::reusing(buffer);
    cdr.f64(event.time_s);
    cdr.u32(event.vehicle.0);
    cdr.string(json["kind"].as_str().unwrap_or_default());
    cdr.string(&json.to_string());
    cdr.into_bytes()
}

/// `None` for a damaged message.
pub fn decode_event(bytes: &[u8]) -> Option<Event> {
    let mut cdr = CdrReader::new(bytes)?;
    let (_time, _vehicle, _kind) = (cdr.f64()?, cdr.u32()?, cdr.string()?);
    serde_json::from_str(&cdr.string()?).ok()
}

/// Name of the ROS 2 type of commands of persons.
pub const COMMAND_TYPE: &str = "city3d_msgs/msg/Command";
/// Definition of [`COMMAND_TYPE`].
pub const COMMAND_SCHEMA: &str = "\
# What a person did, beside the trajectories of the control framework: with the scenario it makes the
# run again exactly.
# It was applied in the step that begins at this tick.
uint64 tick
uint32 vehicle
# drive 0 (the person takes it over, or drives on with these pedals), release 1 (the person gives it
# back), remove 2
uint8 kind
# Bits: 1 reverse, 4 left indicator, 8 right indicator.
uint8 lights
# Pedals in [0, 1].
float64 gas
float64 brake
float64 handbrake
# Desired angle of the front axle, left-positive, radians.
float64 steering
";

const DRIVE: u8 = 0;
const RELEASE: u8 = 1;
const REMOVE: u8 = 2;

/// A command of a person to a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonCommand {
    vehicle: VehicleId,
    kind: u8,
    pedals: Pedals,
}

impl PersonCommand {
    /// `None` for other commands.
    pub fn of(command: &SimCommand) -> Option<Self> {
        let (vehicle, kind, pedals) = match command {
            SimCommand::Drive(vehicle, pedals) => (*vehicle, DRIVE, *pedals),
            SimCommand::Release(vehicle) => (*vehicle, RELEASE, Pedals::default()),
            SimCommand::Remove(vehicle) => (*vehicle, REMOVE, Pedals::default()),
            SimCommand::Start
            | SimCommand::Pause
            | SimCommand::Reset
            | SimCommand::Spawn(_)
            | SimCommand::Measure(..)
            | SimCommand::Signals(_)
            | SimCommand::Follow(_) => return None,
        };
        Some(Self { vehicle, kind, pedals })
    }
}

/// Appends the message of a command of a person to a buffer.
pub fn encode_command(tick: u64, command: PersonCommand, buffer: Vec<u8>) -> Vec<u8> {
    let PersonCommand { vehicle, kind, pedals } = command;
    let mut cdr = CdrWriter::behind(buffer);
    cdr.u64(tick);
    cdr.u32(vehicle.0);
    cdr.u8(kind);
    cdr.u8(u8::from(pedals.reverse) | indicator_bits(pedals.indicator));
    for number in [pedals.gas, pedals.brake, pedals.handbrake, pedals.steering_rad] {
        cdr.f64(number);
    }
    cdr.into_bytes()
}

/// The tick and the command of a message; `None` for a damaged message.
pub fn decode_command(bytes: &[u8]) -> Option<(u64, SimCommand)> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, vehicle) = (cdr.u64()?, VehicleId(cdr.u32()?));
    let (kind, lights) = (cdr.u8()?, cdr.u8()?);
    let pedals = Pedals {
        gas: cdr.f64()?,
        brake: cdr.f64()?,
        handbrake: cdr.f64()?,
        steering_rad: cdr.f64()?,
        reverse: lights & 1 != 0,
        indicator: indicator_of(lights),
    };
    let command = match kind {
        DRIVE => SimCommand::Drive(vehicle, pedals),
        RELEASE => SimCommand::Release(vehicle),
        REMOVE => SimCommand::Remove(vehicle),
        _ => return None,
    };
    Some((tick, command))
}

/// Name of the ROS 2 type of measured poses.
pub const MEASURED_TYPE: &str = "city3d_msgs/msg/MeasuredPose";
/// Definition of [`MEASURED_TYPE`].
pub const MEASURED_SCHEMA: &str = "\
# Where a physical vehicle was measured to be. City frame: full-scale metres, x east, y north, z up.
# It was applied in the step that begins at this tick.
uint64 tick
uint32 vehicle
# Simulated time of the measurement, seconds.
float64 stamp
# Middle of the outline, on the ground.
float64[3] position
# Quaternion x, y, z, w: city from body, body axes forward, left, up.
float64[4] orientation
";

/// Appends the message of a measured pose to a buffer.
pub fn encode_measured(tick: u64, vehicle: VehicleId, pose: &MeasuredPose, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::behind(buffer);
    cdr.u64(tick);
    cdr.u32(vehicle.0);
    cdr.f64(pose.stamp_s);
    let numbers = pose.position.to_array().into_iter().chain(pose.orientation.to_array());
    numbers.for_each(|number| cdr.f64(number));
    cdr.into_bytes()
}

/// The tick and the command of a message; `None` for a damaged message.
pub fn decode_measured(bytes: &[u8]) -> Option<(u64, SimCommand)> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, vehicle, stamp_s) = (cdr.u64()?, VehicleId(cdr.u32()?), cdr.f64()?);
    let position = DVec3::new(cdr.f64()?, cdr.f64()?, cdr.f64()?);
    let orientation = DQuat::from_xyzw(cdr.f64()?, cdr.f64()?, cdr.f64()?, cdr.f64()?);
    Some((tick, SimCommand::Measure(vehicle, MeasuredPose { stamp_s, position, orientation })))
}

/// Name of the ROS 2 type of arrivals.
pub const ARRIVAL_TYPE: &str = "city3d_msgs/msg/Arrival";
/// Definition of [`ARRIVAL_TYPE`].
pub const ARRIVAL_SCHEMA: &str = "\
# A vehicle of an inflow enters the city at its entry; the scenario says what it is.
# It enters in the step that begins at this tick.
uint64 tick
uint32 vehicle
# Metres per second, full scale.
float64 speed
";

/// Appends the message of a vehicle that enters to a buffer.
pub fn encode_arrival(tick: u64, setup: &Setup, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::behind(buffer);
    cdr.u64(tick);
    cdr.u32(setup.id.0);
    cdr.f64(setup.speed_mps);
    cdr.into_bytes()
}

/// The tick, the vehicle and its speed of a message; `None` for a damaged message.
pub fn decode_arrival(bytes: &[u8]) -> Option<(u64, VehicleId, f64)> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, vehicle, speed_mps) = (cdr.u64()?, VehicleId(cdr.u32()?), cdr.f64()?);
    speed_mps.is_finite().then_some((tick, vehicle, speed_mps))
}

/// Name of the ROS 2 type of ticks.
pub const TICK_TYPE: &str = "city3d_msgs/msg/Tick";
/// Definition of [`TICK_TYPE`].
pub const TICK_SCHEMA: &str = "\
# One physics step of a run, or its beginning.
uint64 tick
# Digest of the state: what a run that is simulated again has to come to.
uint64 state_hash
";

/// The message of a tick, in a buffer whose old content is dropped.
pub fn encode_tick(tick: u64, state_hash: u64, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::reusing(buffer);
    cdr.u64(tick);
    cdr.u64(state_hash);
    cdr.into_bytes()
}

/// The tick and its digest; `None` for a damaged message.
pub fn decode_tick(bytes: &[u8]) -> Option<(u64, u64)> {
    let mut cdr = CdrReader::new(bytes)?;
    Some((cdr.u64()?, cdr.u64()?))
}

/// Name of the ROS 2 type of trajectories.
pub const TRAJECTORY_TYPE: &str = "city3d_msgs/msg/Trajectory";
/// Definition of [`TRAJECTORY_TYPE`].
pub const TRAJECTORY_SCHEMA: &str = "\
# The desired motion of a vehicle, as the control framework has told it and as it reached the vehicle.
# City frame: full-scale metres, x east, y north; SI units, radians.
# It was applied in the step that begins at this tick.
uint64 tick
uint32 vehicle
# Counted by the sender.
uint32 sequence
# Bits: 1 yielding, 2 at the end of its route, 4 left indicator, 8 right indicator.
uint8 flags
# Its points in time order, column by column, each with one number for every point.
# Simulated time at which the vehicle shall be there, seconds.
float64[] time
# Of the front-axle centre.
float64[] x
float64[] y
float64[] yaw
float64[] speed
";

const YIELDING: u8 = 1;
const FINISHED: u8 = 2;

/// Appends the message of a trajectory to a buffer.
pub fn encode_trajectory(tick: u64, trajectory: &Trajectory, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::behind(buffer);
    cdr.u64(tick);
    cdr.u32(trajectory.vehicle.0);
    cdr.u32(trajectory.sequence);
    let state = (u8::from(trajectory.yielding) * YIELDING) | (u8::from(trajectory.finished) * FINISHED);
    cdr.u8(state | indicator_bits(trajectory.indicator));
    // Columns of like numbers compress better than rows of unlike ones.
    let points = &trajectory.points;
    cdr.f64s(points.iter().map(|point| point.time_s));
    cdr.f64s(points.iter().map(|point| point.pose.position.x));
    cdr.f64s(points.iter().map(|point| point.pose.position.y));
    cdr.f64s(points.iter().map(|point| point.pose.yaw_rad));
    cdr.f64s(points.iter().map(|point| point.speed_mps));
    cdr.into_bytes()
}

/// The tick and the trajectory of a message; `None` for a damaged message.
pub fn decode_trajectory(bytes: &[u8]) -> Option<(u64, Trajectory)> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, vehicle, sequence, flags) = (cdr.u64()?, VehicleId(cdr.u32()?), cdr.u32()?, cdr.u8()?);
    let [times, xs, ys, yaws, speeds] = [cdr.f64s()?, cdr.f64s()?, cdr.f64s()?, cdr.f64s()?, cdr.f64s()?];
    if [&xs, &ys, &yaws, &speeds].into_iter().any(|column| column.len() != times.len()) {
        return None;
    }
    let point = |k: usize| TrajectoryPoint {
        time_s: times[k],
        pose: Pose2::new(xs[k], ys[k], yaws[k]),
        speed_mps: speeds[k],
    };
    let points = (0..times.len()).map(point).collect();
    let (yielding, finished) = (flags & YIELDING != 0, flags & FINISHED != 0);
    Some((tick, Trajectory { vehicle, sequence, points, yielding, finished, indicator: indicator_of(flags) }))
}

/// One vehicle in a logged snapshot, in the precision of the log.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedVehicle {
    /// Number of the vehicle, unique in the run.
    pub id: VehicleId,
    status: u8,
    lights: u8,
    /// Middle of the outline, city metres.
    pub position: DVec3,
    /// Orientation, then the numbers in the order of the schema.
    numbers: [f32; NUMBERS],
}

/// Single-precision numbers of a vehicle in a snapshot.
const NUMBERS: usize = 4 + 9 + 4;

impl LoggedVehicle {
    /// The logged part of a state.
    pub fn of(v: &VehicleState) -> Self {
        let rest = [
            v.speed_mps,
            v.acceleration_mps2,
            v.yaw_rate_radps,
            v.steering_rad,
            v.gas,
            v.brake,
            v.handbrake,
            v.lateral_error_m,
            v.distance_m,
        ];
        let all = v.orientation.to_array().into_iter().chain(rest);
        let all = all.chain(v.wheels.iter().map(|wheel| wheel.spin_rad));
        let mut numbers = [0.0; NUMBERS];
        numbers.iter_mut().zip(all).for_each(|(number, exact)| *number = exact as f32);
        let lights = (u8::from(v.reverse) * REVERSE)
            | (u8::from(v.brake_lights) * BRAKE_LIGHTS)
            | indicator_bits(v.indicator);
        Self { id: v.id, status: v.status as u8, lights, position: v.position, numbers }
    }

    /// The state as far as the log holds it, without velocity across the heading and wheel lift.
    pub fn state(&self) -> VehicleState {
        let number = |index: usize| f64::from(self.numbers[index]);
        let mut wheels = [WheelState::default(); 4];
        wheels.iter_mut().enumerate().for_each(|(index, wheel)| wheel.spin_rad = number(13 + index));
        VehicleState {
            id: self.id,
            status: Status::ALL.get(usize::from(self.status)).copied().unwrap_or_default(),
            position: self.position,
            orientation: DQuat::from_xyzw(number(0), number(1), number(2), number(3)),
            velocity_mps: DVec3::ZERO,
            speed_mps: number(4),
            acceleration_mps2: number(5),
            yaw_rate_radps: number(6),
            steering_rad: number(7),
            gas: number(8),
            brake: number(9),
            handbrake: number(10),
            reverse: self.lights & REVERSE != 0,
            brake_lights: self.lights & BRAKE_LIGHTS != 0,
            indicator: indicator_of(self.lights),
            wheels,
            lateral_error_m: number(11),
            distance_m: number(12),
        }
    }

    fn write(&self, cdr: &mut CdrWriter) {
        cdr.u32(self.id.0);
        cdr.u8(self.status);
        cdr.u8(self.lights);
        self.position.to_array().into_iter().for_each(|metres| cdr.f64(metres));
        self.numbers.into_iter().for_each(|number| cdr.f32(number));
    }

    fn read(cdr: &mut CdrReader<'_>) -> Option<Self> {
        let (id, status, lights) = (VehicleId(cdr.u32()?), cdr.u8()?, cdr.u8()?);
        let position = DVec3::new(cdr.f64()?, cdr.f64()?, cdr.f64()?);
        let mut numbers = [0.0; NUMBERS];
        for number in &mut numbers {
            *number = cdr.f32()?;
        }
        let pose = numbers.iter().take(4).copied().map(f64::from).chain(position.to_array());
        if !pose.into_iter().all(f64::is_finite) {
            return None;
        }
        Some(Self { id, status, lights, position, numbers })
    }
}

/// A snapshot in a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedSnapshot {
    /// Physics steps since the start or the last reset.
    pub tick: u64,
    /// Simulated time, seconds.
    pub time_s: f64,
    /// Digest of the whole state, also of what the log does not hold.
    pub state_hash: u64,
    /// In id order.
    pub vehicles: Vec<LoggedVehicle>,
    /// By head; empty in a city without signals.
    pub signals: Vec<Aspect>,
}

/// `None` for a damaged message.
pub fn decode_snapshot(bytes: &[u8]) -> Option<LoggedSnapshot> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, time_s, state_hash) = (cdr.u64()?, cdr.f64()?, cdr.u64()?);
    if !time_s.is_finite() {
        return None;
    }
    let mut vehicles = Vec::new();
    for _ in 0..cdr.u32()? {
        vehicles.push(LoggedVehicle::read(&mut cdr)?);
    }
    let signals = if cdr.is_at_end() { Vec::new() } else { aspects_of(cdr.octets()?)? };
    Some(LoggedSnapshot { tick, time_s, state_hash, vehicles, signals })
}

/// `None` for a number that is no aspect.
fn aspects_of(numbers: &[u8]) -> Option<Vec<Aspect>> {
    numbers.iter().map(|number| Aspect::ALL.get(usize::from(*number)).copied()).collect()
}

/// Name of the ROS 2 type of commands of traffic signals.
pub const SIGNALS_TYPE: &str = "city3d_msgs/msg/Signals";
/// Definition of [`SIGNALS_TYPE`].
pub const SIGNALS_SCHEMA: &str = "\
# New aspects of traffic signal heads, as the control framework has commanded them.
# Applied in the step that begins at this tick.
uint64 tick
# Simulated time of the control step that decided, seconds.
float64 time
# Numbers of the heads.
uint32[] heads
# One for each head: dark 0, red 1, yellow 2, green 3.
uint8[] aspects
";

/// Appends the message of a command of traffic signals to a buffer.
pub fn encode_signals(tick: u64, command: &SignalAspects, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::behind(buffer);
    cdr.u64(tick);
    cdr.f64(command.stamp_s);
    cdr.u32(command.heads.len() as u32);
    command.heads.iter().for_each(|(head, _)| cdr.u32(head.0));
    let aspects: Vec<u8> = command.heads.iter().map(|(_, aspect)| *aspect as u8).collect();
    cdr.octets(&aspects);
    cdr.into_bytes()
}

/// The tick and the command of a message; `None` for a damaged message.
pub fn decode_signals(bytes: &[u8]) -> Option<(u64, SimCommand)> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, stamp_s, count) = (cdr.u64()?, cdr.f64()?, cdr.u32()?);
    let heads = (0..count).map(|_| cdr.u32().map(SignalHeadId)).collect::<Option<Vec<_>>>()?;
    let aspects = aspects_of(cdr.octets()?)?;
    if heads.len() != aspects.len() {
        return None;
    }
    let heads = heads.into_iter().zip(aspects).collect();
    Some((tick, SimCommand::Signals(SignalAspects { stamp_s, heads })))
}

/// Name of the ROS 2 type of datagrams that were carried out.
pub const NETWORK_TYPE: &str = "city3d_msgs/msg/NetworkCommand";
/// Definition of [`NETWORK_TYPE`].
pub const NETWORK_SCHEMA: &str = "\
# Something that came over the laboratory's link and was carried out.
# In the step that begins at this tick.
uint64 tick
# Address of who has sent it, or 'window' or 'motion capture'.
string sender
# Kind of the datagram and its body, as docs/wire.md has them; of trajectories and measured poses one at a time.
uint8 kind
uint8[] body
";

/// A datagram of the laboratory's link that was carried out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkCommand {
    /// Tick at which the step began that carried it out.
    pub tick: u64,
    /// Address of the sender.
    pub sender: String,
    /// Kind and body of the datagram, see [`wire`](city3d_protocol::wire).
    pub kind: u8,
    /// The encoded body, without the header and the authentication of its datagram.
    pub body: Vec<u8>,
}

/// The message of a datagram, in a buffer whose old content is dropped.
pub fn encode_network(command: &NetworkCommand, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::reusing(buffer);
    cdr.u64(command.tick);
    cdr.string(&command.sender);
    cdr.u8(command.kind);
    cdr.octets(&command.body);
    cdr.into_bytes()
}

/// `None` for a damaged message.
pub fn decode_network(bytes: &[u8]) -> Option<NetworkCommand> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, sender, kind) = (cdr.u64()?, cdr.string()?, cdr.u8()?);
    Some(NetworkCommand { tick, sender, kind, body: cdr.octets()?.to_vec() })
}

#[cfg(test)]
mod tests;
