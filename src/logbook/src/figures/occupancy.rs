//! Occupancy of conflict zones: when each vehicle was in them, beside the space-time diagrams of the paths.

use super::chart::{ChartLine, Colour, Dash, Figure, LegendEntry, LineStyle, Panel};
use super::paths::StreamMember;
use super::run::{RunLog, Trace};
use super::table::number;
use super::views::FigureSet;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{CityMap, ConflictZone, ZoneId, ZoneKind};
use std::collections::{BTreeMap, BTreeSet};

/// A vehicle in a conflict zone: from when its front enters until its rear has left, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZoneStay {
    /// The conflict zone in the map of the run.
    pub zone: ZoneId,
    /// The side that the vehicle passes, 0 or 1.
    pub side: usize,
    /// Who is inside.
    pub vehicle: VehicleId,
    /// The front bumper enters; the first sample of a vehicle that begins inside.
    pub entered_s: f64,
    /// The rear bumper has left; the last sample of a vehicle that is still inside.
    pub left_s: f64,
}

/// All stays of a run in merges and crossings, by zone and time.
pub fn zone_stays(run: &RunLog) -> Vec<ZoneStay> {
    let map = &run.experiment.city_map;
    let mut found: Vec<ZoneStay> = run.vehicles.iter().flat_map(|trace| stays_of(map, trace)).collect();
    found.sort_by(|a, b| a.zone.cmp(&b.zone).then(a.entered_s.total_cmp(&b.entered_s)));
    found
}

fn stays_of(map: &CityMap, trace: &Trace) -> Vec<ZoneStay> {
    let fronts: Vec<(f64, f64)> = (0..trace.samples.len())
        .map(|k| (trace.samples[k].time_s, trace.front_m(k)))
        .filter(|(_, front_m)| front_m.is_finite())
        .collect();
    let (Some(first), Some(last)) = (fronts.first(), fronts.last()) else { return Vec::new() };
    let mut found = Vec::new();
    for visit in &trace.track.visits {
        for zone in map.zones_on(visit.lane).filter(|zone| zone.kind != ZoneKind::Diverge) {
            let side = usize::from(zone.sides[0].lane != visit.lane);
            let enters_m = visit.start_m + zone.sides[side].from_m;
            let leaves_m = visit.start_m + zone.sides[side].to_m + trace.dimensions.length_m;
            if first.1 >= leaves_m || last.1 < enters_m {
                continue;
            }
            let entered_s = if first.1 >= enters_m { Some(first.0) } else { passing(&fronts, enters_m) };
            let left_s = if last.1 < leaves_m { Some(last.0) } else { passing(&fronts, leaves_m) };
            if let (Some(entered_s), Some(left_s)) = (entered_s, left_s) {
                found.push(ZoneStay { zone: zone.id, side, vehicle: trace.id, entered_s, left_s });
            }
        }
    }
    found
}

/// When a front passes a station: linear interpolation between samples.
fn passing(fronts: &[(f64, f64)], at_m: f64) -> Option<f64> {
    let step = fronts.windows(2).find(|pair| pair[0].1 < at_m && pair[1].1 >= at_m)?;
    let share = (at_m - step[0].1) / (step[1].1 - step[0].1);
    Some(step[0].0 + share * (step[1].0 - step[0].0))
}

/// Most zones that have a row.
const MOST_ZONES: usize = 8;
/// Most zones that the note names.
const MOST_NAMED: usize = 4;
const BAR_PT: f64 = 5.0;
const INSIDE_PT: f64 = 3.2;

/// Colour of vehicles that are on none of the paths.
const OTHERS: Colour = [170, 170, 170];

/// Stays in a zone.
#[derive(Clone, Copy, Debug, Default)]
struct StaysOfZone {
    /// Number on each side.
    sides: [usize; 2],
    /// One of them at least is that of a vehicle on one of the paths.
    is_on_path: bool,
}

impl FigureSet<'_> {
    /// Space-time diagrams of the paths with the stays in conflict zones, and the stays by zone below. `None` where
    /// no zone was passed on both sides.
    pub(super) fn occupancy(&self) -> Option<Figure> {
        let stays: Vec<Vec<ZoneStay>> = self.runs.iter().map(zone_stays).collect();
        let zones = self.zones_of_paths(&stays);
        if zones.is_empty() {
            return None;
        }
        let map = &self.runs[0].experiment.city_map;
        let columns = ["run", "zone", "kind", "lane", "vehicle", "name", "entered_s", "left_s"];
        let mut figure = self.figure("occupancy", "conflict zones and who was in them", &columns);
        let last_s = self.runs.iter().map(|run| run.end_s).fold(0.0, f64::max);
        for stream in 0..self.layout.streams.len() {
            for (run, stays) in stays.iter().enumerate() {
                figure.panels.push(self.path_panel((run, stream), &zones, stays));
            }
        }
        Self::fit_alike(&mut figure, &[0.0, last_s], self.origin());
        let x = figure.panels.first().map_or((0.0, last_s), |panel| panel.x);
        for (run, stays) in stays.iter().enumerate() {
            figure.panels.push(self.zone_panel(run, &zones, stays, x));
            let shown = stays.iter().filter(|stay| self.shows(stay.vehicle));
            for stay in shown.filter(|stay| zones.contains(&stay.zone)) {
                let zone = map.zone(stay.zone);
                figure.table.rows.push(vec![
                    self.labels[run].clone(),
                    stay.zone.0.to_string(),
                    kind(zone).to_owned(),
                    map.lane(zone.sides[stay.side].lane).name.clone(),
                    stay.vehicle.to_string(),
                    self.name(stay.vehicle),
                    number(stay.entered_s, 3),
                    number(stay.left_s, 3),
                ]);
            }
        }
        figure.row_height *= if self.runs.len() == 1 { 0.5 } else { 0.7 };
        let all = 0..self.layout.streams.len();
        figure.legend = match self.has_own_colours() {
            true => self.legend(all),
            false => all.filter_map(|stream| self.key_of_path(stream)).collect(),
        };
        figure.legend.iter_mut().for_each(|key| key.stroke.dash = Dash::Solid);
        if figure.panels.iter().flat_map(|panel| &panel.lines).any(|line| line.stroke.colour == OTHERS) {
            figure.legend.push(LegendEntry {
                name: "vehicles of other paths".to_owned(),
                stroke: LineStyle::solid(OTHERS),
            });
        }
        figure.note = format!(
            "Thick: in a conflict zone, from the front bumper at its beginning until the rear bumper is behind it. \
             Below, a row for each zone, with its two sides one above the other. {} {}",
            named(map, &zones),
            self.origin_note()
        );
        Some(figure)
    }

    /// Space-time diagram of one path, thick where its vehicles are in a zone.
    fn path_panel(&self, (run, stream): (usize, usize), zones: &[ZoneId], stays: &[ZoneStay]) -> Panel {
        let path = self.streams[run][stream].name.clone();
        let title = match self.runs.len() {
            1 => path,
            _ => format!("{}: {path}", self.panel_title(run)),
        };
        let mut panel = Panel { title, y_label: "Position [m]".to_owned(), ..Panel::default() };
        for segment in self.segments(run, stream) {
            let id = segment.trace.id;
            let stroke = self.bar_style(stream, id);
            let points: Vec<(f64, f64)> =
                segment.points.iter().map(|&(k, m, _)| (segment.trace.samples[k].time_s, m)).collect();
            let own = stays.iter().filter(|stay| stay.vehicle == id && zones.contains(&stay.zone));
            let inside: Vec<(f64, f64)> = own.map(|stay| (stay.entered_s, stay.left_s)).collect();
            let is_inside = |time_s: f64| inside.iter().any(|&(from, to)| (from..=to).contains(&time_s));
            let thick = points
                .iter()
                .map(|&(time_s, m)| if is_inside(time_s) { (time_s, m) } else { (time_s, f64::NAN) })
                .collect();
            panel
                .lines
                .push(ChartLine { points: thick, stroke: LineStyle { width_pt: INSIDE_PT, ..stroke } });
            panel.lines.push(ChartLine { points, stroke: LineStyle { width_pt: 0.8, ..stroke } });
        }
        panel
    }

    /// Stays by zone: a row for each zone, a bar for each vehicle, those of the second side lower.
    fn zone_panel(&self, run: usize, zones: &[ZoneId], stays: &[ZoneStay], x: (f64, f64)) -> Panel {
        let count = zones.len() as f64;
        let rows = zones.iter().enumerate().map(|(row, zone)| (row as f64, zone.0.to_string()));
        let mut panel = Panel {
            title: self.panel_title(run),
            x_label: "Time [s]".to_owned(),
            y_label: "Zone".to_owned(),
            x,
            y: (-0.5, count - 0.5),
            marks: [None, Some(rows.collect())],
            height_share: (0.25 + 0.1 * count).min(1.0),
            ..Panel::default()
        };
        let apart = if zones.len() > MOST_ZONES / 2 { 0.18 } else { 0.12 };
        for stay in stays.iter().filter(|stay| self.shows(stay.vehicle)) {
            let Some(row) = zones.iter().position(|zone| *zone == stay.zone) else { continue };
            let y = row as f64 + if stay.side == 0 { apart } else { -apart };
            let width_pt = BAR_PT.min(28.0 / count);
            let style = self.stream_of(run, stay).map(|stream| self.bar_style(stream, stay.vehicle));
            let style = style.unwrap_or(LineStyle::solid(OTHERS));
            let stroke = LineStyle { width_pt, ..style };
            panel.lines.push(ChartLine { points: vec![(stay.entered_s, y), (stay.left_s, y)], stroke });
        }
        panel
    }

    /// Solid line in the colour of a vehicle or, where colours are there twice, of its path.
    fn bar_style(&self, stream: usize, id: VehicleId) -> LineStyle {
        let style =
            if self.has_own_colours() { self.style_on(stream, id) } else { self.style_of_path(stream) };
        LineStyle { dash: Dash::Solid, ..style }
    }

    /// The path on which a vehicle is during a stay; `None` where it is on none.
    fn stream_of(&self, run: usize, stay: &ZoneStay) -> Option<usize> {
        let trace = self.runs[run].vehicle(stay.vehicle)?;
        let is_there = |member: &StreamMember| {
            member.vehicle == stay.vehicle
                && (member.from_m..=member.to_m).contains(&trace.front_at_m(stay.entered_s))
        };
        self.streams[run].iter().position(|stream| stream.members.iter().any(is_there))
    }

    /// Zones that vehicles passed on both sides, at least one of them on a path: those with most stays, by their numbers.
    fn zones_of_paths(&self, runs: &[Vec<ZoneStay>]) -> Vec<ZoneId> {
        let mut stays_of: BTreeMap<ZoneId, StaysOfZone> = BTreeMap::new();
        for (run, stays) in runs.iter().enumerate() {
            for stay in stays.iter().filter(|stay| self.shows(stay.vehicle)) {
                let of = stays_of.entry(stay.zone).or_default();
                of.sides[stay.side] += 1;
                of.is_on_path |= self.stream_of(run, stay).is_some();
            }
        }
        let mut met: Vec<(usize, ZoneId)> = stays_of
            .into_iter()
            .filter(|(_, of)| of.is_on_path && of.sides.iter().all(|count| *count > 0))
            .map(|(zone, of)| (of.sides.iter().sum(), zone))
            .collect();
        met.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        met.truncate(MOST_ZONES);
        let mut zones: Vec<ZoneId> = met.into_iter().map(|(_, zone)| zone).collect();
        zones.sort();
        zones
    }
}

fn kind(zone: &ConflictZone) -> &'static str {
    match zone.kind {
        ZoneKind::Cross => "crossing",
        ZoneKind::Merge => "merge",
        ZoneKind::Diverge => "diverge",
    }
}

/// The lanes of the first zones, in words.
fn named(map: &CityMap, zones: &[ZoneId]) -> String {
    let word = |zone: &ZoneId| {
        let zone = map.zone(*zone);
        let lanes: BTreeSet<&str> = zone.sides.iter().map(|side| map.lane(side.lane).name.as_str()).collect();
        format!(
            "Zone {}: {} of {}",
            zone.id.0,
            kind(zone),
            lanes.into_iter().collect::<Vec<_>>().join(" and ")
        )
    };
    let words: Vec<String> = zones.iter().take(MOST_NAMED).map(word).collect();
    let more = if zones.len() > MOST_NAMED { "; the CSV has the others" } else { "" };
    format!("{}{more}.", words.join("; "))
}
