//! Camera options of the command line: onboard, chase, orbit and overhead cameras.

use super::super::{Failure, values};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_sensors::{Camera, Lens, Mount};
use city3d_session::capture::CameraCarrier;
use city3d_simulation::scenario::Experiment;
use clap::{Args, ValueEnum};
use glam::{DVec2, DVec3};

#[derive(Debug, Args)]
pub(super) struct CameraArgs {
    /// Vehicle by number or name; repeat for several [default: all]
    #[arg(long, value_name = "ID|NAME")]
    vehicle: Vec<String>,
    /// Camera; repeat for several [default: the cameras that the scenario gives its vehicles, or the windscreen
    /// where it gives none]
    #[arg(long)]
    pub(super) camera: Vec<CameraChoice>,
    /// Only the scenario's sensors of this name; repeat for several
    #[arg(long, value_name = "NAME", conflicts_with = "camera")]
    pub(super) sensor: Vec<String>,
    /// Point of the city, in metres, that orbit and overhead look at [default: the --vehicle, or the whole city]
    #[arg(long, value_name = "X,Y", value_parser = point, allow_hyphen_values = true)]
    pub(super) at: Option<DVec2>,
    /// Distance of an orbit, overhead or chase camera from its target, in metres
    #[arg(long, value_name = "M", value_parser = values::camera_distance)]
    distance: Option<f64>,
    /// Azimuth of an orbit camera seen from its target, in degrees counter-clockwise from east
    #[arg(long, value_name = "DEG", default_value_t = 235.0, value_parser = degrees, allow_hyphen_values = true)]
    azimuth: f64,
    /// Elevation of an orbit camera above the horizon, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 40.0, value_parser = elevation)]
    elevation: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum CameraChoice {
    /// Behind the mirror of a vehicle
    Windscreen,
    /// On the front bumper of a vehicle
    Bumper,
    /// Behind and above a vehicle
    Chase,
    /// Beside and above the city, a vehicle or a point
    Orbit,
    /// Straight above the city, a vehicle or a point, north at the top
    Overhead,
}

impl CameraChoice {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Windscreen => "windscreen",
            Self::Bumper => "bumper",
            Self::Chase => "chase",
            Self::Orbit => "orbit",
            Self::Overhead => "overhead",
        }
    }

    /// Mount of an onboard camera.
    pub(super) fn mount(self) -> Option<Mount> {
        match self {
            Self::Windscreen => Some(Mount::Windscreen),
            Self::Bumper => Some(Mount::Bumper),
            Self::Chase | Self::Orbit | Self::Overhead => None,
        }
    }

    /// Whether it needs no vehicle.
    pub(super) fn stands_alone(self) -> bool {
        matches!(self, Self::Orbit | Self::Overhead)
    }
}

fn point(text: &str) -> Result<DVec2, String> {
    let point = text
        .split_once(',')
        .and_then(|(x, y)| Some(DVec2::new(values::coordinate(x)?, values::coordinate(y)?)));
    point.ok_or_else(|| {
        "two numbers of metres up to 100000 with a comma between them are needed, as in 51.5,-20".to_owned()
    })
}

fn degrees(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.abs() <= 360.0 => Ok(number),
        _ => Err("degrees from -360 to 360 are needed".to_owned()),
    }
}

fn elevation(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (2.0..=90.0).contains(&number) => Ok(number),
        _ => Err("degrees from 2 to 90 are needed".to_owned()),
    }
}

/// Placement of a chase, orbit or overhead camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Standpoint {
    kind: CameraChoice,
    vehicle: Option<VehicleId>,
    at: Option<DVec2>,
    distance_m: Option<f64>,
    azimuth_rad: f64,
    elevation_rad: f64,
    /// Middle of the city and half its width and height.
    city: [DVec2; 2],
}

impl CameraArgs {
    /// The vehicles requested by name or number; none means all.
    pub(super) fn chosen<'c>(
        &self,
        (name, carriers): (&str, &'c [CameraCarrier]),
    ) -> Result<Vec<&'c CameraCarrier>, Failure> {
        let mut chosen: Vec<&CameraCarrier> = Vec::new();
        for wanted in &self.vehicle {
            let vehicle = find(wanted, name, carriers)?;
            if !chosen.iter().any(|known| known.id == vehicle.id) {
                chosen.push(vehicle);
            }
        }
        Ok(chosen)
    }

    pub(super) fn standpoint(
        &self,
        kind: CameraChoice,
        vehicle: Option<VehicleId>,
        experiment: &Experiment,
    ) -> Standpoint {
        let [low, high] = experiment.city_map.bounds();
        Standpoint {
            kind,
            vehicle,
            at: self.at,
            distance_m: self.distance,
            azimuth_rad: self.azimuth.to_radians(),
            elevation_rad: self.elevation.to_radians(),
            city: [(low + high) / 2.0, (high - low) / 2.0],
        }
    }
}

fn find<'c>(wanted: &str, name: &str, carriers: &'c [CameraCarrier]) -> Result<&'c CameraCarrier, Failure> {
    let by_name = carriers.iter().find(|vehicle| vehicle.name == wanted);
    let id = wanted.parse().map(VehicleId);
    let by_id = || carriers.iter().find(|vehicle| Ok(vehicle.id) == id);
    by_name.or_else(by_id).ok_or_else(|| {
        let mut present: Vec<String> =
            carriers.iter().take(12).map(|v| format!("{} ({})", v.name, v.id)).collect();
        if carriers.len() > present.len() {
            present.push(format!("and {} more", carriers.len() - present.len()));
        }
        Failure::bad_input(format!(
            "no vehicle of scenario {name} has the name or number \"{wanted}\"; there are: {}",
            present.join(", ")
        ))
    })
}

impl Standpoint {
    /// The camera at one instant.
    pub(super) fn camera(&self, snapshot: &FrameSnapshot, lens: &Lens) -> Camera {
        let id = self.vehicle.unwrap_or_default();
        let followed = self.vehicle.and_then(|id| snapshot.vehicle(id));
        let spot = followed.map(|state| state.position).or(self.at.map(|at| at.extend(0.0)));
        let [middle, half] = self.city;
        // Distance at which the whole city fits into width and height.
        let slope = (lens.vertical_fov_rad / 2.0).tan();
        let aspect = f64::from(lens.extent[0]) / f64::from(lens.extent[1]);
        let fits_m = (half.y / slope).max(half.x / (slope * aspect));
        match self.kind {
            CameraChoice::Windscreen => Camera::onboard(id, Mount::Windscreen),
            CameraChoice::Bumper => Camera::onboard(id, Mount::Bumper),
            CameraChoice::Chase => match self.distance_m {
                Some(distance_m) => Camera::Chase { vehicle: id, distance_m, height_m: 0.4 * distance_m },
                None => Camera::chase(id),
            },
            CameraChoice::Orbit => Camera::Orbit {
                target: spot.unwrap_or(middle.extend(0.0)) + DVec3::Z * 0.8,
                distance_m: self.distance_m.unwrap_or(if spot.is_some() { 22.0 } else { fits_m }),
                azimuth_rad: self.azimuth_rad,
                elevation_rad: self.elevation_rad,
            },
            CameraChoice::Overhead => Camera::Overhead {
                centre: spot.map_or(middle, DVec3::truncate),
                height_m: self.distance_m.unwrap_or(if spot.is_some() { 45.0 } else { fits_m }),
            },
        }
    }
}
