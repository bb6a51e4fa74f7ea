//! Encodes aspects of traffic signal heads.

use super::bytes::{ByteReader, ByteWriter};
use super::{DecodeError, EncodeError, MAX_TIME_S};
use crate::snapshot::{Aspect, SignalAspects, SignalHeadId};

pub(super) fn write(aspects: &SignalAspects, out: &mut ByteWriter) -> Result<(), EncodeError> {
    out.f64(aspects.stamp_s);
    out.count("signal heads", aspects.heads.len(), SignalAspects::MOST)?;
    for (head, aspect) in &aspects.heads {
        out.u32(head.0);
        out.u8(*aspect as u8);
    }
    Ok(())
}

pub(super) fn read(from: &mut ByteReader<'_>) -> Result<SignalAspects, DecodeError> {
    let stamp_s = from.number("time", 0.0, MAX_TIME_S)?;
    let count = from.u8("signal heads")?;
    let count = from.within("signal heads", count, (1, SignalAspects::MOST as u8))?;
    let one = |from: &mut ByteReader<'_>| {
        let head = SignalHeadId(from.u32("signal head")?);
        let known = "0 (dark), 1 (red), 2 (yellow) and 3 (green)";
        Ok((head, from.one_of("aspect", &Aspect::ALL, known)?))
    };
    let heads = (0..count).map(|_| one(from)).collect::<Result<_, DecodeError>>()?;
    Ok(SignalAspects { stamp_s, heads })
}
