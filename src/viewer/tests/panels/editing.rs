//! The editor: what the panel, the keys and the mouse ask for.

use super::city::{has_text, picture, place, texts};
use super::desk::{Desk, EditedFile, click, fleet, harness, map, press};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::RunPhase;
use city3d_simulation::scenario::{StatedVehicle, VehicleEdit};
use city3d_viewer::ui::{CameraMode, EditAction, EditTool, PictureSlot, SpeedUnit, UiAction};
use egui::accesskit::Role;
use egui::{Key, Modifiers, PointerButton, Pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::sync::Arc;

/// A window that edits a file with three vehicles.
fn editing() -> Desk {
    let mut desk = Desk::with(fleet(3));
    desk.edit = Some(EditedFile::of_fleet(3));
    desk.state.open.editor = true;
    desk.run_state.phase = RunPhase::Ready;
    desk.state.selection.vehicle = Some(VehicleId(2));
    desk
}

fn actions(harness: &mut Harness<'static, Desk>) -> Vec<EditAction> {
    let taken = std::mem::take(&mut harness.state_mut().actions).into_iter();
    taken.filter_map(|action| if let UiAction::Edit(edit) = action { Some(edit) } else { None }).collect()
}

#[test]
fn the_form_changes_the_selected_vehicle() {
    let mut harness = harness(editing());
    harness.get_by_label("2 car2");
    harness.get_by_label("\u{2714} 3 vehicles, no problems");
    click(&mut harness, "leaves the city");
    let change = |edit| vec![EditAction::Change(VehicleId(2), edit)];
    assert_eq!(actions(&mut harness), change(VehicleEdit::Leaves(true)));
    click(&mut harness, "bumper");
    assert_eq!(actions(&mut harness), change(VehicleEdit::Cameras(Some(vec!["bumper".to_owned()]))));
    assert!(harness.query_all_by_value("default (idm)").count() == 1, "the driver by its algorithm");
    let choose = |harness: &mut Harness<'static, Desk>, field: &str, name: &str| {
        harness.get_by_role_and_label(Role::ComboBox, field).click();
        harness.run_steps(4);
        click(harness, name);
        actions(harness)
    };
    let name = |name: &str| Some(name.to_owned());
    assert_eq!(choose(&mut harness, "Type", "bus"), change(VehicleEdit::Type(name("bus"))));
    assert_eq!(choose(&mut harness, "Body", "van"), change(VehicleEdit::Shape(name("van"))));
    assert_eq!(choose(&mut harness, "Model", "bicycle"), change(VehicleEdit::Model(name("bicycle"))));
    // A name counts when the field is left, not letter by letter.
    harness.get_by_role_and_label(Role::TextInput, "Name").focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text("x".to_owned()));
    harness.run_steps(2);
    assert_eq!(actions(&mut harness), []);
    press(&mut harness, Key::Enter);
    assert_eq!(actions(&mut harness), change(VehicleEdit::Name("car2x".to_owned())));
    click(&mut harness, "Remove");
    assert_eq!(actions(&mut harness), [EditAction::Remove(VehicleId(2))]);
}

#[test]
fn a_lane_that_is_added_to_a_route_comes_into_sight() {
    let mut desk = editing();
    let lanes: Vec<String> = map().lanes.iter().take(30).map(|lane| lane.name.clone()).collect();
    desk.edit.as_mut().unwrap().vehicles[1].route = lanes[..29].to_vec();
    let mut harness = harness(desk);
    harness.run_steps(4);
    let list = harness.get_by_label("Remove").rect();
    let bottom = |harness: &Harness<'static, Desk>, lane: &str| {
        harness.get_all_by_label(lane).map(|row| row.rect().bottom()).fold(f32::MIN, f32::max)
    };
    assert!(bottom(&harness, &lanes[28]) > 720.0, "the list is long: {list:?}");
    harness.state_mut().edit.as_mut().unwrap().vehicles[1].route = lanes.clone();
    harness.run_steps(60);
    let at = bottom(&harness, &lanes[29]);
    assert!((list.bottom()..720.0).contains(&at), "{at}");
}

#[test]
fn beside_a_lab_vehicle_all_start_from_rest() {
    let mut harness = harness(editing());
    assert!(!has_text(&harness, "0 (lab vehicles start from rest)"));
    harness.state_mut().change(|now| {
        let roster = Arc::make_mut(&mut now.roster);
        roster[0].model = "measured".to_owned();
    });
    harness.run_steps(4);
    harness.get_by_label("0 (lab vehicles start from rest)");
}

#[test]
fn a_low_editor_scrolls_as_a_whole() {
    let mut harness = harness(editing());
    // 1280x720 at 200 %.
    harness.set_size(egui::vec2(640.0, 360.0));
    harness.run_steps(10);
    let right = harness.ctx.content_rect().right();
    for label in ["Undo", "Remove", "2 car2", "At its end"] {
        let rect = harness.get_by_label(label).rect();
        assert!(rect.right() <= right, "{label}: {rect:?} in {right}");
    }
    assert!(harness.get_by_label("At its end").rect().top() > 330.0, "below what is in sight");
    harness.get_by_label("At its end").scroll_to_me();
    harness.run_steps(20);
    let end = harness.get_by_label("At its end").rect();
    assert!(end.top() > 60.0 && end.bottom() < 340.0, "{end:?}");
}

#[test]
fn the_bar_names_the_file_that_is_edited() {
    let mut harness = harness(editing());
    assert!(harness.query_by_value("straight").is_none(), "it is saved as another one");
    harness.get_by_value("mine").click();
    harness.run_steps(5);
    click(&mut harness, "straight");
    assert_eq!(harness.state().actions, [UiAction::Scenario("straight".to_owned())], "the old one again");
}

#[test]
fn undo_and_redo_say_of_what() {
    let mut desk = editing();
    desk.edit.as_mut().unwrap().has_history = true;
    let mut harness = harness(desk);
    for (button, said) in [("Undo", "Undo: move car1 (Ctrl+Z)"), ("Redo", "Redo: remove car3 (Ctrl+Shift+Z)")]
    {
        harness.get_by_label(button).hover();
        harness.run_steps(10);
        harness.get_by_label(said);
    }
}

#[test]
fn problems_are_listed_and_keep_the_scenario_from_running() {
    let mut desk = editing();
    let problem = "line 3, column 1: the map has no lane \"a\"";
    desk.edit.as_mut().unwrap().problems = vec![problem.to_owned()];
    let mut harness = harness(desk);
    harness.get_by_label(&format!("\u{26a0} {problem}"));
    press(&mut harness, Key::F5);
    assert_eq!(actions(&mut harness), []);
    let said = harness.state().state.notice.clone().unwrap().0;
    assert!(said.contains("has problems"), "{said}");
    // Neither does its run go on behind it.
    press(&mut harness, Key::Space);
    assert!(harness.state().actions.is_empty());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::E);
    harness.run_steps(2);
    assert_eq!(actions(&mut harness), [EditAction::End]);
}

/// Types into a field of numbers, and leaves it.
fn type_number(harness: &mut Harness<'static, Desk>, field: &str, number: &str) -> Vec<EditAction> {
    harness.get_by_role_and_label(Role::SpinButton, field).click();
    harness.run_steps(3);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.event(egui::Event::Text(number.to_owned()));
    harness.run_steps(2);
    press(harness, Key::Enter);
    harness.run_steps(2);
    actions(harness)
}

#[test]
fn starts_and_speeds_are_edited_in_the_units_of_the_window_and_kept_in_those_of_the_laboratory() {
    let mut harness = harness(editing());
    let change = |edit| vec![EditAction::Change(VehicleId(2), edit)];
    assert_eq!(type_number(&mut harness, "Initial speed", "36"), change(VehicleEdit::Speed(0.4)));
    assert_eq!(type_number(&mut harness, "Start", "8.5"), change(VehicleEdit::At(0.34)));
    harness.state_mut().state.preferences.units = SpeedUnit::LabMetrePerSecond;
    harness.run_steps(2);
    assert_eq!(type_number(&mut harness, "Initial speed", "0.35"), change(VehicleEdit::Speed(0.35)));
    assert_eq!(type_number(&mut harness, "Start", "0.42"), change(VehicleEdit::At(0.42)));
}

#[test]
fn a_number_beyond_its_bounds_is_refused_beside_its_field() {
    let mut harness = harness(editing());
    assert_eq!(type_number(&mut harness, "Initial speed", "99999"), []);
    let said = harness.get_by_label("refused: only 0 to 180").rect();
    let field = harness.get_by_role_and_label(Role::SpinButton, "Initial speed").rect();
    assert!(field.y_range().contains(said.center().y), "{said:?} {field:?}");
    assert!(harness.query_by_value("0.0 km/h").is_some(), "the file still has the old one");
    // Of another vehicle it says nothing, and a number that is allowed takes it away.
    harness.state_mut().state.selection.vehicle = Some(VehicleId(3));
    harness.run_steps(2);
    assert!(harness.query_by_label_contains("refused:").is_none());
    harness.state_mut().state.selection.vehicle = Some(VehicleId(2));
    harness.run_steps(2);
    harness.get_by_label_contains("refused:");
    type_number(&mut harness, "Initial speed", "20");
    assert!(harness.query_by_label_contains("refused:").is_none());
}

#[test]
fn problems_move_no_field_of_the_form() {
    let mut harness = harness(editing());
    let place = |harness: &Harness<'static, Desk>| {
        let field = |role, label| harness.get_by_role_and_label(role, label).rect();
        [field(Role::TextInput, "Name"), field(Role::SpinButton, "Initial speed")]
    };
    let before = place(&harness);
    let problems = (1..=9).map(|k| format!("line {k}: something is wrong here, with a remedy that is long"));
    harness.state_mut().edit.as_mut().unwrap().problems = problems.collect();
    harness.run_steps(3);
    assert_eq!(place(&harness), before);
    let first = harness.get_by_label_contains("line 1:").rect();
    assert!(first.top() > before[1].bottom(), "they are told below");
}

#[test]
fn labels_stand_beside_the_first_line_of_their_fields() {
    let harness = harness(editing());
    let first = harness.get_by_label("those of its type").rect().center().y;
    // The panel Cameras has the same name.
    let mut labels = harness.get_all_by_label("Cameras");
    assert!(labels.any(|label| (label.rect().center().y - first).abs() < 3.0));
}

#[test]
fn a_driver_is_explained_under_the_mouse() {
    let mut harness = harness(editing());
    harness.state_mut().edit.as_mut().unwrap().drivers.push("sinusoid".to_owned());
    harness.run_steps(2);
    harness.get_by_role_and_label(Role::ComboBox, "Driver").click();
    harness.run_steps(4);
    let place = harness.get_by_label("sinusoid").rect().center();
    harness.hover_at(place);
    harness.run_steps(60);
    harness.get_by_label("A speed that oscillates below the desired one; behind others at most as idm");
}

#[test]
fn the_description_of_the_scenario_is_edited() {
    let mut desk = editing();
    desk.edit.as_mut().unwrap().description = "Of old".to_owned();
    let mut harness = harness(desk);
    harness.get_by_role_and_label(Role::MultilineTextInput, "Description").focus();
    harness.run_steps(2);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.event(egui::Event::Text("A crash".to_owned()));
    harness.run_steps(2);
    assert_eq!(actions(&mut harness), []);
    press(&mut harness, Key::Enter);
    assert_eq!(actions(&mut harness), [EditAction::Describe("A crash".to_owned())]);
}

#[test]
fn a_long_way_round_is_told_beside_its_lane() {
    let mut desk = editing();
    let route = ["main-boulevard/west/inner/3", "west-street/south/outer/2"].map(str::to_owned).to_vec();
    desk.edit.as_mut().unwrap().vehicles[1].route = route;
    let mut harness = harness(desk);
    harness.get_by_label_contains("times the straight distance; to west-street/south/inner/3 beside it: ");
    let warning = "\u{26a0} 3 vehicles, can be run; a long way round: car2";
    harness.get_by_label(warning);
    let is_whole = harness.output().shapes.iter().any(|clipped| match &clipped.shape {
        egui::Shape::Text(text) => {
            let place = text.galley.rect.translate(text.pos.to_vec2());
            text.galley.text() == warning
                && !text.galley.elided
                && clipped.clip_rect.expand(1.0).contains_rect(place)
        }
        _ => false,
    });
    assert!(is_whole, "the warning is cut");
    assert!(harness.query_by_label_contains("no problems").is_none(), "not beside a warning");
    harness.state_mut().edit.as_mut().unwrap().vehicles[1].route[1] = "west-street/south/inner/3".to_owned();
    harness.run_steps(2);
    assert!(harness.query_by_label_contains("times the straight distance").is_none());
}

#[test]
fn start_saves_and_runs_what_is_edited_and_the_old_run_is_neither_stepped_nor_reset() {
    let mut harness = harness(editing());
    click(&mut harness, "\u{25b6} Save, run");
    assert_eq!(actions(&mut harness), [EditAction::Run]);
    for label in ["\u{23ed} Step", "\u{27f2} Reset"] {
        click(&mut harness, label);
    }
    harness.key_press_modifiers(Modifiers::COMMAND, Key::R);
    harness.run_steps(2);
    assert!(harness.state().actions.is_empty(), "{:?}", harness.state().actions);
    harness.state_mut().edit.as_mut().unwrap().problems = vec!["there is no such lane".to_owned()];
    harness.run_steps(2);
    click(&mut harness, "\u{25b6} Save, run");
    assert!(harness.state().actions.is_empty());
}

#[test]
fn the_time_of_the_old_run_is_not_shown_beside_what_is_edited() {
    let mut harness = harness(editing());
    assert!(harness.query_by_label("Timeline").is_none());
    press(&mut harness, Key::Home);
    assert!(harness.state().actions.is_empty(), "{:?}", harness.state().actions);
    harness.state_mut().edit = None;
    harness.run_steps(2);
    harness.get_by_label("Timeline");
}

fn click_at(harness: &mut Harness<'static, Desk>, at: Pos2) {
    for pressed in [true, false] {
        harness.event(egui::Event::PointerMoved(at));
        let modifiers = Modifiers::NONE;
        harness.event(egui::Event::PointerButton {
            pos: at,
            button: PointerButton::Primary,
            pressed,
            modifiers,
        });
        harness.run_steps(1);
    }
    // The next one is no double click.
    harness.run_steps(40);
}

/// Clicks down the middle of the view until an action comes.
fn click_until_asked(harness: &mut Harness<'static, Desk>) -> (Pos2, EditAction) {
    for y in (60..620).step_by(12) {
        let at = Pos2::new(640.0, y as f32);
        click_at(harness, at);
        if let Some(action) = actions(harness).pop() {
            return (at, action);
        }
    }
    panic!("no lane is found");
}

#[test]
fn clicks_on_lanes_place_a_vehicle_and_draw_its_route() {
    let mut desk = editing();
    desk.state.set_mode(CameraMode::Overhead);
    let mut harness = harness(desk);
    press(&mut harness, Key::Insert);
    assert_eq!(harness.state().state.editing.tool, EditTool::AddVehicle);
    let (at, added) = click_until_asked(&mut harness);
    let EditAction::Add { lane, at_m } = added else { panic!("{added:?}") };
    let found = map().lane_by_name(&lane).unwrap().curve.length();
    assert!(at_m >= 0.0 && at_m * 25.0 <= found, "{at_m} of {found}");
    assert!(((at_m * 100.0).round() - at_m * 100.0).abs() < 1e-6, "{at_m} is no round number");
    // The new vehicle is selected by the viewer; its route is drawn next.
    assert_eq!(harness.state().state.editing.tool, EditTool::DrawRoute);
    click_at(&mut harness, at);
    let expected = VehicleEdit::Route(vec!["road/east/1".to_owned(), lane]);
    assert_eq!(actions(&mut harness), [EditAction::Change(VehicleId(2), expected)]);
    // Escape ends the tool before it deselects.
    press(&mut harness, Key::Escape);
    let state = &harness.state().state;
    assert_eq!((state.editing.tool, state.selection.vehicle), (EditTool::Select, Some(VehicleId(2))));
    assert_eq!(actions(&mut harness), []);
}

#[test]
fn a_vehicle_that_cannot_start_is_drawn_where_the_file_states_it_and_can_be_dragged() {
    let mut desk = editing();
    desk.state.set_mode(CameraMode::Overhead);
    let map = map();
    let lane = map.lanes.iter().max_by(|a, b| a.curve.length().total_cmp(&b.curve.length())).unwrap();
    let middle_m = lane.curve.length() / 2.0;
    let stated = StatedVehicle {
        id: VehicleId(9),
        name: "block".to_owned(),
        route: vec![lane.name.clone()],
        at_m: middle_m / 25.0,
        ..StatedVehicle::default()
    };
    let place_in_city = lane.curve.at(middle_m).pose.position;
    desk.change(|now| now.vehicles.iter_mut().for_each(|v| v.position = place_in_city.extend(0.0)));
    let edit = desk.edit.as_mut().unwrap();
    (edit.vehicles, edit.problems) = (vec![stated], vec!["block and another one overlap".to_owned()]);
    desk.state.viewpoint = city3d_viewer::ui::Viewpoint::around(&desk.run_state.now);
    desk.state.selection.vehicle = None;
    let mut harness = harness(desk);
    harness.run_steps(60);
    assert!(has_text(&harness, "9 block: cannot start here"), "{:?}", texts(&harness));
    let view = picture(&harness, PictureSlot::City).view;
    let pixel = view.project(place_in_city.extend(0.0)).unwrap();
    let [width, height] = view.extent.map(f64::from);
    let share = egui::Vec2::new((pixel.x / width) as f32, (pixel.y / height) as f32);
    let from = place(&harness).min + share * place(&harness).size();
    harness.hover_at(from);
    harness.run_steps(1);
    harness.drag_at(from);
    harness.run_steps(1);
    for step in 1..=4 {
        harness.hover_at(from + egui::vec2(4.0 * step as f32, 0.0));
        harness.run_steps(1);
    }
    harness.drop_at(from);
    harness.run_steps(2);
    let asked = actions(&mut harness);
    let [EditAction::Move { vehicle, .. }] = &asked[..] else { panic!("{asked:?}") };
    assert_eq!(*vehicle, VehicleId(9));
    // Once the scenario has no problems, the city shows it itself.
    harness.state_mut().edit.as_mut().unwrap().problems.clear();
    harness.run_steps(2);
    assert!(!has_text(&harness, "9 block: cannot start here"));
}

#[test]
fn the_route_has_the_colour_of_the_legend_in_the_editor_too() {
    let mut desk = editing();
    let route = map().lanes[..2].iter().map(|lane| lane.id).collect();
    desk.routes.insert(VehicleId(2), route);
    let mut harness = harness(desk);
    assert!(has_text(&harness, "route of vehicle 2"), "{:?}", texts(&harness));
    let yellow = |harness: &Harness<'static, Desk>| {
        let lines = &harness.state().state.overlay.lines;
        lines.iter().any(|line| line.paint.colour[..3] == [255, 220, 90])
    };
    assert!(!yellow(&harness), "yellow is the lane of a tool");
    press(&mut harness, Key::T);
    assert!(has_text(&harness, "lane of the next click"));
}
