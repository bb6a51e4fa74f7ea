//! `[[vehicle]]`: a vehicle with its type, driver, route and start.

use super::experiment::{Physical, PlannedVehicle, Start};
use super::feasibility::infeasibilities;
use super::fields::{TableFields, one_of};
use super::read::{FleetBuilder, ReadContext};
use super::read_sensors::read_sensors;
use super::read_settings::{NamedSettings, is_human, pick};
use super::vehicle_type::{MODELS, VehicleType};
use city3d_control::Role;
use city3d_protocol::snapshot::{Appearance, BodyType, ModelKind, VehicleId};
use city3d_roadmap::LaneId;
use std::collections::BTreeSet;
use std::ops::Range;

/// Largest id in an instance image; 0 means no vehicle.
pub const LARGEST_ID: u64 = 65_535;
/// Most vehicles of a scenario.
pub const MOST_VEHICLES: usize = 10_000;

impl ReadContext<'_> {
    /// Reads the `[[vehicle]]` tables.
    pub fn read_vehicles(&self, root: &TableFields<'_, '_>, named: &NamedSettings, fleet: &mut FleetBuilder) {
        let tables = root.tables("vehicle");
        if tables.len() > MOST_VEHICLES {
            let message = format!("{} vehicles; at most {MOST_VEHICLES} can be used", tables.len());
            root.wrong("vehicle", message);
            return;
        }
        let mut taken = BTreeSet::new();
        for (index, fields) in tables.into_iter().enumerate() {
            let id = fields.integer("id", 1..=LARGEST_ID).unwrap_or(index as u64 + 1);
            let id = VehicleId(id as u32);
            let name = fields.string("name").map_or_else(|| format!("cav{id}"), str::to_owned);
            if let Some(other) = fleet.names.get(&id) {
                fields.wrong("id", format!("vehicle id {id} is taken by \"{other}\"; choose another"));
            }
            if !taken.insert(name.clone()) {
                fields.wrong("name", format!("the name \"{name}\" is taken; choose another"));
            }
            if !is_topic_name(&name) {
                let remedy = "use at most 64 letters, digits and underscores, a letter first: it becomes \
                              part of a ROS topic";
                fields.wrong("name", format!("\"{}\" cannot be a name; {remedy}", name.escape_debug()));
            }
            fleet.places.entry(id).or_insert(fields.span.clone());
            fleet.names.entry(id).or_insert(name.clone());
            if let Some(vehicle) = self.read_vehicle(&fields, id, name, named) {
                for problem in infeasibilities(self.map, self.scale, &vehicle) {
                    fields.problems.add(&fields.span_of(problem.field), problem.message);
                }
                fleet.vehicles.push(vehicle);
            }
            fields.finish();
        }
    }

    fn read_vehicle(
        &self,
        fields: &TableFields<'_, '_>,
        id: VehicleId,
        name: String,
        named: &NamedSettings,
    ) -> Option<PlannedVehicle> {
        let appearance = self.read_appearance(fields, id);
        let build = self.read_build(fields, named);
        let physical = read_physical(fields, id, &name);
        let sensors = read_sensors(fields, self.rates);
        let driver = pick(fields, "driver", &named.drivers);
        let is_human = is_human(fields);
        let route = self.read_route(fields);
        let mut at_m = f64::NAN;
        fields.number("at_m", 0.0..=1000.0, &mut at_m);
        if at_m.is_nan() && fields.entry("at_m").is_none() {
            let meaning = "at_m is missing: where on the first lane of the route the front axle starts";
            fields.problems.add(&fields.span, format!("{meaning}, in laboratory metres"));
        }
        let mut speed_mps = 0.0;
        fields.number("speed_mps", 0.0..=2.0, &mut speed_mps);
        let mut leaves = false;
        fields.boolean("leaves", &mut leaves);
        if leaves && physical.is_some() {
            fields.wrong("leaves", "a physical vehicle stays in the laboratory: it cannot leave the city");
        }
        let (VehicleType { mut spec, sensors: usual }, (controller, driver), route) =
            (build?, driver?, route?);
        if physical.is_some() {
            spec.model = ModelKind::Measured;
        }
        let sensors = sensors.unwrap_or(usual);
        let length_m = self.map.lane(route[0]).curve.length();
        if at_m > length_m {
            let lane = &self.map.lane(route[0]).name;
            fields.wrong(
                "at_m",
                format!("at_m is {at_m}; lane \"{lane}\" is {length_m:.3} m long: start on it"),
            );
        }
        let start = Start { lane: route[0], at_m, speed_mps };
        Some(PlannedVehicle {
            id,
            name,
            appearance,
            spec,
            controller,
            driver,
            is_human,
            leaves,
            role: Role::Cav,
            route,
            start,
            sensors,
            physical,
        })
    }

    fn read_build(&self, fields: &TableFields<'_, '_>, named: &NamedSettings) -> Option<VehicleType> {
        let mut build = pick(fields, "type", &named.types)?;
        fields.choice("model", &MODELS, &mut build.spec.model);
        if let Some(model) = self.model {
            build.spec.model = model;
        }
        Some(build)
    }

    /// Route from lane names, joined by shortest paths.
    fn read_route(&self, fields: &TableFields<'_, '_>) -> Option<Vec<LaneId>> {
        let Some(names) = fields.strings("route") else {
            if fields.entry("route").is_none() {
                let meaning =
                    "route is missing: names of lanes, the first where it starts, the last where it ends";
                fields.problems.add(&fields.span, meaning);
            }
            return None;
        };
        let route = self.join(fields, &names, Vec::new())?;
        if route.is_empty() {
            fields.wrong("route", "route is empty; name at least the lane where the vehicle starts");
            return None;
        }
        Some(route)
    }

    /// Route from an entry lane over the lanes that `route` names behind it; it may name the entry itself first.
    pub(super) fn read_route_from(&self, fields: &TableFields<'_, '_>, entry: LaneId) -> Option<Vec<LaneId>> {
        let mut names = fields.strings("route")?;
        if names.first().is_some_and(|(name, _)| *name == self.map.lane(entry).name) {
            names.remove(0);
        }
        self.join(fields, &names, vec![entry])
    }

    /// Extends a route by named lanes, joined by shortest paths.
    fn join(
        &self,
        fields: &TableFields<'_, '_>,
        names: &[(&str, Range<usize>)],
        mut route: Vec<LaneId>,
    ) -> Option<Vec<LaneId>> {
        let lanes: Vec<Option<LaneId>> =
            names.iter().map(|(name, span)| self.lane(fields, name, span)).collect();
        for ((name, span), lane) in names.iter().zip(lanes) {
            let lane = lane?;
            let Some(&last) = route.last() else {
                route.push(lane);
                continue;
            };
            // Repeating a lane means a lap.
            let way = if last == lane {
                self.map.shortest_loop(lane)
            } else {
                self.map.shortest_route(last, lane, |_| true).map(|way| way[1..].to_vec())
            };
            let Some(way) = way else {
                let from = &self.map.lane(last).name;
                fields.problems.add(
                    span,
                    format!(
                        "no way leads from lane \"{from}\" to lane \"{name}\"; name lanes that lie on one way"
                    ),
                );
                return None;
            };
            route.extend(way);
        }
        Some(route)
    }

    pub(super) fn lane(
        &self,
        fields: &TableFields<'_, '_>,
        name: &str,
        span: &Range<usize>,
    ) -> Option<LaneId> {
        let lane = self.map.lane_by_name(name);
        if lane.is_none() {
            let remedy = one_of(name, self.map.lanes.iter().map(|lane| lane.name.as_str()));
            fields.problems.add(span, format!("the map has no lane \"{name}\"; {remedy}"));
        }
        lane.map(|lane| lane.id)
    }
}

/// Default address of a physical vehicle: this machine, this port plus its id.
const FIRST_PORT: u32 = 9900;

/// The link of a physical vehicle; `None` for a simulated one.
fn read_physical(fields: &TableFields<'_, '_>, id: VehicleId, name: &str) -> Option<Physical> {
    let mut is_physical = false;
    fields.choice("body", &[("virtual", false), ("physical", true)], &mut is_physical);
    let usual = || format!("127.0.0.1:{}", FIRST_PORT + id.0);
    let address = fields.string("address").map_or_else(usual, str::to_owned);
    let port = address.rsplit_once(':').and_then(|(host, port)| {
        let port = port.parse::<u16>().ok().filter(|port| *port > 0);
        port.filter(|_| !host.is_empty())
    });
    let is_stated = fields.entry("address").is_some();
    if port.is_none() && (is_physical || is_stated) {
        let key = if is_stated { "address" } else { "body" };
        fields.wrong(key, format!("address is \"{address}\"; write a UDP address as \"192.168.1.21:9901\""));
    }
    let stated = fields.string("subject");
    if stated.is_some_and(|subject| !is_topic_name(subject)) {
        let remedy =
            "use at most 64 letters, digits and underscores, a letter first: it is part of a ROS topic";
        fields.wrong("subject", format!("this cannot be a subject of motion capture; {remedy}"));
    }
    let subject = stated.unwrap_or(name).to_owned();
    is_physical.then_some(Physical { address, subject })
}

/// Bodies of vehicles that state none.
const USUAL_BODIES: [BodyType; 5] =
    [BodyType::Sedan, BodyType::Hatchback, BodyType::Suv, BodyType::Van, BodyType::Pickup];

/// Distinct colours of real cars.
const PALETTE: [[u8; 3]; 10] = [
    [178, 34, 34],
    [28, 79, 140],
    [230, 230, 226],
    [38, 40, 44],
    [222, 158, 28],
    [62, 112, 66],
    [150, 156, 162],
    [96, 48, 110],
    [206, 92, 30],
    [70, 140, 160],
];

/// Of the palette: yellow, and two blues. Sedans and hatchbacks of these colours are taxis and estates.
const TAXI_COLOUR: usize = 4;
const ESTATE_COLOURS: [usize; 2] = [1, 9];

/// Default appearance of a vehicle.
pub fn default_appearance(id: VehicleId) -> Appearance {
    let index = id.0 as usize;
    let colour = index % PALETTE.len();
    // Consecutive ids differ in both.
    let body = match (USUAL_BODIES[(index * 2 + index / PALETTE.len()) % USUAL_BODIES.len()], colour) {
        (BodyType::Sedan | BodyType::Hatchback, TAXI_COLOUR) => BodyType::Taxi,
        (BodyType::Sedan | BodyType::Hatchback, colour) if ESTATE_COLOURS.contains(&colour) => {
            BodyType::Estate
        }
        (usual, _) => usual,
    };
    Appearance { body, colour: PALETTE[colour] }
}

impl ReadContext<'_> {
    fn read_appearance(&self, fields: &TableFields<'_, '_>, id: VehicleId) -> Appearance {
        let mut appearance = default_appearance(id);
        let text = fields.entry("shape").and_then(|value| value.get_ref().as_str());
        match text.filter(|text| text.to_ascii_lowercase().ends_with(".glb")) {
            Some(file) => match self.models.own(file) {
                Ok(body) => appearance.body = body,
                Err(problem) => fields.wrong("shape", problem),
            },
            None => fields.choice("shape", &BodyType::SHIPPED, &mut appearance.body),
        }
        if let Some(text) = fields.string("colour") {
            match parse_colour(text) {
                Some(colour) => appearance.colour = colour,
                None => fields.wrong("colour", format!("colour is \"{text}\"; write it as \"#rrggbb\"")),
            }
        }
        appearance
    }
}

fn parse_colour(text: &str) -> Option<[u8; 3]> {
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii())?;
    let value = u32::from_str_radix(digits, 16).ok()?;
    let [_, red, green, blue] = value.to_be_bytes();
    Some([red, green, blue])
}

/// Whether a text is a valid part of a ROS topic.
pub fn is_topic_name(name: &str) -> bool {
    let mut characters = name.chars();
    characters.next().is_some_and(|c| c.is_ascii_alphabetic())
        && name.len() <= 64
        && characters.all(|c| c.is_ascii_alphanumeric() || c == '_')
}
