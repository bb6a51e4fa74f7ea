//! Foxglove, in a program without it: no options and no server.

use crate::Failure;
use crate::served_at::ServedAt;
use city3d_logbook::record::LogOrigin;
use city3d_session::{Session, SessionHandle, Source};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use std::sync::Arc;

#[derive(Clone, Debug, Default, Args)]
pub struct FoxgloveArgs {}

#[allow(dead_code, reason = "nobody is told")]
pub struct OfferedCity<'a> {
    pub experiment: &'a Arc<Experiment>,
    pub origin: LogOrigin,
    pub snapshot_hz: u32,
    #[cfg(feature = "render")]
    pub look: crate::look::LookArgs,
}

#[derive(Debug)]
pub struct ServedFoxglove;

#[allow(clippy::unused_self, clippy::unnecessary_wraps, reason = "the same calls with and without Foxglove")]
impl FoxgloveArgs {
    pub fn place(&self) -> Result<Option<ServedAt>, Failure> {
        Ok(None)
    }

    pub fn attach<S: Source>(
        &self,
        _: Option<&mut ServedAt>,
        session: Session<S>,
        _: OfferedCity<'_>,
    ) -> Result<(Session<S>, ServedFoxglove), Failure> {
        Ok((session, ServedFoxglove))
    }
}

#[allow(clippy::unused_self, clippy::unnecessary_wraps, reason = "the same calls with and without Foxglove")]
impl ServedFoxglove {
    pub fn open(&self, _: &SessionHandle) {}

    pub fn say(&self) -> Result<(), Failure> {
        Ok(())
    }

    pub fn publishing<S: Source>(&self, session: Session<S>) -> Result<Session<S>, Failure> {
        Ok(session)
    }
}
