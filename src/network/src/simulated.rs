//! A network in simulated time for tests: a discrete-event simulation of programs that exchange datagrams.
//!
//! Each participant is a closure with a [`Host`], in a thread of its own, and of all threads exactly one runs at any
//! time. When it waits, for a while or for a datagram, the scheduler advances the virtual clock to the earliest event
//! and lets the participant go on that it concerns. So there is no real waiting, there are no ports, and a simulation
//! repeats exactly by its seed. (FoundationDB and the crates `turmoil` and `madsim` test distributed programs like this;
//! the participants here are blocking code.)
//!
//! Computation takes no virtual time. Only a poll that finds nothing does ([`SimulatedOptions::poll_time`]), so that a
//! loop that polls comes to its end. A participant must not start threads that use its host, and the participants share
//! nothing that blocks.
//!
//! All addresses are of one machine, as on a loopback interface: [`SimulatedNetwork::partition`] and the like go by the
//! names of participants.
//!
//! ```
//! use city3d_network::simulated::{SimulatedNetwork, SimulatedOptions};
//! use std::net::SocketAddr;
//! use std::time::Duration;
//!
//! let lab = SimulatedNetwork::new(SimulatedOptions { delay: Duration::from_secs(2), ..Default::default() });
//! let address = SocketAddr::from(([127, 0, 0, 1], 9870));
//! lab.spawn("echo", move |host| {
//!     let (socket, mut bytes) = (host.network.bind(address)?, [0; 16]);
//!     if let Some((length, from)) = socket.receive(&mut bytes, Duration::MAX)? {
//!         socket.send_burst(from, &[bytes[..length].to_vec()])?;
//!     }
//!     Ok::<_, std::io::Error>(())
//! });
//! let asker = lab.spawn("asker", move |host| {
//!     let (socket, begun) = (host.network.connect(address)?, host.clock.now());
//!     socket.send(b"hello")?;
//!     socket.receive(&mut [0; 16], Duration::from_secs(60))?;
//!     Ok::<_, std::io::Error>(host.clock.now() - begun)
//! });
//! lab.run();
//! assert_eq!(asker.join()?, Duration::from_secs(4));
//! # Ok::<(), std::io::Error>(())
//! ```

mod scheduler;
#[cfg(test)]
mod tests;
mod traffic;

use crate::host::{Clock, DatagramSocket, Host, Network};
use scheduler::{Body, Failure, Scheduler, Waiting};
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use traffic::{Traffic, source_ip};

/// The wall clock at the beginning of each simulation.
const EPOCH_UNIX_S: f64 = 1.7e9;

/// Conditions of a [`SimulatedNetwork`]. The default is like a loopback interface.
#[derive(Clone, Copy, Debug)]
pub struct SimulatedOptions {
    /// Seed of all draws: losses, jitter and session numbers.
    pub seed: u64,
    /// One-way delay of each datagram.
    pub delay: Duration,
    /// Longest additional delay, drawn for each datagram (uniform distribution): datagrams may overtake each other.
    pub jitter: Duration,
    /// Probability that a datagram is lost.
    pub loss: f64,
    /// Probability that a datagram comes twice.
    pub duplication: f64,
    /// Datagrams that the receive buffer of a socket holds; the newest are dropped.
    pub buffer_datagrams: usize,
    /// Virtual time that a poll takes that finds nothing.
    pub poll_time: Duration,
    /// Longest virtual time of a simulation: one that goes on is taken for an endless loop.
    pub longest: Duration,
}

impl Default for SimulatedOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            delay: Duration::from_micros(50),
            jitter: Duration::ZERO,
            loss: 0.0,
            duplication: 0.0,
            buffer_datagrams: 4096,
            poll_time: Duration::from_micros(1),
            longest: Duration::from_secs(3600),
        }
    }
}

/// What has become of the datagrams of a simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SimulatedCounters {
    /// Datagrams that participants have sent.
    pub sent: u64,
    /// Datagrams that are on their way or have arrived, with the duplicates.
    pub copies: u64,
    /// Lost by chance, or by a partition.
    pub lost: u64,
    /// Came where nothing listened.
    pub refused: u64,
    /// Came to a full buffer.
    pub overflowed: u64,
    /// Came into the buffer of a socket.
    pub delivered: u64,
}

/// A simulated network with its participants. Clones are handles of the same network, also for use by participants.
#[derive(Clone)]
pub struct SimulatedNetwork(Arc<Shared>);

struct Shared {
    /// Instant of the beginning.
    base: Instant,
    scheduler: Mutex<Scheduler>,
    /// All participants have ended.
    done: Condvar,
}

/// Payload of the unwinding of a participant that is stopped.
struct Stopped;

/// A participant of a [`SimulatedNetwork`], for its result.
#[derive(Debug)]
pub struct Participant<T> {
    network: SimulatedNetwork,
    number: usize,
    result: Arc<Mutex<Option<T>>>,
}

impl SimulatedNetwork {
    /// A network without participants.
    pub fn new(options: SimulatedOptions) -> Self {
        let scheduler = Mutex::new(Scheduler::new(Traffic::new(options)));
        Self(Arc::new(Shared { base: Instant::now(), scheduler, done: Condvar::new() }))
    }

    /// Adds a participant. It begins at the present virtual time, once the simulation runs and the others wait.
    /// Participants may add others, and several may have one name: a partition concerns all of them.
    pub fn spawn<T: Send + 'static>(
        &self,
        name: &str,
        body: impl FnOnce(Host) -> T + Send + 'static,
    ) -> Participant<T> {
        let result = Arc::new(Mutex::new(None));
        let (host, place) = (self.host(), Arc::clone(&result));
        let body: Body = Box::new(move || {
            let found = body(host);
            *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(found);
        });
        Participant { network: self.clone(), number: self.lock().add(name, body), result }
    }

    /// Clock and sockets of this network.
    pub fn host(&self) -> Host {
        Host { clock: Arc::new(self.clone()), network: Arc::new(self.clone()) }
    }

    /// Runs the simulation until all participants have ended.
    ///
    /// # Panics
    /// With the panic of a participant; when all wait for ever; when it lasts longer than [`SimulatedOptions::longest`].
    pub fn run(&self) {
        let mut scheduler = self.lock();
        assert!(scheduler.running.is_none(), "the simulation runs already");
        self.dispatch(&mut scheduler);
        while scheduler.running.is_some() {
            scheduler = self.0.done.wait(scheduler).unwrap_or_else(PoisonError::into_inner);
        }
        let (threads, failure) = (std::mem::take(&mut scheduler.threads), scheduler.failure.take());
        drop(scheduler);
        for thread in threads {
            // Its panic is the failure.
            let _ = thread.join();
        }
        match failure {
            Some(Failure::Panic(payload)) => resume_unwind(payload),
            Some(Failure::Stuck(why)) => panic!("{why}"),
            None => {}
        }
    }

    /// Virtual time since the beginning.
    pub fn elapsed(&self) -> Duration {
        self.lock().now
    }

    /// What has become of the datagrams up to now.
    pub fn counters(&self) -> SimulatedCounters {
        self.lock().traffic.counters
    }

    /// Changes the probability that a datagram is lost, for those that are sent from now on.
    pub fn set_loss(&self, loss: f64) {
        self.lock().traffic.options.loss = loss;
    }

    /// Changes the delay and the jitter of the datagrams that are sent from now on.
    pub fn set_delay(&self, delay: Duration, jitter: Duration) {
        let options = &mut self.lock().traffic.options;
        (options.delay, options.jitter) = (delay, jitter);
    }

    /// Cuts two participants off from each other (network partition): datagrams that would arrive are lost, silently.
    pub fn partition(&self, a: &str, b: &str) {
        self.lock().traffic.partition(a, b);
    }

    /// Cuts a participant off from all others.
    pub fn isolate(&self, name: &str) {
        self.lock().traffic.isolate(name);
    }

    /// Ends all partitions.
    pub fn repair(&self) {
        self.lock().traffic.repair();
    }

    /// Stops the participants of this name, as by killing them: each ends where it waits and its sockets are closed.
    /// Another participant that calls this goes on after that; a participant that stops itself ends at its next wait.
    pub fn stop(&self, name: &str) {
        let mut scheduler = self.lock();
        let running = scheduler.running;
        let mut others = Vec::new();
        for (number, one) in scheduler.participants.iter_mut().enumerate() {
            if *one.name == *name && one.waiting != Waiting::Ended {
                one.is_stopped = true;
                others.extend((running.is_some() && running != Some(number)).then_some(number));
            }
        }
        drop(scheduler);
        others.into_iter().for_each(|number| self.wait(Waiting::EndOf(number)));
    }

    fn lock(&self) -> MutexGuard<'_, Scheduler> {
        self.0.scheduler.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets the participant go on whose turn it is. The caller waits, or has ended.
    fn dispatch(&self, scheduler: &mut Scheduler) {
        scheduler.running = scheduler.next();
        let Some(number) = scheduler.running else { return self.0.done.notify_all() };
        let next = &mut scheduler.participants[number];
        let Some(body) = next.body.take() else { return next.wake.notify_one() };
        let (name, network) = (next.name.to_string(), self.clone());
        let thread = std::thread::Builder::new().name(name).spawn(move || network.live(number, body));
        scheduler.threads.push(thread.expect("the system refuses a thread for a participant"));
    }

    /// The life of a participant, in its thread.
    fn live(&self, number: usize, body: Body) {
        let mut scheduler = self.lock();
        let one = &mut scheduler.participants[number];
        one.waiting = Waiting::Nothing;
        let is_stopped = one.is_stopped;
        drop(scheduler);
        let ended = catch_unwind(AssertUnwindSafe(|| if is_stopped { drop(body) } else { body() }));
        let mut scheduler = self.lock();
        scheduler.participants[number].waiting = Waiting::Ended;
        if let Err(payload) = ended
            && !payload.is::<Stopped>()
        {
            scheduler.fail(Failure::Panic(payload));
        }
        self.dispatch(&mut scheduler);
    }

    /// The running participant waits, and others run meanwhile.
    fn wait(&self, waiting: Waiting) {
        if std::thread::panicking() {
            // It is being stopped, and a destructor waits.
            return;
        }
        let mut scheduler = self.lock();
        let Some(own) = scheduler.running else {
            drop(scheduler);
            panic!("only the participants of a simulation that runs can wait");
        };
        scheduler.participants[own].waiting = waiting;
        let wake = Arc::clone(&scheduler.participants[own].wake);
        self.dispatch(&mut scheduler);
        while scheduler.running != Some(own) {
            scheduler = wake.wait(scheduler).unwrap_or_else(PoisonError::into_inner);
        }
        scheduler.participants[own].waiting = Waiting::Nothing;
        let is_stopped = scheduler.participants[own].is_stopped;
        drop(scheduler);
        if is_stopped {
            // Not a panic that anyone shall hear of.
            resume_unwind(Box::new(Stopped));
        }
    }

    /// Counts a call without waiting.
    fn count_idle_call(&self) {
        let mut scheduler = self.lock();
        let (is_endless, now) = (scheduler.is_endless(), scheduler.now);
        drop(scheduler);
        assert!(!is_endless, "a participant asks for ever without waiting, at {now:?}");
    }

    fn open(&self, address: SocketAddr, peer: Option<SocketAddr>) -> io::Result<Box<dyn DatagramSocket>> {
        let mut scheduler = self.lock();
        let owner = scheduler.running.map(|number| Arc::clone(&scheduler.participants[number].name));
        let number = scheduler.traffic.open(owner.unwrap_or_else(|| "".into()), address, peer)?;
        drop(scheduler);
        Ok(Box::new(SimulatedSocket(Arc::new(OpenSocket { network: self.clone(), number }))))
    }
}

impl fmt::Debug for SimulatedNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SimulatedNetwork").finish_non_exhaustive()
    }
}

impl<T> Participant<T> {
    /// The result of the participant. Another participant waits for its end.
    ///
    /// # Panics
    /// When it has not ended though the simulation does not run, or when it was stopped.
    pub fn join(self) -> T {
        if !self.has_ended() {
            self.network.wait(Waiting::EndOf(self.number));
        }
        let result = self.result.lock().unwrap_or_else(PoisonError::into_inner).take();
        result.expect("the participant was stopped, it has no result")
    }

    /// Whether the participant has ended.
    pub fn has_ended(&self) -> bool {
        self.network.lock().participants[self.number].waiting == Waiting::Ended
    }
}

impl Clock for SimulatedNetwork {
    fn now(&self) -> Instant {
        self.count_idle_call();
        self.0.base + self.elapsed()
    }

    fn unix_s(&self) -> f64 {
        self.count_idle_call();
        EPOCH_UNIX_S + self.elapsed().as_secs_f64()
    }

    fn sleep(&self, wait: Duration) {
        self.count_idle_call();
        let until = self.lock().end_of(wait);
        if !wait.is_zero() {
            self.wait(Waiting::Time(until));
        }
    }
}

impl Network for SimulatedNetwork {
    fn bind(&self, address: SocketAddr) -> io::Result<Box<dyn DatagramSocket>> {
        self.open(address, None)
    }

    fn connect(&self, to: SocketAddr) -> io::Result<Box<dyn DatagramSocket>> {
        let ip = source_ip(to);
        self.open(SocketAddr::new(ip, 0), Some(SocketAddr::new(ip, to.port())))
    }

    fn session(&self) -> u64 {
        self.lock().traffic.draw_session()
    }

    fn has_threads(&self) -> bool {
        false
    }
}

/// A socket, closed with its last handle.
#[derive(Debug)]
struct OpenSocket {
    network: SimulatedNetwork,
    number: u64,
}

impl Drop for OpenSocket {
    fn drop(&mut self) {
        self.network.lock().traffic.close(self.number);
    }
}

#[derive(Clone, Debug)]
struct SimulatedSocket(Arc<OpenSocket>);

impl SimulatedSocket {
    fn lock(&self) -> (MutexGuard<'_, Scheduler>, u64) {
        (self.0.network.lock(), self.0.number)
    }

    /// Takes a datagram that has come; if there is none, says when the wait ends.
    fn take(
        &self,
        bytes: &mut [u8],
        wait: Duration,
    ) -> io::Result<Result<(usize, SocketAddr), Option<Duration>>> {
        let (mut scheduler, number) = self.lock();
        let now = scheduler.now;
        scheduler.traffic.deliver(now);
        Ok(scheduler.traffic.take(number, bytes)?.ok_or_else(|| scheduler.end_of(wait)))
    }
}

impl DatagramSocket for SimulatedSocket {
    fn local_address(&self) -> io::Result<SocketAddr> {
        let (scheduler, number) = self.lock();
        scheduler.traffic.address(number)
    }

    fn send(&self, datagram: &[u8]) -> io::Result<()> {
        let (mut scheduler, number) = self.lock();
        let now = scheduler.now;
        scheduler.traffic.send_to_peer(now, number, datagram)
    }

    fn send_burst(&self, to: SocketAddr, datagrams: &[Vec<u8>]) -> io::Result<()> {
        let (mut scheduler, number) = self.lock();
        let now = scheduler.now;
        datagrams.iter().try_for_each(|datagram| scheduler.traffic.send(now, number, to, datagram))
    }

    fn receive(&self, bytes: &mut [u8], wait: Duration) -> io::Result<Option<(usize, SocketAddr)>> {
        let network = &self.0.network;
        network.count_idle_call();
        let poll_time = network.lock().traffic.options.poll_time;
        let until = match self.take(bytes, if wait.is_zero() { poll_time } else { wait })? {
            Ok(taken) => return Ok(Some(taken)),
            Err(until) => until,
        };
        if !wait.is_zero() {
            network.wait(Waiting::Datagram { socket: self.0.number, until });
            return Ok(self.take(bytes, Duration::ZERO)?.ok());
        }
        let is_running = network.lock().running.is_some();
        if is_running && !poll_time.is_zero() {
            network.wait(Waiting::Time(until));
        }
        Ok(None)
    }

    fn try_clone(&self) -> io::Result<Box<dyn DatagramSocket>> {
        Ok(Box::new(self.clone()))
    }
}
