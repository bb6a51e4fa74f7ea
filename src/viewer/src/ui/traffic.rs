//! The panel Traffic: delay, throughput, stops, queue, energy and safety while the run goes on, and the time-space
//! diagram of a route.

use super::control_zones::zone_colour;
use super::live_traffic::LiveTraffic;
use super::{UiState, ViewModel, plans, theme};
use city3d_control::Route;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{LaneId, ZoneKind};
use city3d_session::{DIAGRAM_S, LanePlace};
use city3d_simulation::measures::{PassageTotals, Queue, Tracked};
use egui::{Color32, FontId, Grid, Rangef, RichText, Ui};
use egui_plot::{AxisHints, Line, Plot, PlotPoints, Polygon, VLine};
use std::collections::{BTreeMap, VecDeque};

/// Range of the diagram around the selected vehicle, metres of the city.
const BEHIND_M: f64 = 90.0;
const AHEAD_M: f64 = 60.0;

/// Shows the measures, in full-scale units as all lengths of the window are.
pub(super) fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    egui::ScrollArea::both().auto_shrink(false).show(ui, |ui| {
        let is_known = is_known(ui, shown);
        if is_known {
            flow(ui, shown.traffic);
        }
        ui.separator();
        if plans::has_zones(shown) {
            plans::queue(ui, shown);
            ui.separator();
        }
        if !is_known {
            return;
        }
        safety_and_energy(ui, shown.traffic);
        ui.separator();
        diagram(ui, state, shown);
    });
}

/// Measures of a log whose time differs by more from the shown time are those of another time, seconds.
const LATE_S: f64 = 2.0;

/// Says of which time the measures are; returns whether there are any for what is shown.
fn is_known(ui: &mut Ui, shown: &ViewModel<'_>) -> bool {
    let traffic = shown.traffic.measured();
    let (until_s, shown_s) = (traffic.until_s(), shown.run_state.now.time_s);
    let decimal = theme::decimal(ui.ctx());
    let [until, of_shown] = [until_s, shown_s].map(|s| decimal.fixed(s, 1));
    let note = |ui: &mut Ui, text: String| _ = ui.label(RichText::new(text).small().weak());
    if let Some(replay) = &shown.replay {
        let late_s = LATE_S.max(replay.head.speed);
        if traffic.since_s().is_none() || (shown_s - until_s).abs() > late_s {
            ui.horizontal(|ui| {
                ui.spinner();
                ui.label(format!("The log is being measured up to {of_shown} s."));
            });
            return false;
        }
    }
    let Some(since_s) = traffic.since_s() else {
        note(ui, "Nothing has been measured yet: start the run.".to_owned());
        return false;
    };
    if shown.past.is_shown && shown.replay.is_none() {
        let text = format!("Live, at {until} s: not of the past that is shown, {of_shown} s.");
        ui.label(RichText::new(text).strong().color(ui.visuals().warn_fg_color));
    }
    note(ui, format!("Measured from {} s to {until} s.", decimal.fixed(since_s, 1)));
    true
}

/// One row of the table of flows.
struct FlowRow<'r> {
    name: &'r str,
    colour: Option<Color32>,
    inside: usize,
    passed: String,
    totals: PassageTotals,
    queue: &'r Queue,
}

/// Numbers of the whole city and of each control zone.
fn flow(ui: &mut Ui, traffic: &LiveTraffic) {
    let measures = traffic.measures();
    let there = |tracked: &&Tracked| tracked.trip.ended_s.is_none();
    let arrived = measures.vehicles().iter().filter(|tracked| tracked.trip.has_arrived).count();
    let city = FlowRow {
        name: "City",
        colour: None,
        inside: measures.vehicles().iter().filter(there).count(),
        passed: arrived.to_string(),
        totals: measures.trips(),
        queue: measures.queue(),
    };
    let zones = measures.zones().enumerate().map(|(index, (zone, zone_traffic))| FlowRow {
        name: &zone.name,
        colour: Some(zone_colour(index)),
        inside: zone_traffic.inside().len(),
        passed: zone_traffic.passages.len().to_string(),
        totals: measures.zone_totals(&zone.name).unwrap_or_default(),
        queue: &zone_traffic.queue,
    });
    let decimal = theme::decimal(ui.ctx());
    Grid::new("flow").striped(true).spacing([8.0, 3.0]).show(ui, |ui| {
        for (title, tip) in COLUMNS {
            ui.label(RichText::new(title).small().strong()).on_hover_text(tip);
        }
        ui.end_row();
        for row in std::iter::once(city).chain(zones) {
            let totals = &row.totals;
            let seconds = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |s| decimal.fixed(s, 1));
            let flow = totals.throughput_per_h.map_or_else(|| "-".to_owned(), |flow| format!("{flow:.0}"));
            let name = RichText::new(row.name);
            let on_ground = |colour| theme::on_ground(ui.ctx(), colour);
            let name = row.colour.map_or(name.clone(), |colour| name.color(on_ground(colour)));
            ui.label(name);
            for cell in [
                row.inside.to_string(),
                row.passed,
                flow,
                seconds(totals.mean_delay_s),
                seconds(totals.max_delay_s),
                totals.stops.to_string(),
                format!("{} ({}, {})", row.queue.now, decimal.fixed(row.queue.mean(), 1), row.queue.max),
            ] {
                ui.monospace(cell);
            }
            ui.end_row();
        }
    });
}

const COLUMNS: [(&str, &str); 8] = [
    ("", ""),
    ("Inside", "Vehicles on their way"),
    ("Passed", "Vehicles that have arrived, or left the control zone behind its last conflict"),
    ("Flow (/h)", "Exits after the first one over the time since it, vehicles an hour"),
    ("Delay (s)", "Mean time lost against driving alone, with the time held outside"),
    ("Most (s)", "Largest delay"),
    ("Stops", "How often vehicles stopped: below 0.5 m/s"),
    ("Queue", "Vehicles that are stopped now (mean over time, most at a time)"),
];

/// Longer times to collision are not told, seconds.
const MOST_TTC_S: f64 = 100.0;

/// Surrogate safety and energy of the whole city.
fn safety_and_energy(ui: &mut Ui, traffic: &LiveTraffic) {
    let measures = traffic.measures();
    let (safety, effort) = (measures.safety(), measures.effort());
    let scale = measures.scale();
    let decimal = theme::decimal(ui.ctx());
    let of = |value: f64, unit: &str| format!("{} {unit}", decimal.fixed(value, 1));
    // Who follows at almost the same speed collides in hours, which says nothing.
    let ttc = match safety.min_ttc_s {
        Some(ttc_s) if ttc_s > MOST_TTC_S => format!("above {MOST_TTC_S:.0} s"),
        Some(ttc_s) => of(ttc_s, "s"),
        None => "-".to_owned(),
    };
    let text = |value: Option<f64>, unit: &str| match value {
        Some(value) => of(value, unit),
        None => "-".to_owned(),
    };
    let drac = Some(scale.city_from_lab(safety.max_drac_mps2)).filter(|drac| drac.is_finite());
    let cells = [
        ("Least time to collision", ttc, "Gap over closing speed to the vehicle ahead"),
        (
            "Least gap",
            text(safety.min_gap_m.map(|m| scale.city_from_lab(m)), "m"),
            "Bumper to bumper on one path",
        ),
        (
            "Least post-encroachment",
            text(safety.min_pet_s, "s"),
            "From the exit of one vehicle out of a conflict zone to the entry of the next from the other side; negative \
             where both were inside",
        ),
        ("Braking needed", text(drac, "m/s2"), "Deceleration that avoids a crash with the vehicle ahead"),
        ("Fuel", of(effort.fuel_ml, "mL"), "Polynomial of Kamal et al., no fuel while braking"),
        (
            "Fuel, cruise term",
            of(effort.fuel_with_cruise_ml, "mL"),
            "The same, keeping the term of the speed while braking",
        ),
        (
            "Squared acceleration",
            of(effort.int_u2_m2ps3, "m2/s3"),
            "Integral over time of all vehicles; half of it is the cost of optimal control",
        ),
        (
            "Encounters",
            format!("{} + {}", safety.ttc_encounters, safety.pet_encounters),
            "Time to collision below 3 s + post-encroachment time below 2 s",
        ),
    ];
    Grid::new("safety and energy").spacing([8.0, 3.0]).show(ui, |ui| {
        for pair in cells.chunks(2) {
            for (name, value, tip) in pair {
                ui.label(*name).on_hover_text(*tip);
                ui.monospace(value);
            }
            ui.end_row();
        }
    });
}

/// Time-space diagram of the selected vehicle's route: everybody on its lanes.
fn diagram(ui: &mut Ui, state: &UiState, shown: &ViewModel<'_>) {
    let measures = shown.traffic.measures();
    let Some(selected) = state.selection.vehicle else {
        ui.label(RichText::new("Select a vehicle to see the time-space diagram of its route.").weak());
        return;
    };
    let place = measures.vehicle(selected).and_then(|tracked| Some((tracked.route()?, tracked.station?)));
    let Some((route, station)) = place else {
        ui.label(RichText::new("The selected vehicle is not on a known route.").weak());
        return;
    };
    let factor = measures.scale().factor();
    let now_s = shown.traffic.measured().until_s();
    let starts = lane_starts(route, station.front_s);
    ui.label(
        RichText::new("Time-space diagram: front bumpers along the selected vehicle's route, m").small(),
    );
    let text = FontId::monospace(9.0);
    let colour_of_text = ui.visuals().text_color();
    let axis = |axis: AxisHints<'static>| {
        axis.tick_label_font(text.clone())
            .tick_label_color(colour_of_text)
            .label_spacing(Rangef::new(6.0, 8.0))
    };
    let time = axis(AxisHints::new_x()).min_thickness(11.0).formatter(|mark, _| match mark.value {
        ago if ago > -0.5 => "0 s".to_owned(),
        ago => format!("{ago:.0}"),
    });
    let decimal = theme::decimal(ui.ctx());
    let value =
        axis(AxisHints::new_y()).min_thickness(26.0).formatter(move |mark, _| decimal.plain(mark.value));
    // The list scrolls, so that its own room has no end.
    let height = (ui.clip_rect().bottom() - ui.cursor().top()).clamp(160.0, 400.0);
    let plot = Plot::new("time-space")
        .height(height)
        .default_x_bounds(-DIAGRAM_S, 0.5)
        .default_y_bounds(-BEHIND_M, AHEAD_M)
        .show_background(false)
        .allow_scroll(false)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_boxed_zoom(false)
        .show_x(false)
        .show_y(false)
        .custom_x_axes(vec![time])
        .custom_y_axes(vec![value]);
    let (context, strongest) = (ui.ctx().clone(), ui.visuals().strong_text_color());
    plot.show(ui, |plot| {
        for crossing in &route.crossings {
            let [from, to] = [crossing.from_s, crossing.to_s].map(|s| (s - station.front_s) * factor);
            if to < -BEHIND_M || from > AHEAD_M {
                continue;
            }
            let colour = match crossing.kind {
                ZoneKind::Cross => Color32::from_rgba_unmultiplied(255, 90, 80, 40),
                ZoneKind::Merge | ZoneKind::Diverge => Color32::from_rgba_unmultiplied(255, 180, 60, 40),
            };
            let (from, to) = (from.max(-BEHIND_M), to.min(AHEAD_M));
            let corners = vec![[-DIAGRAM_S, from], [0.5, from], [0.5, to], [-DIAGRAM_S, to]];
            let band = Polygon::new("conflict", PlotPoints::from(corners));
            plot.polygon(band.fill_color(colour).stroke(egui::Stroke::NONE));
        }
        plot.vline(VLine::new("now", 0.0).color(Color32::from_gray(110)).width(1.0));
        for (id, places) in shown.traffic.measured().places() {
            let (colour, width) = match id == selected {
                true => (strongest, 2.5),
                false => (theme::on_ground(&context, body_colour(shown, id)), 1.4),
            };
            for points in pieces(places, &starts, (station.front_s, factor, now_s)) {
                plot.line(Line::new(id.to_string(), PlotPoints::from(points)).color(colour).width(width));
            }
        }
    });
}

/// The colour of a body, lifted so that dark bodies show on a dark ground.
fn body_colour(shown: &ViewModel<'_>, id: VehicleId) -> Color32 {
    let colour = shown.run_state.now.info(id).map(|info| info.appearance.colour);
    let [r, g, b] = colour.unwrap_or([140, 150, 160]);
    let lift = |channel: u8| 90 + (u16::from(channel) * 165 / 255) as u8;
    Color32::from_rgb(lift(r), lift(g), lift(b))
}

/// Start of each lane of a route, for the visit nearest to a position.
fn lane_starts(route: &Route, near_s: f64) -> BTreeMap<LaneId, f64> {
    let mut starts: BTreeMap<LaneId, f64> = BTreeMap::new();
    for (index, &lane) in route.lanes().iter().enumerate() {
        let start_s = route.lane_start(index);
        let is_nearer = |known: &f64| (start_s - near_s).abs() < (known - near_s).abs();
        if starts.get(&lane).is_none_or(is_nearer) {
            starts.insert(lane, start_s);
        }
    }
    starts
}

/// Lines of one vehicle: time before now and metres ahead of the selected one's front. A vehicle that leaves the route,
/// or goes round to its beginning, begins another line.
fn pieces(
    places: &VecDeque<LanePlace>,
    starts: &BTreeMap<LaneId, f64>,
    (origin_s, factor, now_s): (f64, f64, f64),
) -> Vec<Vec<[f64; 2]>> {
    let mut lines: Vec<Vec<[f64; 2]>> = vec![Vec::new()];
    for place in places {
        let point = starts
            .get(&place.lane)
            .map(|start_s| [place.time_s - now_s, (start_s + place.at_m - origin_s) * factor]);
        let point = point.filter(|[_, y]| (-BEHIND_M..=AHEAD_M).contains(y));
        let last = lines.last().and_then(|line| line.last().copied());
        let jumps = point.zip(last).is_some_and(|(new, old)| (new[1] - old[1]).abs() > 0.2 * factor);
        if (point.is_none() || jumps) && lines.last().is_some_and(|line| !line.is_empty()) {
            lines.push(Vec::new());
        }
        if let (Some(point), Some(line)) = (point, lines.last_mut()) {
            line.push(point);
        }
    }
    lines.retain(|line| line.len() > 1);
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_off_the_route_interrupts_its_line() {
        let place = |k: u32, lane: u32| LanePlace {
            time_s: f64::from(k) * 0.1,
            lane: LaneId(lane),
            at_m: f64::from(k) * 0.03,
        };
        let places: VecDeque<LanePlace> = [(0, 1), (1, 1), (2, 7), (3, 7), (4, 1), (5, 1)]
            .into_iter()
            .map(|(k, lane)| place(k, lane))
            .collect();
        let starts = [(LaneId(1), 2.0)].into();
        let lines = pieces(&places, &starts, (2.0, 25.0, 0.5));
        assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2]);
        assert!((lines[0][1][0] + 0.4).abs() < 1e-9 && (lines[0][1][1] - 0.75).abs() < 1e-9, "{lines:?}");
    }
}
