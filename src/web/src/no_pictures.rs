//! Pictures, in a program that draws none.

use crate::message::PageView;
use crate::picture::Picture;
use city3d_session::PublishedState;
use std::sync::{Arc, OnceLock};

#[derive(Debug)]
pub(crate) struct Pictures;

#[allow(clippy::unused_self, reason = "the same calls with and without pictures")]
impl Pictures {
    pub(crate) fn new(_: Arc<OnceLock<PublishedState>>) -> Self {
        Self
    }

    pub(crate) fn stop(&self) {}

    pub(crate) fn are_drawn(&self) -> bool {
        false
    }

    pub(crate) fn failure(&self) -> Option<String> {
        Some("this program was built without pictures".to_owned())
    }

    pub(crate) fn look(&self, _: PageView, _: [u32; 2], _: bool) -> Option<Look> {
        None
    }
}

#[derive(Debug)]
pub(crate) enum Look {}

impl Look {
    pub(crate) fn seen(&mut self) {
        match *self {}
    }

    #[allow(clippy::unused_async, reason = "the same call with and without pictures")]
    pub(crate) async fn next(&mut self) -> Option<(Picture, u64)> {
        match *self {}
    }
}
