//! Poses, pictures and trajectories over ROS 2: command-line options, and the ends of sessions that they ask for.

use super::Failure;
#[cfg(feature = "render")]
use super::look::LookArgs;
#[cfg(feature = "render")]
use super::onboard::PublishedCameras;
use super::serve::ServedEnds;
use city3d_network::link::exchange::Subject;
#[cfg(feature = "render")]
use city3d_network::link::exchange::{CameraShows, PictureForm};
use city3d_ros2::{Ros2Middleware, Ros2Network, Ros2Node, Ros2Options, VehicleTopics};
#[cfg(feature = "window")]
use city3d_session::End;
use city3d_session::remote::PoseFeedback;
use city3d_session::robots::CaptureEnd;
use city3d_session::ros::{RosFeedback, RosMotionCapture, RosNode, physical_subjects_of, subjects_of};
use city3d_simulation::scenario::Experiment;
use clap::{Args, ValueEnum};
use std::net::Ipv4Addr;

/// Name of the end in messages and in `summary.json`.
const END: &str = "ros2";

/// Options of poses over ROS 2.
#[derive(Clone, Debug, Default, Args)]
pub struct Ros2Args {
    /// Exchange poses over ROS 2 as ros2-vicon-receiver does [default domain: ROS_DOMAIN_ID, or 0]
    #[arg(long, value_name = "DOMAIN", num_args = 0..=1, require_equals = true, group = "transport")]
    ros2: Option<Option<u16>>,
    /// Let ROS 2 be reached from the network of this address of this machine, 0.0.0.0 for all [default: from this
    /// machine only]
    #[arg(long, value_name = "IP", requires = "ros2")]
    ros2_network: Option<Ipv4Addr>,
    /// Name of the node of ROS 2, instead of the command's
    #[arg(long, value_name = "NAME", requires = "ros2", value_parser = node_name)]
    ros2_name: Option<String>,
    /// Type of the poses of a vehicle
    #[arg(long, value_name = "TYPE", requires = "ros2", default_value = "pose")]
    ros2_type: VehicleTypeArg,
    /// Speak ROS 2 by Zenoh, as rmw_zenoh does, instead of DDS
    #[cfg(feature = "zenoh")]
    #[arg(long, requires = "ros2")]
    ros2_zenoh: bool,
}

/// Messages of geometry_msgs.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum VehicleTypeArg {
    /// PoseStamped
    #[default]
    Pose,
    /// TransformStamped
    Transform,
}

fn node_name(text: &str) -> Result<String, String> {
    let is_one = text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    is_one
        .then(|| text.to_owned())
        .ok_or_else(|| "letters, digits and _ are needed, a letter first".to_owned())
}

/// The domain of the environment.
fn usual_domain() -> Result<u16, Failure> {
    match std::env::var("ROS_DOMAIN_ID") {
        Ok(domain) if !domain.is_empty() => domain
            .parse()
            .map_err(|_| Failure::bad_input(format!("ROS_DOMAIN_ID is {domain}, which is no number"))),
        _ => Ok(0),
    }
}

impl Ros2Args {
    /// Settings of a node, where the arguments ask for one; `name` is its default name.
    fn options(&self, name: &str) -> Result<Option<Ros2Options>, Failure> {
        let Some(domain) = self.ros2 else { return Ok(None) };
        let domain = domain.map_or_else(usual_domain, Ok)?;
        let name = self.ros2_name.as_deref().unwrap_or(name);
        let options = Ros2Options::new(name, domain).map_err(Failure::bad_input)?;
        let network = match self.ros2_network {
            None => Ros2Network::Loopback,
            Some(Ipv4Addr::UNSPECIFIED) => Ros2Network::All,
            Some(address) => Ros2Network::Interface(address),
        };
        let vehicle_topics = match self.ros2_type {
            VehicleTypeArg::Pose => VehicleTopics::Poses,
            VehicleTypeArg::Transform => VehicleTopics::Transforms,
        };
        Ok(Some(Ros2Options { middleware: self.middleware(), network, vehicle_topics, ..options }))
    }

    #[cfg(feature = "zenoh")]
    fn middleware(&self) -> Ros2Middleware {
        if self.ros2_zenoh { Ros2Middleware::Zenoh } else { Ros2Middleware::Dds }
    }

    #[cfg(not(feature = "zenoh"))]
    fn middleware(&self) -> Ros2Middleware {
        Ros2Middleware::default()
    }
}

fn start(options: &Ros2Options) -> Result<Ros2Node, Failure> {
    Ros2Node::start(options).map_err(Failure::bad_input)
}

/// Options of what a served city exchanges over ROS 2.
#[derive(Clone, Debug, Args)]
pub struct ServedRos2Args {
    #[command(flatten)]
    published: PublishedRos2Args,
    /// Let a node of ROS 2 drive the vehicles of the scenario, by trajectories on /city3d/trajectory
    #[arg(long, requires = "ros2", conflicts_with = "lockstep")]
    ros2_control: bool,
}

/// Options of what any city publishes over ROS 2.
#[derive(Clone, Debug, Default, Args)]
pub struct PublishedRos2Args {
    #[command(flatten)]
    node: Ros2Args,
    /// Publish transforms over ROS 2: /tf and /tf_static
    #[arg(long, requires = "ros2")]
    ros2_tf: bool,
    /// Publish simulated time over ROS 2: on /clock and in the stamps
    #[arg(long, requires = "ros2")]
    ros2_clock: bool,
    #[cfg(feature = "render")]
    #[command(flatten)]
    pictures: Ros2PictureArgs,
}

/// Options of onboard pictures.
#[cfg(feature = "render")]
#[derive(Clone, Debug, Default, Args)]
struct Ros2PictureArgs {
    /// Publish onboard pictures over ROS 2: from the scenario's cameras, or one behind each windscreen
    #[arg(long, requires = "ros2")]
    ros2_cameras: bool,
    /// Width and height of these pictures in pixels [default: the sensors', or 640x480]
    #[arg(long, value_name = "WxH", requires = "ros2_cameras", value_parser = crate::values::size)]
    ros2_camera_size: Option<[u32; 2]>,
    /// Publish depth and classes beside the colours, as pixels; separated by commas
    #[arg(long, value_name = "KIND", requires = "ros2_cameras", value_delimiter = ',')]
    ros2_kinds: Vec<PictureKindArg>,
    /// Form of these pictures
    #[arg(long, value_name = "FORM", requires = "ros2_cameras", default_value = "jpeg")]
    ros2_pictures: PictureFormArg,
}

#[cfg(feature = "render")]
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum PictureFormArg {
    /// CompressedImage, JPEG
    #[default]
    Jpeg,
    /// CompressedImage, PNG
    Png,
    /// Image, rgb8
    Raw,
}

#[cfg(feature = "render")]
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PictureKindArg {
    /// Image, 32FC1: metres along the optical axis
    Depth,
    /// Image, 8UC1: class number of each pixel
    Classes,
}

#[cfg(feature = "render")]
impl PictureKindArg {
    fn shows(self) -> CameraShows {
        match self {
            Self::Depth => CameraShows::Depth,
            Self::Classes => CameraShows::Classes,
        }
    }
}

#[cfg(feature = "render")]
impl Ros2PictureArgs {
    /// The cameras that are asked for, which the node is told.
    fn cameras(
        &self,
        experiment: &Experiment,
        options: &mut Ros2Options,
    ) -> Result<PublishedCameras, Failure> {
        let cameras = match self.ros2_cameras {
            true => {
                let kinds = self.ros2_kinds.iter().map(|kind| kind.shows());
                let shown: Vec<_> = [CameraShows::Colour].into_iter().chain(kinds).collect();
                PublishedCameras::carried(experiment, self.ros2_camera_size, &shown, "--ros2-cameras")?
            }
            false => PublishedCameras::default(),
        };
        (options.cameras, options.picture_form) = (cameras.names(), self.form());
        Ok(cameras)
    }

    fn form(&self) -> PictureForm {
        match self.ros2_pictures {
            PictureFormArg::Jpeg => PictureForm::Jpeg,
            PictureFormArg::Png => PictureForm::Png,
            PictureFormArg::Raw => PictureForm::Rgb8,
        }
    }
}

impl ServedRos2Args {
    /// Poses over ROS 2, and what else is asked for.
    pub fn ends(
        &self,
        experiment: &Experiment,
        #[cfg(feature = "render")] look: &LookArgs,
    ) -> Result<ServedEnds, Failure> {
        let Some(mut options) = self.published.options()? else { return Ok(ServedEnds::default()) };
        options.subscribed = physical_subjects_of(experiment);
        if self.ros2_control {
            let driven = |planned: &city3d_simulation::scenario::PlannedVehicle| Subject {
                vehicle: planned.id,
                name: planned.name.clone(),
            };
            options.driven = experiment.vehicles.iter().map(driven).collect();
        }
        #[cfg(feature = "render")]
        let cameras = self.published.pictures.cameras(experiment, &mut options)?;
        let node = start(&options)?;
        let mut ends = ServedEnds::default();
        if self.ros2_control {
            ends.trajectories = Some(Box::new(node.trajectories()));
        }
        let node = RosNode::new(Box::new(node), END, options.has_clock);
        ends.capture = Some(Box::new(node.capture()));
        ends.urgent.push(Box::new(node.poses()));
        #[cfg(feature = "render")]
        ends.later.extend(cameras.publish(&node, experiment, look)?);
        Ok(ends)
    }
}

impl PublishedRos2Args {
    /// Settings of the node of a city, where the arguments ask for one.
    fn options(&self) -> Result<Option<Ros2Options>, Failure> {
        let options = self.node.options("city3d")?;
        Ok(options.map(|options| Ros2Options { has_tf: self.ros2_tf, has_clock: self.ros2_clock, ..options }))
    }

    /// The ends of a city that runs in a window: poses of all its vehicles, and pictures where they are asked for. None
    /// where ROS 2 is not asked for.
    #[cfg(feature = "window")]
    pub fn ends(&self, experiment: &Experiment, look: &LookArgs) -> Result<Vec<Box<dyn End>>, Failure> {
        let Some(mut options) = self.options()? else { return Ok(Vec::new()) };
        let cameras = self.pictures.cameras(experiment, &mut options)?;
        let node = RosNode::new(Box::new(start(&options)?), END, options.has_clock);
        let mut ends: Vec<Box<dyn End>> = vec![Box::new(node.all_poses(experiment))];
        ends.extend(cameras.publish(&node, experiment, look)?);
        Ok(ends)
    }

    /// Whether ROS 2 is asked for.
    #[cfg(feature = "window")]
    pub fn is_asked(&self) -> bool {
        self.node.ros2.is_some()
    }
}

/// Poses of motion capture for the control framework, where the arguments ask for them.
pub fn feedback(args: &Ros2Args, experiment: &Experiment) -> Result<Option<Box<dyn PoseFeedback>>, Failure> {
    let Some(mut options) = args.options("city3d_mainframe")? else { return Ok(None) };
    options.subscribed = subjects_of(experiment);
    Ok(Some(Box::new(RosFeedback::new(Box::new(start(&options)?), experiment))))
}

/// Motion capture of the emulated robots over ROS 2, where the arguments ask for it.
pub fn capture(args: &Ros2Args, experiment: &Experiment) -> Result<Option<Box<dyn CaptureEnd>>, Failure> {
    let Some(options) = args.options("city3d_testbed")? else { return Ok(None) };
    Ok(Some(Box::new(RosMotionCapture::new(Box::new(start(&options)?), experiment))))
}
