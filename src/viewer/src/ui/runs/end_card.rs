//! The card of a finished run, or of a recorded one: what came of it, and what to do next.

use super::super::{CityKind, DecimalSeparator, Layout, UiAction, UiState, ViewModel};
use super::super::{layout, theme, traffic};
use super::RunAgain;
use super::fields::{environment, seed};
use city3d_logbook::figures::some_names;
use city3d_logbook::measures::RunMeasures;
use city3d_protocol::snapshot::{Status, VehicleInfo, VehicleState};
use city3d_session::{Order, RunPhase};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::measures::TrafficMeasures;
use egui::{Align2, Grid, Rect, RichText, TextEdit, Ui, Vec2};
use std::path::Path;
use std::time::Duration;

/// In place of measures that a run does not have.
const NO_THROUGHPUT: &str = "none: fewer than two arrivals";
const NO_DELAY: &str = "none: no vehicle has a known way";
/// Of a run in which nothing is drawn at random.
const SEED_IS_UNUSED: &str =
    "Nothing is random in this scenario: the seed matters in the testbed environment alone.";
/// For so many frames it is put to its place: at first it is wider than it will be, and egui would move it.
const PLACING_FRAMES: u8 = 6;
/// Height of its title and edges, points: in a low window the rest scrolls.
const AROUND: f32 = 60.0;
/// It looks so often whether the mouse rests.
const WAITS: Duration = Duration::from_millis(250);
/// Id of its window.
const WINDOW: &str = "card of a run";
/// Of what it holds, points: as wide as the column of the table.
const WIDTH: f32 = 350.0;
/// About its size, points.
const SIZE: Vec2 = Vec2::new(366.0, 450.0);
/// Vehicles that drive less have not moved.
const MOVES_M: f64 = 0.1;

/// State of the card.
#[derive(Clone, Debug, Default)]
pub struct EndCard {
    /// The run whose card was closed.
    closed: Option<u32>,
    /// The run whose card the user has asked for.
    asked: Option<u32>,
    /// The run whose card is shown.
    shown: Option<u32>,
    /// The run whose card is put to its place, and for how many frames.
    placed: Option<(u32, u8)>,
    /// The seed of the next run as it is typed, and the run after which it is.
    seed: (String, Option<u32>),
    /// Environment of the next run; `None` for that of this one.
    environment: Option<EnvironmentProfile>,
}

impl EndCard {
    /// Whether it is shown.
    pub fn is_open(&self) -> bool {
        self.shown.is_some()
    }

    /// Opens the card of a run again, also where it goes on beyond its end.
    pub fn open(&mut self, run: u32) {
        (self.asked, self.closed) = (Some(run), None);
    }

    /// Closes it, until another run is finished.
    pub fn close(&mut self) {
        self.asked = None;
        self.closed = self.shown.take().or(self.closed);
        self.placed = None;
    }
}

/// Shows the card once the scenario's duration is over, and when it is asked for; that of a recorded run when it is asked for.
pub(super) fn window(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let run_state = shown.run_state;
    let is_over = run_state.phase == RunPhase::Over;
    let is_asked = state.runs.end_card.asked == Some(run_state.run);
    let is_live = shown.replay.is_none();
    let is_finished = ((is_over && is_live) || is_asked) && shown.city == CityKind::Local;
    // Who looks back at a collision, or compares, has the view for it; the card comes back with the present.
    let gives_way = shown.past.is_shown || state.runs.comparison.is_open();
    let card = &mut state.runs.end_card;
    card.shown = None;
    if !is_finished || gives_way || card.closed == Some(run_state.run) {
        return;
    }
    let Some(measures) = measures(shown) else { return };
    card.shown = Some(run_state.run);
    if card.seed.1 != Some(run_state.run) {
        card.seed = (measures.seed.wrapping_add(1).to_string(), Some(run_state.run));
        card.environment = None;
    }
    let shown_rect = ui.ctx().memory(|memory| memory.area_rect(egui::Id::unique(WINDOW)));
    if shown_rect.is_some_and(|rect| state.layout.opens_beneath(rect)) {
        card.placed = None;
    }
    let frames = card.placed.filter(|(run, _)| *run == run_state.run).map_or(0, |(_, frames)| frames);
    card.placed = Some((run_state.run, (frames + 1).min(PLACING_FRAMES)));
    // As large as it has turned out: some lines are there in some runs alone.
    let size = shown_rect.map(|rect| rect.size()).filter(|_| frames > 2).unwrap_or(SIZE);
    let place = (frames < PLACING_FRAMES).then(|| Layout::place_beside(ui, size, (&*state, shown)));
    let opens = place.filter(|_| frames == 0 && !is_asked);
    // It waits until the mouse rests in what it would cover: a click was meant for something else.
    if opens.is_some_and(|place| state.layout.is_in_the_way(ui, Rect::from_min_size(place, size))) {
        ui.ctx().request_repaint_after(WAITS);
        (state.runs.end_card.shown, state.runs.end_card.placed) = (None, None);
        return;
    }
    let card = &mut state.runs.end_card;
    let units = state.preferences.units;
    let decimal = state.preferences.decimal;
    let mean_speed = units.number(measures.mean_speed_mps, shown.scale(), decimal);
    let mean_speed = format!("{mean_speed} {}", units.label());
    let mut is_open = true;
    let mut compares = false;
    let title = if is_live { "Run finished" } else { "Recorded run" };
    // Folded to its title it is out of the way.
    let window = super::super::sheet(ui, title).id(egui::Id::unique(WINDOW));
    let window = window.pivot(Align2::LEFT_TOP).collapsible(true).default_width(WIDTH).open(&mut is_open);
    // A higher one would be moved up into the window before it shrinks to what it holds.
    // Where it hides nothing at first; the user may move it.
    let window = if let Some(place) = place { layout::moved_to(window, place) } else { window };
    window.show(ui.ctx(), |ui| {
        ui.set_max_width(WIDTH);
        let room = ui.ctx().content_rect().height() - AROUND;
        egui::ScrollArea::vertical().id_salt(run_state.run).max_height(room).show(ui, |ui| {
        ui.label(format!(
            "{}, {}: {} s simulated",
            measures.scenario,
            measures.conditions(),
            decimal.fixed(measures.simulated_s, 1)
        ));
        let now_s = run_state.now.time_s;
        if is_live && now_s > measures.simulated_s + 0.05 {
            let now = decimal.fixed(now_s, 1);
            ui.label(format!("The run has gone on to {now} s: this is its result at the end of the scenario."));
        }
        let by_hand = measures.driven_by_hand();
        if !by_hand.is_empty() {
            let off = "Off their routes they count for neither slow stops nor delay";
            ui.label(format!("Driven by hand: {}", some_names(&by_hand))).on_hover_text(off);
        }
        ui.add_space(4.0);
        // Beyond the end the numbers of the zones are no longer those of the result.
        let zones = (is_over && is_live).then(|| shown.traffic.measures());
        results(ui, &measures, (&mean_speed, decimal), zones);
        let lies = |vehicle: &&VehicleState| {
            let is_physical = run_state.now.info(vehicle.id).is_some_and(VehicleInfo::is_physical);
            vehicle.status == Status::Collided && !is_physical
        };
        if is_live && run_state.now.vehicles.iter().any(|vehicle| lies(&vehicle)) {
            ui.label("Vehicles that have collided stay where they are until a person drives them off; a new run puts all of them back.");
        }
        ui.add_space(4.0);
        log(ui, shown);
        ui.separator();
        ui.horizontal(|ui| {
            let replay = egui::Button::new("Replay");
            let tip = "Play the run from its log: the run ends here";
            if is_live && ui.add_enabled(run_state.folder.is_some(), replay).on_hover_text(tip).clicked() {
                actions.push(UiAction::Replay);
            }
            compares =
                ui.button("Compare with ...").on_hover_text("Another recorded run, side by side").clicked();
            let tip = format!(
                "Simulate beyond the {} s of the scenario, until paused",
                decimal.plain(shown.duration_s)
            );
            if is_live
                && is_over
                && !run_state.has_ended
                && ui.button("Continue").on_hover_text(tip).clicked()
            {
                actions.push(UiAction::Order(Order::Start));
            }
        });
        if shown.runs.may_run_again {
            run_again(ui, card, shown, actions);
        }
        });
    });
    if !is_open {
        card.close();
    }
    if compares {
        state.runs.comparison.choose();
    }
}

/// Measures of the finished run, or of the recorded one on display.
fn measures(shown: &ViewModel<'_>) -> Option<RunMeasures> {
    match shown.replay {
        Some(_) => shown.runs.recorded.cloned(),
        None => shown.run_state.outcome.as_deref().map(RunMeasures::of),
    }
}

/// How often vehicles stood, as the events count it.
const STANDSTILLS: &str = "Standstills (< 0.1 m/s)";
/// Where some have collided: slow stops do not count those.
const STANDSTILLS_OF_ALL: &str = "Standstills, wrecks too";

/// What happened in all control zones together.
const IN_ZONES: &str = "In control zones";

/// How long a vehicle stood at most.
const LONGEST_STAND: &str = "Longest stand";

/// What a measure is, in the words of the panel Traffic.
fn tip_of(name: &str) -> Option<&'static str> {
    match name {
        traffic::SLOW_STOPS => Some(traffic::STOPS),
        STANDSTILLS | STANDSTILLS_OF_ALL => Some(
            "How often vehicles stood before the end of their routes, or off these: the events \"standstill\" but \
                 for that of an arrival. Also before the warm-up is over, and anew after creeping on, which slow stops do not count: \
                 so there may be more of these",
        ),
        "Mean speed" => Some(traffic::MEAN_SPEED),
        LONGEST_STAND => Some(traffic::LONGEST_STAND),
        "Throughput" => Some(traffic::FLOW),
        "Mean delay" => Some(traffic::DELAY),
        IN_ZONES => Some("Of complete passages, from the entry lines to behind the last conflicts"),
        _ => None,
    }
}

fn results(
    ui: &mut Ui,
    measures: &RunMeasures,
    (mean_speed, decimal): (&str, DecimalSeparator),
    traffic: Option<&TrafficMeasures>,
) {
    // What never moves is an obstacle.
    let drivers =
        measures.vehicles.values().filter(|vehicle| vehicle.distance_m > MOVES_M && !vehicle.is_obstacle);
    let bad = theme::on_panel(ui.ctx(), Status::Collided);
    let longest = drivers.max_by(|a, b| a.longest_stand_s.total_cmp(&b.longest_stand_s));
    Grid::new("results").num_columns(2).spacing([18.0, 3.0]).show(ui, |ui| {
        let mut row = |name: &str, value: String, is_bad: bool| {
            let label = ui.label(name);
            let value = RichText::new(value).strong();
            let value = ui.label(if is_bad { value.color(bad) } else { value });
            if let Some(tip) = tip_of(name) {
                label.on_hover_text(tip);
                value.on_hover_text(tip);
            }
            ui.end_row();
        };
        row("Collisions", measures.collisions.to_string(), measures.collisions > 0);
        row(traffic::SLOW_STOPS, measures.stops().to_string(), false);
        let standstills = measures.standstills().map_or_else(|| "-".to_owned(), |count| count.to_string());
        let name = if measures.collisions > 0 { STANDSTILLS_OF_ALL } else { STANDSTILLS };
        row(name, standstills, false);
        row("Mean speed", mean_speed.to_owned(), false);
        let number = |value: Option<f64>, digits: usize, unit: &str| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{} {unit}", decimal.fixed(value, digits)))
        };
        let throughput = match measures.traffic.throughput_per_h {
            None => NO_THROUGHPUT.to_owned(),
            of_trips => number(of_trips, 0, "vehicles/h"),
        };
        row("Throughput", throughput, false);
        let delay = match measures.traffic.mean_delay_s {
            None => NO_DELAY.to_owned(),
            of_trips => number(of_trips, 1, "s"),
        };
        row("Mean delay", delay, false);
        if let Some(vehicle) = longest.filter(|vehicle| vehicle.longest_stand_s >= 0.1) {
            row(
                LONGEST_STAND,
                format!("{} s, {}", decimal.fixed(vehicle.longest_stand_s, 1), vehicle.name),
                false,
            );
        }
        let Some(traffic) = traffic else { return };
        // Whole trips may end in a queue: what coordination does is in its zones.
        let zones: Vec<_> = traffic.zones().filter_map(|(zone, _)| traffic.zone_totals(&zone.name)).collect();
        if !zones.is_empty() {
            let passages: u32 = zones.iter().map(|of| of.count).sum();
            let delay_s: f64 =
                zones.iter().filter_map(|of| Some(of.mean_delay_s? * f64::from(of.count))).sum();
            let delay_s = (passages > 0).then(|| delay_s / f64::from(passages));
            let stops: u32 = zones.iter().map(|of| of.stops).sum();
            row(IN_ZONES, format!("{stops} slow stops, mean delay {}", number(delay_s, 1, "s")), false);
        }
    });
}

/// What is in the folder of a run.
const FOLDER: &str =
    "Log, table and summary; screenshots, videos and charts of the run are written there, too";

fn log(ui: &mut Ui, shown: &ViewModel<'_>) {
    let of_log = shown.replay.and_then(|_| Path::new(shown.scenario).parent());
    let Some(folder) = of_log.or(shown.run_state.folder.as_deref()) else {
        ui.label("The run was not recorded.");
        return;
    };
    let path = folder.display().to_string();
    ui.horizontal(|ui| {
        ui.label("Folder of the run:").on_hover_text(FOLDER);
        if ui.button("Copy path").clicked() {
            ui.ctx().copy_text(path.clone());
        }
    });
    ui.add(egui::Label::new(RichText::new(path).small()).wrap());
}

fn run_again(ui: &mut Ui, card: &mut EndCard, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let found = seed(&card.seed.0);
    ui.horizontal_wrapped(|ui| {
        let tip = "The same scenario from its beginning, with this seed and in this environment. By itself the seed is the next one";
        let name = match &found {
            Ok(seed) => format!("Run again with seed {seed}"),
            Err(_) => "Run again".to_owned(),
        };
        if ui.add_enabled(found.is_ok(), egui::Button::new(name)).on_hover_text(tip).clicked() {
            let again = RunAgain { seed: found.clone().ok(), environment: card.environment };
            actions.push(UiAction::RunAgain(again));
        }
        let label = ui.label("Seed");
        ui.add(TextEdit::singleline(&mut card.seed.0).desired_width(70.0)).labelled_by(label.id);
        environment(ui, &mut card.environment, "as before");
    });
    if !shown.runs.depends_on_seed && card.environment != Some(EnvironmentProfile::Testbed) {
        ui.weak(SEED_IS_UNUSED);
    }
    if let Err(why) = found {
        ui.colored_label(ui.visuals().error_fg_color, why);
    }
}
