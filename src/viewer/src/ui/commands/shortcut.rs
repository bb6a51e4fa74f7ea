//! Keys with modifiers, and their names.

use egui::{InputState, Key, Modifiers};

/// A key with the modifiers that have to be held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shortcut {
    key: Key,
    ctrl: bool,
    shift: bool,
}

/// A key alone.
pub const fn key(key: Key) -> Shortcut {
    Shortcut { key, ctrl: false, shift: false }
}

/// A key with Ctrl.
pub const fn ctrl(key: Key) -> Shortcut {
    Shortcut { key, ctrl: true, shift: false }
}

/// A key with Shift.
pub const fn shift(key: Key) -> Shortcut {
    Shortcut { key, ctrl: false, shift: true }
}

const CTRL: &str = "Ctrl+";
const SHIFT: &str = "Shift+";

impl Shortcut {
    /// What a key press is, Alt aside.
    pub fn of_press(key: Key, modifiers: Modifiers) -> Self {
        Self { key, ctrl: modifiers.command, shift: modifiers.shift }
    }

    /// The same, with Shift.
    pub const fn with_shift(self) -> Self {
        Self { shift: true, ..self }
    }

    /// Whether a key press is this shortcut.
    pub fn is_pressed(&self, key: Key, modifiers: Modifiers) -> bool {
        let held = (modifiers.command, modifiers.shift, modifiers.alt);
        key == self.key && held == (self.ctrl, self.shift, false)
    }

    /// Whether its key is held.
    pub fn is_down(&self, input: &InputState) -> bool {
        input.key_down(self.key)
    }

    /// The key without its modifiers.
    pub fn key(&self) -> Key {
        self.key
    }

    /// Whether it is a key alone.
    pub fn is_plain(&self) -> bool {
        !self.ctrl && !self.shift
    }

    /// In words, as in `Ctrl+Shift+R`.
    pub fn words(&self) -> String {
        let ctrl = if self.ctrl { CTRL } else { "" };
        let shift = if self.shift { SHIFT } else { "" };
        format!("{ctrl}{shift}{}", name(self.key))
    }

    /// The shortcut of such words; `None` where they name no key.
    pub fn from_words(words: &str) -> Option<Self> {
        let after_ctrl = words.strip_prefix(CTRL);
        let rest = after_ctrl.unwrap_or(words);
        let after_shift = rest.strip_prefix(SHIFT);
        let wanted = after_shift.unwrap_or(rest);
        let key = Key::ALL.iter().copied().find(|key| name(*key) == wanted)?;
        Some(Self { key, ctrl: after_ctrl.is_some(), shift: after_shift.is_some() })
    }
}

/// As on the key, in plain characters.
fn name(key: Key) -> &'static str {
    match key {
        Key::PageUp => "PgUp",
        Key::PageDown => "PgDn",
        Key::Escape => "Esc",
        Key::Minus => "-",
        Key::ArrowLeft | Key::ArrowRight | Key::ArrowUp | Key::ArrowDown => key.name(),
        _ => key.symbol_or_name(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_comes_back_from_its_words() {
        for &of in Key::ALL {
            for shortcut in [key(of), ctrl(of), shift(of), ctrl(of).with_shift()] {
                assert_eq!(Shortcut::from_words(&shortcut.words()), Some(shortcut), "{}", shortcut.words());
            }
        }
        assert_eq!(Shortcut::from_words("Ctrl+Nothing"), None);
        assert_eq!(Shortcut::from_words(""), None);
    }
}
