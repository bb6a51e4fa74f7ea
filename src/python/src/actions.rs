//! Actions: what is wanted of vehicles in place of what their algorithms do, as rows of arrays.

use crate::convert::bad_input;
use city3d_geometry::Pose2;
use city3d_protocol::snapshot::{FrameSnapshot, Pedals, Trajectory, TrajectoryPoint, VehicleId};
use numpy::ndarray::{ArrayView1, ArrayView2, ArrayViewD, Axis};
use pyo3::PyResult;

/// What one vehicle is ordered to do, full-scale units.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Pedals and steering angle.
    Drive(VehicleId, Box<Pedals>),
    /// Acceleration along the heading and steering angle; the library sets the pedals.
    Accelerate(VehicleId, Acceleration),
    /// Acceleration along the route; the library steers, and keeps the right of way.
    AlongRoute(VehicleId, f64),
    /// A trajectory that the tracking control follows.
    Follow(Box<Trajectory>),
    /// The vehicle's own algorithm again.
    Release(VehicleId),
}

/// An acceleration along the heading, m/s2, and a steering angle, left-positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceleration {
    pub mps2: f64,
    pub steering_rad: f64,
}

impl Order {
    pub fn vehicle(&self) -> VehicleId {
        match self {
            Self::Drive(id, _) | Self::Accelerate(id, _) | Self::AlongRoute(id, _) | Self::Release(id) => *id,
            Self::Follow(trajectory) => trajectory.vehicle,
        }
    }
}

/// Kinds of actions, and the columns of their rows.
pub const ACTIONS: [(&str, &[&str]); 4] = [
    ("pedals", &["gas", "brake", "steering_rad"]),
    ("acceleration", &["acceleration_mps2", "steering_rad"]),
    ("along_route", &["acceleration_mps2"]),
    ("trajectory", &["time_s", "x_m", "y_m", "heading_rad", "speed_mps"]),
];

/// Largest acceleration that can be meant, m/s2.
const LARGEST_MPS2: f64 = 100.0;
/// Largest coordinate that can be meant, metres.
const LARGEST_M: f64 = 1e6;
/// Most waypoints of a trajectory.
const MOST_WAYPOINTS: usize = 1000;

/// The orders of a table: one row for each id, or one list of waypoints. None of them has been carried out.
///
/// # Errors
/// Names the first row that cannot be meant.
pub fn orders(
    ids: ArrayView1<'_, u32>,
    actions: &ArrayViewD<'_, f64>,
    kind: &str,
    snapshot: &FrameSnapshot,
) -> PyResult<Vec<Order>> {
    let Some((_, columns)) = ACTIONS.iter().find(|(name, _)| *name == kind) else {
        let names = ACTIONS.map(|(name, _)| name).join(", ");
        return Err(bad_input(format!("no actions of kind {kind:?}: there are {names}")));
    };
    let (count, width) = (ids.len(), columns.len());
    let shape = actions.shape();
    let is_list = width == 1 && shape == [count];
    let is_meant = if kind == "trajectory" {
        matches!(shape, [rows, waypoints, numbers] if (*rows, *numbers) == (count, width) && (1..=MOST_WAYPOINTS).contains(waypoints))
    } else {
        is_list || shape == [count, width]
    };
    if !is_meant {
        let what = if kind == "trajectory" { "1 to 1000 waypoints" } else { "one row" };
        let columns = columns.join(", ");
        return Err(bad_input(format!(
            "actions of shape {shape:?} for {count} ids: each id has {what} of {width} ({columns})"
        )));
    }
    let mut orders = Vec::with_capacity(count);
    for (row, &id) in ids.iter().enumerate() {
        let of_row = |why: String| bad_input(format!("row {row} (vehicle {id}): {why}"));
        let vehicle = VehicleId(id);
        check_vehicle(vehicle, snapshot).map_err(of_row)?;
        if ids.iter().take(row).any(|other| *other == id) {
            return Err(of_row("this vehicle has an earlier row, too".to_owned()));
        }
        let own = actions.index_axis(Axis(0), row);
        let order = if kind == "trajectory" {
            own.into_dimensionality().map_err(|error| error.to_string()).and_then(|own| follow(vehicle, own))
        } else {
            let numbers: Vec<f64> = own.iter().copied().collect();
            simple(vehicle, kind, columns, &numbers)
        };
        orders.push(order.map_err(of_row)?);
    }
    Ok(orders)
}

/// # Errors
/// Where the city has no such vehicle, or a physical one.
pub fn check_vehicle(vehicle: VehicleId, snapshot: &FrameSnapshot) -> Result<(), String> {
    match snapshot.info(vehicle) {
        None => {
            let present: Vec<u32> = snapshot.vehicles.iter().map(|vehicle| vehicle.id.0).collect();
            Err(format!("no vehicle {vehicle} in the city: there are {present:?}"))
        }
        Some(info) if info.is_physical() => {
            Err(format!("vehicle {vehicle} is a physical one: nobody drives it from here"))
        }
        Some(_) => Ok(()),
    }
}

/// The order of a row of numbers.
fn simple(vehicle: VehicleId, kind: &str, columns: &[&str], numbers: &[f64]) -> Result<Order, String> {
    if let Some((column, wrong)) = columns.iter().zip(numbers).find(|(_, number)| !number.is_finite()) {
        return Err(format!("{column} is {wrong}; a finite number is needed"));
    }
    let acceleration = |mps2: f64| match mps2.abs() <= LARGEST_MPS2 {
        true => Ok(mps2),
        false => Err(format!("acceleration_mps2 is {mps2}; -{LARGEST_MPS2} to {LARGEST_MPS2} are possible")),
    };
    Ok(match (kind, numbers) {
        ("pedals", &[gas, brake, steering_rad]) => {
            let pedals = Pedals { gas, brake, steering_rad, ..Pedals::default() };
            Order::Drive(vehicle, Box::new(pedals.clamped()))
        }
        ("acceleration", &[mps2, steering_rad]) => {
            Order::Accelerate(vehicle, Acceleration { mps2: acceleration(mps2)?, steering_rad })
        }
        (_, &[mps2, ..]) => Order::AlongRoute(vehicle, acceleration(mps2)?),
        (_, &[]) => return Err("the row is empty".to_owned()),
    })
}

/// The order of a list of waypoints. Those from the first with a time of NaN on are padding.
fn follow(vehicle: VehicleId, waypoints: ArrayView2<'_, f64>) -> Result<Order, String> {
    let mut points: Vec<TrajectoryPoint> = Vec::with_capacity(waypoints.nrows());
    for (index, waypoint) in waypoints.outer_iter().take_while(|waypoint| !waypoint[0].is_nan()).enumerate() {
        let numbers: [f64; 5] = std::array::from_fn(|column| waypoint[column]);
        let [time_s, x_m, y_m, yaw_rad, speed_mps] = numbers;
        if numbers.iter().any(|number| !number.is_finite() || number.abs() > LARGEST_M) {
            return Err(format!(
                "waypoint {index} is {numbers:?}; finite numbers of time, x, y, heading and speed are needed"
            ));
        }
        if speed_mps < 0.0 {
            return Err(format!("waypoint {index} has a speed of {speed_mps} m/s; trajectories go forwards"));
        }
        if let Some(before) = points.last().filter(|before| before.time_s >= time_s) {
            let before_s = before.time_s;
            return Err(format!("waypoint {index} is at {time_s} s, which is not later than {before_s} s"));
        }
        points.push(TrajectoryPoint { time_s, pose: Pose2::new(x_m, y_m, yaw_rad), speed_mps });
    }
    if points.is_empty() {
        return Err("it has no waypoint".to_owned());
    }
    // Its number is that of the world that carries it out.
    Ok(Order::Follow(Box::new(Trajectory { vehicle, points, ..Trajectory::default() })))
}
