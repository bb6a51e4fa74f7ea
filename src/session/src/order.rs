//! Orders: what a person or a program wants of a city that runs.

use super::Speed;
use super::playback::{MarkKind, TimelineMark};
use city3d_network::host::Host;
use city3d_protocol::snapshot::{Pedals, SimCommand, VehicleId};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::time::Duration;

/// An order to a city. Its source says whether it is carried out: a local city obeys, a served one has a leader, and
/// a city elsewhere decides for itself.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Starts the clock, or lets it go on; a failed run needs a reset first.
    Start,
    /// Stops the clock of a running city.
    Pause,
    /// One tick, then pause.
    Step,
    /// Starts the clock, and stops it once the run has come to a goal. Another order about the clock ends this one.
    RunUntil(RunGoal),
    /// Back to the initial conditions, paused; the files of the present run are finished first.
    Reset,
    /// Sets the target speed.
    Speed(Speed),
    /// A person drives a vehicle, with these pedals from the next tick on. The last ones before that tick count.
    Drive(VehicleId, Pedals),
    /// The person hands the vehicle back.
    Release(VehicleId),
    /// A guest who comes by the city's own web page, with a car of its own; the number is the page's.
    Guest(u16, GuestAct),
    /// Whether published states tell the plans of coordinated vehicles. It changes nothing in the city.
    TellPlans(bool),
    /// Whether published states tell the decisions of the control framework and the delays of its commands. It changes
    /// nothing in the city.
    TellDecisions(bool),
}

/// What a guest of the city's own web page does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GuestAct {
    /// Brings its car; where there is no room for it, the city goes on trying.
    Join,
    /// Drives its car.
    Drive(Pedals),
    /// Lets go of the wheel; the car brakes.
    Release,
    /// Takes its car away.
    Leave,
}

/// Where a run is to pause by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RunGoal {
    /// At the first tick that is not before this simulated time, seconds.
    Time(f64),
    /// At the next event of this kind; `None` for any event.
    Event(Option<MarkKind>),
}

impl RunGoal {
    /// Whether a run has come to it by a tick with these events.
    pub(crate) fn is_met(&self, time_s: f64, marks: &[TimelineMark]) -> bool {
        const ROUNDING_S: f64 = 1e-9;
        match *self {
            Self::Time(goal_s) => time_s >= goal_s - ROUNDING_S,
            Self::Event(wanted) => {
                // Of links only a lost one: lab vehicles are unseen for moments, and links come back.
                let counts = |mark: &TimelineMark| mark.what.kind() != MarkKind::Link || mark.what.is_grave();
                let is_it = |mark: &TimelineMark, wanted| mark.what.kind() == wanted && counts(mark);
                marks.iter().any(|mark| wanted.is_none_or(|wanted| is_it(mark, wanted)))
            }
        }
    }
}

impl Order {
    /// The vehicle that the order is for.
    pub fn vehicle(&self) -> Option<VehicleId> {
        match self {
            Self::Drive(vehicle, _) | Self::Release(vehicle) => Some(*vehicle),
            _ => None,
        }
    }

    /// What the order does to a vehicle, as a command of the simulation.
    pub(crate) fn vehicle_command(&self) -> Option<SimCommand> {
        match self {
            Self::Drive(vehicle, pedals) => Some(SimCommand::Drive(*vehicle, *pedals)),
            Self::Release(vehicle) => Some(SimCommand::Release(*vehicle)),
            _ => None,
        }
    }
}

/// Orders that wait at most: a second of pedals and some clicks.
const CAPACITY: usize = 256;
/// In simulated time nobody wakes the session, so it looks this often.
const SIMULATED_POLL: Duration = Duration::from_millis(10);

/// Gives orders to a session.
#[derive(Clone, Debug)]
pub struct OrderSender(SyncSender<Order>);

impl OrderSender {
    /// Gives an order without blocking; `false` where the queue is full, or the session has ended.
    pub fn send(&self, order: Order) -> bool {
        match self.0.try_send(order) {
            Ok(()) => true,
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => false,
        }
    }
}

/// The session's end of the queue.
#[derive(Debug)]
pub struct Orders {
    queue: Receiver<Order>,
    /// Came while the session waited.
    first: Option<Order>,
    /// Nobody can give orders any more.
    is_closed: bool,
}

/// A bounded queue of orders.
pub fn orders() -> (OrderSender, Orders) {
    let (sender, queue) = sync_channel(CAPACITY);
    (OrderSender(sender), Orders { queue, first: None, is_closed: false })
}

impl Orders {
    /// Waits for an order, at most so long.
    pub fn wait(&mut self, host: &Host, most: Duration) {
        if self.first.is_some() || most.is_zero() {
            return;
        }
        if self.is_closed {
            host.clock.sleep(most);
        } else if host.network.has_threads() {
            match self.queue.recv_timeout(most) {
                Ok(order) => self.first = Some(order),
                Err(RecvTimeoutError::Disconnected) => self.is_closed = true,
                Err(RecvTimeoutError::Timeout) => {}
            }
        } else {
            host.clock.sleep(most.min(SIMULATED_POLL));
        }
    }

    /// The next order, if one has come.
    pub fn take(&mut self) -> Option<Order> {
        if let Some(order) = self.first.take() {
            return Some(order);
        }
        match self.queue.try_recv() {
            Ok(order) => Some(order),
            Err(TryRecvError::Disconnected) => {
                self.is_closed = true;
                None
            }
            Err(TryRecvError::Empty) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::playback::Occurrence;
    use city3d_protocol::snapshot::EventKind;

    #[test]
    fn a_run_goes_on_to_a_lost_link_whoever_is_unseen_for_a_moment() {
        let goal = RunGoal::Event(Some(MarkKind::Link));
        let is_met = |kind| {
            let what = Occurrence::Event(kind);
            goal.is_met(1.0, &[TimelineMark { time_s: 1.0, vehicle: VehicleId(1), what }])
        };
        use EventKind::{LinkBack, LinkLost, SeenAgain, Unseen};
        assert_eq!([LinkLost, LinkBack, Unseen, SeenAgain].map(is_met), [true, false, false, false]);
    }
}
