//! The node among others: its thread, its listeners, and how it stays known to the master.

use super::header::Fields;
use super::publisher::{Outbox, Publication, framed};
use super::report::Report;
use super::subscriber::{Link, Subscription};
use super::xmlrpc::Value;
use super::{BindAddress, MasterUri, Message, MessageType, Place, RosError, Topics, api, http, publisher};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, Ipv4Addr, TcpListener as StdListener, ToSocketAddrs, UdpSocket};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::Notify;
use tokio::task::{LocalSet, spawn_local};
use tokio::time::{sleep, timeout};

/// A master or a node that takes longer to answer counts as away.
pub(super) const PATIENCE: Duration = Duration::from_secs(5);
/// Between attempts to reach somebody, each twice as long as the one before.
pub(super) const SHORTEST_PAUSE: Duration = Duration::from_millis(250);
pub(super) const LONGEST_PAUSE: Duration = Duration::from_secs(4);
/// So often the master is asked whether it still knows this node: one that was restarted does not.
const LOOK_UP: Duration = Duration::from_secs(1);
/// So long the end waits for the topics to be taken back; a master may be out of reach.
const FAREWELL: Duration = Duration::from_secs(2);
/// A listener that cannot accept tries again after this: the system is out of something.
const OUT_OF_BREATH: Duration = Duration::from_millis(100);
/// Subscribers at once, and calls at once.
const MOST_SUBSCRIBERS: usize = 256;
const MOST_CALLS: usize = 64;

/// How a node is set up.
#[derive(Clone, Debug)]
pub struct NodeOptions {
    /// With a slash in front.
    pub name: String,
    pub master: MasterUri,
    /// Where it listens; without it `ROS_IP` or `ROS_HOSTNAME` says so, and without those this machine alone
    /// reaches it.
    pub bind: Option<BindAddress>,
}

impl NodeOptions {
    /// Where to listen, and the host that others are told.
    fn host(&self) -> Result<(IpAddr, String), RosError> {
        let named = |name: &str| std::env::var(name).ok().filter(|text| !text.is_empty());
        // As for any node, the name goes before the address.
        let told = named("ROS_HOSTNAME").or_else(|| named("ROS_IP"));
        let Some(BindAddress(bind)) = self.bind else {
            let Some(host) = told else {
                return Ok((Ipv4Addr::LOCALHOST.into(), Ipv4Addr::LOCALHOST.to_string()));
            };
            let found = (host.as_str(), 0).to_socket_addrs().ok().and_then(|mut found| found.next());
            let why = || "it is not known; ROS_IP or ROS_HOSTNAME names this machine".to_owned();
            let address = found.ok_or_else(|| RosError::Host { host: host.clone(), why: why() })?;
            return Ok((address.ip(), host));
        };
        let host = match (told, bind.is_unspecified()) {
            (Some(host), _) => host,
            (None, false) => bind.to_string(),
            (None, true) => self.way_to_master()?.to_string(),
        };
        Ok((bind, host))
    }

    /// The address by which this machine reaches the master.
    fn way_to_master(&self) -> Result<IpAddr, RosError> {
        let Place { host, port } = &self.master.place;
        let any = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0));
        // Nothing is sent: the system looks the way up.
        let found = any.and_then(|socket| {
            socket.connect((host.as_str(), *port))?;
            socket.local_addr()
        });
        let why = |error: std::io::Error| RosError::Host {
            host: host.clone(),
            why: format!("there is no way to the master ({error}); name this machine by ROS_IP"),
        };
        Ok(found.map_err(why)?.ip())
    }
}

/// What other threads can know of a node.
#[derive(Debug, Default)]
pub struct NodeStatus {
    /// The master knows its topics.
    pub is_registered: AtomicBool,
    /// How often the master was away and came again.
    pub returns: AtomicU64,
    pub subscribers: AtomicU64,
    /// Messages that went because a subscriber was too slow.
    pub slow: AtomicU64,
}

/// A node, on its thread.
#[derive(Clone, Debug)]
pub struct Node(Rc<Inner>);

#[derive(Debug)]
struct Inner {
    options: NodeOptions,
    /// Of the Slave API.
    uri: String,
    /// Of TCPROS.
    place: Place,
    publications: RefCell<BTreeMap<String, Publication>>,
    subscriptions: RefCell<BTreeMap<String, Rc<Subscription>>>,
    /// There is something to tell the master.
    is_changed: Notify,
    /// Others have ended this node.
    is_shut: Cell<bool>,
    last_id: Cell<i32>,
    status: Arc<NodeStatus>,
}

/// The thread of a node.
#[derive(Debug)]
pub struct NodeThread {
    pub status: Arc<NodeStatus>,
    /// Tells, by its end, that of the thread.
    ended: Receiver<()>,
}

impl NodeThread {
    /// Starts a thread with a runtime of its own.
    pub(super) fn start(
        name: &str,
        live: impl FnOnce(&Runtime, Arc<NodeStatus>) + Send + 'static,
    ) -> Result<Self, RosError> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(RosError::Start)?;
        let status = Arc::new(NodeStatus::default());
        let (ending, ended) = channel();
        let shared = Arc::clone(&status);
        let live = move || {
            let _ending = ending;
            live(&runtime, shared);
            // Names that are still being looked up keep nobody waiting.
            runtime.shutdown_background();
        };
        std::thread::Builder::new().name(name.to_owned()).spawn(live).map_err(RosError::Start)?;
        Ok(Self { status, ended })
    }

    /// Waits for its end, but not for a master that does not answer.
    pub fn join(&self) {
        // It answers by its end alone.
        let _ = self.ended.recv_timeout(FAREWELL + OUT_OF_BREATH);
    }
}

/// Runs a node on a thread of its own until its work is done, and takes its topics back then. The master need
/// not be there yet.
///
/// # Errors
/// When the node cannot listen, or the thread cannot be started.
pub fn run<F: Future<Output = ()>>(
    options: NodeOptions,
    work: impl FnOnce(Node) -> F + Send + 'static,
) -> Result<NodeThread, RosError> {
    let (bind, host) = options.host()?;
    let listen = |_| {
        let listener = StdListener::bind((bind, 0)).and_then(|listener| {
            listener.set_nonblocking(true)?;
            Ok((listener.local_addr()?.port(), listener))
        });
        listener.map_err(|source| RosError::Listen { address: bind.to_string(), source })
    };
    let (calls, topics) = (listen("calls")?, listen("topics")?);
    warn_of_reach(&options.master, bind);
    NodeThread::start("ros", move |runtime, status| {
        let node = Node(Rc::new(Inner {
            uri: format!("http://{}/", Place { host: host.clone(), port: calls.0 }),
            place: Place { host, port: topics.0 },
            options,
            publications: RefCell::default(),
            subscriptions: RefCell::default(),
            is_changed: Notify::new(),
            is_shut: Cell::new(false),
            last_id: Cell::new(0),
            status,
        }));
        LocalSet::new().block_on(runtime, node.live(calls.1, topics.1, work(node.clone())));
    })
}

/// A node that only this machine reaches is of no use to a master elsewhere.
fn warn_of_reach(master: &MasterUri, bind: IpAddr) {
    let Place { host, .. } = &master.place;
    let is_near = host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback());
    if bind.is_loopback() && !is_near {
        tracing::warn!(
            "the ROS master {} is on another machine, and only this one can reach the topics; --ros-bind or ROS_IP \
             lets others",
            master.uri
        );
    }
}

impl Node {
    pub fn name(&self) -> &str {
        &self.0.options.name
    }

    pub(super) fn master_uri(&self) -> &str {
        &self.0.options.master.uri
    }

    pub(super) fn next_id(&self) -> i32 {
        let id = self.0.last_id.get().wrapping_add(1);
        self.0.last_id.set(id);
        id
    }

    /// Whether others have ended it: it is to say nothing any more.
    pub fn is_shut(&self) -> bool {
        self.0.is_shut.get()
    }

    pub(super) fn shut(&self, why: &str) {
        if !self.0.is_shut.replace(true) {
            self.0.status.is_registered.store(false, Ordering::Relaxed);
            let why = why.chars().filter(|c| !c.is_control()).take(200).collect::<String>();
            tracing::error!("{} is ended under ROS and says nothing there any more: {why}", self.name());
            self.0.publications.take().values().flat_map(|topic| &topic.outboxes).for_each(|out| out.close());
            self.0.is_changed.notify_one();
        }
    }

    pub(super) fn publications(&self) -> Vec<(String, &'static str)> {
        let topics = self.0.publications.borrow();
        topics.iter().map(|(topic, publication)| (topic.clone(), publication.kind.name)).collect()
    }

    pub(super) fn subscriptions(&self) -> Vec<(String, &'static str)> {
        let topics = self.0.subscriptions.borrow();
        topics.iter().map(|(topic, subscription)| (topic.clone(), subscription.kind.name)).collect()
    }

    /// Connections of subscribers, with their topics.
    pub(super) fn outboxes(&self) -> Vec<(String, Rc<Outbox>)> {
        let topics = self.0.publications.borrow();
        let all = topics.iter().flat_map(|(topic, publication)| {
            publication.outboxes.iter().map(|outbox| (topic.clone(), Rc::clone(outbox)))
        });
        all.collect()
    }

    /// Publishers that are followed, with topic and address.
    pub(super) fn links(&self) -> Vec<(String, String, Rc<Link>)> {
        let topics = self.0.subscriptions.borrow();
        let all = topics.values().flat_map(|subscription| {
            let links = subscription.links.borrow();
            let links =
                links.iter().map(|(uri, link)| (subscription.topic.clone(), uri.clone(), Rc::clone(link)));
            links.collect::<Vec<_>>()
        });
        all.collect()
    }

    /// Where a topic can be had.
    pub(super) fn offer(&self, topic: &str) -> Option<Place> {
        self.0.publications.borrow().contains_key(topic).then(|| self.0.place.clone())
    }

    pub(super) fn take_publishers(&self, topic: &str, publishers: impl Iterator<Item = String>) {
        let subscription = self.0.subscriptions.borrow().get(topic).cloned();
        if let Some(subscription) = subscription {
            subscription.update(self, publishers);
        }
    }

    /// Takes a subscriber in.
    ///
    /// # Errors
    /// In words: why not.
    pub(super) fn admit(&self, topic: &str, fields: &Fields) -> Result<(Rc<Outbox>, MessageType), String> {
        let mut publications = self.0.publications.borrow_mut();
        let publication =
            publications.get_mut(topic).ok_or_else(|| format!("{topic:?} is not published here"))?;
        let kind = publication.kind;
        for (field, ours) in [("type", kind.name), ("md5sum", kind.md5sum)] {
            match fields.get(field).map(String::as_str) {
                Some(theirs) if theirs == ours || theirs == "*" => {}
                None if field == "type" => {}
                theirs => return Err(format!("{topic} has {field} {ours}, not {theirs:?}")),
            }
        }
        let outbox =
            Rc::new(Outbox::new(self.next_id(), fields.get("callerid").cloned().unwrap_or_default()));
        publication.outboxes.push(Rc::clone(&outbox));
        self.0.status.subscribers.fetch_add(1, Ordering::Relaxed);
        Ok((outbox, kind))
    }

    /// Forgets a subscriber.
    pub(super) fn dismiss(&self, topic: &str, id: i32) {
        if let Some(publication) = self.0.publications.borrow_mut().get_mut(topic) {
            publication.outboxes.retain(|outbox| outbox.id != id);
        }
        self.0.status.subscribers.fetch_sub(1, Ordering::Relaxed);
    }

    /// Serves others and stays known until the work is done.
    async fn live(&self, calls: StdListener, topics: StdListener, work: impl Future<Output = ()>) {
        let listeners =
            TcpListener::from_std(calls).and_then(|calls| Ok((calls, TcpListener::from_std(topics)?)));
        let (calls, topics) = match listeners {
            Ok(listeners) => listeners,
            Err(error) => return tracing::error!("the ROS node cannot listen: {error}"),
        };
        let mut known = Known::default();
        tokio::select! {
            () = work => {}
            () = listen(calls, MOST_CALLS, |stream| api::serve(self.clone(), stream)) => {}
            () = listen(topics, MOST_SUBSCRIBERS, |stream| publisher::serve(self.clone(), stream)) => {}
            () = self.keep(&mut known) => {}
        }
        // A master that does not answer forgets them by itself, once somebody asks.
        let _ = timeout(FAREWELL, self.take_leave(&known)).await;
    }

    /// Keeps the node known to the master for as long as it lives.
    async fn keep(&self, known: &mut Known) {
        let mut report = Report::new(format!("the ROS master {}", self.master_uri()), &self.0.status);
        let mut pause = SHORTEST_PAUSE;
        loop {
            match self.look_after(known).await {
                Ok(()) => {
                    if !self.is_shut() {
                        report.is_there();
                    }
                    pause = SHORTEST_PAUSE;
                    // Whichever comes first; that a second has gone by is no failure.
                    let _ = timeout(LOOK_UP, self.0.is_changed.notified()).await;
                }
                Err(trouble) => {
                    *known = Known::default();
                    report.is_away(&trouble);
                    sleep(pause).await;
                    pause = (2 * pause).min(LONGEST_PAUSE);
                }
            }
        }
    }

    /// Tells the master what it does not know yet, or no longer.
    async fn look_after(&self, known: &mut Known) -> Result<(), RosError> {
        let pid = self.ask("getPid", &[]).await?;
        let is_known = match self.ask("lookupNode", &[self.name()]).await {
            Ok(Value::Text(uri)) if uri == self.0.uri => true,
            Ok(Value::Text(uri)) if known.is_any() => {
                self.shut(&format!("another node of this name is at {uri}"));
                false
            }
            Ok(_) | Err(RosError::Answer { .. }) => false,
            Err(error) => return Err(error),
        };
        if !is_known || known.master.replace(pid.clone()) != Some(pid) {
            (known.published, known.heard) = Default::default();
        }
        if self.is_shut() {
            return Ok(());
        }
        for (topic, kind) in self.publications() {
            if !known.published.contains(&topic) {
                self.register("registerPublisher", &topic, kind).await?;
                known.published.insert(topic);
            }
        }
        for (topic, kind) in self.subscriptions() {
            if !known.heard.contains(&topic) {
                let publishers = self.register("registerSubscriber", &topic, kind).await?;
                let publishers = publishers.list().unwrap_or_default().iter();
                self.take_publishers(&topic, publishers.filter_map(|uri| uri.text().map(str::to_owned)));
                known.heard.insert(topic);
            }
        }
        let topics = self.publications();
        let gone: Vec<String> = known
            .published
            .iter()
            .filter(|known| !topics.iter().any(|(topic, _)| topic == *known))
            .cloned()
            .collect();
        for topic in gone {
            self.unregister("unregisterPublisher", &topic).await?;
            known.published.remove(&topic);
        }
        Ok(())
    }

    async fn register(&self, method: &str, topic: &str, kind: &str) -> Result<Value, RosError> {
        self.ask(method, &[topic, kind, &self.0.uri]).await
    }

    async fn unregister(&self, method: &str, topic: &str) -> Result<Value, RosError> {
        self.ask(method, &[topic, &self.0.uri]).await
    }

    async fn take_leave(&self, known: &Known) {
        // The node that has taken the name has taken the topics too.
        if self.is_shut() {
            return;
        }
        let published = known.published.iter().map(|topic| ("unregisterPublisher", topic));
        let heard = known.heard.iter().map(|topic| ("unregisterSubscriber", topic));
        for (method, topic) in published.chain(heard) {
            if let Err(error) = self.unregister(method, topic).await {
                return tracing::debug!("{topic} is not taken back: {error}");
            }
        }
    }

    /// Asks the master, in this node's name; the value of `[1, why, value]`.
    async fn ask(&self, method: &str, arguments: &[&str]) -> Result<Value, RosError> {
        let place = &self.0.options.master.place;
        let arguments: Vec<Value> =
            [self.name()].iter().chain(arguments).map(|text| Value::from(*text)).collect();
        let answer = http::call(place, method, &arguments).await?;
        let wrong = |why: &str| RosError::Answer { place: format!("{place}, {method}"), why: why.to_owned() };
        match answer.list() {
            Some([Value::Int(1), _, value]) => Ok(value.clone()),
            Some([Value::Int(_), Value::Text(why), ..]) => Err(wrong(why)),
            _ => Err(wrong("no answer of a ROS master")),
        }
    }
}

impl Topics for Node {
    fn advertise<M: Message>(&self, topic: &str) {
        if !self.is_shut() && !self.0.publications.borrow().contains_key(topic) {
            let publication = Publication { kind: M::TYPE, outboxes: Vec::new() };
            self.0.publications.borrow_mut().insert(topic.to_owned(), publication);
            self.0.is_changed.notify_one();
        }
    }

    fn retract(&self, topic: &str) {
        if let Some(publication) = self.0.publications.borrow_mut().remove(topic) {
            publication.outboxes.iter().for_each(|outbox| outbox.close());
            self.0.is_changed.notify_one();
        }
    }

    fn publish<M: Message>(&self, topic: &str, message: impl FnOnce() -> M) {
        let publications = self.0.publications.borrow();
        let Some(publication) = publications.get(topic).filter(|topic| !topic.outboxes.is_empty()) else {
            return;
        };
        let bytes = framed(|out| message().write(out));
        let is_slow = |outbox: &&Rc<Outbox>| !outbox.push(Rc::clone(&bytes));
        let slow = publication.outboxes.iter().filter(is_slow).count() as u64;
        self.0.status.slow.fetch_add(slow, Ordering::Relaxed);
    }

    fn is_heard(&self, topic: &str) -> bool {
        self.0.publications.borrow().get(topic).is_some_and(|topic| !topic.outboxes.is_empty())
    }

    fn subscribe<M: Message>(&self, topic: &str, hear: impl Fn(M) + 'static) {
        let name = topic.to_owned();
        let deliver = move |bytes: &[u8]| match M::decode(bytes) {
            Ok(message) => hear(message),
            Err(error) => tracing::debug!("{name}: a message is dropped: {error}"),
        };
        let subscription = Rc::new(Subscription::new(topic, M::TYPE, Box::new(deliver)));
        self.0.subscriptions.borrow_mut().insert(topic.to_owned(), subscription);
        self.0.is_changed.notify_one();
    }
}

/// Serves whoever connects, at most so many at once.
async fn listen<F: Future<Output = ()> + 'static>(
    listener: TcpListener,
    most: usize,
    serve: impl Fn(TcpStream) -> F,
) {
    let served = Rc::new(());
    loop {
        match listener.accept().await {
            // Closed at once where there are too many.
            Ok((stream, from)) if Rc::strong_count(&served) > most => {
                tracing::debug!("{from}: more than {most} connections");
                drop(stream);
            }
            Ok((stream, _)) => {
                let (counted, service) = (Rc::clone(&served), serve(stream));
                spawn_local(async move {
                    service.await;
                    drop(counted);
                });
            }
            Err(error) => {
                tracing::debug!("nobody can connect: {error}");
                sleep(OUT_OF_BREATH).await;
            }
        }
    }
}

/// What the master has been told.
#[derive(Debug, Default)]
struct Known {
    /// What it has said to tell it from others.
    master: Option<Value>,
    published: BTreeSet<String>,
    heard: BTreeSet<String>,
}

impl Known {
    fn is_any(&self) -> bool {
        !self.published.is_empty() || !self.heard.is_empty()
    }
}
