//! Actions on the camera of the large view.

use super::{Binding, Command, CommandContext, WATCHING, key, registry, shift};
use crate::ui::CameraMode;
use egui::Key;

registry!(
    ORBIT = Command::always("Orbit camera", &[key(Key::Num1)], |c| look(c, CameraMode::Orbit))
        .known_as("camera 1 view"),
    CHASE = Command::always("Chase camera", &[key(Key::Num2)], |c| look(c, CameraMode::Chase))
        .known_as("camera 2 view behind third person"),
    ONBOARD = Command::always("Onboard camera", &[key(Key::Num3)], |c| look(c, CameraMode::Onboard))
        .known_as("camera 3 view driver windscreen first person"),
    OVERHEAD = Command::always("Overhead camera", &[key(Key::Num4)], |c| look(c, CameraMode::Overhead))
        .known_as("camera 4 view top above bird map"),
    FREE = Command::always("Free camera", &[key(Key::Num5)], |c| look(c, CameraMode::Free))
        .known_as("camera 5 view fly"),
    FRAME_SELECTED = Command::always("Frame the selected vehicle", &[key(Key::Z)], |c| {
        let selected = c.state.selection.vehicle;
        match selected.and_then(|id| c.shown.interpolated.vehicle(id)) {
            Some(vehicle) => c.state.viewpoint.frame(vehicle, c.shown.walls),
            None => c.state.viewpoint.frame_all(c.shown.interpolated),
        }
    })
    .known_as("zoom centre focus"),
    FRAME_ALL = Command::always("Frame all vehicles", &[shift(Key::Z)], |c| {
        c.state.viewpoint.frame_all(c.shown.interpolated);
    })
    .known_as("zoom fit overview reset camera"),
    ZOOM_IN = Command::always("Zoom in", &[], |c| c.state.viewpoint.zoom(ZOOM_STEPS))
        .known_as("camera closer nearer"),
    ZOOM_OUT = Command::always("Zoom out", &[], |c| c.state.viewpoint.zoom(-ZOOM_STEPS))
        .known_as("camera farther away"),
    FRAME_CITY = Command::always("Frame the whole city", &[key(Key::X)], |c| {
        c.state.viewpoint.frame_city(c.shown.map);
    })
    .known_as("zoom fit overview"),
);

/// Steps of the mouse wheel that an action zooms by.
const ZOOM_STEPS: f64 = 3.0;

fn look(context: &mut CommandContext<'_, '_>, mode: CameraMode) {
    context.state.look_by(mode, (context.shown.interpolated, context.now_s));
}

/// The action of each camera mode, in the order of [`CameraMode::ALL`].
pub static MODES: [&Command; 5] = [&ORBIT, &CHASE, &ONBOARD, &OVERHEAD, &FREE];

/// Held keys that move the camera. In a replay the arrows go through time instead.
#[derive(Debug)]
pub struct CameraKeys {
    pub forward: Binding,
    pub back: Binding,
    pub left: Binding,
    pub right: Binding,
    pub down: Binding,
    pub up: Binding,
}

/// Held keys that move the camera.
pub static CAMERA_KEYS: CameraKeys = CameraKeys {
    forward: Binding::held("Move the camera forward", &[key(Key::W), key(Key::ArrowUp)], WATCHING),
    back: Binding::held("Move the camera back", &[key(Key::S), key(Key::ArrowDown)], WATCHING),
    left: Binding::held("Move the camera to the left", &[key(Key::A), key(Key::ArrowLeft)], WATCHING),
    right: Binding::held("Move the camera to the right", &[key(Key::D), key(Key::ArrowRight)], WATCHING),
    down: Binding::held("Move the free camera down", &[key(Key::Q)], WATCHING),
    up: Binding::held("Move the free camera up", &[key(Key::E)], WATCHING),
};

/// All of them.
pub static HELD: &[&Binding] = &[
    &CAMERA_KEYS.forward,
    &CAMERA_KEYS.back,
    &CAMERA_KEYS.left,
    &CAMERA_KEYS.right,
    &CAMERA_KEYS.down,
    &CAMERA_KEYS.up,
];

/// Use of the mouse.
pub const GESTURES: &[(&str, &str)] = &[
    ("drag", "Turn the view; chase turns around its vehicle, onboard in its place"),
    ("right-drag or Shift+drag", "Move the view"),
    ("wheel", "Zoom to the place under the mouse"),
];
