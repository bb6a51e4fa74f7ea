//! ROS 1 node: its thread, its listening sockets, and its registration with the master.

use super::header::ConnectionHeader;
use super::publisher::{Outbox, Publication, framed};
use super::report::ReachabilityLog;
use super::subscriber::{PublisherLink, Subscription};
use super::xmlrpc::XmlRpcValue;
use super::{
    BindAddress, HostPort, MasterUri, MessageType, RosError, RosMessage, Topics, api, http, publisher,
};
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

/// Longest wait for the answer of a master or a node.
pub(super) const REQUEST_TIMEOUT: Duration = Duration::from_secs(5);
/// Exponential backoff between connection attempts: the first delay, and the longest.
pub(super) const MIN_BACKOFF: Duration = Duration::from_millis(250);
pub(super) const MAX_BACKOFF: Duration = Duration::from_secs(4);
/// Interval at which the registration is checked: a restarted master has lost it.
const REGISTRATION_CHECK_INTERVAL: Duration = Duration::from_secs(1);
/// Longest wait for unregistration at the end, for the master may be unreachable.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(2);
/// Delay before `accept` is tried again after an error, such as too many open files.
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(100);
/// Connections of subscribers at once, and calls at once.
const MAX_SUBSCRIBERS: usize = 256;
const MAX_CALLS: usize = 64;

/// Settings of a node.
#[derive(Clone, Debug)]
pub struct NodeOptions {
    /// Name with a leading slash.
    pub name: String,
    /// Master to register with.
    pub master: MasterUri,
    /// Address to listen on; by default `ROS_HOSTNAME` or `ROS_IP`, or else the loopback interface.
    pub bind: Option<BindAddress>,
}

impl NodeOptions {
    /// Address to listen on, and host name to advertise.
    fn host(&self) -> Result<(IpAddr, String), RosError> {
        let named = |name: &str| std::env::var(name).ok().filter(|text| !text.is_empty());
        // ROS prefers the name to the address.
        let told = named("ROS_HOSTNAME").or_else(|| named("ROS_IP"));
        let Some(BindAddress(bind)) = self.bind else {
            let Some(host) = told else {
                return Ok((Ipv4Addr::LOCALHOST.into(), Ipv4Addr::LOCALHOST.to_string()));
            };
            let found = (host.as_str(), 0).to_socket_addrs().ok().and_then(|mut found| found.next());
            let why = || "it cannot be resolved; set ROS_IP to an address of this machine".to_owned();
            let address = found.ok_or_else(|| RosError::Host { host: host.clone(), why: why() })?;
            return Ok((address.ip(), host));
        };
        let host = match (told, bind.is_unspecified()) {
            (Some(host), _) => host,
            (None, false) => bind.to_string(),
            (None, true) => self.local_address_to_master()?.to_string(),
        };
        Ok((bind, host))
    }

    /// Local address of the route to the master.
    fn local_address_to_master(&self) -> Result<IpAddr, RosError> {
        let HostPort { host, port } = &self.master.place;
        let any = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0));
        // Connecting a UDP socket sends nothing; the system looks up the route.
        let found = any.and_then(|socket| {
            socket.connect((host.as_str(), *port))?;
            socket.local_addr()
        });
        let why = |error: std::io::Error| RosError::Host {
            host: host.clone(),
            why: format!("the master cannot be reached ({error}); set ROS_IP to an address of this machine"),
        };
        Ok(found.map_err(why)?.ip())
    }
}

/// Status of a node or bridge, shared with other threads.
#[derive(Debug, Default)]
pub struct NodeStatus {
    /// The topics are registered.
    pub is_registered: AtomicBool,
    /// How often the connection was lost and restored.
    pub returns: AtomicU64,
    /// Subscribers that are connected now; a bridge does not count them.
    pub subscribers: AtomicU64,
    /// Messages that were dropped because a subscriber was too slow.
    pub slow: AtomicU64,
}

/// ROS 1 node, a handle on its own thread.
#[derive(Clone, Debug)]
pub struct RosNode(Rc<NodeState>);

#[derive(Debug)]
struct NodeState {
    options: NodeOptions,
    /// URI of the Slave API.
    uri: String,
    /// Address of TCPROS.
    place: HostPort,
    publications: RefCell<BTreeMap<String, Publication>>,
    subscriptions: RefCell<BTreeMap<String, Rc<Subscription>>>,
    /// The registration has to be updated.
    is_changed: Notify,
    /// The master or another node has shut this node down.
    is_shut_down: Cell<bool>,
    last_id: Cell<i32>,
    status: Arc<NodeStatus>,
}

/// The thread of a node or bridge.
#[derive(Debug)]
pub struct NodeThread {
    /// State of the connection, which the thread updates.
    pub status: Arc<NodeStatus>,
    /// Disconnects when the thread ends.
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
            // Does not wait for name look-ups that are still running.
            runtime.shutdown_background();
        };
        std::thread::Builder::new().name(name.to_owned()).spawn(live).map_err(RosError::Start)?;
        Ok(Self { status, ended })
    }

    /// Waits for the end of the thread, for little more than two seconds at most.
    pub fn join(&self) {
        // The channel carries no message; it disconnects.
        let _ = self.ended.recv_timeout(SHUTDOWN_TIMEOUT + ACCEPT_RETRY_DELAY);
    }
}

/// Runs a node on a thread of its own until its work is done, then unregisters its topics. The master may start later.
///
/// # Errors
/// When the node cannot listen, or the thread cannot be started.
pub fn run<F: Future<Output = ()>>(
    options: NodeOptions,
    work: impl FnOnce(RosNode) -> F + Send + 'static,
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
        let node = RosNode(Rc::new(NodeState {
            uri: format!("http://{}/", HostPort { host: host.clone(), port: calls.0 }),
            place: HostPort { host, port: topics.0 },
            options,
            publications: RefCell::default(),
            subscriptions: RefCell::default(),
            is_changed: Notify::new(),
            is_shut_down: Cell::new(false),
            last_id: Cell::new(0),
            status,
        }));
        LocalSet::new().block_on(runtime, node.run(calls.1, topics.1, work(node.clone())));
    })
}

/// Warns of a node on the loopback interface whose master is on another machine.
fn warn_of_reach(master: &MasterUri, bind: IpAddr) {
    let HostPort { host, .. } = &master.place;
    let is_near = host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback());
    if bind.is_loopback() && !is_near {
        tracing::warn!(
            "the ROS master {} is on another machine, which cannot reach the topics of this one; set --ros-bind or \
             ROS_IP to an address that it can reach",
            master.uri
        );
    }
}

impl RosNode {
    /// Name under which the node registers, with a leading slash.
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

    /// Whether it was shut down by the master or another node, and must publish nothing.
    pub fn is_shut_down(&self) -> bool {
        self.0.is_shut_down.get()
    }

    pub(super) fn shut_down(&self, why: &str) {
        if !self.0.is_shut_down.replace(true) {
            self.0.status.is_registered.store(false, Ordering::Relaxed);
            let why = why.chars().filter(|c| !c.is_control()).take(200).collect::<String>();
            tracing::error!("the ROS node {} is shut down, it publishes no more: {why}", self.name());
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

    /// Outboxes of the subscribers, with their topics.
    pub(super) fn outboxes(&self) -> Vec<(String, Rc<Outbox>)> {
        let topics = self.0.publications.borrow();
        let all = topics.iter().flat_map(|(topic, publication)| {
            publication.outboxes.iter().map(|outbox| (topic.clone(), Rc::clone(outbox)))
        });
        all.collect()
    }

    /// Links to publishers, with topic and URI.
    pub(super) fn links(&self) -> Vec<(String, String, Rc<PublisherLink>)> {
        let topics = self.0.subscriptions.borrow();
        let all = topics.values().flat_map(|subscription| {
            let links = subscription.links.borrow();
            let links =
                links.iter().map(|(uri, link)| (subscription.topic.clone(), uri.clone(), Rc::clone(link)));
            links.collect::<Vec<_>>()
        });
        all.collect()
    }

    /// The TCPROS address of a published topic.
    pub(super) fn tcpros_address(&self, topic: &str) -> Option<HostPort> {
        self.0.publications.borrow().contains_key(topic).then(|| self.0.place.clone())
    }

    pub(super) fn update_publishers(&self, topic: &str, publishers: impl Iterator<Item = String>) {
        let subscription = self.0.subscriptions.borrow().get(topic).cloned();
        if let Some(subscription) = subscription {
            subscription.update(self, publishers);
        }
    }

    /// Adds a subscriber after the TCPROS handshake.
    ///
    /// # Errors
    /// The reason to refuse it.
    pub(super) fn add_subscriber(
        &self,
        topic: &str,
        fields: &ConnectionHeader,
    ) -> Result<(Rc<Outbox>, MessageType), String> {
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

    /// Removes a subscriber.
    pub(super) fn remove_subscriber(&self, topic: &str, id: i32) {
        if let Some(publication) = self.0.publications.borrow_mut().get_mut(topic) {
            publication.outboxes.retain(|outbox| outbox.id != id);
        }
        self.0.status.subscribers.fetch_sub(1, Ordering::Relaxed);
    }

    /// Serves calls and subscribers and stays registered until the work is done.
    async fn run(&self, calls: StdListener, topics: StdListener, work: impl Future<Output = ()>) {
        let listeners =
            TcpListener::from_std(calls).and_then(|calls| Ok((calls, TcpListener::from_std(topics)?)));
        let (calls, topics) = match listeners {
            Ok(listeners) => listeners,
            Err(error) => return tracing::error!("the ROS node cannot listen: {error}"),
        };
        let mut registered = Registrations::default();
        tokio::select! {
            () = work => {}
            () = accept_loop(calls, MAX_CALLS, |stream| api::serve(self.clone(), stream)) => {}
            () = accept_loop(topics, MAX_SUBSCRIBERS, |stream| publisher::serve(self.clone(), stream)) => {}
            () = self.stay_registered(&mut registered) => {}
        }
        // An unreachable master drops the topics once a node asks for them.
        let _ = timeout(SHUTDOWN_TIMEOUT, self.unregister_all(&registered)).await;
    }

    /// Keeps the node registered with the master, with exponential backoff after errors.
    async fn stay_registered(&self, registered: &mut Registrations) {
        let mut log = ReachabilityLog::new(format!("the ROS master {}", self.master_uri()), &self.0.status);
        let mut backoff = MIN_BACKOFF;
        loop {
            match self.update_registrations(registered).await {
                Ok(()) => {
                    if !self.is_shut_down() {
                        log.reachable();
                    }
                    backoff = MIN_BACKOFF;
                    // Whichever comes first; the timeout is not an error.
                    let _ = timeout(REGISTRATION_CHECK_INTERVAL, self.0.is_changed.notified()).await;
                }
                Err(error) => {
                    *registered = Registrations::default();
                    log.unreachable(&error);
                    sleep(backoff).await;
                    backoff = (2 * backoff).min(MAX_BACKOFF);
                }
            }
        }
    }

    /// Registers and unregisters topics so that the master has the present ones.
    async fn update_registrations(&self, registered: &mut Registrations) -> Result<(), RosError> {
        let pid = self.call_master("getPid", &[]).await?;
        let is_known = match self.call_master("lookupNode", &[self.name()]).await {
            Ok(XmlRpcValue::Text(uri)) if uri == self.0.uri => true,
            Ok(XmlRpcValue::Text(uri)) if registered.is_any() => {
                self.shut_down(&format!("another node of this name is at {uri}"));
                false
            }
            Ok(_) | Err(RosError::Answer { .. }) => false,
            Err(error) => return Err(error),
        };
        if !is_known || registered.master.replace(pid.clone()) != Some(pid) {
            (registered.published, registered.subscribed) = Default::default();
        }
        if self.is_shut_down() {
            return Ok(());
        }
        for (topic, kind) in self.publications() {
            if !registered.published.contains(&topic) {
                self.register("registerPublisher", &topic, kind).await?;
                registered.published.insert(topic);
            }
        }
        for (topic, kind) in self.subscriptions() {
            if !registered.subscribed.contains(&topic) {
                let publishers = self.register("registerSubscriber", &topic, kind).await?;
                let publishers = publishers.list().unwrap_or_default().iter();
                self.update_publishers(&topic, publishers.filter_map(|uri| uri.text().map(str::to_owned)));
                registered.subscribed.insert(topic);
            }
        }
        let topics = self.publications();
        let gone: Vec<String> = registered
            .published
            .iter()
            .filter(|registered| !topics.iter().any(|(topic, _)| topic == *registered))
            .cloned()
            .collect();
        for topic in gone {
            self.unregister("unregisterPublisher", &topic).await?;
            registered.published.remove(&topic);
        }
        Ok(())
    }

    async fn register(&self, method: &str, topic: &str, kind: &str) -> Result<XmlRpcValue, RosError> {
        self.call_master(method, &[topic, kind, &self.0.uri]).await
    }

    async fn unregister(&self, method: &str, topic: &str) -> Result<XmlRpcValue, RosError> {
        self.call_master(method, &[topic, &self.0.uri]).await
    }

    async fn unregister_all(&self, registered: &Registrations) {
        // A node that has taken over the name has taken over the topics too.
        if self.is_shut_down() {
            return;
        }
        let published = registered.published.iter().map(|topic| ("unregisterPublisher", topic));
        let subscribed = registered.subscribed.iter().map(|topic| ("unregisterSubscriber", topic));
        for (method, topic) in published.chain(subscribed) {
            if let Err(error) = self.unregister(method, topic).await {
                return tracing::debug!("{topic} is not unregistered: {error}");
            }
        }
    }

    /// Calls a method of the Master API with this node's name; returns the value of `[1, why, value]`.
    async fn call_master(&self, method: &str, arguments: &[&str]) -> Result<XmlRpcValue, RosError> {
        let place = &self.0.options.master.place;
        let arguments: Vec<XmlRpcValue> =
            [self.name()].iter().chain(arguments).map(|text| XmlRpcValue::from(*text)).collect();
        let answer = http::call(place, method, &arguments).await?;
        let wrong = |why: &str| RosError::Answer { place: format!("{place}, {method}"), why: why.to_owned() };
        match answer.list() {
            Some([XmlRpcValue::Int(1), _, value]) => Ok(value.clone()),
            Some([XmlRpcValue::Int(_), XmlRpcValue::Text(why), ..]) => Err(wrong(why)),
            _ => Err(wrong("not the answer of a ROS master")),
        }
    }
}

impl Topics for RosNode {
    fn advertise<M: RosMessage>(&self, topic: &str) {
        if !self.is_shut_down() && !self.0.publications.borrow().contains_key(topic) {
            let publication = Publication { kind: M::TYPE, outboxes: Vec::new() };
            self.0.publications.borrow_mut().insert(topic.to_owned(), publication);
            self.0.is_changed.notify_one();
        }
    }

    fn unadvertise(&self, topic: &str) {
        if let Some(publication) = self.0.publications.borrow_mut().remove(topic) {
            publication.outboxes.iter().for_each(|outbox| outbox.close());
            self.0.is_changed.notify_one();
        }
    }

    fn publish<M: RosMessage>(&self, topic: &str, message: impl FnOnce() -> M) {
        let publications = self.0.publications.borrow();
        let Some(publication) = publications.get(topic).filter(|topic| !topic.outboxes.is_empty()) else {
            return;
        };
        let bytes = framed(|out| message().write(out));
        let is_slow = |outbox: &&Rc<Outbox>| !outbox.push(Rc::clone(&bytes));
        let slow = publication.outboxes.iter().filter(is_slow).count() as u64;
        self.0.status.slow.fetch_add(slow, Ordering::Relaxed);
    }

    fn has_subscribers(&self, topic: &str) -> bool {
        self.0.publications.borrow().get(topic).is_some_and(|topic| !topic.outboxes.is_empty())
    }

    fn subscribe<M: RosMessage>(&self, topic: &str, on_message: impl Fn(M) + 'static) {
        let name = topic.to_owned();
        let deliver = move |bytes: &[u8]| match M::decode(bytes) {
            Ok(message) => on_message(message),
            Err(error) => tracing::debug!("{name}: a message is dropped: {error}"),
        };
        let subscription = Rc::new(Subscription::new(topic, M::TYPE, Box::new(deliver)));
        self.0.subscriptions.borrow_mut().insert(topic.to_owned(), subscription);
        self.0.is_changed.notify_one();
    }
}

/// Accepts connections and serves them, at most `most` at once.
async fn accept_loop<F: Future<Output = ()> + 'static>(
    listener: TcpListener,
    most: usize,
    serve: impl Fn(TcpStream) -> F,
) {
    let served = Rc::new(());
    loop {
        match listener.accept().await {
            // Too many connections: the new one is closed at once.
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
                tracing::debug!("a connection cannot be accepted: {error}");
                sleep(ACCEPT_RETRY_DELAY).await;
            }
        }
    }
}

/// What is registered with the master.
#[derive(Debug, Default)]
struct Registrations {
    /// Process id of the master, which shows its restart.
    master: Option<XmlRpcValue>,
    published: BTreeSet<String>,
    subscribed: BTreeSet<String>,
}

impl Registrations {
    fn is_any(&self) -> bool {
        !self.published.is_empty() || !self.subscribed.is_empty()
    }
}
