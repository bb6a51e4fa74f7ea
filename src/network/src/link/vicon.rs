//! Publishes and subscribes poses over ROS as VICON's bridge (`vicon_bridge`) does: `TransformStamped` and `/tf`.

use super::onboard::{OnboardCamera, PictureSender, PictureTopics, pictures};
use crate::ros::{BridgeOptions, run_bridge};
use crate::ros::{
    ClockMessage, Header, NodeOptions, NodeThread, Quaternion, RosError, TfMessage, Time, Topics, Transform,
    TransformStamped, Vector3, run,
};
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::{MAX_COORDINATE_M, Measurement, UNIT_NORM, VICON_WORLD, vicon_frame};
use glam::{DQuat, DVec3};
use std::collections::{BTreeSet, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::broadcast::{self, Receiver};

/// Bounded queue to the thread of ROS: instants that wait; the oldest are dropped (load shedding).
const FRAME_CAPACITY: usize = 64;
/// Bounded queue of received poses; the oldest are dropped (load shedding).
const POSE_CAPACITY: usize = 4096;
/// Dropped poses are logged no more often than this.
const LOG_INTERVAL: Duration = Duration::from_secs(5);
pub(super) const TF: &str = "/tf";
const CLOCK: &str = "/clock";

/// Subject of VICON: a tracked vehicle by its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subject {
    /// Number of the vehicle in the city.
    pub vehicle: VehicleId,
    /// Name of the vehicle, of which the frame and the topic are made.
    pub name: String,
}

/// How topics are transported: as a ROS 1 node, or through rosbridge.
#[derive(Clone, Debug)]
pub enum RosTransport {
    /// A ROS 1 node.
    Node(NodeOptions),
    /// A rosbridge client.
    Bridge(BridgeOptions),
}

/// Settings of a [`Vicon`].
#[derive(Clone, Debug)]
pub struct ViconOptions {
    /// ROS 1 node or rosbridge client, with its settings.
    pub transport: RosTransport,
    /// Publish simulated time on `/clock` and in the stamps, instead of wall-clock time.
    pub has_clock: bool,
    /// Subjects whose poses are subscribed.
    pub subscribed: Vec<Subject>,
    /// Cameras whose pictures are published.
    pub cameras: Vec<OnboardCamera>,
}

/// A pose received over ROS. Its stamp is as it was sent: seconds since the epoch, or of simulated time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceivedPose {
    /// Sequence number in the header; 0 where the message has none, as in ROS 2.
    pub seq: u32,
    /// Pose of the vehicle, laboratory metres.
    pub pose: Measurement,
}

/// Poses of all subjects at one instant.
#[derive(Clone, Debug)]
struct PoseFrame {
    /// Counts the instants, so that dropped ones leave a gap.
    seq: u32,
    stamp: Time,
    /// Whether its stamp differs from the one before: tf rejects repeated stamps.
    is_later: bool,
    /// In id order.
    subjects: Arc<Vec<Subject>>,
    /// Poses of the visible subjects, laboratory metres.
    poses: Vec<Measurement>,
}

#[derive(Debug, Default)]
struct PoseCounters {
    published: AtomicU64,
    dropped: AtomicU64,
    received: AtomicU64,
    overwritten: AtomicU64,
    invalid: AtomicU64,
    ahead: AtomicU64,
}

/// Counters of the poses over ROS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViconCounters {
    /// Instants that were published.
    pub published: u64,
    /// Instants that were dropped because ROS fell behind.
    pub dropped: u64,
    /// Messages that were dropped because their subscriber was too slow.
    pub slow: u64,
    /// Subscribers that are connected now; 0 over rosbridge, which does not report them.
    pub subscribers: u64,
    /// Whether the topics are registered now, and how often the connection was lost and restored.
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

/// Bounded queue of received poses.
#[derive(Debug, Default)]
struct PoseQueue {
    poses: Mutex<VecDeque<ReceivedPose>>,
    changed: Condvar,
}

/// Publisher and subscriber of poses, on a thread of its own. It unregisters its topics when it is dropped.
#[derive(Debug)]
pub struct Vicon {
    frames: Option<broadcast::Sender<PoseFrame>>,
    queue: Arc<PoseQueue>,
    counts: Arc<PoseCounters>,
    pictures: PictureSender,
    seq: u32,
    stamp: Option<Time>,
    thread: NodeThread,
    /// When a pose with a later stamp was last logged.
    ahead_logged: Option<Instant>,
}

impl Vicon {
    /// Starts the thread, which looks for the master; the master may start later.
    ///
    /// # Errors
    /// When the node cannot be started.
    pub fn start(options: ViconOptions) -> Result<Self, RosError> {
        let ViconOptions { transport, has_clock, subscribed, cameras } = options;
        let (frames, coming) = broadcast::channel(FRAME_CAPACITY);
        let (counts, queue) = (Arc::new(PoseCounters::default()), Arc::new(PoseQueue::default()));
        let (pictures, topics) = pictures(cameras);
        let work = TopicWorker {
            subscribed,
            has_clock,
            frames: coming,
            pictures: topics,
            queue: Arc::clone(&queue),
            counts: Arc::clone(&counts),
        };
        let thread = match transport {
            RosTransport::Node(options) => run(options, move |node| work.run(node))?,
            RosTransport::Bridge(options) => run_bridge(options, move |bridge| work.run(bridge))?,
        };
        Ok(Self {
            frames: Some(frames),
            queue,
            counts,
            pictures,
            seq: 0,
            stamp: None,
            thread,
            ahead_logged: None,
        })
    }

    /// Queues the poses of an instant without blocking. Subjects without a pose are not visible then. The stamp counts
    /// from the epoch or, for simulated time, from its start.
    pub fn publish(&mut self, stamp_s: f64, subjects: &Arc<Vec<Subject>>, poses: Vec<Measurement>) {
        let stamp = Time::from_seconds(stamp_s);
        self.seq = self.seq.wrapping_add(1);
        let is_later = self.stamp.replace(stamp) != Some(stamp);
        let frame = PoseFrame { seq: self.seq, stamp, is_later, subjects: Arc::clone(subjects), poses };
        if self.frames.as_ref().is_none_or(|frames| frames.send(frame).is_err()) {
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The queue for pictures of the cameras.
    pub fn pictures(&self) -> PictureSender {
        self.pictures.clone()
    }

    /// Takes the next received pose, and waits for it at most this long.
    pub fn receive(&self, wait: Duration) -> Option<ReceivedPose> {
        let until = Instant::now() + wait;
        let mut poses = self.queue.poses.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if let Some(pose) = poses.pop_front() {
                return Some(pose);
            }
            let left = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero())?;
            let waited = self.queue.changed.wait_timeout(poses, left);
            poses = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The counters since the start, and the present state of the connection.
    pub fn counters(&self) -> ViconCounters {
        let (counts, status) = (&self.counts, &self.thread.status);
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        ViconCounters {
            published: of(&counts.published),
            dropped: of(&counts.dropped),
            slow: of(&status.slow),
            subscribers: of(&status.subscribers),
            is_registered: status.is_registered.load(Ordering::Relaxed),
            returns: of(&status.returns),
            received: of(&counts.received),
            overwritten: of(&counts.overwritten),
            invalid: of(&counts.invalid),
            ahead: of(&counts.ahead),
        }
    }

    /// Counts a received pose that its receiver drops, because its stamp is this much later than now.
    pub fn drop_ahead(&mut self, vehicle: VehicleId, ahead_s: f64) {
        let count = self.counts.ahead.fetch_add(1, Ordering::Relaxed) + 1;
        if self.ahead_logged.is_none_or(|at| at.elapsed() >= LOG_INTERVAL) {
            self.ahead_logged = Some(Instant::now());
            tracing::warn!(
                "a pose of vehicle {vehicle} is dropped, {ahead_s:.1} s ahead of this machine's clock ({count} so far): \
                 synchronise the clocks, as by NTP"
            );
        }
    }
}

impl Drop for Vicon {
    fn drop(&mut self) {
        self.frames = None;
        self.thread.join();
    }
}

/// Stamps below are simulated seconds, those above seconds since the epoch.
pub const EPOCH_S: f64 = 1e8;

/// Seconds since the epoch.
pub fn wall_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

fn topic(name: &str) -> String {
    format!("/{}", vicon_frame(name))
}

/// Work of the thread that owns the topics.
struct TopicWorker {
    subscribed: Vec<Subject>,
    has_clock: bool,
    frames: Receiver<PoseFrame>,
    pictures: PictureTopics,
    queue: Arc<PoseQueue>,
    counts: Arc<PoseCounters>,
}

impl TopicWorker {
    /// Subscribes, and publishes instants until the sender is gone.
    async fn run(mut self, topics: impl Topics) {
        for subject in std::mem::take(&mut self.subscribed) {
            subscribe_poses(&topics, subject, &self.queue, &self.counts);
        }
        if self.has_clock {
            topics.advertise::<ClockMessage>(CLOCK);
        }
        self.pictures.advertise(&topics);
        let mut subjects: Arc<Vec<Subject>> = Arc::default();
        loop {
            let frame = tokio::select! {
                biased;
                frame = self.frames.recv() => frame,
                picture = self.pictures.next() => {
                    self.pictures.publish(&topics, &picture);
                    continue;
                }
            };
            match frame {
                Ok(frame) => {
                    if !Arc::ptr_eq(&subjects, &frame.subjects) {
                        update_topics(&topics, &subjects, &frame.subjects);
                        subjects = Arc::clone(&frame.subjects);
                    }
                    publish_frame(&topics, &frame, self.has_clock);
                    self.pictures.update_wanted(&topics);
                    self.counts.published.fetch_add(1, Ordering::Relaxed);
                }
                Err(RecvError::Lagged(frames)) => {
                    self.counts.dropped.fetch_add(frames, Ordering::Relaxed);
                }
                Err(RecvError::Closed) => return,
            }
        }
    }
}

/// Advertises the topics of new subjects, and unadvertises those of subjects that are gone.
fn update_topics(topics: &impl Topics, before: &[Subject], after: &[Subject]) {
    let names = |subjects: &[Subject]| subjects.iter().map(|subject| subject.name.clone()).collect();
    let (before, after): (BTreeSet<String>, BTreeSet<String>) = (names(before), names(after));
    before.difference(&after).for_each(|name| topics.unadvertise(&topic(name)));
    after.difference(&before).for_each(|name| topics.advertise::<TransformStamped>(&topic(name)));
    if !after.is_empty() {
        topics.advertise::<TfMessage>(TF);
    }
}

fn publish_frame(topics: &impl Topics, frame: &PoseFrame, has_clock: bool) {
    if has_clock {
        topics.publish(CLOCK, || ClockMessage { clock: frame.stamp });
    }
    let find = |pose: &Measurement| {
        let at = frame.subjects.binary_search_by_key(&pose.vehicle, |subject| subject.vehicle).ok()?;
        Some(&frame.subjects[at].name)
    };
    let named = || frame.poses.iter().filter_map(|pose| Some((find(pose)?, pose)));
    for (name, pose) in named() {
        topics.publish(&topic(name), || transform(name, pose, frame));
    }
    if frame.is_later && !frame.poses.is_empty() {
        let transforms = || named().map(|(name, pose)| transform(name, pose, frame)).collect();
        topics.publish(TF, || TfMessage { transforms: transforms() });
    }
}

fn transform(name: &str, pose: &Measurement, frame: &PoseFrame) -> TransformStamped {
    let (p, q) = (pose.position, pose.orientation);
    TransformStamped {
        header: Header { seq: frame.seq, stamp: frame.stamp, frame_id: VICON_WORLD.to_owned() },
        child_frame_id: vicon_frame(name),
        transform: Transform {
            translation: Vector3 { x: p.x, y: p.y, z: p.z },
            rotation: Quaternion { x: q.x, y: q.y, z: q.z, w: q.w },
        },
    }
}

/// Subscribes to the poses of a subject.
fn subscribe_poses(
    topics: &impl Topics,
    subject: Subject,
    queue: &Arc<PoseQueue>,
    counts: &Arc<PoseCounters>,
) {
    let (queue, counts) = (Arc::clone(queue), Arc::clone(counts));
    topics.subscribe(&topic(&subject.name), move |message: TransformStamped| {
        let Some(received) = received_pose(subject.vehicle, &message) else {
            counts.invalid.fetch_add(1, Ordering::Relaxed);
            return tracing::debug!("{}: an invalid pose is dropped", subject.name);
        };
        counts.received.fetch_add(1, Ordering::Relaxed);
        let mut poses = queue.poses.lock().unwrap_or_else(PoisonError::into_inner);
        if poses.len() >= POSE_CAPACITY {
            poses.pop_front();
            counts.overwritten.fetch_add(1, Ordering::Relaxed);
        }
        poses.push_back(received);
        queue.changed.notify_one();
    });
}

/// Validates a pose: `None` unless it is finite, within the laboratory and has a unit quaternion.
fn received_pose(vehicle: VehicleId, message: &TransformStamped) -> Option<ReceivedPose> {
    let Transform { translation: p, rotation: q } = message.transform;
    let position = DVec3::new(p.x, p.y, p.z);
    let orientation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
    // NaN fails the second and third comparison.
    let is_valid = position.abs().max_element() <= MAX_COORDINATE_M
        && !position.is_nan()
        && UNIT_NORM.contains(&orientation.length());
    let stamp_s = message.header.stamp.seconds();
    let pose = Measurement { vehicle, stamp_s, position, orientation: orientation / orientation.length() };
    is_valid.then_some(ReceivedPose { seq: message.header.seq, pose })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(has_clock: bool) -> ViconOptions {
        // Nobody listens on the discard port of this machine.
        let master = "http://127.0.0.1:9".parse().unwrap();
        let node = NodeOptions { name: "/test".to_owned(), master, bind: Some("127.0.0.1".parse().unwrap()) };
        ViconOptions {
            transport: RosTransport::Node(node),
            has_clock,
            subscribed: Vec::new(),
            cameras: Vec::new(),
        }
    }

    #[test]
    fn without_a_master_nothing_waits_and_all_is_counted() {
        let mut vicon = Vicon::start(options(true)).unwrap();
        let begun = Instant::now();
        for _ in 0..10 * FRAME_CAPACITY {
            vicon.publish(0.0, &Arc::default(), Vec::new());
        }
        let until = begun + Duration::from_secs(20);
        while vicon.counters().published + vicon.counters().dropped < 10 * FRAME_CAPACITY as u64 {
            assert!(Instant::now() < until, "{:?}", vicon.counters());
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(!vicon.counters().is_registered);
    }

    #[test]
    fn only_poses_on_the_floor_are_received() {
        let rotation = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
        let good = TransformStamped {
            transform: Transform { translation: Vector3 { x: 1.0, y: 2.0, z: 0.0 }, rotation },
            ..TransformStamped::default()
        };
        let hear = |message: &TransformStamped| {
            received_pose(VehicleId(3), message).map(|received| received.pose.position)
        };
        assert_eq!(hear(&good), Some(DVec3::new(1.0, 2.0, 0.0)));
        for (x, w) in [(f64::NAN, 1.0), (1e6, 1.0), (1.0, 0.0), (1.0, f64::NAN), (f64::INFINITY, 1.0)] {
            let mut bad = good.clone();
            (bad.transform.translation.x, bad.transform.rotation.w) = (x, w);
            assert_eq!(hear(&bad), None, "{x} {w}");
        }
    }
}
