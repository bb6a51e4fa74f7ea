//! More large views of the city, each with a camera of its own, beside the first one.

use super::layers::{self, Canvas};
use super::viewpoint::{CameraMode, Viewpoint};
use super::{PictureRequest, PictureSlot, UiState, ViewModel, city, overlay, rain};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::Overlay;
use city3d_sensors::{PictureKind, Weather};
use city3d_session::RunPhase;
use egui::emath::GuiRounding as _;
use egui::{Sense, Ui};

/// Views besides the first one.
pub const MORE_VIEWS: usize = 2;
/// Of the pixels that a moving picture may have, those of a view beside the first one.
const PIXEL_SHARE: u32 = 3;

/// The views besides the first one.
#[derive(Clone, Debug)]
pub struct MoreViews {
    cameras: [Viewpoint; MORE_VIEWS],
    /// Lines and surfaces in the city over their pictures: what the layers show.
    pub overlays: [Overlay; MORE_VIEWS],
}

impl MoreViews {
    /// Cameras that look at all vehicles, from above and at an angle.
    pub fn around(snapshot: &FrameSnapshot) -> Self {
        let mut cameras = [(); MORE_VIEWS].map(|()| Viewpoint::around(snapshot));
        cameras[0].set_mode(CameraMode::Overhead, None);
        Self { cameras, overlays: Default::default() }
    }
}

/// Shows one of the views.
pub fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, index: usize) {
    modes(ui, state, shown, index);
    let pixels_per_point = ui.ctx().pixels_per_point();
    let rect = ui.available_rect_before_wrap().round_to_pixels(pixels_per_point);
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    let camera = &mut state.views.cameras[index];
    city::move_camera(ui, &response, camera, shown.interpolated);
    camera.update(shown.interpolated);
    camera.begin(shown.interpolated, shown.map, shown.control_zones);
    let moves = shown.run_state.phase == RunPhase::Running || response.dragged();
    let most = shown.most_moving_pixels.filter(|_| moves).map(|most| most / PIXEL_SHARE);
    let extent = city::extent(rect, pixels_per_point, most);
    camera.show_whole(shown.interpolated, extent, shown.walls);
    let view = camera.view(shown.interpolated, extent);
    let slot = PictureSlot::View(index);
    state.pictures.push(PictureRequest { slot, view, kind: PictureKind::Rgb });
    super::paint_picture(ui, rect, shown, slot);
    if state.look.weather == Weather::Rain {
        let mode = state.views.cameras[index].mode;
        rain::paint(&ui.painter_at(rect), rect, mode, shown.interpolated.time_s);
    }
    let canvas = Canvas::new(ui, &view, rect).of(&state.views.cameras[index]);
    state.views.overlays[index] = overlay::build(state, shown, &canvas);
    layers::paint(&canvas, state, shown);
    if let Some(at) = response.interact_pointer_pos().filter(|_| response.clicked()) {
        let named = layers::label_at(&canvas, state, shown, at);
        state.selection.vehicle = named.or_else(|| city::pick(&canvas, shown, at));
        state.table.reveal = state.selection.vehicle.is_some();
    }
}

/// The modes of the camera, and whom it follows.
fn modes(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, index: usize) {
    let selected = state.selection.vehicle;
    let camera = &mut state.views.cameras[index];
    ui.horizontal_wrapped(|ui| {
        for mode in CameraMode::ALL {
            if ui.selectable_label(camera.mode == mode, mode.label()).clicked() {
                let nearest = selected.or(camera.follow).or_else(|| camera.nearest(shown.interpolated));
                camera.choose_mode(mode, nearest);
            }
        }
        if let Some(id) = camera.follow.filter(|id| shown.interpolated.info(*id).is_some()) {
            ui.label(city::whose_camera(id, selected, shown));
        }
        let follow = ui.add_enabled(selected.is_some(), egui::Button::new("Follow").small());
        if follow.on_hover_text("This view follows the selected vehicle").clicked() {
            camera.follow(selected.and_then(|id| shown.interpolated.vehicle(id)));
        }
    });
}
