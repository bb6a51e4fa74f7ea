//! Trim of a body: mirrors, door seams, handles, number plates, rails, arches.

use super::shape::{CarShape, Rear};
use super::{
    CHROME, CarDetail, HALF_M, LENGTH_M, NUMBER, PAINT, PLASTIC, PLATE, PrimitiveBuilder, SEAM,
    StaticMaterial, TAIL, WHEEL_RADIUS_M, WHEELBASE_M, WIDTH_M,
};
use super::{body, close, wheel};
use glam::{Vec2, Vec3};

/// Of a taxi's sign.
const SIGN: StaticMaterial = StaticMaterial::new("sign", [244, 226, 150]).rough(0.5);

pub(super) fn trim(builder: &mut PrimitiveBuilder, shape: &CarShape, detail: CarDetail) {
    match detail {
        CarDetail::Near | CarDetail::Close => {}
        CarDetail::Far => {
            sign(builder, shape);
            mirrors(builder, shape);
            sills(builder, shape);
            number_plates(builder, shape, detail);
            arches(builder);
            return;
        }
        CarDetail::Farther => {
            sign(builder, shape);
            flat_mirrors(builder, shape);
            wheel::painted(builder, [WHEELBASE_M, WHEEL_RADIUS_M, HALF_M, 0.22]);
            return;
        }
    }
    if detail == CarDetail::Close {
        close::trim(builder, shape);
    } else {
        mirrors(builder, shape);
    }
    for side in [1.0_f32, -1.0] {
        let [_, _, _, pillar, _, front_foot] = shape.cabin.stations;
        let front = front_foot - 0.22;
        let rear = shape.rear_door();
        let doors: &[f32] = match shape.rear {
            Rear::Cargo => &[front, pillar],
            Rear::Bed => &[front, shape.cabin.stations[0] + 0.05, pillar],
            _ => &[front, pillar, rear],
        };
        for &x in doors {
            seam(builder, shape, x, (side, detail));
        }
        for x in [pillar + 0.14, rear + 0.22] {
            if x > pillar || matches!(shape.rear, Rear::Boot | Rear::Hatch) {
                let at = on_side(shape, x, 0.80, side);
                let (low, high) = (at - Vec3::new(0.09, 0.022, 0.016), at + Vec3::new(0.09, 0.022, 0.016));
                builder.block(low, high, if shape.clad { PLASTIC } else { PAINT }, 230);
            }
        }
        if shape.rails {
            let [_, rear_roof, _, _, front_roof, _] = shape.cabin.stations;
            let y = side * (shape.cabin.roof_half - 0.06);
            let z = shape.cabin.roof[0];
            let (low, high) =
                (Vec3::new(rear_roof + 0.15, y - 0.02, z), Vec3::new(front_roof - 0.1, y + 0.02, z + 0.065));
            builder.block(low, high, PLASTIC, 240);
        }
    }
    sign(builder, shape);
    if detail == CarDetail::Near {
        bonnet_gaps(builder, shape);
    }
    number_plates(builder, shape, detail);
    ends(builder, shape);
}

/// The sign on the roof of a taxi.
fn sign(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    if !shape.sign {
        return;
    }
    let [_, rear_roof, _, _, front_roof, _] = shape.cabin.stations;
    let (x, low) = ((rear_roof + front_roof) / 2.0, shape.cabin.roof[1] - 0.01);
    let ring = |half_x: f32, half_y: f32, z: f32| {
        [(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)]
            .map(|(dx, y)| Vec3::new(x + dx, y, z))
    };
    let (foot, top) = (ring(0.10, 0.28, low), ring(0.06, 0.22, shape.height));
    for k in 0..4 {
        let n = (k + 1) % 4;
        builder.plate(&[foot[k], foot[n], top[n], top[k]], SIGN, 250);
        // Lettering: a dark strip on both faces.
        if k % 2 == 1 {
            let at = |a: f32, b: f32| foot[k].lerp(foot[n], a).lerp(top[k].lerp(top[n], a), b);
            let out = Vec3::X * if k == 1 { 0.004 } else { -0.004 };
            let corners = [at(0.28, 0.3), at(0.72, 0.3), at(0.72, 0.75), at(0.28, 0.75)];
            builder.plate(&corners.map(|corner| corner + out), SEAM, 240);
        }
    }
    builder.plate(&top, SIGN, 255);
}

/// The gaps along the sides of the bonnet: creases in the paint, as black lines of a centimetre break into dots from afar.
fn bonnet_gaps(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    const HALF_WIDTH_M: f32 = 0.008;
    let on = |part: f32, f: f32| shape.on_deck(1.0, shape.bonnet_foot(), part, f) + Vec3::Z * 0.003;
    for sign in [1.0_f32, -1.0] {
        for pair in [0.02, 0.35, 0.7, 0.95].windows(2) {
            let f = [-1.0, 1.0].map(|edge| sign * body::BONNET_GAP + edge * HALF_WIDTH_M / HALF_M);
            builder.plate(
                &[on(pair[0], f[0]), on(pair[1], f[0]), on(pair[1], f[1]), on(pair[0], f[1])],
                PAINT,
                60,
            );
        }
    }
}

fn on_side(shape: &CarShape, x: f32, t: f32, side: f32) -> Vec3 {
    let p = shape.side_point(x, t, 0.0);
    Vec3::new(p.x, side * (p.y + 0.004), p.z)
}

/// A dark line down a side where two doors meet.
fn seam(builder: &mut PrimitiveBuilder, shape: &CarShape, x: f32, (side, detail): (f32, CarDetail)) {
    const HALF_WIDTH_M: f32 = 0.006;
    // All rows of the shell, so that it bulges out nowhere between them.
    let rows: &[f32] = match detail {
        CarDetail::Close => &[0.15, 0.36, 0.60, 0.76, 0.78, 0.81, 0.84, 0.87, 0.90, 0.92, 0.99],
        _ => &[0.15, 0.36, 0.60, 0.76, 0.92, 0.99],
    };
    for pair in rows.windows(2) {
        let corner = |dx: f32, t: f32| on_side(shape, x + dx, t, side);
        let (a, b) = if side > 0.0 { (HALF_WIDTH_M, -HALF_WIDTH_M) } else { (-HALF_WIDTH_M, HALF_WIDTH_M) };
        let corners = [corner(a, pair[0]), corner(b, pair[0]), corner(b, pair[1]), corner(a, pair[1])];
        builder.plate(&corners, SEAM, 200);
    }
}

/// How far out a door's mirror begins and ends: at the body's widest points.
const MIRROR_M: [f32; 2] = [HALF_M - 0.17, WIDTH_M / 2.0];

/// x of both, and their lower edges.
fn mirrors_at(shape: &CarShape) -> [f32; 2] {
    let x = shape.cabin.stations[5] - 0.32;
    [x, shape.shoulder_at(x) + 0.01]
}

/// A foot and a housing with its glass.
fn mirrors(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let [x, z] = mirrors_at(shape);
    for side in [1.0_f32, -1.0] {
        let [inner, outer] = MIRROR_M.map(|y| side * y);
        let (low, high) = (inner.min(outer), inner.max(outer));
        builder.block(Vec3::new(x - 0.05, low, z), Vec3::new(x + 0.07, high, z + 0.14), PAINT, 240);
        let (a, b) = (outer - side * 0.015, outer - side * 0.15);
        let (a, b) = (a.max(b), a.min(b));
        let back = x - 0.052;
        let glass = [(a, z + 0.015), (b, z + 0.015), (b, z + 0.125), (a, z + 0.125)];
        builder.plate(&glass.map(|(y, z)| Vec3::new(back, y, z)), CHROME, 255);
    }
}

/// Mirrors without depth, for the greatest distance.
fn flat_mirrors(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let [x, z] = mirrors_at(shape);
    for side in [1.0_f32, -1.0] {
        let [inner, outer] = MIRROR_M.map(|y| side * y);
        let mut corners =
            [(inner, z), (outer, z), (outer, z + 0.14), (inner, z + 0.14)].map(|(y, z)| Vec3::new(x, y, z));
        builder.plate(&corners, PAINT, 240);
        corners.reverse();
        builder.plate(&corners, PAINT, 240);
    }
}

/// How far trim protrudes from an end.
const PROUD_M: f32 = 0.004;

/// A vertical plate at a distance in front of an end: edges from left to right and from below, seen from
/// outside.
fn on_end(
    builder: &mut PrimitiveBuilder,
    shape: &CarShape,
    facing: f32,
    out: f32,
    [across, z]: [[f32; 2]; 2],
    face_material: StaticMaterial,
) {
    let corners = [[across[0], z[0]], [across[1], z[0]], [across[1], z[1]], [across[0], z[1]]];
    let x = facing * (end_before(shape, facing, z) + out);
    builder.plate(&corners.map(|[y, z]| Vec3::new(x, facing * y, z)), face_material, 240);
}

/// How far the middle of an end reaches between two heights.
fn end_before(shape: &CarShape, facing: f32, z: [f32; 2]) -> f32 {
    let high = shape.shoulder_at(facing * LENGTH_M / 2.0);
    let reach = |z: f32| {
        let t = ((z - shape.sill) / (high - shape.sill)).clamp(0.0, 1.0);
        shape.end_x(facing, 0.0, t).abs()
    };
    reach(z[0]).max(reach(z[1]))
}

fn number_plates(builder: &mut PrimitiveBuilder, shape: &CarShape, detail: CarDetail) {
    const HALF_M: f32 = 0.26;
    const HIGH_M: f32 = 0.11;
    let front = shape.shoulder_at(LENGTH_M / 2.0);
    let rear = shape.shoulder_at(-LENGTH_M / 2.0);
    let row = |end: f32, t: f32| shape.sill + t * (end - shape.sill);
    let behind = if shape.rear == Rear::Bed { 0.30 } else { 0.56 };
    for (facing, z) in [(1.0, row(front, 0.40)), (-1.0, row(rear, behind))] {
        on_end(builder, shape, facing, PROUD_M, [[-HALF_M, HALF_M], [z, z + HIGH_M]], PLATE);
        if detail.is_near() {
            // On the plate, wherever the end below it is.
            let x = end_before(shape, facing, [z, z + HIGH_M]) + PROUD_M + 0.002;
            let middle = Vec3::new(facing * x, 0.0, z + HIGH_M / 2.0);
            registration(builder, facing, middle);
        }
    }
}

/// Edge of a square of the lettering on number plates.
const SQUARE_M: f32 = 0.0145;
/// Squares along the lettering: three letters, a space and three digits, each three wide, with one between them and three
/// for the space.
const COLUMNS: f32 = 26.0;
/// Squares along and up the three digits.
const DIGITS: Vec2 = Vec2::new(11.0, 5.0);
/// The letters, of three by five squares.
const LETTERS: [&str; 5] = ["### ### ## ", "#     # # #", "#    ## # #", "#     # # #", "### ### ## "];

/// Lettering of a number plate. Every vehicle has a number of its own, so a shader draws the digits, in texture
/// coordinates that count squares.
pub(super) fn registration(builder: &mut PrimitiveBuilder, facing: f32, middle: Vec3) {
    let (right, up) = (Vec3::Y * (facing * SQUARE_M), Vec3::Z * SQUARE_M);
    let off_middle = (COLUMNS - DIGITS.x) / 2.0;
    lettering(builder, &LETTERS, SEAM, middle - right * off_middle, right);
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(u, v)| {
        let uv = DIGITS * Vec2::new(u, v);
        let off = uv - DIGITS / 2.0;
        (middle + right * (off_middle + off.x) + up * off.y, uv)
    });
    builder.mapped_plate(corners, NUMBER, 240);
}

/// Lettering made of squares: one to the right is at `right`, the middle of all at `middle`.
pub(super) fn lettering(
    builder: &mut PrimitiveBuilder,
    rows: &[&str],
    ink: StaticMaterial,
    middle: Vec3,
    right: Vec3,
) {
    let up = Vec3::Z * right.length();
    let at = |column: usize, row: usize| {
        let (along, down) =
            (column as f32 - rows[0].len() as f32 / 2.0, row as f32 - rows.len() as f32 / 2.0);
        middle + right * along - up * down
    };
    for (row, squares) in rows.iter().enumerate() {
        let is_inked = |column: usize| squares.as_bytes().get(column) == Some(&b'#');
        let mut column = 0;
        while column < squares.len() {
            let first = column;
            while is_inked(column) {
                column += 1;
            }
            if column > first {
                let corners = [at(first, row + 1), at(column, row + 1), at(column, row), at(first, row)];
                builder.plate(&corners, ink, 240);
            }
            column += 1;
        }
    }
}

fn ends(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let front = shape.shoulder_at(LENGTH_M / 2.0);
    let row = |end: f32, t: f32| shape.sill + t * (end - shape.sill);
    // The third brake light, under the rear edge of the roof.
    let [_, rear_roof, ..] = shape.cabin.stations;
    let z = shape.cabin.roof[0] - 0.045;
    let x = rear_roof - 0.06;
    let lamp = [(0.16, z - 0.03), (-0.16, z - 0.03), (-0.16, z), (0.16, z)];
    builder.plate(&lamp.map(|(y, z)| Vec3::new(x, y, z)), TAIL, 240);
    if shape.rear == Rear::Boot {
        let z = row(front, 0.745);
        on_end(builder, shape, 1.0, PROUD_M, [[-0.38, 0.38], [z, z + 0.014]], CHROME);
    }
}

/// The dark lower edge between the wheels, for a distance.
fn sills(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let reach = WHEELBASE_M / 2.0 - 1.19 * WHEEL_RADIUS_M;
    for side in [1.0_f32, -1.0] {
        let ends = if side > 0.0 { [reach, -reach] } else { [-reach, reach] };
        let corner = |k: usize, t: f32| on_side(shape, ends[k], t, side);
        builder.plate(&[corner(0, 0.0), corner(1, 0.0), corner(1, 0.15), corner(0, 0.15)], PLASTIC, 150);
    }
}

/// Dark discs instead of wheel wells, for a distance.
fn arches(builder: &mut PrimitiveBuilder) {
    for axle in [-WHEELBASE_M / 2.0, WHEELBASE_M / 2.0] {
        for side in [-1.0_f32, 1.0] {
            let y = side * (HALF_M - 0.16);
            let r = 1.3 * WHEEL_RADIUS_M;
            let ring = [(-r, 0.2), (r, 0.2), (r, 0.5), (0.5 * r, 0.8), (-0.5 * r, 0.8), (-r, 0.5)];
            let mut ring = ring.map(|(x, z)| Vec3::new(axle + x, y, z));
            if side > 0.0 {
                ring.reverse();
            }
            builder.plate(&ring, SEAM, 120);
        }
    }
}
