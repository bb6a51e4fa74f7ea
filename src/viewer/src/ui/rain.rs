//! Rain that falls in the large views, as streaks over the picture. It falls in simulated time: a paused run has still rain, and
//! a picture of a moment is always the same.

#![allow(clippy::disallowed_methods, reason = "rain is drawn; no state of a run depends on it")]

use super::CameraMode;
use egui::{Color32, Painter, Rect, Stroke, Vec2};

/// A streak for so many square points of the view, and the most of them.
const POINTS2_OF_STREAK: f32 = 3200.0;
const MOST_STREAKS: u32 = 220;
/// Lengths of streaks far away and near, points, and how far they lean.
const LENGTHS: [f32; 2] = [9.0, 30.0];
const LEAN: f32 = 0.07;
/// Heights of the view that a drop falls in a simulated second, far away and near.
const FALLS: [f64; 2] = [0.7, 1.9];

/// Paints the rain of a simulated instant over a view.
pub(super) fn paint(painter: &Painter, rect: Rect, mode: CameraMode, time_s: f64) {
    // From straight above a drop is a point.
    let shrink = if mode == CameraMode::Overhead { 0.15 } else { 1.0 };
    let count = ((rect.area() / POINTS2_OF_STREAK) as u32).min(MOST_STREAKS);
    for drop in 0..count {
        let [x, phase, near] = [1, 2, 3].map(|salt| unit(drop * 4 + salt));
        let [far_length, near_length] = LENGTHS;
        let length = (far_length + (near_length - far_length) * near as f32) * shrink;
        let fallen = (phase + time_s * (FALLS[0] + (FALLS[1] - FALLS[0]) * near)).fract() as f32;
        let top = rect.top() - length + fallen * (rect.height() + length);
        let from = egui::pos2(rect.left() + x as f32 * rect.width(), top);
        let colour = Color32::from_rgba_unmultiplied(215, 225, 235, 60 + (70.0 * near) as u8);
        let ends = [from, from + Vec2::new(-LEAN * length, length)];
        painter.line_segment(ends, Stroke::new(0.8 + 0.7 * near as f32, colour));
    }
}

/// A number from 0 to 1 for a number.
fn unit(number: u32) -> f64 {
    let mut bits = number.wrapping_mul(0x9E37_79B9) ^ 0x85EB_CA6B;
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x7FEB_352D);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x846C_A68B);
    f64::from(bits ^ (bits >> 16)) / f64::from(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::unit;

    #[test]
    fn drops_are_spread_over_the_view() {
        let all: Vec<f64> = (0..400).map(unit).collect();
        assert!(all.iter().all(|share| (0.0..=1.0).contains(share)));
        for part in 0..8 {
            let from = f64::from(part) / 8.0;
            let here = all.iter().filter(|share| (from..from + 0.125).contains(*share)).count();
            assert!((25..=80).contains(&here), "{part}: {here}");
        }
    }
}
