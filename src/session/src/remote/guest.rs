//! A guest's car: brought into a city elsewhere, and driven there by a person.

use super::connection::{Connection, REQUEST_TIMEOUT};
use crate::guests::{GuestSetup, RETRY_INTERVAL};
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::{FrameSnapshot, Pedals, VehicleId, VehicleState};
use city3d_protocol::wire::Body;
use city3d_simulation::scenario::Experiment;
use std::time::{Duration, Instant};

/// Pedals are told this often although they have not moved, so that the city knows that somebody sits there.
const PEDAL_INTERVAL: Duration = Duration::from_millis(50);

/// A car of one's own in a city elsewhere.
pub(super) struct GuestCar {
    setup: GuestSetup,
    scale: LengthScale,
    /// Its id, once the city has it.
    vehicle: Option<VehicleId>,
    last_seen: Option<VehicleState>,
    pedals: Option<Pedals>,
    sequence: u32,
    told_at: Option<Instant>,
    tried_at: Option<Instant>,
    trouble: Option<String>,
}

impl GuestCar {
    pub(super) fn new(experiment: &Experiment, name: String) -> Self {
        Self {
            setup: GuestSetup::of(experiment, name),
            scale: experiment.scale,
            vehicle: None,
            last_seen: None,
            pedals: None,
            sequence: 0,
            told_at: None,
            tried_at: None,
            trouble: None,
        }
    }

    /// Id of the car, once the city has it.
    pub(super) fn vehicle(&self) -> Option<VehicleId> {
        self.vehicle
    }

    /// Why the city has not taken the car, as a sentence.
    pub(super) fn trouble(&self) -> Option<&str> {
        self.trouble.as_deref()
    }

    /// Brings the car into the city, where it was or where it starts, or keeps in mind why it does not take it.
    pub(super) fn set_up(&mut self, city: &mut Connection) {
        self.tried_at = Some(city.host.clock.now());
        let pose = self.last_seen.as_ref().map(|state| state.pose().to_lab(self.scale));
        let brought = self.setup.bring((self.vehicle.take(), pose), |setup| {
            let body = |request| Body::Setup { request, setup: Box::new(setup.clone()) };
            city.client.request(REQUEST_TIMEOUT, body)
        });
        match brought {
            Ok(Some(vehicle)) => (self.vehicle, self.trouble) = (Some(vehicle), None),
            Ok(None) => {}
            Err(why) => self.trouble = Some(why),
        }
    }

    pub(super) fn remember(&mut self, snapshot: &FrameSnapshot) {
        if let Some(state) = self.vehicle.and_then(|vehicle| snapshot.vehicle(vehicle)) {
            self.last_seen = Some(state.clone());
        }
    }

    /// Drives with these pedals, or lets go of them.
    pub(super) fn drive(&mut self, city: &mut Connection, pedals: Option<Pedals>) {
        self.pedals = pedals;
        self.tell(city, pedals);
    }

    /// Tells the pedals again when that is due, and knocks again where the city has not taken the car.
    pub(super) fn keep_up(&mut self, city: &mut Connection) {
        let now = city.host.clock.now();
        let is_due =
            |at: Option<Instant>, every| at.is_none_or(|at| now.saturating_duration_since(at) >= every);
        if self.vehicle.is_none() && is_due(self.tried_at, RETRY_INTERVAL) {
            self.set_up(city);
        }
        if let (Some(pedals), true) = (self.pedals, is_due(self.told_at, PEDAL_INTERVAL)) {
            self.tell(city, Some(pedals));
        }
    }

    fn tell(&mut self, city: &mut Connection, pedals: Option<Pedals>) {
        let Some(vehicle) = self.vehicle else { return };
        self.sequence += 1;
        self.told_at = Some(city.host.clock.now());
        city.client.send(&Body::Drive { vehicle, sequence: self.sequence, pedals });
    }

    /// Takes the car out of the city.
    pub(super) fn leave(&mut self, city: &mut Connection) {
        if let Some(vehicle) = self.vehicle.take() {
            city.client.send(&Body::Remove { request: 0, vehicle });
        }
    }
}
