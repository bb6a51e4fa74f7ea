//! What only the near level of a car has: lamps with depth behind clear covers, lips of the arches, joints of the
//! bumpers, mirrors on stalks, grille, exhaust.

use super::body::ShellColumn;
use super::shape::{CarShape, Rear};
use super::{
    CHROME, GRILLE, HALF_M, HEAD, INDICATOR, LENS, PAINT, PLASTIC, PrimitiveBuilder, REVERSE, SEAM,
    StaticMaterial, TAIL, WHEEL_RADIUS_M, WHEELBASE_M, WIDTH_M, body,
};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, TAU};

/// Reflector of a headlamp, and the housing of a tail lamp.
const BOWL: StaticMaterial = StaticMaterial::new("bowl", [84, 87, 92]).metal().rough(0.35);
const HOUSING: StaticMaterial = StaticMaterial::new("housing", [52, 10, 12]).rough(0.4);
const REFLECTOR: StaticMaterial = StaticMaterial::new("reflector", [120, 12, 14]).rough(0.35);
const PIPE: StaticMaterial = StaticMaterial::new("pipe", [84, 86, 88]).rough(0.45);
/// Inside of the exhaust and of joints.
const DARK: u8 = 70;

/// Adds a flat face that is seen from `outward`, whichever way its corners run.
pub(super) fn face(
    builder: &mut PrimitiveBuilder,
    mut corners: [Vec3; 4],
    outward: Vec3,
    face_material: StaticMaterial,
    openness: u8,
) {
    let normal = (corners[2] - corners[0]).cross(corners[3] - corners[1]);
    if normal.dot(outward) < 0.0 {
        corners.reverse();
    }
    builder.plate(&corners, face_material, openness);
}

pub(super) fn trim(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    for side in [1.0_f32, -1.0] {
        lamp(builder, shape, 1.0, side);
        lamp(builder, shape, -1.0, side);
        lips(builder, shape, side);
        joints(builder, shape, side);
        mirror(builder, shape, side);
    }
    grille(builder, shape);
    bonnet_gaps(builder, shape);
    exhaust(builder, shape);
    underbody(builder, shape);
    reflectors(builder, shape);
}

/// A lamp: the housing behind the hole in the shell, what shines in it, and its cover.
fn lamp(builder: &mut PrimitiveBuilder, shape: &CarShape, facing: f32, side: f32) {
    let mirrored = |p: Vec3| Vec3::new(p.x, p.y * side, p.z);
    let is_tall = facing < 0.0 && shape.has_tall_lamps();
    let end_side = ShellColumn::Side(if facing > 0.0 { 2.14 } else { -2.22 }, 0.0);
    let end = |f: f32| ShellColumn::End(facing, f);
    let mut columns =
        if is_tall { vec![end(0.82), end(1.0)] } else { vec![end(0.62), end(0.82), end(1.0), end_side] };
    if facing > 0.0 {
        columns.reverse();
    }
    // Those of the shell, so that the cover meets the edge of the hole.
    let rows: &[f32] = if is_tall {
        &[0.36, 0.60, 0.74, 0.76, 0.78, 0.81, 0.84, 0.87, 0.90, 0.92]
    } else {
        &[0.60, 0.74, 0.76, 0.78, 0.81, 0.84, 0.87, 0.90, 0.92]
    };
    let surface = |inwards: Vec3| -> Vec<Vec<Vec3>> {
        let row = |&t: &f32| columns.iter().map(|&c| mirrored(shape.point(c, t)) + inwards).collect();
        let mut points: Vec<Vec<Vec3>> = rows.iter().map(row).collect();
        if side > 0.0 {
            points.reverse();
        }
        points
    };
    // That of a tail lamp is close behind its cover, which one looks through at the corner.
    let inwards = if facing > 0.0 {
        Vec3::new(-0.075, -0.03 * side, 0.0)
    } else {
        Vec3::new(0.045, -0.006 * side, 0.0)
    };
    let (cover, bowl) = (surface(Vec3::ZERO), surface(inwards));
    builder.grid(&cover, |_| 250, |_, _| Some(LENS));
    builder.grid(&bowl, |_| 150, |_, _| Some(if facing > 0.0 { BOWL } else { HOUSING }));
    // The walls between both are seen from inside.
    let (last, last_column) = (rows.len() - 1, columns.len() - 1);
    let middle = bowl.iter().flatten().sum::<Vec3>() / (rows.len() * columns.len()) as f32;
    let mut wall = |a: (usize, usize), b: (usize, usize)| {
        let corners = [cover[a.0][a.1], cover[b.0][b.1], bowl[b.0][b.1], bowl[a.0][a.1]];
        face(builder, corners, middle - corners[0], SEAM, 120);
    };
    for c in 0..last_column {
        wall((0, c), (0, c + 1));
        wall((last, c), (last, c + 1));
    }
    for r in 0..last {
        wall((r, 0), (r + 1, 0));
        wall((r, last_column), (r + 1, last_column));
    }
    let indicator = INDICATOR[usize::from(side < 0.0)];
    let at = |f: f32, t: f32, deep: f32| {
        mirrored(shape.point(ShellColumn::End(facing, f), t)) - Vec3::X * (facing * deep)
    };
    let mut strip = |[f, t]: [[f32; 2]; 2], deep: f32, lamp: StaticMaterial| {
        let middle = (f[0] + f[1]) / 2.0;
        for f in [[f[0], middle], [middle, f[1]]] {
            let corners =
                [at(f[0], t[0], deep), at(f[1], t[0], deep), at(f[1], t[1], deep), at(f[0], t[1], deep)];
            face(builder, corners, Vec3::X * facing, lamp, 250);
        }
    };
    if facing > 0.0 {
        strip([[0.64, 0.99], [0.615, 0.65]], 0.014, HEAD);
        strip([[0.70, 0.99], [0.86, 0.90]], 0.014, indicator);
        for f in [0.72, 0.90] {
            let middle = at(f, 0.755, 0.0);
            for (radius, deep, part) in [(0.064, 0.040, CHROME), (0.050, 0.034, SEAM), (0.040, 0.028, HEAD)] {
                let ring: Vec<Vec3> = (0..12)
                    .map(|k| {
                        let (sin, cos) = (TAU * k as f32 / 12.0).sin_cos();
                        middle + Vec3::new(-deep, radius * cos, radius * sin)
                    })
                    .collect();
                builder.plate(&ring, part, 240);
            }
        }
    } else if is_tall {
        for t in [[0.645, 0.70], [0.725, 0.78], [0.805, 0.86], [0.88, 0.905]] {
            strip([[0.835, 0.945], t], 0.018, TAIL);
        }
        strip([[0.835, 0.945], [0.525, 0.62]], 0.022, indicator);
        strip([[0.835, 0.945], [0.385, 0.495]], 0.022, REVERSE);
    } else {
        for t in [[0.615, 0.66], [0.70, 0.735], [0.86, 0.905]] {
            strip([[0.64, 0.945], t], 0.018, TAIL);
        }
        strip([[0.64, 0.80], [0.77, 0.83]], 0.022, REVERSE);
        strip([[0.83, 0.945], [0.77, 0.83]], 0.022, indicator);
    }
}

/// A point of the side at x and a height, proud of it.
fn on_flank(shape: &CarShape, x: f32, z: f32, (side, out): (f32, f32)) -> Vec3 {
    let high = shape.shoulder_at(x);
    let t = ((z - shape.sill) / (high - shape.sill)).clamp(0.0, 1.0);
    let p = shape.side_point(x, t, 0.0);
    Vec3::new(x, side * (p.y + out), z)
}

/// The lips around the wheel arches.
fn lips(builder: &mut PrimitiveBuilder, shape: &CarShape, side: f32) {
    let material = if shape.clad { PLASTIC } else { PAINT };
    let wide = if shape.clad { 1.20 } else { 1.09 };
    for axle in [-WHEELBASE_M / 2.0, WHEELBASE_M / 2.0] {
        let arc = |scale: f32, out: f32| -> Vec<Vec3> {
            (0..=12)
                .map(|k| {
                    let (sin, cos) = (FRAC_PI_2 * (k as f32 / 6.0 - 1.0)).sin_cos();
                    let radius = scale * body::ARCH_M;
                    on_flank(shape, axle + radius * sin, WHEEL_RADIUS_M * 0.92 + radius * cos, (side, out))
                })
                .collect()
        };
        let mut points = vec![arc(wide, 0.002), arc(1.035, 0.018), arc(0.985, 0.012), arc(0.975, -0.03)];
        if side < 0.0 {
            points.reverse();
        }
        builder.grid(&points, |_| 200, |_, _| Some(material));
    }
}

/// The joints between bumpers and body, and under the doors.
fn joints(builder: &mut PrimitiveBuilder, shape: &CarShape, side: f32) {
    for facing in [1.0_f32, -1.0] {
        let mut columns: Vec<ShellColumn> =
            [0.0, 0.36, 0.62, 0.82, 1.0].map(|f| ShellColumn::End(facing, f)).to_vec();
        columns.extend(
            [if facing > 0.0 { 2.14 } else { 2.22 }, 1.95].map(|x| ShellColumn::Side(facing * x, 0.0)),
        );
        for pair in columns.windows(2) {
            let outward = Vec3::new(facing, side * 0.6, 0.0);
            let at = |column: ShellColumn, t: f32| {
                let p = shape.point(column, t);
                Vec3::new(p.x, p.y * side, p.z) + outward * 0.0035
            };
            let (low, high) = (0.455, 0.472);
            let corners = [at(pair[0], low), at(pair[1], low), at(pair[1], high), at(pair[0], high)];
            face(builder, corners, outward, SEAM, DARK);
        }
    }
    let reach = WHEELBASE_M / 2.0 - 1.3 * body::ARCH_M;
    let z = shape.sill + 0.15 * (shape.shoulder_at(0.0) - shape.sill);
    for k in 0..4 {
        let x = [0, 1].map(|n| reach * ((k + n) as f32 / 2.0 - 1.0));
        let corners = [(x[0], z), (x[1], z), (x[1], z + 0.010), (x[0], z + 0.010)]
            .map(|(x, z)| on_flank(shape, x, z, (side, 0.004)));
        face(builder, corners, Vec3::Y * side, SEAM, DARK);
    }
}

/// A rounded housing on a stalk.
fn mirror(builder: &mut PrimitiveBuilder, shape: &CarShape, side: f32) {
    let x = shape.cabin.stations[5] - 0.34;
    let z = shape.shoulder_at(x) + 0.125;
    let (inner, outer) = (HALF_M - 0.055, WIDTH_M / 2.0);
    // Cross-sections along the housing: share of the way out, and of the size.
    let ring = |(way, size): (f32, f32)| -> Vec<Vec3> {
        (0..=10)
            .map(|k| {
                let (sin, cos) = (TAU * k as f32 / 10.0).sin_cos();
                // Flat behind, where the glass is.
                let ahead = if cos > 0.0 { 0.105 * cos } else { 0.03 * cos };
                let y = inner + (outer - inner) * way;
                Vec3::new(x + size * ahead + 0.01 * (1.0 - way), side * y, z + size * 0.072 * sin)
            })
            .collect()
    };
    let mut points: Vec<Vec<Vec3>> =
        [(0.0, 0.55), (0.06, 0.88), (0.3, 1.0), (0.75, 0.96), (0.93, 0.74), (1.0, 0.40)].map(ring).to_vec();
    let mut caps = [points[0].clone(), points[5].clone()];
    if side > 0.0 {
        points.reverse();
    }
    builder.grid(&points, |_| 230, |_, _| Some(PAINT));
    caps[usize::from(side < 0.0)].reverse();
    for cap in caps {
        builder.plate(&cap[..10], PLASTIC, 200);
    }
    let y = [0.12, 0.88].map(|way| side * (inner + (outer - inner) * way));
    let back = x - 0.034;
    let glass = [(y[0], z - 0.05), (y[1], z - 0.05), (y[1], z + 0.05), (y[0], z + 0.05)];
    face(builder, glass.map(|(y, z)| Vec3::new(back, y, z)), Vec3::NEG_X, CHROME, 255);
    let foot = [side * (HALF_M - 0.20), side * (inner + 0.05)];
    let (low, high) = (foot[0].min(foot[1]), foot[0].max(foot[1]));
    builder.block(Vec3::new(x - 0.01, low, z - 0.085), Vec3::new(x + 0.05, high, z - 0.045), PLASTIC, 190);
}

/// Slats, and the frame around them.
fn grille(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let at = |f: f32, t: f32, out: f32| {
        let p = shape.point(ShellColumn::End(1.0, f.abs()), t);
        Vec3::new(p.x + out, p.y * f.signum(), p.z)
    };
    let mut strip = |half: f32, [t, out]: [[f32; 2]; 2], material| {
        for k in 0..4 {
            let f = [0, 1].map(|n| half * ((k + n) as f32 / 2.0 - 1.0));
            let corners = [
                at(f[0], t[0], out[0]),
                at(f[1], t[0], out[0]),
                at(f[1], t[1], out[1]),
                at(f[0], t[1], out[1]),
            ];
            face(builder, corners, Vec3::X, material, 220);
        }
    };
    for t in [0.615, 0.65, 0.685, 0.72] {
        strip(0.58, [[t, t + 0.012], [0.004, 0.014]], PLASTIC);
    }
    strip(0.60, [[0.745, 0.763], [0.006, 0.006]], CHROME);
    for t in [0.12, 0.18, 0.24] {
        strip(0.60, [[t, t + 0.014], [0.004, 0.016]], GRILLE);
    }
}

/// Two pipes under the rear bumper.
fn exhaust(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let sides: &[f32] = if shape.rear == Rear::Boot { &[1.0, -1.0] } else { &[-1.0] };
    for side in sides {
        let ring = |x: f32, radius: f32| -> Vec<Vec3> {
            (0..=8)
                .map(|k| {
                    let (sin, cos) = (TAU * k as f32 / 8.0).sin_cos();
                    Vec3::new(x, side * 0.62 + radius * cos, shape.sill + 0.035 + radius * sin)
                })
                .collect()
        };
        let rear = shape.end_x(-1.0, 0.6, 0.0) + 0.02;
        builder.grid(&[ring(rear + 0.2, 0.035), ring(rear, 0.035)], |_| 150, |_, _| Some(PIPE));
        let mut mouth = ring(rear + 0.002, 0.033);
        mouth.reverse();
        builder.plate(&mouth[..8], SEAM, DARK);
    }
}

/// The gaps around the bonnet: along the wings and before its leading edge.
fn bonnet_gaps(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    const HALF_WIDTH_M: f32 = 0.006;
    let on = |part: f32, f: f32| shape.on_deck(1.0, shape.bonnet_foot(), part, f) + Vec3::Z * 0.003;
    for side in [1.0_f32, -1.0] {
        let f = [-1.0, 1.0].map(|edge| side * body::BONNET_GAP + edge * HALF_WIDTH_M / HALF_M);
        for pair in body::CLOSE_PARTS[..5].windows(2) {
            let corners = [on(pair[0], f[0]), on(pair[1], f[0]), on(pair[1], f[1]), on(pair[0], f[1])];
            face(builder, corners, Vec3::Z, SEAM, DARK);
        }
    }
    let [rear, front] = body::FRONT_GAP;
    let across = [-body::BONNET_GAP, -0.80, -0.48, -0.40, 0.0, 0.40, 0.48, 0.80, body::BONNET_GAP];
    for pair in across.windows(2) {
        let corners = [on(rear, pair[0]), on(rear, pair[1]), on(front, pair[1]), on(front, pair[0])];
        face(builder, corners, Vec3::Z, SEAM, DARK);
    }
}

/// What hangs under the rear: the beam of the axle, and the silencer of the exhaust.
fn underbody(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    const SIDES: usize = 8;
    let mut tube = |ends: [Vec3; 2], [across, upright]: [f32; 2], material: StaticMaterial| {
        let along = (ends[1] - ends[0]).normalize_or(Vec3::Y);
        let side = along.cross(Vec3::Z);
        let ring = |(end, share): (Vec3, f32)| -> Vec<Vec3> {
            (0..=SIDES)
                .map(|k| {
                    let (sin, cos) = (TAU * k as f32 / SIDES as f32).sin_cos();
                    end + side * (share * across * cos) + Vec3::Z * (share * upright * sin)
                })
                .collect()
        };
        let ends = [(ends[0], 0.0), (ends[0], 1.0), (ends[1], 1.0), (ends[1], 0.0)].map(ring);
        builder.grid(&ends, |_| DARK, |_, _| Some(material));
    };
    let (axle, low) = (-WHEELBASE_M / 2.0, shape.sill);
    let beam = |y: f32| Vec3::new(axle, y, WHEEL_RADIUS_M - 0.06);
    tube([beam(-0.86), beam(0.86)], [0.045, 0.045], SEAM);
    tube([Vec3::new(axle - 0.45, -0.52, low), Vec3::new(axle - 0.45, 0.30, low)], [0.13, 0.075], PIPE);
}

/// Reflectors in the rear bumper.
fn reflectors(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let at = |f: f32, t: f32| {
        let p = shape.point(ShellColumn::End(-1.0, f.abs()), t);
        Vec3::new(p.x - 0.004, p.y * f.signum(), p.z)
    };
    for side in [1.0_f32, -1.0] {
        for f in [[0.66, 0.74], [0.74, 0.82]] {
            let [a, b] = f.map(|f| side * f);
            let corners = [at(a, 0.315), at(b, 0.315), at(b, 0.35), at(a, 0.35)];
            face(builder, corners, Vec3::NEG_X, REFLECTOR, 230);
        }
    }
}
