//! Delay of a sweep against flow, or against the numbers of an axis: a curve for each setting of the other axes, with
//! confidence intervals over seeds.

use super::interval::MeanInterval;
use super::map::SweepResults;
use super::table::column;
use crate::figures::chart::{ChartLine, Dash, Figure, LegendEntry, LineStyle, Panel};
use crate::figures::{TidyTable, distinct_styles, number};
use city3d_simulation::scenario::counted;
use city3d_simulation::sweep::Axis;

/// Name of the figure over an axis that varies the demand.
pub const DELAY_FLOW: &str = "delay_flow";
/// Name of the figure over an axis of other numbers.
pub const DELAY: &str = "delay";

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

/// What the delay is drawn against.
#[derive(Clone, Copy)]
struct Abscissa {
    /// Its axis.
    axis: usize,
    /// The axis varies the demand, so that the flow says more than its numbers.
    is_demand: bool,
}

/// One point of a curve: the runs of one setting.
struct DelayPoint {
    curve: String,
    x: MeanInterval,
    delay: MeanInterval,
}

impl SweepResults<'_> {
    /// The figure; `None` where no axis has several numbers, or no run has a delay.
    pub(super) fn delay(&self) -> Option<Figure> {
        let abscissa = self.abscissa()?;
        let cells: usize = self.axes.iter().map(|axis| axis.values.len()).product();
        let per_cell = (self.rows.len() / cells.max(1)).max(1);
        let value = if abscissa.is_demand { "demand" } else { "value" };
        let mut table = TidyTable::new(&["curve", value, "runs", "quantity", "mean", "ci95"]);
        let mut points = Vec::new();
        for cell in self.rows.chunks(per_cell) {
            let curve = self.curve(&cell[0], abscissa.axis);
            for quantity in QUANTITIES {
                let Some(found) = self.interval(cell, quantity) else { continue };
                table.rows.push(vec![
                    curve.clone(),
                    cell[0][abscissa.axis].clone(),
                    found.count.to_string(),
                    quantity.to_owned(),
                    number(found.mean, 6),
                    found.half_width.map_or_else(String::new, |half| number(half, 6)),
                ]);
            }
            let x = || match abscissa.is_demand {
                true => self.interval(cell, "throughput_per_h"),
                false => MeanInterval::of(&[cell[0][abscissa.axis].parse().ok()?]),
            };
            if let Some((x, delay)) = x().zip(self.interval(cell, "mean_delay_s")) {
                points.push(DelayPoint { curve, x, delay });
            }
        }
        (!points.is_empty()).then(|| self.draw(abscissa, &points, table))
    }

    /// The axis of the demand, else the first one with several numbers.
    fn abscissa(&self) -> Option<Abscissa> {
        let demand = self.axes.iter().position(varies_demand);
        let axis = demand.or_else(|| self.axes.iter().position(has_numbers))?;
        Some(Abscissa { axis, is_demand: demand.is_some() })
    }

    fn interval(&self, cell: &[Vec<String>], quantity: &str) -> Option<MeanInterval> {
        let index = column(self.axes.len(), quantity)?;
        let values: Vec<f64> = cell.iter().filter_map(|row| row[index].parse().ok()).collect();
        MeanInterval::of(&values)
    }

    /// Name of a row's curve: its values of the other axes that have several.
    fn curve(&self, row: &[String], abscissa: usize) -> String {
        let others = self.axes.iter().zip(row).enumerate();
        let others = others.filter(|(index, (axis, _))| *index != abscissa && axis.values.len() > 1);
        let words: Vec<String> =
            others.map(|(_, (axis, value))| format!("{} {value}", last_part(&axis.key))).collect();
        if words.is_empty() { self.name().to_owned() } else { words.join(", ") }
    }

    fn draw(&self, abscissa: Abscissa, points: &[DelayPoint], table: TidyTable) -> Figure {
        let mut names: Vec<&str> = Vec::new();
        for point in points {
            if !names.contains(&point.curve.as_str()) {
                names.push(&point.curve);
            }
        }
        let Abscissa { axis, is_demand } = abscissa;
        let against = last_part(&self.axes[axis].key).to_owned();
        let mut panel = Panel {
            x_label: if is_demand { "Throughput [vehicles/h]".to_owned() } else { against.clone() },
            y_label: "Mean delay [s]".to_owned(),
            ..Panel::default()
        };
        let mut legend = Vec::new();
        for (name, stroke) in names.iter().zip(distinct_styles(names.len())) {
            let own: Vec<&DelayPoint> = points.iter().filter(|point| point.curve == *name).collect();
            let line = own.iter().map(|point| (point.x.mean, point.delay.mean)).collect();
            panel.lines.push(ChartLine { points: line, stroke });
            panel.lines.extend(own.iter().flat_map(|point| error_bars(point, stroke)));
            legend.push(LegendEntry { name: (*name).to_owned(), stroke });
        }
        panel.fit(&[0.0], &[0.0]);
        let dot = (panel.x.1 - panel.x.0) * DOT;
        for (name, stroke) in names.iter().zip(distinct_styles(names.len())) {
            let stroke = LineStyle { width_pt: 3.5, dash: Dash::Solid, ..stroke };
            for point in points.iter().filter(|point| point.curve == *name) {
                let (x, y) = (point.x.mean, point.delay.mean);
                panel.lines.push(ChartLine { points: vec![(x - dot, y), (x + dot, y)], stroke });
            }
        }
        let runs = points.iter().map(|point| point.delay.count).max().unwrap_or(0);
        Figure {
            name: if is_demand { DELAY_FLOW } else { DELAY }.to_owned(),
            title: format!("{}: delay against {}", self.name(), if is_demand { "flow" } else { &against }),
            panels: vec![panel],
            columns: 1,
            row_height: 0.5,
            legend,
            scale: None,
            note: format!(
                "Means of up to {} with their 95 % confidence intervals (Student's t). Delay includes the time held \
                 outside{}.",
                counted(runs, "run"),
                if is_demand { "; throughput is measured at the exit" } else { "" }
            ),
            table,
        }
    }
}

/// Half the width of a point over that of the axes.
const DOT: f64 = 0.003;

/// Confidence intervals of a point, as a cross.
fn error_bars(point: &DelayPoint, stroke: LineStyle) -> impl Iterator<Item = ChartLine> {
    let (x, y) = (point.x.mean, point.delay.mean);
    let stroke = LineStyle { width_pt: 0.7, dash: Dash::Solid, ..stroke };
    let upright = point.delay.half_width.map(|half| vec![(x, y - half), (x, y + half)]);
    let level = point.x.half_width.map(|half| vec![(x - half, y), (x + half, y)]);
    [upright, level].into_iter().flatten().map(move |points| ChartLine { points, stroke })
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
    fn rows(axes: &[Axis]) -> Vec<Vec<String>> {
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
                    rows.push(row);
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
        let figure = results.delay().unwrap();
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
        let figure = results.delay().unwrap();
        assert_eq!((figure.name.as_str(), figure.panels[0].x_label.as_str()), (DELAY, "share_cav"));
        assert_eq!(figure.panels[0].lines[0].points, [(600.0, 5.5), (1200.0, 9.5)]);
        // No number, no runs.
        for axis in ["coordination.algorithm=yield,insert", "environment.loss=0,0.1"] {
            let axes: Vec<Axis> = vec![axis.parse().unwrap()];
            let results = SweepResults { axes: &axes, rows: &[], document: &document, is_testbed: false };
            assert!(results.delay().is_none(), "{axis}");
        }
    }
}
