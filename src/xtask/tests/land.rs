//! The land around the city as pictures show it: ground up to the horizon, and something that grows on it.
#![allow(clippy::disallowed_methods, reason = "looks at pictures; no state depends on it")]

#[allow(dead_code, reason = "each test uses its own part")]
#[path = "../../../tests/support/drawing.rs"]
mod drawing;

use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::{Quality, RenderRequest, Renderer, Settings};
use city3d_roadmap::{CityMap, Grid, load_map};
use city3d_scene::{Class, SceneDescription};
use city3d_sensors::{Extrinsics, Lens, PictureKind, Projection, View};
use glam::{DVec2, DVec3};

const AZIMUTHS: u32 = 12;
const EXTENT: [u32; 2] = [160, 120];
/// Sine of 2 degrees: rays that point down by less may miss the ground.
const LEAST_DIP: f64 = 0.035;
/// Sine of the angle below the horizon within which plants are looked for from low cameras.
const BAND: f64 = 0.06;

fn city() -> CityMap {
    let shipped = include_bytes!("../../../assets/maps/ids3c.dxf");
    load_map(shipped).expect("a map").map.to_city(LengthScale::TESTBED)
}

fn grid() -> CityMap {
    let grid = Grid { size: "3x2".parse().expect("a size"), block_m: 3.0, entry_m: 3.0, ..Grid::default() };
    load_map(grid.to_dxf().expect("a drawing").as_bytes()).expect("a map").map.to_city(LengthScale::TESTBED)
}

/// Views away from the town, with the horizon in their upper third.
fn views(map: &CityMap, height_m: f64) -> Vec<View> {
    let [low, high] = map.bounds();
    let (middle, out) = ((low + high) / 2.0, (high - low).max_element() / 2.0 + 45.0);
    let lens = Lens { vertical_fov_rad: 60_f64.to_radians(), extent: EXTENT, ..Lens::default() };
    let view = |k: u32| {
        let ahead = DVec2::from_angle(std::f64::consts::TAU * (f64::from(k) + 0.5) / f64::from(AZIMUTHS));
        let eye = (middle + ahead * out).extend(height_m);
        let down = if height_m > 100.0 { -0.35 } else { -0.12 };
        View::new(Extrinsics::looking_at(eye, eye + ahead.extend(down)), &lens)
    };
    (0..AZIMUTHS).map(view).collect()
}

/// Sine of the angle by which the ray of a pixel rises.
fn rise(view: &View, [x, y]: [u32; 2]) -> f64 {
    let Projection::Pinhole { intrinsics: k, .. } = view.projection else { unreachable!("a pinhole camera") };
    let ray = DVec3::new((f64::from(x) - k.cx) / k.fx, (f64::from(y) - k.cy) / k.fy, 1.0);
    (view.extrinsics.orientation * ray).normalize().z
}

#[test]
fn the_land_reaches_the_horizon_at_every_height_and_is_nowhere_bare() {
    let Some(context) = drawing::software() else { return };
    for (name, map) in [("city", city()), ("3x2", grid())] {
        let scene = SceneDescription::from_map(&map);
        let quality = Quality { shadow_texels: 512, ..Quality::LOW };
        let settings = Settings { quality, ..Settings::default() };
        let mut renderer = Renderer::new(&context, &scene, settings).expect("a renderer");
        for height_m in [5.0, 30.0, 300.0] {
            let views = views(&map, height_m);
            let kinds = [PictureKind::Semantic].into_iter().collect();
            let requests: Vec<RenderRequest> =
                views.iter().map(|&view| RenderRequest { view, kinds }).collect();
            let pictures = renderer.render_kinds(&FrameSnapshot::default(), &requests).expect("pictures");
            for (k, (view, picture)) in views.iter().zip(&pictures).enumerate() {
                let seen = picture.semantic.as_ref().expect("classes");
                let place = format!("{name}, {height_m} m up, view {k}");
                let class = |[x, y]: [u32; 2]| seen.at(x, y);
                let pixels = (0..EXTENT[1]).flat_map(|y| (0..EXTENT[0]).map(move |x| [x, y]));
                let below: Vec<[u32; 2]> = pixels.filter(|&at| rise(view, at) < -LEAST_DIP).collect();
                let nothing = below.iter().filter(|&&at| class(at) == Class::Sky as u8).count();
                assert_eq!(nothing, 0, "{place}: pixels of the sky below the horizon");
                // Low down most of a picture is the field in front: what counts is the band of the horizon.
                let is_looked_at = |at: &[u32; 2]| height_m > 100.0 || rise(view, *at) > -BAND;
                let pixels = (0..EXTENT[1]).flat_map(|y| (0..EXTENT[0]).map(move |x| [x, y]));
                let land: Vec<u8> = pixels.filter(is_looked_at).map(class).collect();
                let land: Vec<u8> = land.into_iter().filter(|&class| class != Class::Sky as u8).collect();
                let grown = land.iter().filter(|&&class| class == Class::Vegetation as u8).count();
                let share = grown as f64 / land.len() as f64;
                assert!(share > 0.006, "{place}: plants in {share} of the land");
            }
        }
    }
}
