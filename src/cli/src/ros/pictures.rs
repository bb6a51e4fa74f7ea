//! Onboard pictures over ROS.

use crate::Failure;
use crate::cameras::{ScenarioCamera, scenario_cameras};
use crate::look::{self, LookArgs};
use city3d_network::link::onboard::OnboardCamera;
use city3d_session::End;
use city3d_session::pictures::CarriedCamera;
use city3d_session::ros::RosNode;
use city3d_session::ros_pictures::RosPictures;
use city3d_simulation::scenario::Experiment;
use clap::Args;
use std::sync::Arc;

/// Options of onboard pictures.
#[derive(Clone, Debug, Args)]
pub struct PictureArgs {
    /// Publish onboard pictures over ROS: from the scenario's cameras, or one behind each windscreen
    #[arg(long, requires = "ros")]
    ros_cameras: bool,
    /// Width and height of the onboard pictures in pixels [default: the sensors', or 640x480]
    #[arg(long, value_name = "WxH", requires = "ros_cameras", value_parser = crate::values::size)]
    ros_camera_size: Option<[u32; 2]>,
    #[command(flatten)]
    look: LookArgs,
}

impl PictureArgs {
    #[cfg(any(feature = "window", feature = "web", feature = "foxglove"))]
    pub fn look(&self) -> LookArgs {
        self.look.clone()
    }

    /// The cameras whose pictures are asked for.
    pub fn cameras(&self, experiment: &Experiment) -> Result<PublishedCameras<'_>, Failure> {
        let cameras =
            if self.ros_cameras { carried_cameras(experiment, self.ros_camera_size) } else { Vec::new() };
        if self.ros_cameras && cameras.is_empty() {
            return Err(Failure::bad_input(format!(
                "scenario {} has no vehicle to carry a camera; leave --ros-cameras out",
                experiment.name
            )));
        }
        Ok(PublishedCameras { cameras, look: &self.look })
    }
}

/// Cameras with their names in topics.
pub struct PublishedCameras<'a> {
    cameras: Vec<(OnboardCamera, CarriedCamera)>,
    look: &'a LookArgs,
}

impl PublishedCameras<'_> {
    pub fn names(&self) -> Vec<OnboardCamera> {
        self.cameras.iter().map(|(name, _)| name.clone()).collect()
    }

    /// Starts to draw, where there are cameras.
    pub fn publish(self, node: &RosNode, experiment: &Experiment) -> Result<Option<Box<dyn End>>, Failure> {
        if self.cameras.is_empty() {
            return Ok(None);
        }
        let cameras = self.cameras.into_iter().map(|(_, camera)| camera).collect();
        let open = look::opener(self.look, &Arc::new(experiment.clone()));
        Ok(Some(Box::new(RosPictures::start(open, cameras, node, experiment.scale)?)))
    }
}

/// The cameras of a scenario with their names in topics.
fn carried_cameras(experiment: &Experiment, extent: Option<[u32; 2]>) -> Vec<(OnboardCamera, CarriedCamera)> {
    let named = |ScenarioCamera { vehicle, name, camera }| (OnboardCamera { vehicle, camera: name }, camera);
    scenario_cameras(experiment, extent).into_iter().map(named).collect()
}
