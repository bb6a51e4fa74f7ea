//! Words, signs and explanations of vehicle statuses.

use super::commands::{KeyMap, TAKE_CONTROL};
use super::theme;
use city3d_geometry::wrap_angle;
use city3d_protocol::snapshot::{DecisionReason, Status, VehicleInfo, VehicleState};
use city3d_roadmap::CityMap;
use egui::{Color32, Painter, Pos2, Rect, Shape, Stroke, Vec2, pos2};

/// A status in the words of the window.
pub fn label(status: Status) -> &'static str {
    match status {
        Status::Manual => "driven by hand",
        Status::LinkLost => "no command",
        Status::Physical => "lab vehicle",
        Status::Unseen => "not tracked",
        other => other.label(),
    }
}

/// The sign of a status on the map and at labels: colours alone are not told apart by everybody.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sign {
    /// Goes as it should.
    Disc,
    /// Gives way: the triangle of the yield sign.
    Triangle,
    /// Stands.
    Square,
    /// A person drives.
    Diamond,
    /// Is not to be relied on: no link, or not seen.
    Ring,
    /// Has collided.
    Cross,
}

/// The sign of a status.
pub fn sign(status: Status) -> Sign {
    match status {
        Status::Driving | Status::Physical => Sign::Disc,
        Status::Yielding => Sign::Triangle,
        Status::Stopped | Status::Waiting | Status::Finished => Sign::Square,
        Status::Manual => Sign::Diamond,
        Status::LinkLost | Status::Unseen => Sign::Ring,
        Status::Collided => Sign::Cross,
    }
}

/// Paints the sign of a status around a point of a picture.
pub fn paint_sign(painter: &Painter, at: Pos2, radius: f32, status: Status) {
    paint_sign_in(painter, (at, radius), status, theme::on_picture(painter.ctx(), status));
}

/// Paints the sign of a status in a colour; all signs have about the same area.
pub fn paint_sign_in(painter: &Painter, (at, radius): (Pos2, f32), status: Status, colour: Color32) {
    let polygon = |points: Vec<Pos2>| Shape::convex_polygon(points, colour, Stroke::NONE);
    let shape = match sign(status) {
        Sign::Disc => Shape::circle_filled(at, radius, colour),
        Sign::Ring => Shape::circle_stroke(at, 0.85 * radius, Stroke::new(0.55 * radius, colour)),
        Sign::Square => {
            Shape::rect_filled(Rect::from_center_size(at, Vec2::splat(1.8 * radius)), 0.0, colour)
        }
        Sign::Triangle => {
            let (half, up) = (1.35 * radius, 1.0 * radius);
            polygon(vec![
                pos2(at.x - half, at.y - up),
                pos2(at.x + half, at.y - up),
                pos2(at.x, at.y + 1.4 * up),
            ])
        }
        Sign::Diamond => {
            let half = 1.35 * radius;
            let [east, north] = [Vec2::X * half, Vec2::Y * half];
            polygon(vec![at + east, at + north, at - east, at - north])
        }
        Sign::Cross => {
            let arm = Vec2::splat(1.2 * radius);
            let stroke = Stroke::new(0.8 * radius, colour);
            let other = Vec2::new(arm.x, -arm.y);
            painter.line_segment([at - other, at + other], stroke);
            Shape::line_segment([at - arm, at + arm], stroke)
        }
    };
    painter.add(shape);
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

/// Whether a vehicle that is limited so gives way to others.
pub fn gives_way(reason: DecisionReason) -> bool {
    match reason {
        DecisionReason::StopLine
        | DecisionReason::YieldLine
        | DecisionReason::Junction
        | DecisionReason::NoRoom
        | DecisionReason::Crossing
        | DecisionReason::Merging => true,
        DecisionReason::FreeRoad
        | DecisionReason::RoadSpeed
        | DecisionReason::Leader
        | DecisionReason::Platoon
        | DecisionReason::RouteEnd
        | DecisionReason::Signal
        | DecisionReason::Plan
        | DecisionReason::SafetyFilter
        | DecisionReason::NotMeasured
        | DecisionReason::OffRoute => false,
    }
}

/// Explanation of a vehicle's status, with the reason where it is known.
pub fn reason(keys: &KeyMap, vehicle: &VehicleState, info: &VehicleInfo, map: &CityMap) -> String {
    let reason = match vehicle.status {
        Status::Stopped if is_off_lanes(vehicle, info, map) => {
            let what = "Off the lanes, its algorithm has no route: drive it back onto a lane";
            return keys.tip(what, &TAKE_CONTROL);
        }
        // It feels nothing of what is simulated, and no key helps.
        Status::Collided if info.is_physical() => RAMMED_PHYSICAL,
        Status::Collided => return keys.tip(meaning(Status::Collided), &TAKE_CONTROL),
        status @ (Status::Driving | Status::Yielding | Status::Stopped | Status::Finished)
            if info.is_physical() =>
        {
            return format!("{}. {LAB_VEHICLE}", meaning(status));
        }
        status => meaning(status),
    };
    reason.to_owned()
}

/// What a collision means to a vehicle of the laboratory.
pub(super) const RAMMED_PHYSICAL: &str = "A lab vehicle: it is measured, feels nothing of a collision with virtual vehicles, and goes on as before. Runs of older versions give it this status until the two are clear of one another";

/// What a lab vehicle is.
pub(super) const LAB_VEHICLE: &str =
    "Lab vehicle: a robot car in the laboratory, drawn where motion capture measures it";

/// In place of a quantity that nobody has measured.
pub(super) const NOT_MEASURED: &str = "-";
/// Why it is not known.
pub(super) const NOT_MEASURED_TIP: &str =
    "Not tracked: nobody measures this lab vehicle now, so its motion is not known";

/// Whether the motion of a vehicle is known. Of one that is not measured a snapshot has the last place, and zeros.
pub(super) fn is_tracked(status: Status) -> bool {
    status != Status::Unseen
}

/// A speed as it is written beside a status: in parentheses where the vehicle waits and will start with it, a dash where it is
/// not measured.
pub(super) fn speed_words(status: Status, number: String) -> String {
    if !is_tracked(status) {
        return NOT_MEASURED.to_owned();
    }
    let is_zero = !number.contains(|digit| matches!(digit, '1'..='9'));
    if status != Status::Waiting || is_zero { number } else { format!("({number})") }
}

/// Explanation of a status for tooltips.
pub fn meaning(status: Status) -> &'static str {
    match status {
        Status::Waiting => {
            "Set up; waits for the start, or for its first trajectory. A speed in parentheses is the one that it starts with"
        }
        Status::Driving => "Under way on its trajectory; the inspector says what limits its speed",
        Status::Yielding => {
            "Gives way at a yield line, or to a vehicle with the right of way, and has been held by that for 0.4 s on end"
        }
        Status::Stopped => {
            "Stands behind others, at a line, where it is parked, or where a person left it off the lanes"
        }
        Status::Manual => "A person drives",
        Status::LinkLost => "No command for longer than the link timeout: it brakes to a stop on its path",
        Status::Collided => {
            "Has hit something and stays. Reset the run, or take control of it and drive it off. A lab vehicle that is hit goes on as before"
        }
        Status::Finished => "At the end of its route",
        Status::Physical => "A robot car in the laboratory, drawn where motion capture measures it",
        Status::Unseen => {
            "A lab vehicle that is not measured now: it is drawn where it was last, and its speed is not known"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statuses_are_told_apart_by_words() {
        let labels: std::collections::HashSet<_> = Status::ALL.map(label).into();
        let meanings: std::collections::HashSet<_> = Status::ALL.map(meaning).into();
        assert_eq!((labels.len(), meanings.len()), (Status::ALL.len(), Status::ALL.len()));
    }

    #[test]
    fn what_a_person_has_to_see_at_once_has_a_sign_of_its_own() {
        let urgent = [Status::Driving, Status::Yielding, Status::Stopped, Status::Manual, Status::Collided];
        let signs: std::collections::HashSet<_> = urgent.map(sign).into();
        assert_eq!(signs.len(), urgent.len());
    }
}
