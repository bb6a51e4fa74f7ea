use super::super::SceneDescription;
use super::super::grounds::distance_to;
use super::super::mesh::{Class, Vertex};
use super::super::tests::city;
use super::*;

/// People of a scene with their numbers among its objects, and the middle of their hips.
fn people_of(scene: &SceneDescription) -> Vec<(usize, &SceneObject, DVec2)> {
    let is_person = |v: &Vertex| v.finish.class == Class::Person;
    let is_figure = |object: &SceneObject| object.levels[0].mesh.vertices.first().is_some_and(is_person);
    let figures = scene.objects.iter().enumerate().filter(|(_, object)| is_figure(object));
    figures
        .map(|(number, object)| {
            // The foot of the trunk without arms, three corners of the second limb, is above the place or on the seat.
            let plain = &object.levels[object.levels.len() - 2].mesh;
            let trunk = &plain.vertices[8..11];
            let foot = trunk.iter().map(|v| v.position.truncate().as_dvec2()).sum::<DVec2>() / 3.0;
            (number, object, foot)
        })
        .collect()
}

fn is_seated(object: &SceneObject) -> bool {
    // Near by their shoes reach the ground.
    let [low, _] = object.levels[1].mesh.bounds();
    low.z > KERB_M + 0.05
}

#[test]
fn people_stand_on_pavements_clear_of_lanes_and_walls_and_sit_on_benches() {
    let map = city();
    let scene = SceneDescription::from_map(&map);
    let (mut standing, mut sitting) = (0, 0);
    for (_, person, foot) in people_of(&scene) {
        let nearest = |kind: SceneryKind, at: DVec2| {
            let of_kind = map.scenery.iter().filter(|piece| piece.kind == kind);
            of_kind.map(|piece| distance_to(&piece.shape, at)).fold(f64::INFINITY, f64::min)
        };
        let off_walls = |at| nearest(SceneryKind::Building, at).min(nearest(SceneryKind::Wall, at));
        if is_seated(person) {
            sitting += 1;
            assert!(nearest(SceneryKind::Bench, foot) < 0.1, "nobody sits at {foot} but on air");
            continue;
        }
        standing += 1;
        assert!(off_walls(foot) > 0.4, "in a wall: {foot}");
        for at in person.levels[0].mesh.vertices.iter().map(|v| v.position.truncate().as_dvec2()) {
            assert!(off_walls(at) > 0.0, "in a wall: {at}");
        }
        for lane in &map.lanes {
            let far = lane.curve.at(lane.curve.project(foot).s).pose.position.distance(foot);
            assert!(far > lane.width_m / 2.0 + 0.3, "{foot} is {far} m from the middle of {}", lane.name);
        }
    }
    // On pavements alone: none on the islands of roundabouts.
    assert!(standing > 130 && sitting > 5, "{standing} stand or walk, {sitting} sit");
}

/// The part of a triangle between two heights, seen from above.
fn between(triangle: [Vec3; 3], [low_m, high_m]: [f32; 2]) -> Vec<DVec2> {
    let cut = |ring: Vec<Vec3>, depth: &dyn Fn(Vec3) -> f32| -> Vec<Vec3> {
        let mut left = Vec::new();
        for (k, &a) in ring.iter().enumerate() {
            let b = ring[(k + 1) % ring.len()];
            let [over, next] = [depth(a), depth(b)];
            if over >= 0.0 {
                left.push(a);
            }
            if (over >= 0.0) != (next >= 0.0) {
                left.push(a.lerp(b, over / (over - next)));
            }
        }
        left
    };
    let above = cut(triangle.to_vec(), &|at| at.z - low_m);
    cut(above, &|at| high_m - at.z).into_iter().map(|at| at.truncate().as_dvec2()).collect()
}

/// One common rule for the whole city: whatever is beside a person, from knee to head, keeps clear of its middle.
#[test]
fn nobody_stands_in_anything() {
    const HEIGHTS_M: [f32; 2] = [0.45, 1.75];
    const CLEAR_M: f64 = 0.17;
    let scene = SceneDescription::from_map(&city());
    let mut looked = 0;
    for (number, person, foot) in people_of(&scene) {
        if is_seated(person) {
            continue;
        }
        for (other, object) in scene.objects.iter().enumerate() {
            let mesh = &object.levels[0].mesh;
            // Who wheels a bicycle has a hand on it: it is the next object.
            let is_own = other == number
                || (other == number + 1
                    && mesh.vertices.first().is_some_and(|v| v.finish.class == Class::Vehicle));
            let [low, high] = mesh.bounds();
            let margin = CLEAR_M as f32;
            let at = foot.as_vec2();
            let is_far = at.cmplt(low.truncate() - margin).any() || at.cmpgt(high.truncate() + margin).any();
            if is_own || is_far || low.z > HEIGHTS_M[1] {
                continue;
            }
            looked += 1;
            for t in mesh.indices.chunks_exact(3) {
                let part = between([t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position), HEIGHTS_M);
                if part.is_empty() {
                    continue;
                }
                let finish = mesh.vertices[t[0] as usize].finish;
                let ring = city3d_roadmap::Footprint::Polyline([part.as_slice(), &part[..1]].concat());
                let off_m = distance_to(&ring, foot);
                assert!(
                    off_m > CLEAR_M,
                    "{finish:?} of object {other} is {off_m} m from who stands at {foot}"
                );
            }
        }
    }
    assert!(looked > 2, "{looked}");
}
