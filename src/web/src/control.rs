//! Orders of pages: each vehicle is driven by one page at most.

use crate::counters::Counters;
use city3d_protocol::snapshot::{Pedals, VehicleId};
use city3d_session::{Order, OrderSender};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Gives orders to the session for the pages.
#[derive(Debug)]
pub(crate) struct Control {
    orders: OrderSender,
    /// Which page drives a vehicle.
    drivers: Mutex<BTreeMap<VehicleId, u64>>,
    counters: Arc<Counters>,
}

impl Control {
    pub(crate) fn new(orders: OrderSender, counters: Arc<Counters>) -> Self {
        Self { orders, drivers: Mutex::default(), counters }
    }

    /// Gives an order; without room it is lost, and counted.
    pub(crate) fn order(&self, order: Order) {
        if !self.orders.send(order) {
            Counters::add(&self.counters.lost_orders, 1);
        }
    }

    /// Pedals of a page; `false` where another page drives the vehicle.
    pub(crate) fn drive(&self, page: u64, vehicle: VehicleId, pedals: Pedals) -> bool {
        let mut drivers = self.drivers.lock().unwrap_or_else(PoisonError::into_inner);
        if *drivers.entry(vehicle).or_insert(page) != page {
            return false;
        }
        self.order(Order::Drive(vehicle, pedals));
        true
    }

    /// Hands a vehicle back that this page drives.
    pub(crate) fn release(&self, page: u64, vehicle: VehicleId) {
        let mut drivers = self.drivers.lock().unwrap_or_else(PoisonError::into_inner);
        if drivers.get(&vehicle) == Some(&page) {
            drivers.remove(&vehicle);
            self.order(Order::Release(vehicle));
        }
    }
}
