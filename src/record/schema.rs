//! The messages of a log in ROS 2's interface language, and their encoding.

use super::cdr::CdrWriter;
use crate::snapshot::{Event, FrameSnapshot, VehicleState};

pub const SNAPSHOT_TYPE: &str = "city3d_msgs/msg/Snapshot";
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
# waiting 0, driving 1, yielding 2, stopped 3, manual 4, link lost 5, collided 6, finished 7, physical 8
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

pub const EVENT_TYPE: &str = "city3d_msgs/msg/Event";
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

pub fn encode_snapshot(snapshot: &FrameSnapshot, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::reusing(buffer);
    cdr.u64(snapshot.tick);
    cdr.f64(snapshot.time_s);
    cdr.u64(snapshot.state_hash);
    cdr.u32(snapshot.vehicles.len() as u32);
    for vehicle in &snapshot.vehicles {
        encode_vehicle(&mut cdr, vehicle);
    }
    cdr.into_bytes()
}

fn encode_vehicle(cdr: &mut CdrWriter, v: &VehicleState) {
    use crate::snapshot::Indicator::{Hazard, Left, Off, Right};
    let indicators = match v.indicator {
        Off => 0,
        Left => 4,
        Right => 8,
        Hazard => 12,
    };
    cdr.u32(v.id.0);
    cdr.u8(v.status as u8);
    cdr.u8(u8::from(v.reverse) | u8::from(v.brake_lights) << 1 | indicators);
    for metres in v.position.to_array() {
        cdr.f64(metres);
    }
    for part in v.orientation.to_array() {
        cdr.f32(part as f32);
    }
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
    for number in rest.into_iter().chain(v.wheels.iter().map(|wheel| wheel.spin_rad)) {
        cdr.f32(number as f32);
    }
}

pub fn encode_event(event: &Event, buffer: Vec<u8>) -> Vec<u8> {
    let json = serde_json::to_value(event).unwrap_or_default();
    let mut cdr = CdrWriter::reusing(buffer);
    cdr.f64(event.time_s);
    cdr.u32(event.vehicle.0);
    cdr.string(json["kind"].as_str().unwrap_or_default());
    cdr.string(&json.to_string());
    cdr.into_bytes()
}
