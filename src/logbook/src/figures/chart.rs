//! Contents of a figure, independent of the drawing: panels with lines on axes, and the table of the data.

use super::table::TidyTable;
use city3d_geometry::trig;

/// sRGB.
pub type Colour = [u8; 3];

pub const BLACK: Colour = [34, 34, 34];
pub const GREY: Colour = [110, 110, 110];

/// Colour-blind safe palette (Okabe and Ito 2008), without the yellow that is too light on white.
pub const PALETTE: [Colour; 7] = [
    [213, 94, 0],
    [0, 114, 178],
    [230, 159, 0],
    [86, 180, 233],
    [204, 121, 167],
    [0, 158, 115],
    [34, 34, 34],
];

/// The lower nine tenths of matplotlib's viridis, a perceptually uniform colour map.
const VIRIDIS: [Colour; 6] =
    [[68, 1, 84], [64, 67, 135], [41, 120, 142], [34, 167, 132], [122, 209, 81], [189, 223, 38]];

/// The colour of a fraction from 0 to 1, linearly interpolated.
pub fn viridis(share: f64) -> Colour {
    let place = share.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let index = (place as usize).min(VIRIDIS.len() - 2);
    let weight = place - index as f64;
    let (low, high) = (VIRIDIS[index], VIRIDIS[index + 1]);
    std::array::from_fn(|k| (f64::from(low[k]) * (1.0 - weight) + f64::from(high[k]) * weight).round() as u8)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dash {
    Solid,
    Dashed,
    Dotted,
}

/// Style of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineStyle {
    pub colour: Colour,
    pub dash: Dash,
    /// Typographic points.
    pub width_pt: f64,
}

impl LineStyle {
    pub fn solid(colour: Colour) -> Self {
        Self { colour, dash: Dash::Solid, width_pt: 1.1 }
    }
}

/// A polyline; NaN interrupts it.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartLine {
    pub points: Vec<(f64, f64)>,
    pub stroke: LineStyle,
}

/// A labelled reference line across a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceLine {
    pub at: f64,
    /// Horizontal at a value of y; otherwise vertical at a value of x.
    pub is_level: bool,
    pub name: String,
    pub dash: Dash,
    /// The label is to the left of a vertical line.
    pub is_before: bool,
}

/// A panel: one pair of axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub x: (f64, f64),
    pub y: (f64, f64),
    pub lines: Vec<ChartLine>,
    pub rules: Vec<ReferenceLine>,
    /// Heat map cells, under the lines.
    pub cells: Vec<HeatMapCell>,
    /// Custom ticks of x and y with labels, instead of round numbers.
    pub marks: Option<[Vec<(f64, String)>; 2]>,
}

/// A cell of a heat map with its label; `share` from 0 to 1 sets the colour.
#[derive(Clone, Debug, PartialEq)]
pub struct HeatMapCell {
    pub x: (f64, f64),
    pub y: (f64, f64),
    pub share: f64,
    pub word: String,
}

impl Panel {
    /// Fits the axes to all lines and to the given values.
    pub fn fit(&mut self, x_with: &[f64], y_with: &[f64]) {
        let points = || {
            self.lines.iter().flat_map(|line| &line.points).filter(|(x, y)| x.is_finite() && y.is_finite())
        };
        let range = |values: &mut dyn Iterator<Item = f64>| {
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                (low.min(value), high.max(value))
            })
        };
        let x = range(&mut points().map(|point| point.0).chain(x_with.iter().copied()));
        let y = range(&mut points().map(|point| point.1).chain(y_with.iter().copied()));
        (self.x, self.y) = (widened(x), widened(y));
    }
}

fn widened((low, high): (f64, f64)) -> (f64, f64) {
    match high - low {
        width if !width.is_finite() => (0.0, 1.0),
        width if width < 1e-9 => (low - 0.5, high + 0.5),
        width => (low, high + 0.02 * width),
    }
}

/// An entry of the legend.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendEntry {
    pub name: String,
    pub stroke: LineStyle,
}

/// A colour bar.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourBar {
    pub label: String,
    pub from: f64,
    pub to: f64,
}

/// A figure with the data that it shows.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Base name of its files.
    pub name: String,
    pub title: String,
    /// Row by row; rows of equal height.
    pub panels: Vec<Panel>,
    pub columns: usize,
    /// Height of a row of axes over the width of the figure.
    pub row_height: f64,
    pub legend: Vec<LegendEntry>,
    pub scale: Option<ColourBar>,
    /// Note below the figure.
    pub note: String,
    pub table: TidyTable,
}

/// Round tick values on an axis, at most so many, and their number of decimals.
pub fn ticks((from, to): (f64, f64), most: usize) -> (Vec<f64>, usize) {
    let rough = (to - from).max(1e-12) / most.max(1) as f64;
    let power = trig::pow(10.0, trig::log10(rough).floor());
    let step =
        [1.0, 2.0, 5.0, 10.0].into_iter().map(|factor| factor * power).find(|step| *step >= rough * 0.999);
    let step = step.unwrap_or(power);
    let first = (from / step - 1e-9).ceil() as i64;
    let last = (to / step + 1e-9).floor() as i64;
    let decimals = (-trig::log10(step * 1.001).floor()).clamp(0.0, 6.0) as usize;
    ((first..=last).map(|k| k as f64 * step).collect(), decimals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        for (range, most, expected, decimals) in [
            ((0.0, 40.0), 8, vec![0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0], 0),
            ((0.0, 0.37), 4, vec![0.0, 0.1, 0.2, 0.3], 1),
            ((-1.2, 1.3), 5, vec![-1.0, -0.5, 0.0, 0.5, 1.0], 1),
            ((0.0012, 0.0031), 2, vec![0.002, 0.003], 3),
        ] {
            let (found, digits) = ticks(range, most);
            assert_eq!(digits, decimals, "{range:?} {found:?}");
            assert!(found.len() == expected.len(), "{range:?} {found:?}");
            assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-9), "{range:?} {found:?}");
        }
    }

    #[test]
    fn axes_hold_all_points_and_skip_what_is_not_a_number() {
        let line = ChartLine {
            points: vec![(1.0, 5.0), (f64::NAN, 0.0), (3.0, f64::NAN), (2.0, 7.0)],
            stroke: LineStyle::solid(BLACK),
        };
        let mut panel = Panel { lines: vec![line], ..Panel::default() };
        panel.fit(&[], &[0.0]);
        assert_eq!(panel.x, (1.0, 2.02));
        assert_eq!(panel.y, (0.0, 7.14));
        let mut empty = Panel::default();
        empty.fit(&[], &[]);
        assert_eq!((empty.x, empty.y), ((0.0, 1.0), (0.0, 1.0)));
    }

    #[test]
    fn colours_of_speed_grow_lighter() {
        let lightness = |share| {
            viridis(share).map(f64::from).iter().zip([0.2, 0.7, 0.1]).map(|(c, w)| c * w).sum::<f64>()
        };
        assert!((0..10).all(|k| lightness(f64::from(k) / 10.0) < lightness(f64::from(k + 1) / 10.0)));
    }
}
