//! Bus and delivery truck: hulls lofted along rows of one height around rounded corners.

use super::{
    CarDetail, GLASS, GRILLE, PAINT, PLASTIC, PrimitiveBuilder, SEAM, StaticMaterial, WELL, heavy_close,
    heavy_trim, wheel,
};
use glam::Vec3;
use std::f32::consts::FRAC_PI_2;

/// The measures of a bus or truck, metres.
#[derive(Clone, Copy, Debug)]
pub struct HeavyShape {
    pub name: &'static str,
    pub length: f32,
    /// From mirror to mirror.
    pub width: f32,
    pub height: f32,
    pub wheelbase: f32,
    pub wheel_radius: f32,
    pub(super) wheel_width: f32,
    /// From the middle to the outer face of a wheel.
    pub(super) wheel_out: f32,
    pub(super) hull: Hull,
    /// A box on a chassis behind the hull, which is a cab.
    pub(super) is_truck: bool,
}

/// The hull of a bus or of a cab.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hull {
    pub(super) rows: &'static [HullRow],
    /// Rows between which windows of the sides, the windscreen and the rear window are: indices of the lower and upper.
    pub(super) side_glass: [usize; 2],
    pub(super) windscreen: [usize; 2],
    pub(super) rear_window: Option<[usize; 2]>,
    /// Rows of the coarser levels.
    pub(super) far_rows: &'static [usize],
    pub(super) farther_rows: &'static [usize],
    /// Windows along the sides, from the rear: x of both edges.
    pub(super) windows: &'static [[f32; 2]],
    /// The doors on the right.
    pub(super) doors: &'static [[f32; 2]],
}

/// A horizontal section.
#[derive(Clone, Copy, Debug)]
pub(super) struct HullRow {
    pub(super) z: f32,
    pub(super) half: f32,
    pub(super) rear: f32,
    pub(super) front: f32,
}

const fn row(z: f32, half: f32, rear: f32, front: f32) -> HullRow {
    HullRow { z, half, rear, front }
}

/// Radius of the corners seen from above, rear and front.
const CORNERS_M: [f32; 2] = [0.16, 0.34];

pub const BUS: HeavyShape = HeavyShape {
    name: "bus",
    length: 11.0,
    width: 2.9,
    height: 3.05,
    wheelbase: 5.6,
    wheel_radius: 0.48,
    wheel_width: 0.30,
    wheel_out: 1.255,
    hull: Hull {
        rows: &[
            row(0.30, 1.215, -5.44, 5.42),
            row(0.36, 1.262, -5.49, 5.48),
            row(0.70, 1.275, -5.495, 5.495),
            row(0.98, 1.275, -5.49, 5.49),
            row(1.22, 1.273, -5.485, 5.48),
            row(2.34, 1.255, -5.45, 5.39),
            row(2.44, 1.252, -5.445, 5.375),
            row(2.80, 1.235, -5.42, 5.30),
            row(2.93, 1.18, -5.36, 5.20),
            row(3.02, 1.03, -5.22, 5.02),
            row(3.05, 0.60, -4.9, 4.6),
            row(3.05, 0.0, -4.9, 4.6),
        ],
        side_glass: [4, 5],
        windscreen: [3, 6],
        rear_window: Some([4, 5]),
        far_rows: &[0, 3, 6, 8, 11],
        farther_rows: &[0, 3, 6, 8, 11],
        windows: &[
            [-5.0, -4.0],
            [-3.9, -2.4],
            [-2.3, -0.8],
            [-0.7, 0.6],
            [0.7, 2.1],
            [2.2, 3.7],
            [3.8, 5.05],
        ],
        doors: &[[-0.7, 0.6], [3.8, 5.05]],
    },
    is_truck: false,
};

pub const TRUCK: HeavyShape = HeavyShape {
    name: "truck",
    length: 6.9,
    width: 2.5,
    height: 2.95,
    wheelbase: 3.9,
    wheel_radius: 0.40,
    wheel_width: 0.26,
    wheel_out: 1.04,
    hull: Hull {
        rows: &[
            row(0.34, 0.97, 1.34, 3.34),
            row(0.40, 1.02, 1.34, 3.42),
            row(0.72, 1.05, 1.34, 3.445),
            row(0.98, 1.05, 1.34, 3.44),
            row(1.32, 1.045, 1.34, 3.41),
            row(2.02, 1.00, 1.34, 3.13),
            row(2.10, 0.99, 1.34, 3.09),
            row(2.20, 0.95, 1.36, 2.98),
            row(2.27, 0.84, 1.40, 2.82),
            row(2.29, 0.0, 1.40, 2.80),
        ],
        side_glass: [4, 5],
        windscreen: [4, 5],
        rear_window: None,
        far_rows: &[0, 2, 4, 5, 7, 9],
        farther_rows: &[0, 4, 5, 9],
        windows: &[[1.62, 2.72]],
        doors: &[],
    },
    is_truck: true,
};

/// A column of the hull: x, and the share of the half width.
#[derive(Clone, Copy)]
enum HullColumn {
    /// On the front (1) or the rear (-1), at a share of the half width.
    End(f32, f32),
    /// On a corner of that end: 0 at the end to 1 at the side.
    Corner(f32, f32),
    /// On the side, at x, with the lower edge at least so high.
    Side(f32, f32),
}

impl HeavyShape {
    fn arch_m(&self) -> f32 {
        1.2 * self.wheel_radius
    }

    /// The section at a height.
    pub(super) fn at(&self, z: f32) -> HullRow {
        let rows = self.hull.rows;
        let after = rows.partition_point(|r| r.z < z).clamp(1, rows.len() - 1);
        let (a, b) = (rows[after - 1], rows[after]);
        let t = ((z - a.z) / (b.z - a.z).max(1e-6)).clamp(0.0, 1.0);
        let mix = |a: f32, b: f32| a + (b - a) * t;
        row(z, mix(a.half, b.half), mix(a.rear, b.rear), mix(a.front, b.front))
    }

    /// A point of the left half.
    fn point(&self, column: HullColumn, section: HullRow) -> Vec3 {
        let end = |facing: f32| {
            let (x, corner) =
                if facing > 0.0 { (section.front, CORNERS_M[1]) } else { (section.rear, CORNERS_M[0]) };
            (x, if self.is_truck && facing < 0.0 { 0.02 } else { corner }.min(section.half))
        };
        match column {
            HullColumn::Side(x, low) if low > section.z => Vec3::new(x, self.at(low).half, low),
            HullColumn::Side(x, _) => Vec3::new(x, section.half, section.z),
            HullColumn::End(facing, f) => {
                let (x, corner) = end(facing);
                // Slightly bowed.
                let bow = if facing > 0.0 { 0.05 * f * f } else { 0.0 };
                Vec3::new(x - facing * bow, f * (section.half - corner), section.z)
            }
            HullColumn::Corner(facing, t) => {
                let (x, corner) = end(facing);
                let bow = if facing > 0.0 { 0.05 * (1.0 - t) } else { 0.0 };
                let (sin, cos) = (t * FRAC_PI_2).sin_cos();
                let inwards = corner * (1.0 - cos) + bow;
                Vec3::new(x - facing * inwards, section.half - corner * (1.0 - sin), section.z)
            }
        }
    }

    /// Columns of the left half from the middle of the rear to the middle of the front.
    fn columns(&self, detail: CarDetail) -> Vec<HullColumn> {
        let (corners, ends): (&[f32], &[f32]) = match detail {
            CarDetail::Near | CarDetail::Close => (&[0.0, 0.33, 0.67, 1.0], &[0.0, 0.5]),
            CarDetail::Far => (&[0.0, 0.6, 1.0], &[0.0]),
            CarDetail::Farther => (&[0.0, 1.0], &[0.0]),
        };
        let mut columns: Vec<HullColumn> = ends.iter().map(|&f| HullColumn::End(-1.0, f)).collect();
        columns.extend(corners.iter().map(|&t| HullColumn::Corner(-1.0, t)));
        let mut sides: Vec<(f32, f32)> = Vec::new();
        let arches: &[f32] = match (detail, self.is_truck) {
            (CarDetail::Farther, _) => &[],
            (_, true) => &[1.0],
            (_, false) => &[-1.0, 1.0],
        };
        let radius = self.arch_m();
        let cuts: &[f32] = if detail.is_near() {
            &[-1.0, -0.966, -0.866, -0.707, -0.5, -0.259, 0.0, 0.259, 0.5, 0.707, 0.866, 0.966, 1.0]
        } else {
            &[-0.95, -0.5, 0.5, 0.95]
        };
        let is_in_arch =
            |x: f32| arches.iter().any(|arch| (x - arch * self.wheelbase / 2.0).abs() < radius + 0.02);
        for arch in arches {
            let middle = arch * self.wheelbase / 2.0;
            sides.push((middle - radius - 0.001, 0.0));
            sides.extend(cuts.iter().map(|cut| {
                let up = (1.0 - cut * cut).max(0.0).sqrt();
                (middle + cut * radius, self.wheel_radius * 0.95 + up * radius)
            }));
            sides.push((middle + radius + 0.001, 0.0));
        }
        if detail.is_near() {
            let edges = self.hull.windows.iter().flatten().filter(|x| !is_in_arch(**x));
            sides.extend(edges.map(|&x| (x, 0.0)));
        }
        sides.sort_by(|a, b| a.0.total_cmp(&b.0));
        columns.extend(sides.iter().map(|&(x, low)| HullColumn::Side(x, low)));
        columns.extend(corners.iter().rev().map(|&t| HullColumn::Corner(1.0, t)));
        columns.extend(ends.iter().rev().map(|&f| HullColumn::End(1.0, f)));
        columns
    }
}

/// What a level of detail has on its hull.
pub(super) fn body(builder: &mut PrimitiveBuilder, shape: &HeavyShape, detail: CarDetail) {
    if shape.is_truck {
        heavy_trim::cargo_box(builder, shape, detail);
    } else {
        heavy_trim::roof_unit(builder, detail);
    }
    heavy_trim::lamps(builder, shape, detail);
    heavy_trim::mirrors(builder, shape, detail);
    match detail {
        CarDetail::Near => {
            wells(builder, shape);
            side_windows(builder, shape, detail);
            heavy_trim::trim(builder, shape);
        }
        CarDetail::Close => {
            wells(builder, shape);
            heavy_close::trim(builder, shape);
            heavy_trim::trim(builder, shape);
            heavy_trim::registrations(builder, shape);
        }
        CarDetail::Far => {
            side_windows(builder, shape, detail);
            wheel_shade(builder, shape);
        }
        CarDetail::Farther => {
            side_windows(builder, shape, detail);
            wheel::painted(
                builder,
                [shape.wheelbase, shape.wheel_radius, shape.wheel_out, shape.wheel_width],
            );
        }
    }
}

fn openness(p: Vec3) -> u8 {
    (255.0 * (0.55 + 0.45 * (p.z / 1.2).clamp(0.0, 1.0))) as u8
}

/// The hull, at the near level with openings behind clear glass.
pub(super) fn hull(builder: &mut PrimitiveBuilder, shape: &HeavyShape, detail: CarDetail) {
    let hull = &shape.hull;
    let all: Vec<usize> = (0..hull.rows.len()).collect();
    let kept: &[usize] = match detail {
        CarDetail::Near | CarDetail::Close => &all,
        CarDetail::Far => hull.far_rows,
        CarDetail::Farther => hull.farther_rows,
    };
    let columns = shape.columns(detail);
    for side in [1.0_f32, -1.0] {
        let at = |&k: &usize| -> Vec<Vec3> {
            let section = hull.rows[k];
            columns.iter().map(|&column| shape.point(column, section) * Vec3::new(1.0, side, 1.0)).collect()
        };
        let mut points: Vec<Vec<Vec3>> = kept.iter().map(at).collect();
        if side > 0.0 {
            points.reverse();
        }
        let count = kept.len() - 1;
        builder.grid(&points, openness, |r, c| {
            let r = if side > 0.0 { count - 1 - r } else { r };
            let within = |[low, high]: [usize; 2]| kept[r] >= low && kept[r + 1] <= high;
            let facing = match (columns[c], columns[c + 1]) {
                (HullColumn::Side(..), _) | (_, HullColumn::Side(..)) => 0.0,
                (HullColumn::End(facing, _) | HullColumn::Corner(facing, _), _) => facing,
            };
            if detail == CarDetail::Close && is_opening(shape, [columns[c], columns[c + 1]], kept[r], side) {
                return None;
            }
            let is_glass = if facing > 0.0 {
                within(hull.windscreen)
            } else {
                facing < 0.0 && hull.rear_window.is_some_and(within)
            };
            Some(match kept[r] {
                _ if is_glass => GLASS,
                0 if detail.is_near() => PLASTIC,
                k if facing > 0.0 && !shape.is_truck && k == hull.windscreen[1] => SEAM,
                k if facing > 0.0 && shape.is_truck && k == 2 && detail.is_near() => GRILLE,
                _ => PAINT,
            })
        });
    }
    // The floor, and the edges of arches and skirt.
    let (low, first) = (hull.rows[0].z + 0.03, hull.rows[0]);
    let y = first.half - 0.03;
    let (rear, front) = (first.rear + 0.1, first.front - 0.2);
    builder.plate(
        &[(rear, -y), (rear, y), (front, y), (front, -y)].map(|(x, y)| Vec3::new(x, y, low)),
        WELL,
        60,
    );
}

/// Whether a face of a side, from row `row` up, is left out for a window or a door.
fn is_opening(shape: &HeavyShape, [a, b]: [HullColumn; 2], row: usize, side: f32) -> bool {
    let (HullColumn::Side(a, _), HullColumn::Side(b, _)) = (a, b) else { return false };
    let hull = &shape.hull;
    let middle = (a + b) / 2.0;
    let is_in = |spans: &[[f32; 2]]| spans.iter().any(|[rear, front]| (*rear..*front).contains(&middle));
    let is_door = side < 0.0 && (1..hull.side_glass[0]).contains(&row) && is_in(hull.doors);
    is_door || (row == hull.side_glass[0] && is_in(hull.windows))
}

/// A quad on the left or right side, proud of the hull: x and z of its edges.
pub(super) fn on_side(
    builder: &mut PrimitiveBuilder,
    shape: &HeavyShape,
    (side, out): (f32, f32),
    [x, z]: [[f32; 2]; 2],
    face_material: StaticMaterial,
) {
    let at = |x: f32, z: f32| Vec3::new(x, side * (shape.at(z).half + out), z);
    let x = if side > 0.0 { [x[1], x[0]] } else { x };
    let corners = [at(x[0], z[0]), at(x[1], z[0]), at(x[1], z[1]), at(x[0], z[1])];
    builder.plate(&corners, face_material, 240);
}

/// A place on the front (1) or the rear (-1), so far proud of it.
pub(super) fn end_at(shape: &HeavyShape, (facing, out): (f32, f32), y: f32, z: f32) -> Vec3 {
    let corner = CORNERS_M[usize::from(facing > 0.0)];
    let section = shape.at(z);
    let x = if facing > 0.0 {
        // Along the bowed front and around its corners.
        let flat = section.half - corner;
        let f = (y.abs() / flat).min(1.0);
        let beyond = ((y.abs() - flat) / corner).clamp(0.0, 1.0);
        section.front - 0.05 * f * f - corner * (1.0 - (1.0 - beyond * beyond).sqrt())
    } else if shape.is_truck {
        -shape.length / 2.0 + 0.012
    } else {
        section.rear
    };
    Vec3::new(x + facing * out, y, z)
}

/// A quad on the front (1) or the rear (-1), proud of it: y and z of its edges.
pub(super) fn on_end(
    builder: &mut PrimitiveBuilder,
    shape: &HeavyShape,
    end: (f32, f32),
    [y, z]: [[f32; 2]; 2],
    face_material: StaticMaterial,
) {
    let y = if end.0 > 0.0 { y } else { [y[1], y[0]] };
    let corners = [(y[0], z[0]), (y[1], z[0]), (y[1], z[1]), (y[0], z[1])];
    builder.plate(&corners.map(|(y, z)| end_at(shape, end, y, z)), face_material, 240);
}

/// Windows along the sides, frames around them, and doors.
fn side_windows(builder: &mut PrimitiveBuilder, shape: &HeavyShape, detail: CarDetail) {
    let hull = &shape.hull;
    let [low, high] = hull.side_glass.map(|k| hull.rows[k].z);
    for side in [1.0_f32, -1.0] {
        let (first, last) = (hull.windows[0][0], hull.windows[hull.windows.len() - 1][1]);
        if detail == CarDetail::Farther {
            on_side(builder, shape, (side, 0.008), [[first, last], [low, high]], GLASS);
            continue;
        }
        // A dark band with the glass in it.
        let edge = 0.045;
        on_side(
            builder,
            shape,
            (side, 0.004),
            [[first - edge, last + edge], [low - edge, high + edge]],
            SEAM,
        );
        for &window in hull.windows {
            on_side(builder, shape, (side, 0.008), [window, [low, high]], GLASS);
        }
        if side < 0.0 {
            for &[rear, front] in hull.doors {
                let middle = (rear + front) / 2.0;
                for leaf in [[rear + 0.05, middle - 0.03], [middle + 0.03, front - 0.05]] {
                    on_side(
                        builder,
                        shape,
                        (side, 0.006),
                        [[leaf[0] - 0.04, leaf[1] + 0.04], [0.40, low]],
                        SEAM,
                    );
                    on_side(builder, shape, (side, 0.010), [leaf, [0.52, low - 0.02]], GLASS);
                }
            }
        }
    }
}

/// Wheel wells under the hull.
fn wells(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    let radius = shape.arch_m();
    let axles: &[f32] = if shape.is_truck { &[1.0] } else { &[-1.0, 1.0] };
    for axle in axles {
        let middle = axle * shape.wheelbase / 2.0;
        for side in [1.0_f32, -1.0] {
            let arc = |inward: f32, drop: bool| -> Vec<Vec3> {
                (0..=12)
                    .map(|k| {
                        let (sin, cos) = (FRAC_PI_2 * (k as f32 / 6.0 - 1.0)).sin_cos();
                        let z = if drop { 0.3 } else { shape.wheel_radius * 0.95 + radius * cos };
                        let y = shape.at(shape.wheel_radius * 0.95 + radius * cos).half - inward;
                        Vec3::new(middle + radius * sin, side * y, z)
                    })
                    .collect()
            };
            let mut points = vec![arc(0.0, false), arc(0.45, false), arc(0.45, true)];
            if side < 0.0 {
                points.reverse();
            }
            builder.grid(&points, |p| if p.z > 0.8 { 90 } else { 60 }, |_, _| Some(WELL));
            // A lip around the arch.
            let lip = |out: f32, scale: f32| -> Vec<Vec3> {
                (0..=12)
                    .map(|k| {
                        let (sin, cos) = (FRAC_PI_2 * (k as f32 / 6.0 - 1.0)).sin_cos();
                        let z = shape.wheel_radius * 0.95 + scale * radius * cos;
                        Vec3::new(middle + scale * radius * sin, side * (shape.at(z).half + out), z)
                    })
                    .collect()
            };
            let mut points = vec![lip(0.004, 1.10), lip(0.014, 1.04), lip(0.0, 0.995)];
            if side < 0.0 {
                points.reverse();
            }
            builder.grid(&points, |_| 170, |_, _| Some(PLASTIC));
        }
    }
}

/// Dark discs in place of wheel wells.
fn wheel_shade(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    let axles: &[f32] = if shape.is_truck { &[1.0] } else { &[-1.0, 1.0] };
    for axle in axles {
        for side in [1.0_f32, -1.0] {
            let (middle, r) = (axle * shape.wheelbase / 2.0, 1.3 * shape.wheel_radius);
            let y = side * (shape.hull.rows[0].half - 0.2);
            let top = shape.wheel_radius + r;
            let ring = [(-r, 0.3), (r, 0.3), (r, 0.7), (0.5 * r, top), (-0.5 * r, top), (-r, 0.7)];
            let mut ring = ring.map(|(x, z)| Vec3::new(middle + x, y, z));
            if side > 0.0 {
                ring.reverse();
            }
            builder.plate(&ring, SEAM, 120);
        }
    }
}
