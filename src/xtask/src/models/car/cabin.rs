//! The cabin: windscreen and rear window, side windows between pillars, roof.

use super::shape::{CarShape, Rear};
use super::{
    CarDetail, DASHBOARD, GLASS, HALF_M, PAINT, PLASTIC, PrimitiveBuilder, SEAM, StaticMaterial, TINTED,
    WIPER, close,
};
use glam::Vec3;

/// Rows of the cabin from its foot to the middle of the roof: part of its height, part of the way from
/// the half width at the foot to that of the roof, and for the middle rows part of the roof's half width.
const FOOT: usize = 0;
const SILL: usize = 1;
const RAIL: usize = 2;
const GUTTER: usize = 3;

struct CabinStation {
    x: f32,
    /// Height of the roof, in its middle.
    roof: f32,
    /// The foot of a window: the rows lie in one line there.
    at_foot: bool,
}

fn stations(shape: &CarShape, detail: CarDetail) -> Vec<CabinStation> {
    let [rear_foot, rear_roof, rear_glass, pillar, front_roof, front_foot] = shape.cabin.stations;
    let [rear, top, front] = shape.cabin.roof;
    let on = |x: f32| {
        let middle = (rear_roof + front_roof) / 2.0;
        let t = ((x - middle) / (front_roof - middle)).clamp(-1.0, 1.0);
        top + (if t > 0.0 { front } else { rear } - top) * t * t
    };
    let station = |x: f32| CabinStation { x, roof: on(x), at_foot: false };
    let foot = |x: f32| CabinStation { x, roof: 0.0, at_foot: true };
    let mut all = vec![foot(rear_foot), station(rear_roof)];
    if detail.is_near() {
        if rear_glass > rear_roof && rear_glass < pillar {
            all.push(station(rear_glass));
        }
        if shape.rear == Rear::Cargo {
            // Where the flanks begin to turn inwards.
            all.push(station(-1.8));
        }
        all.extend([station(pillar - 0.06), station(pillar + 0.06)]);
    } else if shape.rear == Rear::Cargo {
        all.push(station(pillar));
    }
    all.extend([station(front_roof), foot(front_foot)]);
    all
}

fn section(shape: &CarShape, station: &CabinStation, bulge: f32, detail: CarDetail) -> Vec<Vec3> {
    let x = station.x;
    let base = shape.shoulder_at(x) - 0.012;
    let (half, boxiness) = (shape.half_at(x), shape.boxiness(x));
    // From shoulder to roof the flanks of a box are nearly upright, and follow those below along its length.
    let wide = half * (0.875 + 0.091 * boxiness);
    let roof_half = shape.cabin.roof_half * (1.0 + boxiness * (half / HALF_M - 1.0));
    let top = if station.at_foot { wide * 0.94 } else { roof_half };
    let high = match (station.at_foot, detail) {
        (false, _) => station.roof,
        (true, CarDetail::Near | CarDetail::Close) => base + shape.crown + 0.02,
        // Under the bonnet and the boot, which are flatter there: else a slit is left between them.
        (true, _) => base - 0.02,
    };
    let rise = high - base;
    // The sides curve inwards towards the roof.
    let rows = [
        // Well under the shoulders of the shell, so that no slit is left between them.
        (half * (0.92 + 0.052 * boxiness), base - 0.09),
        (wide + (top - wide) * 0.06, base + 0.07 * rise),
        (wide + (top - wide) * 0.86, base + 0.86 * rise),
        (top * 0.985, base + 0.945 * rise),
        (top * 0.80, base + 0.99 * rise),
        (0.0, high),
    ];
    let forward = |y: f32| bulge * (1.0 - (y / wide).powi(2));
    let mut ring: Vec<Vec3> = rows.iter().map(|&(y, z)| Vec3::new(x + forward(y), -y, z)).collect();
    ring.extend(rows.iter().rev().skip(1).map(|&(y, z)| Vec3::new(x + forward(y), y, z)));
    ring
}

pub(super) fn cabin(builder: &mut PrimitiveBuilder, shape: &CarShape, detail: CarDetail) {
    let stations = stations(shape, detail);
    let last = stations.len() - 1;
    // The kept points of a section, and the material above each.
    let (kept, rows): (&[usize], &[usize]) = match detail {
        CarDetail::Farther => (&[0, 2, 4, 6, 8, 10], &[SILL, RAIL, GUTTER]),
        _ => (&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10], &[FOOT, SILL, RAIL, GUTTER, GUTTER]),
    };
    let sections: Vec<Vec<Vec3>> = stations
        .iter()
        .enumerate()
        .map(|(k, station)| {
            let bulge = match k {
                0 => -0.05,
                k if k == last => BULGE_M,
                _ => 0.0,
            };
            let whole = section(shape, station, bulge, detail);
            kept.iter().map(|&point| whole[point]).collect()
        })
        .collect();
    let points = sections[0].len() - 1;
    // Windscreen and rear window by themselves, so that their edges stay sharp.
    for (range, end) in [(0..2, Some(-1.0)), (1..last, None), (last - 1..last + 1, Some(1.0))] {
        let first = range.start;
        // Sections run forwards and points over the top from right to left: outwards is along
        // (next point) x (next section) turned about, so sections go backwards.
        let part: Vec<Vec<Vec3>> = sections[range.clone()].iter().rev().cloned().collect();
        let count = part.len() - 1;
        builder.grid(
            &part,
            |_| 250,
            |row, point| {
                let station = first + count - 1 - row;
                let up = rows[point.min(points - 1 - point)];
                Some(face_material(shape, detail, &stations, station, up, end))
            },
        );
    }
    if detail.is_near() {
        // Behind the edges of boot and bonnet the windows go on downwards, so that no slit is left there.
        let under = |end: usize, inwards: f32| -> Vec<Vec3> {
            sections[end].iter().map(|&point| point + Vec3::new(inwards, 0.0, -0.10)).collect()
        };
        let rear = if shape.rear == Rear::Cargo { PAINT } else { SEAM };
        builder.grid(&[sections[0].clone(), under(0, 0.02)], |_| 200, |_, _| Some(rear));
        builder.grid(&[under(last, -0.02), sections[last].clone()], |_| 200, |_, _| Some(SEAM));
        dashboard(builder, shape);
    }
    if detail == CarDetail::Close {
        frames(builder, shape, &stations, &sections);
    }
    if shape.rear == Rear::Cargo {
        let middle = |section: &[Vec3]| section[section.len() / 2];
        let (foot, top) = (middle(&sections[0]), middle(&sections[1]));
        // On the doors, along their middle.
        let lean = |z: f32| foot.lerp(top, (z - foot.z) / (top.z - foot.z)).x - 0.004;
        let (low, high) = (shape.shoulder_at(-2.4) + 0.12, shape.height - 0.28);
        for side in [-1.0_f32, 1.0] {
            let at = |y: f32, z: f32, deep: f32| Vec3::new(lean(z) + deep, side * y, z);
            if detail == CarDetail::Close {
                rear_pane(builder, [low, high], at);
            } else {
                let pane = [at(0.08, low, 0.0), at(0.72, low, 0.0), at(0.72, high, 0.0), at(0.08, high, 0.0)];
                close::face(builder, pane, Vec3::NEG_X, GLASS, 240);
            }
        }
        if detail.is_near() {
            // As the shell bulges below the shoulder, and the doors lean above it.
            let high = shape.shoulder_at(-super::LENGTH_M / 2.0);
            let mut line: Vec<(f32, f32)> = [0.3, 0.4, 0.5, 0.6, 0.8, 1.0]
                .map(|t| (shape.end_x(-1.0, 0.0, t) - 0.002, shape.sill + t * (high - shape.sill)))
                .to_vec();
            line.extend([foot.z, foot.z + 0.9 * (top.z - foot.z)].map(|z| (lean(z), z)));
            for pair in line.windows(2) {
                let corners = [(0.01, 0), (-0.01, 0), (-0.01, 1), (0.01, 1)];
                builder.plate(&corners.map(|(y, k)| Vec3::new(pair[k].0, y, pair[k].1)), SEAM, 200);
            }
        }
    }
}

/// What is behind the panes of a van's rear doors.
const LOAD: StaticMaterial = StaticMaterial::new("load", [124, 126, 130]);

/// A pane of the rear doors between two heights with round corners, in a rubber frame, and the dim load space behind it:
/// clear glass would show the paint of the door. `at`: a place on a door by y and z, so far behind its surface.
fn rear_pane(builder: &mut PrimitiveBuilder, [low, high]: [f32; 2], at: impl Fn(f32, f32, f32) -> Vec3) {
    const CUT_M: f32 = 0.07;
    let ring = |margin: f32, deep: f32| -> [Vec3; 8] {
        let (y, z) = ([0.11 - margin, 0.73 + margin], [low - margin, high + margin]);
        let cut = CUT_M + 0.4 * margin;
        [
            (y[0] + cut, z[0]),
            (y[1] - cut, z[0]),
            (y[1], z[0] + cut),
            (y[1], z[1] - cut),
            (y[1] - cut, z[1]),
            (y[0] + cut, z[1]),
            (y[0], z[1] - cut),
            (y[0], z[0] + cut),
        ]
        .map(|(y, z)| at(y, z, deep))
    };
    let is_mirrored = at(1.0, low, 0.0).y < 0.0;
    let up = |p: Vec3| ((p.z - low) / (high - low)).clamp(0.0, 1.0);
    let mut fan = |mut corners: [Vec3; 8], face_material: StaticMaterial, openness: &dyn Fn(Vec3) -> u8| {
        if !is_mirrored {
            corners.reverse();
        }
        // A pane is domed, so that it mirrors more and more of the sky upwards.
        let normal = |p: Vec3| Vec3::new(-1.0, 0.12 * p.y, 0.05 + 0.25 * up(p)).normalize_or(Vec3::NEG_X);
        let fan = corners.map(|p| builder.vertex(face_material, p, normal(p), openness(p)));
        for k in 2..fan.len() {
            builder.triangle(face_material, [fan[0], fan[k - 1], fan[k]]);
        }
    };
    // Light falls on the floor through the windows of the cab.
    let dim = |p: Vec3| (150.0 - 130.0 * up(p)) as u8;
    fan(ring(0.0, -0.001), LOAD, &dim);
    fan(ring(0.0, -0.002), GLASS, &|_| 240);
    let rings = [ring(0.034, 0.002), ring(0.024, -0.012), ring(0.004, -0.012), ring(-0.004, -0.002)];
    for pair in rings.windows(2) {
        for k in 0..8 {
            let n = (k + 1) % 8;
            let corners = [pair[0][k], pair[0][n], pair[1][n], pair[1][k]];
            let middle = (corners[0] + corners[2]) / 2.0;
            let centre = at(0.42, (low + high) / 2.0, 0.0);
            // Bevels face away from the pane without, and towards it within.
            let away = (middle - centre).with_x(0.0) * if pair[1][0].x > pair[0][0].x { -1.0 } else { 1.0 };
            close::face(builder, corners, Vec3::NEG_X + away * 0.01, SEAM, 170);
        }
    }
}

/// How far the foot of the windscreen bulges forward in its middle.
const BULGE_M: f32 = 0.10;

/// The foot of the windscreen as a smooth line from right to left, a little above the glass.
fn windscreen_foot(shape: &CarShape) -> Vec<Vec3> {
    const PARTS: i16 = 6;
    (-PARTS..=PARTS).map(|k| windscreen_foot_at(shape, 0.94 * f32::from(k) / f32::from(PARTS))).collect()
}

/// A place on that line, at a share of half its width to the left.
fn windscreen_foot_at(shape: &CarShape, share: f32) -> Vec3 {
    let [.., x] = shape.cabin.stations;
    let wide = shape.half_at(x) * 0.875;
    let high = shape.shoulder_at(x) + 0.008;
    let round = 1.0 - share * share;
    Vec3::new(x + BULGE_M * round, wide * share, high + (shape.crown + 0.012) * round)
}

/// What a camera behind the windscreen sees below its glass: the dashboard, whose edge hides the rear of the bonnet. From
/// outside opaque glass hides it.
fn dashboard(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let [.., front_foot] = shape.cabin.stations;
    let foot = windscreen_foot(shape);
    // From the glass over a slot for warm air and a brow to the passengers; rows go backwards.
    let row = |back: f32, up: f32| -> Vec<Vec3> {
        foot.iter().map(|&at| at + Vec3::new(-back, -0.12 * back * at.y, up)).collect()
    };
    let rear = foot.iter().map(|&at| Vec3::new(front_foot - 0.80, 0.92 * at.y, at.z)).collect();
    let rows = [row(0.0, 0.0), row(0.065, 0.016), row(0.085, 0.016), row(0.24, 0.028), rear];
    let material = |row: usize, _: usize| Some(if row == 1 { SEAM } else { DASHBOARD });
    builder.grid(&rows, |_| 130, material);
}

/// Frames of the side windows, the dark edge of windscreen and rear window, and wipers.
fn frames(
    builder: &mut PrimitiveBuilder,
    shape: &CarShape,
    stations: &[CabinStation],
    sections: &[Vec<Vec3>],
) {
    const FRAME_M: f32 = 0.026;
    let last = stations.len() - 1;
    let mut strip =
        |corners: [Vec3; 4], outward: Vec3, proud: f32| raised(builder, corners, outward, (proud, SEAM));
    for k in 0..last {
        let end = (k == 0).then_some(-1.0).or((k == last - 1).then_some(1.0));
        if !matches!(face_material(shape, CarDetail::Close, stations, k, SILL, end), GLASS | TINTED) {
            continue;
        }
        for side in [1.0_f32, -1.0] {
            let [a, b, c, d] = [(k, SILL), (k + 1, SILL), (k + 1, RAIL), (k, RAIL)]
                .map(|(k, row)| sections[k][row] * Vec3::new(1.0, -side, 1.0));
            let part = |from: Vec3, to: Vec3| (FRAME_M / from.distance(to).max(0.04)).min(0.45);
            let outward = Vec3::Y * side;
            let [ad, bc, ab, dc] = [part(a, d), part(b, c), part(a, b), part(d, c)];
            strip([a, b, b.lerp(c, bc), a.lerp(d, ad)], outward, 0.005);
            strip([d, c, c.lerp(b, bc), d.lerp(a, ad)], outward, 0.005);
            strip([a, d, d.lerp(c, dc), a.lerp(b, ab)], outward, 0.006);
            strip([b, c, c.lerp(d, dc), b.lerp(a, ab)], outward, 0.006);
        }
    }
    rear_pillars(shape, stations, sections, &mut strip);
    let mirrored = 2 * RAIL + 6;
    for (top, foot, facing) in [(last - 1, last, 1.0_f32), (1, 0, -1.0)] {
        if facing < 0.0 && shape.rear == Rear::Cargo {
            continue;
        }
        let outward = Vec3::new(facing, 0.0, 0.6);
        let at = |column: usize, down: f32| sections[top][column].lerp(sections[foot][column], down);
        for column in GUTTER..mirrored - GUTTER {
            // The foot of a rear window may be under the edge of the boot.
            let foot = match shape.rear {
                _ if facing > 0.0 => [0.92, 1.0],
                Rear::Hatch => [0.90, 1.0],
                _ => [0.90, 0.94],
            };
            for [a, b] in [[0.0, 0.05], foot] {
                let corners = [at(column, a), at(column + 1, a), at(column + 1, b), at(column, b)];
                strip(corners, outward, 0.004);
            }
        }
        for (edge, inner) in [(GUTTER, GUTTER + 1), (mirrored - GUTTER, mirrored - GUTTER - 1)] {
            let inwards = |down: f32| at(edge, down).lerp(at(inner, down), 0.2);
            strip([at(edge, 0.0), inwards(0.0), inwards(1.0), at(edge, 1.0)], outward, 0.005);
        }
    }
    wipers(builder, shape, &sections[last - 1], &sections[last]);
}

/// The pillars behind the rear doors, where the windows go on: one long pane would be that of a limousine.
fn rear_pillars(
    shape: &CarShape,
    stations: &[CabinStation],
    sections: &[Vec<Vec3>],
    strip: &mut impl FnMut([Vec3; 4], Vec3, f32),
) {
    const HALF_WIDTH_M: f32 = 0.035;
    let [_, rear_roof, rear_glass, ..] = shape.cabin.stations;
    let x = shape.rear_door();
    if shape.rear != Rear::Hatch || x < rear_glass.max(rear_roof) + 0.2 {
        return;
    }
    let Some(after) = stations.iter().position(|station| station.x > x) else { return };
    let at = |x: f32, row: usize, side: f32| {
        let share = (x - stations[after - 1].x) / (stations[after].x - stations[after - 1].x);
        sections[after - 1][row].lerp(sections[after][row], share) * Vec3::new(1.0, -side, 1.0)
    };
    for side in [1.0_f32, -1.0] {
        let [rear, front] = [x - HALF_WIDTH_M, x + HALF_WIDTH_M];
        let corners =
            [at(rear, SILL, side), at(front, SILL, side), at(front, RAIL, side), at(rear, RAIL, side)];
        strip(corners, Vec3::Y * side, 0.006);
    }
}

/// What lines the ends of the roof, between the upper edges of windscreen and rear window and the lining under the roof.
pub(super) fn headers(builder: &mut PrimitiveBuilder, shape: &CarShape, material: StaticMaterial) {
    const DEEP_M: f32 = 0.12;
    const UNDER_M: f32 = 0.034;
    let stations = stations(shape, CarDetail::Close);
    let last = stations.len() - 1;
    for (top, facing) in [(last - 1, 1.0_f32), (1, -1.0)] {
        let edge = section(shape, &stations[top], 0.0, CarDetail::Close);
        let at = |point: usize, back_m: f32, down_m: f32| {
            edge[point] * Vec3::new(1.0, 0.985, 1.0) - Vec3::new(facing * back_m, 0.0, down_m)
        };
        for point in GUTTER..edge.len() - 1 - GUTTER {
            let corners = [
                at(point, 0.0, 0.004),
                at(point + 1, 0.0, 0.004),
                at(point + 1, DEEP_M, UNDER_M),
                at(point, DEEP_M, UNDER_M),
            ];
            close::face(builder, corners, Vec3::new(0.3 * facing, 0.0, -1.0), material, 130);
        }
    }
}

/// Plastic that wipers are darker than.
const COWL: StaticMaterial = StaticMaterial::new("cowl", [52, 54, 58]);

/// The dark cowl between bonnet and windscreen, and the wipers at rest on it; the windscreen is between two sections.
fn wipers(builder: &mut PrimitiveBuilder, shape: &CarShape, top: &[Vec3], foot: &[Vec3]) {
    const COWL_M: f32 = 0.17;
    // A place on the cowl, so far ahead of the foot of the windscreen.
    let on_cowl = |at: &Vec3, ahead_m: f32| {
        let x = at.x + ahead_m;
        let bonnet = shape.on_bonnet(x, at.y / shape.side_point(x, 1.0, 0.0).y);
        Vec3::new(x, at.y, bonnet.z + 0.008)
    };
    let back = windscreen_foot(shape);
    let edge = back.iter().map(|at| on_cowl(at, COWL_M)).collect();
    builder.grid(&[edge, back], |_| 170, |_, _| Some(COWL));
    // A blade lies along the foot of the glass, which is round: from inside it is seen before the cowl, as higher up it
    // would seem to hang before the bonnet. An arm comes from a pivot on the cowl and holds it in its middle. Shares of
    // half the width, from heel to tip.
    let up = (top[5] - foot[5]).normalize_or(Vec3::Z);
    let out = up.cross(Vec3::NEG_Y);
    const PARTS: u8 = 8;
    for [pivot, heel, tip] in [[0.88, 0.82, -0.02], [0.06, 0.02, -0.82]] {
        let blade =
            |part: f32| windscreen_foot_at(shape, heel + (tip - heel) * part) + up * (0.012 + 0.012 * part);
        for part in 0..PARTS {
            let ends = [part, part + 1].map(|part| blade(f32::from(part) / f32::from(PARTS)));
            wiper_bar(builder, ends, out, (0.006, [-0.002, 0.008]));
        }
        let pivot = on_cowl(&windscreen_foot_at(shape, pivot), 0.05);
        let head = blade(0.5);
        let elbow = pivot.lerp(head, 0.4) + Vec3::Z * 0.005;
        wiper_bar(builder, [pivot, elbow], out, (0.008, [0.004, 0.011]));
        wiper_bar(builder, [elbow, head], out, (0.005, [0.006, 0.011]));
        let cap = Vec3::new(0.011, 0.011, 0.008);
        builder.block(pivot - cap, pivot + cap, WIPER, 160);
    }
}

/// A bar of half a width before the glass, from one distance from it to another. It is not seen from below.
fn wiper_bar(builder: &mut PrimitiveBuilder, ends: [Vec3; 2], out: Vec3, (half_m, proud_m): (f32, [f32; 2])) {
    let across = out.cross(ends[1] - ends[0]).normalize_or(Vec3::Z) * half_m;
    let up = if across.z < 0.0 { -across } else { across };
    let corner = |end: usize, side: f32, layer: usize| ends[end] + up * side + out * proud_m[layer];
    let long = |[(s0, l0), (s1, l1)]: [(f32, usize); 2]| {
        [corner(0, s0, l0), corner(1, s0, l0), corner(1, s1, l1), corner(0, s1, l1)]
    };
    let faces = [([(1.0, 0), (-1.0, 0)], -out), ([(1.0, 1), (-1.0, 1)], out), ([(1.0, 0), (1.0, 1)], up)];
    for (edges, outward) in faces {
        close::face(builder, long(edges), outward, WIPER, 160);
    }
}

/// A face a little off the surface that its corners lie on.
fn raised(
    builder: &mut PrimitiveBuilder,
    corners: [Vec3; 4],
    outward: Vec3,
    (proud_m, material): (f32, StaticMaterial),
) {
    let normal = (corners[2] - corners[0]).cross(corners[3] - corners[1]).normalize_or_zero();
    let out = if normal.dot(outward) < 0.0 { -normal } else { normal };
    close::face(builder, corners.map(|corner| corner + out * proud_m), outward, material, 160);
}

/// What a face is made of: behind which station, how far up, and on which end.
fn face_material(
    shape: &CarShape,
    detail: CarDetail,
    stations: &[CabinStation],
    station: usize,
    up: usize,
    end: Option<f32>,
) -> StaticMaterial {
    let cargo = shape.rear == Rear::Cargo;
    let glass_at_end = |facing: f32| !(cargo && facing < 0.0);
    // Where glass is opaque, all of it has one colour.
    let is_tinted = shape.tinted && detail == CarDetail::Close;
    match (end, up) {
        // The rubber under the windscreen; the rear window stands on sheet metal.
        (Some(facing), FOOT) if facing > 0.0 => SEAM,
        (_, FOOT) => PAINT,
        // Beside the windscreen a triangle of glass, beside the rear window a pillar.
        (Some(facing), SILL) => {
            if facing > 0.0 {
                GLASS
            } else {
                PAINT
            }
        }
        (Some(_), RAIL) => PAINT,
        (Some(facing), GUTTER..) => {
            if !glass_at_end(facing) {
                PAINT
            } else if facing < 0.0 && is_tinted {
                TINTED
            } else {
                GLASS
            }
        }
        (None, SILL) => {
            let [_, rear_roof, rear_glass, pillar, ..] = shape.cabin.stations;
            let middle = (stations[station].x + stations[station + 1].x) / 2.0;
            let is_pillar = (middle - pillar).abs() < 0.05 && detail.is_near();
            let behind = (rear_glass > rear_roof && middle < rear_glass) || (cargo && middle < pillar);
            if behind {
                PAINT
            } else if is_pillar {
                PLASTIC
            } else if is_tinted && middle < pillar {
                TINTED
            } else {
                GLASS
            }
        }
        _ => PAINT,
    }
}
