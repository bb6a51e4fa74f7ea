//! Encodes decisions of the control framework, several vehicles in one datagram.

use super::bytes::{ByteReader, ByteWriter};
use super::envelope::MAX_BODY_BYTES;
use super::trajectories::zero;
use super::{DecodeError, DecodeFault, EncodeError, MAX_COORDINATE_M, MAX_SPEED_MPS, MAX_TIME_S};
use crate::snapshot::{ControlDecision, DecisionReason, VehicleId};
use city3d_geometry::LengthScale;
use glam::DVec2;

/// Bytes of the time and of the number of decisions.
const HEAD_BYTES: usize = 9;
const DECISION_BYTES: usize = 52;
/// Most decisions of a datagram.
pub const MAX_DECISIONS: usize = (MAX_BODY_BYTES - HEAD_BYTES) / DECISION_BYTES;
/// Largest planned acceleration on the laboratory's floor, to either side.
pub const MAX_ACCELERATION_MPS2: f64 = 100.0;

/// Bits of what a decision has.
const OTHER: u8 = 1;
const PLACE: u8 = 2;

/// Decisions of the control framework at one instant, or some of them. Laboratory metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Decisions {
    /// Time of the city's clock at which they held.
    pub time_s: f64,
    /// 1 to [`MAX_DECISIONS`], of as many vehicles.
    pub vehicles: Vec<VehicleDecision>,
}

/// The decision for one vehicle. Laboratory metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleDecision {
    /// The vehicle that it is about.
    pub vehicle: VehicleId,
    /// What limits it.
    pub reason: DecisionReason,
    /// The vehicle that it follows or gives way to, where there is one.
    pub other: Option<VehicleId>,
    /// Where it has to stop, where that stays for some time.
    pub place: Option<DVec2>,
    /// Speed that its route and its driver allow where it is.
    pub target_mps: f64,
    /// Planned acceleration.
    pub acceleration_mps2: f64,
    /// How far its plan is ahead of its measured pose, along the route.
    pub longitudinal_error_m: f64,
}

impl Decisions {
    /// Decisions of the city at one instant, in as many parts as they need; none where there are none.
    pub fn parts(time_s: f64, decisions: &[ControlDecision], scale: LengthScale) -> Vec<Self> {
        let of = |decision: &ControlDecision| VehicleDecision::of(decision, scale);
        let part = |part: &[ControlDecision]| Self { time_s, vehicles: part.iter().map(of).collect() };
        decisions.chunks(MAX_DECISIONS).map(part).collect()
    }

    pub(super) fn write(&self, out: &mut ByteWriter) -> Result<(), EncodeError> {
        out.f64(self.time_s);
        out.count("decisions", self.vehicles.len(), MAX_DECISIONS)?;
        self.vehicles.iter().for_each(|decision| decision.write(out));
        Ok(())
    }

    pub(super) fn read(from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        let time_s = from.number("time", 0.0, MAX_TIME_S)?;
        let count = from.u8("decisions")?;
        let count = from.within("decisions", count, (1, MAX_DECISIONS as u8))?;
        let vehicles = (0..count).map(|_| VehicleDecision::read(from)).collect::<Result<_, _>>()?;
        Ok(Self { time_s, vehicles })
    }
}

impl VehicleDecision {
    /// The lasting part of a decision of the full-scale city, within the ranges of the wire.
    pub fn of(decision: &ControlDecision, scale: LengthScale) -> Self {
        let ControlDecision { vehicle, reason, other, place, .. } = decision.lasting();
        let most = DVec2::splat(MAX_COORDINATE_M);
        let within = |metres: f64, most: f64| scale.lab_from_city(metres).clamp(-most, most);
        Self {
            vehicle,
            reason,
            other,
            place: place.map(|place| (place / scale.factor()).clamp(-most, most)),
            target_mps: within(decision.target_mps, MAX_SPEED_MPS).max(0.0),
            acceleration_mps2: within(decision.acceleration_mps2, MAX_ACCELERATION_MPS2),
            longitudinal_error_m: within(decision.longitudinal_error_m, MAX_COORDINATE_M),
        }
    }

    /// The decision in the full-scale city.
    pub fn in_city(&self, scale: LengthScale) -> ControlDecision {
        ControlDecision {
            vehicle: self.vehicle,
            reason: self.reason,
            other: self.other,
            place: self.place.map(|place| place * scale.factor()),
            target_mps: scale.city_from_lab(self.target_mps),
            acceleration_mps2: scale.city_from_lab(self.acceleration_mps2),
            longitudinal_error_m: scale.city_from_lab(self.longitudinal_error_m),
            measured: None,
        }
    }

    fn write(&self, out: &mut ByteWriter) {
        out.u32(self.vehicle.0);
        out.u32(self.other.map_or(0, |other| other.0));
        out.u8(self.reason as u8);
        out.u8((u8::from(self.other.is_some()) * OTHER) | (u8::from(self.place.is_some()) * PLACE));
        [0; 2].into_iter().for_each(|byte| out.u8(byte));
        let place = self.place.unwrap_or_default().to_array();
        let motion = [self.target_mps, self.acceleration_mps2, self.longitudinal_error_m];
        place.into_iter().chain(motion).for_each(|number| out.f64(number));
    }

    fn read(from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        let (vehicle, other) = (VehicleId(from.u32("vehicle id")?), from.u32("other vehicle id")?);
        let reason = from.one_of("reason", &DecisionReason::ALL, "0 (free road) to 15 (off route)")?;
        let flags = from.u8("decision flags")?;
        let flags = from.within("decision flags", flags, (0, OTHER | PLACE))?;
        for _ in 0..2 {
            zero(from, "reserved")?;
        }
        let has = |bit: u8| flags & bit != 0;
        // What is not there is 0, so that each decision has one encoding.
        if !has(OTHER) && other != 0 {
            let fault = DecodeFault::Unknown { found: other.into(), known: "0" };
            return Err(from.error("other vehicle id", 8, fault));
        }
        let place = if has(PLACE) {
            let mut metres = |field| from.number(field, -MAX_COORDINATE_M, MAX_COORDINATE_M);
            Some(DVec2::new(metres("x")?, metres("y")?))
        } else {
            for field in ["x", "y"] {
                let found = from.u64(field)?;
                if found != 0 {
                    return Err(from.error(field, 8, DecodeFault::Unknown { found, known: "0" }));
                }
            }
            None
        };
        Ok(Self {
            vehicle,
            reason,
            other: has(OTHER).then_some(VehicleId(other)),
            place,
            target_mps: from.number("target speed", 0.0, MAX_SPEED_MPS)?,
            acceleration_mps2: from.number("acceleration", -MAX_ACCELERATION_MPS2, MAX_ACCELERATION_MPS2)?,
            longitudinal_error_m: from.number("longitudinal error", -MAX_COORDINATE_M, MAX_COORDINATE_M)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_geometry::Pose2;

    fn decision(vehicle: u32, reason: DecisionReason) -> ControlDecision {
        ControlDecision {
            vehicle: VehicleId(vehicle),
            reason,
            other: Some(VehicleId(7)),
            place: Some(DVec2::new(50.0, -25.0)),
            target_mps: 12.5,
            acceleration_mps2: -2.5,
            longitudinal_error_m: 0.25,
            measured: Some(Pose2::default()),
        }
    }

    #[test]
    fn decisions_come_back_at_full_scale_without_what_does_not_last() {
        let scale = LengthScale::TESTBED;
        let told = decision(3, DecisionReason::YieldLine);
        let on_the_wire = VehicleDecision::of(&told, scale);
        assert_eq!(on_the_wire.place, Some(DVec2::new(2.0, -1.0)));
        assert_eq!(on_the_wire.in_city(scale), ControlDecision { measured: None, ..told });
        let following = VehicleDecision::of(&decision(3, DecisionReason::Leader), scale);
        assert_eq!((following.other, following.place), (Some(VehicleId(7)), None));
    }

    #[test]
    fn decisions_of_many_vehicles_are_split_over_datagrams() {
        let many: Vec<_> = (1..=50).map(|id| decision(id, DecisionReason::StopLine)).collect();
        let parts = Decisions::parts(2.5, &many, LengthScale::TESTBED);
        let sizes: Vec<usize> = parts.iter().map(|part| part.vehicles.len()).collect();
        assert_eq!(sizes, [MAX_DECISIONS, MAX_DECISIONS, 50 - 2 * MAX_DECISIONS]);
        assert!(Decisions::parts(2.5, &[], LengthScale::TESTBED).is_empty());
        let mut out = ByteWriter::default();
        parts[0].write(&mut out).unwrap();
        assert!(out.bytes.len() <= MAX_BODY_BYTES, "{}", out.bytes.len());
        assert!(out.bytes.len() + DECISION_BYTES > MAX_BODY_BYTES, "a datagram is filled");
    }

    #[test]
    fn numbers_beyond_the_ranges_of_the_wire_are_brought_into_them() {
        let wild = ControlDecision {
            place: Some(DVec2::splat(1e9)),
            target_mps: -1.0,
            acceleration_mps2: 1e9,
            longitudinal_error_m: -1e9,
            ..decision(3, DecisionReason::YieldLine)
        };
        let told =
            Decisions { time_s: 1.0, vehicles: vec![VehicleDecision::of(&wild, LengthScale::TESTBED)] };
        let mut out = ByteWriter::default();
        told.write(&mut out).unwrap();
        assert_eq!(Decisions::read(&mut ByteReader::new(&out.bytes, 0)), Ok(told));
    }
}
