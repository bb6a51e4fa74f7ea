//! The large view: what is drawn over it, clicks in it, its map, and sizes of all kinds.

use super::desk::{Desk, EditedFile, click, fleet, harness, press, with};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_scene::Wall;
use city3d_sensors::Weather;
use city3d_session::RunPhase;
use city3d_viewer::ui::{CameraMode, EditTool, ManualDrive, PictureRequest, PictureSlot, UiAction};
use egui::{Pos2, Rect, Shape, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::{DVec3, Vec2 as Point};

/// Every text that is painted, those that are no widgets too.
pub fn texts(harness: &Harness<'static, Desk>) -> Vec<String> {
    fn of(shape: &Shape) -> Vec<String> {
        match shape {
            Shape::Text(text) => vec![text.galley.text().to_owned()],
            Shape::Vec(shapes) => shapes.iter().flat_map(of).collect(),
            _ => Vec::new(),
        }
    }
    harness.output().shapes.iter().flat_map(|clipped| of(&clipped.shape)).collect()
}

pub fn has_text(harness: &Harness<'static, Desk>, text: &str) -> bool {
    texts(harness).iter().any(|painted| painted == text)
}

pub fn picture(harness: &Harness<'static, Desk>, slot: PictureSlot) -> PictureRequest {
    *harness.state().state.pictures.iter().find(|picture| picture.slot == slot).unwrap()
}

/// The place of the large view on screen: where its picture would be, which no test has.
pub fn place(harness: &Harness<'static, Desk>) -> Rect {
    let extent = picture(harness, PictureSlot::City).view.extent.map(|pixels| pixels as f32);
    let rects = harness.output().shapes.iter().filter_map(|clipped| match &clipped.shape {
        Shape::Rect(rect) => Some(rect.rect),
        _ => None,
    });
    let is_city =
        |rect: &Rect| (rect.size() * harness.ctx.pixels_per_point() - Vec2::from(extent)).length() < 1.5;
    rects.into_iter().find(is_city).unwrap()
}

/// Where a vehicle is on screen.
pub fn vehicle_at(harness: &Harness<'static, Desk>, index: usize) -> Pos2 {
    on_screen(harness, index).expect("it is before the camera")
}

/// Where a vehicle is in the large view; `None` behind the camera.
pub fn on_screen(harness: &Harness<'static, Desk>, index: usize) -> Option<Pos2> {
    let view = picture(harness, PictureSlot::City).view;
    let middle = harness.state().run_state.now.vehicles[index].position + DVec3::Z * 0.75;
    let pixel = view.project(middle)?;
    let [width, height] = view.extent.map(f64::from);
    let share = Vec2::new((pixel.x / width) as f32, (pixel.y / height) as f32);
    Some(place(harness).min + share * place(harness).size())
}

pub fn click_at(harness: &mut Harness<'static, Desk>, at: Pos2, times: u32) {
    harness.event(egui::Event::PointerMoved(at));
    for _ in 0..times {
        for pressed in [true, false] {
            let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
            harness.event(egui::Event::PointerButton { pos: at, button, pressed, modifiers });
        }
        harness.run_steps(1);
    }
    harness.run_steps(1);
}

/// Cars far apart, named like those of a scenario.
pub fn spread(count: u32) -> FrameSnapshot {
    let mut snapshot = fleet(count);
    for (index, vehicle) in snapshot.vehicles.iter_mut().enumerate() {
        vehicle.position = DVec3::new(30.0 * index as f64, 8.0 * index as f64, 0.0);
    }
    snapshot
}

#[test]
fn vehicles_carry_labels_unless_walls_hide_them() {
    let mut desk = Desk::with(spread(3));
    // Round the second car, taller than any camera of this test looks down on.
    let middle = Point::new(30.0, 8.0);
    let corners = [[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]].map(|c| middle + Point::from(c));
    let wall = |k: usize| Wall { from: corners[k], to: corners[(k + 1) % 4], height_m: 60.0 };
    desk.walls = (0..4).map(wall).collect();
    let mut harness = harness(desk);
    assert!(has_text(&harness, "1 car1") && has_text(&harness, "3 car3"), "{:?}", texts(&harness));
    assert!(!has_text(&harness, "2 car2"), "its walls hide it");
    harness.state_mut().state.selection.vehicle = Some(VehicleId(2));
    harness.run_steps(2);
    assert!(has_text(&harness, "2 car2"), "the selected one is found");
    harness.state_mut().state.selection.vehicle = None;
    press(&mut harness, egui::Key::L);
    assert!(!has_text(&harness, "1 car1"), "L switches them off");
}

/// Where a text is painted that is no widget.
fn painted(harness: &Harness<'static, Desk>, text: &str) -> Rect {
    let shapes = harness.output().shapes.iter();
    let mut found = shapes.filter_map(|clipped| match &clipped.shape {
        Shape::Text(shape) if shape.galley.text() == text => Some(shape.visual_bounding_rect()),
        _ => None,
    });
    found.next_back().unwrap_or_else(|| panic!("{text} is not painted: {:?}", texts(harness)))
}

#[test]
fn a_notice_hides_neither_the_speed_of_the_driver_nor_what_the_next_click_does() {
    let mut desk = Desk::with(fleet(2));
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    desk.change(|now| now.vehicles[0].speed_mps = 10.0);
    let mut driven = harness(desk);
    driven.state_mut().state.say("Something is said", 1e3);
    driven.run_steps(3);
    let (notice, speed) = (painted(&driven, "Something is said"), driven.get_by_label("36 km/h").rect());
    assert!(notice.bottom() + 8.0 <= speed.top(), "{notice:?} over {speed:?}");
    let mut desk = Desk::with(fleet(2));
    desk.edit = Some(EditedFile::of_fleet(2));
    desk.state.editing.tool = EditTool::AddVehicle;
    let mut edited = harness(desk);
    edited.state_mut().state.say("Something is said", 1e3);
    edited.run_steps(3);
    let instruction = painted(&edited, "Click the lane where the vehicle starts. Esc ends");
    let notice = painted(&edited, "Something is said");
    assert!(notice.bottom() + 8.0 <= instruction.top(), "{notice:?} over {instruction:?}");
    assert!(place(&edited).contains_rect(notice));
}

#[test]
fn who_is_behind_the_chased_vehicle_has_no_label_on_it() {
    let mut desk = Desk::with(spread(3));
    // One behind another on a straight road: the chase camera is above the last one.
    desk.change(|now| {
        for (index, vehicle) in now.vehicles.iter_mut().enumerate() {
            vehicle.position = DVec3::new(5.5 * index as f64, 0.0, 0.0);
        }
    });
    desk.state.selection.vehicle = Some(VehicleId(2));
    let mut harness = harness(desk);
    press(&mut harness, egui::Key::Num2);
    harness.run_steps(40);
    assert!(!has_text(&harness, "1 car1"), "{:?}", texts(&harness));
    assert!(has_text(&harness, "3 car3"), "who is ahead has one: {:?}", texts(&harness));
}

#[test]
fn a_message_lies_over_all_windows() {
    let mut desk = Desk::with(spread(2));
    desk.state.open.charts = true;
    desk.state.say("Chart: somewhere", 0.0);
    let harness = harness(desk);
    let painted = texts(&harness);
    let place = |text: &str| painted.iter().rposition(|known| known.contains(text)).unwrap();
    assert!(place("Chart: somewhere") > place("laboratory units"), "{painted:?}");
}

#[test]
fn of_labels_that_would_cover_one_another_the_nearest_stays() {
    let mut desk = Desk::with(spread(2));
    desk.change(|now| now.vehicles[1].position = now.vehicles[0].position + DVec3::new(0.4, 0.3, 0.0));
    let mut harness = harness(desk);
    let count = |harness: &Harness<'static, Desk>| {
        ["1 car1", "2 car2"].into_iter().filter(|text| has_text(harness, text)).count()
    };
    assert_eq!(count(&harness), 1);
    for id in [1, 2] {
        harness.state_mut().state.selection.vehicle = Some(VehicleId(id));
        harness.run_steps(2);
        assert!(has_text(&harness, &format!("{id} car{id}")), "the selected one goes before");
    }
}

#[test]
fn a_click_selects_a_double_click_follows_and_one_beside_deselects() {
    let mut harness = harness(Desk::with(spread(3)));
    // Passes of a test are a quarter of a second apart.
    harness.ctx.options_mut(|options| options.input_options.max_double_click_delay = 1.0);
    let at = vehicle_at(&harness, 1);
    click_at(&mut harness, at, 1);
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(2)));
    assert_eq!(harness.state().state.viewpoint.follow, None);
    harness.run_steps(20);
    let at = vehicle_at(&harness, 2);
    click_at(&mut harness, at, 2);
    assert_eq!(harness.state().state.viewpoint.follow, Some(VehicleId(3)));
    harness.run_steps(20);
    let corner = place(&harness).left_bottom() + Vec2::new(10.0, -10.0);
    click_at(&mut harness, corner, 1);
    assert_eq!(harness.state().state.selection.vehicle, None);
}

#[test]
fn the_map_moves_the_view_and_can_be_hidden() {
    let mut harness = with(6);
    let target =
        |harness: &Harness<'static, Desk>| picture(harness, PictureSlot::City).view.extrinsics.position;
    let before = target(&harness);
    let corner = place(&harness).right_top() + Vec2::new(-30.0, 30.0);
    click_at(&mut harness, corner, 1);
    assert!(target(&harness).distance(before) > 10.0, "it looks at the north-east now");
    press(&mut harness, egui::Key::M);
    let there = target(&harness);
    harness.run_steps(20);
    click_at(&mut harness, corner, 1);
    assert_eq!(target(&harness), there, "where the map was there is the city");
}

#[test]
fn layers_are_drawn_with_no_one_six_and_five_hundred_vehicles() {
    for count in [0, 1, 6, 500] {
        let mut harness = with(count);
        let lines = |harness: &Harness<'static, Desk>| harness.state().state.overlay.lines.len();
        click(&mut harness, "Layers");
        let before = lines(&harness);
        for layer in ["Lanes", "Conflict zones", "Boxes"] {
            click(&mut harness, layer);
        }
        assert!(lines(&harness) >= before + 20 + 12 * count as usize, "{count}: lanes and boxes are lines");
        assert!(harness.state().state.overlay.lines.iter().all(|line| line.paint.behind == 0.0));
        click(&mut harness, "Route of the selected vehicle");
        press(&mut harness, egui::Key::PageDown);
        assert_eq!(harness.state().state.selection.vehicle.is_some(), count > 0);
        let layers = harness.state().state.layers;
        assert!(layers.lanes && layers.zones && layers.routes);
    }
}

#[test]
fn what_is_loading_is_said_and_the_panels_go_on() {
    let mut desk = Desk::with(fleet(6));
    desk.loading = Some("Loading city ...".to_owned());
    let mut harness = harness(desk);
    harness.get_by_label("Loading city ...");
    press(&mut harness, egui::Key::Num4);
    assert_eq!(harness.state().state.viewpoint.mode, CameraMode::Overhead);
    harness.state_mut().loading = None;
    harness.run_steps(4);
    assert!(harness.query_by_label("Loading city ...").is_none());
}

#[test]
fn another_scale_factor_has_finer_pictures_at_the_same_places() {
    let mut desk = Desk::with(spread(3));
    desk.state.toggle_preview(VehicleId(1));
    let mut harness = harness(desk);
    let extents = |harness: &Harness<'static, Desk>| {
        [PictureSlot::City, PictureSlot::Preview(VehicleId(1))].map(|slot| picture(harness, slot).view.extent)
    };
    let (before, at) = (extents(&harness), vehicle_at(&harness, 1));
    // Twice the pixels and twice the scale factor: as many points.
    harness.set_pixels_per_point(2.0);
    harness.run_steps(1);
    harness.set_size(Vec2::new(1280.0, 720.0));
    harness.run_steps(4);
    for (fine, coarse) in extents(&harness).into_iter().flatten().zip(before.into_iter().flatten()) {
        assert!(fine.abs_diff(2 * coarse) <= 2, "{fine} pixels instead of {coarse}");
    }
    assert!(vehicle_at(&harness, 1).distance(at) < 2.0);
    harness.get_by_label("car2");
    let at = vehicle_at(&harness, 1);
    click_at(&mut harness, at, 1);
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(2)), "clicks are where they were");
    // The same window on a finer screen: everything is larger, and the city still has its place.
    harness.set_size(Vec2::new(640.0, 360.0));
    harness.run_steps(4);
    let [width, height] = picture(&harness, PictureSlot::City).view.extent;
    assert!(width > 400 && height > 400, "{width} x {height}");
    harness.get_by_label("Status");
}

#[test]
fn rain_falls_with_the_simulated_time_in_every_quality() {
    let mut harness = with(1);
    let streaks = |harness: &Harness<'static, Desk>| -> Vec<Pos2> {
        let lines = harness.output().shapes.iter().filter_map(|clipped| match &clipped.shape {
            Shape::LineSegment { points, stroke } if stroke.color.r() < stroke.color.b() => Some(points[0]),
            _ => None,
        });
        lines.collect()
    };
    assert!(streaks(&harness).is_empty());
    harness.state_mut().state.look.weather = Weather::Rain;
    harness.run_steps(2);
    let before = streaks(&harness);
    assert!((60..=220).contains(&before.len()), "{}", before.len());
    harness.run_steps(3);
    assert_eq!(streaks(&harness), before, "a paused run has still rain");
    harness.state_mut().change(|now| now.time_s += 0.1);
    harness.run_steps(2);
    assert!(streaks(&harness).iter().zip(&before).all(|(now, before)| now != before));
}

#[test]
fn windows_of_all_sizes_are_drawn() {
    let mut desk = Desk::with(fleet(500));
    desk.run_state.phase = RunPhase::Running;
    (1..=4).for_each(|id| desk.state.toggle_preview(VehicleId(id)));
    let open = &mut desk.state.open;
    (open.help, open.layers, open.controllers) = (true, true, true);
    (open.settings, open.events, open.traffic) = (true, true, true);
    desk.state.palette.is_open = true;
    let mut harness = harness(desk);
    for size in [[320.0, 240.0], [1.0, 1.0], [0.0, 0.0], [900.0, 600.0], [3840.0, 2160.0], [200.0, 1500.0]] {
        harness.set_size(size.into());
        harness.run_steps(3);
        let pictures = &harness.state().state.pictures;
        let are_real = pictures.iter().flat_map(|p| p.view.extent).all(|pixels| (1..=8192).contains(&pixels));
        assert!(are_real && pictures.iter().any(|p| p.slot == PictureSlot::City), "{size:?}");
    }
}

#[test]
fn a_small_window_keeps_the_columns_for_id_status_position_and_speed() {
    let kept = ["ID", "Status", "x (m)", "y (m)", "km/h"];
    for (size, has_previews, more) in [
        ([1280.0, 720.0], true, &["Name"][..]),
        ([960.0, 600.0], true, &["Name"]),
        // 1280 x 720 pixels at one and a half times the size.
        ([853.0, 480.0], true, &["Name"]),
        ([800.0, 600.0], true, &["Name"]),
        // And at one and three quarters.
        ([731.0, 411.0], true, &["Name"]),
        ([640.0, 480.0], false, &["Name"]),
        // 1280 x 720 pixels at twice the size.
        ([640.0, 360.0], false, &["Name"]),
    ] {
        let mut desk = Desk::with(fleet(6));
        if has_previews {
            desk.state.toggle_preview(VehicleId(1));
        }
        let mut harness = harness(desk);
        harness.set_size(size.into());
        harness.run_steps(6);
        let edge = size[0] * 0.5;
        for title in kept.iter().chain(more) {
            let headings = harness.query_all_by_label_contains(title);
            let is_seen = headings.into_iter().any(|heading| {
                let rect = heading.rect();
                rect.width() > 10.0 && rect.right() < edge
            });
            assert!(is_seen, "{title} in a window of {size:?}");
        }
        let [width, _] = picture(&harness, PictureSlot::City).view.extent;
        let share = if size[0] >= 1280.0 { 0.47 } else { 0.32 };
        assert!(f64::from(width) > share * f64::from(size[0]), "{width} pixels for the city in {size:?}");
    }
}

#[test]
fn the_bar_picks_scenarios_cameras_and_looks() {
    let mut harness = with(6);
    for (label, mode) in
        [("Overhead", CameraMode::Overhead), ("Free", CameraMode::Free), ("Orbit", CameraMode::Orbit)]
    {
        click(&mut harness, label);
        assert_eq!(harness.state().state.viewpoint.mode, mode);
    }
    click(&mut harness, "Chase");
    let state = &harness.state().state;
    assert_eq!((state.viewpoint.mode, state.viewpoint.follow), (CameraMode::Chase, state.selection.vehicle));
    click(&mut harness, "Orbit");
    let pick = |harness: &mut Harness<'static, Desk>, shown: &str, wanted: &str| {
        harness.get_by_value(shown).click();
        harness.run_steps(4);
        harness.get_by_label(wanted).click();
        harness.run_steps(4);
    };
    pick(&mut harness, "straight", "city");
    pick(&mut harness, "noon", "night");
    let actions = &harness.state().actions;
    assert_eq!(actions[0], UiAction::Scenario("city".to_owned()));
    assert!(matches!(&actions[1], UiAction::Look(look) if look.hours == 22.0), "{actions:?}");
}

#[test]
fn a_notice_does_not_cover_the_name_of_the_followed_vehicle() {
    let mut harness = with(2);
    harness.set_size(Vec2::new(960.0, 600.0));
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    press(&mut harness, egui::Key::Num2);
    let now_s = harness.ctx.input(|input| input.time);
    harness.state_mut().state.say(
        "A sentence that says what has come of it, at such a length that it is as wide as the view",
        now_s,
    );
    harness.run_steps(2);
    let place = |words: &str| {
        let found = harness.output().shapes.iter().find_map(|clipped| match &clipped.shape {
            Shape::Text(text) if text.galley.text().starts_with(words) => {
                Some(text.galley.rect.translate(text.pos.to_vec2()))
            }
            _ => None,
        });
        found.unwrap_or_else(|| panic!("{words} is not painted"))
    };
    let (badge, notice) = (place("Chase: 1 car1"), place("A sentence"));
    assert!(!badge.expand(4.0).intersects(notice.expand(4.0)), "{badge:?}, {notice:?}");
}

#[test]
fn the_last_row_of_a_long_table_is_whole_at_every_size_of_the_interface() {
    let statuses = ["waiting", "driving", "yielding", "stopped"];
    for scale in [1.0, 1.1, 1.25, 1.5] {
        let mut harness = with(500);
        harness.state_mut().state.preferences.scale = scale;
        harness.run_steps(6);
        let rows = harness.output().shapes.iter().filter_map(|clipped| match &clipped.shape {
            Shape::Text(text) if statuses.contains(&text.galley.text()) => {
                Some((text.pos.y + text.galley.size().y, clipped.clip_rect.bottom()))
            }
            _ => None,
        });
        let (mut count, mut last) = (0, (0.0, 0.0));
        for row in rows.filter(|(bottom, clip)| bottom - 8.0 < *clip) {
            (count, last) = (count + 1, if row.0 > last.0 { row } else { last });
        }
        assert!(count > 8 && last.0 <= last.1, "{count} rows, the last ends at {last:?} at {scale}");
    }
}

#[test]
fn in_a_small_view_the_map_is_smaller_and_where_it_has_no_room_that_is_said() {
    let mut harness = harness(Desk::with(fleet(2)));
    let map = |harness: &Harness<'static, Desk>| {
        let pixels = place(harness);
        (pixels.size(), harness.query_by_label("no room for the map").is_some())
    };
    for (scale, size) in [(1.0, [1280.0, 720.0]), (1.5, [1280.0 / 1.5, 720.0 / 1.5])] {
        harness.set_size(size.into());
        harness.run_steps(4);
        assert!(!map(&harness).1, "{scale}: {:?}", map(&harness).0);
    }
    harness.set_size(egui::vec2(420.0, 300.0));
    harness.run_steps(4);
    assert!(map(&harness).1, "{:?}", map(&harness).0);
    harness.state_mut().state.layers.map = false;
    harness.run_steps(4);
    assert!(!map(&harness).1, "nobody asks for it");
}

#[test]
fn the_dashboard_is_low_and_leaves_the_rulers_and_the_driven_vehicle_in_sight() {
    let mut desk = Desk::with(fleet(1));
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    let harness = harness(desk);
    let city = place(&harness);
    let gear = harness.get_by_label_contains("gear D").rect();
    let first = harness.get_by_label_contains("Paused: Space").rect();
    assert!(first.top() > city.bottom() - 140.0, "{first:?} in {city:?}");
    assert!(gear.bottom() < city.bottom() - 38.0, "{gear:?} in {city:?}");
}

#[test]
fn the_dashboard_tells_a_vehicle_that_rolls_back_in_gear_d() {
    let mut desk = Desk::with(fleet(1));
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    desk.change(|now| now.vehicles[0].speed_mps = -1.0);
    let mut harness = harness(desk);
    assert!(has_text(&harness, "-4 km/h"), "{:?}", texts(&harness));
    // A trace of it is none.
    harness.state_mut().change(|now| now.vehicles[0].speed_mps = -0.05);
    harness.run_steps(3);
    assert!(has_text(&harness, "0 km/h") && !has_text(&harness, "-0 km/h"), "{:?}", texts(&harness));
}
