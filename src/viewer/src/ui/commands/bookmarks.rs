//! Actions on the stored cameras of the large view.

use super::{Command, CommandContext, ctrl, registry};
use crate::ui::{Flight, UiState};
use egui::Key;

registry!(
    GO_TO_1 = Command::always("Go to bookmark 1", &[ctrl(Key::Num1)], |c| recall(c, 1))
        .numbered(1, is_set)
        .known_as("camera view"),
    GO_TO_2 = Command::always("Go to bookmark 2", &[ctrl(Key::Num2)], |c| recall(c, 2)).numbered(2, is_set),
    GO_TO_3 = Command::always("Go to bookmark 3", &[ctrl(Key::Num3)], |c| recall(c, 3)).numbered(3, is_set),
    GO_TO_4 = Command::always("Go to bookmark 4", &[ctrl(Key::Num4)], |c| recall(c, 4)).numbered(4, is_set),
    GO_TO_5 = Command::always("Go to bookmark 5", &[ctrl(Key::Num5)], |c| recall(c, 5)).numbered(5, is_set),
    GO_TO_6 = Command::always("Go to bookmark 6", &[ctrl(Key::Num6)], |c| recall(c, 6)).numbered(6, is_set),
    GO_TO_7 = Command::always("Go to bookmark 7", &[ctrl(Key::Num7)], |c| recall(c, 7)).numbered(7, is_set),
    GO_TO_8 = Command::always("Go to bookmark 8", &[ctrl(Key::Num8)], |c| recall(c, 8)).numbered(8, is_set),
    GO_TO_9 = Command::always("Go to bookmark 9", &[ctrl(Key::Num9)], |c| recall(c, 9)).numbered(9, is_set),
    SET_1 = Command::always("Set bookmark 1", &[ctrl(Key::Num1).with_shift()], |c| set(c, 1))
        .numbered(1, is_next)
        .known_as("camera view save"),
    SET_2 = Command::always("Set bookmark 2", &[ctrl(Key::Num2).with_shift()], |c| set(c, 2))
        .numbered(2, is_next),
    SET_3 = Command::always("Set bookmark 3", &[ctrl(Key::Num3).with_shift()], |c| set(c, 3))
        .numbered(3, is_next),
    SET_4 = Command::always("Set bookmark 4", &[ctrl(Key::Num4).with_shift()], |c| set(c, 4))
        .numbered(4, is_next),
    SET_5 = Command::always("Set bookmark 5", &[ctrl(Key::Num5).with_shift()], |c| set(c, 5))
        .numbered(5, is_next),
    SET_6 = Command::always("Set bookmark 6", &[ctrl(Key::Num6).with_shift()], |c| set(c, 6))
        .numbered(6, is_next),
    SET_7 = Command::always("Set bookmark 7", &[ctrl(Key::Num7).with_shift()], |c| set(c, 7))
        .numbered(7, is_next),
    SET_8 = Command::always("Set bookmark 8", &[ctrl(Key::Num8).with_shift()], |c| set(c, 8))
        .numbered(8, is_next),
    SET_9 = Command::always("Set bookmark 9", &[ctrl(Key::Num9).with_shift()], |c| set(c, 9))
        .numbered(9, is_next),
    FLY = Command::always("Fly along the bookmarks, or end the flight", &[], fly),
);

/// The actions by number.
static GOING: [&Command; 9] =
    [&GO_TO_1, &GO_TO_2, &GO_TO_3, &GO_TO_4, &GO_TO_5, &GO_TO_6, &GO_TO_7, &GO_TO_8, &GO_TO_9];
static SETTING: [&Command; 9] = [&SET_1, &SET_2, &SET_3, &SET_4, &SET_5, &SET_6, &SET_7, &SET_8, &SET_9];

fn is_set(state: &UiState, number: u8) -> bool {
    state.bookmarks.get(number).is_some()
}

/// Whether a bookmark is set, or the first one that is not.
fn is_next(state: &UiState, number: u8) -> bool {
    (1..number).all(|before| is_set(state, before)) || is_set(state, number)
}

fn fly(context: &mut CommandContext<'_, '_>) {
    let state = &mut *context.state;
    if state.viewpoint.is_flying() {
        state.viewpoint.end_flight();
        return;
    }
    match Flight::along(&state.bookmarks) {
        Some(flight) => state.viewpoint.begin_flight(flight),
        None => {
            let said = state.keys.tip("Set two bookmarks first", &SET_1);
            state.say(said, context.now_s);
        }
    }
}

fn recall(context: &mut CommandContext<'_, '_>, number: u8) {
    let state = &mut *context.state;
    match state.bookmarks.get(number) {
        Some(bookmark) => state.viewpoint.recall(bookmark),
        None => {
            let text = format!("Bookmark {number} is not set. Set it first");
            let said = state.keys.tip(&text, SETTING[usize::from(number) - 1]);
            state.say(said, context.now_s);
        }
    }
}

fn set(context: &mut CommandContext<'_, '_>, number: u8) {
    context.state.bookmarks.set(number, &context.state.viewpoint);
    let text = format!("Bookmark {number} is set. Come back to this camera at any time");
    let said = context.state.keys.tip(&text, GOING[usize::from(number) - 1]);
    context.state.say(said, context.now_s);
}
