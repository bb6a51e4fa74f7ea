//! Log messages of the control framework's decisions: their schema in the ROS 2 interface definition language, and their
//! CDR encoding.

use city3d_protocol::cdr::{CdrReader, CdrWriter};
use city3d_protocol::snapshot::{ControlDecision, DecisionReason, VehicleId};
use glam::DVec2;

/// Topic of the decisions.
pub const DECISIONS_TOPIC: &str = "/city3d/decisions";
/// Name of the ROS 2 type of decisions.
pub const DECISIONS_TYPE: &str = "city3d_msgs/msg/Decisions";
/// Definition of [`DECISIONS_TYPE`].
pub const DECISIONS_SCHEMA: &str = "\
# Why vehicles do what they do, as the control framework tells it. City frame: full-scale metres, x east, y north.
# They hold in the snapshot of this tick, and until the next ones of the same vehicle, but no longer than 1.1 s.
uint64 tick
# Simulated time, seconds.
float64 time
# In id order; vehicles whose decision is as it was told before may be missing.
city3d_msgs/Decision[] decisions
================================================================================
MSG: city3d_msgs/Decision
uint32 vehicle
# What limits it: free road 0, speed of a bend or limit 1, the vehicle ahead 2, its predecessor in a platoon 3, the end
# of its route 4, a stop line 5, a yield line 6, a signal 7, a junction without a line 8, no room behind the junction 9,
# a crossing 10, a vehicle that merges 11, its coordinated plan 12, the safety filter 13, not measured 14, on no lane 15
uint8 reason
# Bits: 1 there is another vehicle, 2 there is a place.
uint8 flags
# The vehicle that it follows or gives way to.
uint32 other
# Where it has to stop.
float32 x
float32 y
# Speed that its route and its driver allow, and planned acceleration.
float32 target_speed
float32 acceleration
# How far its plan is ahead of its measured pose, along the route.
float32 longitudinal_error
";

const OTHER: u8 = 1;
const PLACE: u8 = 2;

/// Decisions in a log, in its precision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoggedDecisions {
    /// Physics steps since the start or the last reset.
    pub tick: u64,
    /// Simulated time, seconds.
    pub time_s: f64,
    /// In id order, full scale.
    pub decisions: Vec<ControlDecision>,
}

/// Appends the message of decisions to a buffer; of each its lasting part.
pub fn encode_decisions(tick: u64, time_s: f64, decisions: &[ControlDecision], buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::behind(buffer);
    cdr.u64(tick);
    cdr.f64(time_s);
    cdr.u32(decisions.len() as u32);
    for decision in decisions {
        let ControlDecision { vehicle, reason, other, place, .. } = decision.lasting();
        cdr.u32(vehicle.0);
        cdr.u8(reason as u8);
        cdr.u8((u8::from(other.is_some()) * OTHER) | (u8::from(place.is_some()) * PLACE));
        cdr.u32(other.map_or(0, |other| other.0));
        let motion = [decision.target_mps, decision.acceleration_mps2, decision.longitudinal_error_m];
        let numbers = place.unwrap_or_default().to_array().into_iter().chain(motion);
        numbers.for_each(|number| cdr.f32(number as f32));
    }
    cdr.into_bytes()
}

/// `None` for a damaged message.
pub fn decode_decisions(bytes: &[u8]) -> Option<LoggedDecisions> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, time_s, count) = (cdr.u64()?, cdr.f64()?, cdr.u32()?);
    if !time_s.is_finite() {
        return None;
    }
    let mut decisions = Vec::new();
    for _ in 0..count {
        let (vehicle, reason, flags) = (VehicleId(cdr.u32()?), cdr.u8()?, cdr.u8()?);
        let other = VehicleId(cdr.u32()?);
        let mut numbers = [0.0; 5];
        for number in &mut numbers {
            *number = f64::from(cdr.f32()?);
        }
        if !numbers.into_iter().all(f64::is_finite) {
            return None;
        }
        let [x, y, target_mps, acceleration_mps2, longitudinal_error_m] = numbers;
        // Of a later version there may be other reasons: of those nothing is known here.
        let Some(&reason) = DecisionReason::ALL.get(usize::from(reason)) else { continue };
        decisions.push(ControlDecision {
            vehicle,
            reason,
            other: (flags & OTHER != 0).then_some(other),
            place: (flags & PLACE != 0).then_some(DVec2::new(x, y)),
            target_mps,
            acceleration_mps2,
            longitudinal_error_m,
            measured: None,
        });
    }
    Some(LoggedDecisions { tick, time_s, decisions })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(vehicle: u32, reason: DecisionReason) -> ControlDecision {
        ControlDecision {
            vehicle: VehicleId(vehicle),
            reason,
            other: (vehicle == 7).then_some(VehicleId(9)),
            place: (vehicle == 7).then_some(DVec2::new(12.5, -3.25)),
            target_mps: 8.75,
            acceleration_mps2: -0.5,
            longitudinal_error_m: 0.125,
            measured: None,
        }
    }

    #[test]
    fn decisions_are_read_as_they_were_written() {
        let decisions = vec![told(7, DecisionReason::YieldLine), told(8, DecisionReason::Signal)];
        let bytes = encode_decisions(250, 2.5, &decisions, Vec::new());
        assert_eq!(decode_decisions(&bytes), Some(LoggedDecisions { tick: 250, time_s: 2.5, decisions }));
        assert!((0..bytes.len()).all(|end| decode_decisions(&bytes[..end]).is_none()), "none of a part");
    }

    #[test]
    fn a_reason_of_a_later_version_is_left_out_and_what_is_not_finite_is_damage() {
        let decisions = [told(7, DecisionReason::YieldLine), told(8, DecisionReason::Signal)];
        let mut bytes = encode_decisions(250, 2.5, &decisions, Vec::new());
        let reason = 4 + 8 + 8 + 4 + 4;
        assert_eq!(bytes[reason], DecisionReason::YieldLine as u8);
        bytes[reason] = 200;
        assert_eq!(decode_decisions(&bytes).unwrap().decisions, decisions[1..]);
        let last = bytes.len() - 4;
        bytes[last..].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_eq!(decode_decisions(&bytes), None);
    }
}
