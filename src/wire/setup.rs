//! The setup of a vehicle: what brings it into the city.

use super::bytes::{Reader, Writer};
use super::{DecodeError, EncodeError, Fault, LARGEST_M, LARGEST_MPS, LARGEST_RAD};
use crate::geom::{LengthScale, Pose2};
use crate::snapshot::{Appearance, BodyType, Drive, ModelKind, Setup, TorquePoint, VehicleId, VehicleSpec};
use std::collections::BTreeMap;

/// Names are at most so long, in bytes.
pub const LONGEST_NAME: usize = 64;
/// A control algorithm has at most so many parameters.
pub const MOST_PARAMETERS: usize = 16;
/// A torque curve has at most so many points.
pub const MOST_TORQUE_POINTS: usize = 24;
/// Numbers without a meaning of their own are at most so large.
const LARGEST: f64 = 1e12;
/// Bodies from this number on are models of the scenario's.
const FIRST_OWN_BODY: u16 = 256;
const BODIES: [BodyType; 5] =
    [BodyType::Sedan, BodyType::Hatchback, BodyType::Suv, BodyType::Van, BodyType::Pickup];
const DRIVES: [Drive; 3] = [Drive::Front, Drive::Rear, Drive::All];
const MODELS: [ModelKind; 3] = [ModelKind::Raycast, ModelKind::Bicycle, ModelKind::Measured];

/// How a vehicle is built.
#[derive(Clone, Debug, PartialEq)]
pub enum Build {
    /// As a vehicle type of the city's scenario.
    Type(String),
    /// Figure by figure, full scale.
    Spec(Box<VehicleSpec>),
}

impl Build {
    /// The specification that it names, out of those of the scenario's vehicle types.
    ///
    /// # Errors
    /// Where there is no type of its name; says which there are.
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

/// What brings a vehicle into the city. Laboratory metres, but for the build.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleSetup {
    pub id: VehicleId,
    /// Its name in the laboratory.
    pub name: String,
    /// Name of the control algorithm; the city shows and logs it.
    pub controller: String,
    /// Parameters of the algorithm by name; the city logs them.
    pub parameters: Vec<(String, f64)>,
    pub appearance: Appearance,
    /// Middle of the outline.
    pub pose: Pose2,
    /// Along the heading.
    pub speed_mps: f64,
    pub build: Build,
}

impl VehicleSetup {
    /// In the full-scale city, as a vehicle that is built so.
    pub fn in_city(&self, scale: LengthScale, spec: VehicleSpec) -> Setup {
        Setup {
            id: self.id,
            name: self.name.clone(),
            appearance: self.appearance,
            pose: self.pose.scaled(scale.factor()),
            speed_mps: scale.city_from_lab(self.speed_mps),
            spec,
        }
    }

    pub(super) fn write(&self, out: &mut Writer) -> Result<(), EncodeError> {
        out.u32(self.id.0);
        out.u16(match self.appearance.body {
            BodyType::Own(index) => FIRST_OWN_BODY.saturating_add(index),
            body => BODIES.iter().position(|shipped| *shipped == body).unwrap_or(0) as u16,
        });
        self.appearance.colour.into_iter().for_each(|part| out.u8(part));
        let pose = &self.pose;
        [pose.position.x, pose.position.y, pose.yaw_rad, self.speed_mps].into_iter().for_each(|n| out.f64(n));
        out.text("name", &self.name, LONGEST_NAME)?;
        out.text("algorithm", &self.controller, LONGEST_NAME)?;
        out.count("parameters", self.parameters.len(), MOST_PARAMETERS)?;
        for (name, value) in &self.parameters {
            out.text("parameter name", name, LONGEST_NAME)?;
            out.f64(*value);
        }
        match &self.build {
            Build::Type(name) => {
                out.u8(0);
                out.text("vehicle type", name, LONGEST_NAME)
            }
            Build::Spec(spec) => {
                out.u8(1);
                write_spec(spec, out)
            }
        }
    }

    pub(super) fn read(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let id = VehicleId(from.u32("vehicle id")?);
        let body = read_body(from)?;
        let colour = [from.u8("red")?, from.u8("green")?, from.u8("blue")?];
        let (x, y) = (from.number("x", -LARGEST_M, LARGEST_M)?, from.number("y", -LARGEST_M, LARGEST_M)?);
        let yaw_rad = from.number("yaw", -LARGEST_RAD, LARGEST_RAD)?;
        let speed_mps = from.number("speed", 0.0, LARGEST_MPS)?;
        let name = from.text("name", LONGEST_NAME)?;
        let controller = from.text("algorithm", LONGEST_NAME)?;
        let parameters = (0..read_count(from, "parameters", MOST_PARAMETERS)?)
            .map(|_| {
                let name = from.text("parameter name", LONGEST_NAME)?;
                Ok((name, from.number("parameter", -LARGEST, LARGEST)?))
            })
            .collect::<Result<_, _>>()?;
        let build = match from.u8("build")? {
            0 => Build::Type(from.text("vehicle type", LONGEST_NAME)?),
            1 => Build::Spec(Box::new(read_spec(from)?)),
            found => {
                let fault = Fault::Unknown { found: found.into(), known: "0 (a type) and 1 (figures)" };
                return Err(from.error("build", 1, fault));
            }
        };
        Ok(Self {
            id,
            name,
            controller,
            parameters,
            appearance: Appearance { body, colour },
            pose: Pose2::new(x, y, yaw_rad),
            speed_mps,
            build,
        })
    }
}

fn read_body(from: &mut Reader<'_>) -> Result<BodyType, DecodeError> {
    let found = from.u16("body")?;
    if let Some(index) = found.checked_sub(FIRST_OWN_BODY) {
        return Ok(BodyType::Own(index));
    }
    let known = "0 to 4, and from 256 on the scenario's own";
    let unknown = || from.error("body", 2, Fault::Unknown { found: found.into(), known });
    BODIES.get(usize::from(found)).copied().ok_or_else(unknown)
}

/// How many follow, in one byte.
fn read_count(from: &mut Reader<'_>, field: &'static str, most: usize) -> Result<u8, DecodeError> {
    let found = from.u8(field)?;
    from.within(field, found, (0, most as u8))
}

fn write_spec(spec: &VehicleSpec, out: &mut Writer) -> Result<(), EncodeError> {
    out.u8(DRIVES.iter().position(|drive| *drive == spec.drive).unwrap_or(0) as u8);
    out.u8(MODELS.iter().position(|model| *model == spec.model).unwrap_or(0) as u8);
    let mut copy = spec.clone();
    for (_, number) in figures(&mut copy) {
        out.f64(*number);
    }
    let curve = &spec.motor.torque_curve;
    out.count("torque curve", curve.len(), MOST_TORQUE_POINTS)?;
    for point in curve {
        out.f64(point.rpm);
        out.f64(point.torque_nm);
    }
    Ok(())
}

fn read_spec(from: &mut Reader<'_>) -> Result<VehicleSpec, DecodeError> {
    let mut spec = VehicleSpec {
        drive: from.one_of("driven axle", &DRIVES, "0 (front), 1 (rear) and 2 (all)")?,
        model: from.one_of("dynamics model", &MODELS, "0 (raycast), 1 (bicycle) and 2 (measured)")?,
        ..VehicleSpec::default()
    };
    for (field, number) in figures(&mut spec) {
        *number = from.number(field, -LARGEST, LARGEST)?;
    }
    spec.motor.torque_curve = (0..read_count(from, "torque curve", MOST_TORQUE_POINTS)?)
        .map(|_| {
            let rpm = from.number("torque curve rpm", -LARGEST, LARGEST)?;
            Ok(TorquePoint { rpm, torque_nm: from.number("torque curve torque", -LARGEST, LARGEST)? })
        })
        .collect::<Result<_, _>>()?;
    Ok(spec)
}

/// The figures of a build in their order on the wire.
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
