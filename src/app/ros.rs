//! Poses over ROS: the options of commands, and what a city publishes.

use super::Failure;
#[cfg(feature = "render")]
use super::pictures::Taken;
use crate::geom::LengthScale;
use crate::link::onboard::OnboardCamera;
use crate::link::vicon::{Carrier, EPOCH_S, HeardPose, Subject, Vicon, ViconFigures, ViconOptions, wall_s};
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

/// Poses over ROS, as VICON publishes them.
#[derive(Clone, Debug, Args)]
pub struct RosArgs {
    /// Poses over ROS 1 as of VICON; without a master's address by ROS_MASTER_URI, or on this machine
    #[arg(long, value_name = "MASTER_URI", num_args = 0..=1, require_equals = true, group = "carrier")]
    ros: Option<Option<MasterUri>>,
    /// The same over rosbridge, for ROS 2 or across networks; without its address ws://127.0.0.1:9090
    #[cfg(feature = "rosbridge")]
    #[arg(long, value_name = "WS_URI", num_args = 0..=1, require_equals = true, group = "carrier")]
    rosbridge: Option<Option<BridgeUri>>,
    /// Address that the ROS node listens on, 0.0.0.0 for all; ROS_IP or ROS_HOSTNAME, or this machine alone
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

    /// What carries the topics, where that is asked for.
    fn carrier(&self, name: &str) -> Result<Option<Carrier>, Failure> {
        #[cfg(feature = "rosbridge")]
        if let Some(named) = &self.rosbridge {
            let uri = named.clone().map_or_else(BridgeUri::usual, Ok).map_err(Failure::bad_input)?;
            return Ok(Some(Carrier::Bridge(uri.into())));
        }
        let Some(named) = &self.ros else { return Ok(None) };
        let master = named.clone().map_or_else(MasterUri::of_environment, Ok).map_err(Failure::bad_input)?;
        let name = self.ros_name.clone().unwrap_or_else(|| name.to_owned());
        Ok(Some(Carrier::Node(NodeOptions { name, master, bind: self.ros_bind })))
    }

    /// How poses go over ROS, where that is asked for; the node has this name unless told otherwise.
    pub fn options(
        &self,
        name: &str,
        has_clock: bool,
        heard: Vec<Subject>,
    ) -> Result<Option<ViconOptions>, Failure> {
        let carrier = self.carrier(name)?;
        Ok(carrier.map(|carrier| ViconOptions { carrier, has_clock, heard, cameras: Vec::new() }))
    }
}

/// The vehicles of an experiment, as VICON knows them.
pub fn subjects_of(experiment: &Experiment) -> Vec<Subject> {
    let name = |planned: &PlannedVehicle| match &planned.physical {
        Some(physical) => physical.subject.clone(),
        None => planned.name.clone(),
    };
    let subject = |planned: &PlannedVehicle| Subject { vehicle: planned.id, name: name(planned) };
    experiment.vehicles.iter().map(subject).collect()
}

/// Those of the laboratory alone.
pub fn physical_subjects_of(experiment: &Experiment) -> Vec<Subject> {
    subjects_of(experiment).into_iter().filter(|subject| experiment.is_physical(subject.vehicle)).collect()
}

/// The poses that a city publishes.
#[derive(Debug)]
pub struct Poses {
    vicon: Vicon,
    /// Stamps are simulated time.
    has_clock: bool,
    roster: Arc<Vec<VehicleInfo>>,
    subjects: Arc<Vec<Subject>>,
    /// Of the poses that were published last.
    #[cfg(feature = "render")]
    pub stamp_s: f64,
}

impl Poses {
    /// A node, where one is asked for.
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

    /// Hands over the poses of an instant, and never waits.
    pub fn publish(&mut self, snapshot: &FrameSnapshot, scale: LengthScale) {
        if !Arc::ptr_eq(&self.roster, &snapshot.roster) {
            self.roster = Arc::clone(&snapshot.roster);
            let subject = |info: &VehicleInfo| Subject { vehicle: info.id, name: info.name.clone() };
            // Of those that are measured others tell.
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

    /// Where onboard pictures are handed over.
    #[cfg(feature = "render")]
    pub fn pictures(&self) -> PictureSender {
        self.vicon.pictures()
    }

    /// The next pose of a vehicle of the laboratory that has come, on a clock that shows this now.
    pub fn next(&self, time_s: f64, is_running: bool) -> Option<Measurement> {
        let HeardPose { pose, .. } = self.vicon.receive(Duration::ZERO)?;
        let stamp_s = match is_running {
            _ if pose.stamp_s < EPOCH_S => pose.stamp_s,
            true => (time_s + pose.stamp_s - wall_s()).max(0.0),
            false => time_s,
        };
        Some(Measurement { stamp_s, ..pose })
    }

    pub fn figures(&self) -> RosSummary {
        summary(self.vicon.figures())
    }
}

pub fn summary(figures: ViconFigures) -> RosSummary {
    RosSummary {
        published: figures.published,
        dropped: figures.dropped,
        dropped_for_slow: figures.slow,
        heard: figures.heard,
        master_is_there: figures.is_registered,
        master_returns: figures.returns,
        pictures: None,
    }
}

/// Hands over what the cameras of an instant have taken.
#[cfg(feature = "render")]
pub fn publish_pictures(sender: &PictureSender, taken: &[Taken], scale: LengthScale) {
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
