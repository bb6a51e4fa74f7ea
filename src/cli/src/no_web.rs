//! The web page, in a program without it: no options and no server.

use crate::Failure;
use crate::served_at::ServedAt;
use city3d_session::{Session, SessionHandle, Source};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use std::sync::Arc;

#[derive(Clone, Debug, Default, Args)]
pub struct WebArgs {}

#[allow(dead_code, reason = "nothing is served")]
pub struct PagedCity<'a> {
    pub experiment: &'a Arc<Experiment>,
    #[cfg(feature = "render")]
    pub look: &'a crate::look::LookArgs,
}

#[derive(Debug)]
pub struct ServedPage;

impl WebArgs {
    #[allow(
        clippy::unused_self,
        clippy::unnecessary_wraps,
        reason = "the same call with and without the page"
    )]
    pub fn place(&self) -> Result<Option<ServedAt>, Failure> {
        Ok(None)
    }
}

#[allow(clippy::unnecessary_wraps, reason = "the same call with and without the page")]
pub fn attach<S: Source>(
    _: Option<&mut ServedAt>,
    session: Session<S>,
    _: &PagedCity<'_>,
) -> Result<(Session<S>, ServedPage), Failure> {
    Ok((session, ServedPage))
}

#[allow(clippy::unused_self, clippy::unnecessary_wraps, reason = "the same calls with and without the page")]
impl ServedPage {
    pub fn open(&self, _: &SessionHandle) {}

    pub fn say(&self) -> Result<(), Failure> {
        Ok(())
    }
}
