//! Onboard pictures over ROS.

use crate::Failure;
use crate::look::LookArgs;
use crate::onboard::PublishedCameras;
use city3d_network::link::exchange::{CameraShows, OnboardCamera};
use city3d_session::End;
use city3d_session::ros::RosNode;
use city3d_simulation::scenario::Experiment;
use clap::Args;

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
    pub fn look(&self) -> LookArgs {
        self.look.clone()
    }

    /// The cameras whose pictures are asked for.
    pub fn cameras(&self, experiment: &Experiment) -> Result<AskedCameras<'_>, Failure> {
        let cameras = match self.ros_cameras {
            true => PublishedCameras::carried(
                experiment,
                self.ros_camera_size,
                &[CameraShows::Colour],
                "--ros-cameras",
            )?,
            false => PublishedCameras::default(),
        };
        Ok(AskedCameras { cameras, look: &self.look })
    }
}

/// Cameras, and the looks of their pictures.
pub struct AskedCameras<'a> {
    cameras: PublishedCameras,
    look: &'a LookArgs,
}

impl AskedCameras<'_> {
    pub fn names(&self) -> Vec<OnboardCamera> {
        self.cameras.names()
    }

    /// Starts to draw, where there are cameras.
    pub fn publish(self, node: &RosNode, experiment: &Experiment) -> Result<Option<Box<dyn End>>, Failure> {
        self.cameras.publish(node, experiment, self.look)
    }
}
