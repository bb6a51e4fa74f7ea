//! Traffic signals in pictures: the lit lens has its colour by day and night, near and far, and others are dark.

use crate::drawing::software;

use city3d_protocol::snapshot::{Aspect, FrameSnapshot};
use city3d_render::{Context, Daylight, Image, Quality, Renderer, Settings};
use city3d_scene::{Class, Finish, Mesh, SceneDescription, SceneObject, SignalLenses, Surface};
use city3d_sensors::{Extrinsics, Lens, View};
use glam::{DVec3, Vec3};

/// One head over grey ground, in front of its housing: its traffic comes from the west.
fn scene() -> SceneDescription {
    let mut ground = Mesh::default();
    let ring =
        [(-200.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-200.0, 60.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    ground.plate(&ring, Finish::new(Surface::Plain, [118; 3], Class::Road), 1.0);
    let mut housing = Mesh::default();
    let low = Vec3::new(0.11, 0.0, 2.4);
    housing.block(low, Vec3::new(0.2, 0.4, 1.2), 0.0, Finish::new(Surface::Plain, [30; 3], Class::Sign));
    let middles = [3.36, 3.0, 2.64].map(|height_m| Vec3::new(0.0, 0.0, height_m));
    SceneDescription {
        ground: vec![SceneObject::of_one_level(ground)],
        objects: vec![SceneObject::of_one_level(housing)],
        bounds: [Vec3::new(-200.0, -60.0, 0.0), Vec3::new(60.0, 60.0, 10.0)],
        signals: vec![SignalLenses { middles, facing: Vec3::NEG_X }],
        ..SceneDescription::default()
    }
}

fn view(from: DVec3, extent: [u32; 2]) -> View {
    let lens = Lens { extent, ..Lens::default() };
    View::new(Extrinsics::looking_at(from, DVec3::new(0.0, 0.0, 3.0)), &lens)
}

fn picture(renderer: &mut Renderer, view: View, aspect: Aspect) -> Image {
    let snapshot = FrameSnapshot { signals: vec![aspect], ..FrameSnapshot::default() };
    renderer.render(&snapshot, &[view]).expect("pictures").remove(0)
}

fn renderers(context: &Context) -> Vec<(&'static str, Renderer)> {
    let mut all = Vec::new();
    for (name, daylight) in
        [("noon", Daylight::NOON), ("low sun", Daylight::LOW_SUN), ("night", Daylight::NIGHT)]
    {
        for quality in [Quality::HIGH, Quality::LOW] {
            let settings = Settings { quality, daylight, ..Settings::default() };
            all.push((name, Renderer::new(context, &scene(), settings).expect("a renderer")));
        }
    }
    all
}

/// Whether a colour is that of an aspect: red without green, yellow of both without blue, green without red.
fn is_of([r, g, b]: [u8; 3], aspect: Aspect) -> bool {
    let [r, g, b] = [r, g, b].map(i32::from);
    match aspect {
        Aspect::Red => r > 150 && r > g + 70 && r > b + 70,
        Aspect::Yellow => r > 150 && g > 110 && r.min(g) > b + 50,
        Aspect::Green => g > 150 && g > r + 60,
        Aspect::Dark => r.max(g).max(b) < 110,
    }
}

#[test]
fn the_lit_lens_has_its_colour_and_the_others_are_dark() {
    let Some(context) = software() else { return };
    let near = view(DVec3::new(-6.0, 0.0, 3.0), [160, 120]);
    for (name, mut renderer) in renderers(&context) {
        for aspect in [Aspect::Red, Aspect::Yellow, Aspect::Green] {
            let image = picture(&mut renderer, near, aspect);
            for (lens, of) in
                scene().signals[0].middles.into_iter().zip([Aspect::Red, Aspect::Yellow, Aspect::Green])
            {
                let at = near.project(lens.as_dvec3()).expect("in view");
                let colour = image.pixel(at.x.round() as u32, at.y.round() as u32);
                if of == aspect {
                    assert!(is_of(colour, of), "{name}: the {} lens is {colour:?}", of.name());
                } else {
                    assert!(
                        !is_of(colour, of),
                        "{name}, {}: the {} lens is {colour:?}",
                        aspect.name(),
                        of.name()
                    );
                }
            }
        }
    }
}

#[test]
fn a_dark_head_and_one_seen_from_behind_show_no_light() {
    let Some(context) = software() else { return };
    for (name, mut renderer) in renderers(&context) {
        let near = view(DVec3::new(-6.0, 0.0, 3.0), [160, 120]);
        let unsignalled = FrameSnapshot::default();
        let without = renderer.render(&unsignalled, &[near]).expect("pictures").remove(0);
        assert!(without == picture(&mut renderer, near, Aspect::Dark), "{name}");
        let behind = view(DVec3::new(6.0, 0.0, 3.0), [160, 120]);
        let dark = picture(&mut renderer, behind, Aspect::Dark);
        let lit = picture(&mut renderer, behind, Aspect::Red);
        let most = dark.rgb.iter().zip(&lit.rgb).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(most <= Some(40), "{name}: {most:?}");
    }
}

#[test]
fn lit_lenses_are_seen_from_a_hundred_metres() {
    let Some(context) = software() else { return };
    let far = view(DVec3::new(-100.0, -3.0, 1.5), [320, 240]);
    for (name, mut renderer) in renderers(&context) {
        let dark = picture(&mut renderer, far, Aspect::Dark);
        for aspect in [Aspect::Red, Aspect::Yellow, Aspect::Green] {
            let lit = picture(&mut renderer, far, aspect);
            let pixels = (0..240).flat_map(|y| (0..320).map(move |x| (x, y)));
            let changed = pixels.map(|(x, y)| (lit.pixel(x, y), dark.pixel(x, y))).map(|(a, b)| {
                a.into_iter().zip(b).map(|(a, b)| i32::from(a) - i32::from(b)).max().unwrap_or(0)
            });
            let most = changed.max().unwrap_or(0);
            assert!(most > 60, "{name}: {} differs by {most} from 100 m", aspect.name());
        }
    }
}
