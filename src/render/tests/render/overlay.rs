//! Overlays over pictures, and depth, classes and instances in colours.

use crate::drawing::software;
use city3d_protocol::snapshot::{
    Appearance, Dimensions, FrameSnapshot, VehicleId, VehicleInfo, VehicleState,
};
use city3d_render::{
    Context, Image, Overlay, OverlayPaint, Quality, Renderer, Settings, TargetView, instance_colour,
    read_texture,
};
use city3d_scene::{Class, Finish, Mesh, SceneDescription, SceneObject, Surface};
use city3d_sensors::{Extrinsics, Lens, PictureKind, View};
use glam::{DVec3, Vec3};
use std::sync::Arc;

const EXTENT: [u32; 2] = [160, 120];
const RED: [u8; 4] = [255, 0, 0, 255];

/// A grey plain with a wall across it, 4 m high, of another class.
fn scene() -> SceneDescription {
    let finish = |class| Finish::new(Surface::Plain, [120; 3], class);
    let mut ground = Mesh::default();
    let ring =
        [(-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    ground.plate(&ring, finish(Class::Road), 1.0);
    let mut wall = Mesh::default();
    wall.block(Vec3::new(0.0, 10.0, 0.0), Vec3::new(6.0, 0.5, 4.0), 0.0, finish(Class::Building));
    SceneDescription {
        ground: vec![SceneObject::of_one_level(ground)],
        objects: vec![SceneObject::of_one_level(wall)],
        bounds: [Vec3::new(-60.0, -60.0, 0.0), Vec3::new(60.0, 60.0, 10.0)],
        ..SceneDescription::default()
    }
}

/// From the south over the wall.
fn view() -> View {
    let lens = Lens { extent: EXTENT, ..Lens::default() };
    View::new(Extrinsics::looking_at(DVec3::new(0.0, -10.0, 3.0), DVec3::new(0.0, 10.0, 2.0)), &lens)
}

fn drawn(context: &Context, quality: Quality, kind: PictureKind, overlay: Option<&Overlay>) -> Image {
    drawn_with(context, &FrameSnapshot::default(), (quality, kind, overlay))
}

/// With vehicles.
fn drawn_with(
    context: &Context,
    seen: &FrameSnapshot,
    (quality, kind, overlay): (Quality, PictureKind, Option<&Overlay>),
) -> Image {
    let format = wgpu::TextureFormat::Rgba8Unorm;
    let settings = Settings { quality, ..Settings::default() };
    let mut renderer = Renderer::new(context, &scene(), settings).expect("a renderer");
    let texture = context.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: EXTENT[0], height: EXTENT[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let color = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let target = TargetView { kind, overlay, ..TargetView::new(&color, format, EXTENT) };
    renderer.draw(seen, &[view()], &[target]).expect("drawn");
    read_texture(context, &texture).expect("read")
}

/// The pixel at a point of the city.
fn at(image: &Image, point: DVec3) -> [u8; 3] {
    let pixel = view().project(point).expect("in sight");
    let index = (pixel.y.round() as u32 * image.width + pixel.x.round() as u32) as usize * 3;
    [image.rgb[index], image.rgb[index + 1], image.rgb[index + 2]]
}

fn is_red([r, g, b]: [u8; 3]) -> bool {
    r > 230 && g < 40 && b < 40
}

#[test]
fn lines_and_surfaces_are_hidden_by_what_is_in_front_of_them() {
    let Some(context) = software() else { return };
    for quality in [Quality::LOW, Quality::HIGH] {
        let mut overlay = Overlay::new(1.0);
        // A line along the ground, under the wall and beyond; a strip behind it; a ring that shines through.
        let line = |x: f64, y: [f64; 2]| y.map(|y| DVec3::new(x, y, 0.1));
        overlay.line(line(0.0, [-6.0, 40.0]), 4.0, OverlayPaint::hidden(RED));
        let far = line(5.0, [20.0, 30.0]);
        let other = line(8.0, [20.0, 30.0]);
        overlay.strip(&far, &other, OverlayPaint::hidden(RED));
        overlay.line(line(-1.0, [11.0, 14.0]), 4.0, OverlayPaint { colour: RED, behind: 1.0 });
        // From behind the eye: its visible part is drawn all the same.
        overlay.line(line(-3.0, [-50.0, 5.0]), 4.0, OverlayPaint::hidden(RED));
        let plain = drawn(&context, quality, PictureKind::Rgb, None);
        let image = drawn(&context, quality, PictureKind::Rgb, Some(&overlay));
        let name = format!("{} samples", quality.samples);
        assert!(is_red(at(&image, DVec3::new(0.0, 0.0, 0.1))), "before the wall, {name}");
        assert!(is_red(at(&image, DVec3::new(-3.0, 2.0, 0.1))), "from behind the eye, {name}");
        assert!(is_red(at(&image, DVec3::new(6.5, 25.0, 0.1))), "the strip, {name}");
        for y in [11.0, 14.0, 20.0] {
            let behind = DVec3::new(0.0, y, 0.1);
            assert_eq!(at(&image, behind), at(&plain, behind), "behind the wall, {name}");
        }
        assert!(is_red(at(&image, DVec3::new(-1.0, 12.0, 0.1))), "shines through, {name}");
    }
}

#[test]
fn depth_and_classes_are_drawn_in_colours() {
    let Some(context) = software() else { return };
    let near = DVec3::new(2.0, 0.0, 0.0);
    let wall = DVec3::new(0.0, 9.7, 2.0);
    let depth = drawn(&context, Quality::LOW, PictureKind::Depth, None);
    assert!(at(&depth, near)[0] > at(&depth, wall)[0] + 20, "near is brighter");
    let classes = drawn(&context, Quality::LOW, PictureKind::Semantic, None);
    for (point, class) in [(near, Class::Road), (wall, Class::Building)] {
        let found = at(&classes, point);
        assert!(found.iter().zip(class.colour()).all(|(a, b)| a.abs_diff(b) <= 1), "{class:?}: {found:?}");
    }
    let instances = drawn(&context, Quality::LOW, PictureKind::Instance, None);
    assert_eq!(at(&instances, wall), [0; 3], "there is no vehicle");
}

#[test]
fn vehicles_have_the_colours_that_a_legend_can_tell() {
    let Some(context) = software() else { return };
    for number in [1, 5, 6, 40, 1203] {
        let id = VehicleId(number);
        let dimensions = Dimensions {
            length_m: 4.5,
            width_m: 1.8,
            height_m: 1.5,
            wheelbase_m: 2.7,
            track_m: 1.5,
            wheel_radius_m: 0.32,
        };
        let info = VehicleInfo {
            id,
            name: "car".to_owned(),
            dimensions,
            appearance: Appearance::default(),
            model: "raycast".to_owned(),
        };
        let seen = FrameSnapshot {
            vehicles: vec![VehicleState { id, ..VehicleState::default() }],
            roster: Arc::new(vec![info]),
            ..FrameSnapshot::default()
        };
        let image = drawn_with(&context, &seen, (Quality::LOW, PictureKind::Instance, None));
        let found = at(&image, DVec3::new(0.0, 0.0, 0.7));
        let told = instance_colour(id);
        assert!(found.iter().zip(told).all(|(a, b)| a.abs_diff(b) <= 2), "{number}: {found:?}, {told:?}");
    }
}
