//! What stands on pavements along kerbs: bollards, post boxes, cabinets, parked bicycles, and gullies in the gutter.

use super::bicycles;
use super::crossings::{Crossing, DEEP_M};
use super::ground_sheet::KERB_M;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::places::{Disc, KerbRow, Places, along_kerb, is_island};
use super::{SceneObject, hash_to_unit};
use glam::{Affine3A, DVec2, Quat, Vec2, Vec3};

/// Where things stand along a kerb, and where gullies are.
const ROW: KerbRow = KerbRow { spacing_m: 12.0, off_kerb_m: [0.46, 0.46], salt: 41 };
const GULLIES: KerbRow = KerbRow { spacing_m: 17.0, off_kerb_m: [-0.15, -0.15], salt: 51 };
/// Bollards: behind the face of the kerb, from one to the next, and beside a crossing.
const BOLLARDS_OFF_M: f64 = 0.42;
const BOLLARDS_APART_M: f64 = 1.35;
const BESIDE_CROSSING_M: f64 = 0.35;
/// Radii of what things take of the pavement: bollards, half a bicycle, post boxes and cabinets.
const BOLLARD_M: f64 = 0.26;
const BICYCLE_M: f64 = 0.34;
const BOX_M: f64 = 0.42;
/// From one post box to the next.
const POST_BOXES_APART_M: f64 = 110.0;
/// Depth of feet in the pavement.
const FOOT_M: f32 = KERB_M - 0.02;
/// Height of the frame and of the bars of a gully, above wear and below paint.
const GULLY_M: [f32; 2] = [0.0086, 0.0104];

const BOLLARD: Finish = Finish::new(Surface::Metal, [54, 58, 62], Class::Pole);
const BAND: Finish = Finish::new(Surface::Plain, [214, 212, 204], Class::Pole);
const POST_BOX: Finish = Finish::new(Surface::Metal, [176, 30, 34], Class::Furniture);
const SLOT: Finish = Finish::new(Surface::Plain, [22, 22, 24], Class::Furniture);
const NOTICE: Finish = Finish::new(Surface::Plain, [226, 224, 214], Class::Furniture);
const CABINET: Finish = Finish::new(Surface::Metal, [96, 110, 102], Class::Furniture);
const STAND: Finish = Finish::new(Surface::Metal, [132, 136, 140], Class::Furniture);
const GULLY: Finish = Finish::new(Surface::Plain, [26, 27, 28], Class::Road);
const GULLY_BAR: Finish = Finish::new(Surface::Metal, [96, 96, 98], Class::Road);

/// What may stand at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Thing {
    Bollards,
    PostBox,
    Cabinet,
    Bicycle,
}

/// Which thing stands at a place, if any, by shares of 100.
fn thing_at(seed: u32) -> Option<Thing> {
    match (hash_to_unit(seed, 44) * 100.0) as u32 {
        0..18 => Some(Thing::Bollards),
        18..24 => Some(Thing::PostBox),
        24..34 => Some(Thing::Cabinet),
        34..58 => Some(Thing::Bicycle),
        _ => None,
    }
}

/// Everything along the kerbs, whose rings have the road to their left, where there are places.
pub(super) fn furniture(
    kerbs: &[Vec<DVec2>],
    crossings: &[Crossing],
    places: &mut Places<'_>,
) -> Vec<SceneObject> {
    let ends: Vec<_> = crossings.iter().flat_map(Crossing::ends).collect();
    let is_off_crossings =
        |at: DVec2| ends.iter().all(|(end, ..)| end.distance(at) > DEEP_M / 2.0 + BOLLARDS_APART_M + 1.0);
    let [bollard, post_box, cabinet] = [bollard(), post_box(), cabinet()];
    let bicycle = bicycles::bicycle();
    let (mut found, mut post_boxes) = (Vec::new(), Vec::new());
    for (end, outward, along) in &ends {
        for aside in [BESIDE_CROSSING_M, BESIDE_CROSSING_M + BOLLARDS_APART_M] {
            for side in [1.0, -1.0] {
                let at = *end + *outward * BOLLARDS_OFF_M + *along * (side * (DEEP_M / 2.0 + aside));
                if claim(places, &[(at, BOLLARD_M)]) {
                    found.push(bollard.placed(standing(at, Vec2::X), |finish| finish));
                }
            }
        }
    }
    for (ring, number) in kerbs.iter().zip(0..) {
        for (seed, at, along) in along_kerb(ring, number, &ROW) {
            let Some(thing) = thing_at(seed).filter(|_| is_off_crossings(at)) else { continue };
            if is_island(ring) && thing == Thing::Bicycle {
                continue;
            }
            let outward = -along.perp();
            match thing {
                Thing::Bollards => found.extend(
                    (0..4)
                        .map(|k| at + along * (BOLLARDS_APART_M * f64::from(k)))
                        .filter(|&at| is_off_crossings(at) && claim(places, &[(at, BOLLARD_M)]))
                        .map(|at| bollard.placed(standing(at, Vec2::X), |finish| finish)),
                ),
                Thing::PostBox | Thing::Cabinet => {
                    let (object, behind) =
                        if thing == Thing::PostBox { (&post_box, 0.10) } else { (&cabinet, 0.14) };
                    let at = at + outward * behind;
                    let is_wanted = thing == Thing::Cabinet
                        || post_boxes.iter().all(|other: &DVec2| other.distance(at) > POST_BOXES_APART_M);
                    if is_wanted && claim(places, &[(at, BOX_M)]) {
                        if thing == Thing::PostBox {
                            post_boxes.push(at);
                        }
                        found.push(object.placed(standing(at, outward.as_vec2()), |finish| finish));
                    }
                }
                Thing::Bicycle => {
                    let at = at + outward * 0.12;
                    let half = f64::from(bicycles::LENGTH_M / 2.0) - BICYCLE_M;
                    let discs = [-half, 0.0, half].map(|way| -> Disc { (at + along * way, BICYCLE_M) });
                    if claim(places, &discs) {
                        found.extend(parked(&bicycle, (at, along), seed));
                    }
                }
            }
        }
    }
    found
}

/// Takes discs for what stays there for good: not before doors either.
fn claim(places: &mut Places<'_>, discs: &[Disc]) -> bool {
    !discs.iter().any(|&disc| places.is_before_door(disc)) && places.claim(discs)
}

/// The place of what faces a direction.
fn standing(at: DVec2, front: Vec2) -> Affine3A {
    let turn = Quat::from_rotation_z(front.to_angle());
    Affine3A::from_rotation_translation(turn, at.as_vec2().extend(FOOT_M))
}

/// A bicycle that leans on a stand, along the kerb.
fn parked(bicycle: &SceneObject, (at, along): (DVec2, DVec2), seed: u32) -> Vec<SceneObject> {
    const LEAN_RAD: f32 = 0.10;
    let along = along.as_vec2() * (hash_to_unit(seed, 45) - 0.5).signum();
    let here = standing(at, along);
    let leaning = here
        * Affine3A::from_rotation_translation(Quat::from_rotation_x(LEAN_RAD), Vec3::new(0.0, 0.10, 0.02));
    vec![bicycles::painted(bicycle, leaning, seed), stand().placed(here, |finish| finish)]
}

/// A hoop of tube, along x.
fn stand() -> SceneObject {
    let mut mesh = Mesh::default();
    for x in [-0.36, 0.36] {
        mesh.frustum(Vec3::new(x, -0.04, 0.0), [0.026, 0.026], 0.74, 5, STAND);
    }
    mesh.block(Vec3::new(0.0, -0.04, 0.71), Vec3::new(0.77, 0.05, 0.05), 0.0, STAND);
    SceneObject::of_one_level(mesh)
}

fn bollard() -> SceneObject {
    let drawn = |sides: u32| {
        let mut mesh = Mesh::default();
        mesh.frustum(Vec3::ZERO, [0.066, 0.054], 0.96, sides, BOLLARD);
        if sides > 4 {
            mesh.frustum(Vec3::Z * 0.74, [0.062, 0.061], 0.09, sides, BAND);
        }
        mesh
    };
    levels_of(drawn, [7, 4, 3])
}

fn post_box() -> SceneObject {
    let drawn = |sides: u32| {
        let mut mesh = Mesh::default();
        mesh.frustum(Vec3::ZERO, [0.25, 0.25], 0.10, sides, SLOT);
        mesh.frustum(Vec3::Z * 0.08, [0.22, 0.22], 1.24, sides, POST_BOX);
        if sides > 6 {
            mesh.frustum(Vec3::Z * 1.30, [0.26, 0.26], 0.05, sides, POST_BOX.shaded(0.9));
            mesh.frustum(Vec3::Z * 1.35, [0.25, 0.06], 0.09, sides, POST_BOX);
            // Both to the pavement and to the road.
            for x in [0.215, -0.215] {
                mesh.block(Vec3::new(x, 0.0, 1.12), Vec3::new(0.03, 0.24, 0.05), 0.0, SLOT);
                mesh.block(Vec3::new(x, 0.0, 0.86), Vec3::new(0.03, 0.16, 0.20), 0.0, NOTICE);
            }
        } else {
            mesh.frustum(Vec3::Z * 1.30, [0.26, 0.0], 0.14, sides, POST_BOX);
        }
        mesh
    };
    levels_of(drawn, [10, 6, 4])
}

fn cabinet() -> SceneObject {
    let drawn = |detail: u32| {
        let mut mesh = Mesh::default();
        mesh.block(Vec3::ZERO, Vec3::new(0.36, 0.86, 0.12), 0.0, CABINET.shaded(1.5));
        mesh.block(Vec3::Z * 0.11, Vec3::new(0.32, 0.80, 1.02), 0.0, CABINET);
        mesh.block(Vec3::Z * 1.12, Vec3::new(0.38, 0.86, 0.05), 0.0, CABINET.shaded(0.85));
        if detail > 1 {
            // Joint of the doors, lock, and slots, on both sides.
            for x in [0.162, -0.162] {
                mesh.block(Vec3::new(x, 0.0, 0.16), Vec3::new(0.004, 0.012, 0.92), 0.0, SLOT);
                mesh.block(Vec3::new(x, 0.06, 0.62), Vec3::new(0.02, 0.03, 0.10), 0.0, SLOT);
                for k in 0..4 {
                    let at = Vec3::new(x, -0.2, 0.90 + 0.035 * k as f32);
                    mesh.block(at, Vec3::new(0.004, 0.22, 0.012), 0.0, SLOT);
                }
            }
        }
        mesh
    };
    levels_of(drawn, [2, 1, 1])
}

/// An object from the finest detail to the coarsest.
fn levels_of(drawn: impl Fn(u32) -> Mesh, [fine, middle, coarse]: [u32; 3]) -> SceneObject {
    let mut object = SceneObject::of_one_level(drawn(fine));
    object.add_level(drawn(middle), 0.025);
    object.add_level(drawn(coarse), 0.05);
    object.measure_corners();
    object
}

/// Gullies in the gutter, which lie between edge line and kerb.
pub(super) fn gullies(mesh: &mut Mesh, kerbs: &[Vec<DVec2>]) {
    const HALF_M: [f64; 2] = [0.26, 0.12];
    const BARS: u32 = 5;
    for (ring, number) in kerbs.iter().zip(0..) {
        for (_, at, along) in along_kerb(ring, number, &GULLIES) {
            let mut lay = |[from, to]: [f64; 2], half: f64, z: f32, finish: Finish| {
                let corners = [(from, -half), (to, -half), (to, half), (from, half)]
                    .map(|(x, y)| (at + along * x + along.perp() * y).as_vec2().extend(z));
                mesh.plate(&corners, finish, 1.0);
            };
            let [half, wide] = HALF_M;
            lay([-half, half], wide, GULLY_M[0], GULLY);
            for k in 0..BARS {
                let middle = -half + 2.0 * half * (f64::from(k) + 0.5) / f64::from(BARS);
                lay([middle - 0.026, middle + 0.026], wide - 0.02, GULLY_M[1], GULLY_BAR);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::SceneDescription;
    use super::super::mesh::Vertex;
    use super::super::roads::RoadField;
    use super::super::tests::city;
    use super::*;

    #[test]
    fn furniture_stands_along_kerbs_clear_of_the_road() {
        let map = city();
        let field = RoadField::new(&map);
        let scene = SceneDescription::from_map(&map);
        let has = |finish: Finish| move |v: &Vertex| v.finish == finish;
        for (finish, least) in [(BOLLARD, 40), (POST_BOX, 3), (CABINET, 5), (STAND, 8)] {
            let is_one = has(finish);
            let all =
                scene.objects.iter().filter(|object| object.levels[0].mesh.vertices.iter().any(&is_one));
            let mut count = 0;
            for object in all {
                let [low, high] = object.levels[0].mesh.bounds();
                let middle = ((low + high) / 2.0).truncate().as_dvec2();
                assert!(field.distance.at(middle) > 0.3 + 0.25, "{finish:?} at {middle}");
                count += 1;
            }
            assert!(count >= least, "{finish:?}: {count}");
        }
    }

    #[test]
    fn gullies_are_in_the_gutter() {
        let map = city();
        let field = RoadField::new(&map);
        let scene = SceneDescription::from_map(&map);
        let gullies: Vec<Vec3> = scene
            .ground
            .iter()
            .flat_map(|object| &object.levels[0].mesh.vertices)
            .filter(|v| v.finish == GULLY)
            .map(|v| v.position)
            .collect();
        assert!(gullies.len() > 200, "{}", gullies.len());
        for at in gullies {
            let off = field.distance.at(at.truncate().as_dvec2());
            assert!((-0.1..0.42).contains(&off), "{off} m off the road at {at}");
        }
    }
}
