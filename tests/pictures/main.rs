//! Pictures as the program takes them: camera frames, video, the window, and the golden pictures.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "looks at what a run came to; no state depends on it"
)]

mod frames;
mod motion;
mod served_window;
#[path = "../support/mod.rs"]
mod support;
mod video;
mod visual;
mod window;
mod window_page;
mod window_pictures;
mod workbench;
