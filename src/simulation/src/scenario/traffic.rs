//! Random traffic: seeded starts and routes all over the map.

use super::feasibility::can_drive;
use super::inflow::uniform;
use super::vehicle_type::VehicleType;
use city3d_control::DriverParams;
use city3d_geometry::{Lab, LengthScale};
use city3d_roadmap::{LabMap, Lane, LaneId, LaneKind, ZoneKind};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A share of the traffic with a common vehicle type.
#[derive(Clone, Debug)]
pub struct TrafficShare {
    /// Vehicle type of the share.
    pub build: VehicleType,
    /// Size of the share relative to the weights of the others, above 0.
    pub weight: f64,
}

/// What the random traffic of a scenario is drawn from.
#[derive(Clone, Debug)]
pub struct TrafficSpec {
    /// Number of vehicles.
    pub vehicles: usize,
    /// One at least.
    pub shares: Vec<TrafficShare>,
    /// Name of the control algorithm of all vehicles.
    pub controller: String,
    /// Parameters before they vary, laboratory units.
    pub driver: DriverParams,
    /// Driver parameters vary uniformly by up to this share.
    pub spread: f64,
    /// Least route length, laboratory metres.
    pub route_length_m: f64,
}

/// A randomly drawn vehicle.
#[derive(Clone, Debug)]
pub struct SampledVehicle {
    /// Vehicle type of its share.
    pub build: VehicleType,
    /// Parameters as drawn, laboratory units.
    pub driver: DriverParams,
    /// Successive lanes from the lane of the start.
    pub route: Vec<LaneId>,
    /// Front-axle centre along the first lane, laboratory metres.
    pub at_m: f64,
}

/// Spacings of start positions on one lane, laboratory metres: the first one with enough positions is used.
const START_SPACINGS_M: [f64; 3] = [0.45, 0.36, 0.28];
/// Distance of start positions from the lane ends.
const START_FROM_BEGIN_M: f64 = 0.22;
const START_FROM_END_M: f64 = 0.30;

/// Draws the vehicles with a seeded generator.
///
/// # Errors
/// [`TrafficError`] if there are too few start positions, or a share whose vehicles can drive on no closed
/// part of the map.
pub fn draw(
    map: &LabMap,
    scale: LengthScale,
    seed: u64,
    spec: &TrafficSpec,
) -> Result<Vec<SampledVehicle>, TrafficError> {
    let networks = networks(map, scale, spec)?;
    let shares = assign_shares(spec);
    let mut placed = 0;
    let found = START_SPACINGS_M.into_iter().find_map(|spacing_m| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let vehicles = draw_starts(map, &mut rng, &networks, &shares, spacing_m);
        placed = placed.max(vehicles.len());
        (vehicles.len() == shares.len()).then_some((rng, vehicles))
    });
    let (mut rng, vehicles) = found.ok_or(TrafficError::NoRoom { placed })?;
    let starts: Vec<(usize, LaneId)> = vehicles.iter().map(|&(share, lane, _)| (share, lane)).collect();
    let routes = draw_routes(map, &mut rng, &networks, &starts, spec.route_length_m);
    let drawn = vehicles.iter().zip(routes).map(|(&(share, _, at_m), route)| SampledVehicle {
        build: spec.shares[share].build.clone(),
        driver: vary(&mut rng, &spec.driver, spec.spread),
        route,
        at_m,
    });
    Ok(drawn.collect())
}

/// Why traffic cannot be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrafficError {
    /// Start positions are used up after this many vehicles.
    NoRoom { placed: usize },
    /// The vehicles of this share have no part of the map on which they could drive for ever.
    NoNetwork { share: usize },
}

/// For each share the lanes on which its vehicles can drive for ever.
fn networks(map: &LabMap, scale: LengthScale, spec: &TrafficSpec) -> Result<Vec<Vec<bool>>, TrafficError> {
    let network = |(share, of): (usize, &TrafficShare)| {
        let radius = of.build.spec.min_turn_radius();
        let mut open: Vec<bool> =
            map.lanes.iter().map(|lane| can_drive(map, scale, radius, lane.id)).collect();
        loop {
            let dead_ends: Vec<usize> = (0..open.len())
                .filter(|&index| {
                    open[index] && !map.lanes[index].successors.iter().any(|next| open[next.index()])
                })
                .collect();
            if dead_ends.is_empty() {
                break;
            }
            dead_ends.iter().for_each(|&index| open[index] = false);
        }
        if open.contains(&true) { Ok(open) } else { Err(TrafficError::NoNetwork { share }) }
    };
    spec.shares.iter().enumerate().map(network).collect()
}

/// Assigns shares in proportion to the weights, evenly mixed.
fn assign_shares(spec: &TrafficSpec) -> Vec<usize> {
    let total: f64 = spec.shares.iter().map(|share| share.weight).sum();
    let mut given = vec![0.0; spec.shares.len()];
    let mut shares = Vec::with_capacity(spec.vehicles);
    for count in 1..=spec.vehicles {
        let owed = |k: usize| spec.shares[k].weight / total * count as f64 - given[k];
        let most = (0..given.len()).max_by(|&a, &b| owed(a).total_cmp(&owed(b)).then(b.cmp(&a)));
        let share = most.unwrap_or(0);
        given[share] += 1.0;
        shares.push(share);
    }
    shares
}

/// Share, lane and position of each vehicle; fewer if the positions are used up.
fn draw_starts(
    map: &LabMap,
    rng: &mut ChaCha8Rng,
    networks: &[Vec<bool>],
    shares: &[usize],
    spacing_m: f64,
) -> Vec<(usize, LaneId, f64)> {
    let mut places = starting_places(map, spacing_m);
    shuffle(rng, &mut places);
    let mut vehicles = Vec::new();
    for &share in shares {
        let place = places.iter().position(|(lane, _)| networks[share][lane.index()]);
        let Some(place) = place else { break };
        let (lane, at_m) = places.remove(place);
        vehicles.push((share, lane, at_m));
    }
    vehicles
}

/// Start positions on lanes outside junctions, clear of every conflict zone.
fn starting_places(map: &LabMap, spacing_m: f64) -> Vec<(LaneId, f64)> {
    let mut places = Vec::new();
    for lane in map.lanes.iter().filter(|lane| lane.kind == LaneKind::Lane) {
        let mut at_m = START_FROM_BEGIN_M;
        while at_m < lane.curve.length() - START_FROM_END_M {
            let in_zone = map.zones_on(lane.id).any(|zone| {
                let side = zone.sides.iter().find(|side| side.lane == lane.id);
                side.is_some_and(|side| {
                    side.from_m < at_m + START_FROM_END_M && at_m - START_FROM_BEGIN_M < side.to_m
                })
            });
            let in_bend = lane.curve.min_radius((at_m - START_FROM_BEGIN_M).max(0.0), at_m).is_finite();
            if in_zone || in_bend {
                at_m += 0.05;
            } else {
                places.push((lane.id, at_m));
                at_m += spacing_m;
            }
        }
    }
    places
}

/// Route length after which coverage of the map restarts: by then some vehicles are rerouted or stopped.
const COVER_EVERY_M: f64 = 16.0;

/// Grows all routes together: each to the nearest unused lane first, then to random destinations. Seeking
/// unused lanes throughout would crowd the junctions, which have many lanes.
fn draw_routes(
    map: &LabMap,
    rng: &mut ChaCha8Rng,
    networks: &[Vec<bool>],
    starts: &[(usize, LaneId)],
    length_m: f64,
) -> Vec<Vec<LaneId>> {
    let mut uses = vec![0_u32; map.lanes.len()];
    let mut is_covered = vec![false; map.lanes.len()];
    let mut cover_again_at_m = COVER_EVERY_M;
    let mut routes: Vec<Vec<LaneId>> = starts.iter().map(|&(_, lane)| vec![lane]).collect();
    let mut lengths: Vec<f64> = starts.iter().map(|&(_, lane)| map.lane(lane).curve.length()).collect();
    for &(_, lane) in starts {
        uses[lane.index()] += 1;
        is_covered[lane.index()] = true;
    }
    // The shortest route grows first, so that lanes are used in order of time.
    loop {
        let unfinished = (0..routes.len()).filter(|&k| lengths[k] < length_m);
        let Some(index) = unfinished.min_by(|&a, &b| lengths[a].total_cmp(&lengths[b])) else { break };
        if lengths[index] > cover_again_at_m {
            cover_again_at_m += COVER_EVERY_M;
            is_covered.fill(false);
        }
        let open = &networks[starts[index].0];
        let here = routes[index][routes[index].len() - 1];
        let mut way = way_to_unused(map, rng, open, &is_covered, here);
        if way.is_empty() {
            way = sample_trip(map, rng, open, &uses, here);
        }
        if way.is_empty() {
            // Networks have no dead ends, except a map of one lane.
            lengths[index] = length_m;
        }
        for lane in way {
            routes[index].push(lane);
            lengths[index] += map.lane(lane).curve.length();
            uses[lane.index()] += 1;
            is_covered[lane.index()] = true;
        }
    }
    routes
}

/// Expected delay of a lane with conflict zones, alone and at mean use, seconds.
const JUNCTION_S: f64 = 4.0;
const CROWDED_JUNCTION_S: f64 = 6.0;

/// Expected travel time of a lane: driving and congestion delay.
fn expected_s(map: &LabMap, uses: &[u32], mean_uses: f64, lane: LaneId) -> f64 {
    let use_ratio = f64::from(uses[lane.index()]) / mean_uses.max(1.0);
    let lane = map.lane(lane);
    let driving_s = lane.curve.length() / lane.speed_limit_mps;
    let is_junction = map.zones_on(lane.id).any(|zone| zone.kind != ZoneKind::Diverge);
    let waiting_s = if is_junction { JUNCTION_S + CROWDED_JUNCTION_S * use_ratio * use_ratio } else { 0.0 };
    driving_s + waiting_s
}

/// The cheapest route to a random lane, biased towards long routes: junctions are where vehicles wait.
fn sample_trip(map: &LabMap, rng: &mut ChaCha8Rng, open: &[bool], uses: &[u32], from: LaneId) -> Vec<LaneId> {
    let is_goal = |lane: &&Lane<Lab>| lane.kind == LaneKind::Lane && open[lane.id.index()] && lane.id != from;
    let weight = |lane: &Lane<Lab>| lane.curve.length() * lane.curve.length();
    let total: f64 = map.lanes.iter().filter(is_goal).map(weight).sum();
    let mut lot = uniform(rng) * total;
    let goal = map.lanes.iter().filter(is_goal).find(|lane| {
        lot -= weight(lane);
        lot < 0.0
    });
    let mean_uses = f64::from(uses.iter().sum::<u32>()) / uses.len() as f64;
    let cost = |lane: LaneId| open[lane.index()].then(|| expected_s(map, uses, mean_uses, lane));
    let way = goal.and_then(|goal| map.cheapest_route(from, goal.id, cost));
    way.map_or_else(
        // The destination is unreachable: continue on any lane.
        || map.lane(from).successors.iter().copied().filter(|next| open[next.index()]).take(1).collect(),
        |way| way[1..].to_vec(),
    )
}

/// Search depth for an unused lane.
const LOOK_AHEAD_LANES: usize = 12;

/// Breadth-first search: the route of fewest lanes to an unused one, ties at random; empty if none is near.
fn way_to_unused(
    map: &LabMap,
    rng: &mut ChaCha8Rng,
    open: &[bool],
    is_covered: &[bool],
    from: LaneId,
) -> Vec<LaneId> {
    let mut reached: Vec<(LaneId, usize)> = vec![(from, 0)];
    let mut is_reached = vec![false; map.lanes.len()];
    let mut ring = 0..1;
    for _ in 0..LOOK_AHEAD_LANES {
        let ring_end = reached.len();
        for parent in ring {
            for &next in map.lane(reached[parent].0).successors.iter().filter(|next| open[next.index()]) {
                if !std::mem::replace(&mut is_reached[next.index()], true) {
                    reached.push((next, parent));
                }
            }
        }
        ring = ring_end..reached.len();
        let unused: Vec<usize> =
            ring.clone().filter(|&index| !is_covered[reached[index].0.index()]).collect();
        if !unused.is_empty() {
            let mut at = unused[rng.next_u64() as usize % unused.len()];
            let mut way = Vec::new();
            while at > 0 {
                way.push(reached[at].0);
                at = reached[at].1;
            }
            way.reverse();
            return way;
        }
    }
    Vec::new()
}

fn vary(rng: &mut ChaCha8Rng, driver: &DriverParams, spread: f64) -> DriverParams {
    varied(driver, spread, std::array::from_fn(|_| uniform(rng)))
}

/// A driver whose parameters deviate by up to a share, by four numbers in [0, 1).
pub(super) fn varied(driver: &DriverParams, spread: f64, deviations: [f64; 4]) -> DriverParams {
    let [speed, headway, gap, acceleration] = deviations;
    let vary = |value: f64, deviation: f64| value * (1.0 + spread * (2.0 * deviation - 1.0));
    DriverParams {
        desired_speed_mps: vary(driver.desired_speed_mps, speed),
        headway_s: vary(driver.headway_s, headway),
        standstill_gap_m: vary(driver.standstill_gap_m, gap),
        max_acceleration_mps2: driver.max_acceleration_mps2 * (1.0 - spread * acceleration),
        ..*driver
    }
}

fn shuffle<T>(rng: &mut ChaCha8Rng, items: &mut [T]) {
    for k in (1..items.len()).rev() {
        items.swap(k, (rng.next_u64() % (k as u64 + 1)) as usize);
    }
}
