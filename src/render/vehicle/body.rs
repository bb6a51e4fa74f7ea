//! Bodies: a lower shell from bumper to bumper, a cabin of glass and pillars on it, lamps and trim.

use super::loft::Loft;
use super::{GLASS, HEAD, PAINT, PLASTIC, Part, REVERSE, Skin, TAIL, VehicleMesh};
use crate::snapshot::{BodyType, Dimensions};
use glam::Vec3;

/// The side view of a body type. Lengths along the car are parts of its length from the rear (0) to
/// the front (1), heights parts of its height.
struct Shape {
    /// Upper edge of the lower shell: where, how high.
    deck: &'static [(f32, f32)],
    /// Foot of the rear window, rear and front end of the roof, foot of the windscreen.
    cabin: [f32; 4],
    /// Middle of the pillar between the doors.
    pillar: f32,
    /// How far the roof falls towards the rear, part of the height.
    roof_fall: f32,
    /// Half width of the roof as part of the half width.
    roof_width: f32,
    /// Glass behind the pillar; a van has a wall of sheet metal.
    rear_glass: bool,
}

const SEDAN: Shape = Shape {
    deck: &[
        (0.0, 0.60),
        (0.06, 0.635),
        (0.2, 0.645),
        (0.5, 0.615),
        (0.7, 0.60),
        (0.88, 0.54),
        (0.97, 0.49),
        (1.0, 0.46),
    ],
    cabin: [0.15, 0.31, 0.565, 0.735],
    pillar: 0.46,
    roof_fall: 0.035,
    roof_width: 0.72,
    rear_glass: true,
};
const HATCHBACK: Shape = Shape {
    deck: &[
        (0.0, 0.60),
        (0.04, 0.64),
        (0.2, 0.645),
        (0.5, 0.61),
        (0.74, 0.60),
        (0.9, 0.535),
        (0.975, 0.48),
        (1.0, 0.45),
    ],
    cabin: [0.02, 0.14, 0.585, 0.765],
    pillar: 0.45,
    roof_fall: 0.055,
    roof_width: 0.74,
    rear_glass: true,
};
const SUV: Shape = Shape {
    deck: &[
        (0.0, 0.60),
        (0.03, 0.635),
        (0.2, 0.64),
        (0.5, 0.62),
        (0.73, 0.615),
        (0.9, 0.585),
        (0.975, 0.54),
        (1.0, 0.50),
    ],
    cabin: [0.015, 0.085, 0.575, 0.735],
    pillar: 0.45,
    roof_fall: 0.02,
    roof_width: 0.78,
    rear_glass: true,
};
const VAN: Shape = Shape {
    deck: &[(0.0, 0.50), (0.02, 0.52), (0.3, 0.53), (0.7, 0.525), (0.86, 0.51), (0.96, 0.45), (1.0, 0.40)],
    cabin: [0.005, 0.02, 0.70, 0.875],
    pillar: 0.60,
    roof_fall: 0.0,
    roof_width: 0.86,
    rear_glass: false,
};

/// Half a cross-section of the lower shell: part of the half width, part of the height from the
/// sill to the deck, from the sill upwards.
const SECTION: [(f32, f32); 9] = [
    (0.86, 0.0),
    (0.955, 0.05),
    (0.985, 0.22),
    (1.0, 0.48),
    (0.992, 0.72),
    (0.965, 0.90),
    (0.90, 0.985),
    (0.55, 1.02),
    (0.0, 1.035),
];

struct Builder<'a> {
    shape: &'a Shape,
    length: f32,
    /// Half the width of the sheet metal; mirrors reach farther.
    half: f32,
    height: f32,
    sill: f32,
    wheel_radius: f32,
    axles: [f32; 2],
    mesh: VehicleMesh,
}

/// The body of a vehicle in its body frame, to its measures: bumpers and mirrors reach the outline.
pub(in crate::render) fn body(kind: BodyType, d: &Dimensions) -> VehicleMesh {
    let shape = match kind {
        BodyType::Sedan => &SEDAN,
        BodyType::Hatchback => &HATCHBACK,
        BodyType::Suv => &SUV,
        BodyType::Van => &VAN,
    };
    let axle = d.wheelbase_m as f32 / 2.0;
    let mut builder = Builder {
        shape,
        length: d.length_m as f32,
        half: half_of_sheet_metal(d),
        height: d.height_m as f32,
        sill: 0.13 * d.height_m as f32,
        wheel_radius: d.wheel_radius_m as f32,
        axles: [axle, -axle],
        mesh: VehicleMesh::default(),
    };
    builder.shell();
    builder.ends();
    builder.cabin();
    builder.arches();
    builder.mirrors();
    builder.mesh
}

/// Half the width of a body without its mirrors.
pub(in crate::render) fn half_of_sheet_metal(d: &Dimensions) -> f32 {
    d.width_m as f32 / 2.0 * 0.93
}

impl Builder<'_> {
    fn x(&self, t: f32) -> f32 {
        (t - 0.5) * self.length
    }

    fn deck(&self, t: f32) -> f32 {
        let points = self.shape.deck;
        let after = points.partition_point(|p| p.0 < t).clamp(1, points.len() - 1);
        let (a, b) = (points[after - 1], points[after]);
        let part = ((t - a.0) / (b.0 - a.0)).clamp(0.0, 1.0);
        (a.1 + (b.1 - a.1) * part) * self.height
    }

    /// Half width seen from above: round at the corners.
    fn plan(&self, t: f32) -> f32 {
        let out = (2.0 * t - 1.0).abs();
        self.half * (1.0 - 0.05 * out.powi(4) - 0.13 * out.powi(24))
    }

    fn shell_section(&self, t: f32) -> Vec<Vec3> {
        let (x, half) = (self.x(t), self.plan(t));
        // Bumpers curve in below and above towards the ends.
        let end = ((2.0 * t - 1.0).abs() - 0.93).max(0.0) / 0.07;
        let low = self.sill + 0.10 * self.height * end * end;
        let high = self.deck(t) - 0.05 * self.height * end * end;
        let side =
            |sign: f32| move |&(y, z): &(f32, f32)| Vec3::new(x, sign * y * half, low + z * (high - low));
        let mut ring: Vec<Vec3> = SECTION.iter().map(side(-1.0)).collect();
        ring.extend(SECTION.iter().rev().skip(1).map(side(1.0)));
        ring
    }

    fn shell(&mut self) {
        let stops = [
            0.0, 0.008, 0.02, 0.045, 0.09, 0.16, 0.25, 0.36, 0.48, 0.60, 0.70, 0.78, 0.85, 0.91, 0.955, 0.98,
            0.992, 1.0,
        ];
        let loft = Loft { sections: stops.iter().map(|&t| self.shell_section(t)).collect() };
        let last = stops.len() - 2;
        let points = loft.sections[0].len() - 1;
        loft.add_to(&mut self.mesh, |section, point| {
            let from_sill = point.min(points - 1 - point);
            let left = point > points / 2;
            Some(match (section, from_sill) {
                (_, 0 | 1) => PLASTIC,
                (s, 4) if s >= last - 1 => HEAD,
                (s, 3) if s + 2 == last => indicator(left),
                (0 | 1, 4) => TAIL,
                (2, 4) => TAIL,
                _ => PAINT,
            })
        });
        // The floor, so that light does not shine through from below.
        let (half, low) = (self.half * 0.86, self.sill);
        let (rear, front) = (self.x(0.01), self.x(0.99));
        self.mesh.plate(
            &[
                Vec3::new(rear, -half, low),
                Vec3::new(rear, half, low),
                Vec3::new(front, half, low),
                Vec3::new(front, -half, low),
            ],
            PLASTIC,
        );
    }

    /// Front and rear faces with lamps, grille and plates.
    fn ends(&mut self) {
        for (t, facing) in [(1.0, 1.0), (0.0, -1.0)] {
            let ring = self.shell_section(t);
            let count = ring.len();
            for k in 0..count / 2 {
                let (a, b, c, d) = (ring[k], ring[count - 1 - k], ring[count - 2 - k], ring[k + 1]);
                let skin = if k < 3 { PLASTIC } else { PAINT };
                let corners = if facing > 0.0 { [a, b, c, d] } else { [b, a, d, c] };
                if (c - d).length() > 1e-3 {
                    self.mesh.plate(&corners, skin);
                } else {
                    self.mesh.plate(&corners[..3], skin);
                }
            }
            let (low, high, half) = (ring[0].z, ring[count / 2].z, ring[3].y.abs());
            let z = |part: f32| low + part * (high - low);
            let x = ring[0].x + facing * 0.006;
            let farther = x + facing * 0.004;
            let (lamp_low, lamp_high) = (z(0.56), z(0.86));
            for side in [-1.0_f32, 1.0] {
                let band = |a: f32, b: f32| {
                    [(side * a * half).min(side * b * half), (side * a * half).max(side * b * half)]
                };
                let left = side > 0.0;
                if facing > 0.0 {
                    self.mesh.upright(x, facing, band(0.55, 0.97), [lamp_low, lamp_high], HEAD);
                    self.mesh.upright(
                        farther,
                        facing,
                        band(0.86, 0.97),
                        [lamp_low, z(0.70)],
                        indicator(left),
                    );
                } else {
                    self.mesh.upright(x, facing, band(0.52, 0.97), [lamp_low, lamp_high], TAIL);
                    self.mesh.upright(
                        farther,
                        facing,
                        band(0.78, 0.97),
                        [lamp_low, z(0.68)],
                        indicator(left),
                    );
                    self.mesh.upright(farther, facing, band(0.54, 0.68), [lamp_low, z(0.66)], REVERSE);
                }
            }
            let plate = Skin::new(Part::Dull, [222, 222, 214]);
            let grille = Skin::new(Part::Dull, [18, 18, 20]);
            if facing > 0.0 {
                self.mesh.upright(x, facing, [-0.5 * half, 0.5 * half], [z(0.62), z(0.82)], grille);
                self.mesh.upright(farther, facing, [-0.26, 0.26], [z(0.40), z(0.40) + 0.12], plate);
            } else {
                self.mesh.upright(x, facing, [-0.27, 0.27], [z(0.58), z(0.58) + 0.12], plate);
            }
        }
    }

    fn cabin(&mut self) {
        let [rear_foot, rear_roof, front_roof, front_foot] = self.shape.cabin;
        let pillar = self.shape.pillar;
        let back = rear_roof + 0.35 * (pillar - rear_roof).min(0.1);
        let stops = [
            rear_foot,
            rear_roof,
            back,
            pillar - 0.012,
            pillar + 0.012,
            front_roof - 0.02,
            front_roof,
            front_foot,
        ];
        let last = stops.len() - 1;
        let section = |k: usize| -> Vec<Vec3> {
            let t = stops[k];
            let (x, foot) = (self.x(t), self.deck(t) - 0.01);
            let at_foot = k == 0 || k == last;
            let fall =
                self.shape.roof_fall * ((front_roof - t) / (front_roof - rear_roof)).clamp(0.0, 1.0).powi(2);
            let front = 0.02 * ((t - front_roof + 0.12) / 0.12).clamp(0.0, 1.0);
            let roof = if at_foot { foot + 0.012 } else { self.height * (1.0 - fall - front) - 0.02 };
            let wide = self.plan(t) * 0.935;
            let top = if at_foot { wide * 0.96 } else { self.plan(t) * self.shape.roof_width };
            let rise = roof - foot;
            let half = [
                (wide, foot),
                (wide + (top - wide) * 0.10, foot + 0.10 * rise),
                (wide + (top - wide) * 0.88, foot + 0.84 * rise),
                (top * 0.97, foot + 0.94 * rise),
                (top * 0.84, roof - 0.012 * rise),
                (0.0, roof + 0.02 * rise.min(1.0)),
            ];
            let mut ring: Vec<Vec3> = half.iter().map(|&(y, z)| Vec3::new(x, -y, z)).collect();
            ring.extend(half.iter().rev().skip(1).map(|&(y, z)| Vec3::new(x, y, z)));
            ring
        };
        let sections: Vec<Vec<Vec3>> = (0..stops.len()).map(section).collect();
        let points = sections[0].len() - 1;
        let rear_glass = self.shape.rear_glass;
        // Windscreen and rear window are lofts of their own, so that their edges stay sharp.
        for (range, is_end) in [(0..2, true), (1..last, false), (last - 1..last + 1, true)] {
            let start = range.start;
            let loft = Loft { sections: sections[range].to_vec() };
            loft.add_to(&mut self.mesh, |section, point| {
                let (section, from_foot) = (section + start, point.min(points - 1 - point));
                let side_glass = match section {
                    2 => rear_glass,
                    4 => true,
                    _ => false,
                };
                Some(match from_foot {
                    0 => PAINT,
                    1 if side_glass => GLASS,
                    2.. if is_end && (rear_glass || section > 0) => {
                        if from_foot == 2 {
                            PAINT
                        } else {
                            GLASS
                        }
                    }
                    1 if is_end && section > 0 => GLASS,
                    _ => PAINT,
                })
            });
        }
        // The lamp above the rear window.
        let x = self.x(rear_roof) - 0.03;
        let z = sections[1][points / 2].z - 0.05;
        self.mesh.upright(x - 0.02, -1.0, [-0.16, 0.16], [z - 0.02, z + 0.02], TAIL);
        if !rear_glass {
            let x = self.x(0.0) - 0.004;
            let (low, high) = (self.deck(0.0) + 0.06, self.height * 0.86);
            for side in [-1.0_f32, 1.0] {
                let (a, b) = (side * 0.06, side * 0.62 * self.half);
                self.mesh.upright(x + 0.02, -1.0, [a.min(b), a.max(b)], [low, high], GLASS);
            }
        }
    }

    /// Dark rounds behind the wheels.
    fn arches(&mut self) {
        for axle in self.axles {
            for side in [-1.0_f32, 1.0] {
                let radius = 1.16 * self.wheel_radius;
                let y = side * (self.half + 0.004);
                let mut ring = Vec::new();
                for k in 0..=14 {
                    let angle = std::f32::consts::PI * (-0.12 + 1.24 * k as f32 / 14.0);
                    let z = self.wheel_radius + radius * angle.sin();
                    ring.push(Vec3::new(axle + radius * angle.cos(), y, z.max(self.sill - 0.01)));
                }
                if side > 0.0 {
                    ring.reverse();
                }
                self.mesh.plate(&ring, Skin::new(Part::Dull, [14, 14, 15]));
            }
        }
    }

    fn mirrors(&mut self) {
        let t = self.shape.cabin[3] - 0.05;
        let (x, z) = (self.x(t), self.deck(t) + 0.03);
        let outer = self.half / 0.93;
        for side in [-1.0_f32, 1.0] {
            let (a, b) = (side * self.half * 0.88, side * outer);
            let low = Vec3::new(x - 0.06, a.min(b), z);
            let high = Vec3::new(x + 0.06, a.max(b), z + 0.13);
            self.mesh.block(low, high, PAINT);
        }
    }
}

fn indicator(left: bool) -> Skin {
    let part = if left { Part::IndicatorLeft } else { Part::IndicatorRight };
    Skin::new(part, [176, 92, 20])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dimensions(height_m: f64) -> Dimensions {
        Dimensions {
            length_m: 5.0,
            width_m: 2.5,
            height_m,
            wheelbase_m: 3.0,
            track_m: 2.1,
            wheel_radius_m: 0.35,
        }
    }

    #[test]
    fn bodies_fill_their_outline_and_face_outwards() {
        for (kind, height) in
            [(BodyType::Sedan, 1.5), (BodyType::Hatchback, 1.55), (BodyType::Suv, 1.8), (BodyType::Van, 2.2)]
        {
            let mesh = body(kind, &dimensions(height));
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for v in &mesh.vertices {
                (low, high) = (low.min(v.position.into()), high.max(v.position.into()));
            }
            assert!((high.x - 2.5).abs() < 0.03 && (low.x + 2.5).abs() < 0.03, "{kind:?} {low} {high}");
            assert!((high.y - 1.25).abs() < 0.02 && (low.y + 1.25).abs() < 0.02, "{kind:?} {low} {high}");
            assert!((high.z - height as f32).abs() < 0.04 && low.z > 0.1, "{kind:?} {low} {high}");
            // Outward faces enclose a positive volume.
            let corner = |k: u32| Vec3::from(mesh.vertices[k as usize].position);
            let volume: f32 = mesh
                .indices
                .chunks(3)
                .map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0)
                .sum();
            assert!(volume > 8.0, "{kind:?} {volume}");
            assert!(mesh.indices.len() / 3 < 1400, "{}", mesh.indices.len() / 3);
        }
    }
}
