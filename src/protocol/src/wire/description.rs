//! Description of a served city: its scenario, who leads, and what its vehicles look like.

use super::bytes::{ByteReader, ByteWriter};
use super::setup::{MAX_NAME_BYTES, read_appearance, write_appearance};
use super::{Body, DecodeError, EncodeError, MAX_BODY_BYTES, MAX_DETAIL_BYTES};
use crate::snapshot::{Dimensions, VehicleId, VehicleInfo};

/// Bytes of a part without its texts and vehicles.
const HEAD_BYTES: usize = 11;
/// Bytes of a vehicle without its texts.
const VEHICLE_BYTES: usize = 59;
/// Most vehicles of a datagram.
pub const MAX_DESCRIBED: usize = (MAX_BODY_BYTES - HEAD_BYTES) / VEHICLE_BYTES;
/// Range of each dimension: wider than that of a valid specification.
const DIMENSION_M: (f64, f64) = (0.01, 100.0);

/// Description of a city, or one part of it.
#[derive(Clone, Debug, PartialEq)]
pub struct CityDescription {
    /// The number of the request.
    pub request: u32,
    /// Name of the scenario, up to [`MAX_DETAIL_BYTES`].
    pub scenario: String,
    /// Who leads the experiment, in words, up to [`MAX_DETAIL_BYTES`]; empty while nobody leads.
    pub leader: String,
    /// Number of this part, from 0.
    pub part: u16,
    /// Number of parts of the description; each is complete in itself.
    pub parts: u16,
    /// Up to [`MAX_DESCRIBED`] vehicles, with dimensions in metres of the full-scale vehicle.
    pub vehicles: Vec<VehicleInfo>,
}

impl CityDescription {
    /// Packs a description into as few bodies as possible, at least one. Texts that are too long are cut.
    ///
    /// ```
    /// use city3d_protocol::wire::{Body, CityDescription};
    ///
    /// let bodies = CityDescription::parts(7, "straight", "192.168.0.2:4040", &[]);
    /// let [Body::Description(whole)] = bodies.as_slice() else { panic!("one part") };
    /// assert_eq!((whole.request, whole.part, whole.parts), (7, 0, 1));
    /// ```
    pub fn parts(request: u32, scenario: &str, leader: &str, vehicles: &[VehicleInfo]) -> Vec<Body> {
        let [scenario, leader] = [scenario, leader].map(|text| cut(text, MAX_DETAIL_BYTES));
        let head_bytes = HEAD_BYTES + scenario.len() + leader.len();
        let (mut lists, mut together, mut bytes) = (Vec::new(), Vec::new(), head_bytes);
        for info in vehicles {
            let name = cut(&info.name, MAX_NAME_BYTES).to_owned();
            let model = cut(&info.model, MAX_NAME_BYTES).to_owned();
            let more = VEHICLE_BYTES + name.len() + model.len();
            if bytes + more > MAX_BODY_BYTES {
                lists.push(std::mem::take(&mut together));
                bytes = head_bytes;
            }
            bytes += more;
            together.push(VehicleInfo { name, model, ..info.clone() });
        }
        lists.push(together);
        // More parts than their numbers can tell hold more vehicles than there are ids.
        lists.truncate(u16::MAX.into());
        let parts = lists.len() as u16;
        let body = |(part, vehicles)| {
            let (scenario, leader) = (scenario.to_owned(), leader.to_owned());
            Body::Description(Self { request, scenario, leader, part, parts, vehicles })
        };
        (0..parts).zip(lists).map(body).collect()
    }

    pub(super) fn write(&self, out: &mut ByteWriter) -> Result<(), EncodeError> {
        out.u32(self.request);
        out.text("scenario", &self.scenario, MAX_DETAIL_BYTES)?;
        out.text("leader", &self.leader, MAX_DETAIL_BYTES)?;
        out.u16(self.part);
        out.u16(self.parts);
        out.count("vehicles", self.vehicles.len(), MAX_DESCRIBED)?;
        self.vehicles.iter().try_for_each(|info| write_info(info, out))
    }

    pub(super) fn read(from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        let request = from.u32("request")?;
        let scenario = from.text("scenario", MAX_DETAIL_BYTES)?;
        let leader = from.text("leader", MAX_DETAIL_BYTES)?;
        let part = from.u16("part")?;
        let part = from.within("part", part, (0, u16::MAX - 1))?;
        let parts = from.u16("parts")?;
        let parts = from.within("parts", parts, (part + 1, u16::MAX))?;
        let count = from.u8("vehicles")?;
        let count = from.within("vehicles", count, (0, MAX_DESCRIBED as u8))?;
        let vehicles = (0..count).map(|_| read_info(from)).collect::<Result<_, _>>()?;
        Ok(Self { request, scenario, leader, part, parts, vehicles })
    }
}

/// The beginning of a text, at most `most` bytes.
pub(super) fn cut(text: &str, most: usize) -> &str {
    &text[..text.floor_char_boundary(most)]
}

fn write_info(info: &VehicleInfo, out: &mut ByteWriter) -> Result<(), EncodeError> {
    out.u32(info.id.0);
    write_appearance(&info.appearance, out);
    out.text("name", &info.name, MAX_NAME_BYTES)?;
    out.text("dynamics model", &info.model, MAX_NAME_BYTES)?;
    let mut size = info.dimensions;
    figures(&mut size).into_iter().for_each(|(_, metres)| out.f64(*metres));
    Ok(())
}

fn read_info(from: &mut ByteReader<'_>) -> Result<VehicleInfo, DecodeError> {
    let id = VehicleId(from.u32("vehicle id")?);
    let appearance = read_appearance(from)?;
    let name = from.text("name", MAX_NAME_BYTES)?;
    let model = from.text("dynamics model", MAX_NAME_BYTES)?;
    let mut dimensions = Dimensions {
        length_m: 0.0,
        width_m: 0.0,
        height_m: 0.0,
        wheelbase_m: 0.0,
        track_m: 0.0,
        wheel_radius_m: 0.0,
    };
    for (field, metres) in figures(&mut dimensions) {
        *metres = from.number(field, DIMENSION_M.0, DIMENSION_M.1)?;
    }
    Ok(VehicleInfo { id, name, dimensions, appearance, model })
}

/// The dimensions in their order on the wire, which is that of a setup.
fn figures(size: &mut Dimensions) -> [(&'static str, &mut f64); 6] {
    [
        ("length", &mut size.length_m),
        ("width", &mut size.width_m),
        ("height", &mut size.height_m),
        ("wheelbase", &mut size.wheelbase_m),
        ("track", &mut size.track_m),
        ("wheel radius", &mut size.wheel_radius_m),
    ]
}
