//! Cameras and rulers: bookmarks, kinds of pictures, scale and place under the mouse, the way back to the city.

use super::city::{has_text, picture, place, spread, texts};
use super::desk::{Desk, click, fleet, harness, press, with};
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_sensors::PictureKind;
use city3d_viewer::ui::{CameraMode, EditAction, ManualDrive, PictureSlot, UiAction};
use egui::{Key, Modifiers, Shape};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::{DVec2, DVec3};

fn eye(harness: &Harness<'static, Desk>) -> DVec3 {
    picture(harness, PictureSlot::City).view.extrinsics.position
}

/// A digit with Ctrl, and with Shift as a keyboard sends it: another character on the same key.
fn bookmark(harness: &mut Harness<'static, Desk>, sets: bool) {
    let modifiers = Modifiers { ctrl: true, command: true, shift: sets, ..Modifiers::NONE };
    let key = if sets { Key::Quote } else { Key::Num2 };
    let physical_key = Some(Key::Num2);
    for pressed in [true, false] {
        harness.event(egui::Event::Key { key, physical_key, pressed, repeat: false, modifiers });
    }
    harness.run_steps(2);
}

#[test]
fn a_camera_is_stored_under_a_digit_and_comes_back() {
    let mut harness = with(6);
    bookmark(&mut harness, false);
    let (said, _) = harness.state().state.notice.clone().expect("it is not set");
    assert!(said.contains("Ctrl+Shift+2"), "{said}");
    harness.state_mut().state.viewpoint.look_at(DVec2::new(40.0, 10.0));
    harness.run_steps(2);
    let stored = eye(&harness);
    bookmark(&mut harness, true);
    harness.state_mut().state.set_mode(CameraMode::Overhead);
    harness.state_mut().state.viewpoint.look_at(DVec2::new(-90.0, 70.0));
    harness.run_steps(2);
    assert!(eye(&harness).distance(stored) > 50.0);
    bookmark(&mut harness, false);
    assert_eq!((eye(&harness), harness.state().state.viewpoint.mode), (stored, CameraMode::Orbit));
    assert!(harness.state().state.bookmarks.get(2).is_some());
    assert!(harness.state().state.bookmarks.get(3).is_none());
}

#[test]
fn a_preview_shows_depth_classes_and_instances() {
    let mut desk = Desk::with(fleet(2));
    desk.state.toggle_preview(VehicleId(1));
    let mut harness = harness(desk);
    let kind = |harness: &Harness<'static, Desk>| picture(harness, PictureSlot::Preview(VehicleId(1))).kind;
    assert_eq!(kind(&harness), PictureKind::Rgb);
    let mut shown = "windscreen".to_owned();
    let mut below_at = None;
    for (name, wanted) in [
        ("depth", PictureKind::Depth),
        ("semantic classes", PictureKind::Semantic),
        ("instances", PictureKind::Instance),
    ] {
        let below = harness.get_by_label("Gas 0.00").rect();
        assert!(below_at.is_none_or(|before| before == below.left()), "a longer name moves nothing");
        below_at = Some(below.left());

        harness.get_by_value(&shown).click();
        harness.run_steps(4);
        harness.get_by_label(name).click();
        harness.run_steps(4);
        assert_eq!(kind(&harness), wanted);
        // The button has room for a word; the tip tells the camera, too.
        shown = name.trim_start_matches("semantic ").to_owned();
        let words = match wanted {
            PictureKind::Depth => "Depth: 1 m",
            PictureKind::Semantic => "building, wall, vegetation",
            _ => "each vehicle has a colour of its own",
        };
        let with_legend = harness.query_by_label_contains(words).expect("a legend").rect();
        let picture = picture(&harness, PictureSlot::Preview(VehicleId(1))).view.extent;
        let picture_height = with_legend.width() * picture[1] as f32 / picture[0] as f32;
        assert!(with_legend.height() > picture_height + 12.0, "the legend of {name} is below the picture");
        assert!(with_legend.bottom() <= harness.get_by_label("Gas 0.00").rect().top(), "{name}");
    }
    assert!(texts(&harness).contains(&"instance".to_owned()), "the numbers beside their colours follow");
    assert_eq!(picture(&harness, PictureSlot::City).kind, PictureKind::Rgb);
}

#[test]
fn the_place_under_the_mouse_is_told_with_its_lane() {
    let mut desk = Desk::with(spread(3));
    let lane = desk.map.lanes.iter().max_by(|a, b| a.curve.length().total_cmp(&b.curve.length())).unwrap();
    let (name, point) = (lane.name.clone(), lane.curve.at(20.0).pose.position);
    desk.state.set_mode(CameraMode::Overhead);
    let mut harness = harness(desk);
    harness.state_mut().state.viewpoint.look_at(point);
    harness.event(egui::Event::PointerMoved(place(&harness).center()));
    harness.run_steps(3);
    let told = texts(&harness);
    let near = |text: &String| text.starts_with("x ") && text.contains(&format!("lane {name}, "));
    assert!(told.iter().any(near), "{name} at {point} in {told:?}");
    let scale = |text: &String| {
        let metres = text.strip_suffix(" m").and_then(|number| number.parse::<f64>().ok());
        metres.is_some_and(|metres| [10.0, 20.0, 50.0, 100.0].contains(&metres))
    };
    assert!(told.iter().any(scale) && told.iter().any(|text| text == "N"), "{told:?}");
    harness.state_mut().state.layers.rulers = false;
    harness.run_steps(2);
    assert!(!texts(&harness).iter().any(near));
}

#[test]
fn who_drives_out_of_the_city_is_told_the_way_back() {
    let mut desk = Desk::with(fleet(1));
    let high = desk.map.lanes.iter().map(|lane| lane.curve.end().position.x).fold(0.0, f64::max);
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    desk.run_state.phase = city3d_session::RunPhase::Running;
    desk.change(|now| now.vehicles[0].position = DVec3::new(0.0, 0.0, 0.0));
    let mut harness = harness(desk);
    assert!(harness.query_by_label_contains("You left the city").is_none());
    harness.state_mut().change(|now| now.vehicles[0].position.x = high + 500.0);
    harness.run_steps(3);
    harness.get_by_label_contains("You left the city");
    harness.get_by_label_contains(" m to the west");
}

#[test]
fn who_drives_beside_the_road_is_told_so_and_what_is_solid() {
    let mut desk = Desk::with(fleet(1));
    let lane = desk.map.lanes.iter().max_by(|a, b| a.curve.length().total_cmp(&b.curve.length())).unwrap();
    let on_lane = lane.curve.at(20.0).pose.position.extend(0.0);
    // Of some places around the one that is farthest from all lanes, still in the city.
    let off_m = |at: glam::DVec2| {
        desk.map.lanes.iter().map(|lane| lane.curve.project(at).distance).fold(f64::INFINITY, f64::min)
    };
    let around = (-40..=40).flat_map(|x| (-40..=40).map(move |y| glam::DVec2::new(x.into(), y.into())));
    let off_lane = around.max_by(|a, b| off_m(*a).total_cmp(&off_m(*b))).unwrap().extend(0.0);
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    desk.run_state.phase = city3d_session::RunPhase::Running;
    desk.change(|now| now.vehicles[0].position = on_lane);
    let mut harness = harness(desk);
    let told = |harness: &Harness<'static, Desk>| harness.query_by_label_contains("Off the road").is_some();
    assert!(!told(&harness));
    harness.get_by_label("solid: traffic, buildings, walls, hedges; not trees, people");
    harness.state_mut().change(|now| now.vehicles[0].position = off_lane);
    harness.run_steps(3);
    assert!(told(&harness));
    let mut map = (*harness.state().map).clone();
    map.scenery.clear();
    harness.state_mut().map = std::sync::Arc::new(map);
    harness.run_steps(2);
    harness.get_by_label("solid: traffic; not buildings, trees, people");
}

#[test]
fn who_left_the_road_is_told_why_it_stands() {
    let mut desk = Desk::with(fleet(1));
    desk.change(|now| {
        now.vehicles[0].status = Status::Stopped;
        now.vehicles[0].position = DVec3::new(4000.0, 0.0, 0.0);
    });
    desk.state.toggle_preview(VehicleId(1));
    let mut harness = harness(desk);
    for at in 0..2 {
        let place = harness.get_all_by_label("stopped").nth(at).unwrap().rect().center();
        harness.hover_at(place);
        harness.run_steps(10);
        assert!(harness.query_by_label_contains("Off the lanes").is_some(), "{at}");
    }
}

#[test]
fn only_who_is_outside_of_the_map_has_an_arrow_at_its_edge() {
    let mut desk = Desk::with(fleet(1));
    let ends = || desk.map.lanes.iter().flat_map(|lane| [lane.curve.start(), lane.curve.end()]);
    let low = ends().map(|pose| pose.position).fold(DVec2::INFINITY, DVec2::min);
    desk.change(|now| now.vehicles[0].status = city3d_protocol::snapshot::Status::Driving);
    desk.change(|now| now.vehicles[0].position = low.extend(0.0));
    let mut harness = harness(desk);
    // On the map a vehicle that drives is a disc, outside of it an arrow head: three corners.
    let arrows = |harness: &Harness<'static, Desk>| {
        let map = egui::Rect::from_min_size(
            place(harness).right_top() + egui::vec2(-158.0, 8.0),
            egui::Vec2::splat(150.0),
        );
        let is_arrow = |shape: &egui::Shape| match shape {
            egui::Shape::Path(path) => path.closed && path.points.len() == 3 && map.contains(path.points[0]),
            _ => false,
        };
        harness.output().shapes.iter().filter(|clipped| is_arrow(&clipped.shape)).count()
    };
    assert_eq!(arrows(&harness), 0, "at the corner of the lanes, and so on the map");
    harness.state_mut().change(|now| now.vehicles[0].position.x -= 300.0);
    harness.run_steps(2);
    assert_eq!(arrows(&harness), 1);
}

#[test]
fn a_preview_that_is_opened_late_plots_what_was_before() {
    let mut harness = with(2);
    for step in 1..=100 {
        harness.state_mut().change(|now| {
            now.time_s = 2.5 + f64::from(step) * 0.2;
            now.vehicles[0].speed_mps = f64::from(step % 10);
        });
        harness.run_steps(1);
    }
    harness.state_mut().state.toggle_preview(VehicleId(1));
    harness.run_steps(4);
    let lines = harness.output().shapes.iter().filter_map(|clipped| match &clipped.shape {
        Shape::Path(path) => Some(path.points.len()),
        _ => None,
    });
    let longest = lines.max().unwrap_or(0);
    assert!(longest > 80, "the plot of 20 s has {longest} points");
}

#[test]
fn the_editor_and_the_inspector_are_in_the_menu_of_panels() {
    let mut harness = with(2);
    click(&mut harness, "Panels");
    harness.get_by_label_contains("Inspector: why");
    harness.get_by_label_contains("Edit the scenario").click();
    harness.run_steps(3);
    assert_eq!(harness.state().actions, [UiAction::Edit(EditAction::Begin)]);
}

#[test]
fn an_action_frames_the_whole_city() {
    let mut harness = with(3);
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    press(&mut harness, egui::Key::Num2);
    harness.run_steps(20);
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::P);
    harness.run_steps(2);
    harness.event(egui::Event::Text("frame the whole city".to_owned()));
    harness.run_steps(2);
    press(&mut harness, egui::Key::Enter);
    harness.run_steps(3);
    let state = &harness.state().state;
    assert_eq!((state.viewpoint.mode, state.viewpoint.follow), (CameraMode::Orbit, None));
    let view = state.pictures.iter().find(|picture| picture.slot == PictureSlot::City).unwrap().view;
    let [width, height] = view.extent.map(f64::from);
    let is_inside = |point: glam::DVec2| {
        let pixel = view.project(point.extend(0.0));
        pixel.is_some_and(|at| (-1.0..=width).contains(&at.x) && (-1.0..=height).contains(&at.y))
    };
    let ends = harness.state().map.lanes.iter().map(|lane| lane.curve.at(0.0).pose.position);
    assert!(ends.into_iter().all(is_inside), "all lanes are in the picture");
    // It has a key, too.
    let framed = format!("{:?}", state.viewpoint);
    press(&mut harness, egui::Key::Num2);
    harness.run_steps(20);
    press(&mut harness, egui::Key::X);
    harness.run_steps(3);
    assert_eq!(format!("{:?}", harness.state().state.viewpoint), framed);
}

#[test]
fn a_camera_tells_whose_it_is_where_another_vehicle_is_selected() {
    let mut harness = with(3);
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    press(&mut harness, egui::Key::Num3);
    harness.run_steps(3);
    assert!(has_text(&harness, "Onboard: 1 car1"), "{:?}", texts(&harness));
    harness.state_mut().state.selection.vehicle = Some(VehicleId(2));
    harness.run_steps(3);
    assert!(has_text(&harness, "Onboard: 1 car1, not the selected 2 car2"), "{:?}", texts(&harness));
}
