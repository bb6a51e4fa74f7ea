//! The registry of actions (command pattern): what the user can do, by which key, and when. Keys, palette, help and
//! tips are made from it, so that an action is one entry in one of the lists below.

mod bookmarks;
mod camera;
mod driving;
mod editing;
mod files;
mod look;
mod panels;
mod run;
mod shortcut;
mod time;
mod vehicles;

pub use shortcut::{Shortcut, ctrl, key, shift};

use super::timeline::TimelineView;
use super::{CityKind, UiAction, UiState, ViewModel};
use city3d_session::Order;
use city3d_session::playback::PlaybackCommand;
use egui::{Key, Modifiers};

/// An action of the window.
#[derive(Clone, Copy, Debug)]
pub struct Command {
    /// What it does: an imperative, in the words of the field.
    pub name: &'static str,
    /// Keys that run it; the first one is shown.
    pub keys: &'static [Shortcut],
    /// A held key runs it again and again.
    pub repeats: bool,
    is_available: fn(&UiState, &ViewModel<'_>) -> Availability,
    run: fn(&mut CommandContext<'_, '_>),
}

/// Whether an action can be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Availability {
    /// It can be run.
    Now,
    /// Something has to be done first; the sentence says what.
    After(&'static str),
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
    /// Mouse and held keys, which are not actions: what is used, and what it does.
    pub gestures: &'static [(&'static str, &'static str)],
    /// Whether a window of this kind has them.
    is_here: fn(&ViewModel<'_>) -> bool,
}

impl Section {
    const fn new(title: &'static str, commands: &'static [&'static Command]) -> Self {
        Self { title, commands, gestures: &[], is_here: |_| true }
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
}

/// All actions. Of two with one key, the first that is available runs.
pub static SECTIONS: [Section; 10] = [
    // Keys of the run are those of the playback while the past is played.
    Section::new("Time", time::ALL).with(time::GESTURES),
    Section::new("Run", run::ALL).only(|shown| shown.replay.is_none()),
    Section::new("Files", files::ALL),
    Section::new("Editing", editing::ALL).with(editing::GESTURES).only(|shown| shown.replay.is_none()),
    Section::new("Camera", camera::ALL).with(camera::GESTURES),
    Section::new("Bookmarks", bookmarks::ALL),
    Section::new("Vehicles", vehicles::ALL).with(vehicles::GESTURES),
    Section::new("Driving", driving::ALL).with(driving::GESTURES).only(|shown| shown.replay.is_none()),
    Section::new("Panels", panels::ALL),
    Section::new("Appearance", look::ALL),
];

pub use camera::MODES as CAMERA_MODES;
pub use driving::{CONTROLLERS, TAKE_CONTROL};
pub use editing::EDITING;
pub use files::OPEN;
pub use look::{LARGER, SMALLER};
pub use panels::{CAMERAS, EVENTS, HELP, MENU as PANEL_MENU, SETTINGS, VIDEO};
pub use run::{FASTER, REAL_TIME, RESET, SLOWER, START_OR_PAUSE, STEP};
pub use time::{
    GRAVE_EVENT, NEXT_EVENT, PLAY_BACKWARD, PLAY_OR_PAUSE, PREVIOUS_EVENT, STEP_BACK, STEP_FORWARD, TO_END,
    TO_START,
};
pub use vehicles::PREVIEW;

/// Every action, in the order in which keys look for theirs.
pub fn all() -> impl Iterator<Item = &'static Command> {
    SECTIONS.iter().flat_map(|section| section.commands.iter().copied())
}

impl Command {
    /// An action that is always available.
    const fn always(
        name: &'static str,
        keys: &'static [Shortcut],
        run: fn(&mut CommandContext<'_, '_>),
    ) -> Self {
        Self { name, keys, repeats: false, is_available: |_, _| Availability::Now, run }
    }

    /// The same, but available only where the function says so.
    const fn only(self, is_available: fn(&UiState, &ViewModel<'_>) -> Availability) -> Self {
        Self { is_available, ..self }
    }

    /// The same, but repeated while its key is held.
    const fn repeating(self) -> Self {
        Self { repeats: true, ..self }
    }

    /// Whether it can be run.
    pub fn availability(&self, state: &UiState, shown: &ViewModel<'_>) -> Availability {
        (self.is_available)(state, shown)
    }

    /// Runs it, or tells the user what has to be done first.
    pub fn run(&self, context: &mut CommandContext<'_, '_>) {
        match self.availability(context.state, context.shown) {
            Availability::Now => (self.run)(context),
            Availability::After(what) => context.state.say(what, context.now_s),
            Availability::Never => {}
        }
    }

    /// The first key in words; empty where it has none.
    pub fn key(&self) -> String {
        self.keys.first().map(Shortcut::words).unwrap_or_default()
    }

    /// All keys in words.
    pub fn all_keys(&self) -> String {
        let keys: Vec<String> = self.keys.iter().map(Shortcut::words).collect();
        keys.join(" or ")
    }

    /// A tip with the key behind it.
    pub fn tip(&self, text: &str) -> String {
        let key = self.key();
        if key.is_empty() { text.to_owned() } else { format!("{text} ({key})") }
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
        let with_key = || all().filter(|c| c.keys.iter().any(|k| k.is_pressed(pressed, *modifiers)));
        let runs = |wanted: fn(Availability) -> bool| {
            with_key().find(|command| wanted(command.availability(state, shown)))
        };
        runs(|availability| availability == Availability::Now)
            .or_else(|| runs(|availability| matches!(availability, Availability::After(_))))
    })
}

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
