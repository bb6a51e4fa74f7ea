//! Plots of the logbook's figures on the screen.

use super::super::preview::{marks, round_step};
use super::super::theme;
use super::hover;
use super::labels::LabelRoom;
use city3d_geometry::trig;
use city3d_logbook::figures::chart::{Colour, Dash, Figure, Panel};
use egui::{Align2, Color32, RichText, Ui};
use egui_plot::{
    AxisHints, GridMark, HLine, Line, LineStyle, Plot, PlotPoint, PlotPoints, Points, Text, VLine,
};

/// What the horizontal axis of a figure is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) enum Across {
    /// No time.
    Anything,
    /// Time of no run that is shown.
    Time,
    /// Time of the shown run, and which one is shown, seconds; a click goes to another.
    ShownTime(f64),
}

/// One pair of axes; returns the time of a click.
pub(super) fn show(
    ui: &mut Ui,
    (figure, index, panel): (&Figure, usize, &Panel),
    height: f32,
    across: Across,
) -> Option<f64> {
    let at_s = if let Across::ShownTime(at_s) = across { Some(at_s) } else { None };
    let context = ui.ctx().clone();
    let label = match panel.title.as_str() {
        "" => panel.y_label.clone(),
        title => format!("{title}: {}", panel.y_label),
    };
    ui.label(RichText::new(label).small());
    let buckets = (ui.available_width() / 2.0).max(50.0) as usize;
    let width = ui.available_width();
    let decimal = theme::decimal(ui.ctx());
    let number = move |mark: GridMark, _: &std::ops::RangeInclusive<f64>| tick(mark, decimal);
    let axis = |hints: AxisHints<'static>| theme::small_axis(ui, hints);
    // Of panels that share an axis the lowest names it.
    let x_label = figure.panels.iter().map(|panel| panel.x_label.as_str()).rfind(|label| !label.is_empty());
    let x_label = x_label.unwrap_or_default();
    let near = hover::words_near([x_label, &panel.y_label], decimal);
    // Those over time are told for all lines at once, wherever the mouse is.
    let tells_all = across != Across::Anything && !figure.legend.is_empty() && panel.names.is_empty();
    let plot = Plot::new(("chart", index))
        .height(height)
        .custom_x_axes(vec![axis(AxisHints::new_x()).label(panel.x_label.as_str()).formatter(number)])
        .custom_y_axes(vec![axis(AxisHints::new_y()).formatter(number)])
        // By themselves small axes have a single number.
        .x_grid_spacer(move |grid| grid_marks(grid.bounds, width / LEAST_BETWEEN[0]))
        .y_grid_spacer(move |grid| grid_marks(grid.bounds, height / LEAST_BETWEEN[1]))
        .label_formatter(move |hovered| near(hovered).filter(|_| !tells_all))
        .default_x_bounds(panel.x.0, panel.x.1)
        .default_y_bounds(panel.y.0, panel.y.1)
        .allow_scroll(false)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_boxed_zoom(false);
    let (grey, text) = (Color32::from_gray(130), ui.visuals().text_color());
    // The axes take a part of it.
    let size = egui::vec2((width - AXIS[0]).max(1.0), (height - AXIS[1]).max(1.0));
    let (mut room, names) = (LabelRoom::new(panel.x, panel.y, size), ui.new_child(egui::UiBuilder::new()));
    for line in &panel.lines {
        for piece in pieces(&line.points) {
            room.add_line(&decimated(piece, panel.x, NAME_BUCKETS));
        }
    }
    for rule in panel.rules.iter().filter(|rule| rule.is_level) {
        room.add_line(&[[panel.x.0, rule.at], [panel.x.1, rule.at]]);
    }
    let shown = plot.show(ui, |plot| {
        plot.set_plot_bounds(egui_plot::PlotBounds::from_min_max(
            [panel.x.0, panel.y.0],
            [panel.x.1, panel.y.1],
        ));
        for rule in &panel.rules {
            let style = LineStyle::dashed_loose();
            if rule.is_level {
                plot.hline(HLine::new(rule.name.clone(), rule.at).color(grey).style(style));
            } else {
                plot.vline(VLine::new(rule.name.clone(), rule.at).color(grey).style(style));
            }
            let (at, anchor) = match rule.is_level {
                true => (PlotPoint::new(panel.x.0, rule.at), Align2::LEFT_BOTTOM),
                false if rule.is_before => (PlotPoint::new(rule.at, panel.y.1), Align2::RIGHT_TOP),
                false => (PlotPoint::new(rule.at, panel.y.1), Align2::LEFT_TOP),
            };
            let is_inside = match rule.is_level {
                true => (panel.y.0..=panel.y.1).contains(&rule.at),
                false => (panel.x.0..=panel.x.1).contains(&rule.at),
            };
            if !is_inside || rule.name.is_empty() {
                continue;
            }
            let named = (rule.name.as_str(), at);
            let placed = match rule.is_level {
                true => room.place(&names, named, &[anchor, Align2::LEFT_TOP]).map(|anchor| (at, anchor)),
                false => room
                    .place_below(&names, named, anchor)
                    .map(|lower| (PlotPoint::new(at.x, at.y - lower), anchor)),
            };
            if let Some((at, anchor)) = placed {
                let words = RichText::new(&rule.name).size(theme::SMALL);
                plot.text(Text::new("", at, words).anchor(anchor).color(text));
            }
        }
        for (index, line) in panel.lines.iter().enumerate() {
            let key = figure.legend.iter().find(|key| key.stroke == line.stroke).map(|key| &key.name);
            let own = panel.names.iter().find(|end| end.lines.contains(&index)).map(|end| &end.name);
            let name = own.or(key).map_or("", String::as_str);
            let colour = on_ground(&context, line.stroke.colour);
            for piece in pieces(&line.points) {
                let points: PlotPoints<'_> = decimated(piece, panel.x, buckets).into();
                let width = if line.stroke.width_pt > WIDE_PT { 2.5 } else { 1.5 };
                let drawn = Line::new(name, points).color(colour).width(width).allow_hover(!tells_all);
                plot.line(drawn.style(style_of(line.stroke.dash)));
            }
        }
        for end in &panel.names {
            let is_right = end.at.0 > (panel.x.0 + panel.x.1) / 2.0;
            let anchors = match is_right {
                true => [Align2::RIGHT_BOTTOM, Align2::RIGHT_TOP, Align2::LEFT_TOP, Align2::LEFT_BOTTOM],
                false => [Align2::LEFT_BOTTOM, Align2::LEFT_TOP, Align2::RIGHT_BOTTOM, Align2::RIGHT_TOP],
            };
            let at = PlotPoint::new(end.at.0, end.at.1);
            if let Some(anchor) = room.place(&names, (&end.name, at), &anchors) {
                let words = RichText::new(&end.name).size(theme::SMALL);
                plot.text(Text::new("", at, words).anchor(anchor).color(text));
            }
        }
        if let Some(at_s) = at_s {
            plot.vline(VLine::new("shown time", at_s).color(grey).width(1.0));
        }
        let at = plot.pointer_coordinate().filter(|_| tells_all && plot.response().hovered());
        // What is told, dotted and gone to is one state.
        if let Some(time_s) = at.and_then(|at| hover::nearest_time_s(panel, at.x)) {
            for (key, value) in hover::values_at(&figure.legend, panel, time_s) {
                let colour = on_ground(&context, key.stroke.colour);
                let dot = Points::new("", [time_s, value]).color(colour).radius(DOT).allow_hover(false);
                plot.points(dot);
            }
        }
        plot.response().clicked().then(|| plot.pointer_coordinate()).flatten()
    });
    if across == Across::Anything {
        return None;
    }
    let state_near =
        |time_s: f64| if tells_all { hover::nearest_time_s(panel, time_s) } else { Some(time_s) };
    let pointed = shown.response.hover_pos().map(|at| shown.transform.value_from_position(at).x);
    let pointed = pointed.and_then(state_near);
    let values = pointed.map_or_else(Vec::new, |time_s| hover::values_at(&figure.legend, panel, time_s));
    shown.response.on_hover_ui_at_pointer(|ui| {
        if let Some(time_s) = pointed.filter(|_| !values.is_empty()) {
            ui.label(hover::words_at([x_label, &panel.y_label], (time_s, &values), decimal));
        }
        if at_s.is_some() {
            ui.label("Click to go to that time");
        }
    });
    at_s.and(shown.inner).and_then(|point| state_near(point.x))
}

/// Lines that are wider on paper are wide on the screen too, points.
const WIDE_PT: f64 = 2.0;
/// Radius of a dot on a line at the time under the mouse, points.
const DOT: f32 = 3.0;
/// Steps of the axis in which names avoid lines.
const NAME_BUCKETS: usize = 60;

/// What the numbers of the axes take of the width and of the height, about, points.
const AXIS: [f32; 2] = [40.0, 30.0];
/// Room of an axis for each of its numbers, across and down, points.
const LEAST_BETWEEN: [f32; 2] = [90.0, 40.0];

/// Grid lines at round numbers, so many steps apart that each has room for its number; never fewer than two.
fn grid_marks((from, to): (f64, f64), parts: f32) -> Vec<GridMark> {
    marks((from, to), round_step(to - from, f64::from(parts).clamp(3.0, 10.0)))
}

fn style_of(dash: Dash) -> LineStyle {
    match dash {
        Dash::Solid => LineStyle::Solid,
        Dash::Dashed => LineStyle::dashed_loose(),
        Dash::Dotted => LineStyle::dotted_dense(),
        Dash::DashDotted => LineStyle::dashed_dense(),
    }
}

/// A number of an axis, with the decimals that its steps have.
fn tick(mark: GridMark, decimal: theme::DecimalSeparator) -> String {
    let decimals = (-trig::log10(mark.step_size)).ceil().max(0.0) as usize;
    decimal.fixed(mark.value + 0.0, decimals)
}

/// The parts of a line between values that are not numbers.
fn pieces(points: &[(f64, f64)]) -> impl Iterator<Item = &[(f64, f64)]> {
    points.split(|(x, y)| !(x.is_finite() && y.is_finite())).filter(|piece| !piece.is_empty())
}

/// A line with so many steps over its axis: of each step its least and its largest value, so that no peak is lost.
fn decimated(points: &[(f64, f64)], (from, to): (f64, f64), buckets: usize) -> Vec<[f64; 2]> {
    if points.len() <= 2 * buckets {
        return points.iter().map(|&(x, y)| [x, y]).collect();
    }
    let bucket = |x: f64| ((x - from) / (to - from).max(1e-9) * buckets as f64).floor() as i64;
    let mut kept = Vec::with_capacity(2 * buckets);
    for chunk in points.chunk_by(|a, b| bucket(a.0) == bucket(b.0)) {
        let low = (0..chunk.len()).min_by(|a, b| chunk[*a].1.total_cmp(&chunk[*b].1)).unwrap_or(0);
        let high = (0..chunk.len()).max_by(|a, b| chunk[*a].1.total_cmp(&chunk[*b].1)).unwrap_or(0);
        let (first, second) = (low.min(high), low.max(high));
        kept.push([chunk[first].0, chunk[first].1]);
        if second != first {
            kept.push([chunk[second].0, chunk[second].1]);
        }
    }
    kept
}

/// A colour of figures, which are made for paper, or of a body, as it is legible in this theme.
pub(super) fn on_ground(context: &egui::Context, [r, g, b]: Colour) -> Color32 {
    theme::line_on_ground(context, Color32::from_rgb(r, g, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_drawn_with_few_points_and_all_its_peaks() {
        let peak = 7777;
        let points: Vec<(f64, f64)> = (0..30_000)
            .map(|k| (f64::from(k) * 0.1, if k == peak { 50.0 } else { f64::from(k % 7) }))
            .collect();
        let drawn = decimated(&points, (0.0, 3000.0), 200);
        assert!(drawn.len() <= 402, "{}", drawn.len());
        assert!(drawn.is_sorted_by_key(|[x, _]| *x));
        assert!(drawn.contains(&[f64::from(peak) * 0.1, 50.0]));
        assert_eq!(decimated(&points[..50], (0.0, 5.0), 200).len(), 50, "a short one is drawn as it is");
    }

    #[test]
    fn an_axis_has_at_least_two_numbers_however_small_it_is() {
        for bounds in [(0.0, 52.0), (-5.0, 45.0), (0.0, 0.58), (-0.02, 0.021), (0.0, 3000.0), (17.0, 47.0)] {
            for parts in [0.5, 2.0, 6.0] {
                let count = grid_marks(bounds, parts).len();
                assert!((2..=11).contains(&count), "{bounds:?}, {parts}: {count}");
            }
        }
    }
}
