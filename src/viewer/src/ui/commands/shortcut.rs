//! Keys with modifiers, and their names.

use egui::{Key, Modifiers};

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

impl Shortcut {
    /// The same, with Shift.
    pub const fn with_shift(self) -> Self {
        Self { shift: true, ..self }
    }

    /// Whether a key press is this shortcut.
    pub fn is_pressed(&self, key: Key, modifiers: Modifiers) -> bool {
        let held = (modifiers.command, modifiers.shift, modifiers.alt);
        key == self.key && held == (self.ctrl, self.shift, false)
    }

    /// In words, as in `Ctrl+Shift+R`.
    pub fn words(&self) -> String {
        let ctrl = if self.ctrl { "Ctrl+" } else { "" };
        let shift = if self.shift { "Shift+" } else { "" };
        format!("{ctrl}{shift}{}", name(self.key))
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
