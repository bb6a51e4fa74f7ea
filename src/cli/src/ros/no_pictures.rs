//! Onboard pictures over ROS, in a program without the renderer: there are none.

use crate::Failure;
use city3d_network::link::exchange::OnboardCamera;
use city3d_session::End;
use city3d_session::ros::RosNode;
use city3d_simulation::scenario::Experiment;
use clap::Args;

#[derive(Clone, Debug, Args)]
pub struct PictureArgs {}

impl PictureArgs {
    pub fn cameras(&self, _: &Experiment) -> Result<PublishedCameras, Failure> {
        Ok(PublishedCameras)
    }
}

pub struct PublishedCameras;

impl PublishedCameras {
    pub fn names(&self) -> Vec<OnboardCamera> {
        Vec::new()
    }

    pub fn publish(self, _: &RosNode, _: &Experiment) -> Result<Option<Box<dyn End>>, Failure> {
        Ok(None)
    }
}
