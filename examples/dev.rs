//! Development pictures.
use city3d::camera::*;
use city3d::city::scene::*;
use city3d::geom::Pose2;
use city3d::render::*;
use city3d::snapshot::*;
use glam::*;
use std::sync::Arc;

fn car(id: u32, body: BodyType, colour: [u8; 3], pose: Pose2) -> (VehicleState, VehicleInfo) {
    let height_m = match body { BodyType::Sedan => 1.5, BodyType::Hatchback => 1.55, BodyType::Suv => 1.8, BodyType::Van => 2.2 };
    let dimensions = Dimensions { length_m: 5.0, width_m: 2.5, height_m, wheelbase_m: 3.0, track_m: 2.1, wheel_radius_m: 0.36 };
    let info = VehicleInfo { id: VehicleId(id), name: format!("cav{id}"), dimensions, appearance: Appearance { body, colour }, model: "x".into() };
    let mut state = VehicleState { id: VehicleId(id), position: pose.position.extend(0.0), orientation: DQuat::from_axis_angle(DVec3::Z, pose.yaw_rad), ..Default::default() };
    if id % 2 == 0 { state.brake_lights = true; state.indicator = Indicator::Left; }
    state.wheels[0].steer_rad = 0.3; state.wheels[1].steer_rad = 0.3;
    (state, info)
}

fn main() {
    tracing_subscriber::fmt().init();
    let t0 = std::time::Instant::now();
    let context = Context::headless(&AdapterPreference::from_environment()).unwrap();
    let mut ground = Mesh::default();
    let g = Finish::new(Surface::Grass, [96, 128, 62], Class::Grass);
    for x in -4..4 { for y in -4..4 {
    let (x, y) = (x as f32 * 20.0, y as f32 * 20.0);
    let g = if y == 0.0 { Finish::new(Surface::Asphalt, [90, 90, 92], Class::Road) } else { g };
    ground.plate(&[vec3(x, y, 0.0), vec3(x + 20.0, y, 0.0), vec3(x + 20.0, y + 20.0, 0.0), vec3(x, y + 20.0, 0.0)], g, 4.0);
    }}
    ground.block(vec3(20.0, 30.0, 0.0), vec3(12.0, 12.0, 9.0), 0.0, Finish::new(Surface::Brick, [170, 110, 90], Class::Building));
    let scene = SceneDescription { meshes: vec![ground], bounds: [vec3(-80.0, -80.0, 0.0), vec3(80.0, 80.0, 15.0)] };
    println!("scene {:?}", t0.elapsed());
    let mut renderer = Renderer::new(&context, &scene, Settings::default()).unwrap();
    println!("renderer {:?}", t0.elapsed());
    let kinds = [BodyType::Sedan, BodyType::Hatchback, BodyType::Suv, BodyType::Van];
    let colours = [[178, 34, 34], [40, 80, 150], [220, 222, 225], [40, 44, 48]];
    let (vehicles, roster): (Vec<_>, Vec<_>) = (0..4).map(|k| car(k, kinds[k as usize], colours[k as usize], Pose2::new(f64::from(k) * 7.0, 8.0, 0.0))).unzip();
    let snapshot = FrameSnapshot { vehicles, roster: Arc::new(roster), ..Default::default() };
    let lens = Lens { extent: [1280, 720], ..Default::default() };
    let views = [
        Camera::Orbit { target: dvec3(10.0, 8.0, 0.8), distance_m: 17.0, azimuth_rad: -1.0, elevation_rad: 0.25 },
        Camera::Orbit { target: dvec3(10.0, 8.0, 0.8), distance_m: 17.0, azimuth_rad: -2.3, elevation_rad: 0.2 },
        Camera::onboard(VehicleId(0), Mount::Windscreen),
    ].map(|c| c.view(&snapshot, &lens).unwrap());
    let t = std::time::Instant::now();
    let images = renderer.render(&snapshot, &views).unwrap();
    println!("3 pictures {:?}", t.elapsed());
    for (k, image) in images.iter().enumerate() { write_png(std::path::Path::new(&format!("/tmp/render/a{k}.png")), image).unwrap(); }
}
