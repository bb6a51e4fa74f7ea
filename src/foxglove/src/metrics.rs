//! Metrics of a running city, as JSON.

use city3d_protocol::snapshot::Status;
use city3d_session::{RunState, Speed};
use city3d_simulation::measures::TrafficReport;
use serde_json::{Map, Value, json};

/// The value of an unlimited speed.
const UNLIMITED: f64 = 0.0;

/// A speed as a multiple of real time; 0 where it is unlimited.
pub(crate) fn speed_factor(speed: Speed) -> f64 {
    match speed {
        Speed::Times(factor) => factor,
        Speed::Unlimited => UNLIMITED,
    }
}

/// The metrics of a state.
pub(crate) fn metrics(state: &RunState, clients: u64) -> Value {
    let vehicles = &state.now.vehicles;
    let count = vehicles.len() as f64;
    let sum_mps: f64 = vehicles.iter().map(|vehicle| vehicle.speed_mps.abs()).sum();
    let with = |status: Status| vehicles.iter().filter(|vehicle| vehicle.status == status).count();
    let link = state.link.as_deref();
    let ends: Map<String, Value> = state
        .ends
        .iter()
        .map(|end| {
            let told = json!({ "delivered": end.delivered, "dropped": end.dropped, "failure": end.failure });
            (end.name.clone(), told)
        })
        .collect();
    let traffic = state.traffic.as_ref().map(|traffic| TrafficReport::of(traffic.measures()));
    json!({
        "time_s": state.now.time_s,
        "tick": state.now.tick,
        "run": state.run,
        "phase": state.phase.label(),
        "speed": speed_factor(state.speed),
        "real_time_factor": state.real_time_factor,
        "vehicles": vehicles.len(),
        "mean_speed_mps": if vehicles.is_empty() { 0.0 } else { sum_mps / count },
        "driving": with(Status::Driving),
        "yielding": with(Status::Yielding),
        "stopped": with(Status::Stopped),
        "collided": with(Status::Collided),
        "leader": link.and_then(|link| link.leader.clone()),
        "link_received_per_s": link.map(|link| link.received_per_s),
        "link_dropped": link.map(|link| link.dropped),
        "clients": clients,
        "ends": ends,
        "traffic": traffic,
    })
}

/// Their definition.
pub(crate) fn schema() -> Value {
    let number = json!({ "type": "number" });
    let mut properties = Map::new();
    for name in [
        "time_s",
        "tick",
        "run",
        "speed",
        "real_time_factor",
        "vehicles",
        "mean_speed_mps",
        "driving",
        "yielding",
        "stopped",
        "collided",
        "link_received_per_s",
        "link_dropped",
        "clients",
    ] {
        properties.insert(name.to_owned(), number.clone());
    }
    for name in ["phase", "leader"] {
        properties.insert(name.to_owned(), json!({ "type": "string" }));
    }
    for name in ["ends", "traffic"] {
        properties.insert(name.to_owned(), json!({ "type": "object" }));
    }
    json!({ "title": "city3d.Metrics", "type": "object", "properties": properties })
}
