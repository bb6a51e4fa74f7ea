//! States of vehicles as rows of numbers.

use city3d_protocol::snapshot::{Dimensions, FrameSnapshot, Status, VehicleState};

/// Names of the columns of a state, with their units. Full-scale SI units, x to the east and y to the north of the city's
/// middle; angles counter-clockwise from the east.
pub const COLUMNS: [&str; 21] = [
    "id",
    "x_m",
    "y_m",
    "z_m",
    "heading_rad",
    "vx_mps",
    "vy_mps",
    "speed_mps",
    "acceleration_mps2",
    "yaw_rate_radps",
    "steering_rad",
    "gas",
    "brake",
    "handbrake",
    "reverse",
    "lateral_error_m",
    "distance_m",
    "length_m",
    "width_m",
    "front_axle_m",
    "status",
];

/// Labels of the statuses, each at the index of its number.
pub fn statuses() -> Vec<&'static str> {
    Status::ALL.map(Status::label).to_vec()
}

/// One row for each vehicle, in id order.
pub fn rows(snapshot: &FrameSnapshot) -> Vec<f64> {
    let mut values = Vec::with_capacity(COLUMNS.len() * snapshot.vehicles.len());
    for (state, info) in snapshot.iter() {
        values.extend(row(state, &info.dimensions));
    }
    values
}

fn row(state: &VehicleState, dimensions: &Dimensions) -> [f64; COLUMNS.len()] {
    [
        f64::from(state.id.0),
        state.position.x,
        state.position.y,
        state.position.z,
        state.pose().yaw_rad,
        state.velocity_mps.x,
        state.velocity_mps.y,
        state.speed_mps,
        state.acceleration_mps2,
        state.yaw_rate_radps,
        state.steering_rad,
        state.gas,
        state.brake,
        state.handbrake,
        f64::from(u8::from(state.reverse)),
        state.lateral_error_m,
        state.distance_m,
        dimensions.length_m,
        dimensions.width_m,
        dimensions.front_axle_m(),
        f64::from(state.status as u8),
    ]
}
