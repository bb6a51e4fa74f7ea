//! Actions on the time that is shown: the playback of a recorded run, and looking back in one that goes on.

use super::{Availability, Command, CommandContext, Hint, RELEASE, Scope, WATCHING, key, registry, shift};
use crate::ui::timeline::{self, ShownTime, TimelineRange, TimelineView};
use crate::ui::{CameraMode, UiState, ViewModel};
use city3d_session::playback::{PlaybackCommand, Playhead};
use egui::Key;

/// Step of the arrow keys, seconds.
const LEAP_S: f64 = 5.0;

registry!(
    PLAY_OR_PAUSE = Command::always("Play or pause", &[key(Key::Space)], |c| {
        with_head(c, |head| if head.is_playing { PlaybackCommand::Pause } else { PlaybackCommand::Play });
    })
    .known_as("replay playback resume stop")
    .only(is_played)
    .within(Scope::PLAYED),
    PLAY_BACKWARD = Command::always("Play backward", &[key(Key::J)], |c| c.play(PlaybackCommand::Reverse))
        .known_as("replay reverse rewind")
        .only(looks_back)
        .within(WATCHING),
    STEP_BACK = Command::always("One recorded step back", &[key(Key::Comma)], |c| {
        c.play(PlaybackCommand::Step { forward: false });
    })
    .known_as("frame tick")
    .only(looks_back)
    .within(WATCHING)
    .repeating(),
    STEP_FORWARD = Command::always("One recorded step forward", &[key(Key::Period), key(Key::N)], |c| {
        c.play(PlaybackCommand::Step { forward: true });
    })
    .known_as("frame tick advance")
    .only(is_played)
    .within(Scope::PLAYED)
    .repeating(),
    LEAP_BACK = Command::always("5 seconds back", &[key(Key::ArrowLeft)], |c| {
        with_head(c, |head| PlaybackCommand::Seek((head.at_s - LEAP_S).max(head.from_s)));
    })
    .only(leaps_back)
    .within(Scope::LIVE.and(Scope::PLAYED))
    .repeating(),
    LEAP_FORWARD = Command::always("5 seconds forward", &[key(Key::ArrowRight)], |c| {
        with_head(c, |head| PlaybackCommand::Seek(head.at_s + LEAP_S));
    })
    .only(is_played)
    .within(Scope::PLAYED)
    .repeating(),
    PREVIOUS_EVENT =
        Command::always("Go to the previous event", &[key(Key::OpenBracket), shift(Key::ArrowLeft)], |c| {
            to_event(c, false);
        })
        .known_as("jump")
        .only(looks_back)
        .within(WATCHING)
        .repeating(),
    NEXT_EVENT =
        Command::always("Go to the next event", &[key(Key::CloseBracket), shift(Key::ArrowRight)], |c| {
            to_event(c, true);
        })
        .known_as("jump")
        .only(is_played)
        .within(Scope::PLAYED)
        .repeating(),
    TO_START = Command::always("Go to the start", &[key(Key::Home)], |c| {
        with_head(c, |head| PlaybackCommand::Seek(head.from_s));
    })
    .known_as("replay from the beginning rewind")
    .only(looks_back)
    .within(WATCHING),
    TO_END = Command::always("Go to the end, or back to the present", &[key(Key::End)], |c| {
        match c.timeline.shown {
            ShownTime::Past => c.play(PlaybackCommand::Live),
            _ => with_head(c, |head| PlaybackCommand::Seek(head.to_s)),
        }
    })
    .known_as("live now")
    .only(is_played)
    .within(Scope::PLAYED),
    GRAVE_EVENT = Command::always("Go to the last serious event", &[key(Key::G)], |c| {
        if let Some(command) = timeline::to_grave_event(c.timeline, c.state) {
            c.play(command);
        }
    })
    .known_as("next jump crash accident collision long stop lost link left the road grave")
    .only(|state, shown| match state.events.last_grave(shown.events) {
        Some(_) => looks_back(state, shown),
        None => {
            Availability::After(Hint::new(
                "No vehicle has collided, stopped for long, left the road or lost its link so far",
            ))
        }
    })
    .within(WATCHING),
    REPLAY_FASTER = Command::always("Play faster", &[key(Key::Plus), key(Key::Equals)], |c| {
        with_head(c, |head| PlaybackCommand::Speed(head.other_speed(true)));
    })
    .known_as("replay speed")
    .only(is_played)
    .within(Scope::PLAYED),
    REPLAY_SLOWER = Command::always("Play slower", &[key(Key::Minus)], |c| {
        with_head(c, |head| PlaybackCommand::Speed(head.other_speed(false)));
    })
    .known_as("replay speed slow motion")
    .only(is_played)
    .within(Scope::PLAYED),
    WHOLE_RUN = Command::always("Show the whole run on the timeline", &[], |c| {
        c.state.section = TimelineRange::default();
    })
    .known_as("zoom out")
    .only(|state, _| Availability::when(state.section != TimelineRange::default())),
);

/// Why nothing is done to the present.
pub const PAST_IS_SHOWN: Hint = Hint::by("The past is shown: go back to the present first", &TO_END);
/// Why who drives does not look at the past.
pub const DRIVES: Hint = Hint::by("You drive: release the vehicle to look at the past", &RELEASE);

/// Use of the mouse.
pub const GESTURES: &[(&str, &str)] = &[
    ("click on the timeline", "Go to that time, or to the event of a mark and select its vehicle"),
    ("double-click on a mark", "Follow the vehicle of the event, too"),
    ("wheel on the timeline", "Show less or more of the run"),
    ("right-drag on the timeline", "Move the shown part of the run"),
    ("arrows in the present", "Leap back by the chase and onboard cameras; the other cameras move"),
];

fn is_played(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    Availability::when(TimelineView::of(shown).is_played())
}

/// Available in the present, too; who drives has to see it, and what is edited has no past.
fn looks_back(state: &UiState, shown: &ViewModel<'_>) -> Availability {
    match state.driving {
        _ if shown.edit.is_some() => super::editing::RUN_WAITS,
        Some(_) => Availability::After(DRIVES),
        None => Availability::Now,
    }
}

/// In the present, cameras that ride on a vehicle leave the arrows to it; those of the others move them.
fn leaps_back(state: &UiState, shown: &ViewModel<'_>) -> Availability {
    let rides = matches!(state.viewpoint.mode, CameraMode::Chase | CameraMode::Onboard);
    let from_present = rides && state.driving.is_none() && shown.edit.is_none();
    Availability::when(from_present || TimelineView::of(shown).is_played())
}

fn with_head(context: &mut CommandContext<'_, '_>, command: fn(&Playhead) -> PlaybackCommand) {
    context.play(command(&context.timeline.head));
}

fn to_event(context: &mut CommandContext<'_, '_>, forward: bool) {
    if let Some(command) = timeline::to_event(context.timeline, context.state, forward) {
        context.play(command);
    }
}
