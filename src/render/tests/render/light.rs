//! Light in pictures that are developed from radiance: occlusion, exposure, dither, tiles. On the software adapter.

use crate::drawing;

use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::{Context, Daylight, Image, Quality, Renderer, Settings, TargetView};
use city3d_scene::{Class, Finish, Mesh, SceneDescription, SceneObject, Surface, Wall};
use city3d_sensors::{Camera, Extrinsics, Lens, View};
use drawing::software;
use glam::{DVec2, DVec3, Vec2, Vec3};

const HIGH: Quality = Quality { shadow_texels: 1024, ..Quality::HIGH };

/// Level ground of one grey, and on it a box of the same.
fn card(grey: u8, block: Option<Vec3>) -> SceneDescription {
    let finish = Finish::new(Surface::Plain, [grey; 3], Class::Road);
    let mut ground = Mesh::default();
    let ring =
        [(-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    ground.plate(&ring, finish, 1.0);
    let mut standing = Mesh::default();
    if let Some(size) = block {
        standing.block(Vec3::ZERO, size, 0.0, finish);
    }
    SceneDescription {
        ground: vec![SceneObject::of_one_level(ground)],
        objects: vec![SceneObject::of_one_level(standing)],
        bounds: [Vec3::new(-60.0, -60.0, 0.0), Vec3::new(60.0, 60.0, 10.0)],
        ..SceneDescription::default()
    }
}

fn renderer(context: &Context, scene: &SceneDescription, quality: Quality, daylight: Daylight) -> Renderer {
    let settings = Settings { quality, daylight, ..Settings::default() };
    Renderer::new(context, scene, settings).expect("a renderer")
}

fn lens() -> Lens {
    Lens { extent: [160, 120], ..Lens::default() }
}

fn looking(from: DVec3, at: DVec3) -> View {
    View::new(Extrinsics::looking_at(from, at), &lens())
}

fn from_above(height_m: f64) -> View {
    let camera = Camera::Overhead { centre: DVec2::ZERO, height_m };
    camera.view(&FrameSnapshot::default(), &lens()).expect("a view")
}

fn take(renderer: &mut Renderer, views: &[View]) -> Vec<Image> {
    renderer.render(&FrameSnapshot::default(), views).expect("pictures")
}

/// Mean of the green channel over a rectangle: left, top, right, bottom.
fn mean(image: &Image, [left, top, right, bottom]: [u32; 4]) -> f64 {
    let pixels = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
    let sum: f64 = pixels.map(|(x, y)| f64::from(image.pixel(x, y)[1])).sum();
    sum / f64::from((right - left) * (bottom - top))
}

#[test]
fn a_grey_card_is_grey_at_each_time_of_day() {
    let Some(context) = software() else { return };
    // 18 % of the light, what exposure meters take the world for.
    let scene = card(118, None);
    let times =
        [(Daylight::NOON, 120.0..185.0), (Daylight::LOW_SUN, 85.0..170.0), (Daylight::NIGHT, 20.0..75.0)];
    for (daylight, wanted) in times {
        let image = take(&mut renderer(&context, &scene, HIGH, daylight), &[from_above(20.0)]).remove(0);
        let [red, green, blue] = image.pixel(80, 60).map(f64::from);
        assert!(wanted.contains(&green), "{daylight:?}: {green}");
        assert!((red - blue).abs() < 45.0, "{daylight:?}: {red} {blue}");
    }
}

#[test]
fn a_corner_is_darker_than_the_open_plain_which_stays_as_it_is() {
    let Some(context) = software() else { return };
    let scene = card(150, Some(Vec3::new(6.0, 6.0, 3.0)));
    // From the north, on the side in the shade: no light there but that from all sides.
    let view = looking(DVec3::new(0.0, 14.0, 4.0), DVec3::new(0.0, 3.0, 0.5));
    let picture = |looks| {
        let quality = Quality { ssao_samples: looks, ..HIGH };
        take(&mut renderer(&context, &scene, quality, Daylight::NOON), &[view]).remove(0)
    };
    let (without, with) = (picture(0), picture(12));
    let foot = view.project(DVec3::new(0.0, 3.0, 0.0)).expect("in view");
    let (x, y) = (foot.x.round() as u32, foot.y.round() as u32);
    let darker = |place: [u32; 4]| mean(&without, place) - mean(&with, place);
    let corner = darker([x - 8, y - 2, x + 8, y + 3]);
    assert!((8.0..60.0).contains(&corner), "{corner}");
    // Farther from the wall less, and nothing in the open.
    let nearby = darker([x - 8, y + 5, x + 8, y + 8]);
    assert!(nearby < 0.7 * corner, "{nearby} of {corner}");
    let open = darker([4, 100, 30, 118]);
    assert!(open.abs() < 0.5, "{open}");
    let sky = darker([0, 0, 160, 8]);
    assert!(sky.abs() < 0.01, "{sky}");
}

#[test]
fn a_plain_seen_at_a_slant_occludes_nothing_of_itself() {
    let Some(context) = software() else { return };
    let scene = card(150, None);
    let view = looking(DVec3::new(0.0, 0.0, 1.4), DVec3::new(8.0, 1.0, 1.0));
    let picture = |looks| {
        let quality = Quality { ssao_samples: looks, ..HIGH };
        take(&mut renderer(&context, &scene, quality, Daylight::NOON), &[view]).remove(0)
    };
    let (without, with) = (picture(0), picture(12));
    let most = without.rgb.iter().zip(&with.rgb).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(most <= Some(1), "{most:?}");
}

#[test]
fn a_thing_thinner_than_a_texel_of_the_shadow_map_has_a_shadow_where_it_touches_the_ground() {
    let Some(context) = software() else { return };
    let scene = card(150, Some(Vec3::new(0.1, 0.1, 0.2)));
    let picture = |scene: &SceneDescription, view, contact_steps, daylight| {
        let quality = Quality { contact_steps, shadow_texels: 1024, ..Quality::ULTRA };
        take(&mut renderer(&context, scene, quality, daylight), &[view]).remove(0)
    };
    let near = looking(DVec3::new(1.0, 1.2, 1.2), DVec3::ZERO);
    let darker = |daylight| {
        let (without, with) = (picture(&scene, near, 0, daylight), picture(&scene, near, 16, daylight));
        let pixels = (0..120).flat_map(|y| (0..160).map(move |x| (x, y)));
        let change = |(x, y)| (x, y, i32::from(without.pixel(x, y)[1]) - i32::from(with.pixel(x, y)[1]));
        pixels.map(change).filter(|(.., change)| change.abs() > 8).collect::<Vec<_>>()
    };
    let found = darker(Daylight::NOON);
    let (foot, count) = (near.project(DVec3::ZERO).expect("in view"), found.len());
    assert!((10..600).contains(&count), "{count}");
    assert!(found.iter().all(|(.., change)| *change > 0), "it darkens alone: {found:?}");
    let is_near = |(x, y): (u32, u32)| foot.distance(DVec2::new(x.into(), y.into())) < 45.0;
    assert!(found.iter().all(|(x, y, _)| is_near((*x, *y))), "{foot:?}: {found:?}");
    assert_eq!(darker(Daylight::NIGHT), [], "lamps have no shadows");
    // A plain hides the sun from none of itself.
    let (plain, slanting) = (card(150, None), looking(DVec3::new(0.0, 0.0, 1.4), DVec3::new(8.0, 1.0, 1.0)));
    let [without, with] = [0, 16].map(|steps| picture(&plain, slanting, steps, Daylight::LOW_SUN));
    let most = without.rgb.iter().zip(&with.rgb).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(most <= Some(1), "{most:?}");
}

#[test]
fn dither_keeps_the_mean_between_two_levels() {
    let Some(context) = software() else { return };
    // Strips of greys a step apart.
    let mut ground = Mesh::default();
    for k in 0..12_u8 {
        let (left, right) = (f32::from(k) * 2.0 - 12.0, f32::from(k) * 2.0 - 10.0);
        let ring = [(left, -20.0), (right, -20.0), (right, 20.0), (left, 20.0)];
        let finish = Finish::new(Surface::Plain, [100 + k; 3], Class::Road);
        ground.plate(&ring.map(|(x, y)| Vec3::new(x, y, 0.0)), finish, 1.0);
    }
    let scene = SceneDescription { ground: vec![SceneObject::of_one_level(ground)], ..card(0, None) };
    let mut renderer = renderer(&context, &scene, HIGH, Daylight::NOON);
    let image = take(&mut renderer, &[from_above(18.0)]).remove(0);
    assert!(image == take(&mut renderer, &[from_above(18.0)]).remove(0), "the same picture twice differs");
    let edge = |x: f64| from_above(18.0).project(DVec3::new(x, 0.0, 0.0)).map_or(0.0, |at| at.x) as u32;
    let strip = |k: u32| {
        let x = f64::from(k) * 2.0 - 12.0;
        [edge(x) + 2, 0, edge(x + 2.0) - 1, 120]
    };
    let levels: Vec<f64> = (1..11).map(|k| mean(&image, strip(k))).collect();
    for (k, level) in (1..).zip(&levels) {
        let [left, _, right, bottom] = strip(k);
        let pixels = (0..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
        let most = pixels.map(|(x, y)| (f64::from(image.pixel(x, y)[1]) - level).abs()).fold(0.0, f64::max);
        // Half a step each way around a level that haze changes a little along the strip.
        assert!(most < 1.25, "strip {k}: a pixel is {most} from the mean {level}");
    }
    // Even steps: rounded to whole levels they would differ by up to 1.
    let steps: Vec<f64> = levels.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let usual = steps.iter().sum::<f64>() / steps.len() as f64;
    assert!(steps.iter().all(|step| (step - usual).abs() < 0.2), "{levels:?}");
    assert!(levels.iter().any(|level| (level - level.round()).abs() > 0.3), "{levels:?}");
}

#[test]
fn tiles_look_alike_wherever_they_lie_and_know_nothing_of_each_other() {
    let Some(context) = software() else { return };
    let scene = card(150, Some(Vec3::new(6.0, 6.0, 3.0)));
    let view = looking(DVec3::new(0.0, 14.0, 4.0), DVec3::new(0.0, 3.0, 0.5));
    let dark_neighbour = looking(DVec3::new(0.0, 4.0, 1.0), DVec3::new(0.0, 0.0, 1.0));
    let bright_neighbour = looking(DVec3::new(0.0, 14.0, 4.0), DVec3::new(0.0, 30.0, 40.0));
    for samples in [1, 4] {
        let quality = Quality { samples, ..HIGH };
        let mut renderer = renderer(&context, &scene, quality, Daylight::NOON);
        let alone = take(&mut renderer, &[view]).remove(0);
        let views = [dark_neighbour, view, bright_neighbour, bright_neighbour, view, dark_neighbour, view];
        let together = take(&mut renderer, &views);
        for index in [1, 4, 6] {
            let pairs = alone.rgb.chunks_exact(3).zip(together[index].rgb.chunks_exact(3));
            // The last bits of coordinates depend on the place of a tile, so that a pixel on an edge may differ.
            let far = pairs.filter(|(p, q)| p.iter().zip(*q).any(|(x, y)| x.abs_diff(*y) > 1)).count();
            assert!(far <= 20, "{samples} samples, tile {index}: {far} pixels differ");
        }
    }
}

#[test]
fn no_lamp_shines_through_a_wall() {
    let Some(context) = software() else { return };
    let lamp = Vec3::new(0.0, -4.0, 6.0);
    let wall = Wall { from: Vec2::new(-20.0, 0.0), to: Vec2::new(20.0, 0.0), height_m: 8.0 };
    let green_at = |walls: Vec<Wall>, y: f64| {
        let scene = SceneDescription { lamps: vec![lamp], walls, ..card(118, None) };
        let mut renderer = renderer(&context, &scene, HIGH, Daylight::NIGHT);
        let view = from_above(40.0);
        let at = view.project(DVec3::new(0.0, y, 0.0)).expect("in view");
        let (x, y) = (at.x.round() as u32, at.y.round() as u32);
        mean(&take(&mut renderer, &[view])[0], [x - 3, y - 2, x + 3, y + 3])
    };
    let [before, behind] = [-9.0, 1.5].map(|y| green_at(vec![wall], y));
    let [open, dark] = [1.5, 18.0].map(|y| green_at(Vec::new(), y));
    assert!(before > dark + 20.0, "{before} {dark}");
    assert!(open > dark + 20.0, "without a wall: {open} {dark}");
    assert!((behind - dark).abs() < 4.0, "{behind} {dark}");
}

#[test]
fn a_target_of_anyones_shows_what_is_read_back() {
    let Some(context) = software() else { return };
    let scene = card(150, Some(Vec3::new(6.0, 6.0, 3.0)));
    let view = looking(DVec3::new(0.0, 14.0, 4.0), DVec3::new(0.0, 3.0, 0.5));
    let mut renderer = renderer(&context, &scene, HIGH, Daylight::NOON);
    let wanted = take(&mut renderer, &[view]).remove(0);
    for format in [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba8UnormSrgb] {
        let size = wgpu::Extent3d { width: 160, height: 120, depth_or_array_layers: 1 };
        let texture = context.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let color = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let target = TargetView::new(&color, format, [160, 120]);
        renderer.draw(&FrameSnapshot::default(), &[view], &[target]).expect("drawn");
        let shown = texels(&context, &texture);
        let far = wanted
            .rgb
            .chunks_exact(3)
            .zip(shown.chunks_exact(4))
            .map(|(p, q)| p.iter().zip(q).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or_default());
        assert!(far.filter(|&far| far > 1).count() <= 20, "{format:?}");
    }
}

/// Bytes of a texture of 160 x 120 texels of four bytes.
fn texels(context: &Context, texture: &wgpu::Texture) -> Vec<u8> {
    let buffer = context.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 768 * 120,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(768), rows_per_image: Some(120) };
    let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    context.queue.submit([encoder.finish()]);
    buffer.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("mapped"));
    context.device.poll(wgpu::PollType::wait_indefinitely()).expect("done");
    let bytes = buffer.slice(..).get_mapped_range().expect("mapped");
    bytes.chunks_exact(768).flat_map(|row| row[..640].to_vec()).collect()
}

#[test]
fn the_mean_of_shifted_pictures_repeats_and_smooths_what_is_thinner_than_a_pixel() {
    let Some(context) = software() else { return };
    // A wire, a third of a pixel thick, that crosses the picture at a slant.
    let mut wire = Mesh::default();
    let finish = Finish::new(Surface::Plain, [20; 3], Class::Building);
    wire.block(Vec3::new(0.0, 0.0, 2.0), Vec3::new(40.0, 0.05, 0.05), 0.0, finish);
    let bare = card(200, None);
    let strung = SceneDescription { objects: vec![SceneObject::of_one_level(wire)], ..card(200, None) };
    let view = looking(DVec3::new(-3.0, -18.0, 7.0), DVec3::new(0.0, 0.0, 2.0));
    let picture = |scene: &SceneDescription, jitter_samples| {
        let quality = Quality { jitter_samples, ssao_samples: 0, ..HIGH };
        take(&mut renderer(&context, scene, quality, Daylight::NOON), &[view]).remove(0)
    };
    // Deviation of how much the wire darkens each column, as a share of the mean: by right as much in one as in the next.
    // Its shadow is lower down.
    let unevenness = |jitter_samples| {
        let (without, with) = (picture(&bare, jitter_samples), picture(&strung, jitter_samples));
        assert!(with == picture(&strung, jitter_samples), "the same picture twice differs");
        let darkened = |x: u32| -> f64 {
            (50..70).map(|y| f64::from(without.pixel(x, y)[1]) - f64::from(with.pixel(x, y)[1])).sum()
        };
        let columns: Vec<f64> = (20..140).map(darkened).collect();
        let mean = columns.iter().sum::<f64>() / columns.len() as f64;
        assert!(mean > 10.0, "{mean}: the wire is seen");
        let squares: f64 = columns.iter().map(|column| (column - mean).powi(2)).sum();
        (squares / columns.len() as f64).sqrt() / mean
    };
    let (single, averaged) = (unevenness(0), unevenness(4));
    assert!(averaged < 0.7 * single, "{averaged} and {single}");
    assert!(picture(&bare, 0) == picture(&bare, 1), "one picture is not shifted");
}

#[test]
fn people_have_soft_patches_under_their_feet_by_day_and_shadows_away_from_lamps_at_night() {
    let Some(context) = software() else { return };
    let scene = |class| {
        let mut figure = Mesh::default();
        let finish = Finish::new(Surface::Plain, [150; 3], class);
        figure.block(Vec3::ZERO, Vec3::new(0.3, 0.3, 1.7), 0.0, finish);
        let objects = vec![SceneObject::of_one_level(figure)];
        SceneDescription { objects, lamps: vec![Vec3::new(-5.0, 0.0, 6.0)], ..card(150, None) }
    };
    let view = looking(DVec3::new(1.0, -6.0, 5.0), DVec3::new(1.0, 0.0, 0.0));
    let picture = |class, daylight| {
        let quality = Quality { ssao_samples: 0, ..HIGH };
        take(&mut renderer(&context, &scene(class), quality, daylight), &[view]).remove(0)
    };
    let darkening = |daylight, at: DVec3| {
        let (of_person, of_wall) = (picture(Class::Person, daylight), picture(Class::Building, daylight));
        let at = view.project(at).expect("in view");
        let rectangle = [at.x as u32 - 1, at.y as u32 - 1, at.x as u32 + 1, at.y as u32 + 1];
        mean(&of_person, rectangle) / mean(&of_wall, rectangle)
    };
    assert!(darkening(Daylight::NOON, DVec3::new(0.0, -0.22, 0.0)) < 0.95);
    let night = darkening(Daylight::NIGHT, DVec3::new(0.9, 0.0, 0.0));
    assert!(night < 0.9, "{night}: away from the lamp");
    let towards = darkening(Daylight::NIGHT, DVec3::new(-1.2, 0.0, 0.0));
    assert!((towards - 1.0).abs() < 0.02, "{towards}: towards the lamp");
}
