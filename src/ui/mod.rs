//! The panels of the window: functions of a moment of the run and of what the user has chosen. They
//! draw with egui, say which pictures they need, and return what is to be done; they touch neither
//! the run nor the GPU.

mod bar;
mod city;
mod controllers;
mod drive;
mod events;
mod help;
mod history;
mod keys;
mod layers;
mod map;
mod preview;
mod sight;
mod status;
mod timeline;
mod vehicles;
mod viewpoint;

pub use drive::Driving;
pub use events::Events;
pub use history::{History, KEPT_S, Sample};
pub use layers::Layers;
pub use preview::{Eye, OwnCamera, Preview};
pub use status::is_off_lanes;
pub use timeline::Section;
pub use vehicles::Table;
pub use viewpoint::{Mode, Viewpoint};

use crate::camera::View;
use crate::city::scene::Wall;
use crate::city::{CityMap, LaneId};
use crate::cockpit::{Devices, Handling};
use crate::live::{Moment, Order};
use crate::playback::{Cue, Mark, Playhead};
use crate::snapshot::{FrameSnapshot, VehicleId};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Names of the algorithms that drive.
pub type Drivers = BTreeMap<VehicleId, String>;

/// What the panels show, apart from what the user has chosen.
#[derive(Debug)]
pub struct Shown<'a> {
    /// What tables and numbers tell.
    pub moment: &'a Moment,
    /// What is seen in the city: between the last two ticks while the run goes on.
    pub seen: &'a FrameSnapshot,
    pub history: &'a History,
    pub map: &'a CityMap,
    /// What hides vehicles from sight.
    pub walls: &'a [Wall],
    pub drivers: &'a Drivers,
    /// Lanes that a vehicle is going to drive, by the scenario.
    pub routes: &'a BTreeMap<VehicleId, Vec<LaneId>>,
    /// Cameras that the scenario gives vehicles.
    pub cameras: &'a BTreeMap<VehicleId, Vec<OwnCamera>>,
    /// What driving by hand has to know of the vehicles.
    pub handling: &'a BTreeMap<VehicleId, Handling>,
    pub scenario: &'a str,
    pub duration_s: f64,
    pub scenarios: &'a [Choice],
    /// What is being loaded, in words; nothing changes before it is there.
    pub loading: Option<&'a str>,
    /// Textures of the pictures that were asked for.
    pub textures: &'a BTreeMap<Slot, egui::TextureId>,
    /// What the line at the bottom says: the adapter, where the log is.
    pub footer: &'a str,
    /// Pictures of the window in a second.
    pub frames_per_s: f64,
    /// The most pixels that the large view may have while it moves; on a screen with more it is coarser.
    pub most_moving_pixels: Option<u32>,
    /// Pedals, steering and lateral errors are known; otherwise only poses are.
    pub tells_control: bool,
    /// A recorded run is shown: nobody drives, and time goes as the user wants.
    pub replay: Option<Replay<'a>>,
}

impl Shown<'_> {
    fn cameras_of(&self, vehicle: VehicleId) -> &[OwnCamera] {
        self.cameras.get(&vehicle).map_or(&[], Vec::as_slice)
    }
}

/// A scenario that can be picked.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// A shipped name, or a file.
    pub name: String,
    /// What it is about, as it says itself.
    pub description: String,
}

/// A recorded run, and where in it the window is.
#[derive(Clone, Copy, Debug)]
pub struct Replay<'a> {
    /// What was recorded, as its scenario calls it.
    pub name: &'a str,
    pub head: Playhead,
    /// What happened, in order of time.
    pub marks: &'a [Mark],
    /// How much of the log has been looked through for them, 0 to 1.
    pub searched: f64,
    /// Why the log has no end, where it is torn.
    pub torn: Option<&'a str>,
    /// Another place is wanted, and has not been read yet.
    pub is_late: bool,
}

/// A place for a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    City,
    Preview(VehicleId),
}

/// A picture that the panels need.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picture {
    pub slot: Slot,
    pub view: View,
}

/// What the user wants done that the panels cannot do.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    Order(Order),
    /// Of a replay.
    Cue(Cue),
    Drive(VehicleId),
    GiveBack,
    Scenario(String),
    Look(Look),
    /// What does what on gamepads and wheels has changed.
    KeepDevices,
    Screenshot,
    Quit,
}

/// How much work a pixel is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    Low,
    Medium,
    #[default]
    High,
    Ultra,
}

impl Preset {
    pub const ALL: [Self; 4] = [Self::Low, Self::Medium, Self::High, Self::Ultra];

    pub fn label(self) -> &'static str {
        match self {
            Self::Low => "low",
            Self::Medium => "medium",
            Self::High => "high",
            Self::Ultra => "ultra",
        }
    }
}

/// How pictures look.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Look {
    pub preset: Preset,
    /// Local time from midnight.
    pub hours: f64,
}

/// Widths of the panels at the sides, points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Widths {
    pub vehicles: f32,
    pub previews: f32,
}

impl Default for Widths {
    fn default() -> Self {
        Self { vehicles: 425.0, previews: 270.0 }
    }
}

/// Which vehicle the user means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    pub vehicle: Option<VehicleId>,
    /// To be followed from now on.
    pub follow: Option<VehicleId>,
}

/// Sheets and windows that are open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Open {
    #[serde(skip)]
    pub help: bool,
    #[serde(skip)]
    pub layers: bool,
    #[serde(skip)]
    pub controllers: bool,
    /// The list of what happened in a recorded run.
    #[serde(skip)]
    pub events: bool,
}

/// What the user has chosen.
#[derive(Clone, Debug)]
pub struct State {
    pub viewpoint: Viewpoint,
    pub selection: Selection,
    pub previews: Vec<Preview>,
    pub table: Table,
    pub layers: Layers,
    pub look: Look,
    pub open: Open,
    pub widths: Widths,
    /// Of the vehicle that the user drives.
    pub driving: Option<Driving>,
    /// Which of what happened in a recorded run is shown.
    pub events: Events,
    /// What the timeline shows of it.
    pub section: Section,
    /// The place on the timeline is being dragged.
    pub is_scrubbing: bool,
    /// Gamepads and steering wheels.
    pub devices: Devices,
    /// Said to the user for a while, and until when, in seconds of egui's clock.
    pub notice: Option<(String, f64)>,
    /// The pictures that this pass needs.
    pub pictures: Vec<Picture>,
}

impl State {
    pub fn new(snapshot: &FrameSnapshot, look: Look) -> Self {
        Self {
            viewpoint: Viewpoint::around(snapshot),
            selection: Selection::default(),
            previews: Vec::new(),
            table: Table::default(),
            layers: Layers::default(),
            look,
            open: Open::default(),
            widths: Widths::default(),
            driving: None,
            events: Events::default(),
            section: Section::default(),
            is_scrubbing: false,
            devices: Devices::default(),
            notice: None,
            pictures: Vec::new(),
        }
    }

    /// Opens the preview of a vehicle, or closes it.
    pub fn toggle_preview(&mut self, vehicle: VehicleId) {
        let count = self.previews.len();
        self.previews.retain(|preview| preview.vehicle != vehicle);
        if self.previews.len() == count {
            self.previews.push(Preview { vehicle, eye: Eye::default() });
        }
    }

    /// The vehicle that the user drives.
    pub fn driven(&self) -> Option<VehicleId> {
        self.driving.as_ref().map(|driving| driving.vehicle)
    }

    pub fn set_mode(&mut self, mode: Mode) {
        if matches!(mode, Mode::Chase | Mode::Onboard) {
            self.viewpoint.follow = self.selection.vehicle.or(self.viewpoint.follow);
        }
        let nearest = self.selection.vehicle;
        self.viewpoint.set_mode(mode, nearest);
    }

    pub fn follow(&mut self, vehicle: Option<VehicleId>) {
        self.viewpoint.follow = vehicle;
    }

    /// Says something to the user for some seconds.
    pub fn say(&mut self, text: impl Into<String>, now_s: f64) {
        self.notice = Some((text.into(), now_s + 6.0));
    }

    /// Forgets what belongs to vehicles that are not there.
    fn attend(&mut self, shown: &Shown<'_>) {
        let is_there = |id: VehicleId| shown.moment.now.vehicle(id).is_some();
        let is_late = shown.replay.is_some_and(|replay| replay.is_late);
        // One that a jump has selected may be there only where it leads.
        if !is_late {
            self.selection.vehicle = self.selection.vehicle.filter(|id| is_there(*id));
        }
        let is_seen = |id: VehicleId| shown.seen.vehicle(id).is_some();
        if let Some(vehicle) = self.selection.follow.take_if(|id| !is_late || is_seen(*id)) {
            self.viewpoint.follow = Some(vehicle);
            if matches!(self.viewpoint.mode, Mode::Free | Mode::Overhead) {
                self.viewpoint.set_mode(Mode::Orbit, Some(vehicle));
            }
        }
        self.viewpoint.attend(shown.seen);
        if self.driving.as_ref().is_some_and(|driving| !is_there(driving.vehicle)) {
            self.driving = None;
        }
    }
}

/// Panels at the sides become no narrower, where there is so much room, points.
const LEAST_VEHICLES: f32 = 180.0;
const LEAST_PREVIEWS: f32 = 160.0;
/// And they grow no wider, points.
const WIDEST: f32 = 640.0;
/// Nor than this share of the window.
const MOST_OF_WINDOW: f32 = 0.333;

/// The colour of the ground of the panels. They do not paint it: whoever draws them clears to it.
pub const GROUND: egui::Color32 = egui::Color32::from_gray(27);

/// One pass over all panels. Afterwards `state.pictures` holds the pictures that they need.
pub fn show(ui: &mut egui::Ui, state: &mut State, shown: &Shown<'_>) -> Vec<Action> {
    let mut actions = Vec::new();
    state.pictures.clear();
    state.attend(shown);
    if let Some(replay) = &shown.replay {
        if !state.open.events {
            // Who does not see the list does not see what it leaves out.
            state.events.filter.clear();
        }
        state.events.attend(replay.marks);
    }
    keys::act(ui, state, shown, &mut actions);
    if shown.replay.is_some() {
        // Buttons of gamepads mean nothing there.
        drop(state.devices.take_pressed());
    } else {
        drive::act(state, &mut actions);
    }
    let frame = egui::Frame::side_top_panel(ui.style()).fill(egui::Color32::TRANSPARENT);
    egui::Panel::top("bar").frame(frame).show(ui, |ui| {
        ui.add_space(3.0);
        bar::show(ui, state, shown, &mut actions);
        ui.add_space(3.0);
    });
    egui::Panel::bottom("footer").frame(frame).show(ui, |ui| footer(ui, shown));
    if let Some(replay) = &shown.replay {
        egui::Panel::bottom("timeline").frame(frame).show(ui, |ui| {
            ui.add_space(2.0);
            timeline::show(ui, state, shown, replay, &mut actions);
        });
    }
    // However small the window is, the city keeps a third of it.
    let whole = ui.available_width();
    let third = (whole * MOST_OF_WINDOW).clamp(0.0, WIDEST);
    let side = |panel: egui::Panel, width: f32, (least, most): (f32, f32)| {
        panel.frame(frame).default_size(width.min(most)).size_range(least.min(most)..=most)
    };
    // One that has less room than it wishes for is another panel in a window of another width: that makes egui
    // give it its width again.
    let room = |wished: f32, most: f32| if wished > most { most as u32 } else { 0 };
    let beside = if state.previews.is_empty() { preview::STRIP } else { LEAST_PREVIEWS.min(third) };
    let most = vehicles::least_width(ui).min(whole - third - beside).max(third);
    let panel = egui::Panel::left(("vehicles", room(state.widths.vehicles, most)));
    let panel = side(panel, state.widths.vehicles, (LEAST_VEHICLES, most));
    let panel = panel.show(ui, |ui| {
        // However little is in it, a panel keeps its width.
        ui.set_min_width(ui.available_width());
        vehicles::show(ui, shown, state);
    });
    let width = panel.response.rect.width();
    wish(&mut state.widths.vehicles, width, most);
    if state.previews.is_empty() {
        let panel = egui::Panel::right("no previews").frame(frame.inner_margin(0)).resizable(false);
        panel.exact_size(preview::STRIP).show(ui, |ui| preview::strip(ui, state, shown));
    } else {
        let most = third.min((whole - third - width).max(0.0));
        let panel = egui::Panel::right(("previews", room(state.widths.previews, most)));
        let panel = side(panel, state.widths.previews, (LEAST_PREVIEWS, most));
        let panel = panel.show(ui, |ui| {
            ui.set_min_width(ui.available_width());
            preview::show_all(ui, state, shown, &mut actions);
        });
        wish(&mut state.widths.previews, panel.response.rect.width(), most);
    }
    egui::CentralPanel::no_frame().show(ui, |ui| city::show(ui, state, shown));
    layers::window(ui, state);
    controllers::window(ui, state, &mut actions);
    if let Some(replay) = &shown.replay {
        events::window(ui, state, shown, replay, &mut actions);
    }
    help::window(ui, state, shown.replay.is_some());
    drive::step(ui, state, shown, &mut actions);
    actions
}

/// Takes down the width that the user has given a panel. One that only has no room for more keeps its wish.
fn wish(wished: &mut f32, width: f32, most: f32) {
    if (width - wished.min(most)).abs() > 0.5 {
        *wished = width;
    }
}

/// A window over the city that does not cover the bar, nor what is at the sides where there is room.
fn sheet(ui: &egui::Ui, title: &'static str) -> egui::Window<'static> {
    let top = ui.ctx().content_rect().center_top() + egui::vec2(0.0, 70.0);
    egui::Window::new(title).pivot(egui::Align2::CENTER_TOP).default_pos(top).resizable(false)
}

fn footer(ui: &mut egui::Ui, shown: &Shown<'_>) {
    ui.horizontal(|ui| {
        ui.small(if shown.replay.is_some() {
            "Space play/pause   left right 5 s   [ ] event   click a car to select   F follow   P preview   F1 all keys"
        } else {
            "Space start/pause   N step   click a car to select   F follow   P preview   Enter drive   F1 all keys"
        });
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if shown.frames_per_s > 0.0 {
                // Of one width, so that what stands beside it stays where it is.
                let text = format!("{:3.0} pictures/s", shown.frames_per_s);
                ui.label(egui::RichText::new(text).small().monospace());
            }
            ui.add(egui::Label::new(egui::RichText::new(shown.footer).small().weak()).truncate());
        });
    });
}

/// Size in pixels of a place on screen, each edge one at least.
fn pixels(size: egui::Vec2, pixels_per_point: f32) -> [u32; 2] {
    [size.x, size.y].map(|points| (points * pixels_per_point).round().clamp(1.0, 8192.0) as u32)
}

/// Paints the picture of a slot, or a dark place where it has not come yet.
fn paint_picture(ui: &egui::Ui, rect: egui::Rect, shown: &Shown<'_>, slot: Slot) {
    match shown.textures.get(&slot) {
        Some(&texture) => {
            let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
            ui.painter().image(texture, rect, whole, egui::Color32::WHITE);
        }
        None => {
            ui.painter().rect_filled(rect, 0.0, egui::Color32::from_gray(20));
        }
    }
}
