//! The registry of actions (command pattern): what the user can do, by which key, and when. Keys, palette, help and
//! tips are made from it, so that an action is one entry in one of the lists below.

mod binding;
mod bookmarks;
mod camera;
mod driving;
mod editing;
mod files;
mod hint;
pub mod key_map;
mod look;
mod panels;
mod run;
mod shortcut;
mod time;
mod vehicles;

pub use binding::{Binding, KeyUse, Scope};
pub use hint::Hint;
pub use key_map::{KeyMap, bindings};
pub use shortcut::{Shortcut, ctrl, key, shift};

use super::timeline::TimelineView;
use super::{CityKind, UiAction, UiState, ViewModel};
use city3d_session::Order;
use city3d_session::playback::PlaybackCommand;
use egui::{Context, Key, Modifiers};

/// Place of an action in a series.
#[derive(Clone, Copy, Debug)]
struct Numbered {
    number: u8,
    is_listed: fn(&UiState, u8) -> bool,
}

/// An action of the window.
#[derive(Clone, Copy, Debug)]
pub struct Command {
    /// What it does: an imperative, in the words of the field.
    pub name: &'static str,
    /// Other usual words for it, which the palette finds it by.
    pub known_as: &'static str,
    /// Keys that run it until the user assigns others; the first one is shown.
    pub usual_keys: &'static [Shortcut],
    /// A held key runs it again and again.
    pub repeats: bool,
    /// Its key works while a dialog or the palette is open.
    pub is_in_dialogs: bool,
    scope: Scope,
    is_fixed: bool,
    /// Its number where it is one of a series of actions, and whether the palette lists it before the number is typed.
    series: Option<Numbered>,
    is_available: fn(&UiState, &ViewModel<'_>) -> Availability,
    run: fn(&mut CommandContext<'_, '_>),
}

/// Whether an action can be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Availability {
    /// It can be run.
    Now,
    /// Something has to be done first; the hint says what.
    After(Hint),
    /// This window never has it, or it makes no sense at present.
    Never,
}

impl Availability {
    /// Available where a condition holds, else not at all.
    pub fn when(condition: bool) -> Self {
        if condition { Self::Now } else { Self::Never }
    }
}

/// What an action works on.
#[derive(Debug)]
pub struct CommandContext<'a, 'v> {
    /// What the user has chosen.
    pub state: &'a mut UiState,
    /// What the window shows.
    pub shown: &'a ViewModel<'v>,
    /// Actions for whoever owns the window.
    pub actions: &'a mut Vec<UiAction>,
    /// The run in time, as it will be after the commands of this frame.
    pub timeline: &'a mut TimelineView<'v>,
    /// Seconds of egui's clock.
    pub now_s: f64,
}

impl CommandContext<'_, '_> {
    /// Requests an order to the city.
    pub fn order(&mut self, order: Order) {
        self.actions.push(UiAction::Order(order));
    }

    /// Requests a command to the player.
    pub fn play(&mut self, command: PlaybackCommand) {
        if self.timeline.is_played() {
            self.timeline.head.predict(command);
        }
        self.actions.push(UiAction::PlaybackCommand(command));
    }
}

/// A part of the registry.
#[derive(Clone, Copy, Debug)]
pub struct Section {
    /// Heading in the help.
    pub title: &'static str,
    /// Its actions.
    pub commands: &'static [&'static Command],
    /// What acts while a key is held.
    pub held: &'static [&'static Binding],
    /// Use of the mouse, which is no action: what is used, and what it does.
    pub gestures: &'static [(&'static str, &'static str)],
    /// Whether a window of this kind has them.
    is_here: fn(&ViewModel<'_>) -> bool,
}

impl Section {
    const fn new(title: &'static str, commands: &'static [&'static Command]) -> Self {
        Self { title, commands, held: &[], gestures: &[], is_here: |_| true }
    }

    const fn holding(self, held: &'static [&'static Binding]) -> Self {
        Self { held, ..self }
    }

    const fn with(self, gestures: &'static [(&'static str, &'static str)]) -> Self {
        Self { gestures, ..self }
    }

    const fn only(self, is_here: fn(&ViewModel<'_>) -> bool) -> Self {
        Self { is_here, ..self }
    }

    /// Whether a window that shows this has the section.
    pub fn is_in(&self, shown: &ViewModel<'_>) -> bool {
        (self.is_here)(shown)
    }

    /// Everything in it that a key can be assigned to.
    pub fn bindings(&self) -> impl Iterator<Item = Binding> {
        let held = self.held.iter().map(|held| **held);
        self.commands.iter().map(|command| command.binding()).chain(held)
    }
}

/// All actions. Of two with one key, the first that is available runs.
pub static SECTIONS: [Section; 10] = [
    // Keys of the run are those of the playback while the past is played.
    Section::new("Time", time::ALL).with(time::GESTURES),
    Section::new("Run", run::ALL).only(|shown| shown.replay.is_none()),
    Section::new("Files", files::ALL),
    Section::new("Editing", editing::ALL).with(editing::GESTURES).only(|shown| shown.replay.is_none()),
    Section::new("Camera", camera::ALL).holding(camera::HELD).with(camera::GESTURES),
    Section::new("Bookmarks", bookmarks::ALL),
    Section::new("Vehicles", vehicles::ALL).with(vehicles::GESTURES),
    Section::new("Driving", driving::ALL).holding(driving::HELD).only(|shown| shown.replay.is_none()),
    Section::new("Panels", panels::ALL),
    Section::new("Appearance", look::ALL),
];

pub use camera::{CAMERA_KEYS, MODES as CAMERA_MODES};
pub use driving::{CONTROLLERS, DRIVING_KEYS, INDICATE_LEFT, INDICATE_RIGHT, RELEASE, REVERSE, TAKE_CONTROL};
pub use editing::{ADD as ADD_VEHICLE, EDIT, EDITING, RUN as RUN_EDITED};
pub use files::{OPEN, RESULT};
pub use look::{LARGER, SMALLER};
pub use panels::{
    CAMERAS, EVENTS, HELP, LABELS, MAP, MENU as PANEL_MENU, PALETTE, SCREENSHOT, SETTINGS, VEHICLES, VIDEO,
    VIEWS as VIEW_MENU,
};
pub use run::{FASTER, REAL_TIME, RESET, SLOWER, START_OR_PAUSE, STEP};
pub use time::{
    DRIVES, GRAVE_EVENT, LEAP_BACK, LEAP_FORWARD, NEXT_EVENT, PAST_IS_SHOWN, PLAY_BACKWARD, PLAY_OR_PAUSE,
    PREVIOUS_EVENT, REPLAY_FASTER, REPLAY_SLOWER, STEP_BACK, STEP_FORWARD, TO_END, TO_START,
};
pub use vehicles::{FOLLOW, PREVIEW};

/// Every action, in the order in which keys look for theirs.
pub fn all() -> impl Iterator<Item = &'static Command> {
    SECTIONS.iter().flat_map(|section| section.commands.iter().copied())
}

impl Command {
    /// An action that is always available.
    const fn always(
        name: &'static str,
        usual_keys: &'static [Shortcut],
        run: fn(&mut CommandContext<'_, '_>),
    ) -> Self {
        Self {
            name,
            known_as: "",
            usual_keys,
            repeats: false,
            is_in_dialogs: false,
            scope: Scope::ALL,
            is_fixed: false,
            series: None,
            is_available: |_, _| Availability::Now,
            run,
        }
    }

    /// The same, but found by these words, too.
    const fn known_as(self, known_as: &'static str) -> Self {
        Self { known_as, ..self }
    }

    /// The same, but available only where the function says so.
    const fn only(self, is_available: fn(&UiState, &ViewModel<'_>) -> Availability) -> Self {
        Self { is_available, ..self }
    }

    /// The same, but its key works in these situations alone.
    const fn within(self, scope: Scope) -> Self {
        Self { scope, ..self }
    }

    /// The same, but its key works while a dialog is open, too.
    const fn in_dialogs(self) -> Self {
        Self { is_in_dialogs: true, ..self }
    }

    /// The same, but one of a series by this number, which the palette lists where the function says so or the number is typed.
    const fn numbered(self, number: u8, is_listed: fn(&UiState, u8) -> bool) -> Self {
        Self { series: Some(Numbered { number, is_listed }), ..self }
    }

    /// The same, but with a key that dialogs know too, so that it stays.
    const fn fixed(self) -> Self {
        Self { is_fixed: true, ..self }
    }

    /// The same, but repeated while its key is held.
    const fn repeating(self) -> Self {
        Self { repeats: true, ..self }
    }

    /// Whether it can be run.
    pub fn availability(&self, state: &UiState, shown: &ViewModel<'_>) -> Availability {
        (self.is_available)(state, shown)
    }

    /// Whether the palette lists it for these words: of a series of actions not all, unless their numbers are typed.
    pub(super) fn is_listed(&self, state: &UiState, words: &str) -> bool {
        self.series.is_none_or(|Numbered { number, is_listed }| {
            is_listed(state, number) || words.split_whitespace().any(|word| word == number.to_string())
        })
    }

    /// Runs it, or tells the user what has to be done first.
    pub fn run(&self, context: &mut CommandContext<'_, '_>) {
        match self.availability(context.state, context.shown) {
            Availability::Now => (self.run)(context),
            Availability::After(hint) => {
                let what = hint.words(&context.state.keys);
                context.state.say(what, context.now_s);
            }
            Availability::Never => {}
        }
    }

    /// What its key can be, and where it works.
    pub fn binding(&self) -> Binding {
        let key_use = if self.is_fixed { KeyUse::Fixed } else { KeyUse::Pressed };
        Binding { name: self.name, usual: self.usual_keys, scope: self.scope, key_use }
    }

    /// Its first key in words; empty where it has none.
    pub fn key(&self, context: &Context) -> String {
        key_map::of(context).first(&self.binding())
    }

    /// A tip with its key behind it.
    pub fn tip(&self, context: &Context, text: &str) -> String {
        key_map::of(context).tip(text, self)
    }
}

/// The action of a pressed key. A shortcut with exactly these modifiers comes before one without Shift, which layouts
/// need for some characters. An action that wants something else first gives way to one that can be run.
pub fn of_key(
    (pressed, modifiers): (Key, Modifiers),
    state: &UiState,
    shown: &ViewModel<'_>,
) -> Option<&'static Command> {
    let without_shift = Modifiers { shift: false, ..modifiers };
    let choices = [modifiers, without_shift];
    let tried = if modifiers.shift { &choices[..] } else { &choices[..1] };
    tried.iter().find_map(|modifiers| {
        let has_key = |command: &&'static Command| {
            state.keys.keys(&command.binding()).iter().any(|key| key.is_pressed(pressed, *modifiers))
        };
        let with_key = || all().filter(has_key);
        let runs = |wanted: fn(Availability) -> bool| {
            with_key().find(|command| wanted(command.availability(state, shown)))
        };
        runs(|availability| availability == Availability::Now)
            .or_else(|| runs(|availability| matches!(availability, Availability::After(_))))
    })
}

/// Not while a person drives, who has to see the present.
const WATCHING: Scope = Scope::LIVE.and(Scope::EDITING).and(Scope::PLAYED);

/// Not in a replay.
const NOT_PLAYED: Scope = Scope::LIVE.and(Scope::DRIVING).and(Scope::EDITING);

/// Only a local city is stepped, and keeps another time than the clock's.
fn is_local_run(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    Availability::when(shown.replay.is_none() && shown.city == CityKind::Local)
}

fn is_live(_: &UiState, shown: &ViewModel<'_>) -> Availability {
    Availability::when(shown.replay.is_none())
}

/// Makes the entries of a list and the list of them, so that an action is one entry.
macro_rules! registry {
    ($($name:ident = $command:expr),* $(,)?) => {
        $(pub static $name: $crate::ui::commands::Command = $command;)*
        /// The actions of this file.
        pub static ALL: &[&$crate::ui::commands::Command] = &[$(&$name),*];
    };
}
use registry;
