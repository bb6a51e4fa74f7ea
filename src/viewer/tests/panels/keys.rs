//! Keys of the user's own: the page of keys, what they run, and where they are told.

use super::commands::desks;
use super::desk::{Desk, click, fleet, harness, press, with};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::{Order, RunPhase};
use city3d_viewer::ui::runs::ResetQuestion;
use city3d_viewer::ui::{
    Binding, KeyMap, KeyUse, ManualDrive, SECTIONS, Scope, SettingsPage, UiAction, bindings,
};
use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::sync::Arc;

fn binding(name: &str) -> Binding {
    bindings().find(|binding| binding.name == name).unwrap_or_else(|| panic!("no action {name}"))
}

fn words(harness: &Harness<'static, Desk>, name: &str) -> String {
    harness.state().state.keys.words(&binding(name))
}

/// The page of keys, searched for some words.
fn page(desk: Desk, search: &str) -> Harness<'static, Desk> {
    let mut harness = harness(desk);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Comma);
    harness.run_steps(3);
    click(&mut harness, "Keys");
    let field = harness.get_all_by_role(egui::accesskit::Role::TextInput).last().unwrap();
    field.focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text(search.to_owned()));
    harness.run_steps(3);
    harness
}

/// Comes to a button by the keyboard, and presses it.
fn press_button(harness: &mut Harness<'static, Desk>, label: &str) {
    harness.get_by_label(label).focus();
    harness.run_steps(2);
    press(harness, Key::Enter);
    harness.run_steps(2);
}

#[test]
fn the_settings_list_every_action_with_its_key() {
    let mut desk = Desk::with(fleet(2));
    (desk.state.open.settings, desk.state.settings_page) = (true, SettingsPage::Keys);
    let harness = harness(desk);
    for section in &SECTIONS {
        for binding in section.bindings() {
            assert!(harness.query_all_by_label(binding.name).count() > 0, "{} is not listed", binding.name);
            for key in binding.usual {
                assert!(
                    harness.query_all_by_label(&key.words()).count() > 0,
                    "{}: {}",
                    binding.name,
                    key.words()
                );
            }
        }
    }
}

#[test]
fn the_usual_keys_of_two_actions_do_not_clash() {
    let keys = KeyMap::default();
    for binding in bindings() {
        for key in binding.usual {
            let rivals: Vec<&str> = keys.rivals(&binding, *key).iter().map(|rival| rival.name).collect();
            assert!(rivals.is_empty(), "{}: {} is also for {rivals:?}", binding.name, key.words());
        }
    }
}

#[test]
fn an_action_can_be_run_only_where_its_key_is_said_to_work() {
    let [selected, running, driving, replay, editing, finished] = desks();
    for (desk, scope) in [
        (selected, Scope::LIVE),
        (running, Scope::LIVE),
        (driving, Scope::DRIVING),
        (replay, Scope::PLAYED),
        (editing, Scope::EDITING),
        (finished, Scope::LIVE),
    ] {
        let now = desk.available_now();
        assert!(!now.is_empty());
        for name in now {
            assert!(binding(name).scope.overlaps(scope), "{name} can be run in {scope:?}");
        }
    }
}

#[test]
fn another_key_is_assigned_by_the_keyboard_and_told_everywhere() {
    let mut harness = page(Desk::with(fleet(2)), "start, pause");
    press_button(&mut harness, "Space");
    harness.get_by_label("Press a key ...");
    // What would move the focus, and what other actions have, reach the page alone.
    press(&mut harness, Key::Tab);
    harness.get_by_label("Tab moves the keyboard focus");
    assert!(harness.state().state.key_page.is_waiting());
    press(&mut harness, Key::K);
    assert_eq!(words(&harness, "Start, pause or continue the run"), "K");
    assert!(harness.state().actions.is_empty(), "the pressed keys did nothing else");
    press(&mut harness, Key::Escape);
    press(&mut harness, Key::Escape);
    assert!(!harness.state().state.open.settings);
    press(&mut harness, Key::Space);
    assert!(harness.state().actions.is_empty(), "its usual key is free");
    press(&mut harness, Key::K);
    assert_eq!(harness.state().actions, [UiAction::Order(Order::Start)]);
    // The tip of the button, the footer, the help, and the settings file.
    harness.get_by_label("\u{25b6} Continue").hover();
    harness.run_steps(40);
    harness.get_by_label_contains("(K)");
    harness.get_by_label_contains("K start/pause");
    press(&mut harness, Key::F1);
    harness.run_steps(5);
    harness.get_by_label("K");
    let stored = toml_of(&harness.state().state.keys);
    assert_eq!(stored.trim(), "\"Start, pause or continue the run\" = [\"K\"]");
}

fn toml_of(keys: &Arc<KeyMap>) -> String {
    toml::to_string(&**keys).unwrap()
}

#[test]
fn the_palette_opens_and_closes_by_its_own_key() {
    let mut desk = Desk::with(fleet(2));
    let search = binding("Find an action");
    let f12 = binding("Save a screenshot").usual[0];
    let keys = Arc::make_mut(&mut desk.state.keys);
    keys.assign(&binding("Save a screenshot"), Vec::new());
    keys.assign(&search, vec![f12]);
    let mut harness = harness(desk);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
    harness.run_steps(3);
    assert!(!harness.state().state.palette.is_open);
    for is_open in [true, false] {
        press(&mut harness, Key::F12);
        harness.run_steps(2);
        assert_eq!(harness.state().state.palette.is_open, is_open);
    }
}

#[test]
fn a_key_that_another_action_has_is_named_and_given_over_or_left_there() {
    for gives in [true, false] {
        let mut harness = page(Desk::with(fleet(2)), "screenshot");
        press_button(&mut harness, "F12");
        press(&mut harness, Key::F3);
        harness.run_steps(3);
        harness.get_by_label("F3 already has an action: List of events");
        if gives {
            // The answer has the keyboard focus.
            press(&mut harness, Key::Enter);
        } else {
            press_button(&mut harness, "Leave it there");
        }
        harness.run_steps(2);
        let told = [words(&harness, "Save a screenshot"), words(&harness, "List of events")];
        let expected = if gives { ["F3", ""] } else { ["F12", "F3"] };
        assert_eq!(told, expected.map(str::to_owned));
        assert!(harness.query_by_label_contains("already has an action").is_none());
    }
}

#[test]
fn escape_leaves_a_key_where_it_is_and_the_page_open() {
    let mut harness = page(Desk::with(fleet(2)), "screenshot");
    press_button(&mut harness, "F12");
    press(&mut harness, Key::F3);
    harness.run_steps(3);
    harness.get_by_label("F3 already has an action: List of events");
    press(&mut harness, Key::Escape);
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("already has an action").is_none());
    let told = [words(&harness, "Save a screenshot"), words(&harness, "List of events")];
    assert_eq!(told, ["F12", "F3"].map(str::to_owned));
    assert!(harness.state().state.open.settings, "the page stays");
}

#[test]
fn actions_that_are_never_there_together_share_a_key() {
    // Hazard lights are for who drives; a route is drawn in the editor.
    let mut harness = page(Desk::with(fleet(2)), "hazard");
    press_button(&mut harness, "H");
    press(&mut harness, Key::T);
    assert_eq!(words(&harness, "Hazard lights"), "T");
    assert_eq!(words(&harness, "Draw the route of the selected vehicle"), "T");
}

#[test]
fn keys_are_added_taken_away_and_restored() {
    let mut harness = page(Desk::with(fleet(2)), "screenshot");
    press_button(&mut harness, "+");
    harness.key_press_modifiers(Modifiers::COMMAND, Key::F8);
    harness.run_steps(3);
    assert_eq!(words(&harness, "Save a screenshot"), "F12 or Ctrl+F8");
    let row = harness.get_by_label("Save a screenshot").rect().center().y;
    let is_in_row = |rect: egui::Rect| (rect.center().y - row).abs() < 4.0;
    harness.get_all_by_label("x").find(|button| is_in_row(button.rect())).unwrap().focus();
    harness.run_steps(2);
    press(&mut harness, Key::Enter);
    harness.run_steps(2);
    assert_eq!(words(&harness, "Save a screenshot"), "Ctrl+F8");
    press_button(&mut harness, "Restore");
    assert_eq!(words(&harness, "Save a screenshot"), "F12");
    press_button(&mut harness, "F12");
    press(&mut harness, Key::F8);
    press_button(&mut harness, "Restore all keys");
    assert!(harness.state().state.keys.is_all_usual());
}

#[test]
fn escape_leaves_a_key_as_it_was_and_keeps_its_own_work() {
    let mut harness = page(Desk::with(fleet(2)), "screenshot");
    press_button(&mut harness, "F12");
    press(&mut harness, Key::Escape);
    assert!(!harness.state().state.key_page.is_waiting());
    assert!(harness.state().state.open.settings, "it only ended the assignment");
    assert_eq!(words(&harness, "Save a screenshot"), "F12");
    let close = binding("Close what is open; then release, then deselect the vehicle");
    assert_eq!(close.key_use, KeyUse::Fixed);
}

#[test]
fn keys_of_a_driver_are_assigned_like_others() {
    let mut desk = Desk::with(fleet(2));
    desk.run_state.phase = RunPhase::Running;
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    let name = "Gas: the pedal moves while you hold the key";
    let mut harness = page(desk, "gas:");
    press_button(&mut harness, "W");
    harness.key_press_modifiers(Modifiers::COMMAND, Key::K);
    harness.run_steps(2);
    harness.get_by_label("What acts while it is held needs a key without Ctrl and Shift");
    press(&mut harness, Key::K);
    assert_eq!(words(&harness, name), "K or Up");
    press(&mut harness, Key::Escape);
    press(&mut harness, Key::Escape);
    let gas = |harness: &mut Harness<'static, Desk>, key: Key| {
        harness.state_mut().actions.clear();
        harness.key_down(key);
        harness.run_steps(10);
        harness.key_up(key);
        let pedal = |action: &UiAction| match action {
            UiAction::Order(Order::Drive(_, pedals)) => pedals.gas,
            _ => 0.0,
        };
        let most = harness.state().actions.iter().map(pedal).fold(0.0, f64::max);
        harness.run_steps(60);
        most
    };
    assert!(gas(&mut harness, Key::K) > 0.05);
    assert_eq!(gas(&mut harness, Key::W), 0.0);
    // The dashboard tells it.
    harness.get_by_label_contains("K S pedals");
}

#[test]
fn the_camera_moves_by_assigned_keys() {
    let mut desk = Desk::with(fleet(2));
    let forward = binding("Move the camera forward");
    let key = binding("Follow the selected vehicle, or stop following").usual[0];
    Arc::make_mut(&mut desk.state.keys)
        .assign(&binding("Follow the selected vehicle, or stop following"), Vec::new());
    Arc::make_mut(&mut desk.state.keys).assign(&forward, vec![key]);
    let mut harness = harness(desk);
    let mut moved = |key: Key| {
        let before = format!("{:?}", harness.state().state.viewpoint);
        harness.key_down(key);
        harness.run_steps(4);
        harness.key_up(key);
        harness.run_steps(1);
        format!("{:?}", harness.state().state.viewpoint) != before
    };
    assert!(moved(Key::F) && !moved(Key::W));
}

#[test]
fn in_dialogs_only_the_keys_of_the_registry_for_them_work() {
    let quit = binding("Quit");
    let other = binding("Save a screenshot");
    for is_assigned in [false, true] {
        let mut harness = with(2);
        if is_assigned {
            // F12 quits now, and Ctrl+Q saves a picture.
            let keys = Arc::make_mut(&mut harness.state_mut().state.keys);
            keys.assign(&quit, other.usual.to_vec());
            keys.assign(&other, quit.usual.to_vec());
        }
        let text = "It is not recorded.".to_owned();
        harness.state_mut().state.runs.question = Some(ResetQuestion { text, is_new: true });
        harness.run_steps(3);
        press(&mut harness, Key::F12);
        harness.key_press_modifiers(Modifiers::COMMAND, Key::Q);
        harness.key_press_modifiers(Modifiers::COMMAND, Key::E);
        press(&mut harness, Key::F9);
        harness.run_steps(2);
        let (first, second) = match is_assigned {
            true => (UiAction::Quit, UiAction::Screenshot),
            false => (UiAction::Screenshot, UiAction::Quit),
        };
        assert_eq!(harness.state().actions, [first, second]);
    }
}

#[test]
fn a_letter_that_quits_is_typed_in_the_palette() {
    let mut harness = with(2);
    let quit = binding("Quit");
    let letter = binding("Show or hide the map").usual[0];
    let keys = Arc::make_mut(&mut harness.state_mut().state.keys);
    keys.assign(&binding("Show or hide the map"), Vec::new());
    keys.assign(&quit, vec![letter]);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
    harness.run_steps(3);
    press(&mut harness, Key::M);
    assert!(harness.state().actions.is_empty());
    press(&mut harness, Key::Escape);
    press(&mut harness, Key::M);
    assert_eq!(harness.state().actions, [UiAction::Quit]);
}
