//! Poses and onboard pictures over ROS: command-line options, and the ends of sessions that they ask for.

#[cfg_attr(not(feature = "render"), path = "ros/no_pictures.rs")]
mod pictures;

use super::Failure;
use city3d_geometry::LengthScale;
use city3d_network::link::feedback::ViconFeedback;
use city3d_network::link::vicon::{
    EPOCH_S, ReceivedPose, RosTransport, Subject, Vicon, ViconCounters, ViconOptions, wall_s,
};
use city3d_network::link::{Client, ClientEvent};
use city3d_network::ros::{BindAddress, BridgeUri, MasterUri, NodeOptions};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleInfo};
use city3d_protocol::wire::Measurement;
use city3d_session::remote_control::PoseFeedback;
use city3d_session::robots::CaptureEnd;
use city3d_session::served::{PoseExchange, ServedEnds};
use city3d_simulation::runner::RosSummary;
use city3d_simulation::scenario::{Experiment, PlannedVehicle};
use clap::Args;
use std::sync::Arc;
use std::time::Duration;

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

/// The vehicles of an experiment as VICON subjects.
fn subjects_of(experiment: &Experiment) -> Vec<Subject> {
    let name = |planned: &PlannedVehicle| match &planned.physical {
        Some(physical) => physical.subject.clone(),
        None => planned.name.clone(),
    };
    let subject = |planned: &PlannedVehicle| Subject { vehicle: planned.id, name: name(planned) };
    experiment.vehicles.iter().map(subject).collect()
}

/// The physical vehicles of an experiment as VICON subjects.
fn physical_subjects_of(experiment: &Experiment) -> Vec<Subject> {
    subjects_of(experiment).into_iter().filter(|subject| experiment.is_physical(subject.vehicle)).collect()
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
    /// Poses over ROS, and onboard pictures where they are asked for.
    pub fn ends(&self, experiment: &Experiment) -> Result<ServedEnds, Failure> {
        let physical = physical_subjects_of(experiment);
        let Some(options) = self.transport.options("/city3d", self.ros_clock, physical)? else {
            return Ok(ServedEnds::default());
        };
        let cameras = self.pictures.cameras(experiment)?;
        let poses = RosPosePublisher::start(ViconOptions { cameras: cameras.names(), ..options })?;
        let pictures = cameras.publish(poses.vicon.pictures(), experiment)?;
        Ok(ServedEnds { poses: Some(Box::new(poses)), pictures, marks: None })
    }
}

/// Poses of VICON for the control framework, where the arguments ask for them.
pub fn feedback(args: &RosArgs, experiment: &Experiment) -> Result<Option<Box<dyn PoseFeedback>>, Failure> {
    let heard = subjects_of(experiment);
    let Some(options) = args.options("/city3d_mainframe", false, heard)? else { return Ok(None) };
    let vicon = Vicon::start(options).map_err(Failure::bad_input)?;
    let per_control = experiment.rates.ticks_per_control();
    Ok(Some(Box::new(RosFeedback(ViconFeedback::new(vicon, experiment.vehicles.len(), per_control)))))
}

/// Pose feedback over ROS.
struct RosFeedback(ViconFeedback);

impl PoseFeedback for RosFeedback {
    fn receive(&mut self, city: &mut Client) -> Option<ClientEvent> {
        self.0.receive(city)
    }
}

/// Motion capture of the emulated robots over ROS, where the arguments ask for it.
pub fn capture(args: &RosArgs, experiment: &Experiment) -> Result<Option<Box<dyn CaptureEnd>>, Failure> {
    let Some(options) = args.options("/city3d_testbed", false, Vec::new())? else { return Ok(None) };
    let vicon = Vicon::start(options).map_err(Failure::bad_input)?;
    let subjects = Arc::new(physical_subjects_of(experiment));
    Ok(Some(Box::new(RosMotionCapture { vicon, subjects })))
}

/// Motion capture over ROS, with its subjects.
struct RosMotionCapture {
    vicon: Vicon,
    subjects: Arc<Vec<Subject>>,
}

impl CaptureEnd for RosMotionCapture {
    fn publish(&mut self, latency_s: f64, poses: Vec<Measurement>) {
        // As VICON's bridge stamps them: now, less the latency of the capture.
        self.vicon.publish(wall_s() - latency_s, &self.subjects, poses);
    }
}

/// Publishes the poses of a city over ROS, and receives those of physical vehicles.
#[derive(Debug)]
struct RosPosePublisher {
    vicon: Vicon,
    /// Stamps are simulated time.
    has_clock: bool,
    roster: Arc<Vec<VehicleInfo>>,
    subjects: Arc<Vec<Subject>>,
    stamp_s: f64,
}

impl RosPosePublisher {
    fn start(options: ViconOptions) -> Result<Self, Failure> {
        let has_clock = options.has_clock;
        let vicon = Vicon::start(options).map_err(Failure::bad_input)?;
        Ok(Self { vicon, has_clock, roster: Arc::default(), subjects: Arc::default(), stamp_s: 0.0 })
    }
}

impl PoseExchange for RosPosePublisher {
    fn publish(&mut self, snapshot: &FrameSnapshot, scale: LengthScale) {
        if !Arc::ptr_eq(&self.roster, &snapshot.roster) {
            self.roster = Arc::clone(&snapshot.roster);
            let subject = |info: &VehicleInfo| Subject { vehicle: info.id, name: info.name.clone() };
            // Measured vehicles are published by VICON itself.
            let simulated = self.roster.iter().filter(|info| info.model != "measured");
            self.subjects = Arc::new(simulated.map(subject).collect());
        }
        let poses = Measurement::all(snapshot, scale).collect();
        self.stamp_s = if self.has_clock { snapshot.time_s } else { wall_s() };
        self.vicon.publish(self.stamp_s, &self.subjects, poses);
    }

    fn stamp_s(&self) -> f64 {
        self.stamp_s
    }

    fn next(&mut self, time_s: f64, is_running: bool) -> Option<Measurement> {
        let ReceivedPose { pose, .. } = self.vicon.receive(Duration::ZERO)?;
        let stamp_s = match is_running {
            _ if pose.stamp_s < EPOCH_S => pose.stamp_s,
            true => (time_s + pose.stamp_s - wall_s()).max(0.0),
            false => time_s,
        };
        Some(Measurement { stamp_s, ..pose })
    }

    fn summary(&self) -> RosSummary {
        summary_of(self.vicon.counters())
    }
}

fn summary_of(counters: ViconCounters) -> RosSummary {
    RosSummary {
        published: counters.published,
        dropped: counters.dropped,
        dropped_for_slow: counters.slow,
        heard: counters.received,
        master_is_there: counters.is_registered,
        master_returns: counters.returns,
        pictures: None,
    }
}
