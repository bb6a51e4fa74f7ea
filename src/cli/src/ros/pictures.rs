//! Onboard pictures over ROS.

use crate::Failure;
use crate::look::LookArgs;
use crate::pictures::{CarriedCamera, PictureThread, TakenPicture};
use city3d_geometry::LengthScale;
use city3d_network::link::onboard::{OnboardCamera, OnboardPicture, PictureSender};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::encode_png;
use city3d_sensors::{CameraSensor, Lens, Mount, Projection, SensorKind};
use city3d_session::served::{PictureCounts, PictureEnd};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use rayon::prelude::*;
use std::sync::Arc;

/// Default camera where the scenario has none: pictures per second behind each windscreen.
const USUAL_HZ: f64 = 10.0;
const USUAL_NAME: &str = "windscreen";

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
    pub fn publish(
        self,
        sender: PictureSender,
        experiment: &Experiment,
    ) -> Result<Option<Box<dyn PictureEnd>>, Failure> {
        if self.cameras.is_empty() {
            return Ok(None);
        }
        let (wanted, scale, publisher) = (sender.wanted(), experiment.scale, sender.clone());
        let take = move |taken: Vec<_>| publish(&publisher, &taken, scale);
        let cameras = self.cameras.into_iter().map(|(_, camera)| camera).collect();
        let experiment = Arc::new(experiment.clone());
        let thread = PictureThread::start(&experiment, self.look.clone(), cameras, wanted, take)?;
        Ok(Some(Box::new(PublishedPictures { thread, sender })))
    }
}

/// The cameras that a scenario gives its vehicles, or one behind each windscreen where it gives none.
fn carried_cameras(experiment: &Experiment, extent: Option<[u32; 2]>) -> Vec<(OnboardCamera, CarriedCamera)> {
    let sized = |lens: Lens| Lens { extent: extent.unwrap_or(lens.extent), ..lens };
    let mut cameras = Vec::new();
    for planned in &experiment.vehicles {
        cameras.extend(planned.sensors.iter().map(|sensor| {
            let SensorKind::Camera(CameraSensor { mount, lens, .. }) = sensor.kind;
            let name = OnboardCamera { vehicle: planned.name.clone(), camera: sensor.name.clone() };
            let every_s = 1.0 / sensor.rate_hz;
            (name, CarriedCamera { vehicle: planned.id, mount, lens: sized(lens), every_s })
        }));
    }
    if cameras.is_empty() {
        cameras.extend(experiment.vehicles.iter().map(|planned| {
            let name = OnboardCamera { vehicle: planned.name.clone(), camera: USUAL_NAME.to_owned() };
            let (mount, lens, every_s) = (Mount::Windscreen, sized(Lens::default()), 1.0 / USUAL_HZ);
            (name, CarriedCamera { vehicle: planned.id, mount, lens, every_s })
        }));
    }
    cameras
}

/// Onboard pictures that are published over ROS.
struct PublishedPictures {
    thread: PictureThread,
    sender: PictureSender,
}

impl PictureEnd for PublishedPictures {
    fn show(&mut self, snapshot: &FrameSnapshot, stamp_s: f64) {
        self.thread.show(snapshot, stamp_s);
    }

    fn counts(&self) -> PictureCounts {
        let PictureCounts { taken, dropped, .. } = self.thread.counts();
        let (published, lost) = self.sender.counters();
        PictureCounts { taken, published, dropped: lost + dropped }
    }
}

/// Encodes the pictures of an instant as PNG and queues them.
fn publish(sender: &PictureSender, taken: &[TakenPicture], scale: LengthScale) {
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
