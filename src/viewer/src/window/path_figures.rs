//! The figures of paths in the panel Charts: which merging point they show, and why there are none.

use crate::ui::{ChartKind, ChartSpan, ChartState, MergeChoice};
use city3d_logbook::figures::chart::Figure;
use city3d_logbook::figures::{FigureSet, MergingPoint, RunLog, StreamLayout, merges, passing, some_names};
use city3d_protocol::snapshot::VehicleId;
use std::collections::BTreeSet;

/// Of the tables of figures of paths.
const VEHICLE_COLUMN: usize = 2;
/// Most vehicles that a message names.
const MOST_NAMED: usize = 3;

/// The merging points of a run to choose from.
pub(super) fn merge_choices(run: &RunLog) -> Vec<MergeChoice> {
    let choice = |merge: MergingPoint| MergeChoice { lane: merge.name, vehicles: merge.vehicles };
    merges(run).into_iter().map(choice).collect()
}

/// Figures of the paths of a run, as they were chosen.
pub(super) struct PathFigures<'a> {
    pub run: &'a RunLog,
    pub charts: &'a ChartState,
    pub selected: Option<VehicleId>,
    /// Where a span of the last seconds ends; the end of the run by default.
    pub until_s: Option<f64>,
}

impl PathFigures<'_> {
    /// The merging point that was chosen, else the one that most of the kept vehicles pass, or without these the selected
    /// one; `None` where no paths merge.
    pub fn merge(&self) -> Option<MergingPoint> {
        let mut all = merges(self.run);
        let chosen = all.iter().position(|merge| Some(&merge.name) == self.charts.merge.as_ref());
        let wanted: Vec<VehicleId> = match self.charts.vehicles.is_empty() {
            true => self.selected.into_iter().collect(),
            false => self.charts.vehicles.clone(),
        };
        let count =
            |merge: &MergingPoint| passing(self.run, merge).iter().filter(|id| wanted.contains(id)).count();
        // Of equal ones the first, which most vehicles pass.
        let best = (0..all.len()).rev().max_by_key(|index| count(&all[*index]));
        chosen.or(best).map(|index| all.swap_remove(index))
    }

    /// The figure.
    ///
    /// # Errors
    /// Why there is none, and what to do.
    pub fn draw(&self) -> Result<Figure, String> {
        let merge = self.merge();
        let name = merge.as_ref().map(|merge| merge.name.as_str());
        let layout = StreamLayout::of(self.run, name, None).map_err(|error| error.to_string())?;
        if layout.streams.is_empty() {
            return Err("No vehicle follows a lane yet.".to_owned());
        }
        let mut figure = self.of_layout(&layout)?;
        if figure.table.rows.is_empty() {
            return Err(self.absence(merge.as_ref()));
        }
        let span = self.charts.span;
        if span != ChartSpan::Whole && self.charts.kind != ChartKind::SpeedAlongPath {
            let end_s = self.until_s.unwrap_or(f64::INFINITY).min(self.run.end_s);
            let from_s = (end_s - span.length_s()).max(0.0);
            if !has_points_after(&figure, from_s) {
                return Err("Nobody was on these paths in that time: show the whole run.".to_owned());
            }
            figure.panels.iter_mut().for_each(|panel| panel.x = (from_s, end_s));
        }
        if let Some(absent) = self.absent(&figure) {
            figure.note = format!("{absent} {}", figure.note);
        }
        Ok(figure)
    }

    /// Which of the wanted vehicles a figure does not have: they are on none of its paths.
    pub fn absent(&self, figure: &Figure) -> Option<String> {
        let drawn: BTreeSet<&str> =
            figure.table.rows.iter().filter_map(|row| row.get(VEHICLE_COLUMN)).map(String::as_str).collect();
        let wanted = self.only();
        let all = self.run.vehicles.iter().filter(|trace| wanted.is_empty() || wanted.contains(&trace.id));
        let absent = all.filter(|trace| !drawn.contains(trace.id.to_string().as_str()));
        let names: Vec<String> = absent.map(|trace| format!("{} {}", trace.id, trace.name)).collect();
        (!names.is_empty()).then(|| format!("Not on these paths: {}.", some_names(&names)))
    }

    /// The vehicles that are wanted alone; empty for all. Beside kept ones the selected one is shown.
    fn only(&self) -> BTreeSet<VehicleId> {
        let mut only: BTreeSet<VehicleId> = self.charts.vehicles.iter().copied().collect();
        if !only.is_empty() {
            only.extend(self.selected);
        }
        only
    }

    fn of_layout(&self, layout: &StreamLayout) -> Result<Figure, String> {
        // The figures of all vehicles say more than those of one.
        let runs = std::slice::from_ref(self.run);
        let figures = FigureSet::new(runs, layout, &self.only()).in_metres_of(self.charts.scale);
        match self.charts.kind {
            ChartKind::Positions if layout.merge.is_none() => {
                Err("No paths of this run merge so far.".to_owned())
            }
            ChartKind::Positions => Ok(figures.position()),
            ChartKind::SpeedAlongPath => Ok(figures.speed(self.path(layout))),
            ChartKind::SpaceTime | ChartKind::Way | ChartKind::Series(_) => Ok(figures.space_time()),
        }
    }

    /// The first path with a kept vehicle.
    fn path(&self, layout: &StreamLayout) -> usize {
        let is_kept = |id: VehicleId| self.charts.vehicles.contains(&id);
        let streams = layout.streams(self.run);
        let found = streams.iter().position(|stream| stream.members.iter().any(|m| is_kept(m.vehicle)));
        found.unwrap_or(0)
    }

    /// Why no kept vehicle is in a figure, and what to do.
    fn absence(&self, merge: Option<&MergingPoint>) -> String {
        let kept: BTreeSet<VehicleId> = self.charts.vehicles.iter().copied().collect();
        if kept.is_empty() {
            return "Nobody has driven on these paths yet.".to_owned();
        }
        let passes_any = |merge: &MergingPoint| !passing(self.run, merge).is_disjoint(&kept);
        let does = |one, many| if kept.len() == 1 { one } else { many };
        let names = self.names();
        let words = match merge {
            None => format!("{} on none of the paths of this figure: show", does("is", "are")),
            Some(_) if merges(self.run).iter().any(passes_any) => {
                let does = does("does not", "do not");
                format!("{does} pass this merging point: choose another one, or show")
            }
            Some(_) => format!("{} passed no merging point so far: show", does("has", "have")),
        };
        format!("{names} {words} all vehicles.")
    }

    /// The kept vehicles by their names.
    fn names(&self) -> String {
        let kept = &self.charts.vehicles;
        let name = |id: &VehicleId| {
            self.run.vehicle(*id).map_or_else(|| format!("Vehicle {id}"), |trace| trace.name.clone())
        };
        match &kept[..] {
            _ if kept.len() > MOST_NAMED => format!("The {} kept vehicles", kept.len()),
            [before @ .., last] if !before.is_empty() => {
                let before: Vec<String> = before.iter().map(name).collect();
                format!("{} and {}", before.join(", "), name(last))
            }
            _ => kept.iter().map(name).collect(),
        }
    }
}

/// Whether a figure over time has something to show from a time on.
fn has_points_after(figure: &Figure, from_s: f64) -> bool {
    let lines = figure.panels.iter().flat_map(|panel| &panel.lines);
    lines.flat_map(|line| &line.points).any(|(time_s, _)| *time_s >= from_s)
}
