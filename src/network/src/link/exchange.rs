//! What exchanges of poses have in common, whichever middleware carries them: subjects, received poses, pictures, counters.

use city3d_geometry::Lab;
use city3d_protocol::snapshot::{Trajectory, VehicleId};
use city3d_protocol::wire::{MAX_COORDINATE_M, Measurement, UNIT_NORM};
use glam::{DQuat, DVec3};
use std::collections::VecDeque;
use std::fmt::Debug;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Bounded queue of received poses; the oldest are dropped (load shedding).
const POSE_CAPACITY: usize = 4096;
/// Dropped poses are logged no more often than this.
const LOG_INTERVAL: Duration = Duration::from_secs(5);

/// Stamps below are simulated seconds, those above seconds since the epoch.
pub const EPOCH_S: f64 = 1e8;

/// Seconds since the epoch.
pub fn wall_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// Subject of VICON: a tracked vehicle by its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subject {
    /// Number of the vehicle in the city.
    pub vehicle: VehicleId,
    /// Name of the vehicle, of which the frame and the topic are made.
    pub name: String,
}

/// A pose received over topics. Its stamp is as it was sent: seconds since the epoch, or of simulated time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceivedPose {
    /// Sequence number in the header; 0 where the message has none, as in ROS 2.
    pub seq: u32,
    /// Pose of the vehicle, laboratory metres.
    pub pose: Measurement,
}

/// A measurement from what a message says; `None` unless it is finite, within the laboratory and has a unit quaternion.
pub fn measured(
    vehicle: VehicleId,
    stamp_s: f64,
    position: DVec3,
    orientation: DQuat,
) -> Option<Measurement> {
    // NaN fails the second and third comparison.
    let is_valid = position.abs().max_element() <= MAX_COORDINATE_M
        && !position.is_nan()
        && UNIT_NORM.contains(&orientation.length());
    let orientation = orientation / orientation.length();
    is_valid.then_some(Measurement { vehicle, stamp_s, position, orientation })
}

/// Counters of an exchange of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExchangeCounters {
    /// Instants that were published.
    pub published: u64,
    /// Instants that were dropped because the middleware fell behind.
    pub dropped: u64,
    /// Messages that were dropped because their subscriber was too slow.
    pub slow: u64,
    /// Subscribers that are connected now; 0 over rosbridge, which does not report them.
    pub subscribers: u64,
    /// Whether the topics are registered now.
    pub is_registered: bool,
    /// How often the connection was lost and restored.
    pub returns: u64,
    /// Received poses of vehicles on the floor.
    pub received: u64,
    /// Of them, those that the full queue has dropped.
    pub overwritten: u64,
    /// Messages that hold no pose on the floor: a number is not finite, far away, or the quaternion is no rotation.
    pub invalid: u64,
    /// Received poses with stamps later than now.
    pub ahead: u64,
}

/// Publishes and receives poses by topics. No call waits for a peer; queues are bounded, and what they drop is counted.
pub trait PoseExchange: Debug + Send {
    /// Queues the poses of an instant without blocking. Subjects without a pose are not visible then. The stamp counts
    /// from the epoch or, for simulated time, from its start.
    fn publish(&mut self, stamp_s: f64, subjects: &Arc<Vec<Subject>>, poses: Vec<Measurement>);

    /// Takes the next received pose, and waits for it at most this long.
    fn receive(&self, wait: Duration) -> Option<ReceivedPose>;

    /// Counts a received pose that its receiver drops, because its stamp is this much later than now.
    fn drop_ahead(&mut self, vehicle: VehicleId, ahead_s: f64);

    /// The counters since the start, and the present state of the connection.
    fn counters(&self) -> ExchangeCounters;

    /// The queue for pictures of its cameras.
    fn pictures(&self) -> Arc<dyn PictureQueue>;
}

/// A trajectory received over topics.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceivedTrajectory {
    /// Seconds since the epoch, or of simulated time: from here the times of the points count.
    pub stamp_s: f64,
    /// Laboratory metres; its sequence number is to be given.
    pub trajectory: Trajectory<Lab>,
}

/// Receives trajectories by topics. No call waits; the queue is bounded, and what it drops is counted.
pub trait TrajectoryExchange: Debug + Send {
    /// Takes the next trajectory.
    fn next(&self) -> Option<ReceivedTrajectory>;
}

/// Bounded queue of received poses.
#[derive(Debug, Default)]
pub struct PoseQueue {
    poses: Mutex<VecDeque<ReceivedPose>>,
    changed: Condvar,
    received: AtomicU64,
    overwritten: AtomicU64,
}

impl PoseQueue {
    /// Queues a pose; a full queue drops its oldest one.
    pub fn push(&self, pose: ReceivedPose) {
        self.received.fetch_add(1, Ordering::Relaxed);
        let mut poses = self.poses.lock().unwrap_or_else(PoisonError::into_inner);
        if poses.len() >= POSE_CAPACITY {
            poses.pop_front();
            self.overwritten.fetch_add(1, Ordering::Relaxed);
        }
        poses.push_back(pose);
        self.changed.notify_one();
    }

    /// Takes the next pose, and waits for it at most this long.
    pub fn pop(&self, wait: Duration) -> Option<ReceivedPose> {
        let until = Instant::now() + wait;
        let mut poses = self.poses.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if let Some(pose) = poses.pop_front() {
                return Some(pose);
            }
            let left = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero())?;
            let waited = self.changed.wait_timeout(poses, left);
            poses = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Numbers of poses that have come, and of those that were dropped.
    pub fn counters(&self) -> (u64, u64) {
        (self.received.load(Ordering::Relaxed), self.overwritten.load(Ordering::Relaxed))
    }
}

/// Counts poses with stamps later than now, and says it from time to time.
#[derive(Debug, Default)]
pub struct AheadLog {
    count: u64,
    /// When one was last logged.
    logged: Option<Instant>,
}

impl AheadLog {
    /// Counts a dropped pose.
    pub fn note(&mut self, vehicle: VehicleId, ahead_s: f64) {
        self.count += 1;
        if self.logged.is_none_or(|at| at.elapsed() >= LOG_INTERVAL) {
            self.logged = Some(Instant::now());
            tracing::warn!(
                "a pose of vehicle {vehicle} is dropped, {ahead_s:.1} s ahead of this machine's clock ({} so far): \
                 synchronise the clocks, as by NTP",
                self.count
            );
        }
    }

    /// How many there were.
    pub fn count(&self) -> u64 {
        self.count
    }
}

/// Names of an onboard camera and of its vehicle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OnboardCamera {
    /// Name of the vehicle, the first part of the topics.
    pub vehicle: String,
    /// Name of the camera, the second part of the topics.
    pub camera: String,
    /// What its pictures show.
    pub shows: CameraShows,
}

/// What the pictures of a camera show; each has topics of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CameraShows {
    /// Colour.
    #[default]
    Colour,
    /// Metres along the optical axis.
    Depth,
    /// Class number of each pixel.
    Classes,
}

impl OnboardCamera {
    /// Where its topics are.
    fn place(&self) -> String {
        let shown = match self.shows {
            CameraShows::Colour => "",
            CameraShows::Depth => "/depth",
            CameraShows::Classes => "/classes",
        };
        format!("/{}/{}{shown}", self.vehicle, self.camera)
    }

    /// Topic of its pictures as files.
    pub fn image_topic(&self) -> String {
        format!("{}/image/compressed", self.place())
    }

    /// Topic of its pictures as pixels.
    pub fn raw_topic(&self) -> String {
        format!("{}/image", self.place())
    }

    /// Topic of its intrinsics.
    pub fn info_topic(&self) -> String {
        format!("{}/camera_info", self.place())
    }

    /// Camera axes: x right, y down, z forward.
    pub fn frame(&self) -> String {
        format!("{}/{}", self.vehicle, self.camera)
    }
}

/// How the bytes of a picture are to be understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureForm {
    /// A PNG file.
    Png,
    /// A JPEG file.
    Jpeg,
    /// Rows of pixels of 8 bits: red, green, blue.
    Rgb8,
    /// Rows of 32-bit floats, little-endian: laboratory metres along the optical axis, infinite for the sky.
    Depth,
    /// Rows of class numbers of 8 bits.
    Classes,
}

/// A picture with the intrinsics and extrinsics of its camera.
#[derive(Clone, Debug)]
pub struct OnboardPicture {
    /// Index of the camera.
    pub camera: usize,
    /// When it was taken: seconds since the epoch, or of simulated time.
    pub stamp_s: f64,
    /// What the bytes are.
    pub form: PictureForm,
    /// The picture itself.
    pub bytes: Vec<u8>,
    /// Width and height, pixels.
    pub extent: [u32; 2],
    /// Focal lengths and principal point, pixels.
    pub pinhole: [f64; 4],
    /// Laboratory metres.
    pub position: DVec3,
    /// World from camera.
    pub orientation: DQuat,
}

/// Bounded queue of pictures to the thread that publishes them.
pub trait PictureQueue: Debug + Send + Sync {
    /// Queues a picture without blocking; a full queue drops the oldest one, and once its thread has ended the picture itself.
    fn send(&self, picture: OnboardPicture);

    /// Flags of the cameras whose pictures have subscribers.
    fn wanted(&self) -> Arc<[AtomicBool]>;

    /// Numbers of published and of dropped pictures.
    fn counters(&self) -> (u64, u64);

    /// What the bytes of its pictures have to be.
    fn form(&self) -> PictureForm;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_poses_on_the_floor_are_received() {
        let hear = |x: f64, w: f64| {
            let orientation = DQuat::from_xyzw(0.0, 0.0, 0.0, w);
            measured(VehicleId(3), 0.0, DVec3::new(x, 2.0, 0.0), orientation).map(|pose| pose.position)
        };
        assert_eq!(hear(1.0, 1.0), Some(DVec3::new(1.0, 2.0, 0.0)));
        for (x, w) in [(f64::NAN, 1.0), (1e6, 1.0), (1.0, 0.0), (1.0, f64::NAN), (f64::INFINITY, 1.0)] {
            assert_eq!(hear(x, w), None, "{x} {w}");
        }
    }

    #[test]
    fn a_full_queue_drops_its_oldest_pose() {
        let queue = PoseQueue::default();
        let pose = measured(VehicleId(3), 0.0, DVec3::ZERO, DQuat::IDENTITY).unwrap();
        (0..=POSE_CAPACITY as u32).for_each(|seq| queue.push(ReceivedPose { seq, pose }));
        assert_eq!(queue.pop(Duration::ZERO).map(|received| received.seq), Some(1));
        assert_eq!(queue.counters(), (POSE_CAPACITY as u64 + 1, 1));
    }
}
