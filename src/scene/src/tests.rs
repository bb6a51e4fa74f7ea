use super::*;
use city3d_geometry::LengthScale;
use city3d_roadmap::{LaneKind, PlacedModel, load_map};
use glam::{DVec2, Vec2};
use std::collections::BTreeMap;

pub(super) fn city() -> CityMap {
    let shipped = include_bytes!("../../../assets/maps/ids3c.dxf");
    load_map(shipped).unwrap().map.to_city(LengthScale::TESTBED)
}

/// Triangles of a surface that look up, as seen from above, where so large an error is allowed.
fn level_triangles(scene: &SceneDescription, surface: Surface, error_m: f32) -> Vec<[Vec2; 3]> {
    let mut found = Vec::new();
    let levels = scene.ground.iter().filter_map(|o| o.levels.iter().rev().find(|l| l.error_m <= error_m));
    for mesh in levels.map(|level| &level.mesh) {
        for t in mesh.indices.chunks_exact(3) {
            let corners = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
            if corners.iter().all(|v| v.finish.surface == surface && v.position.z < 0.05 && v.normal.z > 0.9)
            {
                found.push(corners.map(|v| v.position.truncate()));
            }
        }
    }
    found
}

#[test]
fn nothing_lies_on_a_lane_but_what_belongs_to_it() {
    let map = city();
    let scene = SceneDescription::from_map(&map);
    let mut above = Vec::new();
    for mesh in scene.meshes() {
        for t in mesh.indices.chunks_exact(3) {
            let corners = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
            let class = corners[0].finish.class;
            let foreign = !matches!(class, Class::Road | Class::Marking);
            if foreign && corners.iter().all(|v| v.position.z < 2.0 && v.normal.z > 0.9) {
                above.push((class, corners.map(|v| v.position.truncate())));
            }
        }
    }
    for lane in &map.lanes {
        let half = lane.width_m / 2.0 - 0.05;
        for (_, point) in lane.curve.sample(3.0) {
            for left in [-half, 0.0, half] {
                let at = point.pose.point_at(0.0, left).as_vec2();
                let found = above.iter().find(|(_, t)| covers(t, at));
                assert!(found.is_none(), "{found:?} lies on {} at {at}", lane.name);
            }
        }
    }
}

#[test]
fn walls_for_labels_reach_up_to_roofs_and_spires() {
    let map = city();
    let walls = SceneDescription::walls_of(&map);
    let highest_m = walls.iter().map(|wall| wall.height_m).fold(0.0, f32::max);
    let buildings = map.scenery.iter().enumerate().filter(|(_, piece)| piece.kind == SceneryKind::Building);
    let eaves = buildings
        .flat_map(|(index, piece)| buildings::opaque_walls(&SeededScenery { piece, seed: index as u32 }));
    let (count, eaves_m) = eaves.fold((0, 0.0), |(count, high), wall| (count + 1, wall.height_m.max(high)));
    assert!(walls.len() > count && highest_m > eaves_m + 1.0, "{highest_m} m, eaves at {eaves_m} m");
}

/// To within a millimetre; slivers cover nothing.
fn covers(t: &[Vec2; 3], p: Vec2) -> bool {
    let doubled_area = (t[1] - t[0]).perp_dot(t[2] - t[0]);
    doubled_area > 1e-5
        && (0..3).all(|k| (t[(k + 1) % 3] - t[k]).normalize_or_zero().perp_dot(p - t[k]) >= -1e-3)
}

#[test]
fn no_window_is_behind_a_door() {
    let scene = SceneDescription::from_map(&city());
    let with_windows = [Surface::Windows, Surface::Sash, Surface::Shutters, Surface::Balcony];
    let mut doors = 0;
    for mesh in scene.objects.iter().map(|object| &object.levels[0].mesh) {
        let corners = |t: &[u32]| [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
        let faces: Vec<_> = mesh.indices.chunks_exact(3).map(corners).collect();
        for door in faces.iter().filter(|t| t[0].finish.surface == Surface::Door) {
            doors += 1;
            // Above it, and beside its frame, where parts of windows would be seen.
            let corners = door.map(|v| v.position);
            let top = corners.into_iter().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
            let middle = corners
                .into_iter()
                .reduce(Vec3::min)
                .unwrap()
                .midpoint(corners.into_iter().reduce(Vec3::max).unwrap());
            let across = door[0].normal.cross(Vec3::Z) * 0.14;
            for at in [top + Vec3::Z * 0.04, middle + across * 7.0, middle - across * 7.0] {
                let at = at - door[0].normal * 0.066;
                let behind = faces.iter().find(|t| {
                    let [a, b, c] = t.map(|v| v.position);
                    let facing = (b - a).cross(c - a);
                    let edges = [(a, b), (b, c), (c, a)];
                    let inside = edges.iter().all(|(p, q)| (q - p).cross(at - p).dot(facing) >= 0.0);
                    let away = (at - a).dot(facing) / facing.length().max(1e-9);
                    inside && away.abs() < 0.02 && with_windows.contains(&t[0].finish.surface)
                });
                assert!(behind.is_none(), "{behind:?} behind a door at {at}");
            }
        }
    }
    assert!(doors > 60, "{doors}");
}

/// Also under tracks, and between lanes that run side by side.
#[test]
fn every_lane_lies_on_asphalt_from_edge_to_edge() {
    let map = city();
    let scene = SceneDescription::from_map(&map);
    for error_m in roads::LEVELS.into_iter().chain([wear::SEEN_M]) {
        let paved = level_triangles(&scene, Surface::Asphalt, error_m);
        let squares = by_square(&paved);
        for lane in &map.lanes {
            let half = f64::from(lane.width_m as f32) / 2.0;
            for (_, point) in lane.curve.sample(2.0) {
                for left in [-half, 0.05 - half, 0.5 - half, -0.5, 0.0, half - 0.51, half - 0.01, half] {
                    let at = point.pose.point_at(0.0, left).as_vec2();
                    let near = squares.get(&square_of(at)).into_iter().flatten();
                    let is_paved = near.into_iter().any(|t| covers(t, at));
                    assert!(
                        is_paved,
                        "{} lies bare at {at}, {left} m from its middle, within {error_m}",
                        lane.name
                    );
                }
            }
        }
    }
}

/// Else they flicker where they overlap.
#[test]
fn tracks_on_one_another_differ_in_height() {
    let scene = SceneDescription::from_map(&city());
    let meshes = scene.ground.iter().map(|object| &object.levels[0].mesh);
    let flat: Vec<(f32, [Vec2; 3])> = meshes
        .flat_map(|mesh| {
            let lanes =
                mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]));
            let lanes = lanes.filter(|corners| corners[0].finish.surface == Surface::Lane);
            lanes
                .map(|corners| (corners[0].position.z, corners.map(|v| v.position.truncate())))
                .collect::<Vec<_>>()
        })
        .collect();
    let squares = by_square(&flat.iter().map(|(_, corners)| *corners).collect::<Vec<_>>());
    let height_of: BTreeMap<[u32; 6], f32> = flat.iter().map(|&(z, corners)| (key_of(corners), z)).collect();
    let mut laps = 0;
    for &(z, corners) in &flat {
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        for other in squares.get(&square_of(middle)).into_iter().flatten().filter(|other| **other != corners)
        {
            if covers(other, middle) {
                laps += 1;
                let apart = (height_of[&key_of(*other)] - z).abs();
                assert!(apart > 0.0003, "tracks at {middle} lie {apart} m over one another");
            }
        }
        assert!(z < wear::PATCH_M - 0.0003, "tracks at {middle} lie over patches, {z} m");
    }
    assert!(laps > 50, "{laps}");
}

fn key_of(corners: [Vec2; 3]) -> [u32; 6] {
    let [a, b, c] = corners.map(|p| p.to_array().map(f32::to_bits));
    [a[0], a[1], b[0], b[1], c[0], c[1]]
}

/// Leaves thin out towards the silhouette of round objects; the side of a hedge, seen along the road, would
/// vanish.
#[test]
fn faces_of_hedges_are_flat() {
    let shape =
        city3d_roadmap::Footprint::Polyline(vec![DVec2::ZERO, DVec2::new(9.0, 2.0), DVec2::new(12.0, 9.0)]);
    let mut piece = city().scenery.iter().find(|piece| piece.kind == SceneryKind::Hedge).unwrap().clone();
    piece.shape = shape;
    for level in plants::hedge(&SeededScenery { piece: &piece, seed: 7 }, &[], &|_| true).levels {
        for t in level.mesh.indices.chunks_exact(3) {
            let [a, b, c] = [t[0], t[1], t[2]].map(|k| level.mesh.vertices[k as usize]);
            assert!(a.normal == b.normal && b.normal == c.normal, "{a:?} {b:?} {c:?}");
            let face = (b.position - a.position).cross(c.position - a.position);
            assert!(face.normalize_or_zero().dot(a.normal) > 0.7, "turned inside out: {a:?} {b:?} {c:?}");
        }
    }
}

fn square_of(at: Vec2) -> [i32; 2] {
    (at / 4.0).floor().as_ivec2().to_array()
}

/// Triangles by the squares that their boxes touch.
fn by_square(triangles: &[[Vec2; 3]]) -> BTreeMap<[i32; 2], Vec<[Vec2; 3]>> {
    let mut squares: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for triangle in triangles {
        let [a, b, c] = *triangle;
        let ([west, south], [east, north]) = (square_of(a.min(b).min(c)), square_of(a.max(b).max(c)));
        for x in west..=east {
            for y in south..=north {
                squares.entry([x, y]).or_default().push(*triangle);
            }
        }
    }
    squares
}

#[test]
fn yellow_lines_keep_to_the_middle_between_directions() {
    let map = city();
    let field = roads::RoadField::new(&map);
    let mesh = markings::RoadMarkings::new(&map, &field, &lanes::LaneBoxIndex::new(&map), &[]).mesh(0.0);
    let yellow = mesh.vertices.iter().filter(|v| v.finish.colour[2] < 100);
    let mut count = 0;
    for vertex in yellow {
        let at: DVec2 = vertex.position.truncate().as_dvec2();
        for lane in map.lanes.iter().filter(|lane| lane.kind == LaneKind::Lane) {
            let far = lane.curve.at(lane.curve.project(at).s).pose.position.distance(at);
            assert!(far > 0.33 * lane.width_m, "yellow at {at}, {far} m from the middle of {}", lane.name);
        }
        count += 1;
    }
    assert!(count > 1000, "{count} corners of yellow lines");
}

#[test]
fn what_is_planted_or_set_up_stands_behind_the_kerb() {
    let map = city();
    let field = roads::RoadField::new(&map);
    let mut found = Vec::new();
    for piece in &map.scenery {
        // From the middle or the line to its outside.
        let half_m = match piece.kind {
            SceneryKind::Hedge => 0.5,
            SceneryKind::Tree => 0.3,
            SceneryKind::Wall | SceneryKind::Lamp | SceneryKind::Bench | SceneryKind::PicnicTable => 0.15,
            SceneryKind::Building => 0.0,
            _ => continue,
        };
        let points: Vec<DVec2> = match &piece.shape {
            Footprint::Circle { centre, .. } => vec![*centre],
            Footprint::Polygon(line) | Footprint::Polyline(line) => line
                .windows(2)
                .flat_map(|pair| (0..=8).map(|k| pair[0].lerp(pair[1], f64::from(k) / 8.0)))
                .collect(),
        };
        let away = |p: &DVec2| f64::from(field.distance.at(*p)) - half_m;
        if let Some(nearest) = points.iter().min_by(|a, b| away(a).total_cmp(&away(b)))
            && away(nearest) < f64::from(roads::SHOULDER_M) + kerbs::WIDTH_M
        {
            let (kind, name, away) = (piece.kind, &piece.name, away(nearest));
            found.push(format!("{kind:?} {name} at {nearest:.2}: {away:.2} m"));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn no_strip_of_grass_is_left_between_pavements_and_what_else_is_paved() {
    let map = city();
    let scene = SceneDescription::from_map(&map);
    let mut paved = Vec::new();
    for mesh in scene.ground.iter().map(|object| &object.levels[0].mesh) {
        for t in mesh.indices.chunks_exact(3) {
            let corners = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
            if corners.iter().all(|v| v.normal.z > 0.3 && v.finish.class != Class::Grass) {
                paved.push(corners.map(|v| v.position.truncate()));
            }
        }
    }
    let paved = by_square(&paved);
    let is_paved = |p: DVec2| {
        let p = p.as_vec2();
        paved.get(&square_of(p)).is_some_and(|near| near.iter().any(|t| covers(t, p)))
    };
    let mut looked = 0;
    for piece in &map.scenery {
        let (SceneryKind::Paving, Footprint::Polygon(ring)) = (piece.kind, &piece.shape) else { continue };
        let ring = polygon::counter_clockwise(ring);
        for (k, &from) in ring.iter().enumerate() {
            let to = ring[(k + 1) % ring.len()];
            let out = -(to - from).normalize().perp();
            for part in 1..20 {
                let at = from.lerp(to, f64::from(part) / 20.0);
                let beside = [0.2, 0.4, 0.6, 0.8].map(|away| is_paved(at + out * away));
                looked += 1;
                // The grid is no finer than a quarter of a metre.
                let gaps = beside.iter().filter(|is_paved| !**is_paved).count();
                assert!(!beside[3] || gaps < 2, "{} at {at:.2}: {beside:?}", piece.name);
            }
        }
    }
    assert!(looked > 300, "{looked}");
}

#[test]
fn bars_and_lines_of_paint_lie_one_over_the_other() {
    let map = city();
    let scene = SceneDescription::from_map(&map);
    for level in &scene.ground[1].levels {
        let heights = |surface: Surface| -> Vec<f32> {
            let mut heights: Vec<f32> = level
                .mesh
                .vertices
                .iter()
                .filter(|v| v.finish.surface == surface)
                .map(|v| v.position.z)
                .collect();
            heights.sort_by(f32::total_cmp);
            heights.dedup();
            heights
        };
        let (lines, figures) = (heights(Surface::Line), heights(Surface::Paint));
        // From afar some of the figures are lines, under the others.
        assert_eq!(lines.len(), if level.error_m < 0.10 { 1 } else { 2 }, "{lines:?}");
        assert!(lines.windows(2).all(|pair| pair[1] - pair[0] > 0.0015), "{lines:?}");
        assert!(figures.iter().all(|z| *z > lines[lines.len() - 1] + 0.004), "{figures:?} over {lines:?}");
    }
}

#[test]
fn nothing_solid_stands_on_a_lane_and_all_numbers_are_finite() {
    let map = city();
    let scene = SceneDescription::from_map(&map);
    let solid = [Class::Building, Class::Wall, Class::Pole, Class::Furniture];
    for v in scene.meshes().flat_map(|mesh| &mesh.vertices) {
        assert!(v.position.is_finite() && v.normal.is_finite() && v.uv.is_finite(), "{v:?}");
        let low = v.position.z < 2.5;
        if low && solid.contains(&v.finish.class) {
            let at = v.position.truncate().as_dvec2();
            for lane in &map.lanes {
                let far = lane.curve.at(lane.curve.project(at).s).pose.position.distance(at);
                assert!(far > 1.5, "{:?} at {at}, {far} m from {}", v.finish.class, lane.name);
            }
        }
    }
}

/// Triangles are what a software adapter is slowest with.
#[test]
fn the_city_keeps_to_its_budget_of_triangles() {
    let scene = SceneDescription::from_map(&city());
    let [low, high] = scene.bounds.map(Vec3::truncate);
    // The land and the gardens around the town have a budget of their own.
    let within = |margin_m: f32| {
        move |object: &&SceneObject| {
            let [from, to] = object.levels[0].mesh.bounds().map(Vec3::truncate);
            from.cmpgt(low - margin_m).all() && to.cmplt(high + margin_m).all()
        }
    };
    let all = || {
        let ground = scene.ground.iter().filter(within(2.0 * CELL_M));
        ground.chain(scene.objects.iter().filter(within(1.0)))
    };
    // So have people: there are many, and few are near.
    let is_person = |object: &SceneObject| {
        object.levels[0].mesh.vertices.first().is_some_and(|v| v.finish.class == Class::Person)
    };
    // And so has what is no longer drawn from afar, and in `low` near by only.
    let is_small = |object: &SceneObject| object.levels.last().is_some_and(|level| level.mesh.is_empty());
    // Near levels of parked cars are those of moving ones.
    let has_near_level = |object: &SceneObject| {
        object.levels[0].mesh.vertices.first().is_some_and(|v| v.finish.class == Class::Vehicle)
    };
    let kind_of = |object: &SceneObject| match (is_person(object), is_small(object)) {
        _ if has_near_level(object) => 3,
        (true, _) => 1,
        (false, true) => 2,
        (false, false) => 0,
    };
    // And so have the levels of trees and people that are drawn from a few metres away.
    let is_leaf_overhead = |v: &Vertex| v.finish.surface == Surface::Leaves && v.position.z > 2.5;
    let has_near_level = |object: &&SceneObject| {
        is_person(object)
            || object.levels.len() > 1 && object.levels[0].mesh.vertices.iter().any(is_leaf_overhead)
    };
    let nearest = |object: &SceneObject| object.levels[0].mesh.triangle_count();
    let near_by: usize = all().filter(has_near_level).map(nearest).sum();
    assert!(near_by < 560_000, "{near_by} of trees and people near by");
    let budget = |kind: u32| {
        let objects = || all().filter(|object| kind_of(object) == kind);
        let usual =
            |object: &SceneObject| object.levels[usize::from(has_near_level(&object))].mesh.triangle_count();
        let finest: usize = objects().map(usual).sum();
        let last = objects().filter_map(|object| object.levels.last());
        let coarsest: usize = last.map(|level| level.mesh.triangle_count()).sum();
        [finest, coarsest]
    };
    let ([finest, coarsest], [near, far], [small, _]) = (budget(0), budget(1), budget(2));
    assert!(finest < 145_000 && coarsest < 30_000, "{finest} in full, {coarsest} at their coarsest");
    assert!(small < 45_000, "{small} of small things");
    let [near_cars, far_cars] = budget(3);
    assert!(
        near_cars < 220_000 && far_cars < 2_000,
        "parked cars: {near_cars} in full, {far_cars} from afar"
    );
    assert!(near < 65_000 && far < 5_000, "people: {near} in full, {far} at their coarsest");
    for object in all() {
        for pair in object.levels.windows(2) {
            assert!(pair[1].mesh.triangle_count() <= pair[0].mesh.triangle_count());
            assert!(pair[1].error_m > pair[0].error_m);
        }
    }
}

#[test]
fn the_same_map_gives_the_same_scene() {
    let map = city();
    assert!(SceneDescription::from_map(&map) == SceneDescription::from_map(&map));
}

#[test]
fn faces_of_many_corners_stay_in_their_outline() {
    let mut mesh = Mesh::default();
    let finish = Finish::new(Surface::Plain, [255; 3], Class::Building);
    mesh.frustum(Vec3::ZERO, [1.0, 0.8], 2.0, 20, finish);
    mesh.block(Vec3::new(50.0, 0.0, 0.0), Vec3::ONE, 0.3, finish);
    for t in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position);
        assert!(a.distance(b).max(b.distance(c)).max(c.distance(a)) < 3.0, "a spike from {a} to {b} and {c}");
    }
}

#[test]
fn awnings_hang_above_heads_and_nothing_goes_through_them() {
    const HEADS_M: f32 = 2.0;
    let map = city();
    let scene = SceneDescription::from_map(&map);
    let mut cloths = 0;
    for mesh in scene.objects.iter().map(|object| &object.levels[0].mesh) {
        for t in mesh.indices.chunks_exact(3) {
            let corners = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
            if corners[0].finish.surface != Surface::Awning {
                continue;
            }
            cloths += 1;
            assert!(corners.iter().all(|v| v.position.z > HEADS_M), "{:?}", corners[0].position);
            let seen = corners.map(|v| v.position.truncate());
            for piece in &map.scenery {
                let at = props::middle(&piece.shape);
                let stands = matches!(piece.kind, SceneryKind::Tree | SceneryKind::Lamp);
                assert!(!stands || !covers(&seen, at), "{:?} at {at} through an awning", piece.kind);
            }
        }
    }
    assert!(cloths > 20, "{cloths} triangles of awnings");
}

#[test]
fn coarser_levels_keep_to_their_error() {
    /// Limbs of coarser people begin inside of the body.
    const INSIDE_M: f32 = 0.03;
    /// Rounding of coordinates at 100 m.
    const ROUNDED_M: f32 = 2e-5;
    let scene = SceneDescription::from_map(&city());
    let (mut levels, mut wrong) = (0, Vec::new());
    let [from, to] = scene.bounds.map(Vec3::truncate);
    for object in &scene.objects {
        // Details of the near level of cars count for no error.
        let is_car = object.levels[0].mesh.vertices.first().is_some_and(|v| v.finish.class == Class::Vehicle);
        let nearest = usize::from(is_car);
        let finest = &object.levels[nearest].mesh;
        let [low, high] = finest.bounds();
        // Plants of the land are far from all cameras: their errors are those of heights, see `land::tests`.
        let is_outside = low.truncate().cmpgt(to).any() || high.truncate().cmplt(from).any();
        if is_outside && finest.vertices.first().is_some_and(|v| v.finish.class == Class::Vegetation) {
            continue;
        }
        let is_tree = finest.vertices.iter().any(|v| {
            matches!(v.finish.surface, Surface::Leaves | Surface::Needles) && v.position.z > low.z + 2.5
        });
        let bridged_m = if is_tree { trees::BRIDGED * (high - low).truncate().max_element() } else { 0.0 };
        let is_person = finest.vertices.first().is_some_and(|v| v.finish.class == Class::Person);
        let inside_m = if is_person { INSIDE_M } else { 0.0 };
        // What is no longer drawn has no corners.
        for level in object.levels.iter().skip(1 + nearest).filter(|level| !level.mesh.is_empty()) {
            let name = format!("{:?} at {}", finest.vertices[0].finish.class, finest.vertices[0].position);
            let (error_m, outline_m) = (level.error_m, finest.outline_apart(&level.mesh));
            if outline_m > error_m {
                wrong.push(format!("{name}: outlines differ by {outline_m} m of {error_m}"));
            }
            let step = (level.mesh.vertices.len() / 48).max(1);
            let points = level.mesh.vertices.iter().step_by(step).map(|v| v.position);
            let off_m = points.map(|p| finest.distance_to(p)).fold(0.0, f32::max);
            if off_m > error_m + bridged_m + inside_m + ROUNDED_M {
                wrong.push(format!("{name}: a corner lies off by {off_m} m of {error_m}"));
            }
            levels += 1;
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(levels > 800, "{levels} coarser levels");
}

#[test]
fn a_model_is_in_memory_once_however_often_the_map_places_it() {
    let bytes = city3d_models::shipped("sedan.glb").unwrap();
    let model = Arc::new(city3d_models::glb::read(bytes).unwrap());
    let models = BTreeMap::from([("sedan.glb".to_owned(), model)]);
    let with = |count: u32| {
        let mut map = city();
        map.scenery.clear();
        let place = |k: u32| PlacedModel {
            file: "sedan.glb".to_owned(),
            at: DVec2::new(f64::from(k % 50), f64::from(k / 50)),
            front_rad: 0.1 * f64::from(k),
            size: 4.0,
            line: 0,
        };
        map.models = (0..count).map(place).collect();
        SceneDescription::with_models(&map, &models)
    };
    let vertices = |scene: &SceneDescription| scene.meshes().map(|mesh| mesh.vertices.len()).sum::<usize>();
    let (one, many) = (with(1), with(2000));
    assert_eq!(vertices(&one), vertices(&many));
    let placed = |scene: &SceneDescription| -> usize {
        scene.instanced.iter().map(|model| model.instances.len()).sum()
    };
    // The others are people.
    assert_eq!(placed(&many) - placed(&one), 1999);
}
