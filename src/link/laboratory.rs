//! Vehicles of the laboratory, each at its own UDP address: trajectories and the experiment's clock go to them, and
//! poses come back where they are asked for.

use super::{Client, Heard, LinkError};
use crate::snapshot::{Trajectory, VehicleId};
use crate::wire::{Body, Clock, Measurement, Message, Seal, pack};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// So often a vehicle is greeted, and its poses are asked for again.
const RENEW: Duration = Duration::from_secs(1);
const LEASE_S: f64 = 10.0;
/// So often the clock is told while nothing about it changes.
const TELL_CLOCK: Duration = Duration::from_millis(100);
/// A vehicle that has said nothing for so long is silent.
const SILENT: Duration = Duration::from_secs(3);
/// Datagrams of a vehicle that are read at once.
const AT_ONCE: usize = 256;

/// What is at one address.
#[derive(Debug)]
struct Station {
    address: String,
    vehicles: Vec<VehicleId>,
    client: Client,
    renewed: Option<Instant>,
    heard: Option<Instant>,
    is_silent: bool,
}

/// All of them.
#[derive(Debug)]
pub struct Laboratory {
    stations: Vec<Station>,
    /// Whether poses are asked for.
    wants_poses: bool,
    told: Option<(Instant, Clock)>,
}

impl Laboratory {
    /// Opens sockets to vehicles and their addresses; nothing is sent yet.
    ///
    /// # Errors
    /// When an address is none, or cannot be reached from here.
    pub fn new(
        vehicles: impl Iterator<Item = (VehicleId, String)>,
        wants_poses: bool,
        world: u32,
        seal: &Seal,
    ) -> Result<Self, LinkError> {
        let mut by_address: BTreeMap<String, Vec<VehicleId>> = BTreeMap::new();
        for (vehicle, address) in vehicles {
            by_address.entry(address).or_default().push(vehicle);
        }
        let station = |(address, vehicles): (String, Vec<VehicleId>)| {
            let client = Client::new(&address, world, seal.clone())?;
            Ok(Station { address, vehicles, client, renewed: None, heard: None, is_silent: false })
        };
        let stations = by_address.into_iter().map(station).collect::<Result<_, LinkError>>()?;
        Ok(Self { stations, wants_poses, told: None })
    }

    pub fn is_empty(&self) -> bool {
        self.stations.is_empty()
    }

    /// Whether a vehicle is one of the laboratory's.
    pub fn has(&self, vehicle: VehicleId) -> bool {
        self.stations.iter().any(|station| station.vehicles.contains(&vehicle))
    }

    /// Reads what has come, and renews what has to be; adds the poses that have come.
    pub fn poll(&mut self, poses: &mut Vec<Measurement>) {
        for station in &mut self.stations {
            station.poll(self.wants_poses, poses);
        }
    }

    /// Tells the vehicles what the experiment's clock shows, when that is due.
    pub fn tell_clock(&mut self, clock: Clock) {
        let is_due = self.told.is_none_or(|(when, told)| {
            when.elapsed() >= TELL_CLOCK || told.phase != clock.phase || clock.time_s < told.time_s
        });
        if is_due {
            self.told = Some((Instant::now(), clock));
            self.stations.iter_mut().for_each(|station| _ = station.client.send(&Body::Clock(clock)));
        }
    }

    /// Sends trajectories to those whom they are for.
    pub fn send<'a>(&mut self, trajectories: impl Iterator<Item = &'a Trajectory> + Clone) {
        for station in &mut self.stations {
            let own = trajectories.clone().filter(|one| station.vehicles.contains(&one.vehicle));
            for body in pack(own.cloned().map(Message::Follow)) {
                station.client.send(&body);
            }
        }
    }
}

impl Station {
    fn poll(&mut self, wants_poses: bool, poses: &mut Vec<Measurement>) {
        if self.renewed.is_none_or(|renewed| renewed.elapsed() >= RENEW) {
            self.renewed = Some(Instant::now());
            // One that says nothing may have been restarted, and does not know to whom it belongs.
            match self.heard {
                Some(heard) if heard.elapsed() > RENEW => self.client.probe(),
                _ => _ = self.client.send(&Body::Hello { token: 0 }),
            }
            if wants_poses {
                self.client.send(&Body::Subscribe { request: 0, every_ticks: 1, lease_s: LEASE_S });
            }
        }
        for _ in 0..AT_ONCE {
            match self.client.receive(Duration::ZERO) {
                Some(Heard::Restarted) => {
                    self.client.renew();
                    self.renewed = None;
                }
                Some(Heard::Body(body)) => {
                    self.heard = Some(Instant::now());
                    if let Body::Poses(seen) = body {
                        let own = seen.vehicles.iter().map(|seen| seen.pose);
                        poses.extend(own.filter(|pose| self.vehicles.contains(&pose.vehicle)));
                    }
                }
                None => break,
            }
        }
        self.report();
    }

    fn report(&mut self) {
        let begun = *self.heard.get_or_insert_with(Instant::now);
        let is_silent = begun.elapsed() > SILENT;
        if is_silent && !self.is_silent {
            let names: Vec<String> = self.vehicles.iter().map(ToString::to_string).collect();
            tracing::warn!(
                "nothing is heard of the physical vehicles {} at {}",
                names.join(", "),
                self.address
            );
        } else if !is_silent && self.is_silent {
            tracing::warn!("the physical vehicles at {} are there again", self.address);
        }
        self.is_silent = is_silent;
    }
}
