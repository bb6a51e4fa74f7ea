//! A web page as an end of a city that runs: a small HTTP and WebSocket server on a thread of its own. It reads the
//! latest state that the session publishes, so that nothing that a browser does can delay the city. Whoever has the
//! token of the address gives orders; all others watch.

#![allow(clippy::disallowed_types, reason = "has the sockets and the threads of the page")]

mod client;
mod control;
mod counters;
mod feed;
#[cfg(all(feature = "h264", feature = "render"))]
mod h264;
#[cfg(not(all(feature = "h264", feature = "render")))]
#[path = "no_h264.rs"]
mod h264;
mod http;
mod message;
mod picture;
#[cfg(feature = "render")]
mod pictures;
#[cfg(not(feature = "render"))]
#[path = "no_pictures.rs"]
mod pictures;
mod server;

/// For measurements: `benches/codecs.rs`.
#[cfg(all(feature = "h264", feature = "render"))]
#[doc(hidden)]
pub mod codecs {
    pub use crate::h264::ViewEncoder;
    pub use crate::picture::{Picture, PictureKind};
}

pub use client::PATIENCE;
pub use control::PageOrders;
pub use counters::WebCounts;
#[cfg(feature = "render")]
pub use pictures::PictureDrawer;
pub use server::{WebEnd, WebError, WebOptions, WebServer};
