//! The editor: what the panel, the keys and the mouse ask for.

use super::desk::{Desk, EditedFile, click, fleet, harness, map, press};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::RunPhase;
use city3d_simulation::scenario::VehicleEdit;
use city3d_viewer::ui::{CameraMode, EditAction, EditTool, UiAction};
use egui::{Key, Modifiers, PointerButton, Pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

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
    harness.get_all_by_value("default").next().unwrap().click();
    harness.run_steps(4);
    click(&mut harness, "bus");
    assert_eq!(actions(&mut harness), change(VehicleEdit::Type(Some("bus".to_owned()))));
    // A name counts when the field is left, not letter by letter.
    harness.get_by_role_and_label(egui::accesskit::Role::TextInput, "Name").focus();
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

#[test]
fn start_saves_and_runs_what_is_edited_and_the_old_run_is_neither_stepped_nor_reset() {
    let mut harness = harness(editing());
    click(&mut harness, "\u{25b6} Start");
    assert_eq!(actions(&mut harness), [EditAction::Run]);
    for label in ["\u{23ed} Step", "\u{27f2} Reset"] {
        click(&mut harness, label);
    }
    harness.key_press_modifiers(Modifiers::COMMAND, Key::R);
    harness.run_steps(2);
    assert!(harness.state().actions.is_empty(), "{:?}", harness.state().actions);
    harness.state_mut().edit.as_mut().unwrap().problems = vec!["there is no such lane".to_owned()];
    harness.run_steps(2);
    click(&mut harness, "\u{25b6} Start");
    assert!(harness.state().actions.is_empty());
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
