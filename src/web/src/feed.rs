//! What all pages are told: JSON texts made once from the latest published state, however many pages there are. A page
//! that is slow misses states; it never finds them queued.

use city3d_protocol::snapshot::{VehicleId, VehicleInfo};
use city3d_session::playback::{Playhead, TimelineMark};
use city3d_session::{EventReader, LinkStatus, RunState, Speed};
use city3d_simulation::scenario::Experiment;
use serde_json::{Value, json};
use std::sync::Arc;

/// Most events that a page is told of a city that runs, the latest ones.
const MAX_EVENTS: usize = 200;
/// Most events of a log, the first ones.
const MAX_LOG_EVENTS: usize = 2000;
/// Distance between points of a lane, city metres.
const LANE_STEP_M: f64 = 3.0;

/// A text with a number that changes whenever the text does.
#[derive(Clone, Debug, Default)]
pub(crate) struct Versioned {
    pub version: u64,
    pub text: Arc<str>,
}

impl Versioned {
    fn renew(&mut self, value: &Value) {
        *self = Self { version: self.version + 1, text: value.to_string().into() };
    }
}

/// What pages are told at one time.
#[derive(Clone, Debug, Default)]
pub(crate) struct Told {
    pub roster: Versioned,
    pub events: Versioned,
    pub state: Versioned,
    /// The link of the city, where it has one.
    pub link: Option<Arc<LinkStatus>>,
}

impl Told {
    /// The car of a guest of a page.
    pub(crate) fn car_of(&self, guest: u16) -> Option<VehicleId> {
        let guests = self.link.as_ref()?.page_guests.as_ref()?;
        guests.iter().find(|known| known.number == guest)?.vehicle
    }
}

/// Makes texts of states.
#[derive(Debug, Default)]
pub(crate) struct Feed {
    told: Told,
    events: EventReader,
    run: u32,
    roster: Arc<Vec<VehicleInfo>>,
}

impl Feed {
    /// The texts of a state; of a log with its playhead.
    pub(crate) fn tell(&mut self, state: &RunState, pages: u64, head: Option<Playhead>) -> Told {
        if self.told.roster.version == 0 || *self.roster != *state.now.roster {
            self.roster = Arc::clone(&state.now.roster);
            self.told.roster.renew(&roster(&self.roster));
        }
        let known = self.events.read(&state.events);
        let is_other_run = self.run != state.run;
        self.run = state.run;
        if self.told.events.version == 0 || is_other_run || known != self.events.marks().len() {
            let marks = self.events.marks();
            let told = match head {
                None => &marks[marks.len().saturating_sub(MAX_EVENTS)..],
                Some(_) => &marks[..marks.len().min(MAX_LOG_EVENTS)],
            };
            self.told.events.renew(&events(told, marks.len()));
        }
        self.told.state.renew(&run_state(state, pages, head));
        self.told.link.clone_from(&state.link);
        self.told.clone()
    }
}

fn rounded(value: f64, digits: i32) -> f64 {
    let factor = f64::from(10_u32.pow(digits.unsigned_abs()));
    if value.is_finite() { (value * factor).round() / factor } else { 0.0 }
}

/// The roads, which do not change: name of the scenario and centre lines of the lanes.
pub(crate) fn map(experiment: &Experiment) -> String {
    let lanes: Vec<Value> = experiment
        .city_map
        .lanes
        .iter()
        .map(|lane| {
            let points: Vec<f64> = lane
                .curve
                .sample(LANE_STEP_M)
                .iter()
                .flat_map(|(_, point)| [rounded(point.pose.position.x, 2), rounded(point.pose.position.y, 2)])
                .collect();
            json!({ "w": rounded(lane.width_m, 2), "p": points })
        })
        .collect();
    let [low, high] = experiment.city_map.bounds();
    json!({ "t": "map", "scenario": experiment.name, "scale": experiment.scale.factor(), "lanes": lanes,
        "bounds": [low.x, low.y, high.x, high.y] })
    .to_string()
}

fn roster(infos: &[VehicleInfo]) -> Value {
    let vehicles: Vec<Value> = infos
        .iter()
        .map(|info| {
            let size = &info.dimensions;
            json!([info.id.0, info.name, rounded(size.length_m, 2), rounded(size.width_m, 2), info.model])
        })
        .collect();
    json!({ "t": "roster", "vehicles": vehicles })
}

fn events(marks: &[TimelineMark], count: usize) -> Value {
    let listed: Vec<Value> = marks
        .iter()
        .map(|mark| json!([rounded(mark.time_s, 2), mark.vehicle.0, mark.what.label()]))
        .collect();
    json!({ "t": "events", "count": count, "events": listed })
}

fn run_state(state: &RunState, pages: u64, head: Option<Playhead>) -> Value {
    let vehicles: Vec<Value> = state
        .now
        .vehicles
        .iter()
        .map(|vehicle| {
            let pose = vehicle.pose();
            json!([
                vehicle.id.0,
                rounded(pose.position.x, 2),
                rounded(pose.position.y, 2),
                rounded(pose.yaw_rad, 3),
                rounded(vehicle.speed_mps, 2),
                vehicle.status.label(),
                rounded(vehicle.steering_rad, 3),
                rounded(vehicle.gas, 2),
                rounded(vehicle.brake, 2),
                rounded(vehicle.handbrake, 2)
            ])
        })
        .collect();
    let speed = match state.speed {
        Speed::Times(factor) => json!(rounded(factor, 2)),
        Speed::Unlimited => json!("fastest"),
    };
    let ends: Vec<Value> =
        state.ends.iter().map(|end| json!([end.name, end.delivered, end.dropped, end.failure])).collect();
    let link = state.link.as_ref();
    let guests = link.and_then(|link| link.page_guests.as_ref()).map(|guests| {
        guests
            .iter()
            .map(|guest| json!([guest.number, guest.vehicle.map(|vehicle| vehicle.0), guest.trouble]))
            .collect::<Vec<_>>()
    });
    let log = head.map(|head| json!([rounded(head.from_s, 2), rounded(head.to_s, 2), rounded(head.at_s, 2)]));
    json!({ "t": "state", "run": state.run, "tick": state.now.tick, "time": rounded(state.now.time_s, 2),
        "phase": state.phase.label(), "speed": speed, "rate": rounded(state.real_time_factor, 2),
        "refusal": state.refusal.as_ref().map(|(count, why)| json!([count, &**why])),
        "leader": link.and_then(|link| link.leader.clone()),
        "link_dropped": link.map(|link| link.dropped), "keeps_speed": link.is_some(),
        "guests": guests, "log": log, "ended": state.has_ended, "pages": pages, "ends": ends, "vehicles": vehicles })
}
