//! A node of ROS 2 on a thread of its own: what it publishes goes there through bounded queues, what it receives comes back
//! through others.

use crate::Ros2Error;
use crate::dds::{Dds, DroppedByDds};
use crate::middleware::{Middleware, Received, TopicSubscriber};
use crate::options::{Ros2Middleware, Ros2Options, VehicleTopics};
use crate::publisher::{PoseFrame, Published, PublishedTopics, vehicle_topic};
use crate::trajectory::{ReceivedTrajectories, TRAJECTORY_TOPIC};
use city3d_network::link::exchange::{
    AheadLog, ExchangeCounters, OnboardPicture, PictureForm, PictureQueue, PoseExchange, PoseQueue,
    ReceivedPose, Subject, measured,
};
use city3d_protocol::cdr::CdrReader;
use city3d_protocol::ros2::{
    MULTI_DOF_TRAJECTORY, POSE_STAMPED, Stamp, TRANSFORM_STAMPED, read_pose, read_transform,
};
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::Measurement;
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Wake, Waker};
use std::thread::JoinHandle;
use std::time::Duration;

/// Instants that wait for the thread, also while it advertises many vehicles at once; the oldest are dropped (load shedding).
const FRAME_CAPACITY: usize = 1024;
/// Pictures that wait for the thread; the oldest are dropped (load shedding).
const PICTURE_CAPACITY: usize = 32;
/// Received messages of a topic that are taken before instants are published.
const MAX_TAKEN: usize = 256;

/// What waits for the thread.
#[derive(Debug, Default)]
struct Inbox {
    frames: VecDeque<PoseFrame>,
    pictures: VecDeque<OnboardPicture>,
    /// A subscription has messages.
    is_woken: bool,
    is_over: bool,
}

impl Inbox {
    fn is_empty(&self) -> bool {
        self.frames.is_empty() && self.pictures.is_empty() && !self.is_woken
    }
}

/// What the thread shares with those that use the node.
#[derive(Debug)]
struct Shared {
    inbox: Mutex<Inbox>,
    changed: Condvar,
    poses: PoseQueue,
    trajectories: ReceivedTrajectories,
    published: AtomicU64,
    dropped: AtomicU64,
    slow: AtomicU64,
    invalid: AtomicU64,
    pictures_published: AtomicU64,
    pictures_dropped: AtomicU64,
    /// Whether the pictures of each camera have subscribers.
    wanted: Arc<[AtomicBool]>,
    picture_form: PictureForm,
}

impl Shared {
    fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for work, and takes it; `None` at the end, when everything is done.
    fn wait(&self) -> Option<Inbox> {
        let mut inbox = self.inbox();
        while inbox.is_empty() {
            if inbox.is_over {
                return None;
            }
            inbox = self.changed.wait(inbox).unwrap_or_else(PoisonError::into_inner);
        }
        let is_over = inbox.is_over;
        Some(std::mem::replace(&mut *inbox, Inbox { is_over, ..Inbox::default() }))
    }
}

impl Wake for Shared {
    fn wake(self: Arc<Self>) {
        self.inbox().is_woken = true;
        self.changed.notify_one();
    }
}

/// Publishes and receives poses over ROS 2. Dropping it ends the node.
#[derive(Debug)]
pub struct Ros2Node {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    stamp: Option<Stamp>,
    ahead: AheadLog,
    dropped_by_dds: DroppedByDds,
}

impl Ros2Node {
    /// Starts a node.
    ///
    /// # Errors
    /// When it cannot be started, or not be kept to this machine.
    pub fn start(options: &Ros2Options) -> Result<Self, Ros2Error> {
        let middleware: Box<dyn Middleware> = match options.middleware {
            Ros2Middleware::Dds => Box::new(Dds::join(options)?),
            #[cfg(feature = "zenoh")]
            Ros2Middleware::Zenoh => Box::new(crate::zenoh::Zenoh::join(options)?),
        };
        Self::on(middleware, options)
    }

    fn on(mut middleware: Box<dyn Middleware>, options: &Ros2Options) -> Result<Self, Ros2Error> {
        let shared = Arc::new(Shared {
            inbox: Mutex::default(),
            changed: Condvar::new(),
            poses: PoseQueue::default(),
            trajectories: ReceivedTrajectories::default(),
            published: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
            slow: AtomicU64::new(0),
            invalid: AtomicU64::new(0),
            pictures_published: AtomicU64::new(0),
            pictures_dropped: AtomicU64::new(0),
            wanted: options.cameras.iter().map(|_| AtomicBool::new(false)).collect(),
            picture_form: options.picture_form,
        });
        let waker = Waker::from(Arc::clone(&shared));
        let topics = PublishedTopics::new(&mut *middleware, options)?;
        let subscriptions = subscribe(&mut *middleware, options, &waker)?;
        middleware.announce();
        let driven = options.driven.iter().map(|driven| (driven.name.clone(), driven.vehicle)).collect();
        let worker = Worker { shared: Arc::clone(&shared), middleware, topics, subscriptions, driven };
        let thread = std::thread::Builder::new()
            .name("ros 2".to_owned())
            .spawn(move || worker.run())
            .map_err(|error| Ros2Error::Start(error.to_string()))?;
        // Who has published already is heard without being woken.
        waker.wake();
        let (ahead, dropped_by_dds) = (AheadLog::default(), DroppedByDds::from_now());
        Ok(Self { shared, thread: Some(thread), stamp: None, ahead, dropped_by_dds })
    }

    /// The queue of received trajectories.
    pub fn trajectories(&self) -> ReceivedTrajectories {
        self.shared.trajectories.clone()
    }
}

impl PoseExchange for Ros2Node {
    fn publish(&mut self, stamp_s: f64, subjects: &Arc<Vec<Subject>>, poses: Vec<Measurement>) {
        let stamp = Stamp::from_seconds(stamp_s);
        let is_later = self.stamp.replace(stamp) != Some(stamp);
        let frame = PoseFrame { stamp, is_later, subjects: Arc::clone(subjects), poses };
        let mut inbox = self.shared.inbox();
        if inbox.frames.len() >= FRAME_CAPACITY {
            inbox.frames.pop_front();
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
        inbox.frames.push_back(frame);
        drop(inbox);
        self.shared.changed.notify_one();
    }

    fn receive(&self, wait: Duration) -> Option<ReceivedPose> {
        self.shared.poses.pop(wait)
    }

    fn drop_ahead(&mut self, vehicle: VehicleId, ahead_s: f64) {
        self.ahead.note(vehicle, ahead_s);
    }

    fn counters(&self) -> ExchangeCounters {
        let shared = &self.shared;
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let (received, overwritten) = shared.poses.counters();
        let (trajectories, _, invalid_trajectories) = shared.trajectories.counters();
        ExchangeCounters {
            published: of(&shared.published),
            dropped: of(&shared.dropped),
            slow: of(&shared.slow),
            subscribers: 0,
            // There is no master.
            is_registered: self.thread.as_ref().is_some_and(|thread| !thread.is_finished()),
            returns: 0,
            received: received + trajectories,
            overwritten,
            invalid: of(&shared.invalid) + invalid_trajectories + self.dropped_by_dds.count(),
            ahead: self.ahead.count(),
        }
    }

    fn pictures(&self) -> Arc<dyn PictureQueue> {
        Arc::clone(&self.shared) as Arc<dyn PictureQueue>
    }
}

impl PictureQueue for Shared {
    fn send(&self, picture: OnboardPicture) {
        let mut inbox = self.inbox();
        if inbox.pictures.len() >= PICTURE_CAPACITY {
            inbox.pictures.pop_front();
            self.pictures_dropped.fetch_add(1, Ordering::Relaxed);
        }
        inbox.pictures.push_back(picture);
        drop(inbox);
        self.changed.notify_one();
    }

    fn wanted(&self) -> Arc<[AtomicBool]> {
        Arc::clone(&self.wanted)
    }

    fn counters(&self) -> (u64, u64) {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        (of(&self.pictures_published), of(&self.pictures_dropped))
    }

    fn form(&self) -> PictureForm {
        self.picture_form
    }
}

impl Drop for Ros2Node {
    fn drop(&mut self) {
        self.shared.inbox().is_over = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}

/// What a subscription is for.
enum Subscription {
    Poses(VehicleId, VehicleTopics),
    Trajectories,
}

type Subscriptions = Vec<(Subscription, Box<dyn TopicSubscriber>)>;

fn subscribe(
    middleware: &mut dyn Middleware,
    options: &Ros2Options,
    waker: &Waker,
) -> Result<Subscriptions, Ros2Error> {
    let kind = match options.vehicle_topics {
        VehicleTopics::Poses => POSE_STAMPED,
        VehicleTopics::Transforms => TRANSFORM_STAMPED,
    };
    let mut subscriptions = Vec::new();
    for Subject { vehicle, name } in &options.subscribed {
        let subscriber = middleware.subscriber(&vehicle_topic(name), kind, waker)?;
        subscriptions.push((Subscription::Poses(*vehicle, options.vehicle_topics), subscriber));
    }
    if !options.driven.is_empty() {
        let subscriber = middleware.subscriber(TRAJECTORY_TOPIC, MULTI_DOF_TRAJECTORY, waker)?;
        subscriptions.push((Subscription::Trajectories, subscriber));
    }
    Ok(subscriptions)
}

/// Work of the thread that owns the topics.
struct Worker {
    shared: Arc<Shared>,
    topics: PublishedTopics,
    subscriptions: Subscriptions,
    driven: BTreeMap<String, VehicleId>,
    /// Ends after its topics.
    middleware: Box<dyn Middleware>,
}

impl Worker {
    fn run(mut self) {
        let shared = Arc::clone(&self.shared);
        while let Some(work) = shared.wait() {
            if work.is_woken {
                self.receive();
            }
            for frame in work.frames {
                self.topics.publish_frame(&mut *self.middleware, &frame);
                shared.published.fetch_add(1, Ordering::Relaxed);
            }
            for picture in work.pictures {
                self.topics.publish_picture(&picture);
                shared.pictures_published.fetch_add(1, Ordering::Relaxed);
            }
            let Published { slow, .. } = self.topics.published;
            shared.slow.store(slow, Ordering::Relaxed);
            let flags = shared.wanted.iter().zip(self.topics.wanted());
            flags.for_each(|(flag, wanted)| flag.store(wanted, Ordering::Relaxed));
        }
    }

    fn receive(&mut self) {
        let Self { shared, subscriptions, driven, .. } = self;
        for (subscription, subscriber) in subscriptions {
            let mut taken = 0;
            while let Some(received) = subscriber.take() {
                match (&*subscription, received) {
                    (Subscription::Trajectories, Received::Message(message)) => {
                        shared.trajectories.take(&message, driven);
                    }
                    (Subscription::Trajectories, Received::Refused) => shared.trajectories.refuse(),
                    (Subscription::Poses(vehicle, kind), received) => {
                        match received_pose(*vehicle, *kind, &received) {
                            Some(pose) => shared.poses.push(pose),
                            None => drop(shared.invalid.fetch_add(1, Ordering::Relaxed)),
                        }
                    }
                }
                taken += 1;
                if taken == MAX_TAKEN {
                    // The others have their turn, and then this one again.
                    shared.inbox().is_woken = true;
                    break;
                }
            }
        }
    }
}

/// The pose of a message; `None` where it is none on the floor.
fn received_pose(vehicle: VehicleId, kind: VehicleTopics, received: &Received) -> Option<ReceivedPose> {
    let Received::Message(message) = received else { return None };
    let mut cdr = CdrReader::of_body(message);
    let stamped = match kind {
        VehicleTopics::Poses => read_pose(&mut cdr)?,
        VehicleTopics::Transforms => read_transform(&mut cdr)?,
    };
    let pose = measured(vehicle, stamped.stamp.seconds(), stamped.pose.position, stamped.pose.orientation)?;
    Some(ReceivedPose { seq: 0, pose })
}
