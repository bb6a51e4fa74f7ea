//! The space-time diagram of the panel Traffic: everybody on the lanes of the selected vehicle's route.

use super::events::named;
use super::{ChartKind, ChartSpan, UiState, ViewModel, overlay, theme};
use city3d_control::Route;
use city3d_logbook::figures::{FigureScale, WAY_AHEAD_M, WAY_BEHIND_M};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{LaneId, ZoneKind};
use city3d_session::{DIAGRAM_S, LanePlace};
use egui::{Align2, Color32, RichText, Ui};
use egui_plot::{AxisHints, Line, Plot, PlotPoint, PlotPoints, PlotUi, Polygon, Text, VLine};
use std::collections::{BTreeMap, VecDeque};

/// Range of the diagram around the selected vehicle, metres of the city.
const BEHIND_M: f64 = WAY_BEHIND_M;
const AHEAD_M: f64 = WAY_AHEAD_M;
/// Room behind the present for the names of the lines, seconds of the axis.
const NAMES_S: f64 = 17.0;
/// Names less than this apart would touch, points.
const NAMES_APART: f64 = 14.0;
/// What the axis below the diagram takes of its height, points.
const AXIS: f64 = 34.0;
/// Names of the axes.
const TIME_AXIS: &str = "Time before now [s]";
const CITY_AXIS: &str = "Position from its front [m, full scale]";
const LAB_AXIS: &str = "Position from its front [m, laboratory]";
/// Opacity of the bands.
const BAND: f32 = 0.3;

/// Space-time diagram of the selected vehicle's route: everybody on its lanes.
pub(super) fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    let measures = shown.traffic.measures();
    let Some(selected) = state.selection.vehicle else {
        ui.label(RichText::new("Select a vehicle to see the space-time diagram of its route.").weak());
        return;
    };
    let place = measures.vehicle(selected).and_then(|tracked| Some((tracked.route()?, tracked.station?)));
    let Some((route, station)) = place else {
        ui.label(RichText::new("The selected vehicle is not on a known route.").weak());
        return;
    };
    let factor = measures.scale().factor();
    // The list scrolls, so that its own room has no end.
    let height = (ui.clip_rect().bottom() - ui.cursor().top()).clamp(160.0, 400.0);
    let diagram = SpaceTime {
        shown,
        selected,
        starts: lane_starts(route, station.front_s),
        origin_s: station.front_s,
        factor,
        now_s: shown.traffic.measured().until_s(),
        apart_m: NAMES_APART * (BEHIND_M + AHEAD_M) / (f64::from(height) - AXIS),
    };
    let title = format!("Space-time diagram: the way of {}", named(shown.names, selected));
    let tip =
        "Front bumpers along its route: metres before and behind where it is now, over the last seconds";
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new(title).small()).on_hover_text(tip);
        let large =
            "This diagram, large: it can be saved there, and shows the whole run with the span \"whole run\"";
        if ui.small_button("Open in Charts").on_hover_text(large).clicked() {
            state.open.charts = true;
            (state.charts.kind, state.charts.span) = (ChartKind::Way, ChartSpan::Minute);
            // The metres of this diagram.
            state.charts.is_lab = false;
        }
    });
    let bands = bands(route, &diagram);
    keys(ui, &bands);
    let scale = state.preferences.units.figure_scale();
    let (axis, _) = value_axis_of(scale, factor);
    ui.label(RichText::new(axis).size(theme::SMALL));
    plot(ui, height, scale, factor).show(ui, |plot| diagram.draw(plot, &bands));
}

/// A stretch of the route that is in a conflict zone, metres ahead.
struct Band {
    kind: ZoneKind,
    from_m: f64,
    to_m: f64,
}

impl Band {
    fn colour(&self) -> Color32 {
        match self.kind {
            ZoneKind::Cross => overlay::CROSSING,
            ZoneKind::Merge | ZoneKind::Diverge => overlay::MERGE,
        }
    }

    fn words(&self) -> &'static str {
        match self.kind {
            ZoneKind::Cross => "conflict zone: crossing",
            ZoneKind::Merge | ZoneKind::Diverge => "conflict zone: merge",
        }
    }
}

/// The conflict zones in the range of the diagram.
fn bands(route: &Route, diagram: &SpaceTime<'_, '_>) -> Vec<Band> {
    let ahead_m = |s: f64| (s - diagram.origin_s) * diagram.factor;
    let all = route.crossings.iter().map(|crossing| Band {
        kind: crossing.kind,
        from_m: ahead_m(crossing.from_s).max(-BEHIND_M),
        to_m: ahead_m(crossing.to_s).min(AHEAD_M),
    });
    all.filter(|band| band.from_m < band.to_m).collect()
}

/// What the bands and the lines mean.
fn keys(ui: &mut Ui, bands: &[Band]) {
    ui.horizontal_wrapped(|ui| {
        let mut told: Vec<&str> = Vec::new();
        for band in bands {
            if told.contains(&band.words()) {
                continue;
            }
            told.push(band.words());
            let (rect, _) = ui.allocate_exact_size(egui::vec2(14.0, 9.0), egui::Sense::hover());
            ui.painter().rect_filled(rect, 1.0, band.colour().gamma_multiply(BAND));
            ui.label(RichText::new(band.words()).small());
        }
        ui.label(RichText::new("thick: its own line").small().weak());
    });
}

/// Name of the axis of places, which is above it, and its metres for one of the city.
fn value_axis_of(scale: FigureScale, factor: f64) -> (&'static str, f64) {
    match scale {
        FigureScale::City | FigureScale::CityMetresPerSecond => (CITY_AXIS, 1.0),
        FigureScale::Laboratory => (LAB_AXIS, 1.0 / factor),
    }
}

/// The axes, named as those of the figures of `city3d plot` and in the metres of the settings; `factor` is that of the scale.
fn plot(ui: &Ui, height: f32, scale: FigureScale, factor: f64) -> Plot<'static> {
    let small = |text: &str| RichText::new(text).size(theme::SMALL);
    let time =
        theme::small_axis(ui, AxisHints::new_x()).min_thickness(14.0).formatter(|mark, _| match mark.value {
            ahead if ahead > 0.5 => String::new(),
            ago if ago > -0.5 => "now".to_owned(),
            ago => format!("{ago:.0}"),
        });
    let time = time.label(small(TIME_AXIS));
    let (_, per_city_m) = value_axis_of(scale, factor);
    let decimal = theme::decimal(ui.ctx());
    let value = theme::value_axis(ui).formatter(move |mark, _| match mark.value {
        // It would touch the first mark of the time.
        lowest if lowest < 1.0 - BEHIND_M => String::new(),
        value => decimal.plain(value * per_city_m),
    });
    Plot::new("space-time")
        .height(height)
        .width(ui.clip_rect().right() - ui.cursor().left())
        .default_x_bounds(-DIAGRAM_S, NAMES_S)
        .default_y_bounds(-BEHIND_M, AHEAD_M)
        .show_background(false)
        .allow_scroll(false)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_boxed_zoom(false)
        .show_x(false)
        .show_y(false)
        .custom_x_axes(vec![time])
        .custom_y_axes(vec![value])
}

/// The lines of one frame, relative to the selected vehicle and the present.
struct SpaceTime<'a, 'v> {
    shown: &'a ViewModel<'v>,
    selected: VehicleId,
    /// Where each lane of the route begins, laboratory metres.
    starts: BTreeMap<LaneId, f64>,
    /// Station of the selected vehicle's front bumper, laboratory metres.
    origin_s: f64,
    /// City metres per laboratory metre.
    factor: f64,
    now_s: f64,
    /// Names nearer to one another would touch, metres of the axis.
    apart_m: f64,
}

impl SpaceTime<'_, '_> {
    fn draw(&self, plot: &mut PlotUi<'_>, bands: &[Band]) {
        for band in bands {
            let (from_m, to_m) = (band.from_m, band.to_m);
            let corners = vec![[-DIAGRAM_S, from_m], [0.0, from_m], [0.0, to_m], [-DIAGRAM_S, to_m]];
            let area = Polygon::new("conflict", PlotPoints::from(corners));
            let colour = band.colour().gamma_multiply(BAND);
            plot.polygon(area.fill_color(colour).stroke(egui::Stroke::NONE));
        }
        plot.vline(VLine::new("now", 0.0).color(Color32::from_gray(110)).width(1.0));
        let context = plot.ctx().clone();
        let strongest = context.global_style().visuals.strong_text_color();
        let mut ends = Vec::new();
        for (id, places) in self.shown.traffic.measured().places() {
            let body = theme::line_on_ground(&context, overlay::body_colour(self.shown, id));
            let (colour, width) = if id == self.selected { (strongest, 2.5) } else { (body, 1.4) };
            for points in pieces(places, &self.starts, (self.origin_s, self.factor, self.now_s)) {
                ends.extend(points.last().filter(|[time_s, _]| *time_s > -0.5).map(|[_, m]| (id, *m)));
                plot.line(Line::new(id.to_string(), PlotPoints::from(points)).color(colour).width(width));
            }
        }
        for (id, at_m) in self.named(ends) {
            let words = RichText::new(named(self.shown.names, id)).size(theme::SMALL);
            let text = Text::new("name", PlotPoint::new(0.8, at_m), words).anchor(Align2::LEFT_CENTER);
            plot.text(text.color(strongest));
        }
    }

    /// The vehicles whose names find room beside the ends of their lines: the selected one, then from the front.
    fn named(&self, mut ends: Vec<(VehicleId, f64)>) -> Vec<(VehicleId, f64)> {
        ends.sort_by(|a, b| (b.0 == self.selected).cmp(&(a.0 == self.selected)).then(b.1.total_cmp(&a.1)));
        let mut named: Vec<(VehicleId, f64)> = Vec::new();
        for end in ends {
            if named.iter().all(|(_, m)| (m - end.1).abs() >= self.apart_m) {
                named.push(end);
            }
        }
        named
    }
}

/// Start of each lane of a route, for the visit nearest to a position.
fn lane_starts(route: &Route, near_s: f64) -> BTreeMap<LaneId, f64> {
    let mut starts: BTreeMap<LaneId, f64> = BTreeMap::new();
    for (index, &lane) in route.lanes().iter().enumerate() {
        let start_s = route.lane_start(index);
        let is_nearer = |known: &f64| (start_s - near_s).abs() < (known - near_s).abs();
        if starts.get(&lane).is_none_or(is_nearer) {
            starts.insert(lane, start_s);
        }
    }
    starts
}

/// Lines of one vehicle: time before now and metres ahead of the selected one's front. A vehicle that leaves the route,
/// or goes round to its beginning, begins another line.
fn pieces(
    places: &VecDeque<LanePlace>,
    starts: &BTreeMap<LaneId, f64>,
    (origin_s, factor, now_s): (f64, f64, f64),
) -> Vec<Vec<[f64; 2]>> {
    let mut lines: Vec<Vec<[f64; 2]>> = vec![Vec::new()];
    for place in places {
        let point = starts
            .get(&place.lane)
            .map(|start_s| [place.time_s - now_s, (start_s + place.at_m - origin_s) * factor]);
        let point = point.filter(|[_, y]| (-BEHIND_M..=AHEAD_M).contains(y));
        let last = lines.last().and_then(|line| line.last().copied());
        let jumps = point.zip(last).is_some_and(|(new, old)| (new[1] - old[1]).abs() > 0.2 * factor);
        if (point.is_none() || jumps) && lines.last().is_some_and(|line| !line.is_empty()) {
            lines.push(Vec::new());
        }
        if let (Some(point), Some(line)) = (point, lines.last_mut()) {
            line.push(point);
        }
    }
    lines.retain(|line| line.len() > 1);
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_off_the_route_interrupts_its_line() {
        let place = |k: u32, lane: u32| LanePlace {
            time_s: f64::from(k) * 0.1,
            lane: LaneId(lane),
            at_m: f64::from(k) * 0.03,
        };
        let places: VecDeque<LanePlace> = [(0, 1), (1, 1), (2, 7), (3, 7), (4, 1), (5, 1)]
            .into_iter()
            .map(|(k, lane)| place(k, lane))
            .collect();
        let starts = [(LaneId(1), 2.0)].into();
        let lines = pieces(&places, &starts, (2.0, 25.0, 0.5));
        assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2]);
        assert!((lines[0][1][0] + 0.4).abs() < 1e-9 && (lines[0][1][1] - 0.75).abs() < 1e-9, "{lines:?}");
    }
}
