//! Ends of a session: what is attached to a city that runs. Each has a bounded queue and a failure of its own; none
//! delays or ends the city.

use super::{EndStatus, Moment};
use city3d_simulation::runner::{EndSummary, LinkSummary};
use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Arc;

/// Something that is told the moments of a city: files, subscribers, a window.
pub trait End: Send {
    /// Name in messages and in `summary.json`.
    fn name(&self) -> &'static str;

    /// A step is about to be made from this moment, which names what led here since the run began.
    fn prepare(&mut self, _before: &Moment<'_>) {}

    /// Takes a moment. It must not wait: what finds no room is dropped and counted.
    fn take(&mut self, moment: &Moment<'_>);

    /// The present run ends with this moment, and another may follow.
    fn finish_run(&mut self, _last: &Moment<'_>, _account: &RunAccount) {}

    /// The session ends: whatever is still on its way may be waited for, but not for ever.
    fn close(&mut self) {}

    /// How it does, and what it has dropped.
    fn health(&self) -> EndHealth;

    /// Whether it logs its failures itself, with what it knows of them.
    fn says_failures(&self) -> bool {
        false
    }
}

/// Why an end does not work: an error of its own, with what caused it. Copies share it.
#[derive(Clone, Debug)]
pub struct EndFailure(Arc<dyn Error + Send + Sync>);

impl EndFailure {
    /// An end fails with this error.
    pub fn new(error: impl Error + Send + Sync + 'static) -> Self {
        Self(Arc::new(error))
    }
}

impl Error for EndFailure {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.source()
    }
}

impl std::fmt::Display for EndFailure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// Whether an end works.
#[derive(Clone, Debug, Default)]
pub struct EndHealth {
    /// Moments, or what they became, that have gone out.
    pub delivered: u64,
    /// Those that have not: there was no room for them, or the end had failed.
    pub dropped: u64,
    /// Why it does not work now; `None` while it does.
    pub failure: Option<EndFailure>,
}

/// What a session has counted when a run ends.
#[derive(Clone, Debug, Default)]
pub struct RunAccount {
    /// Statistics of the link, where there is one.
    pub link: Option<LinkSummary>,
    /// Of each end.
    pub ends: BTreeMap<&'static str, EndSummary>,
    /// The run was stopped before its end.
    pub is_stopped: bool,
}

/// The ends of a session, in the order in which they are told.
#[derive(Default)]
pub(crate) struct Ends {
    ends: Vec<AttachedEnd>,
}

struct AttachedEnd {
    end: Box<dyn End>,
    /// Its present failure has been said.
    is_said: bool,
    /// How often it has failed.
    failures: u64,
}

impl Ends {
    /// Attaches an end. Those that somebody waits for come first.
    pub(crate) fn attach(&mut self, end: Box<dyn End>) {
        self.ends.push(AttachedEnd { end, is_said: false, failures: 0 });
    }

    pub(crate) fn prepare(&mut self, before: &Moment<'_>) {
        self.ends.iter_mut().for_each(|attached| attached.end.prepare(before));
    }

    pub(crate) fn take(&mut self, moment: &Moment<'_>) {
        self.ends.iter_mut().for_each(|attached| attached.end.take(moment));
    }

    pub(crate) fn finish_run(&mut self, last: &Moment<'_>, account: &RunAccount) {
        self.ends.iter_mut().for_each(|attached| attached.end.finish_run(last, account));
    }

    pub(crate) fn close(&mut self) {
        self.ends.iter_mut().for_each(|attached| attached.end.close());
    }

    /// Says each failure once, and that an end works again.
    pub(crate) fn say_failures(&mut self) {
        for AttachedEnd { end, is_said, failures } in &mut self.ends {
            let failure = end.health().failure;
            match (&failure, *is_said) {
                (Some(why), false) => {
                    *failures += 1;
                    if !end.says_failures() {
                        tracing::warn!("{}: {why}; the city goes on without", end.name());
                    }
                }
                (None, true) if !end.says_failures() => tracing::warn!("{}: works again", end.name()),
                _ => {}
            }
            *is_said = failure.is_some();
        }
    }

    /// Delivered, dropped and failures, by name; of the files only where something is wrong.
    pub(crate) fn summary(&self) -> BTreeMap<&'static str, EndSummary> {
        let of = |attached: &AttachedEnd| {
            let EndHealth { delivered, dropped, failure } = attached.end.health();
            let failure = failure.map(|why| why.to_string());
            EndSummary { delivered, dropped, failures: attached.failures, failure }
        };
        let is_worth_telling = |(name, end): &(&str, EndSummary)| {
            !["files", "progress"].contains(name) || end.dropped + end.failures > 0
        };
        self.ends
            .iter()
            .map(|attached| (attached.end.name(), of(attached)))
            .filter(is_worth_telling)
            .collect()
    }

    /// How each end does, for people.
    pub(crate) fn status(&self) -> Vec<EndStatus> {
        let of = |attached: &AttachedEnd| {
            let EndHealth { delivered, dropped, failure } = attached.end.health();
            let failure = failure.map(|why| why.to_string());
            EndStatus { name: attached.end.name().to_owned(), delivered, dropped, failure }
        };
        self.ends.iter().map(of).collect()
    }

    /// The first failure of an end, if one fails.
    pub(crate) fn failure(&self) -> Option<EndFailure> {
        self.ends.iter().find_map(|attached| attached.end.health().failure)
    }
}
