//! The large view of the city: picture, overlays, and mouse control.

use super::commands::{
    Binding, CONTROLLERS, Command, DRIVING_KEYS, INDICATE_LEFT, INDICATE_RIGHT, KeyMap, RELEASE, RESET,
    REVERSE, START_OR_PAUSE,
};
use super::inspector;
use super::layers::{self, Canvas};
use super::vehicle_menu::{MenuSubject, VehicleMenu};
use super::{
    PictureRequest, PictureSlot, UiAction, UiState, ViewModel, Viewpoint, editing, legend, map, overlay,
    rain, rulers, status, theme,
};
use city3d_protocol::snapshot::{FrameSnapshot, Status, VehicleId, VehicleState};
use city3d_roadmap::CityMap;
use city3d_sensors::{BoundingBox, PictureKind, Weather};
use city3d_session::{OFF_ROAD_M, RunPhase, is_beside_road};
use egui::emath::GuiRounding as _;
use egui::{Align2, Color32, FontId, Order, PointerButton, Pos2, Rect, Response, RichText, Sense, Ui};
use glam::DVec3;

/// Picking radius, points.
const NEAR_POINTS: f32 = 16.0;
/// Points of scrolling that are one step of zoom.
const SCROLL_STEP: f64 = 40.0;

/// Shows the large view of the city with its overlays, and handles the mouse in it.
pub fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let rect = ui.available_rect_before_wrap().round_to_pixels(ui.ctx().pixels_per_point());
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    state.city_pixels = super::pixels(rect.size(), ui.ctx().pixels_per_point());
    let moves_vehicle = shown.edit.is_some() && {
        let unmoved = state.viewpoint.view(shown.interpolated, super::pixels(rect.size(), 1.0));
        let canvas = Canvas::new(ui, &unmoved, rect);
        let picked = |at| pick(&canvas, shown, at);
        editing::drag(&response, &canvas, picked, state, (shown, &mut *actions))
    };
    if !moves_vehicle {
        move_camera(ui, &response, &mut state.viewpoint, shown.interpolated);
    }
    state.viewpoint.update(shown.interpolated);
    let moves = shown.run_state.phase == RunPhase::Running || response.dragged() || state.is_scrubbing;
    let extent = extent(rect, ui.ctx().pixels_per_point(), shown.most_moving_pixels.filter(|_| moves));
    state.viewpoint.begin(shown.interpolated, shown.map, shown.control_zones);
    state.viewpoint.show_whole(shown.interpolated, extent, shown.walls);
    let dt_s = f64::from(ui.input(|input| input.stable_dt.min(0.1)));
    if state.viewpoint.keep_in_sight(shown.interpolated, shown.walls, dt_s) {
        ui.ctx().request_repaint();
    }
    let view = state.viewpoint.view(shown.interpolated, extent);
    state.pictures.push(PictureRequest { slot: PictureSlot::City, view, kind: PictureKind::Rgb });
    super::paint_picture(ui, rect, shown, PictureSlot::City);
    if state.look.weather == Weather::Rain {
        rain::paint(&ui.painter_at(rect), rect, state.viewpoint.mode, shown.interpolated.time_s);
    }
    let canvas = Canvas::new(ui, &view, rect).of(&state.viewpoint);
    let pointed = response.hover_pos();
    state.measure.point_at(pointed.and_then(|at| canvas.ground_at(at)));
    act_on_clicks(&response, &canvas, state, (shown, actions));
    let mut overlay = overlay::build(state, shown, &canvas);
    editing::add_overlay(&mut overlay, state, shown, pointed.and_then(|at| canvas.ground_at(at)));
    state.overlay = overlay;
    state.tints = state.layers.colour.tints(ui.ctx(), shown);
    layers::paint(&canvas, state, shown);
    state.measure.paint(&canvas);
    let instruction = editing::paint(&canvas, state, shown, pointed.and_then(|at| canvas.ground_at(at)));
    rulers::paint(&canvas, state, shown, pointed);
    let legend = legend::show(ui, rect, state, shown);
    if state.layers.map {
        map::show(ui, rect, state, shown);
    }
    followed(ui, rect, state, shown);
    let dashboard = dashboard(ui, rect, state, shown);
    loading(ui, rect, shown);
    // Above what one reads meanwhile: speed and pedals, or what the next click does.
    let over = [dashboard, instruction].into_iter().flatten().map(|rect| rect.top());
    let bottom = over.fold(rect.bottom() - PAST_SIGN, f32::min);
    notice(ui, (rect, bottom, legend), state, shown);
}

/// Height of the sign of the past at the lower edge, points.
const PAST_SIGN: f32 = 50.0;

/// Selects, follows, measures, and opens the menu.
fn act_on_clicks(
    response: &Response,
    canvas: &Canvas<'_>,
    state: &mut UiState,
    (shown, actions): (&ViewModel<'_>, &mut Vec<UiAction>),
) {
    let Some(at) = response.interact_pointer_pos() else { return };
    let ground = canvas.ground_at(at);
    let named = |state: &UiState| layers::label_at(canvas, state, shown, at);
    if response.secondary_clicked() {
        let vehicle = named(state).or_else(|| pick(canvas, shown, at)).map(MenuSubject::Vehicle);
        state.menu = vehicle.or(ground.map(MenuSubject::Place)).map(VehicleMenu::of);
    }
    let is_clicked = response.clicked() || response.double_clicked();
    if !is_clicked || state.measure.click(ground) || editing::click(response, ground, state, shown, actions) {
        return;
    }
    let picked =
        named(state).or_else(|| editing::pick(canvas, shown, at)).or_else(|| pick(canvas, shown, at));
    state.selection.vehicle = picked;
    state.table.reveal = picked.is_some();
    if response.double_clicked() && picked.is_some() {
        state.selection.follow = picked;
    }
}

/// Resolution of the picture, reduced to the pixel budget.
pub fn extent(rect: Rect, pixels_per_point: f32, most: Option<u32>) -> [u32; 2] {
    let [width, height] = super::pixels(rect.size(), pixels_per_point);
    let there = width as f32 * height as f32;
    let scale = most.map_or(1.0, |most| (most as f32 / there).sqrt().min(1.0));
    super::pixels(rect.size(), pixels_per_point * scale)
}

/// Turns, shifts and zooms a camera by the mouse; the ground under the mouse stays there while the wheel zooms.
pub fn move_camera(ui: &Ui, response: &Response, camera: &mut Viewpoint, seen: &FrameSnapshot) {
    let delta = response.drag_delta();
    let (right, down) = (f64::from(delta.x), f64::from(delta.y));
    let shifts = ui.input(|input| input.modifiers.shift);
    if response.dragged_by(PointerButton::Primary) && !shifts {
        camera.turn(right, down);
    } else if response.dragged() {
        camera.shift(right, down);
    }
    if response.hovered() {
        let (scroll, zoom) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        let steps = f64::from(scroll) / SCROLL_STEP + f64::from(zoom - 1.0) * 8.0;
        if steps != 0.0 {
            let view = camera.view(seen, super::pixels(response.rect.size(), 1.0));
            let canvas = Canvas::new(ui, &view, response.rect);
            camera.zoom_at(steps, response.hover_pos().and_then(|at| canvas.ground_at(at)));
        }
    }
}

/// Picking: the vehicle at a screen point, of several the nearest to the camera.
pub fn pick(canvas: &Canvas<'_>, shown: &ViewModel<'_>, at: Pos2) -> Option<VehicleId> {
    let hits = shown.interpolated.iter().filter_map(|(vehicle, info)| {
        let d = &info.dimensions;
        let forward = vehicle.orientation * DVec3::X * (d.length_m / 2.0);
        let middle = vehicle.position + DVec3::Z * (d.height_m / 2.0);
        let [front, centre, rear] = [middle + forward, middle, middle - forward].map(|p| canvas.place(p));
        let centre = centre?;
        let reach = front.zip(rear).map_or(0.0, |(front, rear)| front.distance(rear) / 2.0);
        let distance = distance_to_segment(at, front.unwrap_or(centre), rear.unwrap_or(centre));
        (distance < NEAR_POINTS.max(0.45 * reach)).then_some((canvas.depth(middle), vehicle.id))
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, id)| id)
}

/// Where the vehicle is on the screen that the user looks at: the followed one, else the selected one.
pub fn watched(state: &UiState, shown: &ViewModel<'_>, rect: Rect) -> Option<Rect> {
    on_screen(state.viewpoint.follow.or(state.selection.vehicle)?, state, shown, rect)
}

/// Where a vehicle is in the view; `None` where it is out of it.
fn on_screen(id: VehicleId, state: &UiState, shown: &ViewModel<'_>, rect: Rect) -> Option<Rect> {
    let seen = shown.interpolated.vehicle(id).zip(shown.interpolated.info(id))?;
    let view = state.pictures.iter().find(|picture| picture.slot == PictureSlot::City)?.view;
    let place = |corner: DVec3| layers::place_of(&view, rect, corner);
    let (vehicle, info) = seen;
    let corners: Vec<Pos2> = BoundingBox::of(vehicle, info).corners().into_iter().filter_map(place).collect();
    let on_screen = Rect::from_points(&corners).intersect(rect);
    on_screen.is_positive().then_some(on_screen)
}

fn distance_to_segment(point: Pos2, from: Pos2, to: Pos2) -> f32 {
    let along = to - from;
    let share = if along.length_sq() > 0.0 { (point - from).dot(along) / along.length_sq() } else { 0.0 };
    point.distance(from + along * share.clamp(0.0, 1.0))
}

/// Slower than this backwards, the dashboard shows a speed without its sign: it would be 0.
const ROLLS_BACK_MPS: f64 = 0.15;

/// Speed and pedals of the vehicle that the user drives; returns where they are.
fn dashboard(ui: &Ui, rect: Rect, state: &UiState, shown: &ViewModel<'_>) -> Option<Rect> {
    let driving = state.driving.as_ref()?;
    let vehicle = shown.run_state.now.vehicle(driving.vehicle)?;
    let pedals = driving.driver().pedals();
    let gear = match (pedals.reverse, driving.driver().is_shifting()) {
        (_, true) => "stop before you change gear",
        (true, false) => "gear R",
        (false, false) => "gear D",
    };
    let arrows = match pedals.indicator {
        city3d_protocol::snapshot::Indicator::Off => "",
        city3d_protocol::snapshot::Indicator::Left => "\u{25c0} ",
        city3d_protocol::snapshot::Indicator::Right => " \u{25b6}",
        city3d_protocol::snapshot::Indicator::Hazard => "\u{25c0} \u{25b6}",
    };
    let (units, scale) = (state.preferences.units, shown.scale());
    // Backwards it is negative, as in the table: in gear D a vehicle may roll back.
    let speed_mps =
        if vehicle.speed_mps > -ROLLS_BACK_MPS { vehicle.speed_mps.abs() } else { vehicle.speed_mps };
    let speed = units.dashboard(speed_mps, scale, state.preferences.decimal);
    let speed = status::speed_words(vehicle.status, speed);
    let trouble = trouble(state, shown, vehicle, pedals.reverse);
    let place = vehicle.position.truncate();
    let left = || map::way_back(shown.map, place);
    let is_off = || is_beside_road(shown.map, place) && !shown.roads_out.is_near(place, OFF_ROAD_M);
    let beside = || is_off().then(|| OFF_ROAD.to_owned());
    let trouble = trouble.or_else(left).or_else(beside);
    let lines = driving_keys(&state.keys, driving.is_by_device());
    let area = egui::Area::new(ui.scope_id().with("dashboard"))
        // Above the rulers, and low: the rear of the vehicle is just above it.
        .fixed_pos(rect.center_bottom() - egui::vec2(0.0, rulers::height(rect)))
        .pivot(Align2::CENTER_BOTTOM)
        .show(ui.ctx(), |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.spacing_mut().item_spacing.y = 1.0;
                ui.set_max_width((rect.width() - 24.0).max(SPEED_WIDTH));
                if let Some(trouble) = trouble {
                    ui.label(RichText::new(trouble).strong().color(ui.visuals().warn_fg_color));
                }
                ui.horizontal(|ui| {
                    let speed = RichText::new(speed).size(22.0).strong();
                    let gear = format!("{gear}   {arrows}");
                    // In a small view the help has the keys, and the vehicle needs the room.
                    if rect.width() < KEYS_FROM_WIDTH || rect.height() < KEYS_FROM_HEIGHT {
                        ui.label(speed);
                        ui.label(gear);
                        return;
                    }
                    let size = egui::vec2(SPEED_WIDTH, 0.0);
                    ui.allocate_ui_with_layout(size, egui::Layout::top_down(egui::Align::Center), |ui| {
                        ui.set_width(SPEED_WIDTH);
                        ui.label(speed);
                        ui.label(gear);
                    });
                    ui.vertical(|ui| {
                        let solid = solid_things(shown.map);
                        for line in lines.iter().map(String::as_str).chain([solid]) {
                            ui.add(egui::Label::new(RichText::new(line).small()).extend());
                        }
                    });
                });
            });
        });
    Some(area.response.rect)
}

/// Width of the speed and the gear on the dashboard, points.
const SPEED_WIDTH: f32 = 112.0;
/// In a smaller view the dashboard does without the keys, points.
const KEYS_FROM_WIDTH: f32 = 460.0;
const KEYS_FROM_HEIGHT: f32 = 300.0;

/// What a driver is told beside the road.
const OFF_ROAD: &str = "Off the road: drive back onto a lane";

/// What stops a car, and what it passes through.
fn solid_things(map: &CityMap) -> &'static str {
    match map.scenery.iter().any(|piece| piece.kind.is_solid()) {
        true => "solid: traffic, buildings, walls, hedges; not trees, people",
        false => "solid: traffic; not buildings, trees, people",
    }
}

/// The keys of a driver, in the lines of the dashboard.
fn driving_keys(keys: &KeyMap, is_by_device: bool) -> Vec<String> {
    let held = &DRIVING_KEYS;
    let first = |bindings: &[Binding]| {
        let keys: Vec<String> = bindings.iter().map(|binding| keys.first(binding)).collect();
        keys.join(" ")
    };
    let release = format!("{} releases", first(&[RELEASE.binding()]));
    if is_by_device {
        return vec![format!(
            "by gamepad or wheel   {} its buttons   {release}",
            first(&[CONTROLLERS.binding()])
        )];
    }
    let pedals = format!(
        "{} pedals   {} steer   {} handbrake   {} reverse gear",
        first(&[held.gas, held.brake]),
        first(&[held.left, held.right]),
        first(&[held.handbrake]),
        first(&[REVERSE.binding()])
    );
    let signs = format!(
        "{} indicators   {} look back   {release}",
        first(&[INDICATE_LEFT.binding(), INDICATE_RIGHT.binding()]),
        first(&[held.look_back])
    );
    vec![pedals, signs]
}

/// Why the vehicle does not obey its driver.
fn trouble(state: &UiState, shown: &ViewModel<'_>, vehicle: &VehicleState, reverse: bool) -> Option<String> {
    let status = vehicle.status;
    let keys = &state.keys;
    let of = |command: &Command| keys.first(&command.binding());
    let gas = keys.first(&DRIVING_KEYS.gas);
    match (&shown.run_state.phase, status) {
        (RunPhase::Over, _) if state.runs.end_card.is_open() => {
            Some(format!("The run has finished: Continue on its card, or {} to start again", of(&RESET)))
        }
        (RunPhase::Over, _) => Some(format!(
            "The run has finished: {} continues, {} starts again",
            of(&START_OR_PAUSE),
            of(&RESET)
        )),
        (RunPhase::Running, Status::Collided) => {
            let gear = of(&REVERSE);
            Some(match (struck_is_ahead(shown, vehicle), reverse) {
                (Some(is_ahead), reverse) if is_ahead == reverse => {
                    format!("Collided: {gas} drives off, away from what was hit")
                }
                (Some(_), _) => {
                    format!("Collided: {gear} (gear) then {gas} drives off; {gas} alone pushes on")
                }
                (None, _) => format!("Collided: drive off, away from what was hit; {gear} changes the gear"),
            })
        }
        (RunPhase::Running, _) | (RunPhase::Failed(_), _) => None,
        (RunPhase::Paused, _) if shown.has_begun() => {
            Some(format!("Paused: {} continues the run", of(&START_OR_PAUSE)))
        }
        _ => Some(format!("Paused: {} starts the run", of(&START_OR_PAUSE))),
    }
}

/// Whether the vehicle that one has collided with is ahead of it; `None` where it was no vehicle, or is no longer near.
fn struck_is_ahead(shown: &ViewModel<'_>, vehicle: &VehicleState) -> Option<bool> {
    /// Between the middles of two vehicles that touch, at most, metres.
    const TOUCHING_M: f64 = 9.0;
    let (_, struck) = inspector::last_collision(shown, vehicle.id)?;
    let struck = shown.run_state.now.vehicle(struck?)?;
    let way = (struck.position - vehicle.position).truncate();
    (way.length() < TOUCHING_M).then(|| way.dot(vehicle.forward()) > 0.0)
}

/// Shows what is being loaded; the city stays as it is.
fn loading(ui: &Ui, rect: Rect, shown: &ViewModel<'_>) {
    let Some(what) = shown.loading else { return };
    egui::Area::new(ui.scope_id().with("loading"))
        .fixed_pos(rect.center())
        .pivot(Align2::CENTER_CENTER)
        .interactable(false)
        .show(ui.ctx(), |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.horizontal(|ui| {
                    ui.spinner();
                    ui.label(what);
                });
            });
        });
}

/// The vehicle that a camera goes with, and the selected one where that is another.
pub(super) fn whose_camera(id: VehicleId, selected: Option<VehicleId>, shown: &ViewModel<'_>) -> String {
    let name = |id: VehicleId| {
        shown.interpolated.info(id).map_or_else(|| id.to_string(), |info| format!("{id} {}", info.name))
    };
    let other = selected.filter(|selected| *selected != id);
    let other = other.map_or_else(String::new, |other| format!(", not the selected {}", name(other)));
    format!("{}{other}", name(id))
}

/// Room of the name of the followed vehicle in the corner of the view, about, points.
pub(super) const NAME_OF_CAMERA: egui::Vec2 = egui::vec2(280.0, 34.0);

/// Names the followed vehicle, which has no label.
fn followed(ui: &Ui, rect: Rect, state: &UiState, shown: &ViewModel<'_>) {
    let Some(id) = state.viewpoint.follow else { return };
    let Some((vehicle, info)) = shown.interpolated.vehicle(id).zip(shown.interpolated.info(id)) else {
        return;
    };
    let [r, g, b] = info.appearance.colour;
    let whose = whose_camera(id, state.selection.vehicle, shown);
    let text = format!("{}: {whose}", state.viewpoint.mode.label());
    let painter = ui.painter_at(rect);
    // Beside the map, on two lines where it has to be.
    let beside = if state.layers.map { super::map::beside(rect) } else { rect };
    let room = (beside.width() - 48.0).max(100.0);
    let text = painter.layout(text, FontId::proportional(13.0), Color32::WHITE, room);
    let line = text.rows.first().map_or(0.0, |row| row.height());
    let swatch = line * 0.7;
    let size = text.size() + egui::vec2(swatch + 6.0, 0.0);
    let place = Align2::LEFT_TOP.anchor_size(rect.left_top() + egui::vec2(14.0, 12.0), size);
    painter.rect_filled(place.expand2(egui::vec2(7.0, 4.0)), 4.0, theme::ON_PICTURE);
    let mark = Rect::from_center_size(
        place.left_top() + egui::vec2(swatch / 2.0, line / 2.0),
        egui::Vec2::splat(swatch),
    );
    painter.rect_filled(mark, 2.0, Color32::from_rgb(r, g, b));
    painter.rect_stroke(
        mark,
        2.0,
        (1.0, theme::on_picture(painter.ctx(), vehicle.status)),
        egui::StrokeKind::Outside,
    );
    painter.galley(place.min + egui::vec2(swatch + 6.0, 0.0), text, Color32::WHITE);
}

/// Where panels and dialogs float over the city.
fn floating_windows(context: &egui::Context) -> Vec<Rect> {
    context.memory(|memory| {
        let layers = memory.areas().visible_layer_ids().into_iter();
        let windows = layers.filter(|layer| matches!(layer.order, Order::Middle | Order::Foreground));
        windows.filter_map(|layer| memory.area_rect(layer.id)).collect()
    })
}

/// Shows the message, above a lower edge: at the bottom, for titles and buttons of windows are at the top. At the top, or below
/// the legend there, where a dialog reaches far down, or where it would hide what it tells of alone at the bottom.
fn notice(
    ui: &Ui,
    (rect, bottom, legend): (Rect, f32, Option<Rect>),
    state: &mut UiState,
    shown: &ViewModel<'_>,
) {
    const MARGIN: f32 = 20.0;
    let now_s = ui.input(|input| input.time);
    state.notice = state.notice.take().filter(|(_, until_s)| now_s < *until_s);
    let Some((text, until_s)) = &state.notice else { return };
    // Over all windows: what it tells may be about one of them.
    let layer = egui::LayerId::new(Order::Tooltip, egui::Id::unique("notice"));
    let painter = ui.ctx().layer_painter(layer).with_clip_rect(rect);
    let beside = if state.layers.map { map::beside(rect) } else { rect };
    // Below the name of the followed vehicle.
    let below = if state.viewpoint.follow.is_some() { NAME_OF_CAMERA.y } else { 0.0 };
    let below_legend = legend.map_or(rect.top() + below, |legend| legend.bottom());
    let places = [
        (Align2::CENTER_BOTTOM, rect.with_max_y(bottom)),
        (Align2::CENTER_TOP, beside.with_min_y(beside.top() + below)),
        (Align2::CENTER_TOP, beside.with_min_y(below_legend)),
    ];
    let placed = places.map(|(align, room)| {
        let room = room.shrink(MARGIN);
        let galley = painter.layout(text.clone(), FontId::proportional(14.0), Color32::WHITE, room.width());
        (align.align_size_within_rect(galley.size(), room), galley)
    });
    let collided = shown.interpolated.vehicles.iter().filter(|vehicle| vehicle.status == Status::Collided);
    let told: Vec<Rect> = collided
        .filter_map(|vehicle| on_screen(vehicle.id, state, shown, rect))
        .chain(watched(state, shown, rect))
        .collect();
    let mut panels = floating_windows(ui.ctx());
    panels.extend(legend);
    // Those that have collided before panels that float.
    let hides = |place: &Rect| {
        [&told, &panels].map(|all| all.iter().any(|hidden| hidden.intersects(place.expand(8.0))))
    };
    let [at_bottom, at_top, below_legend] = placed;
    let in_order = match state.runs.is_modal() {
        true => [at_top, below_legend, at_bottom],
        false => [at_bottom, at_top, below_legend],
    };
    let Some((place, galley)) = in_order.into_iter().min_by_key(|(place, _)| hides(place)) else { return };
    painter.rect_filled(place.expand(8.0), 5.0, theme::ON_PICTURE);
    painter.galley(place.min, galley, Color32::WHITE);
    let left = (until_s - now_s).max(0.0);
    ui.ctx().request_repaint_after(std::time::Duration::from_secs_f64(left));
}
