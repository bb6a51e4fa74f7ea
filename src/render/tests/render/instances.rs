//! Models of the map: one mesh at many places, and what it looks like there.

use crate::drawing::software;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::{Daylight, Pictures, Quality, RenderRequest, Renderer, Settings};
use city3d_scene::{Class, Finish, InstancedObject, Mesh, SceneDescription, SceneObject, Surface, Vertex};
use city3d_sensors::{Extrinsics, Lens, PictureKind, PictureKinds, View};
use glam::{Affine3A, DVec3, Quat, Vec3};

fn all_kinds() -> PictureKinds {
    PictureKind::ALL.into_iter().fold(PictureKinds::NONE, PictureKinds::with)
}

fn plain() -> SceneDescription {
    let mut mesh = Mesh::default();
    let ground = Finish::new(Surface::Plain, [90; 3], Class::Road);
    let ring = [(-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)];
    mesh.plate(&ring.map(|(x, y)| Vec3::new(x, y, 0.0)), ground, 1.0);
    SceneDescription {
        ground: vec![SceneObject::of_one_level(mesh)],
        bounds: [Vec3::new(-60.0, -60.0, 0.0), Vec3::new(60.0, 60.0, 10.0)],
        ..SceneDescription::default()
    }
}

/// A house with windows, and a tree crown beside it, which a pipeline of its own draws.
fn house() -> Mesh {
    let mut mesh = Mesh::default();
    let finish = |surface, class| Finish::new(surface, [200, 150, 120], class);
    mesh.block(Vec3::ZERO, Vec3::new(4.0, 3.0, 3.0), 0.0, finish(Surface::Windows, Class::Building));
    let crown = finish(Surface::Leaves, Class::Vegetation);
    mesh.frustum(Vec3::new(3.5, 0.0, 0.0), [1.0, 0.5], 2.5, 12, crown);
    mesh
}

fn places() -> Vec<Affine3A> {
    let place = |scale: f32, yaw_rad: f32, x: f32, y: f32| {
        let turn = Quat::from_rotation_z(yaw_rad);
        Affine3A::from_scale_rotation_translation(Vec3::splat(scale), turn, Vec3::new(x, y, 0.0))
    };
    vec![place(1.0, 0.3, 8.0, 3.0), place(0.7, 2.0, 6.0, -4.0), place(1.6, -1.1, 20.0, -1.0)]
}

/// The mesh of an object at a place.
fn moved(mesh: &Mesh, place: &Affine3A) -> SceneObject {
    let vertex = |v: &Vertex| Vertex {
        position: place.transform_point3(v.position),
        normal: place.transform_vector3(v.normal).normalize_or(Vec3::Z),
        ..*v
    };
    let vertices = mesh.vertices.iter().map(vertex).collect();
    SceneObject::of_one_level(Mesh { vertices, indices: mesh.indices.clone() })
}

#[test]
fn instances_look_as_if_each_had_a_mesh_of_its_own() {
    let Some(context) = software() else { return };
    let places = places();
    let object = SceneObject::of_one_level(house());
    let instanced = SceneDescription {
        instanced: vec![InstancedObject { object, instances: places.clone() }],
        ..plain()
    };
    let objects = places.iter().map(|place| moved(&house(), place)).collect();
    let baked = SceneDescription { objects, ..plain() };
    let lens = Lens { extent: [160, 120], ..Lens::default() };
    let eye = DVec3::new(-6.0, 1.0, 3.0);
    let view = View::new(Extrinsics::looking_at(eye, DVec3::new(9.0, 0.0, 1.0)), &lens);
    let request = RenderRequest { view, kinds: all_kinds() };
    for quality in [Quality::LOW, Quality::MEDIUM] {
        for daylight in [Daylight::NOON, Daylight::NIGHT] {
            let quality = Quality { shadow_texels: 1024, ..quality };
            let settings = Settings { quality, daylight, ..Settings::default() };
            let [own, one] = [&instanced, &baked].map(|scene| {
                let mut renderer = Renderer::new(&context, scene, settings).unwrap();
                let request = std::slice::from_ref(&request);
                renderer.render_kinds(&FrameSnapshot::default(), request).unwrap().remove(0)
            });
            assert!(share_that_differs(&own, &one) < 0.003, "{:?}", share_that_differs(&own, &one));
        }
    }
}

/// Share of the pixels that differ in any kind.
fn share_that_differs(a: &Pictures, b: &Pictures) -> f64 {
    let (rgb, classes, depth) = (
        a.rgb.as_ref().unwrap().rgb.chunks(3).zip(b.rgb.as_ref().unwrap().rgb.chunks(3)),
        a.semantic.as_ref().unwrap().values.iter().zip(&b.semantic.as_ref().unwrap().values),
        a.depth.as_ref().unwrap().values.iter().zip(&b.depth.as_ref().unwrap().values),
    );
    let pixels = rgb.zip(classes).zip(depth);
    let count = pixels.len() as f64;
    let differs = pixels.filter(|(((p, q), (c, d)), (m, n))| {
        c != d || (**m - **n).abs() > 0.01 || p.iter().zip(*q).any(|(p, q)| p.abs_diff(*q) > 8)
    });
    differs.count() as f64 / count
}

#[test]
fn ten_thousand_copies_of_a_large_model_are_drawn() {
    let Some(context) = software() else { return };
    // 40,000 vertices are 1.3 MB: 13 GB, if each copy had its own.
    let mut mesh = Mesh::default();
    let finish = Finish::new(Surface::Plain, [200, 60, 60], Class::Building);
    for k in 0..2000 {
        mesh.block(Vec3::new(0.0, 0.0, 0.001 * k as f32), Vec3::splat(1.0), 0.0, finish);
    }
    // One in front of the camera, and the others behind it, where they cast no shadow on the city.
    let place = |k: u32| Vec3::new(if k == 0 { 8.0 } else { -100.0 - k as f32 }, 0.0, 0.0);
    let instances = (0..10_000).map(|k| Affine3A::from_translation(place(k))).collect();
    let object = SceneObject::of_one_level(mesh);
    let scene = SceneDescription { instanced: vec![InstancedObject { object, instances }], ..plain() };
    let lens = Lens { extent: [64, 48], ..Lens::default() };
    let eye = DVec3::new(0.0, 0.0, 1.5);
    let view = View::new(Extrinsics::looking_at(eye, DVec3::new(8.0, 0.0, 0.5)), &lens);
    let quality = Quality { shadow_texels: 1024, ..Quality::LOW };
    let mut renderer = Renderer::new(&context, &scene, Settings { quality, ..Settings::default() }).unwrap();
    let request = RenderRequest { view, kinds: all_kinds() };
    let pictures = renderer.render_kinds(&FrameSnapshot::default(), &[request]).unwrap();
    let classes = &pictures[0].semantic.as_ref().unwrap().values;
    assert_eq!(classes[classes.len() / 2 + 32], Class::Building as u8);
    // Its own triangles and the ground's, and nothing of the others.
    assert!((20_000..21_000).contains(&renderer.triangles()), "{}", renderer.triangles());
}
