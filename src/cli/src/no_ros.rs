//! ROS, in a program without it: no options and no ends.

use super::Failure;
use super::serve::ServedEnds;
use city3d_session::remote::PoseFeedback;
use city3d_session::robots::CaptureEnd;
use city3d_simulation::scenario::Experiment;
use clap::Args;

#[derive(Clone, Debug, Args)]
pub struct RosArgs {}

#[derive(Clone, Debug, Args)]
pub struct ServedRosArgs {}

impl ServedRosArgs {
    #[cfg(feature = "render")]
    #[allow(clippy::unused_self, reason = "the same call with and without ROS")]
    pub fn look(&self) -> super::look::LookArgs {
        super::look::LookArgs::default()
    }

    pub fn ends(&self, _: &Experiment) -> Result<ServedEnds, Failure> {
        Ok(ServedEnds::default())
    }
}

pub fn feedback(_: &RosArgs, _: &Experiment) -> Result<Option<Box<dyn PoseFeedback>>, Failure> {
    Ok(None)
}

pub fn capture(_: &RosArgs, _: &Experiment) -> Result<Option<Box<dyn CaptureEnd>>, Failure> {
    Ok(None)
}
