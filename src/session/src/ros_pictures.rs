//! Onboard pictures as an end over ROS: encoded, with the intrinsics and extrinsics of their cameras.

use super::Moment;
use super::end::{End, EndHealth};
use super::pictures::{
    CarriedCamera, OpenRenderer, PictureError, PictureStamps, PictureThread, TakenPicture, jpeg,
};
use super::ros::RosNode;
use city3d_geometry::LengthScale;
use city3d_network::link::exchange::{OnboardPicture, PictureForm, PictureQueue};
use city3d_render::{Pictures, encode_png};
use city3d_sensors::Projection;
use rayon::prelude::*;
use std::sync::Arc;

const JPEG_QUALITY: u8 = 90;

/// Onboard pictures that are published over ROS.
#[derive(Debug)]
pub struct RosPictures {
    thread: PictureThread,
    queue: Arc<dyn PictureQueue>,
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
        let queue = node.pictures();
        let stamps = if node.has_clock() { PictureStamps::Simulated } else { PictureStamps::Wall };
        let publisher = Arc::clone(&queue);
        let take = move |taken: Vec<_>| publish(&*publisher, &taken, scale);
        let thread = PictureThread::start(open, (cameras, stamps), queue.wanted(), take)?;
        Ok(Self { thread, queue })
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
        let (published, lost) = self.queue.counters();
        let EndHealth { dropped, failure, .. } = self.thread.health();
        EndHealth { delivered: published, dropped: lost + dropped, failure }
    }
}

/// Encodes the pictures of an instant as the queue wants them, and queues them.
fn publish(queue: &dyn PictureQueue, taken: &[TakenPicture], scale: LengthScale) {
    taken.par_iter().for_each(|taken| {
        let Projection::Pinhole { intrinsics: k, .. } = taken.view.projection else { return };
        match encode(&taken.pictures, queue.form(), scale) {
            Ok((form, bytes)) => queue.send(OnboardPicture {
                camera: taken.camera,
                stamp_s: taken.stamp_s,
                form,
                bytes,
                extent: taken.view.extent,
                pinhole: [k.fx, k.fy, k.cx, k.cy],
                position: taken.view.extrinsics.position / scale.factor(),
                orientation: taken.view.extrinsics.orientation,
            }),
            Err(error) => tracing::warn!("an onboard picture is dropped: {error}"),
        }
    });
}

/// Colour in the form that is asked for; depth in laboratory metres, and classes, as pixels.
fn encode(
    pictures: &Pictures,
    form: PictureForm,
    scale: LengthScale,
) -> Result<(PictureForm, Vec<u8>), String> {
    if let Some(depth) = &pictures.depth {
        let metres = depth.values.iter().map(|depth_m| depth_m / scale.factor() as f32);
        return Ok((PictureForm::Depth, metres.flat_map(f32::to_le_bytes).collect()));
    }
    if let Some(classes) = &pictures.semantic {
        return Ok((PictureForm::Classes, classes.values.clone()));
    }
    let image = pictures.rgb.as_ref().ok_or("a picture of another kind is not published")?;
    let bytes = match form {
        PictureForm::Png => encode_png(image).map_err(|error| error.to_string()),
        PictureForm::Jpeg => jpeg(image, JPEG_QUALITY).map_err(|error| error.to_string()),
        PictureForm::Rgb8 => Ok(image.rgb.clone()),
        PictureForm::Depth | PictureForm::Classes => Err("colour is no depth and no class".to_owned()),
    }?;
    Ok((form, bytes))
}
