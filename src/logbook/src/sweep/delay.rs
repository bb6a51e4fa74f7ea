//! Delay of sweeps against flow, or against the numbers of an axis: a curve for each setting of the other axes, with
//! confidence intervals over seeds.

use super::interval::MeanInterval;
use super::map::SweepResults;
use super::table::{SweepRow, column};
use crate::figures::{TidyTable, number};
use city3d_simulation::sweep::Axis;
use std::collections::BTreeSet;
use thiserror::Error;
use toml::Value;

/// Columns of the table of a sweep whose means the figure's table has.
const QUANTITIES: [&str; 14] = [
    "throughput_per_h",
    "mean_delay_s",
    "max_delay_s",
    "mean_travel_s",
    "held_s",
    "slow_stops",
    "stood_s",
    "mean_queue",
    "fuel_ml",
    "fuel_with_cruise_ml",
    "int_u2_m2ps3",
    "min_ttc_s",
    "min_pet_s",
    "collisions",
];

/// Axes with one of these words in the last part of their keys vary the demand.
const DEMAND_WORDS: [&str; 4] = ["rate", "per_h", "flow", "demand"];

/// The axis that delays belong to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DelayAxis {
    /// The last part of its key, such as `rate_veh_h` or `share_cav`.
    pub name: String,
    /// The axis varies the demand, so that delays are drawn against the flow that left.
    pub is_demand: bool,
}

/// One point of a curve: the runs of one setting.
#[derive(Clone, Debug, PartialEq)]
pub struct DelayPoint {
    /// Name of the curve: the setting of the other axes, or the scenario where there are none.
    pub curve: String,
    /// Value of the [`DelayAxis`].
    pub value: String,
    /// Mean delay of the runs, s.
    pub delay_s: MeanInterval,
    /// Vehicles an hour that left, where it was measured.
    pub throughput_per_h: Option<MeanInterval>,
    /// Number of collisions in all runs of the point.
    pub collisions: u64,
}

/// Delays of one sweep, or of several in one figure.
#[derive(Debug)]
pub struct DelayCurves {
    pub(super) axis: DelayAxis,
    /// Names of the scenarios.
    pub(super) scenarios: Vec<String>,
    /// Points by curve, in the order of the runs.
    pub(super) points: Vec<DelayPoint>,
    /// Means and intervals of all quantities.
    pub(super) table: TidyTable,
}

/// Delays of different axes have no common figure.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "{first} varies {of_first}, and {other} varies {of_other}; sweeps of the same parameter can be compared"
)]
pub struct DifferentAxes {
    first: String,
    of_first: String,
    other: String,
    of_other: String,
}

impl DelayCurves {
    /// Delays of a sweep; `None` where no axis has several numbers, or no run has a delay.
    pub fn of(sweep: &SweepResults<'_>) -> Option<Self> {
        let (index, axis) = abscissa(sweep.axes)?;
        let cells: usize = sweep.axes.iter().map(|axis| axis.values.len()).product();
        let per_cell = (sweep.rows.len() / cells.max(1)).max(1);
        let mut curves = Self {
            table: TidyTable::new(&["curve", axis.column(), "runs", "quantity", "mean", "ci95"]),
            axis,
            scenarios: vec![sweep.name().to_owned()],
            points: Vec::new(),
        };
        for cell in sweep.rows.chunks(per_cell) {
            let (curve, value) = (sweep.curve(&cell[0], index), cell[0][index].to_owned());
            curves.tabulate(sweep, cell, &curve, &value);
            let Some(delay_s) = sweep.interval(cell, "mean_delay_s") else { continue };
            let collisions = sweep.interval(cell, "collisions");
            curves.points.push(DelayPoint {
                curve,
                value,
                delay_s,
                throughput_per_h: sweep.interval(cell, "throughput_per_h"),
                collisions: collisions.map_or(0, |found| (found.mean * found.count as f64).round() as u64),
            });
        }
        (!curves.points.is_empty()).then_some(curves)
    }

    /// Adds rows with the means of a cell.
    fn tabulate(&mut self, sweep: &SweepResults<'_>, cell: &[SweepRow], curve: &str, value: &str) {
        for quantity in QUANTITIES {
            let Some(found) = sweep.interval(cell, quantity) else { continue };
            self.table.rows.push(vec![
                curve.to_owned(),
                value.to_owned(),
                found.count.to_string(),
                quantity.to_owned(),
                number(found.mean, 6),
                found.half_width.map_or_else(String::new, |half| number(half, 6)),
            ]);
        }
    }

    /// Delays of several sweeps, each with a label. Curves of the same name in two sweeps get the labels in front; where
    /// the name is that of the scenario the label takes its place.
    ///
    /// # Errors
    /// When two sweeps vary different parameters.
    pub fn joined(sweeps: Vec<(String, Self)>) -> Result<Option<Self>, DifferentAxes> {
        let shared = names_of_several(&sweeps);
        let mut sweeps = sweeps.into_iter();
        let Some((first, mut all)) = sweeps.next() else { return Ok(None) };
        all.label(&first, &shared);
        for (other, mut one) in sweeps {
            if one.axis != all.axis {
                let (of_first, of_other) = (all.axis.name, one.axis.name);
                return Err(DifferentAxes { first, of_first, other, of_other });
            }
            one.label(&other, &shared);
            all.points.append(&mut one.points);
            all.table.rows.append(&mut one.table.rows);
            all.scenarios.retain(|name| !one.scenarios.contains(name));
            all.scenarios.append(&mut one.scenarios);
        }
        Ok(Some(all))
    }

    /// Puts a label in front of the names of these curves.
    fn label(&mut self, label: &str, shared: &BTreeSet<String>) {
        let names = self.points.iter_mut().map(|point| &mut point.curve);
        let names = names.chain(self.table.rows.iter_mut().map(|row| &mut row[0]));
        for name in names.filter(|name| shared.contains(*name)) {
            *name = match self.scenarios.contains(name) {
                true => label.to_owned(),
                false => format!("{label}: {name}"),
            };
        }
    }

    /// The axis that the points' values are of.
    pub fn axis(&self) -> &DelayAxis {
        &self.axis
    }

    /// Points by curve, in the order of the runs.
    pub fn points(&self) -> &[DelayPoint] {
        &self.points
    }

    /// Names of the curves, in the order of the runs.
    pub fn names(&self) -> Vec<&str> {
        distinct(self.points.iter().map(|point| point.curve.as_str()))
    }

    /// Values of the axis, in the order of the runs.
    pub fn values(&self) -> Vec<&str> {
        distinct(self.points.iter().map(|point| point.value.as_str()))
    }
}

impl DelayAxis {
    /// Name of the table's column with its values.
    fn column(&self) -> &'static str {
        if self.is_demand { "demand" } else { "value" }
    }
}

impl SweepResults<'_> {
    fn interval(&self, cell: &[SweepRow], quantity: &str) -> Option<MeanInterval> {
        let index = column(self.axes.len(), quantity)?;
        let values: Vec<f64> = cell.iter().filter_map(|row| row[index].parse().ok()).collect();
        MeanInterval::of(&values)
    }

    /// Name of a row's curve: its values of the other axes that have several, else of those whose value is a word, such as an
    /// algorithm, else the scenario.
    fn curve(&self, row: &SweepRow, abscissa: usize) -> String {
        let others = || self.axes.iter().zip(row).enumerate().filter(|(index, _)| *index != abscissa);
        let words = |is_named: &dyn Fn(&Axis) -> bool| {
            let named = others().filter(|(_, (axis, _))| is_named(axis));
            named.map(|(_, (axis, value))| format!("{} {value}", last_part(&axis.key))).collect::<Vec<_>>()
        };
        let varied = words(&|axis| axis.values.len() > 1);
        let named =
            if varied.is_empty() { words(&|axis| axis.values.iter().all(Value::is_str)) } else { varied };
        if named.is_empty() { self.name().to_owned() } else { named.join(", ") }
    }
}

/// The axis of the demand, else the first one with several numbers, with its index.
fn abscissa(axes: &[Axis]) -> Option<(usize, DelayAxis)> {
    let demand = axes.iter().position(varies_demand);
    let index = demand.or_else(|| axes.iter().position(has_numbers))?;
    let name = last_part(&axes[index].key).to_owned();
    Some((index, DelayAxis { name, is_demand: demand.is_some() }))
}

/// Names of curves that more than one sweep has.
fn names_of_several(sweeps: &[(String, DelayCurves)]) -> BTreeSet<String> {
    let mut seen = BTreeSet::new();
    let names = sweeps.iter().flat_map(|(_, sweep)| sweep.names());
    names.filter(|name| !seen.insert(*name)).map(str::to_owned).collect()
}

/// Each word once, in the order in which they come.
fn distinct<'w>(words: impl Iterator<Item = &'w str>) -> Vec<&'w str> {
    let mut found = Vec::new();
    for word in words {
        if !found.contains(&word) {
            found.push(word);
        }
    }
    found
}

/// The last part of a dotted path.
fn last_part(key: &str) -> &str {
    key.rsplit('.').next().unwrap_or(key)
}

fn has_numbers(axis: &Axis) -> bool {
    axis.values.len() > 1 && axis.values.iter().all(|value| value.is_float() || value.is_integer())
}

fn varies_demand(axis: &Axis) -> bool {
    axis.values.len() > 1 && DEMAND_WORDS.iter().any(|word| last_part(&axis.key).contains(word))
}

#[cfg(test)]
mod tests {
    use super::super::table::COLUMNS;
    use super::*;

    /// Rows of two algorithms at two demands with two seeds each: flow and delay.
    fn rows(axes: &[Axis]) -> Vec<SweepRow> {
        let width = axes.len() + 1 + COLUMNS.len();
        let mut rows = Vec::new();
        for (algorithm, steep) in [("yield", 4.0), ("insert", 1.0)] {
            for rate in [600.0, 1200.0] {
                for seed in [1.0, 2.0] {
                    let mut row = vec![String::new(); width];
                    row[..3].clone_from_slice(&[algorithm.to_owned(), rate.to_string(), seed.to_string()]);
                    let mut set = |name: &str, value: f64| {
                        row[column(axes.len(), name).unwrap()] = value.to_string();
                    };
                    set("throughput_per_h", rate + 10.0 * seed);
                    set("mean_delay_s", steep * rate / 600.0 + seed);
                    rows.push(row.into());
                }
            }
        }
        rows
    }

    #[test]
    fn a_curve_for_each_algorithm_with_intervals_over_the_seeds() {
        let axes: Vec<Axis> = ["coordination.algorithm=yield,insert", "inflow.1.rate_veh_h=600,1200"]
            .map(|axis| axis.parse().unwrap())
            .into();
        let (rows, document) = (rows(&axes), toml::Table::new());
        let results = SweepResults { axes: &axes, rows: &rows, document: &document, is_testbed: false };
        let figure = DelayCurves::of(&results).unwrap().figure();
        let names: Vec<&str> = figure.legend.iter().map(|key| key.name.as_str()).collect();
        assert_eq!(names, ["algorithm yield", "algorithm insert"]);
        assert_eq!(figure.panels[0].lines[0].points, [(615.0, 5.5), (1215.0, 9.5)]);
        // Two seeds 1 apart: 12.706 x 0.7071 / 1.4142.
        let delays: Vec<_> = figure.table.rows.iter().filter(|row| row[3] == "mean_delay_s").collect();
        assert_eq!(delays[0][..5], ["algorithm yield", "600", "2", "mean_delay_s", "5.500000"]);
        assert_eq!(delays[0][5], "6.353000");
        assert_eq!(delays.len(), 4);
    }

    #[test]
    fn without_a_demand_the_delay_is_drawn_against_the_numbers_of_an_axis() {
        let document = toml::Table::new();
        let axes: Vec<Axis> = ["coordination.algorithm=yield,insert", "inflow.*.share_cav=600,1200"]
            .map(|axis| axis.parse().unwrap())
            .into();
        let rows = rows(&axes);
        let results = SweepResults { axes: &axes, rows: &rows, document: &document, is_testbed: false };
        let figure = DelayCurves::of(&results).unwrap().figure();
        assert_eq!((figure.name.as_str(), figure.panels[0].x_label.as_str()), ("delay", "share_cav"));
        assert_eq!(figure.panels[0].lines[0].points, [(600.0, 5.5), (1200.0, 9.5)]);
        // A word that all runs share names the curve, a number does not.
        let alike: Vec<Axis> = ["coordination.algorithm=replan", "inflow.*.share_cav=600,1200"]
            .map(|axis| axis.parse().unwrap())
            .into();
        let few: Vec<SweepRow> = rows[..4].to_vec();
        let curves = DelayCurves::of(&SweepResults { axes: &alike, rows: &few, ..results }).unwrap();
        assert_eq!(curves.names(), ["algorithm yield"]);
        // No number, no runs.
        for axis in ["coordination.algorithm=yield,insert", "environment.loss=0,0.1"] {
            let axes: Vec<Axis> = vec![axis.parse().unwrap()];
            let results = SweepResults { axes: &axes, rows: &[], document: &document, is_testbed: false };
            assert!(DelayCurves::of(&results).is_none(), "{axis}");
        }
    }

    #[test]
    fn curves_of_several_sweeps_share_a_figure_and_are_told_apart_by_labels() {
        let named = |name: &str| toml::Table::from_iter([("name".to_owned(), toml::Value::from(name))]);
        let axes: Vec<Axis> = ["coordination.algorithm=yield,insert", "inflow.1.rate_veh_h=600,1200"]
            .map(|axis| axis.parse().unwrap())
            .into();
        let rows = rows(&axes);
        let of = |document: &toml::Table, axes: &[Axis], rows: &[SweepRow]| {
            DelayCurves::of(&SweepResults { axes, rows, document, is_testbed: false }).unwrap()
        };
        let plans = || ("plans".to_owned(), of(&named("intersection"), &axes, &rows));
        // Without an axis but the demand the curve is called by its scenario.
        let only: Vec<Axis> = vec![axes[1].clone()];
        let bare: Vec<SweepRow> = rows[..4].iter().map(|row| row.iter().skip(1).collect()).collect();
        let signals = ("signals".to_owned(), of(&named("intersection-signals"), &only, &bare));
        let both = DelayCurves::joined(vec![plans(), signals]).unwrap().unwrap();
        assert_eq!(both.names(), ["algorithm yield", "algorithm insert", "intersection-signals"]);
        let figure = both.figure();
        assert_eq!((figure.legend.len(), figure.name.as_str()), (3, "delay_flow"));
        assert_eq!(figure.title, "intersection, intersection-signals: delay against flow");

        let testbed = ("testbed".to_owned(), plans().1);
        let twice = DelayCurves::joined(vec![plans(), testbed]).unwrap().unwrap();
        assert_eq!(
            twice.names(),
            [
                "plans: algorithm yield",
                "plans: algorithm insert",
                "testbed: algorithm yield",
                "testbed: algorithm insert"
            ]
        );
        assert_eq!(twice.table.rows[0][0], "plans: algorithm yield");

        let share = |values: &str| format!("inflow.*.share_cav={values}").parse().unwrap();
        // A point on the vertical axis would hide behind it.
        let with_none: Vec<Axis> = vec![axes[0].clone(), share("0,1200")];
        let renamed = |cell| if cell == "600" { "0" } else { cell };
        let from_none: Vec<SweepRow> = rows.iter().map(|row| row.iter().map(renamed).collect()).collect();
        let figure = of(&named("intersection"), &with_none, &from_none).figure();
        assert!(figure.panels[0].x.0 < 0.0 && both.figure().panels[0].x.0 == 0.0);

        let other: Vec<Axis> = vec![axes[0].clone(), share("600,1200")];
        let shares = ("shares".to_owned(), of(&named("intersection"), &other, &rows));
        let error = DelayCurves::joined(vec![plans(), shares]).unwrap_err();
        assert!(
            error.to_string().starts_with("plans varies rate_veh_h, and shares varies share_cav"),
            "{error}"
        );
    }
}
