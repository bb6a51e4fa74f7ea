//! ROS 2, in a program without it: no options and no ends.

use super::Failure;
#[cfg(feature = "render")]
use super::look::LookArgs;
use super::serve::ServedEnds;
use city3d_session::remote::PoseFeedback;
use city3d_session::robots::CaptureEnd;
use city3d_simulation::scenario::Experiment;
use clap::Args;

#[derive(Clone, Debug, Default, Args)]
pub struct Ros2Args {}

#[derive(Clone, Debug, Args)]
pub struct ServedRos2Args {}

#[cfg(feature = "window")]
#[derive(Clone, Debug, Default, Args)]
pub struct PublishedRos2Args {}

#[cfg(feature = "window")]
#[allow(clippy::unused_self, clippy::unnecessary_wraps, reason = "the same calls with and without ROS 2")]
impl PublishedRos2Args {
    pub fn ends(&self, _: &Experiment, _: &LookArgs) -> Result<Vec<Box<dyn city3d_session::End>>, Failure> {
        Ok(Vec::new())
    }

    pub fn is_asked(&self) -> bool {
        false
    }
}

impl ServedRos2Args {
    #[allow(clippy::unused_self, reason = "the same call with and without ROS 2")]
    pub fn ends(
        &self,
        _: &Experiment,
        #[cfg(feature = "render")] _: &LookArgs,
    ) -> Result<ServedEnds, Failure> {
        Ok(ServedEnds::default())
    }
}

pub fn feedback(_: &Ros2Args, _: &Experiment) -> Result<Option<Box<dyn PoseFeedback>>, Failure> {
    Ok(None)
}

pub fn capture(_: &Ros2Args, _: &Experiment) -> Result<Option<Box<dyn CaptureEnd>>, Failure> {
    Ok(None)
}
