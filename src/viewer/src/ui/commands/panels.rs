//! Actions on panels, overlays and the window itself.

use super::{Command, ctrl, key, registry};
use crate::ui::UiAction;
use egui::Key;

registry!(
    PALETTE = Command::always("Find an action", &[ctrl(Key::P)], |c| c.state.palette.open()),
    HELP = Command::always("Help: all keys and statuses", &[key(Key::F1), key(Key::Questionmark)], |c| {
        c.state.open.help = !c.state.open.help;
    }),
    EVENTS = Command::always("List of events", &[key(Key::F3)], |c| {
        c.state.open.events = !c.state.open.events;
    }),
    TRAFFIC = Command::always("Traffic: delay, safety, time-space diagram", &[key(Key::F4)], |c| {
        c.state.open.traffic = !c.state.open.traffic;
    }),
    LAYERS = Command::always("Layers: overlays of the city", &[], |c| {
        c.state.open.layers = !c.state.open.layers;
    }),
    LABELS = Command::always("Show or hide labels over vehicles", &[key(Key::L)], |c| {
        c.state.layers.labels = !c.state.layers.labels;
    }),
    MAP = Command::always("Show or hide the map", &[key(Key::M)], |c| {
        c.state.layers.map = !c.state.layers.map;
    }),
    LANES = Command::always("Show or hide lanes", &[], |c| c.state.layers.lanes = !c.state.layers.lanes),
    ROUTES = Command::always("Show or hide routes", &[], |c| c.state.layers.routes = !c.state.layers.routes),
    CONFLICT_ZONES = Command::always("Show or hide conflict zones", &[], |c| {
        c.state.layers.zones = !c.state.layers.zones;
    }),
    CONTROL_ZONES = Command::always("Show or hide control zones", &[], |c| {
        c.state.layers.control_zones = !c.state.layers.control_zones;
    }),
    PLANS = Command::always("Show or hide plans of coordinated vehicles", &[], |c| {
        c.state.layers.plans = !c.state.layers.plans;
    }),
    SCREENSHOT = Command::always("Save a screenshot", &[key(Key::F12)], |c| {
        c.actions.push(UiAction::Screenshot);
    }),
    QUIT = Command::always("Quit", &[ctrl(Key::Q)], |c| c.actions.push(UiAction::Quit)),
);
