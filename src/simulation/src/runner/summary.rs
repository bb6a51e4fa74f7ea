//! `summary.json`: the results of a run.

use super::{InflowTotals, Observer, VehicleTotals};
use crate::measures::{Tracked, TrafficReport, VehicleTraffic};
use crate::scenario::Experiment;
use city3d_control::Role;
use city3d_control::coordination::CoordinationReport;
use city3d_protocol::snapshot::{Event, FrameSnapshot, Status, VehicleId};
use city3d_protocol::wire::DropCounts;
use serde::Serialize;
use std::collections::BTreeMap;

/// One vehicle of a summary, full-scale SI units.
#[derive(Clone, Debug, Serialize)]
pub struct VehicleSummary {
    /// Name in the scenario or in the setup that came over the link.
    pub name: String,
    /// Status at the end; `Finished` for a vehicle that has left.
    pub status: Status,
    /// Odometer at the end, or when the vehicle left.
    pub distance_m: f64,
    /// It has left the city; one that arrived and stays has not.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub has_left: bool,
    /// Distance driven, divided by the simulated time in the city.
    pub mean_speed_mps: f64,
    /// How often the vehicle came to a stop.
    pub stops: u32,
    /// Longest standstill, simulated seconds.
    pub longest_stand_s: f64,
    /// `None` where the desired path is unknown.
    pub mean_lateral_error_m: Option<f64>,
    /// Largest lateral error; `None` where the desired path is unknown.
    pub max_lateral_error_m: Option<f64>,
    /// Largest distance of the outline beyond its lane's edges; negative when it stays inside.
    pub max_lane_excess_m: f64,
    /// Collisions with vehicles and static obstacles; one between two vehicles counts for both.
    pub collisions: u32,
    /// It is parked, and nobody has driven it off: it is no traffic.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_obstacle: bool,
    /// A person has driven it, at least for a while.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub driven_by_hand: bool,
    /// Delay, fuel and effort, surrogate safety; `None` for a vehicle that was never seen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub traffic: Option<VehicleTraffic>,
    /// Of a vehicle that came by an inflow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub arrival: Option<ArrivalSummary>,
}

/// How a vehicle of an inflow came and went, simulated seconds.
#[derive(Clone, Debug, Serialize)]
pub struct ArrivalSummary {
    /// Name of the inflow.
    pub inflow: String,
    /// Whether it is coordinated.
    pub role: Role,
    /// When it arrived at its entry.
    pub arrived_s: f64,
    /// How long it was held there.
    pub held_s: f64,
    /// When it entered the city.
    pub entered_s: f64,
    /// When it left; `None` while it is there.
    pub left_s: Option<f64>,
}

/// Results of a run, full-scale SI units.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Name of the experiment, from its scenario.
    pub scenario: String,
    /// SHA-256 of the scenario's text, hexadecimal: of equal texts the experiments differ by what was set otherwise alone.
    pub scenario_digest: String,
    /// Seed of the traffic and the environment.
    pub seed: u64,
    /// Environment between control framework and vehicles: `ideal`, `testbed`, or `own` for a scenario's own values.
    pub environment: &'static str,
    /// Vehicles of the laboratory are measured with noise and losses, though the environment is ideal; left out where it is false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub ideal_but_for_lab: bool,
    /// Version of City3D.
    pub version: &'static str,
    /// Simulated time at the end, seconds.
    pub simulated_s: f64,
    /// Tick at which the run was stopped before its end; `None` where it came to its end or was reset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped_at_tick: Option<u64>,
    /// The result at the end of the scenario, without its events, of a run that went on beyond it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_scenario_end: Option<Box<Self>>,
    /// Wall-clock time that the run took, seconds; in the window, only that of the simulation.
    pub wall_s: f64,
    /// Simulated seconds per wall-clock second.
    pub real_time_factor: f64,
    /// Collisions with vehicles and static obstacles; one between two vehicles counts once.
    pub collisions: usize,
    /// Digest of the final state, hexadecimal.
    pub state_hash: String,
    /// Mean over the vehicles of their mean speeds; 0 without vehicles.
    pub mean_speed_mps: f64,
    /// Delay, throughput, fuel and surrogate safety of the whole city, and of the control zones.
    pub traffic: TrafficReport,
    /// Plans in control zones and what the safety filter has done, in a run whose control framework is in this process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coordination: Option<CoordinationReport>,
    /// Lanes that no vehicle has entered.
    pub unused_lanes: Vec<String>,
    /// Events of all vehicles, tick by tick.
    pub events: Vec<Event>,
    /// By vehicle id, also those that have left.
    pub vehicles: BTreeMap<u32, VehicleSummary>,
    /// Totals of the inflows by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub inflows: BTreeMap<String, InflowTotals>,
    /// Statistics of the link, in a run that is controlled over it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub link: Option<LinkSummary>,
    /// Ends of the session by name: subscribers, ROS, pictures, a window; files where they failed.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub ends: BTreeMap<&'static str, EndSummary>,
}

/// What became of the moments of a run at one end of its session.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct EndSummary {
    /// Moments, or what they became, that have gone out.
    pub delivered: u64,
    /// Those that have not, because the end was too slow or did not work.
    pub dropped: u64,
    /// How often it stopped working.
    pub failures: u64,
    /// Why it did not work at the end of the run, as a sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

/// Statistics of the laboratory's link.
#[derive(Clone, Debug, Default, Serialize)]
pub struct LinkSummary {
    /// Received datagrams.
    pub received: u64,
    /// Received datagrams that passed all checks.
    pub used: u64,
    /// Datagrams lost on their way, by the gaps in the sequence numbers.
    pub missing: u64,
    /// Dropped datagrams, trajectories and requests, by reason.
    pub dropped: DropCounts,
    /// Simulated seconds that were skipped because the simulation fell behind real time.
    pub time_skipped_s: f64,
    /// How late its ticks began; `None` where no clock paces it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tick_lateness: Option<TickLateness>,
    /// Statistics of ROS, where it is used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ros: Option<RosSummary>,
}

/// How late the ticks of a run began behind the clock that paces it, wall-clock milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TickLateness {
    /// Number of ticks.
    pub ticks: u64,
    /// Median.
    pub p50_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
    /// Most.
    pub max_ms: f64,
}

/// Statistics of poses over ROS.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct RosSummary {
    /// Instants whose poses were published.
    pub published: u64,
    /// Instants that were dropped because ROS fell behind.
    pub dropped: u64,
    /// Messages that were dropped for subscribers that were too slow.
    pub dropped_for_slow: u64,
    /// Received poses.
    pub heard: u64,
    /// Received messages that hold no pose on the floor.
    pub invalid: u64,
    /// Received poses that were dropped because their stamps were later than now.
    pub ahead: u64,
    /// Whether the topics were registered at the end, and how often the connection was restored.
    pub master_is_there: bool,
    /// How often the connection to the ROS master was restored.
    pub master_returns: u64,
    /// Onboard pictures, where they are published.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pictures: Option<PicturesSummary>,
}

/// Statistics of onboard pictures.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct PicturesSummary {
    /// Pictures that were published over ROS.
    pub published: u64,
    /// Pictures that were due and were not published, because drawing or ROS fell behind.
    pub dropped: u64,
}

impl Summary {
    /// Removes what poses alone do not show.
    #[must_use]
    pub fn of_poses(mut self) -> Self {
        for vehicle in self.vehicles.values_mut() {
            (vehicle.mean_lateral_error_m, vehicle.max_lateral_error_m) = (None, None);
        }
        self.at_scenario_end = self.at_scenario_end.map(|summary| Box::new(summary.of_poses()));
        self
    }

    /// Summary of a run that took `wall_s` wall-clock seconds and ended with `last`, without a link.
    pub fn new(
        experiment: &Experiment,
        observer: &Observer,
        last: &FrameSnapshot,
        events: Vec<Event>,
        wall_s: f64,
    ) -> Self {
        let simulated_s = last.time_s;
        let mut vehicles = BTreeMap::new();
        for (id, name, totals) in observer.vehicles() {
            let state = last.vehicle(id);
            let had_path = totals.samples > 0;
            let distance_m = state.map_or(totals.distance_m, |state| state.distance_m);
            let until_s = if state.is_some() { simulated_s } else { totals.there_s[1] };
            let summary = VehicleSummary {
                name: name.to_owned(),
                status: state.map_or(Status::Finished, |state| state.status),
                distance_m,
                has_left: state.is_none(),
                mean_speed_mps: distance_m / (until_s - totals.there_s[0]).max(1e-9),
                stops: totals.stops,
                longest_stand_s: totals.longest_stand_s,
                mean_lateral_error_m: had_path.then(|| totals.lateral_error_sum_m / totals.samples as f64),
                max_lateral_error_m: had_path.then_some(totals.max_lateral_error_m),
                max_lane_excess_m: Some(totals.max_lane_excess_m)
                    .filter(|excess_m| excess_m.is_finite())
                    .unwrap_or(0.0),
                collisions: totals.collisions,
                is_obstacle: observer.traffic().vehicle(id).is_some_and(Tracked::is_obstacle),
                driven_by_hand: totals.driven_by_hand,
                traffic: observer
                    .traffic()
                    .vehicle(id)
                    .map(|tracked| VehicleTraffic::of(tracked, experiment.scale)),
                arrival: arrival_of(observer, id, totals),
            };
            vehicles.insert(id.0, summary);
        }
        let lanes = observer.lanes().unused().map(|lane| experiment.city_map.lane(lane).name.clone());
        // An empty sum of floats is -0.
        let mean = |of: fn(&VehicleSummary) -> f64| {
            let drivers = || vehicles.values().filter(|vehicle| !vehicle.is_obstacle);
            let sum = drivers().fold(0.0, |sum, vehicle| sum + of(vehicle));
            sum / drivers().count().max(1) as f64
        };
        Self {
            scenario: experiment.name.clone(),
            scenario_digest: experiment.text_digest(),
            seed: experiment.seed,
            environment: experiment.environment_name(),
            ideal_but_for_lab: experiment.is_ideal_but_for_lab(),
            version: env!("CARGO_PKG_VERSION"),
            simulated_s,
            stopped_at_tick: None,
            at_scenario_end: None,
            wall_s,
            real_time_factor: simulated_s / wall_s.max(1e-9),
            collisions: events.iter().filter(|event| event.kind.is_collision()).count(),
            state_hash: format!("{:016x}", last.state_hash),
            mean_speed_mps: mean(|vehicle| vehicle.mean_speed_mps),
            traffic: TrafficReport::of(observer.traffic()),
            coordination: None,
            unused_lanes: lanes.collect(),
            events,
            vehicles,
            inflows: observer
                .inflows()
                .totals()
                .into_iter()
                .map(|(name, of)| (name.to_owned(), of))
                .collect(),
            link: None,
            ends: BTreeMap::new(),
        }
    }
}

fn arrival_of(observer: &Observer, id: VehicleId, totals: &VehicleTotals) -> Option<ArrivalSummary> {
    let inflows = observer.inflows();
    let (arrival, held_s) = (inflows.planned(id)?, inflows.held_s(id)?);
    Some(ArrivalSummary {
        inflow: inflows.name(arrival.inflow).to_owned(),
        role: arrival.vehicle.role,
        arrived_s: arrival.time_s,
        held_s,
        entered_s: totals.there_s[0],
        left_s: totals.has_left.then_some(totals.there_s[1]),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Library, Overrides, read_experiment};

    #[test]
    fn a_city_that_nobody_has_driven_in_has_no_speed_below_nothing() {
        let (text, library) = Library::scenario("straight").unwrap();
        let mut experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
        experiment.vehicles.clear();
        let observer = Observer::new(&experiment);
        let summary = Summary::new(&experiment, &observer, &FrameSnapshot::default(), Vec::new(), 1.0);
        assert_eq!(format!("{:.2}", summary.mean_speed_mps), "0.00");
    }
}
