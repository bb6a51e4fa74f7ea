//! One vehicle under measurement: its motion, its way through conflict and control zones, and its trip.

use super::encroachment::ZoneMove;
use super::fuel::Effort;
use super::motion::Motion;
use super::passage::{Passage, PassageMove, Stretch, stretches};
use super::place::{FreeRun, RoutePlace, Station};
use super::surrogate::Safety;
use city3d_control::coordination::ControlZone;
use city3d_control::{CavGeometry, CavSetup, DriverParams, PARKED, Route};
use city3d_geometry::{Lab, Pose2};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{LabMap, ZoneId};
use std::sync::Arc;

/// One vehicle and what has been measured of it.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Its id.
    pub id: VehicleId,
    /// Effort, stops and displacement.
    pub motion: Motion,
    /// Surrogate measures of safety.
    pub safety: Safety,
    /// Its whole way.
    pub trip: Trip,
    /// Where it is on its route; `None` off the route, and without one.
    pub station: Option<Station>,
    place: Option<RoutePlace>,
    u_max_mps2: f64,
    next_crossing: usize,
    /// Conflict zones that it is in.
    in_zones: Vec<InZone>,
    stretches: Vec<Stretch>,
    next_stretch: usize,
    /// Control zones that it is in.
    open: Vec<OpenPassage>,
    /// Time held outside that no control zone has counted yet.
    uncounted_held_s: f64,
    /// Speed at which it comes in if nobody is in the way; until it has come.
    free_entry_mps: f64,
    is_parked: bool,
}

/// A whole trip: from the first snapshot of a vehicle until it is gone or at the end of its route.
#[derive(Clone, Copy, Debug, Default)]
pub struct Trip {
    /// First snapshot.
    pub begun_s: f64,
    /// The end; `None` while it is on its way.
    pub ended_s: Option<f64>,
    /// Last snapshot.
    pub seen_s: f64,
    /// Time that it was held before it came into the city.
    pub held_s: f64,
    /// Whether it has come to the end of its route.
    pub has_arrived: bool,
    /// Whether it has left its route: its free time is unknown.
    pub has_strayed: bool,
    free: Option<FreeRun>,
    /// Free time on earlier routes.
    free_before_s: f64,
}

impl Trip {
    /// Time that the way so far takes alone; `None` where it is unknown.
    pub fn free_s(&self) -> Option<f64> {
        let free_s = self.free_before_s + self.free.map(|free| free.time_s)?;
        (!self.has_strayed).then_some(free_s)
    }

    /// Time on the way so far.
    pub fn travel_s(&self) -> f64 {
        self.ended_s.unwrap_or(self.seen_s) - self.begun_s
    }
}

/// A conflict zone that the vehicle is in.
#[derive(Clone, Copy, Debug)]
struct InZone {
    zone: ZoneId,
    side: usize,
    /// Position of the front when the rear leaves.
    until_s: f64,
}

/// A passage that goes on.
#[derive(Clone, Copy, Debug)]
struct OpenPassage {
    stretch: Stretch,
    entered_s: f64,
    held_s: f64,
    free: FreeRun,
    /// Totals at the entry.
    stops: u32,
    stood_s: f64,
    effort: Effort,
}

impl OpenPassage {
    fn passage(&self, vehicle: VehicleId, motion: &Motion, left_s: f64) -> Passage {
        Passage {
            vehicle,
            entered_s: self.entered_s,
            left_s,
            free_s: self.free.time_s,
            held_s: self.held_s,
            stops: motion.stops - self.stops,
            stood_s: motion.stood_s - self.stood_s,
            effort: motion.effort - self.effort,
        }
    }
}

/// A parked vehicle that has driven farther is one no longer, city metres: who strikes it pushes it less far.
pub(crate) const PARKED_MOVES_M: f64 = 10.0;
/// A route is at its end this close to it, laboratory metres.
const END_M: f64 = 0.1;

/// Moves of all vehicles between two samples.
#[derive(Clone, Debug, Default)]
pub struct Moves {
    /// Through conflict zones.
    pub zones: Vec<ZoneMove>,
    /// Vehicles that are first seen inside a conflict zone: zone, side.
    pub begun: Vec<(ZoneId, usize, VehicleId)>,
    /// Vehicles that no longer count in a conflict zone: zone, side.
    pub forgotten: Vec<(ZoneId, usize, VehicleId)>,
    /// Through control zones.
    pub passages: Vec<PassageMove>,
}

impl Moves {
    /// Removes all.
    pub fn clear(&mut self) {
        self.zones.clear();
        self.begun.clear();
        self.forgotten.clear();
        self.passages.clear();
    }
}

impl Tracked {
    /// A vehicle that is seen for the first time, without a route.
    pub fn new(id: VehicleId, time_s: f64) -> Self {
        Self {
            id,
            motion: Motion::default(),
            safety: Safety::default(),
            trip: Trip { begun_s: time_s, seen_s: time_s, ..Trip::default() },
            station: None,
            place: None,
            u_max_mps2: DriverParams::default().max_acceleration_mps2,
            next_crossing: 0,
            in_zones: Vec::new(),
            stretches: Vec::new(),
            next_stretch: 0,
            open: Vec::new(),
            uncounted_held_s: 0.0,
            free_entry_mps: 0.0,
            is_parked: false,
        }
    }

    /// It comes in after it was held outside for a time. Alone it would come in at a speed: what others cost it at the entry
    /// counts as delay.
    pub fn come_in(&mut self, held_s: f64, free_entry_mps: f64) {
        (self.trip.held_s, self.uncounted_held_s) = (held_s, held_s);
        self.free_entry_mps = free_entry_mps;
    }

    /// Gives it the route of its setup.
    pub fn set_up(&mut self, map: &LabMap, zones: &[ControlZone], setup: &CavSetup) {
        self.u_max_mps2 = setup.driver.max_acceleration_mps2;
        self.is_parked = setup.controller == PARKED;
        let route = Route::new(map, &setup.route, setup.body, &setup.driver);
        self.take_place(zones, RoutePlace::new(Arc::new(route), setup.body, 0));
    }

    fn take_place(&mut self, zones: &[ControlZone], place: RoutePlace) {
        self.stretches = stretches(zones, &place.route);
        self.place = Some(place);
        (self.next_crossing, self.next_stretch, self.station) = (0, 0, None);
    }

    /// Takes another route of the control framework, if it has one. A passage that goes on is aborted, and begins again
    /// where the new route is still before the conflicts.
    pub fn reroute(
        &mut self,
        zones: &[ControlZone],
        (route, body, reroutes): (&Arc<Route>, CavGeometry, u32),
        moves: &mut Moves,
    ) {
        if let Some(place) = self.place.as_mut().filter(|place| place.reroutes == reroutes) {
            place.share(route);
            return;
        }
        let time_s = self.trip.seen_s;
        self.drop_out(time_s, moves);
        self.trip.free_before_s += self.trip.free.take().map_or(0.0, |free| free.time_s);
        let route = Arc::clone(route);
        let place = match &self.place {
            Some(place) => place.rerouted(route, reroutes),
            None => RoutePlace::new(route, body, reroutes),
        };
        self.take_place(zones, place);
    }

    /// Where its route passes control zones.
    pub fn stretches(&self) -> &[Stretch] {
        &self.stretches
    }

    /// Its route, while it has one.
    pub fn route(&self) -> Option<&Route> {
        self.place.as_ref().map(|place| &*place.route)
    }

    /// Whether it is parked in the way, and nobody has driven it off: it is no traffic.
    pub fn is_obstacle(&self) -> bool {
        self.is_parked && self.motion.integral_of_speed_m.abs() < PARKED_MOVES_M
    }

    /// Whether it is on its way: in the city, not at the end of its route, and no obstacle.
    pub fn is_under_way(&self) -> bool {
        self.trip.ended_s.is_none() && !self.is_obstacle()
    }

    /// Bumpers along its route: rear, front.
    pub fn bumpers(&self) -> Option<(f64, f64)> {
        let (place, station) = (self.place.as_ref()?, self.station?);
        Some((station.front_s - place.body().length_m, station.front_s))
    }

    /// Takes its pose at the next sample.
    pub fn sample(
        &mut self,
        map: &LabMap,
        (time_s, speed_mps): (f64, f64),
        pose: &Pose2<Lab>,
        moves: &mut Moves,
    ) {
        self.trip.seen_s = time_s;
        let Some(place) = &mut self.place else { return };
        let Some(front_s) = place.front_s(map, pose) else {
            self.trip.has_strayed = true;
            self.drop_out(time_s, moves);
            self.station = None;
            return;
        };
        let now = Station { time_s, front_s, speed_mps };
        match self.station.replace(now) {
            None => self.begin(now, moves),
            Some(last) if RoutePlace::is_within_reach(last.front_s, front_s) => {
                self.advance(last, now, moves);
            }
            // Not by driving: what lies between was not driven.
            Some(_) => {
                self.trip.has_strayed = true;
                self.drop_out(time_s, moves);
                self.begin(now, moves);
            }
        }
    }

    /// First sample on a route.
    fn begin(&mut self, now: Station, moves: &mut Moves) {
        let Some(place) = &self.place else { return };
        let length_m = place.body().length_m;
        let crossings = &place.route.crossings;
        self.next_crossing = crossings.partition_point(|crossing| crossing.from_s <= now.front_s);
        for crossing in &crossings[..self.next_crossing] {
            let until_s = crossing.to_s + length_m;
            if until_s > now.front_s {
                self.in_zones.push(InZone { zone: crossing.zone, side: crossing.side, until_s });
                moves.begun.push((crossing.zone, crossing.side, self.id));
            }
        }
        let allowed_mps = place.route.speed_at(place.axle_s(now.front_s));
        let free_mps = std::mem::take(&mut self.free_entry_mps).min(allowed_mps);
        let free = Station { speed_mps: now.speed_mps.max(free_mps), ..now };
        if self.trip.ended_s.is_none() {
            self.trip.free = Some(FreeRun::new(free.front_s, free.speed_mps));
        }
        self.next_stretch = self.stretches.partition_point(|stretch| stretch.entry_s <= now.front_s);
        for index in 0..self.next_stretch {
            // Who starts in the conflicts has not come through the zone.
            if self.stretches[index].from_s > now.front_s {
                self.enter(self.stretches[index], free, moves);
            }
        }
    }

    fn advance(&mut self, last: Station, now: Station, moves: &mut Moves) {
        let Some(place) = &self.place else { return };
        let length_m = place.body().length_m;
        let id = self.id;
        while let Some(crossing) = place.route.crossings.get(self.next_crossing) {
            if crossing.from_s > now.front_s {
                break;
            }
            let time_s = last.passing(&now, crossing.from_s).time_s;
            let (zone, side) = (crossing.zone, crossing.side);
            moves.zones.push(ZoneMove { time_s, vehicle: id, zone, side, enters: true });
            self.in_zones.push(InZone { zone, side, until_s: crossing.to_s + length_m });
            self.next_crossing += 1;
        }
        self.in_zones.retain(|inside| {
            let stays = inside.until_s > now.front_s;
            if !stays {
                let time_s = last.passing(&now, inside.until_s).time_s;
                let (zone, side) = (inside.zone, inside.side);
                moves.zones.push(ZoneMove { time_s, vehicle: id, zone, side, enters: false });
            }
            stays
        });
        if let Some(free) = self.trip.free.as_mut().filter(|_| self.trip.ended_s.is_none()) {
            free.drive_to(place, self.u_max_mps2, now.front_s);
        }
        for open in &mut self.open {
            open.free.drive_to(place, self.u_max_mps2, now.front_s.min(open.stretch.to_s + length_m));
        }
        let motion = &self.motion;
        self.open.retain(|open| {
            let until_s = open.stretch.to_s + length_m;
            let stays = now.front_s < until_s;
            if !stays {
                let passage = open.passage(id, motion, last.passing(&now, until_s).time_s);
                moves.passages.push(PassageMove::Leave { zone: open.stretch.zone, passage });
            }
            stays
        });
        while let Some(&stretch) = self.stretches.get(self.next_stretch) {
            if stretch.entry_s > now.front_s {
                break;
            }
            let at = last.passing(&now, stretch.entry_s);
            self.enter(stretch, at, moves);
            self.next_stretch += 1;
        }
    }

    fn enter(&mut self, stretch: Stretch, at: Station, moves: &mut Moves) {
        let time_s = at.time_s;
        moves.passages.push(PassageMove::Enter { zone: stretch.zone, vehicle: self.id, time_s });
        self.open.push(OpenPassage {
            stretch,
            entered_s: at.time_s,
            held_s: std::mem::take(&mut self.uncounted_held_s),
            free: FreeRun::new(at.front_s, at.speed_mps),
            stops: self.motion.stops,
            stood_s: self.motion.stood_s,
            effort: self.motion.effort,
        });
    }

    /// It leaves its zones in a way that is no passage.
    fn drop_out(&mut self, time_s: f64, moves: &mut Moves) {
        let id = self.id;
        moves.forgotten.extend(self.in_zones.drain(..).map(|inside| (inside.zone, inside.side, id)));
        let aborted = self.open.drain(..);
        moves.passages.extend(aborted.map(|open| PassageMove::Abort {
            zone: open.stretch.zone,
            vehicle: id,
            time_s,
        }));
    }

    /// It stands at the end of its route.
    pub fn finish(&mut self, time_s: f64) {
        self.trip.has_arrived = true;
        self.trip.ended_s.get_or_insert(time_s);
    }

    /// It has left the city.
    pub fn go(&mut self, time_s: f64, moves: &mut Moves) {
        let at_end = |place: &RoutePlace, station: Station| station.front_s > place.route.length() - END_M;
        if self.place.as_ref().zip(self.station).is_some_and(|(place, station)| at_end(place, station)) {
            self.trip.has_arrived = true;
            for open in self.open.drain(..) {
                let passage = open.passage(self.id, &self.motion, time_s);
                moves.passages.push(PassageMove::Leave { zone: open.stretch.zone, passage });
            }
        }
        self.trip.ended_s.get_or_insert(time_s);
        self.drop_out(time_s, moves);
        (self.place, self.station) = (None, None);
        (self.stretches, self.in_zones) = (Vec::new(), Vec::new());
    }
}
