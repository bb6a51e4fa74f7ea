//! The figures of one run, or of two side by side.

use super::chart::{
    BLACK, ChartLine, Colour, ColourBar, Dash, Figure, GREY, LegendEntry, LineStyle, PALETTE, Panel,
    ReferenceLine,
};
use super::paths::{Stream, StreamLayout, StreamMember};
use super::run::{RunLog, Trace};
use super::series::{AVERAGED_S, by_speed, differences, moving_average};
use super::table::{TidyTable, number};
use city3d_protocol::snapshot::VehicleId;
use std::collections::{BTreeMap, BTreeSet};

/// Most vehicles with colours of their own.
const MOST_COLOURS: usize = 12;
/// Most vehicles with panels of their own.
const MOST_ROWS: usize = 8;
/// Least range of the speed axis, laboratory m/s.
const LEAST_SPEED_MPS: f64 = 0.05;

/// All figures of one run, or of two side by side.
#[derive(Debug)]
pub struct FigureSet<'a> {
    pub(super) runs: &'a [RunLog],
    pub(super) layout: &'a StreamLayout,
    /// Streams of each run.
    pub(super) streams: Vec<Vec<Stream>>,
    pub(super) labels: Vec<String>,
    /// Line styles of the selected vehicles.
    pub(super) strokes: BTreeMap<VehicleId, LineStyle>,
    has_own_colours: bool,
}

/// A trace segment of a vehicle on a path: sample index, position and averaged speed in laboratory units.
pub(super) struct PathSegment<'r> {
    pub(super) trace: &'r Trace,
    pub(super) points: Vec<(usize, f64, f64)>,
}

/// Columns of a segment's rows.
const SEGMENT_COLUMNS: [&str; 7] = ["run", "path", "vehicle", "name", "time_s", "position_m", "speed_mps"];

impl PathSegment<'_> {
    /// Its rows in a table, by [`SEGMENT_COLUMNS`].
    fn rows(&self, run: &str, path: &str) -> impl Iterator<Item = Vec<String>> {
        self.points.iter().map(move |&(k, position, speed)| {
            vec![
                run.to_owned(),
                path.to_owned(),
                self.trace.id.to_string(),
                self.trace.name.clone(),
                number(self.trace.samples[k].time_s, 3),
                number(position, 4),
                number(speed, 5),
            ]
        })
    }
}

impl<'a> FigureSet<'a> {
    /// Figures of runs of one scenario; of all vehicles unless some are named.
    pub fn new(runs: &'a [RunLog], layout: &'a StreamLayout, only: &BTreeSet<VehicleId>) -> Self {
        let streams: Vec<Vec<Stream>> = runs.iter().map(|run| layout.streams(run)).collect();
        let is_shown = |id: &VehicleId| only.is_empty() || only.contains(id);
        let mut strokes = BTreeMap::new();
        for stream in 0..layout.streams.len() {
            let members =
                streams.iter().flat_map(|streams| &streams[stream].members).map(|member| member.vehicle);
            let members: BTreeSet<VehicleId> = members.filter(is_shown).collect();
            for (place, id) in members.into_iter().enumerate() {
                strokes.entry(id).or_insert(stroke_of(stream, place, layout.streams.len()));
            }
        }
        let all: BTreeSet<VehicleId> =
            runs.iter().flat_map(|run| &run.vehicles).map(|trace| trace.id).collect();
        for id in all.into_iter().filter(is_shown) {
            let uses = |colour: &Colour| {
                strokes.values().filter(|stroke: &&LineStyle| stroke.colour == *colour).count()
            };
            let rarest = PALETTE.into_iter().min_by_key(uses).unwrap_or(BLACK);
            strokes.entry(id).or_insert(LineStyle::solid(rarest));
        }
        let has_own_colours = strokes.len() <= MOST_COLOURS;
        Self { runs, layout, streams, labels: labels(runs), strokes, has_own_colours }
    }

    /// Labels of the runs in figures and tables.
    pub fn labels(&self) -> &[String] {
        &self.labels
    }

    /// All figures, and why some are missing.
    pub fn all(&self) -> (Vec<Figure>, Vec<String>) {
        let mut notes = Vec::new();
        let mut figures: Vec<Figure> =
            (0..self.layout.streams.len()).map(|stream| self.speed(stream)).collect();
        if self.layout.merge.is_some() {
            figures.push(self.position());
        } else {
            notes.push(
                "no streams merge in this scenario: no figure of positions aligned at a merging point"
                    .to_owned(),
            );
        }
        figures.push(self.space_time());
        match self.occupancy() {
            Some(figure) => figures.push(figure),
            None => notes
                .push("no conflict zone was passed on both sides: no figure of their occupancy".to_owned()),
        }
        figures.push(self.lateral_error());
        if self.runs.iter().any(|run| run.origin.has_world()) {
            figures.push(self.pedals());
        } else {
            notes.push("a log of poses alone has no pedals: no figure of them".to_owned());
        }
        (figures, notes)
    }

    fn lab(&self, city: f64) -> f64 {
        self.runs[0].lab(city)
    }

    fn scenario(&self) -> &str {
        &self.runs[0].experiment.name
    }

    fn title(&self, what: &str) -> String {
        match self.runs.len() {
            1 => format!("{}, {}: {what}", self.scenario(), self.labels[0]),
            _ => format!("{}: {what}", self.scenario()),
        }
    }

    pub(super) fn panel_title(&self, run: usize) -> String {
        if self.runs.len() == 1 {
            return String::new();
        }
        format!("({}) {}", char::from(b'a' + (run % 26) as u8), self.labels[run])
    }

    /// Note on the origin of positions.
    pub(super) fn origin_note(&self) -> String {
        let lane = |index: usize| self.streams[0][index].lane.as_str();
        match &self.layout.merge {
            Some(merge) => {
                let before = self.lab(self.layout.merge_at_m);
                let by = (0..self.layout.streams.len()).map(|k| format!("Path {} by {}", k + 1, lane(k)));
                format!(
                    "Laboratory metres, front bumper. 0 lies {before:.2} m before the merging point, the beginning of \
                     {}, on every path; {}.",
                    merge.name,
                    by.collect::<Vec<_>>().join(", ")
                )
            }
            None => {
                let by = (0..self.layout.streams.len()).map(|k| format!("Path {} of {}", k + 1, lane(k)));
                format!(
                    "Laboratory metres, front bumper. 0 is the beginning of {}.",
                    by.collect::<Vec<_>>().join(", ")
                )
            }
        }
    }

    pub(super) fn segments(&self, run: usize, stream: usize) -> impl Iterator<Item = PathSegment<'_>> {
        let log = &self.runs[run];
        let shown = |member: &&StreamMember| self.strokes.contains_key(&member.vehicle);
        let members = self.streams[run][stream].members.iter().filter(shown);
        members.filter_map(move |member| {
            let trace = log.vehicle(member.vehicle)?;
            let speeds = moving_average(trace);
            let at = |k: usize| {
                self.layout.position_m(trace, member, k).map(|m| (k, self.lab(m), self.lab(speeds[k])))
            };
            Some(PathSegment { trace, points: (0..trace.samples.len()).filter_map(at).collect() })
        })
    }

    fn stroke(&self, id: VehicleId) -> LineStyle {
        self.strokes.get(&id).copied().unwrap_or(LineStyle::solid(BLACK))
    }

    /// Line style of a vehicle on a path: its own, or that of the path where there are too many.
    pub(super) fn stroke_on(&self, stream: usize, id: VehicleId) -> LineStyle {
        if self.has_own_colours {
            return self.stroke(id);
        }
        LineStyle { width_pt: 0.7, ..stroke_of(stream, 0, self.layout.streams.len()) }
    }

    /// Reference lines of a path: stop or yield line, merging point, and one car length before it.
    fn rules(&self, streams: impl Iterator<Item = usize>, is_level: bool) -> Vec<ReferenceLine> {
        let Some(_) = self.layout.merge else { return Vec::new() };
        let at = self.lab(self.layout.merge_at_m);
        let rule = |at: f64, name: &str, dash: Dash, is_before: bool| ReferenceLine {
            at,
            is_level,
            name: name.to_owned(),
            dash,
            is_before,
        };
        let mut rules = vec![rule(at, "merging point", Dash::Solid, false)];
        if is_level {
            rules.push(rule(at - self.car_length(), "one car length before it", Dash::Dashed, true));
        }
        for stream in streams {
            if let Some(before_m) = self.layout.streams[stream].line_before_m {
                let name = if is_level {
                    format!("yield line of Path {}", stream + 1)
                } else {
                    "yield line".to_owned()
                };
                rules.push(rule(at - self.lab(before_m), &name, Dash::Dotted, true));
            }
        }
        rules
    }

    /// Length of the longest vehicle on the paths, laboratory metres.
    fn car_length(&self) -> f64 {
        let members = self.streams[0].iter().flat_map(|stream| &stream.members);
        let lengths =
            members.filter_map(|member| Some(self.runs[0].vehicle(member.vehicle)?.dimensions.length_m));
        self.lab(lengths.fold(0.0, f64::max))
    }

    /// The vehicles of some streams.
    pub(super) fn legend(&self, streams: impl Iterator<Item = usize>) -> Vec<LegendEntry> {
        let mut keys = Vec::new();
        for stream in streams {
            let members =
                self.streams.iter().flat_map(|streams| &streams[stream].members).map(|member| member.vehicle);
            let members: BTreeSet<VehicleId> = members.filter(|id| self.strokes.contains_key(id)).collect();
            let Some(first) = members.first() else { continue };
            if !self.has_own_colours {
                let name = format!("Path {} ({} vehicles)", stream + 1, members.len());
                keys.push(LegendEntry { name, stroke: self.stroke_on(stream, *first) });
                continue;
            }
            for id in members {
                keys.push(LegendEntry { name: self.name(id), stroke: self.stroke(id) });
            }
        }
        keys
    }

    pub(super) fn name(&self, id: VehicleId) -> String {
        let trace = self.runs.iter().find_map(|run| run.vehicle(id));
        trace.map_or_else(|| id.to_string(), |trace| trace.name.clone())
    }

    pub(super) fn figure(&self, name: &str, what: &str, columns: &[&'static str]) -> Figure {
        Figure {
            name: name.to_owned(),
            title: self.title(what),
            panels: Vec::new(),
            columns: self.runs.len(),
            row_height: if self.runs.len() == 1 { 0.5 } else { 0.36 },
            legend: Vec::new(),
            scale: None,
            note: String::new(),
            table: TidyTable::new(columns),
        }
    }

    pub(super) fn fit_alike(figure: &mut Figure, x_with: &[f64], y_with: &[f64]) {
        let mut all = Panel::default();
        all.lines.extend(figure.panels.iter().flat_map(|panel| panel.lines.iter().cloned()));
        all.fit(x_with, y_with);
        for panel in &mut figure.panels {
            (panel.x, panel.y) = (all.x, all.y);
        }
    }

    /// Speed against position of the vehicles of one path.
    pub fn speed(&self, stream: usize) -> Figure {
        let path = format!("Path {}", stream + 1);
        let mut figure = self.figure(
            &format!("speed_path_{}", stream + 1),
            &format!("speed along {path}"),
            &SEGMENT_COLUMNS,
        );
        for run in 0..self.runs.len() {
            let mut panel = Panel {
                title: self.panel_title(run),
                x_label: format!("Position along {path} [m]"),
                y_label: "Speed [m/s]".to_owned(),
                rules: self.rules(std::iter::once(stream), false),
                ..Panel::default()
            };
            for segment in self.segments(run, stream) {
                let stroke = LineStyle { dash: Dash::Solid, ..self.stroke(segment.trace.id) };
                let points = segment.points.iter().map(|&(_, m, mps)| (m, mps)).collect();
                panel.lines.push(ChartLine { points, stroke });
                figure.table.rows.extend(segment.rows(&self.labels[run], &path));
            }
            figure.panels.push(panel);
        }
        Self::fit_alike(&mut figure, &[], &[0.0, LEAST_SPEED_MPS]);
        figure.legend = self.legend(std::iter::once(stream));
        figure.legend.iter_mut().for_each(|key| key.stroke.dash = Dash::Solid);
        figure.note = format!("Speeds are means over {AVERAGED_S} s. {}", self.origin_note());
        figure
    }

    /// Position against time, all paths aligned at the merging point.
    pub fn position(&self) -> Figure {
        let columns = ["run", "path", "vehicle", "name", "time_s", "position_m"];
        let mut figure =
            self.figure("position", "positions of all paths, aligned at the merging point", &columns);
        let all = 0..self.layout.streams.len();
        for run in 0..self.runs.len() {
            let mut panel = Panel {
                title: self.panel_title(run),
                x_label: "Time [s]".to_owned(),
                y_label: "Position [m]".to_owned(),
                rules: self.rules(all.clone(), true),
                ..Panel::default()
            };
            for stream in all.clone() {
                for PathSegment { trace, points } in self.segments(run, stream) {
                    let time_s = |k: usize| trace.samples[k].time_s;
                    let line = points.iter().map(|&(k, m, _)| (time_s(k), m)).collect();
                    panel.lines.push(ChartLine { points: line, stroke: self.stroke_on(stream, trace.id) });
                    for (k, position, _) in points {
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
        Self::fit_alike(&mut figure, &[0.0], &[]);
        figure.legend = self.legend(all);
        figure.note = self.origin_note();
        figure
    }

    /// Space-time diagram: position against time of each path, coloured by speed.
    pub fn space_time(&self) -> Figure {
        let mut figure = self.figure("space_time", "space-time diagram", &SEGMENT_COLUMNS);
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
                    y_label: "Position [m]".to_owned(),
                    rules: self.rules(std::iter::once(stream), true),
                    ..Panel::default()
                };
                panel.rules.retain(|rule| rule.dash != Dash::Dashed);
                panel
                    .rules
                    .iter_mut()
                    .for_each(|rule| rule.name = rule.name.replace(&format!(" of {path}"), ""));
                for segment in self.segments(run, stream) {
                    panel.lines.extend(by_speed(segment.trace, &segment.points, fastest));
                    figure.table.rows.extend(segment.rows(&self.labels[run], &path));
                }
                figure.panels.push(panel);
            }
        }
        Self::fit_alike(&mut figure, &[0.0, last_s], &[]);
        figure.row_height *= if self.runs.len() == 1 { 0.62 } else { 0.85 };
        figure.scale = Some(ColourBar { label: "Speed [m/s]".to_owned(), from: 0.0, to: fastest });
        figure.note = format!("Speeds are means over {AVERAGED_S} s. {}", self.origin_note());
        figure
    }

    /// The first vehicles up to a number, and a note where some are left out.
    fn some(&self, most: usize) -> (Vec<VehicleId>, String) {
        let ids: Vec<VehicleId> = self.strokes.keys().copied().take(most).collect();
        let word = match self.strokes.len() > most {
            true => {
                format!(" The first {most} of {} vehicles; --vehicle chooses others.", self.strokes.len())
            }
            false => String::new(),
        };
        (ids, word)
    }

    /// Distance of the front axle from the desired path.
    fn lateral_error(&self) -> Figure {
        let columns = ["run", "vehicle", "name", "time_s", "lateral_error_m"];
        let mut figure = self.figure("lateral_error", "lateral error of the front axle", &columns);
        let (ids, word) = self.some(MOST_COLOURS);
        for (run, log) in self.runs.iter().enumerate() {
            let mut panel = Panel {
                title: self.panel_title(run),
                x_label: "Time [s]".to_owned(),
                y_label: "Lateral error [mm]".to_owned(),
                ..Panel::default()
            };
            for trace in ids.iter().filter_map(|id| log.vehicle(*id)) {
                let points = trace.samples.iter().map(|s| (s.time_s, self.lab(s.lateral_error_m) * 1000.0));
                let stroke = LineStyle { width_pt: 0.8, ..self.stroke(trace.id) };
                panel.lines.push(ChartLine {
                    points: points.collect(),
                    stroke: LineStyle { dash: Dash::Solid, ..stroke },
                });
                for sample in &trace.samples {
                    figure.table.rows.push(vec![
                        self.labels[run].clone(),
                        trace.id.to_string(),
                        trace.name.clone(),
                        number(sample.time_s, 3),
                        number(self.lab(sample.lateral_error_m), 6),
                    ]);
                }
            }
            figure.panels.push(panel);
        }
        Self::fit_alike(&mut figure, &[0.0], &[0.0]);
        figure.legend = self.keys_of(&ids);
        let of = match self.runs.iter().any(|run| !run.origin.has_world()) {
            true => "the middle of its lane (in a log of poses alone), else from its desired path",
            false => "its desired path",
        };
        figure.note =
            format!("Front-axle centre from {of}, positive to the left. Laboratory millimetres.{word}");
        figure
    }

    fn keys_of(&self, ids: &[VehicleId]) -> Vec<LegendEntry> {
        let key = |&id: &VehicleId| LegendEntry {
            name: self.name(id),
            stroke: LineStyle { dash: Dash::Solid, ..self.stroke(id) },
        };
        ids.iter().map(key).collect()
    }

    /// Gas, brake and handbrake, a row for each vehicle.
    fn pedals(&self) -> Figure {
        const GAS: Colour = PALETTE[1];
        const BRAKE: Colour = PALETTE[0];
        const HANDBRAKE: Colour = BLACK;
        let columns = ["run", "vehicle", "name", "time_s", "gas", "brake", "handbrake"];
        let mut figure = self.figure("pedals", "pedals", &columns);
        let (ids, word) = self.some(MOST_ROWS);
        for (row, &id) in ids.iter().enumerate() {
            for (run, log) in self.runs.iter().enumerate() {
                let title = match self.runs.len() {
                    1 => self.name(id),
                    _ => format!("{}: {}", self.panel_title(run), self.name(id)),
                };
                let is_last = row + 1 == ids.len();
                let mut panel = Panel {
                    title,
                    x_label: if is_last { "Time [s]".to_owned() } else { String::new() },
                    y_label: "Pedal".to_owned(),
                    ..Panel::default()
                };
                let samples = log.vehicle(id).map_or(&[][..], |trace| &trace.samples);
                let line = |of: &dyn Fn(usize) -> f64, colour| ChartLine {
                    points: (0..samples.len()).map(|k| (samples[k].time_s, of(k))).collect(),
                    stroke: LineStyle { width_pt: 0.8, ..LineStyle::solid(colour) },
                };
                // A released pedal has no line.
                let down = |value: f64| if value > 1e-3 { value } else { f64::NAN };
                panel.lines.push(line(&|_| 0.0, GREY));
                panel.lines.push(line(&|k| down(samples[k].gas), GAS));
                panel.lines.push(line(&|k| -down(samples[k].brake), BRAKE));
                panel.lines.push(line(&|k| -down(samples[k].handbrake), HANDBRAKE));
                for sample in samples {
                    figure.table.rows.push(vec![
                        self.labels[run].clone(),
                        id.to_string(),
                        self.name(id),
                        number(sample.time_s, 3),
                        number(sample.gas, 4),
                        number(sample.brake, 4),
                        number(sample.handbrake, 4),
                    ]);
                }
                figure.panels.push(panel);
            }
        }
        let last_s = self.runs.iter().map(|run| run.end_s).fold(0.0, f64::max);
        Self::fit_alike(&mut figure, &[0.0, last_s], &[]);
        figure.panels.iter_mut().for_each(|panel| panel.y = (-1.05, 1.05));
        figure.row_height = if self.runs.len() == 1 { 0.1 } else { 0.085 };
        let key =
            |name: &str, colour| LegendEntry { name: name.to_owned(), stroke: LineStyle::solid(colour) };
        figure.legend = vec![
            key("gas, upwards", GAS),
            key("brake, downwards", BRAKE),
            key("handbrake, downwards", HANDBRAKE),
        ];
        figure.note = format!("1 is a pedal that is fully down.{word}");
        figure
    }

    /// Distance between the positions of a vehicle in two runs over time.
    ///
    /// # Panics
    /// When there are fewer than two runs.
    pub fn difference(&self) -> Figure {
        let columns = ["vehicle", "name", "time_s", "difference_m"];
        let mut figure = self.figure("difference", "distance between the two runs", &columns);
        (figure.columns, figure.row_height) = (1, 0.5);
        let (ids, word) = self.some(MOST_COLOURS);
        let mut panel =
            Panel { x_label: "Time [s]".to_owned(), y_label: "Distance [m]".to_owned(), ..Panel::default() };
        for &id in &ids {
            let (Some(a), Some(b)) = (self.runs[0].vehicle(id), self.runs[1].vehicle(id)) else { continue };
            let points: Vec<(f64, f64)> =
                differences(a, b).into_iter().map(|(time_s, m)| (time_s, self.lab(m))).collect();
            for &(time_s, apart) in &points {
                figure.table.rows.push(vec![
                    id.to_string(),
                    self.name(id),
                    number(time_s, 3),
                    number(apart, 5),
                ]);
            }
            panel
                .lines
                .push(ChartLine { points, stroke: LineStyle { dash: Dash::Solid, ..self.stroke(id) } });
        }
        panel.fit(&[0.0], &[0.0]);
        figure.panels.push(panel);
        figure.legend = self.keys_of(&ids);
        figure.note = format!(
            "Between the middles of a vehicle's outline in \"{}\" and in \"{}\" at the same time. Laboratory metres.{word}",
            self.labels[0], self.labels[1]
        );
        figure
    }
}

/// Warm colours on the first of two paths, cold ones on the second: distinct in colour and dash.
fn stroke_of(stream: usize, place: usize, streams: usize) -> LineStyle {
    const WARM: [usize; 3] = [0, 2, 4];
    const COLD: [usize; 3] = [1, 3, 5];
    let index = match (streams, stream) {
        (2, 0) => WARM[place % WARM.len()],
        (2, _) => COLD[place % COLD.len()],
        _ => (place + 2 * stream) % PALETTE.len(),
    };
    let dash = [Dash::Solid, Dash::Dashed, Dash::Dotted][stream.min(2)];
    LineStyle { colour: PALETTE[index], dash, width_pt: 1.1 }
}

/// Labels of runs: their environments where these differ, else with the folder.
fn labels(runs: &[RunLog]) -> Vec<String> {
    let settings: BTreeSet<&str> = runs.iter().map(RunLog::setting).collect();
    if settings.len() == runs.len() {
        return runs.iter().map(|run| run.setting().to_owned()).collect();
    }
    let folder = |run: &RunLog| {
        let parent = run.path.parent().and_then(|parent| parent.file_name());
        parent.map_or_else(|| run.path.display().to_string(), |name| name.to_string_lossy().into_owned())
    };
    let folders: BTreeSet<String> = runs.iter().map(folder).collect();
    let name = |(index, run): (usize, &RunLog)| match folders.len() == runs.len() {
        true => format!("{}, {}", run.setting(), folder(run)),
        false => format!("{}, run {}", run.setting(), char::from(b'A' + (index % 26) as u8)),
    };
    runs.iter().enumerate().map(name).collect()
}
