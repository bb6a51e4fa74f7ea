//! Pictures of the renderer: geometry, light, shadows, and the kinds of ground truth.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "looks at what a run came to; no state depends on it"
)]

#[allow(dead_code, reason = "each test uses its own part")]
#[path = "../../../../tests/support/drawing.rs"]
mod drawing;
mod images;
mod instances;
mod kinds;
mod light;
mod overlay;
mod signals;
mod weather;
