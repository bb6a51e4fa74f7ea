//! The cameras of a scenario whose pictures are published while it runs.

use city3d_sensors::{CameraSensor, Lens, Mount, PictureKind, SensorKind};
use city3d_session::pictures::CarriedCamera;
use city3d_simulation::scenario::Experiment;

/// Default camera where the scenario has none: pictures per second behind each windscreen.
const USUAL_HZ: f64 = 10.0;
const USUAL_NAME: &str = "windscreen";

/// A camera with its names.
pub struct ScenarioCamera {
    pub vehicle: String,
    pub name: String,
    pub camera: CarriedCamera,
}

/// The cameras that a scenario gives its vehicles, or one behind each windscreen where it gives none.
pub fn scenario_cameras(experiment: &Experiment, extent: Option<[u32; 2]>) -> Vec<ScenarioCamera> {
    let sized = |lens: Lens| Lens { extent: extent.unwrap_or(lens.extent), ..lens };
    let mut cameras = Vec::new();
    for planned in &experiment.vehicles {
        cameras.extend(planned.sensors.iter().map(|sensor| {
            let SensorKind::Camera(CameraSensor { mount, lens, .. }) = sensor.kind;
            let every_s = 1.0 / sensor.rate_hz;
            let camera = CarriedCamera {
                vehicle: planned.id,
                mount,
                lens: sized(lens),
                every_s,
                kind: PictureKind::Rgb,
            };
            ScenarioCamera { vehicle: planned.name.clone(), name: sensor.name.clone(), camera }
        }));
    }
    if cameras.is_empty() {
        cameras.extend(experiment.vehicles.iter().map(|planned| {
            let (mount, lens, every_s) = (Mount::Windscreen, sized(Lens::default()), 1.0 / USUAL_HZ);
            let camera = CarriedCamera { vehicle: planned.id, mount, lens, every_s, kind: PictureKind::Rgb };
            ScenarioCamera { vehicle: planned.name.clone(), name: USUAL_NAME.to_owned(), camera }
        }));
    }
    cameras
}
