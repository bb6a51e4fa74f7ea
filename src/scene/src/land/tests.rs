use super::super::SceneDescription;
use super::super::ground_sheet::GRASS_M;
use super::super::mesh::Class;
use super::super::roads::{Outlines, SHOULDER_M};
use super::super::tests::city;
use super::*;
use city3d_geometry::{LengthScale, point_in_polygon};
use city3d_roadmap::{Footprint, Grid, SceneryKind, load_map};
use glam::Vec2;

fn grid(size: &str) -> CityMap {
    let grid = Grid { size: size.parse().unwrap(), block_m: 3.0, entry_m: 3.0, ..Grid::default() };
    load_map(grid.to_dxf().unwrap().as_bytes()).unwrap().map.to_city(LengthScale::TESTBED)
}

fn land_of(map: &CityMap) -> Land {
    let field = RoadField::new(map);
    let rim = Outlines::new(&field, &[]).ground(map, &[]).rim();
    Land::new(map, &field, rim, (roads_from(map, &field), &[]))
}

fn objects_of(map: &CityMap, land: &Land) -> Vec<SceneObject> {
    let field = RoadField::new(map);
    let around = Surroundings { map, field: &field };
    land.objects(&TreePrototypes::new(false), &LaneBoxIndex::new(map), &around)
}

#[test]
fn the_roads_out_of_a_map_are_those_that_are_drawn() {
    for map in [city(), grid("4x4")] {
        let drawn: Vec<_> = land_of(&map).roads.iter().map(|road| road.line.clone()).collect();
        let found: Vec<_> = roads_out(&map).iter().map(|road| road.line.clone()).collect();
        assert!(!drawn.is_empty());
        assert_eq!(found, drawn);
    }
}

/// Vehicles drive on a plane wherever they leave the road.
#[test]
fn the_land_is_level_near_the_town_and_rises_beyond() {
    for map in [city(), grid("3x2")] {
        let land = land_of(&map);
        let mesh = land.ground();
        let is_near = |at: Vec2| land.relief.away_m(at.as_dvec2()) < 60.0;
        let near: Vec<f32> =
            mesh.vertices.iter().filter(|v| is_near(v.position.truncate())).map(|v| v.position.z).collect();
        assert!(near.len() > 100 && near.iter().all(|z| *z == GRASS_M), "{} corners", near.len());
        let highest = mesh.vertices.iter().map(|v| v.position.z).fold(0.0, f32::max);
        assert!(highest > 60.0, "hills of {highest} m");
    }
}

#[test]
fn slopes_are_gentle() {
    let land = land_of(&city());
    let mesh = land.ground();
    let is_near = |at: Vec2| land.relief.away_m(at.as_dvec2()) < 1500.0;
    for v in mesh.vertices.iter().filter(|v| is_near(v.position.truncate())) {
        assert!(v.normal.z > 0.94, "a slope of {} at {}", v.normal, v.position);
    }
}

/// Triangles of asphalt seen from above.
fn asphalt(mesh: &Mesh) -> Vec<[DVec2; 3]> {
    let corners = |t: &[u32]| [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
    let paved = mesh.indices.chunks_exact(3).map(corners).filter(|t| t[0].finish.class == Class::Road);
    paved.map(|t| t.map(|v| v.position.truncate().as_dvec2())).collect()
}

#[test]
fn roads_lead_from_the_streets_into_the_land_without_a_gap() {
    for (name, map, count) in [("city", city(), 2..=3), ("3x2", grid("3x2"), 10..=10)] {
        let field = RoadField::new(&map);
        let land = land_of(&map);
        assert!(count.contains(&land.roads.len()), "{name}: {} roads", land.roads.len());
        let mut laid = Mesh::default();
        land.lay(&mut laid);
        let paved = [asphalt(&land.ground()), asphalt(&laid)].concat();
        for road in &land.roads {
            assert!(field.distance.at(road.approach[0]) <= SHOULDER_M, "{name}: begins beside the street");
            let end = road.line[road.line.len() - 1];
            assert!(land.relief.away_m(end) > 1500.0, "{name}: ends at {end}");
            for pair in road.approach.windows(2).chain(road.line.windows(2)) {
                let steps = (pair[0].distance(pair[1]) / 3.0).ceil() as u32;
                for at in (0..=steps).map(|k| pair[0].lerp(pair[1], f64::from(k) / f64::from(steps.max(1)))) {
                    let left = (pair[1] - pair[0]).normalize().perp() * 0.6 * road.half_m;
                    for at in [at - left, at, at + left] {
                        let is_bare = !paved.iter().any(|t| covers(t, at)) && at.distance(end) > 5.0;
                        assert!(!is_bare, "{name}: no asphalt at {at}");
                    }
                }
            }
        }
    }
}

/// Height of the highest triangle over a place.
fn top_of(mesh: &Mesh, at: DVec2) -> Option<f64> {
    let corners = |t: &[u32]| [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position.as_dvec3());
    let heights = mesh.indices.chunks_exact(3).map(corners).filter_map(|[a, b, c]| {
        let flat = [a, b, c].map(|corner| corner.truncate());
        let area = (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]);
        let share = |p: DVec2, q: DVec2| (p - at).perp_dot(q - at) / area;
        let shares = [share(flat[1], flat[2]), share(flat[2], flat[0]), share(flat[0], flat[1])];
        let is_over = area > 1e-9 && shares.iter().all(|share| *share >= 0.0);
        is_over.then(|| a.z * shares[0] + b.z * shares[1] + c.z * shares[2])
    });
    heights.reduce(f64::max)
}

/// Neither the kerb nor the pavement of the street comes through the asphalt of a road that leaves it.
#[test]
fn mouths_of_country_roads_cover_the_kerb_and_the_pavement() {
    let map = city();
    let field = RoadField::new(&map);
    let roads = roads_from(&map, &field);
    let mouths: Vec<Footprint> = roads.iter().map(CountryRoad::driveway).collect();
    let sheet = Outlines::new(&field, &[]).ground(&map, &mouths.iter().collect::<Vec<_>>());
    let ground = sheet.mesh(0.0);
    for road in &roads {
        let mut mouth = Mesh::default();
        road.approach_mesh(&mut mouth);
        let mut looked = 0;
        for [a, b, c] in asphalt(&mouth) {
            for shares in [[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8], [0.34, 0.33, 0.33]] {
                let at = a * shares[0] + b * shares[1] + c * shares[2];
                let (Some(over), Some(under)) = (top_of(&mouth, at), top_of(&ground, at)) else { continue };
                assert!(over > under + 0.002, "{under} m comes through {over} m at {at}");
                looked += 1;
            }
        }
        assert!(looked > 400, "{looked}");
    }
}

/// To within 2 cm.
fn covers(t: &[DVec2; 3], at: DVec2) -> bool {
    let edge = |k: usize| (t[(k + 1) % 3] - t[k]).normalize_or_zero().perp_dot(at - t[k]);
    (0..3).all(|k| edge(k) >= -0.02)
}

#[test]
fn coarser_plants_of_the_land_are_as_tall_within_their_error() {
    let map = city();
    let land = land_of(&map);
    let mut levels = 0;
    for object in objects_of(&map, &land) {
        let tops = |mesh: &Mesh| mesh.bounds().map(|corner| corner.z);
        let [low, high] = tops(&object.levels[0].mesh);
        for level in object.levels[1..].iter().filter(|level| !level.mesh.is_empty()) {
            let [from, to] = tops(&level.mesh);
            // Feet are below the ground.
            assert!((high - to).abs() < level.error_m, "{high} m, {to} m with an error of {}", level.error_m);
            assert!(from > low - level.error_m, "{low} m, {from} m with an error of {}", level.error_m);
            levels += 1;
        }
        assert!(object.levels.windows(2).all(|pair| pair[0].error_m < pair[1].error_m));
    }
    assert!(levels > 1000, "{levels}");
}

#[test]
fn nothing_of_the_land_stands_on_a_road_or_in_the_town() {
    for map in [city(), grid("3x2")] {
        let land = land_of(&map);
        let field = RoadField::new(&map);
        let mut plants = 0;
        for object in objects_of(&map, &land) {
            for v in object.levels.iter().flat_map(|level| &level.mesh.vertices) {
                let at = v.position.truncate().as_dvec2();
                for road in &land.roads {
                    let off_m = road.distance_m(at, 20.0) - road.half_m;
                    assert!(off_m > 0.5, "{:?} at {at}, {off_m} m beside a road", v.finish.class);
                }
                assert!(
                    !field.distance.at(at).is_finite(),
                    "{:?} at {at} stands in the town",
                    v.finish.class
                );
                plants += usize::from(v.finish.class == Class::Vegetation);
            }
        }
        assert!(plants > 10_000, "{plants}");
    }
}

#[test]
fn houses_have_gardens_that_touch_nothing_else() {
    let map = city();
    let (land, field) = (land_of(&map), RoadField::new(&map));
    assert!(land.gardens.len() > 25, "{} gardens", land.gardens.len());
    let mut laid = Mesh::default();
    land.gardens.iter().for_each(|garden| garden.ground(&mut laid));
    let buildings: Vec<&Vec<DVec2>> = map
        .scenery
        .iter()
        .filter(|piece| piece.kind == SceneryKind::Building)
        .filter_map(|piece| match &piece.shape {
            Footprint::Polygon(ring) => Some(ring),
            _ => None,
        })
        .collect();
    for t in laid.indices.chunks_exact(3) {
        let middle =
            t.iter().map(|&k| laid.vertices[k as usize].position.truncate().as_dvec2()).sum::<DVec2>() / 3.0;
        assert!(f64::from(field.distance.at(middle)) > 2.0, "a garden on the road at {middle}");
        assert!(
            !buildings.iter().any(|ring| point_in_polygon(middle, ring)),
            "a garden in a house at {middle}"
        );
        let owners = land.gardens.iter().filter(|garden| garden.contains(middle)).count();
        assert_eq!(owners, 1, "gardens at {middle}");
    }
    let fences: Vec<SceneObject> = land.gardens(&TreePrototypes::new(false));
    let has = |class| {
        fences.iter().any(|object| object.levels[0].mesh.vertices.iter().any(|v| v.finish.class == class))
    };
    assert!([Class::Wall, Class::Building, Class::Vegetation].into_iter().all(has), "fences, sheds, hedges");
}

#[test]
fn farms_stand_in_level_yards_beside_the_roads() {
    let map = city();
    let land = land_of(&map);
    assert!(land.farms.len() >= 2, "{} farms", land.farms.len());
    for farm in &land.farms {
        let nearest =
            land.roads.iter().map(|road| road.distance_m(farm.yard.at, 60.0)).fold(f64::INFINITY, f64::min);
        assert!(nearest < 45.0, "{nearest} m to a road");
        let ground = land.ground();
        let inside = |v: &&super::super::mesh::Vertex| {
            v.position.truncate().as_dvec2().distance(farm.yard.at) < farm.yard.radius_m + 0.01
        };
        for v in ground.vertices.iter().filter(inside) {
            assert!((f64::from(v.position.z) - farm.yard.height_m).abs() < 0.01, "{}", v.position);
        }
    }
}

/// Triangles are what a software adapter is slowest with.
#[test]
fn the_land_keeps_to_its_budget_of_triangles() {
    for map in [city(), grid("3x2")] {
        let land = land_of(&map);
        let ground = land.ground().triangle_count();
        assert!(ground < 16_000, "{ground} of the ground");
        let objects = [land.gardens(&TreePrototypes::new(false)), objects_of(&map, &land)].concat();
        let count = |level: fn(&SceneObject) -> usize| objects.iter().map(level).sum::<usize>();
        let finest = count(|object| object.levels[0].mesh.triangle_count());
        let coarsest = count(|object| object.levels[object.levels.len() - 1].mesh.triangle_count());
        assert!(finest < 120_000 && coarsest < 70_000, "{finest} in full, {coarsest} at their coarsest");
        assert!(objects.len() < 1600, "{} objects", objects.len());
    }
}

/// Shadows and lamps keep to the town, whose bounds are those of its map.
#[test]
fn the_town_ends_where_it_did() {
    let map = city();
    let scene = SceneDescription::from_map(&map);
    let [low, high] = map.bounds().map(|corner| corner.as_vec2());
    assert_eq!([low, high], scene.bounds.map(|corner| corner.truncate()));
    assert!(scene.bounds[1].z < 60.0, "{}", scene.bounds[1].z);
}
