//! Pictures as a user gets them, small, on the software adapter.

use crate::drawing;

use city3d_protocol::snapshot::{BodyType, FrameSnapshot, Indicator, VehicleId, VehicleInfo, VehicleState};
use city3d_render::{
    AdapterPreference, Context, Image, Pictures, PngStream, Quality, RenderError, RenderRequest, Renderer,
    Settings,
};
use city3d_scene::{Class, Finish, Mesh, SceneDescription, SceneObject, Surface};
use city3d_sensors::{Camera, Extrinsics, Lens, Mount, PictureKind, PictureKinds, View};
use drawing::{DIMENSIONS, snapshot, software};
use glam::{DVec2, DVec3, Vec3};

/// Black level ground, on which shadows leave no trace.
fn black_plain() -> SceneDescription {
    let mut mesh = Mesh::default();
    let black = Finish::new(Surface::Plain, [0, 0, 0], Class::Road);
    let ring =
        [(-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    mesh.plate(&ring, black, 1.0);
    SceneDescription {
        ground: vec![SceneObject::of_one_level(mesh)],
        bounds: [Vec3::new(-60.0, -60.0, 0.0), Vec3::new(60.0, 60.0, 10.0)],
        ..SceneDescription::default()
    }
}

/// Light ground, on which they do.
fn light_plain() -> SceneDescription {
    let mut scene = black_plain();
    for vertex in &mut scene.ground[0].levels[0].mesh.vertices {
        vertex.finish.colour = [160, 160, 160];
    }
    scene
}

fn renderer(context: &Context, scene: &SceneDescription, samples: u32) -> Renderer {
    let quality = Quality { samples, shadow_texels: 1024, ..Quality::LOW };
    Renderer::new(context, scene, Settings { quality, ..Settings::default() }).expect("a renderer")
}

fn car(id: u32, at: DVec2, yaw_rad: f64) -> (VehicleState, VehicleInfo) {
    drawing::car(id, at, yaw_rad, [225, 225, 230])
}

fn lens() -> Lens {
    Lens { extent: [320, 240], ..Lens::default() }
}

fn looking(from: DVec3, at: DVec3) -> View {
    View::new(Extrinsics::looking_at(from, at), &lens())
}

/// Smallest box around the pixels that differ: left, top, right, bottom.
fn difference(a: &Image, b: &Image) -> Option<[f64; 4]> {
    let mut found: Option<[f64; 4]> = None;
    for y in 0..a.height {
        for x in 0..a.width {
            let far = a.pixel(x, y).iter().zip(b.pixel(x, y)).any(|(p, q)| p.abs_diff(q) > 10);
            if far {
                let (x, y) = (f64::from(x), f64::from(y));
                let [l, t, r, bottom] = found.unwrap_or([x, y, x, y]);
                found = Some([l.min(x), t.min(y), r.max(x), bottom.max(y)]);
            }
        }
    }
    found
}

/// Whether two pictures are the same but for roundings: where a view lies in its batch shifts the last
/// bits of coordinates, so that a pixel in a thousand may fall to the other side of an edge.
fn alike(a: &Image, b: &Image) -> bool {
    let pairs = a.rgb.chunks_exact(3).zip(b.rgb.chunks_exact(3));
    let far = pairs.filter(|(p, q)| p.iter().zip(*q).any(|(x, y)| x.abs_diff(*y) > 6)).count();
    (a.width, a.height) == (b.width, b.height) && far * 1000 <= a.rgb.len() / 3
}

/// Box around the corners of a car's measures as the camera model projects them.
fn projected(view: &View, state: &VehicleState) -> [f64; 4] {
    let half = DVec3::new(DIMENSIONS.length_m / 2.0, DIMENSIONS.width_m / 2.0, DIMENSIONS.height_m);
    let corners = (0..8).map(|k| {
        let sign = |bit: u32| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let z = if k >> 2 & 1 == 0 { 0.0 } else { half.z };
        let at = state.position + state.orientation * DVec3::new(sign(0) * half.x, sign(1) * half.y, z);
        view.project(at).expect("in front of the camera")
    });
    corners.fold([f64::MAX, f64::MAX, f64::MIN, f64::MIN], |b, p| {
        [b[0].min(p.x), b[1].min(p.y), b[2].max(p.x), b[3].max(p.y)]
    })
}

#[test]
fn a_car_is_in_the_picture_where_its_pose_says() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &black_plain(), 1);
    let view = looking(DVec3::new(0.0, 0.0, 1.4), DVec3::new(20.0, 0.0, 1.0));
    for (x, y, yaw) in
        [(14.0, 0.0, 0.0), (14.0, 3.0, 0.4), (22.0, -5.0, 1.6), (18.0, 2.0, -2.5), (40.0, 0.0, 0.0)]
    {
        let (state, info) = car(3, DVec2::new(x, y), yaw);
        let want = projected(&view, &state);
        let without = renderer.render(&snapshot(Vec::new()), &[view]).unwrap();
        let with = renderer.render(&snapshot(vec![(state, info)]), &[view]).unwrap();
        let got = difference(&with[0], &without[0]).expect("the car shows");
        // Bodies are round, so that a silhouette stays within the box and nearly fills it.
        let inside = got[0] >= want[0] - 2.0
            && got[1] >= want[1] - 2.0
            && got[2] <= want[2] + 2.0
            && got[3] <= want[3] + 2.0;
        assert!(inside, "at ({x}, {y}): drawn {got:?}, projected {want:?}");
        let slack = |size: f64| 0.12 * size + 3.0;
        for side in 0..4 {
            let size = want[2 + side % 2] - want[side % 2];
            let off = (got[side] - want[side]).abs();
            assert!(off < slack(size), "at ({x}, {y}) side {side}: drawn {got:?}, projected {want:?}");
        }
    }
}

fn count(image: &Image, wanted: impl Fn([u8; 3]) -> bool) -> usize {
    image.rgb.chunks_exact(3).filter(|p| wanted([p[0], p[1], p[2]])).count()
}

#[test]
fn brake_lamps_light_up() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &black_plain(), 1);
    let view = looking(DVec3::new(-9.0, 0.0, 1.6), DVec3::new(0.0, 0.0, 0.8));
    let (mut state, info) = car(1, DVec2::ZERO, 0.0);
    let glowing = |p: [u8; 3]| p[0] > 200 && p[1] < 140 && p[2] < 140;
    let off = renderer.render(&snapshot(vec![(state.clone(), info.clone())]), &[view]).unwrap();
    state.brake_lights = true;
    let on = renderer.render(&snapshot(vec![(state, info)]), &[view]).unwrap();
    let (off, on) = (count(&off[0], glowing), count(&on[0], glowing));
    assert!(on > off + 100, "{off} pixels glow without braking, {on} with");
}

#[test]
fn indicators_flash_on_their_side() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &black_plain(), 1);
    let view = looking(DVec3::new(-9.0, 0.0, 1.6), DVec3::new(0.0, 0.0, 0.8));
    let mut picture = |indicator, time_s| {
        let (state, info) = car(1, DVec2::ZERO, 0.0);
        let snapshot = snapshot(vec![(VehicleState { indicator, ..state }, info)]);
        renderer.render(&FrameSnapshot { time_s, ..snapshot }, &[view]).unwrap().remove(0)
    };
    let dark = picture(Indicator::Off, 0.1);
    let between_flashes = picture(Indicator::Left, 0.5);
    assert_eq!(difference(&dark, &between_flashes), None);
    let left = difference(&dark, &picture(Indicator::Left, 0.1)).expect("the left one flashes");
    let right = difference(&dark, &picture(Indicator::Right, 0.1)).expect("the right one flashes");
    assert!(left[2] < 150.0 && right[0] > 170.0, "left {left:?}, right {right:?}");
}

#[test]
fn views_of_one_call_are_what_each_would_be_alone() {
    let Some(context) = software() else { return };
    let scene = light_plain();
    let mut renderer = renderer(&context, &scene, 4);
    let snapshot = snapshot(vec![car(1, DVec2::ZERO, 0.3), car(2, DVec2::new(12.0, 1.0), 0.3)]);
    let small = Lens { extent: [100, 60], ..Lens::default() };
    let views = [
        Camera::onboard(VehicleId(1), Mount::Windscreen).view(&snapshot, &lens()).unwrap(),
        Camera::chase(VehicleId(2)).view(&snapshot, &small).unwrap(),
        Camera::Overhead { centre: DVec2::ZERO, height_m: 40.0 }.view(&snapshot, &lens()).unwrap(),
        Camera::onboard(VehicleId(2), Mount::Bumper).view(&snapshot, &small).unwrap(),
    ];
    let together = renderer.render(&snapshot, &views).unwrap();
    for (index, view) in views.iter().enumerate() {
        let alone = renderer.render(&snapshot, &[*view]).unwrap().remove(0);
        assert_eq!([alone.width, alone.height], view.extent);
        assert!(alike(&alone, &together[index]), "view {index} differs when it is drawn with others");
    }
    assert!(!alike(&together[0], &together[2]) && !alike(&together[1], &together[3]));
}

#[test]
fn shadows_follow_and_leave_nothing_behind() {
    let Some(context) = software() else { return };
    let scene = light_plain();
    let mut moved = renderer(&context, &scene, 1);
    let view = looking(DVec3::new(0.0, -0.1, 45.0), DVec3::ZERO);
    let first = moved.render(&snapshot(vec![car(1, DVec2::new(-8.0, 0.0), 0.0)]), &[view]).unwrap();
    let after = moved.render(&snapshot(vec![car(1, DVec2::new(9.0, 4.0), 1.0)]), &[view]).unwrap();
    let mut fresh = renderer(&context, &scene, 1);
    let alone = fresh.render(&snapshot(vec![car(1, DVec2::new(9.0, 4.0), 1.0)]), &[view]).unwrap();
    assert!(after == alone, "the shadow of where the car was is still there");
    // The sun stands in the south-west: the shadow falls to the north-east, beyond the car's outline.
    let empty = fresh.render(&snapshot(Vec::new()), &[view]).unwrap();
    let outline = projected(&view, &car(1, DVec2::new(-8.0, 0.0), 0.0).0);
    let darker = difference(&first[0], &empty[0]).expect("a car and its shadow");
    assert!(darker[1] < outline[1] - 3.0 && darker[3] < outline[3] + 6.0, "{darker:?} {outline:?}");
}

#[test]
fn the_own_body_leaves_the_windscreens_view_free() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &light_plain(), 1);
    for (_, body) in BodyType::SHIPPED {
        let (state, mut info) = car(1, DVec2::ZERO, 0.0);
        info.appearance.body = body;
        let with = snapshot(vec![(state, info)]);
        let view = Camera::onboard(VehicleId(1), Mount::Windscreen).view(&with, &lens()).unwrap();
        let pictures = [with, snapshot(Vec::new())].map(|s| renderer.render(&s, &[view]).unwrap().remove(0));
        if let Some([_, top, ..]) = difference(&pictures[0], &pictures[1]) {
            assert!(top > 150.0, "{body:?}: the body reaches up to row {top} of 240");
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_by_name() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &black_plain(), 1);
    let good = looking(DVec3::new(-9.0, 0.0, 1.6), DVec3::ZERO);
    let empty = snapshot(Vec::new());
    let flat = View { extent: [320, 0], ..good };
    assert!(matches!(renderer.render(&empty, &[good, flat]), Err(RenderError::Extent { height: 0, .. })));
    let mut lost = good;
    lost.extrinsics.position.x = f64::NAN;
    assert!(matches!(renderer.render(&empty, &[good, lost]), Err(RenderError::View { index: 1 })));
    let (state, mut info) = car(5, DVec2::ZERO, 0.0);
    info.dimensions.width_m = -1.0;
    let error = renderer.render(&snapshot(vec![(state, info)]), &[good]).unwrap_err().to_string();
    assert!(error.contains("vehicle 5") && error.contains("width") && error.contains("-1"), "{error}");
    assert_eq!(renderer.render(&empty, &[]).unwrap(), Vec::new());
    let named = Context::headless(&AdapterPreference::Named("no such thing".into())).unwrap_err();
    assert!(named.to_string().contains("no such thing"), "{named}");
}

#[test]
fn adapters_side_by_side_draw_what_one_draws() {
    // First: Mesa counts the processors once a process.
    let many = Context::for_batches(&AdapterPreference::Software);
    let Some(context) = software() else { return };
    let many = many.expect("the same adapter");
    if cfg!(target_os = "linux") && std::env::var_os("LP_NUM_THREADS").is_none() {
        let processors = std::thread::available_parallelism().unwrap().get();
        assert_eq!(many.device_count(), processors / processors.div_ceil(8));
        // Nobody is kept to the processors that the adapters were told to count: neither this thread nor the first.
        assert_eq!(std::thread::available_parallelism().unwrap().get(), processors);
        let allowed = |thread: &str| {
            let status = std::fs::read_to_string(format!("/proc/{thread}/status")).unwrap();
            status.lines().find(|line| line.starts_with("Cpus_allowed_list")).map(str::to_owned)
        };
        assert_eq!(allowed("self"), allowed("thread-self"));
    }
    let (mut one, mut side_by_side) =
        (renderer(&context, &light_plain(), 1), renderer(&many, &light_plain(), 1));
    let cars = |tick: u32| snapshot(vec![car(7, DVec2::new(f64::from(tick), 0.0), 0.3)]);
    let from = |k: u32| looking(DVec3::new(-9.0, f64::from(k), 2.0), DVec3::ZERO);
    let small = |k: u32| {
        let from = Extrinsics::looking_at(DVec3::new(-9.0, f64::from(k), 2.0), DVec3::ZERO);
        View::new(from, &Lens { extent: [48, 36], ..Lens::default() })
    };
    let views = [from(0), small(1), from(2), from(3), small(4)];
    let alike = |a: &[Image], b: &[Image]| {
        let pairs = a.iter().zip(b);
        a.len() == b.len() && pairs.into_iter().all(|(a, b)| a.width == b.width && alike(a, b))
    };
    for tick in 0..3 {
        let (expected, found) = (one.render(&cars(tick), &views), side_by_side.render(&cars(tick), &views));
        assert!(alike(&expected.unwrap(), &found.unwrap()), "tick {tick}");
        // Of views that come alone each adapter gets some.
        let (expected, found) =
            (one.render(&cars(tick), &views[1..2]), side_by_side.render(&cars(tick), &views[1..2]));
        assert!(alike(&expected.unwrap(), &found.unwrap()), "tick {tick}");
        assert_eq!(one.triangles(), side_by_side.triangles());
    }
    assert_eq!([1, 50].map(|views| one.batches_in_flight(views)), [2, 2]);
    assert_eq!([1, 50].map(|views| side_by_side.batches_in_flight(views)), [2 * many.device_count(), 2]);
    let requests = views.map(|view| RenderRequest {
        view,
        kinds: PictureKinds::RGB.with(PictureKind::Depth).with(PictureKind::Instance),
    });
    let expected = one.render_kinds(&cars(1), &requests).unwrap();
    let found = side_by_side.render_kinds(&cars(1), &requests).unwrap();
    for (expected, found) in expected.iter().zip(&found) {
        let count = |pictures: &Pictures| {
            let instance = pictures.instance.as_ref().expect("asked for");
            instance.values.iter().filter(|&&id| id == 7).count()
        };
        let (expected, count) = (count(expected), count(found));
        assert!(expected > 20 && expected.abs_diff(count) <= 2 + expected / 100, "{expected} {count}");
        assert!(found.depth.is_some() && found.rgb.is_some() && found.semantic.is_none());
    }
    // What is wrong is told by its place among all, and nothing is drawn.
    let mut wrong = views;
    wrong[4].extrinsics.position.x = f64::NAN;
    assert!(matches!(side_by_side.render(&cars(0), &wrong), Err(RenderError::View { index: 4 })));
    assert_eq!(side_by_side.render(&cars(0), &[]).unwrap(), Vec::new());
}

#[test]
fn a_stream_writes_every_picture_and_reports_a_bad_path() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &light_plain(), 1);
    let folder = tempfile::tempdir().unwrap();
    let small = Lens { extent: [64, 48], ..Lens::default() };
    let view = View::new(Extrinsics::looking_at(DVec3::new(-9.0, 0.0, 1.6), DVec3::ZERO), &small);
    let at = |tick: u64| snapshot(vec![car(1, DVec2::new(tick as f64, 0.0), 0.0)]);
    let mut stream = PngStream::new(&mut renderer);
    for tick in 0..9 {
        let paths = (0..2).map(|k| folder.path().join(format!("{tick}_{k}.png"))).collect();
        stream.push(&at(tick), &[view, view], paths).unwrap();
    }
    assert_eq!(stream.finish().unwrap(), 18);
    let read = |name: &str| {
        let rgb = image::open(folder.path().join(name)).unwrap().into_rgb8();
        Image { width: rgb.width(), height: rgb.height(), rgb: rgb.into_raw() }
    };
    let (first, second, next) = (read("4_0.png"), read("4_1.png"), read("5_0.png"));
    assert!(alike(&first, &renderer.render(&at(4), &[view]).unwrap()[0]));
    assert!(alike(&first, &second) && !alike(&first, &next));
    let mut stream = PngStream::new(&mut renderer);
    stream.push(&at(0), &[view], vec![folder.path().join("none/a.png")]).unwrap();
    assert!(stream.finish().unwrap_err().to_string().contains("none/a.png"));
}

#[test]
fn what_a_view_cannot_see_costs_it_nothing() {
    let Some(context) = software() else { return };
    // Boxes in front of a camera at the middle, then twenty times as many behind it.
    let boxes = |xs: std::ops::Range<i32>| {
        xs.flat_map(|x| (-4..4).map(move |y| Vec3::new(3.0 * x as f32, 3.0 * y as f32, 0.0))).map(|at| {
            let mut mesh = Mesh::default();
            let finish = Finish::new(Surface::Plain, [200, 60, 60], Class::Building);
            mesh.block(at, Vec3::splat(1.5), 0.0, finish);
            SceneObject::of_one_level(mesh)
        })
    };
    let mut near = black_plain();
    near.objects.extend(boxes(4..8));
    let mut large = near.clone();
    large.objects.extend(boxes(-84..-4));
    let views = vec![looking(DVec3::new(0.0, 0.0, 2.0), DVec3::new(20.0, 0.0, 1.0)); 12];
    let triangles = |scene: &SceneDescription, views: &[View]| {
        let mut renderer = renderer(&context, scene, 1);
        renderer.render(&FrameSnapshot::default(), views).expect("pictures");
        renderer.triangles()
    };
    let one = triangles(&near, &views[..1]);
    // Two or three sides of each box face the camera; the plain is cut into cells.
    assert!((32 * 4..=32 * 6 + 300).contains(&one), "{one}");
    assert_eq!(triangles(&large, &views[..1]), one);
    // A view among others is given what it is given alone.
    assert_eq!(triangles(&near, &views), one);
}
