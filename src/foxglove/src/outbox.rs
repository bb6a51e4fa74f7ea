//! What waits for one client: a bounded queue for each channel (keep last), bounded in bytes for all together. Whoever
//! publishes never waits.

use crate::channel::Channel;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;
use tokio_tungstenite::tungstenite::Bytes;

/// Bytes that wait for a client, at most. One message may be larger.
const MAX_BYTES: usize = 8 << 20;

/// A message on its way to a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Waiting {
    pub channel: u32,
    /// The client's own number of its subscription.
    pub subscription: u32,
    /// Simulated time, nanoseconds.
    pub stamp_ns: u64,
    pub payload: Bytes,
}

/// What a client is to be sent next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Next {
    /// The present simulated time, nanoseconds.
    Time(u64),
    Message(Waiting),
}

#[derive(Debug, Default)]
struct Queue {
    /// Numbers of subscriptions by channel, with the channels.
    subscriptions: BTreeMap<u32, (u32, Arc<Channel>)>,
    waiting: VecDeque<Waiting>,
    bytes: usize,
    time_ns: Option<u64>,
}

impl Queue {
    fn remove(&mut self, index: usize) {
        if let Some(message) = self.waiting.remove(index) {
            self.bytes -= message.payload.len();
        }
    }
}

#[derive(Debug, Default)]
pub(crate) struct Outbox {
    queue: Mutex<Queue>,
    wake: Notify,
}

impl Outbox {
    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Subscribes to a channel; `false` where the client has a subscription to it, or of this number.
    pub(crate) fn subscribe(&self, channel: &Arc<Channel>, subscription: u32) -> bool {
        let mut queue = self.queue();
        let is_new = !queue.subscriptions.contains_key(&channel.id)
            && !queue.subscriptions.values().any(|(known, _)| *known == subscription);
        if is_new {
            queue.subscriptions.insert(channel.id, (subscription, Arc::clone(channel)));
        }
        is_new
    }

    /// Ends a subscription; returns its channel.
    pub(crate) fn unsubscribe(&self, subscription: u32) -> Option<Arc<Channel>> {
        let mut queue = self.queue();
        let mut known = queue.subscriptions.values();
        let channel = known.find(|(known, _)| *known == subscription)?.1.id;
        let (_, channel) = queue.subscriptions.remove(&channel)?;
        queue.waiting.retain(|message| message.channel != channel.id);
        queue.bytes = queue.waiting.iter().map(|message| message.payload.len()).sum();
        Some(channel)
    }

    /// The number of the subscription to a channel.
    pub(crate) fn subscription(&self, channel: u32) -> Option<u32> {
        self.queue().subscriptions.get(&channel).map(|(subscription, _)| *subscription)
    }

    /// Ends all subscriptions; returns their channels.
    pub(crate) fn unsubscribe_all(&self) -> Vec<Arc<Channel>> {
        let subscriptions = std::mem::take(&mut self.queue().subscriptions);
        subscriptions.into_values().map(|(_, channel)| channel).collect()
    }

    /// Queues a message, if the client has subscribed to its channel. Returns how many older ones had to give way.
    pub(crate) fn push(&self, channel: u32, depth: usize, stamp_ns: u64, payload: &Bytes) -> u64 {
        let mut queue = self.queue();
        let Some(&(subscription, _)) = queue.subscriptions.get(&channel) else { return 0 };
        let before = queue.waiting.len();
        let of_channel = queue.waiting.iter().filter(|message| message.channel == channel).count();
        if of_channel >= depth
            && let Some(oldest) = queue.waiting.iter().position(|message| message.channel == channel)
        {
            queue.remove(oldest);
        }
        while !queue.waiting.is_empty() && queue.bytes + payload.len() > MAX_BYTES {
            queue.remove(0);
        }
        let dropped = before - queue.waiting.len();
        queue.bytes += payload.len();
        queue.waiting.push_back(Waiting { channel, subscription, stamp_ns, payload: payload.clone() });
        drop(queue);
        self.wake.notify_one();
        dropped as u64
    }

    /// The present time, for a client that has subscribed to anything.
    pub(crate) fn tell_time(&self, stamp_ns: u64) {
        let mut queue = self.queue();
        if !queue.subscriptions.is_empty() {
            queue.time_ns = Some(stamp_ns);
            drop(queue);
            self.wake.notify_one();
        }
    }

    /// Waits for what is to be sent next.
    pub(crate) async fn next(&self) -> Next {
        loop {
            if let Some(next) = self.take() {
                return next;
            }
            self.wake.notified().await;
        }
    }

    /// What is to be sent next, if anything waits.
    pub(crate) fn take(&self) -> Option<Next> {
        let mut queue = self.queue();
        if let Some(time_ns) = queue.time_ns.take() {
            return Some(Next::Time(time_ns));
        }
        let message = queue.waiting.pop_front()?;
        queue.bytes -= message.payload.len();
        Some(Next::Message(message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(id: u32) -> Arc<Channel> {
        Channel::new(id, "/poses", crate::channel::Schema::vicon(), 2)
    }

    fn stamps(outbox: &Outbox) -> Vec<(u32, u64)> {
        let mut found = Vec::new();
        while let Some(Next::Message(message)) = outbox.take() {
            found.push((message.channel, message.stamp_ns));
        }
        found
    }

    #[test]
    fn of_each_channel_the_last_messages_wait() {
        let outbox = Outbox::default();
        assert!(outbox.subscribe(&channel(1), 10) && outbox.subscribe(&channel(2), 20));
        assert!(!outbox.subscribe(&channel(1), 30) && !outbox.subscribe(&channel(3), 10), "twice");
        let payload = Bytes::from_static(b"pose");
        let dropped: u64 = (0..5).map(|stamp_ns| outbox.push(1, 2, stamp_ns, &payload)).sum();
        assert_eq!((dropped, outbox.push(2, 2, 9, &payload), outbox.push(3, 2, 9, &payload)), (3, 0, 0));
        assert_eq!(stamps(&outbox), [(1, 3), (1, 4), (2, 9)]);
    }

    #[test]
    fn bytes_that_wait_are_bounded_and_a_large_message_passes_alone() {
        let outbox = Outbox::default();
        outbox.subscribe(&channel(1), 10);
        let picture = Bytes::from(vec![0; MAX_BYTES / 4]);
        let dropped: u64 = (0..9).map(|stamp_ns| outbox.push(1, 100, stamp_ns, &picture)).sum();
        assert_eq!((dropped, outbox.queue().bytes), (5, MAX_BYTES));
        assert_eq!(outbox.push(1, 100, 10, &Bytes::from(vec![0; MAX_BYTES + 1])), 4);
        assert_eq!(stamps(&outbox), [(1, 10)]);
        assert_eq!(outbox.queue().bytes, 0);
    }

    #[test]
    fn only_the_latest_time_is_told_before_what_waits() {
        let outbox = Outbox::default();
        outbox.tell_time(5);
        assert_eq!(outbox.take(), None, "nothing is subscribed to");
        outbox.subscribe(&channel(1), 10);
        outbox.push(1, 2, 7, &Bytes::from_static(b"pose"));
        outbox.tell_time(6);
        outbox.tell_time(7);
        assert_eq!(outbox.take(), Some(Next::Time(7)));
        assert_eq!(outbox.unsubscribe(10).map(|channel| channel.id), Some(1));
        assert_eq!((outbox.take(), outbox.queue().bytes), (None, 0));
    }
}
