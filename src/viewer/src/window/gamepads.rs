//! Reads gamepads and steering wheels on a thread; their events wake the window.

use crate::cockpit::{ControlFunction, DeviceControl, DeviceEvent, DeviceInfo, DeviceProfile};
use gilrs::ev::Code;
use gilrs::ev::filter::{Filter as _, Jitter, axis_dpad_to_button};
use gilrs::{Axis, Button, EventType, Gamepad, GamepadId, Gilrs, GilrsBuilder};
use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Weak};
use std::time::Duration;

/// Handle of the gamepad thread. Dropping it ends the thread.
pub struct Gamepads {
    events: Receiver<DeviceEvent>,
    _alive: Arc<()>,
}

/// Capacity of the event channel; a full one blocks the thread (back-pressure), so that no event is lost.
const EVENTS: usize = 256;
/// Interval at which the thread checks for its end.
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Smaller axis motions are filtered out as jitter.
const JITTER_THRESHOLD: f32 = 0.004;

impl Gamepads {
    /// `on_update` is called on the thread after each event.
    pub fn listen(on_update: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (outbox, events) = sync_channel(EVENTS);
        let alive = Arc::new(());
        let tell = EventSender { outbox, on_update };
        let (sender, wanted) = (tell.clone(), Arc::downgrade(&alive));
        let thread = std::thread::Builder::new().name("gamepads".to_owned());
        if let Err(error) = thread.spawn(move || listen(&sender, &wanted)) {
            tell.tell(DeviceEvent::Missing(format!(
                "The thread that reads gamepads cannot be started: {error}"
            )));
        }
        Self { events, _alive: alive }
    }

    /// The next event, if there is one.
    pub fn try_next(&self) -> Option<DeviceEvent> {
        self.events.try_recv().ok()
    }
}

#[derive(Clone)]
struct EventSender {
    outbox: SyncSender<DeviceEvent>,
    on_update: Arc<dyn Fn() + Send + Sync>,
}

impl EventSender {
    fn tell(&self, event: DeviceEvent) {
        // The window may have been closed.
        if self.outbox.send(event).is_ok() {
            (self.on_update)();
        }
    }
}

fn listen(tell: &EventSender, wanted: &Weak<()>) {
    let builder = GilrsBuilder::new().with_default_filters(false).with_force_feedback(false);
    let mut gilrs = match builder.set_update_state(false).build() {
        Ok(gilrs) => gilrs,
        Err(error) => {
            tell.tell(DeviceEvent::Missing(format!("Gamepads cannot be read here: {error}")));
            return;
        }
    };
    let mut known = BTreeSet::new();
    let there: Vec<GamepadId> = gilrs.gamepads().map(|(id, _)| id).collect();
    for id in there {
        known.insert(usize::from(id));
        tell.tell(DeviceEvent::Plugged(id.into(), plug(&gilrs.gamepad(id))));
    }
    while wanted.strong_count() > 0 {
        let event = gilrs
            .next_event_blocking(Some(POLL_INTERVAL))
            .filter_ev(&axis_dpad_to_button, &mut gilrs)
            .filter_ev(&Jitter { threshold: JITTER_THRESHOLD }, &mut gilrs);
        let Some(event) = event else { continue };
        gilrs.update(&event);
        if let Some(event) = translated(&gilrs, &mut known, event.id, event.event) {
            tell.tell(event);
        }
    }
}

fn translated(
    gilrs: &Gilrs,
    known: &mut BTreeSet<usize>,
    id: GamepadId,
    event: EventType,
) -> Option<DeviceEvent> {
    let number = usize::from(id);
    match event {
        // Some systems also announce devices that were connected at the start.
        EventType::Connected => {
            known.insert(number).then(|| DeviceEvent::Plugged(number, plug(&gilrs.gamepad(id))))
        }
        EventType::Disconnected => {
            known.remove(&number);
            Some(DeviceEvent::Unplugged(number))
        }
        EventType::AxisChanged(_, value, code) => {
            Some(DeviceEvent::Moved(number, DeviceControl::Axis(code.into_u32()), value.into()))
        }
        // It follows each press and release, and carries the trigger position.
        EventType::ButtonChanged(_, value, code) => {
            Some(DeviceEvent::Moved(number, DeviceControl::Button(code.into_u32()), value.into()))
        }
        _ => None,
    }
}

const USUAL: [(ControlFunction, Button); 9] = [
    (ControlFunction::Gas, Button::RightTrigger2),
    (ControlFunction::Brake, Button::LeftTrigger2),
    (ControlFunction::Handbrake, Button::South),
    (ControlFunction::Reverse, Button::West),
    (ControlFunction::LookBack, Button::North),
    (ControlFunction::IndicateLeft, Button::LeftTrigger),
    (ControlFunction::IndicateRight, Button::RightTrigger),
    (ControlFunction::Hazard, Button::DPadUp),
    (ControlFunction::TakeWheel, Button::Start),
];

/// Description and default mapping of a device.
fn plug(gamepad: &Gamepad<'_>) -> DeviceInfo {
    let name = gamepad.os_name().to_owned();
    let uuid: String = gamepad.uuid().iter().map(|byte| format!("{byte:02x}")).collect();
    let named_wheel = ["wheel", "racing", "pedal"].iter().any(|word| name.to_lowercase().contains(word));
    let is_wheel = named_wheel || gamepad.button_code(Button::RightTrigger2).is_none();
    let steering = gamepad.axis_code(Axis::LeftStickX).map(|code| DeviceControl::Axis(code.into_u32()));
    let control = |code: Code| DeviceControl::Button(code.into_u32());
    // Button names of wheels say little about their positions.
    let buttons = USUAL.iter().filter(|_| !is_wheel);
    let buttons: Vec<_> = buttons
        .filter_map(|&(function, button)| Some((function, control(gamepad.button_code(button)?))))
        .collect();
    DeviceInfo {
        key: format!("{name} {uuid}"),
        name,
        usual: DeviceProfile::usual(steering, is_wheel, &buttons),
    }
}
