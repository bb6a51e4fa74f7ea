//! What a plot says of the place under the mouse.

use super::super::theme::DecimalSeparator;
use city3d_logbook::figures::chart::{LegendEntry, Panel};
use egui_plot::HoverPosition;

/// A quantity of an axis.
struct Axis {
    name: String,
    /// Empty for a number alone.
    unit: String,
}

impl Axis {
    /// Takes the label of an axis apart, such as `Speed [km/h]`.
    fn of(label: &str) -> Self {
        let (name, unit) = label.trim_end_matches(']').split_once(" [").unwrap_or((label, ""));
        Self { name: name.to_owned(), unit: unit.to_owned() }
    }

    /// A value of it under a name.
    fn told(&self, name: &str, value: f64, decimal: DecimalSeparator) -> String {
        format!("{name}: {} {}", decimal.fixed(value, 2), self.unit).trim_end().to_owned()
    }
}

/// The time of the state nearest to a time: of the samples of all lines that are named.
pub(super) fn nearest_time_s(panel: &Panel, time_s: f64) -> Option<f64> {
    let near = |points: &[(f64, f64)]| {
        let next = points.partition_point(|(at, _)| *at < time_s);
        let around = &points[next.saturating_sub(1)..points.len().min(next + 1)];
        around.iter().map(|(at, _)| *at).min_by(|a, b| (a - time_s).abs().total_cmp(&(b - time_s).abs()))
    };
    let nearest = panel.lines.iter().filter_map(|line| near(&line.points));
    nearest.min_by(|a, b| (a - time_s).abs().total_cmp(&(b - time_s).abs()))
}

/// The values of the named lines at a place of the horizontal axis, in the order of the legend; a line that ends before it, or
/// has a gap there, has none.
pub(super) fn values_at<'f>(legend: &'f [LegendEntry], panel: &Panel, x: f64) -> Vec<(&'f LegendEntry, f64)> {
    /// A sample farther away is none of that place, as a share of the axis.
    const NEAR: f64 = 0.01;
    let reach = NEAR * (panel.x.1 - panel.x.0);
    let value_at = |points: &[(f64, f64)]| {
        let near = |(at, value): &&(f64, f64)| (at - x).abs() <= reach && value.is_finite();
        let nearest = points.iter().min_by(|a, b| (a.0 - x).abs().total_cmp(&(b.0 - x).abs()))?;
        if !nearest.1.is_finite() {
            return None;
        }
        let before = points.iter().filter(near).rfind(|(at, _)| *at <= x);
        let after = points.iter().filter(near).find(|(at, _)| *at >= x);
        match (before, after) {
            (Some(&(from, a)), Some(&(to, b))) if to > from => Some(a + (b - a) * (x - from) / (to - from)),
            (one, other) => one.or(other).map(|(_, value)| *value),
        }
    };
    let of_key = |key: &'f LegendEntry| {
        let line = panel.lines.iter().find(|line| line.stroke == key.stroke)?;
        Some((key, value_at(&line.points)?))
    };
    legend.iter().filter_map(of_key).collect()
}

/// Values of lines at one time in words. `axes` are the labels of the axes.
pub(super) fn words_at(
    axes: [&str; 2],
    (x, values): (f64, &[(&LegendEntry, f64)]),
    decimal: DecimalSeparator,
) -> String {
    let [across, up] = axes.map(Axis::of);
    let head = across.told(&across.name, x, decimal);
    let lines = values.iter().map(|(key, value)| up.told(&key.name, *value, decimal));
    std::iter::once(head).chain(lines).collect::<Vec<_>>().join("\n")
}

/// What a plot says of the place under the mouse: whose line is there, and both quantities with their units. `axes` are the
/// labels of its axes.
pub(in super::super) fn words_near(
    axes: [&str; 2],
    decimal: DecimalSeparator,
) -> impl Fn(&HoverPosition<'_>) -> Option<String> + use<> {
    let axes = axes.map(Axis::of);
    move |hovered| {
        let (whose, position) = match hovered {
            HoverPosition::NearDataPoint { plot_name, position, .. } => (*plot_name, position),
            // The place of the mouse is no value of anybody.
            HoverPosition::Elsewhere { .. } => return None,
        };
        let quantities = axes.iter().zip([position.x, position.y]);
        let quantities = quantities.map(|(axis, value)| axis.told(&axis.name, value, decimal));
        let lines: Vec<String> = std::iter::once(whose.to_owned()).chain(quantities).collect();
        Some(lines.join("\n").trim_start().to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_plot::PlotPoint;

    #[test]
    fn all_lines_are_told_at_the_time_under_the_mouse() {
        use city3d_logbook::figures::chart::{ChartLine, LineStyle};
        let stroke = |red: u8| LineStyle::solid([red, 0, 0]);
        let line = |colour: u8, points: Vec<(f64, f64)>| ChartLine { points, stroke: stroke(colour) };
        let entry = |colour: u8, name: &str| LegendEntry { name: name.to_owned(), stroke: stroke(colour) };
        let first = (0..1000).map(|k| (f64::from(k) * 0.1, f64::from(k))).collect();
        let ends = vec![(0.0, 5.0), (20.0, 6.0), (20.1, f64::NAN), (60.0, 7.0)];
        let panel = Panel { x: (0.0, 100.0), lines: vec![line(2, ends), line(1, first)], ..Panel::default() };
        let legend = [entry(1, "1 a"), entry(2, "2 b"), entry(3, "none")];
        let told = values_at(&legend, &panel, 20.04);
        assert_eq!((told[0].0.name.as_str(), told[1]), ("1 a", (&legend[1], 6.0)));
        assert!((told[0].1 - 200.4).abs() < 1e-9, "between two samples: {told:?}");
        assert!((nearest_time_s(&panel, 20.04).unwrap() - 20.0).abs() < 1e-9);
        assert_eq!(nearest_time_s(&panel, 500.0), Some(99.9));
        assert_eq!(values_at(&legend, &panel, 40.0), [(&legend[0], 400.0)], "a gap has no value");
        let words =
            words_at(["Time [s]", "Speed [km/h]"], (20.04, &[(&legend[0], 2.0)]), DecimalSeparator::Point);
        assert_eq!(words, "Time: 20.04 s\n1 a: 2.00 km/h");
    }

    #[test]
    fn the_place_under_the_mouse_is_told_with_its_vehicle_and_units() {
        let words = words_near(["Time [s]", "Speed [km/h]"], DecimalSeparator::Comma);
        let position = PlotPoint::new(12.3, 45.678);
        let near = HoverPosition::NearDataPoint { plot_name: "3 path1_c", position, index: 7 };
        assert_eq!(words(&near).unwrap(), "3 path1_c\nTime: 12,30 s\nSpeed: 45,68 km/h");
        let elsewhere = HoverPosition::Elsewhere { position };
        assert_eq!(words(&elsewhere), None, "beside the lines nobody has these values");
    }
}
