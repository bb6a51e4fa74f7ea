//! Camera pictures as JPEG with their calibration, drawn while somebody looks.

use crate::channel::{Channel, camera_channels};
use crate::hub::Hub;
use crate::publisher::encoded;
use crate::scene::{stamp, transform};
use city3d_logbook::record::message::nanoseconds;
use city3d_sensors::{Projection, View};
use city3d_session::pictures::{
    CarriedCamera, OpenRenderer, PictureError, PictureStamps, PictureThread, TakenPicture, jpeg,
};
use foxglove::messages::{CameraCalibration, CompressedImage, FrameTransforms};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const JPEG_QUALITY: u8 = 80;

/// A camera on a vehicle, with its name in topics.
#[derive(Clone, Debug)]
pub struct NamedCamera {
    /// `VEHICLE/CAMERA`; also the frame of its pictures: x right, y down, z forward.
    pub name: String,
    /// The camera.
    pub camera: CarriedCamera,
}

/// What is published of a camera.
#[derive(Debug)]
struct PublishedCamera {
    frame: String,
    image: Arc<Channel>,
    calibration: Arc<Channel>,
}

/// Cameras that draw while somebody has subscribed to their pictures.
#[derive(Debug)]
pub(crate) struct Cameras {
    published: Arc<[PublishedCamera]>,
    wanted: Arc<[AtomicBool]>,
    pub thread: PictureThread,
}

impl Cameras {
    /// Offers the channels of cameras. The renderer is opened when the first picture is wanted.
    pub(crate) fn start(
        hub: &Arc<Hub>,
        cameras: Vec<NamedCamera>,
        open: OpenRenderer,
    ) -> Result<Self, PictureError> {
        let mut published = Vec::new();
        for NamedCamera { name, .. } in &cameras {
            let [image, calibration] = camera_channels([hub.next_id(), hub.next_id()], name);
            hub.offer(&[Arc::clone(&image), Arc::clone(&calibration)]);
            published.push(PublishedCamera { frame: name.clone(), image, calibration });
        }
        let published = Arc::<[PublishedCamera]>::from(published);
        let wanted: Arc<[AtomicBool]> = cameras.iter().map(|_| AtomicBool::new(false)).collect();
        let (of_thread, to) = (Arc::clone(&published), Arc::clone(hub));
        let take = move |taken: Vec<TakenPicture>| {
            taken.par_iter().for_each(|taken| publish(&to, &of_thread[taken.camera], taken));
        };
        let carried = cameras.into_iter().map(|camera| camera.camera).collect();
        let thread = PictureThread::start_when_wanted(
            open,
            (carried, PictureStamps::Simulated),
            Arc::clone(&wanted),
            take,
        )?;
        Ok(Self { published, wanted, thread })
    }

    /// Looks who is looked at.
    pub(crate) fn look(&self) {
        for (camera, wanted) in self.published.iter().zip(self.wanted.iter()) {
            wanted.store(camera.image.is_wanted() || camera.calibration.is_wanted(), Ordering::Relaxed);
        }
    }
}

/// Publishes a picture behind its calibration and the place of its camera.
fn publish(hub: &Hub, camera: &PublishedCamera, taken: &TakenPicture) {
    let time_ns = nanoseconds(taken.stamp_s);
    if hub.city.transforms.is_wanted() {
        let place = &taken.view.extrinsics;
        let transform = transform(&camera.frame, place.position, place.orientation, time_ns);
        let message = FrameTransforms { transforms: vec![transform] };
        hub.hand_over(&hub.city.transforms, time_ns, encoded(&message));
    }
    if let Some(calibration) = calibration(&taken.view, &camera.frame, time_ns) {
        hub.hand_over(&camera.calibration, time_ns, encoded(&calibration));
    }
    if !camera.image.is_wanted() {
        return;
    }
    let Some(image) = &taken.pictures.rgb else { return };
    match jpeg(image, JPEG_QUALITY) {
        Ok(data) => {
            let message = CompressedImage {
                timestamp: stamp(time_ns),
                frame_id: camera.frame.clone(),
                data: data.into(),
                format: "jpeg".to_owned(),
            };
            hub.hand_over(&camera.image, time_ns, encoded(&message));
        }
        Err(error) => tracing::warn!("a picture is dropped: {error}"),
    }
}

/// A pinhole without distortion, as it is drawn; `None` for other projections.
fn calibration(view: &View, frame: &str, time_ns: u64) -> Option<CameraCalibration> {
    let Projection::Pinhole { intrinsics: k, .. } = view.projection else { return None };
    let [width, height] = view.extent;
    Some(CameraCalibration {
        timestamp: stamp(time_ns),
        frame_id: frame.to_owned(),
        width,
        height,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: vec![k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    })
}
