//! Scheduler of a simulation: which participant runs next, and when (discrete-event simulation).

use super::traffic::Traffic;
use std::any::Any;
use std::sync::{Arc, Condvar};
use std::thread::JoinHandle;
use std::time::Duration;

/// A participant that reads the clock or polls this often without waiting is taken for an endless loop.
const MAX_IDLE_CALLS: u64 = 10_000_000;

pub(super) type Body = Box<dyn FnOnce() + Send>;

/// What a participant waits for. A time of `None` never comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Waiting {
    /// For nothing: it runs.
    Nothing,
    Time(Option<Duration>),
    Datagram {
        socket: u64,
        until: Option<Duration>,
    },
    /// For the end of another participant.
    EndOf(usize),
    /// It has ended.
    Ended,
}

pub(super) struct ParticipantState {
    pub name: Arc<str>,
    /// What it does, until it begins.
    pub body: Option<Body>,
    pub waiting: Waiting,
    /// It shall end at its next wait.
    pub is_stopped: bool,
    /// Wakes its thread.
    pub wake: Arc<Condvar>,
}

/// Why a simulation ends early.
pub(super) enum Failure {
    /// A participant has panicked.
    Panic(Box<dyn Any + Send>),
    /// Nobody can go on, in words.
    Stuck(String),
}

pub(super) struct Scheduler {
    /// Virtual time since the beginning.
    pub now: Duration,
    pub participants: Vec<ParticipantState>,
    /// The participant that runs.
    pub running: Option<usize>,
    pub threads: Vec<JoinHandle<()>>,
    pub traffic: Traffic,
    pub failure: Option<Failure>,
    /// Calls of the running participant since it has waited.
    idle_calls: u64,
}

impl Scheduler {
    pub fn new(traffic: Traffic) -> Self {
        Self {
            now: Duration::ZERO,
            participants: Vec::new(),
            running: None,
            threads: Vec::new(),
            traffic,
            failure: None,
            idle_calls: 0,
        }
    }

    pub fn add(&mut self, name: &str, body: Body) -> usize {
        self.participants.push(ParticipantState {
            name: name.into(),
            body: Some(body),
            waiting: Waiting::Time(Some(self.now)),
            is_stopped: self.failure.is_some(),
            wake: Arc::default(),
        });
        self.participants.len() - 1
    }

    /// Stops all participants, for the first failure.
    pub fn fail(&mut self, failure: Failure) {
        self.failure.get_or_insert(failure);
        self.participants.iter_mut().for_each(|one| one.is_stopped = true);
    }

    /// Advances the virtual time to the earliest event, and gives the participant whose turn it is; `None` when all have
    /// ended. Of participants at the same time, the one that was spawned first.
    pub fn next(&mut self) -> Option<usize> {
        self.idle_calls = 0;
        while self.participants.iter().any(|one| one.waiting != Waiting::Ended) {
            let ready =
                (0..self.participants.len()).filter_map(|number| Some((self.ready_at(number)?, number)));
            match (ready.min(), self.traffic.next_arrival()) {
                (ready, Some(at)) if ready.is_none_or(|(ready, _)| at <= ready) => {
                    self.now = self.now.max(at);
                    self.traffic.deliver(self.now);
                }
                (Some((at, _)), _) if at > self.traffic.options.longest && self.failure.is_none() => {
                    let longest = self.traffic.options.longest;
                    let stuck = format!("the simulation goes on after {longest:?}: {}", self.report());
                    self.fail(Failure::Stuck(stuck));
                }
                (Some((at, number)), _) => {
                    self.now = self.now.max(at);
                    return Some(number);
                }
                (None, _) => {
                    let stuck = format!("deadlock at {:?}, all wait for ever: {}", self.now, self.report());
                    self.fail(Failure::Stuck(stuck));
                }
            }
        }
        None
    }

    /// When a participant goes on, as things are.
    fn ready_at(&self, number: usize) -> Option<Duration> {
        let one = &self.participants[number];
        match one.waiting {
            Waiting::Nothing | Waiting::Ended => None,
            _ if one.is_stopped => Some(self.now),
            Waiting::Time(until) => until,
            Waiting::Datagram { socket, .. } if self.traffic.is_readable(socket) => Some(self.now),
            Waiting::Datagram { until, .. } => until,
            Waiting::EndOf(other) => (self.participants[other].waiting == Waiting::Ended).then_some(self.now),
        }
    }

    /// The end of a wait that begins now; the longest one has none.
    pub fn end_of(&self, wait: Duration) -> Option<Duration> {
        self.now.checked_add(wait).filter(|end| *end < Duration::MAX)
    }

    /// Who waits for what, in words.
    fn report(&self) -> String {
        let until =
            |until: Option<Duration>| until.map_or("for ever".to_owned(), |until| format!("until {until:?}"));
        let told = self.participants.iter().filter_map(|one| {
            let what = match one.waiting {
                Waiting::Ended => return None,
                Waiting::Nothing => "runs".to_owned(),
                Waiting::Time(time) => format!("sleeps {}", until(time)),
                Waiting::Datagram { socket, until: time } => {
                    let at = self
                        .traffic
                        .address(socket)
                        .map_or("a closed socket".to_owned(), |at| at.to_string());
                    format!("waits for a datagram at {at} {}", until(time))
                }
                Waiting::EndOf(other) => format!("waits for the end of {}", self.participants[other].name),
            };
            Some(format!("{} {what}", one.name))
        });
        told.collect::<Vec<_>>().join("; ")
    }

    /// Counts a call that takes no virtual time; `true` when the running participant seems to be in an endless loop.
    pub fn is_endless(&mut self) -> bool {
        self.idle_calls += 1;
        self.running.is_some() && self.idle_calls > MAX_IDLE_CALLS
    }
}
