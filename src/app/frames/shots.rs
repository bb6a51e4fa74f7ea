//! Which cameras take pictures: those that the scenario gives its vehicles, or those of the command line.

use super::super::Failure;
use super::cameras::{CameraArgs, Kind, Standpoint};
use super::carriers::Carrier;
use crate::camera::{Camera, CameraError, Kinds, Lens, Mount, View};
use crate::scenario::Experiment;
use crate::sensor::{CameraSensor, Sensor, SensorKind};
use crate::snapshot::{FrameSnapshot, VehicleId};

/// What the command line states of all cameras: it wins over the scenario.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stated {
    pub(super) extent: Option<[u32; 2]>,
    pub(super) vertical_fov_rad: Option<f64>,
    pub(super) every_s: Option<f64>,
    /// Where neither the command line nor the scenario says it.
    pub(super) usual_every_s: f64,
    pub(super) kinds: Option<Kinds>,
}

/// A camera that takes pictures throughout a run.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    /// Of the camera, in file names.
    pub(super) camera: String,
    /// Name of the vehicle, or `city`.
    pub(super) owner: String,
    pub(super) vehicle: Option<VehicleId>,
    pub(super) lens: Lens,
    pub(super) kinds: Kinds,
    /// Simulated seconds from one picture to the next.
    pub(super) every_s: f64,
    source: Source,
}

#[derive(Clone, Copy, Debug)]
enum Source {
    Mounted(VehicleId, Mount),
    Free(Standpoint),
}

impl Shot {
    /// What it sees; `None` where its vehicle is no longer there.
    pub(super) fn view(&self, snapshot: &FrameSnapshot) -> Result<Option<View>, CameraError> {
        if self.vehicle.is_some_and(|id| snapshot.vehicle(id).is_none()) {
            return Ok(None);
        }
        let camera = match &self.source {
            Source::Mounted(vehicle, mount) => Camera::onboard(*vehicle, *mount),
            Source::Free(standpoint) => standpoint.camera(snapshot, &self.lens),
        };
        camera.view(snapshot, &self.lens).map(Some)
    }

    /// Name of the file of a picture, without what the kind adds.
    pub(super) fn stem(&self, tick: u64) -> String {
        format!("{}_{}_{tick:08}", self.camera, self.owner)
    }
}

/// What was asked for, camera by camera.
pub(super) fn shots(
    args: &CameraArgs,
    stated: &Stated,
    experiment: &Experiment,
    carriers: &[Carrier],
) -> Result<Vec<Shot>, Failure> {
    let chosen = args.chosen((&experiment.name, carriers))?;
    let all: Vec<&Carrier> = if chosen.is_empty() { carriers.iter().collect() } else { chosen.clone() };
    let shots = if args.camera.is_empty() {
        let shots = of_sensors(args, stated, &all)?;
        if shots.is_empty() {
            of_kinds(&[Kind::Windscreen], args, stated, experiment, (&chosen, &all))
        } else {
            shots
        }
    } else {
        of_kinds(&args.camera, args, stated, experiment, (&chosen, &all))
    };
    if shots.is_empty() {
        let name = &experiment.name;
        return Err(Failure::bad_input(format!(
            "scenario {name} has no vehicle to carry a camera; take --camera orbit or overhead"
        )));
    }
    let step_s = experiment.rates.dt_s();
    match stated.every_s.filter(|&every_s| every_s < step_s * (1.0 - 1e-9)) {
        Some(every_s) => Err(Failure::bad_input(format!(
            "a picture every {every_s} s is more than one a physics step; take --every {step_s} or more, --fps {} or less",
            experiment.rates.physics_hz
        ))),
        None => Ok(shots),
    }
}

/// The cameras that the scenario gives the chosen vehicles, or all of them.
fn of_sensors(args: &CameraArgs, stated: &Stated, all: &[&Carrier]) -> Result<Vec<Shot>, Failure> {
    let carried =
        || all.iter().flat_map(|vehicle| vehicle.sensors.iter().map(move |sensor| (*vehicle, sensor)));
    for wanted in &args.sensor {
        if !carried().any(|(_, sensor)| sensor.name == *wanted) {
            let mut names: Vec<&str> = carried().map(|(_, sensor)| sensor.name.as_str()).collect();
            names.sort_unstable();
            names.dedup();
            let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            return Err(Failure::bad_input(format!(
                "no vehicle asked for carries a sensor \"{wanted}\"; there are: {names}"
            )));
        }
    }
    let is_wanted = |sensor: &Sensor| args.sensor.is_empty() || args.sensor.contains(&sensor.name);
    let shots = carried().filter(|(_, sensor)| is_wanted(sensor)).map(|(vehicle, sensor)| {
        let SensorKind::Camera(CameraSensor { mount, mut lens, kinds }) = sensor.kind;
        lens.extent = stated.extent.unwrap_or(lens.extent);
        lens.vertical_fov_rad = stated.vertical_fov_rad.unwrap_or(lens.vertical_fov_rad);
        Shot {
            camera: sensor.name.clone(),
            owner: vehicle.name.clone(),
            vehicle: Some(vehicle.id),
            lens,
            kinds: stated.kinds.unwrap_or(kinds),
            every_s: stated.every_s.unwrap_or(1.0 / sensor.rate_hz),
            source: Source::Mounted(vehicle.id, mount),
        }
    });
    Ok(shots.collect())
}

/// Cameras of the command line on the chosen vehicles, or on all of them.
fn of_kinds(
    kinds: &[Kind],
    args: &CameraArgs,
    stated: &Stated,
    experiment: &Experiment,
    (chosen, all): (&[&Carrier], &[&Carrier]),
) -> Vec<Shot> {
    let mut lens = Lens::default();
    lens.extent = stated.extent.unwrap_or(lens.extent);
    lens.vertical_fov_rad = stated.vertical_fov_rad.unwrap_or(lens.vertical_fov_rad);
    let mut done: Vec<Kind> = Vec::new();
    let mut shots = Vec::new();
    for &kind in kinds {
        if done.contains(&kind) {
            continue;
        }
        done.push(kind);
        let mut shot = |vehicle: Option<&Carrier>| {
            let id = vehicle.map(|vehicle| vehicle.id);
            let source = match (kind.mount(), id) {
                (Some(mount), Some(id)) => Source::Mounted(id, mount),
                _ => Source::Free(args.standpoint(kind, id, experiment)),
            };
            shots.push(Shot {
                camera: kind.name().to_owned(),
                owner: vehicle.map_or("city", |vehicle| &vehicle.name).to_owned(),
                vehicle: id,
                lens,
                kinds: stated.kinds.unwrap_or(Kinds::RGB),
                every_s: stated.every_s.unwrap_or(stated.usual_every_s),
                source,
            });
        };
        if kind.stands_alone() && (chosen.is_empty() || args.at.is_some()) {
            shot(None);
        } else {
            all.iter().for_each(|vehicle| shot(Some(vehicle)));
        }
    }
    shots
}
