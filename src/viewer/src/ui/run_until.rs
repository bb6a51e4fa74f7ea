//! Letting a run go on up to a goal: a number of steps, a time, or an event.

use super::theme::{self, DecimalSeparator};
use super::{CityKind, UiAction, UiState, ViewModel};
use city3d_session::playback::MarkKind;
use city3d_session::{Order, RunGoal, RunPhase};
use egui::Ui;
use egui::containers::menu::MenuButton;

/// What the user has entered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunUntilState {
    /// Number of steps.
    steps: u32,
    /// Simulated time, seconds.
    time_s: f64,
}

impl Default for RunUntilState {
    fn default() -> Self {
        Self { steps: 10, time_s: 10.0 }
    }
}

impl RunUntilState {
    /// The chosen number of steps.
    pub(super) fn steps(&self) -> u32 {
        self.steps
    }
}

/// The goal that lies so many steps ahead of the present.
pub(super) fn after_steps(shown: &ViewModel<'_>, steps: u32) -> RunGoal {
    // In the middle of a step, for times are rounded.
    RunGoal::Time(shown.past.head.to_s + (f64::from(steps) - 0.5) * shown.step_s)
}

/// Events that a run can be run up to.
const EVENTS: [(&str, Option<MarkKind>); 8] = [
    ("collision", Some(MarkKind::Collision)),
    ("standstill of 30 s", Some(MarkKind::LongStop)),
    ("vehicle off the road", Some(MarkKind::LeftRoad)),
    ("lost link", Some(MarkKind::Link)),
    ("yield", Some(MarkKind::Yield)),
    ("passing of a merge", Some(MarkKind::Merge)),
    ("standstill", Some(MarkKind::Stop)),
    ("event of any kind", None),
];

/// A goal in words.
fn words(goal: RunGoal, decimal: DecimalSeparator) -> String {
    match goal {
        RunGoal::Time(time_s) => format!("{} s", decimal.fixed(time_s, 2)),
        RunGoal::Event(kind) => {
            let found = EVENTS.iter().find(|(_, event)| *event == kind);
            format!("the next {}", found.map_or("event", |(words, _)| words))
        }
    }
}

/// The button with its menu; while a goal is set, it names it.
pub(super) fn button(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    if matches!(shown.run_state.phase, RunPhase::Failed(_)) || shown.edit.is_some() {
        return;
    }
    let text = match shown.run_state.goal {
        Some(goal) => format!("\u{23ed} Until {}", words(goal, theme::decimal(ui.ctx()))),
        None => "\u{23ed} Until ...".to_owned(),
    };
    let (menu, _) = MenuButton::new(text).config(super::menu_with_fields()).ui(ui, |ui| {
        let goal = menu(ui, state, shown);
        if let Some(goal) = goal {
            actions.push(UiAction::Order(Order::RunUntil(goal)));
            ui.close();
        }
    });
    menu.on_hover_text(
        "Let the run go on for some steps, up to a time, or up to an event, and pause it there",
    );
}

/// Shows the goals; returns the one that was chosen.
fn menu(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>) -> Option<RunGoal> {
    // What is shown may be the past.
    let now_s = shown.past.head.to_s;
    let mut goal = None;
    if shown.city == CityKind::Local {
        ui.horizontal(|ui| {
            let is_chosen = ui.button("Step").on_hover_text("That many steps of the simulation").clicked();
            let unit = if state.run_until.steps == 1 { " step" } else { " steps" };
            let steps = theme::number_field(&mut state.run_until.steps).range(1..=100_000);
            ui.add(steps.suffix(unit));
            if is_chosen {
                goal = Some(after_steps(shown, state.run_until.steps));
            }
        });
    }
    ui.horizontal(|ui| {
        let is_chosen = ui.button("Run until").on_hover_text("Simulated time").clicked();
        state.run_until.time_s = state.run_until.time_s.max(now_s.ceil());
        ui.add(theme::number_field(&mut state.run_until.time_s).range(now_s..=1e6).speed(0.5).suffix(" s"));
        if is_chosen {
            goal = Some(RunGoal::Time(state.run_until.time_s));
        }
    });
    if shown.city == CityKind::Local && now_s < shown.duration_s {
        let to_end = ui.button("Until the end of the scenario");
        let end = theme::decimal(ui.ctx()).plain(shown.duration_s);
        if to_end.on_hover_text(format!("Simulated time {end} s")).clicked() {
            goal = Some(RunGoal::Time(shown.duration_s));
        }
    }
    ui.separator();
    for (words, kind) in EVENTS {
        if ui.button(format!("Until the next {words}")).clicked() {
            goal = Some(RunGoal::Event(kind));
        }
    }
    goal
}
