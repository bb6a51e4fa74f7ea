//! The language of numbers: a decimal point or a decimal comma, in all panels and fields.

use super::city::texts;
use super::desk::{Desk, EditedFile, click, fleet, harness, press};
use super::timeline::mark;
use city3d_protocol::snapshot::{EventKind, FrameSnapshot, Status, VehicleId};
use city3d_session::RunPhase;
use city3d_viewer::ui::{DecimalSeparator, Preview};
use egui::Key;
use egui_kittest::kittest::Queryable;

/// Whether a text has a digit, this sign, and a digit.
fn has_fraction(text: &str, sign: char) -> bool {
    let all: Vec<char> = text.chars().collect();
    all.windows(3).any(|w| w[0].is_ascii_digit() && w[1] == sign && w[2].is_ascii_digit())
}

/// Windows with every panel that shows numbers.
fn desks() -> [Desk; 4] {
    let busy = || {
        let mut desk = Desk::with(fleet(6));
        desk.state.selection.vehicle = Some(VehicleId(2));
        desk.state.previews = vec![Preview::new(VehicleId(2))];
        (desk.state.open.traffic, desk.state.open.events, desk.state.open.inspector) = (true, true, true);
        (desk.state.layers.gaps, desk.state.layers.map) = (true, true);
        desk.events = vec![mark(1.25, 2, EventKind::LinkLost), mark(2.25, 3, EventKind::Stop)];
        desk.state.measure.begin(Some(glam::DVec2::ZERO));
        desk.state.measure.points.push(glam::DVec2::new(3.25, 4.0));
        desk
    };
    let (mut running, mut charted, mut editing) = (busy(), busy(), busy());
    running.run_state.phase = RunPhase::Running;
    (charted.state.open.charts, charted.chart) = (true, Some(super::charts::figure()));
    editing.edit = Some(EditedFile::of_fleet(6));
    editing.state.open.editor = true;
    [busy(), running, charted, editing]
}

#[test]
fn all_numbers_are_written_with_the_chosen_sign() {
    for (index, mut desk) in desks().into_iter().enumerate() {
        desk.state.preferences.decimal = DecimalSeparator::Comma;
        let mut harness = harness(desk);
        harness.run_steps(6);
        let texts = texts(&harness);
        let commas = texts.iter().filter(|text| has_fraction(text, ',')).count();
        assert!(commas > 20, "desk {index}: {commas} numbers of {} texts", texts.len());
        for text in texts {
            assert!(!has_fraction(&text, '.'), "desk {index}: {text:?} has a decimal point");
        }
    }
}

#[test]
fn the_settings_choose_the_sign() {
    let mut desk = Desk::with(fleet(2));
    desk.state.open.settings = true;
    let mut harness = harness(desk);
    harness.get_by_label("   2.50 s");
    click(&mut harness, "12,5");
    assert_eq!(harness.state().state.preferences.decimal, DecimalSeparator::Comma);
    harness.get_by_label("   2,50 s");
}

#[test]
fn number_fields_take_a_point_and_a_comma() {
    for (typed, seconds) in [("2,5", 2.5), ("7.25", 7.25)] {
        let mut harness = harness(Desk::with(fleet(2)));
        click(&mut harness, "\u{23f7}");
        harness
            .get_all_by_role(egui::accesskit::Role::SpinButton)
            .last()
            .expect("that of the time-lapse")
            .click();
        harness.run_steps(3);
        harness.key_press_modifiers(egui::Modifiers::COMMAND, Key::A);
        harness.event(egui::Event::Text(typed.to_owned()));
        harness.run_steps(2);
        press(&mut harness, Key::Enter);
        assert_eq!(harness.state().state.lapse_s, seconds, "{typed}");
        harness.get_by_label("Time-lapse");
    }
}

#[test]
fn who_waits_for_the_start_is_told_with_the_speed_of_the_start() {
    let mut desk = Desk::with(fleet(1));
    desk.change(|now| (now.vehicles[0].status, now.vehicles[0].speed_mps) = (Status::Waiting, 5.0));
    let mut harness = harness(desk);
    harness.get_by_label("(18.0)");
    for (status, speed_mps, told) in [(Status::Driving, 5.0, "18.0"), (Status::Waiting, 0.0, "0.0")] {
        let standing = |now: &mut FrameSnapshot| {
            (now.vehicles[0].status, now.vehicles[0].speed_mps) = (status, speed_mps);
        };
        harness.state_mut().change(standing);
        harness.run_steps(3);
        assert!(harness.query_all_by_label(told).count() > 0, "{told}");
        assert!(harness.query_by_label("(18.0)").is_none());
    }
}
