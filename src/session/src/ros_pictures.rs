//! Onboard pictures as an end over ROS: encoded as PNG, with the intrinsics and extrinsics of their cameras.

use super::Moment;
use super::end::{End, EndHealth};
use super::pictures::{
    CarriedCamera, OpenRenderer, PictureError, PictureStamps, PictureThread, TakenPicture,
};
use super::ros::RosNode;
use city3d_geometry::LengthScale;
use city3d_network::link::onboard::{OnboardPicture, PictureSender};
use city3d_render::encode_png;
use city3d_sensors::Projection;
use rayon::prelude::*;

/// Onboard pictures that are published over ROS.
#[derive(Debug)]
pub struct RosPictures {
    thread: PictureThread,
    sender: PictureSender,
}

impl RosPictures {
    /// Opens the renderer, and draws for the subscribers of a node.
    ///
    /// # Errors
    /// Where no adapter can draw.
    pub fn start(
        open: OpenRenderer,
        cameras: Vec<CarriedCamera>,
        node: &RosNode,
        scale: LengthScale,
    ) -> Result<Self, PictureError> {
        let sender = node.pictures();
        let stamps = if node.has_clock() { PictureStamps::Simulated } else { PictureStamps::Wall };
        let publisher = sender.clone();
        let take = move |taken: Vec<_>| publish(&publisher, &taken, scale);
        let thread = PictureThread::start(open, (cameras, stamps), sender.wanted(), take)?;
        Ok(Self { thread, sender })
    }
}

impl End for RosPictures {
    fn name(&self) -> &'static str {
        "pictures"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        self.thread.take(moment);
    }

    fn health(&self) -> EndHealth {
        let (published, lost) = self.sender.counters();
        let EndHealth { dropped, failure, .. } = self.thread.health();
        EndHealth { delivered: published, dropped: lost + dropped, failure }
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
