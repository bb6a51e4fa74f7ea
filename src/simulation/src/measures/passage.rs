//! Passages of a control zone: travel time, delay, stops, queue, throughput and order.

use super::fuel::Effort;
use city3d_control::Route;
use city3d_control::coordination::ControlZone;
use city3d_protocol::snapshot::VehicleId;

/// Where a route passes a control zone: arc lengths along the route, laboratory metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Index of the control zone.
    pub zone: usize,
    /// The entry line.
    pub entry_s: f64,
    /// Start of the first conflict.
    pub from_s: f64,
    /// End of the last conflict.
    pub to_s: f64,
}

/// Where a route passes the zones, by their entry lines: as the coordination has it.
pub fn stretches(zones: &[ControlZone], route: &Route) -> Vec<Stretch> {
    let ways = ControlZone::passages(zones, route).into_iter();
    let mut found: Vec<Stretch> = ways
        .map(|way| Stretch { zone: way.zone, entry_s: way.entry_s, from_s: way.from_s, to_s: way.to_s })
        .collect();
    found.sort_by(|a, b| a.entry_s.total_cmp(&b.entry_s).then(a.zone.cmp(&b.zone)));
    found
}

/// One passage of a control zone, from the front at the entry line to the rear behind the last conflict. Seconds, and
/// effort at full scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// Who passed.
    pub vehicle: VehicleId,
    /// When its front bumper reached the entry line, or when it was first seen beyond it.
    pub entered_s: f64,
    /// When its rear bumper left the last conflict.
    pub left_s: f64,
    /// The time that it needs alone, from the same speed at the entry line.
    pub free_s: f64,
    /// How long it was held outside before.
    pub held_s: f64,
    /// How often it came to stand inside.
    pub stops: u32,
    /// How long it stood inside.
    pub stood_s: f64,
    /// Fuel and control effort inside.
    pub effort: Effort,
}

impl Passage {
    /// Time inside.
    pub fn travel_s(&self) -> f64 {
        self.left_s - self.entered_s
    }

    /// Time lost to others: travel time less the free one, and the time held outside.
    pub fn delay_s(&self) -> f64 {
        self.travel_s() - self.free_s + self.held_s
    }
}

/// A vehicle enters a control zone, leaves it behind its last conflict, or drops out inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PassageMove {
    /// Its front is at the entry line.
    Enter {
        /// Index of the control zone.
        zone: usize,
        /// Who enters.
        vehicle: VehicleId,
        /// Simulated time.
        time_s: f64,
    },
    /// Its rear has left the last conflict.
    Leave {
        /// Index of the control zone.
        zone: usize,
        /// The whole passage.
        passage: Passage,
    },
    /// It was taken away inside, or has left its route.
    Abort {
        /// Index of the control zone.
        zone: usize,
        /// Who drops out.
        vehicle: VehicleId,
        /// Simulated time.
        time_s: f64,
    },
}

impl PassageMove {
    /// Index of the control zone.
    pub fn zone(&self) -> usize {
        match self {
            Self::Enter { zone, .. } | Self::Leave { zone, .. } | Self::Abort { zone, .. } => *zone,
        }
    }

    /// When it happened.
    pub fn time_s(&self) -> f64 {
        match self {
            Self::Enter { time_s, .. } | Self::Abort { time_s, .. } => *time_s,
            Self::Leave { passage, .. } => passage.left_s,
        }
    }
}

/// Traffic of one control zone.
#[derive(Clone, Debug, Default)]
pub struct ZoneTraffic {
    /// Complete passages, in order of their ends.
    pub passages: Vec<Passage>,
    /// Vehicles that entered.
    pub entered: u32,
    /// Vehicles that dropped out inside.
    pub aborted: u32,
    /// Pairs of vehicles that left in another order than they entered; of two that entered at the same time, as at the start
    /// of a run, neither was first.
    pub order_inversions: u32,
    /// Vehicles that stand inside or are held outside.
    pub queue: Queue,
    /// Vehicles inside, in order of entry, and when they entered.
    inside: Vec<(VehicleId, f64)>,
}

/// Length of a queue over time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Queue {
    /// Largest length.
    pub max: u32,
    /// Present length.
    pub now: u32,
    vehicle_s: f64,
    lasted_s: f64,
}

impl Queue {
    /// The queue has had this length for a time.
    pub fn add(&mut self, length: u32, dt_s: f64) {
        (self.now, self.max) = (length, self.max.max(length));
        self.vehicle_s += f64::from(length) * dt_s;
        self.lasted_s += dt_s;
    }

    /// Mean over time; 0 before the first sample.
    pub fn mean(&self) -> f64 {
        if self.lasted_s > 0.0 { self.vehicle_s / self.lasted_s } else { 0.0 }
    }
}

impl ZoneTraffic {
    /// Takes the next move in order of time.
    pub fn take(&mut self, by: &PassageMove) {
        match by {
            PassageMove::Enter { vehicle, time_s, .. } => {
                self.entered += 1;
                self.inside.push((*vehicle, *time_s));
            }
            PassageMove::Leave { passage, .. } => {
                if let Some(before) = self.remove(passage.vehicle) {
                    self.order_inversions += before;
                }
                self.passages.push(*passage);
            }
            PassageMove::Abort { vehicle, .. } => {
                self.aborted += u32::from(self.remove(*vehicle).is_some());
            }
        }
    }

    /// Takes a vehicle out; gives the number of those inside that entered before it, not at the same time.
    fn remove(&mut self, vehicle: VehicleId) -> Option<u32> {
        let at = self.inside.iter().position(|(other, _)| *other == vehicle)?;
        let (_, entered_s) = self.inside.remove(at);
        Some(self.inside.iter().filter(|(_, other_s)| *other_s < entered_s).count() as u32)
    }

    /// Vehicles inside, in order of entry.
    pub fn inside(&self) -> impl ExactSizeIterator<Item = VehicleId> {
        self.inside.iter().map(|(vehicle, _)| *vehicle)
    }

    /// Totals of the passages that began after the warm-up, `now_s` being the end of the observation.
    pub fn totals(&self, warm_up_s: f64, now_s: f64) -> PassageTotals {
        let counted = self.passages.iter().filter(|passage| passage.entered_s >= warm_up_s);
        let exits = self.passages.iter().map(|passage| passage.left_s).filter(|left_s| *left_s >= warm_up_s);
        let is_empty = self.inside.is_empty();
        PassageTotals::of(counted, throughput_per_h(exits, is_empty, now_s))
    }
}

/// Vehicles an hour: exits after the first one over the time since it, until the last one, or until now while somebody
/// is still inside. `None` with fewer than two exits.
pub fn throughput_per_h(exits: impl Iterator<Item = f64>, is_empty: bool, now_s: f64) -> Option<f64> {
    let (mut count, mut first_s, mut last_s) = (0_u32, f64::INFINITY, f64::NEG_INFINITY);
    for left_s in exits {
        (count, first_s, last_s) = (count + 1, first_s.min(left_s), last_s.max(left_s));
    }
    let until_s = if is_empty { last_s } else { now_s };
    (count > 1 && until_s > first_s).then(|| f64::from(count - 1) / (until_s - first_s) * 3600.0)
}

/// Means and totals of passages, or of whole trips.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PassageTotals {
    /// Number of passages.
    pub count: u32,
    /// Mean travel time.
    pub mean_travel_s: Option<f64>,
    /// Mean delay.
    pub mean_delay_s: Option<f64>,
    /// Largest delay.
    pub max_delay_s: Option<f64>,
    /// Total time held outside.
    pub held_s: f64,
    /// Stops, all together.
    pub stops: u32,
    /// Time stood, all together.
    pub stood_s: f64,
    /// Vehicles an hour.
    pub throughput_per_h: Option<f64>,
    /// Fuel and control effort, all together, full scale.
    pub effort: Effort,
}

impl PassageTotals {
    /// Totals of passages, with their flow.
    pub fn of<'p>(passages: impl Iterator<Item = &'p Passage>, throughput_per_h: Option<f64>) -> Self {
        let mut totals = Self { throughput_per_h, ..Self::default() };
        let (mut travel_s, mut delay_s) = (0.0, 0.0);
        for passage in passages {
            totals.count += 1;
            travel_s += passage.travel_s();
            delay_s += passage.delay_s();
            let max_s = totals.max_delay_s.map_or(passage.delay_s(), |max_s| max_s.max(passage.delay_s()));
            totals.max_delay_s = Some(max_s);
            totals.held_s += passage.held_s;
            totals.stops += passage.stops;
            totals.stood_s += passage.stood_s;
            totals.effort += passage.effort;
        }
        if totals.count > 0 {
            let count = f64::from(totals.count);
            (totals.mean_travel_s, totals.mean_delay_s) = (Some(travel_s / count), Some(delay_s / count));
        }
        totals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passage(vehicle: u32, entered_s: f64, left_s: f64) -> Passage {
        Passage {
            vehicle: VehicleId(vehicle),
            entered_s,
            left_s,
            free_s: 10.0,
            held_s: 0.5,
            stops: 1,
            stood_s: 2.0,
            effort: Effort::default(),
        }
    }

    #[test]
    fn delay_is_the_time_beyond_the_free_one_with_the_time_held_outside() {
        let mut zone = ZoneTraffic::default();
        for (vehicle, entered_s, left_s) in [(1, 0.0, 10.0), (2, 2.0, 16.0), (3, 4.0, 20.0)] {
            zone.take(&PassageMove::Enter { zone: 0, vehicle: VehicleId(vehicle), time_s: entered_s });
            zone.take(&PassageMove::Leave { zone: 0, passage: passage(vehicle, entered_s, left_s) });
        }
        let totals = zone.totals(0.0, 30.0);
        assert_eq!((totals.count, totals.stops, totals.held_s), (3, 3, 1.5));
        assert_eq!(totals.mean_travel_s, Some(40.0 / 3.0));
        assert!((totals.mean_delay_s.unwrap() - 11.5 / 3.0).abs() < 1e-12);
        assert_eq!(totals.max_delay_s, Some(6.5));
        // Two exits in the ten seconds after the first.
        assert_eq!(totals.throughput_per_h, Some(720.0));
        // After a warm-up of 3 s only the last passage counts, and the exits after it.
        assert_eq!(zone.totals(3.0, 30.0).count, 1);
    }

    #[test]
    fn a_zone_that_holds_somebody_still_counts_its_time() {
        let exits = [10.0, 20.0];
        assert_eq!(throughput_per_h(exits.into_iter(), true, 90.0), Some(360.0));
        assert_eq!(throughput_per_h(exits.into_iter(), false, 90.0), Some(45.0));
        assert_eq!(throughput_per_h([10.0].into_iter(), true, 90.0), None);
    }

    #[test]
    fn inversions_count_the_pairs_that_change_their_order() {
        let mut zone = ZoneTraffic::default();
        // The first two at the same time.
        for (vehicle, time_s) in [(1, 0.0), (2, 0.0), (3, 1.0)] {
            zone.take(&PassageMove::Enter { zone: 0, vehicle: VehicleId(vehicle), time_s });
        }
        for vehicle in [3, 2, 1] {
            zone.take(&PassageMove::Leave { zone: 0, passage: passage(vehicle, 0.0, 1.0) });
        }
        assert_eq!(zone.order_inversions, 2);
        zone.take(&PassageMove::Enter { zone: 0, vehicle: VehicleId(4), time_s: 2.0 });
        zone.take(&PassageMove::Abort { zone: 0, vehicle: VehicleId(4), time_s: 3.0 });
        assert_eq!((zone.entered, zone.aborted, zone.inside().len()), (4, 1, 0));
    }

    #[test]
    fn the_queue_is_a_mean_over_time() {
        let mut queue = Queue::default();
        queue.add(2, 1.0);
        queue.add(0, 3.0);
        assert_eq!((queue.mean(), queue.max, queue.now), (0.5, 2, 0));
    }
}
