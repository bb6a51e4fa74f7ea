//! Measures of a run as they stand in its summary: full-scale SI units.

use super::{Effort, Passage, PassageTotals, Queue, Safety, Tracked, TrafficMeasures};
use city3d_geometry::LengthScale;
use serde::Serialize;
use std::collections::BTreeMap;

/// Measures of the whole city.
#[derive(Clone, Debug, Serialize)]
pub struct TrafficReport {
    /// Vehicles that were in the city.
    pub vehicles: usize,
    /// Vehicles that came to the end of their routes.
    pub arrived: usize,
    /// Vehicles that were still held outside at the end.
    pub waiting: u32,
    /// Whole trips, also those that go on at the end of the run.
    #[serde(flatten)]
    pub trips: TravelReport,
    /// Fuel and effort, all together.
    #[serde(flatten)]
    pub effort: EffortReport,
    /// Surrogate safety, the worst of all.
    #[serde(flatten)]
    pub safety: SafetyReport,
    /// Passages of the control zones by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub zones: BTreeMap<String, ZoneReport>,
}

/// Passages of a control zone, or whole trips.
#[derive(Clone, Debug, Serialize)]
pub struct TravelReport {
    /// Mean travel time; `None` without a passage.
    pub mean_travel_s: Option<f64>,
    /// Mean delay with the time held outside.
    pub mean_delay_s: Option<f64>,
    /// Largest delay.
    pub max_delay_s: Option<f64>,
    /// Time held outside, all together.
    pub held_s: f64,
    /// Vehicles an hour at the exit.
    pub throughput_per_h: Option<f64>,
    /// Stops below 0.02 m/s in the laboratory.
    pub stops: u32,
    /// Time stood, all together.
    pub stood_s: f64,
    /// Mean over time of the number of vehicles that stand.
    pub mean_queue: f64,
    /// Largest number of vehicles that stood at a time.
    pub max_queue: u32,
}

/// Fuel and control effort.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct EffortReport {
    /// Without fuel while braking.
    pub fuel_ml: f64,
    /// With the term of the speed while braking.
    pub fuel_with_cruise_ml: f64,
    /// Integral of the squared acceleration.
    pub int_u2_m2ps3: f64,
}

/// Surrogate measures of safety.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SafetyReport {
    /// Least time to collision with a leader; 0 where vehicles touched.
    pub min_ttc_s: Option<f64>,
    /// Encounters with a time to collision below 3 s.
    pub ttc_encounters: u32,
    /// Largest deceleration to avoid a crash; `None` where vehicles touched.
    pub max_drac_mps2: Option<f64>,
    /// Encounters with a deceleration to avoid a crash above 3 m/s2.
    pub drac_encounters: u32,
    /// Least gap to a leader; at most 0 where vehicles touched, from whatever side.
    pub min_gap_m: Option<f64>,
    /// Least post-encroachment time.
    pub min_pet_s: Option<f64>,
    /// Encounters with a post-encroachment time below 2 s.
    pub pet_encounters: u32,
}

/// One control zone.
#[derive(Clone, Debug, Serialize)]
pub struct ZoneReport {
    /// Vehicles that entered.
    pub entered: u32,
    /// Vehicles that left behind the last conflict.
    pub left: usize,
    /// Vehicles that dropped out inside.
    pub aborted: u32,
    /// Passages after the warm-up.
    #[serde(flatten)]
    pub travel: TravelReport,
    /// Fuel and effort of these passages.
    #[serde(flatten)]
    pub effort: EffortReport,
    /// Pairs that left in another order than they entered.
    pub order_inversions: u32,
    /// Each passage, in order of the exits.
    pub passages: Vec<PassageReport>,
}

/// One passage of a control zone.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PassageReport {
    /// Id of the vehicle.
    pub vehicle: u32,
    /// When its front reached the entry line.
    pub entered_s: f64,
    /// When its rear left the last conflict.
    pub left_s: f64,
    /// Time that it needs alone.
    pub free_s: f64,
    /// Delay with the time held outside.
    pub delay_s: f64,
    /// Stops inside.
    pub stops: u32,
    /// Time stood inside.
    pub stood_s: f64,
}

/// Measures of one vehicle.
#[derive(Clone, Debug, Serialize)]
pub struct VehicleTraffic {
    /// From its first snapshot until it arrived or was gone.
    pub travel_s: f64,
    /// Delay on the way so far; `None` where the free time is unknown.
    pub delay_s: Option<f64>,
    /// Stops below 0.02 m/s in the laboratory.
    pub slow_stops: u32,
    /// Time stood.
    pub stood_s: f64,
    /// Fuel and effort.
    #[serde(flatten)]
    pub effort: EffortReport,
    /// Surrogate safety towards the vehicles ahead, and as the second one in conflict zones.
    #[serde(flatten)]
    pub safety: SafetyReport,
}

/// Rounds to six decimals, so that the file stays short.
fn short(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

impl TrafficReport {
    /// Report of all that was measured.
    pub fn of(measures: &TrafficMeasures) -> Self {
        let zones = measures.zones().map(|(zone, traffic)| {
            let totals = traffic.totals(measures.warm_up_s, measures.now_s);
            let report = ZoneReport {
                entered: traffic.entered,
                left: traffic.passages.len(),
                aborted: traffic.aborted,
                travel: TravelReport::of(&totals, &traffic.queue),
                effort: EffortReport::of(totals.effort),
                order_inversions: traffic.order_inversions,
                passages: traffic.passages.iter().map(PassageReport::of).collect(),
            };
            (zone.name.clone(), report)
        });
        Self {
            vehicles: measures.vehicles.len(),
            arrived: measures.vehicles.iter().filter(|tracked| tracked.trip.has_arrived).count(),
            waiting: measures.held_outside(),
            trips: TravelReport::of(&measures.trips(), &measures.queue),
            effort: EffortReport::of(measures.effort()),
            safety: SafetyReport::of(&measures.safety(), measures.scale),
            zones: zones.collect(),
        }
    }
}

impl TravelReport {
    fn of(totals: &PassageTotals, queue: &Queue) -> Self {
        Self {
            mean_travel_s: totals.mean_travel_s.map(short),
            mean_delay_s: totals.mean_delay_s.map(short),
            max_delay_s: totals.max_delay_s.map(short),
            held_s: short(totals.held_s),
            throughput_per_h: totals.throughput_per_h.map(short),
            stops: totals.stops,
            stood_s: short(totals.stood_s),
            mean_queue: short(queue.mean()),
            max_queue: queue.max,
        }
    }
}

impl EffortReport {
    fn of(effort: Effort) -> Self {
        Self {
            fuel_ml: short(effort.fuel_ml),
            fuel_with_cruise_ml: short(effort.fuel_with_cruise_ml),
            int_u2_m2ps3: short(effort.int_u2_m2ps3),
        }
    }
}

impl SafetyReport {
    fn of(safety: &Safety, scale: LengthScale) -> Self {
        let city = |lab| short(scale.city_from_lab(lab));
        Self {
            min_ttc_s: safety.min_ttc_s.map(short),
            ttc_encounters: safety.ttc_encounters,
            max_drac_mps2: Some(city(safety.max_drac_mps2)).filter(|drac| drac.is_finite()),
            drac_encounters: safety.drac_encounters,
            min_gap_m: safety.min_gap_m.map(city),
            min_pet_s: safety.min_pet_s.map(short),
            pet_encounters: safety.pet_encounters,
        }
    }
}

impl PassageReport {
    fn of(passage: &Passage) -> Self {
        Self {
            vehicle: passage.vehicle.0,
            entered_s: short(passage.entered_s),
            left_s: short(passage.left_s),
            free_s: short(passage.free_s),
            delay_s: short(passage.delay_s()),
            stops: passage.stops,
            stood_s: short(passage.stood_s),
        }
    }
}

impl VehicleTraffic {
    /// Report of one vehicle.
    pub fn of(tracked: &Tracked, scale: LengthScale) -> Self {
        let trip = &tracked.trip;
        Self {
            travel_s: short(trip.travel_s()),
            delay_s: trip.free_s().map(|free_s| short(trip.travel_s() - free_s + trip.held_s)),
            slow_stops: tracked.motion.stops,
            stood_s: short(tracked.motion.stood_s),
            effort: EffortReport::of(tracked.motion.effort),
            safety: SafetyReport::of(&tracked.safety, scale),
        }
    }
}
