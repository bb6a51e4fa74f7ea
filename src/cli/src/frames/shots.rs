//! The cameras that take pictures: sensors of the scenario's vehicles, or cameras of the command line.

use super::super::Failure;
use super::cameras::{CameraArgs, CameraChoice, Standpoint};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_render::PictureCamera;
use city3d_sensors::{Camera, CameraError, Lens, Mount, PictureKinds, View};
use city3d_sensors::{CameraSensor, Sensor, SensorKind};
use city3d_session::capture::CameraCarrier;
use city3d_simulation::scenario::Experiment;

/// Overrides of the command line for all cameras; they win over the scenario.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraOverrides {
    pub(super) extent: Option<[u32; 2]>,
    pub(super) vertical_fov_rad: Option<f64>,
    pub(super) every_s: Option<f64>,
    /// Default interval.
    pub(super) default_every_s: f64,
    pub(super) kinds: Option<PictureKinds>,
}

/// A camera that takes pictures throughout a run.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    /// Name of the camera in file names.
    pub(super) camera: String,
    /// Name of the vehicle, or `city`.
    pub(super) owner: String,
    pub(super) vehicle: Option<VehicleId>,
    pub(super) lens: Lens,
    pub(super) kinds: PictureKinds,
    /// Simulated seconds from one picture to the next.
    pub(super) every_s: f64,
    source: ShotCamera,
}

#[derive(Clone, Copy, Debug)]
enum ShotCamera {
    Mounted(VehicleId, Mount),
    Free(Standpoint),
}

impl Shot {
    /// Its view; `None` once its vehicle has left.
    pub(super) fn view(&self, snapshot: &FrameSnapshot) -> Result<Option<View>, CameraError> {
        if self.vehicle.is_some_and(|id| snapshot.vehicle(id).is_none()) {
            return Ok(None);
        }
        let camera = match &self.source {
            ShotCamera::Mounted(vehicle, mount) => Camera::onboard(*vehicle, *mount),
            ShotCamera::Free(standpoint) => standpoint.camera(snapshot, &self.lens),
        };
        camera.view(snapshot, &self.lens).map(Some)
    }

    /// The camera, as the table names it.
    pub(super) fn taken_by(&self) -> PictureCamera<'_> {
        PictureCamera { camera: &self.camera, owner: &self.owner, vehicle: self.vehicle, lens: self.lens }
    }

    /// File stem of a picture, without the kind.
    pub(super) fn stem(&self, tick: u64) -> String {
        format!("{}_{}_{tick:08}", self.camera, self.owner)
    }
}

/// The requested cameras.
pub(super) fn shots(
    args: &CameraArgs,
    overrides: &CameraOverrides,
    experiment: &Experiment,
    carriers: &[CameraCarrier],
) -> Result<Vec<Shot>, Failure> {
    let chosen = args.chosen((&experiment.name, carriers))?;
    let all: Vec<&CameraCarrier> = if chosen.is_empty() { carriers.iter().collect() } else { chosen.clone() };
    let shots = if args.camera.is_empty() {
        let shots = of_sensors(args, overrides, &all)?;
        if shots.is_empty() {
            of_kinds(&[CameraChoice::Windscreen], args, overrides, experiment, (&chosen, &all))
        } else {
            shots
        }
    } else {
        of_kinds(&args.camera, args, overrides, experiment, (&chosen, &all))
    };
    if shots.is_empty() {
        let name = &experiment.name;
        return Err(Failure::bad_input(format!(
            "scenario {name} has no vehicle to carry a camera; take --camera orbit or overhead"
        )));
    }
    let step_s = experiment.rates.dt_s();
    match overrides.every_s.filter(|&every_s| every_s < step_s * (1.0 - 1e-9)) {
        Some(every_s) => Err(Failure::bad_input(format!(
            "a picture every {every_s} s is more than one per physics step; take --every {step_s} or more, or \
             --fps {} or less",
            experiment.rates.physics_hz
        ))),
        None => Ok(shots),
    }
}

/// The cameras that the scenario gives the chosen vehicles, or all of them.
fn of_sensors(
    args: &CameraArgs,
    overrides: &CameraOverrides,
    all: &[&CameraCarrier],
) -> Result<Vec<Shot>, Failure> {
    let carried =
        || all.iter().flat_map(|vehicle| vehicle.sensors.iter().map(move |sensor| (*vehicle, sensor)));
    for wanted in &args.sensor {
        if !carried().any(|(_, sensor)| sensor.name == *wanted) {
            let mut names: Vec<&str> = carried().map(|(_, sensor)| sensor.name.as_str()).collect();
            names.sort_unstable();
            names.dedup();
            let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            return Err(Failure::bad_input(format!(
                "none of the chosen vehicles carries a sensor \"{wanted}\"; there are: {names}"
            )));
        }
    }
    let is_wanted = |sensor: &Sensor| args.sensor.is_empty() || args.sensor.contains(&sensor.name);
    let shots = carried().filter(|(_, sensor)| is_wanted(sensor)).map(|(vehicle, sensor)| {
        let SensorKind::Camera(CameraSensor { mount, mut lens, kinds }) = sensor.kind;
        lens.extent = overrides.extent.unwrap_or(lens.extent);
        lens.vertical_fov_rad = overrides.vertical_fov_rad.unwrap_or(lens.vertical_fov_rad);
        Shot {
            camera: sensor.name.clone(),
            owner: vehicle.name.clone(),
            vehicle: Some(vehicle.id),
            lens,
            kinds: overrides.kinds.unwrap_or(kinds),
            every_s: overrides.every_s.unwrap_or(1.0 / sensor.rate_hz),
            source: ShotCamera::Mounted(vehicle.id, mount),
        }
    });
    Ok(shots.collect())
}

/// Cameras of the command line on the chosen vehicles, or on all of them.
fn of_kinds(
    kinds: &[CameraChoice],
    args: &CameraArgs,
    overrides: &CameraOverrides,
    experiment: &Experiment,
    (chosen, all): (&[&CameraCarrier], &[&CameraCarrier]),
) -> Vec<Shot> {
    let mut lens = Lens::default();
    lens.extent = overrides.extent.unwrap_or(lens.extent);
    lens.vertical_fov_rad = overrides.vertical_fov_rad.unwrap_or(lens.vertical_fov_rad);
    let mut done: Vec<CameraChoice> = Vec::new();
    let mut shots = Vec::new();
    for &kind in kinds {
        if done.contains(&kind) {
            continue;
        }
        done.push(kind);
        let mut shot = |vehicle: Option<&CameraCarrier>| {
            let id = vehicle.map(|vehicle| vehicle.id);
            let source = match (kind.mount(), id) {
                (Some(mount), Some(id)) => ShotCamera::Mounted(id, mount),
                _ => ShotCamera::Free(args.standpoint(kind, id, experiment)),
            };
            shots.push(Shot {
                camera: kind.name().to_owned(),
                owner: vehicle.map_or("city", |vehicle| &vehicle.name).to_owned(),
                vehicle: id,
                lens,
                kinds: overrides.kinds.unwrap_or(PictureKinds::RGB),
                every_s: overrides.every_s.unwrap_or(overrides.default_every_s),
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
