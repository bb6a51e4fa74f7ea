//! Poses over ROS 1 as VICON's bridge publishes them, and those that others publish so.

use super::onboard::{OnboardCamera, PictureSender, PictureTopics, pictures};
#[cfg(feature = "rosbridge")]
use crate::ros::{BridgeOptions, run_bridge};
use crate::ros::{
    Clock, Header, NodeOptions, NodeThread, Quaternion, RosError, TfMessage, Time, Topics, Transform,
    TransformStamped, Vector3, run,
};
use crate::snapshot::VehicleId;
use crate::wire::{LARGEST_M, Measurement, VICON_WORLD, vicon_frame};
use glam::{DQuat, DVec3};
use std::collections::{BTreeSet, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::broadcast::{self, Receiver};

/// Instants that may wait for the thread of ROS; when there are more, the oldest are dropped.
const QUEUE: usize = 64;
/// Poses of others that may wait for this process; when there are more, the oldest are dropped.
const INBOX: usize = 4096;
/// A rotation is one as long as its quaternion is about so long.
const UNIT: std::ops::RangeInclusive<f64> = 0.9..=1.1;
pub(super) const TF: &str = "/tf";
const CLOCK: &str = "/clock";

/// What VICON tracks: a vehicle, by its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subject {
    pub vehicle: VehicleId,
    pub name: String,
}

/// What carries the topics.
#[derive(Clone, Debug)]
pub enum Carrier {
    /// A node of ROS 1.
    Node(NodeOptions),
    #[cfg(feature = "rosbridge")]
    /// A client of rosbridge.
    Bridge(BridgeOptions),
}

/// How poses are published and heard.
#[derive(Clone, Debug)]
pub struct ViconOptions {
    pub carrier: Carrier,
    /// Simulated time on `/clock` and in the stamps, instead of the clock on the wall.
    pub has_clock: bool,
    /// Whose poses are listened to.
    pub heard: Vec<Subject>,
    /// Whose pictures are published.
    pub cameras: Vec<OnboardCamera>,
}

/// A pose that somebody has published. Its stamp is as it was sent: seconds since the epoch, or simulated ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeardPose {
    pub seq: u32,
    pub pose: Measurement,
}

/// The poses of an instant.
#[derive(Clone, Debug)]
struct Frame {
    /// One up for each instant, so that those that were dropped leave a gap.
    seq: u32,
    stamp: Time,
    /// Whether its stamp is another one than that of the instant before: tf wants no stamp twice.
    is_later: bool,
    /// In the order of their numbers.
    subjects: Arc<Vec<Subject>>,
    /// Of those that are seen; laboratory metres.
    poses: Vec<Measurement>,
}

#[derive(Debug, Default)]
struct Counts {
    published: AtomicU64,
    dropped: AtomicU64,
    heard: AtomicU64,
    unheard: AtomicU64,
}

/// What became of poses over ROS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViconFigures {
    /// Instants that were published.
    pub published: u64,
    /// Instants that were not: ROS fell behind.
    pub dropped: u64,
    /// Messages that went because their subscriber was too slow.
    pub slow: u64,
    pub subscribers: u64,
    /// Whether the master knows the topics now, and how often it was away and came again.
    pub is_registered: bool,
    pub returns: u64,
    /// Poses of others that have come, and of them those that nobody has fetched in time.
    pub heard: u64,
    pub unheard: u64,
}

/// Poses that have come and wait to be fetched.
#[derive(Debug, Default)]
struct Inbox {
    poses: Mutex<VecDeque<HeardPose>>,
    has_news: Condvar,
}

/// A node that publishes poses from a thread of its own, and listens to others. Dropped, it takes its topics back.
#[derive(Debug)]
pub struct Vicon {
    frames: Option<broadcast::Sender<Frame>>,
    inbox: Arc<Inbox>,
    counts: Arc<Counts>,
    pictures: PictureSender,
    seq: u32,
    stamp: Option<Time>,
    thread: NodeThread,
}

impl Vicon {
    /// Begins to look for the master; it need not be there yet.
    ///
    /// # Errors
    /// When the node cannot be started.
    pub fn start(options: ViconOptions) -> Result<Self, RosError> {
        let ViconOptions { carrier, has_clock, heard, cameras } = options;
        let (frames, coming) = broadcast::channel(QUEUE);
        let (counts, inbox) = (Arc::new(Counts::default()), Arc::new(Inbox::default()));
        let (pictures, topics) = pictures(cameras);
        let work = Work {
            heard,
            has_clock,
            frames: coming,
            pictures: topics,
            inbox: Arc::clone(&inbox),
            counts: Arc::clone(&counts),
        };
        let thread = match carrier {
            Carrier::Node(options) => run(options, move |node| work.live(node))?,
            #[cfg(feature = "rosbridge")]
            Carrier::Bridge(options) => run_bridge(options, move |bridge| work.live(bridge))?,
        };
        Ok(Self { frames: Some(frames), inbox, counts, pictures, seq: 0, stamp: None, thread })
    }

    /// Hands over the poses of an instant, and never waits. Subjects without a pose are not seen then. The stamp
    /// counts from the epoch or, where time is simulated, from its start.
    pub fn publish(&mut self, stamp_s: f64, subjects: &Arc<Vec<Subject>>, poses: Vec<Measurement>) {
        let stamp = Time::of_seconds(stamp_s);
        self.seq = self.seq.wrapping_add(1);
        let is_later = self.stamp.replace(stamp) != Some(stamp);
        let frame = Frame { seq: self.seq, stamp, is_later, subjects: Arc::clone(subjects), poses };
        if self.frames.as_ref().is_none_or(|frames| frames.send(frame).is_err()) {
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Where pictures of the cameras are handed over.
    pub fn pictures(&self) -> PictureSender {
        self.pictures.clone()
    }

    /// The next pose of somebody else, waiting no longer than this.
    pub fn receive(&self, wait: Duration) -> Option<HeardPose> {
        let until = Instant::now() + wait;
        let mut poses = self.inbox.poses.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if let Some(pose) = poses.pop_front() {
                return Some(pose);
            }
            let left = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero())?;
            let waited = self.inbox.has_news.wait_timeout(poses, left);
            poses = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    pub fn figures(&self) -> ViconFigures {
        let (counts, status) = (&self.counts, &self.thread.status);
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        ViconFigures {
            published: of(&counts.published),
            dropped: of(&counts.dropped),
            slow: of(&status.slow),
            subscribers: of(&status.subscribers),
            is_registered: status.is_registered.load(Ordering::Relaxed),
            returns: of(&status.returns),
            heard: of(&counts.heard),
            unheard: of(&counts.unheard),
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

/// What is done on the thread that has the topics.
struct Work {
    heard: Vec<Subject>,
    has_clock: bool,
    frames: Receiver<Frame>,
    pictures: PictureTopics,
    inbox: Arc<Inbox>,
    counts: Arc<Counts>,
}

impl Work {
    /// Listens, and publishes instants until no more can come.
    async fn live(mut self, topics: impl Topics) {
        for subject in std::mem::take(&mut self.heard) {
            hear(&topics, subject, &self.inbox, &self.counts);
        }
        if self.has_clock {
            topics.advertise::<Clock>(CLOCK);
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
                        change(&topics, &subjects, &frame.subjects);
                        subjects = Arc::clone(&frame.subjects);
                    }
                    publish_frame(&topics, &frame, self.has_clock);
                    self.pictures.look(&topics);
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

/// Offers the topics of those who have come, and takes back those of who is gone.
fn change(topics: &impl Topics, before: &[Subject], after: &[Subject]) {
    let names = |subjects: &[Subject]| subjects.iter().map(|subject| subject.name.clone()).collect();
    let (before, after): (BTreeSet<String>, BTreeSet<String>) = (names(before), names(after));
    before.difference(&after).for_each(|name| topics.retract(&topic(name)));
    after.difference(&before).for_each(|name| topics.advertise::<TransformStamped>(&topic(name)));
    if !after.is_empty() {
        topics.advertise::<TfMessage>(TF);
    }
}

fn publish_frame(topics: &impl Topics, frame: &Frame, has_clock: bool) {
    if has_clock {
        topics.publish(CLOCK, || Clock { clock: frame.stamp });
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

fn transform(name: &str, pose: &Measurement, frame: &Frame) -> TransformStamped {
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

/// Listens to the poses of a subject.
fn hear(topics: &impl Topics, subject: Subject, inbox: &Arc<Inbox>, counts: &Arc<Counts>) {
    let (inbox, counts) = (Arc::clone(inbox), Arc::clone(counts));
    topics.subscribe(&topic(&subject.name), move |message: TransformStamped| {
        let Some(heard) = heard_pose(subject.vehicle, &message) else {
            return tracing::debug!("{}: a pose that is none is dropped", subject.name);
        };
        counts.heard.fetch_add(1, Ordering::Relaxed);
        let mut poses = inbox.poses.lock().unwrap_or_else(PoisonError::into_inner);
        if poses.len() >= INBOX {
            poses.pop_front();
            counts.unheard.fetch_add(1, Ordering::Relaxed);
        }
        poses.push_back(heard);
        inbox.has_news.notify_one();
    });
}

/// `None` for numbers that are no pose on a laboratory's floor.
fn heard_pose(vehicle: VehicleId, message: &TransformStamped) -> Option<HeardPose> {
    let Transform { translation: p, rotation: q } = message.transform;
    let position = DVec3::new(p.x, p.y, p.z);
    let orientation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
    // Numbers that are none fail both.
    let is_one = position.abs().max_element() <= LARGEST_M
        && !position.is_nan()
        && UNIT.contains(&orientation.length());
    let stamp_s = message.header.stamp.seconds();
    let pose = Measurement { vehicle, stamp_s, position, orientation: orientation / orientation.length() };
    is_one.then_some(HeardPose { seq: message.header.seq, pose })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(has_clock: bool) -> ViconOptions {
        // Nobody listens on the discard port of this machine.
        let master = "http://127.0.0.1:9".parse().unwrap();
        let node = NodeOptions { name: "/test".to_owned(), master, bind: Some("127.0.0.1".parse().unwrap()) };
        ViconOptions { carrier: Carrier::Node(node), has_clock, heard: Vec::new(), cameras: Vec::new() }
    }

    #[test]
    fn without_a_master_nothing_waits_and_all_is_counted() {
        let mut vicon = Vicon::start(options(true)).unwrap();
        let begun = Instant::now();
        for _ in 0..10 * QUEUE {
            vicon.publish(0.0, &Arc::default(), Vec::new());
        }
        let until = begun + Duration::from_secs(20);
        while vicon.figures().published + vicon.figures().dropped < 10 * QUEUE as u64 {
            assert!(Instant::now() < until, "{:?}", vicon.figures());
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(!vicon.figures().is_registered);
    }

    #[test]
    fn only_poses_on_the_floor_are_heard() {
        let rotation = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
        let good = TransformStamped {
            transform: Transform { translation: Vector3 { x: 1.0, y: 2.0, z: 0.0 }, rotation },
            ..TransformStamped::default()
        };
        let hear =
            |message: &TransformStamped| heard_pose(VehicleId(3), message).map(|heard| heard.pose.position);
        assert_eq!(hear(&good), Some(DVec3::new(1.0, 2.0, 0.0)));
        for (x, w) in [(f64::NAN, 1.0), (1e6, 1.0), (1.0, 0.0), (1.0, f64::NAN), (f64::INFINITY, 1.0)] {
            let mut bad = good.clone();
            (bad.transform.translation.x, bad.transform.rotation.w) = (x, w);
            assert_eq!(hear(&bad), None, "{x} {w}");
        }
    }
}
