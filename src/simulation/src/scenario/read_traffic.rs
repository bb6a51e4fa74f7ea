//! `[traffic]`: randomly drawn vehicles.

use super::experiment::{PlannedVehicle, Start};
use super::feasibility::infeasibilities;
use super::fields::{TableFields, number_of, one_of};
use super::read::{FleetBuilder, ReadContext};
use super::read_sensors::read_sensors;
use super::read_settings::{NamedSettings, is_human, pick};
use super::read_vehicles::{LARGEST_ID, MOST_VEHICLES, default_appearance};
use super::traffic::{self, TrafficError, TrafficShare, TrafficSpec};
use city3d_control::Role;
use city3d_protocol::snapshot::VehicleId;
use std::collections::BTreeSet;

impl ReadContext<'_> {
    /// Reads the `[traffic]` table and draws its vehicles; their ids follow those of the file.
    pub fn read_traffic(&self, root: &TableFields<'_, '_>, named: &NamedSettings, fleet: &mut FleetBuilder) {
        let Some(fields) = root.table("traffic") else { return };
        let first_id = fleet.names.keys().next_back().map_or(1, |id| id.0 + 1);
        fleet.places.insert(VehicleId(first_id), fields.span.clone());
        fleet.first_drawn = Some(VehicleId(first_id));
        let count = fields.integer("vehicles", 1..=MOST_VEHICLES as u64).unwrap_or(50) as usize;
        let vehicles_span = fields.span_of("vehicles");
        if u64::from(first_id) + count as u64 - 1 > LARGEST_ID {
            let message = format!(
                "the traffic's ids begin at {first_id}, after the largest of [[vehicle]], and {count} do not fit \
                 below {LARGEST_ID}; give those vehicles smaller ids"
            );
            fields.problems.add(&vehicles_span, message);
        }
        let (mut spread, mut start_speed_mps) = (0.1, 0.0);
        fields.number("spread", 0.0..=0.5, &mut spread);
        fields.number("start_speed_mps", 0.0..=1.0, &mut start_speed_mps);
        let shares = read_shares(&fields, named);
        let driver = pick(&fields, "driver", &named.drivers);
        if is_human(&fields) {
            let remedy = "choose a [driver] for it, and write vehicles for persons as [[vehicle]] tables";
            fields.wrong("driver", format!("a person cannot drive the traffic; {remedy}"));
        }
        let sensors = read_sensors(&fields, self.rates);
        let span = fields.span.clone();
        fields.finish();
        let Some((controller, driver)) = driver.filter(|_| !shares.is_empty()) else { return };
        let fastest = driver.desired_speed_mps * (1.0 + spread);
        let spec = TrafficSpec {
            vehicles: count,
            shares,
            controller,
            driver,
            spread,
            route_length_m: fastest * self.duration_s + 10.0,
        };
        let drawn = match traffic::draw(self.map, self.scale, self.seed, &spec) {
            Ok(drawn) => drawn,
            Err(error) => {
                root.problems.add(&vehicles_span, error_text(error, count));
                return;
            }
        };
        let mut is_infeasible = false;
        let taken: BTreeSet<String> = fleet.names.values().cloned().collect();
        for (drawn, id) in drawn.into_iter().zip((first_id..).map(VehicleId)) {
            let mut name = format!("cav{id}");
            while taken.contains(&name) {
                name.push('_');
            }
            let vehicle = PlannedVehicle {
                id,
                name: name.clone(),
                appearance: default_appearance(id),
                start: Start { lane: drawn.route[0], at_m: drawn.at_m, speed_mps: start_speed_mps },
                spec: drawn.build.spec,
                sensors: sensors.clone().unwrap_or(drawn.build.sensors),
                controller: spec.controller.clone(),
                driver: drawn.driver,
                is_human: false,
                leaves: false,
                role: Role::Cav,
                route: drawn.route,
                physical: None,
            };
            // One infeasible vehicle is reported per share.
            if !is_infeasible {
                for problem in infeasibilities(self.map, self.scale, &vehicle) {
                    is_infeasible = true;
                    root.problems.add(&span, problem.message);
                }
            }
            fleet.places.insert(id, span.clone());
            fleet.names.insert(id, name);
            fleet.vehicles.push(vehicle);
        }
    }
}

fn error_text(error: TrafficError, count: usize) -> String {
    match error {
        TrafficError::NoRoom { placed } => {
            format!("vehicles = {count}, and the map has room for {placed} at the start; ask for fewer")
        }
        TrafficError::NoNetwork { share } => format!(
            "type number {} in types cannot drive any closed route on this map; give it a larger \
             steering_limit_deg",
            share + 1
        ),
    }
}

/// Reads `types`, shares of vehicle types; all `default` without it.
pub(super) fn read_shares(fields: &TableFields<'_, '_>, named: &NamedSettings) -> Vec<TrafficShare> {
    let Some(table) = fields.table("types") else {
        return vec![TrafficShare { build: named.types["default"].clone(), weight: 1.0 }];
    };
    if table.entries().next().is_none() {
        fields.wrong("types", "types is empty; give it shares, such as { default = 1 }, or leave it out");
    }
    let mut shares = Vec::new();
    for (name, value) in table.entries() {
        let key: &str = name.get_ref();
        let Some(build) = named.types.get(key) else {
            let remedy = one_of(key, named.types.keys().map(String::as_str));
            fields.problems.add(&name.span(), format!("vehicle type \"{key}\" is not defined; {remedy}"));
            continue;
        };
        match number_of(value.get_ref()).filter(|weight| *weight > 0.0) {
            Some(weight) => shares.push(TrafficShare { build: build.clone(), weight }),
            None => {
                fields
                    .problems
                    .add(&value.span(), format!("the share of \"{key}\" must be a number above 0"));
            }
        }
    }
    shares
}
