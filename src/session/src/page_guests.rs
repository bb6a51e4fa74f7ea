//! Guests of the city's own web page: senders of a served city that use no link, with the same rules.

use super::guests::{GuestSetup, RETRY_INTERVAL};
use super::{GuestAct, GuestStatus};
use city3d_protocol::snapshot::{Pedals, VehicleId};
use city3d_protocol::wire::Body;
use city3d_simulation::runner::{FIRST_PAGE_GUEST, SenderNumber, ServerWorld};
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;

/// Name of their cars; a number is added to that of the second one.
const NAME: &str = "guest";

/// The guests of the page.
#[derive(Debug)]
pub(crate) struct PageGuests {
    setup: GuestSetup,
    guests: BTreeMap<u16, PageGuest>,
    /// Last sequence number of those who have left: who comes again by the same number counts on, for the city answers a
    /// request that it knows as it did before.
    left: BTreeMap<u16, u32>,
}

#[derive(Debug)]
struct PageGuest {
    sender: SenderNumber,
    /// Its car, once the city has it.
    vehicle: Option<VehicleId>,
    trouble: Option<String>,
    /// Counts its requests and pedals.
    sequence: u32,
    /// When it has asked to be let in, wall-clock seconds.
    asked_s: f64,
}

impl PageGuests {
    /// No guests, in the city of an experiment.
    pub fn of(experiment: &Experiment) -> Self {
        Self {
            setup: GuestSetup::of(experiment, NAME.to_owned()),
            guests: BTreeMap::new(),
            left: BTreeMap::new(),
        }
    }

    /// Carries out what a guest does.
    pub fn act(&mut self, world: &mut ServerWorld, now_s: f64, number: u16, act: GuestAct) {
        match act {
            GuestAct::Join => {
                let since = self.left.get(&number).copied().unwrap_or_default();
                let guest = self.guests.entry(number).or_insert_with(|| PageGuest::new(number, since));
                guest.ask(&self.setup, world, now_s);
            }
            GuestAct::Leave => {
                if let Some(mut guest) = self.guests.remove(&number) {
                    guest.leave(world, now_s);
                    self.left.insert(number, guest.sequence);
                }
            }
            GuestAct::Drive(pedals) => self.drive(world, now_s, number, Some(pedals)),
            GuestAct::Release => self.drive(world, now_s, number, None),
        }
    }

    fn drive(&mut self, world: &mut ServerWorld, now_s: f64, number: u16, pedals: Option<Pedals>) {
        let Some(guest) = self.guests.get_mut(&number) else { return };
        if let Some(vehicle) = guest.vehicle {
            let sequence = guest.next();
            world.take(guest.sender, now_s, Body::Drive { vehicle, sequence, pedals });
        }
    }

    /// Keeps the guests present, and asks again for those who wait outside.
    pub fn keep_up(&mut self, world: &mut ServerWorld, now_s: f64) {
        for guest in self.guests.values_mut() {
            world.note_activity(guest.sender, now_s);
            if guest.vehicle.is_none() && now_s - guest.asked_s >= RETRY_INTERVAL.as_secs_f64() {
                guest.ask(&self.setup, world, now_s);
            }
        }
    }

    /// The guests, for people.
    pub fn statuses(&self) -> Vec<GuestStatus> {
        let status = |(number, guest): (&u16, &PageGuest)| GuestStatus {
            number: *number,
            vehicle: guest.vehicle,
            trouble: guest.trouble.clone(),
        };
        self.guests.iter().map(status).collect()
    }
}

impl PageGuest {
    fn new(number: u16, sequence: u32) -> Self {
        let sender = FIRST_PAGE_GUEST + SenderNumber::from(number);
        Self { sender, vehicle: None, trouble: None, sequence, asked_s: 0.0 }
    }

    fn next(&mut self) -> u32 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    fn ask(&mut self, setup: &GuestSetup, world: &mut ServerWorld, now_s: f64) {
        if self.vehicle.is_some() {
            return;
        }
        self.asked_s = now_s;
        let brought = setup.bring((None, None), |setup| {
            let body = Body::Setup { request: self.next(), setup: Box::new(setup) };
            match world.take(self.sender, now_s, body)? {
                Body::Ack { outcome, detail, .. } => Some((outcome, detail)),
                _ => None,
            }
        });
        (self.vehicle, self.trouble) = match brought {
            Ok(vehicle) => (vehicle, None),
            Err(why) => (None, Some(why)),
        };
    }

    fn leave(&mut self, world: &mut ServerWorld, now_s: f64) {
        if let Some(vehicle) = self.vehicle {
            let request = self.next();
            world.take(self.sender, now_s, Body::Remove { request, vehicle });
        }
    }
}
