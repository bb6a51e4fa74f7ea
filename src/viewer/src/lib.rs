//! The window: its panels, the cockpit of a person who drives, and the viewpoints on the city.

#![allow(clippy::disallowed_types, reason = "has the event loop, its clock and its threads")]

pub mod cockpit;
pub mod ui;
pub mod window;
