//! Texture layers of letters and road signs, one glyph per cell.

use super::patterns::{Texel, grey};
use city3d_scene::{glyph_cell, sign_cell};

/// Distance from a point to a segment.
fn to_segment([x, y]: [f32; 2], [ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
    let (dx, dy) = (bx - ax, by - ay);
    let t = (((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy).max(1e-6)).clamp(0.0, 1.0);
    (x - ax - t * dx).hypot(y - ay - t * dy)
}

/// Letters as dark strokes that join the set cells of a five by seven bitmap.
pub(super) fn letters(at: [f32; 2]) -> Texel {
    let Some((rows, [x, y])) = glyph_cell(at) else { return grey(1.0) };
    // Cell units: six wide and nine high, the letter's grid in the middle.
    let (x, y) = (x * 6.0, y * 9.0);
    let set = |column: i32, row: i32| {
        (0..5).contains(&column) && (0..7).contains(&row) && rows[6 - row as usize] >> (4 - column) & 1 == 1
    };
    let centre = |column: i32, row: i32| [column as f32 + 1.0, row as f32 + 1.5];
    let (near_column, near_row) = ((x - 1.0).round() as i32, (y - 1.5).round() as i32);
    let mut distance = f32::INFINITY;
    for row in near_row - 1..=near_row + 1 {
        for column in near_column - 1..=near_column + 1 {
            if !set(column, row) {
                continue;
            }
            let here = centre(column, row);
            distance = distance.min(to_segment([x, y], here, here));
            for (dc, dr) in [(1, 0), (0, 1), (1, 1), (-1, 1)] {
                let straight = dc == 0 || dr == 0;
                // Diagonals only where no corner goes round.
                if set(column + dc, row + dr)
                    && (straight || !(set(column + dc, row) || set(column, row + dr)))
                {
                    distance = distance.min(to_segment([x, y], here, centre(column + dc, row + dr)));
                }
            }
        }
    }
    let ink = ((0.50 - distance) / 0.22 + 0.5).clamp(0.0, 1.0);
    grey(1.0 - 0.90 * ink)
}

const RED: [f32; 3] = [0.78, 0.08, 0.09];
const BLUE: [f32; 3] = [0.05, 0.25, 0.62];
const WHITE: [f32; 3] = [0.97, 0.97, 0.96];
const BLACK: [f32; 3] = [0.06, 0.06, 0.07];
const YELLOW: [f32; 3] = [0.98, 0.76, 0.10];

/// Road signs: x to the right and y upwards from -1 to 1 in each cell.
pub(super) fn signs(at: [f32; 2]) -> Texel {
    let (index, [u, v]) = sign_cell(at);
    let (x, y) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let r = x.hypot(y);
    let colour = match index {
        // Give way: a triangle on its tip.
        0 => {
            let inside = (0.62 - y).min((y + 1.0) / 2.0_f32.hypot(1.0) * 1.05 - x.abs() * 0.88);
            if inside > 0.24 { WHITE } else { RED }
        }
        // Stop.
        1 => stop(x, y),
        // Roundabout: three arrows that chase one another.
        2 => roundabout(x, y, r),
        // Parking.
        3 => {
            let stem = (-0.42..-0.16).contains(&x) && (-0.62..0.62).contains(&y);
            let bowl = (x + 0.10).max(0.0).hypot(y - 0.22);
            let ring = x > -0.42 && (0.16..0.40).contains(&bowl) && x < 0.42;
            if stem || ring { WHITE } else { BLUE }
        }
        // Priority road.
        4 => {
            let inside = 1.0 - x.abs() - y.abs();
            if inside > 0.34 {
                YELLOW
            } else if inside > 0.04 {
                WHITE
            } else {
                BLACK
            }
        }
        // Speed limit of 30.
        5 => {
            if r > 0.72 {
                RED
            } else if thirty(x, y) {
                BLACK
            } else {
                WHITE
            }
        }
        // A name board, blank.
        _ => WHITE,
    };
    (colour, 0.8)
}

fn roundabout(x: f32, y: f32, r: f32) -> [f32; 3] {
    if r > 0.93 {
        return WHITE;
    }
    let turn = y.atan2(x) / std::f32::consts::TAU * 3.0;
    let part = (turn + 9.0).fract();
    // Each arrow runs counter-clockwise: a shaft, then a head that narrows.
    let half = if part < 0.55 { 0.085 } else { 0.24 * (1.0 - (part - 0.55) / 0.33).max(0.0) };
    if (r - 0.52).abs() < half && part > 0.06 { WHITE } else { BLUE }
}

fn stop(x: f32, y: f32) -> [f32; 3] {
    let edge = x.abs().max(y.abs()).max((x.abs() + y.abs()) * std::f32::consts::FRAC_1_SQRT_2);
    if edge > 0.86 {
        return WHITE;
    }
    // Four letters between -0.74 and 0.74.
    let column = ((x + 0.74) / 0.37).floor();
    let (lx, ly) = (((x + 0.74) / 0.37).fract() * 2.0 - 1.0, y / 0.30);
    if !(0.0..4.0).contains(&column) || ly.abs() > 1.0 || lx.abs() > 0.74 {
        return RED;
    }
    let w = 0.26;
    let ink = match column as i32 {
        0 => {
            let bars = ly.abs() > 0.72 || ly.abs() < 0.14;
            bars || (ly > 0.0 && lx < -0.74 + 2.0 * w) || (ly < 0.0 && lx > 0.74 - 2.0 * w)
        }
        1 => ly > 0.72 || lx.abs() < w,
        2 => (lx.hypot(ly * 0.74) - 0.56).abs() < 0.20,
        _ => {
            lx < -0.74 + 2.0 * w
                || (ly > 0.72 || (0.0..0.28).contains(&ly))
                || (ly > 0.0 && lx > 0.74 - 1.6 * w)
        }
    };
    if ink { WHITE } else { RED }
}

fn thirty(x: f32, y: f32) -> bool {
    let zero = |cx: f32| {
        let d = ((x - cx) / 0.20).hypot(y / 0.40);
        (0.62..1.0).contains(&d)
    };
    let three = {
        let top = ((x + 0.24) / 0.19).hypot((y - 0.19) / 0.20);
        let low = ((x + 0.24) / 0.21).hypot((y + 0.19) / 0.21);
        ((0.55..1.0).contains(&top) || (0.55..1.0).contains(&low)) && (x > -0.26 || y.abs() > 0.26)
    };
    three || zero(0.24)
}
