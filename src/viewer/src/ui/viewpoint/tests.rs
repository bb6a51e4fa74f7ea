//! Tests of the large view's camera: what it sees, how it moves, and what it follows.

use super::*;
use city3d_protocol::snapshot::{Appearance, Dimensions, VehicleInfo, VehicleState};
use std::sync::Arc;

fn snapshot(x: f64) -> FrameSnapshot {
    let dimensions = Dimensions {
        length_m: 5.0,
        width_m: 2.5,
        height_m: 1.5,
        wheelbase_m: 3.0,
        track_m: 2.1,
        wheel_radius_m: 0.34,
    };
    let info = VehicleInfo {
        id: VehicleId(3),
        name: "car".into(),
        dimensions,
        appearance: Appearance::default(),
        model: String::new(),
    };
    let vehicle =
        VehicleState { id: VehicleId(3), position: DVec3::new(x, 4.0, 0.0), ..VehicleState::default() };
    FrameSnapshot { vehicles: vec![vehicle], roster: Arc::new(vec![info]), ..FrameSnapshot::default() }
}

fn sees(viewpoint: &Viewpoint, seen: &FrameSnapshot) -> bool {
    let pixel = viewpoint.view(seen, [400, 300]).project(seen.vehicles[0].position + DVec3::Z);
    pixel.is_some_and(|p| (0.0..400.0).contains(&p.x) && (0.0..300.0).contains(&p.y))
}

#[test]
fn every_mode_but_onboard_sees_the_vehicle_that_it_follows() {
    let seen = snapshot(10.0);
    for mode in [CameraMode::Orbit, CameraMode::Chase, CameraMode::Overhead] {
        let mut viewpoint = Viewpoint::around(&snapshot(-200.0));
        viewpoint.follow = Some(VehicleId(3));
        viewpoint.set_mode(mode, None);
        viewpoint.update(&seen);
        assert!(sees(&viewpoint, &seen), "{mode:?}");
    }
    let mut viewpoint = Viewpoint::around(&seen);
    viewpoint.set_mode(CameraMode::Free, None);
    assert!(sees(&viewpoint, &seen), "the free camera starts where the orbit was");
    viewpoint.set_mode(CameraMode::Onboard, Some(VehicleId(3)));
    assert_eq!(viewpoint.view(&seen, [400, 300]).carrier, Some(VehicleId(3)));
}

#[test]
fn a_free_camera_that_is_asked_for_at_first_begins_where_the_orbit_would() {
    let mut seen = snapshot(-70.0);
    let far = DVec3::new(-10.0, 90.0, 0.0);
    seen.vehicles.push(VehicleState { id: VehicleId(4), position: far, ..seen.vehicles[0].clone() });
    let (mut orbit, mut free) = (Viewpoint::around(&seen), Viewpoint::around(&seen));
    free.set_mode(CameraMode::Free, None);
    for _ in 0..2 {
        orbit.show_whole(&seen, [400, 300], &[]);
        free.show_whole(&seen, [400, 300], &[]);
    }
    assert_eq!(free.mode, CameraMode::Free);
    let [orbit, free] = [orbit, free].map(|viewpoint| viewpoint.view(&seen, [400, 300]).extrinsics.position);
    assert!((orbit - free).length() < 1.5, "{free}, the orbit is at {orbit}");
}

#[test]
fn at_first_everything_that_drives_is_seen_in_pictures_of_all_shapes() {
    let mut seen = snapshot(-70.0);
    seen.vehicles.push(VehicleState {
        id: VehicleId(4),
        position: DVec3::new(-10.0, 60.0, 0.0),
        ..seen.vehicles[0].clone()
    });
    for mode in [CameraMode::Orbit, CameraMode::Overhead] {
        for extent in [[586, 662], [1400, 500], [700, 900]] {
            let mut viewpoint = Viewpoint::around(&seen);
            viewpoint.set_mode(mode, None);
            viewpoint.show_whole(&seen, extent, &[]);
            let corners = [(-88.0, -14.0), (8.0, -14.0), (8.0, 78.0), (-88.0, 78.0)];
            let view = viewpoint.view(&seen, extent);
            let pixels = corners.map(|(x, y)| view.project(DVec3::new(x, y, 0.0)).unwrap());
            let size = DVec2::from(extent.map(f64::from));
            assert!(
                pixels.iter().all(|p| p.min_element() >= 0.0 && p.cmple(size).all()),
                "{mode:?} {pixels:?}"
            );
            let widest = |of: fn(&DVec2) -> f64| {
                let values = pixels.iter().map(of);
                values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
            };
            let share = (widest(|p| p.x) / size.x).max(widest(|p| p.y) / size.y);
            assert!(share > 0.8, "{mode:?} {extent:?}: no farther away than it has to be, {share}");
            // Whoever has moved it finds it where it was left.
            viewpoint.zoom(3.0);
            let left = viewpoint.clone();
            viewpoint.show_whole(&seen, extent, &[]);
            assert_eq!(viewpoint, left);
        }
    }
}

#[test]
fn at_first_it_looks_from_where_walls_hide_the_fewest() {
    let seen = snapshot(10.0);
    let extent = [800, 600];
    let mut usual = Viewpoint::around(&seen);
    usual.show_whole(&seen, extent, &[]);
    assert_eq!([usual.azimuth_rad, usual.elevation_rad], UNTURNED_RAD);
    let eye = usual.view(&seen, extent).extrinsics.position;
    // Before the car, across the usual line of sight, and so high that it hides it from there.
    let car = seen.vehicles[0].position;
    let (towards, across) = ((eye - car).truncate().normalize(), (eye - car).truncate().normalize().perp());
    let end = |side: f64| (car.truncate() + towards * 6.0 + across * side).as_vec2();
    let wall = Wall { from: end(-5.0), to: end(5.0), height_m: 40.0 };
    let is_hidden = |viewpoint: &Viewpoint| {
        occlusion::is_occluded(viewpoint.view(&seen, extent).extrinsics.position, car + DVec3::Z, &[wall])
    };
    assert!(is_hidden(&usual));
    let mut turned = Viewpoint::around(&seen);
    turned.show_whole(&seen, extent, &[wall]);
    assert!(!is_hidden(&turned) && sees(&turned, &seen));
    // Once, not whenever something drives on.
    let azimuth_rad = turned.azimuth_rad;
    turned.show_whole(&snapshot(40.0), extent, &[]);
    assert_eq!(turned.azimuth_rad, azimuth_rad);
}

#[test]
fn looking_back_sees_what_is_behind() {
    let seen = snapshot(10.0);
    let behind = DVec3::new(-15.0, 4.0, 0.5);
    for mode in [CameraMode::Chase, CameraMode::Onboard] {
        let mut viewpoint = Viewpoint::around(&seen);
        viewpoint.set_mode(mode, Some(VehicleId(3)));
        viewpoint.rear = true;
        let pixel = viewpoint.view(&seen, [400, 300]).project(behind);
        assert!(pixel.is_some_and(|p| (50.0..350.0).contains(&p.x)), "{mode:?} {pixel:?}");
    }
}

#[test]
fn chase_and_onboard_cameras_turn_and_zoom_and_begin_again_with_another_mode() {
    let seen = snapshot(10.0);
    let eye_and_axis = |viewpoint: &Viewpoint| {
        let view = viewpoint.view(&seen, [400, 300]);
        (view.extrinsics.position - seen.vehicles[0].position, view.extrinsics.forward(), view)
    };
    let fov_rad = |viewpoint: &Viewpoint| viewpoint.gaze.lens(Lens::default()).vertical_fov_rad;
    let mut viewpoint = Viewpoint::around(&seen);
    let orbit_m = viewpoint.distance_m;
    viewpoint.set_mode(CameraMode::Chase, Some(VehicleId(3)));
    let (usual, _, view) = eye_and_axis(&viewpoint);
    let lens = Lens { extent: [400, 300], ..Lens::default() };
    let camera = Camera::Chase { vehicle: VehicleId(3), distance_m: 9.0, height_m: 3.6 };
    let expected = camera.view(&seen, &lens).unwrap();
    assert!((view.extrinsics.position - expected.extrinsics.position).length() < 1e-9);
    assert!((view.extrinsics.forward() - expected.extrinsics.forward()).length() < 1e-9);
    // A quarter turn, a higher camera, three times as far away.
    viewpoint.turn(FRAC_PI_2 / RAD_PER_POINT, 0.5 / RAD_PER_POINT);
    let (turned, _, _) = eye_and_axis(&viewpoint);
    assert!(turned.x.abs() < 1e-6 && turned.y > 5.0 && turned.z > usual.z + 2.0, "{turned}");
    viewpoint.zoom(-8.6);
    let (far, axis, _) = eye_and_axis(&viewpoint);
    assert!((far.length() / turned.length() - 3.0).abs() < 0.02, "{far}");
    assert!(axis.dot(-far.normalize()) > 0.9 && sees(&viewpoint, &seen));
    viewpoint.turn(0.0, 1e4);
    assert!(eye_and_axis(&viewpoint).0.z > 0.9 * far.length(), "it stays above the ground");
    viewpoint.set_mode(CameraMode::Onboard, None);
    let (seat, ahead, before) = eye_and_axis(&viewpoint);
    assert!(ahead.x > 0.9);
    viewpoint.turn(FRAC_PI_2 / RAD_PER_POINT, -0.3 / RAD_PER_POINT);
    let (still, right, _) = eye_and_axis(&viewpoint);
    assert!((seat - still).length() < 1e-9 && right.y < -0.8 && right.z > ahead.z + 0.2, "{right}");
    viewpoint.zoom(6.0);
    assert!(fov_rad(&viewpoint) < 0.6 * Lens::default().vertical_fov_rad);
    let [near, far] = [viewpoint.view(&seen, [400, 300]), before].map(|view| view.clip_from_world());
    assert!(near != far);
    // The wheel has moved no other camera, and who comes back finds the usual view.
    viewpoint.set_mode(CameraMode::Chase, None);
    assert!((eye_and_axis(&viewpoint).0 - usual).length() < 1e-9);
    assert_eq!(viewpoint.distance_m, orbit_m);
}

#[test]
fn a_bookmark_keeps_the_turn_and_zoom_of_cameras_that_ride_on_a_vehicle() {
    let seen = snapshot(10.0);
    let picture = |viewpoint: &Viewpoint| viewpoint.view(&seen, [400, 300]).clip_from_world();
    for mode in [CameraMode::Chase, CameraMode::Onboard] {
        let mut viewpoint = Viewpoint::around(&seen);
        viewpoint.set_mode(mode, Some(VehicleId(3)));
        let usual = picture(&viewpoint);
        viewpoint.turn(80.0, 30.0);
        viewpoint.zoom(-2.0);
        let stored = picture(&viewpoint);
        assert!(stored != usual, "{mode:?}");
        let mut bookmarks = Bookmarks::default();
        bookmarks.set(1, &viewpoint);
        let text = toml::to_string(bookmarks.get(1).unwrap()).unwrap();
        let bookmark: Bookmark = toml::from_str(&text).unwrap();
        viewpoint.set_mode(CameraMode::Orbit, None);
        viewpoint.recall(&bookmark);
        viewpoint.update(&seen);
        assert_eq!(picture(&viewpoint), stored, "{mode:?}");
        // Settings of an earlier version have neither.
        let old = text.split("[gaze]").next().unwrap();
        viewpoint.recall(&toml::from_str(old).unwrap());
        assert_eq!(picture(&viewpoint), usual, "{mode:?}");
    }
}

#[test]
fn the_chase_camera_stays_outside_of_its_vehicle_however_near_it_comes() {
    for length_m in [4.0, 12.0, 18.0] {
        let mut seen = snapshot(10.0);
        Arc::make_mut(&mut seen.roster)[0].dimensions.length_m = length_m;
        let mut viewpoint = Viewpoint::around(&seen);
        viewpoint.set_mode(CameraMode::Chase, Some(VehicleId(3)));
        let eye = |viewpoint: &Viewpoint| {
            viewpoint.view(&seen, [400, 300]).extrinsics.position - seen.vehicles[0].position
        };
        viewpoint.zoom(30.0);
        viewpoint.update(&seen);
        let near = eye(&viewpoint);
        assert!(near.x < -length_m / 2.0 - 1.5, "{length_m} m: {near}");
        viewpoint.zoom(-1.0);
        let back = eye(&viewpoint).length() / near.length();
        assert!(back > 1.1, "the wheel acts at once: {back}");
    }
}

#[test]
fn following_eases_to_the_vehicle_and_everything_can_be_framed_again() {
    let seen = snapshot(10.0);
    let mut viewpoint = Viewpoint::around(&snapshot(-60.0));
    viewpoint.distance_m = 200.0;
    let start = viewpoint.target;
    viewpoint.follow(seen.vehicle(VehicleId(3)));
    viewpoint.update(&seen);
    assert!((viewpoint.target - start).length() < 1e-9, "no jump");
    let mut frames = 0;
    while viewpoint.ease(0.02) {
        let before = viewpoint.distance_m;
        viewpoint.update(&seen);
        frames += 1;
        assert!(viewpoint.distance_m <= before && frames < 100);
    }
    viewpoint.update(&seen);
    assert!(frames > 10 && viewpoint.distance_m == VEHICLE_M);
    assert!((viewpoint.target - seen.vehicles[0].position).length() < 1e-6);
    viewpoint.zoom(2.0);
    let near_m = viewpoint.distance_m;
    viewpoint.frame(&seen.vehicles[0], &[]);
    while viewpoint.ease(0.02) {}
    assert_eq!((viewpoint.follow, viewpoint.distance_m), (None, near_m), "nobody is moved away");
    viewpoint.frame_all(&seen);
    viewpoint.show_whole(&seen, [400, 300], &[]);
    assert!(viewpoint.distance_m >= UNMOVED_M[0] && sees(&viewpoint, &seen));
}

#[test]
fn a_vehicle_that_has_left_is_not_followed_and_nothing_breaks_without_any() {
    let mut viewpoint = Viewpoint::around(&snapshot(10.0));
    viewpoint.set_mode(CameraMode::Chase, Some(VehicleId(3)));
    let empty = FrameSnapshot::default();
    viewpoint.update(&empty);
    assert_eq!((viewpoint.mode, viewpoint.follow), (CameraMode::Orbit, None));
    assert!(viewpoint.view(&empty, [1, 1]).clip_from_world().is_finite());
    assert!(Viewpoint::around(&empty).view(&empty, [8, 8]).clip_from_world().is_finite());
}

#[test]
fn dragging_takes_the_ground_along_and_zooming_brings_it_nearer() {
    let seen = snapshot(10.0);
    for mode in [CameraMode::Orbit, CameraMode::Overhead] {
        let mut viewpoint = Viewpoint::around(&seen);
        viewpoint.set_mode(mode, None);
        let at = |viewpoint: &Viewpoint| {
            viewpoint.view(&seen, [800, 600]).project(seen.vehicles[0].position).unwrap()
        };
        let before = at(&viewpoint);
        viewpoint.shift(40.0, 25.0);
        let moved = at(&viewpoint) - before;
        assert!(moved.x > 15.0 && moved.y > 8.0, "{mode:?} {moved}");
        let (near, far) = (viewpoint.distance_m, {
            viewpoint.zoom(-2.0);
            viewpoint.distance_m
        });
        assert!(far > near);
    }
}

#[test]
fn the_wheel_zooms_to_the_ground_under_the_mouse() {
    let seen = snapshot(10.0);
    for mode in [CameraMode::Orbit, CameraMode::Overhead] {
        let mut viewpoint = Viewpoint::around(&seen);
        viewpoint.set_mode(mode, None);
        let point = viewpoint.target.truncate() + DVec2::new(12.0, -9.0);
        let at =
            |viewpoint: &Viewpoint| viewpoint.view(&seen, [800, 600]).project(point.extend(0.0)).unwrap();
        let (before, middle) = (at(&viewpoint), viewpoint.target);
        viewpoint.zoom_at(3.0, Some(point));
        let moved = at(&viewpoint).distance(before);
        assert!(moved < 4.0 && viewpoint.target.distance(middle) > 3.0, "{mode:?}: {moved}");
        viewpoint.zoom_at(-3.0, Some(point));
        assert!(viewpoint.target.distance(middle) < 1e-9, "{mode:?}: the way back");
        // Sky, or a camera that keeps a vehicle in its middle.
        viewpoint.zoom_at(2.0, None);
        assert!(viewpoint.target.distance(middle) < 1e-9, "{mode:?}");
        viewpoint.follow = Some(seen.vehicles[0].id);
        viewpoint.zoom_at(2.0, Some(point));
        assert!(viewpoint.target.distance(middle) < 1e-9, "{mode:?}");
    }
}

/// Cars all over a city, most of them in its north-east.
fn scattered() -> FrameSnapshot {
    let mut seen = snapshot(0.0);
    let mut add = |id, x, y| {
        let position = DVec3::new(x, y, 0.0);
        seen.vehicles.push(VehicleState { id: VehicleId(id), position, ..seen.vehicles[0].clone() });
    };
    for k in 0..12 {
        let k = f64::from(k);
        add(10 + k as u32, -170.0 + 30.0 * k, -150.0 + 7.0 * k);
        add(40 + k as u32, 60.0 + 3.0 * k, 50.0 + 2.0 * k);
    }
    seen
}

#[test]
fn the_first_picture_of_a_large_city_shows_vehicles_large_enough_to_be_seen_moving() {
    let (text, library) = city3d_simulation::scenario::Library::scenario("city").unwrap();
    let read = city3d_simulation::scenario::read_experiment("city", &text, &library, Default::default());
    let (map, seen, extent) = (read.unwrap().city_map, scattered(), [850, 620]);
    let mut viewpoint = Viewpoint::around(&seen);
    viewpoint.begin(&seen, &map, &[]);
    viewpoint.show_whole(&seen, extent, &[]);
    let view = viewpoint.view(&seen, extent);
    let length = |at: DVec3| {
        let [rear, front] = [-2.5, 2.5].map(|x| view.project(at + DVec3::new(x, 0.0, 0.7)).unwrap());
        (front - rear).length()
    };
    let is_inside =
        |at: DVec3| view.project(at).is_some_and(|p| p.min_element() > 0.0 && p.x < 850.0 && p.y < 620.0);
    let inside: Vec<DVec3> = seen.vehicles.iter().map(|v| v.position).filter(|at| is_inside(*at)).collect();
    assert!(inside.len() >= 12, "the crowd is seen: {}", inside.len());
    let longest = inside.into_iter().map(length).fold(0.0, f64::max);
    assert!(longest > 25.0, "{longest} pixels");
    // All vehicles are still one key away, and what the user has moved stays.
    let near_m = viewpoint.distance_m;
    viewpoint.frame_all(&seen);
    viewpoint.begin(&seen, &map, &[]);
    viewpoint.show_whole(&seen, extent, &[]);
    assert!(viewpoint.distance_m > 1.5 * near_m, "{} {near_m}", viewpoint.distance_m);
}

#[test]
fn without_vehicles_the_first_picture_shows_where_they_will_come() {
    let (text, library) = city3d_simulation::scenario::Library::scenario("intersection").unwrap();
    let read =
        city3d_simulation::scenario::read_experiment("intersection", &text, &library, Default::default());
    let experiment = read.unwrap();
    let zones = crate::ui::ControlZoneArea::all(&experiment);
    let empty = FrameSnapshot::default();
    let eye_and_distance = |zones: &[crate::ui::ControlZoneArea]| {
        let mut viewpoint = Viewpoint::around(&empty);
        viewpoint.begin(&empty, &experiment.city_map, zones);
        viewpoint.show_whole(&empty, [850, 620], &[]);
        (
            viewpoint.target.truncate().distance(zones.first().map_or(DVec2::ZERO, |zone| zone.middle)),
            viewpoint.distance_m,
        )
    };
    let (off_m, near_m) = eye_and_distance(&zones);
    let (_, far_m) = eye_and_distance(&[]);
    assert!(off_m < 30.0 && near_m < 130.0 && far_m > near_m, "{off_m} {near_m} {far_m}");
    // The first two that have come are far from it, and from one another.
    let mut seen = snapshot(-150.0);
    let position = DVec3::new(0.0, 160.0, 0.0);
    seen.vehicles.push(VehicleState { id: VehicleId(4), position, ..seen.vehicles[0].clone() });
    let mut viewpoint = Viewpoint::around(&seen);
    viewpoint.begin(&seen, &experiment.city_map, &zones);
    viewpoint.show_whole(&seen, [850, 620], &[]);
    assert!(viewpoint.target.truncate().distance(zones[0].middle) < 30.0, "{:?}", viewpoint.target);
}

#[test]
fn the_view_is_chosen_again_when_the_first_vehicles_come_unless_it_was_moved() {
    let (text, library) = city3d_simulation::scenario::Library::scenario("roundabout").unwrap();
    let read =
        city3d_simulation::scenario::read_experiment("roundabout", &text, &library, Default::default());
    let map = read.unwrap().city_map;
    let (empty, seen) = (FrameSnapshot::default(), snapshot(-50.0));
    let begun = |is_moved: bool| {
        let mut viewpoint = Viewpoint::around(&empty);
        let show = |viewpoint: &mut Viewpoint, seen: &FrameSnapshot| {
            viewpoint.begin(seen, &map, &[]);
            viewpoint.show_whole(seen, [850, 620], &[]);
            viewpoint.distance_m
        };
        let of_the_map_m = show(&mut viewpoint, &empty);
        if is_moved {
            viewpoint.zoom(1.1);
        }
        (of_the_map_m, show(&mut viewpoint, &seen), show(&mut viewpoint, &empty))
    };
    let (of_the_map_m, near_m, later_m) = begun(false);
    assert!(near_m < 0.7 * of_the_map_m && later_m == near_m, "{of_the_map_m} {near_m} {later_m}");
    let (of_the_map_m, moved_m, _) = begun(true);
    assert!((0.8..1.25).contains(&(moved_m / of_the_map_m)), "{of_the_map_m} {moved_m}");
}

#[test]
fn the_camera_rises_over_a_house_that_hides_the_followed_vehicle_and_comes_down_again() {
    let seen = snapshot(10.0);
    let middle = seen.vehicles[0].position.truncate().as_vec2();
    // All around it, as between houses.
    let corners = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]].map(|c| middle + glam::Vec2::from(c));
    let walls: Vec<Wall> =
        (0..4).map(|k| Wall { from: corners[k], to: corners[(k + 1) % 4], height_m: 12.0 }).collect();
    for mode in [CameraMode::Orbit, CameraMode::Chase] {
        let mut viewpoint = Viewpoint::around(&seen);
        viewpoint.follow(Some(&seen.vehicles[0]));
        viewpoint.set_mode(mode, Some(VehicleId(3)));
        viewpoint.update(&seen);
        (viewpoint.distance_m, viewpoint.elevation_rad) = (40.0, 0.3);
        if mode == CameraMode::Chase {
            viewpoint.zoom(-12.0);
        }
        let hidden = |viewpoint: &Viewpoint| {
            let eye = viewpoint.view(&seen, [400, 300]).extrinsics.position;
            occlusion::is_occluded(eye, seen.vehicles[0].position + DVec3::Z, &walls)
        };
        let low_m = viewpoint.view(&seen, [400, 300]).extrinsics.position.z;
        assert!(hidden(&viewpoint), "{mode:?}");
        let frames = (0..200).take_while(|_| viewpoint.keep_in_sight(&seen, &walls, 0.033)).count();
        assert!((3..100).contains(&frames), "it rises, and rests: {frames}");
        assert!(!hidden(&viewpoint) && sees(&viewpoint, &seen), "{mode:?}");
        let eye = viewpoint.view(&seen, [400, 300]).extrinsics.position;
        let vehicle = seen.vehicles[0].position + DVec3::Z;
        assert!(!occlusion::is_occluded_up_to(eye, vehicle, (&walls, 2.0)), "over the roof, too: {mode:?}");
        if mode == CameraMode::Orbit {
            let mut let_go = viewpoint.clone();
            let_go.follow(None);
            assert!(!let_go.keep_in_sight(&seen, &walls, 0.033));
            let after = let_go.view(&seen, [400, 300]).extrinsics.position;
            assert!(after.distance(eye) < 1e-6, "who lets go keeps the view: {after} {eye}");
        }
        while viewpoint.keep_in_sight(&seen, &[], 0.033) {}
        let again_m = viewpoint.view(&seen, [400, 300]).extrinsics.position.z;
        assert!((again_m - low_m).abs() < 1e-6, "{mode:?}: {low_m} {again_m}");
    }
}

#[test]
fn a_framed_vehicle_is_seen_over_the_house_before_it() {
    let seen = snapshot(10.0);
    let vehicle = &seen.vehicles[0];
    let mut viewpoint = Viewpoint::around(&seen);
    (viewpoint.azimuth_rad, viewpoint.elevation_rad) = (-FRAC_PI_2, 0.3);
    let at = vehicle.position.truncate().as_vec2() - glam::Vec2::new(0.0, 6.0);
    let wall =
        Wall { from: at - glam::Vec2::new(20.0, 0.0), to: at + glam::Vec2::new(20.0, 0.0), height_m: 8.0 };
    let is_hidden = |viewpoint: &Viewpoint| {
        let eye = viewpoint.view(&seen, [400, 300]).extrinsics.position;
        occlusion::is_occluded(eye, vehicle.position + DVec3::Z, &[wall])
    };
    for (walls, is_seen) in [(&[][..], false), (&[wall][..], true)] {
        let mut framed = viewpoint.clone();
        framed.frame(vehicle, walls);
        while framed.ease(0.02) {}
        assert_eq!(is_hidden(&framed), !is_seen, "{walls:?}");
        assert_eq!((framed.azimuth_rad, framed.elevation_rad > 0.31), (-FRAC_PI_2, is_seen));
    }
    let mut turned = viewpoint;
    turned.frame(vehicle, &[wall]);
    turned.turn(0.0, -1.0);
    while turned.ease(0.02) {}
    assert!(
        (turned.elevation_rad - 0.3).abs() < 0.01,
        "who turns the view decides: {}",
        turned.elevation_rad
    );
}

#[test]
fn the_camera_has_risen_before_the_followed_vehicle_is_hidden() {
    let mut seen = snapshot(10.0);
    (seen.vehicles[0].speed_mps, seen.vehicles[0].orientation) = (10.0, DQuat::IDENTITY);
    let mut viewpoint = Viewpoint::around(&seen);
    viewpoint.follow(Some(&seen.vehicles[0]));
    while viewpoint.ease(0.1) {}
    viewpoint.update(&seen);
    let eye = viewpoint.view(&seen, [400, 300]).extrinsics.position;
    // Beside the line of sight of now, and across that of half a second later.
    let at = |share: f64, ahead_m: f64| {
        eye.lerp(seen.vehicles[0].position, share).truncate().as_vec2() + glam::Vec2::new(ahead_m as f32, 0.0)
    };
    let wall = Wall { from: at(0.6, 2.0), to: at(0.6, 12.0), height_m: 30.0 };
    assert!(!occlusion::is_occluded(eye, seen.vehicles[0].position + DVec3::Z, &[wall]));
    assert!(viewpoint.keep_in_sight(&seen, &[wall], 0.033), "it rises already");
    seen.vehicles[0].speed_mps = 0.0;
    while viewpoint.keep_in_sight(&seen, &[wall], 0.033) {}
    let later = viewpoint.view(&seen, [400, 300]).extrinsics.position;
    assert!((later - eye).length() < 1e-6, "who stands will not be hidden");
}
