//! Depth, classes and instances against geometry: known points and known boxes, small pictures on the
//! software adapter.

use crate::drawing;

use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleInfo, VehicleState};
use city3d_render::{Context, Pictures, Plane, Quality, RenderError, RenderRequest, Renderer, Settings};
use city3d_scene::{Class, Finish, Mesh, SceneDescription, SceneObject, Surface};
use city3d_sensors::{Camera, Extrinsics, Lens, Mount, PictureKind, PictureKinds, Projection, View};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use drawing::{DIMENSIONS, snapshot, software};
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::sync::Arc;

fn renderer(context: &Context, scene: &SceneDescription) -> Renderer {
    let quality = Quality { shadow_texels: 1024, ..Quality::LOW };
    Renderer::new(context, scene, Settings { quality, ..Settings::default() }).expect("a renderer")
}

/// Where the wall of [`wall_on_a_plain`] faces the west.
const WALL_X: f32 = 20.0;

/// Level ground with a wall across it, from y = -10 to 10 and 4 m high.
fn wall_on_a_plain() -> SceneDescription {
    let mut mesh = Mesh::default();
    let ground = Finish::new(Surface::Plain, [90; 3], Class::Road);
    let ring =
        [(-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    mesh.plate(&ring, ground, 1.0);
    let wall = Finish::new(Surface::Plain, [200; 3], Class::Wall);
    mesh.block(Vec3::new(WALL_X + 0.5, 0.0, 0.0), Vec3::new(1.0, 20.0, 4.0), 0.0, wall);
    SceneDescription {
        ground: vec![SceneObject::of_one_level(mesh)],
        bounds: [Vec3::new(-60.0, -60.0, 0.0), Vec3::new(60.0, 60.0, 10.0)],
        ..SceneDescription::default()
    }
}

fn car(id: u32, at: DVec2, yaw_rad: f64) -> (VehicleState, VehicleInfo) {
    drawing::car(id, at, yaw_rad, [255, 0, 255])
}

/// A width that is no multiple of what rows are padded to.
fn lens() -> Lens {
    Lens { extent: [300, 225], ..Lens::default() }
}

fn looking(from: DVec3, at: DVec3) -> View {
    View::new(Extrinsics::looking_at(from, at), &lens())
}

fn all() -> PictureKinds {
    PictureKind::ALL.into_iter().collect()
}

fn take(renderer: &mut Renderer, snapshot: &FrameSnapshot, view: &View) -> Pictures {
    let request = RenderRequest { view: *view, kinds: all() };
    renderer.render_kinds(snapshot, &[request]).expect("pictures").remove(0)
}

struct Seen {
    depth: Plane<f32>,
    semantic: Plane<u8>,
    instance: Plane<u16>,
    pixels: Vec<(u32, u32)>,
}

impl Seen {
    fn new(pictures: Pictures) -> Self {
        let (depth, semantic, instance) =
            (pictures.depth.unwrap(), pictures.semantic.unwrap(), pictures.instance.unwrap());
        let extent = [depth.width, depth.height];
        assert!([semantic.width, semantic.height] == extent && [instance.width, instance.height] == extent);
        let pixels = (0..extent[1]).flat_map(|y| (0..extent[0]).map(move |x| (x, y))).collect();
        Self { depth, semantic, instance, pixels }
    }

    fn of_class(&self, class: Class) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.pixels.iter().copied().filter(move |&(x, y)| self.semantic.at(x, y) == class as u8)
    }

    /// Smallest box around a vehicle: left, top, right, bottom.
    fn outline(&self, id: u16) -> Option<[f64; 4]> {
        let of = self.pixels.iter().filter(|&&(x, y)| self.instance.at(x, y) == id);
        of.map(|&(x, y)| DVec2::new(f64::from(x), f64::from(y))).fold(None, |found, p| {
            let [l, t, r, b] = found.unwrap_or([p.x, p.y, p.x, p.y]);
            Some([l.min(p.x), t.min(p.y), r.max(p.x), b.max(p.y)])
        })
    }

    /// What holds of every picture: vehicles where the classes say so, and depth where there is anything.
    /// Cars that are parked are of that class and have no number.
    fn assert_agree(&self, has_parked: bool) {
        for &(x, y) in &self.pixels {
            let (depth, class) = (self.depth.at(x, y), self.semantic.at(x, y));
            assert!(usize::from(class) < Class::ALL.len(), "class {class} at ({x}, {y})");
            let (is_vehicle, has_number) = (class == Class::Vehicle as u8, self.instance.at(x, y) > 0);
            let agree = has_number == is_vehicle || has_parked && is_vehicle;
            assert!(agree, "class {class}, number {has_number} at ({x}, {y})");
            assert_eq!(depth.is_infinite(), class == Class::Sky as u8, "class {class} at ({x}, {y})");
            assert!(depth > 0.0, "depth {depth} at ({x}, {y})");
        }
    }
}

/// The point of the city that a pixel shows, as a user of OpenCV finds it.
fn unprojected(view: &View, (x, y): (u32, u32), depth_m: f32) -> DVec3 {
    let Projection::Pinhole { intrinsics: k, .. } = view.projection else { panic!("no pinhole") };
    let ray = DVec3::new((f64::from(x) - k.cx) / k.fx, (f64::from(y) - k.cy) / k.fy, 1.0);
    view.extrinsics.position + view.extrinsics.orientation * (ray * f64::from(depth_m))
}

/// Pixel corners of a car's measures: all eight.
fn corners(view: &View, state: &VehicleState) -> [(DVec2, f64); 8] {
    let half = DVec3::new(DIMENSIONS.length_m / 2.0, DIMENSIONS.width_m / 2.0, DIMENSIONS.height_m);
    std::array::from_fn(|k| {
        let sign = |bit: u32| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let z = if k >> 2 & 1 == 0 { 0.0 } else { half.z };
        let at = state.position + state.orientation * DVec3::new(sign(0) * half.x, sign(1) * half.y, z);
        let depth = view.extrinsics.forward().dot(at - view.extrinsics.position);
        (view.project(at).expect("in front of the camera"), depth)
    })
}

#[test]
fn a_wall_and_the_ground_lie_at_their_distances() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &wall_on_a_plain());
    // Straight at the wall, and askew from above.
    for view in [
        looking(DVec3::new(2.0, 0.0, 1.5), DVec3::new(20.0, 0.0, 1.5)),
        looking(DVec3::new(3.0, -9.0, 5.0), DVec3::new(20.0, 2.0, 1.0)),
    ] {
        let seen = Seen::new(take(&mut renderer, &snapshot(Vec::new()), &view));
        seen.assert_agree(false);
        let (mut walls, mut roads) = (0, 0);
        for at in seen.of_class(Class::Road) {
            let point = unprojected(&view, at, seen.depth.at(at.0, at.1));
            assert!(point.z.abs() < 1e-3, "road at {at:?}: {point}");
            roads += 1;
        }
        for at in seen.of_class(Class::Wall) {
            let point = unprojected(&view, at, seen.depth.at(at.0, at.1));
            let is_front = (point.x - f64::from(WALL_X)).abs() < 2e-3;
            let is_lid = (point.z - 4.0).abs() < 2e-3 && point.x > 20.0;
            assert!(is_front || is_lid, "wall at {at:?}: {point}");
            walls += 1;
        }
        assert!(walls > 5000 && roads > 10_000, "{walls} pixels of wall, {roads} of road");
    }
    // Straight ahead every pixel of the wall is as deep as its middle: depth is no distance.
    let view = looking(DVec3::new(2.0, 0.0, 1.5), DVec3::new(20.0, 0.0, 1.5));
    let seen = Seen::new(take(&mut renderer, &snapshot(Vec::new()), &view));
    let known = [(DVec3::new(20.0, -4.0, 3.0), Class::Wall), (DVec3::new(10.0, 2.0, 0.0), Class::Road)];
    for (point, class) in known {
        let pixel = view.project(point).unwrap().round().as_uvec2();
        assert_eq!(seen.semantic.at(pixel.x, pixel.y), class as u8);
        let depth = f64::from(seen.depth.at(pixel.x, pixel.y));
        // A pixel of ground is some centimetres deep at this distance.
        assert!((depth - (point.x - 2.0)).abs() < 0.15, "{point}: {depth}");
    }
    let sky = view.project(DVec3::new(20.0, 0.0, 6.0)).unwrap().round().as_uvec2();
    assert_eq!(seen.semantic.at(sky.x, sky.y), Class::Sky as u8);
}

#[test]
fn a_painted_line_is_as_wide_as_its_paint() {
    let Some(context) = software() else { return };
    let mut scene = wall_on_a_plain();
    let paint = Finish::new(Surface::Line, [230; 3], Class::Marking);
    // Along x from 0 to 12 m, of 0.4 m; for the colours the mesh is wider, and lies higher than the road.
    let corners = [(0.0, -0.6), (12.0, -0.6), (12.0, 0.6), (0.0, 0.6)];
    let across = corners.map(|(_, y)| Vec2::new(y, 0.2));
    scene.ground[0].levels[0].mesh.face(&corners.map(|(x, y)| Vec3::new(x, y, 0.012)), &across, paint);
    let mut renderer = renderer(&context, &scene);
    let view = looking(DVec3::new(-6.0, -0.5, 3.0), DVec3::new(8.0, 0.0, 0.0));
    let seen = Seen::new(take(&mut renderer, &snapshot(Vec::new()), &view));
    seen.assert_agree(false);
    let mut painted = 0;
    for at in seen.pixels.iter().copied() {
        let class = seen.semantic.at(at.0, at.1);
        if class != Class::Road as u8 && class != Class::Marking as u8 {
            continue;
        }
        let point = unprojected(&view, at, seen.depth.at(at.0, at.1));
        let is_paint = point.y.abs() < 0.2 && (0.0..12.0).contains(&point.x);
        let is_border =
            (point.y.abs() - 0.2).abs() < 0.02 || point.x.abs() < 0.03 || (point.x - 12.0).abs() < 0.2;
        assert!(is_border || is_paint == (class == Class::Marking as u8), "class {class} at {point}");
        assert!(class == Class::Marking as u8 || point.z.abs() < 1e-3, "road at {point}");
        painted += u32::from(class == Class::Marking as u8);
    }
    assert!(painted > 300, "{painted} pixels of paint");
}

#[test]
fn a_car_is_where_its_pose_says_in_every_kind() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &wall_on_a_plain());
    let view = looking(DVec3::new(-14.0, 0.0, 1.4), DVec3::new(20.0, 0.0, 1.0));
    for (id, x, y, yaw) in [
        (3, 0.0, 0.0, 0.0),
        (65_535, 0.0, 3.0, 0.4),
        (7, 8.0, -5.0, 1.6),
        (1, 4.0, 2.0, -2.5),
        (2, 16.0, 0.0, 0.2),
    ] {
        let (state, info) = car(id, DVec2::new(x, y), yaw);
        let corners = corners(&view, &state);
        let want = corners.iter().fold([f64::MAX, f64::MAX, f64::MIN, f64::MIN], |b, (p, _)| {
            [b[0].min(p.x), b[1].min(p.y), b[2].max(p.x), b[3].max(p.y)]
        });
        let pictures = take(&mut renderer, &snapshot(vec![(state, info)]), &view);
        let image = pictures.rgb.clone().unwrap();
        let seen = Seen::new(pictures);
        seen.assert_agree(false);
        let got = seen.outline(id as u16).expect("the car shows");
        // Bodies are round, so that a silhouette stays within the box and nearly fills it.
        for side in 0..4 {
            let size = want[2 + side % 2] - want[side % 2];
            let outside = if side < 2 { want[side] - got[side] } else { got[side] - want[side] };
            assert!(outside < 1.5, "vehicle {id}, side {side}: drawn {got:?}, projected {want:?}");
            assert!(
                -outside < 0.12 * size + 2.0,
                "vehicle {id}, side {side}: drawn {got:?}, projected {want:?}"
            );
        }
        let near = corners.iter().map(|c| c.1).fold(f64::MAX, f64::min);
        let far = corners.iter().map(|c| c.1).fold(f64::MIN, f64::max);
        for at in seen.of_class(Class::Vehicle) {
            let depth = f64::from(seen.depth.at(at.0, at.1));
            assert!((near - 0.05..far + 0.05).contains(&depth), "vehicle {id} at {at:?}: {depth}");
        }
        // The first surface that is seen is that of the near side.
        let nearest = seen
            .of_class(Class::Vehicle)
            .map(|(x, y)| f64::from(seen.depth.at(x, y)))
            .fold(f64::MAX, f64::min);
        assert!(nearest - near < 0.5, "vehicle {id}: {nearest} of {near}");
        // Its paint, which nothing else has, is seen on the vehicle alone.
        for y in 0..image.height {
            for x in 0..image.width {
                let [r, g, b] = image.pixel(x, y).map(i32::from);
                if r > g + 60 && b > g + 60 {
                    assert_eq!(u32::from(seen.instance.at(x, y)), id, "paint at ({x}, {y})");
                }
            }
        }
    }
}

#[test]
fn who_stands_in_front_hides_the_others() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &wall_on_a_plain());
    let view = looking(DVec3::new(-14.0, 0.0, 1.4), DVec3::new(20.0, 0.0, 1.0));
    let cars = [car(4, DVec2::new(6.0, 2.0), 1.57), car(9, DVec2::new(-2.0, 0.0), 0.0)];
    let seen = Seen::new(take(&mut renderer, &snapshot(cars.to_vec()), &view));
    seen.assert_agree(false);
    // A point of the near one's rear, in front of the far one's side.
    let hidden = view.project(DVec3::new(-4.5, 0.0, 0.9)).unwrap().round().as_uvec2();
    assert_eq!(seen.instance.at(hidden.x, hidden.y), 9);
    let beside = view.project(DVec3::new(5.0, 3.8, 0.7)).unwrap().round().as_uvec2();
    assert_eq!(seen.instance.at(beside.x, beside.y), 4);
    // The wall behind hides what is behind it.
    let behind = Seen::new(take(&mut renderer, &snapshot(vec![car(5, DVec2::new(30.0, 0.0), 0.0)]), &view));
    assert_eq!(behind.outline(5), None);
}

#[test]
fn depth_lies_on_the_road_of_the_city() {
    let Some(context) = software() else { return };
    let (text, library) = Library::scenario("roundabout").unwrap();
    let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
    let scene = SceneDescription::from_map(&experiment.city_map);
    let lanes = experiment.city_map.lanes.iter().flat_map(|lane| [lane.curve.start(), lane.curve.end()]);
    let ends: Vec<DVec2> = lanes.map(|pose| pose.position).collect();
    // Half the width of the widest road beside its lanes, and how high roads that lead out begin.
    const BESIDE_M: f64 = 5.0;
    const PAVEMENT_M: f64 = 0.145;
    let low = ends.iter().fold(DVec2::INFINITY, |low, at| low.min(*at)) - BESIDE_M;
    let high = ends.iter().fold(DVec2::NEG_INFINITY, |high, at| high.max(*at)) + BESIDE_M;
    let mut renderer = renderer(&context, &scene);
    let mut run = Run::new(Arc::new(experiment)).unwrap();
    while run.snapshot().tick < 300 {
        run.step();
    }
    let at = run.snapshot();
    let (mut streets, mut ramps) = (0, 0);
    for (id, mount) in [(2, Mount::Windscreen), (4, Mount::Windscreen), (6, Mount::Bumper)] {
        let view = Camera::onboard(VehicleId(id), mount).view(at, &lens()).unwrap();
        let seen = Seen::new(take(&mut renderer, at, &view));
        seen.assert_agree(true);
        for pixel in seen.of_class(Class::Road) {
            let depth = seen.depth.at(pixel.0, pixel.1);
            let point = unprojected(&view, pixel, depth);
            // Roads that lead out rise with the land.
            if !(low.cmplt(point.truncate()).all() && point.truncate().cmplt(high).all()) {
                continue;
            }
            // Patches and lanes lie some millimetres higher than the road around them; a road that leads out climbs the
            // pavement.
            assert!(
                (-0.01..PAVEMENT_M + 0.01).contains(&point.z),
                "vehicle {id}, {pixel:?}, {depth} m: {point}"
            );
            let is_street = point.z < 0.01;
            (streets, ramps) = (streets + usize::from(is_street), ramps + usize::from(!is_street));
        }
        // Of the own body only what the picture shows.
        let own = seen.pixels.iter().filter(|&&(x, y)| u32::from(seen.instance.at(x, y)) == id);
        assert!(own.clone().all(|&(_, y)| y > 140), "{:?}", own.min_by_key(|at| at.1));
    }
    assert!(streets > 20_000 && ramps * 50 < streets, "{streets} pixels of streets, {ramps} of ramps");
}

#[test]
fn requests_get_what_they_ask_for_whatever_the_others_want() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &wall_on_a_plain());
    let snapshot = snapshot(vec![car(3, DVec2::new(2.0, 0.0), 0.3)]);
    let small = Lens { extent: [33, 20], ..Lens::default() };
    let from = |x: f64, lens: &Lens| {
        View::new(Extrinsics::looking_at(DVec3::new(x, 1.0, 2.0), DVec3::new(20.0, 0.0, 1.0)), lens)
    };
    let kinds = |kinds: &[PictureKind]| kinds.iter().copied().collect::<PictureKinds>();
    let requests = [
        RenderRequest { view: from(-14.0, &lens()), kinds: kinds(&[PictureKind::Instance]) },
        RenderRequest { view: from(-12.0, &small), kinds: all() },
        RenderRequest { view: from(-10.0, &lens()), kinds: PictureKinds::RGB },
        RenderRequest {
            view: from(-9.0, &lens()),
            kinds: kinds(&[PictureKind::Depth, PictureKind::Semantic]),
        },
        RenderRequest { view: from(-8.0, &small), kinds: PictureKinds::NONE },
    ];
    let together = renderer.render_kinds(&snapshot, &requests).unwrap();
    let there =
        |p: &Pictures| [p.rgb.is_some(), p.depth.is_some(), p.semantic.is_some(), p.instance.is_some()];
    let expected = [
        [false, false, false, true],
        [true; 4],
        [true, false, false, false],
        [false, true, true, false],
        [false; 4],
    ];
    for ((request, pictures), expected) in requests.iter().zip(&together).zip(expected) {
        assert_eq!(there(pictures), expected);
        let alone = renderer.render_kinds(&snapshot, &[*request]).unwrap().remove(0);
        let differ = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 1e-2).count();
        if let (Some(a), Some(b)) = (&alone.depth, &pictures.depth) {
            assert!(differ(&a.values, &b.values) * 1000 <= a.values.len());
        }
        if let (Some(a), Some(b)) = (&alone.instance, &pictures.instance) {
            let off = a.values.iter().zip(&b.values).filter(|(a, b)| a != b).count();
            assert!(off * 500 <= a.values.len() && b.values.contains(&3), "{off} pixels of another vehicle");
        }
    }
    assert_eq!(renderer.max_batch_len(&requests), requests.len());
    assert_eq!(renderer.max_batch_len(&[]), 0);
}

#[test]
fn vehicles_that_no_pixel_can_tell_are_refused_by_number() {
    let Some(context) = software() else { return };
    let mut renderer = renderer(&context, &wall_on_a_plain());
    let view = looking(DVec3::new(-14.0, 0.0, 1.4), DVec3::new(20.0, 0.0, 1.0));
    for id in [0, 65_536] {
        let with = snapshot(vec![car(id, DVec2::ZERO, 0.0)]);
        let error = renderer.render_kinds(&with, &[RenderRequest { view, kinds: all() }]).unwrap_err();
        assert!(matches!(error, RenderError::Number { vehicle } if vehicle.0 == id), "{error}");
        assert!(renderer.render(&with, &[view]).is_ok());
    }
}

/// What the finest preset shows of a kind of thing on more than two pixels across, the quickest one shows too,
/// within so many pixels.
#[test]
fn low_shows_what_ultra_shows() {
    const AROUND: i32 = 3;
    let Some(context) = software() else { return };
    let (text, library) = Library::scenario("city").unwrap();
    let experiment = Arc::new(read_experiment("city", &text, &library, Overrides::default()).unwrap());
    let scene = SceneDescription::with_models(&experiment.city_map, &experiment.models.placed);
    let run = Run::new(experiment).unwrap();
    let snapshot = run.snapshot();
    let kinds: PictureKinds = [PictureKind::Semantic, PictureKind::Instance].into_iter().collect();
    let requests: Vec<RenderRequest> = snapshot
        .vehicles
        .iter()
        .step_by(9)
        .map(|vehicle| {
            let view = Camera::onboard(vehicle.id, Mount::Windscreen).view(snapshot, &lens()).unwrap();
            RenderRequest { view, kinds }
        })
        .collect();
    let pictures = |quality: Quality| {
        let settings = Settings { quality, ..Settings::default() };
        Renderer::new(&context, &scene, settings).unwrap().render_kinds(snapshot, &requests).unwrap()
    };
    let (low, ultra) = (pictures(Quality::LOW), pictures(Quality { shadow_texels: 512, ..Quality::ULTRA }));
    let kinds_of_things = [Class::Building, Class::Marking, Class::Vehicle].map(|class| class as u8);
    let (mut looked_at, mut missing) = (0_u32, 0_u32);
    for (low, ultra) in low.iter().zip(&ultra) {
        let (low, ultra) = (low.semantic.as_ref().unwrap(), ultra.semantic.as_ref().unwrap());
        let (width, height) = (ultra.width as i32, ultra.height as i32);
        let square = |picture: &Plane<u8>, (x, y): (i32, i32), reach: i32| -> Vec<u8> {
            let rows = (y - reach).max(0)..=(y + reach).min(height - 1);
            let columns = (x - reach).max(0)..=(x + reach).min(width - 1);
            rows.flat_map(|y| columns.clone().map(move |x| (x, y)))
                .map(|(x, y)| picture.at(x as u32, y as u32))
                .collect()
        };
        for at in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let class = ultra.at(at.0 as u32, at.1 as u32);
            if kinds_of_things.contains(&class) && square(ultra, at, 1).iter().all(|&c| c == class) {
                looked_at += 1;
                // A crown of few triangles closes gaps between leaves.
                let is_behind_leaves = low.at(at.0 as u32, at.1 as u32) == Class::Vegetation as u8;
                missing += u32::from(!is_behind_leaves && !square(low, at, AROUND).contains(&class));
            }
        }
    }
    assert!(looked_at > 20_000, "{looked_at}");
    assert!(missing == 0, "{missing} of {looked_at} pixels");
    let seen_on = |pictures: &[Pictures]| -> Vec<Vec<u16>> {
        let numbers = |pictures: &Pictures| {
            let plane = pictures.instance.as_ref().unwrap();
            let mut counts = std::collections::BTreeMap::new();
            for &number in plane.values.iter().filter(|&&number| number > 0) {
                *counts.entry(number).or_insert(0) += 1;
            }
            counts.into_iter().filter(|&(_, count)| count > 8).map(|(number, _)| number).collect()
        };
        pictures.iter().map(numbers).collect()
    };
    for (low, ultra) in low.iter().zip(seen_on(&ultra)) {
        let plane = low.instance.as_ref().unwrap();
        for number in ultra {
            assert!(plane.values.contains(&number), "vehicle {number}");
        }
    }
}

/// By day most drivers of the city see somebody; a person is at least so many pixels.
#[test]
fn most_drivers_of_the_city_see_people() {
    const LEAST_PX: usize = 6;
    let Some(context) = software() else { return };
    let (text, library) = Library::scenario("city").unwrap();
    let experiment = Arc::new(read_experiment("city", &text, &library, Overrides::default()).unwrap());
    let scene = SceneDescription::with_models(&experiment.city_map, &experiment.models.placed);
    let run = Run::new(experiment).unwrap();
    let snapshot = run.snapshot();
    let kinds: PictureKinds = [PictureKind::Semantic].into_iter().collect();
    let requests: Vec<RenderRequest> = snapshot
        .vehicles
        .iter()
        .map(|vehicle| {
            let view =
                Camera::onboard(vehicle.id, Mount::Windscreen).view(snapshot, &Lens::default()).unwrap();
            RenderRequest { view, kinds }
        })
        .collect();
    let pictures = renderer(&context, &scene).render_kinds(snapshot, &requests).unwrap();
    let person = Class::Person as u8;
    let sees = |pictures: &&Pictures| {
        let semantic = pictures.semantic.as_ref().unwrap();
        semantic.values.iter().filter(|&&class| class == person).count() >= LEAST_PX
    };
    let seeing = pictures.iter().filter(sees).count();
    assert!(10 * seeing >= 6 * pictures.len() && pictures.len() == 50, "{seeing} of {}", pictures.len());
}
