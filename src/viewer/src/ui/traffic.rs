//! The panel Traffic: delay, throughput, stops, queue, energy and safety while the run goes on, and the time-space
//! diagram of a route.

use super::control_zones::zone_colour;
use super::live_traffic::LiveTraffic;
use super::{DecimalSeparator, SpeedUnit, UiState, ViewModel, plans, space_time, theme};
use city3d_simulation::measures::{PassageTotals, Queue, Tracked};
use egui::{Color32, Grid, RichText, Ui};

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
        safety_and_energy(ui, shown.traffic, state.preferences.units);
        ui.separator();
        space_time::show(ui, state, shown);
    });
}

/// What measures of a log are, beside those of its run.
const OF_LOG: &str = "A log has some states a second, and the run was measured at every step: counts, and integrals of accelerations, may be slightly smaller here than in its summary";

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
    if shown.edit.is_some() {
        note(ui, "The edited scenario has not run yet.".to_owned());
        return false;
    }
    let Some(since_s) = traffic.since_s() else {
        note(ui, "Nothing has been measured yet: start the run.".to_owned());
        return false;
    };
    if shown.past.is_shown && shown.replay.is_none() {
        let text = format!("Live, at {until} s: not of the past that is shown, {of_shown} s.");
        ui.label(RichText::new(text).strong().color(ui.visuals().warn_fg_color));
    }
    let from = if shown.replay.is_some() { " from the log" } else { "" };
    let text = format!("Measured{from} from {} s to {until} s.", decimal.fixed(since_s, 1));
    let label = ui.label(RichText::new(text).small().weak());
    if shown.replay.is_some() {
        label.on_hover_text(OF_LOG);
    }
    let warm_up_s = traffic.measures().warm_up_s();
    if warm_up_s > 0.0 {
        let warm_up = decimal.fixed(warm_up_s, 0);
        note(ui, format!("Flow, delay, slow stops and queues count from {warm_up} s on (warm-up)."));
    }
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
    /// The warm-up goes on: nothing is known of what counts after it.
    warms_up: bool,
}

impl FlowRow<'_> {
    /// Its numbers, in the order of [`COLUMNS`].
    fn cells(&self, decimal: DecimalSeparator) -> [String; 9] {
        let (totals, queue) = (&self.totals, self.queue);
        let counted = |text: String| if self.warms_up { "-".to_owned() } else { text };
        let seconds = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |s| decimal.fixed(s, 1));
        let flow = totals.throughput_per_h.map_or_else(|| NO_FLOW.to_owned(), |flow| format!("{flow:.0}"));
        [
            self.inside.to_string(),
            self.passed.clone(),
            flow,
            seconds(totals.mean_delay_s),
            seconds(totals.max_delay_s),
            counted(totals.stops.to_string()),
            counted(queue.now.to_string()),
            counted(decimal.fixed(queue.mean(), 1)),
            counted(queue.max.to_string()),
        ]
    }
}

/// Numbers of the whole city and of each control zone.
fn flow(ui: &mut Ui, traffic: &LiveTraffic) {
    let measures = traffic.measures();
    let there = |tracked: &&Tracked| tracked.is_under_way();
    let arrived = measures.vehicles().iter().filter(|tracked| tracked.trip.has_arrived).count();
    let warms_up = measures.now_s() < measures.warm_up_s();
    let city = FlowRow {
        name: "City",
        colour: None,
        inside: measures.vehicles().iter().filter(there).count(),
        passed: arrived.to_string(),
        totals: measures.trips(),
        queue: measures.queue(),
        warms_up,
    };
    let zones = measures.zones().enumerate().map(|(index, (zone, zone_traffic))| FlowRow {
        name: &zone.name,
        colour: Some(zone_colour(index)),
        inside: zone_traffic.inside().len(),
        passed: zone_traffic.passages.len().to_string(),
        totals: measures.zone_totals(&zone.name).unwrap_or_default(),
        queue: &zone_traffic.queue,
        warms_up,
    });
    let decimal = theme::decimal(ui.ctx());
    let rows: Vec<FlowRow<'_>> = std::iter::once(city).chain(zones).collect();
    let name = |ui: &mut Ui, row: &FlowRow<'_>| {
        let text = RichText::new(row.name);
        let colour = row.colour.map(|colour| theme::on_ground(ui.ctx(), colour));
        ui.label(colour.map_or(text.clone(), |colour| text.color(colour)));
    };
    let title = |ui: &mut Ui, (title, tip): (&str, &str)| {
        ui.label(RichText::new(title).small().strong()).on_hover_text(tip);
    };
    Grid::new("flow").striped(true).spacing([BETWEEN_COLUMNS, 3.0]).show(ui, |ui| {
        if is_narrow(ui) {
            ui.label("");
            rows.iter().for_each(|row| name(ui, row));
            ui.end_row();
            for (k, column) in COLUMNS[1..].iter().enumerate() {
                title(ui, *column);
                for row in &rows {
                    ui.monospace(&row.cells(decimal)[k]).on_hover_text(column.1);
                }
                ui.end_row();
            }
            return;
        }
        COLUMNS.into_iter().for_each(|column| title(ui, column));
        ui.end_row();
        for row in &rows {
            name(ui, row);
            for (cell, (_, tip)) in row.cells(decimal).iter().zip(&COLUMNS[1..]) {
                ui.monospace(cell).on_hover_text(*tip);
            }
            ui.end_row();
        }
    });
}

/// Whether the tables have no room beside one another: then each measure has a line of its own.
fn is_narrow(ui: &Ui) -> bool {
    const WIDE: f32 = 700.0;
    // The panel scrolls, so that its own room has no end.
    ui.clip_rect().width() < WIDE
}

/// What measures are that the card of a finished run has, too.
pub(super) const FLOW: &str = "Exits after the first one over the time since it, vehicles an hour; none of fewer than two after the warm-up";
pub(super) const DELAY: &str = "Mean time lost against driving alone, with the time held outside: of all that have set out, also those that are on their way or have collided; in a control zone of complete passages alone";
pub(super) const MEAN_SPEED: &str = "Distance over the time in the city, mean over the vehicles but parked ones: one that has arrived and stays there slows it, the longer the run goes on";
pub(super) const LONGEST_STAND: &str = "Of any vehicle on its way, as the events tell it: from below 0.1 m/s until it was faster than 0.4 m/s and went away. Who has arrived, or has collided, does not count";
pub(super) const SLOW_STOPS: &str = "Slow stops (< 0.5 m/s)";
pub(super) const STOPS: &str = "How often vehicles on their routes became slower than 0.5 m/s, also where these end: not before the warm-up of the scenario is over, and not anew before they have been faster than 1 m/s; in a control zone on complete passages alone. Whoever has left its route, as a person may, does not count from then on, nor do its earlier stops; one that has collided does not come to stand. Events \"standstill\" are those below 0.1 m/s, of everybody";

const QUEUE: &str = "Vehicles on their way, also collided ones, that became slower than 0.5 m/s and have not been faster than 1 m/s since, and those that wait outside of the city for room";

const COLUMNS: [(&str, &str); 10] = [
    ("", ""),
    (
        "Inside",
        "Vehicles on their way, also those that have collided; parked ones and those at their ends do not count",
    ),
    ("Passed", "Vehicles that have arrived, or left the control zone behind its last conflict"),
    ("Flow (/h)", FLOW),
    ("Delay (s)", DELAY),
    ("Most (s)", "Largest of these delays"),
    (SLOW_STOPS, STOPS),
    ("Queue now", QUEUE),
    ("Queue, mean", "The same, mean over time"),
    (
        "Queue, most",
        "The most vehicles that were stopped at a time, also before they moved off for the first time",
    ),
];

/// Between columns of numbers, points: closer ones read as one number.
pub(super) const BETWEEN_COLUMNS: f32 = 16.0;
/// In place of a flow.
const NO_FLOW: &str = "none yet";
/// Longer times to collision are not told, seconds.
const MOST_TTC_S: f64 = 100.0;

/// Speed, surrogate safety and energy of the whole city.
fn safety_and_energy(ui: &mut Ui, traffic: &LiveTraffic, units: SpeedUnit) {
    let measures = traffic.measures();
    let (safety, effort) = (measures.safety(), measures.effort());
    let scale = measures.scale();
    let decimal = theme::decimal(ui.ctx());
    let of = |value: f64, unit: &str| format!("{} {unit}", decimal.fixed(value, 1));
    // Who follows at almost the same speed collides in hours, which says nothing.
    let ttc = match safety.min_ttc_s {
        // It ends where they touch: a collision from the side has none before.
        Some(_) if safety.min_gap_m.is_some_and(|gap_m| gap_m <= 0.0) => "0 s: they touched".to_owned(),
        Some(ttc_s) if ttc_s > MOST_TTC_S => format!("above {MOST_TTC_S:.0} s"),
        Some(ttc_s) => of(ttc_s, "s"),
        None => "-".to_owned(),
    };
    let text = |value: Option<f64>, unit: &str| match value {
        Some(value) => of(value, unit),
        None => "-".to_owned(),
    };
    let drac = match scale.city_from_lab(safety.max_drac_mps2) {
        // Where they touch no braking would have been enough.
        drac if drac.is_infinite() => "infinite: they touched".to_owned(),
        drac if drac > 0.0 => of(drac, "m/s\u{b2}"),
        _ => "none so far".to_owned(),
    };
    let mean_speed = measures.mean_speed_now_mps();
    let mean_speed = mean_speed.map(|mps| units.number(mps, scale, decimal));
    let cells = [
        (
            "Mean speed now",
            mean_speed.map_or_else(|| "-".to_owned(), |speed| format!("{speed} {}", units.label())),
            "Of the vehicles on their way. That of the whole run is on the card at its end",
        ),
        (
            "Least time to collision",
            ttc,
            "Gap over closing speed to the vehicle ahead, both on their routes: who was driven off its own counts as soon as it touches another. 0 s once two vehicles have touched, from whatever side",
        ),
        (
            "Least gap",
            text(safety.min_gap_m.map(|m| scale.city_from_lab(m)), "m"),
            "Bumper to bumper on one path, both on their routes: who was driven off its own counts as soon as it touches another. 0 m or less once two vehicles have touched, from whatever side",
        ),
        (
            "Least post-encroachment",
            // It may be slightly below 0, which means something else.
            safety.min_pet_s.map_or_else(|| "-".to_owned(), |pet_s| format!("{} s", decimal.fixed(pet_s, 2))),
            "From the exit of one vehicle out of a conflict zone to the entry of the next from the other side; negative \
             where both were inside",
        ),
        (
            "Most braking needed",
            drac,
            "DRAC: the least deceleration that would have avoided a crash with the vehicle ahead; \"none so far\" while nobody has come nearer to another, \"infinite\" where none would have been enough",
        ),
        (
            "Fuel, none while braking",
            of(effort.fuel_ml, "ml"),
            "All vehicles together, by the polynomial of Kamal et al.: who brakes burns nothing",
        ),
        (
            "Fuel, also while braking",
            of(effort.fuel_with_cruise_ml, "ml"),
            "The same, but who brakes burns what the speed alone needs (the cruise term)",
        ),
        (
            "Squared acceleration",
            of(effort.int_u2_m2ps3, "m\u{b2}/s\u{b3}"),
            "Integral over time of all vehicles; half of it is the cost of optimal control",
        ),
        (
            "Encounters",
            format!("{} + {}", safety.ttc_encounters, safety.pet_encounters),
            "Time to collision below 3 s + post-encroachment time below 2 s",
        ),
    ];
    Grid::new("safety and energy").spacing([8.0, 3.0]).show(ui, |ui| {
        for pair in cells.chunks(if is_narrow(ui) { 1 } else { 2 }) {
            for (name, value, tip) in pair {
                ui.label(*name).on_hover_text(*tip);
                ui.monospace(value).on_hover_text(*tip);
            }
            ui.end_row();
        }
    });
}
