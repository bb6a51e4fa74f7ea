//! The near level of a figure: a body with hands, shoes and a face, in clothes with hems, collars and belts.

use super::super::mesh::{Finish, Mesh};
use super::figure::{
    BAG, BELT, COAT, COLLAR, Dress, HIP_M, LEGS, Model, Pose, SHIRT, SHOES, SKIN, SLEEVE, TROUSERS,
    belongings, hem,
};
use super::head::Head;
use super::loft::{Section, limb_sections, loft};
use super::look::Look;
use glam::{Quat, Vec2, Vec3};

/// Sides of what is round.
const TRUNK_SIDES: u32 = 12;
const LIMB_SIDES: u32 = 7;
const SMALL_SIDES: u32 = 6;

/// Sections of a trunk above the hips: height along the spine, half width, half depth, and how far in front of the spine.
type Profile = [f32; 4];

const CHEST: [Profile; 5] = [
    [0.34, 0.163, 0.116, 0.010],
    [0.46, 0.172, 0.104, 0.004],
    [0.525, 0.162, 0.084, -0.006],
    [0.576, 0.114, 0.070, -0.008],
    [0.614, 0.060, 0.060, -0.002],
];
const WAIST: [Profile; 2] = [[0.02, 0.163, 0.118, 0.0], [0.17, 0.145, 0.104, 0.006]];
/// The same of women: a narrower waist and shoulders, and a bust.
const SLIM_CHEST: [Profile; 5] = [
    [0.35, 0.146, 0.118, 0.016],
    [0.46, 0.158, 0.102, 0.008],
    [0.525, 0.152, 0.080, -0.006],
    [0.574, 0.104, 0.066, -0.008],
    [0.612, 0.054, 0.056, -0.002],
];
const SLIM_WAIST: [Profile; 2] = [[0.02, 0.164, 0.118, 0.0], [0.18, 0.126, 0.094, 0.004]];
/// Of what is tucked in.
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
const BELT_ON_WAIST: [Profile; 2] = [[0.160, 0.134, 0.101, 0.004], [0.200, 0.133, 0.101, 0.005]];
/// A collar folded over, lower in front than behind: the foremost and the hindmost point, each by place in front of the
/// spine and height along it, and half the width.
const COLLAR_ROUND: [[f32; 5]; 4] = [
    [0.052, 0.572, -0.050, 0.620, 0.050],
    [0.057, 0.596, -0.060, 0.652, 0.058],
    [0.067, 0.596, -0.071, 0.650, 0.066],
    [0.096, 0.552, -0.088, 0.590, 0.106],
];
const SCARF: [Profile; 4] = [
    [0.575, 0.070, 0.070, 0.0],
    [0.590, 0.096, 0.090, 0.008],
    [0.622, 0.092, 0.088, 0.010],
    [0.645, 0.058, 0.056, 0.004],
];

/// A leg in trousers, and a bare one: share of thigh and shin, half width and half depth, and how far behind the bone.
const THIGH: [([f32; 4], [f32; 2]); 3] = [
    ([0.0, 0.072, 0.092, 0.0], [0.074, 0.090]),
    ([0.40, 0.078, 0.086, 0.0], [0.068, 0.076]),
    ([0.74, 0.069, 0.076, 0.0], [0.054, 0.060]),
];
const SHIN: [([f32; 4], [f32; 2]); 6] = [
    ([0.0, 0.063, 0.069, 0.0], [0.049, 0.054]),
    ([0.30, 0.060, 0.067, 0.012], [0.050, 0.056]),
    ([0.70, 0.055, 0.060, 0.008], [0.036, 0.040]),
    ([0.96, 0.057, 0.066, 0.0], [0.031, 0.034]),
    ([0.965, 0.030, 0.034, 0.0], [0.030, 0.033]),
    ([1.04, 0.028, 0.032, 0.0], [0.028, 0.032]),
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
    [-0.014, 0.022, 0.019],
    [0.035, 0.036, 0.021],
    [0.080, 0.041, 0.019],
    [0.115, 0.037, 0.015],
    [0.146, 0.024, 0.011],
    [0.150, 0.0, 0.0],
];

/// A figure in full detail: 1.75 m tall, looks along x, its feet at the origin, or its seat if it sits.
pub(super) fn body(mesh: &mut Mesh, model: Model, look: Look) {
    let figure = Figure { model, look, pose: model.pose, dress: model.dress() };
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
    look: Look,
    pose: Pose,
    dress: Dress,
}

impl Figure {
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
        let jacket = self.jacket_hem();
        let hem: &[Profile] = match self.dress {
            Dress::Coat | Dress::Frock => &skirt,
            Dress::Jacket => &jacket,
            Dress::Shirt => &TUCKED_HEM,
        };
        let (waist, chest) = if self.model.has_long_hair { (SLIM_WAIST, SLIM_CHEST) } else { (WAIST, CHEST) };
        let profile: Vec<Profile> = hem.iter().chain(&waist).chain(&chest).copied().collect();
        self.band(mesh, &profile, COAT);
        match self.dress {
            Dress::Shirt => self.band(mesh, &PELVIS, TROUSERS),
            // Its top would be seen through a jacket.
            Dress::Jacket => {
                let seen = if self.pose.is_seated() { 4 } else { 3 };
                self.band(mesh, &PELVIS[..seen], TROUSERS);
            }
            Dress::Coat | Dress::Frock => {}
        }
        match self.dress {
            Dress::Shirt => self.band(mesh, &BELT_ON_HIPS, BELT),
            Dress::Coat | Dress::Frock => self.band(mesh, &BELT_ON_WAIST, BELT),
            Dress::Jacket => {}
        }
        match self.dress {
            Dress::Jacket => {
                self.collar(mesh);
                self.band(mesh, &outside([jacket[1], jacket[2]]), COLLAR);
                self.strip(
                    mesh,
                    &profile,
                    &[(0.36, 0.002), (0.44, 0.020), (0.53, 0.036), (0.575, 0.038)],
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
                if self.look.has_scarf {
                    self.band(mesh, &SCARF, BAG);
                } else {
                    self.collar(mesh);
                }
                self.band(mesh, &outside([skirt[1], skirt[2]]), COLLAR);
                let buttons = [(-0.25, 0.007), (-0.10, 0.007), (0.02, 0.007), (0.15, 0.007)];
                self.strip(mesh, &profile, &buttons, COLLAR);
                self.strip(
                    mesh,
                    &profile,
                    &[(0.20, 0.007), (0.35, 0.007), (0.46, 0.007), (0.56, 0.007)],
                    COLLAR,
                );
            }
            Dress::Shirt | Dress::Frock => {
                self.strip(mesh, &profile, &[(0.525, 0.006), (0.575, 0.030), (0.613, 0.034)], SKIN);
            }
        }
    }

    /// The lower edge of a jacket, which covers both thighs.
    fn jacket_hem(&self) -> [Profile; 3] {
        let up = if self.pose.is_seated() { -0.07 } else { -0.12 };
        /// Half of a thigh with the cloth over it.
        const HALF_M: f32 = 0.094;
        let [left, right] = [1.0, -1.0].map(|side| {
            let hip = self.pose.hips() + Vec3::Y * (HIP_M * side);
            let [knee, ..] = self.pose.leg(side);
            if self.pose.is_seated() { 0.0 } else { hip.lerp(knee, up / (knee.z - hip.z)).x }
        });
        let [front, back] = [left.max(right) + HALF_M, left.min(right) - HALF_M];
        let [deep, forward] = [((front - back) / 2.0).max(0.130), front.midpoint(back)];
        let wide = if front - back > 0.26 { 0.198 } else { 0.176 };
        [
            [up + 0.005, 0.8 * wide, 0.8 * deep, forward],
            [up, wide, deep, forward],
            [up + 0.045, wide - 0.002, deep - 0.002, 0.8 * forward],
        ]
    }

    fn collar(&self, mesh: &mut Mesh) {
        let ahead = self.ahead();
        let sections = COLLAR_ROUND.map(|[front, low, back, high, wide]| {
            let [front, back] = [self.spine(low) + ahead * front, self.spine(high) + ahead * back];
            Section { at: front.midpoint(back), front: (front - back) / 2.0, side: Vec3::Y * wide }
        });
        loft(mesh, &sections, TRUNK_SIDES, COLLAR);
    }

    /// The lower part of a coat or frock, which falls over both legs.
    fn skirt(&self) -> Vec<Profile> {
        // Clear of the leg in front.
        const CLEAR_M: f32 = 0.014;
        const STRIDE_M: f32 = 0.16;
        let [up, wide, deep, forward] = hem(self.pose);
        let wide = wide + if deep > STRIDE_M { 0.036 } else { 0.010 };
        let [deep, forward] = [deep + CLEAR_M, forward + 0.6 * CLEAR_M];
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
        // What is worn over it hides the upper part, which ends a little over the hem.
        let hidden = match self.dress {
            _ if self.pose.is_seated() => 0.0,
            Dress::Coat | Dress::Frock => {
                let share = hem(self.pose)[0] / (knee.z - hip.z);
                // A leg far in front would stand out of the coat higher up.
                if share > 0.85 { share - 0.03 } else { 0.70 }
            }
            Dress::Jacket => 0.22,
            Dress::Shirt => 0.12,
        };
        let thigh =
            THIGH.map(|([share, wide, deep, behind], bare)| ([share.max(hidden), wide, deep, behind], bare));
        let first = thigh.iter().rposition(|part| part.0[0] <= hidden).unwrap_or(0);
        let mut joints: Vec<(Vec3, [f32; 2])> = (thigh[first..].iter().map(|part| joint(hip, knee, part)))
            .chain(SHIN.iter().map(|part| joint(knee, ankle, part)))
            .collect();
        if !self.pose.is_seated() {
            let share = if matches!(self.dress, Dress::Coat | Dress::Frock) { 0.78 } else { 0.80 };
            joints[0].1 = joints[0].1.map(|half| share * half);
        }
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
        // From the neck along the slope of the shoulder, so that no ball stands out at the joint.
        let narrow_m = if self.model.has_long_hair { 0.012 } else { 0.0 };
        let root = [
            (self.spine(0.560) + Vec3::Y * (0.060 * side), [0.030, 0.044]),
            (self.spine(0.540) + Vec3::Y * (0.125 * side), [0.040, 0.052]),
            (self.spine(0.508) + Vec3::Y * ((0.176 - narrow_m) * side), [0.046, 0.053]),
            (upper(0.28) - Vec3::Y * (0.6 * narrow_m * side), [0.046, 0.052]),
        ];
        let is_short = matches!(self.dress, Dress::Shirt | Dress::Frock);
        let sleeve: &[(Vec3, [f32; 2])] = if is_short {
            &[(upper(0.62), [0.046, 0.050]), (upper(0.63), [0.034, 0.037])]
        } else {
            &[
                (upper(0.70), [0.043, 0.047]),
                (elbow, [0.040, 0.043]),
                (lower(0.40), [0.040, 0.042]),
                (lower(0.93), [0.034, 0.036]),
            ]
        };
        let sleeve: Vec<_> = root.iter().chain(sleeve).copied().collect();
        loft(mesh, &limb_sections(&sleeve, facing), LIMB_SIDES, SLEEVE);
        if is_short {
            let arm = [
                (upper(0.50), [0.036, 0.039]),
                (elbow, [0.033, 0.035]),
                (lower(0.35), [0.034, 0.035]),
                (lower(1.0), [0.023, 0.026]),
            ];
            loft(mesh, &limb_sections(&arm, facing), LIMB_SIDES, SKIN);
        } else {
            let cuff = [
                (lower(0.86), [0.0365, 0.0385]),
                (lower(0.955), [0.0365, 0.0385]),
                (lower(0.96), [0.020, 0.022]),
            ];
            loft(mesh, &limb_sections(&cuff, facing), LIMB_SIDES, COLLAR);
        }
        hand(mesh, wrist, (fingers - wrist).normalize_or(-Vec3::Z), side);
    }

    /// Neck, head, hair and face.
    fn head(&self, mesh: &mut Mesh) {
        let [nod, turn_rad] = self.pose.head();
        let tilt = Quat::from_rotation_z(turn_rad) * Quat::from_rotation_y(nod);
        let neck = self.spine(0.60);
        let head = Head { neck, nod_m: 0.03 * nod, tilt };
        let wide = if self.model.has_long_hair { 0.046 } else { 0.051 };
        let throat = [
            (self.spine(0.555), [0.068, 0.060]),
            (neck, [wide, wide + 0.003]),
            (head.at(0.0, 0.0, 0.11), [wide - 0.002, wide + 0.002]),
        ];
        loft(mesh, &limb_sections(&throat, Vec3::X), LIMB_SIDES, SKIN);
        head.draw(mesh, self.look.cut);
    }
}

/// The seam or knitted band at the lower edge of a coat or jacket, outside of it.
fn outside(edge: [Profile; 2]) -> [Profile; 2] {
    const LIFT_M: f32 = 0.003;
    edge.map(|[up, wide, deep, forward]| [up, wide + LIFT_M, deep + LIFT_M, forward])
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
    use super::super::figure::{HAIR, HAT, POSES};
    use super::super::look::{CUTS, Cut};
    use super::*;

    fn bodies() -> Vec<(Model, Look, Mesh)> {
        let cuts = |pose| CUTS.into_iter().map(move |(has_long_hair, cut)| (pose, has_long_hair, cut));
        let looks = POSES.into_iter().flat_map(cuts).flat_map(|(pose, has_long_hair, cut)| {
            [false, true]
                .map(|is_light| (Model { pose, has_long_hair, is_light }, Look { cut, has_scarf: is_light }))
        });
        looks
            .map(|(model, look)| {
                let mut mesh = Mesh::default();
                body(&mut mesh, model, look);
                (model, look, mesh)
            })
            .collect()
    }

    #[test]
    fn faces_of_bodies_are_turned_outwards() {
        for (model, look, mesh) in bodies() {
            for t in mesh.indices.chunks_exact(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
                let face = (b.position - a.position).cross(c.position - a.position);
                let out = a.normal + b.normal + c.normal;
                // Slivers have no direction.
                assert!(
                    face.length() < 2e-5 || face.normalize().dot(out) > 0.0,
                    "{model:?} {look:?}: {a:?} {b:?} {c:?}"
                );
            }
        }
    }

    #[test]
    fn everybody_has_skin_hair_shoes_and_legs_under_what_they_wear() {
        for (model, look, mesh) in bodies() {
            let extent = |finish: Finish| {
                let of = mesh.vertices.iter().filter(|v| v.finish == finish).map(|v| v.position.z);
                of.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)])
            };
            let legs = if model.dress() == Dress::Frock { LEGS } else { TROUSERS };
            let crown = match look.cut {
                Cut::Bald => SKIN,
                Cut::Cap | Cut::Beanie | Cut::LooseBeanie => HAT,
                Cut::Hood => SLEEVE,
                _ => HAIR,
            };
            let [shoes, legs, coat, skin, crown] = [SHOES, legs, COAT, SKIN, crown].map(extent);
            assert!(shoes[0] < legs[0] && legs[0] < coat[0], "{model:?}: {shoes:?} {legs:?} {coat:?}");
            assert!(
                coat[1] < skin[1] && skin[1] <= crown[1],
                "{model:?} {look:?}: {coat:?} {skin:?} {crown:?}"
            );
        }
    }

    /// A coat or frock covers the thighs of who walks.
    #[test]
    fn no_leg_is_seen_through_a_coat() {
        for (model, _, mesh) in
            bodies().into_iter().filter(|(model, ..)| matches!(model.dress(), Dress::Coat | Dress::Frock))
        {
            let [up, ..] = hem(model.pose);
            let finish = if model.dress() == Dress::Frock { LEGS } else { TROUSERS };
            let highest = mesh.vertices.iter().filter(|v| v.finish == finish).map(|v| v.position.z);
            let over_m = highest.fold(0.0, f32::max) - (model.pose.hips().z + up);
            assert!(over_m < 0.10, "{model:?}: legs end {over_m} m over the hem");
        }
    }
}
