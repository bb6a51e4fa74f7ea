//! The figure of delays: curves with confidence intervals.

use super::delay::{DelayCurves, DelayPoint};
use super::interval::MeanInterval;
use crate::figures::chart::{ChartLine, Dash, Figure, LegendEntry, LineStyle, Panel};
use crate::figures::distinct_styles;
use city3d_simulation::scenario::counted;

/// Name of the figure over an axis that varies the demand.
pub const DELAY_FLOW: &str = "delay_flow";
/// Name of the figure over an axis of other numbers.
pub const DELAY: &str = "delay";

/// Half the width of a point over that of the axes.
const DOT: f64 = 0.003;
/// Room beside a point on the vertical axis, over the width of the axes: the axis would hide its confidence interval.
const BESIDE_AXIS: f64 = 0.02;

impl DelayCurves {
    /// The figure: mean delay against the flow that left, or against the values of the axis.
    pub fn figure(&self) -> Figure {
        let is_demand = self.axis.is_demand;
        let mut panel = Panel {
            x_label: if is_demand { "Throughput [vehicles/h]".to_owned() } else { self.axis.name.clone() },
            y_label: "Mean delay [s]".to_owned(),
            ..Panel::default()
        };
        let mut legend = Vec::new();
        let names = self.names();
        for (name, stroke) in names.iter().zip(distinct_styles(names.len())) {
            panel.lines.push(ChartLine { points: self.places(name).collect(), stroke });
            panel.lines.extend(self.of_curve(name).flat_map(|(x, point)| error_bars(x, point, stroke)));
            legend.push(LegendEntry { name: (*name).to_owned(), stroke });
        }
        panel.fit(&[0.0], &[0.0]);
        let width = panel.x.1 - panel.x.0;
        let is_on_axis = |name: &&str| self.places(name).any(|(x, _)| x <= panel.x.0);
        if names.iter().any(is_on_axis) {
            panel.x.0 -= width * BESIDE_AXIS;
        }
        let dot = width * DOT;
        for (name, stroke) in names.iter().zip(distinct_styles(names.len())) {
            let stroke = LineStyle { width_pt: 3.5, dash: Dash::Solid, ..stroke };
            let dots = self.places(name).map(|(x, y)| vec![(x - dot, y), (x + dot, y)]);
            panel.lines.extend(dots.map(|points| ChartLine { points, stroke }));
        }
        let runs = self.points.iter().map(|point| point.delay_s.count).max().unwrap_or(0);
        let against = if is_demand { "flow" } else { &self.axis.name };
        Figure {
            name: if is_demand { DELAY_FLOW } else { DELAY }.to_owned(),
            title: format!("{}: delay against {against}", self.scenarios.join(", ")),
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
            table: self.table.clone(),
        }
    }

    /// The points of a curve with what they are drawn against.
    fn of_curve(&self, name: &str) -> impl Iterator<Item = (MeanInterval, &DelayPoint)> {
        let own = self.points.iter().filter(move |point| point.curve == name);
        own.filter_map(|point| Some((self.abscissa(point)?, point)))
    }

    fn abscissa(&self, point: &DelayPoint) -> Option<MeanInterval> {
        match self.axis.is_demand {
            true => point.throughput_per_h,
            false => MeanInterval::of(&[point.value.parse().ok()?]),
        }
    }

    fn places(&self, name: &str) -> impl Iterator<Item = (f64, f64)> {
        self.of_curve(name).map(|(x, point)| (x.mean, point.delay_s.mean))
    }
}

/// Confidence intervals of a point, as a cross.
fn error_bars(
    across: MeanInterval,
    point: &DelayPoint,
    stroke: LineStyle,
) -> impl Iterator<Item = ChartLine> {
    let (x, y) = (across.mean, point.delay_s.mean);
    let stroke = LineStyle { width_pt: 0.7, dash: Dash::Solid, ..stroke };
    let upright = point.delay_s.half_width.map(|half| vec![(x, y - half), (x, y + half)]);
    let level = across.half_width.map(|half| vec![(x - half, y), (x + half, y)]);
    [upright, level].into_iter().flatten().map(move |points| ChartLine { points, stroke })
}
