//! Contents of a figure, independent of the drawing: panels with lines on axes, and the table of the data.

use super::table::TidyTable;
use city3d_geometry::trig;
use std::ops::Range;

/// sRGB.
pub type Colour = [u8; 3];

/// Colour of axes and text: a soft black.
pub const BLACK: Colour = [34, 34, 34];
/// Colour of notes, and of reference lines and their labels.
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

/// Dash pattern of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dash {
    /// Without gaps.
    Solid,
    /// Dashes of 2.2 mm with gaps of 1.3 mm in print.
    Dashed,
    /// Dots of 0.6 mm with gaps of 0.9 mm in print.
    Dotted,
    /// Dashes of 2.2 mm and dots of 0.6 mm by turns, with gaps of 0.9 mm in print.
    DashDotted,
}

/// Style of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineStyle {
    /// Stroke colour.
    pub colour: Colour,
    /// Dash pattern along the line.
    pub dash: Dash,
    /// Typographic points.
    pub width_pt: f64,
}

impl LineStyle {
    /// A solid line of the usual width, 1.1 points.
    pub fn solid(colour: Colour) -> Self {
        Self { colour, dash: Dash::Solid, width_pt: 1.1 }
    }
}

/// A polyline; NaN interrupts it.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartLine {
    /// Points in the units of the panel's axes, in drawing order.
    pub points: Vec<(f64, f64)>,
    /// Colour, dash pattern and width.
    pub stroke: LineStyle,
}

/// The name of a line whose colour means something else, at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct LineName {
    /// End of the line, in the units of the panel's axes.
    pub at: (f64, f64),
    /// Number and name of the vehicle.
    pub name: String,
    /// The pieces of the line among [`Panel::lines`].
    pub lines: Range<usize>,
}

/// A labelled reference line across a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceLine {
    /// Value of y or x at which the line lies, in the unit of that axis.
    pub at: f64,
    /// Horizontal at a value of y; otherwise vertical at a value of x.
    pub is_level: bool,
    /// Label outside the axes; in a column figure the legend has those of horizontal lines.
    pub name: String,
    /// Dash pattern; the colour is [`GREY`].
    pub dash: Dash,
    /// The label is to the left of a vertical line.
    pub is_before: bool,
}

/// A panel: one pair of axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Text above the axes; empty for none.
    pub title: String,
    /// Label of the x axis with its unit; an empty one hides the tick labels too.
    pub x_label: String,
    /// Label of the y axis with its unit; empty for none.
    pub y_label: String,
    /// Values at the left and the right end of the x axis.
    pub x: (f64, f64),
    /// Values at the lower and the upper end of the y axis.
    pub y: (f64, f64),
    /// Data lines, drawn in this order over cells and reference lines.
    pub lines: Vec<ChartLine>,
    /// Names of lines that the legend does not tell.
    pub names: Vec<LineName>,
    /// Reference lines; those outside the axes are not drawn.
    pub rules: Vec<ReferenceLine>,
    /// Heat map cells, under the lines.
    pub cells: Vec<HeatMapCell>,
    /// Custom ticks of x and of y with labels, instead of round numbers.
    pub marks: [Option<Vec<(f64, String)>>; 2],
    /// Height of the axes over that of the figure's other rows.
    pub height_share: f64,
}

impl Default for Panel {
    fn default() -> Self {
        Self {
            title: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x: (0.0, 0.0),
            y: (0.0, 0.0),
            lines: Vec::new(),
            names: Vec::new(),
            rules: Vec::new(),
            cells: Vec::new(),
            marks: [None, None],
            height_share: 1.0,
        }
    }
}

/// A cell of a heat map with its label; `share` from 0 to 1 sets the colour.
#[derive(Clone, Debug, PartialEq)]
pub struct HeatMapCell {
    /// Left and right edge, in the unit of the x axis.
    pub x: (f64, f64),
    /// Lower and upper edge, in the unit of the y axis.
    pub y: (f64, f64),
    /// Position on the colour map, see [`viridis`].
    pub share: f64,
    /// Label in the middle of the cell.
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
        // What is below zero by a rounding error alone keeps zero at the edge.
        width => (if low < -0.01 * width { low - 0.02 * width } else { low }, high + 0.02 * width),
    }
}

/// An entry of the legend.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendEntry {
    /// Text right of the line sample.
    pub name: String,
    /// Style of the line sample.
    pub stroke: LineStyle,
}

/// A colour bar.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourBar {
    /// Quantity and unit, right of the bar.
    pub label: String,
    /// Value at the left end, the darkest colour.
    pub from: f64,
    /// Value at the right end, the lightest colour.
    pub to: f64,
}

/// A figure with the data that it shows.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Base name of its files.
    pub name: String,
    /// Heading at the top, broken into lines that fit the width.
    pub title: String,
    /// Row by row; rows of equal height.
    pub panels: Vec<Panel>,
    /// Panels in a row; [`FigureSize::Column`](super::FigureSize) has one.
    pub columns: usize,
    /// Height of a row of axes over the width of the figure.
    pub row_height: f64,
    /// Line samples with names below the title; empty for none.
    pub legend: Vec<LegendEntry>,
    /// Colour bar below the legend; `None` where no colour stands for a value.
    pub scale: Option<ColourBar>,
    /// Note below the figure.
    pub note: String,
    /// The plotted data with units in the names of the columns.
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
        panel.fit(&[], &[-3.0]);
        assert_eq!(panel.y, (-3.2, 7.2), "what is below zero stands off the edge");
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
