//! Manual driving: keys, gamepads and steering wheels become pedals and steering.

mod calibration;
mod device;
mod devices;
mod driver;

pub use calibration::{Assignment, Calibrator};
pub use device::{
    ControlFunction, Device, DeviceControl, DeviceProfile, LeverCalibration, LeverPositions,
    SteeringCalibration,
};
pub use devices::{DeviceEvent, DeviceInfo, Devices};
pub use driver::{DriverInput, HeldKeys, ManualDriver, SteeringGeometry};
