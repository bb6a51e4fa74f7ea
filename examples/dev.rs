//! Development pictures.
use city3d::camera::*;
use city3d::city::scene::*;
use city3d::geom::Pose2;
use city3d::render::*;
use city3d::snapshot::*;
use glam::*;
use std::sync::Arc;

fn car(id: u32, body: BodyType, colour: [u8; 3], pose: Pose2) -> (VehicleState, VehicleInfo) {
    let height_m = match body {
        BodyType::Sedan => 1.5,
        BodyType::Hatchback => 1.55,
        BodyType::Suv => 1.8,
        BodyType::Van => 2.2,
    };
    let dimensions = Dimensions {
        length_m: 5.0,
        width_m: 2.5,
        height_m,
        wheelbase_m: 3.0,
        track_m: 2.1,
        wheel_radius_m: 0.36,
    };
    let info = VehicleInfo {
        id: VehicleId(id),
        name: format!("cav{id}"),
        dimensions,
        appearance: Appearance { body, colour },
        model: "x".into(),
    };
    let mut state = VehicleState {
        id: VehicleId(id),
        position: pose.position.extend(0.0),
        orientation: DQuat::from_axis_angle(DVec3::Z, pose.yaw_rad),
        ..Default::default()
    };
    if id % 2 == 0 {
        state.brake_lights = true;
        state.indicator = Indicator::Left;
    }
    state.wheels[0].steer_rad = 0.3;
    state.wheels[1].steer_rad = 0.3;
    (state, info)
}

fn main() {
    tracing_subscriber::fmt().init();
    let t0 = std::time::Instant::now();
    let context = Context::headless(&AdapterPreference::from_environment()).unwrap();
    let map =
        city3d::city::map_of_drawing(&city3d::city::generate::ids3c()).unwrap_or_else(|e| panic!("{e}"));
    println!("map {:?}", t0.elapsed());
    let map = map.map.to_city(city3d::geom::LengthScale::TESTBED);
    let scene = SceneDescription::from_map(&map);
    println!(
        "triangles {:?} bounds {:?}",
        scene.meshes.iter().map(|m| m.triangle_count()).collect::<Vec<_>>(),
        scene.bounds
    );
    println!("scene {:?}", t0.elapsed());
    let mut renderer = Renderer::new(
        &context,
        &scene,
        Settings {
            quality: if std::env::var("FAST").is_ok() { Quality::FAST } else { Quality::HIGH },
            ..Settings::default()
        },
    )
    .unwrap();
    println!("renderer {:?}", t0.elapsed());
    let kinds = [BodyType::Sedan, BodyType::Hatchback, BodyType::Suv, BodyType::Van];
    let colours =
        [[178, 34, 34], [40, 80, 150], [220, 222, 225], [40, 44, 48], [196, 148, 48], [72, 110, 84]];
    let mut cars = Vec::new();
    for (k, lane) in map.lanes.iter().filter(|l| l.curve.length() > 12.0).enumerate() {
        let k = k as u32;
        let pose = lane.curve.at(lane.curve.length() * (0.3 + 0.1 * f64::from(k % 5))).pose;
        let pose = pose.advanced(-1.5);
        if cars
            .iter()
            .any(|(s, _): &(VehicleState, VehicleInfo)| s.position.truncate().distance(pose.position) < 9.0)
        {
            continue;
        }
        cars.push(car(cars.len() as u32, kinds[(k * 7 % 4) as usize], colours[(k * 5 % 6) as usize], pose));
    }
    println!("cars {}", cars.len());
    let (vehicles, roster): (Vec<_>, Vec<_>) = cars.into_iter().unzip();
    let snapshot = FrameSnapshot { vehicles, roster: Arc::new(roster), ..Default::default() };
    let lens = Lens { extent: [1280, 720], ..Default::default() };
    if std::env::var("BENCH").is_ok() {
        for extent in [[320, 240], [640, 480]] {
            for n in [1usize, 10, 50] {
                let lens = Lens { extent, ..Default::default() };
                let views: Vec<_> = (0..n)
                    .map(|k| {
                        Camera::onboard(VehicleId(k as u32), Mount::Windscreen)
                            .view(&snapshot, &lens)
                            .unwrap()
                    })
                    .collect();
                renderer.render(&snapshot, &views).unwrap();
                let t = std::time::Instant::now();
                let mut images = 0;
                let mut pending = std::collections::VecDeque::new();
                while t.elapsed().as_secs_f64() < 3.0 {
                    pending.push_back(renderer.begin(&snapshot, &views).unwrap());
                    if pending.len() > 1 {
                        images += renderer.finish(pending.pop_front().unwrap()).unwrap().len();
                    }
                }
                while let Some(p) = pending.pop_front() {
                    images += renderer.finish(p).unwrap().len();
                }
                println!("{extent:?} {n} cameras: {:.1} images/s", images as f64 / t.elapsed().as_secs_f64());
                let folder = std::path::Path::new("/tmp/render/bench");
                std::fs::create_dir_all(folder).unwrap();
                let t = std::time::Instant::now();
                let mut stream = PngStream::new(&mut renderer);
                let mut batch = 0;
                while t.elapsed().as_secs_f64() < 3.0 {
                    stream
                        .push(
                            &snapshot,
                            &views,
                            (0..n).map(|k| folder.join(format!("{}_{k}.png", batch % 4))).collect(),
                        )
                        .unwrap();
                    batch += 1;
                }
                let written = stream.finish().unwrap();
                println!("  with PNG: {:.1} images/s", written as f64 / t.elapsed().as_secs_f64());
            }
        }
        return;
    }
    let views = [
        Camera::Orbit {
            target: dvec3(-50.0, -48.0, 0.0),
            distance_m: 48.0,
            azimuth_rad: 0.9,
            elevation_rad: 0.42,
        },
        Camera::onboard(VehicleId(0), Mount::Windscreen),
        Camera::chase(VehicleId(12)),
        Camera::Overhead { centre: dvec2(0.0, 0.0), height_m: 180.0 },
        Camera::Orbit {
            target: dvec3(-20.0, 15.0, 2.0),
            distance_m: 60.0,
            azimuth_rad: -2.0,
            elevation_rad: 0.5,
        },
        Camera::onboard(VehicleId(20), Mount::Bumper),
        Camera::Overhead { centre: dvec2(0.0, -10.0), height_m: 50.0 },
        Camera::chase(VehicleId(5)),
    ]
    .map(|c| c.view(&snapshot, &lens).unwrap());
    for m in &scene.meshes {
        for v in &m.vertices {
            assert!(
                v.position.is_finite()
                    && v.normal.is_finite()
                    && v.uv.is_finite()
                    && v.position.abs().max_element() < 2000.0,
                "{v:?}"
            );
        }
    }
    let t = std::time::Instant::now();
    let mut images = Vec::new();
    for (k, v) in views.iter().enumerate() {
        images.extend(renderer.render(&snapshot, &[*v]).unwrap());
        println!("view {k} {:?}", t.elapsed());
    }
    println!("pictures {:?}", t.elapsed());
    for (k, image) in images.iter().enumerate() {
        write_png(std::path::Path::new(&format!("/tmp/render/a{k}.png")), image).unwrap();
    }
}
