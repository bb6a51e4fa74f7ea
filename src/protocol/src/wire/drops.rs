//! Reasons for dropping datagrams and parts of them, and their counters.

use super::{DecodeError, DecodeFault};
use serde::Serialize;
use std::collections::BTreeMap;

/// Reason for dropping a datagram, or a command of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DropReason {
    /// Not a datagram of this link, or damaged.
    Malformed,
    /// A number is infinite or NaN.
    NotFinite,
    /// Another version of the wire format.
    Version,
    /// Without the shared key, or with another one.
    Unauthenticated,
    /// The address is not on the allow list.
    ForeignSender,
    /// For another city, for this one before its restart, or from an address that has not answered a challenge.
    OtherCity,
    /// Replay: the sequence number has come already.
    Duplicate,
    /// A newer trajectory of the vehicle, or newer pedals, came before.
    Reordered,
    /// The pose was measured later than now: the clocks differ.
    Ahead,
    /// The whole trajectory lies in the past, or the sequence number is older than the anti-replay window.
    Stale,
    /// No vehicle has this number.
    UnknownVehicle,
    /// The vehicle belongs to another sender, or another sender leads the experiment.
    NotYours,
    /// A body that only cities send, sent to a city.
    WrongWay,
    /// The sender exceeds its rate limit.
    TooFast,
    /// A bounded queue or the table of senders is full.
    Full,
    /// A barrier came before all datagrams that it counts.
    Incomplete,
}

impl DropReason {
    /// The reason in words.
    pub fn label(self) -> &'static str {
        match self {
            Self::Malformed => "malformed",
            Self::NotFinite => "not finite",
            Self::Version => "of another version",
            Self::Unauthenticated => "not authenticated",
            Self::ForeignSender => "from a foreign sender",
            Self::OtherCity => "for another city",
            Self::Duplicate => "duplicate",
            Self::Reordered => "reordered",
            Self::Ahead => "ahead of the clock",
            Self::Stale => "stale",
            Self::UnknownVehicle => "for an unknown vehicle",
            Self::NotYours => "without permission",
            Self::WrongWay => "of a kind that only the city sends",
            Self::TooFast => "over the rate limit",
            Self::Full => "beyond the queue's capacity",
            Self::Incomplete => "of an incomplete tick",
        }
    }
}

impl From<&DecodeError> for DropReason {
    fn from(error: &DecodeError) -> Self {
        match error.fault {
            DecodeFault::NotFinite => Self::NotFinite,
            DecodeFault::Version { .. } => Self::Version,
            DecodeFault::Unauthenticated | DecodeFault::NoKey => Self::Unauthenticated,
            _ => Self::Malformed,
        }
    }
}

/// Number of drops by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct DropCounts(BTreeMap<DropReason, u64>);

impl DropCounts {
    /// Adds one drop.
    pub fn count(&mut self, reason: DropReason) {
        *self.0.entry(reason).or_default() += 1;
    }

    /// Number of drops for one reason.
    pub fn of(&self, reason: DropReason) -> u64 {
        self.0.get(&reason).copied().unwrap_or(0)
    }

    /// Number of drops for all reasons together.
    pub fn total(&self) -> u64 {
        self.0.values().sum()
    }

    /// Adds the counts of another counter.
    pub fn add(&mut self, other: &Self) {
        for (reason, count) in &other.0 {
            *self.0.entry(*reason).or_default() += count;
        }
    }

    /// The reasons that have occurred, in the order of [`DropReason`], with their numbers of drops.
    pub fn iter(&self) -> impl Iterator<Item = (DropReason, u64)> + '_ {
        self.0.iter().map(|(reason, count)| (*reason, *count))
    }
}
