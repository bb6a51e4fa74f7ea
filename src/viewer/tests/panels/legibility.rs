//! What has to be read: sizes of texts, nothing over them, nothing that vanishes without a word.

use super::city::{has_text, on_screen, place, texts};
use super::desk::{Desk, click, fleet, harness, press, with};
use super::end_card::finished;
use city3d_logbook::measures::RunMeasures;
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_viewer::ui::runs::{ComparedRuns, FilePurpose, RunAgain};
use city3d_viewer::ui::{Theme, UiAction};
use egui::{Rect, Shape, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

/// Painted texts with their sizes of letters, places, and what is visible of their panels.
fn painted(harness: &Harness<'static, Desk>) -> Vec<(String, f32, Rect, Rect)> {
    fn of(shape: &Shape, clip: Rect, found: &mut Vec<(String, f32, Rect, Rect)>) {
        match shape {
            Shape::Text(text) => {
                let sizes = text.galley.job.sections.iter().map(|section| section.format.font_id.size);
                let size = sizes.fold(f32::INFINITY, f32::min);
                let place = text.galley.rect.translate(text.pos.to_vec2());
                found.push((text.galley.text().to_owned(), size, place, clip));
            }
            Shape::Vec(shapes) => shapes.iter().for_each(|shape| of(shape, clip, found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    for clipped in &harness.output().shapes {
        of(&clipped.shape, clipped.clip_rect, &mut found);
    }
    found
}

/// Letters are at least so high, points.
const SMALLEST: f32 = 11.0;

#[test]
fn no_text_is_smaller_than_eleven_points() {
    let mut desk = Desk::with(fleet(6));
    desk.state.toggle_preview(VehicleId(1));
    desk.state.open.traffic = true;
    desk.chart = Some(super::charts::figure());
    desk.state.layers.boxes = true;
    desk.state.selection.vehicle = Some(VehicleId(1));
    let mut harness = harness(desk);
    harness.set_size(Vec2::new(1600.0, 1000.0));
    for key in [None, Some(egui::Key::F6), Some(egui::Key::F3), Some(egui::Key::I)] {
        if let Some(key) = key {
            press(&mut harness, key);
        }
        harness.run_steps(4);
        let found = painted(&harness);
        assert!(found.len() > 60, "{} texts", found.len());
        let small: Vec<_> =
            found.iter().filter(|(text, size, ..)| !text.is_empty() && *size < SMALLEST).collect();
        assert!(small.is_empty(), "{small:?}");
    }
}

#[test]
fn the_scroll_bar_of_a_comparison_covers_no_number() {
    let mut harness = harness(finished());
    let present = RunMeasures::of(&super::end_card::outcome());
    let mut pairs = present.beside(&present);
    while pairs.len() < 60 {
        pairs.extend(pairs.clone());
    }
    let names = ["this run".to_owned(), "another".to_owned()];
    harness.state_mut().state.runs.comparison.show(ComparedRuns { names, pairs, note: None });
    harness.run_steps(4);
    let header = painted(&harness).into_iter().find(|(text, ..)| text == "A - B").expect("it has a heading");
    let window = harness.get_by_label("Compare runs").rect();
    // The bar is as wide as this when the mouse is over it.
    let free = window.right() - 9.0;
    assert!(header.2.right() < free, "{:?} of {window:?}", header.2);
    for (text, _, place, _) in painted(&harness).iter().filter(|(text, ..)| text == "0") {
        assert!(place.right() <= header.2.right() + 1.0, "{text} at {place:?}");
    }
}

#[test]
fn a_narrow_window_keeps_its_controls_in_a_menu_that_says_so() {
    let mut harness = with(6);
    harness.state_mut().state.preferences.scale = 1.5;
    harness.run_steps(6);
    let hidden = ["\u{23f4} Step", "\u{23f4} Event", "Event \u{23f5}"];
    for label in hidden {
        assert!(harness.query_by_label(label).is_none(), "{label} has no room");
    }
    click(&mut harness, "More \u{23f7}");
    for label in hidden {
        let there = harness.get_by_label(label).rect();
        assert!(harness.ctx.content_rect().contains_rect(there), "{label} at {there:?}");
    }
    // The bar wraps: all of its groups are in sight.
    press(&mut harness, egui::Key::Escape);
    for label in ["\u{25b6} Continue", "Open", "Orbit", "Free", "Layers", "Help"] {
        let there = harness.get_by_label(label).rect();
        assert!(harness.ctx.content_rect().contains_rect(there), "{label} at {there:?}");
    }
    let mut wide = with(6);
    wide.run_steps(4);
    assert!(wide.query_by_label("More \u{23f7}").is_none());
}

#[test]
fn the_pedals_of_both_previews_are_in_sight_in_a_small_window() {
    let mut desk = Desk::with(fleet(2));
    desk.state.toggle_preview(VehicleId(1));
    desk.state.toggle_preview(VehicleId(2));
    let mut harness = harness(desk);
    harness.run_steps(4);
    let bottom = place(&harness).bottom();
    let last = harness.get_all_by_label("Handbrake 0.00").map(|gauge| gauge.rect().bottom());
    let lowest = last.fold(0.0, f32::max);
    assert!(lowest <= bottom, "{lowest} of {bottom}");
    let words = "Plots: in a taller window, or with one preview";
    assert_eq!(harness.get_all_by_label(words).count(), 2, "what has no room is told");
    harness.set_size(Vec2::new(1280.0, 1100.0));
    harness.run_steps(4);
    assert!(harness.query_by_label(words).is_none());
    assert_eq!(harness.query_all_by_label_contains("Lateral error").count(), 2);
}

#[test]
fn a_message_does_not_cover_who_has_collided() {
    let mut desk = Desk::with(fleet(1));
    desk.change(|now| now.vehicles[0].status = Status::Collided);
    let mut harness = harness(desk);
    harness.run_steps(4);
    let (mut is_at_top, mut is_at_bottom) = (false, false);
    for k in 0..30 {
        harness.state_mut().change(|now| now.vehicles[0].position.y = 60.0 - 6.0 * f64::from(k));
        let now_s = harness.ctx.input(|input| input.time);
        harness.state_mut().state.say("A collision of a vehicle", now_s);
        harness.run_steps(3);
        let said = painted(&harness).into_iter().find(|(text, ..)| text == "A collision of a vehicle");
        let said = said.expect("it is shown").2.expand(8.0);
        let city = place(&harness);
        let at = on_screen(&harness, 0);
        assert!(at.is_none_or(|at| !said.contains(at)), "{said:?} over {at:?}");
        is_at_top |= said.center().y < city.center().y;
        is_at_bottom |= said.center().y > city.center().y;
    }
    assert!(is_at_top && is_at_bottom, "it gives way where it has to");
}

#[test]
fn a_notice_does_not_cover_what_a_dialog_says() {
    let mut harness = with(2);
    let folder = tempfile::tempdir().unwrap();
    harness.state_mut().state.runs.last_folder = Some(folder.path().to_path_buf());
    harness.state_mut().state.runs.browse(FilePurpose::SaveScenario { runs: false });
    let now_s = harness.ctx.input(|input| input.time);
    harness.state_mut().state.say("The video is written", now_s);
    harness.run_steps(3);
    let find = |words: &str| {
        let found = painted(&harness).into_iter().find(|(text, ..)| text.starts_with(words));
        found.unwrap_or_else(|| panic!("{words} in {:?}", texts(&harness))).2
    };
    let notice = find("The video is written").expand(8.0);
    for words in ["Save the scenario as a file", "Type a name: a new file"] {
        assert!(!find(words).intersects(notice), "{words}: {:?} and {notice:?}", find(words));
    }
}

#[test]
fn a_finished_run_can_be_run_again_in_another_environment_and_tells_what_a_stop_is() {
    let mut harness = harness(finished());
    harness.get_by_value("as before").click();
    harness.run_steps(4);
    click(&mut harness, "testbed");
    click(&mut harness, "Run again with seed 2");
    let again = RunAgain { seed: Some(2), environment: Some(EnvironmentProfile::Testbed) };
    assert_eq!(harness.state().actions, [UiAction::RunAgain(again)]);
    harness.get_by_label("Slow stops (< 0.5 m/s)").hover();
    harness.run_steps(10);
    assert!(harness.query_by_label_contains("also where these end").is_some());
}

#[test]
fn the_theme_of_high_contrast_is_chosen_in_the_settings() {
    let mut harness = with(2);
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::Comma);
    harness.run_steps(3);
    click(&mut harness, "High contrast");
    assert_eq!(harness.state().state.preferences.theme, Theme::HighContrast);
    harness.run_steps(2);
    assert_eq!(harness.ctx.global_style().visuals.panel_fill, egui::Color32::BLACK);
    assert!(has_text(&harness, "High contrast"));
}
