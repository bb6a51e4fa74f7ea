//! A guest's car: brought into a city elsewhere, and driven there by a person.

use super::connection::{Connection, REQUEST_TIMEOUT};
use city3d_protocol::snapshot::{
    Appearance, BodyType, FrameSnapshot, ModelKind, Pedals, VehicleId, VehicleSpec, VehicleState,
};
use city3d_protocol::wire::{Body, PERSON, RequestOutcome, VehicleBuild, VehicleSetup};
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pedals are told this often although they have not moved, so that the city knows that somebody sits there.
const PEDAL_INTERVAL: Duration = Duration::from_millis(50);
/// A city that has no room is asked again at this interval.
const RETRY_INTERVAL: Duration = Duration::from_secs(2);
/// First id that a guest tries: ids of scenarios are small.
const FIRST_ID: u32 = 901;
/// Ids that it tries before it gives up.
const MOST_TRIES: u32 = 64;
/// Colour of the car, so that its driver finds it.
const COLOUR: [u8; 3] = [245, 190, 40];

/// A car of one's own in a city elsewhere.
pub(super) struct GuestCar {
    experiment: Arc<Experiment>,
    /// Name in the city; a number is added where it is taken.
    name: String,
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
    pub(super) fn new(experiment: Arc<Experiment>, name: String) -> Self {
        Self {
            experiment,
            name,
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

    /// Brings the car into the city, or keeps in mind why it does not take it.
    pub(super) fn set_up(&mut self, city: &mut Connection) {
        let first = self.vehicle.take().map_or(FIRST_ID, |vehicle| vehicle.0);
        self.tried_at = Some(city.host.clock.now());
        for number in first..first + MOST_TRIES {
            let setup = self.setup(number);
            let body = |request| Body::Setup { request, setup: Box::new(setup.clone()) };
            match city.client.request(REQUEST_TIMEOUT, body) {
                Some((RequestOutcome::Done, _)) => {
                    (self.vehicle, self.trouble) = (Some(setup.id), None);
                    return;
                }
                // Another guest has the number or the name.
                Some((RequestOutcome::Refused, detail)) if detail.contains("choose another") => {}
                Some((_, detail)) => {
                    self.trouble = Some(format!("your car waits outside: {detail}"));
                    return;
                }
                None => return,
            }
        }
        self.trouble = Some(format!("your car waits outside: {MOST_TRIES} other guests are there"));
    }

    /// Where it was, or behind the first vehicle of the scenario; the city finds free space from there.
    fn setup(&self, number: u32) -> VehicleSetup {
        let (experiment, scale) = (&self.experiment, self.experiment.scale);
        let planned = experiment.vehicles.first();
        let pose = match (&self.last_seen, planned) {
            (Some(state), _) => state.pose().to_lab(scale),
            (None, Some(planned)) => planned.pose_in_lab(&experiment.city_map, scale),
            (None, None) => experiment
                .lab_map
                .lanes
                .first()
                .map_or_else(Default::default, |lane| lane.curve.at(lane.curve.length() / 2.0).pose),
        };
        let simulated = experiment.vehicles.iter().find(|planned| planned.spec.model != ModelKind::Measured);
        let spec = simulated.map_or_else(VehicleSpec::default, |planned| planned.spec.clone());
        let name = match number {
            FIRST_ID => self.name.clone(),
            number => format!("{}_{}", self.name, number - FIRST_ID + 1),
        };
        VehicleSetup {
            id: VehicleId(number),
            name,
            controller: PERSON.to_owned(),
            parameters: Default::default(),
            appearance: Appearance { body: BodyType::Hatchback, colour: COLOUR },
            pose,
            speed_mps: 0.0,
            build: VehicleBuild::Spec(Box::new(spec)),
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
