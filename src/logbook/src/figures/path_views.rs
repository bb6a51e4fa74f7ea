//! Figures of paths: speed against position, and positions against time.

use super::chart::{BLACK, ChartLine, ColourBar, Dash, Figure, LegendEntry, LineName, LineStyle, Panel};
use super::paths::{GiveWayKind, GiveWayLine};
use super::series::{AVERAGED_S, by_speed, median_speeds};
use super::style::tint;
use super::table::number;
use super::views::{FigureSet, LEAST_SPEED_MPS, PathSegment};
use city3d_protocol::snapshot::{Aspect, VehicleId};
use city3d_simulation::scenario::counted;
use std::collections::BTreeMap;

/// Line style of a median over the vehicles.
const MEDIAN: LineStyle = LineStyle { colour: BLACK, dash: Dash::Solid, width_pt: 1.8 };

/// Line styles of a signal at its line, while traffic waits there.
const RED: LineStyle = LineStyle { colour: [213, 94, 0], dash: Dash::Solid, width_pt: 2.6 };
const YELLOW: LineStyle = LineStyle { colour: [230, 159, 0], ..RED };

impl FigureSet<'_> {
    /// Speed against position of the vehicles of one path.
    pub fn speed(&self, stream: usize) -> Figure {
        let path = format!("Path {}", stream + 1);
        let mut figure = self.figure(
            &format!("speed_path_{}", stream + 1),
            &format!("speed along {path}"),
            &self.segment_columns(),
        );
        let ids: Vec<VehicleId> = self.members(stream).into_iter().collect();
        let styles = if self.has_own_styles() { self.styles_of(&ids) } else { BTreeMap::new() };
        let crowd = LineStyle { width_pt: 0.5, ..LineStyle::solid(tint(self.style_of_path(stream).colour)) };
        for run in 0..self.runs.len() {
            let mut panel = Panel {
                title: self.panel_title(run),
                x_label: format!("Position along {path} {}", self.unit("m")),
                y_label: format!("Speed {}", self.speed_unit()),
                rules: self.rules(run, std::iter::once(stream), false),
                ..Panel::default()
            };
            let segments: Vec<PathSegment<'_>> = self.segments(run, stream).collect();
            for segment in &segments {
                let stroke = styles.get(&segment.trace.id).copied().unwrap_or(crowd);
                let points = segment.points.iter().map(|&(_, m, mps)| (m, mps)).collect();
                panel.lines.push(ChartLine { points, stroke });
                figure.table.rows.extend(segment.rows(&self.labels[run], &path));
            }
            if !self.has_own_styles() {
                let points = median_speeds(&segments);
                let row = |&(m, mps): &(f64, f64)| {
                    let (run, path) = (self.labels[run].clone(), path.clone());
                    let (none, name) = (String::new, "median".to_owned());
                    vec![run, path, none(), name, none(), number(m, 4), number(mps, 5)]
                };
                figure.table.rows.extend(points.iter().map(row));
                panel.lines.push(ChartLine { points, stroke: MEDIAN });
            }
            figure.panels.push(panel);
        }
        Self::fit_alike(&mut figure, self.origin(), &[0.0, LEAST_SPEED_MPS]);
        figure.legend = match self.has_own_styles() {
            true => self.keys_of(&ids),
            false => vec![
                LegendEntry { name: counted(ids.len(), "vehicle"), stroke: crowd },
                LegendEntry { name: "median of the vehicles at a position".to_owned(), stroke: MEDIAN },
            ],
        };
        figure.note = format!("Speeds are means over {AVERAGED_S} s. {}", self.origin_note());
        figure
    }

    /// Position against time, all paths aligned at the merging point.
    pub fn position(&self) -> Figure {
        let columns = ["run", "path", "vehicle", "name", "time_s", self.columns()[0]];
        let mut figure =
            self.figure("position", "positions of all paths, aligned at the merging point", &columns);
        let all = 0..self.layout.streams.len();
        for run in 0..self.runs.len() {
            let mut panel = Panel {
                title: self.panel_title(run),
                x_label: "Time [s]".to_owned(),
                y_label: format!("Position {}", self.unit("m")),
                rules: self.rules(run, all.clone(), true),
                ..Panel::default()
            };
            for stream in all.clone() {
                for PathSegment { trace, points } in self.segments(run, stream) {
                    let time_s = |k: usize| trace.samples[k].time_s;
                    let line = points.iter().map(|&(k, m, _)| (time_s(k), m)).collect();
                    panel.lines.push(ChartLine { points: line, stroke: self.style_on(stream, trace.id) });
                    for (k, position, _) in points.into_iter().filter(|(_, m, _)| m.is_finite()) {
                        figure.table.rows.push(vec![
                            self.labels[run].clone(),
                            self.streams[run][stream].name.clone(),
                            trace.id.to_string(),
                            trace.name.clone(),
                            number(time_s(k), 3),
                            number(position, 4),
                        ]);
                    }
                }
            }
            figure.panels.push(panel);
        }
        Self::fit_alike(&mut figure, &[0.0], self.origin());
        figure.legend = self.legend(all);
        figure.note = self.origin_note();
        figure
    }

    /// Space-time diagram: position against time of each path, coloured by speed.
    pub fn space_time(&self) -> Figure {
        let mut figure = self.figure("space_time", "space-time diagram", &self.segment_columns());
        let all = 0..self.layout.streams.len();
        let (mut fastest, mut last_s) = (LEAST_SPEED_MPS, 0.0_f64);
        for run in 0..self.runs.len() {
            last_s = last_s.max(self.runs[run].end_s);
            let points = all
                .clone()
                .flat_map(|stream| self.segments(run, stream).flat_map(|s| s.points).collect::<Vec<_>>());
            fastest = points.map(|(_, _, mps)| mps).fold(fastest, f64::max);
        }
        for stream in all {
            for run in 0..self.runs.len() {
                let path = self.streams[run][stream].name.clone();
                let title = match self.runs.len() {
                    1 => path.clone(),
                    _ => format!("{}: {path}", self.panel_title(run)),
                };
                let is_lowest = stream + 1 == self.layout.streams.len();
                let mut panel = Panel {
                    title,
                    x_label: if is_lowest { "Time [s]".to_owned() } else { String::new() },
                    y_label: format!("Position {}", self.unit("m")),
                    rules: self.rules(run, std::iter::once(stream), true),
                    ..Panel::default()
                };
                panel.rules.retain(|rule| rule.dash != Dash::Dashed);
                panel
                    .rules
                    .iter_mut()
                    .for_each(|rule| rule.name = rule.name.replace(&format!(" of {path}"), ""));
                panel.lines.extend(self.signal_bars(run, stream));
                for segment in self.segments(run, stream) {
                    let lines = by_speed(segment.trace, &segment.points, fastest);
                    let end = lines.last().and_then(|line| line.points.last()).copied();
                    let from = panel.lines.len();
                    panel.lines.extend(lines);
                    let lines = from..panel.lines.len();
                    let name = || self.name(segment.trace.id);
                    panel.names.extend(end.map(|at| LineName { at, name: name(), lines }));
                    figure.table.rows.extend(segment.rows(&self.labels[run], &path));
                }
                panel.rules.extend(self.end_rule(&panel));
                figure.panels.push(panel);
            }
        }
        Self::fit_alike(&mut figure, &[0.0, last_s], self.origin());
        figure.row_height *= if self.runs.len() == 1 { 0.62 } else { 0.85 };
        let bars: Vec<LineStyle> =
            figure.panels.iter().flat_map(|panel| &panel.lines).map(|line| line.stroke).collect();
        let named = [("signal red", RED), ("signal yellow", YELLOW)].into_iter();
        figure.legend = named
            .filter(|(_, stroke)| bars.contains(stroke))
            .map(|(name, stroke)| LegendEntry { name: name.to_owned(), stroke })
            .collect();
        figure.scale =
            Some(ColourBar { label: format!("Speed {}", self.speed_unit()), from: 0.0, to: fastest });
        figure.note = format!("Speeds are means over {AVERAGED_S} s. {}", self.origin_note());
        figure
    }

    /// The times at which the signal of a path, if it has one, shows red or yellow, as bars at its line.
    fn signal_bars(&self, run: usize, stream: usize) -> Vec<ChartLine> {
        let log = &self.runs[run];
        let Some(GiveWayLine { before_m, kind: GiveWayKind::Signal(head) }) = self.streams[run][stream].line
        else {
            return Vec::new();
        };
        let at = self.metres(self.layout.merge_at_m - before_m);
        let changes = log.aspects.get(head).map_or(&[][..], Vec::as_slice);
        let ends = changes.iter().skip(1).map(|(time_s, _)| *time_s).chain([log.end_s]);
        let bar = |(&(from_s, aspect), to_s): (&(f64, Aspect), f64)| {
            let stroke = match aspect {
                Aspect::Red => RED,
                Aspect::Yellow => YELLOW,
                Aspect::Green | Aspect::Dark => return None,
            };
            Some(ChartLine { points: vec![(from_s, at), (to_s, at)], stroke })
        };
        changes.iter().zip(ends).filter_map(bar).collect()
    }
}
