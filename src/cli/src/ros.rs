//! Poses and onboard pictures over ROS: command-line options, and the ends of sessions that they ask for.

#[cfg_attr(not(feature = "render"), path = "ros/no_pictures.rs")]
mod pictures;

use super::Failure;
use super::serve::ServedEnds;
use city3d_network::link::exchange::{PoseExchange, Subject};
use city3d_network::link::vicon::{RosTransport, Vicon, ViconOptions};
use city3d_network::ros::{BindAddress, BridgeUri, MasterUri, NodeOptions};
use city3d_session::remote::PoseFeedback;
use city3d_session::robots::CaptureEnd;
use city3d_session::ros::{RosFeedback, RosMotionCapture, RosNode, physical_subjects_of, subjects_of};
use city3d_simulation::scenario::Experiment;
use clap::Args;

/// Options of poses over ROS.
#[derive(Clone, Debug, Args)]
pub struct RosArgs {
    /// Exchange poses over ROS 1 as VICON does [default master: ROS_MASTER_URI, or this machine]
    #[arg(long, value_name = "MASTER_URI", num_args = 0..=1, require_equals = true, group = "transport")]
    ros: Option<Option<MasterUri>>,
    /// Exchange poses over rosbridge, for ROS 2 or across networks [default server: ws://127.0.0.1:9090]
    #[arg(long, value_name = "WS_URI", num_args = 0..=1, require_equals = true, group = "transport")]
    rosbridge: Option<Option<BridgeUri>>,
    /// Address that the ROS node listens on, 0.0.0.0 for all [default: ROS_HOSTNAME, ROS_IP or 127.0.0.1]
    #[arg(long, value_name = "IP", requires = "ros")]
    ros_bind: Option<BindAddress>,
    /// Name of the ROS node, instead of the command's
    #[arg(long, value_name = "NAME", requires = "ros", value_parser = node_name)]
    ros_name: Option<String>,
}

fn node_name(text: &str) -> Result<String, String> {
    let bare = text.trim_start_matches('/');
    let is_one = bare.starts_with(|c: char| c.is_ascii_alphabetic())
        && bare.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '/'));
    is_one
        .then(|| format!("/{bare}"))
        .ok_or_else(|| "letters, digits and _ are needed, a letter first".to_owned())
}

impl RosArgs {
    /// The transport of the topics, where the arguments ask for one.
    fn transport(&self, name: &str) -> Result<Option<RosTransport>, Failure> {
        if let Some(named) = &self.rosbridge {
            let uri = named.clone().map_or_else(BridgeUri::localhost, Ok).map_err(Failure::bad_input)?;
            return Ok(Some(RosTransport::Bridge(uri.into())));
        }
        let Some(named) = &self.ros else { return Ok(None) };
        let master =
            named.clone().map_or_else(MasterUri::from_environment, Ok).map_err(Failure::bad_input)?;
        let name = self.ros_name.clone().unwrap_or_else(|| name.to_owned());
        Ok(Some(RosTransport::Node(NodeOptions { name, master, bind: self.ros_bind })))
    }

    /// Settings of poses over ROS, where the arguments ask for them; `name` is the default name of the node.
    fn options(
        &self,
        name: &str,
        has_clock: bool,
        subscribed: Vec<Subject>,
    ) -> Result<Option<ViconOptions>, Failure> {
        let transport = self.transport(name)?;
        Ok(transport.map(|transport| ViconOptions { transport, has_clock, subscribed, cameras: Vec::new() }))
    }
}

/// Options of what a served city exchanges over ROS.
#[derive(Clone, Debug, Args)]
pub struct ServedRosArgs {
    #[command(flatten)]
    transport: RosArgs,
    /// Publish simulated time over ROS: on /clock and in the stamps
    #[arg(long, requires = "transport")]
    ros_clock: bool,
    #[command(flatten)]
    pictures: pictures::PictureArgs,
}

impl ServedRosArgs {
    /// The looks of the pictures, and of a window beside them.
    #[cfg(feature = "render")]
    pub fn look(&self) -> super::look::LookArgs {
        self.pictures.look()
    }

    /// Poses over ROS, and onboard pictures where they are asked for.
    pub fn ends(&self, experiment: &Experiment) -> Result<ServedEnds, Failure> {
        let physical = physical_subjects_of(experiment);
        let Some(options) = self.transport.options("/city3d", self.ros_clock, physical)? else {
            return Ok(ServedEnds::default());
        };
        let cameras = self.pictures.cameras(experiment)?;
        let exchange = start(ViconOptions { cameras: cameras.names(), ..options })?;
        let node = RosNode::new(exchange, "ros", self.ros_clock);
        let mut ends = ServedEnds { capture: Some(Box::new(node.capture())), ..ServedEnds::default() };
        ends.urgent.push(Box::new(node.poses()));
        ends.later.extend(cameras.publish(&node, experiment)?);
        Ok(ends)
    }
}

fn start(options: ViconOptions) -> Result<Box<dyn PoseExchange>, Failure> {
    Ok(Box::new(Vicon::start(options).map_err(Failure::bad_input)?))
}

/// Poses of VICON for the control framework, where the arguments ask for them.
pub fn feedback(args: &RosArgs, experiment: &Experiment) -> Result<Option<Box<dyn PoseFeedback>>, Failure> {
    let Some(options) = args.options("/city3d_mainframe", false, subjects_of(experiment))? else {
        return Ok(None);
    };
    Ok(Some(Box::new(RosFeedback::new(start(options)?, experiment))))
}

/// Motion capture of the emulated robots over ROS, where the arguments ask for it.
pub fn capture(args: &RosArgs, experiment: &Experiment) -> Result<Option<Box<dyn CaptureEnd>>, Failure> {
    let Some(options) = args.options("/city3d_testbed", false, Vec::new())? else { return Ok(None) };
    Ok(Some(Box::new(RosMotionCapture::new(start(options)?, experiment))))
}
