//! Delay against flow of a sweep: a curve for each setting of the other axes, with confidence intervals over seeds.

use super::interval::MeanInterval;
use super::map::SweepResults;
use super::table::column;
use crate::figures::chart::{ChartLine, Dash, Figure, LegendEntry, LineStyle, Panel};
use crate::figures::{TidyTable, distinct_styles, number};
use city3d_simulation::scenario::counted;
use city3d_simulation::sweep::Axis;

/// Name of the figure.
pub const DELAY_FLOW: &str = "delay_flow";

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

/// Axes whose keys hold one of these words vary the demand.
const DEMAND_WORDS: [&str; 4] = ["rate", "per_h", "flow", "demand"];

/// One point of a curve: the runs of one setting.
struct FlowPoint {
    curve: String,
    flow: MeanInterval,
    delay: MeanInterval,
}

impl SweepResults<'_> {
    /// The figure; `None` where no axis varies the demand, or no run has a delay and a flow.
    pub(super) fn delay_against_flow(&self) -> Option<Figure> {
        let demand = self.axes.iter().position(varies_demand)?;
        let cells: usize = self.axes.iter().map(|axis| axis.values.len()).product();
        let per_cell = (self.rows.len() / cells.max(1)).max(1);
        let mut table = TidyTable::new(&["curve", "demand", "runs", "quantity", "mean", "ci95"]);
        let mut points = Vec::new();
        for cell in self.rows.chunks(per_cell) {
            let curve = self.curve(&cell[0], demand);
            for quantity in QUANTITIES {
                let Some(found) = self.interval(cell, quantity) else { continue };
                table.rows.push(vec![
                    curve.clone(),
                    cell[0][demand].clone(),
                    found.count.to_string(),
                    quantity.to_owned(),
                    number(found.mean, 6),
                    found.half_width.map_or_else(String::new, |half| number(half, 6)),
                ]);
            }
            if let (Some(flow), Some(delay)) =
                (self.interval(cell, "throughput_per_h"), self.interval(cell, "mean_delay_s"))
            {
                points.push(FlowPoint { curve, flow, delay });
            }
        }
        (!points.is_empty()).then(|| self.draw(&points, table))
    }

    fn interval(&self, cell: &[Vec<String>], quantity: &str) -> Option<MeanInterval> {
        let index = column(self.axes.len(), quantity)?;
        let values: Vec<f64> = cell.iter().filter_map(|row| row[index].parse().ok()).collect();
        MeanInterval::of(&values)
    }

    /// Name of a row's curve: its values of the axes that do not vary the demand.
    fn curve(&self, row: &[String], demand: usize) -> String {
        let others = self.axes.iter().zip(row).enumerate().filter(|(index, _)| *index != demand);
        let words: Vec<String> = others
            .map(|(_, (axis, value))| format!("{} {value}", axis.key.rsplit('.').next().unwrap_or(&axis.key)))
            .collect();
        if words.is_empty() { self.name().to_owned() } else { words.join(", ") }
    }

    fn draw(&self, points: &[FlowPoint], table: TidyTable) -> Figure {
        let mut names: Vec<&str> = Vec::new();
        for point in points {
            if !names.contains(&point.curve.as_str()) {
                names.push(&point.curve);
            }
        }
        let mut panel = Panel {
            x_label: "Throughput [vehicles/h]".to_owned(),
            y_label: "Mean delay [s]".to_owned(),
            ..Panel::default()
        };
        let mut legend = Vec::new();
        for (name, stroke) in names.iter().zip(distinct_styles(names.len())) {
            let own: Vec<&FlowPoint> = points.iter().filter(|point| point.curve == *name).collect();
            let line = own.iter().map(|point| (point.flow.mean, point.delay.mean)).collect();
            panel.lines.push(ChartLine { points: line, stroke });
            panel.lines.extend(own.iter().flat_map(|point| error_bars(point, stroke)));
            legend.push(LegendEntry { name: (*name).to_owned(), stroke });
        }
        panel.fit(&[0.0], &[0.0]);
        let dot = (panel.x.1 - panel.x.0) * DOT;
        for (name, stroke) in names.iter().zip(distinct_styles(names.len())) {
            let stroke = LineStyle { width_pt: 3.5, dash: Dash::Solid, ..stroke };
            for point in points.iter().filter(|point| point.curve == *name) {
                let (x, y) = (point.flow.mean, point.delay.mean);
                panel.lines.push(ChartLine { points: vec![(x - dot, y), (x + dot, y)], stroke });
            }
        }
        let runs = points.iter().map(|point| point.delay.count).max().unwrap_or(0);
        Figure {
            name: DELAY_FLOW.to_owned(),
            title: format!("{}: delay against flow", self.name()),
            panels: vec![panel],
            columns: 1,
            row_height: 0.5,
            legend,
            scale: None,
            note: format!(
                "Means of up to {} with their 95 % confidence intervals (Student's t). Delay includes the time held \
                 outside; throughput is measured at the exit.",
                counted(runs, "run")
            ),
            table,
        }
    }
}

/// Half the width of a point over that of the axes.
const DOT: f64 = 0.003;

/// Confidence intervals of a point, as a cross.
fn error_bars(point: &FlowPoint, stroke: LineStyle) -> impl Iterator<Item = ChartLine> {
    let (x, y) = (point.flow.mean, point.delay.mean);
    let stroke = LineStyle { width_pt: 0.7, dash: Dash::Solid, ..stroke };
    let upright = point.delay.half_width.map(|half| vec![(x, y - half), (x, y + half)]);
    let level = point.flow.half_width.map(|half| vec![(x - half, y), (x + half, y)]);
    [upright, level].into_iter().flatten().map(move |points| ChartLine { points, stroke })
}

fn varies_demand(axis: &Axis) -> bool {
    axis.values.len() > 1 && DEMAND_WORDS.iter().any(|word| axis.key.contains(word))
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
        let figure = results.delay_against_flow().unwrap();
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
    fn without_a_demand_there_is_no_figure() {
        let axes: Vec<Axis> = vec!["environment.loss=0,0.1".parse().unwrap()];
        let document = toml::Table::new();
        let results = SweepResults { axes: &axes, rows: &[], document: &document, is_testbed: false };
        assert!(results.delay_against_flow().is_none());
    }
}
