//! The figures of one run, or of two side by side: vehicles, their line styles, and what all figures share.

use super::FigureScale;
use super::chart::{BLACK, Colour, Dash, Figure, LegendEntry, LineStyle, Panel, ReferenceLine};
use super::labels::labels;
use super::paths::{BEHIND_M, Stream, StreamLayout, StreamMember, listed};
use super::run::{RunLog, Trace};
use super::series::moving_average;
use super::style::{distinct_styles, plain_where_possible, styles_of_stream};
use super::table::{TidyTable, number};
use city3d_protocol::snapshot::VehicleId;
use city3d_simulation::scenario::counted;
use std::collections::{BTreeMap, BTreeSet};

/// Least range of the speed axis, laboratory m/s.
pub(super) const LEAST_SPEED_MPS: f64 = 0.05;
/// Who comes so near to the end of a path has come to it, laboratory metres.
const NEAR_END_M: f64 = 0.05;
/// Most vehicles with line styles of their own.
pub(super) const MOST_STYLES: usize = 12;

/// All figures of one run, or of two side by side.
#[derive(Debug)]
pub struct FigureSet<'a> {
    pub(super) runs: &'a [RunLog],
    pub(super) layout: &'a StreamLayout,
    /// Streams of each run.
    pub(super) streams: Vec<Vec<Stream>>,
    pub(super) labels: Vec<String>,
    /// The selected vehicles.
    shown: BTreeSet<VehicleId>,
    /// Line styles of those on the paths; empty where they are too many for styles of their own.
    styles: BTreeMap<VehicleId, LineStyle>,
    /// The metres that axes and columns name; laboratory metres, without a name, where there is none.
    pub(super) scale: Option<FigureScale>,
}

/// A trace segment of a vehicle on a path: sample index, position and averaged speed in laboratory units; NaN where it was
/// not measured, so that lines have a gap there.
pub(super) struct PathSegment<'r> {
    pub(super) trace: &'r Trace,
    pub(super) points: Vec<(usize, f64, f64)>,
}

impl PathSegment<'_> {
    /// Its rows in a table, by [`FigureSet::segment_columns`].
    pub(super) fn rows(&self, run: &str, path: &str) -> impl Iterator<Item = Vec<String>> {
        let told = self.points.iter().filter(|(_, position, _)| position.is_finite());
        told.map(move |&(k, position, speed)| {
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
    /// Figures of runs on one map; of all vehicles unless some are named.
    pub fn new(runs: &'a [RunLog], layout: &'a StreamLayout, only: &BTreeSet<VehicleId>) -> Self {
        let streams: Vec<Vec<Stream>> = runs.iter().map(|run| layout.streams(run)).collect();
        let all = runs.iter().flat_map(|run| &run.vehicles).map(|trace| trace.id);
        let shown: BTreeSet<VehicleId> = all.filter(|id| only.is_empty() || only.contains(id)).collect();
        let styles = styles_of(&shown, &streams);
        Self { runs, layout, streams, labels: labels(runs), shown, styles, scale: None }
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
        figures.push(self.speed_over_time());
        figures.push(self.lateral_error());
        if self.runs.iter().any(|run| run.origin.has_world()) {
            figures.push(self.pedals());
        } else {
            notes.push("a log of poses alone has no pedals: no figure of them".to_owned());
        }
        (figures, notes)
    }

    /// Which of several merging points the figures show, and how to see the others; `None` without others.
    pub fn merge_note(&self) -> Option<String> {
        let StreamLayout { merge: Some(merge), other_merges, is_requested, .. } = self.layout else {
            return None;
        };
        if other_merges.is_empty() {
            return None;
        }
        let why = if *is_requested { "as requested" } else { "which most vehicles passed" };
        Some(format!(
            "streams merge at {} points; the figures show the beginning of {} ({} of {}), {why}; --merge LANE shows \
             another one: {}",
            other_merges.len() + 1,
            merge.name,
            merge.vehicles,
            counted(self.runs[0].vehicles.len(), "vehicle"),
            listed(other_merges)
        ))
    }

    fn title(&self, what: &str) -> String {
        let mut names: Vec<&str> = self.runs.iter().map(|run| run.experiment.name.as_str()).collect();
        names.dedup();
        match self.runs.len() {
            1 => format!("{}: {what}", self.labels[0]),
            _ => format!("{}: {what}", names.join(" and ")),
        }
    }

    pub(super) fn panel_title(&self, run: usize) -> String {
        if self.runs.len() == 1 {
            return String::new();
        }
        format!("({}) {}", panel_letter(run), self.labels[run])
    }

    /// The positions that an axis has besides those of the vehicles: the origin before a merging point.
    pub(super) fn origin(&self) -> &'static [f64] {
        if self.layout.merge.is_some() { &[0.0] } else { &[] }
    }

    /// Note on the origin of positions.
    pub(super) fn origin_note(&self) -> String {
        let lane = |index: usize| self.streams[0][index].lane.as_str();
        let frame = match self.scale {
            Some(FigureScale::City | FigureScale::CityMetresPerSecond) => "Full-scale metres",
            None | Some(FigureScale::Laboratory) => "Laboratory metres",
        };
        match &self.layout.merge {
            Some(merge) => {
                let before = self.metres(self.layout.merge_at_m);
                let by = (0..self.layout.streams.len()).map(|k| format!("Path {} by {}", k + 1, lane(k)));
                // Figures that name their metres are those of the window, which has a list of merging points.
                let how = match self.scale {
                    Some(_) => "",
                    None => "; city3d plot --merge LANE shows another one",
                };
                let others = match self.layout.other_merges.len() {
                    0 => String::new(),
                    others => format!(" It is one of {} merging points{how}.", others + 1),
                };
                format!(
                    "{frame}, front bumper. 0 lies {before:.2} m before the merging point, the beginning of \
                     {}, on every path; {}.{others}",
                    merge.name,
                    by.collect::<Vec<_>>().join(", ")
                )
            }
            None => {
                let by = (0..self.layout.streams.len()).map(|k| format!("{} (Path {})", lane(k), k + 1));
                format!("{frame}, front bumper. 0 is the beginning of {}.", by.collect::<Vec<_>>().join(", "))
            }
        }
    }

    /// Where paths through a merging point end.
    fn path_end(&self) -> Option<f64> {
        let behind_m = self.runs[0].experiment.scale.city_from_lab(BEHIND_M);
        self.layout.merge.as_ref().map(|_| self.metres(self.layout.merge_at_m + behind_m))
    }

    /// A line where a path ends, if vehicles come there: they drive on, but not in the figure.
    pub(super) fn end_rule(&self, panel: &Panel) -> Option<ReferenceLine> {
        let end = self.path_end()?;
        let near = self.metres(self.runs[0].experiment.scale.city_from_lab(NEAR_END_M));
        let is_reached = panel.lines.iter().any(|line| line.points.iter().any(|(_, at)| *at > end - near));
        is_reached.then(|| ReferenceLine {
            at: end,
            is_level: true,
            name: "end of the path: vehicles drive on".to_owned(),
            dash: Dash::Dotted,
            is_before: false,
        })
    }

    pub(super) fn segments(&self, run: usize, stream: usize) -> impl Iterator<Item = PathSegment<'_>> {
        let log = &self.runs[run];
        let is_shown = |member: &&StreamMember| self.shows(member.vehicle);
        let members = self.streams[run][stream].members.iter().filter(is_shown);
        members.filter_map(move |member| {
            let trace = log.vehicle(member.vehicle)?;
            let speeds = moving_average(trace);
            let at = |k: usize| {
                if !trace.samples[k].is_seen {
                    return Some((k, f64::NAN, f64::NAN));
                }
                self.layout
                    .position_m(trace, member, k)
                    .map(|m| (k, self.metres(m), self.speed_of(speeds[k])))
            };
            Some(PathSegment { trace, points: (0..trace.samples.len()).filter_map(at).collect() })
        })
    }

    /// Whether a vehicle is one of the selected.
    pub(super) fn shows(&self, id: VehicleId) -> bool {
        self.shown.contains(&id)
    }

    /// Whether each vehicle has a line style of its own.
    pub(super) fn has_own_styles(&self) -> bool {
        !self.styles.is_empty()
    }

    /// Whether the vehicles on the paths are told apart by their colours alone.
    pub(super) fn has_own_colours(&self) -> bool {
        let colours: BTreeSet<Colour> = self.styles.values().map(|style| style.colour).collect();
        self.has_own_styles() && colours.len() == self.styles.len()
    }

    /// Line style of a vehicle on a path: its own, or that of the path where there are too many.
    pub(super) fn style_on(&self, stream: usize, id: VehicleId) -> LineStyle {
        let own = self.styles.get(&id).copied();
        own.unwrap_or_else(|| self.style_of_path(stream))
    }

    /// Line style of the vehicles of a path where they have none of their own.
    pub(super) fn style_of_path(&self, stream: usize) -> LineStyle {
        let style = styles_of_stream(stream, self.layout.streams.len()).next();
        LineStyle { dash: Dash::Solid, width_pt: 0.7, ..style.unwrap_or(LineStyle::solid(BLACK)) }
    }

    /// Line styles of some vehicles in a figure: those on the paths if all have some. They are solid where their colours
    /// tell them apart.
    pub(super) fn styles_of(&self, ids: &[VehicleId]) -> BTreeMap<VehicleId, LineStyle> {
        let own: Option<BTreeMap<VehicleId, LineStyle>> =
            ids.iter().map(|id| Some((*id, *self.styles.get(id)?))).collect();
        let others = || ids.iter().copied().zip(distinct_styles(ids.len())).collect();
        let mut styles = own.unwrap_or_else(others);
        plain_where_possible(styles.values_mut());
        styles
    }

    /// The selected vehicles of a path, in all runs.
    pub(super) fn members(&self, stream: usize) -> BTreeSet<VehicleId> {
        let members = self.streams.iter().flat_map(|streams| &streams[stream].members);
        members.map(|member| member.vehicle).filter(|id| self.shows(*id)).collect()
    }

    /// Reference lines of some paths in a run: where they give way, the merging point, and one car length before it.
    pub(super) fn rules(
        &self,
        run: usize,
        streams: impl Iterator<Item = usize>,
        is_level: bool,
    ) -> Vec<ReferenceLine> {
        let Some(_) = self.layout.merge else { return Vec::new() };
        let at = self.metres(self.layout.merge_at_m);
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
            if let Some(line) = self.streams[run][stream].line {
                let name = match is_level {
                    true => format!("{} of Path {}", self.line_name(stream), stream + 1),
                    false => self.line_name(stream),
                };
                rules.push(rule(at - self.metres(line.before_m), &name, Dash::Dotted, true));
            }
        }
        rules
    }

    /// Name of the line of a path at which vehicles give way, with the panels where the runs have different ones.
    fn line_name(&self, stream: usize) -> String {
        let line = |(run, streams): (usize, &Vec<Stream>)| Some((run, streams[stream].line?.kind.label()));
        let kinds: Vec<(usize, &str)> = self.streams.iter().enumerate().filter_map(line).collect();
        let is_same = |kind: &str| kinds.iter().all(|(_, other)| *other == kind);
        if let [(_, kind), ..] = kinds[..]
            && kinds.len() == self.runs.len()
            && is_same(kind)
        {
            return kind.to_owned();
        }
        let words = kinds.iter().map(|(run, kind)| format!("{kind} ({})", panel_letter(*run)));
        words.collect::<Vec<_>>().join(", ")
    }

    /// Length of the longest vehicle on the paths, laboratory metres.
    fn car_length(&self) -> f64 {
        let members = self.streams[0].iter().flat_map(|stream| &stream.members);
        let lengths =
            members.filter_map(|member| Some(self.runs[0].vehicle(member.vehicle)?.dimensions.length_m));
        self.metres(lengths.fold(0.0, f64::max))
    }

    /// The vehicles of some streams, or the streams where vehicles have no line styles of their own.
    pub(super) fn legend(&self, streams: impl Iterator<Item = usize>) -> Vec<LegendEntry> {
        let mut keys = Vec::new();
        for stream in streams {
            let members = self.members(stream);
            if !self.has_own_styles() {
                keys.extend(self.key_of_path(stream));
                continue;
            }
            // Names need not say on which path a vehicle is: the first one of each path does.
            let is_named = self.layout.streams.len() > 1;
            for (place, id) in members.into_iter().enumerate() {
                let path =
                    if is_named && place == 0 { format!("Path {}: ", stream + 1) } else { String::new() };
                let name = format!("{path}{}", self.name(id));
                keys.push(LegendEntry { name, stroke: self.style_on(stream, id) });
            }
        }
        keys
    }

    /// A path in a legend; `None` without vehicles.
    pub(super) fn key_of_path(&self, stream: usize) -> Option<LegendEntry> {
        let members = self.members(stream).len();
        let name = format!("Path {} ({})", stream + 1, counted(members, "vehicle"));
        (members > 0).then(|| LegendEntry { name, stroke: self.style_of_path(stream) })
    }

    /// The first vehicles up to a number, and a note where some are left out.
    pub(super) fn some(&self, most: usize) -> (Vec<VehicleId>, String) {
        let ids: Vec<VehicleId> = self.shown.iter().copied().take(most).collect();
        let word = match self.shown.len() > most {
            true => format!(" The first {most} of {} vehicles; --vehicle chooses others.", self.shown.len()),
            false => String::new(),
        };
        (ids, word)
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
}

fn panel_letter(run: usize) -> char {
    char::from(b'a' + (run % 26) as u8)
}

/// A style for each vehicle on a path, by the first path that it is on; none where they are too many. No two have the same.
fn styles_of(shown: &BTreeSet<VehicleId>, streams: &[Vec<Stream>]) -> BTreeMap<VehicleId, LineStyle> {
    let mut styles: BTreeMap<VehicleId, LineStyle> = BTreeMap::new();
    let count = streams.iter().map(Vec::len).max().unwrap_or(0);
    for stream in 0..count {
        let members = streams.iter().flat_map(|streams| &streams[stream].members);
        let members: BTreeSet<VehicleId> = members.map(|member| member.vehicle).collect();
        for &id in members.intersection(shown) {
            if styles.contains_key(&id) {
                continue;
            }
            if styles.len() == MOST_STYLES {
                return BTreeMap::new();
            }
            let has_new_colour =
                |style: &LineStyle| styles.values().all(|taken| taken.colour != style.colour);
            let is_free = |style: &LineStyle| styles.values().all(|taken| taken != style);
            let mut wanted = styles_of_stream(stream, count);
            let style = wanted.find(has_new_colour).or_else(|| styles_of_stream(stream, count).find(is_free));
            styles.insert(id, style.unwrap_or(LineStyle::solid(BLACK)));
        }
    }
    styles
}
