//! Gamepads and steering wheels, read on a thread of their own: they wake the window when they are moved.

use crate::cockpit::{Control, DeviceEvent, Function, Plug, Profile};
use gilrs::ev::Code;
use gilrs::ev::filter::{Filter as _, Jitter, axis_dpad_to_button};
use gilrs::{Axis, Button, EventType, Gamepad, GamepadId, Gilrs, GilrsBuilder};
use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Weak};
use std::time::Duration;

/// What the thread tells. Dropped, the thread ends.
pub struct Gamepads {
    events: Receiver<DeviceEvent>,
    _alive: Arc<()>,
}

/// Events that may wait for the window; the thread waits when there are more, so that none is lost.
const EVENTS: usize = 256;
/// So often the thread looks whether it is still wanted.
const LOOK_UP: Duration = Duration::from_millis(250);
/// Axes that move by less are not heard of.
const LEAST_WAY: f32 = 0.004;

impl Gamepads {
    /// `on_news` is called on the thread after each event.
    pub fn listen(on_news: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (outbox, events) = sync_channel(EVENTS);
        let alive = Arc::new(());
        let tell = Teller { outbox, on_news };
        let (teller, wanted) = (tell.clone(), Arc::downgrade(&alive));
        let thread = std::thread::Builder::new().name("gamepads".to_owned());
        if let Err(error) = thread.spawn(move || listen(&teller, &wanted)) {
            tell.tell(DeviceEvent::Missing(format!(
                "The thread that reads gamepads cannot be started: {error}"
            )));
        }
        Self { events, _alive: alive }
    }

    /// The next thing that has happened, if any has.
    pub fn try_next(&self) -> Option<DeviceEvent> {
        self.events.try_recv().ok()
    }
}

#[derive(Clone)]
struct Teller {
    outbox: SyncSender<DeviceEvent>,
    on_news: Arc<dyn Fn() + Send + Sync>,
}

impl Teller {
    fn tell(&self, event: DeviceEvent) {
        // Nobody listens any more when the window is closed.
        if self.outbox.send(event).is_ok() {
            (self.on_news)();
        }
    }
}

fn listen(tell: &Teller, wanted: &Weak<()>) {
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
            .next_event_blocking(Some(LOOK_UP))
            .filter_ev(&axis_dpad_to_button, &mut gilrs)
            .filter_ev(&Jitter { threshold: LEAST_WAY }, &mut gilrs);
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
        // Some systems tell of those that were there from the start.
        EventType::Connected => {
            known.insert(number).then(|| DeviceEvent::Plugged(number, plug(&gilrs.gamepad(id))))
        }
        EventType::Disconnected => {
            known.remove(&number);
            Some(DeviceEvent::Unplugged(number))
        }
        EventType::AxisChanged(_, value, code) => {
            Some(DeviceEvent::Moved(number, Control::Axis(code.into_u32()), value.into()))
        }
        // It follows each press and release, and says how far triggers are pulled.
        EventType::ButtonChanged(_, value, code) => {
            Some(DeviceEvent::Moved(number, Control::Button(code.into_u32()), value.into()))
        }
        _ => None,
    }
}

const USUAL: [(Function, Button); 9] = [
    (Function::Gas, Button::RightTrigger2),
    (Function::Brake, Button::LeftTrigger2),
    (Function::Handbrake, Button::South),
    (Function::Reverse, Button::West),
    (Function::LookBack, Button::North),
    (Function::IndicateLeft, Button::LeftTrigger),
    (Function::IndicateRight, Button::RightTrigger),
    (Function::Hazard, Button::DPadUp),
    (Function::TakeWheel, Button::Start),
];

/// What is known of a device, and what its controls do as long as nobody has chosen.
fn plug(gamepad: &Gamepad<'_>) -> Plug {
    let name = gamepad.os_name().to_owned();
    let uuid: String = gamepad.uuid().iter().map(|byte| format!("{byte:02x}")).collect();
    let named_wheel = ["wheel", "racing", "pedal"].iter().any(|word| name.to_lowercase().contains(word));
    let is_wheel = named_wheel || gamepad.button_code(Button::RightTrigger2).is_none();
    let steering = gamepad.axis_code(Axis::LeftStickX).map(|code| Control::Axis(code.into_u32()));
    let control = |code: Code| Control::Button(code.into_u32());
    // What the buttons of a wheel are called says little about where they are.
    let buttons = USUAL.iter().filter(|_| !is_wheel);
    let buttons: Vec<_> = buttons
        .filter_map(|&(function, button)| Some((function, control(gamepad.button_code(button)?))))
        .collect();
    Plug { key: format!("{name} {uuid}"), name, usual: Profile::usual(steering, is_wheel, &buttons) }
}
