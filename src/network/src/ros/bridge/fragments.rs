//! Reassembly of fragmented messages: `op: fragment` of the rosbridge protocol 2.0, section 3.2.2.

use super::MAX_MESSAGE_BYTES;
use serde::Deserialize;
use serde_json::Value;
use std::collections::VecDeque;

/// Incomplete messages in the buffer; the oldest is dropped for another.
const MAX_INCOMPLETE: usize = 16;
/// Most fragments of one message.
const MAX_FRAGMENTS: usize = 4096;

/// Fragment of a message.
#[derive(Deserialize)]
pub(super) struct Fragment {
    id: Value,
    data: String,
    num: usize,
    total: usize,
}

/// Reassembly buffer of incomplete messages.
#[derive(Default)]
pub(super) struct FragmentReassembly {
    /// Fragments by id, oldest message first.
    begun: VecDeque<(String, Vec<Option<String>>)>,
}

impl FragmentReassembly {
    /// Adds a fragment; returns the message when it is complete.
    pub(super) fn take(&mut self, Fragment { id, data, num, total }: Fragment) -> Option<String> {
        let id = id.to_string();
        if total == 0 || total > MAX_FRAGMENTS || num >= total {
            return None;
        }
        let index = self.begun.iter().position(|(other, parts)| *other == id && parts.len() == total);
        let index = index.unwrap_or_else(|| {
            if self.begun.len() >= MAX_INCOMPLETE {
                self.begun.pop_front();
            }
            self.begun.push_back((id, Vec::new()));
            self.begun.len() - 1
        });
        let (_, parts) = self.begun.get_mut(index)?;
        parts.resize(total, None);
        parts[num] = Some(data);
        let length: usize = parts.iter().flatten().map(String::len).sum();
        if length > MAX_MESSAGE_BYTES {
            self.begun.remove(index);
            return None;
        }
        let whole: Option<String> = parts.iter().map(Option::as_deref).collect();
        whole.inspect(|_| drop(self.begun.remove(index)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(id: &str, data: &str, num: usize, total: usize) -> Fragment {
        Fragment { id: id.into(), data: data.to_owned(), num, total }
    }

    #[test]
    fn fragments_make_a_whole_in_any_order() {
        let mut fragments = FragmentReassembly::default();
        assert_eq!(fragments.take(part("a", "lo", 1, 2)), None);
        assert_eq!(fragments.take(part("b", "x", 0, 2)), None);
        assert_eq!(fragments.take(part("a", "hel", 0, 2)), Some("hello".to_owned()));
        assert_eq!(fragments.take(part("b", "y", 1, 2)), Some("xy".to_owned()));
        assert!(fragments.begun.is_empty());
    }

    #[test]
    fn fragments_that_never_end_take_no_more_than_so_much_room() {
        let mut fragments = FragmentReassembly::default();
        for k in 0..1000 {
            assert_eq!(fragments.take(part(&k.to_string(), "x", 0, 2)), None);
        }
        assert_eq!(fragments.begun.len(), MAX_INCOMPLETE);
        for (num, total) in [(0, 0), (2, 2), (0, usize::MAX)] {
            assert_eq!(fragments.take(part("wrong", "x", num, total)), None);
        }
        let long = "x".repeat(MAX_MESSAGE_BYTES / 2 + 1);
        assert_eq!(fragments.take(part("long", &long, 0, 3)), None);
        assert_eq!(fragments.take(part("long", &long, 1, 3)), None);
        assert_eq!(fragments.take(part("long", "", 2, 3)), None);
    }
}
