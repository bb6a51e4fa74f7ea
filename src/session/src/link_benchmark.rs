//! Latency of the link, measured: a city that is served on a thread of this process, and a load generator that sends each
//! of its vehicles a trajectory each tick and takes the times.

use super::remote::setup_of;
use super::served::{ServeOptions, ServedCity, TimingMark, TimingMarks};
use super::{End, Host, Session, SessionError, SessionHandle, StepTiming};
use city3d_control::SetupError;
use city3d_geometry::Lab;
use city3d_network::link::{Client, ClientEvent, LinkError};
use city3d_protocol::snapshot::{Trajectory, VehicleId};
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, EncodeError, ExperimentAction, Message, ObservedVehicle, Poses,
    RequestOutcome, pack,
};
use city3d_simulation::runner::ControlLoop;
use city3d_simulation::scenario::Experiment;
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use thiserror::Error;

/// Longest wait for an answer of the city.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(20);
const POSE_TIMEOUT: Duration = Duration::from_millis(100);
/// Lease of the subscription, and its renewal interval in ticks.
const LEASE_S: f64 = 60.0;
const RENEW_TICKS: u32 = 500;

/// Why the load generator ends early.
#[derive(Debug, Error)]
pub enum LoadError {
    /// The link cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The control framework rejects a vehicle.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// A trajectory cannot be encoded.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The city refuses a request; its reason.
    #[error("the city refuses: {0}")]
    Refused(String),
    /// The city does not acknowledge a request.
    #[error("the city does not answer")]
    NoAnswer,
    /// The city has lost its state.
    #[error("the city has been restarted")]
    Restarted,
    /// The city sends no poses any more.
    #[error("the city is silent")]
    Silent,
}

/// Percentiles of a latency, microseconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LatencyPercentiles {
    /// Median.
    pub p50_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// The largest.
    pub most_us: f64,
}

impl LatencyPercentiles {
    /// The percentiles of some times; NaN where there are none.
    pub fn of(mut times: Vec<Duration>) -> Self {
        times.sort_unstable();
        let at = |share: f64| {
            let place = (share * times.len().saturating_sub(1) as f64).round() as usize;
            times.get(place).map_or(f64::NAN, |time| (time.as_secs_f64() * 1e7).round() / 10.0)
        };
        Self { p50_us: at(0.5), p99_us: at(0.99), most_us: at(1.0) }
    }
}

/// A city that is served on a thread of this process.
pub struct BenchmarkCity {
    /// Its session.
    pub session: SessionHandle,
    /// Where it listens.
    pub address: String,
    /// Times of its datagrams and ticks.
    pub marks: Receiver<TimingMark>,
}

impl BenchmarkCity {
    /// Serves a city on this machine, without files and without a rate limit in reach; `end` hears of its ticks after
    /// its subscribers.
    ///
    /// # Errors
    /// When the city cannot be served, or the operating system refuses the thread.
    pub fn serve(experiment: &Experiment, end: Option<Box<dyn End>>) -> Result<Self, SessionError> {
        let options = ServeOptions { world: 1, rate_per_s: 1e6, ..ServeOptions::at("127.0.0.1:0") };
        let (sender, marks) = channel();
        let host = Host::system();
        let mut city = ServedCity::open(options, experiment.clone(), None, host.clone())?;
        city.mark_taken(sender.clone());
        let (address, poses) = (city.address(), city.poses());
        let mut session =
            Session::new(city, host).with_end(poses).with_end(Box::new(TimingMarks::new(sender)));
        if let Some(end) = end {
            session = session.with_end(end);
        }
        Ok(Self { session: session.spawn(None)?, address, marks })
    }
}

/// Load generator: a control framework that sends each vehicle a trajectory each tick, and takes the times.
pub struct LoadGenerator<'a> {
    experiment: &'a Arc<Experiment>,
    client: Client,
    control: ControlLoop,
    latest: BTreeMap<VehicleId, Trajectory<Lab>>,
    sequence: u32,
    /// Poses received so far of the present tick.
    partial: (u64, Vec<ObservedVehicle>),
    /// Sending times, by first vehicle and sequence number of a datagram.
    sent: Vec<((VehicleId, u32), Instant)>,
    /// Receiving times, by tick and vehicle.
    received: Vec<((u64, VehicleId), Instant)>,
}

impl<'a> LoadGenerator<'a> {
    /// A client of the city at an address, with the control framework of the experiment; nothing is sent yet.
    ///
    /// # Errors
    /// When the link cannot be opened, or control rejects a vehicle.
    pub fn new(experiment: &'a Arc<Experiment>, address: &str) -> Result<Self, LoadError> {
        Ok(Self {
            experiment,
            client: Client::new(address, 0, Authenticator::Checksum)?,
            control: ControlLoop::new(experiment)?,
            latest: BTreeMap::new(),
            sequence: 0,
            partial: (0, Vec::new()),
            sent: Vec::new(),
            received: Vec::new(),
        })
    }

    fn request(&mut self, body: impl Fn(u32) -> Body) -> Result<(), LoadError> {
        match self.client.request(REQUEST_TIMEOUT, body) {
            Some((RequestOutcome::Done, _)) => Ok(()),
            Some((_, why)) => Err(LoadError::Refused(why)),
            None => Err(LoadError::NoAnswer),
        }
    }

    /// Sets up all vehicles, subscribes and starts the experiment.
    ///
    /// # Errors
    /// When the city refuses, or does not answer.
    pub fn set_up(&mut self) -> Result<(), LoadError> {
        for planned in &self.experiment.vehicles {
            let setup = Box::new(setup_of(self.experiment, planned, None));
            self.request(|request| Body::Setup { request, setup: setup.clone() })?;
        }
        self.request(|request| Body::Subscribe { request, every_ticks: 1, lease_s: LEASE_S })?;
        self.request(|request| Body::Command { request, action: ExperimentAction::Start })
    }

    /// Controls the vehicles for a time.
    ///
    /// # Errors
    /// When the city is restarted, or sends no poses.
    pub fn run(&mut self, lasting: Duration) -> Result<(), LoadError> {
        let until = Instant::now() + lasting;
        while Instant::now() < until {
            match self.client.receive(POSE_TIMEOUT) {
                Some(ClientEvent::Body(Body::Poses(poses))) => self.answer(&poses, Instant::now()),
                Some(ClientEvent::Body(_)) => {}
                Some(ClientEvent::Restarted) => return Err(LoadError::Restarted),
                None => return Err(LoadError::Silent),
            }
        }
        Ok(())
    }

    /// Makes a control step once all poses of a tick are received.
    fn answer(&mut self, poses: &Poses, at: Instant) {
        let received = poses.vehicles.iter().map(|seen| ((poses.tick, seen.pose.vehicle), at));
        self.received.extend(received);
        if poses.part == 0 {
            self.partial = (poses.tick, Vec::new());
        }
        self.partial.1.extend_from_slice(&poses.vehicles);
        if self.partial.0 != poses.tick || poses.part + 1 < poses.parts {
            return;
        }
        let mut delivered = Vec::new();
        let seen = self.partial.1.iter().map(|seen| seen.pose);
        self.control.step((poses.tick, poses.time_s), seen, &mut delivered);
        for message in delivered {
            match message {
                Message::Follow(trajectory) => drop(self.latest.insert(trajectory.vehicle, trajectory)),
                Message::Remove(vehicle) => drop(self.latest.remove(&vehicle)),
                Message::Signals(_) => {}
            }
        }
        self.sequence += 1;
        if self.sequence.is_multiple_of(RENEW_TICKS) {
            self.client.send(&Body::Subscribe { request: 0, every_ticks: 1, lease_s: LEASE_S });
        }
        let mut ready = Vec::new();
        for body in self.bodies() {
            let Body::Trajectories(list) = &body else { continue };
            let Some(first) = list.first().map(|first| (first.vehicle, first.sequence)) else { continue };
            ready.extend(self.client.prepare(&body).map(|(_, bytes)| (first, bytes)));
        }
        for (first, bytes) in ready {
            self.sent.push((first, Instant::now()));
            self.client.resend(&bytes);
        }
    }

    /// Bodies with the newest trajectory of each vehicle.
    fn bodies(&self) -> Vec<Body> {
        let renewed = |trajectory: &Trajectory<Lab>| {
            Message::Follow(Trajectory { sequence: self.sequence, ..trajectory.clone() })
        };
        pack(self.latest.values().map(renewed))
    }

    /// The encoded datagrams of a tick.
    ///
    /// # Errors
    /// When a trajectory cannot be encoded.
    pub fn datagrams(&self) -> Result<Vec<Vec<u8>>, LoadError> {
        let encode = |body: Body| body.encode(DatagramHeader::default(), &Authenticator::Checksum);
        Ok(self.bodies().into_iter().map(encode).collect::<Result<_, _>>()?)
    }

    /// Latencies of the datagrams that were sent after an instant, with the marks of the city.
    pub fn samples(&self, marked: &Receiver<TimingMark>, since: Instant) -> LatencySamples {
        let mut samples = LatencySamples::default();
        let (sent, received) =
            (BTreeMap::from_iter(self.sent.clone()), BTreeMap::from_iter(self.received.clone()));
        let mut waiting = Vec::new();
        for mark in marked.try_iter() {
            match mark {
                TimingMark::Taken { vehicle, sequence, at } => {
                    if let Some(&sent) = sent.get(&(vehicle, sequence))
                        && sent >= since
                    {
                        waiting.push((vehicle, sent, at));
                    }
                }
                TimingMark::Ticked { tick, timing, sent: handed } => {
                    let StepTiming { due, begun, done } = timing;
                    for (vehicle, sent, taken) in waiting.drain(..) {
                        let Some(&received) = received.get(&(tick, vehicle)) else { continue };
                        let parts = [
                            taken.saturating_duration_since(sent),
                            begun.saturating_duration_since(due.max(taken)),
                            received.saturating_duration_since(done),
                        ];
                        samples.beyond.push(parts.iter().sum());
                        samples.inward.push(parts[0]);
                        samples.late.push(parts[1]);
                        samples.outward.push(parts[2]);
                        samples.sending.push(handed.saturating_duration_since(done));
                        samples.step.push(done.saturating_duration_since(begun));
                    }
                }
            }
        }
        samples
    }
}

/// Latencies of datagrams, from the sent trajectory to the received pose.
#[derive(Clone, Debug, Default)]
pub struct LatencySamples {
    /// From sending to receiving, without the wait for the tick and without the step of the world.
    pub beyond: Vec<Duration>,
    /// Part of it: until the datagram is queued.
    pub inward: Vec<Duration>,
    /// Part of it: the lateness of the tick.
    pub late: Vec<Duration>,
    /// Part of it: from the end of the step until the pose is received.
    pub outward: Vec<Duration>,
    /// Part of `outward`: until all poses are handed over to the system.
    pub sending: Vec<Duration>,
    /// The step of the world.
    pub step: Vec<Duration>,
}
