//! The panel Charts: quantities of several vehicles over time, and the figures of `city3d plot`, while a run goes on.

use super::events::named;
use super::preview::{marks, round_step};
use super::theme::{self, DecimalSeparator};
use super::{UiAction, UiState, ViewModel};
use city3d_geometry::trig;
use city3d_logbook::figures::chart::{Colour, Dash, Figure, LegendEntry, Panel};
use city3d_logbook::figures::{FigureScale, Quantity};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::playback::PlaybackCommand;
use city3d_simulation::scenario::counted;
use egui::{Color32, ComboBox, RichText, Ui};
use egui_plot::{
    AxisHints, GridMark, HLine, HoverPosition, Line, LineStyle, Plot, PlotPoint, PlotPoints, Text, VLine,
};

/// What a chart shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChartKind {
    /// A quantity over time.
    Series(Quantity),
    /// Positions along the paths over time, coloured by speed.
    SpaceTime,
    /// Positions of all paths over time, aligned at the merging point.
    Positions,
    /// Speed against position along the first path.
    SpeedAlongPath,
}

impl ChartKind {
    /// The kinds that are not over time for one vehicle each.
    const FIGURES: [Self; 3] = [Self::SpaceTime, Self::Positions, Self::SpeedAlongPath];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Series(quantity) => quantity.label(),
            Self::SpaceTime => "Space-time diagram",
            Self::Positions => "Positions, aligned at the merging point",
            Self::SpeedAlongPath => "Speed along the path",
        }
    }

    /// Whether the traces have to be matched to lanes.
    pub fn needs_lanes(self) -> bool {
        match self {
            Self::Series(quantity) => quantity.needs_lanes(),
            Self::SpaceTime | Self::Positions | Self::SpeedAlongPath => true,
        }
    }

    /// Whether it shows paths, which may merge at several points.
    pub fn is_of_paths(self) -> bool {
        Self::FIGURES.contains(&self)
    }

    /// Whether its horizontal axis is the simulated time.
    fn is_over_time(self) -> bool {
        self != Self::SpeedAlongPath
    }
}

/// Time span of a chart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ChartSpan {
    /// From the start.
    #[default]
    Whole,
    /// The last minute.
    Minute,
    /// The last ten seconds.
    TenSeconds,
}

impl ChartSpan {
    const ALL: [Self; 3] = [Self::Whole, Self::Minute, Self::TenSeconds];

    fn label(self) -> &'static str {
        match self {
            Self::Whole => "whole run",
            Self::Minute => "last 60 s",
            Self::TenSeconds => "last 10 s",
        }
    }

    /// Its length, seconds; infinite for the whole run.
    pub fn length_s(self) -> f64 {
        match self {
            Self::Whole => f64::INFINITY,
            Self::Minute => 60.0,
            Self::TenSeconds => 10.0,
        }
    }
}

/// A merging point that figures of paths can show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MergeChoice {
    /// Name of the lane that begins there, as `city3d plot --merge` takes it.
    pub lane: String,
    /// Number of vehicles that have passed.
    pub vehicles: usize,
}

/// What the user has chosen to be charted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChartState {
    /// What is shown.
    pub kind: ChartKind,
    /// Vehicles that stay in the chart, whichever is selected.
    pub vehicles: Vec<VehicleId>,
    /// Name of the merging point whose paths are shown; without it, one that the kept or
    /// the selected vehicles pass.
    pub merge: Option<String>,
    /// How far back it shows.
    pub span: ChartSpan,
    /// In laboratory units, whatever the settings say.
    pub is_lab: bool,
    /// In which metres, by that choice and by the settings.
    pub scale: FigureScale,
}

impl Default for ChartState {
    fn default() -> Self {
        Self {
            kind: ChartKind::Series(Quantity::Speed),
            vehicles: Vec::new(),
            merge: None,
            span: ChartSpan::default(),
            is_lab: false,
            scale: FigureScale::default(),
        }
    }
}

/// Most vehicles in a chart where none is chosen.
const MOST_VEHICLES: usize = 8;

impl ChartState {
    /// The vehicles of the chart: those that were chosen and the selected one, else the first of all.
    pub fn shown(&self, selected: Option<VehicleId>, all: impl Iterator<Item = VehicleId>) -> Vec<VehicleId> {
        let mut shown = self.vehicles.clone();
        shown.extend(selected.filter(|id| !self.vehicles.contains(id)));
        if shown.is_empty() { all.take(MOST_VEHICLES).collect() } else { shown }
    }
}

/// A chart as it has been computed.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChartView<'a> {
    /// The figure; `None` until it is computed, and where there is none.
    pub figure: Option<&'a Figure>,
    /// Why there is none.
    pub trouble: Option<&'a str>,
    /// Merging points of the run, where the figure is of paths.
    pub merges: &'a [MergeChoice],
    /// Name of the one that is shown.
    pub merge: Option<&'a str>,
    /// It is being computed anew.
    pub is_busy: bool,
    /// Where it was saved last, in words.
    pub saved: Option<&'a str>,
}

/// The controls and the chart, wherever they are docked.
pub(super) fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    ui.horizontal_wrapped(|ui| controls(ui, state, shown, actions));
    merging_point(ui, &mut state.charts, shown.chart);
    vehicles(ui, state, shown);
    if let Some(saved) = shown.chart.saved {
        ui.add(egui::Label::new(RichText::new(saved).small().weak()).truncate()).on_hover_text(saved);
    }
    ui.separator();
    let needs_control_data =
        matches!(state.charts.kind, ChartKind::Series(quantity) if quantity.needs_control_data());
    if needs_control_data && !shown.has_control_data {
        ui.weak("Only poses are known of this city: pedals, steering and desired paths are not.");
        return;
    }
    match (shown.chart.figure, shown.chart.trouble) {
        (Some(figure), _) => draw(ui, state, (figure, shown), actions),
        (None, Some(trouble)) => {
            ui.label(trouble);
            let is_of_some = state.charts.kind.is_of_paths() && !state.charts.vehicles.is_empty();
            if is_of_some && ui.button("Show all vehicles").clicked() {
                state.charts.vehicles.clear();
            }
        }
        (None, None) => _ = ui.spinner(),
    }
}

fn controls(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let charts = &mut state.charts;
    charts.scale = match charts.is_lab {
        true => FigureScale::Laboratory,
        false => state.preferences.units.figure_scale(),
    };
    ComboBox::from_id_salt("chart")
        .selected_text(charts.kind.label())
        .width(150.0)
        .height(400.0)
        .show_ui(ui, |ui| {
            for quantity in Quantity::ALL {
                ui.selectable_value(&mut charts.kind, ChartKind::Series(quantity), quantity.label());
            }
            ui.separator();
            for kind in ChartKind::FIGURES {
                ui.selectable_value(&mut charts.kind, kind, kind.label());
            }
        })
        .response
        .on_hover_text("What the chart shows");
    ComboBox::from_id_salt("chart span")
        .selected_text(charts.span.label())
        .width(80.0)
        .show_ui(ui, |ui| {
            for span in ChartSpan::ALL {
                ui.selectable_value(&mut charts.span, span, span.label());
            }
        })
        .response
        .on_hover_text("How far back the chart shows");
    let tip = "Laboratory metres, as city3d plot draws; else with the unit of speeds of the settings";
    ui.checkbox(&mut charts.is_lab, "laboratory units").on_hover_text(tip);
    let save = ui.add_enabled(shown.chart.figure.is_some(), egui::Button::new("Save"));
    let save = save.on_hover_text("Write the chart as SVG, PNG and CSV into the folder of the run");
    if save.on_disabled_hover_text("There is no chart to write").clicked() {
        actions.push(UiAction::SaveChart);
    }
    if shown.chart.is_busy && shown.chart.figure.is_some() {
        ui.spinner().on_hover_text("Lanes of the vehicles are being found");
    }
}

/// Which of several merging points the paths of the figure meet at.
fn merging_point(ui: &mut Ui, charts: &mut ChartState, chart: ChartView<'_>) {
    if chart.merges.len() < 2 {
        return;
    }
    let shown = chart.merges.iter().find(|merge| Some(merge.lane.as_str()) == chart.merge);
    ui.horizontal_wrapped(|ui| {
        let tip = "Where the paths of the chart come together: the lane that begins there";
        let label = ui.label("Merging point").on_hover_text(tip).id;
        let list = ComboBox::from_id_salt("merging point")
            .selected_text(shown.map_or_else(String::new, merge_words))
            .height(400.0)
            .show_ui(ui, |ui| {
                let own = ui.selectable_value(&mut charts.merge, None, "automatic");
                own.on_hover_text(
                    "One that the kept or the selected vehicles pass, else that of most vehicles",
                );
                ui.separator();
                for merge in chart.merges {
                    let is_shown = Some(&merge.lane) == charts.merge.as_ref();
                    if ui.selectable_label(is_shown, merge_words(merge)).clicked() {
                        charts.merge = Some(merge.lane.clone());
                    }
                }
            });
        list.response.labelled_by(label).on_hover_text(tip);
    });
}

fn merge_words(merge: &MergeChoice) -> String {
    format!("{} ({})", merge.lane, counted(merge.vehicles, "vehicle"))
}

/// The vehicles that stay in the chart, each with a way out of it, and a way in for the selected one. That is first and
/// always there: a second click on it must not meet the way out.
fn vehicles(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    let name = |id: VehicleId| named(shown.names, id);
    ui.horizontal_wrapped(|ui| {
        let selected = state.selection.vehicle.filter(|id| !state.charts.vehicles.contains(id));
        let keep = ui.add_enabled(selected.is_some(), egui::Button::new("+ Keep").small());
        let keep = match selected {
            Some(id) => {
                keep.on_hover_text(format!("Keep {} in the chart when another one is selected", name(id)))
            }
            None => keep.on_disabled_hover_text("Select a vehicle that is not kept yet"),
        };
        let mut removed = None;
        for id in &state.charts.vehicles {
            let text = format!("{} \u{d7}", name(*id));
            if ui.small_button(text).on_hover_text("Take it out of the chart").clicked() {
                removed = Some(*id);
            }
        }
        state.charts.vehicles.retain(|id| Some(*id) != removed);
        if keep.clicked() {
            state.charts.vehicles.extend(selected);
        }
        match selected {
            Some(id) => _ = ui.label(RichText::new(format!("selected: {}", name(id))).weak()),
            None if state.charts.vehicles.is_empty() && state.charts.kind.is_of_paths() => {
                ui.weak("All vehicles on the paths; select one to keep it alone.");
            }
            None if state.charts.vehicles.is_empty() => {
                ui.weak(format!("The first {MOST_VEHICLES} vehicles; select one to see it alone."));
            }
            None => {}
        }
    });
}

/// Draws a figure of the logbook.
fn draw(
    ui: &mut Ui,
    state: &UiState,
    (figure, shown): (&Figure, &ViewModel<'_>),
    actions: &mut Vec<UiAction>,
) {
    legend(ui, figure);
    if let Some(scale) = &figure.scale {
        let [from, to] = [scale.from, scale.to].map(|end| state.preferences.decimal.fixed(end, 2));
        ui.weak(format!("{}: {from} dark to {to} light", scale.label));
    }
    let note_height = 30.0;
    let count = figure.panels.len().max(1) as f32;
    let height = ((ui.available_height() - note_height) / count - 18.0).max(80.0);
    let is_over_time = state.charts.kind.is_over_time();
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        for (index, panel) in figure.panels.iter().enumerate() {
            let at_s = is_over_time.then_some(shown.run_state.now.time_s);
            if let Some(time_s) = plot(ui, (figure, index, panel), height, at_s) {
                actions.push(UiAction::PlaybackCommand(PlaybackCommand::Seek(time_s)));
            }
        }
        ui.label(RichText::new(&figure.note).small().weak());
    });
}

fn legend(ui: &mut Ui, figure: &Figure) {
    ui.horizontal_wrapped(|ui| {
        for key in &figure.legend {
            let colour = on_ground(ui.ctx(), key.stroke.colour);
            let text = format!("{} {}", sample(key.stroke.dash), key.name);
            ui.label(RichText::new(text).small().color(colour));
        }
    });
}

/// A figure of the logbook that shows no time of the run.
pub(super) fn draw_over_time(ui: &mut Ui, figure: &Figure) {
    legend(ui, figure);
    for (index, panel) in figure.panels.iter().enumerate() {
        let height = (ui.available_height() - 60.0).max(80.0);
        plot(ui, (figure, index, panel), height, None);
    }
    ui.label(RichText::new(&figure.note).small().weak());
}

/// One pair of axes; returns the time of a click.
fn plot(
    ui: &mut Ui,
    (figure, index, panel): (&Figure, usize, &Panel),
    height: f32,
    at_s: Option<f64>,
) -> Option<f64> {
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
    let near = hover_words([x_label, &panel.y_label], decimal);
    // Those over time are told for all lines at once, wherever the mouse is.
    let tells_all = at_s.is_some() && !figure.legend.is_empty();
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
                true => (PlotPoint::new(panel.x.0, rule.at), egui::Align2::LEFT_BOTTOM),
                false if rule.is_before => (PlotPoint::new(rule.at, panel.y.1), egui::Align2::RIGHT_TOP),
                false => (PlotPoint::new(rule.at, panel.y.1), egui::Align2::LEFT_TOP),
            };
            let is_inside = match rule.is_level {
                true => (panel.y.0..=panel.y.1).contains(&rule.at),
                false => (panel.x.0..=panel.x.1).contains(&rule.at),
            };
            if is_inside && !rule.name.is_empty() {
                let words = RichText::new(&rule.name).size(theme::SMALL);
                plot.text(Text::new("", at, words).anchor(anchor).color(text));
            }
        }
        for line in &panel.lines {
            let key = figure.legend.iter().find(|key| key.stroke == line.stroke);
            let name = key.map_or("", |key| key.name.as_str());
            let colour = on_ground(&context, line.stroke.colour);
            for piece in pieces(&line.points) {
                let points: PlotPoints<'_> = decimated(piece, panel.x, buckets).into();
                plot.line(Line::new(name, points).color(colour).width(1.5).style(style_of(line.stroke.dash)));
            }
        }
        for end in &panel.names {
            let is_right = end.at.0 > (panel.x.0 + panel.x.1) / 2.0;
            let anchor = if is_right { egui::Align2::RIGHT_BOTTOM } else { egui::Align2::LEFT_BOTTOM };
            let words = RichText::new(&end.name).size(theme::SMALL);
            plot.text(Text::new("", PlotPoint::new(end.at.0, end.at.1), words).anchor(anchor).color(text));
        }
        if let Some(at_s) = at_s {
            plot.vline(VLine::new("shown time", at_s).color(grey).width(1.0));
        }
        plot.response().clicked().then(|| plot.pointer_coordinate()).flatten()
    });
    at_s?;
    let pointed = shown.response.hover_pos().map(|at| shown.transform.value_from_position(at).x);
    let values = pointed.map_or_else(Vec::new, |time_s| values_at(&figure.legend, panel, time_s));
    shown.response.on_hover_ui_at_pointer(|ui| {
        if let Some(time_s) = pointed.filter(|_| !values.is_empty()) {
            ui.label(at_words([x_label, &panel.y_label], (time_s, &values), decimal));
        }
        ui.label("Click to go to that time");
    });
    shown.inner.map(|point| point.x)
}

/// The values of the named lines at a place of the horizontal axis, in the order of the legend; a line that ends before it, or
/// has a gap there, has none.
fn values_at<'f>(legend: &'f [LegendEntry], panel: &Panel, x: f64) -> Vec<(&'f str, f64)> {
    /// A sample farther away is none of that place, as a share of the axis.
    const NEAR: f64 = 0.01;
    let reach = NEAR * (panel.x.1 - panel.x.0);
    let nearest = |points: &[(f64, f64)]| {
        let near = points.iter().filter(|(at, value)| (at - x).abs() <= reach && value.is_finite());
        near.min_by(|a, b| (a.0 - x).abs().total_cmp(&(b.0 - x).abs())).map(|(_, value)| *value)
    };
    let of_key = |key: &'f LegendEntry| {
        let line = panel.lines.iter().find(|line| line.stroke == key.stroke)?;
        Some((key.name.as_str(), nearest(&line.points)?))
    };
    legend.iter().filter_map(of_key).collect()
}

/// Values of lines at one time in words. `axes` are the labels of the axes, such as `Speed [km/h]`.
fn at_words(axes: [&str; 2], (x, values): (f64, &[(&str, f64)]), decimal: DecimalSeparator) -> String {
    let axes = axes.map(|label| label.trim_end_matches(']').split_once(" [").unwrap_or((label, "")));
    let [(x_name, x_unit), (_, unit)] = axes;
    let line = |(name, value): &(&str, f64)| {
        format!("{name}: {} {unit}", decimal.fixed(*value, 2)).trim_end().to_owned()
    };
    let head = format!("{x_name}: {} {x_unit}", decimal.fixed(x, 2)).trim_end().to_owned();
    std::iter::once(head).chain(values.iter().map(line)).collect::<Vec<_>>().join("\n")
}

/// Room of an axis for each of its numbers, across and down, points.
const LEAST_BETWEEN: [f32; 2] = [90.0, 40.0];

/// Grid lines at round numbers, so many steps apart that each has room for its number; never fewer than two.
fn grid_marks((from, to): (f64, f64), parts: f32) -> Vec<GridMark> {
    marks((from, to), round_step(to - from, f64::from(parts).clamp(3.0, 10.0)))
}

/// A dash pattern as text.
fn sample(dash: Dash) -> &'static str {
    match dash {
        Dash::Solid => "\u{2014}",
        Dash::Dashed => "- -",
        Dash::Dotted => "\u{b7}\u{b7}\u{b7}",
        Dash::DashDotted => "-\u{b7}-",
    }
}

fn style_of(dash: Dash) -> LineStyle {
    match dash {
        Dash::Solid => LineStyle::Solid,
        Dash::Dashed => LineStyle::dashed_loose(),
        Dash::Dotted => LineStyle::dotted_dense(),
        Dash::DashDotted => LineStyle::dashed_dense(),
    }
}

/// What a plot says of the place under the mouse: whose line is there, and both quantities with their units. `axes` are the
/// labels of its axes, such as `Speed [km/h]`.
pub(super) fn hover_words(
    axes: [&str; 2],
    decimal: DecimalSeparator,
) -> impl Fn(&HoverPosition<'_>) -> Option<String> + use<> {
    let axes = axes.map(|label| label.trim_end_matches(']').to_owned());
    move |hovered| {
        let (whose, position) = match hovered {
            HoverPosition::NearDataPoint { plot_name, position, .. } => (*plot_name, position),
            // The place of the mouse is no value of anybody.
            HoverPosition::Elsewhere { .. } => return None,
        };
        let quantities = axes.iter().zip([position.x, position.y]).map(|(axis, value)| {
            let (name, unit) = axis.split_once(" [").unwrap_or((axis, ""));
            format!("{name}: {} {unit}", decimal.fixed(value, 2)).trim_end().to_owned()
        });
        let lines: Vec<String> = std::iter::once(whose.to_owned()).chain(quantities).collect();
        Some(lines.join("\n").trim_start().to_owned())
    }
}

/// A number of an axis, with the decimals that its steps have.
fn tick(mark: GridMark, decimal: DecimalSeparator) -> String {
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
fn on_ground(context: &egui::Context, [r, g, b]: Colour) -> Color32 {
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

    #[test]
    fn the_chart_shows_what_was_chosen_and_the_selected_one_else_the_first() {
        let mut charts = ChartState::default();
        let all = || (1..=20).map(VehicleId);
        assert_eq!(charts.shown(None, all()).len(), MOST_VEHICLES);
        assert_eq!(charts.shown(Some(VehicleId(9)), all()), [VehicleId(9)]);
        charts.vehicles = vec![VehicleId(3), VehicleId(4)];
        assert_eq!(charts.shown(Some(VehicleId(9)), all()), [3, 4, 9].map(VehicleId));
        assert_eq!(charts.shown(Some(VehicleId(3)), all()), [3, 4].map(VehicleId));
    }

    #[test]
    fn all_lines_are_told_at_the_time_under_the_mouse() {
        use city3d_logbook::figures::chart::{ChartLine, LineStyle};
        let stroke = |red: u8| LineStyle::solid([red, 0, 0]);
        let line = |colour: u8, points: Vec<(f64, f64)>| ChartLine { points, stroke: stroke(colour) };
        let entry = |colour: u8, name: &str| LegendEntry { name: name.to_owned(), stroke: stroke(colour) };
        let first = (0..1000).map(|k| (f64::from(k) * 0.1, f64::from(k))).collect();
        let ends = vec![(0.0, 5.0), (20.0, 6.0), (20.1, f64::NAN), (60.0, 7.0)];
        let panel = Panel { x: (0.0, 100.0), lines: vec![line(2, ends), line(1, first)], ..Panel::default() };
        let legend = [entry(1, "1 a"), entry(2, "2 b"), entry(3, "none")];
        assert_eq!(values_at(&legend, &panel, 20.04), [("1 a", 200.0), ("2 b", 6.0)]);
        assert_eq!(values_at(&legend, &panel, 40.0), [("1 a", 400.0)], "a gap has no value");
        let words = at_words(["Time [s]", "Speed [km/h]"], (20.04, &[("1 a", 2.0)]), DecimalSeparator::Point);
        assert_eq!(words, "Time: 20.04 s\n1 a: 2.00 km/h");
    }

    #[test]
    fn the_place_under_the_mouse_is_told_with_its_vehicle_and_units() {
        let words = hover_words(["Time [s]", "Speed [km/h]"], DecimalSeparator::Comma);
        let position = PlotPoint::new(12.3, 45.678);
        let near = HoverPosition::NearDataPoint { plot_name: "3 path1_c", position, index: 7 };
        assert_eq!(words(&near).unwrap(), "3 path1_c\nTime: 12,30 s\nSpeed: 45,68 km/h");
        let elsewhere = HoverPosition::Elsewhere { position };
        assert_eq!(words(&elsewhere), None, "beside the lines nobody has these values");
    }
}
