//! Whether vehicles can do what an experiment asks of them: bends and accelerations, with numbers.

use super::experiment::PlannedVehicle;
use crate::city::LabMap;
use crate::geom::LengthScale;

/// A turn has to be this much wider than the tightest the vehicle can do, for control to have room.
pub const STEERING_RESERVE: f64 = 1.02;
const GRAVITY: f64 = 9.81;

/// Something that a vehicle cannot do.
#[derive(Debug)]
pub struct Infeasible {
    /// The field of the vehicle that asks for it.
    pub field: &'static str,
    pub message: String,
}

/// Everything that the vehicle cannot do, in full-scale figures.
pub fn infeasibilities(map: &LabMap, scale: LengthScale, vehicle: &PlannedVehicle) -> Vec<Infeasible> {
    let mut found = Vec::new();
    let (spec, driver) = (&vehicle.spec, &vehicle.driver);
    let grip = spec.tyre_friction * GRAVITY;
    // More than half the pedal is the handbrake's (the paper, eq. 2).
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
        "raise it towards 0, or give the vehicle stronger brakes (half the pedal has to do) or more friction",
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

/// A start so fast that the route is too short to stop on.
fn overrun(map: &LabMap, scale: LengthScale, vehicle: &PlannedVehicle) -> Option<Infeasible> {
    let route_m: f64 = vehicle.route.iter().map(|lane| map.lane(*lane).curve.length()).sum();
    let overhang_m =
        scale.lab_from_city((vehicle.spec.dimensions.length_m - vehicle.spec.dimensions.wheelbase_m) / 2.0);
    let left_m = route_m - vehicle.start.at_m - overhang_m;
    let needed_m = vehicle.driver.stopping_distance(vehicle.start.speed_mps);
    (vehicle.start.speed_mps > 0.0 && needed_m > left_m).then(|| Infeasible {
        field: "speed_mps",
        message: format!(
            "{}: at {} m/s it needs {needed_m:.2} laboratory metres to stop, and its route ends after \
             {:.2}: start slower or further back, or give it a longer route",
            vehicle.name,
            vehicle.start.speed_mps,
            left_m.max(0.0)
        ),
    })
}

/// Whether a vehicle can drive every bend of a lane.
pub fn can_drive(
    map: &LabMap,
    scale: LengthScale,
    min_turn_radius_m: f64,
    lane: crate::city::LaneId,
) -> bool {
    let curve = &map.lane(lane).curve;
    scale.city_from_lab(curve.min_radius(0.0, curve.length())) >= min_turn_radius_m * STEERING_RESERVE
}
