//! Rain and fog in pictures, on the software adapter.

use crate::drawing;

use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::{Context, Daylight, Image, Quality, Renderer, Settings};
use city3d_scene::{Class, Finish, Mesh, SceneDescription, SceneObject, Surface};
use city3d_sensors::{Extrinsics, Lens, View, Weather};
use drawing::software;
use glam::{DVec3, Vec3};

const LAMP: Vec3 = Vec3::new(20.0, 0.0, 6.0);
const EYE: DVec3 = DVec3::new(0.0, 0.0, 3.0);
const PRESETS: [Quality; 2] =
    [Quality { shadow_texels: 1024, ..Quality::HIGH }, Quality { shadow_texels: 1024, ..Quality::LOW }];

/// A road with a lamp beside it, and a wall far off.
fn road() -> SceneDescription {
    let mut ground = Mesh::default();
    let ring =
        [(-60.0, -60.0), (300.0, -60.0), (300.0, 60.0), (-60.0, 60.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    ground.plate(&ring, Finish::new(Surface::Asphalt, [150; 3], Class::Road), 1.0);
    let mut wall = Mesh::default();
    let finish = Finish::new(Surface::Plain, [40; 3], Class::Wall);
    wall.block(Vec3::new(200.0, 0.0, 0.0), Vec3::new(1.0, 100.0, 30.0), 0.0, finish);
    SceneDescription {
        ground: vec![SceneObject::of_one_level(ground)],
        objects: vec![SceneObject::of_one_level(wall)],
        lamps: vec![LAMP],
        bounds: [Vec3::new(-60.0, -60.0, 0.0), Vec3::new(300.0, 60.0, 30.0)],
        ..SceneDescription::default()
    }
}

fn ahead() -> View {
    let lens = Lens { extent: [320, 240], ..Lens::default() };
    View::new(Extrinsics::looking_at(EYE, DVec3::new(20.0, 0.0, 1.0)), &lens)
}

fn picture(context: &Context, quality: Quality, daylight: Daylight, weather: Weather) -> Image {
    let settings = Settings { quality, daylight, weather, ..Settings::default() };
    let mut renderer = Renderer::new(context, &road(), settings).expect("a renderer");
    renderer.render(&FrameSnapshot::default(), &[ahead()]).expect("a picture").remove(0)
}

/// Mean of the green channel in a square of seven pixels around a point of the city.
fn green(image: &Image, point: DVec3) -> f64 {
    let at = ahead().project(point).expect("in view").round();
    let pixels = (-3..=3).flat_map(|y| (-3..=3).map(move |x| (at.x as i32 + x, at.y as i32 + y)));
    pixels.map(|(x, y)| f64::from(image.pixel(x as u32, y as u32)[1])).sum::<f64>() / 49.0
}

#[test]
fn rain_darkens_the_road_and_fog_hides_what_is_far() {
    let Some(context) = software() else { return };
    for quality in PRESETS {
        let of = |weather| picture(&context, quality, Daylight::NOON, weather);
        let [clear, rain, fog] = Weather::ALL.map(of);
        let road = DVec3::new(8.0, 1.0, 0.0);
        assert!(
            green(&clear, road) > green(&rain, road) + 20.0,
            "{} {}",
            green(&clear, road),
            green(&rain, road)
        );
        // A dark wall 200 m away fades in fog.
        let wall = DVec3::new(199.5, 0.0, 12.0);
        let faded = green(&fog, wall) - green(&clear, wall);
        assert!(faded > 40.0, "{faded}");
        let near = (green(&fog, road) - green(&rain, road)).abs();
        assert!(near < faded, "{near} {faded}");
    }
}

/// Drops fall: two instants differ in rain alone, by less than what is in the picture, and an instant is the same twice.
#[test]
fn rain_is_seen_to_fall() {
    let Some(context) = software() else { return };
    let at = |time_s: f64, weather| {
        let settings = Settings { quality: PRESETS[0], weather, ..Settings::default() };
        let mut renderer = Renderer::new(&context, &road(), settings).expect("a renderer");
        let snapshot = FrameSnapshot { time_s, ..FrameSnapshot::default() };
        renderer.render(&snapshot, &[ahead()]).expect("a picture").remove(0)
    };
    let changed = |weather| {
        let (a, b) = (at(1.0, weather), at(1.1, weather));
        a.rgb.iter().zip(&b.rgb).filter(|(a, b)| a.abs_diff(**b) > 4).count() as f64 / a.rgb.len() as f64
    };
    assert_eq!(at(1.0, Weather::Rain), at(1.0, Weather::Rain));
    let [clear, rain, fog] = Weather::ALL.map(changed);
    assert_eq!((clear, fog), (0.0, 0.0));
    assert!((0.01..0.3).contains(&rain), "{rain}");
}

#[test]
fn a_wet_road_mirrors_a_lamp_at_night_where_the_law_of_reflection_has_it() {
    let Some(context) = software() else { return };
    for quality in PRESETS {
        let of = |weather| picture(&context, quality, Daylight::NIGHT, weather);
        let [dry, wet] = [Weather::Clear, Weather::Rain].map(of);
        // Angles of incidence and reflection are equal where heights and distances have the same ratio.
        let lamp = LAMP.as_dvec3();
        let mirrored = DVec3::new(lamp.x * EYE.z / (EYE.z + lamp.z), 0.0, 0.0);
        let beside = mirrored + DVec3::new(0.0, 2.5, 0.0);
        let contrast = |image: &Image| green(image, mirrored) - green(image, beside);
        assert!(contrast(&wet) > contrast(&dry) + 15.0, "{} {}", contrast(&wet), contrast(&dry));
    }
}

/// Ground of a surface before a red wall.
fn before_a_red_wall(surface: Surface) -> SceneDescription {
    let mut ground = Mesh::default();
    let ring =
        [(-60.0, -60.0), (300.0, -60.0), (300.0, 60.0), (-60.0, 60.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    ground.plate(&ring, Finish::new(surface, [90; 3], Class::Road), 1.0);
    let mut wall = Mesh::default();
    let finish = Finish::new(Surface::Plain, [200, 20, 20], Class::Wall);
    wall.block(Vec3::new(RED_WALL_M as f32, 0.0, 0.0), Vec3::new(1.0, 40.0, 4.0), 0.0, finish);
    SceneDescription {
        ground: vec![SceneObject::of_one_level(ground)],
        objects: vec![SceneObject::of_one_level(wall)],
        bounds: [Vec3::new(-60.0, -60.0, 0.0), Vec3::new(300.0, 60.0, 10.0)],
        ..SceneDescription::default()
    }
}

/// Distance of the wall.
const RED_WALL_M: f64 = 30.0;

/// How red a point of the ground is, that mirrors a point of the wall so high.
fn red(image: &Image, height_m: f64) -> f64 {
    let wall_m = RED_WALL_M - 0.5;
    let mirrored = DVec3::new(wall_m * EYE.z / (EYE.z + height_m), 0.0, 0.0);
    let at = ahead().project(mirrored).expect("in view").round();
    let pixels = (-1..=1).flat_map(|y| (-4..=4).map(move |x| (at.x as i32 + x, at.y as i32 + y)));
    let pixels = pixels.map(|(x, y)| image.pixel(x as u32, y as u32));
    pixels.map(|[red, green, ..]| f64::from(red) - f64::from(green)).sum::<f64>() / 27.0
}

#[test]
fn water_and_glass_mirror_in_ultra_and_a_wet_road_in_high_too() {
    let Some(context) = software() else { return };
    let [high, ultra] = [PRESETS[0], Quality { shadow_texels: 1024, ..Quality::ULTRA }];
    let of = |surface, weather, quality| {
        let settings = Settings { quality, weather, ..Settings::default() };
        let scene = before_a_red_wall(surface);
        let mut renderer = Renderer::new(&context, &scene, settings).expect("a renderer");
        renderer.render(&FrameSnapshot::default(), &[ahead()]).expect("a picture").remove(0)
    };
    for (surface, weather, quality, mirrors) in [
        (Surface::Water, Weather::Clear, ultra, true),
        (Surface::Glazing, Weather::Clear, ultra, true),
        (Surface::Asphalt, Weather::Rain, ultra, true),
        (Surface::Asphalt, Weather::Rain, high, true),
        (Surface::Asphalt, Weather::Clear, ultra, false),
    ] {
        let without = Quality { reflection_steps: 0, wet_reflection_steps: 0, ..quality };
        let [plain, mirrored] = [without, quality].map(|quality| of(surface, weather, quality));
        // Low on the wall, and above it, where the sky is mirrored.
        let [low, above] = [1.5, 6.5].map(|height_m| red(&mirrored, height_m) - red(&plain, height_m));
        assert_eq!(low > 8.0, mirrors, "{surface:?} {weather:?}: {low}");
        assert!(above.abs() < 4.0 && (mirrors || low.abs() < 3.0), "{surface:?}: {low} {above}");
    }
}
