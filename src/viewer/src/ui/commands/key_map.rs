//! Keys of the user's own: which key runs which action.

use super::{Binding, Command, SECTIONS, Shortcut};
use egui::{Context, Id};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The keys that the user has assigned in place of the usual ones. In the settings an action has its name and its
/// keys in words: `"Save a screenshot" = ["Ctrl+F12"]`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "BTreeMap<String, Vec<String>>", into = "BTreeMap<String, Vec<String>>")]
pub struct KeyMap {
    assigned: BTreeMap<String, Vec<Shortcut>>,
}

impl From<BTreeMap<String, Vec<String>>> for KeyMap {
    /// Words that name no key are left out, with a warning.
    fn from(stored: BTreeMap<String, Vec<String>>) -> Self {
        let read = |(name, words): (String, Vec<String>)| {
            let shortcut = |words: &String| {
                let shortcut = Shortcut::from_words(words);
                if shortcut.is_none() {
                    tracing::warn!("view.toml: {words:?} is no key; \"{name}\" goes without it");
                }
                shortcut
            };
            let shortcuts = words.iter().filter_map(shortcut).collect();
            (name, shortcuts)
        };
        Self { assigned: stored.into_iter().map(read).collect() }
    }
}

impl From<KeyMap> for BTreeMap<String, Vec<String>> {
    fn from(keys: KeyMap) -> Self {
        let words = |shortcuts: Vec<Shortcut>| shortcuts.iter().map(Shortcut::words).collect();
        keys.assigned.into_iter().map(|(name, shortcuts)| (name, words(shortcuts))).collect()
    }
}

/// All actions and held keys, in the order in which keys look for theirs.
pub fn bindings() -> impl Iterator<Item = Binding> {
    SECTIONS.iter().flat_map(|section| section.bindings())
}

impl KeyMap {
    /// The keys of an action: assigned ones, else the usual ones.
    pub fn keys<'a>(&'a self, binding: &Binding) -> &'a [Shortcut] {
        self.assigned.get(binding.name).map_or(binding.usual, Vec::as_slice)
    }

    /// Whether an action has its usual keys.
    pub fn is_usual(&self, binding: &Binding) -> bool {
        !self.assigned.contains_key(binding.name)
    }

    /// Whether the user has assigned no key at all.
    pub fn is_all_usual(&self) -> bool {
        self.assigned.is_empty()
    }

    /// Gives an action these keys in place of those that it has.
    pub fn assign(&mut self, binding: &Binding, mut keys: Vec<Shortcut>) {
        let mut seen = Vec::new();
        keys.retain(|key| {
            !seen.contains(key) && {
                seen.push(*key);
                true
            }
        });
        if keys == binding.usual {
            self.assigned.remove(binding.name);
        } else {
            self.assigned.insert(binding.name.to_owned(), keys);
        }
    }

    /// Gives an action its usual keys.
    pub fn restore(&mut self, binding: &Binding) {
        self.assigned.remove(binding.name);
    }

    /// Takes a key away from an action.
    pub fn take(&mut self, binding: &Binding, key: Shortcut) {
        let left = self.keys(binding).iter().copied().filter(|other| *other != key).collect();
        self.assign(binding, left);
    }

    /// Other actions that a key would run in a situation where it runs this one. Keys that two actions share from the
    /// start are shared on purpose: arrows go through time while the past is played, and move the camera otherwise.
    pub fn rivals(&self, binding: &Binding, key: Shortcut) -> Vec<Binding> {
        let is_meant = |other: &Binding| binding.usual.contains(&key) && other.usual.contains(&key);
        let is_rival = |other: &Binding| {
            other.name != binding.name
                && other.scope.overlaps(binding.scope)
                && self.keys(other).contains(&key)
                && !is_meant(other)
        };
        bindings().filter(is_rival).collect()
    }

    /// The first key of an action in words; empty where it has none.
    pub fn first(&self, binding: &Binding) -> String {
        self.keys(binding).first().map(Shortcut::words).unwrap_or_default()
    }

    /// All keys of an action in words.
    pub fn words(&self, binding: &Binding) -> String {
        let keys: Vec<String> = self.keys(binding).iter().map(Shortcut::words).collect();
        keys.join(" or ")
    }

    /// A text with the key of an action behind it.
    pub fn tip(&self, text: &str, action: &Command) -> String {
        let key = self.first(&action.binding());
        if key.is_empty() { text.to_owned() } else { format!("{text} ({key})") }
    }
}

/// Where a context has the keys that hold in it.
const KEY: &str = "keys";

/// Tells a context the keys, so that tips show them.
pub fn apply(context: &Context, keys: &Arc<KeyMap>) {
    context.data_mut(|data| data.insert_temp(Id::unique(KEY), Arc::clone(keys)));
}

/// The keys that hold in a context.
pub fn of(context: &Context) -> Arc<KeyMap> {
    context.data(|data| data.get_temp(Id::unique(KEY))).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::super::{ctrl, key, panels};
    use super::*;
    use egui::Key;

    #[test]
    fn assigned_keys_come_back_and_what_is_no_key_is_left_out() {
        let mut keys = KeyMap::default();
        let quit = panels::QUIT.binding();
        keys.assign(&quit, vec![ctrl(Key::Plus), key(Key::F10), key(Key::F10)]);
        assert_eq!(keys.words(&quit), "Ctrl++ or F10");
        let text = toml::to_string(&keys).unwrap();
        assert_eq!(toml::from_str::<KeyMap>(&text).unwrap(), keys);
        let damaged: KeyMap = toml::from_str(&text.replace("Ctrl++", "Hyper+7")).unwrap();
        assert_eq!(damaged.words(&quit), "F10");
        keys.assign(&quit, quit.usual.to_vec());
        assert!(keys.is_all_usual(), "usual keys are not stored");
    }
}
