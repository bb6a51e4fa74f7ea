//! Publishes and subscribes poses over ROS as VICON's bridge (`vicon_bridge`) does: `TransformStamped` and `/tf`.

use super::exchange::{
    AheadLog, ExchangeCounters, OnboardCamera, PictureQueue, PoseExchange, PoseQueue, ReceivedPose, Subject,
    measured,
};
use super::onboard::{PictureSender, PictureTopics, pictures};
use crate::ros::{BridgeOptions, run_bridge};
use crate::ros::{
    ClockMessage, Header, NodeOptions, NodeThread, Quaternion, RosError, TfMessage, Time, Topics, Transform,
    TransformStamped, Vector3, run,
};
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::{Measurement, VICON_WORLD, vicon_frame};
use glam::{DQuat, DVec3};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::broadcast::{self, Receiver};

/// Bounded queue to the thread of ROS: instants that wait; the oldest are dropped (load shedding).
const FRAME_CAPACITY: usize = 64;
pub(super) const TF: &str = "/tf";
const CLOCK: &str = "/clock";

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
    invalid: AtomicU64,
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
    ahead: AheadLog,
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
            ahead: AheadLog::default(),
        })
    }
}

impl PoseExchange for Vicon {
    fn publish(&mut self, stamp_s: f64, subjects: &Arc<Vec<Subject>>, poses: Vec<Measurement>) {
        let stamp = Time::from_seconds(stamp_s);
        self.seq = self.seq.wrapping_add(1);
        let is_later = self.stamp.replace(stamp) != Some(stamp);
        let frame = PoseFrame { seq: self.seq, stamp, is_later, subjects: Arc::clone(subjects), poses };
        if self.frames.as_ref().is_none_or(|frames| frames.send(frame).is_err()) {
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn receive(&self, wait: Duration) -> Option<ReceivedPose> {
        self.queue.pop(wait)
    }

    fn drop_ahead(&mut self, vehicle: VehicleId, ahead_s: f64) {
        self.ahead.note(vehicle, ahead_s);
    }

    fn counters(&self) -> ExchangeCounters {
        let (counts, status) = (&self.counts, &self.thread.status);
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let (received, overwritten) = self.queue.counters();
        ExchangeCounters {
            published: of(&counts.published),
            dropped: of(&counts.dropped),
            slow: of(&status.slow),
            subscribers: of(&status.subscribers),
            is_registered: status.is_registered.load(Ordering::Relaxed),
            returns: of(&status.returns),
            received,
            overwritten,
            invalid: of(&counts.invalid),
            ahead: self.ahead.count(),
        }
    }

    fn pictures(&self) -> Arc<dyn PictureQueue> {
        Arc::new(self.pictures.clone())
    }
}

impl Drop for Vicon {
    fn drop(&mut self) {
        self.frames = None;
        self.thread.join();
    }
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
        queue.push(received);
    });
}

/// The pose of a message; `None` where it is none on the floor.
fn received_pose(vehicle: VehicleId, message: &TransformStamped) -> Option<ReceivedPose> {
    let Transform { translation: p, rotation: q } = message.transform;
    let (position, orientation) = (DVec3::new(p.x, p.y, p.z), DQuat::from_xyzw(q.x, q.y, q.z, q.w));
    let pose = measured(vehicle, message.header.stamp.seconds(), position, orientation)?;
    Some(ReceivedPose { seq: message.header.seq, pose })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

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
}
