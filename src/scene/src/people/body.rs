//! The near level of a figure: a body with hands, shoes and a face, in clothes with hems, collars and belts.

use super::super::mesh::{Finish, Mesh};
use super::figure::{
    BAG, BELT, COAT, COLLAR, Dress, EYE, EYE_WHITE, HAIR, HIP_M, LEGS, MOUTH, Model, NOSE, Pose, SHIRT,
    SHOES, SKIN, SLEEVE, TROUSERS, belongings, hem,
};
use super::loft::{Section, limb_sections, loft};
use glam::{Quat, Vec2, Vec3};

/// Sides of what is round.
const TRUNK_SIDES: u32 = 11;
const HEAD_SIDES: u32 = 10;
const LIMB_SIDES: u32 = 7;
const SMALL_SIDES: u32 = 6;

/// Sections of a trunk above the hips: height along the spine, half width, half depth, and how far in front of the spine.
type Profile = [f32; 4];

const CHEST: [Profile; 5] = [
    [0.34, 0.168, 0.118, 0.010],
    [0.46, 0.176, 0.108, 0.004],
    [0.530, 0.158, 0.088, -0.006],
    [0.570, 0.108, 0.070, -0.006],
    [0.600, 0.066, 0.062, 0.0],
];
const WAIST: [Profile; 2] = [[0.02, 0.164, 0.120, 0.0], [0.17, 0.148, 0.108, 0.006]];
/// Of a jacket, and of what is tucked in.
const JACKET_HEM: [Profile; 3] =
    [[-0.115, 0.140, 0.100, 0.0], [-0.120, 0.172, 0.126, 0.0], [-0.10, 0.174, 0.128, 0.0]];
const TUCKED_HEM: [Profile; 1] = [[-0.01, 0.160, 0.116, 0.0]];
const PELVIS: [Profile; 5] = [
    [-0.15, 0.0, 0.0, 0.0],
    [-0.14, 0.085, 0.070, 0.0],
    [-0.08, 0.158, 0.116, -0.006],
    [0.0, 0.162, 0.117, -0.004],
    [0.06, 0.154, 0.110, 0.0],
];
/// A belt, at the top of trousers or around the waist of a coat.
const BELT_ON_HIPS: [Profile; 2] = [[-0.012, 0.165, 0.121, 0.0], [0.024, 0.1665, 0.1225, 0.0]];
const BELT_ON_WAIST: [Profile; 2] = [[0.150, 0.155, 0.114, 0.005], [0.195, 0.156, 0.115, 0.006]];
const COLLAR_ROUND: [Profile; 4] = [
    [0.580, 0.094, 0.074, -0.004],
    [0.610, 0.072, 0.068, 0.002],
    [0.648, 0.067, 0.066, -0.002],
    [0.640, 0.054, 0.054, -0.002],
];
const SCARF: [Profile; 4] = [
    [0.575, 0.070, 0.070, 0.0],
    [0.590, 0.096, 0.090, 0.008],
    [0.622, 0.092, 0.088, 0.010],
    [0.645, 0.058, 0.056, 0.004],
];

/// A leg in trousers, and a bare one: share of thigh and shin, half width and half depth, and how far behind the bone.
const THIGH: [([f32; 4], [f32; 2]); 3] = [
    ([0.0, 0.084, 0.104, 0.0], [0.074, 0.090]),
    ([0.40, 0.082, 0.092, 0.0], [0.068, 0.076]),
    ([0.74, 0.069, 0.076, 0.0], [0.054, 0.060]),
];
const SHIN: [([f32; 4], [f32; 2]); 4] = [
    ([0.0, 0.063, 0.069, 0.0], [0.049, 0.054]),
    ([0.30, 0.060, 0.067, 0.012], [0.050, 0.056]),
    ([0.70, 0.055, 0.060, 0.008], [0.036, 0.040]),
    ([0.96, 0.057, 0.066, 0.0], [0.031, 0.034]),
];

/// A shoe: from the ankle forward, half width, and height over its sole at the ankle.
const SHOE: [[f32; 3]; 9] = [
    [-0.070, 0.0, 0.040],
    [-0.068, 0.028, 0.066],
    [-0.052, 0.038, 0.098],
    [0.0, 0.042, 0.104],
    [0.060, 0.044, 0.072],
    [0.125, 0.049, 0.052],
    [0.172, 0.044, 0.042],
    [0.194, 0.032, 0.030],
    [0.198, 0.0, 0.015],
];
/// From the ankle down to its sole.
const SOLE_M: f32 = 0.092;

/// A hand: from the wrist along it, half width and half thickness.
const HAND: [[f32; 3]; 6] = [
    [0.0, 0.026, 0.022],
    [0.035, 0.036, 0.021],
    [0.080, 0.041, 0.019],
    [0.115, 0.037, 0.015],
    [0.146, 0.024, 0.011],
    [0.150, 0.0, 0.0],
];

/// Sections of a head: height over its joint, half width, half depth, and how far in front of the joint.
const SKULL: [Profile; 9] = [
    [0.066, 0.0, 0.0, 0.040],
    [0.072, 0.030, 0.034, 0.042],
    [0.090, 0.048, 0.054, 0.034],
    [0.120, 0.061, 0.078, 0.020],
    [0.150, 0.069, 0.089, 0.013],
    [0.182, 0.0735, 0.093, 0.008],
    [0.220, 0.0735, 0.093, 0.003],
    [0.255, 0.062, 0.080, -0.002],
    [0.282, 0.0, 0.0, -0.004],
];
/// Hair in sections that are higher at the forehead than at the nape: the foremost and the hindmost point, each by its
/// place along x and its height, and half the width.
const HAIR_CAP: [[f32; 5]; 6] = [
    [0.088, 0.226, -0.070, 0.105, 0.066],
    [0.1015, 0.230, -0.094, 0.098, 0.0785],
    [0.104, 0.246, -0.108, 0.150, 0.0850],
    [0.090, 0.274, -0.104, 0.220, 0.0800],
    [0.050, 0.292, -0.066, 0.272, 0.0540],
    [-0.006, 0.296, -0.006, 0.296, 0.0],
];
/// Hair that falls to the shoulders, and a tail of hair.
const LOOSE: [Profile; 5] = [
    [-0.015, 0.0, 0.0, -0.058],
    [0.0, 0.078, 0.046, -0.054],
    [0.070, 0.089, 0.058, -0.044],
    [0.140, 0.087, 0.070, -0.032],
    [0.225, 0.080, 0.080, -0.020],
];
const TAIL: [([f32; 2], f32); 5] = [
    ([-0.095, 0.215], 0.016),
    ([-0.135, 0.205], 0.030),
    ([-0.150, 0.130], 0.032),
    ([-0.138, 0.050], 0.022),
    ([-0.130, 0.005], 0.0),
];

/// A figure in full detail: 1.75 m tall, looks along x, its feet at the origin, or its seat if it sits.
pub(super) fn body(mesh: &mut Mesh, model: Model) {
    let figure = Figure { model, pose: model.pose, dress: model.dress() };
    figure.trunk(mesh);
    for side in [1.0, -1.0] {
        figure.leg(mesh, side);
        figure.arm(mesh, side);
    }
    figure.head(mesh);
    belongings(mesh, model.pose, true);
}

struct Figure {
    model: Model,
    pose: Pose,
    dress: Dress,
}

impl Figure {
    fn is_long(&self) -> bool {
        matches!(self.dress, Dress::Coat | Dress::Frock)
    }

    fn spine(&self, up: f32) -> Vec3 {
        let lean = self.pose.lean();
        self.pose.hips() + Vec3::new(lean, 0.0, (1.0 - lean * lean).sqrt()) * up
    }

    /// Forward, square to the spine.
    fn ahead(&self) -> Vec3 {
        let lean = self.pose.lean();
        Vec3::new((1.0 - lean * lean).sqrt(), 0.0, -lean)
    }

    fn section(&self, [up, wide, deep, forward]: Profile) -> Section {
        let ahead = self.ahead();
        Section { at: self.spine(up) + ahead * forward, front: ahead * deep, side: Vec3::Y * wide }
    }

    fn band(&self, mesh: &mut Mesh, profile: &[Profile], finish: Finish) {
        let sections: Vec<Section> = profile.iter().map(|&part| self.section(part)).collect();
        loft(mesh, &sections, TRUNK_SIDES, finish);
    }

    /// Pelvis, chest, and what is worn over them.
    fn trunk(&self, mesh: &mut Mesh) {
        let skirt = self.skirt();
        let hem: &[Profile] = match self.dress {
            Dress::Coat | Dress::Frock => &skirt,
            Dress::Jacket => &JACKET_HEM,
            Dress::Shirt => &TUCKED_HEM,
        };
        let profile: Vec<Profile> = hem.iter().chain(&WAIST).chain(&CHEST).copied().collect();
        self.band(mesh, &profile, COAT);
        if !self.is_long() {
            self.band(mesh, &PELVIS, TROUSERS);
        }
        match self.dress {
            Dress::Shirt => self.band(mesh, &BELT_ON_HIPS, BELT),
            Dress::Coat | Dress::Frock => self.band(mesh, &BELT_ON_WAIST, BELT),
            Dress::Jacket => {}
        }
        match self.dress {
            Dress::Jacket => {
                self.band(mesh, &COLLAR_ROUND, COLLAR);
                self.strip(
                    mesh,
                    &profile,
                    &[(0.36, 0.002), (0.44, 0.020), (0.53, 0.040), (0.598, 0.050)],
                    SHIRT,
                );
                self.strip(
                    mesh,
                    &profile,
                    &[(-0.10, 0.006), (0.02, 0.006), (0.17, 0.006), (0.36, 0.006)],
                    COLLAR,
                );
            }
            Dress::Coat => {
                self.band(mesh, &SCARF, BAG);
                let buttons = [(-0.25, 0.007), (-0.10, 0.007), (0.02, 0.007), (0.15, 0.007)];
                self.strip(mesh, &profile, &buttons, COLLAR);
                self.strip(mesh, &profile, &[(0.195, 0.007), (0.34, 0.007), (0.50, 0.007)], COLLAR);
            }
            Dress::Shirt | Dress::Frock => {
                self.strip(mesh, &profile, &[(0.52, 0.012), (0.56, 0.034), (0.598, 0.050)], SKIN);
            }
        }
    }

    /// The lower part of a coat or frock, which falls over both legs.
    fn skirt(&self) -> Vec<Profile> {
        let [up, wide, deep, forward] = hem(self.pose);
        let part = |share: f32| {
            let mix = |low: f32, high: f32| low + (high - low) * share;
            [mix(up, 0.0), mix(wide, 0.164), mix(deep, 0.122), mix(forward, 0.0)]
        };
        vec![[up + 0.01, 0.8 * wide, 0.8 * deep, forward], part(0.0), part(0.10), part(0.55)]
    }

    /// A strip on the front of a trunk of a profile: heights along the spine with half widths.
    fn strip(&self, mesh: &mut Mesh, profile: &[Profile], rows: &[(f32, f32)], finish: Finish) {
        const LIFT_M: f32 = 0.005;
        let on_front = |up: f32, y: f32| {
            let above = profile.iter().position(|part| part[0] > up).unwrap_or(profile.len() - 1).max(1);
            let [low, high] = [profile[above - 1], profile[above]];
            let share = ((up - low[0]) / (high[0] - low[0])).clamp(0.0, 1.0);
            let [wide, deep, forward] = [1, 2, 3].map(|k| low[k] + (high[k] - low[k]) * share);
            let bulge = (1.0 - (y / wide) * (y / wide)).max(0.0).sqrt();
            self.spine(up) + self.ahead() * (forward + deep * bulge + LIFT_M) + Vec3::Y * y
        };
        for pair in rows.windows(2) {
            let [(low, narrow), (high, wide)] = [pair[0], pair[1]];
            for [left, right] in [[-1.0, 0.0], [0.0, 1.0]] {
                let corners = [
                    on_front(low, left * narrow),
                    on_front(low, right * narrow),
                    on_front(high, right * wide),
                    on_front(high, left * wide),
                ];
                mesh.face(&corners, &[Vec2::ZERO; 4], finish);
            }
        }
    }

    fn leg(&self, mesh: &mut Mesh, side: f32) {
        let [knee, ankle, tip] = self.pose.leg(side);
        let hip = self.pose.hips() + Vec3::Y * (HIP_M * side);
        // Towards where the knee bends.
        let facing = (knee - hip.midpoint(ankle) + Vec3::X * 0.1).normalize_or(Vec3::X);
        let is_bare = self.dress == Dress::Frock;
        let joint = |from: Vec3, to: Vec3, (clothed, bare): &([f32; 4], [f32; 2])| {
            let [share, wide, deep, behind] = *clothed;
            let size = if is_bare { *bare } else { [wide, deep] };
            (from.lerp(to, share) - facing * behind, size)
        };
        // A coat or frock hides the upper part.
        let hidden = if self.is_long() { THIGH.len() - 1 } else { 0 };
        let thigh = THIGH.iter().skip(hidden);
        let joints: Vec<(Vec3, [f32; 2])> = (thigh.map(|part| joint(hip, knee, part)))
            .chain(SHIN.iter().map(|part| joint(knee, ankle, part)))
            .collect();
        let finish = if is_bare { LEGS } else { TROUSERS };
        loft(mesh, &limb_sections(&joints, facing), LIMB_SIDES, finish);
        shoe(mesh, [knee, ankle, tip]);
    }

    fn arm(&self, mesh: &mut Mesh, side: f32) {
        let [elbow, wrist, fingers] = self.pose.arm(side);
        let shoulder = self.spine(0.525) + Vec3::Y * (0.185 * side);
        let facing = (shoulder.midpoint(wrist) - elbow + Vec3::X * 0.1).normalize_or(Vec3::X);
        let upper = |share: f32| shoulder.lerp(elbow, share);
        let lower = |share: f32| elbow.lerp(wrist, share);
        let root = [
            (self.spine(0.515) + Vec3::Y * (0.10 * side), [0.040, 0.050]),
            (self.spine(0.512) + Vec3::Y * (0.170 * side), [0.050, 0.056]),
            (upper(0.24), [0.054, 0.059]),
        ];
        let is_short = matches!(self.dress, Dress::Shirt | Dress::Frock);
        let sleeve: &[(Vec3, [f32; 2])] = if is_short {
            &[(upper(0.70), [0.057, 0.062]), (upper(0.71), [0.036, 0.038])]
        } else {
            &[
                (upper(0.65), [0.050, 0.054]),
                (elbow, [0.045, 0.048]),
                (lower(0.45), [0.043, 0.046]),
                (lower(0.95), [0.037, 0.040]),
                (lower(0.96), [0.020, 0.022]),
            ]
        };
        let sleeve: Vec<_> = root.iter().chain(sleeve).copied().collect();
        loft(mesh, &limb_sections(&sleeve, facing), LIMB_SIDES, SLEEVE);
        if is_short {
            let arm = [
                (upper(0.55), [0.038, 0.041]),
                (elbow, [0.036, 0.038]),
                (lower(0.35), [0.036, 0.038]),
                (lower(1.0), [0.024, 0.027]),
            ];
            loft(mesh, &limb_sections(&arm, facing), LIMB_SIDES, SKIN);
        }
        hand(mesh, wrist, (fingers - wrist).normalize_or(-Vec3::Z), side);
    }

    /// Neck, head, hair and face.
    fn head(&self, mesh: &mut Mesh) {
        let neck = self.spine(0.60);
        let [nod, turn_rad] = self.pose.head();
        let turn = Quat::from_rotation_z(turn_rad);
        let tilt = turn * Quat::from_rotation_y(nod);
        let joint = neck + Vec3::Z * 0.06;
        let at = |x: f32, y: f32, up: f32| joint + tilt * Vec3::new(x + 0.5 * nod * 0.06, y, up - 0.06);
        let section = |&[up, wide, deep, forward]: &Profile| Section {
            at: at(forward, 0.0, up),
            front: tilt * Vec3::X * deep,
            side: tilt * Vec3::Y * wide,
        };
        let throat = [
            (self.spine(0.565), [0.060, 0.062]),
            (neck, [0.053, 0.056]),
            (at(0.0, 0.0, 0.11), [0.050, 0.052]),
        ];
        loft(mesh, &limb_sections(&throat, Vec3::X), LIMB_SIDES, SKIN);
        let skull: Vec<Section> = SKULL.iter().map(section).collect();
        loft(mesh, &skull, HEAD_SIDES, SKIN);
        let cap: Vec<Section> = HAIR_CAP
            .iter()
            .map(|&[front, high, back, low, wide]| {
                let [front, back] = [at(front, 0.0, high), at(back, 0.0, low)];
                Section { at: front.midpoint(back), front: (front - back) / 2.0, side: tilt * Vec3::Y * wide }
            })
            .collect();
        loft(mesh, &cap, HEAD_SIDES, HAIR);
        match (self.model.has_long_hair, self.dress) {
            (true, Dress::Frock) => {
                let tail = TAIL.map(|([x, up], wide)| (at(x, 0.0, up), [wide; 2]));
                loft(mesh, &limb_sections(&tail, Vec3::X), SMALL_SIDES, HAIR);
            }
            (true, _) => {
                let loose: Vec<Section> = LOOSE.iter().map(section).collect();
                loft(mesh, &loose, HEAD_SIDES, HAIR);
            }
            _ => {}
        }
        face(mesh, &at);
    }
}

/// Eyes with brows, a nose, a mouth and ears; `at` places what is so far in front, to the left and up in a head.
fn face(mesh: &mut Mesh, at: &impl Fn(f32, f32, f32) -> Vec3) {
    let flat = |mesh: &mut Mesh, corners: &[Vec3], finish: Finish| {
        mesh.face(corners, &vec![Vec2::ZERO; corners.len()], finish);
    };
    for side in [1.0, -1.0] {
        // Counter-clockwise on both sides.
        let ordered = |mut corners: Vec<Vec3>| {
            if side < 0.0 {
                corners.reverse();
            }
            corners
        };
        let white = [
            [0.018, 0.1785, 0.0985],
            [0.032, 0.1735, 0.0975],
            [0.047, 0.179, 0.0870],
            [0.033, 0.1855, 0.0970],
        ];
        let iris = [
            [0.027, 0.1745, 0.0995],
            [0.0385, 0.1745, 0.0965],
            [0.0385, 0.1850, 0.0965],
            [0.027, 0.1850, 0.0990],
        ];
        let brow =
            [[0.014, 0.196, 0.1005], [0.050, 0.197, 0.0865], [0.048, 0.203, 0.0870], [0.016, 0.204, 0.1000]];
        for (shape, finish) in [(white, EYE_WHITE), (iris, EYE), (brow, HAIR)] {
            let corners = shape.map(|[y, up, x]| at(x, y * side, up)).to_vec();
            flat(mesh, &ordered(corners), finish);
        }
        // Bridge, tip, and wing of the nose.
        let [bridge, tip, wing] =
            [at(0.101, 0.0, 0.184), at(0.126, 0.0, 0.142), at(0.098, 0.017 * side, 0.136)];
        flat(mesh, &ordered(vec![tip, wing, bridge]), NOSE);
        flat(mesh, &ordered(vec![at(0.100, 0.0, 0.132), wing, tip]), NOSE);
        let ear = [[0.128, 0.0, 0.004], [0.140, 0.010, 0.011], [0.168, 0.012, 0.019], [0.182, 0.0, 0.010]];
        let ear: Vec<Section> = ear
            .iter()
            .map(|&[up, thick, deep]| Section {
                at: at(-0.006, 0.072 * side, up),
                front: (at(deep, 0.0, up) - at(0.0, 0.0, up)),
                side: at(0.0, thick, up) - at(0.0, 0.0, up),
            })
            .collect();
        loft(mesh, &ear, 5, SKIN);
    }
    let lip = |y: f32, up: f32| at(0.1005 - 9.0 * y * y, y, up);
    for [left, right] in [[-0.024, 0.0], [0.0, 0.024]] {
        let corners =
            [(left, 0.1115), (right, 0.1115), (right, 0.1205), (left, 0.1195)].map(|(y, up)| lip(y, up));
        flat(mesh, &corners, MOUTH);
    }
}

/// A palm with fingers, and a thumb.
fn hand(mesh: &mut Mesh, wrist: Vec3, along: Vec3, side: f32) {
    let palm = (Vec3::Y - along * along.y).normalize_or(Vec3::X);
    let across = palm.cross(along);
    let across = across * if across.x + 0.5 * across.z < 0.0 { -1.0 } else { 1.0 };
    let sections = HAND.map(|[far, wide, thick]| Section {
        at: wrist + along * far,
        front: across * wide,
        side: palm * thick,
    });
    loft(mesh, &sections, SMALL_SIDES, SKIN);
    let inward = palm * (-0.010 * side);
    let thumb = [
        (wrist + along * 0.030 + across * 0.022, [0.014; 2]),
        (wrist + along * 0.062 + across * 0.045 + inward, [0.012; 2]),
        (wrist + along * 0.094 + across * 0.050 + inward * 1.5, [0.007; 2]),
    ];
    loft(mesh, &limb_sections(&thumb, across), 4, SKIN);
}

/// A shoe with its sole flat.
fn shoe(mesh: &mut Mesh, [knee, ankle, tip]: [Vec3; 3]) {
    let shin = (knee - ankle).normalize_or(Vec3::Z);
    let along = (tip - (ankle - shin * 0.06)).normalize_or(Vec3::X);
    let up = (shin - along * shin.dot(along)).normalize_or(Vec3::Z);
    let across = up.cross(along);
    // The heel of a flat foot is below its ankle.
    let sole = ankle - up * SOLE_M.min(0.06 * shin.dot(up) + 0.03);
    let sections: Vec<Section> = SHOE
        .iter()
        .map(|&[far, wide, high]| Section {
            at: sole + along * far + up * (high / 2.0),
            front: up * (high / 2.0),
            side: across * wide,
        })
        .collect();
    loft(mesh, &sections, LIMB_SIDES, SHOES);
}

#[cfg(test)]
mod tests {
    use super::super::figure::POSES;
    use super::*;

    fn bodies() -> Vec<(Model, Mesh)> {
        let both = [false, true];
        let models = POSES.into_iter().flat_map(|pose| {
            both.into_iter()
                .flat_map(move |has_long_hair| both.map(|is_light| Model { pose, has_long_hair, is_light }))
        });
        models
            .map(|model| {
                let mut mesh = Mesh::default();
                body(&mut mesh, model);
                (model, mesh)
            })
            .collect()
    }

    #[test]
    fn faces_of_bodies_are_turned_outwards() {
        for (model, mesh) in bodies() {
            for t in mesh.indices.chunks_exact(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
                let face = (b.position - a.position).cross(c.position - a.position);
                let out = a.normal + b.normal + c.normal;
                // Slivers have no direction.
                assert!(
                    face.length() < 2e-5 || face.normalize().dot(out) > 0.0,
                    "{model:?}: {a:?} {b:?} {c:?}"
                );
            }
        }
    }

    #[test]
    fn everybody_has_skin_hair_shoes_and_legs_under_what_they_wear() {
        for (model, mesh) in bodies() {
            let extent = |finish: Finish| {
                let of = mesh.vertices.iter().filter(|v| v.finish == finish).map(|v| v.position.z);
                of.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)])
            };
            let legs = if model.dress() == Dress::Frock { LEGS } else { TROUSERS };
            let [shoes, legs, coat, skin, hair] = [SHOES, legs, COAT, SKIN, HAIR].map(extent);
            assert!(shoes[0] < legs[0] && legs[0] < coat[0], "{model:?}: {shoes:?} {legs:?} {coat:?}");
            assert!(coat[1] < skin[1] && skin[1] < hair[1], "{model:?}: {coat:?} {skin:?} {hair:?}");
        }
    }

    /// A coat or frock covers the thighs of who walks.
    #[test]
    fn no_leg_is_seen_through_a_coat() {
        for (model, mesh) in
            bodies().into_iter().filter(|(model, _)| matches!(model.dress(), Dress::Coat | Dress::Frock))
        {
            let [up, ..] = hem(model.pose);
            let finish = if model.dress() == Dress::Frock { LEGS } else { TROUSERS };
            let highest = mesh.vertices.iter().filter(|v| v.finish == finish).map(|v| v.position.z);
            let over_m = highest.fold(0.0, f32::max) - (model.pose.hips().z + up);
            assert!(over_m < 0.10, "{model:?}: legs end {over_m} m over the hem");
        }
    }
}
