//! Orders of pages, to a city that runs or to a log that is played. Each vehicle is driven by one page at most.

use city3d_network::listener::{PeerCounters, count};
use city3d_protocol::snapshot::{Pedals, VehicleId};
use city3d_session::playback::{PlaybackCommand, PlayerRemote, Playhead};
use city3d_session::{GuestAct, Order, OrderSender, Speed};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};

/// Who takes the orders of pages.
#[derive(Clone, Debug)]
pub enum PageOrders {
    /// A city that runs.
    City(OrderSender),
    /// A log that is played.
    Log(PlayerRemote),
}

/// Gives orders for the pages.
#[derive(Debug)]
pub(crate) struct Control {
    orders: PageOrders,
    /// Which page drives a vehicle.
    drivers: Mutex<BTreeMap<VehicleId, u64>>,
    /// Orders that pages would not give again, while there is no room for them.
    backlog: Mutex<VecDeque<Order>>,
    counters: Arc<PeerCounters>,
}

impl Control {
    pub(crate) fn new(orders: PageOrders, counters: Arc<PeerCounters>) -> Self {
        Self { orders, drivers: Mutex::default(), backlog: Mutex::default(), counters }
    }

    /// Gives an order; without room it is lost, and counted.
    pub(crate) fn order(&self, order: Order) {
        if !self.send(order) {
            count(&self.counters.lost_orders, 1);
        }
    }

    fn send(&self, order: Order) -> bool {
        match &self.orders {
            PageOrders::City(orders) => orders.send(order),
            PageOrders::Log(remote) => playback_command(&order).is_none_or(|command| remote.send(command)),
        }
    }

    /// Gives an order that must not be lost: a vehicle would stay driven, or a guest's car stay there. Of each vehicle and
    /// guest only what still matters is kept.
    fn insist(&self, order: Order) {
        let mut backlog = self.backlog.lock().unwrap_or_else(PoisonError::into_inner);
        if let Order::Guest(guest, GuestAct::Leave) = order {
            backlog.retain(|known| {
                !matches!(known, Order::Guest(other, GuestAct::Join | GuestAct::Release) if *other == guest)
            });
        }
        if !backlog.contains(&order) {
            backlog.push_back(order);
        }
        drop(backlog);
        self.catch_up();
    }

    /// Gives the orders that there was no room for.
    pub(crate) fn catch_up(&self) {
        let mut backlog = self.backlog.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(order) = backlog.pop_front() {
            if !self.send(order.clone()) {
                backlog.push_front(order);
                return;
            }
        }
    }

    /// Where the playhead of the log is; `None` of a city that runs.
    pub(crate) fn head(&self) -> Option<Playhead> {
        match &self.orders {
            PageOrders::City(_) => None,
            PageOrders::Log(remote) => Some(remote.head()),
        }
    }

    /// Shows a log at a time, in simulated seconds; a city that runs has no other time than the present.
    pub(crate) fn seek(&self, time_s: f64) {
        if let PageOrders::Log(remote) = &self.orders
            && !remote.send(PlaybackCommand::Seek(time_s))
        {
            count(&self.counters.lost_orders, 1);
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
            self.insist(Order::Release(vehicle));
        }
    }

    /// What a guest of a page does. Only pedals may be lost: others follow.
    pub(crate) fn guest(&self, guest: u16, act: GuestAct) {
        let order = Order::Guest(guest, act);
        match act {
            GuestAct::Drive(_) => self.order(order),
            GuestAct::Join | GuestAct::Release | GuestAct::Leave => self.insist(order),
        }
    }
}

/// What an order is to a log; `None` where it is nothing.
fn playback_command(order: &Order) -> Option<PlaybackCommand> {
    match order {
        Order::Start => Some(PlaybackCommand::Play),
        Order::Pause => Some(PlaybackCommand::Pause),
        Order::Step => Some(PlaybackCommand::Step { forward: true }),
        Order::Reset => Some(PlaybackCommand::Seek(f64::NEG_INFINITY)),
        Order::Speed(Speed::Times(factor)) => Some(PlaybackCommand::Speed(*factor)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_must_not_be_lost_is_given_once_there_is_room() {
        let (sender, mut orders) = city3d_session::orders();
        let counters = Arc::<PeerCounters>::default();
        let control = Control::new(PageOrders::City(sender), Arc::clone(&counters));
        let (own, pedals) = (VehicleId(3), Pedals::default());
        control.drive(1, own, pedals);
        while counters.counts().lost_orders == 0 {
            control.order(Order::Pause);
        }
        control.guest(7, GuestAct::Join);
        for _ in 0..100 {
            control.guest(7, GuestAct::Leave);
            control.guest(7, GuestAct::Join);
            control.drive(1, own, pedals);
            control.release(1, own);
        }
        control.guest(8, GuestAct::Join);
        control.guest(8, GuestAct::Leave);
        while orders.take().is_some() {}
        control.catch_up();
        let given: Vec<Order> = std::iter::from_fn(|| orders.take()).collect();
        let guest = Order::Guest;
        let wanted = [
            guest(7, GuestAct::Leave),
            Order::Release(own),
            guest(7, GuestAct::Join),
            guest(8, GuestAct::Leave),
        ];
        assert_eq!(given, wanted);
    }
}
