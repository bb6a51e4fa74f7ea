//! Actions on the playback of a recorded run.

use super::{Availability, Command, CommandContext, key, registry, shift};
use crate::ui::timeline::{self, TimelineRange};
use crate::ui::{UiState, ViewModel};
use city3d_session::playback::{PlaybackCommand, Playhead};
use egui::Key;

/// Step of the arrow keys, seconds.
const LEAP_S: f64 = 5.0;

registry!(
    PLAY_OR_PAUSE = Command::always("Play or pause", &[key(Key::Space)], |c| {
        with_head(c, |head| if head.is_playing { PlaybackCommand::Pause } else { PlaybackCommand::Play });
    })
    .only(is_replay),
    PLAY_BACKWARD = Command::always("Play backward", &[key(Key::J)], |c| c.play(PlaybackCommand::Reverse))
        .only(is_replay),
    STEP_BACK = Command::always("One recorded step back", &[key(Key::Comma)], |c| {
        c.play(PlaybackCommand::Step { forward: false });
    })
    .only(is_replay)
    .repeating(),
    STEP_FORWARD = Command::always("One recorded step forward", &[key(Key::Period), key(Key::N)], |c| {
        c.play(PlaybackCommand::Step { forward: true });
    })
    .only(is_replay)
    .repeating(),
    LEAP_BACK = Command::always("5 seconds back", &[key(Key::ArrowLeft)], |c| {
        with_head(c, |head| PlaybackCommand::Seek(head.at_s - LEAP_S));
    })
    .only(is_replay)
    .repeating(),
    LEAP_FORWARD = Command::always("5 seconds forward", &[key(Key::ArrowRight)], |c| {
        with_head(c, |head| PlaybackCommand::Seek(head.at_s + LEAP_S));
    })
    .only(is_replay)
    .repeating(),
    PREVIOUS_EVENT =
        Command::always("Go to the previous event", &[key(Key::OpenBracket), shift(Key::ArrowLeft)], |c| {
            to_event(c, false);
        })
        .only(is_replay)
        .repeating(),
    NEXT_EVENT =
        Command::always("Go to the next event", &[key(Key::CloseBracket), shift(Key::ArrowRight)], |c| {
            to_event(c, true);
        })
        .only(is_replay)
        .repeating(),
    TO_START = Command::always("Go to the start", &[key(Key::Home)], |c| {
        with_head(c, |head| PlaybackCommand::Seek(head.from_s));
    })
    .only(is_replay),
    TO_END = Command::always("Go to the end", &[key(Key::End)], |c| {
        with_head(c, |head| PlaybackCommand::Seek(head.to_s));
    })
    .only(is_replay),
    REPLAY_FASTER = Command::always("Play faster", &[key(Key::Plus), key(Key::Equals)], |c| {
        with_head(c, |head| PlaybackCommand::Speed(head.other_speed(true)));
    })
    .only(is_replay),
    REPLAY_SLOWER = Command::always("Play slower", &[key(Key::Minus)], |c| {
        with_head(c, |head| PlaybackCommand::Speed(head.other_speed(false)));
    })
    .only(is_replay),
    WHOLE_RUN = Command::always("Show the whole run on the timeline", &[], |c| {
        c.state.section = TimelineRange::default();
    })
    .only(|state, _| Availability::when(state.section != TimelineRange::default())),
);

/// Use of the mouse.
pub const GESTURES: &[(&str, &str)] = &[
    ("click on the timeline", "Go to that time, or to the event of a mark"),
    ("wheel on the timeline", "Show less or more of the run"),
    ("right-drag on the timeline", "Move the shown part of the run"),
];

fn is_replay(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    Availability::when(shown.replay.is_some())
}

fn with_head(context: &mut CommandContext<'_, '_>, command: fn(&Playhead) -> PlaybackCommand) {
    if let Some(replay) = *context.replay {
        context.play(command(&replay.head));
    }
}

fn to_event(context: &mut CommandContext<'_, '_>, forward: bool) {
    let command =
        context.replay.as_ref().and_then(|replay| timeline::to_event(replay, context.state, forward));
    if let Some(command) = command {
        context.play(command);
    }
}
