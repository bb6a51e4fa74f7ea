//! Space-time diagram of the way of one vehicle: the front bumpers of everybody on its lanes, from its own front at the end.

use super::chart::{ChartLine, Figure, GREY, LegendEntry, LineName, LineStyle, Panel};
use super::gap::{lane_starts, stations};
use super::labels::conditions;
use super::run::{RunLog, Trace};
use super::style::distinct_styles;
use super::table::{TidyTable, number};
use super::{FigureScale, MatchedPath};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::LaneId;
use std::collections::BTreeMap;

/// What is shown behind and ahead of its front, where the figure does not show the whole run, city metres.
pub const WAY_BEHIND_M: f64 = 90.0;
/// See [`WAY_BEHIND_M`].
pub const WAY_AHEAD_M: f64 = 60.0;
/// A longer step between two samples is a jump, as of one who goes round to the beginning of the way, city metres.
const JUMP_M: f64 = 12.0;
/// Most vehicles with lines of their own style.
const MOST_STYLES: usize = 20;
/// Its own line is wide, points.
const OWN_PT: f64 = 2.4;

/// What a space-time diagram of the way of a vehicle shows.
#[derive(Clone, Copy, Debug)]
pub struct WayFigure<'a> {
    /// The run, matched to lanes.
    pub run: &'a RunLog,
    /// Whose way.
    pub of: VehicleId,
    /// In which metres.
    pub scale: FigureScale,
    /// Simulated times of its left and right end, seconds.
    pub span_s: (f64, f64),
    /// From the beginning of the way; otherwise from [`WAY_BEHIND_M`] behind the vehicle.
    pub is_whole: bool,
}

/// The line of a vehicle: times and metres ahead of the front of the one whose way it is; NaN where it is not on it.
type WayLine = Vec<(f64, f64)>;

/// The positions that lines reach, with some room at both ends.
fn reached(lines: &[(&Trace, WayLine)]) -> (f64, f64) {
    let all = || lines.iter().flat_map(|(_, line)| line).map(|(_, m)| *m).filter(|m| m.is_finite());
    let (low_m, high_m) = (all().fold(0.0, f64::min), all().fold(0.0, f64::max));
    let room_m = 0.05 * (high_m - low_m) + 1.0;
    (low_m - room_m, high_m + room_m)
}

impl WayFigure<'_> {
    /// The figure; `None` where the vehicle is on no lane.
    pub fn draw(&self) -> Option<Figure> {
        let own = self.run.vehicle(self.of)?;
        let starts = lane_starts(own, &self.run.experiment);
        let fronts = fronts(own);
        let (_, origin_m) = fronts.range(..=tick(self.span_s.1)).next_back()?;
        let first_m = fronts.range(tick(self.span_s.0)..).next().map_or(*origin_m, |(_, front_m)| *front_m);
        let low_m = if self.is_whole { first_m - origin_m - WAY_BEHIND_M } else { -WAY_BEHIND_M };
        let within = |line: WayLine| self.clipped(line, (low_m, WAY_AHEAD_M));
        let line = |trace: &Trace| within(self.line(trace, &starts, (&fronts, *origin_m)));
        let others = self.run.vehicles.iter().filter(|trace| trace.id != self.of);
        let lines: Vec<(&Trace, WayLine)> = std::iter::once(own)
            .chain(others)
            .map(|trace| (trace, line(trace)))
            .filter(|(_, line)| line.iter().any(|(_, m)| m.is_finite()))
            .collect();
        let range_m = if self.is_whole { reached(&lines) } else { (low_m, WAY_AHEAD_M) };
        Some(self.figure(own, &lines, range_m))
    }

    /// Where a vehicle was on the way. A lane that the way has twice is the visit nearest to whose way it is.
    fn line(
        &self,
        trace: &Trace,
        starts: &BTreeMap<LaneId, Vec<f64>>,
        (fronts, origin_m): (&BTreeMap<i64, f64>, f64),
    ) -> WayLine {
        let mut places = vec![f64::NAN; trace.samples.len()];
        for station in stations(trace) {
            let Some(starts) = starts.get(&station.lane) else { continue };
            let time_s = trace.samples[station.sample].time_s;
            let own_m = fronts.range(..=tick(time_s)).next_back().or(fronts.iter().next());
            let own_m = own_m.map_or(origin_m, |(_, front_m)| *front_m);
            let at = starts.iter().map(|start_m| start_m + station.front_m);
            let nearest = at.min_by(|a, b| (a - own_m).abs().total_cmp(&(b - own_m).abs()));
            places[station.sample] = nearest.map_or(f64::NAN, |front_m| front_m - origin_m);
        }
        trace.samples.iter().map(|sample| sample.time_s).zip(places).collect()
    }

    /// A line within the axes, interrupted where it jumps.
    fn clipped(&self, line: WayLine, (low_m, high_m): (f64, f64)) -> WayLine {
        let mut kept = WayLine::new();
        for (time_s, m) in line.into_iter().filter(|(s, _)| (self.span_s.0..=self.span_s.1).contains(s)) {
            let m = if (low_m..=high_m).contains(&m) { m } else { f64::NAN };
            if kept.last().is_some_and(|(_, last_m)| (m - last_m).abs() > JUMP_M) {
                kept.push((time_s, f64::NAN));
            }
            kept.push((time_s, m));
        }
        kept
    }

    fn figure(&self, own: &Trace, lines: &[(&Trace, WayLine)], (low_m, high_m): (f64, f64)) -> Figure {
        let (per_city_m, metres, column) = match self.scale {
            FigureScale::Laboratory => (self.run.lab(1.0), "laboratory", "position_lab_m"),
            FigureScale::City | FigureScale::CityMetresPerSecond => (1.0, "full scale", "position_city_m"),
        };
        let name = |trace: &Trace| format!("{} {}", trace.id, trace.name);
        let of_run = conditions(&self.run.experiment, self.run.has_physical);
        let mut panel = Panel {
            x_label: "Time [s]".to_owned(),
            y_label: format!("Position from the front of {} [m, {metres}]", name(own)),
            x: self.span_s,
            y: (low_m * per_city_m, high_m * per_city_m),
            ..Panel::default()
        };
        let mut table = TidyTable::new(&["run", "vehicle", "name", "time_s", column]);
        let mut legend = Vec::new();
        let styles = distinct_styles(MOST_STYLES.min(lines.len())).map(Some).chain(std::iter::repeat(None));
        for ((trace, line), style) in lines.iter().zip(styles) {
            let mut stroke = style.unwrap_or(LineStyle::solid(GREY));
            if trace.id == self.of {
                stroke.width_pt = OWN_PT;
            }
            let points: WayLine = line.iter().map(|&(time_s, m)| (time_s, m * per_city_m)).collect();
            let mut told = points.iter().filter(|(_, m)| m.is_finite());
            table.rows.extend(told.clone().map(|&(time_s, m)| {
                let (id, name) = (trace.id.to_string(), trace.name.clone());
                vec![of_run.clone(), id, name, number(time_s, 3), number(m, 4)]
            }));
            let index = panel.lines.len();
            // The legend tells the others by their styles.
            let end = told.next_back().copied().filter(|_| style.is_none());
            panel.names.extend(end.map(|at| LineName { at, name: name(trace), lines: index..index + 1 }));
            panel.lines.push(ChartLine { points, stroke });
            legend.extend(style.map(|_| LegendEntry { name: name(trace), stroke }));
        }
        Figure {
            name: "way".to_owned(),
            title: format!("{of_run}: space-time diagram, the way of {}", name(own)),
            panels: vec![panel],
            columns: 1,
            row_height: 0.5,
            legend,
            scale: None,
            note: format!(
                "Front bumpers of everybody on the lanes of {}, from where its own front is at the end; its line is thick.",
                name(own)
            ),
            table,
        }
    }
}

/// Microseconds, which are ordered.
fn tick(time_s: f64) -> i64 {
    (time_s * 1e6).round() as i64
}

/// Stations of the front bumper where they are known, by time.
fn fronts(trace: &Trace) -> BTreeMap<i64, f64> {
    let MatchedPath { stations_m, .. } = &trace.track;
    let known = (0..stations_m.len()).filter(|k| stations_m[*k].is_finite());
    known.map(|k| (tick(trace.samples[k].time_s), trace.front_m(k))).collect()
}
