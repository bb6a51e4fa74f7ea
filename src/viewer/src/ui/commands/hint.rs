//! What has to be done before an action can be run.

use super::{Command, KeyMap};

/// A sentence, and the action that does what it says; its key is told behind the sentence.
#[derive(Clone, Copy, Debug)]
pub struct Hint {
    words: &'static str,
    action: Option<&'static Command>,
}

impl PartialEq for Hint {
    fn eq(&self, other: &Self) -> bool {
        self.words == other.words
    }
}

impl Eq for Hint {}

impl Hint {
    /// A sentence alone.
    pub const fn new(words: &'static str) -> Self {
        Self { words, action: None }
    }

    /// With the action that does it.
    pub const fn by(words: &'static str, action: &'static Command) -> Self {
        Self { words, action: Some(action) }
    }

    /// The sentence, with the key of its action.
    pub fn words(&self, keys: &KeyMap) -> String {
        match self.action {
            Some(action) => keys.tip(self.words, action),
            None => self.words.to_owned(),
        }
    }
}
