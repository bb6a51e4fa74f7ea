//! A figure in one of several postures, and the clothes that it wears: a body near by, low-poly limbs farther away.

use super::super::bicycles;
use super::super::foliage::limb;
use super::super::mesh::{Class, Finish, Mesh, Surface};
use super::super::{CloseUp, SceneObject};
use super::body;
use super::look::Look;
use glam::{Quat, Vec3};

/// Sides and errors of the levels with limbs, and the error of the one without arms.
const COARSER: [(u32, f32); 2] = [(4, 0.03), (3, 0.06)];
/// Least error of the usual level beside the one for cameras close by.
const USUAL_ERROR_M: f32 = 0.015;
const PLAIN_ERROR_M: f32 = 0.33;
/// From the middle of the hips to a leg.
pub(super) const HIP_M: f32 = 0.095;
/// Height of the hips of who stands, and over the seat of who sits.
const HIPS_M: f32 = 0.86;
const SEATED_M: f32 = 0.06;
/// Trunks are less deep than broad.
const DEPTH: f32 = 0.78;
/// A figure whose trunk has so many sides has a face.
const FACE_SIDES: u32 = 7;
/// From the middle of a bicycle to who wheels it, to its left.
pub(super) const WHEELS_M: Vec3 = Vec3::new(0.08, 0.36, 0.0);

/// What a figure does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pose {
    Stand,
    /// A hand on the hip.
    Akimbo,
    /// Both hands in the pockets.
    Pockets,
    /// Looks at a telephone.
    Phone,
    /// Explains something with a hand.
    Talk,
    /// In mid-stride, the left leg in front.
    Stride,
    /// One leg swings past the other.
    Pass,
    /// In mid-stride with a bag.
    Carry,
    /// Leads a child by the right hand.
    Lead,
    /// Holds up its left hand.
    Child,
    /// Wheels a bicycle, to its right.
    Wheel,
    Sit,
    SitWithPhone,
}

pub(super) const POSES: [Pose; 13] = [
    Pose::Stand,
    Pose::Akimbo,
    Pose::Pockets,
    Pose::Phone,
    Pose::Talk,
    Pose::Stride,
    Pose::Pass,
    Pose::Carry,
    Pose::Lead,
    Pose::Child,
    Pose::Wheel,
    Pose::Sit,
    Pose::SitWithPhone,
];

/// Joints of one side: of a leg knee, ankle and tip of the foot; of an arm elbow, wrist and fingers.
type Joints = [[f32; 3]; 3];

/// Hanging, as seen on the left side; of who sits, less by the height of the hips.
const HANGING: Joints = [[-0.03, 0.222, 1.12], [0.05, 0.218, 0.88], [0.08, 0.208, 0.785]];
const SWUNG_FORWARD: Joints = [[0.07, 0.226, 1.12], [0.24, 0.205, 0.95], [0.32, 0.190, 0.89]];
const SWUNG_BACK: Joints = [[-0.16, 0.228, 1.15], [-0.22, 0.225, 0.90], [-0.22, 0.215, 0.80]];
const ON_HIP: Joints = [[-0.08, 0.40, 1.14], [0.05, 0.20, 1.00], [0.09, 0.14, 0.97]];
const IN_POCKET: Joints = [[-0.09, 0.265, 1.13], [0.04, 0.21, 0.90], [0.06, 0.17, 0.86]];
const WITH_PHONE: Joints = [[0.03, 0.23, 1.12], [0.24, 0.11, 1.21], [0.29, 0.07, 1.27]];
/// Out from the body, and low: higher up it would seem to hold something.
const EXPLAINING: Joints = [[0.00, 0.28, 1.12], [0.19, 0.37, 1.02], [0.27, 0.41, 1.01]];
const CARRYING: Joints = [[0.00, 0.228, 1.11], [0.02, 0.24, 0.85], [0.02, 0.24, 0.76]];
const LEADING: Joints = [[0.00, 0.27, 1.12], [0.02, 0.33, 0.87], [0.02, 0.36, 0.78]];
const LED: Joints = [[0.02, 0.31, 1.17], [0.03, 0.42, 1.18], [0.03, 0.46, 1.20]];
/// Hands on the thighs, above the hips of who sits.
const IN_LAP: Joints = [[0.08, 0.27, 1.13], [0.32, 0.20, 0.96], [0.40, 0.17, 0.93]];

const UPRIGHT: Joints = [[0.03, 0.095, 0.46], [-0.01, 0.10, 0.09], [0.17, 0.13, 0.03]];
/// A leg on which no weight rests.
const RELAXED: Joints = [[0.10, 0.13, 0.46], [0.06, 0.17, 0.09], [0.23, 0.25, 0.03]];
const IN_FRONT: Joints = [[0.22, 0.095, 0.50], [0.33, 0.095, 0.12], [0.50, 0.095, 0.09]];
const BEHIND: Joints = [[-0.06, 0.095, 0.45], [-0.36, 0.095, 0.20], [-0.26, 0.095, 0.03]];
const UNDER: Joints = [[0.05, 0.09, 0.45], [-0.03, 0.09, 0.09], [0.15, 0.10, 0.03]];
const PASSING: Joints = [[0.20, 0.10, 0.48], [-0.06, 0.10, 0.22], [0.08, 0.11, 0.12]];
const SEATED: Joints = [[0.42, 0.095, 0.90], [0.40, 0.095, 0.49], [0.58, 0.095, 0.44]];

impl Pose {
    /// Middle of the hips.
    pub(super) fn hips(self) -> Vec3 {
        Vec3::Z * if self.is_seated() { SEATED_M } else { HIPS_M }
    }

    pub(super) fn is_seated(self) -> bool {
        matches!(self, Self::Sit | Self::SitWithPhone)
    }

    /// Sine of the angle by which the trunk leans forward.
    pub(super) fn lean(self) -> f32 {
        match self {
            Self::Stride | Self::Pass | Self::Carry => 0.06,
            Self::Wheel => 0.10,
            _ => 0.0,
        }
    }

    /// How far the head is bent forward, as a share of its height, and its turn to the left, radians.
    pub(super) fn head(self) -> [f32; 2] {
        match self {
            Self::Phone | Self::SitWithPhone => [0.40, 0.0],
            Self::Lead => [0.10, -0.5],
            Self::Stand => [0.0, 0.35],
            Self::Pockets => [0.05, -0.3],
            Self::Sit => [0.05, 0.5],
            _ => [0.0, 0.0],
        }
    }

    /// The left and the right leg.
    fn legs(self) -> [Joints; 2] {
        match self {
            Self::Stand | Self::Akimbo | Self::Talk => [UPRIGHT, RELAXED],
            Self::Phone => [RELAXED, UPRIGHT],
            Self::Pockets | Self::Child => [UPRIGHT, UPRIGHT],
            Self::Stride | Self::Carry | Self::Wheel => [IN_FRONT, BEHIND],
            Self::Pass | Self::Lead => [UNDER, PASSING],
            Self::Sit | Self::SitWithPhone => [SEATED, SEATED],
        }
    }

    /// The left and the right arm; opposite to the legs of who walks.
    fn arms(self) -> [Joints; 2] {
        match self {
            Self::Stand => [HANGING, IN_POCKET],
            Self::Akimbo => [ON_HIP, HANGING],
            Self::Pockets => [IN_POCKET, IN_POCKET],
            Self::Phone => [HANGING, WITH_PHONE],
            Self::Talk => [EXPLAINING, HANGING],
            Self::Stride => [SWUNG_BACK, SWUNG_FORWARD],
            Self::Pass => [HANGING, HANGING],
            Self::Carry => [SWUNG_BACK, CARRYING],
            Self::Lead => [HANGING, LEADING],
            Self::Child => [LED, HANGING],
            Self::Wheel => {
                let grip = bicycles::GRIP_M - WHEELS_M;
                // The hand over the grip, for which the right side is the left one mirrored.
                let at = |x: f32, y: f32, z: f32| [grip.x + x, -grip.y + y, grip.z + z];
                [SWUNG_BACK, [[0.15, 0.27, 1.13], at(-0.05, 0.0, 0.04), at(0.02, 0.0, 0.01)]]
            }
            Self::Sit => [IN_LAP, IN_LAP],
            Self::SitWithPhone => [IN_LAP, WITH_PHONE],
        }
    }

    /// The joints of a leg: of the left one for a side of 1, of the right one for -1.
    pub(super) fn leg(self, side: f32) -> [Vec3; 3] {
        on_side(self.legs()[usize::from(side < 0.0)], side, self.drop())
    }

    /// The joints of an arm.
    pub(super) fn arm(self, side: f32) -> [Vec3; 3] {
        on_side(self.arms()[usize::from(side < 0.0)], side, self.drop())
    }

    /// What limbs of who sits are lower by.
    fn drop(self) -> Vec3 {
        Vec3::Z * (HIPS_M - self.hips().z)
    }
}

/// The joints of a side, 1 for the left or -1 for the right one.
fn on_side(joints: Joints, side: f32, drop: Vec3) -> [Vec3; 3] {
    joints.map(|[x, y, z]| Vec3::new(x, y * side, z) - drop)
}

/// Parts of a figure, each with a colour of its own until it is dressed.
pub(super) const COAT: Finish = part(0);
pub(super) const SLEEVE: Finish = part(1);
pub(super) const TROUSERS: Finish = part(2);
pub(super) const SHOES: Finish = part(3);
pub(super) const SKIN: Finish = part(4);
pub(super) const NOSE: Finish = part(5);
pub(super) const MOUTH: Finish = part(6);
pub(super) const HAIR: Finish = part(7);
pub(super) const EYE: Finish = part(8);
pub(super) const BAG: Finish = part(9);
pub(super) const PHONE: Finish = part(10);
pub(super) const COLLAR: Finish = part(11);
pub(super) const SHIRT: Finish = part(12);
pub(super) const BELT: Finish = part(13);
pub(super) const LEGS: Finish = part(14);
/// What is worn on the head near by, and what covers it from farther away.
pub(super) const HAT: Finish = part(15);
pub(super) const CROWN: Finish = part(16);

const fn part(number: u8) -> Finish {
    Finish::new(Surface::Plain, [number, 0, 255], Class::Person)
}

/// What a figure wears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dress {
    /// A jacket over a shirt.
    Jacket,
    /// A shirt with short sleeves, tucked in.
    Shirt,
    /// A coat to the knees, with a scarf.
    Coat,
    /// A frock to the knees, with short sleeves.
    Frock,
}

/// A model of figures: a pose, with long hair or without, dressed for a warm day or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Model {
    pub(super) pose: Pose,
    pub(super) has_long_hair: bool,
    pub(super) is_light: bool,
}

impl Model {
    /// What it wears; nobody sits in what is long.
    pub(super) fn dress(self) -> Dress {
        match (self.has_long_hair && !self.pose.is_seated(), self.is_light) {
            (true, true) => Dress::Frock,
            (true, false) => Dress::Coat,
            (false, true) => Dress::Shirt,
            (false, false) => Dress::Jacket,
        }
    }
}

/// The hem of a coat, which falls over both thighs: its height over the hips, half width and depth, and how far in front of
/// the hips its middle is.
pub(super) fn hem(pose: Pose) -> [f32; 4] {
    const UP_M: f32 = -0.32;
    /// Of a leg, with the cloth.
    const THICK_M: f32 = 0.105;
    let at = |side: f32| {
        let thigh = pose.hips() + Vec3::Y * (HIP_M * side);
        let [knee, ..] = pose.leg(side);
        thigh.lerp(knee, UP_M / (knee.z - thigh.z))
    };
    let [left, right] = [at(1.0), at(-1.0)];
    let [front, back] = [left.x.max(right.x) + THICK_M, left.x.min(right.x) - THICK_M];
    let wide = left.y.max(-right.y) + 0.8 * THICK_M;
    [UP_M, wide, ((front - back) / 2.0).max(0.125), front.midpoint(back)]
}

/// What a figure has in its right hand.
pub(super) fn belongings(mesh: &mut Mesh, pose: Pose, is_near: bool) {
    const BAG_M: Vec3 = Vec3::new(0.34, 0.12, 0.27);
    let [_, _, fingers] = pose.arm(-1.0);
    match pose {
        Pose::Carry => {
            let top = fingers - Vec3::Z * 0.09;
            mesh.block(top - Vec3::Z * BAG_M.z, BAG_M, 0.0, BAG);
            for y in [-0.045, 0.045].into_iter().filter(|_| is_near) {
                let end = |x: f32| (top + Vec3::new(x, y, -0.01), 0.006);
                limb(mesh, &[end(-0.10), (fingers + Vec3::new(0.0, 0.2 * y, 0.01), 0.006)], 3, BAG);
                limb(mesh, &[end(0.10), (fingers + Vec3::new(0.0, 0.2 * y, 0.01), 0.006)], 3, BAG);
            }
        }
        Pose::Phone | Pose::SitWithPhone => {
            mesh.block(fingers, Vec3::new(0.02, 0.075, 0.13), 0.0, PHONE);
        }
        _ => {}
    }
}

/// A figure of 1.75 m that looks along x, its feet at the origin, or its seat if it sits; `sides` are those of its
/// trunk.
fn figure(mesh: &mut Mesh, model: Model, has_loose_hair: bool, sides: u32) {
    let pose = model.pose;
    let few = sides.saturating_sub(1).max(3);
    let hips = pose.hips();
    let lean = pose.lean();
    let spine = |up: f32| hips + Vec3::new(lean, 0.0, (1.0 - lean * lean).sqrt()) * up;
    let dress = model.dress();
    let legs = if dress == Dress::Frock { LEGS } else { TROUSERS };
    let is_short = matches!(dress, Dress::Shirt | Dress::Frock);
    for side in [1.0, -1.0] {
        let [knee, ankle, tip] = pose.leg(side);
        let hip = hips + Vec3::Y * (HIP_M * side);
        // A coat or frock hides the upper part.
        let thigh = if matches!(dress, Dress::Coat | Dress::Frock) { hip.lerp(knee, 0.7) } else { hip };
        limb(
            mesh,
            &[(thigh, if thigh == hip { 0.105 } else { 0.078 }), (knee, 0.07), (ankle, 0.05)],
            few,
            legs,
        );
        let foot = [(ankle - Vec3::X * 0.05, 0.055), (tip, 0.035), (tip + Vec3::X * 0.02, 0.0)];
        limb(mesh, &foot, 3, SHOES);
        let shoulder = spine(0.525) + Vec3::Y * (0.185 * side);
        let [elbow, hand, fingers] = pose.arm(side);
        // From within the trunk, so that no light is seen between.
        let inside = spine(0.56) + Vec3::Y * (0.07 * side);
        let upper = [(inside, 0.062), (shoulder, 0.07), (elbow, 0.052), (hand, 0.042)];
        let lower = [(elbow, 0.052), (hand, 0.042), (fingers, 0.012)];
        let (sleeve, bare) = if is_short { (&upper[..3], &lower[..]) } else { (&upper[..], &lower[1..]) };
        limb(mesh, sleeve, 3, SLEEVE);
        limb(mesh, bare, 3, SKIN);
    }
    belongings(mesh, pose, false);
    let first = mesh.vertices.len();
    let shoulders = [(spine(0.40), 0.19), (spine(0.56), 0.155), (spine(0.62), 0.055)];
    let waist = [(spine(-0.10), 0.135), (spine(0.05), 0.17)];
    let [hem_up, wide, deep, forward] = hem(pose);
    let skirt = [(spine(hem_up), wide), (spine(0.02), 0.18)];
    let is_long = matches!(dress, Dress::Coat | Dress::Frock);
    let trunk: Vec<_> = if is_long { skirt } else { waist }.into_iter().chain(shoulders).collect();
    limb(mesh, &trunk, sides, COAT);
    for vertex in &mut mesh.vertices[first..] {
        let middle = hips.x + lean * (vertex.position.z - hips.z);
        // A long coat covers the stride.
        let (depth, forward) =
            if is_long && vertex.position.z < hips.z { (deep / wide, forward) } else { (DEPTH, 0.0) };
        vertex.position.x = middle + forward + depth * (vertex.position.x - middle);
    }
    head(mesh, spine(0.60), (pose, has_loose_hair), sides);
}

/// Neck, head, hair, and a face on fine ones.
fn head(mesh: &mut Mesh, neck: Vec3, (pose, has_loose_hair): (Pose, bool), sides: u32) {
    let [nod, turn_rad] = pose.head();
    let turn = Quat::from_rotation_z(turn_rad);
    let above = |x: f32, up: f32| neck + turn * Vec3::new(x + nod * up, 0.0, up * (1.0 - 0.3 * nod));
    let skull = [
        (neck, 0.05),
        (above(0.01, 0.055), 0.048),
        (above(0.02, 0.10), 0.078),
        (above(0.02, 0.18), 0.095),
        (above(0.0, 0.26), 0.06),
    ];
    limb(mesh, &skull, sides, SKIN);
    let mut crown = vec![
        (above(-0.03, 0.12), 0.095),
        (above(-0.01, 0.20), 0.104),
        (above(0.0, 0.27), 0.07),
        (above(0.0, 0.29), 0.0),
    ];
    if has_loose_hair {
        crown[0] = (above(-0.055, 0.02), 0.088);
    }
    limb(mesh, &crown, sides, CROWN);
    if sides < FACE_SIDES {
        return;
    }
    let middle = above(0.02, 0.15);
    let tilt = turn * Quat::from_rotation_y(nod);
    let at = |x: f32, y: f32, z: f32| middle + tilt * Vec3::new(x, y, z);
    for side in [1.0, -1.0] {
        let y = 0.033 * side;
        limb(mesh, &[(at(0.080, y, 0.020), 0.0125), (at(0.0905, y, 0.020), 0.0)], 5, EYE);
        let brow = [(at(0.075, 0.016 * side, 0.045), 0.008), (at(0.064, 0.044 * side, 0.043), 0.004)];
        limb(mesh, &brow, 3, HAIR);
    }
    limb(mesh, &[(at(0.066, 0.0, 0.022), 0.006), (at(0.096, 0.0, -0.012), 0.014)], 3, NOSE);
    limb(mesh, &[(at(0.080, 0.022, -0.041), 0.006), (at(0.080, -0.022, -0.041), 0.006)], 3, MOUTH);
}

/// A figure far away: legs, trunk and head.
fn plain_figure(mesh: &mut Mesh, pose: Pose) {
    let hips = pose.hips();
    let spine = |up: f32| hips + Vec3::new(pose.lean() * up, 0.0, up);
    let legs = match pose {
        Pose::Sit | Pose::SitWithPhone => {
            [(Vec3::new(0.42, 0.0, -0.42), 0.13), (Vec3::new(0.3, 0.0, 0.08), 0.17)]
        }
        Pose::Stride | Pose::Carry | Pose::Wheel => [(Vec3::ZERO, 0.24), (hips, 0.15)],
        _ => [(Vec3::ZERO, 0.12), (hips, 0.17)],
    };
    limb(mesh, &legs, 3, TROUSERS);
    limb(mesh, &[(spine(if pose.is_seated() { -0.06 } else { 0.0 }), 0.18), (spine(0.60), 0.20)], 3, COAT);
    limb(mesh, &[(spine(0.60), 0.07), (spine(0.89), 0.12)], 3, SKIN);
}

/// A model at the levels of detail for cameras that are not close by, its parts in the colours of parts.
pub(super) fn object(model: Model, has_loose_hair: bool) -> SceneObject {
    let drawn = |sides: u32| {
        let mut mesh = Mesh::default();
        figure(&mut mesh, model, has_loose_hair, sides);
        mesh
    };
    let mut object = SceneObject::of_one_level(drawn(FACE_SIDES));
    for (sides, error_m) in COARSER {
        object.add_level(drawn(sides), error_m);
    }
    let mut plain = Mesh::default();
    plain_figure(&mut plain, model.pose);
    object.add_level(plain, PLAIN_ERROR_M);
    object
}

/// The level of a model for cameras close by.
pub(super) fn close_up(model: Model, look: Look) -> CloseUp {
    let mut mesh = Mesh::default();
    body::body(&mut mesh, model, look);
    CloseUp { mesh, usual_error_m: USUAL_ERROR_M, is_measured: true }
}

#[cfg(test)]
mod tests {
    use super::super::look::CUTS;
    use super::*;

    #[test]
    fn limbs_are_as_long_in_all_poses_and_arms_swing_against_legs() {
        let far = |a: Vec3, b: Vec3| a.distance(b);
        for pose in POSES {
            let spine = pose.hips() + Vec3::new(pose.lean(), 0.0, 1.0) * 0.525;
            for (side, (leg, arm)) in [1.0, -1.0].into_iter().zip(pose.legs().into_iter().zip(pose.arms())) {
                let [knee, ankle, _] = on_side(leg, side, pose.drop());
                let [elbow, wrist, _] = on_side(arm, side, pose.drop());
                let hip = pose.hips() + Vec3::Y * (HIP_M * side);
                let shoulder = spine + Vec3::Y * (0.185 * side);
                assert!((0.29..0.48).contains(&far(hip, knee)), "{pose:?}: thigh {}", far(hip, knee));
                assert!((0.25..0.43).contains(&far(knee, ankle)), "{pose:?}: shin {}", far(knee, ankle));
                assert!((0.21..0.35).contains(&far(shoulder, elbow)), "{pose:?}: {}", far(shoulder, elbow));
                assert!((0.10..0.32).contains(&far(elbow, wrist)), "{pose:?}: {}", far(elbow, wrist));
            }
        }
        let [left_leg, right_leg] = Pose::Stride.legs();
        let [left_arm, right_arm] = Pose::Stride.arms();
        assert!(left_leg[1][0] > right_leg[1][0] && left_arm[1][0] < right_arm[1][0]);
    }

    #[test]
    fn who_wheels_a_bicycle_holds_its_bar() {
        let [_, _, fingers] = on_side(Pose::Wheel.arms()[1], -1.0, Vec3::ZERO);
        assert!(fingers.distance(bicycles::GRIP_M - WHEELS_M) < 0.05, "{fingers}");
    }

    #[test]
    fn figures_are_as_tall_as_people_and_coarser_from_afar() {
        for pose in POSES {
            for (has_long_hair, cut) in CUTS {
                let model = Model { pose, has_long_hair, is_light: false };
                let look = Look { cut, has_scarf: true };
                let mut object = object(model, cut.is_loose()).with_close_up(close_up(model, look));
                object.show_close_up();
                let [low, high] = object.levels[0].mesh.bounds();
                let tall_m = if pose.is_seated() { 1.4 } else { 1.75 };
                assert!((high.z - low.z - tall_m).abs() < 0.12, "{pose:?}: {} m", high.z - low.z);
                let counts: Vec<usize> =
                    object.levels.iter().map(|level| level.mesh.triangle_count()).collect();
                assert!(counts.windows(2).all(|pair| pair[1] < pair[0]) && counts[0] < 2100, "{counts:?}");
                assert!(counts.len() >= 3 && counts[1] < 340, "{counts:?}");
            }
        }
    }
}
