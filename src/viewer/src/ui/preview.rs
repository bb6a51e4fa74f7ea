//! The preview panels: camera picture, pedals and running plots of one vehicle.

mod gauges;
mod plots;

use self::gauges::pedals;
pub use self::plots::KEPT_S;
use self::plots::plots;
pub(super) use self::plots::{marks, round_step};
use super::theme::SpeedUnit;
use super::{
    PictureRequest, PictureSlot, UiAction, UiState, ViewModel, bar, commands, picture_legend, plans, status,
    theme,
};
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleInfo, VehicleState};
use city3d_sensors::{Camera, Lens, Mount, MountPoint, PictureKind, View};
use egui::emath::GuiRounding as _;
use egui::{Align, Color32, ComboBox, Layout, RichText, Sense, Ui, Vec2};
use serde::{Deserialize, Serialize};

/// The camera of a preview.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PreviewCamera {
    /// Behind the windscreen, looking ahead.
    #[default]
    Windscreen,
    /// At the front bumper, looking ahead.
    Bumper,
    /// At the mount point of the windscreen, looking backwards.
    Rear,
    /// Behind and above the vehicle, looking at it.
    Chase,
    /// A camera sensor of the vehicle, by its index.
    Own(usize),
}

/// A camera sensor of a vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioCamera {
    /// Name of the sensor in the scenario.
    pub name: String,
    /// Place and direction on the vehicle, body frame.
    pub mount: Mount,
    /// Field of view and clip planes; a preview replaces the resolution by that of its panel.
    pub lens: Lens,
}

impl PreviewCamera {
    const ALL: [(Self, &'static str); 4] = [
        (Self::Windscreen, "windscreen"),
        (Self::Bumper, "bumper"),
        (Self::Rear, "rear"),
        (Self::Chase, "chase"),
    ];

    /// The camera sensor, if the vehicle has it: another scenario may lack it.
    fn own(self, cameras: &[ScenarioCamera]) -> Option<&ScenarioCamera> {
        if let Self::Own(place) = self { cameras.get(place) } else { None }
    }

    /// Name in the list of cameras. A camera of the scenario that is called as one of the usual ones is told apart.
    fn label(self, cameras: &[ScenarioCamera]) -> String {
        let known = Self::ALL.iter().find(|(eye, _)| *eye == self).map_or(Self::ALL[0].1, |(_, label)| label);
        match self.own(cameras) {
            Some(own) if Self::ALL.iter().any(|(_, label)| *label == own.name) => {
                format!("{} (scenario)", own.name)
            }
            Some(own) => own.name.clone(),
            None => known.to_owned(),
        }
    }

    fn camera(self, vehicle: VehicleId, cameras: &[ScenarioCamera]) -> Camera {
        let back = Mount::Custom {
            place: MountPoint::Windscreen,
            yaw_rad: std::f64::consts::PI,
            pitch_rad: -0.06,
            roll_rad: 0.0,
        };
        match self {
            Self::Windscreen => Camera::onboard(vehicle, Mount::Windscreen),
            Self::Own(_) => {
                Camera::onboard(vehicle, self.own(cameras).map_or(Mount::Windscreen, |own| own.mount))
            }
            Self::Bumper => Camera::onboard(vehicle, Mount::Bumper),
            Self::Rear => Camera::onboard(vehicle, back),
            Self::Chase => Camera::chase(vehicle),
        }
    }
}

/// One preview panel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preview {
    /// The vehicle that the panel shows; at most one panel shows a vehicle.
    pub vehicle: VehicleId,
    /// Camera of the picture.
    pub eye: PreviewCamera,
    /// What the pixels of the picture show.
    pub kind: PictureKind,
}

/// Kinds of pictures, their names in the list and on its button, which is narrow.
const KINDS: [(PictureKind, &str, &str); 4] = [
    (PictureKind::Rgb, "colour", "colour"),
    (PictureKind::Depth, "depth", "depth"),
    (PictureKind::Semantic, "semantic classes", "classes"),
    (PictureKind::Instance, "instances", "instances"),
];
/// Marks a camera of the scenario that is called as a usual one, on the button of the list.
const OF_SCENARIO: &str = "*";

impl Preview {
    /// A panel with the usual camera, in colour.
    pub fn new(vehicle: VehicleId) -> Self {
        Self { vehicle, eye: PreviewCamera::default(), kind: PictureKind::Rgb }
    }

    /// Kind and camera.
    fn label(&self, cameras: &[ScenarioCamera]) -> String {
        let eye = self.eye.label(cameras);
        match KINDS.iter().find(|(kind, ..)| *kind == self.kind) {
            Some((kind, name, _)) if *kind != PictureKind::Rgb => format!("{name}, {eye}"),
            _ => eye,
        }
    }

    /// What finds room on the button of the list: the kind, or of a picture in colour the camera.
    fn short_label(&self, cameras: &[ScenarioCamera]) -> String {
        let kind = KINDS.into_iter().find(|(kind, ..)| *kind == self.kind && *kind != PictureKind::Rgb);
        match (kind, self.eye.own(cameras)) {
            (Some((.., short)), _) => short.to_owned(),
            (None, Some(own)) if self.eye.label(cameras) != own.name => format!("{}{OF_SCENARIO}", own.name),
            (None, _) => self.eye.label(cameras),
        }
    }

    /// The view of its camera, with the lens of `city3d frames` or of the camera sensor.
    pub fn view(&self, seen: &FrameSnapshot, cameras: &[ScenarioCamera], extent: [u32; 2]) -> Option<View> {
        let lens = self.eye.own(cameras).map_or_else(Lens::default, |own| own.lens);
        self.eye.camera(self.vehicle, cameras).view(seen, &Lens { extent, ..lens }).ok()
    }
}

/// Aspect ratio of the pictures, where there is room.
const ASPECT: f32 = 4.0 / 3.0;
/// Height of a panel without its picture, points: plots stacked, plots side by side, and without plots.
const FULL: f32 = 312.0;
const COMPACT: f32 = 222.0;
const LOW: f32 = 162.0;
/// Flattest pictures beside plots, and without them.
const FLAT: f32 = 2.1;
const FLATTEST: f32 = 2.6;
/// Height of the line with the plan.
const PLAN_LINE: f32 = 18.0;

/// Where the plots of a panel are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PlotPlaces {
    Stacked,
    SideBySide,
    /// There is no room for them.
    Nowhere,
}

/// Layout of a panel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PreviewLayout {
    aspect: f32,
    plots: PlotPlaces,
}

impl PreviewLayout {
    /// Sized so that two panels fit at once: the pedals of both are in sight, the plots give way.
    fn of(count: usize, place: Vec2, has_plans: bool) -> Self {
        let each = place.y / 2.0 - if has_plans { PLAN_LINE } else { 0.0 };
        if count < 2 || each >= place.x / ASPECT + FULL {
            return Self { aspect: ASPECT, plots: PlotPlaces::Stacked };
        }
        let aspect =
            |others: f32, flattest: f32| (place.x / (each - others).max(1.0)).clamp(ASPECT, flattest);
        if each >= place.x / FLAT + COMPACT {
            return Self { aspect: aspect(COMPACT, FLAT), plots: PlotPlaces::SideBySide };
        }
        Self { aspect: aspect(LOW, FLATTEST), plots: PlotPlaces::Nowhere }
    }
}

/// Opens the preview of the selected vehicle, else of the first.
pub fn open_first(state: &mut UiState, shown: &ViewModel<'_>) {
    let first = shown.run_state.now.vehicles.first().map(|vehicle| vehicle.id);
    if let Some(vehicle) = state.selection.vehicle.or(first) {
        state.selection.vehicle = Some(vehicle);
        state.toggle_preview(vehicle);
    }
}

/// Shows all previews that are open.
pub fn show_all(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let selected = state.selection.vehicle.filter(|id| !state.previews.iter().any(|p| p.vehicle == *id));
    let add = ui.add_enabled(selected.is_some(), egui::Button::new("+ Selected vehicle"));
    let add = add
        .on_hover_text(commands::PREVIEW.tip(ui.ctx(), "Camera, pedals and plots of the selected vehicle"));
    let add =
        add.on_disabled_hover_text("Select another vehicle first: click it in the city or in the table");
    if let (true, Some(vehicle)) = (add.clicked(), selected) {
        state.toggle_preview(vehicle);
    }
    let layout = PreviewLayout::of(state.previews.len(), ui.available_size(), plans::has_zones(shown));
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        let mut previews = std::mem::take(&mut state.previews);
        previews.retain_mut(|preview| {
            let is_kept =
                ui.push_id(preview.vehicle.0, |ui| show(ui, (preview, layout), state, shown, actions)).inner;
            ui.separator();
            is_kept
        });
        state.previews = previews;
    });
}

/// Shows a panel; `false` once it is closed.
fn show(
    ui: &mut Ui,
    (preview, layout): (&mut Preview, PreviewLayout),
    state: &mut UiState,
    shown: &ViewModel<'_>,
    actions: &mut Vec<UiAction>,
) -> bool {
    let now = &shown.run_state.now;
    let (Some(vehicle), Some(info)) = (now.vehicle(preview.vehicle), now.info(preview.vehicle)) else {
        let text = format!("Vehicle {} is no longer in the city.", preview.vehicle);
        ui.add(egui::Label::new(text).wrap());
        return !ui.small_button("Close preview").clicked();
    };
    let mut is_kept = true;
    let line = egui::vec2(ui.available_width(), ui.spacing().interact_size.y);
    // The button has its place at the right, whatever the status says.
    ui.allocate_ui_with_layout(line, egui::Layout::right_to_left(egui::Align::Center), |ui| {
        is_kept = !ui.small_button("x").on_hover_text("Close this preview").clicked();
        ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
            heading(ui, shown, (vehicle, info));
        });
    });
    // The speed may be wider than its place.
    let width = ui.available_width();
    // Above the picture, whose legend comes and goes.
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let beside = if shown.replay.is_none() { SPEED_WIDTH + DRIVE } else { SPEED_WIDTH };
        // Where the others need a row of their own in any case, it has this one.
        let room = match ui.available_width() {
            all if all < PICKER + beside => all,
            all => all - beside,
        };
        let width = room.clamp(PICKER, WIDEST_PICKER);
        bar::cell(ui, width, |ui| picker(ui, width, preview, shown.cameras_of(preview.vehicle)));
        if shown.replay.is_none() {
            drive_button(ui, (preview.vehicle, shown), state, actions);
        }
        speed(ui, vehicle, (state.preferences.units, shown.scale()));
    });
    picture(ui, preview, (width, layout.aspect), (shown, state));
    pedals(ui, vehicle, (info.is_physical(), shown.has_control_data));
    if let Some((words, tip)) = plans::words(shown, preview.vehicle, state.preferences.decimal) {
        ui.add(egui::Label::new(RichText::new(words).small()).truncate()).on_hover_text(tip);
    }
    plots(ui, (shown, state.preferences.units), vehicle, layout);
    is_kept
}

/// The list of cameras and kinds of pictures.
fn picker(ui: &mut Ui, width: f32, preview: &mut Preview, cameras: &[ScenarioCamera]) {
    let list = ComboBox::from_id_salt("eye")
        .selected_text(preview.short_label(cameras))
        .width(width)
        .truncate()
        // All of it at once: a list that ends early hides kinds.
        .height(400.0);
    let list = list.show_ui(ui, |ui| {
        for (eye, label) in PreviewCamera::ALL {
            ui.selectable_value(&mut preview.eye, eye, label);
        }
        if !cameras.is_empty() {
            ui.separator();
        }
        for place in 0..cameras.len() {
            let own = PreviewCamera::Own(place);
            ui.selectable_value(&mut preview.eye, own, own.label(cameras))
                .on_hover_text("A camera that the scenario gives this vehicle");
        }
        ui.separator();
        for (kind, name, _) in KINDS {
            ui.selectable_value(&mut preview.kind, kind, name);
        }
    });
    let own = preview.eye.own(cameras).map_or("", |_| ". The scenario gives this vehicle that camera");
    let tip = format!("Where the picture is taken from, and what it shows: {}{own}", preview.label(cameras));
    list.response.on_hover_text(tip);
}

/// Which vehicle it is, and its status.
/// Room of a status that is cut, points.
const LEAST_STATUS: f32 = 30.0;

fn heading(ui: &mut Ui, shown: &ViewModel<'_>, (vehicle, info): (&VehicleState, &VehicleInfo)) {
    let [r, g, b] = info.appearance.colour;
    super::vehicles::chip(ui, Color32::from_rgb(r, g, b), info.is_physical());
    ui.label(RichText::new(format!("{} {}", vehicle.id, info.name)).strong());
    // Cut to its dots alone it would run into the button.
    if ui.available_width() < LEAST_STATUS {
        return;
    }
    let colour = theme::on_panel(ui.ctx(), vehicle.status);
    let text = RichText::new(status::label(vehicle.status)).color(colour);
    ui.add(egui::Label::new(text).truncate()).on_hover_ui(|ui| {
        _ = ui.label(status::reason(&commands::key_map::of(ui.ctx()), vehicle, info, shown.map));
    });
}

fn drive_button(
    ui: &mut Ui,
    (vehicle, shown): (VehicleId, &ViewModel<'_>),
    state: &UiState,
    actions: &mut Vec<UiAction>,
) {
    if state.driven() == Some(vehicle) {
        if ui
            .button("Release")
            .on_hover_text(commands::TAKE_CONTROL.tip(ui.ctx(), "Back to its controller"))
            .clicked()
        {
            actions.push(UiAction::GiveBack);
        }
    } else if shown.may_drive(vehicle) {
        let present = commands::PAST_IS_SHOWN.words(&commands::key_map::of(ui.ctx()));
        let drive = ui.add_enabled(!shown.past.is_shown, egui::Button::new("Drive"));
        let tip = commands::TAKE_CONTROL.tip(ui.ctx(), "Take control of this vehicle");
        if drive.on_hover_text(tip).on_disabled_hover_text(present).clicked() {
            actions.push(UiAction::Drive(vehicle));
        }
    }
}

/// The picture, aligned to pixels: one screen pixel per camera pixel. Its legend is below, where it hides nothing.
fn picture(
    ui: &mut Ui,
    preview: &Preview,
    (width, aspect): (f32, f32),
    (shown, state): (&ViewModel<'_>, &mut UiState),
) {
    let per_point = ui.ctx().pixels_per_point();
    let width = (width.max(40.0) * per_point).floor();
    let size = Vec2::new(width, (width / aspect).round()) / per_point;
    let legend = picture_legend::height(ui.painter(), size.x, preview.kind);
    let (rect, response) = ui.allocate_exact_size(size + Vec2::new(0.0, legend), Sense::hover());
    let below = rect.with_min_y(rect.bottom() - legend);
    let words = picture_legend::words(preview.kind);
    if !words.is_empty() {
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &words));
    }
    if !ui.is_rect_visible(rect) {
        return;
    }
    let rect = egui::Rect::from_min_size(rect.min.round_to_pixels(per_point), size);
    let slot = PictureSlot::Preview(preview.vehicle);
    let extent = super::pixels(size, per_point);
    let mut seen = Vec::new();
    if let Some(view) = preview.view(shown.interpolated, shown.cameras_of(preview.vehicle), extent) {
        if preview.kind == PictureKind::Instance {
            seen = picture_legend::seen(&view, shown);
        }
        state.pictures.push(PictureRequest { slot, view, kind: preview.kind });
    }
    super::paint_picture(ui, rect, shown, slot);
    if preview.kind != PictureKind::Rgb {
        // The button of the list has room for the kind alone.
        caption(&ui.painter_at(rect), rect, &preview.eye.label(shown.cameras_of(preview.vehicle)));
    }
    picture_legend::paint(&ui.painter_at(below), below, preview.kind, &seen);
}

/// The name of a camera in the corner of its picture.
fn caption(painter: &egui::Painter, rect: egui::Rect, name: &str) {
    let font = egui::FontId::proportional(11.0);
    let text = painter.layout_no_wrap(name.to_owned(), font, Color32::WHITE);
    let ground = egui::Rect::from_min_size(rect.min, text.size() + Vec2::new(8.0, 4.0));
    painter.rect_filled(ground, 0.0, Color32::from_black_alpha(170));
    painter.galley(ground.min + Vec2::new(4.0, 2.0), text, Color32::WHITE);
}

/// Least and largest width of the list of cameras and kinds; its texts do not widen it, so that nothing below moves, points.
const PICKER: f32 = 92.0;
const WIDEST_PICKER: f32 = 170.0;
/// Room for the button that takes and releases control, points.
const DRIVE: f32 = 66.0;
/// Width of the widest speed with its gear, points.
const SPEED_WIDTH: f32 = 96.0;

fn speed(ui: &mut Ui, vehicle: &VehicleState, (units, scale): (SpeedUnit, LengthScale)) {
    let gear = if vehicle.reverse { "  R" } else { "" };
    let number = units.number(vehicle.speed_mps, scale, theme::decimal(ui.ctx()));
    let number = status::speed_words(vehicle.status, number);
    let text = match status::is_tracked(vehicle.status) {
        true => format!("{number} {}{gear}", units.label()),
        false => format!("{number} {}", units.label()),
    };
    let label = egui::Label::new(RichText::new(text).monospace().strong()).extend();
    // Of one width, so that the row never breaks and nothing below moves.
    let size = Vec2::new(SPEED_WIDTH, ui.spacing().interact_size.y);
    let row = ui.allocate_ui_with_layout(size, Layout::left_to_right(Align::Center), |ui| {
        ui.set_min_width(SPEED_WIDTH);
        ui.add(label)
    });
    row.inner.on_hover_text(match status::is_tracked(vehicle.status) {
        true => "Speed along its heading",
        false => status::NOT_MEASURED_TIP,
    });
}
