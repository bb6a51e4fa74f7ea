//! `[[...sensor]]`: sensors of a vehicle. Full-scale metres in the body frame, angles in degrees.

use super::experiment::Rates;
use super::fields::TableFields;
use super::read_vehicles::is_topic_name;
use city3d_sensors::{CameraSensor, Sensor, SensorKind};
use city3d_sensors::{Lens, Mount, MountPoint, PictureKind, PictureKinds};
use glam::DVec3;
use std::collections::BTreeSet;

/// Most sensors of a vehicle.
const MOST_SENSORS: usize = 64;
/// Longest edge of a picture in pixels.
const LARGEST_EDGE: f64 = 8192.0;
const USUAL_RATE_HZ: f64 = 10.0;
/// Range of the field of view in degrees.
const VIEW_DEG: std::ops::RangeInclusive<f64> = 1.0..=150.0;

/// Mounts by name; the first is the usual one.
pub(super) const MOUNTS: [(&str, MountPoint); 2] =
    [("windscreen", MountPoint::Windscreen), ("bumper", MountPoint::Bumper)];

/// Reads the sensors of a table; `None` if it has none.
pub fn read_sensors(fields: &TableFields<'_, '_>, rates: Rates) -> Option<Vec<Sensor>> {
    fields.entry("sensor")?;
    let tables = fields.tables("sensor");
    if tables.len() > MOST_SENSORS {
        let message = format!("{} sensors; a vehicle carries at most {MOST_SENSORS}", tables.len());
        fields.wrong("sensor", message);
        return Some(Vec::new());
    }
    let mut taken = BTreeSet::new();
    Some(tables.into_iter().map(|table| read_sensor(table, rates, &mut taken)).collect())
}

type Read = fn(&TableFields<'_, '_>) -> SensorKind;
const KINDS: [(&str, Read); 1] = [("camera", read_camera)];

fn read_sensor(fields: TableFields<'_, '_>, rates: Rates, taken: &mut BTreeSet<String>) -> Sensor {
    let mut read: Read = read_camera;
    if fields.required_string("kind", "what the sensor is, such as \"camera\"").is_some() {
        fields.choice("kind", &KINDS, &mut read);
    }
    let kind = read(&fields);
    let name = read_name(&fields, taken);
    let mut rate_hz = USUAL_RATE_HZ.min(f64::from(rates.physics_hz));
    fields.number("rate_hz", 0.001..=2000.0, &mut rate_hz);
    if rate_hz > f64::from(rates.physics_hz) {
        let physics_hz = rates.physics_hz;
        fields.wrong(
            "rate_hz",
            format!("rate_hz is {rate_hz}; a sensor measures at most once a physics step: {physics_hz}"),
        );
    }
    fields.finish();
    Sensor { name, rate_hz, kind }
}

/// The stated name, or that of the mount.
fn read_name(fields: &TableFields<'_, '_>, taken: &mut BTreeSet<String>) -> String {
    let stated = fields.string("name");
    let usual = || match fields.entry("position_m") {
        Some(_) => "camera",
        None => fields.string("mount").unwrap_or("windscreen"),
    };
    let name = stated.unwrap_or_else(usual).to_owned();
    if stated.is_some() && !is_topic_name(&name) {
        let remedy = "use at most 64 letters, digits and underscores, a letter first: it becomes part of \
                      file names and of a ROS topic";
        fields.wrong("name", format!("\"{}\" cannot be a name; {remedy}", name.escape_debug()));
    }
    if !taken.insert(name.clone()) {
        fields.wrong(
            "name",
            format!("a sensor of this vehicle is called \"{name}\" already; choose another name"),
        );
    }
    name
}

fn read_camera(fields: &TableFields<'_, '_>) -> SensorKind {
    SensorKind::Camera(CameraSensor {
        mount: read_mount(fields),
        lens: read_lens(fields),
        kinds: read_kinds(fields),
    })
}

fn read_mount(fields: &TableFields<'_, '_>) -> Mount {
    let mut place = MountPoint::Windscreen;
    fields.choice("mount", &MOUNTS, &mut place);
    if let Some(point) = fields.numbers("position_m", -50.0..=50.0, "[1.2, 0.0, 1.4]: ahead, left, up") {
        if fields.entry("mount").is_some() {
            fields.wrong("position_m", "position_m and mount both say where the camera is; keep one");
        }
        place = MountPoint::Point(DVec3::from_array(point));
    }
    let usual = [0.0, place.usual_pitch_rad().to_degrees(), 0.0];
    let [mut yaw_deg, mut pitch_deg, mut roll_deg] = usual;
    fields.number("yaw_deg", -360.0..=360.0, &mut yaw_deg);
    fields.number("pitch_deg", -90.0..=90.0, &mut pitch_deg);
    fields.number("roll_deg", -180.0..=180.0, &mut roll_deg);
    let angles = [yaw_deg, pitch_deg, roll_deg];
    match place {
        MountPoint::Windscreen if angles == usual => Mount::Windscreen,
        MountPoint::Bumper if angles == usual => Mount::Bumper,
        place => {
            let [yaw_rad, pitch_rad, roll_rad] = angles.map(f64::to_radians);
            Mount::Custom { place, yaw_rad, pitch_rad, roll_rad }
        }
    }
}

#[allow(clippy::disallowed_methods, reason = "cameras draw; no state of a run depends on them")]
fn read_lens(fields: &TableFields<'_, '_>) -> Lens {
    let mut lens = Lens::default();
    if let Some(size) = fields.numbers("size_px", 1.0..=LARGEST_EDGE, "[640, 480]: width and height") {
        if size.iter().all(|edge: &f64| edge.fract() == 0.0) {
            lens.extent = size.map(|edge| edge as u32);
        } else {
            fields.wrong("size_px", "size_px counts pixels; give two whole numbers, such as [640, 480]");
        }
    }
    let mut degrees = lens.vertical_fov_rad.to_degrees();
    fields.number("vertical_fov_deg", VIEW_DEG, &mut degrees);
    let mut horizontal = f64::NAN;
    fields.number("horizontal_fov_deg", VIEW_DEG, &mut horizontal);
    if horizontal.is_finite() {
        if fields.entry("vertical_fov_deg").is_some() {
            let message = "horizontal_fov_deg and vertical_fov_deg both state the angle of view; keep one";
            fields.wrong("horizontal_fov_deg", message);
        }
        let [width, height] = lens.extent.map(f64::from);
        let half = ((horizontal / 2.0).to_radians().tan() * height / width).atan();
        degrees = 2.0 * half.to_degrees();
        if !VIEW_DEG.contains(&degrees) {
            let message = format!(
                "horizontal_fov_deg is {horizontal}, which makes {degrees:.1} degrees from top to bottom; \
                 between {} and {} can be drawn",
                VIEW_DEG.start(),
                VIEW_DEG.end()
            );
            fields.wrong("horizontal_fov_deg", message);
        }
    }
    lens.vertical_fov_rad = degrees.to_radians();
    lens
}

fn read_kinds(fields: &TableFields<'_, '_>) -> PictureKinds {
    let Some(names) = fields.strings("images") else { return PictureKinds::RGB };
    if names.is_empty() {
        fields.wrong("images", "images is empty; name one kind at least, such as \"rgb\"");
    }
    let find = |name: &str| PictureKind::ALL.into_iter().find(|kind| kind.name() == name);
    for (name, span) in names.iter().filter(|(name, _)| find(name).is_none()) {
        let remedy = super::fields::one_of(name, PictureKind::ALL.into_iter().map(PictureKind::name));
        fields.problems.add(span, format!("there are no images of kind \"{name}\"; {remedy}"));
    }
    names.iter().filter_map(|(name, _)| find(name)).collect()
}
