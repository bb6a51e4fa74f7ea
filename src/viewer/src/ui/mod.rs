//! The panels of the window, an immediate-mode user interface with egui. They are functions of a view model and of
//! the user's choices; they request pictures and return actions, and touch neither the run nor the GPU.

mod bar;
mod charts;
mod city;
mod colouring;
pub(crate) mod commands;
mod control_zones;
mod controllers;
mod drive;
mod editing;
mod events;
mod footer;
mod gaze;
mod help;
mod inspector;
mod key_page;
mod keys;
mod layers;
mod layout;
mod legend;
mod link;
mod live_traffic;
mod look;
mod map;
mod measure;
mod occlusion;
mod overlay;
mod palette;
mod panels;
mod picture_legend;
mod plans;
mod preview;
mod rain;
mod rulers;
mod run_until;
pub mod runs;
mod settings;
mod space_time;
mod status;
mod theme;
mod timeline;
mod tracks;
mod traffic;
mod vehicle_menu;
mod vehicles;
mod video;
mod view_model;
mod viewpoint;
mod views;
mod way_back;

pub use charts::{ChartKind, ChartSpan, ChartState, ChartView, MergeChoice};
pub use colouring::ColourBy;
pub use commands::{
    Availability, Binding, Command, KeyMap, KeyUse, SECTIONS, Scope, Section, Shortcut, bindings,
};
pub use control_zones::{ControlZoneArea, ZoneStretch};
pub use drive::ManualDrive;
pub use editing::{EditAction, EditState, EditTool, EditView};
pub use events::{EventFilter, announcement, collision_remark, event_words};
pub use key_page::KeyPage;
pub use layers::Layers;
pub use layout::{Layout, StoredLayout};
pub use live_traffic::{LiveTraffic, TRACKS_KNOWN_S};
pub use look::{Look, QualityPreset};
pub use measure::Measure;
pub use palette::Palette;
pub use panels::Panel;
pub use preview::{KEPT_S, Preview, PreviewCamera, ScenarioCamera};
pub use run_until::RunUntilState;
pub use settings::SettingsPage;
pub use status::{gives_way, is_off_lanes};
pub use theme::{DecimalSeparator, Preferences, SpeedUnit, StatusColours, Theme, ground};
pub(crate) use theme::{difference as colour_difference, legible_line};
pub use timeline::{ShownTime, TimelineRange, TimelineView};
pub use tracks::{TrackPoint, Tracks};
pub use vehicle_menu::{MenuSubject, VehicleMenu};
pub use vehicles::TableState;
pub use video::{VideoKind, VideoRequest, VideoStatus, VideoSubject};
pub use view_model::{
    CityKind, DriverNames, PastView, PictureRequest, PictureSlot, ReplayView, ScenarioChoice, VehicleNames,
    ViewModel,
};
pub use viewpoint::{Bookmark, Bookmarks, CameraMode, Flight, Viewpoint};
pub use views::{MORE_VIEWS, MoreViews};

use crate::cockpit::Devices;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_render::Overlay;
use city3d_session::playback::PlaybackCommand;
use city3d_session::{Order, RunPhase};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// An action of the user that the panels do not carry out themselves.
#[derive(Clone, Debug, PartialEq)]
pub enum UiAction {
    /// An order to the city.
    Order(Order),
    /// A command to the player of a log.
    PlaybackCommand(PlaybackCommand),
    /// The user takes over this vehicle.
    Drive(VehicleId),
    /// The user releases the driven vehicle to its algorithm.
    GiveBack,
    /// Another scenario, by a shipped name or a file, from its beginning and as it is written.
    Scenario(String),
    /// A scenario, a map or a log.
    Open(runs::OpenRequest),
    /// The log of the present run, which ends with it.
    Replay,
    /// The scenario that is shown from its beginning, at once.
    RunAgain(runs::RunAgain),
    /// The run is reset: the user was asked.
    ResetConfirmed,
    /// The measures of the present run beside those of another one: its folder or its log.
    CompareWith(PathBuf),
    /// Another quality or time of day; the city's renderer is built again.
    Look(Look),
    /// A device mapping has changed and is to be stored.
    KeepDevices,
    /// A picture of the next frame, saved as a PNG file in the folder of the run.
    Screenshot,
    /// The chart, saved into the folder of the run.
    SaveChart,
    /// A video begins, or the one that is being recorded ends.
    Video(VideoRequest),
    /// A change of the edited scenario.
    Edit(EditAction),
    /// The window closes.
    Quit,
    /// The user was asked about changes of a scenario that are not saved: they are saved first, or not, and then comes this.
    Leave {
        /// What ends the editor.
        then: Box<UiAction>,
        /// Whether the changes are saved before.
        saves: bool,
    },
}

/// The selected vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// `None` while no vehicle is selected.
    pub vehicle: Option<VehicleId>,
    /// Vehicle that the camera starts to follow.
    pub follow: Option<VehicleId>,
}

/// Panels and pages that are open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct OpenPanels {
    /// The table of vehicles.
    pub vehicles: bool,
    /// The previews, while there are any.
    pub cameras: bool,
    /// All keys and statuses (F1).
    #[serde(skip)]
    pub help: bool,
    /// Theme, size, units.
    #[serde(skip)]
    pub settings: bool,
    /// Switches of the overlays.
    #[serde(skip)]
    pub layers: bool,
    /// Mapping and calibration of gamepads and steering wheels (F2).
    #[serde(skip)]
    pub controllers: bool,
    /// The list of events (F3).
    pub events: bool,
    /// Delay, throughput, safety and energy (F4).
    pub traffic: bool,
    /// Quantities over time and figures (F6).
    #[serde(skip)]
    pub charts: bool,
    /// Why the selected vehicle does what it does (I).
    #[serde(skip)]
    pub inspector: bool,
    /// The editor of the scenario (Ctrl+E).
    #[serde(skip)]
    pub editor: bool,
    /// Views beside the first one.
    pub views: [bool; MORE_VIEWS],
}

impl Default for OpenPanels {
    fn default() -> Self {
        Self {
            vehicles: true,
            cameras: true,
            help: false,
            settings: false,
            layers: false,
            controllers: false,
            events: false,
            traffic: false,
            charts: false,
            inspector: false,
            editor: false,
            views: [false; MORE_VIEWS],
        }
    }
}

/// State of the user interface: what the user has chosen.
#[derive(Clone, Debug)]
pub struct UiState {
    /// Camera of the large view.
    pub viewpoint: Viewpoint,
    /// The selected vehicle, which the keys act on.
    pub selection: Selection,
    /// The open previews, from top to bottom.
    pub previews: Vec<Preview>,
    /// Sorting and filter of the table of vehicles.
    pub table: TableState,
    /// Overlays of the city view.
    pub layers: Layers,
    /// The chosen quality and time of day; the pictures follow once their renderer is built.
    pub look: Look,
    /// The windows that are open over the city.
    pub open: OpenPanels,
    /// Where the panels are.
    pub layout: Layout,
    /// Theme, status colours, size and units.
    pub preferences: Preferences,
    /// Which key runs which action.
    pub keys: Arc<KeyMap>,
    /// Which page the settings show.
    pub settings_page: SettingsPage,
    /// What is being assigned on the page of keys.
    pub key_page: KeyPage,
    /// The command palette.
    pub palette: Palette,
    /// Words that the help is searched for.
    pub help_words: String,
    /// A widget had the keyboard focus in the last frame.
    had_focus: bool,
    /// Camera and selected vehicle before a jump to an event of the past.
    view_before_jump: Option<Viewpoint>,
    /// The run that has come to its end, and when, seconds of egui's clock.
    ended: Option<(u32, f64)>,
    /// Manual control of the vehicle that the user drives.
    pub driving: Option<ManualDrive>,
    /// Filter of the events.
    pub events: EventFilter,
    /// Visible range of the timeline.
    pub section: TimelineRange,
    /// What is charted.
    pub charts: ChartState,
    /// Goals of a run.
    pub run_until: RunUntilState,
    /// Simulated seconds between two pictures of a time-lapse.
    pub lapse_s: f64,
    /// Length of a video that ends by itself, seconds.
    pub video_lasts_s: f64,
    /// What videos show.
    pub video_subject: VideoSubject,
    /// Size of the large view, pixels of the screen.
    pub city_pixels: [u32; 2],
    /// The playhead is being dragged.
    pub is_scrubbing: bool,
    /// Gamepads and steering wheels.
    pub devices: Devices,
    /// Start page, file panel, and the end of a run.
    pub runs: runs::RunPanels,
    /// A message to the user, and until when it is shown, seconds of egui's clock.
    pub notice: Option<(String, f64)>,
    /// The pictures that this frame needs.
    pub pictures: Vec<PictureRequest>,
    /// Lines and surfaces in the city, over the picture of the large view.
    pub overlay: Overlay,
    /// Colours of bodies in the large views in place of their own.
    pub tints: Vec<(VehicleId, [u8; 3])>,
    /// The menu of a vehicle or a place.
    pub menu: Option<VehicleMenu>,
    /// The measure tool.
    pub measure: Measure,
    /// Stored cameras of the large view.
    pub bookmarks: Bookmarks,
    /// Tools of the editor.
    pub editing: EditState,
    /// Cameras of the views beside the first one.
    pub views: MoreViews,
    /// The preview of the first vehicle opens by itself; not once the user has chosen previews.
    pub opens_preview: bool,
}

impl UiState {
    /// A new window: an orbit camera around all vehicles of `snapshot`, nothing selected, no previews.
    pub fn new(snapshot: &FrameSnapshot, look: Look) -> Self {
        Self {
            viewpoint: Viewpoint::around(snapshot),
            selection: Selection::default(),
            previews: Vec::new(),
            table: TableState::default(),
            layers: Layers::default(),
            look,
            open: OpenPanels::default(),
            layout: Layout::default(),
            preferences: Preferences::default(),
            keys: Arc::default(),
            settings_page: SettingsPage::default(),
            key_page: KeyPage::default(),
            palette: Palette::default(),
            help_words: String::new(),
            had_focus: false,
            view_before_jump: None,
            ended: None,
            driving: None,
            events: EventFilter::default(),
            section: TimelineRange::default(),
            charts: ChartState::default(),
            run_until: RunUntilState::default(),
            lapse_s: 1.0,
            video_lasts_s: 10.0,
            video_subject: VideoSubject::default(),
            city_pixels: [1, 1],
            is_scrubbing: false,
            devices: Devices::default(),
            runs: runs::RunPanels::default(),
            notice: None,
            pictures: Vec::new(),
            overlay: Overlay::default(),
            tints: Vec::new(),
            menu: None,
            measure: Measure::default(),
            bookmarks: Bookmarks::default(),
            editing: EditState::default(),
            views: MoreViews::around(snapshot),
            opens_preview: true,
        }
    }

    /// The state for another run: what belongs to the user stays, what belongs to the run goes.
    pub fn renewed(&mut self, snapshot: &FrameSnapshot) -> Self {
        let mut next = Self::new(snapshot, self.look);
        next.table = std::mem::take(&mut self.table);
        (next.layers, next.preferences) = (self.layers, self.preferences);
        (next.video_subject, next.lapse_s) = (self.video_subject, self.lapse_s);
        next.video_lasts_s = self.video_lasts_s;
        (next.keys, next.settings_page) = (Arc::clone(&self.keys), self.settings_page);
        next.devices = std::mem::take(&mut self.devices);
        next.bookmarks = std::mem::take(&mut self.bookmarks);
        (next.layout, next.open) = (std::mem::take(&mut self.layout), self.open);
        next.runs.last_folder = self.runs.last_folder.take();
        // Who has closed all previews wants none.
        next.opens_preview = self.opens_preview || !self.previews.is_empty();
        next
    }

    /// Looks at what another state looks at. A vehicle is kept where it is the same one: in charts also one that is to come.
    pub fn look_as(&mut self, other: Self, first: &FrameSnapshot, is_again: impl Fn(VehicleId) -> bool) {
        let is_here = |id: VehicleId| first.vehicle(id).is_some() && is_again(id);
        self.viewpoint = other.viewpoint;
        self.selection.vehicle = other.selection.vehicle.filter(|id| is_here(*id));
        self.previews = other.previews;
        self.previews.retain(|preview| is_here(preview.vehicle));
        self.opens_preview &= self.previews.is_empty();
        self.charts = other.charts;
        self.charts.vehicles.retain(|id| is_again(*id));
    }

    /// Opens the preview of a vehicle, or closes it.
    pub fn toggle_preview(&mut self, vehicle: VehicleId) {
        self.opens_preview = false;
        let count = self.previews.len();
        self.previews.retain(|preview| preview.vehicle != vehicle);
        if self.previews.len() == count {
            self.open.cameras = true;
            self.previews.push(Preview::new(vehicle));
        }
    }

    /// Whether something on display needs the plans of coordinated vehicles.
    pub fn shows_plans(&self) -> bool {
        self.layers.plans || self.open.traffic || self.open.inspector || !self.previews.is_empty()
    }

    /// The vehicle that the user drives.
    pub fn driven(&self) -> Option<VehicleId> {
        self.driving.as_ref().map(|driving| driving.vehicle)
    }

    /// Changes the mode of the large view; chase and onboard take the selected vehicle.
    pub fn set_mode(&mut self, mode: CameraMode) {
        self.viewpoint.choose_mode(mode, self.selection.vehicle);
    }

    /// The same; where no vehicle is selected or followed, chase and onboard select the nearest one, and say so.
    pub(crate) fn look_by(&mut self, mode: CameraMode, (seen, now_s): (&FrameSnapshot, f64)) {
        let rides = matches!(mode, CameraMode::Chase | CameraMode::Onboard);
        let has_one = self.selection.vehicle.or(self.viewpoint.follow).is_some();
        if rides && !has_one {
            let said = match self.viewpoint.nearest(seen).and_then(|id| seen.info(id)) {
                Some(info) => {
                    (self.selection.vehicle, self.table.reveal) = (Some(info.id), true);
                    let name = events::numbered_name(info);
                    format!("The camera goes with {name}, the nearest: select another vehicle for its view")
                }
                None => "There is no vehicle yet for the camera to go with".to_owned(),
            };
            self.say(said, now_s);
        }
        self.set_mode(mode);
    }

    /// All panels back in their usual places.
    pub fn restore_layout(&mut self) {
        let pages =
            OpenPanels { help: self.open.help, settings: self.open.settings, ..OpenPanels::default() };
        (self.layout, self.open) = (Layout::default(), pages);
    }

    /// What Escape closes first: a page, else a panel over the city. Docked panels stay.
    fn first_to_close(&self) -> Option<fn(&mut Self)> {
        if self.open.help {
            return Some(|state| state.open.help = false);
        }
        if self.open.settings {
            return Some(|state| state.open.settings = false);
        }
        if self.runs.comparison.is_open() {
            return Some(|state| state.runs.comparison.close());
        }
        if self.runs.end_card.is_open() {
            return Some(|state| state.runs.end_card.close());
        }
        let is_over =
            |entry: &&panels::PanelEntry| (entry.is_open)(self) && self.layout.is_floating(entry.panel);
        panels::ALL.iter().find(is_over).map(|entry| entry.close)
    }

    /// Shows a message for some seconds.
    pub fn say(&mut self, text: impl Into<String>, now_s: f64) {
        self.notice = Some((text.into(), now_s + 6.0));
    }

    /// Shows a message that nobody has asked for: one that is shown stays above it.
    pub fn add_to_said(&mut self, text: impl Into<String>, now_s: f64) {
        let text = text.into();
        let before = self.notice.take().filter(|(_, until_s)| now_s < *until_s);
        let last = before.iter().flat_map(|(text, _)| text.lines()).last();
        let text = [last, Some(text.as_str())].into_iter().flatten().collect::<Vec<_>>().join("\n");
        self.say(text, now_s);
    }

    /// Notes when a run comes to its end.
    fn note_end(&mut self, ui: &egui::Ui, shown: &ViewModel<'_>) {
        let now_s = ui.input(|input| input.time);
        let run = (shown.run_state.phase == RunPhase::Over).then_some(shown.run_state.run);
        if run != self.ended.map(|(run, _)| run) {
            self.ended = run.map(|run| (run, now_s));
        }
        if self.has_just_ended(now_s) {
            ui.ctx().request_repaint_after(std::time::Duration::from_secs_f64(PAUSES_LATE_S));
        }
    }

    /// Whether the run has come to its end a moment ago: who means to pause it then must not continue it.
    pub(crate) fn has_just_ended(&self, now_s: f64) -> bool {
        self.ended.is_some_and(|(_, at_s)| (0.0..PAUSES_LATE_S).contains(&(now_s - at_s)))
    }

    /// Opens a preview where none was chosen: of the vehicle that the user drives or has selected, else of the first one.
    fn open_first_preview(&mut self, seen: &FrameSnapshot) {
        let first = self.driven().or(self.selection.vehicle).or(seen.vehicles.first().map(|v| v.id));
        let first = first.filter(|id| seen.vehicle(*id).is_some());
        if let Some(vehicle) = first.filter(|_| self.opens_preview && self.previews.is_empty()) {
            (self.opens_preview, self.previews) = (false, vec![Preview::new(vehicle)]);
        }
    }

    /// Drops references to vehicles that have left.
    fn update(&mut self, shown: &ViewModel<'_>) {
        // A vehicle that was just added to the edited scenario is seen once the scenario is checked.
        let is_stated = |id| shown.edit.is_some_and(|edit| edit.vehicle(id).is_some());
        let is_there = |id: VehicleId| shown.run_state.now.vehicle(id).is_some() || is_stated(id);
        let is_late = shown.replay.is_some_and(|replay| replay.is_late);
        // A seek may select a vehicle that exists only at its target.
        if !is_late {
            self.selection.vehicle = self.selection.vehicle.filter(|id| is_there(*id));
        }
        let is_seen = |id: VehicleId| shown.interpolated.vehicle(id).is_some();
        if let Some(vehicle) = self.selection.follow.take_if(|id| !is_late || is_seen(*id)) {
            if matches!(self.viewpoint.mode, CameraMode::Free | CameraMode::Overhead) {
                self.viewpoint.set_mode(CameraMode::Orbit, Some(vehicle));
            }
            self.viewpoint.follow(shown.interpolated.vehicle(vehicle));
        }
        self.viewpoint.update(shown.interpolated);
        if self.driving.as_ref().is_some_and(|driving| !is_there(driving.vehicle)) {
            self.driving = None;
        }
    }
}

/// For so long after its end a run cannot be continued, seconds.
const PAUSES_LATE_S: f64 = 0.7;

/// Lays out all panels for one frame. Afterwards `state.pictures` holds the pictures that they need.
pub fn show(ui: &mut egui::Ui, state: &mut UiState, shown: &ViewModel<'_>) -> Vec<UiAction> {
    let mut actions = Vec::new();
    theme::apply(ui.ctx(), state.preferences);
    commands::key_map::apply(ui.ctx(), &state.keys);
    state.pictures.clear();
    state.forget_view(shown);
    state.update(shown);
    state.note_end(ui, shown);
    state.open_first_preview(&shown.run_state.now);
    if !state.open.events {
        // A closed list must not hide events.
        state.events.filter.clear();
    }
    state.events.update(shown.events, shown.names);
    key_page::capture(ui, state);
    palette::show(ui, state, shown, &mut actions);
    keys::act(ui, state, shown, &mut actions);
    let dt_s = f64::from(ui.input(|input| input.stable_dt.min(0.1)));
    if state.viewpoint.ease(dt_s) | state.viewpoint.go_on_flying(dt_s) {
        ui.ctx().request_repaint();
    }
    if TimelineView::of(shown).is_played() {
        // Gamepad buttons have no function in a replay.
        drop(state.devices.take_pressed());
    } else {
        drive::act(state, &mut actions);
    }
    let frame = egui::Frame::side_top_panel(ui.style()).fill(egui::Color32::TRANSPARENT);
    egui::Panel::top("bar").frame(frame).show(ui, |ui| {
        // In a low window the city needs the room.
        let air = if timeline::is_low(ui) { 0.0 } else { 3.0 };
        ui.add_space(air);
        ui.spacing_mut().item_spacing.y = air;
        bar::show(ui, state, shown, &mut actions);
        ui.add_space(air);
    });
    let has_dialog = state.runs.is_modal();
    egui::Panel::bottom("footer").frame(frame).show(ui, |ui| footer::show(ui, shown, has_dialog));
    // What is edited has no time yet: that of the old run would mislead.
    if shown.edit.is_none() {
        egui::Panel::bottom("timeline").frame(frame).show(ui, |ui| {
            timeline::show(ui, state, shown, &mut actions);
        });
    }
    if !state.open.controllers {
        state.devices.stop_learning();
    }
    egui::CentralPanel::no_frame().show(ui, |ui| layout::show(ui, state, shown, &mut actions));
    vehicle_menu::show(ui, state, shown, &mut actions);
    settings::window(ui, state);
    help::window(ui, state, shown);
    runs::show(ui, state, shown, &mut actions);
    drive::step(ui, state, shown, &mut actions);
    state.look_back_at_present(shown, &actions);
    state.had_focus = ui.memory(|memory| memory.focused().is_some());
    actions
}

/// Height of the window without what a sheet may hold: the bars, its place below the upper one, and its title, points.
const AROUND_SHEET: f32 = 180.0;

/// A window over the city, below the bar and between the side panels.
fn sheet(ui: &egui::Ui, title: &'static str) -> egui::Window<'static> {
    let top = ui.ctx().content_rect().center_top() + egui::vec2(0.0, 70.0);
    egui::Window::new(title)
        .pivot(egui::Align2::CENTER_TOP)
        .default_pos(top)
        // A long page takes the room that there is; a short one shrinks to what it holds.
        .default_height((ui.ctx().content_rect().height() - AROUND_SHEET).max(100.0))
        .resizable(false)
        .collapsible(false)
}

/// A menu that stays open while one types into its fields; a choice closes it.
fn menu_with_fields() -> egui::containers::menu::MenuConfig {
    let stays = egui::PopupCloseBehavior::CloseOnClickOutside;
    egui::containers::menu::MenuConfig::new().close_behavior(stays)
}

/// Size in pixels of a screen rectangle, at least 1 by 1.
fn pixels(size: egui::Vec2, pixels_per_point: f32) -> [u32; 2] {
    [size.x, size.y].map(|points| (points * pixels_per_point).round().clamp(1.0, 8192.0) as u32)
}

/// Paints the picture of a slot, or a dark rectangle until it is drawn.
fn paint_picture(ui: &egui::Ui, rect: egui::Rect, shown: &ViewModel<'_>, slot: PictureSlot) {
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
