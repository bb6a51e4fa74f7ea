//! Feasibility checks: bends, accelerations and starts that vehicles cannot drive.

use super::experiment::PlannedVehicle;
use city3d_control::{CRUISE, DriverParams, LeaderState, Route};
use city3d_geometry::{LengthScale, trig};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::LabMap;

/// Required turning radius relative to the vehicle's smallest: control needs a reserve.
pub const STEERING_RESERVE: f64 = 1.02;
const GRAVITY: f64 = 9.81;

/// An infeasible demand on a vehicle.
#[derive(Debug)]
pub struct Infeasible {
    /// The vehicle's field that demands it.
    pub field: &'static str,
    /// The demand, what is possible, and the remedy.
    pub message: String,
}

/// All infeasible demands on a vehicle, in full-scale values.
pub fn infeasibilities(map: &LabMap, scale: LengthScale, vehicle: &PlannedVehicle) -> Vec<Infeasible> {
    let mut found = Vec::new();
    let (spec, driver) = (&vehicle.spec, &vehicle.driver);
    let grip = spec.tyre_friction * GRAVITY;
    // Beyond half travel the pedal applies the handbrake (the paper, eq. 2).
    let half_pedal = spec.brake_torque_nm / spec.dimensions.wheel_radius_m / spec.mass_kg / 2.0;
    let mut exceeds = |what: &str, asked: f64, possible: f64, remedy: &str| {
        if asked > possible {
            let name = &vehicle.name;
            let message = format!(
                "{name}: {what} of {asked:.2} m/s2 at full scale; {possible:.2} is possible: {remedy}"
            );
            found.push(Infeasible { field: "driver", message });
        }
    };
    let u_max = scale.city_from_lab(driver.max_acceleration_mps2);
    let u_min = scale.city_from_lab(driver.min_acceleration_mps2.abs());
    let lateral = scale.city_from_lab(driver.lateral_acceleration_mps2);
    exceeds(
        "max_acceleration_mps2 asks for an acceleration",
        u_max,
        spec.max_acceleration_at(0.0).min(grip),
        "lower it, or give the vehicle more torque or friction",
    );
    exceeds(
        "min_acceleration_mps2 asks for a deceleration",
        u_min,
        half_pedal.min(grip),
        "raise it towards 0, or give the vehicle stronger brakes (half the pedal must suffice) or more friction",
    );
    exceeds(
        "lateral_acceleration_mps2 asks for a cornering acceleration",
        lateral,
        grip,
        "lower it or give the tyres more friction",
    );
    for lane in &vehicle.route {
        let lane = map.lane(*lane);
        let radius = scale.city_from_lab(lane.curve.min_radius(0.0, lane.curve.length()));
        if radius < spec.min_turn_radius() * STEERING_RESERVE {
            let message = format!(
                "{}: lane \"{}\" has a bend of radius {radius:.2} m at full scale; the front axle of this \
                 vehicle needs {:.2} m: choose another route, a larger steering_limit_deg or a shorter wheelbase_m",
                vehicle.name,
                lane.name,
                spec.min_turn_radius() * STEERING_RESERVE,
            );
            found.push(Infeasible { field: "route", message });
            break;
        }
    }
    found.extend(overrun(map, scale, vehicle));
    found
}

/// A start too fast to stop on the route.
fn overrun(map: &LabMap, scale: LengthScale, vehicle: &PlannedVehicle) -> Option<Infeasible> {
    if vehicle.leaves {
        return None;
    }
    let route_m: f64 = vehicle.route.iter().map(|lane| map.lane(*lane).curve.length()).sum();
    let overhang_m =
        scale.lab_from_city((vehicle.spec.dimensions.length_m - vehicle.spec.dimensions.wheelbase_m) / 2.0);
    let left_m = route_m - vehicle.start.at_m - overhang_m;
    let needed_m = vehicle.driver.stopping_distance(vehicle.start.speed_mps);
    (vehicle.start.speed_mps > 0.0 && needed_m > left_m).then(|| Infeasible {
        field: "speed_mps",
        message: format!(
            "{}: at {} m/s it needs {needed_m:.2} m to stop, and its route ends after \
             {:.2} m (of the laboratory): start slower or further back, or give it a longer route",
            vehicle.name,
            vehicle.start.speed_mps,
            left_m.max(0.0)
        ),
    })
}

/// Look-ahead of a start, laboratory metres: more than any stopping distance.
const AHEAD_M: f64 = 3.0;
const STEP_M: f64 = 0.02;

/// A start that requires harder braking than u_min, and its feasible speed.
#[derive(Clone, Debug, PartialEq)]
pub struct InfeasibleStart {
    /// The vehicle that starts too fast.
    pub vehicle: VehicleId,
    /// Laboratory m/s.
    pub most_mps: f64,
    /// The demand and the remedy.
    pub message: String,
}

/// Infeasible starts of vehicles: before a bend, or behind another vehicle.
pub fn infeasible_starts(
    map: &LabMap,
    scale: LengthScale,
    vehicles: &[PlannedVehicle],
) -> Vec<InfeasibleStart> {
    let moving = vehicles.iter().filter(|vehicle| vehicle.start.speed_mps > 0.0 && !vehicle.is_human);
    let find = |vehicle| {
        too_fast_for_bend(map, scale, vehicle).or_else(|| too_near_to_leader(map, scale, vehicle, vehicles))
    };
    moving.filter_map(find).collect()
}

fn too_fast_for_bend(map: &LabMap, scale: LengthScale, vehicle: &PlannedVehicle) -> Option<InfeasibleStart> {
    let (start, driver) = (&vehicle.start, &vehicle.driver);
    let mut lanes = Vec::new();
    let mut length_m = 0.0;
    for lane in &vehicle.route {
        if length_m > start.at_m + AHEAD_M {
            break;
        }
        length_m += map.lane(*lane).curve.length();
        lanes.push(*lane);
    }
    // A lower desired speed is approached gently.
    let wish = DriverParams { desired_speed_mps: f64::MAX.sqrt(), ..*driver };
    let route = Route::new(map, &lanes, vehicle.body_in_lab(scale), &wish);
    let braking = driver.min_acceleration_mps2.abs();
    let steps = ((length_m - start.at_m).clamp(0.0, AHEAD_M) / STEP_M) as u32;
    let most_mps = (0..=steps)
        .map(|step| STEP_M * f64::from(step))
        .map(|way_m| (trig::powi(route.speed_at(start.at_m + way_m), 2) + 2.0 * braking * way_m).sqrt())
        .fold(f64::INFINITY, f64::min);
    (start.speed_mps > most_mps + 1e-6).then(|| InfeasibleStart {
        vehicle: vehicle.id,
        most_mps,
        message: format!(
            "{}: at {} m/s it would have to brake harder than min_acceleration_mps2 for the bend or limit ahead; \
             start at {most_mps:.2} m/s or slower, or further back",
            vehicle.name, start.speed_mps,
        ),
    })
}

fn too_near_to_leader(
    map: &LabMap,
    scale: LengthScale,
    vehicle: &PlannedVehicle,
    vehicles: &[PlannedVehicle],
) -> Option<InfeasibleStart> {
    // A vehicle of constant speed ignores leaders.
    if vehicle.controller == CRUISE {
        return None;
    }
    let (start, driver) = (&vehicle.start, &vehicle.driver);
    let (gap_m, leader) = leader_at_start(map, scale, vehicle, vehicles)?;
    let ahead = LeaderState { gap_m, speed_mps: leader.start.speed_mps };
    // The desired speed does not count: it is approached gently.
    let is_too_fast = |speed_mps: f64| {
        driver.wanted_acceleration(speed_mps, f64::MAX.sqrt(), Some(ahead)) < driver.min_acceleration_mps2
    };
    if !is_too_fast(start.speed_mps) {
        return None;
    }
    let (mut low, mut high) = (0.0, start.speed_mps);
    for _ in 0..30 {
        let middle = (low + high) / 2.0;
        if is_too_fast(middle) { high = middle } else { low = middle }
    }
    Some(InfeasibleStart {
        vehicle: vehicle.id,
        most_mps: low,
        message: format!(
            "{}: at {} m/s and {gap_m:.2} m behind {} it would have to brake harder than min_acceleration_mps2; \
             start further back, or at {low:.2} m/s or slower",
            vehicle.name, start.speed_mps, leader.name
        ),
    })
}

/// The leader at the start, and the distance to its rear bumper, laboratory metres.
fn leader_at_start<'v>(
    map: &LabMap,
    scale: LengthScale,
    vehicle: &PlannedVehicle,
    vehicles: &'v [PlannedVehicle],
) -> Option<(f64, &'v PlannedVehicle)> {
    let front_m = vehicle.start.at_m + vehicle.body_in_lab(scale).overhang_m();
    let mut lane_start_m = 0.0;
    let mut nearest: Option<(f64, &PlannedVehicle)> = None;
    for lane in &vehicle.route {
        if lane_start_m > front_m + AHEAD_M {
            break;
        }
        let on_lane = vehicles.iter().filter(|other| other.id != vehicle.id && other.start.lane == *lane);
        for other in on_lane {
            let body = other.body_in_lab(scale);
            let rear_m = lane_start_m + other.start.at_m + body.overhang_m() - body.length_m;
            let gap_m = rear_m - front_m;
            if gap_m > 0.0 && gap_m < AHEAD_M && nearest.is_none_or(|(least_m, _)| gap_m < least_m) {
                nearest = Some((gap_m, other));
            }
        }
        lane_start_m += map.lane(*lane).curve.length();
    }
    nearest
}

/// Whether a vehicle can drive every bend of a lane.
pub fn can_drive(
    map: &LabMap,
    scale: LengthScale,
    min_turn_radius_m: f64,
    lane: city3d_roadmap::LaneId,
) -> bool {
    let curve = &map.lane(lane).curve;
    scale.city_from_lab(curve.min_radius(0.0, curve.length())) >= min_turn_radius_m * STEERING_RESERVE
}
