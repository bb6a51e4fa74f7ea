//! The person at the wheel: from keys, gamepads and steering wheels to pedals and steering.

mod device;
mod devices;
mod driver;
mod learn;

pub use device::{Control, Device, Function, Lever, Levers, Profile, Steering};
pub use devices::{DeviceEvent, Devices, Plug};
pub use driver::{Driver, Handling, Hands, Keys};
pub use learn::{Assignment, Learner};
