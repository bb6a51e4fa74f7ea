//! All connected gamepads and steering wheels, and which of them drives.

use super::calibration::Calibrator;
use super::device::{ControlFunction, Device, DeviceControl, DeviceProfile, LeverPositions};
use std::collections::BTreeMap;

/// Description of a device that has just been connected.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceInfo {
    /// Identifies the device across sessions.
    pub key: String,
    /// Name that the operating system gives it.
    pub name: String,
    /// The default mapping.
    pub usual: DeviceProfile,
}

/// A device event. Devices keep their number while they are connected.
#[derive(Clone, Debug, PartialEq)]
pub enum DeviceEvent {
    /// A device is connected and has this number from now on.
    Plugged(usize, DeviceInfo),
    /// The device with this number is disconnected.
    Unplugged(usize),
    /// A control of the device with this number has a new value, uncalibrated.
    Moved(usize, DeviceControl, f64),
    /// Gamepads cannot be read on this machine, for this reason.
    Missing(String),
}

/// The connected devices, and the stored mappings of all devices.
#[derive(Clone, Debug, Default)]
pub struct Devices {
    plugged: BTreeMap<usize, Device>,
    usual: BTreeMap<String, DeviceProfile>,
    /// Mappings that the user has chosen, by device key.
    profiles: BTreeMap<String, DeviceProfile>,
    /// The device that was used last.
    active: Option<usize>,
    is_used: bool,
    pressed: Vec<ControlFunction>,
    learner: Option<(usize, Calibrator)>,
    missing: Option<String>,
}

impl Devices {
    /// Starts with the stored mappings.
    pub fn new(profiles: BTreeMap<String, DeviceProfile>) -> Self {
        Self { profiles, ..Self::default() }
    }

    /// Handles an event at `now_s`; returns a message for the user.
    pub fn take(&mut self, event: DeviceEvent, now_s: f64) -> Option<String> {
        match event {
            DeviceEvent::Plugged(number, plug) => Some(self.plug(number, plug)),
            DeviceEvent::Unplugged(number) => self.unplug(number),
            DeviceEvent::Moved(number, control, value) => {
                self.move_control(number, control, value, now_s);
                None
            }
            DeviceEvent::Missing(reason) => {
                self.missing = Some(reason);
                None
            }
        }
    }

    fn plug(&mut self, number: usize, plug: DeviceInfo) -> String {
        let profile = self.profiles.get(&plug.key).unwrap_or(&plug.usual).clone();
        let lacks = |function| profile.control(function).is_none();
        let text = if lacks(ControlFunction::Steering)
            || lacks(ControlFunction::Gas)
            || lacks(ControlFunction::Brake)
        {
            format!("{} is plugged in: assign its wheel and pedals on the page Gamepad.", plug.name)
        } else {
            format!("{} is plugged in: it drives the vehicle that you take control of.", plug.name)
        };
        self.usual.insert(plug.key.clone(), plug.usual);
        self.plugged.insert(number, Device::new(plug.key, plug.name, profile));
        text
    }

    fn unplug(&mut self, number: usize) -> Option<String> {
        let gone = self.plugged.remove(&number)?;
        if self.learner.as_ref().is_some_and(|(of, _)| *of == number) {
            self.learner = None;
        }
        let was_active = self.active == Some(number);
        if was_active {
            (self.active, self.is_used) = (None, false);
        }
        let then = if was_active { ": its pedals are released, the keyboard drives on" } else { "" };
        Some(format!("{} is unplugged{then}.", gone.name))
    }

    fn move_control(&mut self, number: usize, control: DeviceControl, value: f64, now_s: f64) {
        let Some(device) = self.plugged.get_mut(&number) else { return };
        let pressed = device.take(control, value);
        if let Some((of, learner)) = &mut self.learner {
            // A control that is being calibrated does not drive.
            if *of == number {
                learner.take(control, value, now_s);
            }
            return;
        }
        if device.is_used() || !pressed.is_empty() {
            (self.active, self.is_used) = (Some(number), true);
        }
        self.pressed.extend(pressed);
    }

    /// Devices with their numbers.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &Device)> {
        self.plugged.iter().map(|(number, device)| (*number, device))
    }

    /// The device with this number; `None` while it is not connected.
    pub fn get(&self, number: usize) -> Option<&Device> {
        self.plugged.get(&number)
    }

    /// Why gamepads cannot be read, if that is known.
    pub fn missing(&self) -> Option<&str> {
        self.missing.as_deref()
    }

    /// Functions pressed since the last call.
    pub fn take_pressed(&mut self) -> Vec<ControlFunction> {
        std::mem::take(&mut self.pressed)
    }

    /// Whether a device has been used since the last call.
    pub fn take_used(&mut self) -> bool {
        std::mem::take(&mut self.is_used)
    }

    /// Positions of the device that was used last.
    pub fn levers(&self) -> Option<LeverPositions> {
        self.active.and_then(|number| self.plugged.get(&number)).map(Device::levers)
    }

    /// Whether a button of the device that was used last is held.
    pub fn is_held(&self, function: ControlFunction) -> bool {
        let active = self.active.and_then(|number| self.plugged.get(&number));
        active.is_some_and(|device| device.is_pressed(function))
    }

    /// Starts the calibration of a function on a device.
    pub fn learn(&mut self, number: usize, function: ControlFunction) {
        if let Some(device) = self.plugged.get(&number) {
            self.learner = Some((number, Calibrator::new(function, device.values())));
        }
    }

    /// The device under calibration, and its calibrator.
    pub fn learning(&self) -> Option<(usize, &Calibrator)> {
        self.learner.as_ref().map(|(number, learner)| (*number, learner))
    }

    /// Cancels the calibration, if one is in progress; the mapping stays as it is.
    pub fn stop_learning(&mut self) {
        self.learner = None;
    }

    /// Applies a finished calibration. Returns the functions that lost their control; `None` while it is not
    /// finished.
    pub fn try_finish(&mut self, now_s: f64) -> Option<Vec<ControlFunction>> {
        let (number, learner) = self.learner.as_ref()?;
        let (number, assignment) = (*number, learner.outcome(now_s)?);
        self.learner = None;
        let mut taken = Vec::new();
        self.change(number, |profile| taken = profile.assign(assignment));
        Some(taken)
    }

    /// Changes the mapping of a device, and stores it.
    pub fn change(&mut self, number: usize, change: impl FnOnce(&mut DeviceProfile)) {
        if let Some(device) = self.plugged.get_mut(&number) {
            change(&mut device.profile);
            self.profiles.insert(device.key.clone(), device.profile.clone());
        }
    }

    /// Restores the default mapping of a device.
    pub fn restore(&mut self, number: usize) {
        if let Some(device) = self.plugged.get_mut(&number) {
            self.profiles.remove(&device.key);
            device.profile = self.usual.get(&device.key).cloned().unwrap_or_default();
        }
    }

    /// The mappings to store.
    pub fn profiles(&self) -> &BTreeMap<String, DeviceProfile> {
        &self.profiles
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STICK: DeviceControl = DeviceControl::Axis(0);
    const TRIGGER: DeviceControl = DeviceControl::Button(7);
    const START: DeviceControl = DeviceControl::Button(11);

    fn plug(key: &str) -> DeviceInfo {
        let buttons = [(ControlFunction::Gas, TRIGGER), (ControlFunction::TakeWheel, START)];
        DeviceInfo {
            key: key.to_owned(),
            name: "Pad".to_owned(),
            usual: DeviceProfile::usual(Some(STICK), false, &buttons),
        }
    }

    fn one() -> Devices {
        let mut devices = Devices::default();
        let said = devices.take(DeviceEvent::Plugged(4, plug("a")), 0.0).unwrap();
        assert!(said.contains("assign"), "its brake is nowhere: {said}");
        devices
    }

    #[test]
    fn the_device_that_is_used_drives_and_noise_does_not() {
        let mut devices = one();
        devices.take(DeviceEvent::Plugged(5, plug("b")), 0.0);
        assert_eq!(devices.levers(), None);
        devices.take(DeviceEvent::Moved(5, TRIGGER, 0.05), 1.0);
        assert!(!devices.take_used() && devices.levers().is_none());
        devices.take(DeviceEvent::Moved(4, TRIGGER, 0.7), 1.0);
        assert!(devices.take_used() && !devices.take_used());
        assert_eq!(devices.levers().unwrap().gas, 0.7);
        devices.take(DeviceEvent::Moved(5, START, 1.0), 1.0);
        devices.take(DeviceEvent::Moved(5, START, 0.0), 1.0);
        assert_eq!(devices.take_pressed(), [ControlFunction::TakeWheel], "a short press is not missed");
        assert_eq!(devices.levers().unwrap().gas, 0.05);
    }

    #[test]
    fn one_that_is_unplugged_lets_go_and_comes_back_with_what_was_chosen() {
        let mut devices = one();
        devices.take(DeviceEvent::Moved(4, TRIGGER, 1.0), 1.0);
        devices.change(4, |profile| profile.speed_sensitive = false);
        let said = devices.take(DeviceEvent::Unplugged(4), 2.0).unwrap();
        assert!(said.contains("pedals are released"), "{said}");
        assert_eq!((devices.levers(), devices.take_used()), (None, false));
        devices.take(DeviceEvent::Moved(4, TRIGGER, 1.0), 2.0);
        assert_eq!(devices.take(DeviceEvent::Unplugged(4), 2.0), None);
        devices.take(DeviceEvent::Plugged(9, plug("a")), 3.0);
        assert!(!devices.get(9).unwrap().profile.speed_sensitive);
        devices.restore(9);
        assert!(devices.get(9).unwrap().profile.speed_sensitive && devices.profiles().is_empty());
    }

    #[test]
    fn what_is_found_out_is_kept_and_does_not_drive_meanwhile() {
        let mut devices = one();
        devices.learn(4, ControlFunction::Brake);
        for (time_s, value) in [(1.0, -1.0), (1.1, 0.9), (1.2, -1.0)] {
            devices.take(DeviceEvent::Moved(4, DeviceControl::Axis(3), value), time_s);
            assert_eq!(devices.try_finish(time_s), None);
        }
        devices.take(DeviceEvent::Moved(4, START, 0.4), 1.2);
        assert_eq!(devices.try_finish(2.0), Some(Vec::new()));
        assert!(devices.learning().is_none() && devices.take_pressed().is_empty());
        assert_eq!(devices.profiles()["a"].control(ControlFunction::Brake), Some(DeviceControl::Axis(3)));
        devices.take(DeviceEvent::Moved(4, DeviceControl::Axis(3), 0.9), 3.0);
        assert!(devices.levers().unwrap().brake > 0.95);
        devices.learn(4, ControlFunction::Gas);
        devices.take(DeviceEvent::Unplugged(4), 4.0);
        assert!(devices.learning().is_none());
    }
}
