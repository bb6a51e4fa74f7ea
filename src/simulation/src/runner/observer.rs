//! Evaluates a run: progress of each vehicle on its route, lane keeping of its outline, stops, use of the lanes, the
//! measures of traffic, and those who come and go.

use super::inflow_totals::InflowObserver;
use crate::measures::{PARKED_MOVES_M, TrafficMeasures};
use crate::scenario::{Experiment, PlannedVehicle};
use city3d_control::{Mainframe, PARKED};
use city3d_estimation::{MotionSample, StandstillChange, StandstillDetector};
use city3d_geometry::{OrientedRect, trig};
use city3d_protocol::snapshot::{
    Dimensions, Event, EventKind, FrameSnapshot, Status, VehicleId, VehicleInfo, VehicleState,
};
use city3d_roadmap::{CityMap, Lane, LaneId, ZoneKind};
use glam::DVec2;
use std::sync::Arc;

/// Totals of one vehicle over a run, full scale.
#[derive(Clone, Debug)]
pub struct VehicleTotals {
    /// Front-axle centre along the route, city metres.
    pub axle_s: f64,
    /// Mean and largest distance of the front-axle centre from the desired path.
    pub lateral_error_sum_m: f64,
    /// Largest distance of the front-axle centre from the desired path, city metres; 0 without samples.
    pub max_lateral_error_m: f64,
    /// Largest distance of the outline beyond the edges of its lane; negative when it stays inside.
    pub max_lane_excess_m: f64,
    /// How often the vehicle came to a stop.
    pub stops: u32,
    /// Longest standstill on its way, simulated seconds.
    pub longest_stand_s: f64,
    /// Collisions with vehicles and static obstacles; one between two vehicles counts for both.
    pub collisions: u32,
    /// Number of samples in the sum of lateral errors; there are none while a person drives.
    pub samples: u64,
    /// A person has driven it.
    pub driven_by_hand: bool,
    /// Odometer, also of a vehicle that has left.
    pub distance_m: f64,
    /// Simulated times at which it came to the city and was last seen there.
    pub there_s: [f64; 2],
    /// It was taken out of the city.
    pub has_left: bool,
}

impl VehicleTotals {
    /// Simulated seconds in the city.
    pub fn stay_s(&self) -> f64 {
        self.there_s[1] - self.there_s[0]
    }
}

/// Lanes that a vehicle has entered.
#[derive(Clone, Debug)]
pub struct LaneUse {
    entered: Vec<bool>,
}

impl LaneUse {
    /// Whether a vehicle has entered a lane or started on it.
    ///
    /// # Panics
    /// When the map of the observed run has no such lane.
    pub fn is_used(&self, lane: LaneId) -> bool {
        self.entered[lane.index()]
    }

    /// Lanes that no vehicle has entered.
    pub fn unused(&self) -> impl Iterator<Item = LaneId> {
        self.entered.iter().enumerate().filter(|(_, used)| !**used).map(|(index, _)| LaneId(index as u32))
    }
}

/// Evaluates the snapshots of a run.
#[derive(Clone, Debug)]
pub struct Observer {
    map: Arc<CityMap>,
    /// By lane.
    lane_bounds: Vec<LaneBounds>,
    /// In id order.
    tracks: Vec<RouteProgress>,
    /// Roster of the last snapshot.
    roster: Arc<Vec<VehicleInfo>>,
    lanes: LaneUse,
    inflows: InflowObserver,
    every_ticks: u64,
    traffic: TrafficMeasures,
}

/// Progress and totals of a vehicle.
#[derive(Clone, Debug)]
struct RouteProgress {
    id: VehicleId,
    name: String,
    /// Empty where it is unknown.
    route: Vec<LaneId>,
    /// How often the control framework has changed the route.
    reroutes: u32,
    is_parked: bool,
    /// Index of the lane under the front axle, and the arc length at which it begins.
    index: usize,
    lane_start_s: f64,
    front_axle_m: f64,
    wheelbase_m: f64,
    length_m: f64,
    width_m: f64,
    stand: StandstillDetector,
    /// Longest of the stands that have ended.
    longest_ended_s: f64,
    totals: VehicleTotals,
}

/// Bounding box of a lane's centre line and its largest half width, city metres: a bound for early rejection.
#[derive(Clone, Copy, Debug)]
struct LaneBounds {
    low: DVec2,
    high: DVec2,
    half_width_m: f64,
}

impl LaneBounds {
    fn of(lane: &Lane) -> Self {
        let mut extent =
            Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY, half_width_m: lane.width_m / 2.0 };
        for (_, point) in lane.curve.sample(EXTENT_STEP_M) {
            extent.low = extent.low.min(point.pose.position - EXTENT_STEP_M / 2.0);
            extent.high = extent.high.max(point.pose.position + EXTENT_STEP_M / 2.0);
            let half_width_m = lane.width_m / 2.0 + lane.widening(point.curvature);
            extent.half_width_m = extent.half_width_m.max(half_width_m);
        }
        extent
    }

    /// Lower bound of the distance of a point beyond the lane's edges.
    fn least_excess(&self, point: DVec2) -> f64 {
        point.distance(point.clamp(self.low, self.high)) - self.half_width_m
    }
}

/// Sampling step of centre lines, city metres; between samples a line stays within half a step.
const EXTENT_STEP_M: f64 = 0.5;

/// The widening of a tight bend tapers off within this distance after its lane, city metres: a rear axle that leaves a
/// bend is still on its inside.
const TAPER_M: f64 = 0.6;

/// Sampling rate of outlines, in simulated time.
const SAMPLES_PER_S: u32 = 20;

impl Observer {
    /// Observer of a run at its start, with the routes of the planned vehicles.
    ///
    /// # Panics
    /// When a planned vehicle has an empty route.
    pub fn new(experiment: &Experiment) -> Self {
        let mut lanes = LaneUse { entered: vec![false; experiment.city_map.lanes.len()] };
        for vehicle in &experiment.vehicles {
            lanes.entered[vehicle.route[0].index()] = true;
        }
        Self {
            map: Arc::clone(&experiment.city_map),
            lane_bounds: experiment.city_map.lanes.iter().map(LaneBounds::of).collect(),
            tracks: experiment.vehicles.iter().map(RouteProgress::planned).collect(),
            roster: Arc::default(),
            lanes,
            inflows: InflowObserver::new(experiment),
            every_ticks: u64::from((experiment.rates.physics_hz / SAMPLES_PER_S).max(1)),
            traffic: TrafficMeasures::new(experiment),
        }
    }

    /// Evaluates a snapshot, and adds the merge events, which only routes show. Without a control framework routes stay
    /// as they are.
    pub fn observe(
        &mut self,
        mainframe: Option<&Mainframe>,
        snapshot: &FrameSnapshot,
        events: &mut Vec<Event>,
    ) {
        self.traffic.observe(mainframe, snapshot);
        self.add_new_vehicles(&snapshot.roster);
        self.inflows.advance_to(snapshot);
        for cav in mainframe.into_iter().flat_map(Mainframe::cavs) {
            if let Some(track) = self.track(cav.id)
                && track.reroutes != cav.reroutes
            {
                track.reroutes = cav.reroutes;
                track.take_route(cav.route.lanes());
            }
        }
        for event in &snapshot.events {
            self.count(event);
        }
        let samples = snapshot.tick.is_multiple_of(self.every_ticks);
        for state in &snapshot.vehicles {
            let Ok(index) = self.tracks.binary_search_by_key(&state.id, |track| track.id) else {
                continue;
            };
            let track = &mut self.tracks[index];
            track.totals.distance_m = state.distance_m;
            track.totals.driven_by_hand |= state.status == Status::Manual;
            track.totals.there_s[1] = snapshot.time_s;
            track.time_stand(state, snapshot.time_s);
            if samples {
                track.sample(&self.map, &self.lane_bounds, state);
                track.advance(&self.map, state, snapshot.time_s, &mut self.lanes, events);
            }
        }
    }

    /// Adds vehicles that have joined the run.
    fn add_new_vehicles(&mut self, roster: &Arc<Vec<VehicleInfo>>) {
        if Arc::ptr_eq(&self.roster, roster) {
            return;
        }
        self.roster = Arc::clone(roster);
        for info in roster.iter() {
            if let Err(index) = self.tracks.binary_search_by_key(&info.id, |track| track.id) {
                let arrival = self.inflows.arrival(info.id, &info.name);
                if let Some(arrival) = arrival {
                    self.lanes.entered[arrival.route[0].index()] = true;
                }
                let unknown = || RouteProgress::new(info.id, &info.name, &info.dimensions);
                self.tracks.insert(index, arrival.map_or_else(unknown, RouteProgress::planned));
            }
        }
    }

    fn track(&mut self, id: VehicleId) -> Option<&mut RouteProgress> {
        let index = self.tracks.binary_search_by_key(&id, |track| track.id).ok()?;
        Some(&mut self.tracks[index])
    }

    fn count(&mut self, event: &Event) {
        match event.kind {
            EventKind::Spawn => {
                self.inflows.note_entry(event);
                if let Some(track) = self.track(event.vehicle) {
                    track.totals.there_s[0] = event.time_s;
                }
            }
            EventKind::Remove => {
                self.inflows.note_leaving(event);
                if let Some(track) = self.track(event.vehicle) {
                    track.leave();
                }
            }
            _ => {}
        }
        let mut with = |id, count: fn(&mut VehicleTotals)| {
            if let Some(track) = self.track(id) {
                count(&mut track.totals);
            }
        };
        match &event.kind {
            EventKind::Stop => with(event.vehicle, |totals| totals.stops += 1),
            EventKind::Collision { with: other } => {
                with(event.vehicle, |totals| totals.collisions += 1);
                with(*other, |totals| totals.collisions += 1);
            }
            EventKind::CollisionStatic { .. } => with(event.vehicle, |totals| totals.collisions += 1),
            _ => {}
        }
    }

    /// Id, name and totals of the vehicles, in id order.
    pub fn vehicles(&self) -> impl Iterator<Item = (VehicleId, &str, &VehicleTotals)> {
        self.tracks.iter().map(|track| (track.id, track.name.as_str(), &track.totals))
    }

    /// In id order.
    pub fn totals(&self) -> impl Iterator<Item = &VehicleTotals> {
        self.tracks.iter().map(|track| &track.totals)
    }

    /// Fuel, stops, surrogate safety, passages and delays.
    pub fn traffic(&self) -> &TrafficMeasures {
        &self.traffic
    }

    /// The inflows, and who has come by them.
    pub fn inflows(&self) -> &InflowObserver {
        &self.inflows
    }

    /// Lanes that were entered so far.
    pub fn lanes(&self) -> &LaneUse {
        &self.lanes
    }
}

impl RouteProgress {
    fn planned(vehicle: &PlannedVehicle) -> Self {
        let route = vehicle.route.clone();
        let is_parked = vehicle.controller == PARKED;
        Self { route, is_parked, ..Self::new(vehicle.id, &vehicle.name, &vehicle.spec.dimensions) }
    }

    fn new(id: VehicleId, name: &str, size: &Dimensions) -> Self {
        Self {
            id,
            name: name.to_owned(),
            route: Vec::new(),
            reroutes: 0,
            is_parked: false,
            index: 0,
            lane_start_s: 0.0,
            front_axle_m: size.front_axle_m(),
            wheelbase_m: size.wheelbase_m,
            length_m: size.length_m,
            width_m: size.width_m,
            stand: StandstillDetector::default(),
            longest_ended_s: 0.0,
            totals: VehicleTotals {
                axle_s: 0.0,
                lateral_error_sum_m: 0.0,
                max_lateral_error_m: 0.0,
                max_lane_excess_m: f64::NEG_INFINITY,
                stops: 0,
                longest_stand_s: 0.0,
                collisions: 0,
                samples: 0,
                driven_by_hand: false,
                distance_m: 0.0,
                there_s: [0.0; 2],
                has_left: false,
            },
        }
    }

    /// Takes a new route: a continuation of the present one, or one that starts at the vehicle.
    fn take_route(&mut self, lanes: &[LaneId]) {
        if self.route.is_empty() || !lanes.starts_with(&self.route[..=self.index]) {
            (self.index, self.lane_start_s) = (0, self.totals.axle_s);
        }
        self.route = lanes.to_vec();
    }

    /// Its route is of no more use.
    fn leave(&mut self) {
        self.totals.has_left = true;
        self.route = Vec::new();
        (self.index, self.stand) = (0, StandstillDetector::default());
    }

    fn time_stand(&mut self, state: &VehicleState, time_s: f64) {
        // An occlusion neither starts nor ends a stand: the true motion is unknown.
        if state.status == Status::Unseen {
            return;
        }
        // Who has arrived or collided waits for nothing, nor does who is parked.
        let is_obstacle = self.is_parked && self.totals.distance_m.abs() < PARKED_MOVES_M;
        if is_obstacle || matches!(state.status, Status::Finished | Status::Collided) {
            self.stand = StandstillDetector::default();
            return;
        }
        // As the events tell it.
        let seen = MotionSample::exact(state.speed_mps, state.position.truncate());
        if let Some(StandstillChange::MovedOff { stood_s }) = self.stand.update(time_s, &seen) {
            self.longest_ended_s = self.longest_ended_s.max(stood_s);
            self.totals.longest_stand_s = self.longest_ended_s;
        }
        if let Some(since_s) = self.stand.since_s().filter(|_| !self.stand.is_moving_off()) {
            self.totals.longest_stand_s = self.totals.longest_stand_s.max(time_s - since_s);
        }
    }

    fn sample(&mut self, map: &CityMap, lane_bounds: &[LaneBounds], state: &VehicleState) {
        if let Some(error) = state.tracked_lateral_error_m().map(f64::abs) {
            self.totals.samples += 1;
            self.totals.lateral_error_sum_m += error;
            self.totals.max_lateral_error_m = self.totals.max_lateral_error_m.max(error);
        }
        if self.route.is_empty() {
            return;
        }
        let half = DVec2::new(self.length_m, self.width_m) / 2.0;
        let outline = OrientedRect { centre: state.position.truncate(), axis: state.forward(), half };
        let rear_axle = outline.centre - outline.axis * (self.wheelbase_m / 2.0);
        let side = outline.axis.perp() * half.y;
        for point in outline.corners().into_iter().chain([rear_axle + side, rear_axle - side]) {
            let excess = self.excess(map, lane_bounds, point);
            self.totals.max_lane_excess_m = self.totals.max_lane_excess_m.max(excess);
        }
    }

    /// How far a point lies beyond the edge of the nearest lane of the route around the vehicle.
    fn excess(&self, map: &CityMap, lane_bounds: &[LaneBounds], point: DVec2) -> f64 {
        let first = self.index.saturating_sub(2);
        let last = (self.index + 2).min(self.route.len() - 1);
        let mut least = f64::INFINITY;
        // The lane under the front axle comes first, so that the bounds reject most others.
        for index in std::iter::once(self.index).chain((first..=last).filter(|k| *k != self.index)) {
            if lane_bounds[self.route[index].index()].least_excess(point) >= least {
                continue;
            }
            let lane = map.lane(self.route[index]);
            let foot = lane.curve.project(point);
            let beyond_ends_m = (trig::powi(foot.distance, 2) - trig::powi(foot.lateral, 2)).max(0.0).sqrt();
            let is_outermost =
                (index == 0 && foot.s == 0.0) || (index + 1 == self.route.len() && foot.s > 0.0);
            if beyond_ends_m > TAPER_M && !is_outermost {
                continue;
            }
            let (left, right) = lane.half_widths_at(foot.s);
            least = least.min(if foot.lateral > 0.0 { foot.lateral - left } else { -foot.lateral - right });
        }
        if least.is_finite() { least } else { 0.0 }
    }

    fn advance(
        &mut self,
        map: &CityMap,
        state: &VehicleState,
        time_s: f64,
        lanes: &mut LaneUse,
        events: &mut Vec<Event>,
    ) {
        let axle = state.position.truncate() + state.forward() * self.front_axle_m;
        while !self.route.is_empty() {
            let lane = map.lane(self.route[self.index]);
            let s = lane.curve.project(axle).s;
            self.totals.axle_s = self.lane_start_s + s;
            if s < lane.curve.length() - 1e-6 || self.index + 1 == self.route.len() {
                break;
            }
            self.lane_start_s += lane.curve.length();
            self.index += 1;
            lanes.entered[self.route[self.index].index()] = true;
            if map.zones_on(lane.id).any(|zone| zone.kind == ZoneKind::Merge) {
                events.push(Event { time_s, vehicle: state.id, kind: EventKind::Merge });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::VehicleSpec;

    #[test]
    fn a_stand_lasts_as_the_events_tell_it() {
        let mut progress = RouteProgress::new(VehicleId(1), "car", &VehicleSpec::default().dimensions);
        let mut x = 0.0;
        // It comes, stands, creeps forward below the upper threshold, stands on, and goes.
        for tick in 0..3000 {
            let time_s = f64::from(tick) * 0.01;
            let speed_mps = match time_s {
                ..5.0 => 5.0,
                12.0..12.3 => 0.3,
                20.0.. => 3.0,
                _ => 0.0,
            };
            x += speed_mps * 0.01;
            let position = glam::DVec3::new(x, 0.0, 0.0);
            let state = VehicleState { speed_mps, position, ..VehicleState::default() };
            progress.time_stand(&state, time_s);
        }
        let stood_s = progress.totals.longest_stand_s;
        assert!((stood_s - 15.0).abs() < 0.02, "a moment of creeping does not end it: {stood_s}");
    }

    #[test]
    fn who_has_arrived_stands_no_longer() {
        let mut progress = RouteProgress::new(VehicleId(1), "car", &VehicleSpec::default().dimensions);
        let mut stand = |status, until_s: f64| {
            let state = VehicleState { status, ..VehicleState::default() };
            progress.time_stand(&state, until_s);
            progress.totals.longest_stand_s
        };
        assert_eq!([stand(Status::Stopped, 1.0), stand(Status::Stopped, 4.0)], [0.0, 3.0]);
        assert_eq!([stand(Status::Finished, 5.0), stand(Status::Finished, 60.0)], [3.0, 3.0]);
        assert_eq!([stand(Status::Stopped, 70.0), stand(Status::Stopped, 71.0)], [3.0, 3.0]);
    }
}
