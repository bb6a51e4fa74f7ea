//! Aspects of traffic signals.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Number of a signal head: its index in the signals of the experiment's map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct SignalHeadId(pub u32);

impl SignalHeadId {
    /// Position of the head in the list of all heads.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for SignalHeadId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "signal head {}", self.0)
    }
}

/// What a signal head shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Aspect {
    /// No lamp: nobody has commanded the head yet.
    #[default]
    Dark = 0,
    /// Traffic waits at the line.
    Red = 1,
    /// Traffic that can stop comfortably waits at the line.
    Yellow = 2,
    /// Traffic may pass, and left turns give way to oncoming traffic.
    Green = 3,
}

impl Aspect {
    /// In the order of their numbers.
    pub const ALL: [Self; 4] = [Self::Dark, Self::Red, Self::Yellow, Self::Green];

    /// The name that files and the screen use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dark => "dark",
            Self::Red => "red",
            Self::Yellow => "yellow",
            Self::Green => "green",
        }
    }
}

/// New aspects of some signal heads.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SignalAspects {
    /// Simulated time of the control step that decided; older ones than the newest are dropped.
    pub stamp_s: f64,
    /// In id order.
    pub heads: Vec<(SignalHeadId, Aspect)>,
}

impl SignalAspects {
    /// Most heads of one command: one datagram holds them.
    pub const MOST: usize = 200;
}
