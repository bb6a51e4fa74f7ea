//! Bounded queue from the receive thread to the simulation.
//!
//! Trajectories do not wake a reader that sleeps until its next tick: it looks at them then, and a thread that woke for
//! each of them would delay the next ones. A full queue drops the newest datagram (load shedding).

use super::senders::SenderId;
use city3d_protocol::wire::Body;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Datagrams that the queue holds.
const CAPACITY: usize = 4096;
/// This many datagrams wake the reader, which bounds the work of one tick.
const WAKE_COUNT: usize = 64;

/// A datagram that has passed all checks of the link.
#[derive(Clone, Debug)]
pub struct Inbound {
    /// Session of the sender.
    pub sender: SenderId,
    /// Decoded content of the datagram.
    pub body: Body,
    /// When it had been decoded.
    pub at: Instant,
}

impl Inbound {
    /// Whether its sender waits for an answer.
    fn is_urgent(&self) -> bool {
        !matches!(self.body, Body::Trajectories(_) | Body::Drive { .. })
    }
}

/// What wakes the reader.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum WakeCondition {
    #[default]
    Nothing,
    Anything,
    /// A datagram that wants an answer, or [`WAKE_COUNT`] datagrams.
    Urgent,
}

#[derive(Debug, Default)]
struct QueueState {
    datagrams: VecDeque<Inbound>,
    /// How many of them are urgent.
    urgent: usize,
    waiting: WakeCondition,
}

impl QueueState {
    fn has(&self, waiting: WakeCondition) -> bool {
        match waiting {
            WakeCondition::Nothing => false,
            WakeCondition::Anything => !self.datagrams.is_empty(),
            WakeCondition::Urgent => self.urgent > 0 || self.datagrams.len() >= WAKE_COUNT,
        }
    }
}

/// Bounded queue with one writer and one reader, and a condition variable that wakes the reader.
#[derive(Debug, Default)]
pub(super) struct ReceiveQueue {
    queue: Mutex<QueueState>,
    changed: Condvar,
}

impl ReceiveQueue {
    fn lock(&self) -> MutexGuard<'_, QueueState> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the queue takes another datagram.
    pub fn has_room(&self) -> bool {
        self.lock().datagrams.len() < CAPACITY
    }

    /// Whether it holds what would wake the reader.
    pub fn has(&self, waiting: WakeCondition) -> bool {
        self.lock().has(waiting)
    }

    /// Appends a datagram. The only writer has checked [`ReceiveQueue::has_room`].
    pub fn push(&self, inbound: Inbound) {
        let mut queue = self.lock();
        queue.urgent += usize::from(inbound.is_urgent());
        queue.datagrams.push_back(inbound);
        let wakes = queue.has(queue.waiting);
        drop(queue);
        if wakes {
            self.changed.notify_one();
        }
    }

    /// Takes the next datagram, and waits for it at most this long.
    pub fn receive(&self, wait: Duration) -> Option<Inbound> {
        let mut queue = self.wait(WakeCondition::Anything, wait);
        let inbound = queue.datagrams.pop_front()?;
        queue.urgent -= usize::from(inbound.is_urgent());
        Some(inbound)
    }

    /// Waits at most this long for a datagram that wants an answer, or for [`WAKE_COUNT`] datagrams.
    pub fn wait_for_urgent(&self, wait: Duration) {
        drop(self.wait(WakeCondition::Urgent, wait));
    }

    fn wait(&self, waiting: WakeCondition, wait: Duration) -> MutexGuard<'_, QueueState> {
        let mut queue = self.lock();
        if !wait.is_zero() {
            queue.waiting = waiting;
            let waited = self.changed.wait_timeout_while(queue, wait, |queue| !queue.has(waiting));
            queue = waited.unwrap_or_else(PoisonError::into_inner).0;
            queue.waiting = WakeCondition::Nothing;
        }
        queue
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::Trajectory;
    use std::sync::Arc;

    fn inbound(body: Body) -> Inbound {
        Inbound { sender: SenderId(1), body, at: Instant::now() }
    }

    fn trajectory() -> Inbound {
        inbound(Body::Trajectories(vec![Trajectory::default()]))
    }

    const LONG: Duration = Duration::from_secs(60);

    /// How long a wait lasts while another thread pushes.
    fn wait_while(wait: Duration, pushes: impl FnOnce(&ReceiveQueue) + Send) -> Duration {
        let (queue, begun) = (ReceiveQueue::default(), Instant::now());
        std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(20));
                pushes(&queue);
            });
            queue.wait_for_urgent(wait);
        });
        begun.elapsed()
    }

    #[test]
    fn few_trajectories_wake_no_sleeping_reader() {
        let few = |queue: &ReceiveQueue| (1..WAKE_COUNT).for_each(|_| queue.push(trajectory()));
        let short = Duration::from_millis(300);
        assert!(wait_while(short, few) >= short);
        let many = |queue: &ReceiveQueue| (0..WAKE_COUNT).for_each(|_| queue.push(trajectory()));
        let request = |queue: &ReceiveQueue| {
            queue.push(trajectory());
            queue.push(inbound(Body::Hello { token: 1 }));
        };
        assert!(wait_while(LONG, many) < LONG && wait_while(LONG, request) < LONG);
    }

    #[test]
    fn datagrams_keep_their_order_and_wake_a_waiting_reader() {
        let queue = Arc::new(ReceiveQueue::default());
        let other = Arc::clone(&queue);
        let thread = std::thread::spawn(move || [(); 2].map(|()| other.receive(LONG).unwrap().body));
        queue.push(trajectory());
        queue.push(inbound(Body::Hello { token: 1 }));
        let [first, second] = thread.join().unwrap();
        assert!(matches!(first, Body::Trajectories(_)) && matches!(second, Body::Hello { token: 1 }));
        assert!(queue.receive(Duration::ZERO).is_none());
        // Datagrams that were taken wake the reader no more.
        let begun = Instant::now();
        queue.wait_for_urgent(Duration::from_millis(30));
        assert!(begun.elapsed() >= Duration::from_millis(30));
    }

    #[test]
    fn the_queue_is_bounded() {
        let queue = ReceiveQueue::default();
        for _ in 0..CAPACITY {
            assert!(queue.has_room());
            queue.push(trajectory());
        }
        assert!(!queue.has_room());
        assert!(queue.receive(Duration::ZERO).is_some() && queue.has_room());
    }
}
