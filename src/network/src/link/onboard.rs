//! Publishes onboard pictures over ROS: `CompressedImage`, `CameraInfo` and `/tf` for each camera.

use super::exchange::{OnboardCamera, OnboardPicture, PictureForm, PictureQueue};
use crate::ros::{
    CameraInfo, CompressedImage, Header, Quaternion, TfMessage, Time, Topics, Transform, TransformStamped,
    Vector3,
};
use city3d_protocol::wire::VICON_WORLD;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use tokio::sync::broadcast;

/// Bounded queue to the thread of ROS: pictures that wait; the oldest are dropped (load shedding).
const CAPACITY: usize = 32;

#[derive(Debug, Default)]
pub(super) struct PictureCounters {
    published: AtomicU64,
    dropped: AtomicU64,
}

/// Sending end of the queue of pictures; it never blocks.
#[derive(Clone, Debug)]
pub struct PictureSender {
    pictures: broadcast::Sender<Arc<OnboardPicture>>,
    counts: Arc<PictureCounters>,
    wanted: Arc<[AtomicBool]>,
}

impl PictureQueue for PictureSender {
    fn send(&self, picture: OnboardPicture) {
        if self.pictures.send(Arc::new(picture)).is_err() {
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn wanted(&self) -> Arc<[AtomicBool]> {
        Arc::clone(&self.wanted)
    }

    fn counters(&self) -> (u64, u64) {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        (of(&self.counts.published), of(&self.counts.dropped))
    }

    fn form(&self) -> PictureForm {
        PictureForm::Png
    }
}

/// Receiving end of the queue, on the thread of ROS.
#[derive(Debug)]
pub(super) struct PictureTopics {
    cameras: Vec<OnboardCamera>,
    /// Sequence number of the last picture, by camera.
    seq: Vec<u32>,
    pictures: broadcast::Receiver<Arc<OnboardPicture>>,
    counts: Arc<PictureCounters>,
    wanted: Arc<[AtomicBool]>,
}

/// Creates both ends of the queue.
pub(super) fn pictures(cameras: Vec<OnboardCamera>) -> (PictureSender, PictureTopics) {
    let (sender, pictures) = broadcast::channel(CAPACITY);
    let counts = Arc::new(PictureCounters::default());
    let wanted: Arc<[AtomicBool]> = cameras.iter().map(|_| AtomicBool::new(false)).collect();
    let seq = vec![0; cameras.len()];
    let topics =
        PictureTopics { cameras, seq, pictures, counts: Arc::clone(&counts), wanted: Arc::clone(&wanted) };
    (PictureSender { pictures: sender, counts, wanted }, topics)
}

impl PictureTopics {
    pub(super) fn advertise(&self, topics: &impl Topics) {
        for camera in &self.cameras {
            topics.advertise::<CompressedImage>(&camera.image_topic());
            topics.advertise::<CameraInfo>(&camera.info_topic());
        }
    }

    /// Updates the flags of the cameras that have subscribers.
    pub(super) fn update_wanted(&self, topics: &impl Topics) {
        for (camera, wanted) in self.cameras.iter().zip(&*self.wanted) {
            let is_wanted =
                topics.has_subscribers(&camera.image_topic()) || topics.has_subscribers(&camera.info_topic());
            wanted.store(is_wanted, Ordering::Relaxed);
        }
    }

    /// The next picture; never returns once all senders are gone.
    pub(super) async fn next(&mut self) -> Arc<OnboardPicture> {
        loop {
            match self.pictures.recv().await {
                Ok(picture) => return picture,
                Err(broadcast::error::RecvError::Lagged(pictures)) => {
                    self.counts.dropped.fetch_add(pictures, Ordering::Relaxed);
                }
                Err(broadcast::error::RecvError::Closed) => std::future::pending().await,
            }
        }
    }

    pub(super) fn publish(&mut self, topics: &impl Topics, picture: &OnboardPicture) {
        let (Some(camera), Some(seq)) = (self.cameras.get(picture.camera), self.seq.get_mut(picture.camera))
        else {
            return;
        };
        *seq = seq.wrapping_add(1);
        let (seq, stamp) = (*seq, Time::from_seconds(picture.stamp_s));
        let header = || Header { seq, stamp, frame_id: camera.frame() };
        topics.publish(&camera.image_topic(), || CompressedImage {
            header: header(),
            format: "png".to_owned(),
            data: picture.bytes.clone(),
        });
        let info = || CameraInfo::pinhole(header(), picture.extent, picture.pinhole);
        topics.publish(&camera.info_topic(), info);
        let (p, q) = (picture.position, picture.orientation);
        let transform = || TransformStamped {
            header: Header { seq, stamp, frame_id: VICON_WORLD.to_owned() },
            child_frame_id: camera.frame(),
            transform: Transform {
                translation: Vector3 { x: p.x, y: p.y, z: p.z },
                rotation: Quaternion { x: q.x, y: q.y, z: q.z, w: q.w },
            },
        };
        topics.publish(super::vicon::TF, || TfMessage { transforms: vec![transform()] });
        self.counts.published.fetch_add(1, Ordering::Relaxed);
    }
}
