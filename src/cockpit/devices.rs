//! All gamepads and steering wheels that are plugged in, and which of them drives.

use super::device::{Control, Device, Function, Levers, Profile};
use super::learn::Learner;
use std::collections::BTreeMap;

/// A device that has just been plugged in.
#[derive(Clone, Debug, PartialEq)]
pub struct Plug {
    /// What it is known by from one run to the next.
    pub key: String,
    pub name: String,
    /// Which control does what as long as nobody has chosen.
    pub usual: Profile,
}

/// What happens at the sockets. Devices have numbers for as long as they are plugged in.
#[derive(Clone, Debug, PartialEq)]
pub enum DeviceEvent {
    Plugged(usize, Plug),
    Unplugged(usize),
    Moved(usize, Control, f64),
    /// Gamepads cannot be had on this machine, for this reason.
    Missing(String),
}

/// What is plugged in, and what is known of devices that were.
#[derive(Clone, Debug, Default)]
pub struct Devices {
    plugged: BTreeMap<usize, Device>,
    usual: BTreeMap<String, Profile>,
    /// What the user has chosen, by the keys of devices.
    profiles: BTreeMap<String, Profile>,
    /// The one that was used last.
    active: Option<usize>,
    is_used: bool,
    pressed: Vec<Function>,
    learner: Option<(usize, Learner)>,
    missing: Option<String>,
}

impl Devices {
    /// With what was chosen in earlier runs.
    pub fn new(profiles: BTreeMap<String, Profile>) -> Self {
        Self { profiles, ..Self::default() }
    }

    /// Takes what has happened at `now_s`; gives what the user should be told.
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

    fn plug(&mut self, number: usize, plug: Plug) -> String {
        let profile = self.profiles.get(&plug.key).unwrap_or(&plug.usual).clone();
        let lacks = |function| profile.control(function).is_none();
        let text = if lacks(Function::Steering) || lacks(Function::Gas) || lacks(Function::Brake) {
            format!("{} is plugged in: assign its wheel and pedals on the page Gamepad (F2).", plug.name)
        } else {
            format!("{} is plugged in: it drives the vehicle whose wheel you take.", plug.name)
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

    fn move_control(&mut self, number: usize, control: Control, value: f64, now_s: f64) {
        let Some(device) = self.plugged.get_mut(&number) else { return };
        let pressed = device.take(control, value);
        if let Some((of, learner)) = &mut self.learner {
            // What is moved to be found out shall not drive.
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

    pub fn get(&self, number: usize) -> Option<&Device> {
        self.plugged.get(&number)
    }

    /// Why there are none, where that is known.
    pub fn missing(&self) -> Option<&str> {
        self.missing.as_deref()
    }

    /// What has been pressed since this was last asked.
    pub fn take_pressed(&mut self) -> Vec<Function> {
        std::mem::take(&mut self.pressed)
    }

    /// Whether a device has been used since this was last asked.
    pub fn take_used(&mut self) -> bool {
        std::mem::take(&mut self.is_used)
    }

    /// Where the levers of the device are that was used last.
    pub fn levers(&self) -> Option<Levers> {
        self.active.and_then(|number| self.plugged.get(&number)).map(Device::levers)
    }

    /// Whether a button of the device that was used last is held.
    pub fn is_held(&self, function: Function) -> bool {
        let active = self.active.and_then(|number| self.plugged.get(&number));
        active.is_some_and(|device| device.is_pressed(function))
    }

    /// Begins to find out which control of a device shall do something.
    pub fn learn(&mut self, number: usize, function: Function) {
        if let Some(device) = self.plugged.get(&number) {
            self.learner = Some((number, Learner::new(function, device.values())));
        }
    }

    /// The device that is being watched, and what for.
    pub fn learning(&self) -> Option<(usize, &Learner)> {
        self.learner.as_ref().map(|(number, learner)| (*number, learner))
    }

    pub fn stop_learning(&mut self) {
        self.learner = None;
    }

    /// Takes over what has been found out by now. Gives what the control did until now and no longer does;
    /// `None` as long as there is nothing.
    pub fn try_finish(&mut self, now_s: f64) -> Option<Vec<Function>> {
        let (number, learner) = self.learner.as_ref()?;
        let (number, assignment) = (*number, learner.outcome(now_s)?);
        self.learner = None;
        let mut taken = Vec::new();
        self.change(number, |profile| taken = profile.assign(assignment));
        Some(taken)
    }

    /// Changes which control of a device does what, and keeps it for the next time.
    pub fn change(&mut self, number: usize, change: impl FnOnce(&mut Profile)) {
        if let Some(device) = self.plugged.get_mut(&number) {
            change(&mut device.profile);
            self.profiles.insert(device.key.clone(), device.profile.clone());
        }
    }

    /// Forgets what was chosen for a device.
    pub fn restore(&mut self, number: usize) {
        if let Some(device) = self.plugged.get_mut(&number) {
            self.profiles.remove(&device.key);
            device.profile = self.usual.get(&device.key).cloned().unwrap_or_default();
        }
    }

    /// What the user has chosen, to be kept.
    pub fn profiles(&self) -> &BTreeMap<String, Profile> {
        &self.profiles
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STICK: Control = Control::Axis(0);
    const TRIGGER: Control = Control::Button(7);
    const START: Control = Control::Button(11);

    fn plug(key: &str) -> Plug {
        let buttons = [(Function::Gas, TRIGGER), (Function::TakeWheel, START)];
        Plug {
            key: key.to_owned(),
            name: "Pad".to_owned(),
            usual: Profile::usual(Some(STICK), false, &buttons),
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
        assert_eq!(devices.take_pressed(), [Function::TakeWheel], "a short press is not missed");
        assert_eq!(devices.levers().unwrap().gas, 0.05);
    }

    #[test]
    fn one_that_is_unplugged_lets_go_and_comes_back_with_what_was_chosen() {
        let mut devices = one();
        devices.take(DeviceEvent::Moved(4, TRIGGER, 1.0), 1.0);
        devices.change(4, |profile| profile.eases = false);
        let said = devices.take(DeviceEvent::Unplugged(4), 2.0).unwrap();
        assert!(said.contains("pedals are released"), "{said}");
        assert_eq!((devices.levers(), devices.take_used()), (None, false));
        devices.take(DeviceEvent::Moved(4, TRIGGER, 1.0), 2.0);
        assert_eq!(devices.take(DeviceEvent::Unplugged(4), 2.0), None);
        devices.take(DeviceEvent::Plugged(9, plug("a")), 3.0);
        assert!(!devices.get(9).unwrap().profile.eases);
        devices.restore(9);
        assert!(devices.get(9).unwrap().profile.eases && devices.profiles().is_empty());
    }

    #[test]
    fn what_is_found_out_is_kept_and_does_not_drive_meanwhile() {
        let mut devices = one();
        devices.learn(4, Function::Brake);
        for (time_s, value) in [(1.0, -1.0), (1.1, 0.9), (1.2, -1.0)] {
            devices.take(DeviceEvent::Moved(4, Control::Axis(3), value), time_s);
            assert_eq!(devices.try_finish(time_s), None);
        }
        devices.take(DeviceEvent::Moved(4, START, 0.4), 1.2);
        assert_eq!(devices.try_finish(2.0), Some(Vec::new()));
        assert!(devices.learning().is_none() && devices.take_pressed().is_empty());
        assert_eq!(devices.profiles()["a"].control(Function::Brake), Some(Control::Axis(3)));
        devices.take(DeviceEvent::Moved(4, Control::Axis(3), 0.9), 3.0);
        assert!(devices.levers().unwrap().brake > 0.95);
        devices.learn(4, Function::Gas);
        devices.take(DeviceEvent::Unplugged(4), 4.0);
        assert!(devices.learning().is_none());
    }
}
