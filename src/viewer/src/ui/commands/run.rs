//! Actions on a run that goes on.

use super::{
    Availability, Command, Hint, NOT_PLAYED, Scope, ctrl, is_live, is_local_run, key, registry, shift,
};
use crate::ui::bar::other_speed;
use crate::ui::{UiState, ViewModel, run_until};
use city3d_session::playback::MarkKind;
use city3d_session::{Order, RunGoal, RunPhase, Speed};
use egui::Key;

registry!(
    START_OR_PAUSE = Command::always("Start, pause or continue the run", &[key(Key::Space)], |c| {
        if c.shown.run_state.phase == RunPhase::Over && c.state.runs.end_card.is_open() {
            let said = "The run has finished: Continue on its card goes beyond its end";
            return c.state.say(said.to_owned(), c.now_s);
        }
        if c.state.has_just_ended(c.now_s) {
            let said = "The run has just come to its end. Continue beyond it";
            return c.state.say(c.state.keys.tip(said, &START_OR_PAUSE), c.now_s);
        }
        let runs = c.shown.run_state.phase == RunPhase::Running;
        c.order(if runs { Order::Pause } else { Order::Start });
    })
    .known_as("play stop resume simulation")
    .only(can_run)
    .within(GOING_ON),
    STEP = Command::always("One step (usually 10 ms)", &[key(Key::N)], |c| c.order(Order::Step))
        .known_as("tick frame advance")
        .only(can_step)
        .within(GOING_ON),
    RESET = Command::always("Reset the run", &[ctrl(Key::R)], |c| c.order(Order::Reset))
        .known_as("restart start again stop")
        .only(can_reset)
        .within(NOT_PLAYED),
    FASTER = Command::always("Run faster", &[key(Key::Plus), key(Key::Equals)], |c| {
        c.order(Order::Speed(other_speed(c.shown.run_state.speed, true)));
    })
    .known_as("speed up accelerate time")
    .only(is_local_run)
    .within(NOT_PLAYED),
    SLOWER = Command::always("Run slower", &[key(Key::Minus)], |c| {
        c.order(Order::Speed(other_speed(c.shown.run_state.speed, false)));
    })
    .known_as("speed slow motion")
    .only(is_local_run)
    .within(NOT_PLAYED),
    REAL_TIME = Command::always("Run in real time", &[], |c| c.order(Order::Speed(Speed::Times(1.0))))
        .known_as("speed 1x")
        .only(is_local_run)
        .within(NOT_PLAYED),
    SOME_STEPS = Command::always("Run the chosen number of steps", &[shift(Key::N)], |c| {
        let steps = c.state.run_until.steps();
        c.order(Order::RunUntil(run_until::after_steps(c.shown, steps)));
    })
    .only(can_step)
    .within(GOING_ON),
    UNTIL_COLLISION = Command::always("Run until the next collision", &[], |c| {
        c.order(Order::RunUntil(RunGoal::Event(Some(MarkKind::Collision))));
    })
    .known_as("crash accident")
    .only(can_run)
    .within(GOING_ON),
    UNTIL_EVENT = Command::always("Run until the next event", &[], |c| {
        c.order(Order::RunUntil(RunGoal::Event(None)));
    })
    .only(can_run)
    .within(GOING_ON),
    UNLIMITED = Command::always("Run as fast as possible", &[], |c| c.order(Order::Speed(Speed::Unlimited)))
        .known_as("fastest max speed")
        .only(is_local_run)
        .within(NOT_PLAYED),
);

/// While the scenario is edited, its run waits.
const GOING_ON: Scope = Scope::LIVE.and(Scope::DRIVING);

const FAILED: Availability = Availability::After(Hint::by("The run has failed. Reset it first.", &RESET));

fn can_run(state: &UiState, shown: &ViewModel<'_>) -> Availability {
    if shown.edit.is_some() {
        return super::editing::RUN_WAITS;
    }
    match shown.run_state.phase {
        RunPhase::Failed(_) if shown.replay.is_none() => FAILED,
        _ => is_live(state, shown),
    }
}

fn can_reset(state: &UiState, shown: &ViewModel<'_>) -> Availability {
    if shown.edit.is_some() { super::editing::RUN_WAITS } else { is_live(state, shown) }
}

fn can_step(state: &UiState, shown: &ViewModel<'_>) -> Availability {
    match is_local_run(state, shown) {
        Availability::Now if shown.past.is_shown => Availability::After(super::PAST_IS_SHOWN),
        Availability::Now => can_run(state, shown),
        other => other,
    }
}
