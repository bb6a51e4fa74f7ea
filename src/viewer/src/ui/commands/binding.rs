//! What keys can be assigned to, and where they work.

use super::Shortcut;

/// Situations of a window in which keys do something. Two actions may share a key where no situation has both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scope(u8);

impl Scope {
    /// A run that goes on is watched.
    pub const LIVE: Self = Self(1);
    /// A person drives from this window.
    pub const DRIVING: Self = Self(2);
    /// The scenario is edited.
    pub const EDITING: Self = Self(4);
    /// A recorded run, or the past of one that goes on, is played.
    pub const PLAYED: Self = Self(8);
    /// All of them.
    pub const ALL: Self = Self(15);

    /// These situations, and those.
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether some situation is in both.
    pub const fn overlaps(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

/// How a key works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyUse {
    /// A press runs an action.
    Pressed,
    /// It acts while it is held, as a pedal does.
    Held,
    /// A press, by a key that dialogs and text fields know too: it cannot be assigned.
    Fixed,
}

/// An action or a held key, with its usual keys.
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    /// What it does; the settings know it by this name.
    pub name: &'static str,
    /// The keys that it has until the user assigns others.
    pub usual: &'static [Shortcut],
    /// Where it works.
    pub scope: Scope,
    /// How it works.
    pub key_use: KeyUse,
}

impl Binding {
    /// Keys that act while they are held.
    pub const fn held(name: &'static str, usual: &'static [Shortcut], scope: Scope) -> Self {
        Self { name, usual, scope, key_use: KeyUse::Held }
    }
}
