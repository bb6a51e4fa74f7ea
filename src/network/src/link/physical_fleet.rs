//! UDP links to the physical vehicles, one per address: sends trajectories and the experiment's clock, and receives
//! poses by a subscription with a lease.

use super::{Client, ClientEvent, LinkError};
use crate::host::{Clock, Host};
use city3d_geometry::Lab;
use city3d_protocol::snapshot::{Trajectory, VehicleId};
use city3d_protocol::wire::{Authenticator, Body, CityClock, Measurement, Message, pack};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Interval of the heartbeat to each vehicle, and of the renewal of the lease.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(1);
const LEASE_S: f64 = 10.0;
/// Interval of the clock datagrams while the clock keeps its phase.
const CLOCK_INTERVAL: Duration = Duration::from_millis(100);
/// A vehicle that has sent nothing for this long counts as silent.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(3);
/// Datagrams of a vehicle that one poll reads at most.
const MAX_DATAGRAMS_PER_POLL: usize = 256;

/// The link to one address, which may serve several vehicles.
#[derive(Debug)]
struct VehicleLink {
    address: String,
    vehicles: Vec<VehicleId>,
    client: Client,
    renewed: Option<Instant>,
    last_heard: Option<Instant>,
    is_silent: bool,
}

/// The links to all physical vehicles.
#[derive(Debug, Default)]
pub struct PhysicalFleet {
    host: Host,
    links: Vec<VehicleLink>,
    /// Whether to subscribe to poses.
    wants_poses: bool,
    /// The clock that was sent last, and when.
    sent_clock: Option<(Instant, CityClock)>,
}

impl PhysicalFleet {
    /// Opens sockets of this machine to vehicles and their addresses; nothing is sent yet.
    ///
    /// # Errors
    /// When an address is malformed, or cannot be reached from here.
    pub fn new(
        vehicles: impl Iterator<Item = (VehicleId, String)>,
        wants_poses: bool,
        world: u32,
        authenticator: &Authenticator,
    ) -> Result<Self, LinkError> {
        Self::on(&Host::system(), vehicles, wants_poses, world, authenticator)
    }

    /// Opens sockets of a host to vehicles and their addresses; nothing is sent yet.
    ///
    /// # Errors
    /// When an address is malformed, or cannot be reached from there.
    pub fn on(
        host: &Host,
        vehicles: impl Iterator<Item = (VehicleId, String)>,
        wants_poses: bool,
        world: u32,
        authenticator: &Authenticator,
    ) -> Result<Self, LinkError> {
        let mut by_address: BTreeMap<String, Vec<VehicleId>> = BTreeMap::new();
        for (vehicle, address) in vehicles {
            by_address.entry(address).or_default().push(vehicle);
        }
        let link = |(address, vehicles): (String, Vec<VehicleId>)| {
            let client = Client::on(host, &address, world, authenticator.clone())?;
            Ok(VehicleLink { address, vehicles, client, renewed: None, last_heard: None, is_silent: false })
        };
        let links = by_address.into_iter().map(link).collect::<Result<_, LinkError>>()?;
        Ok(Self { host: host.clone(), links, wants_poses, sent_clock: None })
    }

    /// Whether there are no physical vehicles.
    pub fn is_empty(&self) -> bool {
        self.links.is_empty()
    }

    /// Whether a vehicle is physical.
    pub fn has(&self, vehicle: VehicleId) -> bool {
        self.links.iter().any(|link| link.vehicles.contains(&vehicle))
    }

    /// Receives datagrams, sends due heartbeats and lease renewals; adds the poses that have come.
    pub fn poll(&mut self, poses: &mut Vec<Measurement>) {
        for link in &mut self.links {
            link.poll(&*self.host.clock, self.wants_poses, poses);
        }
    }

    /// Sends the experiment's clock to the vehicles when that is due.
    pub fn send_clock(&mut self, clock: CityClock) {
        let now = self.host.clock.now();
        let is_due = self.sent_clock.is_none_or(|(when, sent)| {
            now.duration_since(when) >= CLOCK_INTERVAL
                || sent.phase != clock.phase
                || clock.time_s < sent.time_s
        });
        if is_due {
            self.sent_clock = Some((now, clock));
            self.links.iter_mut().for_each(|link| _ = link.client.send(&Body::Clock(clock)));
        }
    }

    /// Sends each vehicle its trajectories.
    pub fn send<'a>(&mut self, trajectories: impl Iterator<Item = &'a Trajectory<Lab>> + Clone) {
        for link in &mut self.links {
            let own = trajectories.clone().filter(|one| link.vehicles.contains(&one.vehicle));
            for body in pack(own.cloned().map(Message::Follow)) {
                link.client.send(&body);
            }
        }
    }
}

impl VehicleLink {
    fn poll(&mut self, clock: &dyn Clock, wants_poses: bool, poses: &mut Vec<Measurement>) {
        let now = clock.now();
        if self.renewed.is_none_or(|renewed| now.duration_since(renewed) >= HEARTBEAT_INTERVAL) {
            self.renewed = Some(now);
            // A silent vehicle may have been restarted and does not know this session any more.
            match self.last_heard {
                Some(last_heard) if now.duration_since(last_heard) > HEARTBEAT_INTERVAL => {
                    self.client.probe();
                }
                _ => _ = self.client.send(&Body::Hello { token: 0 }),
            }
            if wants_poses {
                self.client.send(&Body::Subscribe { request: 0, every_ticks: 1, lease_s: LEASE_S });
            }
        }
        for _ in 0..MAX_DATAGRAMS_PER_POLL {
            match self.client.receive(Duration::ZERO) {
                Some(ClientEvent::Restarted) => {
                    self.client.reset_session();
                    self.renewed = None;
                }
                Some(ClientEvent::Body(body)) => {
                    self.last_heard = Some(clock.now());
                    if let Body::Poses(seen) = body {
                        let own = seen.vehicles.iter().map(|seen| seen.pose);
                        poses.extend(own.filter(|pose| self.vehicles.contains(&pose.vehicle)));
                    }
                }
                None => break,
            }
        }
        self.report(clock.now());
    }

    fn report(&mut self, now: Instant) {
        let begun = *self.last_heard.get_or_insert(now);
        let is_silent = now.duration_since(begun) > HEARTBEAT_TIMEOUT;
        if is_silent && !self.is_silent {
            let names: Vec<String> = self.vehicles.iter().map(ToString::to_string).collect();
            tracing::warn!(
                "no pose comes from the physical vehicles {} at {}",
                names.join(", "),
                self.address
            );
        } else if !is_silent && self.is_silent {
            tracing::warn!("poses come from the physical vehicles at {} again", self.address);
        }
        self.is_silent = is_silent;
    }
}
