//! Measures of traffic from snapshots: fuel and effort, stops, surrogate safety, passages of control zones, delay.
//!
//! Definitions and sources: `docs/coordination.md`. Lengths and speeds are those of the laboratory, as in the control
//! framework; effort and what is reported of a run are at full scale.

mod audit;
mod encroachment;
mod fuel;
mod held;
mod motion;
mod passage;
mod place;
mod report;
mod surrogate;
mod tracked;
mod traffic_place;

pub use audit::{AuditFinding, LEAST_DISPLACEMENT_M, RATIO_TOLERANCE};
pub use encroachment::{Encroachment, PET_S};
pub use fuel::{BrakingFuel, Effort, fuel_rate_mlps};
pub use motion::{Motion, STANDS_MPS};
pub use passage::{Passage, PassageTotals, Queue, Stretch, ZoneTraffic, stretches};
pub use place::Station;
pub use report::{EffortReport, SafetyReport, TrafficReport, TravelReport, VehicleTraffic, ZoneReport};
pub use surrogate::{DRAC_MPS2, Following, Safety, TTC_S};
pub use tracked::{Tracked, Trip};
pub use traffic_place::{LaneFinder, LanePose, LeaderAhead, SIGHT_M, TrafficPlace};

use crate::scenario::Experiment;
use city3d_control::coordination::ControlZone;
use city3d_control::{CavSetup, Mainframe};
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::{EventKind, FrameSnapshot, Status, VehicleId, VehicleInfo};
use city3d_roadmap::LabMap;
use encroachment::ZoneStates;
use held::HeldOutside;
use passage::throughput_per_h;
use std::sync::Arc;
use surrogate::LaneOccupants;
use tracked::Moves;
pub(crate) use tracked::PARKED_MOVES_M;

/// Least time between two samples of positions along routes. Times of passing are interpolated between them.
const SAMPLE_S: f64 = 0.05;
/// Rounding error of times.
const ROUNDING_S: f64 = 1e-6;

/// Measures the traffic of a run from its snapshots, in order of time.
///
/// ```
/// use city3d_simulation::measures::TrafficMeasures;
/// use city3d_simulation::runner::Run;
/// use city3d_simulation::scenario::{Library, Overrides, read_experiment};
/// use std::sync::Arc;
///
/// let (text, library) = Library::scenario("straight")?;
/// let experiment = Arc::new(read_experiment("straight", &text, &library, Overrides::default())?);
/// let mut run = Run::new(Arc::clone(&experiment))?;
/// let mut measures = TrafficMeasures::new(&experiment);
/// for _ in 0..200 {
///     run.step();
///     measures.observe(Some(run.mainframe()), run.snapshot());
/// }
/// assert!(measures.effort().fuel_ml > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TrafficMeasures {
    map: Arc<LabMap>,
    scale: LengthScale,
    /// Setups of the planned vehicles, in id order.
    setups: Arc<Vec<CavSetup>>,
    held: HeldOutside,
    zones: Vec<ControlZone>,
    /// One for each of `zones`.
    traffic: Vec<ZoneTraffic>,
    /// Everybody who has been seen, in id order.
    vehicles: Vec<Tracked>,
    /// Who is in the city: index in `vehicles` of each vehicle of a snapshot.
    present: Vec<usize>,
    roster: Arc<Vec<VehicleInfo>>,
    queue: Queue,
    encroachments: Vec<Encroachment>,
    warm_up_s: f64,
    now_s: f64,
    last_sample_s: Option<f64>,
    conflict_zones: ZoneStates,
    occupants: LaneOccupants,
    moves: Moves,
    found: Vec<Encroachment>,
}

impl TrafficMeasures {
    /// Measures of a run at its start, with the control zones of the experiment.
    pub fn new(experiment: &Experiment) -> Self {
        Self::with_zones(experiment, experiment.control_zones.clone())
    }

    /// Measures of a run at its start, with other control zones.
    pub fn with_zones(experiment: &Experiment, zones: Vec<ControlZone>) -> Self {
        let mut setups = experiment.cav_setups();
        setups.sort_by_key(|setup| setup.id);
        Self {
            map: Arc::clone(&experiment.lab_map),
            scale: experiment.scale,
            setups: Arc::new(setups),
            held: HeldOutside::new(experiment),
            traffic: vec![ZoneTraffic::default(); zones.len()],
            zones,
            vehicles: Vec::new(),
            present: Vec::new(),
            roster: Arc::default(),
            queue: Queue::default(),
            encroachments: Vec::new(),
            warm_up_s: experiment.warm_up_s,
            now_s: 0.0,
            last_sample_s: None,
            conflict_zones: ZoneStates::new(experiment.lab_map.zones.len()),
            occupants: LaneOccupants::default(),
            moves: Moves::default(),
            found: Vec::new(),
        }
    }

    /// Takes the next snapshot. Without a control framework, routes stay those of the scenario.
    pub fn observe(&mut self, mainframe: Option<&Mainframe>, snapshot: &FrameSnapshot) {
        self.now_s = snapshot.time_s;
        self.moves.clear();
        self.update_roster(snapshot);
        let factor = self.scale.factor();
        for (state, &index) in snapshot.vehicles.iter().zip(&self.present) {
            self.vehicles[index].motion.observe(snapshot.time_s, state, factor);
        }
        let since_s = self.last_sample_s.map_or(f64::INFINITY, |last_s| snapshot.time_s - last_s);
        if since_s > SAMPLE_S - ROUNDING_S {
            self.last_sample_s = Some(snapshot.time_s);
            self.sample(mainframe, snapshot);
            self.measure_followers();
            let dt_s = if since_s.is_finite() { since_s } else { 0.0 };
            if snapshot.time_s >= self.warm_up_s {
                self.measure_queues(dt_s);
            }
        }
        self.take_moves();
        self.take_collisions(snapshot);
    }

    /// Vehicles that touch, also one that backs into another or has left its route: whom followers do not tell.
    fn take_collisions(&mut self, snapshot: &FrameSnapshot) {
        for event in &snapshot.events {
            let EventKind::Collision { with } = event.kind else { continue };
            for id in [event.vehicle, with] {
                if let Ok(index) = self.vehicles.binary_search_by_key(&id, |tracked| tracked.id) {
                    self.vehicles[index].safety.touch();
                }
            }
        }
    }

    /// Adds vehicles that have come, and closes the trips of those that have gone.
    fn update_roster(&mut self, snapshot: &FrameSnapshot) {
        if Arc::ptr_eq(&self.roster, &snapshot.roster) && self.present.len() == snapshot.vehicles.len() {
            return;
        }
        self.roster = Arc::clone(&snapshot.roster);
        for &index in &self.present {
            let tracked = &mut self.vehicles[index];
            if snapshot.vehicle(tracked.id).is_none() {
                tracked.go(snapshot.time_s, &mut self.moves);
            }
        }
        for state in &snapshot.vehicles {
            if let Err(index) = self.vehicles.binary_search_by_key(&state.id, |tracked| tracked.id) {
                let mut tracked = Tracked::new(state.id, snapshot.time_s);
                if let Ok(at) = self.setups.binary_search_by_key(&state.id, |setup| setup.id) {
                    tracked.set_up(&self.map, &self.zones, &self.setups[at]);
                } else if let Some(arrival) = self.held.arrival(state.id) {
                    tracked.set_up(&self.map, &self.zones, &arrival.setup);
                    tracked.come_in((snapshot.time_s - arrival.due_s).max(0.0), arrival.setup.speed_mps);
                }
                self.vehicles.insert(index, tracked);
            }
        }
        let index_of = |id| self.vehicles.binary_search_by_key(&id, |tracked: &Tracked| tracked.id);
        self.present.clear();
        self.present.extend(snapshot.vehicles.iter().filter_map(|state| index_of(state.id).ok()));
    }

    /// Takes the positions of all vehicles along their routes.
    fn sample(&mut self, mainframe: Option<&Mainframe>, snapshot: &FrameSnapshot) {
        self.occupants.clear(&self.map);
        let cavs = mainframe.map_or(&[][..], Mainframe::cavs);
        for (state, &index) in snapshot.vehicles.iter().zip(&self.present) {
            let tracked = &mut self.vehicles[index];
            if state.status == Status::Unseen {
                continue;
            }
            if let Ok(at) = cavs.binary_search_by_key(&state.id, |cav| cav.id) {
                let cav = &cavs[at];
                tracked.reroute(&self.zones, (&cav.route, cav.body, cav.reroutes), &mut self.moves);
            }
            let speed_mps = self.scale.lab_from_city(state.speed_mps);
            let pose = state.pose().to_lab(self.scale);
            tracked.sample(&self.map, (snapshot.time_s, speed_mps), &pose, &mut self.moves);
            if state.status == Status::Finished {
                tracked.finish(snapshot.time_s);
            }
            if let (Some(route), Some(bumpers)) = (tracked.route(), tracked.bumpers()) {
                self.occupants.add(index, route, bumpers, speed_mps);
            }
        }
    }

    fn measure_followers(&mut self) {
        let drac_mps2 = self.scale.lab_from_city(DRAC_MPS2);
        for &index in &self.present {
            let tracked = &self.vehicles[index];
            let Some((route, station)) = tracked.route().zip(tracked.station) else { continue };
            // An unseen vehicle keeps its last place, and measures nothing from there.
            let is_new = station.time_s == self.now_s;
            let ahead = || self.occupants.ahead(index, route, station.front_s, station.speed_mps);
            let following = if is_new { ahead() } else { None };
            self.vehicles[index].safety.follow(following, drac_mps2);
        }
    }

    fn measure_queues(&mut self, dt_s: f64) {
        let vehicles = &self.vehicles;
        let has_come = |id| vehicles.binary_search_by_key(&id, |tracked| tracked.id).is_ok();
        self.held.update(self.now_s, (&self.map, &self.zones), has_come);
        let stands = |id: &VehicleId| {
            let index = vehicles.binary_search_by_key(id, |tracked| tracked.id);
            index.is_ok_and(|index| vehicles[index].motion.stands())
        };
        for (index, zone) in self.traffic.iter_mut().enumerate() {
            let length = zone.inside().filter(|id| stands(id)).count() as u32;
            zone.queue.add(length + self.held.count(Some(index)), dt_s);
        }
        let on_the_way = self.present.iter().map(|&index| &vehicles[index]);
        let all = on_the_way.filter(|tracked| tracked.is_under_way() && tracked.motion.stands());
        self.queue.add(all.count() as u32 + self.held.count(None), dt_s);
    }

    /// Takes the moves of all vehicles in order of time.
    fn take_moves(&mut self) {
        for &(zone, side, vehicle) in &self.moves.forgotten {
            self.conflict_zones.forget(zone, side, vehicle);
        }
        for &(zone, side, vehicle) in &self.moves.begun {
            self.conflict_zones.begin_inside(zone, side, vehicle, self.now_s);
        }
        // Stable: of moves at one time, those of the smaller id come first.
        self.moves.zones.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        for by in &self.moves.zones {
            self.conflict_zones.take(by, &mut self.found);
        }
        for encroachment in self.found.drain(..) {
            let second = self.vehicles.binary_search_by_key(&encroachment.second, |tracked| tracked.id);
            if let Ok(index) = second {
                self.vehicles[index].safety.encroach(encroachment.pet_s);
            }
            if encroachment.pet_s < PET_S {
                self.encroachments.push(encroachment);
            }
        }
        self.moves.passages.sort_by(|a, b| a.time_s().total_cmp(&b.time_s()));
        for by in &self.moves.passages {
            self.traffic[by.zone()].take(by);
        }
    }

    /// Time of the last snapshot.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }

    /// Simulated time from which delay, slow stops, throughput and queues count, seconds.
    pub fn warm_up_s(&self) -> f64 {
        self.warm_up_s
    }

    /// Scale of the experiment.
    pub fn scale(&self) -> LengthScale {
        self.scale
    }

    /// Everybody who has been seen, in id order.
    pub fn vehicles(&self) -> &[Tracked] {
        &self.vehicles
    }

    /// A vehicle that has been seen.
    pub fn vehicle(&self, id: VehicleId) -> Option<&Tracked> {
        self.vehicles.binary_search_by_key(&id, |tracked| tracked.id).ok().map(|index| &self.vehicles[index])
    }

    /// The control zones with their traffic.
    pub fn zones(&self) -> impl Iterator<Item = (&ControlZone, &ZoneTraffic)> {
        self.zones.iter().zip(&self.traffic)
    }

    /// Totals of a control zone after the warm-up; `None` for an unknown name.
    pub fn zone_totals(&self, name: &str) -> Option<PassageTotals> {
        let (_, traffic) = self.zones().find(|(zone, _)| zone.name == name)?;
        Some(traffic.totals(self.warm_up_s, self.now_s))
    }

    /// Fuel and effort of all vehicles, full scale.
    pub fn effort(&self) -> Effort {
        self.vehicles.iter().fold(Effort::default(), |sum, tracked| sum + tracked.motion.effort)
    }

    /// Mean speed in the last snapshot of the vehicles on their way, full-scale m/s; `None` while there are none.
    pub fn mean_speed_now_mps(&self) -> Option<f64> {
        let under_way = self.vehicles.iter().filter(|tracked| tracked.is_under_way());
        let speeds = under_way.filter_map(|of| of.motion.speed_at(self.now_s));
        let (sum, count) = speeds.fold((0.0, 0_u32), |(sum, count), speed| (sum + speed.abs(), count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// The least favourable values of all vehicles.
    pub fn safety(&self) -> Safety {
        self.vehicles.iter().fold(Safety::default(), |worst, tracked| worst.with(&tracked.safety))
    }

    /// Post-encroachment times below [`PET_S`], in order of time.
    pub fn encroachments(&self) -> &[Encroachment] {
        &self.encroachments
    }

    /// Vehicles that wait outside now.
    pub fn held_outside(&self) -> u32 {
        self.held.count(None)
    }

    /// Vehicles that stand on their way or are held outside, all over the city.
    pub fn queue(&self) -> &Queue {
        &self.queue
    }

    /// Totals of the trips that began after the warm-up, whether they have ended or not. Vehicles that have left their
    /// routes, or have none, have no free time and do not count, nor do obstacles. A trip is complete at the end of its route.
    pub fn trips(&self) -> PassageTotals {
        let passages: Vec<Passage> = self.vehicles.iter().filter_map(|tracked| self.trip(tracked)).collect();
        let arrived = self.vehicles.iter().filter(|tracked| tracked.trip.has_arrived);
        let exits = arrived.filter_map(|tracked| tracked.trip.ended_s).filter(|s| *s >= self.warm_up_s);
        let all_gone = self.present.iter().all(|&index| self.vehicles[index].trip.ended_s.is_some());
        PassageTotals::of(passages.iter(), throughput_per_h(exits, all_gone, self.now_s))
    }

    /// A trip as a passage of the whole city; `None` during the warm-up and where the free time is unknown.
    fn trip(&self, tracked: &Tracked) -> Option<Passage> {
        let trip = &tracked.trip;
        (trip.begun_s >= self.warm_up_s && !tracked.is_obstacle()).then_some(())?;
        Some(Passage {
            vehicle: tracked.id,
            entered_s: trip.begun_s,
            left_s: trip.begun_s + trip.travel_s(),
            free_s: trip.free_s()?,
            held_s: trip.held_s,
            stops: tracked.motion.stops,
            stood_s: tracked.motion.stood_s,
            effort: tracked.motion.effort,
        })
    }
}
