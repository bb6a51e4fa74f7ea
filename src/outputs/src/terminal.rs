//! Text that is safe to show on a terminal, wherever it comes from.

use std::borrow::Cow;

/// Text with control characters, and those that change the direction of text, as escapes (`\u{1b}`). Line ends and tabs
/// stay.
pub fn visible(text: &str) -> Cow<'_, str> {
    if !text.contains(is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        if is_escaped(character) {
            shown.extend(character.escape_unicode());
        } else {
            shown.push(character);
        }
    }
    Cow::Owned(shown)
}

fn is_escaped(character: char) -> bool {
    match character {
        '\n' | '\t' => false,
        // Marks, separators, embeddings, overrides and isolates of the bidirectional algorithm (Unicode, annex 9).
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => true,
        other => other.is_control(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_controls_a_terminal_is_shown() {
        assert_eq!(visible("caf\u{e9} 1\t2\n\u{2014}"), "caf\u{e9} 1\t2\n\u{2014}");
        assert_eq!(visible("a\u{1b}[31mb\rc\u{7}"), "a\\u{1b}[31mb\\u{d}c\\u{7}");
        assert_eq!(visible("\u{9b}2J\u{7f}\u{202e}x"), "\\u{9b}2J\\u{7f}\\u{202e}x");
    }
}
