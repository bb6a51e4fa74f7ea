//! Poses and onboard pictures over ROS: command-line options, and the publisher of a served city.

use super::Failure;
#[cfg(feature = "render")]
use super::pictures::TakenPicture;
use crate::geom::LengthScale;
use crate::link::onboard::OnboardCamera;
use crate::link::vicon::{
    EPOCH_S, ReceivedPose, RosTransport, Subject, Vicon, ViconCounters, ViconOptions, wall_s,
};
#[cfg(feature = "rosbridge")]
use crate::ros::BridgeUri;
use crate::ros::{BindAddress, MasterUri, NodeOptions};
use crate::runner::RosSummary;
use crate::scenario::{Experiment, PlannedVehicle};
use crate::snapshot::{FrameSnapshot, VehicleInfo};
use crate::wire::Measurement;
#[cfg(feature = "render")]
use crate::{
    camera::Projection,
    link::onboard::{OnboardPicture, PictureSender},
    render::encode_png,
};
use clap::Args;
#[cfg(feature = "render")]
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Duration;

/// Options of poses over ROS.
#[derive(Clone, Debug, Args)]
pub struct RosArgs {
    /// Exchange poses over ROS 1 as VICON does [default master: ROS_MASTER_URI, or this machine]
    #[arg(long, value_name = "MASTER_URI", num_args = 0..=1, require_equals = true, group = "transport")]
    ros: Option<Option<MasterUri>>,
    /// Exchange poses over rosbridge, for ROS 2 or across networks [default server: ws://127.0.0.1:9090]
    #[cfg(feature = "rosbridge")]
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
    pub fn is_asked_for(&self) -> bool {
        #[cfg(feature = "rosbridge")]
        return self.ros.is_some() || self.rosbridge.is_some();
        #[cfg(not(feature = "rosbridge"))]
        self.ros.is_some()
    }

    /// The transport of the topics, where the arguments ask for one.
    fn transport(&self, name: &str) -> Result<Option<RosTransport>, Failure> {
        #[cfg(feature = "rosbridge")]
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
    pub fn options(
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
pub fn subjects_of(experiment: &Experiment) -> Vec<Subject> {
    let name = |planned: &PlannedVehicle| match &planned.physical {
        Some(physical) => physical.subject.clone(),
        None => planned.name.clone(),
    };
    let subject = |planned: &PlannedVehicle| Subject { vehicle: planned.id, name: name(planned) };
    experiment.vehicles.iter().map(subject).collect()
}

/// The physical vehicles of an experiment as VICON subjects.
pub fn physical_subjects_of(experiment: &Experiment) -> Vec<Subject> {
    subjects_of(experiment).into_iter().filter(|subject| experiment.is_physical(subject.vehicle)).collect()
}

/// Publishes the poses of a city over ROS, and receives those of physical vehicles.
#[derive(Debug)]
pub struct RosPosePublisher {
    vicon: Vicon,
    /// Stamps are simulated time.
    has_clock: bool,
    roster: Arc<Vec<VehicleInfo>>,
    subjects: Arc<Vec<Subject>>,
    /// Stamp of the poses that were published last.
    #[cfg(feature = "render")]
    pub stamp_s: f64,
}

impl RosPosePublisher {
    /// Starts the publisher, where the arguments ask for one.
    pub fn start(
        args: &RosArgs,
        has_clock: bool,
        physical: Vec<Subject>,
        cameras: Vec<OnboardCamera>,
    ) -> Result<Option<Self>, Failure> {
        let Some(options) = args.options("/city3d", has_clock, physical)? else { return Ok(None) };
        let options = ViconOptions { cameras, ..options };
        let vicon = Vicon::start(options).map_err(Failure::bad_input)?;
        Ok(Some(Self {
            vicon,
            has_clock,
            roster: Arc::default(),
            subjects: Arc::default(),
            #[cfg(feature = "render")]
            stamp_s: 0.0,
        }))
    }

    /// Queues the poses of an instant without blocking.
    pub fn publish(&mut self, snapshot: &FrameSnapshot, scale: LengthScale) {
        if !Arc::ptr_eq(&self.roster, &snapshot.roster) {
            self.roster = Arc::clone(&snapshot.roster);
            let subject = |info: &VehicleInfo| Subject { vehicle: info.id, name: info.name.clone() };
            // Measured vehicles are published by VICON itself.
            let simulated = self.roster.iter().filter(|info| info.model != "measured");
            self.subjects = Arc::new(simulated.map(subject).collect());
        }
        let poses = Measurement::all(snapshot, scale).collect();
        let stamp_s = if self.has_clock { snapshot.time_s } else { wall_s() };
        self.vicon.publish(stamp_s, &self.subjects, poses);
        #[cfg(feature = "render")]
        {
            self.stamp_s = stamp_s;
        }
    }

    /// The queue for onboard pictures.
    #[cfg(feature = "render")]
    pub fn pictures(&self) -> PictureSender {
        self.vicon.pictures()
    }

    /// Takes the next received pose of a physical vehicle, stamped with the simulated time `time_s` of now.
    pub fn next(&self, time_s: f64, is_running: bool) -> Option<Measurement> {
        let ReceivedPose { pose, .. } = self.vicon.receive(Duration::ZERO)?;
        let stamp_s = match is_running {
            _ if pose.stamp_s < EPOCH_S => pose.stamp_s,
            true => (time_s + pose.stamp_s - wall_s()).max(0.0),
            false => time_s,
        };
        Some(Measurement { stamp_s, ..pose })
    }

    pub fn summary(&self) -> RosSummary {
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

/// Encodes the pictures of an instant as PNG and queues them.
#[cfg(feature = "render")]
pub fn publish_pictures(sender: &PictureSender, taken: &[TakenPicture], scale: LengthScale) {
    taken.par_iter().for_each(|taken| {
        let Projection::Pinhole { intrinsics: k, .. } = taken.view.projection else { return };
        match encode_png(&taken.image) {
            Ok(png) => sender.send(OnboardPicture {
                camera: taken.camera,
                stamp_s: taken.stamp_s,
                png,
                extent: taken.view.extent,
                pinhole: [k.fx, k.fy, k.cx, k.cy],
                position: taken.view.extrinsics.position / scale.factor(),
                orientation: taken.view.extrinsics.orientation,
            }),
            Err(error) => tracing::warn!("an onboard picture is dropped: {error}"),
        }
    });
}
