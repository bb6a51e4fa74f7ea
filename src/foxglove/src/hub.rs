//! The hub between publishers and clients: channels, and the outboxes of all clients.

use crate::channel::{Channel, CityChannels, Schema, vicon_channel};
use crate::counters::Counters;
use crate::outbox::Outbox;
use city3d_logbook::record::LogTopic;
use city3d_network::listener::count;
use city3d_protocol::snapshot::VehicleInfo;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, mpsc, watch};
use tokio_tungstenite::tungstenite::Bytes;

/// Channels of vehicles' poses, at most.
const MAX_VEHICLES: usize = 1000;

/// Messages of other threads that wait for the server's, at most.
const ELSEWHERE: usize = 64;

/// A message on its way to the clients: its channel, simulated nanoseconds, and its bytes.
pub(crate) type Publication = (Arc<Channel>, u64, Bytes);

/// The channels that are offered, by their numbers.
pub(crate) type Offered = Arc<BTreeMap<u32, Arc<Channel>>>;

/// Channels of vehicles, by name.
#[derive(Debug, Default)]
struct Vehicles {
    channels: BTreeMap<String, Arc<Channel>>,
    roster: Arc<Vec<VehicleInfo>>,
}

#[derive(Debug)]
pub(crate) struct Hub {
    pub city: CityChannels,
    offered: watch::Sender<Offered>,
    vehicles: Mutex<Vehicles>,
    vicon_schema: Arc<Schema>,
    /// Subscriptions to the poses of all vehicles together.
    vicon_subscriptions: Arc<AtomicU32>,
    /// What other threads publish.
    #[cfg_attr(not(feature = "render"), allow(dead_code, reason = "there are no other threads"))]
    elsewhere: mpsc::Sender<Publication>,
    next_id: AtomicU32,
    clients: Mutex<BTreeMap<u64, Arc<Outbox>>>,
    /// Subscriptions of all clients together.
    subscriptions: AtomicU32,
    /// Somebody has subscribed: what stands is to be told once more.
    pub subscribed: Notify,
    counters: Arc<Counters>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    /// A hub, and what other threads hand over to publish.
    pub(crate) fn new(city: CityChannels, counters: Arc<Counters>) -> (Self, mpsc::Receiver<Publication>) {
        let (elsewhere, receiver) = mpsc::channel(ELSEWHERE);
        let offered: BTreeMap<_, _> = city.all().map(|channel| (channel.id, Arc::clone(channel))).collect();
        let next_id = AtomicU32::new(offered.keys().last().map_or(1, |last| last + 1));
        let hub = Self {
            city,
            offered: watch::Sender::new(Arc::new(offered)),
            vehicles: Mutex::default(),
            vicon_schema: Schema::vicon(),
            vicon_subscriptions: Arc::default(),
            elsewhere,
            next_id,
            clients: Mutex::default(),
            subscriptions: AtomicU32::new(0),
            subscribed: Notify::new(),
            counters,
        };
        (hub, receiver)
    }

    pub(crate) fn next_id(&self) -> u32 {
        self.next_id.fetch_add(1, Ordering::Relaxed)
    }

    /// Offers more channels.
    #[cfg(feature = "render")]
    pub(crate) fn offer(&self, channels: &[Arc<Channel>]) {
        self.offered.send_modify(|offered| {
            let more = channels.iter().map(|channel| (channel.id, Arc::clone(channel)));
            Arc::make_mut(offered).extend(more);
        });
    }

    /// The channels that are offered, and their changes.
    pub(crate) fn offered(&self) -> watch::Receiver<Offered> {
        self.offered.subscribe()
    }

    /// Whether anybody listens to anything.
    pub(crate) fn is_wanted(&self) -> bool {
        self.subscriptions.load(Ordering::Relaxed) > 0
    }

    /// Whether anybody listens to a topic of the log.
    pub(crate) fn wants(&self, topic: LogTopic) -> bool {
        self.city.log(topic).is_some_and(|channel| channel.is_wanted())
    }

    /// Offers a channel of poses for each vehicle of the city, and for no others.
    pub(crate) fn follow(&self, roster: &Arc<Vec<VehicleInfo>>) {
        let mut vehicles = locked(&self.vehicles);
        if Arc::ptr_eq(&vehicles.roster, roster) || vehicles.roster == *roster {
            return;
        }
        vehicles.roster = Arc::clone(roster);
        let present = roster.iter().take(MAX_VEHICLES).map(|info| info.name.as_str());
        let present: std::collections::BTreeSet<&str> = present.collect();
        let gone: Vec<u32> = vehicles
            .channels
            .extract_if(.., |name, _| !present.contains(name.as_str()))
            .map(|(_, channel)| channel.id)
            .collect();
        let mut come = Vec::new();
        for name in present {
            if !vehicles.channels.contains_key(name) {
                let channel =
                    vicon_channel(self.next_id(), name, &self.vicon_schema, &self.vicon_subscriptions);
                come.push((channel.id, Arc::clone(&channel)));
                vehicles.channels.insert(name.to_owned(), channel);
            }
        }
        drop(vehicles);
        self.offered.send_modify(|offered| {
            let offered = Arc::make_mut(offered);
            gone.iter().for_each(|id| _ = offered.remove(id));
            offered.extend(come);
        });
    }

    /// Whether anybody listens to the poses of a vehicle.
    pub(crate) fn wants_vicon(&self) -> bool {
        self.vicon_subscriptions.load(Ordering::Relaxed) > 0
    }

    /// The channel of the poses of a vehicle, where somebody listens to it.
    pub(crate) fn vicon(&self, name: &str) -> Option<Arc<Channel>> {
        let vehicles = locked(&self.vehicles);
        vehicles.channels.get(name).filter(|channel| channel.is_wanted()).cloned()
    }

    /// Adds a client.
    pub(crate) fn enter(&self, client: u64) -> Arc<Outbox> {
        let outbox = Arc::<Outbox>::default();
        locked(&self.clients).insert(client, Arc::clone(&outbox));
        outbox
    }

    /// Removes a client with its subscriptions.
    pub(crate) fn leave(&self, client: u64) {
        let Some(outbox) = locked(&self.clients).remove(&client) else { return };
        for channel in outbox.unsubscribe_all() {
            channel.unsubscribe();
            self.subscriptions.fetch_sub(1, Ordering::Relaxed);
        }
    }

    /// Subscribes a client to a channel; `false` where its numbers are taken.
    pub(crate) fn subscribe(&self, outbox: &Outbox, channel: &Arc<Channel>, subscription: u32) -> bool {
        let is_new = outbox.subscribe(channel, subscription);
        if is_new {
            channel.subscribe();
            self.subscriptions.fetch_add(1, Ordering::Relaxed);
            self.subscribed.notify_one();
        }
        is_new
    }

    /// Ends a subscription of a client.
    pub(crate) fn unsubscribe(&self, outbox: &Outbox, subscription: u32) {
        let Some(channel) = outbox.unsubscribe(subscription) else { return };
        channel.unsubscribe();
        self.subscriptions.fetch_sub(1, Ordering::Relaxed);
    }

    /// Hands a message over to the server's thread, which publishes it. A thread of low priority must not hold what the server
    /// waits for.
    #[cfg(feature = "render")]
    pub(crate) fn hand_over(&self, channel: &Arc<Channel>, stamp_ns: u64, payload: impl Into<Bytes>) {
        if self.elsewhere.try_send((Arc::clone(channel), stamp_ns, payload.into())).is_err() {
            count(&self.counters.skipped, 1);
        }
    }

    /// Hands a message to all clients that have subscribed to its channel.
    pub(crate) fn publish(&self, channel: &Channel, stamp_ns: u64, payload: impl Into<Bytes>) {
        let payload = payload.into();
        let clients = locked(&self.clients);
        let push = |outbox: &Arc<Outbox>| outbox.push(channel.id, channel.depth, stamp_ns, &payload);
        let dropped = clients.values().map(push).sum();
        drop(clients);
        count(&self.counters.skipped, dropped);
    }

    /// Tells all clients the present simulated time.
    pub(crate) fn tell_time(&self, stamp_ns: u64) {
        locked(&self.clients).values().for_each(|outbox| outbox.tell_time(stamp_ns));
    }
}
