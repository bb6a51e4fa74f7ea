//! Instrumentation of a served city for `bench link`: time stamps of datagrams and ticks.

#[cfg(feature = "render")]
use super::Failure;
#[cfg(feature = "render")]
use super::pictures::PictureThread;
#[cfg(feature = "render")]
use super::serve::ServeArgs;
use crate::snapshot::VehicleId;
#[cfg(feature = "render")]
use clap::{Args, Command, FromArgMatches};
use std::sync::mpsc::Sender;
use std::time::Instant;

#[cfg(feature = "render")]
impl ServeArgs {
    /// Parses arguments as of a command line.
    ///
    /// # Errors
    /// When the arguments are invalid.
    pub(super) fn of(arguments: &[&str]) -> Result<Self, Failure> {
        let command = Self::augment_args(Command::new("serve").no_binary_name(true));
        let found = command.try_get_matches_from(arguments).map_err(Failure::bad_input)?;
        Self::from_arg_matches(&found).map_err(Failure::bad_input)
    }
}

/// Probes of a served city.
#[derive(Debug, Default)]
pub(super) struct Instruments {
    pub(super) marks: Option<Sender<TimingMark>>,
    #[cfg(feature = "render")]
    pub(super) pictures: Option<PictureThread>,
}

/// Time stamps of an event inside a served city.
#[cfg_attr(not(feature = "render"), allow(dead_code, reason = "the bench alone reads them"))]
#[derive(Clone, Copy, Debug)]
pub(super) enum TimingMark {
    /// A datagram of trajectories has been queued for the next tick.
    Taken { vehicle: VehicleId, sequence: u32, at: Instant },
    /// A tick is done and its poses have been sent.
    Ticked { tick: u64, due: Instant, begun: Instant, done: Instant, sent: Instant },
}
