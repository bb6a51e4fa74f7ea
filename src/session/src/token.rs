//! The token of the address: who knows it may give orders.

use std::fmt::{self, Write};

/// Bytes of a token that is drawn.
const TOKEN_BYTES: usize = 16;

/// A secret word; comparing it takes the same time whatever is wrong.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl Token {
    /// Draws a token from the system's source of randomness.
    ///
    /// # Errors
    /// Where the system has none.
    pub fn draw() -> Result<Self, std::io::Error> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(std::io::Error::other)?;
        Ok(Self(bytes.iter().fold(String::new(), |mut text, byte| {
            // Writing to a string does not fail.
            let _ = write!(text, "{byte:02x}");
            text
        })))
    }

    /// Whether it is the word that somebody offers.
    pub fn is(&self, offered: &str) -> bool {
        let (own, offered) = (self.0.as_bytes(), offered.as_bytes());
        let differing = own.iter().zip(offered).fold(0, |differing, (a, b)| differing | (a ^ b));
        own.len() == offered.len() && differing == 0
    }

    /// The token, for the address that is told at the start.
    pub fn text(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_whole_token_is_the_token() {
        let (token, other) = (Token::draw().unwrap(), Token::draw().unwrap());
        assert_eq!(token.text().len(), 2 * TOKEN_BYTES);
        assert!(token.is(token.text()));
        for wrong in [other.text(), "", &token.text()[1..], &format!("{}0", token.text())] {
            assert!(!token.is(wrong), "{wrong}");
        }
        assert!(!format!("{token:?}").contains(token.text()));
    }
}
