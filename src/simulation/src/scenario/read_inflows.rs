//! `[[inflow]]`: vehicles that come to the city at an entry lane and leave it at the end of their routes.

use super::experiment::{PlannedVehicle, Start};
use super::feasibility::{can_drive, infeasibilities};
use super::fields::{TableFields, number_of, one_of};
use super::inflow::{ArrivalDraw, ArrivalProcess, Inflow, PlannedArrival, share_of};
use super::read::{FleetBuilder, MOST_SEED, ReadContext};
use super::read_settings::{HUMAN, NamedDrivers, NamedSettings};
use super::read_traffic::read_shares;
use super::read_vehicles::{LARGEST_ID, default_appearance};
use super::traffic::{TrafficShare, varied};
use super::vehicle_type::VehicleType;
use city3d_control::{DriverParams, Role};
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{Lane, LaneId, LaneKind};
use std::collections::{BTreeMap, BTreeSet};

/// Most inflows of a scenario.
const MOST_INFLOWS: usize = 1000;
/// Highest rate: no lane carries as many.
const MOST_VEH_H: f64 = 3600.0;
/// Least headway of Poisson arrivals where none is stated, if the rate permits it.
const USUAL_LEAST_HEADWAY_S: f64 = 1.0;

/// The inflows of a scenario, and the vehicles that are drawn for them.
#[derive(Default)]
pub(super) struct Demand {
    pub inflows: Vec<Inflow>,
    pub arrivals: Vec<PlannedArrival>,
}

/// A driver with its share among those of one role.
#[derive(Clone)]
struct DriverShare {
    weight: f64,
    controller: String,
    driver: DriverParams,
}

/// A destination with its share, and the way there by vehicle type.
struct WayShare {
    weight: f64,
    /// By index of the vehicle type.
    routes: Vec<Vec<LaneId>>,
}

/// What the vehicles of one inflow are drawn from.
struct Composition {
    types: Vec<TrafficShare>,
    cavs: Vec<DriverShare>,
    humans: Vec<DriverShare>,
    ways: Vec<WayShare>,
    spread: f64,
    speed_mps: Option<f64>,
    leaves: bool,
}

impl ReadContext<'_> {
    /// Reads the `[[inflow]]` tables and draws their vehicles; the ids follow those of `[[vehicle]]` and `[traffic]`.
    pub fn read_inflows(
        &self,
        root: &TableFields<'_, '_>,
        named: &NamedSettings,
        fleet: &FleetBuilder,
    ) -> Demand {
        let tables = root.tables("inflow");
        if tables.len() > MOST_INFLOWS {
            root.wrong("inflow", format!("{} inflows; at most {MOST_INFLOWS} can be used", tables.len()));
            return Demand::default();
        }
        let first_id = fleet.names.keys().next_back().map_or(1, |id| u64::from(id.0) + 1);
        let room = (LARGEST_ID + 1).saturating_sub(first_id) as usize;
        let mut demand = Demand::default();
        let (mut compositions, mut drawn) = (Vec::new(), Vec::new());
        let (mut names, mut counts) = (BTreeSet::new(), BTreeMap::<LaneId, u64>::new());
        for (index, fields) in tables.into_iter().enumerate() {
            let name = fields.string("name").map_or_else(|| format!("inflow{}", index + 1), str::to_owned);
            if !names.insert(name.clone()) {
                fields.wrong("name", format!("the name \"{name}\" is taken; choose another"));
            }
            let inflow = self.read_inflow(&fields, name);
            let mut share_cav = 1.0;
            fields.number("share_cav", 0.0..=1.0, &mut share_cav);
            let seed = fields.integer("seed", 0..=MOST_SEED).unwrap_or(self.seed);
            let composition =
                self.read_composition(&fields, named, inflow.as_ref().map(|inflow| inflow.lane));
            let Some((inflow, composition)) = inflow.zip(composition).filter(|_| root.problems.is_empty())
            else {
                fields.finish();
                continue;
            };
            self.check_feasible(&fields, &inflow, &composition, share_cav);
            let count = counts.entry(inflow.lane).or_default();
            let lane = (self.map.lane(inflow.lane).name.as_str(), *count);
            *count += 1;
            let draws = inflow.draw(seed, lane, share_cav, room + 1);
            drawn.extend(draws.into_iter().map(|draw| (draw, compositions.len())));
            if drawn.len() > room {
                let message = format!(
                    "with this inflow more than {room} vehicles arrive, and ids end at {LARGEST_ID}; lower \
                     rate_veh_h, or let it end sooner with to_s or duration_s"
                );
                fields.wrong("rate_veh_h", message);
            }
            demand.inflows.push(inflow);
            compositions.push(composition);
            fields.finish();
        }
        if !root.problems.is_empty() {
            return demand;
        }
        drawn.sort_by(|(a, one), (b, other)| a.time_s.total_cmp(&b.time_s).then(one.cmp(other)));
        let taken: BTreeSet<&str> = fleet.names.values().map(String::as_str).collect();
        for ((draw, inflow), id) in drawn.into_iter().zip(first_id as u32..) {
            let mut vehicle =
                self.arriving(&demand.inflows[inflow], &compositions[inflow], &draw, VehicleId(id));
            while taken.contains(vehicle.name.as_str()) {
                vehicle.name.push('_');
            }
            demand.arrivals.push(PlannedArrival { time_s: draw.time_s, inflow, vehicle });
        }
        demand
    }

    /// Reads where and when vehicles arrive; `None` if the entry lane is wrong.
    fn read_inflow(&self, fields: &TableFields<'_, '_>, name: String) -> Option<Inflow> {
        let lane = fields.required_string("lane", "the name of the lane where vehicles enter");
        let rate_veh_h = fields.required_number("rate_veh_h", 0.1..=MOST_VEH_H);
        let mut kind = ArrivalProcess::default();
        fields.choice("kind", &ArrivalProcess::NAMES, &mut kind);
        let mean_s = 3600.0 / rate_veh_h;
        let mut min_headway_s = USUAL_LEAST_HEADWAY_S.min(mean_s / 2.0);
        fields.number("min_headway_s", 0.0..=60.0, &mut min_headway_s);
        if min_headway_s >= mean_s {
            let message = format!(
                "min_headway_s is {min_headway_s}; {rate_veh_h} vehicles in an hour come every {mean_s:.2} s: it must \
                 be less, or the rate lower"
            );
            fields.wrong("min_headway_s", message);
        }
        let (mut from_s, mut to_s) = (0.0, self.duration_s);
        fields.number("from_s", 0.0..=86_400.0, &mut from_s);
        fields.number("to_s", 0.0..=86_400.0, &mut to_s);
        let is_stated = fields.entry("to_s").is_some();
        if to_s <= from_s && is_stated {
            fields.wrong("to_s", format!("to_s is {to_s}; it must be later than from_s, which is {from_s}"));
        }
        let name_of_lane = lane?;
        let lane = self.lane(fields, name_of_lane, &fields.span_of("lane"))?;
        if self.map.lane(lane).kind == LaneKind::Connector {
            let message =
                format!("lane \"{name_of_lane}\" crosses a junction; let vehicles enter on a lane of a road");
            fields.wrong("lane", message);
        }
        Some(Inflow { name, lane, rate_veh_h, kind, min_headway_s, from_s, to_s: to_s.min(self.duration_s) })
    }

    /// Reads what arrives and where it goes.
    fn read_composition(
        &self,
        fields: &TableFields<'_, '_>,
        named: &NamedSettings,
        lane: Option<LaneId>,
    ) -> Option<Composition> {
        let types = read_types(fields, named);
        let cavs = read_drivers(fields, "driver", &named.drivers);
        let humans = read_drivers(fields, "human_driver", &named.drivers);
        let (mut spread, mut speed_mps, mut leaves) = (0.0, f64::NAN, true);
        fields.number("spread", 0.0..=0.5, &mut spread);
        fields.number("speed_mps", 0.0..=2.0, &mut speed_mps);
        fields.boolean("leaves", &mut leaves);
        // Destinations that are missing on the map are told even where the entry is wrong.
        let ways = match lane {
            Some(lane) => self.read_ways(fields, lane, &types, cavs.first().map(|share| &share.driver)),
            None => {
                fields.entry("route");
                fields.entry("destinations");
                Vec::new()
            }
        };
        let speed_mps = Some(speed_mps).filter(|speed_mps| !speed_mps.is_nan());
        let is_whole = ![types.len(), cavs.len(), humans.len(), ways.len()].contains(&0);
        is_whole.then_some(Composition { types, cavs, humans, ways, spread, speed_mps, leaves })
    }

    /// Reads `route` or `destinations`; without both the vehicles leave at the end of the entry lane.
    fn read_ways(
        &self,
        fields: &TableFields<'_, '_>,
        entry: LaneId,
        types: &[TrafficShare],
        driver: Option<&DriverParams>,
    ) -> Vec<WayShare> {
        let destinations = self.read_destinations(fields);
        if fields.entry("route").is_some() {
            if destinations.is_some() {
                let remedy = "leave out one of them: route is one way for all, destinations are drawn";
                fields.wrong("destinations", format!("there are a route and destinations; {remedy}"));
            }
            let route = self.read_route_from(fields, entry);
            return route
                .map(|route| WayShare { weight: 1.0, routes: vec![route; types.len()] })
                .into_iter()
                .collect();
        }
        let Some(destinations) = destinations else {
            return vec![WayShare { weight: 1.0, routes: vec![vec![entry]; types.len()] }];
        };
        let way_share = |(weight, goal): &(f64, LaneId)| {
            let way = |share: &TrafficShare| self.quickest_way(entry, *goal, &share.build, driver);
            let routes: Option<Vec<_>> = types.iter().map(way).collect();
            if routes.is_none() {
                let [from, to] = [entry, *goal].map(|lane| &self.map.lane(lane).name);
                let message = format!(
                    "no way leads from lane \"{from}\" to lane \"{to}\" that all vehicles of this inflow can drive; \
                     choose another destination, or vehicles that turn tighter"
                );
                fields.wrong("destinations", message);
            }
            Some(WayShare { weight: *weight, routes: routes? })
        };
        destinations.iter().filter_map(way_share).collect()
    }

    /// Names of lanes, alike or with weights; `None` where none are asked for.
    fn read_destinations(&self, fields: &TableFields<'_, '_>) -> Option<Vec<(f64, LaneId)>> {
        let value = fields.entry("destinations")?;
        let mut found = Vec::new();
        if value.get_ref().as_table().is_some() {
            for (name, value) in fields.table("destinations")?.entries() {
                let weight = number_of(value.get_ref()).filter(|weight| *weight > 0.0);
                if weight.is_none() {
                    let name: &str = name.get_ref();
                    let message = format!("the share of \"{name}\" must be a number above 0");
                    fields.problems.add(&value.span(), message);
                }
                found.extend(weight.zip(self.lane(fields, name.get_ref(), &name.span())));
            }
        } else {
            for (name, span) in fields.strings("destinations")? {
                found.extend(self.lane(fields, name, &span).map(|lane| (1.0, lane)));
            }
        }
        if found.is_empty() && fields.problems.is_empty() {
            let remedy = "name lanes, or leave it out";
            fields.wrong("destinations", format!("destinations is empty; {remedy}"));
        }
        Some(found)
    }

    /// The way of least driving time at the speeds of a driver, over lanes that the vehicle can drive.
    fn quickest_way(
        &self,
        from: LaneId,
        to: LaneId,
        build: &VehicleType,
        driver: Option<&DriverParams>,
    ) -> Option<Vec<LaneId>> {
        let radius = build.spec.min_turn_radius();
        let usual = DriverParams::default();
        let driver = driver.unwrap_or(&usual);
        self.map.cheapest_route(from, to, |id| {
            let lane = self.map.lane(id);
            let is_open = can_drive(self.map, self.scale, radius, id);
            is_open.then(|| driving_time_s(lane, self.map.min_radius(id), driver))
        })
    }

    /// Checks each kind of vehicle once; what is wrong with several is told once.
    fn check_feasible(
        &self,
        fields: &TableFields<'_, '_>,
        inflow: &Inflow,
        composition: &Composition,
        share_cav: f64,
    ) {
        let lane = self.map.lane(inflow.lane);
        for share in &composition.types {
            let length_m = self.scale.lab_from_city(share.build.spec.dimensions.length_m);
            if lane.curve.length() < length_m + LEAST_BEHIND_BUMPER_M {
                let message = format!(
                    "lane \"{}\" is {:.3} m long, and vehicles of {length_m:.3} m cannot enter there; choose a longer lane",
                    lane.name,
                    lane.curve.length()
                );
                fields.wrong("lane", message);
                return;
            }
        }
        let roles = [(Role::Cav, share_cav > 0.0), (Role::Human, share_cav < 1.0)];
        let mut told = BTreeSet::new();
        for role in roles.into_iter().filter(|(_, is_there)| *is_there).map(|(role, _)| role) {
            let drivers = composition.drivers(role).len();
            for (kind, driver, way) in
                combinations([composition.types.len(), drivers, composition.ways.len()])
            {
                let mut vehicle = self.vehicle_of(inflow, composition, role, [kind, way, driver]);
                vehicle.name = inflow.name.clone();
                for problem in infeasibilities(self.map, self.scale, &vehicle) {
                    let field = if problem.field == "driver" && role == Role::Human {
                        "human_driver"
                    } else {
                        problem.field
                    };
                    if told.insert(field) {
                        fields.problems.add(&fields.span_of(field), problem.message);
                    }
                }
            }
        }
    }

    fn arriving(
        &self,
        inflow: &Inflow,
        composition: &Composition,
        draw: &ArrivalDraw,
        id: VehicleId,
    ) -> PlannedVehicle {
        let [kind_lot, way_lot, cav_lot, human_lot] = draw.lots;
        let kind = share_of(kind_lot, composition.types.iter().map(|share| share.weight));
        let way = share_of(way_lot, composition.ways.iter().map(|share| share.weight));
        let driver_lot = if draw.role == Role::Cav { cav_lot } else { human_lot };
        let driver = share_of(driver_lot, composition.drivers(draw.role).iter().map(|share| share.weight));
        let mut vehicle = self.vehicle_of(inflow, composition, draw.role, [kind, way, driver]);
        vehicle.id = id;
        vehicle.name = match draw.role {
            Role::Cav => format!("cav{id}"),
            Role::Human => format!("hdv{id}"),
        };
        vehicle.appearance = default_appearance(id);
        vehicle.driver = varied(&vehicle.driver, composition.spread, draw.deviations);
        vehicle.start.speed_mps = self.entry_speed(inflow, composition, &vehicle.driver);
        vehicle
    }

    /// A vehicle of an inflow without its own id, name and deviations: by the indices of type, way and driver.
    fn vehicle_of(
        &self,
        inflow: &Inflow,
        composition: &Composition,
        role: Role,
        [kind, way, driver]: [usize; 3],
    ) -> PlannedVehicle {
        let spec = composition.types[kind].build.spec.clone();
        let DriverShare { controller, driver, .. } = composition.drivers(role)[driver].clone();
        let speed_mps = self.entry_speed(inflow, composition, &driver);
        let mut vehicle = PlannedVehicle {
            id: VehicleId(0),
            name: String::new(),
            appearance: default_appearance(VehicleId(0)),
            start: Start { lane: inflow.lane, at_m: 0.0, speed_mps },
            spec,
            controller,
            driver,
            is_human: false,
            leaves: composition.leaves,
            role,
            route: composition.ways[way].routes[kind].clone(),
            sensors: Vec::new(),
            physical: None,
        };
        vehicle.start.at_m = entry_axle_m(&vehicle, self.scale);
        vehicle
    }

    fn entry_speed(&self, inflow: &Inflow, composition: &Composition, driver: &DriverParams) -> f64 {
        let limit_mps = self.map.lane(inflow.lane).speed_limit_mps;
        composition.speed_mps.unwrap_or(driver.desired_speed_mps.min(limit_mps))
    }
}

/// Space between the lane's beginning and the rear bumper of a vehicle that enters.
const LEAST_BEHIND_BUMPER_M: f64 = 0.005;

/// Front-axle position of a vehicle that enters: its rear bumper is at the beginning of the lane.
fn entry_axle_m(vehicle: &PlannedVehicle, scale: LengthScale) -> f64 {
    let body = vehicle.body_in_lab(scale);
    body.length_m - body.overhang_m() + LEAST_BEHIND_BUMPER_M
}

impl Composition {
    fn drivers(&self, role: Role) -> &[DriverShare] {
        match role {
            Role::Cav => &self.cavs,
            Role::Human => &self.humans,
        }
    }
}

/// Time over a lane at the posted speed, the desired one and that of its tightest bend.
fn driving_time_s(lane: &Lane<city3d_geometry::Lab>, min_radius_m: f64, driver: &DriverParams) -> f64 {
    let bend_mps = (driver.lateral_acceleration_mps2 * min_radius_m).sqrt();
    lane.curve.length() / lane.speed_limit_mps.min(driver.desired_speed_mps).min(bend_mps)
}

/// All triples of indices below three counts: types, drivers, ways.
fn combinations([types, drivers, ways]: [usize; 3]) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..types).flat_map(move |kind| {
        (0..drivers).flat_map(move |driver| (0..ways).map(move |way| (kind, driver, way)))
    })
}

/// Reads `type`, a vehicle type, or `types`, shares of some.
fn read_types(fields: &TableFields<'_, '_>, named: &NamedSettings) -> Vec<TrafficShare> {
    if fields.entry("type").is_none() {
        return read_shares(fields, named);
    }
    if fields.entry("types").is_some() {
        fields.wrong("types", "there are type and types; leave out one of them");
    }
    let build = super::read_settings::pick(fields, "type", &named.types);
    build.map(|build| TrafficShare { build, weight: 1.0 }).into_iter().collect()
}

/// Reads one driver by name, or shares of several: `{ calm = 0.7, hasty = 0.3 }`.
fn read_drivers(fields: &TableFields<'_, '_>, key: &'static str, named: &NamedDrivers) -> Vec<DriverShare> {
    let mut shares = Vec::new();
    let mut add = |name: &str, span: &std::ops::Range<usize>, weight: f64| {
        if name == HUMAN {
            let remedy = "choose a [driver] for it, and write vehicles for persons as [[vehicle]] tables";
            fields.problems.add(span, format!("a person cannot drive vehicles of an inflow; {remedy}"));
            return;
        }
        match named.get(name) {
            Some((controller, driver)) => {
                shares.push(DriverShare { weight, controller: controller.clone(), driver: *driver });
            }
            None => {
                let remedy = one_of(name, named.keys().map(String::as_str));
                fields.problems.add(span, format!("{key} \"{name}\" is not defined; {remedy}"));
            }
        }
    };
    let span = fields.span_of(key);
    let Some(value) = fields.entry(key) else {
        add("default", &span, 1.0);
        return shares;
    };
    if value.get_ref().as_table().is_none() {
        if let Some(name) = fields.string(key) {
            add(name, &span, 1.0);
        }
        return shares;
    }
    let Some(table) = fields.table(key) else { return shares };
    if table.entries().next().is_none() {
        fields.wrong(
            key,
            format!("{key} is empty; give it shares, such as {{ default = 1 }}, or leave it out"),
        );
    }
    for (name, value) in table.entries() {
        let name_text: &str = name.get_ref();
        match number_of(value.get_ref()).filter(|weight| *weight > 0.0) {
            Some(weight) => add(name_text, &name.span(), weight),
            None => {
                let message = format!("the share of \"{name_text}\" must be a number above 0");
                fields.problems.add(&value.span(), message);
            }
        }
    }
    shares
}
