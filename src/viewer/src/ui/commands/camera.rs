//! Actions on the camera of the large view.

use super::{Command, key, registry, shift};
use crate::ui::CameraMode;
use egui::Key;

registry!(
    ORBIT = Command::always("Orbit camera", &[key(Key::Num1)], |c| c.state.set_mode(CameraMode::Orbit)),
    CHASE = Command::always("Chase camera", &[key(Key::Num2)], |c| c.state.set_mode(CameraMode::Chase)),
    ONBOARD = Command::always("Onboard camera", &[key(Key::Num3)], |c| c.state.set_mode(CameraMode::Onboard)),
    OVERHEAD =
        Command::always("Overhead camera", &[key(Key::Num4)], |c| c.state.set_mode(CameraMode::Overhead)),
    FREE = Command::always("Free camera", &[key(Key::Num5)], |c| c.state.set_mode(CameraMode::Free)),
    FRAME_SELECTED = Command::always("Frame the selected vehicle", &[key(Key::Z)], |c| {
        let selected = c.state.selection.vehicle;
        match selected.and_then(|id| c.shown.interpolated.vehicle(id)) {
            Some(vehicle) => c.state.viewpoint.frame(vehicle),
            None => c.state.viewpoint.frame_all(c.shown.interpolated),
        }
    }),
    FRAME_ALL = Command::always("Frame all vehicles", &[shift(Key::Z)], |c| {
        c.state.viewpoint.frame_all(c.shown.interpolated);
    }),
);

/// The action of each camera mode, in the order of [`CameraMode::ALL`].
pub static MODES: [&Command; 5] = [&ORBIT, &CHASE, &ONBOARD, &OVERHEAD, &FREE];

/// Use of the mouse, and held keys.
pub const GESTURES: &[(&str, &str)] = &[
    ("drag", "Turn the view; chase turns around its vehicle, onboard in its place"),
    ("right-drag or Shift+drag", "Move the view"),
    ("wheel", "Zoom"),
    ("W A S D or arrows", "Move the camera"),
    ("Q and E", "Move the free camera down and up"),
];
