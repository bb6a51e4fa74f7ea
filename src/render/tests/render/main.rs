//! Pictures of the renderer: geometry, light, shadows, and the kinds of ground truth.

#[path = "../../../../tests/support/drawing.rs"]
mod drawing;
mod images;
mod kinds;
mod light;
