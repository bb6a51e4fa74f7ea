//! Which cameras of which vehicles take pictures.

use super::super::Failure;
use crate::camera::{Camera, Mount};
use crate::scenario::{Experiment, PlannedVehicle};
use crate::snapshot::{FrameSnapshot, VehicleId};
use clap::{Args, ValueEnum};
use glam::{DVec2, DVec3};

#[derive(Debug, Args)]
pub(super) struct CameraArgs {
    /// Vehicle by number or name, may be given more than once; all of them without it
    #[arg(long, value_name = "ID|NAME")]
    vehicle: Vec<String>,
    /// Camera, may be given more than once
    #[arg(long, default_value = "windscreen")]
    camera: Vec<Kind>,
    /// Point of the city in metres that orbit and overhead look at; a --vehicle or the whole city without it
    #[arg(long, value_name = "X,Y", value_parser = point, allow_hyphen_values = true)]
    at: Option<DVec2>,
    /// Metres from an orbit, overhead or chase camera to what it looks at
    #[arg(long, value_name = "M", value_parser = super::positive)]
    distance: Option<f64>,
    /// Where an orbit camera stands, seen from what it looks at, counter-clockwise from east
    #[arg(long, value_name = "DEG", default_value_t = 235.0, value_parser = degrees, allow_hyphen_values = true)]
    azimuth: f64,
    /// How high an orbit camera stands above the horizon
    #[arg(long, value_name = "DEG", default_value_t = 40.0, value_parser = elevation)]
    elevation: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Kind {
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

impl Kind {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Windscreen => "windscreen",
            Self::Bumper => "bumper",
            Self::Chase => "chase",
            Self::Orbit => "orbit",
            Self::Overhead => "overhead",
        }
    }

    /// Whether it needs no vehicle.
    fn stands_alone(self) -> bool {
        matches!(self, Self::Orbit | Self::Overhead)
    }
}

fn numbers(text: &str) -> Option<DVec2> {
    let (x, y) = text.split_once(',')?;
    let at = DVec2::new(x.trim().parse().ok()?, y.trim().parse().ok()?);
    at.is_finite().then_some(at)
}

fn point(text: &str) -> Result<DVec2, String> {
    numbers(text).ok_or_else(|| "two numbers with a comma between them are needed, as in 51.5,-20".to_owned())
}

fn degrees(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err("degrees are needed".to_owned()),
    }
}

fn elevation(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (2.0..=90.0).contains(&number) => Ok(number),
        _ => Err("degrees from 2 to 90 are needed".to_owned()),
    }
}

/// A camera that takes pictures throughout a run.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    pub(super) kind: Kind,
    /// Of the vehicle, or `city`.
    pub(super) name: String,
    vehicle: Option<VehicleId>,
    /// Middle of the city and half its width and height.
    city: [DVec2; 2],
}

/// What was asked for, camera by camera.
pub(super) fn shots(args: &CameraArgs, experiment: &Experiment) -> Result<Vec<Shot>, Failure> {
    let mut chosen: Vec<&PlannedVehicle> = Vec::new();
    for wanted in &args.vehicle {
        let vehicle = find(wanted, experiment)?;
        if !chosen.iter().any(|known| known.id == vehicle.id) {
            chosen.push(vehicle);
        }
    }
    let [low, high] = experiment.city_map.bounds();
    let city = [(low + high) / 2.0, (high - low) / 2.0];
    let mut shots: Vec<Shot> = Vec::new();
    for &kind in &args.camera {
        if shots.iter().any(|shot| shot.kind == kind) {
            continue;
        }
        if kind.stands_alone() && (chosen.is_empty() || args.at.is_some()) {
            shots.push(Shot { kind, name: "city".to_owned(), vehicle: None, city });
            continue;
        }
        let all = experiment.vehicles.iter().filter(|_| chosen.is_empty());
        shots.extend(all.chain(chosen.iter().copied()).map(|vehicle| Shot {
            kind,
            name: vehicle.name.clone(),
            vehicle: Some(vehicle.id),
            city,
        }));
    }
    if shots.is_empty() {
        let name = &experiment.name;
        return Err(Failure::bad_input(format!(
            "scenario {name} has no vehicle to carry a camera; take --camera orbit or overhead"
        )));
    }
    Ok(shots)
}

fn find<'a>(wanted: &str, experiment: &'a Experiment) -> Result<&'a PlannedVehicle, Failure> {
    let by_name = experiment.vehicles.iter().find(|vehicle| vehicle.name == wanted);
    let id = wanted.parse().map(VehicleId);
    let by_id = || experiment.vehicles.iter().find(|vehicle| Ok(vehicle.id) == id);
    by_name.or_else(by_id).ok_or_else(|| {
        let mut present: Vec<String> =
            experiment.vehicles.iter().take(12).map(|v| format!("{} ({})", v.name, v.id)).collect();
        if experiment.vehicles.len() > present.len() {
            present.push(format!("and {} more", experiment.vehicles.len() - present.len()));
        }
        let name = &experiment.name;
        Failure::bad_input(format!(
            "no vehicle of scenario {name} has the name or number \"{wanted}\"; there are: {}",
            present.join(", ")
        ))
    })
}

impl Shot {
    /// The camera at one instant; `aspect` is width over height of its pictures.
    pub(super) fn camera(
        &self,
        snapshot: &FrameSnapshot,
        args: &CameraArgs,
        vertical_fov_rad: f64,
        aspect: f64,
    ) -> Camera {
        let id = self.vehicle.unwrap_or_default();
        let followed = self.vehicle.and_then(|id| snapshot.vehicle(id));
        let spot = followed.map(|state| state.position).or(args.at.map(|at| at.extend(0.0)));
        let [middle, half] = self.city;
        // Far enough for all of the city in the picture, in its width and in its height.
        let slope = (vertical_fov_rad / 2.0).tan();
        let fits_m = (half.y / slope).max(half.x / (slope * aspect));
        match self.kind {
            Kind::Windscreen => Camera::onboard(id, Mount::Windscreen),
            Kind::Bumper => Camera::onboard(id, Mount::Bumper),
            Kind::Chase => match args.distance {
                Some(distance_m) => Camera::Chase { vehicle: id, distance_m, height_m: 0.4 * distance_m },
                None => Camera::chase(id),
            },
            Kind::Orbit => Camera::Orbit {
                target: spot.unwrap_or(middle.extend(0.0)) + DVec3::Z * 0.8,
                distance_m: args.distance.unwrap_or(if spot.is_some() { 22.0 } else { fits_m }),
                azimuth_rad: args.azimuth.to_radians(),
                elevation_rad: args.elevation.to_radians(),
            },
            Kind::Overhead => Camera::Overhead {
                centre: spot.map_or(middle, DVec3::truncate),
                height_m: args.distance.unwrap_or(if spot.is_some() { 45.0 } else { fits_m }),
            },
        }
    }

    /// Whether its vehicle is there to take pictures of.
    pub(super) fn is_present(&self, snapshot: &FrameSnapshot) -> bool {
        self.vehicle.is_none_or(|id| snapshot.vehicle(id).is_some())
    }
}
