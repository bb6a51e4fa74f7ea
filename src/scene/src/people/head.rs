//! The head of a figure near by: a face, and hair with a hairline, or what is worn over it.

use super::super::mesh::{Finish, Mesh};
use super::figure::{EYE, HAIR, HAT, MOUTH, NOSE, SKIN, SLEEVE};
use super::loft::{Section, limb_sections, loft, tube};
use super::look::Cut;
use glam::{Quat, Vec2, Vec3};
use std::f32::consts::TAU;

/// Sides of a skull and of hair: columns at every 30 degrees from the forehead.
const SIDES: usize = 12;
const SMALL_SIDES: u32 = 6;

/// Sections of a head: height over its neck, half width, half depth, and how far in front of the joint.
const SKULL: [[f32; 4]; 10] = [
    [0.064, 0.0, 0.0, 0.046],
    [0.070, 0.028, 0.032, 0.046],
    [0.088, 0.046, 0.054, 0.036],
    [0.118, 0.060, 0.078, 0.020],
    [0.150, 0.068, 0.089, 0.012],
    [0.182, 0.0725, 0.092, 0.007],
    [0.220, 0.0725, 0.092, 0.002],
    [0.252, 0.063, 0.081, -0.001],
    [0.274, 0.038, 0.049, -0.003],
    [0.282, 0.0, 0.0, -0.004],
];

/// Above, hair and hats are round.
const ROUND_M: f32 = 0.20;

/// Hair or a hat: its lower edge by columns from the forehead to the nape, half a head, metres over the neck.
struct Shell {
    edge: [f32; SIDES / 2 + 1],
    /// How far outside of the skull.
    thick_m: f32,
    /// How far its top is over that of the skull.
    top_m: f32,
    /// Whether it falls straight from the widest part of the skull rather than along it.
    is_hanging: bool,
    /// By which share it is narrower at the neck.
    gathered: f32,
    /// How far it stands out over the forehead.
    sweep_m: f32,
}

const SHORT: Shell = Shell {
    edge: [0.238, 0.244, 0.206, 0.168, 0.134, 0.108, 0.102],
    thick_m: 0.011,
    top_m: 0.018,
    is_hanging: false,
    gathered: 0.0,
    sweep_m: 0.0,
};
/// Long on top, combed up from the forehead, short at the sides.
const SWEPT: Shell =
    Shell { edge: [0.244, 0.250, 0.212, 0.180, 0.150, 0.126, 0.120], top_m: 0.027, sweep_m: 0.012, ..SHORT };
/// Combed back tightly into a bun or tail.
const TIED: Shell =
    Shell { edge: [0.246, 0.240, 0.216, 0.184, 0.150, 0.124, 0.112], thick_m: 0.010, top_m: 0.016, ..SHORT };
const BOB: Shell = Shell {
    edge: [0.236, 0.224, 0.116, 0.078, 0.070, 0.066, 0.066],
    thick_m: 0.014,
    top_m: 0.018,
    is_hanging: true,
    gathered: -0.06,
    ..SHORT
};
const LOOSE: Shell =
    Shell { edge: [0.244, 0.230, 0.080, 0.036, 0.016, 0.006, 0.004], thick_m: 0.010, gathered: 0.0, ..BOB };
/// What is seen of hair under a hat.
const UNDER_HAT: Shell = Shell { edge: [0.225, 0.222, 0.205, 0.166, 0.132, 0.108, 0.102], ..TIED };
const CAP: Shell =
    Shell { edge: [0.222, 0.220, 0.214, 0.206, 0.196, 0.186, 0.182], thick_m: 0.015, top_m: 0.022, ..SHORT };
const BEANIE: Shell =
    Shell { edge: [0.222, 0.218, 0.206, 0.186, 0.166, 0.150, 0.146], thick_m: 0.014, top_m: 0.030, ..SHORT };
/// The turned-up edge of a beanie: as high everywhere over its lower edge.
const TURN_UP_M: f32 = 0.036;
const HOOD: Shell = Shell {
    edge: [0.246, 0.238, 0.080, 0.030, 0.0, -0.016, -0.020],
    thick_m: 0.020,
    top_m: 0.026,
    is_hanging: true,
    gathered: 0.26,
    ..SHORT
};

/// A head on its neck.
pub(super) struct Head {
    pub(super) neck: Vec3,
    /// How far forward a nod takes it.
    pub(super) nod_m: f32,
    pub(super) tilt: Quat,
}

impl Head {
    /// The place so far in front, to the left and over the neck.
    pub(super) fn at(&self, x: f32, y: f32, up: f32) -> Vec3 {
        const JOINT_M: f32 = 0.06;
        self.neck + Vec3::Z * JOINT_M + self.tilt * Vec3::new(x + self.nod_m, y, up - JOINT_M)
    }

    pub(super) fn draw(&self, mesh: &mut Mesh, cut: Cut) {
        let skull: Vec<Section> = SKULL.iter().map(|part| self.section(part)).collect();
        loft(mesh, &skull, SIDES as u32, SKIN);
        self.face(mesh);
        match cut {
            Cut::Short => self.shell(mesh, &SHORT, HAIR),
            Cut::Swept => self.shell(mesh, &SWEPT, HAIR),
            Cut::Bearded => {
                self.shell(mesh, &SHORT, HAIR);
                self.beard(mesh);
            }
            Cut::Bald => self.beard(mesh),
            Cut::Bob => self.shell(mesh, &BOB, HAIR),
            Cut::Loose => self.shell(mesh, &LOOSE, HAIR),
            Cut::Bun => {
                self.shell(mesh, &TIED, HAIR);
                let knot = [
                    (self.at(-0.080, 0.0, 0.232), [0.022; 2]),
                    (self.at(-0.098, 0.0, 0.241), [0.041; 2]),
                    (self.at(-0.124, 0.0, 0.254), [0.036; 2]),
                    (self.at(-0.138, 0.0, 0.261), [0.0; 2]),
                ];
                loft(mesh, &limb_sections(&knot, Vec3::Y), SMALL_SIDES, HAIR);
            }
            Cut::Tail => {
                self.shell(mesh, &TIED, HAIR);
                let tail = [
                    (self.at(-0.085, 0.0, 0.222), [0.016; 2]),
                    (self.at(-0.122, 0.0, 0.216), [0.029, 0.026]),
                    (self.at(-0.140, 0.0, 0.150), [0.032, 0.026]),
                    (self.at(-0.132, 0.0, 0.060), [0.022, 0.018]),
                    (self.at(-0.122, 0.0, 0.005), [0.0; 2]),
                ];
                loft(mesh, &limb_sections(&tail, Vec3::X), SMALL_SIDES, HAIR);
            }
            Cut::Cap => {
                self.shell(mesh, &UNDER_HAT, HAIR);
                self.shell(mesh, &CAP, HAT);
                self.peak(mesh);
            }
            Cut::Beanie => {
                self.shell(mesh, &UNDER_HAT, HAIR);
                self.beanie(mesh);
            }
            Cut::LooseBeanie => {
                self.shell(mesh, &LOOSE, HAIR);
                self.beanie(mesh);
            }
            Cut::Hood => self.shell(mesh, &HOOD, SLEEVE),
        }
    }

    fn section(&self, &[up, wide, deep, forward]: &[f32; 4]) -> Section {
        Section {
            at: self.at(forward, 0.0, up),
            front: self.tilt * Vec3::X * deep,
            side: self.tilt * Vec3::Y * wide,
        }
    }

    /// Hair or a hat around the skull down to its edge, which is turned inwards.
    fn shell(&self, mesh: &mut Mesh, shell: &Shell, finish: Finish) {
        /// How far inwards the edge goes, as a share.
        const INSIDE: f32 = 0.80;
        /// Up to where the inner side of hanging hair is seen: above is the skull.
        const LINED_M: f32 = 0.16;
        let column = |k: usize| shell.edge[k.min(SIDES - k)];
        let top_m = SKULL[SKULL.len() - 1][0] + shell.top_m;
        let point = |k: usize, up: f32, share: f32| {
            let [wide, deep, forward] = shell.girth(up, top_m);
            let (sin, cos) = (TAU * k as f32 / SIDES as f32).sin_cos();
            let over = ((up - ROUND_M) / (top_m - ROUND_M)).clamp(0.0, 1.0);
            let swept_m = 4.0 * shell.sweep_m * over * (1.0 - over) * cos.max(0.0);
            self.at(forward + swept_m + share * deep * cos, share * wide * sin, up)
        };
        let rim = |least_m: f32| {
            (0..SIDES).map(|k| point(k, (column(k) + 0.004).max(least_m), INSIDE)).collect::<Vec<_>>()
        };
        let lining = shell.is_hanging.then(|| rim(LINED_M));
        // Closer to each other above the widest part, where the skull curves.
        let row = |row: usize| {
            let up = |edge_m: f32| {
                let middle_m = (edge_m + 0.35 * (top_m - edge_m)).max(ROUND_M);
                let over = |share: f32| middle_m + share * (top_m - middle_m);
                [edge_m, edge_m.midpoint(middle_m), middle_m, over(0.52), over(0.86), top_m][row]
            };
            (0..SIDES).map(|k| point(k, up(column(k)), 1.0)).collect::<Vec<_>>()
        };
        let rows: Vec<Vec<Vec3>> =
            lining.into_iter().chain([rim(f32::NEG_INFINITY)]).chain((0..6).map(row)).collect();
        tube(mesh, &rows, finish);
    }

    fn beanie(&self, mesh: &mut Mesh) {
        self.shell(mesh, &BEANIE, HAT);
        // A ring around its edge.
        let ring = |thick_m: f32, over_m: f32| -> Vec<Vec3> {
            let shell = Shell { thick_m, ..BEANIE };
            (0..SIDES)
                .map(|k| {
                    let up = BEANIE.edge[k.min(SIDES - k)] + over_m;
                    let [wide, deep, forward] = shell.girth(up, SKULL[SKULL.len() - 1][0] + BEANIE.top_m);
                    let (sin, cos) = (TAU * k as f32 / SIDES as f32).sin_cos();
                    self.at(forward + deep * cos, wide * sin, up)
                })
                .collect()
        };
        let rows =
            [ring(0.004, 0.0), ring(0.019, -0.002), ring(0.021, TURN_UP_M), ring(0.012, TURN_UP_M + 0.003)];
        tube(mesh, &rows, HAT);
    }

    /// The peak of a cap, seen from above and below.
    fn peak(&self, mesh: &mut Mesh) {
        const COLUMNS: [f32; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
        let inner = |share: f32| self.at(0.090 - 0.034 * share * share, 0.060 * share, 0.227);
        let outer =
            |share: f32| self.at(0.176 - 0.096 * share * share, 0.070 * share, 0.219 - 0.006 * share * share);
        for pair in COLUMNS.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let top = [inner(a), outer(a), outer(b), inner(b)];
            let down = Vec3::Z * 0.004;
            let under = [inner(b), outer(b), outer(a), inner(a)].map(|corner| corner - down);
            for corners in [top, under] {
                mesh.face(&corners, &[Vec2::ZERO; 4], HAT);
            }
        }
    }

    /// A full beard with a moustache around the mouth.
    fn beard(&self, mesh: &mut Mesh) {
        // The foremost and the hindmost point by place along x and height, and half the width.
        const ROWS: [[f32; 5]; 6] = [
            [0.040, 0.052, 0.040, 0.052, 0.0],
            [0.088, 0.058, 0.004, 0.056, 0.038],
            [0.105, 0.080, -0.016, 0.080, 0.056],
            [0.107, 0.098, -0.036, 0.124, 0.0695],
            [0.107, 0.103, -0.036, 0.176, 0.0755],
            [0.080, 0.104, -0.030, 0.178, 0.066],
        ];
        let rows: Vec<Section> = ROWS
            .iter()
            .map(|&[front, low, back, high, wide]| {
                let [front, back] = [self.at(front, 0.0, low), self.at(back, 0.0, high)];
                Section {
                    at: front.midpoint(back),
                    front: (front - back) / 2.0,
                    side: self.tilt * Vec3::Y * wide,
                }
            })
            .collect();
        loft(mesh, &rows, SIDES as u32, HAIR);
        for side in [1.0, -1.0] {
            self.patch(
                mesh,
                &[[0.0, 0.121], [0.026, 0.110], [0.024, 0.119], [0.0, 0.130]],
                side,
                0.004,
                HAIR,
            );
        }
    }

    /// Eyes with brows, a nose, a mouth and ears.
    fn face(&self, mesh: &mut Mesh) {
        const EYE_AT: [[f32; 2]; 6] = [
            [0.0225, 0.1745],
            [0.0290, 0.1715],
            [0.0365, 0.1735],
            [0.0400, 0.1770],
            [0.0350, 0.1805],
            [0.0265, 0.1800],
        ];
        const BROW_AT: [[f32; 2]; 4] =
            [[0.0180, 0.1940], [0.0450, 0.1945], [0.0420, 0.1985], [0.0190, 0.1985]];
        const LIP_AT: [[f32; 2]; 4] = [[0.0, 0.1135], [0.0200, 0.1160], [0.0200, 0.1180], [0.0, 0.1185]];
        for side in [1.0, -1.0] {
            self.patch(mesh, &EYE_AT, side, 0.0015, EYE);
            self.patch(mesh, &BROW_AT, side, 0.003, HAIR);
            self.patch(mesh, &LIP_AT, side, 0.0015, MOUTH);
            // Bridge, tip, and wing of the nose.
            let front = |up: f32| front_of(0.0, up);
            let bridge = self.at(front(0.180) + 0.001, 0.0, 0.180);
            let tip = self.at(front(0.146) + 0.017, 0.0, 0.144);
            let wing = self.at(front(0.138) - 0.001, 0.0145 * side, 0.138);
            let under = self.at(front(0.134), 0.0, 0.134);
            for corners in [[tip, wing, bridge], [under, wing, tip]] {
                let [a, b, c] = corners;
                let corners = if side < 0.0 { [a, c, b] } else { corners };
                mesh.face(&corners, &[Vec2::ZERO; 3], NOSE);
            }
            let ear = [[0.127, 0.0, 0.0], [0.140, 0.008, 0.010], [0.166, 0.010, 0.017], [0.182, 0.0, 0.0]];
            let ear: Vec<Section> = ear
                .iter()
                .map(|&[up, thick, deep]| Section {
                    at: self.at(-0.006, 0.071 * side, up),
                    front: self.tilt * Vec3::X * deep,
                    side: self.tilt * Vec3::Y * thick,
                })
                .collect();
            loft(mesh, &ear, 5, SKIN);
        }
    }

    /// A flat patch over the front of the skull: corners to the left and up, mirrored for a side of -1.
    fn patch(&self, mesh: &mut Mesh, corners: &[[f32; 2]], side: f32, lift_m: f32, finish: Finish) {
        let mut corners: Vec<Vec3> =
            corners.iter().map(|&[y, up]| self.at(front_of(y, up) + lift_m, y * side, up)).collect();
        if side < 0.0 {
            corners.reverse();
        }
        mesh.face(&corners, &vec![Vec2::ZERO; corners.len()], finish);
    }
}

impl Shell {
    /// Half width, half depth and place along x at a height.
    fn girth(&self, up: f32, top_m: f32) -> [f32; 3] {
        /// Where the skull is widest.
        const WIDEST_M: f32 = 0.185;
        /// From where down hanging hair is gathered.
        const GATHERED_M: f32 = 0.14;
        let level = if self.is_hanging { up.max(WIDEST_M) } else { up };
        let [wide, deep, forward] = skull_at(level.min(ROUND_M));
        // Towards the neck hanging hair and hoods are narrower.
        let gathered = 1.0 - self.gathered * ((GATHERED_M - up) / GATHERED_M).clamp(0.0, 1.2);
        let over = ((up - ROUND_M) / (top_m - ROUND_M)).clamp(0.0, 1.0);
        let share = (1.0 - over * over).sqrt() * gathered;
        [(wide + self.thick_m) * share, (deep + self.thick_m) * share, forward - 0.2 * self.thick_m]
    }
}

/// Half width, half depth and place along x of the skull at a height.
fn skull_at(up: f32) -> [f32; 3] {
    let above = SKULL.iter().position(|part| part[0] > up).unwrap_or(SKULL.len() - 1).max(1);
    let [low, high] = [SKULL[above - 1], SKULL[above]];
    let share = ((up - low[0]) / (high[0] - low[0])).clamp(0.0, 1.0);
    [1, 2, 3].map(|k| low[k] + (high[k] - low[k]) * share)
}

/// The place along x of the front of the skull.
fn front_of(y: f32, up: f32) -> f32 {
    let [wide, deep, forward] = skull_at(up);
    forward + deep * (1.0 - (y / wide) * (y / wide)).max(0.0).sqrt()
}
