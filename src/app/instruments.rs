//! What a served city has for a measurement: when things happen in it.

#[cfg(feature = "render")]
use super::Failure;
#[cfg(feature = "render")]
use super::pictures::Pictures;
#[cfg(feature = "render")]
use super::serve::ServeArgs;
use crate::snapshot::VehicleId;
#[cfg(feature = "render")]
use clap::{Args, Command, FromArgMatches};
use std::sync::mpsc::Sender;
use std::time::Instant;

#[cfg(feature = "render")]
impl ServeArgs {
    /// As of a command line.
    ///
    /// # Errors
    /// Where they are none.
    pub(super) fn of(arguments: &[&str]) -> Result<Self, Failure> {
        let command = Self::augment_args(Command::new("serve").no_binary_name(true));
        let found = command.try_get_matches_from(arguments).map_err(Failure::bad_input)?;
        Self::from_arg_matches(&found).map_err(Failure::bad_input)
    }
}

/// What a served city has for a measurement.
#[derive(Debug, Default)]
pub(super) struct Instruments {
    pub(super) marks: Option<Sender<Mark>>,
    #[cfg(feature = "render")]
    pub(super) pictures: Option<Pictures>,
}

/// When something has happened in it.
#[cfg_attr(not(feature = "render"), allow(dead_code, reason = "the bench alone reads them"))]
#[derive(Clone, Copy, Debug)]
pub(super) enum Mark {
    /// A datagram of trajectories waits for the next tick.
    Taken { vehicle: VehicleId, sequence: u32, at: Instant },
    /// The world has made the step that leads to a tick, and its poses have been sent.
    Ticked { tick: u64, due: Instant, begun: Instant, done: Instant, sent: Instant },
}
