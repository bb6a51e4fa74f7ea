//! What the palette lists: the actions of the registry, and choices that only the city's state knows.

use super::synonyms;
use crate::ui::bar::{SPEEDS, speed_label};
use crate::ui::commands::{self, Availability, Command, CommandContext, KeyMap};
use crate::ui::events::named;
use crate::ui::{UiAction, UiState, ViewModel};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::{Order, Speed};

/// A row of the palette.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub name: String,
    /// Other words for it.
    known_as: &'static str,
    /// Its first key, empty without one.
    pub key: String,
    pub availability: Availability,
    does: Deed,
}

/// How many words of those typed are found.
struct Hits {
    all: usize,
    /// Without words such as "a" and "is", which are in the names of most actions.
    of_long_words: usize,
}

#[derive(Clone, Debug)]
enum Deed {
    Command(&'static Command),
    Select(VehicleId),
    Preview(VehicleId),
    Scenario(String),
    Speed(Speed),
}

impl Entry {
    /// Does what the row says.
    pub fn run(self, context: &mut CommandContext<'_, '_>) {
        match self.does {
            Deed::Command(command) => command.run(context),
            Deed::Select(vehicle) => {
                context.state.selection.vehicle = Some(vehicle);
                context.state.table.reveal = true;
            }
            Deed::Preview(vehicle) => context.state.toggle_preview(vehicle),
            Deed::Scenario(name) => context.actions.push(UiAction::Scenario(name)),
            Deed::Speed(speed) => context.order(Order::Speed(speed)),
        }
    }

    /// All words that it has, in lower case.
    fn text(&self) -> String {
        format!("{} {}", self.name, self.known_as).to_lowercase()
    }

    /// How many of the words it has or means.
    fn hits(&self, words: &str) -> Hits {
        let text = self.text();
        // Of several things as of one.
        let single =
            |word: &str| word.len() > synonyms::LEAST_LETTERS && text.contains(word.trim_end_matches('s'));
        let has = |word: &&str| text.contains(*word) || single(word) || synonyms::means(word, &text);
        let found = || words.split_whitespace().filter(has);
        let is_long = |word: &&str| word.len() >= synonyms::LEAST_LETTERS;
        Hits { all: found().count(), of_long_words: found().filter(is_long).count() }
    }

    /// How well it matches; last what means the words without having them.
    fn rank(&self, words: &str) -> u8 {
        let text = self.text();
        let has_all = words.split_whitespace().all(|word| text.contains(word));
        if has_all { rank(&self.name, words) } else { MEANT }
    }

    fn choice(name: String, does: Deed) -> Self {
        Self { name, known_as: "", key: String::new(), availability: Availability::Now, does }
    }

    fn action(command: &'static Command, availability: Availability, keys: &KeyMap) -> Self {
        let key = keys.first(&command.binding());
        let known_as = command.known_as;
        Self { name: command.name.to_owned(), known_as, key, availability, does: Deed::Command(command) }
    }
}

/// The rows that have all words, the best match first; where none has all, those that have most. Without words the actions alone:
/// vehicles may be many.
pub(super) fn matching(words: &str, state: &UiState, shown: &ViewModel<'_>) -> Vec<Entry> {
    let words = meaning(words);
    let action =
        |command: &'static Command| Entry::action(command, command.availability(state, shown), &state.keys);
    let actions = commands::all().filter(|command| command.is_listed(state, &words)).map(action);
    let choices = if words.is_empty() { Vec::new() } else { choices(state, shown) };
    let found: Vec<_> = actions
        .chain(choices)
        .filter(|entry| entry.availability != Availability::Never)
        .map(|entry| (entry.hits(&words), entry))
        .collect();
    let all = words.split_whitespace().count();
    let is_whole = found.iter().any(|(hits, _)| hits.all == all);
    let counted = |hits: &Hits| if is_whole { hits.all } else { hits.of_long_words };
    let most = found.iter().map(|(hits, _)| counted(hits)).max().unwrap_or(0);
    let mut found: Vec<Entry> = found
        .into_iter()
        .filter(|(hits, _)| counted(hits) == most && (is_whole || most > 0))
        .map(|(_, entry)| entry)
        .collect();
    found.sort_by_cached_key(|entry| (entry.rank(&words), entry.availability != Availability::Now));
    found
}

/// What is typed, in lower case and without the words of a question, unless it is made of these alone.
fn meaning(typed: &str) -> String {
    let typed = typed.trim().trim_end_matches('?').to_lowercase();
    let kept: Vec<&str> =
        typed.split_whitespace().filter(|word| !synonyms::OF_QUESTIONS.contains(word)).collect();
    if kept.is_empty() { typed } else { kept.join(" ") }
}

/// Every vehicle, speed and shipped scenario.
fn choices(state: &UiState, shown: &ViewModel<'_>) -> Vec<Entry> {
    let vehicles = shown.run_state.now.vehicles.iter().flat_map(|vehicle| {
        let name = named(shown.names, vehicle.id);
        [
            Entry::choice(format!("Select {name}"), Deed::Select(vehicle.id)),
            Entry::choice(format!("Open or close the camera of {name}"), Deed::Preview(vehicle.id)),
        ]
    });
    // A city elsewhere does not become another one.
    let has_others = shown.run_state.link.is_none();
    let scenarios = shown.scenarios.iter().filter(|choice| has_others && choice.name != shown.scenario);
    let scenarios = scenarios.map(|choice| {
        Entry::choice(format!("Open the scenario {}", choice.name), Deed::Scenario(choice.name.clone()))
    });
    let has_speed = commands::REAL_TIME.availability(state, shown) == Availability::Now;
    let speeds = SPEEDS.into_iter().filter(|_| has_speed).map(Speed::Times);
    let speeds = speeds.map(|speed| {
        Entry::choice(format!("Run at {}", speed_label(speed, state.preferences.decimal)), Deed::Speed(speed))
    });
    vehicles.chain(scenarios).chain(speeds).collect()
}

/// Rank of what has the words neither in its name nor among its other words.
const MEANT: u8 = 5;

/// How well a name matches: the whole, its beginning, beginnings of words, anything else; last what has the words by
/// another name.
fn rank(name: &str, words: &str) -> u8 {
    let name = name.to_lowercase();
    let begins = |word: &str| name.split(|c: char| !c.is_alphanumeric()).any(|part| part.starts_with(word));
    match () {
        () if name == words => 0,
        () if name.starts_with(words) => 1,
        () if words.split_whitespace().all(begins) => 2,
        () if words.split_whitespace().all(|word| name.contains(word)) => 3,
        () => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::{meaning, rank};

    #[test]
    fn a_question_is_asked_by_its_other_words() {
        assert_eq!(meaning(" Where is my video?"), "where video");
        assert_eq!(meaning("how do I zoom out"), "zoom out");
        assert_eq!(meaning("What is"), "what is", "nothing else is asked for");
    }

    #[test]
    fn beginnings_of_words_come_before_what_lies_within_them() {
        let ranks = ["map", "Map of the city", "Show or hide the map", "Remap keys", "Plan of the city"]
            .map(|name| rank(name, "map"));
        assert_eq!(ranks, [0, 1, 2, 3, 4]);
    }
}
