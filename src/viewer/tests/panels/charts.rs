//! The panel Charts: what can be chosen, what is drawn, and what a click does.

use super::city::{has_text, texts};
use super::desk::{Desk, click, fleet, harness, press};
use city3d_logbook::figures::chart::{
    ChartLine, Dash, Figure, LegendEntry, LineName, LineStyle, Panel, ReferenceLine,
};
use city3d_logbook::figures::{FigureScale, Quantity, TidyTable};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::playback::PlaybackCommand;
use city3d_viewer::ui::{self, ChartKind, MergeChoice, UiAction};
use egui::Key;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

/// A line from 0 to 10 s.
pub fn figure() -> Figure {
    let stroke = LineStyle::solid([0, 114, 178]);
    let points = (0..=100).map(|k| (f64::from(k) * 0.1, f64::from(k))).collect();
    let panel = Panel {
        x_label: "Time [s]".to_owned(),
        y_label: "Speed [km/h]".to_owned(),
        x: (0.0, 10.0),
        y: (0.0, 100.0),
        lines: vec![ChartLine { points, stroke }],
        ..Panel::default()
    };
    Figure {
        name: "speed".to_owned(),
        title: "straight: speed".to_owned(),
        panels: vec![panel],
        columns: 1,
        row_height: 0.5,
        legend: vec![LegendEntry { name: "1 car1".to_owned(), stroke }],
        scale: None,
        note: "Along the heading. Full scale.".to_owned(),
        table: TidyTable::default(),
    }
}

#[test]
fn the_name_of_a_line_stands_at_its_end() {
    let harness = open(|desk| {
        let names = vec![LineName { at: (9.0, 90.0), name: "7 last".to_owned(), lines: 0..1 }];
        desk.chart.as_mut().unwrap().panels[0].names = names;
    });
    assert!(has_text(&harness, "7 last"), "{:?}", texts(&harness));
}

fn open(change: impl FnOnce(&mut Desk)) -> Harness<'static, Desk> {
    let mut desk = Desk::with(fleet(6));
    desk.chart = Some(figure());
    change(&mut desk);
    let mut harness = harness(desk);
    press(&mut harness, Key::F6);
    harness.run_steps(6);
    harness
}

#[test]
fn a_chart_names_its_lines_and_quantities_can_be_chosen() {
    let mut harness = open(|_| {});
    for label in ["Speed [km/h]", "\u{2014} 1 car1", "Along the heading. Full scale."] {
        harness.get_by_label(label);
    }
    harness.get_by_value("Speed").click();
    harness.run_steps(4);
    click(&mut harness, "Time headway");
    assert_eq!(harness.state().state.charts.kind, ChartKind::Series(Quantity::Headway));
    click(&mut harness, "laboratory units");
    assert_eq!(harness.state().state.charts.scale, FigureScale::Laboratory);
    click(&mut harness, "Save");
    assert_eq!(harness.state().actions, [UiAction::SaveChart]);
    press(&mut harness, Key::F6);
    harness.run_steps(4);
    assert!(harness.query_by_label("Speed [km/h]").is_none(), "the key that opens it closes it");
    press(&mut harness, Key::F6);
    harness.state_mut().state.layout.toggle_floating(ui::Panel::Charts);
    harness.run_steps(4);
    press(&mut harness, Key::Escape);
    harness.run_steps(4);
    assert!(harness.query_by_label("Speed [km/h]").is_none(), "Escape closes what floats over the city");
}

#[test]
fn reference_lines_of_a_chart_have_their_names() {
    let rule = ReferenceLine {
        at: 40.0,
        is_level: true,
        name: "merging point".to_owned(),
        dash: Dash::Solid,
        is_before: false,
    };
    let outside = ReferenceLine { at: 400.0, name: "far away".to_owned(), ..rule.clone() };
    let harness = open(|desk| desk.chart.as_mut().unwrap().panels[0].rules = vec![rule, outside]);
    assert!(has_text(&harness, "merging point") && !has_text(&harness, "far away"), "{:?}", texts(&harness));
}

#[test]
fn vehicles_stay_in_the_chart_until_they_are_taken_out() {
    let mut harness = open(|desk| desk.state.selection.vehicle = Some(VehicleId(2)));
    let keep = harness.get_by_label("+ Keep").rect();
    click(&mut harness, "+ Keep");
    // A second click at the same place takes nothing out again.
    assert_eq!(harness.get_by_label("+ Keep").rect(), keep);
    super::city::click_at(&mut harness, keep.center(), 1);
    harness.state_mut().state.selection.vehicle = Some(VehicleId(5));
    harness.run_steps(3);
    super::city::click_at(&mut harness, keep.center(), 2);
    harness.run_steps(3);
    assert_eq!(harness.state().state.charts.vehicles, [2, 5].map(VehicleId));
    click(&mut harness, "2 car2 \u{d7}");
    assert_eq!(harness.state().state.charts.vehicles, [VehicleId(5)]);
}

#[test]
fn a_click_in_a_chart_over_time_goes_to_that_time() {
    let mut harness = open(|_| {});
    let label = harness.get_by_label("Speed [km/h]").rect();
    // In the middle of the axes, whose left edge is narrower than their right one.
    let at = label.left_bottom() + egui::vec2(280.0, 80.0);
    harness.event(egui::Event::PointerMoved(at));
    harness.run_steps(1);
    for pressed in [true, false] {
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        harness.event(egui::Event::PointerButton { pos: at, button, pressed, modifiers });
        harness.run_steps(1);
    }
    harness.run_steps(2);
    let told = &harness.state().actions;
    let [UiAction::PlaybackCommand(PlaybackCommand::Seek(time_s))] = told[..] else { panic!("{told:?}") };
    assert!((3.0..7.0).contains(&time_s), "{time_s}");
}

#[test]
fn of_poses_alone_no_pedals_are_charted() {
    let harness = open(|desk| {
        desk.has_control_data = false;
        desk.state.charts.kind = ChartKind::Series(Quantity::Gas);
    });
    harness.get_by_label_contains("Only poses are known");
    assert!(harness.query_by_label("Speed [km/h]").is_none());
}

#[test]
fn a_merging_point_can_be_chosen_where_there_are_several() {
    let merge = |lane: &str, vehicles| MergeChoice { lane: lane.to_owned(), vehicles };
    let mut harness = open(|desk| {
        desk.state.charts.kind = ChartKind::SpaceTime;
        desk.merges = vec![merge("street-1/west/2", 21), merge("avenue-1/north/1", 1)];
    });
    assert!(harness.query_by_label_contains("The first 8 vehicles").is_none(), "it has all of them");
    harness.get_by_value("street-1/west/2 (21 vehicles)").click();
    harness.run_steps(4);
    click(&mut harness, "avenue-1/north/1 (1 vehicle)");
    assert_eq!(harness.state().state.charts.merge.as_deref(), Some("avenue-1/north/1"));
    harness.get_by_value("street-1/west/2 (21 vehicles)").click();
    harness.run_steps(4);
    click(&mut harness, "automatic");
    assert_eq!(harness.state().state.charts.merge, None);
    harness.state_mut().merges.truncate(1);
    harness.run_steps(3);
    assert!(harness.query_by_label("Merging point").is_none(), "there is nothing to choose");
}

#[test]
fn where_the_kept_vehicles_have_no_figure_the_chart_says_so_and_leads_to_all_vehicles() {
    let mut harness = open(|desk| {
        desk.state.charts.kind = ChartKind::SpaceTime;
        desk.state.charts.vehicles = vec![VehicleId(2)];
        (desk.chart, desk.chart_trouble) = (None, Some("car2 does not pass".to_owned()));
    });
    harness.get_by_label("car2 does not pass");
    click(&mut harness, "Save");
    assert_eq!(harness.state().actions, [], "there is nothing to write");
    click(&mut harness, "Show all vehicles");
    assert!(harness.state().state.charts.vehicles.is_empty());
}
