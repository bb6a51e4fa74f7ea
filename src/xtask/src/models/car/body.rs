//! The shell of a car up to its shoulders, with wheel arches, bonnet, boot or bed.

use super::shape::{CarShape, Rear, along};
use super::{
    CarDetail, GRILLE, HALF_M, HEAD, INDICATOR, LENGTH_M, PAINT, PLASTIC, PrimitiveBuilder, REVERSE,
    StaticMaterial, TAIL, WELL, WHEEL_RADIUS_M, WHEELBASE_M,
};
use glam::Vec3;

/// Radius of a wheel arch.
pub(super) const ARCH_M: f32 = 1.19 * WHEEL_RADIUS_M;
/// Position of bumpers: number plates protrude to the full length.
const END_M: f32 = LENGTH_M / 2.0 - 0.006;
/// Depth of the wheel wells.
const WELL_M: f32 = 0.34;
/// Rows of the shell from the sill (0) to the shoulder (1), and its half width there as part of the most.
/// The sill has a chamfer, and the shoulder an edge.
const ROWS: [(f32, f32); 8] = [
    (0.0, 0.935),
    (0.07, 0.972),
    (0.15, 0.988),
    (0.36, 0.984),
    (0.60, 0.994),
    (0.76, 1.0),
    (0.92, 0.938),
    (1.0, 0.885),
];
/// The same of the flanks of a van along its load: upright, a little bowed.
const BOX_ROWS: [(f32, f32); 8] = [
    (0.0, 0.945),
    (0.07, 0.976),
    (0.15, 0.990),
    (0.36, 0.992),
    (0.60, 0.997),
    (0.76, 1.0),
    (0.92, 0.985),
    (1.0, 0.958),
];
/// Where on a van these flanks become those of a car.
const BOX_TO_M: [f32; 2] = [1.0, 1.75];
const NEAR_ROWS: [f32; 7] = [0.0, 0.15, 0.36, 0.60, 0.76, 0.92, 1.0];
/// Close rows on both sides of an edge keep it sharp.
const CLOSE_ROWS: [f32; 16] =
    [0.0, 0.055, 0.085, 0.15, 0.36, 0.60, 0.74, 0.76, 0.78, 0.81, 0.84, 0.87, 0.90, 0.92, 0.94, 1.0];
/// Rows between which the shoulder is round on the near level, and by how much of the half width: a flat face would mirror the
/// sun all along a door.
const ROUND_SHOULDER: [f32; 2] = [0.76, 0.92];
const ROUND: f32 = 0.008;
/// Distant levels: the sides have fewer rows than the ends, which carry the lamps.
const FAR_ROWS: [f32; 6] = [0.0, 0.15, 0.60, 0.76, 0.92, 1.0];
const FAR_SIDE_ROWS: [f32; 3] = [0.0, 0.60, 1.0];
/// Columns of the front and the rear from the middle outwards.
const FRONT: [f32; 5] = [0.0, 0.36, 0.62, 0.82, 1.0];
const FAR_FRONT: [f32; 4] = [0.0, 0.62, 0.82, 1.0];
const FARTHER_FRONT: [f32; 3] = [0.0, 0.62, 1.0];
/// Distant levels: start of the ends; lamps wrap around the corners up to here.
const FAR_END_M: f32 = 2.14;
const FARTHER_END_M: f32 = 2.24;

/// Rows of bonnet and boot of the near level: shares of the way to the end. Two close ones are beside the front gap of a bonnet.
pub(super) const CLOSE_PARTS: [f32; 8] = [0.0, 0.3, 0.55, 0.78, FRONT_GAP[0], FRONT_GAP[1], 0.97, 1.0];
pub(super) const FRONT_GAP: [f32; 2] = [0.925, 0.937];

/// Columns of an arch: shares of its radius.
const NEAR_CUTS: [f32; 7] = [-1.0, -0.86, -0.5, 0.0, 0.5, 0.86, 1.0];
const CLOSE_CUTS: [f32; 13] =
    [-1.0, -0.966, -0.866, -0.707, -0.5, -0.259, 0.0, 0.259, 0.5, 0.707, 0.866, 0.966, 1.0];

/// How far a bonnet is raised at shares of its half width: a bulge in its middle between creases, and the crests of the wings
/// beside its gaps.
const BONNET_RELIEF: [(f32, f32); 7] =
    [(0.0, 0.020), (0.40, 0.018), (0.48, 0.0), (0.80, 0.0), (0.86, -0.006), (0.93, 0.012), (1.0, 0.0)];
/// Where the gaps at the sides of a bonnet are.
pub(super) const BONNET_GAP: f32 = 0.86;
/// Distances behind the foot of the windscreen between which the relief begins, and the part of the way at which it ends.
const RELIEF_FROM_M: [f32; 2] = [0.28, 0.52];
const RELIEF_TO: f32 = 0.80;
/// How far under the windscreen a bonnet begins, and a boot under the rear window.
const UNDER_GLASS_M: f32 = 0.10;

fn smoothstep([from, to]: [f32; 2], x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Position of a shell column.
#[derive(Clone, Copy)]
pub(super) enum ShellColumn {
    /// On the side, at x, with the lower edge at least so high.
    Side(f32, f32),
    /// On the front (1) or the rear (-1), at a part of the half width.
    End(f32, f32),
}

/// What the round shoulder adds to the flat one between its edges.
fn rounding(t: f32) -> f32 {
    let [low, high] = ROUND_SHOULDER;
    let u = ((t - low) / (high - low)).clamp(0.0, 1.0);
    4.0 * ROUND * u * (1.0 - u)
}

fn profile(rows: &[(f32, f32)], t: f32) -> f32 {
    let after = rows.partition_point(|r| r.0 < t).clamp(1, rows.len() - 1);
    let (a, b) = (rows[after - 1], rows[after]);
    a.1 + (b.1 - a.1) * ((t - a.0) / (b.0 - a.0)).clamp(0.0, 1.0)
}

impl CarShape {
    pub(super) fn shoulder_at(&self, x: f32) -> f32 {
        along(self.shoulder, x)
    }

    /// Half the width of the sheet metal at x.
    pub(super) fn half_at(&self, x: f32) -> f32 {
        let out = (x.abs() / (LENGTH_M / 2.0)).min(1.0);
        // A load wants room up to the rear doors.
        let corner = if self.rear == Rear::Cargo && x < 0.0 { 0.05 } else { 0.10 };
        HALF_M * (1.0 - 0.03 * out.powi(3) - corner * ((out - 0.72).max(0.0) / 0.28).powi(2))
    }

    /// How much the flanks are those of a box at x.
    pub(super) fn boxiness(&self, x: f32) -> f32 {
        if self.rear == Rear::Cargo { 1.0 - smoothstep(BOX_TO_M, x) } else { 0.0 }
    }

    /// Half the width of the shell at x and a row, as part of the most there.
    fn flank(&self, x: f32, t: f32) -> f32 {
        let usual = profile(&ROWS, t) + rounding(t);
        usual + (profile(&BOX_ROWS, t) - usual) * self.boxiness(x)
    }

    /// The outermost x on an end at a part of its half width and a row.
    pub(super) fn end_x(&self, facing: f32, f: f32, t: f32) -> f32 {
        let end = usize::from(facing < 0.0);
        let [top, bottom] = self.rake[end];
        // The bumper stands out most, at two fifths of the height.
        let back =
            if t > 0.40 { top * ((t - 0.40) / 0.60).powi(2) } else { bottom * ((0.40 - t) / 0.40).powi(2) };
        facing * (END_M - back - self.bow[end] * f.abs().powf(2.4))
    }

    /// A point of the side: y outwards.
    pub(super) fn side_point(&self, x: f32, t: f32, low: f32) -> Vec3 {
        let high = self.shoulder_at(x);
        let end = (x.abs() - 1.9).max(0.0) / 0.6;
        let sill = self.sill + 0.06 * end * end;
        let low = low.max(sill);
        let z = low + t * (high - low);
        let part = ((z - sill) / (high - sill)).clamp(0.0, 1.0);
        let facing = x.signum();
        let reach = END_M - self.bow[usize::from(facing < 0.0)];
        // Towards the ends the side leans with the front and the rear.
        let lean = ((x.abs() - 1.95) / (reach - 1.95)).clamp(0.0, 1.0);
        let x = x + lean * (self.end_x(facing, 1.0, part) - facing * reach);
        Vec3::new(x, self.half_at(x) * self.flank(x, part), z)
    }

    /// A point of the bonnet (`facing` 1) or boot (-1) that starts at x `foot`: share of the way to the end,
    /// and of the half width.
    pub(super) fn on_deck(&self, facing: f32, foot: f32, part: f32, f: f32) -> Vec3 {
        let reach = END_M - self.bow[usize::from(facing < 0.0)];
        let edge = self.side_point(foot + (facing * reach - foot) * part, 1.0, 0.0);
        let crown = self.crown * (1.0 - part.powi(4));
        let end = Vec3::new(self.end_x(facing, f, 1.0), edge.y * f, edge.z);
        let mut on = Vec3::new(edge.x, edge.y * f, edge.z + crown * (1.0 - f * f));
        if facing > 0.0 {
            let begins = smoothstep(RELIEF_FROM_M, edge.x - foot);
            let ends = smoothstep([RELIEF_TO, 1.0], part);
            on.z += profile(&BONNET_RELIEF, f.abs()) * begins * (1.0 - ends);
        }
        // Its edge is that of the shell.
        on.lerp(end, part.powi(6) * (1.0 - f.powi(8)))
    }

    /// A point of the bonnet at x, at a share of its half width.
    pub(super) fn on_bonnet(&self, x: f32, f: f32) -> Vec3 {
        let foot = self.bonnet_foot();
        let reach = END_M - self.bow[0];
        self.on_deck(1.0, foot, ((x - foot) / (reach - foot)).clamp(0.0, 1.0), f)
    }

    /// Where the bonnet begins, under the windscreen.
    pub(super) fn bonnet_foot(&self) -> f32 {
        let [.., front_foot] = self.cabin.stations;
        front_foot - UNDER_GLASS_M
    }

    pub(super) fn point(&self, column: ShellColumn, t: f32) -> Vec3 {
        match column {
            ShellColumn::Side(x, low) => self.side_point(x, t, low),
            ShellColumn::End(facing, f) => {
                let reach = END_M - self.bow[usize::from(facing < 0.0)];
                let edge = self.side_point(facing * reach, t, 0.0);
                Vec3::new(self.end_x(facing, f, t), edge.y * f, edge.z)
            }
        }
    }
}

/// Columns of one side from the middle of the rear to the middle of the front.
fn columns(detail: CarDetail) -> Vec<ShellColumn> {
    let near = detail.is_near();
    let ends: &[f32] = match detail {
        CarDetail::Near | CarDetail::Close => &FRONT,
        CarDetail::Far => &FAR_FRONT,
        CarDetail::Farther => &FARTHER_FRONT,
    };
    let mut columns: Vec<ShellColumn> = ends.iter().map(|&f| ShellColumn::End(-1.0, f)).collect();
    let [rear, front] = match detail {
        CarDetail::Near | CarDetail::Close => [-2.22, FAR_END_M],
        CarDetail::Far => [-FAR_END_M, FAR_END_M],
        CarDetail::Farther => [-FARTHER_END_M, FARTHER_END_M],
    };
    columns.push(ShellColumn::Side(rear, 0.0));
    let arches: &[f32] = match detail {
        CarDetail::Farther => {
            // Where the bonnet begins to slope.
            columns.push(ShellColumn::Side(1.2, 0.0));
            &[]
        }
        _ => &[-WHEELBASE_M / 2.0, WHEELBASE_M / 2.0],
    };
    for &axle in arches {
        let cuts: &[f32] = match detail {
            CarDetail::Close => &CLOSE_CUTS,
            CarDetail::Near => &NEAR_CUTS,
            _ => &[-0.9, -0.5, 0.5, 0.9],
        };
        columns.push(ShellColumn::Side(axle - ARCH_M, 0.0));
        columns.extend(cuts.iter().map(|&cut| {
            let up = (1.0 - cut * cut).max(0.0).sqrt();
            ShellColumn::Side(axle + cut * ARCH_M, WHEEL_RADIUS_M * 0.92 + up * ARCH_M)
        }));
        columns.push(ShellColumn::Side(axle + ARCH_M, 0.0));
        if axle < 0.0 && near {
            columns.extend([-0.55, 0.30].map(|x| ShellColumn::Side(x, 0.0)));
        }
    }
    columns.push(ShellColumn::Side(front, 0.0));
    columns.extend(ends.iter().rev().map(|&f| ShellColumn::End(1.0, f)));
    columns
}

/// Low and inward parts see less of the sky.
fn openness(p: Vec3) -> u8 {
    (255.0 * (0.58 + 0.42 * (p.z / 0.8).clamp(0.0, 1.0))) as u8
}

pub(super) fn shell(builder: &mut PrimitiveBuilder, shape: &CarShape, detail: CarDetail) {
    let columns = columns(detail);
    for side in [1.0_f32, -1.0] {
        match detail {
            CarDetail::Near => {
                panels(builder, shape, detail, (&columns, &NEAR_ROWS), side);
                wells(builder, shape, (&columns, NEAR_CUTS.len()), side);
            }
            CarDetail::Close => {
                panels(builder, shape, detail, (&columns, &CLOSE_ROWS), side);
                wells(builder, shape, (&columns, CLOSE_CUTS.len()), side);
            }
            CarDetail::Farther => panels(builder, shape, detail, (&columns, &FAR_SIDE_ROWS), side),
            CarDetail::Far => {
                let (rear, front) = (FAR_FRONT.len(), columns.len() - FAR_FRONT.len() - 1);
                panels(builder, shape, detail, (&columns[..=rear], &FAR_ROWS), side);
                panels(builder, shape, detail, (&columns[rear..=front], &FAR_SIDE_ROWS), side);
                panels(builder, shape, detail, (&columns[front..], &FAR_ROWS), side);
            }
        }
    }
    deck(builder, shape, detail, 1.0);
    match shape.rear {
        Rear::Bed => bed(builder, shape, detail),
        _ => deck(builder, shape, detail, -1.0),
    }
    let (low, y) = (shape.sill + 0.02, HALF_M * 0.9);
    let x = LENGTH_M / 2.0 - 0.25;
    let floor = [(-x, -y), (-x, y), (x, y), (x, -y)].map(|(x, y)| Vec3::new(x, y, low));
    builder.plate(&floor, WELL, 60);
}

/// Panels between columns and rows of one side.
fn panels(
    builder: &mut PrimitiveBuilder,
    shape: &CarShape,
    detail: CarDetail,
    (columns, rows): (&[ShellColumn], &[f32]),
    side: f32,
) {
    let at = |column: ShellColumn, t: f32| match column {
        // Where the ends meet the sides, which have fewer rows: nothing may gape.
        ShellColumn::Side(x, _) if detail == CarDetail::Far && x.abs() >= FAR_END_M => {
            let after = FAR_SIDE_ROWS.partition_point(|&row| row < t).max(1);
            let (low, high) = (FAR_SIDE_ROWS[after - 1], FAR_SIDE_ROWS[after]);
            shape.point(column, low).lerp(shape.point(column, high), (t - low) / (high - low))
        }
        _ => shape.point(column, t),
    };
    let mirrored = |p: Vec3| Vec3::new(p.x, p.y * side, p.z);
    // Columns run forwards; rows upwards on the right, downwards on the left, to face outwards.
    let mut points: Vec<Vec<Vec3>> =
        rows.iter().map(|&t| columns.iter().map(|&column| mirrored(at(column, t))).collect()).collect();
    if side > 0.0 {
        points.reverse();
    }
    let count = rows.len() - 1;
    builder.grid(&points, openness, |row, column| {
        let row = if side > 0.0 { count - 1 - row } else { row };
        let face = [columns[column], columns[column + 1]];
        if detail == CarDetail::Close && is_lamp_hole(shape, face, rows[row]) {
            return None;
        }
        Some(face_material(shape, detail, face, rows[row], side > 0.0))
    });
}

/// Whether a face is left out for a lamp with depth.
fn is_lamp_hole(shape: &CarShape, [a, b]: [ShellColumn; 2], t: f32) -> bool {
    let facing = match (a, b) {
        (ShellColumn::End(facing, f), ShellColumn::End(_, g)) if f.min(g) > 0.6 => facing,
        (ShellColumn::Side(..), ShellColumn::End(facing, _))
        | (ShellColumn::End(facing, _), ShellColumn::Side(..)) => facing,
        _ => return false,
    };
    if facing < 0.0 && shape.has_tall_lamps() {
        let is_outermost =
            matches!((a, b), (ShellColumn::End(_, f), ShellColumn::End(_, g)) if f.min(g) > 0.8);
        return is_outermost && (0.35..0.915).contains(&t);
    }
    (0.59..0.915).contains(&t)
}

/// The material of a shell face between two columns, from row `t` up.
fn face_material(
    shape: &CarShape,
    detail: CarDetail,
    [a, b]: [ShellColumn; 2],
    t: f32,
    left: bool,
) -> StaticMaterial {
    let indicator = INDICATOR[usize::from(!left)];
    if detail == CarDetail::Farther {
        return farther_face_material([a, b], t, left);
    }
    let tall = shape.has_tall_lamps();
    match (a, b) {
        (ShellColumn::End(facing, f), ShellColumn::End(_, g)) => {
            let (inner, outer) = (f.min(g), f.max(g));
            if facing > 0.0 {
                match t {
                    t if t < 0.1 => {
                        if outer < 0.7 {
                            GRILLE
                        } else {
                            PLASTIC
                        }
                    }
                    t if t < 0.3 && detail.is_near() && outer < 0.7 => GRILLE,
                    t if (0.59..0.9).contains(&t) && inner > 0.6 => {
                        let is_indicator = inner > 0.8 && t < 0.7;
                        if is_indicator { indicator } else { HEAD }
                    }
                    t if (0.59..0.7).contains(&t) => GRILLE,
                    _ => PAINT,
                }
            } else {
                match t {
                    t if t < if shape.clad && detail.is_near() { 0.3 } else { 0.1 } => PLASTIC,
                    t if tall && inner > 0.8 && (0.3..0.9).contains(&t) => {
                        if t < if detail.is_near() { 0.5 } else { 0.7 } { indicator } else { TAIL }
                    }
                    t if tall => {
                        let is_reverse = inner > 0.6 && inner < 0.8 && (0.3..0.5).contains(&t);
                        if is_reverse && detail != CarDetail::Close { REVERSE } else { PAINT }
                    }
                    t if (0.59..0.9).contains(&t) && inner > 0.6 => {
                        if t < 0.7 && inner > 0.8 {
                            indicator
                        } else {
                            TAIL
                        }
                    }
                    t if (0.59..0.7).contains(&t) && inner > 0.3 && detail != CarDetail::Close => REVERSE,
                    _ => PAINT,
                }
            }
        }
        (ShellColumn::Side(..), ShellColumn::End(facing, _))
        | (ShellColumn::End(facing, _), ShellColumn::Side(..)) => {
            let lamp = (0.59..0.9).contains(&t) || (tall && facing < 0.0 && (0.3..0.9).contains(&t));
            match (lamp, facing > 0.0) {
                (true, true) => {
                    if t < 0.7 && detail.is_near() {
                        indicator
                    } else {
                        HEAD
                    }
                }
                (true, false) if tall => PAINT,
                (true, false) => TAIL,
                _ if t < 0.1 => PLASTIC,
                _ => PAINT,
            }
        }
        (ShellColumn::Side(_, low_a), ShellColumn::Side(_, low_b)) => {
            let at_arch = low_a.max(low_b) > 0.0;
            match t {
                t if t < 0.1 && (shape.clad || !at_arch) && detail.is_near() => PLASTIC,
                _ => PAINT,
            }
        }
    }
}

/// [`face_material`] at the greatest distance: lamps, the indicators around the corners.
fn farther_face_material([a, b]: [ShellColumn; 2], t: f32, left: bool) -> StaticMaterial {
    match (a, b) {
        _ if t < 0.5 => PAINT,
        (ShellColumn::End(facing, f), ShellColumn::End(_, g)) if f.min(g) > 0.6 => {
            if facing > 0.0 {
                HEAD
            } else {
                TAIL
            }
        }
        (ShellColumn::Side(..), ShellColumn::End(..)) | (ShellColumn::End(..), ShellColumn::Side(..)) => {
            INDICATOR[usize::from(!left)]
        }
        _ => PAINT,
    }
}

/// The wheel wells: from the edge of the arch inwards, and the wall behind the wheel.
fn wells(
    builder: &mut PrimitiveBuilder,
    shape: &CarShape,
    (columns, cuts): (&[ShellColumn], usize),
    side: f32,
) {
    let sides: Vec<(f32, f32)> = columns
        .iter()
        .filter_map(|column| match *column {
            ShellColumn::Side(x, low) if low > 0.0 => Some((x, low)),
            _ => None,
        })
        .collect();
    for arch in sides.chunks(cuts) {
        let row = |inward: f32, drop: bool| -> Vec<Vec3> {
            arch.iter()
                .map(|&(x, low)| {
                    let edge = shape.side_point(x, 0.0, low);
                    Vec3::new(edge.x, side * (edge.y - inward), if drop { shape.sill } else { edge.z })
                })
                .collect()
        };
        let mut points = vec![row(0.0, false), row(WELL_M, false), row(WELL_M, true)];
        if side < 0.0 {
            points.reverse();
        }
        // Inside out: it is looked at from below and from beside.
        builder.grid(&points, |p| if p.y.abs() > HALF_M - 0.1 { 120 } else { 50 }, |_, _| Some(WELL));
    }
}

/// Bonnet (`facing` 1) or boot (-1): level across, a little higher in the middle.
fn deck(builder: &mut PrimitiveBuilder, shape: &CarShape, detail: CarDetail, facing: f32) {
    let [rear_foot, ..] = shape.cabin.stations;
    let foot = if facing > 0.0 { shape.bonnet_foot() } else { rear_foot + UNDER_GLASS_M };
    let parts: &[f32] = match detail {
        CarDetail::Close => &CLOSE_PARTS,
        CarDetail::Near => &[0.0, 0.35, 0.7, 0.9, 1.0],
        _ => &[0.0, 0.7, 1.0],
    };
    let across: &[f32] = match detail {
        CarDetail::Close if facing > 0.0 => {
            &[-1.0, -0.93, -0.86, -0.80, -0.48, -0.44, -0.40, 0.0, 0.40, 0.44, 0.48, 0.80, 0.86, 0.93, 1.0]
        }
        CarDetail::Close => &[-1.0, -0.86, -0.72, -0.62, -0.32, 0.0, 0.32, 0.62, 0.72, 0.86, 1.0],
        CarDetail::Near => &[-1.0, -0.62, 0.0, 0.62, 1.0],
        CarDetail::Far => &[-1.0, 0.0, 1.0],
        CarDetail::Farther => &[-1.0, 1.0],
    };
    let row = |&part: &f32| across.iter().map(|&f| shape.on_deck(facing, foot, part, f)).collect();
    let mut points: Vec<Vec<Vec3>> = parts.iter().map(row).collect();
    if detail.is_near() {
        // The shell has other columns: under its edges it goes on downwards, so that no slit is left.
        let mut skirt = |edge: Vec<Vec3>, upwards: bool| {
            let inwards = Vec3::new(-0.004 * facing, 0.0, -0.05);
            let under = edge.iter().map(|&p| p * Vec3::new(1.0, 0.98, 1.0) + inwards).collect();
            let rows = if upwards { [under, edge] } else { [edge, under] };
            builder.grid(&rows, |_| 250, |_, _| Some(PAINT));
        };
        let forwards = facing > 0.0;
        skirt(points.iter().map(|row| row[0]).collect(), forwards);
        skirt(points.iter().map(|row| row[row.len() - 1]).collect(), !forwards);
        skirt(points[points.len() - 1].clone(), forwards);
    }
    if facing > 0.0 {
        points.reverse();
    }
    builder.grid(&points, |_| 250, |_, _| Some(PAINT));
}

/// The open bed of a pickup: floor and walls, and a rim on the walls.
fn bed(builder: &mut PrimitiveBuilder, shape: &CarShape, detail: CarDetail) {
    const WALL_M: f32 = 0.07;
    let (front, rear) = (shape.cabin.stations[0] + 0.04, -LENGTH_M / 2.0 + 0.10);
    let (high, low) = (shape.shoulder_at(-1.6) - 0.005, 0.72);
    let outer = |x: f32| shape.half_at(x) * profile(&ROWS, 1.0) + 0.005;
    let inner = outer(rear) - WALL_M;
    let inside = [(rear + WALL_M, -inner), (rear + WALL_M, inner), (front, inner), (front, -inner)];
    let at = |p: (f32, f32), z: f32| Vec3::new(p.0, p.1, z);
    for k in 0..4 {
        let (a, b) = (inside[k], inside[(k + 1) % 4]);
        builder.plate(&[at(b, high), at(a, high), at(a, low), at(b, low)], PLASTIC, 150);
    }
    // The rim follows the body, which is narrower at its rear.
    let edge = rear + WALL_M;
    let along = match detail {
        CarDetail::Farther | CarDetail::Far => vec![front, edge],
        _ => vec![front, -1.6, -2.1, edge],
    };
    for (&ahead, &behind) in along.iter().zip(&along[1..]) {
        for side in [-1.0, 1.0] {
            let corners = [
                (ahead, side * inner),
                (behind, side * inner),
                (behind, side * outer(behind)),
                (ahead, side * outer(ahead)),
            ];
            let mut rim = corners.map(|corner| at(corner, high));
            if side > 0.0 {
                rim.reverse();
            }
            builder.plate(&rim, PAINT, 250);
        }
    }
    let end = rear - 0.06;
    let gate = [(edge, -outer(edge)), (edge, outer(edge)), (end, outer(end)), (end, -outer(end))];
    builder.plate(&gate.map(|corner| at(corner, high)), PAINT, 250);
    let floor = [3, 2, 1, 0].map(|k| at(inside[k], low));
    builder.plate(&floor, PLASTIC, 110);
}
