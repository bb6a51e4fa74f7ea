//! The person at the wheel: from keys to pedals and steering, with the ramps that a foot and a hand have.

mod keyboard;

pub use keyboard::{Handling, KeyboardDriver, Keys};
