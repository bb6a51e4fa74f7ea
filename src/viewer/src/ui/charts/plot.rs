//! Plots of the logbook's figures on the screen.

use super::super::preview::{marks, round_step};
use super::super::theme;
use super::hover;
use super::labels::{self, LabelRoom};
use city3d_geometry::trig;
use city3d_logbook::figures::chart::{Colour, Dash, Figure, LineName, Panel, ReferenceLine};
use egui::{Align2, Color32, FontId, Painter, Pos2, RichText, Ui};
use egui_plot::{AxisHints, GridMark, HLine, Line, LineStyle, Plot, PlotPoint, PlotPoints, Points, VLine};
use std::borrow::Cow;

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
    // Of panels that share an axis the lowest names it.
    let x_label = figure.panels.iter().map(|panel| panel.x_label.as_str()).rfind(|label| !label.is_empty());
    let x_label = x_label.unwrap_or_default();
    let near = hover::words_near([x_label, &panel.y_label], decimal);
    // Those over time are told for all lines at once, wherever the mouse is.
    let tells_all = across != Across::Anything && !figure.legend.is_empty() && panel.names.is_empty();
    // Of a run that has not begun all is at one time, which is no axis.
    let panel = &with_length(panel);
    // The axes take a part of it.
    let size = egui::vec2((width - AXIS[0]).max(1.0), (height - AXIS[1]).max(1.0));
    let names = ui.new_child(egui::UiBuilder::new());
    let axis = |hints: AxisHints<'static>| theme::small_axis(&names, hints);
    let x = with_room_for_names(&names, panel, size.x);
    let plot = Plot::new(("chart", index))
        .height(height)
        .custom_x_axes(vec![axis(AxisHints::new_x()).label(panel.x_label.as_str()).formatter(number)])
        .custom_y_axes(vec![axis(AxisHints::new_y()).formatter(number)])
        // By themselves small axes have a single number.
        .x_grid_spacer(move |grid| grid_marks(grid.bounds, width / LEAST_BETWEEN[0]))
        .y_grid_spacer(move |grid| grid_marks(grid.bounds, height / LEAST_BETWEEN[1]))
        .label_formatter(move |hovered| near(hovered).filter(|_| !tells_all))
        .default_x_bounds(x.0, x.1)
        .default_y_bounds(panel.y.0, panel.y.1)
        .allow_scroll(false)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_boxed_zoom(false);
    let grey = Color32::from_gray(130);
    let mut room = LabelRoom::new(x, panel.y, size);
    for line in &panel.lines {
        for piece in pieces(&line.points) {
            room.add_line(&decimated(piece, x, NAME_BUCKETS));
        }
    }
    for rule in panel.rules.iter().filter(|rule| rule.is_level) {
        room.add_line(&[[x.0, rule.at], [x.1, rule.at]]);
    }
    let per_point = (panel.y.1 - panel.y.0) / f64::from(size.y);
    let level_names = level_names(panel, f64::from(theme::SMALL) * LINE * per_point);
    let mut words = Vec::new();
    let shown = plot.show(ui, |plot| {
        plot.set_plot_bounds(egui_plot::PlotBounds::from_min_max([x.0, panel.y.0], [x.1, panel.y.1]));
        for rule in &panel.rules {
            let style = LineStyle::dashed_loose();
            if rule.is_level {
                plot.hline(HLine::new(rule.name.clone(), rule.at).color(grey).style(style));
            } else {
                plot.vline(VLine::new(rule.name.clone(), rule.at).color(grey).style(style));
            }
            if rule.is_level || rule.name.is_empty() || !(panel.x.0..=panel.x.1).contains(&rule.at) {
                continue;
            }
            let at = PlotPoint::new(rule.at, panel.y.1);
            let anchor = if rule.is_before { Align2::RIGHT_TOP } else { Align2::LEFT_TOP };
            if let Some(lower) = room.place_below(&names, (rule.name.as_str(), at), anchor) {
                words.push((PlotPoint::new(at.x, at.y - lower), anchor, rule.name.as_str()));
            }
        }
        for (at, name) in &level_names {
            let at = PlotPoint::new(x.0, *at);
            let anchor = room.place(&names, (name, at), &[Align2::LEFT_BOTTOM, Align2::LEFT_TOP]);
            words.extend(anchor.map(|anchor| (at, anchor, name.as_str())));
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
            let anchors: &[Align2] = match is_right {
                _ if is_at_edge(panel, end) => {
                    &[Align2::LEFT_CENTER, Align2::LEFT_BOTTOM, Align2::LEFT_TOP, Align2::RIGHT_BOTTOM]
                }
                true => &[Align2::RIGHT_BOTTOM, Align2::RIGHT_TOP, Align2::LEFT_TOP, Align2::LEFT_BOTTOM],
                false => &[Align2::LEFT_BOTTOM, Align2::LEFT_TOP, Align2::RIGHT_BOTTOM, Align2::RIGHT_TOP],
            };
            let at = PlotPoint::new(end.at.0, end.at.1);
            let anchor = room.place(&names, (&end.name, at), anchors);
            words.extend(anchor.map(|anchor| (at, anchor, end.name.as_str())));
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
    let painter = ui.painter_at(shown.response.rect);
    for (at, anchor, name) in words {
        paint_name(&painter, (shown.transform.position_from_point(&at), anchor), name);
    }
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

/// The panel with axes that have a length.
fn with_length(panel: &Panel) -> Cow<'_, Panel> {
    let has = |(from, to): (f64, f64)| to > from && (to - from).is_finite();
    if has(panel.x) && has(panel.y) {
        return Cow::Borrowed(panel);
    }
    let long = |axis: (f64, f64)| if has(axis) { axis } else { (axis.0, axis.0 + 1.0) };
    Cow::Owned(Panel { x: long(panel.x), y: long(panel.y), ..panel.clone() })
}

/// Whether a named line ends at the right edge.
fn is_at_edge(panel: &Panel, end: &LineName) -> bool {
    /// Of the axis.
    const NEAR: f64 = 0.03;
    end.at.0 > panel.x.1 - NEAR * (panel.x.1 - panel.x.0)
}

/// The horizontal axis of a plot of so many points, longer than that of the panel where lines end with their names at its right
/// edge: those stand beside them, where no line is.
fn with_room_for_names(ui: &Ui, panel: &Panel, width: f32) -> (f64, f64) {
    /// Largest part of the plot that names take.
    const MOST: f32 = 0.3;
    let at_edge = panel.names.iter().filter(|end| is_at_edge(panel, end));
    let widest = at_edge.map(|end| labels::size_of(ui, &end.name).x).fold(0.0, f32::max);
    let part = f64::from((widest / width).min(MOST));
    (panel.x.0, panel.x.0 + (panel.x.1 - panel.x.0) / (1.0 - part))
}

/// Height of a line of text in its size.
const LINE: f64 = 1.4;

/// Names of the horizontal reference lines and where each stands. Lines that are too close for a name between them have one in
/// common, above them, which tells them from above.
fn level_names(panel: &Panel, least_apart: f64) -> Vec<(f64, String)> {
    let is_named = |rule: &&ReferenceLine| {
        rule.is_level && !rule.name.is_empty() && (panel.y.0..=panel.y.1).contains(&rule.at)
    };
    let mut rules: Vec<&ReferenceLine> = panel.rules.iter().filter(is_named).collect();
    rules.sort_by(|a, b| b.at.total_cmp(&a.at));
    let groups = rules.chunk_by(|upper, lower| upper.at - lower.at < least_apart);
    let name = |group: &[&ReferenceLine]| {
        let names: Vec<&str> = group.iter().map(|rule| rule.name.as_str()).collect();
        match names[..] {
            [one] => one.to_owned(),
            _ => format!("from above: {}", names.join("; ")),
        }
    };
    groups.map(|group| (group[0].at, name(group))).collect()
}

/// Paints a name in a plot, on a ground that lines behind it do not strike it through.
fn paint_name(painter: &Painter, (at, anchor): (Pos2, Align2), name: &str) {
    let visuals = &painter.ctx().global_style().visuals;
    let font = FontId::proportional(theme::SMALL);
    let text = painter.layout_no_wrap(name.to_owned(), font, visuals.text_color());
    let place = anchor.anchor_size(at, text.size());
    painter.rect_filled(
        place.shrink2(egui::vec2(0.0, 2.0)),
        2.0,
        visuals.extreme_bg_color.gamma_multiply(0.8),
    );
    painter.galley(place.min, text, visuals.text_color());
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
    use city3d_logbook::figures::TidyTable;

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

    fn panel(rules: Vec<ReferenceLine>, ends: &[f64]) -> Panel {
        let end = |x: &f64| LineName { at: (*x, 1.0), name: "4 path2_a".to_owned(), lines: 0..1 };
        let names = ends.iter().map(end).collect();
        Panel { x: (0.0, 40.0), y: (0.0, 150.0), rules, names, ..Panel::default() }
    }

    #[test]
    fn every_level_line_has_a_name_and_close_ones_have_one_in_common() {
        let rule = |at: f64, name: &str| ReferenceLine {
            at,
            is_level: true,
            name: name.to_owned(),
            dash: Dash::Dashed,
            is_before: false,
        };
        let rules = vec![rule(92.0, "merging point"), rule(80.0, "yield line"), rule(87.0, "one car length")];
        let named = level_names(&panel(rules.clone(), &[]), 8.0);
        assert_eq!(named, [(92.0, "from above: merging point; one car length; yield line".to_owned())]);
        let named = level_names(&panel(rules, &[]), 6.0);
        let names: Vec<&str> = named.iter().map(|(_, name)| name.as_str()).collect();
        assert_eq!(names, ["from above: merging point; one car length", "yield line"]);
    }

    #[test]
    fn names_of_lines_that_end_at_the_edge_stand_beside_them() {
        let context = egui::Context::default();
        let mut output = context.run_ui(egui::RawInput::default(), |ui| {
            let width = f64::from(labels::size_of(ui, "4 path2_a").x);
            let (from, to) = with_room_for_names(ui, &panel(Vec::new(), &[12.0, 40.0]), 500.0);
            let room = (to - 40.0) / (to - from) * 500.0;
            assert!(from == 0.0 && (room - width).abs() < 0.5, "{room} points for {width}");
            assert_eq!(with_room_for_names(ui, &panel(Vec::new(), &[12.0]), 500.0), (0.0, 40.0));
        });
        output.textures_delta.clear();
    }

    #[test]
    fn a_figure_of_one_moment_has_axes() {
        let context = egui::Context::default();
        let mut output = context.run_ui(egui::RawInput::default(), |ui| {
            let panels = vec![Panel { x: (0.0, 0.0), y: (3.0, 3.0), ..Panel::default() }];
            let figure = Figure {
                name: "way".to_owned(),
                title: String::new(),
                panels,
                columns: 1,
                row_height: 0.5,
                legend: Vec::new(),
                scale: None,
                note: String::new(),
                table: TidyTable::default(),
            };
            for across in [Across::Anything, Across::Time, Across::ShownTime(0.0)] {
                assert_eq!(show(ui, (&figure, 0, &figure.panels[0]), 120.0, across), None);
            }
        });
        output.textures_delta.clear();
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
