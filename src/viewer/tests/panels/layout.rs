//! Panels are docked, moved, hidden and lifted; theme, size and units hold everywhere.

use super::city::{place, spread, vehicle_at};
use super::desk::{Desk, click, fleet, harness, press, with};
use super::end_card::finished;
use city3d_protocol::snapshot::VehicleId;
use city3d_session::RunPhase;
use city3d_viewer::ui::{Layout, Panel, PictureSlot, SpeedUnit, Theme};
use egui::accesskit::Role;
use egui::{Key, Modifiers, Pos2, Rect, Shape, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

fn city_width(harness: &Harness<'static, Desk>) -> u32 {
    let pictures = &harness.state().state.pictures;
    pictures.iter().find(|picture| picture.slot == PictureSlot::City).unwrap().view.extent[0]
}

/// The line between the table and the city.
fn table_edge(harness: &Harness<'static, Desk>) -> f32 {
    place(harness).left()
}

fn drag(harness: &mut Harness<'static, Desk>, from: Pos2, to: Pos2) {
    harness.hover_at(from);
    harness.run_steps(2);
    harness.drag_at(from);
    harness.run_steps(2);
    for share in [0.3, 0.7, 1.0] {
        harness.hover_at(from.lerp(to, share));
        harness.run_steps(2);
    }
    harness.drop_at(to);
    harness.run_steps(4);
}

fn title(harness: &Harness<'static, Desk>, panel: &str) -> Rect {
    harness.get_by_role_and_label(Role::Button, panel).rect()
}

#[test]
fn the_table_is_hidden_by_a_key_and_by_its_button_and_comes_back() {
    let mut harness = with(6);
    let narrow = city_width(&harness);
    for _ in 0..2 {
        harness.key_press_modifiers(Modifiers::COMMAND, Key::B);
        harness.run_steps(3);
        assert!(harness.query_by_label("Status").is_none());
        assert!(city_width(&harness) > narrow + 300, "{} of {narrow}", city_width(&harness));
        harness.key_press_modifiers(Modifiers::COMMAND, Key::B);
        harness.run_steps(3);
        assert_eq!(city_width(&harness), narrow);
    }
    click(&mut harness, "Close");
    assert!(harness.query_by_label("Status").is_none());
}

#[test]
fn a_list_opens_below_the_table_and_covers_nothing() {
    let mut harness = with(6);
    harness.state_mut().state.toggle_preview(VehicleId(1));
    harness.run_steps(4);
    let before = city_width(&harness);
    press(&mut harness, Key::F3);
    press(&mut harness, Key::F4);
    harness.run_steps(3);
    assert_eq!(city_width(&harness), before);
    let (table, list) = (harness.get_by_label("Status").rect(), title(&harness, "Events"));
    assert!(list.top() > table.bottom() && list.right() < table_edge(&harness), "{list:?} below {table:?}");
    // Both are tabs of one place; the last one is in front.
    harness.get_by_label("Nothing has been measured yet: start the run.");
    assert!(harness.query_by_label("Nothing has happened yet.").is_none());
    title(&harness, "Events");
    click(&mut harness, "Events");
    harness.get_by_label("Nothing has happened yet.");
    // The key of a panel behind another one brings it to the front; that of the one in front closes it.
    press(&mut harness, Key::F4);
    harness.run_steps(3);
    harness.get_by_label("Nothing has been measured yet: start the run.");
    press(&mut harness, Key::F3);
    harness.run_steps(3);
    harness.get_by_label("Nothing has happened yet.");
    press(&mut harness, Key::Escape);
    assert!(harness.state().state.open.events, "Escape closes what lies over the city, not what is docked");
}

/// As at 150 %: a list that is lower than the usual least height of one.
#[test]
fn in_a_low_panel_a_list_is_scrolled_to_its_last_row() {
    let mut harness = with(6);
    harness.set_size(vec2(853.0, 480.0));
    press(&mut harness, Key::F3);
    harness.run_steps(4);
    let edge = title(&harness, "Events").top();
    harness.hover_at(harness.get_all_by_label("car1").next().unwrap().rect().center());
    harness.run_steps(2);
    for _ in 0..10 {
        let (unit, delta) = (egui::MouseWheelUnit::Point, vec2(0.0, -60.0));
        let (phase, source) = (egui::TouchPhase::Move, egui::MouseWheelSource::Unknown);
        let modifiers = egui::Modifiers::default();
        harness.event(egui::Event::MouseWheel { unit, delta, modifiers, phase, source });
        harness.run_steps(8);
    }
    let last = harness.get_all_by_label("car6").next().unwrap().rect();
    assert!(last.bottom() <= edge, "{last:?} above {edge}");
}

#[test]
fn a_panel_is_moved_by_its_title_and_restored() {
    let mut harness = with(6);
    press(&mut harness, Key::F3);
    harness.run_steps(3);
    let from = title(&harness, "Events").center();
    assert!(from.x < table_edge(&harness), "{from:?}");
    drag(&mut harness, from, Pos2::new(1270.0, 400.0));
    let moved = title(&harness, "Events");
    assert!(moved.left() > 800.0, "{moved:?}");
    harness.state_mut().state.restore_layout();
    press(&mut harness, Key::F3);
    harness.run_steps(3);
    assert_eq!(title(&harness, "Events").center(), from);
}

#[test]
fn the_width_of_a_panel_is_kept_in_a_window_of_any_size_and_in_the_settings() {
    let mut harness = with(6);
    let usual = city_width(&harness);
    let edge = Pos2::new(table_edge(&harness) + 0.5, 400.0);
    drag(&mut harness, edge, edge - vec2(60.0, 0.0));
    let dragged = city_width(&harness);
    assert!((50..=70).contains(&(dragged - usual)), "{usual} {dragged}");
    harness.set_size(vec2(1600.0, 900.0));
    harness.run_steps(4);
    assert_eq!(city_width(&harness), dragged + 320, "the city takes what a larger window has");
    let state = &harness.state().state;
    let stored = state.layout.stored(state.open).unwrap();
    let mut desk = Desk::with(fleet(6));
    desk.state.layout = Layout::from(&stored);
    assert_eq!(desk.state.layout.stored(desk.state.open), Some(stored));
    assert_eq!(city_width(&self::harness(desk)), dragged);
}

#[test]
fn panels_that_float_hide_no_other() {
    let mut desk = Desk::with(fleet(6));
    (desk.state.open.layers, desk.state.open.events) = (true, true);
    desk.state.layout.toggle_floating(Panel::Events);
    let mut harness = harness(desk);
    harness.run_steps(4);
    let window = |harness: &Harness<'static, Desk>, title: &str| {
        harness.get_by_role_and_label(Role::Window, title).rect()
    };
    let (layers, events) = (window(&harness, "Layers"), window(&harness, "Events"));
    assert!(!layers.intersects(events), "{layers:?} {events:?}");
    press(&mut harness, Key::Escape);
    press(&mut harness, Key::Escape);
    let open = harness.state().state.open;
    assert!(!open.layers && !open.events);
}

#[test]
fn theme_size_and_units_hold_at_once() {
    let mut harness = with(6);
    harness.get_by_label("km/h");
    harness.state_mut().state.preferences.theme = Theme::Light;
    harness.state_mut().state.preferences.units = SpeedUnit::LabMetrePerSecond;
    harness.run_steps(3);
    assert!(!harness.ctx.global_style().visuals.dark_mode);
    harness.get_by_label("m/s lab");
    // Vehicle 6 goes with 6 m/s.
    harness.get_by_label("0.240");
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Plus);
    harness.run_steps(3);
    assert_eq!(harness.ctx.zoom_factor(), 1.1);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Num0);
    harness.run_steps(3);
    assert_eq!(harness.ctx.zoom_factor(), 1.0);
}

#[test]
fn the_page_of_settings_changes_them() {
    let mut harness = with(6);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Comma);
    harness.run_steps(4);
    click(&mut harness, "Light");
    click(&mut harness, "Colour-blind");
    let preferences = harness.state().state.preferences;
    assert_eq!(preferences.theme, Theme::Light);
    assert_ne!(preferences.colours, city3d_viewer::ui::Preferences::default().colours);
    press(&mut harness, Key::Escape);
    assert!(!harness.state().state.open.settings);
}

#[test]
fn in_a_narrow_window_the_bar_breaks_between_its_groups() {
    let mut harness = with(6);
    for width in [1280.0, 1000.0, 900.0, 700.0] {
        harness.set_size(vec2(width, 700.0));
        harness.run_steps(4);
        let top = |label: &str| harness.get_by_label(label).rect().center().y;
        for group in
            [&["Orbit", "Chase", "Onboard", "Overhead", "Free"][..], &["Layers", "Cameras", "Panels", "Help"]]
        {
            let tops: Vec<f32> = group.iter().map(|label| top(label)).collect();
            assert!(tops.iter().all(|y| (y - tops[0]).abs() < 2.0), "{width}: {group:?} at {tops:?}");
            let right = harness.get_by_label(group[group.len() - 1]).rect().right();
            assert!(right <= width, "{width}: {group:?} ends at {right}");
        }
        let rows = if width >= 1280.0 { 1 } else { 2 };
        let last = top("Help") - top("\u{27f2} Reset");
        assert!((last > 10.0) == (rows > 1), "{width}: {last} below");
    }
}

#[test]
fn without_previews_the_city_has_their_room_and_the_bar_opens_one() {
    let mut harness = with(6);
    let wide = city_width(&harness);
    // Nobody is selected: the first one's.
    click(&mut harness, "Cameras");
    assert_eq!(harness.state().state.previews[0].vehicle, VehicleId(1));
    harness.run_steps(3);
    assert!(city_width(&harness) + 200 < wide, "{} of {wide}", city_width(&harness));
    harness.state_mut().state.selection.vehicle = Some(VehicleId(4));
    press(&mut harness, Key::P);
    let open = |harness: &Harness<'static, Desk>| -> Vec<u32> {
        harness.state().state.previews.iter().map(|preview| preview.vehicle.0).collect()
    };
    assert_eq!(open(&harness), [1, 4]);
    // Hidden, they are not drawn, and come back as they were.
    harness.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::B);
    harness.run_steps(3);
    assert_eq!((city_width(&harness), harness.state().state.pictures.len()), (wide, 1));
    harness.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::B);
    harness.run_steps(3);
    assert_eq!((open(&harness), harness.state().state.pictures.len()), (vec![1, 4], 3));
}

#[test]
fn the_heading_that_sorts_the_table_is_whole() {
    let mut harness = with(6);
    click(&mut harness, "km/h");
    harness.get_by_label("km/h, ascending");
    let heading = harness.output().shapes.iter().find_map(|clipped| match &clipped.shape {
        Shape::Text(text) if text.galley.text() == "km/h" => {
            Some((text.galley.elided, text, clipped.clip_rect))
        }
        _ => None,
    });
    let (is_cut, text, clip) = heading.expect("the heading is painted as it is");
    assert!(!is_cut && text.pos.x + text.galley.size().x <= clip.right(), "{:?} in {clip:?}", text.pos);
}

#[test]
fn the_reverse_gear_moves_nothing_in_a_preview() {
    for units in [SpeedUnit::KmPerHour, SpeedUnit::LabMetrePerSecond] {
        let mut desk = Desk::with(fleet(2));
        desk.state.preferences.units = units;
        desk.state.toggle_preview(VehicleId(1));
        let mut harness = harness(desk);
        let mut top = |reverse: bool, speed_mps: f64| {
            harness.state_mut().change(|now| {
                (now.vehicles[0].reverse, now.vehicles[0].speed_mps) = (reverse, speed_mps);
            });
            harness.run_steps(3);
            harness.get_by_label("Gas 0.00").rect().top()
        };
        assert_eq!(top(false, 13.9), top(true, -0.06), "{units:?}");
    }
}

#[test]
fn a_second_view_leaves_previews_and_views_room() {
    let mut desk = Desk::with(fleet(6));
    desk.state.toggle_preview(VehicleId(1));
    let mut harness = harness(desk);
    let width = |harness: &Harness<'static, Desk>, slot: PictureSlot| {
        let pictures = &harness.state().state.pictures;
        pictures.iter().find(|picture| picture.slot == slot).unwrap().view.extent[0]
    };
    let alone = width(&harness, PictureSlot::Preview(VehicleId(1)));
    harness.state_mut().state.open.views = [true, false];
    harness.run_steps(4);
    let [city, second] = [PictureSlot::City, PictureSlot::View(0)].map(|slot| width(&harness, slot));
    assert!(city > 500 && second > 500, "{city} and {second}");
    assert_eq!(width(&harness, PictureSlot::Preview(VehicleId(1))), alone, "previews keep their room");
    harness.state_mut().state.open.views = [true, true];
    harness.run_steps(4);
    let [second, third] = [0, 1].map(|view| width(&harness, PictureSlot::View(view)));
    assert!(second > 250 && third > 250, "{second} and {third}");
}

#[test]
fn panels_open_beside_one_another_and_not_over_the_followed_vehicle() {
    let mut desk = Desk::with(spread(3));
    desk.state.selection.vehicle = Some(VehicleId(2));
    let mut harness = harness(desk);
    harness.state_mut().state.layout.toggle_floating(Panel::Charts);
    // A window with room for both beside the vehicle.
    harness.set_size(vec2(1600.0, 900.0));
    harness.run_steps(4);
    press(&mut harness, Key::F);
    harness.run_steps(60);
    assert_eq!(harness.state().state.viewpoint.follow, Some(VehicleId(2)));
    // What is opened first is the last of the list of panels, and yet hidden by none that follows.
    harness.state_mut().state.open.layers = true;
    harness.run_steps(4);
    press(&mut harness, Key::F6);
    harness.run_steps(4);
    let [layers, charts] =
        ["Layers", "Charts"].map(|title| harness.get_by_role_and_label(Role::Window, title).rect());
    assert!(!layers.intersects(charts), "{layers:?} {charts:?}");
    let vehicle = super::city::vehicle_at(&harness, 1);
    for panel in [layers, charts] {
        assert!(!panel.contains(vehicle), "{panel:?} over the vehicle at {vehicle:?}");
    }
    let [bar, timeline] = ["Reset", "Until ..."].map(|label| harness.get_by_label_contains(label).rect());
    for panel in [layers, charts] {
        assert!(!panel.intersects(bar) && !panel.intersects(timeline), "{panel:?} over a bar");
    }
}

#[test]
fn a_panel_over_the_city_gives_way_to_one_that_opens_beneath_it() {
    let mut harness = with(6);
    harness.state_mut().state.layout.toggle_floating(Panel::Charts);
    press(&mut harness, Key::F6);
    harness.run_steps(4);
    let charts =
        |harness: &Harness<'static, Desk>| harness.get_by_role_and_label(Role::Window, "Charts").rect();
    // Over the table, below its rows: where it hides nothing.
    let from = charts(&harness).center_top() + vec2(0.0, 12.0);
    drag(&mut harness, from, egui::pos2(200.0, 350.0));
    let before = charts(&harness);
    press(&mut harness, Key::F4);
    harness.run_steps(6);
    let traffic = harness.get_by_label("Nothing has been measured yet: start the run.").rect();
    assert!(before.intersects(traffic), "it would be hidden: {before:?} {traffic:?}");
    let after = charts(&harness);
    assert!(!after.intersects(traffic), "{after:?} over {traffic:?}");
}

#[test]
fn every_layer_says_what_it_shows() {
    let mut harness = with(2);
    harness.state_mut().state.open.layers = true;
    harness.run_steps(4);
    for (layer, tip) in [("Way ahead", "The next 6 s of its route"), ("Driven paths", "in the last 20 s")] {
        let at = harness.get_by_label(layer).rect().center();
        harness.hover_at(at);
        harness.run_steps(20);
        assert!(harness.query_by_label_contains(tip).is_some(), "{layer}");
    }
}

#[test]
fn a_long_legend_keeps_beside_the_map() {
    let mut desk = Desk::with(fleet(3));
    desk.state.selection.vehicle = Some(VehicleId(1));
    desk.state.preferences.scale = 1.5;
    (desk.state.layers.tracks, desk.state.layers.zones, desk.state.layers.gaps) = (true, true, true);
    desk.state.layers.is_legend_open = Some(true);
    let mut harness = harness(desk);
    harness.run_steps(8);
    let city = place(&harness);
    let texts: Vec<Rect> = harness
        .output()
        .shapes
        .iter()
        .filter_map(|clipped| match &clipped.shape {
            Shape::Text(text) if text.galley.text().contains("the last 20 s") => {
                Some(Rect::from_min_size(text.pos, text.galley.size()))
            }
            _ => None,
        })
        .collect();
    assert_eq!(texts.len(), 2);
    for text in texts {
        assert!(text.right() <= city.right(), "{text:?} in {city:?}");
    }
}

#[test]
fn entries_at_the_edge_of_a_list_do_not_look_disabled() {
    let harness = with(6);
    assert_eq!(harness.ctx.global_style().spacing.scroll.fade.strength, 0.0);
}

#[test]
fn the_card_of_a_finished_run_opens_beside_the_vehicle_that_one_looks_at() {
    for selected in [None, Some(VehicleId(1))] {
        let mut desk = finished();
        desk.state.selection.vehicle = selected;
        desk.run_state.phase = RunPhase::Paused;
        let mut harness = harness(desk);
        harness.state_mut().run_state.phase = RunPhase::Over;
        harness.run_steps(8);
        let city = place(&harness);
        let card = ["Run finished", "Run again with seed 2", "Collisions"]
            .map(|text| harness.get_by_label(text).rect());
        let card = card.into_iter().fold(card[0], Rect::union);
        assert!(city.contains_rect(card), "{card:?} beside {city:?}");
        let at = vehicle_at(&harness, 0);
        assert!(selected.is_none() || !card.contains(at), "{selected:?}: {at:?} under {card:?}");
        assert!(harness.ctx.content_rect().contains_rect(card), "{card:?}");
    }
}

/// Whether the charts float when they are opened in a window of a size, in which they are closed again.
fn floats_in(harness: &mut Harness<'static, Desk>, size: egui::Vec2) -> bool {
    harness.set_size(size);
    harness.run_steps(4);
    press(harness, Key::F6);
    harness.run_steps(6);
    assert!(harness.state().state.open.charts);
    let floats = harness.query_by_role_and_label(Role::Window, "Charts").is_some();
    press(harness, Key::F6);
    harness.run_steps(4);
    floats
}

#[test]
fn charts_open_below_the_city_and_over_it_where_there_is_no_room_below() {
    let mut harness = with(6);
    let sizes = [vec2(1280.0, 720.0), vec2(853.0, 480.0), vec2(1280.0, 720.0)];
    assert_eq!(sizes.map(|size| floats_in(&mut harness, size)), [false, true, false]);
    harness.state_mut().state.layout.toggle_floating(Panel::Charts);
    assert_eq!(sizes.map(|size| floats_in(&mut harness, size)), [true; 3], "the user has lifted them");
}
