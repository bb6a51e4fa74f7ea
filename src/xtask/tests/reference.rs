//! What `cargo xtask reference` exports for a path tracer, without one.
#![allow(clippy::disallowed_methods, reason = "looks at what is drawn; no state depends on it")]

use city3d_render::{SceneLight, SurfaceTexture};
use city3d_scene::{Class, SceneDescription, Surface};
use city3d_simulation::runner::Run;
use glam::{DVec2, Vec2, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;
use xtask::reference::{CAMERAS, Group, GroupKey, TIMES, experiment, groups, lights};

/// The exported city, its bounds, and the number of its vehicles.
fn exported() -> (BTreeMap<GroupKey, Group>, [Vec3; 2], usize) {
    let experiment = experiment().expect("the scenario");
    let scene = SceneDescription::with_models(&experiment.city_map, &experiment.models.placed);
    let models = experiment.models.vehicles.clone();
    let snapshot = Run::new(Arc::new(experiment)).expect("a run").snapshot().clone();
    (groups(&scene, &snapshot, &models), scene.bounds, snapshot.vehicles.len())
}

/// Whether a triangle covers a point of the plan.
fn covers([a, b, c]: [Vec3; 3], at: Vec2) -> bool {
    let side = |p: Vec3, q: Vec3| (q - p).truncate().perp_dot(at - p.truncate());
    let sides = [side(a, b), side(b, c), side(c, a)];
    sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s <= 0.0)
}

#[test]
fn the_export_covers_the_ground_and_its_colours_and_normals_are_those_of_light_and_surfaces() {
    let (groups, [low, high], vehicles) = exported();
    for (key, group) in &groups {
        let whole = group.indices.len() % 3 == 0 && !group.indices.is_empty();
        assert!(whole && group.indices.iter().all(|&k| (k as usize) < group.vertices.len()), "{key:?}");
        for vertex in &group.vertices {
            assert!(vertex.colour.iter().all(|c| (0.0..=1.0).contains(c)), "{key:?}: {vertex:?}");
            assert!((vertex.normal.length() - 1.0).abs() < 1e-3 && vertex.position.is_finite(), "{key:?}");
            assert!(vertex.uv.is_finite(), "{key:?}");
        }
    }
    // The ground has no hole: every place of a grid lies under a triangle of a class of the ground.
    let is_ground = |class: Class| {
        matches!(class, Class::Road | Class::Pavement | Class::Grass | Class::Water | Class::Vegetation)
    };
    let mut open: Vec<Vec2> = (0..40 * 40)
        .map(|k| DVec2::new(f64::from(k % 40) + 0.37, f64::from(k / 40) + 0.61) / 40.0)
        .map(|part| low.truncate() + (high - low).truncate() * part.as_vec2())
        .collect();
    for (_, group) in groups.iter().filter(|(key, _)| is_ground(key.class())) {
        for triangle in group.indices.chunks_exact(3) {
            let corners = [0, 1, 2].map(|k| group.vertices[triangle[k] as usize].position);
            let [from, to] = [
                corners.iter().fold(Vec3::INFINITY, |low, &at| low.min(at)).truncate(),
                corners.iter().fold(Vec3::NEG_INFINITY, |high, &at| high.max(at)).truncate(),
            ];
            open.retain(|&at| !(at.cmpge(from).all() && at.cmple(to).all() && covers(corners, at)));
        }
    }
    assert!(open.is_empty(), "nothing lies under {} places, first {}", open.len(), open[0]);
    // Each vehicle has a body and four wheels.
    let cars: usize =
        groups.iter().filter(|(key, _)| key.surface().is_none()).map(|(_, g)| g.indices.len() / 3).sum();
    assert!(vehicles > 0 && cars > 500 * vehicles, "{cars} triangles of {vehicles} vehicles");
}

#[test]
fn the_sun_is_that_of_the_renderer_and_above_the_horizon() {
    for ((name, settings, light), (time, daylight)) in lights().zip(TIMES) {
        assert_eq!((name, settings.daylight), (time, daylight));
        assert_eq!(light, SceneLight::new(&settings));
        // Solar noon is at 11, latitude 44 degrees, declination 4: the altitude of the sun by spherical trigonometry.
        let hour_angle = f64::from(daylight.hours - 11.0) * 15.0_f64.to_radians();
        let (latitude, declination) = (44.0_f64.to_radians(), 4.0_f64.to_radians());
        let sine = latitude.sin() * declination.sin() + latitude.cos() * declination.cos() * hour_angle.cos();
        assert!((f64::from(light.to_sun.z) - sine).abs() < 1e-4, "{name}: {} and {sine}", light.to_sun);
        assert!(light.to_sun.z > 0.1 && (light.to_sun.length() - 1.0).abs() < 1e-5, "{name}");
        // In the morning it is in the east.
        assert_eq!(light.to_sun.x > 0.0, daylight.hours < 11.0, "{name}: {}", light.to_sun);
        assert!(light.exposure > 0.0 && light.sun.iter().chain(&light.sky).all(|&c| c > 0.0), "{name}");
    }
}

#[test]
fn two_of_five_cameras_are_held_out_and_their_names_differ() {
    assert_eq!(CAMERAS.iter().filter(|camera| camera.is_held_out).count(), 2);
    let names: std::collections::BTreeSet<&str> = CAMERAS.iter().map(|camera| camera.name).collect();
    assert_eq!(names.len(), CAMERAS.len());
}

#[test]
fn textures_have_every_texel_and_glass_is_smoother_than_brick() {
    let [glass, brick] = [Surface::Glass, Surface::Brick].map(|surface| SurfaceTexture::new(surface as u8));
    for texture in [&glass, &brick] {
        assert_eq!(texture.rgba.len(), 4 * (texture.edge * texture.edge) as usize);
    }
    assert!(glass.rgba[3] < brick.rgba[3]);
}
