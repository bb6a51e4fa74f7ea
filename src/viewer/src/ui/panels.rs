//! The panels around and over the city. A panel is one entry: its title, where it opens first, and what it shows.

use super::{
    UiAction, UiState, ViewModel, charts, city, controllers, editing, events, inspector, layers, preview,
    timeline, traffic, vehicles, views,
};
use egui::Ui;
use serde::{Deserialize, Serialize};

/// A panel of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Panel {
    /// The large view, which takes the room that the others leave.
    City,
    /// The table of all vehicles.
    Vehicles,
    /// Previews: what cameras of vehicles see.
    Cameras,
    /// The list of events.
    Events,
    /// Delay, throughput, safety and energy.
    Traffic,
    /// Quantities over time and figures.
    Charts,
    /// Switches of the overlays.
    Layers,
    /// Mapping of gamepads and steering wheels.
    Controllers,
    /// Why the selected vehicle does what it does.
    Inspector,
    /// Vehicles of the scenario, while it is edited.
    Editor,
    /// A large view beside the first one.
    SecondView,
    /// Another large view.
    ThirdView,
}

/// Where a panel opens first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Home {
    /// The middle or the left column, where there is always a panel.
    Fixed,
    /// In the left column.
    BelowVehicles,
    /// In the right column.
    Right,
    /// Over the city.
    Floating,
    /// Side by side in a row below the city: beside it they would be narrow, and take the room of the columns.
    ViewsRow,
    /// In a row of its own at the lower edge of the city, so wide that time has room.
    ChartsRow,
}

/// What the layout knows of a panel.
pub(super) struct PanelEntry {
    pub panel: Panel,
    pub title: &'static str,
    pub home: Home,
    /// Size over the city, points.
    pub size: [f32; 2],
    pub is_open: fn(&UiState) -> bool,
    pub close: fn(&mut UiState),
    pub show: fn(&mut Ui, &mut UiState, &ViewModel<'_>, &mut Vec<UiAction>),
}

pub(super) static ALL: [PanelEntry; 12] = [
    PanelEntry {
        panel: Panel::City,
        title: "City",
        home: Home::Fixed,
        size: [640.0, 480.0],
        is_open: |_| true,
        close: |_| {},
        show: |ui, state, shown, actions| {
            let rect = ui.available_rect_before_wrap();
            city::show(ui, state, shown, actions);
            timeline::past_sign(ui, rect, shown, actions);
        },
    },
    PanelEntry {
        panel: Panel::Vehicles,
        title: "Vehicles",
        home: Home::Fixed,
        size: [440.0, 300.0],
        is_open: |state| state.open.vehicles,
        close: |state| state.open.vehicles = false,
        show: |ui, state, shown, _| vehicles::show(ui, shown, state),
    },
    PanelEntry {
        panel: Panel::Cameras,
        title: "Cameras",
        home: Home::Right,
        size: [300.0, 520.0],
        is_open: |state| state.open.cameras && !state.previews.is_empty(),
        close: |state| state.open.cameras = false,
        show: preview::show_all,
    },
    PanelEntry {
        panel: Panel::Events,
        title: "Events",
        home: Home::BelowVehicles,
        size: [330.0, 320.0],
        is_open: |state| state.open.events,
        close: |state| state.open.events = false,
        show: events::show,
    },
    PanelEntry {
        panel: Panel::Traffic,
        title: "Traffic",
        home: Home::BelowVehicles,
        size: [480.0, 550.0],
        is_open: |state| state.open.traffic,
        close: |state| state.open.traffic = false,
        show: |ui, state, shown, _| traffic::show(ui, state, shown),
    },
    PanelEntry {
        panel: Panel::Charts,
        title: "Charts",
        home: Home::ChartsRow,
        size: [560.0, 500.0],
        is_open: |state| state.open.charts,
        close: |state| state.open.charts = false,
        show: charts::show,
    },
    PanelEntry {
        panel: Panel::Layers,
        title: "Layers",
        home: Home::Floating,
        size: [470.0, 260.0],
        is_open: |state| state.open.layers,
        close: |state| state.open.layers = false,
        show: |ui, state, _, _| layers::show(ui, state),
    },
    PanelEntry {
        panel: Panel::Controllers,
        title: "Gamepad and steering wheel",
        home: Home::Floating,
        size: [490.0, 420.0],
        is_open: |state| state.open.controllers,
        close: |state| state.open.controllers = false,
        show: |ui, state, _, actions| controllers::show(ui, state, actions),
    },
    PanelEntry {
        panel: Panel::Inspector,
        title: "Inspector",
        home: Home::BelowVehicles,
        size: [330.0, 350.0],
        is_open: |state| state.open.inspector,
        close: |state| state.open.inspector = false,
        show: inspector::show,
    },
    PanelEntry {
        panel: Panel::Editor,
        title: "Editor",
        home: Home::Right,
        size: [300.0, 520.0],
        is_open: |state| state.open.editor,
        close: |state| state.open.editor = false,
        show: editing::show,
    },
    PanelEntry {
        panel: Panel::SecondView,
        title: "View 2",
        home: Home::ViewsRow,
        size: [480.0, 360.0],
        is_open: |state| state.open.views[0],
        close: |state| state.open.views[0] = false,
        show: |ui, state, shown, _| views::show(ui, state, shown, 0),
    },
    PanelEntry {
        panel: Panel::ThirdView,
        title: "View 3",
        home: Home::ViewsRow,
        size: [480.0, 360.0],
        is_open: |state| state.open.views[1],
        close: |state| state.open.views[1] = false,
        show: |ui, state, shown, _| views::show(ui, state, shown, 1),
    },
];

/// What the layout knows of a panel.
pub(super) fn entry(panel: Panel) -> &'static PanelEntry {
    ALL.iter().find(|entry| entry.panel == panel).unwrap_or(&ALL[0])
}

/// Panels that open first at a place.
pub(super) fn with_home(home: Home) -> Vec<Panel> {
    ALL.iter().filter(|entry| entry.home == home).map(|entry| entry.panel).collect()
}
