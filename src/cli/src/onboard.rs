//! Onboard cameras whose pictures are published by topics.

use super::Failure;
use super::cameras::{ScenarioCamera, scenario_cameras};
use super::look::{self, LookArgs};
use city3d_network::link::exchange::{CameraShows, OnboardCamera};
use city3d_sensors::PictureKind;
use city3d_session::End;
use city3d_session::pictures::CarriedCamera;
use city3d_session::ros::RosNode;
use city3d_session::ros_pictures::RosPictures;
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;

/// Cameras with their names in topics.
#[derive(Default)]
pub struct PublishedCameras(Vec<(OnboardCamera, CarriedCamera)>);

impl PublishedCameras {
    /// The cameras that a scenario gives its vehicles, or one behind each windscreen where it gives none. `option` has asked
    /// for them.
    pub fn carried(
        experiment: &Experiment,
        extent: Option<[u32; 2]>,
        shown: &[CameraShows],
        option: &str,
    ) -> Result<Self, Failure> {
        let named = |of: ScenarioCamera| {
            shown.iter().map(move |&shows| {
                let kind = match shows {
                    CameraShows::Colour => PictureKind::Rgb,
                    CameraShows::Depth => PictureKind::Depth,
                    CameraShows::Classes => PictureKind::Semantic,
                };
                let name = OnboardCamera { vehicle: of.vehicle.clone(), camera: of.name.clone(), shows };
                (name, CarriedCamera { kind, ..of.camera })
            })
        };
        let cameras: Vec<_> = scenario_cameras(experiment, extent).into_iter().flat_map(named).collect();
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
