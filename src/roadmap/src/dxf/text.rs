//! Encodes and decodes text of a DXF file of release 2000.

use std::fmt::Write;

/// Text for a file: characters outside ASCII as `\U+XXXX` in UTF-16 units, control characters in
/// caret notation, a caret itself with a space behind it.
pub(super) fn encode(text: &str) -> String {
    let mut encoded = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '^' => encoded.push_str("^ "),
            '\0'..='\u{1f}' => {
                encoded.push('^');
                encoded.push(char::from(character as u8 + b'@'));
            }
            ' '..='~' => encoded.push(character),
            _ => {
                for unit in character.encode_utf16(&mut [0; 2]) {
                    // Writing to a string cannot fail.
                    let _ = write!(encoded, "\\U+{unit:04X}");
                }
            }
        }
    }
    encoded
}

/// The inverse of [`encode`]. Bytes that are not UTF-8 are taken as Latin-1, the western code page.
pub(super) fn decode(bytes: &[u8]) -> String {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    };
    let mut units = Vec::with_capacity(text.len());
    let mut rest = text.as_str();
    while let Some(character) = rest.chars().next() {
        if let Some(unit) = rest.strip_prefix("\\U+").and_then(|r| r.get(..4)).and_then(hex_unit) {
            units.push(unit);
            rest = &rest[7..];
            continue;
        }
        rest = &rest[character.len_utf8()..];
        match (character, rest.bytes().next()) {
            ('^', Some(b' ')) => {
                units.push(u16::from(b'^'));
                rest = &rest[1..];
            }
            ('^', Some(letter @ b'@'..=b'_')) => {
                units.push(u16::from(letter - b'@'));
                rest = &rest[1..];
            }
            _ => units.extend_from_slice(character.encode_utf16(&mut [0; 2])),
        }
    }
    String::from_utf16_lossy(&units)
}

fn hex_unit(digits: &str) -> Option<u16> {
    digits.bytes().all(|b| b.is_ascii_hexdigit()).then(|| u16::from_str_radix(digits, 16).ok()).flatten()
}

/// The plain text of an MTEXT: formatting codes dropped, paragraphs and line breaks as spaces.
pub(super) fn without_formatting(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut characters = text.chars();
    while let Some(character) = characters.next() {
        match character {
            '{' | '}' => {}
            '\\' => match characters.next() {
                Some('P' | 'N' | '~') => plain.push(' '),
                Some(escaped @ ('\\' | '{' | '}')) => plain.push(escaped),
                // Codes with an argument, which a semicolon ends.
                Some('A' | 'C' | 'c' | 'f' | 'F' | 'H' | 'Q' | 'T' | 'W' | 'p' | 'S') => {
                    for skipped in characters.by_ref() {
                        if skipped == ';' {
                            break;
                        }
                    }
                }
                _ => {}
            },
            _ => plain.push(character),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_survives_the_file() {
        for text in ["west-street/south/1", "Café ^ x\nü", "bus \u{1F68C}", "^J", "100% \\Users", ""] {
            let encoded = encode(text);
            assert!(encoded.is_ascii() && !encoded.contains('\n'));
            assert_eq!(decode(encoded.as_bytes()), text);
        }
        assert_eq!(decode(b"Caf\xe9"), "Café");
        assert_eq!(decode("Café \\U+".as_bytes()), "Café \\U+");
    }

    #[test]
    fn formatting_is_dropped() {
        assert_eq!(without_formatting(r"{\fArial|b0;fire\Pstation} h=0.3"), "fire station h=0.3");
        assert_eq!(without_formatting(r"a\\b\H0.5x;c\"), r"a\bc");
    }
}
