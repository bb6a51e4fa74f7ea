//! Encodes the pedals and the steering wheel of a person who drives a vehicle.

use super::DecodeError;
use super::bytes::{ByteReader, ByteWriter};
use super::trajectories::{read_indicator, zero};
use crate::snapshot::Pedals;

const RELEASED: u8 = 0;
const DRIVEN: u8 = 1;

pub(super) fn write(pedals: Option<Pedals>, out: &mut ByteWriter) {
    let Some(pedals) = pedals.map(Pedals::clamped) else { return out.u8(RELEASED) };
    out.u8(DRIVEN);
    out.u8(u8::from(pedals.reverse));
    out.u8(pedals.indicator as u8);
    out.u8(0);
    [pedals.gas, pedals.brake, pedals.handbrake, pedals.steering_rad].into_iter().for_each(|n| out.f64(n));
}

pub(super) fn read(from: &mut ByteReader<'_>) -> Result<Option<Pedals>, DecodeError> {
    let known = "0 (handed back) and 1 (driven)";
    if from.one_of("driver", &[RELEASED, DRIVEN], known)? == RELEASED {
        return Ok(None);
    }
    let reverse = from.one_of("reverse", &[false, true], "0 and 1")?;
    let indicator = read_indicator(from)?;
    zero(from, "reserved")?;
    Ok(Some(Pedals {
        gas: from.number("gas", 0.0, 1.0)?,
        brake: from.number("brake", 0.0, 1.0)?,
        handbrake: from.number("handbrake", 0.0, 1.0)?,
        steering_rad: from.number("steering", -Pedals::MAX_STEERING_RAD, Pedals::MAX_STEERING_RAD)?,
        reverse,
        indicator,
    }))
}
