//! The toolbar: controls of the run, clock, scenario, camera and quality.

use super::runs::RunAgain;
use super::timeline::TimelineView;
use super::viewpoint::CameraMode;
use super::{
    CityKind, DecimalSeparator, EditAction, Look, QualityPreset, ScenarioChoice, UiAction, UiState,
    ViewModel, commands, theme,
};
use city3d_sensors::Weather;
use city3d_session::{Order, RunPhase, Speed};
use egui::{Button, ComboBox, Response, RichText, Ui};
use std::path::Path;

/// The selectable speeds.
pub const SPEEDS: [f64; 8] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0];

/// Shows the toolbar; adds what its controls request to `actions`.
pub fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    ui.horizontal_wrapped(|ui| {
        // One row at the width of 1280 points, whatever its menus say.
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.spacing_mut().button_padding.x = 3.0;
        if let Some(replay) = &shown.replay {
            group(ui, "replay", |ui| replayed(ui, state, (shown, replay.name), actions));
        } else {
            group(ui, "run", |ui| {
                let has_just_ended = state.has_just_ended(ui.input(|input| input.time));
                let has_card = state.runs.end_card.is_open();
                run_controls(ui, shown, (has_just_ended, has_card), actions);
                if shown.city == CityKind::Local {
                    speed(ui, shown.run_state.speed, actions);
                }
                if clock(ui, shown) {
                    run(&commands::RESULT, ui, state, shown, actions);
                }
            });
            group(ui, "city", |ui| match &shown.run_state.link {
                Some(link) => super::link::show(ui, link, shown),
                None => {
                    scenario(ui, state, shown, actions);
                    edit_button(ui, state, shown, actions);
                }
            });
        }
        group(ui, "cameras", |ui| cameras(ui, state, shown));
        group(ui, "look", |ui| {
            look(ui, state, actions);
            loading(ui, shown);
        });
        group(ui, "panels", |ui| panels(ui, state, shown, actions));
    });
}

/// What stands in place of the run's controls in a replay.
fn replayed(
    ui: &mut Ui,
    state: &mut UiState,
    (shown, name): (&ViewModel<'_>, &str),
    actions: &mut Vec<UiAction>,
) {
    let tip = format!("The recorded run of {}, {}; nothing is simulated", shown.scenario, shown.conditions);
    ui.label(RichText::new(format!("Replay of {name}")).strong()).on_hover_text(tip);
    open_button(ui, state);
    let again = ui.add_enabled(shown.runs.may_run_again, egui::Button::new("Run again"));
    let again = again.on_hover_text("Simulate its scenario again, with the same seed");
    let unknown = "Its scenario is no shipped one, and no recent file has it as it was then";
    if again.on_disabled_hover_text(unknown).clicked() {
        actions.push(UiAction::RunAgain(RunAgain::default()));
    }
    if ui.button("Compare").on_hover_text("Its measures beside those of another recorded run").clicked() {
        state.runs.comparison.choose();
    }
}

fn open_button(ui: &mut Ui, state: &mut UiState) {
    let tip =
        commands::OPEN.tip(ui.ctx(), "Start page: scenarios, recent files, recorded runs; or a file at once");
    if ui.button("Open").on_hover_text(tip).clicked() {
        state.runs.start_page.open();
    }
}

/// Width of the sign of work.
const WORK: f32 = 16.0;

/// The sign that a picture or a scenario is being prepared: it has its place also while there is none.
fn loading(ui: &mut Ui, shown: &ViewModel<'_>) {
    cell(ui, WORK, |ui| {
        if let Some(what) = shown.loading {
            let tip = format!("{what} The picture stays as it is until then.");
            ui.add(egui::Spinner::new().size(WORK - 2.0)).on_hover_text(tip);
        }
    });
}

/// A place of fixed width, so that its neighbours do not move.
pub(super) fn cell(ui: &mut Ui, width: f32, content: impl FnOnce(&mut Ui)) {
    let size = egui::vec2(width, ui.spacing().interact_size.y);
    ui.allocate_ui_with_layout(size, egui::Layout::left_to_right(egui::Align::Center), |ui| {
        ui.set_min_width(width);
        content(ui);
    });
}

/// Controls that stay together, with a line before them: where they do not fit, they begin a row, without the line.
fn group(ui: &mut Ui, name: &'static str, add: impl FnOnce(&mut Ui)) {
    together(ui, name, true, add);
}

/// Controls that stay together: where they do not fit, they begin a row.
pub(super) fn together(ui: &mut Ui, name: &'static str, has_line: bool, add: impl FnOnce(&mut Ui)) {
    /// Width of the line between two groups, with its spacing, points.
    const LINE: f32 = 13.0;
    let id = ui.scope_id().with(name);
    let width: f32 = ui.data(|data| data.get_temp(id)).unwrap_or(0.0);
    if ui.cursor().left() > ui.max_rect().left() + 1.0 {
        if width + LINE > ui.available_size_before_wrap().x {
            ui.end_row();
        } else if has_line {
            ui.separator();
        }
    }
    let width = ui.horizontal(add).response.rect.width();
    ui.data_mut(|data| data.insert_temp(id, width));
}

/// Widths of a run button and of the real-time factor, points.
const BUTTON: f32 = 84.0;
const PACE: f32 = 54.0;
/// Width of the duration beside the clock.
const DURATION: f32 = 50.0;
/// Width of the list of scenarios, so that its neighbours do not move: a longer name is cut, and stands in the tip.
const SCENARIO: f32 = 93.0;

fn run_controls(
    ui: &mut Ui,
    shown: &ViewModel<'_>,
    (has_just_ended, has_card): (bool, bool),
    actions: &mut Vec<UiAction>,
) {
    if shown.edit.is_some() {
        return edited_run_controls(ui, shown, actions);
    }
    let phase = &shown.run_state.phase;
    let keys = commands::key_map::of(ui.ctx());
    let can_run = !matches!(phase, RunPhase::Failed(_));
    let mut button = |ui: &mut Ui, text: &str, enabled: bool, tip: &str, order: Order| {
        // Fixed width, so that its neighbours do not move.
        let least = if order == Order::Start || order == Order::Pause { BUTTON } else { 0.0 };
        let button = Button::new(text).min_size(egui::vec2(least, 0.0));
        if ui.add_enabled(enabled, button).on_hover_text(tip).on_disabled_hover_text(tip).clicked() {
            actions.push(UiAction::Order(order));
        }
    };
    if *phase == RunPhase::Running {
        button(
            ui,
            "\u{23f8} Pause",
            true,
            &keys.tip("Pause the run", &commands::START_OR_PAUSE),
            Order::Pause,
        );
    } else if *phase == RunPhase::Over {
        let duration = theme::decimal(ui.ctx()).plain(shown.duration_s);
        let tip = format!("Continue beyond the {duration} s of the scenario, until paused");
        // While the card is open, the key continues nothing.
        let tip = if has_card { tip } else { keys.tip(&tip, &commands::START_OR_PAUSE) };
        // It takes the place of Pause.
        let may = !shown.run_state.has_ended && !has_just_ended;
        button(ui, "\u{25b6} Continue", may, &tip, Order::Start);
    } else if *phase == RunPhase::Paused && shown.has_begun() {
        let tip = keys.tip("Continue the run", &commands::START_OR_PAUSE);
        button(ui, "\u{25b6} Continue", true, &tip, Order::Start);
    } else {
        let tip = keys.tip("Start the run", &commands::START_OR_PAUSE);
        button(ui, "\u{25b6} Start", can_run, &tip, Order::Start);
    }
    if shown.city == CityKind::Local {
        let tip = match shown.past.is_shown {
            true => keys.tip("The past is shown: go back to the present first", &commands::TO_END),
            false => keys.tip("One step (usually 10 ms), then pause", &commands::STEP),
        };
        button(ui, "\u{23ed} Step", can_run && !shown.past.is_shown, &tip, Order::Step);
    }
    let tip = match shown.city {
        CityKind::Local if shown.run_state.phase == RunPhase::Over => {
            "Back to the start. The log is kept; a new one begins"
        }
        CityKind::Local => "Back to the start, after a question. The log so far is kept; a new one begins",
        CityKind::Served => "Back to the start with the same vehicles; a new log begins",
        CityKind::Elsewhere => "Asks the city to go back to its start",
    };
    button(ui, "\u{27f2} Reset", true, &keys.tip(tip, &commands::RESET), Order::Reset);
}

/// In place of the controls of the run: what is edited is saved and run.
fn edited_run_controls(ui: &mut Ui, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let may_run = shown.edit.is_some_and(|edit| edit.problems.is_empty() && !edit.is_checking);
    let start = Button::new("\u{25b6} Save, run").min_size(egui::vec2(BUTTON, 0.0));
    let keys = commands::key_map::of(ui.ctx());
    let tip = keys.tip("Save the scenario and run it", commands::EDITING.run);
    let start = ui.add_enabled(may_run, start).on_hover_text(tip);
    if start.on_disabled_hover_text("The scenario has problems: see the editor").clicked() {
        actions.push(UiAction::Edit(EditAction::Run));
    }
    let waits = keys.tip("The run waits while its scenario is edited: go back to it first", &commands::EDIT);
    for text in ["\u{23ed} Step", "\u{27f2} Reset"] {
        ui.add_enabled(false, Button::new(text)).on_disabled_hover_text(&waits);
    }
}

fn speed(ui: &mut Ui, present: Speed, actions: &mut Vec<UiAction>) {
    let mut chosen = present;
    let decimal = theme::decimal(ui.ctx());
    ComboBox::from_id_salt("speed")
        .selected_text(if present == Speed::Unlimited {
            "max".to_owned()
        } else {
            speed_label(present, decimal)
        })
        .width(58.0)
        // All of them, without a bar.
        .height(300.0)
        .show_ui(ui, |ui| {
            for factor in SPEEDS {
                ui.selectable_value(
                    &mut chosen,
                    Speed::Times(factor),
                    speed_label(Speed::Times(factor), decimal),
                );
            }
            ui.selectable_value(&mut chosen, Speed::Unlimited, speed_label(Speed::Unlimited, decimal));
        })
        .response
        .on_hover_text(format!(
            "Simulated seconds per second ({} and {})",
            commands::FASTER.key(ui.ctx()),
            commands::SLOWER.key(ui.ctx())
        ));
    if chosen != present {
        actions.push(UiAction::Order(Order::Speed(chosen)));
    }
}

/// A speed in words.
pub fn speed_label(speed: Speed, decimal: DecimalSeparator) -> String {
    match speed {
        Speed::Times(factor) => format!("{}x", decimal.plain(factor)),
        Speed::Unlimited => "as fast as possible".to_owned(),
    }
}

/// The next speed up or down the list, or the present one at its end.
pub fn other_speed(present: Speed, faster: bool) -> Speed {
    let Speed::Times(factor) = present else {
        return if faster { present } else { Speed::Times(SPEEDS[SPEEDS.len() - 1]) };
    };
    let next = if faster {
        SPEEDS.iter().find(|speed| **speed > factor * 1.001)
    } else {
        SPEEDS.iter().rev().find(|speed| **speed < factor * 0.999)
    };
    match next {
        Some(speed) => Speed::Times(*speed),
        None if faster => Speed::Unlimited,
        None => present,
    }
}

/// Shows time and phase; returns whether the result of the finished run is asked for.
fn clock(ui: &mut Ui, shown: &ViewModel<'_>) -> bool {
    let run_state = shown.run_state;
    // The bar belongs to the run, also while its past is shown.
    let is_past = shown.past.is_shown;
    let time_s = if is_past { shown.past.head.to_s } else { run_state.now.time_s };
    let duration_s = shown.duration_s;
    // Room for runs of hours, so that its neighbours do not move.
    let decimal = theme::decimal(ui.ctx());
    let text = format!("{:>7} s", decimal.fixed(time_s, 2));
    let lasts = decimal.plain(duration_s);
    let tip = match is_past {
        true => format!("The present of the run; the scenario lasts {lasts} s"),
        false => format!("Simulated time, step {}; the scenario lasts {lasts} s", run_state.now.tick),
    };
    ui.label(RichText::new(text).monospace().strong()).on_hover_text(&tip);
    if shown.city == CityKind::Local {
        // Beyond its end the run has no duration that it is part of.
        let is_beyond = time_s > duration_s + 1e-6;
        let text = if is_beyond { format!("past {lasts} s") } else { format!("of {lasts} s") };
        cell(ui, DURATION, |ui| _ = ui.label(RichText::new(text).small()).on_hover_text(tip));
    }
    let (text, tip) = match &run_state.phase {
        RunPhase::Running => (
            format!("at {}x", decimal.written(factor(run_state.real_time_factor))),
            "Real-time factor: simulated seconds per second, as measured",
        ),
        RunPhase::Over => (
            "finished".to_owned(),
            "The scenario's duration is over: Continue goes beyond it, Reset starts again",
        ),
        RunPhase::Failed(reason) => (format!("failed: {reason}"), "Reset starts again"),
        RunPhase::Paused if shown.has_begun() => {
            (run_state.phase.label().to_owned(), "Continue goes on with it")
        }
        phase => (phase.label().to_owned(), "Start runs it"),
    };
    let mut text = RichText::new(text);
    if matches!(run_state.phase, RunPhase::Over | RunPhase::Failed(_)) {
        text = text.strong().color(ui.visuals().warn_fg_color);
    }
    let mut label = egui::Label::new(text).extend().selectable(false);
    let has_result = run_state.phase == RunPhase::Over && shown.city == CityKind::Local;
    let tip = match has_result {
        true => {
            label = label.sense(egui::Sense::click());
            format!("{tip}. Click to see the result")
        }
        false => tip.to_owned(),
    };
    let mut is_asked = false;
    cell(ui, PACE, |ui| is_asked = ui.add(label).on_hover_text(tip).clicked());
    is_asked && has_result
}

/// With as many digits as can be read while it changes.
fn factor(factor: f64) -> String {
    let digits = if factor < 9.995 { 2 } else { usize::from(factor < 99.95) };
    format!("{factor:.digits$}")
}

fn scenario(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    open_button(ui, state);
    // A whole path would leave no room for the rest.
    let short = |name: &str| -> String {
        let stem = Path::new(name).file_stem();
        stem.map_or_else(|| name.to_owned(), |stem| stem.to_string_lossy().into_owned())
    };
    // Which file is edited may have changed since its scenario was opened.
    let present = shown.edit.map_or(shown.scenario, |edit| edit.name);
    // All of it at once, where the window is high enough.
    let height = (ui.ctx().content_rect().height() - 120.0).max(120.0);
    let picker = ComboBox::from_id_salt("scenario").selected_text(short(present)).width(SCENARIO).truncate();
    let picker = picker.height(height);
    let choices = |ui: &mut Ui| {
        for ScenarioChoice { name, description } in shown.scenarios {
            let mut chosen = ui.selectable_label(name == present, short(name));
            if short(name) != *name {
                chosen = chosen.on_hover_text(name);
            }
            if !description.is_empty() {
                chosen = chosen.on_hover_text(description);
            }
            if chosen.clicked() && name != present {
                actions.push(UiAction::Scenario(name.clone()));
            }
        }
    };
    let choice = shown.scenarios.iter().find(|choice| choice.name == present);
    let about = choice.map(|choice| choice.description.as_str()).filter(|about| !about.is_empty());
    let tip = about.map_or_else(String::new, |about| format!("{about}.\n"));
    let tip = match shown.edit {
        Some(_) => format!("{tip}The scenario {present} is edited; another one starts from its beginning"),
        None => format!(
            "{tip}The scenario {present}, {}; another one starts from its beginning",
            shown.conditions
        ),
    };
    cell(ui, SCENARIO, |ui| _ = picker.show_ui(ui, choices).response.on_hover_text(tip));
}

/// Opens and leaves the editor.
fn edit_button(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let button = Button::selectable(shown.edit.is_some(), "Edit");
    let button = command_button(ui, &commands::EDIT, button, (state, shown));
    let tip = "Change the scenario: vehicles, routes, obstacles; the run waits meanwhile";
    if button.on_hover_text(commands::EDIT.tip(ui.ctx(), tip)).clicked() {
        run(&commands::EDIT, ui, state, shown, actions);
    }
}

fn cameras(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    let now_s = ui.input(|input| input.time);
    for (mode, command) in CameraMode::ALL.into_iter().zip(commands::CAMERA_MODES) {
        let tip = command.tip(ui.ctx(), camera_tip(mode));
        let is_on = state.viewpoint.mode == mode;
        if ui.selectable_label(is_on, mode.label()).on_hover_text(tip).clicked() {
            state.look_by(mode, (shown.interpolated, now_s));
        }
    }
}

/// Switches of panels; the menu has all of them with their keys.
fn panels(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let open = &mut state.open;
    ui.toggle_value(&mut open.layers, "Layers").on_hover_text("Labels, lanes, routes, conflict zones, map");
    let mut chosen: Option<&commands::Command> = None;
    let has_cameras = open.cameras && !state.previews.is_empty();
    let cameras = ui.selectable_label(has_cameras, "Cameras");
    if cameras
        .on_hover_text(commands::CAMERAS.tip(ui.ctx(), "What cameras of vehicles see, pedals and plots"))
        .clicked()
    {
        chosen = Some(&commands::CAMERAS);
    }
    let menu = ui.menu_button("Panels", |ui| {
        let mut entries = commands::PANEL_MENU.to_vec();
        entries.extend(commands::VIEW_MENU);
        if shown.replay.is_none() {
            entries.push(&commands::CONTROLLERS);
            entries.push(&commands::EDIT);
        }
        entries.push(&commands::RESULT);
        entries.push(&commands::SETTINGS);
        for command in entries {
            let button = Button::new(command.name).shortcut_text(command.key(ui.ctx()));
            if command_button(ui, command, button, (state, shown)).clicked() {
                chosen = Some(command);
            }
        }
    });
    menu.response.on_hover_text("Show and hide panels");
    ui.toggle_value(&mut state.open.help, "Help").on_hover_text(commands::HELP.tip(ui.ctx(), "All keys"));
    if let Some(command) = chosen {
        run(command, ui, state, shown, actions);
    }
}

/// A button of an action, which says what has to be done first where it is not available.
fn command_button(
    ui: &mut Ui,
    command: &commands::Command,
    button: Button<'_>,
    (state, shown): (&UiState, &ViewModel<'_>),
) -> Response {
    let availability = command.availability(state, shown);
    let button = ui.add_enabled(availability == commands::Availability::Now, button);
    match availability {
        commands::Availability::After(hint) => button.on_disabled_hover_text(hint.words(&state.keys)),
        _ => button,
    }
}

/// Runs an action that a control of the bar stands for.
fn run(
    command: &commands::Command,
    ui: &Ui,
    state: &mut UiState,
    shown: &ViewModel<'_>,
    actions: &mut Vec<UiAction>,
) {
    let now_s = ui.input(|input| input.time);
    let mut timeline = TimelineView::of(shown);
    command.run(&mut commands::CommandContext { state, shown, actions, timeline: &mut timeline, now_s });
}

fn camera_tip(mode: CameraMode) -> &'static str {
    match mode {
        CameraMode::Orbit => {
            "Around a point or the followed vehicle: drag to turn, right-drag to move, scroll to zoom"
        }
        CameraMode::Chase => "Behind the selected vehicle; without one, the nearest",
        CameraMode::Onboard => {
            "From behind the windscreen of the selected vehicle; without one, of the nearest"
        }
        CameraMode::Overhead => "Straight down",
        CameraMode::Free => {
            "Fly with the keys of the camera (W A S D, Q and E unless the settings say otherwise); drag to look around"
        }
    }
}

/// Height of the open list of the light: all of it.
const MENU_HEIGHT: f32 = 420.0;
/// Widths of the lists of qualities and of times of day: for the longest of their words.
const QUALITY: f32 = 70.0;
const TIME: f32 = 76.0;

fn look(ui: &mut Ui, state: &mut UiState, actions: &mut Vec<UiAction>) {
    let before = state.look;
    ComboBox::from_id_salt("quality")
        .selected_text(state.look.preset.label())
        .width(QUALITY)
        .truncate()
        .show_ui(ui, |ui| {
            for preset in QualityPreset::ALL {
                ui.selectable_value(&mut state.look.preset, preset, preset.label());
            }
        })
        .response
        .on_hover_text("Quality of the pictures: low for machines without a GPU");
    // One row at the width of 1280 points: a long text is small, cut where need be, and stands in the tip.
    let words = RichText::new(state.look.weather_first());
    let words = if state.look.weather == Weather::Clear { words } else { words.small() };
    let tip = format!("Time of day and weather: {}", state.look.light());
    let list = ComboBox::from_id_salt("time")
        .selected_text(words)
        .width(TIME)
        .truncate()
        // All of it at once: a list that ends with the slider hides the weather.
        .height(MENU_HEIGHT);
    let choices = |ui: &mut Ui| {
        for (hours, label) in TIMES {
            ui.selectable_value(&mut state.look.hours, hours, label);
        }
        any_time(ui, state);
        ui.separator();
        for weather in Weather::ALL {
            ui.selectable_value(&mut state.look.weather, weather, weather.name());
        }
    };
    cell(ui, TIME, |ui| _ = list.show_ui(ui, choices).response.on_hover_text(tip));
    if state.look != before {
        actions.push(UiAction::Look(state.look));
    }
}

/// Any other time of day. It counts once the slider is let go: pictures in another light are built anew.
fn any_time(ui: &mut Ui, state: &mut UiState) {
    let id = ui.scope_id().with("any time");
    let mut hours = ui.data(|data| data.get_temp::<f64>(id)).unwrap_or(state.look.hours);
    let slider = egui::Slider::new(&mut hours, 0.0..=LAST_HOUR).step_by(0.25).show_value(false);
    let slider = ui.add(slider).on_hover_text("Any time of day");
    ui.label(time_label(hours));
    if slider.dragged() {
        ui.data_mut(|data| data.insert_temp(id, hours));
    } else {
        ui.data_mut(|data| data.remove::<f64>(id));
        state.look.hours = hours;
    }
}

/// The last time of day of the slider.
const LAST_HOUR: f64 = 23.75;

pub(super) const TIMES: [(f64, &str); 5] =
    [(8.0, "morning"), (12.0, "noon"), (16.5, "low sun"), (17.6, "dusk"), (22.0, "night")];

pub(super) fn time_label(hours: f64) -> String {
    let named = TIMES.iter().find(|(time, _)| (time - hours).abs() < 1e-6);
    let minutes = (hours * 60.0).round() as u32;
    named.map_or_else(|| format!("{:02}:{:02}", minutes / 60, minutes % 60), |(_, label)| (*label).to_owned())
}

impl Look {
    /// In words.
    pub fn label(&self) -> String {
        format!("{}, {}", self.preset.label(), self.light())
    }

    /// Takes over time of day and weather of another look.
    pub fn show_light_of(&mut self, other: Self) {
        (self.hours, self.weather) = (other.hours, other.weather);
    }

    /// The weather unless it is clear, and the time of day: of what has no room the former says more.
    fn weather_first(&self) -> String {
        let time = time_label(self.hours);
        if self.weather == Weather::Clear { time } else { format!("{}, {time}", self.weather.name()) }
    }

    /// Time of day, and the weather unless it is clear.
    fn light(&self) -> String {
        let time = time_label(self.hours);
        if self.weather == Weather::Clear { time } else { format!("{time}, {}", self.weather.name()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_go_up_and_down_the_list_to_its_ends() {
        assert_eq!(other_speed(Speed::Times(1.0), true), Speed::Times(2.0));
        assert_eq!(other_speed(Speed::Times(3.0), false), Speed::Times(2.0));
        assert_eq!(other_speed(Speed::Times(0.1), false), Speed::Times(0.1));
        assert_eq!(other_speed(Speed::Times(20.0), true), Speed::Unlimited);
        assert_eq!(other_speed(Speed::Unlimited, false), Speed::Times(20.0));
    }

    #[test]
    fn factors_of_all_sizes_take_about_the_same_room() {
        let told = [0.984, 9.99, 12.345, 451.2].map(factor);
        assert_eq!(told, ["0.98", "9.99", "12.3", "451"]);
    }

    #[test]
    fn times_of_day_have_names_or_the_hour() {
        assert_eq!((time_label(22.0), time_label(17.5)), ("night".to_owned(), "17:30".to_owned()));
    }
}
