//! Poles with the names of streets, where roads leave junctions.

use super::mesh::{Class, Finish, Mesh, Surface};
use super::roads::RoadField;
use super::signs::at_line;
use super::{SceneObject, lettering};
use city3d_roadmap::{CityMap, Lane, LaneKind};
use glam::{DVec2, Vec2, Vec3};

/// How far along its lane a pole stands at most.
const ALONG_M: f64 = 4.2;
/// Least distances of poles: of the same street, and of any.
const SAME_M: f64 = 30.0;
const APART_M: f64 = 5.0;
const LETTER_M: f32 = 0.135;
/// Height of the middle of the lowest blade, and from one to the next.
const LOWEST_M: f32 = 2.55;
const STEP_M: f32 = 0.31;
const THICK_M: f32 = 0.03;
/// Error of blades without letters.
const PLAIN_M: f32 = 0.035;

const POST: Finish = Finish::new(Surface::Metal, [92, 98, 102], Class::Pole);
const BLADE: Finish = Finish::new(Surface::Plain, [222, 226, 228], Class::Sign);

/// A street's name and its direction.
struct Blade {
    text: String,
    along: Vec2,
}

/// The name of the street of a lane, in capitals: the first part of the lane's name.
fn street_of(lane: &Lane) -> Option<String> {
    let (street, _) = lane.name.split_once('/')?;
    let is_said = street.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '-');
    (is_said && street.len() > 2).then(|| street.replace('-', " ").to_uppercase())
}

/// Poles with one blade for the street that begins there, and one for that from which one comes.
pub(super) fn poles(map: &CityMap, field: &RoadField) -> Vec<SceneObject> {
    let mut poles = Vec::new();
    let mut standing: Vec<(DVec2, String)> = Vec::new();
    let begins = |lane: &Lane| {
        let from = |id| map.lane(id).kind == LaneKind::Connector;
        lane.kind == LaneKind::Lane && lane.predecessors.iter().any(|&id| from(id))
    };
    for lane in map.lanes.iter().filter(|lane| begins(lane)) {
        // The right neighbour is closer to the kerb.
        if lane.right.is_some_and(|right| begins(map.lane(right))) {
            continue;
        }
        let Some(text) = street_of(lane) else { continue };
        let Some((at, towards)) = at_line(map, field, lane, ALONG_M.min(lane.curve.length() / 2.0)) else {
            continue;
        };
        let is_near = |(known, name): &(DVec2, String)| {
            known.distance(at) < if *name == text { SAME_M } else { APART_M }
        };
        if standing.iter().any(is_near) {
            continue;
        }
        let mut blades = vec![Blade { text: text.clone(), along: towards }];
        blades.extend(crossed(map, lane, towards).filter(|other| other.text != text));
        poles.push(pole(at.as_vec2(), &blades));
        standing.push((at, text));
    }
    poles
}

/// The street from which one turns into a lane.
fn crossed(map: &CityMap, lane: &Lane, towards: Vec2) -> Option<Blade> {
    let before = |id| map.lane(id).predecessors.iter().map(|&id| map.lane(id));
    let turned = lane.predecessors.iter().flat_map(|&id| before(id)).find_map(|from| {
        let along = from.curve.end().forward().as_vec2();
        (along.dot(towards).abs() < 0.5).then(|| street_of(from)).flatten()
    })?;
    Some(Blade { text: turned, along: towards.perp() })
}

fn pole(foot: Vec2, blades: &[Blade]) -> SceneObject {
    let mut object = SceneObject::of_one_level(draw(foot, blades, true));
    object.add_level(draw(foot, blades, false), PLAIN_M);
    object
}

fn draw(foot: Vec2, blades: &[Blade], is_lettered: bool) -> Mesh {
    let mut mesh = Mesh::default();
    let top = LOWEST_M + STEP_M * (blades.len() as f32 - 0.4);
    mesh.frustum(
        foot.extend(0.1),
        [0.034, if is_lettered { 0.03 } else { 0.0 }],
        top,
        if is_lettered { 6 } else { 3 },
        POST,
    );
    for (k, blade) in blades.iter().enumerate() {
        let middle = foot.extend(LOWEST_M + STEP_M * k as f32);
        draw_blade(&mut mesh, middle, blade, is_lettered);
    }
    mesh
}

/// A blade that is read from both sides.
fn draw_blade(mesh: &mut Mesh, middle: Vec3, blade: &Blade, is_lettered: bool) {
    let width = lettering::width_of(&blade.text, LETTER_M) + 0.16;
    let high = lettering::half_board(LETTER_M);
    let along = blade.along.extend(0.0);
    let across = along.cross(Vec3::Z);
    // Above and below the blade the pole is seen.
    let at = |x: f32, y: f32, z: f32| {
        middle + along * (x * width / 2.0) + across * (y * THICK_M) + Vec3::Z * (z * high)
    };
    for side in [1.0_f32, -1.0] {
        if is_lettered {
            let size = [width, LETTER_M];
            lettering::write(mesh, &blade.text, at(0.0, side, 0.0), along * side, size, BLADE);
        } else {
            let face =
                [at(-side, side, -1.0), at(side, side, -1.0), at(side, side, 1.0), at(-side, side, 1.0)];
            mesh.plate(&face, BLADE.shaded(0.85), 1.0);
        }
    }
    if is_lettered {
        for up in [1.0_f32, -1.0] {
            let lid = [at(-1.0, up, up), at(1.0, up, up), at(1.0, -up, up), at(-1.0, -up, up)];
            mesh.plate(&lid, BLADE, 1.0);
            let end = [at(up, up, -1.0), at(up, -up, -1.0), at(up, -up, 1.0), at(up, up, 1.0)];
            mesh.plate(&end, BLADE, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::city;
    use super::*;

    #[test]
    fn poles_name_the_streets_of_the_city_and_are_read_from_both_sides() {
        let map = city();
        let field = RoadField::new(&map);
        let poles = poles(&map, &field);
        assert!(poles.len() >= 8, "{}", poles.len());
        for pole in &poles {
            let mesh = &pole.levels[0].mesh;
            let foot = mesh.vertices[0].position.truncate().as_dvec2();
            assert!(field.distance.at(foot) > 0.5, "on the road at {foot}");
            let letters = || mesh.vertices.iter().filter(|v| v.finish.surface == Surface::Letters);
            let sum: Vec3 = letters().map(|v| v.normal).sum();
            assert!(letters().count() > 40 && sum.length() < 1e-2, "{sum}");
            // Faces look away from the middle of the blade.
            let centre = letters().map(|v| v.position).sum::<Vec3>() / letters().count() as f32;
            assert!(letters().any(|v| (v.position - centre).dot(v.normal) > 0.0));
        }
    }
}
