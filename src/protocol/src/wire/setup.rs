//! Setup of a vehicle: the request that creates it in the city.

use super::bytes::{ByteReader, ByteWriter};
use super::{DecodeError, DecodeFault, EncodeError, MAX_ANGLE_RAD, MAX_COORDINATE_M, MAX_SPEED_MPS};
use crate::snapshot::{Appearance, BodyType, Drive, ModelKind, Setup, TorquePoint, VehicleId, VehicleSpec};
use city3d_geometry::{Lab, LengthScale, Pose2};
use std::collections::BTreeMap;

/// Controller of a car that a person drives over the link. Its sender is a guest, and does not lead by bringing it.
pub const PERSON: &str = "person";
/// Longest name, bytes.
pub const MAX_NAME_BYTES: usize = 64;
/// Most parameters of a control algorithm.
pub const MAX_PARAMETERS: usize = 16;
/// Most points of a torque curve.
pub const MAX_TORQUE_POINTS: usize = 24;
/// Largest number without a range of its own.
const MAX_NUMBER: f64 = 1e12;
/// Body numbers from here on are the scenario's own models.
const FIRST_OWN_BODY: u16 = 256;
const DRIVES: [Drive; 3] = [Drive::Front, Drive::Rear, Drive::All];
const MODELS: [ModelKind; 3] = [ModelKind::Raycast, ModelKind::Bicycle, ModelKind::Measured];

/// Specification of a vehicle: by a type of the scenario, or value by value.
#[derive(Clone, Debug, PartialEq)]
pub enum VehicleBuild {
    /// Name of a vehicle type of the city's scenario.
    Type(String),
    /// All values, full scale.
    Spec(Box<VehicleSpec>),
}

impl VehicleBuild {
    /// Looks up the specification among the vehicle types of the scenario.
    ///
    /// # Errors
    /// When the type is unknown; the message lists the known ones.
    pub fn resolve(&self, types: &BTreeMap<String, VehicleSpec>) -> Result<VehicleSpec, String> {
        match self {
            Self::Spec(spec) => Ok(VehicleSpec::clone(spec)),
            Self::Type(name) => {
                let known = || types.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                let name = if name.is_empty() { "default" } else { name };
                let unknown = || format!("vehicle type \"{name}\" is not defined; there are {}", known());
                types.get(name).cloned().ok_or_else(unknown)
            }
        }
    }
}

/// Setup of a vehicle. Laboratory metres, except for the full-scale build.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleSetup {
    /// Unique in the city, 1 to 65535.
    pub id: VehicleId,
    /// Its name in the laboratory.
    pub name: String,
    /// Name of the control algorithm; the city shows and logs it.
    pub controller: String,
    /// Parameters of the algorithm by name; the city logs them.
    pub parameters: Vec<(String, f64)>,
    /// Body type and colour.
    pub appearance: Appearance,
    /// Pose of the centre of the outline.
    pub pose: Pose2<Lab>,
    /// Along the heading.
    pub speed_mps: f64,
    /// Its construction: dimensions, motor, tyres and control.
    pub build: VehicleBuild,
}

impl VehicleSetup {
    /// Converts to the full-scale city, with a resolved specification.
    pub fn in_city(&self, scale: LengthScale, spec: VehicleSpec) -> Setup {
        Setup {
            id: self.id,
            name: self.name.clone(),
            appearance: self.appearance,
            pose: self.pose.to_city(scale),
            speed_mps: scale.city_from_lab(self.speed_mps),
            spec,
        }
    }

    pub(super) fn write(&self, out: &mut ByteWriter) -> Result<(), EncodeError> {
        out.u32(self.id.0);
        write_appearance(&self.appearance, out);
        let pose = &self.pose;
        [pose.position.x, pose.position.y, pose.yaw_rad, self.speed_mps].into_iter().for_each(|n| out.f64(n));
        out.text("name", &self.name, MAX_NAME_BYTES)?;
        out.text("algorithm", &self.controller, MAX_NAME_BYTES)?;
        out.count("parameters", self.parameters.len(), MAX_PARAMETERS)?;
        for (name, value) in &self.parameters {
            out.text("parameter name", name, MAX_NAME_BYTES)?;
            out.f64(*value);
        }
        match &self.build {
            VehicleBuild::Type(name) => {
                out.u8(0);
                out.text("vehicle type", name, MAX_NAME_BYTES)
            }
            VehicleBuild::Spec(spec) => {
                out.u8(1);
                write_spec(spec, out)
            }
        }
    }

    pub(super) fn read(from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        let id = VehicleId(from.u32("vehicle id")?);
        let appearance = read_appearance(from)?;
        let (x, y) = (
            from.number("x", -MAX_COORDINATE_M, MAX_COORDINATE_M)?,
            from.number("y", -MAX_COORDINATE_M, MAX_COORDINATE_M)?,
        );
        let yaw_rad = from.number("yaw", -MAX_ANGLE_RAD, MAX_ANGLE_RAD)?;
        let speed_mps = from.number("speed", 0.0, MAX_SPEED_MPS)?;
        let name = from.text("name", MAX_NAME_BYTES)?;
        let controller = from.text("algorithm", MAX_NAME_BYTES)?;
        let parameters = (0..read_count(from, "parameters", MAX_PARAMETERS)?)
            .map(|_| {
                let name = from.text("parameter name", MAX_NAME_BYTES)?;
                Ok((name, from.number("parameter", -MAX_NUMBER, MAX_NUMBER)?))
            })
            .collect::<Result<_, _>>()?;
        let build = match from.u8("build")? {
            0 => VehicleBuild::Type(from.text("vehicle type", MAX_NAME_BYTES)?),
            1 => VehicleBuild::Spec(Box::new(read_spec(from)?)),
            found => {
                let fault = DecodeFault::Unknown { found: found.into(), known: "0 (a type) and 1 (figures)" };
                return Err(from.error("build", 1, fault));
            }
        };
        Ok(Self {
            id,
            name,
            controller,
            parameters,
            appearance,
            pose: Pose2::new(x, y, yaw_rad),
            speed_mps,
            build,
        })
    }
}

pub(super) fn write_appearance(appearance: &Appearance, out: &mut ByteWriter) {
    out.u16(match appearance.body {
        BodyType::Own(index) => FIRST_OWN_BODY.saturating_add(index),
        body => BodyType::SHIPPED.iter().position(|(_, shipped)| *shipped == body).unwrap_or(0) as u16,
    });
    appearance.colour.into_iter().for_each(|part| out.u8(part));
}

pub(super) fn read_appearance(from: &mut ByteReader<'_>) -> Result<Appearance, DecodeError> {
    let body = read_body(from)?;
    Ok(Appearance { body, colour: [from.u8("red")?, from.u8("green")?, from.u8("blue")?] })
}

fn read_body(from: &mut ByteReader<'_>) -> Result<BodyType, DecodeError> {
    let found = from.u16("body")?;
    if let Some(index) = found.checked_sub(FIRST_OWN_BODY) {
        return Ok(BodyType::Own(index));
    }
    let known = "0 to 4, and from 256 on the scenario's own";
    let unknown = || from.error("body", 2, DecodeFault::Unknown { found: found.into(), known });
    BodyType::SHIPPED.get(usize::from(found)).map(|(_, body)| *body).ok_or_else(unknown)
}

/// Reads the number of following items, one byte.
fn read_count(from: &mut ByteReader<'_>, field: &'static str, most: usize) -> Result<u8, DecodeError> {
    let found = from.u8(field)?;
    from.within(field, found, (0, most as u8))
}

fn write_spec(spec: &VehicleSpec, out: &mut ByteWriter) -> Result<(), EncodeError> {
    out.u8(DRIVES.iter().position(|drive| *drive == spec.drive).unwrap_or(0) as u8);
    out.u8(MODELS.iter().position(|model| *model == spec.model).unwrap_or(0) as u8);
    let mut copy = spec.clone();
    for (_, number) in figures(&mut copy) {
        out.f64(*number);
    }
    let curve = &spec.motor.torque_curve;
    out.count("torque curve", curve.len(), MAX_TORQUE_POINTS)?;
    for point in curve {
        out.f64(point.rpm);
        out.f64(point.torque_nm);
    }
    Ok(())
}

fn read_spec(from: &mut ByteReader<'_>) -> Result<VehicleSpec, DecodeError> {
    let mut spec = VehicleSpec {
        drive: from.one_of("driven axle", &DRIVES, "0 (front), 1 (rear) and 2 (all)")?,
        model: from.one_of("dynamics model", &MODELS, "0 (raycast), 1 (bicycle) and 2 (measured)")?,
        ..VehicleSpec::default()
    };
    for (field, number) in figures(&mut spec) {
        *number = from.number(field, -MAX_NUMBER, MAX_NUMBER)?;
    }
    spec.motor.torque_curve = (0..read_count(from, "torque curve", MAX_TORQUE_POINTS)?)
        .map(|_| {
            let rpm = from.number("torque curve rpm", -MAX_NUMBER, MAX_NUMBER)?;
            Ok(TorquePoint { rpm, torque_nm: from.number("torque curve torque", -MAX_NUMBER, MAX_NUMBER)? })
        })
        .collect::<Result<_, _>>()?;
    Ok(spec)
}

/// The values of a specification in their order on the wire.
fn figures(spec: &mut VehicleSpec) -> [(&'static str, &mut f64); 30] {
    let (size, control) = (&mut spec.dimensions, &mut spec.control);
    let (centre, suspension) = (&mut spec.centre_of_mass, &mut spec.suspension);
    [
        ("length", &mut size.length_m),
        ("width", &mut size.width_m),
        ("height", &mut size.height_m),
        ("wheelbase", &mut size.wheelbase_m),
        ("track", &mut size.track_m),
        ("wheel radius", &mut size.wheel_radius_m),
        ("mass", &mut spec.mass_kg),
        ("yaw inertia factor", &mut spec.yaw_inertia_factor),
        ("centre of mass height", &mut centre.height_m),
        ("centre of mass ahead", &mut centre.ahead_m),
        ("gear ratio", &mut spec.motor.gear_ratio),
        ("power", &mut spec.motor.max_power_w),
        ("brake torque", &mut spec.brake_torque_nm),
        ("handbrake torque", &mut spec.handbrake_torque_nm),
        ("steering limit", &mut spec.steering_limit_rad),
        ("steering rate", &mut spec.steering_rate_radps),
        ("suspension rest length", &mut suspension.rest_length_m),
        ("suspension frequency", &mut suspension.frequency_hz),
        ("suspension damping ratio", &mut suspension.damping_ratio),
        ("tyre friction", &mut spec.tyre_friction),
        ("tyre cornering", &mut spec.tyre_cornering),
        ("drag area", &mut spec.drag_area_m2),
        ("rolling resistance", &mut spec.rolling_resistance),
        ("k_e", &mut control.k_e),
        ("k_s", &mut control.k_s),
        ("k_a", &mut control.k_a),
        ("k_y", &mut control.k_y),
        ("speed_p", &mut control.speed_p),
        ("speed_i", &mut control.speed_i),
        ("speed_d", &mut control.speed_d),
    ]
}
