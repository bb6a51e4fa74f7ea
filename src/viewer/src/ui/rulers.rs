//! Scale bar, north arrow, and the place under the mouse: coordinates and the lane.

use super::layers::Canvas;
use super::theme::{self, DecimalSeparator};
use super::{UiState, ViewModel, map};
use egui::{Align2, Color32, FontId, Pos2, Rect, Stroke, Vec2};
use glam::{DQuat, DVec2, DVec3};

/// Longest scale bar, points.
const LONGEST: f64 = 120.0;
/// From the corner of the view, points.
const MARGIN: f32 = 14.0;
/// Height of the lowest row with coordinates and scale, points.
const HEIGHT: f32 = 42.0;
/// The smallest view that has rulers, points.
const LEAST: Vec2 = Vec2::new(230.0, 190.0);
/// In a narrower view coordinates and scale have no room in one row, points.
const NARROW: f32 = 480.0;
/// Height of scale and north arrow, points.
const ABOVE_NORTH: f32 = 66.0;
/// Height of the sign that the past is shown.
const PAST_SIGN: f32 = 40.0;
const COLOUR: Color32 = Color32::from_gray(235);
/// Dark enough that labels of vehicles behind it do not run into its letters.
const GROUND: Color32 = Color32::from_black_alpha(225);

fn has_room(rect: Rect) -> bool {
    rect.width() >= LEAST.x && rect.height() >= LEAST.y
}

/// Height of what the rulers take from the lower edge of a view, points.
pub fn height(rect: Rect) -> f32 {
    if has_room(rect) { HEIGHT } else { 6.0 }
}

/// Paints the rulers, while their layer is visible. `pointed` is the place of the mouse in the view.
pub fn paint(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>, pointed: Option<Pos2>) {
    let rect = canvas.rect();
    if !state.layers.rulers || !has_room(rect) {
        return;
    }
    let corner = rect.right_bottom() - Vec2::splat(MARGIN);
    if let Some((length_m, points)) = scale(canvas) {
        scale_bar(canvas, corner, (length_m, points as f32));
    }
    north(canvas, corner - Vec2::new(16.0, 46.0));
    if let Some(ground) = pointed.and_then(|at| canvas.ground_at(at)) {
        let text = place_words(shown, ground, theme::decimal(canvas.painter().ctx()));
        // The sign of the past is in the middle of the lowest row.
        let row = match shown.past.is_shown {
            _ if rect.width() < NARROW => ABOVE_NORTH,
            true => PAST_SIGN,
            false => 0.0,
        };
        let left = rect.left_bottom() + Vec2::new(MARGIN, -MARGIN - row);
        label(canvas, (left, Align2::LEFT_BOTTOM), text);
    }
}

/// A point of the ground in words: coordinates, and the lane there.
pub fn place_words(shown: &ViewModel<'_>, ground: DVec2, decimal: DecimalSeparator) -> String {
    let [x, y] = [ground.x, ground.y].map(|metres| decimal.tenths(metres));
    let lane = shown.traffic.lanes().lane_under(shown.map, ground);
    let lane = lane.map_or_else(String::new, |(lane, at_m)| {
        format!("   lane {}, {} m", shown.map.lane(lane).name, decimal.tenths(at_m))
    });
    format!("x {x} m   y {y} m{lane}")
}

fn label(canvas: &Canvas<'_>, (at, align): (Pos2, Align2), text: String) {
    let width = canvas.rect().width() - 2.0 * MARGIN;
    let galley = canvas.painter().layout(text, FontId::proportional(12.0), COLOUR, width);
    let place = align.anchor_size(at, galley.size());
    canvas.painter().rect_filled(place.expand2(Vec2::new(6.0, 3.0)), 4.0, GROUND);
    canvas.painter().galley(place.min, galley, COLOUR);
}

/// Length and width on the screen of a bar of a round length, for the ground in the middle of the view; `None` where the
/// middle shows no ground.
fn scale(canvas: &Canvas<'_>) -> Option<(f64, f64)> {
    let ground = canvas.ground_at(canvas.rect().center())?.extend(0.0);
    let view = canvas.view();
    let right = view.extrinsics.orientation * DVec3::X;
    let points_of_metre = f64::from(canvas.place(ground + right)?.distance(canvas.place(ground)?));
    let length_m = round_below(LONGEST / points_of_metre)?;
    Some((length_m, length_m * points_of_metre))
}

/// The largest of 1, 2, 5, 10, 20 ... up to a length.
fn round_below(most_m: f64) -> Option<f64> {
    let steps = [1.0, 2.0, 5.0].into_iter();
    let all = [0.1, 1.0, 10.0, 100.0].into_iter().flat_map(|power| steps.clone().map(move |s| s * power));
    all.take_while(|length_m| *length_m <= most_m).last()
}

fn scale_bar(canvas: &Canvas<'_>, corner: Pos2, (length_m, points): (f64, f32)) {
    let ground = Rect::from_min_max(corner - Vec2::new(points + 12.0, 26.0), corner + Vec2::new(4.0, 4.0));
    let painter = canvas.painter();
    painter.rect_filled(ground, 4.0, GROUND);
    let (left, right) = (corner - Vec2::new(points + 4.0, 2.0), corner - Vec2::new(4.0, 2.0));
    let stroke = Stroke::new(2.0, COLOUR);
    painter.line_segment([left, right], stroke);
    for end in [left, right] {
        painter.line_segment([end, end - Vec2::new(0.0, 5.0)], stroke);
    }
    let decimal = theme::decimal(painter.ctx());
    let text = format!("{} m", decimal.fixed(length_m, usize::from(length_m < 1.0)));
    let middle = left.lerp(right, 0.5) - Vec2::new(0.0, 6.0);
    painter.text(middle, Align2::CENTER_BOTTOM, text, FontId::proportional(11.0), COLOUR);
}

/// An arrow to the north on the ground, as in a map that is turned to where the camera looks.
fn north(canvas: &Canvas<'_>, middle: Pos2) {
    let on_screen = north_in(canvas.view().extrinsics.orientation);
    let painter = canvas.painter();
    let direction = on_screen.normalized();
    painter.circle_filled(middle, 16.0, GROUND);
    // The letter is where the arrow points, as on maps: behind it, it would tell the south.
    map::paint_arrow(painter, middle - direction * 6.0, direction, (8.0, COLOUR));
    let text = middle + direction * 9.0;
    painter.text(text, Align2::CENTER_CENTER, "N", FontId::proportional(11.0), COLOUR);
}

/// Direction of the north on the screen for a camera's orientation: up is where it looks, and where its picture is up when it
/// looks straight down.
fn north_in(city_from_camera: DQuat) -> Vec2 {
    let (forward, down) = (city_from_camera * DVec3::Z, city_from_camera * DVec3::Y);
    let ahead = (forward - down).truncate();
    Vec2::new(-ahead.x as f32, -ahead.y as f32).normalized()
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_geometry::trig;
    use glam::DMat3;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    #[test]
    fn the_compass_turns_with_a_camera_that_looks_round() {
        for pitch_rad in [0.0, 0.7, 1.57] {
            for (heading_rad, expected) in
                [(FRAC_PI_2, [0.0, -1.0]), (0.0, [-1.0, 0.0]), (FRAC_PI_4, [-0.707, -0.707])]
            {
                let (sin, cos) = trig::sin_cos(heading_rad);
                let (down, level) = trig::sin_cos(pitch_rad);
                // A camera's axes: x right, y down, z forward.
                let right = DVec3::new(sin, -cos, 0.0);
                let forward = DVec3::new(cos * level, sin * level, -down);
                let axes = DMat3::from_cols(right, forward.cross(right), forward);
                let north = north_in(DQuat::from_mat3(&axes));
                let off = (north - Vec2::from(expected)).length();
                assert!(off < 2e-3, "{heading_rad} {pitch_rad}: {north:?}");
            }
        }
    }

    #[test]
    fn bars_have_round_lengths_that_fit() {
        for (most_m, length_m) in [(0.25, 0.2), (1.9, 1.0), (4.99, 2.0), (77.0, 50.0), (9999.0, 500.0)] {
            assert_eq!(round_below(most_m), Some(length_m));
        }
        assert_eq!(round_below(0.05), None);
    }
}
