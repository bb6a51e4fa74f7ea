//! The legend in the city view: what the colours of the visible layers mean.

use super::colouring::scale;
use super::{UiState, ViewModel, control_zones, overlay, status};
use city3d_protocol::snapshot::Status;
use egui::{Align2, Color32, FontId, Galley, Painter, Pos2, Rect, Sense, Shape, Stroke, Ui, Vec2};
use std::sync::Arc;

/// A line of the legend.
#[derive(Clone, Debug, PartialEq)]
struct LegendLine {
    mark: LegendMark,
    text: String,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum LegendMark {
    Line(Color32),
    Sign(Status),
    /// Pieces in the colours of some bodies.
    Bodies([Color32; 3]),
    Scale,
}

impl LegendLine {
    fn new(colour: Color32, text: impl Into<String>) -> Self {
        Self { mark: LegendMark::Line(colour), text: text.into() }
    }
}

/// The lines for the visible layers.
fn lines(state: &UiState, shown: &ViewModel<'_>) -> Vec<LegendLine> {
    let layers = &state.layers;
    let mut lines = Vec::new();
    let mut add = |is_visible: bool, colour: Color32, text: &str| {
        if is_visible {
            lines.push(LegendLine::new(colour, text));
        }
    };
    add(layers.lanes, overlay::LANE, "lane");
    add(layers.zones, overlay::CROSSING, "conflict zone: crossing");
    add(layers.zones, overlay::MERGE, "conflict zone: merge");
    if let Some(id) = state.selection.vehicle {
        let has_route = layers.routes || layers.all_routes || shown.edit.is_some();
        add(has_route, overlay::ROUTE, &format!("route of vehicle {id}"));
    }
    add(shown.edit.is_some() && state.editing.is_busy(), overlay::EDITED, "lane of the next click");
    let many = format!("more than {} routes: the wider, the more", overlay::ROUTES_APART);
    let has_many = layers.all_routes && overlay::has_many_routes(state.selection.vehicle, shown);
    add(has_many, overlay::MANY_ROUTES, &many);
    let has_tracks = layers.tracks && shown.edit.is_none();
    if let Some(id) = state.selection.vehicle {
        add(has_tracks, overlay::DRIVEN, &format!("driven path of vehicle {id}, the last 20 s"));
    }
    add(layers.path, overlay::PLANNED, "way ahead, a dot every second");
    let gap = match state.selection.vehicle {
        Some(_) => "gap of the selected vehicle to the one ahead",
        None => "gap to the vehicle ahead",
    };
    add(layers.gaps, overlay::GAP, gap);
    add(layers.gaps, overlay::CLOSE_GAP, "gap of less than 1 s");
    add(layers.measured, overlay::MEASURED, &measured_words(shown));
    add(layers.frusta, overlay::FRUSTUM, "what a camera sees");
    if has_tracks {
        let of_others = if state.selection.vehicle.is_some() { " of the others" } else { "" };
        let text = format!("driven paths{of_others}, the last 20 s, in their colours");
        lines.push(LegendLine { mark: LegendMark::Bodies(some_bodies(shown)), text });
    }
    if layers.all_routes {
        let text = if state.selection.vehicle.is_some() { "routes of the others" } else { "routes" };
        let mark = LegendMark::Bodies(some_bodies(shown));
        lines.push(LegendLine { mark, text: format!("{text}, in their colours") });
    }
    if layers.plans && super::plans::has_any(shown) {
        let mark = LegendMark::Bodies(some_bodies(shown));
        let text = "coordinated plan, a dot every second; bar: where conflicts begin, \"2 in 3.0 s\": when 2 is there";
        lines.push(LegendLine { mark, text: text.to_owned() });
    }
    if layers.control_zones && !lines.is_empty() {
        for (zone, area) in shown.control_zones.iter().enumerate() {
            let text = format!("control zone {}", area.name);
            lines.push(LegendLine::new(control_zones::zone_colour(zone), text));
        }
    }
    lines.extend(colours(state, shown));
    lines
}

/// Colours of the first bodies.
fn some_bodies(shown: &ViewModel<'_>) -> [Color32; 3] {
    let ids: Vec<_> = shown.interpolated.vehicles.iter().map(|vehicle| vehicle.id).collect();
    std::array::from_fn(|k| {
        let id = ids.get(k % ids.len().max(1)).copied().unwrap_or_default();
        overlay::body_colour(shown, id)
    })
}

fn measured_words(shown: &ViewModel<'_>) -> String {
    let decisions = shown.run_state.insight.as_ref().and_then(|insight| insight.decisions.as_ref());
    let is_told =
        decisions.is_some_and(|told| told.is_empty() || told.iter().any(|told| told.measured.is_some()));
    let name = "measured pose";
    if is_told { name.to_owned() } else { format!("{name}: {}", super::inspector::not_told(shown)) }
}

/// What the colours of vehicles mean.
fn colours(state: &UiState, shown: &ViewModel<'_>) -> Vec<LegendLine> {
    let by = state.layers.colour;
    let Some([least, most]) = by.ends(state.preferences, shown.scale()) else {
        let told = [Status::Driving, Status::Yielding, Status::Stopped, Status::Manual, Status::Collided];
        let line = |status: Status| LegendLine {
            mark: LegendMark::Sign(status),
            text: status::label(status).to_owned(),
        };
        // Labels have signs, which the help explains; boxes have the colour alone.
        return if state.layers.boxes { told.map(line).into() } else { Vec::new() };
    };
    vec![LegendLine { mark: LegendMark::Scale, text: format!("{}: {least} to {most}", by.label()) }]
}

const ROW: f32 = 14.0;
const FONT_SIZE: f32 = 11.0;
/// Between the legend and what is beside it, points.
const BESIDE: f32 = 12.0;
/// Width that a text is given where there is hardly any room, points.
const LEAST_TEXT: f32 = 110.0;
const TEXT: Color32 = Color32::from_gray(235);
const GROUND: Color32 = Color32::from_black_alpha(175);
/// Width of the title with the number of lines, points.
const TITLE_WIDTH: f32 = 84.0;
const MARK: f32 = 22.0;
/// Wide enough to read a value of the scale by its colour.
const MARK_WITH_SCALE: f32 = 74.0;

/// Shows the legend at the left edge of a rectangle, below the name of the followed vehicle. A click folds it to its title,
/// for it lies over the city. Returns where it is.
pub fn show(ui: &Ui, rect: Rect, state: &mut UiState, shown: &ViewModel<'_>) -> Option<Rect> {
    let lines = if state.layers.legend { lines(state, shown) } else { Vec::new() };
    if lines.is_empty() {
        return None;
    }
    let painter = ui.painter_at(rect);
    let corner = rect.left_top() + Vec2::new(14.0, 44.0);
    let room = if state.layers.map { super::map::beside(rect) } else { rect };
    let drawn = DrawnLegend::of(&painter, &lines, room.right() - corner.x - BESIDE);
    // By itself it covers little of the view; whoever opens or folds it finds it so again.
    let has_room = drawn.size.x < 0.4 * rect.width() && drawn.size.y < 0.25 * rect.height();
    let is_folded = !state.layers.is_legend_open.unwrap_or(has_room);
    let size = if is_folded { Vec2::new(TITLE_WIDTH, ROW) } else { drawn.size };
    let ground = Rect::from_min_size(corner, size);
    painter.rect_filled(ground.expand(6.0), 4.0, GROUND);
    if !is_folded {
        drawn.paint(&painter, corner, &lines);
    }
    let title =
        if is_folded { format!("\u{23f5} Legend ({})", lines.len()) } else { "\u{23f7} Legend".to_owned() };
    painter.text(corner, Align2::LEFT_TOP, &title, FontId::proportional(FONT_SIZE), TEXT);
    // The title alone: a click on the road behind the rest of it means the road.
    let bar = Rect::from_min_size(corner, Vec2::new(size.x, ROW)).expand(6.0);
    let response = ui.interact(bar.intersect(rect), ui.scope_id().with("legend"), Sense::click());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &title));
    let tip = if is_folded { "Click: show the legend" } else { "Click: fold the legend" };
    if response.on_hover_text(tip).clicked() {
        state.layers.is_legend_open = Some(is_folded);
    }
    Some(ground.expand(6.0))
}

/// The texts of a legend, laid out, and its size with the title.
struct DrawnLegend {
    texts: Vec<Arc<Galley>>,
    /// Width of the marks, points.
    mark: f32,
    size: Vec2,
}

impl DrawnLegend {
    /// Texts that are wider than there is room take several lines.
    fn of(painter: &Painter, lines: &[LegendLine], room: f32) -> Self {
        let font = FontId::proportional(FONT_SIZE);
        let has_scale = lines.iter().any(|line| matches!(line.mark, LegendMark::Scale));
        let mark = if has_scale { MARK_WITH_SCALE } else { MARK };
        let widest = (room - mark).max(LEAST_TEXT);
        let text = |line: &LegendLine| painter.layout(line.text.clone(), font.clone(), TEXT, widest);
        let texts: Vec<_> = lines.iter().map(text).collect();
        let width = texts.iter().map(|text| text.size().x).fold(0.0, f32::max) + mark;
        let height = ROW + texts.iter().map(|text| height_of(text)).sum::<f32>();
        let size = Vec2::new(width.max(TITLE_WIDTH), height);
        Self { texts, mark, size }
    }

    /// Paints the lines below the title.
    fn paint(self, painter: &Painter, corner: Pos2, lines: &[LegendLine]) {
        let mut top = corner.y + ROW;
        for (line, text) in lines.iter().zip(self.texts) {
            let left = Pos2::new(corner.x, top + height_of(&text) / 2.0);
            top += height_of(&text);
            paint_mark(painter, (left, left + Vec2::new(self.mark - 8.0, 0.0)), line.mark);
            let place = Align2::LEFT_CENTER.anchor_size(left + Vec2::new(self.mark, 0.0), text.size());
            painter.galley(place.min, text, Color32::WHITE);
        }
    }
}

/// Height of the lines of a text, points.
fn height_of(text: &Galley) -> f32 {
    ROW * text.rows.len().max(1) as f32
}

fn paint_mark(painter: &Painter, (left, right): (Pos2, Pos2), mark: LegendMark) {
    match mark {
        LegendMark::Line(colour) => {
            painter.add(Shape::line_segment([left, right], Stroke::new(3.0, colour)));
        }
        LegendMark::Sign(of) => status::paint_sign(painter, left.lerp(right, 0.5), 4.0, of),
        LegendMark::Bodies(colours) => {
            for (k, colour) in colours.into_iter().enumerate() {
                let ends = [k, k + 1].map(|end| left.lerp(right, end as f32 / colours.len() as f32));
                painter.add(Shape::line_segment(ends, Stroke::new(3.0, colour)));
            }
        }
        LegendMark::Scale => {
            const STEPS: u8 = 18;
            for step in 0..STEPS {
                let share = |step: u8| f32::from(step) / f32::from(STEPS);
                let ends = [step, step + 1].map(|end| left.lerp(right, share(end)));
                let colour = scale(f64::from(step) / f64::from(STEPS - 1));
                painter.add(Shape::line_segment(ends, Stroke::new(7.0, colour)));
            }
        }
    }
}
