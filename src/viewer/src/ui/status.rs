//! Colours and explanations of vehicle statuses.

use city3d_geometry::wrap_angle;
use city3d_protocol::snapshot::{Status, VehicleInfo, VehicleState};
use city3d_roadmap::CityMap;
use egui::Color32;

/// The colour of a status, readable on a dark ground.
pub fn colour(status: Status) -> Color32 {
    match status {
        Status::Waiting => Color32::from_rgb(160, 160, 160),
        Status::Driving => Color32::from_rgb(120, 200, 120),
        Status::Yielding => Color32::from_rgb(235, 195, 80),
        Status::Stopped => Color32::from_rgb(235, 140, 80),
        Status::Manual => Color32::from_rgb(110, 175, 255),
        Status::LinkLost => Color32::from_rgb(230, 110, 230),
        Status::Collided => Color32::from_rgb(255, 85, 85),
        Status::Finished => Color32::from_rgb(150, 170, 190),
        Status::Physical => Color32::from_rgb(90, 210, 210),
        Status::Unseen => Color32::from_rgb(190, 120, 120),
    }
}

/// A front axle farther than this from every lane, or turned further from it, is off the lanes: control cannot
/// recover from more.
const OFF_LANES_M: f64 = 2.5;
const OFF_LANES_RAD: f64 = 1.0;

/// Whether a vehicle is off all lanes, so that no algorithm can route it.
pub fn is_off_lanes(vehicle: &VehicleState, info: &VehicleInfo, map: &CityMap) -> bool {
    let pose = vehicle.pose();
    let axle = pose.point_at(info.dimensions.front_axle_m(), 0.0);
    map.lanes.iter().all(|lane| {
        let foot = lane.curve.project(axle);
        let turn = wrap_angle(pose.yaw_rad - lane.curve.at(foot.s).pose.yaw_rad);
        foot.distance > OFF_LANES_M || turn.abs() > OFF_LANES_RAD
    })
}

/// Explanation of a vehicle's status, with the reason where it is known.
pub fn reason(vehicle: &VehicleState, info: &VehicleInfo, map: &CityMap) -> &'static str {
    match vehicle.status {
        Status::Stopped if is_off_lanes(vehicle, info, map) => {
            "Off the lanes, its algorithm has no route: drive it back onto a lane (Enter)"
        }
        Status::Driving | Status::Yielding | Status::Stopped | Status::Finished if info.is_physical() => {
            meaning(Status::Physical)
        }
        status => meaning(status),
    }
}

/// Explanation of a status for tooltips.
pub fn meaning(status: Status) -> &'static str {
    match status {
        Status::Waiting => "Set up; waits for its first trajectory",
        Status::Driving => "Follows its trajectory",
        Status::Yielding => "Gives way at a yield line, or to a vehicle with the right of way",
        Status::Stopped => "Stopped: behind others, at a line, or where a person left it off the lanes",
        Status::Manual => "A person drives",
        Status::LinkLost => "No trajectory for longer than the link timeout: it brakes to a stop on its path",
        Status::Collided => "Has hit something; it brakes and stays. A person who takes it over can drive on",
        Status::Finished => "At the end of its route",
        Status::Physical => "A vehicle of the laboratory, drawn as it is measured",
        Status::Unseen => "A vehicle of the laboratory that is not measured: it is drawn where it was last",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statuses_are_told_apart_by_colour_and_words() {
        let colours: std::collections::HashSet<_> = Status::ALL.map(colour).into();
        let meanings: std::collections::HashSet<_> = Status::ALL.map(meaning).into();
        assert_eq!((colours.len(), meanings.len()), (Status::ALL.len(), Status::ALL.len()));
    }
}
