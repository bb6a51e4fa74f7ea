//! Why datagrams and parts of them are dropped, and how often.

use super::{DecodeError, Fault};
use serde::Serialize;
use std::collections::BTreeMap;

/// Why something that came over the link was not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DropReason {
    /// No datagram of this link, or damaged.
    Malformed,
    /// A number that is none, or infinite.
    NotFinite,
    /// Of another version of the link.
    Version,
    /// Without the shared key, or made with another one.
    Unauthenticated,
    /// From an address that is not on the list of senders.
    ForeignSender,
    /// For another city, or for the one before a restart.
    OtherCity,
    /// It has come already.
    Duplicate,
    /// A newer trajectory of the vehicle has come before.
    Reordered,
    /// All of a trajectory lies in the past, or the datagram is far behind the newest of its sender.
    Stale,
    /// There is no vehicle of this number.
    UnknownVehicle,
    /// The vehicle belongs to another sender, or another sender leads the experiment.
    NotYours,
    /// What the city sends, sent to the city.
    WrongWay,
    /// The sender sends faster than it may.
    TooFast,
    /// The city has not kept up, or has as many senders as it may.
    Full,
    /// A barrier before all datagrams that it speaks of.
    Incomplete,
}

impl DropReason {
    /// As it is called in words.
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
            Self::Stale => "stale",
            Self::UnknownVehicle => "for an unknown vehicle",
            Self::NotYours => "for what another sender leads",
            Self::WrongWay => "the wrong way",
            Self::TooFast => "too fast",
            Self::Full => "beyond what the queue holds",
            Self::Incomplete => "before others of their tick",
        }
    }
}

impl From<&DecodeError> for DropReason {
    fn from(error: &DecodeError) -> Self {
        match error.fault {
            Fault::NotFinite => Self::NotFinite,
            Fault::Version { .. } => Self::Version,
            Fault::Unauthenticated | Fault::NoKey => Self::Unauthenticated,
            _ => Self::Malformed,
        }
    }
}

/// How many were dropped, by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Drops(BTreeMap<DropReason, u64>);

impl Drops {
    pub fn count(&mut self, reason: DropReason) {
        *self.0.entry(reason).or_default() += 1;
    }

    pub fn of(&self, reason: DropReason) -> u64 {
        self.0.get(&reason).copied().unwrap_or(0)
    }

    pub fn total(&self) -> u64 {
        self.0.values().sum()
    }

    /// Adds those of another count.
    pub fn add(&mut self, other: &Self) {
        for (reason, count) in &other.0 {
            *self.0.entry(*reason).or_default() += count;
        }
    }

    pub fn iter(&self) -> impl Iterator<Item = (DropReason, u64)> + '_ {
        self.0.iter().map(|(reason, count)| (*reason, *count))
    }
}
