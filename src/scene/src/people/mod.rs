//! People on pavements and benches: a few figures of low-poly limbs. They are scenery: nothing collides with
//! them, and they stay in their pose.

use super::bicycles;
use super::foliage::limb;
use super::ground_sheet::KERB_M;
use super::kerbside::{KerbRow, Posts, along_kerb, has_room};
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::doubled_area;
use super::roads::RoadField;
use super::{LodMesh, SceneObject, hash_to_unit};
use city3d_roadmap::{CityMap, SceneryKind};
use glam::{Affine3A, DVec2, Quat, Vec3};

/// Where people are along a kerb.
const ROW: KerbRow = KerbRow { spacing_m: 5.5, off_kerb_m: [0.75, 1.65], salt: 11 };
/// Clearance from what stands on the pavement.
const CLEAR_M: f64 = 0.55;
/// Share of those along kerbs who wait astride a bicycle.
const CYCLISTS: f32 = 0.06;
/// Smaller areas within kerbs are islands of roundabouts, square metres.
const LEAST_AREA_M2: f64 = 500.0;
/// Seat of a bench, and where on it people sit, along it.
const SEAT_M: f32 = 0.58;
const SEATS_M: [f32; 2] = [-0.42, 0.40];
/// From the middle of the hips to a leg.
const HIP_M: f32 = 0.095;
/// Errors of the coarser levels, of the one without arms, and from which on nobody is drawn: that is how tall people are.
const COARSER: [(u32, f32); 2] = [(4, 0.03), (3, 0.06)];
const PLAIN_ERROR_M: f32 = 0.33;
const UNDRAWN_M: f32 = 1.75;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pose {
    Stand,
    Walk,
    Sit,
    /// Astride a bicycle, on its saddle: hands on the bar, the left foot on its pedal, the right one on the ground.
    Straddle,
}

impl Pose {
    /// Middle of the hips.
    fn hips(self) -> Vec3 {
        match self {
            Self::Stand | Self::Walk => Vec3::new(0.0, 0.0, 0.86),
            Self::Sit => Vec3::new(0.0, 0.0, 0.06),
            Self::Straddle => Vec3::new(bicycles::SADDLE_M.x, 0.0, bicycles::SADDLE_M.z + 0.05),
        }
    }

    /// Sine of the angle by which the trunk leans forward.
    fn lean(self) -> f32 {
        match self {
            Self::Stand | Self::Sit => 0.0,
            Self::Walk => 0.07,
            Self::Straddle => 0.38,
        }
    }

    /// Knee, ankle and tip of the foot of the left side, 1, or the right one, -1.
    fn leg(self, side: f32) -> [Vec3; 3] {
        let y = HIP_M * side;
        let at = Vec3::new;
        match self {
            Self::Stand => [at(0.03, y, 0.46), at(-0.01, y, 0.09), at(0.17, y + 0.03 * side, 0.03)],
            Self::Walk if side > 0.0 => [at(0.22, y, 0.50), at(0.33, y, 0.12), at(0.50, y, 0.09)],
            Self::Walk => [at(-0.06, y, 0.45), at(-0.36, y, 0.20), at(-0.26, y, 0.03)],
            Self::Sit => [at(0.42, y, 0.04), at(0.40, y, -0.37), at(0.58, y, -0.42)],
            Self::Straddle if side > 0.0 => {
                [at(0.215, 0.12, 0.80), at(-0.01, 0.13, 0.48), at(0.17, 0.14, 0.42)]
            }
            Self::Straddle => [at(-0.05, 2.0 * y, 0.51), at(-0.05, 3.1 * y, 0.10), at(0.13, 3.4 * y, 0.03)],
        }
    }

    /// Elbow, wrist and fingers of a side.
    fn arm(self, side: f32) -> [Vec3; 3] {
        let swing = match self {
            Self::Stand => 0.05,
            Self::Walk => -0.24 * side,
            Self::Sit => 0.26,
            Self::Straddle => {
                let grip = bicycles::GRIP_M * Vec3::new(1.0, side, 1.0);
                return [Vec3::new(0.12, 0.30 * side, 1.15), grip + Vec3::new(-0.04, 0.0, 0.02), grip];
            }
        };
        let elbow = self.hips() + Vec3::new(0.4 * swing - 0.02, 0.27 * side, 0.27);
        let drop = if swing > 0.2 { 0.10 } else { 0.03 };
        let wrist = self.hips() + Vec3::new(swing + 0.06, 0.24 * side, drop);
        [elbow, wrist, wrist + Vec3::new(0.02, 0.0, -0.09)]
    }
}

/// Colours of a figure.
struct Outfit {
    coat: [u8; 3],
    trousers: [u8; 3],
    hair: [u8; 3],
    skin: [u8; 3],
}

/// The figures: each one is a model of its own.
const FIGURES: [(Pose, Outfit); 11] = [
    (Pose::Stand, outfit([62, 84, 120], [44, 46, 54], [54, 40, 30], [214, 172, 142])),
    (Pose::Stand, outfit([168, 62, 54], [70, 72, 80], [30, 26, 24], [150, 108, 82])),
    (Pose::Stand, outfit([196, 184, 156], [92, 74, 58], [150, 146, 140], [226, 186, 158])),
    (Pose::Walk, outfit([52, 96, 78], [52, 54, 60], [96, 66, 40], [222, 180, 150])),
    (Pose::Walk, outfit([206, 170, 72], [58, 70, 98], [44, 34, 28], [188, 140, 108])),
    (Pose::Walk, outfit([88, 90, 96], [36, 38, 44], [60, 44, 34], [120, 84, 62])),
    (Pose::Walk, outfit([214, 214, 210], [84, 100, 130], [170, 128, 78], [228, 190, 164])),
    (Pose::Sit, outfit([120, 78, 112], [66, 66, 74], [70, 50, 36], [218, 176, 146])),
    (Pose::Sit, outfit([74, 104, 132], [110, 98, 80], [138, 134, 130], [206, 164, 134])),
    // What would be hair is a helmet.
    (Pose::Straddle, outfit([214, 200, 60], [44, 46, 54], [206, 60, 48], [220, 178, 148])),
    (Pose::Straddle, outfit([70, 112, 158], [88, 82, 72], [222, 224, 226], [160, 116, 90])),
];

const fn outfit(coat: [u8; 3], trousers: [u8; 3], hair: [u8; 3], skin: [u8; 3]) -> Outfit {
    Outfit { coat, trousers, hair, skin }
}

const fn cloth(colour: [u8; 3]) -> Finish {
    Finish::new(Surface::Plain, colour, Class::Person)
}

/// A figure whose trunk has so many sides has a face.
const FACE_SIDES: u32 = 7;
/// Colours of coats: figures of one pose differ by them.
const COATS: [[u8; 3]; 10] = [
    [62, 84, 120],
    [168, 62, 54],
    [196, 184, 156],
    [52, 96, 78],
    [206, 170, 72],
    [88, 90, 96],
    [214, 214, 210],
    [120, 78, 112],
    [58, 60, 70],
    [150, 104, 74],
];

/// A figure of 1.75 m that looks along x, its feet at the origin, or its seat if it sits; `sides` are those of its
/// trunk.
fn figure(mesh: &mut Mesh, pose: Pose, outfit: &Outfit, sides: u32) {
    let (coat, trousers) = (cloth(outfit.coat), cloth(outfit.trousers));
    let (skin, hair) = (cloth(outfit.skin), cloth(outfit.hair));
    let shoes = trousers.shaded(0.45);
    let few = sides.saturating_sub(1).max(3);
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let hips = pose.hips();
    // Up along the trunk, and a place beside it.
    let lean = pose.lean();
    let spine = |up: f32| hips + at(lean, 0.0, (1.0 - lean * lean).sqrt()) * up;
    for side in [1.0, -1.0] {
        let [knee, ankle, tip] = pose.leg(side);
        limb(mesh, &[(hips + at(0.0, HIP_M * side, 0.0), 0.105), (knee, 0.07), (ankle, 0.05)], few, trousers);
        limb(
            mesh,
            &[(ankle - at(0.05, 0.0, 0.0), 0.055), (tip, 0.035), (tip + at(0.02, 0.0, 0.0), 0.0)],
            3,
            shoes,
        );
        let shoulder = spine(0.525) + at(0.0, 0.185 * side, 0.0);
        let [elbow, hand, fingers] = pose.arm(side);
        // From within the trunk, so that no light is seen between.
        let inside = spine(0.56) + at(0.0, 0.07 * side, 0.0);
        let arm = [(inside, 0.062), (shoulder, 0.07), (elbow, 0.052), (hand, 0.042)];
        limb(mesh, &arm, 3, coat.shaded(0.92));
        limb(mesh, &[(hand, 0.042), (fingers, 0.012)], 3, skin);
    }
    let trunk = [
        (spine(-0.10), 0.13),
        (spine(0.05), 0.165),
        (spine(0.40), 0.185),
        (spine(0.56), 0.15),
        (spine(0.62), 0.055),
    ];
    limb(mesh, &trunk, sides, coat);
    let neck = spine(0.60);
    let above = |x: f32, up: f32| neck + at(x, 0.0, up);
    let head = [
        (neck, 0.05),
        (above(0.01, 0.055), 0.048),
        (above(0.02, 0.10), 0.078),
        (above(0.02, 0.18), 0.095),
        (above(0.0, 0.26), 0.06),
    ];
    limb(mesh, &head, sides, skin);
    let crown = [
        (above(-0.03, 0.12), 0.095),
        (above(-0.01, 0.20), 0.104),
        (above(0.0, 0.27), 0.07),
        (above(0.0, 0.29), 0.0),
    ];
    limb(mesh, &crown, sides, hair);
    if sides >= FACE_SIDES {
        face(mesh, above(0.02, 0.15), (skin, hair));
    }
}

/// Eyes, nose and mouth on the front of a head of some 9 cm around a point.
fn face(mesh: &mut Mesh, middle: Vec3, (skin, hair): (Finish, Finish)) {
    let at = |x: f32, y: f32, z: f32| middle + Vec3::new(x, y, z);
    let dark = cloth([38, 30, 28]);
    for side in [1.0, -1.0] {
        let y = 0.033 * side;
        let eye = [(at(0.080, y, 0.020), 0.0125), (at(0.0905, y, 0.020), 0.0)];
        limb(mesh, &eye, 5, dark);
        let brow = [(at(0.075, 0.016 * side, 0.045), 0.008), (at(0.066, 0.052 * side, 0.043), 0.005)];
        limb(mesh, &brow, 3, hair);
    }
    let nose = [(at(0.066, 0.0, 0.022), 0.006), (at(0.096, 0.0, -0.012), 0.014)];
    limb(mesh, &nose, 3, skin.shaded(0.94));
    let mouth = [(at(0.080, 0.022, -0.041), 0.006), (at(0.080, -0.022, -0.041), 0.006)];
    limb(mesh, &mouth, 3, skin.shaded(0.62));
}

/// A figure far away: legs, trunk and head.
fn plain_figure(mesh: &mut Mesh, pose: Pose, outfit: &Outfit) {
    let hips = pose.hips();
    let spine = |up: f32| hips + Vec3::new(pose.lean() * up, 0.0, up);
    let legs = match pose {
        Pose::Stand => [(Vec3::ZERO, 0.11), (hips, 0.17)],
        Pose::Walk => [(Vec3::ZERO, 0.24), (hips, 0.15)],
        Pose::Straddle => [(Vec3::ZERO, 0.20), (hips, 0.17)],
        Pose::Sit => [(Vec3::new(0.42, 0.0, -0.42), 0.13), (Vec3::new(0.3, 0.0, 0.08), 0.17)],
    };
    limb(mesh, &legs, 3, cloth(outfit.trousers));
    limb(
        mesh,
        &[(spine(if pose == Pose::Sit { -0.06 } else { 0.0 }), 0.18), (spine(0.60), 0.20)],
        3,
        cloth(outfit.coat),
    );
    limb(mesh, &[(spine(0.60), 0.07), (spine(0.89), 0.12)], 3, cloth(outfit.skin));
}

fn object((pose, outfit): &(Pose, Outfit)) -> SceneObject {
    let drawn = |sides: u32| {
        let mut mesh = Mesh::default();
        figure(&mut mesh, *pose, outfit, sides);
        mesh
    };
    let mut object = SceneObject::of_one_level(drawn(7));
    for (sides, error_m) in COARSER {
        object.add_level(drawn(sides), error_m);
    }
    let mut plain = Mesh::default();
    plain_figure(&mut plain, *pose, outfit);
    // Its legs are apart, on both sides of the bicycle.
    let error_m = if *pose == Pose::Straddle { 1.4 * PLAIN_ERROR_M } else { PLAIN_ERROR_M };
    object.add_level(plain, error_m);
    object
}

/// People along the kerbs, whose rings have the road to their left, and on benches.
pub(super) fn people(
    map: &CityMap,
    field: &RoadField,
    kerbs: &[Vec<DVec2>],
    posts: &Posts,
) -> Vec<SceneObject> {
    let figures: Vec<SceneObject> = FIGURES.iter().map(object).collect();
    let bicycle = bicycles::bicycle();
    let mut people = Vec::new();
    // Two of one look are not next to one another.
    let mut last = [usize::MAX; 2];
    let mut add = |seed: u32, is_wanted: &dyn Fn(Pose) -> bool, at: Vec3, yaw_rad: f32| {
        let fit: Vec<usize> = (0..FIGURES.len()).filter(|&k| is_wanted(FIGURES[k].0)).collect();
        let pick = |salt: u32, of: usize| (hash_to_unit(seed, salt) * of as f32) as usize % of;
        let (mut figure, mut coat) = (pick(1, fit.len()), pick(8, COATS.len()));
        if fit[figure] == last[0] {
            figure = (figure + 1) % fit.len();
        }
        if coat == last[1] {
            coat = (coat + 1) % COATS.len();
        }
        let chosen = fit[figure];
        last = [chosen, coat];
        let (worn, coat) = (cloth(FIGURES[chosen].1.coat), cloth(COATS[coat]));
        let dressed = |finish: Finish| match finish {
            of if of == worn => coat,
            of if of == worn.shaded(0.92) => coat.shaded(0.92),
            other => other,
        };
        let scale = 0.93 + 0.12 * hash_to_unit(seed, 2);
        let (size, turn) = (Vec3::splat(scale), Quat::from_rotation_z(yaw_rad));
        let here = Affine3A::from_scale_rotation_translation(size, turn, at);
        let mut person = figures[chosen].placed(here, dressed);
        person.levels.push(LodMesh { mesh: Mesh::default(), error_m: UNDRAWN_M });
        people.push(person);
        if FIGURES[chosen].0 == Pose::Straddle {
            people.push(bicycles::painted(&bicycle, here, seed));
        }
    };
    // Nobody has a way to the island of a roundabout.
    let has_people = |ring: &[DVec2]| doubled_area(ring).abs() > 2.0 * LEAST_AREA_M2;
    for (ring, seed) in kerbs.iter().zip(0..).filter(|(ring, _)| has_people(ring)) {
        for (seed, at, along) in along_kerb(ring, seed, &ROW) {
            if !has_room(map, field, posts, (at, CLEAR_M)) {
                continue;
            }
            if hash_to_unit(seed, 7) < CYCLISTS {
                // They wait as traffic drives, the road to their left.
                let yaw_rad = (-along).as_vec2().to_angle();
                add(seed, &|wanted| wanted == Pose::Straddle, at.as_vec2().extend(KERB_M - 0.01), yaw_rad);
                continue;
            }
            let is_walking = hash_to_unit(seed, 3) < 0.6;
            let turned =
                std::f32::consts::PI * hash_to_unit(seed, 4).round() + 0.3 * (hash_to_unit(seed, 5) - 0.5);
            let any = std::f32::consts::TAU * hash_to_unit(seed, 5);
            let yaw_rad = if is_walking { along.as_vec2().to_angle() + turned } else { any };
            let pose = if is_walking { Pose::Walk } else { Pose::Stand };
            add(seed, &|wanted| wanted == pose, at.as_vec2().extend(KERB_M - 0.01), yaw_rad);
        }
    }
    for (piece, index) in
        map.scenery.iter().zip(0_u32..).filter(|(piece, _)| piece.kind == SceneryKind::Bench)
    {
        let (middle, front) = super::props::bench_place(piece);
        for (seat, part) in SEATS_M.into_iter().zip(0..) {
            let seed = index.wrapping_mul(2).wrapping_add(0x5eed_0000 + part);
            if hash_to_unit(seed, 6) < 0.35 {
                let at = middle + front.perp() * seat + front * 0.02;
                add(seed, &|wanted| wanted == Pose::Sit, at.extend(SEAT_M), front.to_angle());
            }
        }
    }
    people
}

#[cfg(test)]
mod tests {
    use super::super::SceneDescription;
    use super::super::grounds::distance_to;
    use super::super::mesh::Vertex;
    use super::super::tests::city;
    use super::*;

    #[test]
    fn people_stand_on_pavements_clear_of_lanes_and_walls_and_sit_on_benches() {
        let map = city();
        let scene = SceneDescription::from_map(&map);
        let is_person = |v: &Vertex| v.finish.class == Class::Person;
        let is_figure = |object: &&SceneObject| object.levels[0].mesh.vertices.first().is_some_and(is_person);
        let (mut standing, mut sitting) = (0, 0);
        for person in scene.objects.iter().filter(is_figure) {
            // The foot of its trunk without arms, three corners of the second limb, is above its place or on its seat.
            let plain = &person.levels[person.levels.len() - 2].mesh;
            let trunk = &plain.vertices[8..11];
            let foot = trunk.iter().map(|v| v.position.truncate().as_dvec2()).sum::<DVec2>() / 3.0;
            let nearest = |kind: SceneryKind, at: DVec2| {
                let of_kind = map.scenery.iter().filter(|piece| piece.kind == kind);
                of_kind.map(|piece| distance_to(&piece.shape, at)).fold(f64::INFINITY, f64::min)
            };
            let off_walls = |at| nearest(SceneryKind::Building, at).min(nearest(SceneryKind::Wall, at));
            let finest = &person.levels[0].mesh;
            let [low, high] = finest.bounds();
            if high.z - low.z < 1.55 {
                sitting += 1;
                assert!(nearest(SceneryKind::Bench, foot) < 0.1, "nobody sits at {foot} but on air");
                continue;
            }
            standing += 1;
            assert!(off_walls(foot) > 0.5, "in a wall: {foot}");
            for at in finest.vertices.iter().map(|v| v.position.truncate().as_dvec2()) {
                assert!(off_walls(at) > 0.0, "in a wall: {at}");
            }
            for lane in &map.lanes {
                let far = lane.curve.at(lane.curve.project(foot).s).pose.position.distance(foot);
                assert!(far > lane.width_m / 2.0 + 0.4, "{foot} is {far} m from the middle of {}", lane.name);
            }
        }
        // On pavements alone: none on the islands of roundabouts.
        assert!(standing > 130 && sitting > 5, "{standing} stand or walk, {sitting} sit");
    }

    #[test]
    fn cyclists_hold_the_bar_and_have_a_foot_on_the_ground_and_one_on_its_pedal() {
        let far = |pair: [Vec3; 2]| pair[0].distance(pair[1]);
        for side in [1.0, -1.0] {
            let [elbow, wrist, fingers] = Pose::Straddle.arm(side);
            assert_eq!(fingers, bicycles::GRIP_M * Vec3::new(1.0, side, 1.0));
            let [knee, ankle, tip] = Pose::Straddle.leg(side);
            let hip = Pose::Straddle.hips() + Vec3::Y * HIP_M * side;
            // Limbs are as long as those of people who stand.
            for bone in [[hip, knee], [knee, ankle]] {
                assert!((0.37..0.47).contains(&far(bone)), "{} m", far(bone));
            }
            assert!((0.2..0.35).contains(&far([elbow, wrist])), "{} m", far([elbow, wrist]));
            let pedal = bicycles::left_pedal();
            assert!(if side > 0.0 { far([tip, pedal]) < 0.12 } else { tip.z < 0.05 }, "{tip}");
        }
    }

    #[test]
    fn figures_are_as_tall_as_people_and_coarser_from_afar() {
        for of in &FIGURES {
            let object = object(of);
            let [low, high] = object.levels[0].mesh.bounds();
            let tall_m = if of.0 == Pose::Sit { 1.4 } else { 1.75 };
            assert!((high.z - low.z - tall_m).abs() < 0.12, "{:?}: {} m", of.0, high.z - low.z);
            let counts: Vec<usize> = object.levels.iter().map(|level| level.mesh.triangle_count()).collect();
            assert!(counts.windows(2).all(|pair| pair[1] < pair[0]) && counts[0] < 320, "{counts:?}");
        }
    }
}
