//! What only the near level of a bus or truck has: clear windows with an interior behind them, and the rails, ribs, hinges and
//! letters of the cargo box.

use super::close::face;
use super::heavy::{HeavyShape, HullRow, on_end, on_side};
use super::heavy_trim::{AMBER, BOX};
use super::interior::{INSIDE, LINING, driver, passenger, seat};
use super::trim::lettering;
use super::{CHROME, DASHBOARD, GLASS, PLASTIC, PrimitiveBuilder, SEAM, StaticMaterial, TAIL};
use glam::Vec3;

const FLOOR: StaticMaterial = StaticMaterial::new("floor", [104, 104, 106]);
const BUS_SEAT: StaticMaterial = StaticMaterial::new("bus_seat", [74, 112, 178]);
const POLE: StaticMaterial = StaticMaterial::new("pole", [222, 176, 46]).rough(0.5);
const ALUMINIUM: StaticMaterial = StaticMaterial::new("aluminium", [150, 153, 157]).rough(0.45);
const REFLECTOR: StaticMaterial = StaticMaterial::new("reflector", [206, 60, 40]).rough(0.4);
const LETTERS: StaticMaterial = StaticMaterial::new("letters", [34, 62, 104]).rough(0.4);
/// Width of the frames of windows and doors.
const FRAME_M: f32 = 0.045;

pub(super) fn trim(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    side_windows(builder, shape);
    if shape.is_truck {
        cargo_box(builder, shape);
    }
}

/// Clear windows and doors, between frames.
fn side_windows(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    let hull = &shape.hull;
    let [low, high] = hull.side_glass.map(|k| hull.rows[k].z);
    let (first, last) = (hull.windows[0][0], hull.windows[hull.windows.len() - 1][1]);
    let (rear_edge, front_edge) = (first - FRAME_M, last + FRAME_M);
    for side in [1.0_f32, -1.0] {
        let doors = if side < 0.0 { hull.doors } else { &[] };
        let mut bars = vec![
            [[rear_edge, front_edge], [high, high + FRAME_M]],
            [[rear_edge, first], [low, high]],
            [[last, front_edge], [low, high]],
        ];
        bars.extend(hull.windows.windows(2).map(|pair| [[pair[0][1], pair[1][0]], [low, high]]));
        // Under the windows, where no door is.
        let mut from = rear_edge;
        for &[rear, front] in doors {
            bars.push([[from, rear], [low - FRAME_M, low]]);
            from = front;
        }
        bars.push([[from, front_edge], [low - FRAME_M, low]]);
        let mut panes: Vec<[[f32; 2]; 2]> =
            hull.windows.iter().map(|&window| [window, [low, high]]).collect();
        for &[rear, front] in doors {
            let middle = (rear + front) / 2.0;
            let leaves = [[rear + 0.05, middle - 0.03], [middle + 0.03, front - 0.05]];
            let (foot, sill, head) = (hull.rows[1].z, 0.52, low - 0.02);
            let upright = [[rear, leaves[0][0]], [leaves[0][1], leaves[1][0]], [leaves[1][1], front]];
            bars.extend(upright.map(|x| [x, [sill, head]]));
            bars.extend([[foot, sill], [head, low]].map(|z| [[rear, front], z]));
            // The leaves go on upwards before the window.
            bars.push([[middle - 0.02, middle + 0.02], [low, high]]);
            panes.extend(leaves.map(|leaf| [leaf, [sill, head]]));
        }
        for bar in bars {
            on_side(builder, shape, (side, 0.010), bar, SEAM);
        }
        for pane in panes {
            on_side(builder, shape, (side, 0.008), pane, GLASS);
        }
    }
}

/// What is seen through the windows.
pub(super) fn interior(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    let under = ceiling_m(shape) - 0.01;
    if shape.is_truck {
        ceiling(builder, [[1.40, 2.80], [-0.82, 0.82]], under);
        cab(builder);
    } else {
        ceiling(builder, [[-5.2, 4.95], [-1.1, 1.1]], under);
        saloon(builder, shape);
    }
}

/// Height of the ceiling: where the roof begins to curve inwards.
pub(super) fn ceiling_m(shape: &HeavyShape) -> f32 {
    let rows = shape.hull.rows;
    let is_wide = |row: &&HullRow| row.half > 0.9 * rows[2].half;
    rows.iter().rev().find(is_wide).map_or(0.0, |row| row.z)
}

fn ceiling(builder: &mut PrimitiveBuilder, [x, y]: [[f32; 2]; 2], z: f32) {
    let corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])];
    face(builder, corners.map(|(x, y)| Vec3::new(x, y, z)), Vec3::NEG_Z, LINING, 150);
}

fn floor(builder: &mut PrimitiveBuilder, [x, y]: [[f32; 2]; 2], z: f32) {
    let corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])];
    builder.plate(&corners.map(|(x, y)| Vec3::new(x, y, z)), FLOOR, 110);
}

/// The seats of a truck's cab.
fn cab(builder: &mut PrimitiveBuilder) {
    const FLOOR_M: f32 = 0.80;
    floor(builder, [[1.36, 3.2], [-0.95, 0.95]], FLOOR_M);
    builder.block(Vec3::new(2.64, -0.9, 1.0), Vec3::new(3.18, 0.9, 1.33), DASHBOARD, 140);
    for y in [-0.42, 0.42] {
        seat(builder, Vec3::new(2.1, y, FLOOR_M));
    }
    driver(builder, Vec3::new(2.1, 0.42, FLOOR_M));
}

/// Benches with passengers, poles and the driver of a bus.
fn saloon(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    const FLOOR_M: f32 = 0.45;
    floor(builder, [[-5.3, 5.2], [-1.2, 1.2]], FLOOR_M);
    wheel_boxes(builder, shape, FLOOR_M);
    for bench in 0..10 {
        let x = -4.55 + 0.85 * bench as f32;
        for side in [1.0_f32, -1.0] {
            let is_at_door =
                shape.hull.doors.iter().any(|[rear, front]| (rear - 0.3..front + 0.4).contains(&x));
            if side < 0.0 && is_at_door {
                continue;
            }
            let mut block = |[x0, x1]: [f32; 2], y: [f32; 2], z: [f32; 2]| {
                let y = if side > 0.0 { y } else { [-y[1], -y[0]] };
                builder.block(Vec3::new(x + x0, y[0], z[0]), Vec3::new(x + x1, y[1], z[1]), BUS_SEAT, INSIDE);
            };
            block([-0.25, 0.20], [0.36, 1.14], [1.02, 1.12]);
            for y in [[0.36, 0.73], [0.77, 1.14]] {
                block([-0.33, -0.25], y, [1.06, 1.80]);
            }
        }
    }
    // Benches and places of passengers, from the rear.
    for (number, (bench, y)) in
        [(0.0, -0.55), (1.0, 0.95), (3.0, 0.55), (4.0, -0.95), (6.0, 0.95), (7.0, 0.55), (8.0, -0.95)]
            .into_iter()
            .enumerate()
    {
        passenger(builder, Vec3::new(-4.56 + 0.85 * bench, y, 0.88), number);
    }
    for (x, y) in [(-2.2, 0.33), (-2.2, -0.33), (-0.72, -0.36), (0.66, -0.36), (1.9, 0.33), (3.72, -0.36)] {
        let half = Vec3::new(0.018, 0.018, 0.0);
        builder.block(Vec3::new(x, y, FLOOR_M) - half, Vec3::new(x, y, 2.78) + half, POLE, 200);
    }
    // The driver sits higher than a passenger stands.
    let seat_at = Vec3::new(4.3, 0.66, 0.75);
    builder.block(Vec3::new(3.82, 0.28, FLOOR_M), Vec3::new(4.85, 1.16, seat_at.z), LINING, 130);
    builder.block(Vec3::new(3.80, 0.28, FLOOR_M), Vec3::new(3.84, 1.16, 1.75), LINING, 150);
    builder.block(Vec3::new(4.9, -0.9, FLOOR_M), Vec3::new(5.3, 0.95, 1.0), DASHBOARD, 140);
    seat(builder, seat_at);
    driver(builder, seat_at);
}

/// Boxes over the wheel wells, which are open towards the wheels.
fn wheel_boxes(builder: &mut PrimitiveBuilder, shape: &HeavyShape, floor_m: f32) {
    const HALF_M: f32 = 0.62;
    const TOP_M: f32 = 1.06;
    for axle in [-1.0_f32, 1.0] {
        let x = axle * shape.wheelbase / 2.0;
        for side in [1.0_f32, -1.0] {
            let (inner, outer) = (side * 0.78, side * 1.2);
            let at = |dx: f32, y: f32, z: f32| Vec3::new(x + dx, y, z);
            let mut quad = |corners: [Vec3; 4], outward: Vec3| face(builder, corners, outward, LINING, 130);
            let across = [(-HALF_M, inner), (HALF_M, inner), (HALF_M, outer), (-HALF_M, outer)];
            quad(across.map(|(dx, y)| at(dx, y, TOP_M)), Vec3::Z);
            let upright = |a: (f32, f32), b: (f32, f32)| {
                [at(a.0, a.1, floor_m), at(b.0, b.1, floor_m), at(b.0, b.1, TOP_M), at(a.0, a.1, TOP_M)]
            };
            quad(upright(across[0], across[1]), Vec3::NEG_Y * side);
            quad(upright(across[0], across[3]), Vec3::NEG_X);
            quad(upright(across[1], across[2]), Vec3::X);
        }
    }
}

/// Rails, ribs and letters along the sides of the box; frame, hinges and handles of its doors. Nothing stands out
/// by more than the error of the usual level.
fn cargo_box(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    const HALF_M: f32 = 1.2;
    const LOW_M: f32 = 0.94;
    /// Rail between the ribs and the letters.
    const MIDDLE_M: f32 = 1.93;
    let (rear, front, high) = (-shape.length / 2.0 + 0.02, 1.26, shape.height);
    for side in [1.0_f32, -1.0] {
        let mut strip = |x: [f32; 2], z: [f32; 2], out: f32, material: StaticMaterial| {
            let y = [side * (HALF_M - 0.01), side * (HALF_M + out)];
            let (low, high) = (y[0].min(y[1]), y[0].max(y[1]));
            builder.block(Vec3::new(x[0], low, z[0]), Vec3::new(x[1], high, z[1]), material, 235);
        };
        for z in [[LOW_M, LOW_M + 0.10], [MIDDLE_M, MIDDLE_M + 0.05], [high - 0.15, high - 0.055]] {
            strip([rear + 0.05, front - 0.05], z, 0.018, ALUMINIUM);
        }
        for x in [[rear + 0.04, rear + 0.12], [front - 0.12, front - 0.04]] {
            strip(x, [LOW_M + 0.05, high - 0.06], 0.020, ALUMINIUM);
        }
        for rib in 1..13 {
            let x = rear + 0.08 + (front - rear - 0.16) * rib as f32 / 13.0;
            strip([x - 0.025, x + 0.025], [LOW_M + 0.54, MIDDLE_M], 0.014, BOX);
        }
        for lamp in 0..4 {
            let x = rear + 0.5 + 1.2 * lamp as f32;
            strip([x - 0.05, x + 0.05], [LOW_M + 0.03, LOW_M + 0.07], 0.022, AMBER);
        }
        letters(builder, side, Vec3::new((rear + front) / 2.0, side * (HALF_M + 0.004), 2.385));
    }
    let mut on_doors = |y: [f32; 2], z: [f32; 2], out: f32, material: StaticMaterial| {
        on_end(builder, shape, (-1.0, out), [y, z], material);
    };
    // The frame around the doors.
    for y in [[-1.16, -1.08], [1.08, 1.16]] {
        on_doors(y, [LOW_M + 0.05, high - 0.05], 0.010, ALUMINIUM);
    }
    for z in [[LOW_M + 0.05, LOW_M + 0.12], [high - 0.13, high - 0.05]] {
        on_doors([-1.08, 1.08], z, 0.010, ALUMINIUM);
    }
    for side in [1.0_f32, -1.0] {
        let span = |a: f32, b: f32| if side > 0.0 { [a, b] } else { [-b, -a] };
        // Marker lamps above, and the housing of the lamps below.
        on_doors(span(1.0, 1.08), [high - 0.11, high - 0.07], 0.014, TAIL);
        on_doors(span(0.52, 1.10), [0.64, 0.82], 0.011, SEAM);
        on_doors(span(0.30, 0.46), [0.69, 0.75], 0.014, REFLECTOR);
        for hinge in 0..4 {
            let z = LOW_M + 0.25 + 0.48 * hinge as f32;
            on_doors(span(0.96, 1.12), [z, z + 0.06], 0.018, CHROME);
        }
        // Handles and guides of the lock rods.
        on_doors(span(0.22, 0.44), [LOW_M + 0.34, LOW_M + 0.38], 0.022, CHROME);
        for z in [LOW_M + 0.18, LOW_M + 0.90, high - 0.30] {
            on_doors(span(0.20, 0.28), [z, z + 0.06], 0.020, PLASTIC);
            on_doors(span(0.38, 0.46), [z, z + 0.06], 0.020, PLASTIC);
        }
    }
}

/// The name on a side of the box, in squares.
fn letters(builder: &mut PrimitiveBuilder, side: f32, middle: Vec3) {
    const SQUARE_M: f32 = 0.075;
    const ROWS: [&str; 7] = [
        " ###  ### ##### #   # ####  #### ",
        "#   #  #    #   #   #     # #   #",
        "#      #    #    # #      # #   #",
        "#      #    #     #    ###  #   #",
        "#      #    #     #       # #   #",
        "#   #  #    #     #       # #   #",
        " ###  ###   #     #   ####  #### ",
    ];
    lettering(builder, &ROWS, LETTERS, middle, Vec3::NEG_X * (side * SQUARE_M));
}
