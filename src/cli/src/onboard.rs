//! Onboard cameras whose pictures are published by topics.

use super::Failure;
use super::look::{self, LookArgs};
use city3d_network::link::exchange::OnboardCamera;
use city3d_sensors::{CameraSensor, Lens, Mount, SensorKind};
use city3d_session::End;
use city3d_session::pictures::CarriedCamera;
use city3d_session::ros::RosNode;
use city3d_session::ros_pictures::RosPictures;
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;

/// Default camera where the scenario has none: pictures per second behind each windscreen.
const USUAL_HZ: f64 = 10.0;
const USUAL_NAME: &str = "windscreen";

/// Cameras with their names in topics.
#[derive(Default)]
pub struct PublishedCameras(Vec<(OnboardCamera, CarriedCamera)>);

impl PublishedCameras {
    /// The cameras that a scenario gives its vehicles, or one behind each windscreen where it gives none. `option` has asked
    /// for them.
    pub fn carried(experiment: &Experiment, extent: Option<[u32; 2]>, option: &str) -> Result<Self, Failure> {
        let sized = |lens: Lens| Lens { extent: extent.unwrap_or(lens.extent), ..lens };
        let mut cameras = Vec::new();
        for planned in &experiment.vehicles {
            cameras.extend(planned.sensors.iter().map(|sensor| {
                let SensorKind::Camera(CameraSensor { mount, lens, .. }) = sensor.kind;
                let name = OnboardCamera { vehicle: planned.name.clone(), camera: sensor.name.clone() };
                let every_s = 1.0 / sensor.rate_hz;
                (name, CarriedCamera { vehicle: planned.id, mount, lens: sized(lens), every_s })
            }));
        }
        if cameras.is_empty() {
            cameras.extend(experiment.vehicles.iter().map(|planned| {
                let name = OnboardCamera { vehicle: planned.name.clone(), camera: USUAL_NAME.to_owned() };
                let (mount, lens, every_s) = (Mount::Windscreen, sized(Lens::default()), 1.0 / USUAL_HZ);
                (name, CarriedCamera { vehicle: planned.id, mount, lens, every_s })
            }));
        }
        if cameras.is_empty() {
            return Err(Failure::bad_input(format!(
                "scenario {} has no vehicle to carry a camera; leave {option} out",
                experiment.name
            )));
        }
        Ok(Self(cameras))
    }

    pub fn names(&self) -> Vec<OnboardCamera> {
        self.0.iter().map(|(name, _)| name.clone()).collect()
    }

    /// Starts to draw, where there are cameras.
    pub fn publish(
        self,
        node: &RosNode,
        experiment: &Experiment,
        look: &LookArgs,
    ) -> Result<Option<Box<dyn End>>, Failure> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let cameras = self.0.into_iter().map(|(_, camera)| camera).collect();
        let open = look::opener(look, &Arc::new(experiment.clone()));
        Ok(Some(Box::new(RosPictures::start(open, cameras, node, experiment.scale)?)))
    }
}
