//! What has come and waits for the simulation. Trajectories alone do not wake who rests until its next tick: they
//! are looked at then, and a thread that is woken for each of them would be in the way of those that follow.

use super::senders::Origin;
use crate::wire::Body;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Datagrams that may wait for the simulation.
const QUEUE: usize = 4096;
/// So many wake who rests: none has to take in more at once.
const MANY: usize = 64;

/// A datagram that has been read and may be used.
#[derive(Clone, Debug)]
pub struct Inbound {
    pub origin: Origin,
    pub body: Body,
    /// When it had been read.
    pub at: Instant,
}

impl Inbound {
    /// Whether somebody waits for an answer to it.
    fn is_urgent(&self) -> bool {
        !matches!(self.body, Body::Trajectories(_))
    }
}

/// What its reader waits for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Waiting {
    #[default]
    Nothing,
    Anything,
    Urgent,
}

#[derive(Debug, Default)]
struct Queue {
    datagrams: VecDeque<Inbound>,
    /// How many of them are.
    urgent: usize,
    waiting: Waiting,
}

impl Queue {
    fn has(&self, waiting: Waiting) -> bool {
        match waiting {
            Waiting::Nothing => false,
            Waiting::Anything => !self.datagrams.is_empty(),
            Waiting::Urgent => self.urgent > 0 || self.datagrams.len() >= MANY,
        }
    }
}

/// A bounded queue with one reader.
#[derive(Debug, Default)]
pub(super) struct Inbox {
    queue: Mutex<Queue>,
    has_news: Condvar,
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn has_room(&self) -> bool {
        self.lock().datagrams.len() < QUEUE
    }

    /// Puts a datagram behind the others; whoever does has looked for room.
    pub fn push(&self, inbound: Inbound) {
        let mut queue = self.lock();
        queue.urgent += usize::from(inbound.is_urgent());
        queue.datagrams.push_back(inbound);
        let wakes = queue.has(queue.waiting);
        drop(queue);
        if wakes {
            self.has_news.notify_one();
        }
    }

    /// The next datagram, waiting no longer than this.
    pub fn receive(&self, wait: Duration) -> Option<Inbound> {
        let mut queue = self.wait(Waiting::Anything, wait);
        let inbound = queue.datagrams.pop_front()?;
        queue.urgent -= usize::from(inbound.is_urgent());
        Some(inbound)
    }

    /// Until something waits that wants an answer, or much, but no longer than this.
    pub fn rest(&self, wait: Duration) {
        drop(self.wait(Waiting::Urgent, wait));
    }

    fn wait(&self, waiting: Waiting, wait: Duration) -> MutexGuard<'_, Queue> {
        let mut queue = self.lock();
        if !wait.is_zero() {
            queue.waiting = waiting;
            let waited = self.has_news.wait_timeout_while(queue, wait, |queue| !queue.has(waiting));
            queue = waited.unwrap_or_else(PoisonError::into_inner).0;
            queue.waiting = Waiting::Nothing;
        }
        queue
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::Trajectory;
    use std::sync::Arc;

    fn inbound(body: Body) -> Inbound {
        Inbound { origin: Origin(1), body, at: Instant::now() }
    }

    fn trajectory() -> Inbound {
        inbound(Body::Trajectories(vec![Trajectory::default()]))
    }

    const LONG: Duration = Duration::from_secs(60);

    /// How long a rest takes while somebody else pushes.
    fn rest_while(wait: Duration, pushes: impl FnOnce(&Inbox) + Send) -> Duration {
        let (inbox, begun) = (Inbox::default(), Instant::now());
        std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(20));
                pushes(&inbox);
            });
            inbox.rest(wait);
        });
        begun.elapsed()
    }

    #[test]
    fn trajectories_wake_nobody_who_rests_unless_they_become_many() {
        let few = |inbox: &Inbox| (1..MANY).for_each(|_| inbox.push(trajectory()));
        let short = Duration::from_millis(300);
        assert!(rest_while(short, few) >= short);
        let many = |inbox: &Inbox| (0..MANY).for_each(|_| inbox.push(trajectory()));
        let request = |inbox: &Inbox| {
            inbox.push(trajectory());
            inbox.push(inbound(Body::Hello { token: 1 }));
        };
        assert!(rest_while(LONG, many) < LONG && rest_while(LONG, request) < LONG);
    }

    #[test]
    fn they_come_in_their_order_and_wake_who_waits_for_anything() {
        let inbox = Arc::new(Inbox::default());
        let other = Arc::clone(&inbox);
        let thread = std::thread::spawn(move || [(); 2].map(|()| other.receive(LONG).unwrap().body));
        inbox.push(trajectory());
        inbox.push(inbound(Body::Hello { token: 1 }));
        let [first, second] = thread.join().unwrap();
        assert!(matches!(first, Body::Trajectories(_)) && matches!(second, Body::Hello { token: 1 }));
        assert!(inbox.receive(Duration::ZERO).is_none());
        // What has been taken wakes nobody any more.
        let begun = Instant::now();
        inbox.rest(Duration::from_millis(30));
        assert!(begun.elapsed() >= Duration::from_millis(30));
    }

    #[test]
    fn there_is_room_for_so_many_and_no_more() {
        let inbox = Inbox::default();
        for _ in 0..QUEUE {
            assert!(inbox.has_room());
            inbox.push(trajectory());
        }
        assert!(!inbox.has_room());
        assert!(inbox.receive(Duration::ZERO).is_some() && inbox.has_room());
    }
}
