//! Draws figures as SVG and PNG with plotters, from one drawing with subpixel steps. The font is embedded, so that
//! every machine gives the same picture.

use super::chart::{
    BLACK, ChartLine, Colour, ColourBar, Dash, Figure, GREY, LegendEntry, LineStyle, Panel, ReferenceLine,
    ticks, viridis,
};
use super::plan::{EDGE_MM, KEY_MM, LINE_MM, PageLayout, PaperRect};
use city3d_geometry::trig;
use city3d_outputs::WholeFile;
use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::element::{Circle, PathElement, Polygon, Rectangle};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontFamily, FontStyle, FontTransform, RGBColor, ShapeStyle, TextStyle};
use std::path::Path;
use thiserror::Error;

/// A figure that cannot be drawn.
#[derive(Debug, Error)]
pub enum DrawError {
    /// The embedded font cannot be registered.
    #[error("the font of figures cannot be used")]
    Font,
    /// An error of plotters, in words.
    #[error("a figure cannot be drawn: {0}")]
    Plot(String),
    /// The pixels cannot be encoded.
    #[error("a PNG cannot be written: {0}")]
    Png(#[from] png::EncodingError),
}

/// Printed size of figures. Text is 8 points in both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FigureSize {
    /// One of two columns.
    Column,
    /// The whole page.
    #[default]
    Page,
}

impl FigureSize {
    /// Printed width, millimetres.
    pub fn width_mm(self) -> f64 {
        match self {
            Self::Column => 88.0,
            Self::Page => 180.0,
        }
    }
}

/// Font family for SVG viewers; the program embeds the first one.
pub(super) const FAMILY: &str = "DejaVu Sans, Verdana, Helvetica, Arial, sans-serif";
pub(super) const TEXT_PT: f64 = 8.0;
pub(super) const SMALL_PT: f64 = 7.0;
pub(super) const MM_PER_PT: f64 = 25.4 / 72.0;
/// Units of an SVG and pixels of a PNG per millimetre; PNGs are supersampled by this factor per axis (anti-aliasing).
const SVG_PER_MM: f64 = 40.0;
const PNG_PER_MM: u32 = 10;
const SUPERSAMPLING: u32 = 3;
/// Font size of plotters over the em height: in SVG, and for the rasterized DejaVu.
const SVG_SIZE: f64 = 1.24;
pub(super) const RASTER_SIZE: f64 = 1.164;

type DrawArea<'a, B> = DrawingArea<B, Shift>;

/// The figure as SVG.
///
/// # Errors
/// Where plotters cannot draw it.
pub fn svg(figure: &Figure, size: FigureSize) -> Result<String, DrawError> {
    let mut text = String::new();
    let plan = PageLayout::of(figure, size)?;
    let extent = plan.extent(SVG_PER_MM);
    let area = SVGBackend::with_string(&mut text, extent).into_drawing_area();
    FigurePainter { area: &area, per_mm: SVG_PER_MM, size_of_em: SVG_SIZE, is_raster: false }
        .figure(figure, &plan)?;
    area.present().map_err(plot)?;
    drop(area);
    // The printed size; the view box keeps the units of the drawing.
    let pixels = format!("width=\"{}\" height=\"{}\" ", extent.0, extent.1);
    let print = format!("width=\"{}mm\" height=\"{}mm\" ", plan.width_mm, plan.height_mm);
    Ok(text.replacen(&pixels, &print, 1))
}

/// The figure as PNG, 254 pixels to the inch.
///
/// # Errors
/// Where plotters cannot draw it.
pub fn png(figure: &Figure, size: FigureSize) -> Result<Vec<u8>, DrawError> {
    let plan = PageLayout::of(figure, size)?;
    let (width, height) = plan.extent(f64::from(PNG_PER_MM));
    let fine = (width * SUPERSAMPLING, height * SUPERSAMPLING);
    let mut pixels = vec![255; fine.0 as usize * fine.1 as usize * 3];
    let per_mm = f64::from(PNG_PER_MM * SUPERSAMPLING);
    let area = BitMapBackend::with_buffer(&mut pixels, fine).into_drawing_area();
    FigurePainter { area: &area, per_mm, size_of_em: RASTER_SIZE, is_raster: true }.figure(figure, &plan)?;
    area.present().map_err(plot)?;
    drop(area);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    let per_m = PNG_PER_MM * 1000;
    encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: per_m, yppu: per_m, unit: png::Unit::Meter }));
    encoder.write_header()?.write_image_data(&box_downsampled(&pixels, width as usize, height as usize))?;
    Ok(bytes)
}

/// Box filter: downsamples the supersampled pixels.
fn box_downsampled(fine: &[u8], width: usize, height: usize) -> Vec<u8> {
    let times = SUPERSAMPLING as usize;
    let mut pixels = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        for x in 0..width {
            for channel in 0..3 {
                let square = (0..times * times).map(|k| {
                    let (column, row) = (x * times + k % times, y * times + k / times);
                    u32::from(fine[(row * width * times + column) * 3 + channel])
                });
                pixels.push((square.sum::<u32>() / (times * times) as u32) as u8);
            }
        }
    }
    pixels
}

pub(super) fn plot(error: impl std::fmt::Display) -> DrawError {
    DrawError::Plot(error.to_string())
}

/// Draws a figure on one backend.
struct FigurePainter<'a, B: DrawingBackend> {
    area: &'a DrawArea<'a, B>,
    per_mm: f64,
    size_of_em: f64,
    /// Raster lines are drawn segment by segment: plotters fills the self-overlapping outline of a whole polyline.
    is_raster: bool,
}

/// Font size, colour and alignment of a text.
#[derive(Clone, Copy)]
struct TextFormat {
    points: f64,
    colour: Colour,
    h: HPos,
    v: VPos,
    is_bold: bool,
    is_upright: bool,
}

const SMALL: TextFormat = TextFormat {
    points: SMALL_PT,
    colour: BLACK,
    h: HPos::Left,
    v: VPos::Center,
    is_bold: false,
    is_upright: false,
};
/// Where the name of a line stands from its end, downwards on the paper, and the least distance of two, millimetres.
const NAME_ABOVE_MM: f64 = -1.2;
const NAME_APART_MM: f64 = 2.6;
const MIDDLE: TextFormat = TextFormat { points: TEXT_PT, h: HPos::Center, ..SMALL };

impl<B: DrawingBackend> FigurePainter<'_, B> {
    fn figure(&self, figure: &Figure, plan: &PageLayout) -> Result<(), DrawError> {
        self.area.fill(&RGBColor(255, 255, 255)).map_err(plot)?;
        let bold = TextFormat { points: TEXT_PT, is_bold: true, v: VPos::Top, ..SMALL };
        for (y, line) in &plan.title {
            self.text(line, (EDGE_MM, *y), bold)?;
        }
        for (key, at) in &plan.keys {
            self.key(key, *at)?;
        }
        if let (Some(scale), Some(place)) = (&figure.scale, plan.scale) {
            self.scale(scale, place)?;
        }
        for (index, (panel, &place)) in figure.panels.iter().zip(&plan.panels).enumerate() {
            self.panel(panel, place)?;
            self.upright_names(panel, place)?;
            self.line_names(panel, place)?;
            if plan.have_names[index] {
                let first = index - index % figure.columns.max(1);
                self.level_names(&figure.panels[first..=index], place)?;
            }
        }
        for (title, place) in plan.panel_titles.iter().zip(&plan.panels) {
            for (y, line) in title {
                self.text(line, (place.x, *y), TextFormat { points: TEXT_PT, ..SMALL })?;
            }
        }
        for (y, line) in &plan.note {
            self.text(line, (EDGE_MM, *y), TextFormat { colour: GREY, v: VPos::Top, ..SMALL })?;
        }
        Ok(())
    }

    fn at(&self, (x_mm, y_mm): (f64, f64)) -> (i32, i32) {
        ((x_mm * self.per_mm).round() as i32, (y_mm * self.per_mm).round() as i32)
    }

    fn text(&self, text: &str, at_mm: (f64, f64), how: TextFormat) -> Result<(), DrawError> {
        if text.is_empty() {
            return Ok(());
        }
        let size = how.points * MM_PER_PT * self.per_mm * self.size_of_em;
        let style = if how.is_bold { FontStyle::Bold } else { FontStyle::Normal };
        let turn = if how.is_upright { FontTransform::Rotate270 } else { FontTransform::None };
        let style = TextStyle::from((FontFamily::Name(FAMILY), size, style)).transform(turn);
        let colour = rgb(how.colour);
        let style = style.color(&colour).pos(Pos::new(how.h, how.v));
        self.area.draw_text(text, &style, self.at(at_mm)).map_err(plot)
    }

    fn key(&self, key: &LegendEntry, (x, y): (f64, f64)) -> Result<(), DrawError> {
        let middle = y + LINE_MM / 2.0;
        self.stroke(&[(x, middle), (x + KEY_MM, middle)], key.stroke)?;
        self.text(&key.name, (x + KEY_MM + 1.0, middle), SMALL)
    }

    fn scale(&self, scale: &ColourBar, place: PaperRect) -> Result<(), DrawError> {
        const STEPS: u32 = 60;
        let x_at = |share: f64| place.x + share * place.width;
        for step in 0..STEPS {
            let share = f64::from(step) / f64::from(STEPS);
            let corner = self.at((x_at(share), place.y));
            let other = self.at((x_at(share + 1.0 / f64::from(STEPS)), place.y + place.height));
            let fill = rgb(viridis(share)).filled();
            self.area.draw(&Rectangle::new([corner, other], fill)).map_err(plot)?;
        }
        let (values, decimals) = ticks((scale.from, scale.to), 5);
        for value in values {
            let x = x_at((value - scale.from) / (scale.to - scale.from));
            let under = TextFormat { h: HPos::Center, ..SMALL };
            self.text(&format!("{value:.decimals$}"), (x, place.y + place.height + LINE_MM / 2.0), under)?;
        }
        self.text(&scale.label, (place.x + place.width + 3.0, place.y + place.height / 2.0), SMALL)
    }

    fn panel(&self, panel: &Panel, place: PaperRect) -> Result<(), DrawError> {
        let PaperRect { x: left, y: top, width, height } = place;
        let x_at = |x: f64| left + (x - panel.x.0) / (panel.x.1 - panel.x.0) * width;
        let y_at = |y: f64| top + height - (y - panel.y.0) / (panel.y.1 - panel.y.0) * height;
        let grid = LineStyle { colour: [225, 225, 225], dash: Dash::Solid, width_pt: 0.5 };
        let [x_marks, y_marks] = marks(panel, place);
        for (value, word) in x_marks {
            let x = x_at(value);
            self.stroke(&[(x, top), (x, top + height)], grid)?;
            if !panel.x_label.is_empty() {
                self.text(&word, (x, top + height + 2.4), TextFormat { h: HPos::Center, ..SMALL })?;
            }
        }
        for (value, word) in y_marks {
            let y = y_at(value);
            self.stroke(&[(left, y), (left + width, y)], grid)?;
            self.text(&word, (left - 1.2, y), TextFormat { h: HPos::Right, ..SMALL })?;
        }
        for cell in &panel.cells {
            let corners = [(x_at(cell.x.0), y_at(cell.y.1)), (x_at(cell.x.1), y_at(cell.y.0))];
            let fill = rgb(viridis(cell.share)).filled();
            self.area.draw(&Rectangle::new(corners.map(|corner| self.at(corner)), fill)).map_err(plot)?;
            let middle = ((corners[0].0 + corners[1].0) / 2.0, (corners[0].1 + corners[1].1) / 2.0);
            let colour = if cell.share < 0.6 { [255; 3] } else { BLACK };
            self.text(&cell.word, middle, TextFormat { colour, h: HPos::Center, ..SMALL })?;
        }
        for rule in &panel.rules {
            self.rule(rule, panel, place)?;
        }
        for line in &panel.lines {
            self.line(line, x_at, y_at)?;
        }
        let axis = LineStyle { colour: BLACK, dash: Dash::Solid, width_pt: 0.7 };
        let (right, bottom) = (left + width, top + height);
        self.stroke(&[(left, top), (left, bottom), (right, bottom)], axis)?;
        self.text(&panel.x_label, (left + width / 2.0, bottom + 2.4 + LINE_MM), MIDDLE)?;
        let beside = (left - 11.0, top + height / 2.0);
        self.text(&panel.y_label, beside, TextFormat { is_upright: true, ..MIDDLE })
    }

    fn rule(&self, rule: &ReferenceLine, panel: &Panel, place: PaperRect) -> Result<(), DrawError> {
        let Some(at) = rule_at(rule, panel, place) else { return Ok(()) };
        let stroke = LineStyle { colour: GREY, dash: rule.dash, width_pt: 0.8 };
        if rule.is_level {
            self.stroke(&[(place.x, at), (place.x + place.width, at)], stroke)
        } else {
            self.stroke(&[(at, place.y), (at, place.y + place.height)], stroke)
        }
    }

    /// Labels of vertical reference lines, above the axes.
    fn upright_names(&self, panel: &Panel, place: PaperRect) -> Result<(), DrawError> {
        for rule in panel.rules.iter().filter(|rule| !rule.is_level) {
            let Some(at) = rule_at(rule, panel, place) else { continue };
            let (off, h) = if rule.is_before { (0.6, HPos::Right) } else { (-0.6, HPos::Left) };
            let words = TextFormat { colour: GREY, h, ..SMALL };
            self.text(&rule.name, (at + off, place.y - 2.0), words)?;
        }
        Ok(())
    }

    /// Labels of the horizontal reference lines of a row, to the right of its last panel.
    fn level_names(&self, row: &[Panel], place: PaperRect) -> Result<(), DrawError> {
        let words = TextFormat { colour: GREY, ..SMALL };
        let mut level: Vec<(f64, &str)> = Vec::new();
        for panel in row {
            for rule in panel.rules.iter().filter(|rule| rule.is_level) {
                let Some(at) = rule_at(rule, panel, place) else { continue };
                if !level.contains(&(at, rule.name.as_str())) {
                    level.push((at, &rule.name));
                }
            }
        }
        level.sort_by(|a, b| a.0.total_cmp(&b.0));
        let wanted: Vec<f64> = level.iter().map(|(at, _)| *at).collect();
        for (y, (_, name)) in apart(&wanted, 2.9).into_iter().zip(level) {
            self.text(name, (place.x + place.width + 1.5, y), words)?;
        }
        Ok(())
    }

    /// Names of lines at their ends: above them and to their left, as most lines rise to the end of the run.
    fn line_names(&self, panel: &Panel, place: PaperRect) -> Result<(), DrawError> {
        let x_at = |x: f64| place.x + (x - panel.x.0) / (panel.x.1 - panel.x.0) * place.width;
        let y_at = |y: f64| place.y + place.height - (y - panel.y.0) / (panel.y.1 - panel.y.0) * place.height;
        let is_inside =
            |(x, y): (f64, f64)| (panel.x.0..=panel.x.1).contains(&x) && (panel.y.0..=panel.y.1).contains(&y);
        let mut names: Vec<(f64, f64, &str)> = panel
            .names
            .iter()
            .filter(|end| is_inside(end.at))
            .map(|end| (x_at(end.at.0), y_at(end.at.1), end.name.as_str()))
            .collect();
        names.sort_by(|a, b| a.1.total_cmp(&b.1));
        let wanted: Vec<f64> = names.iter().map(|(_, y, _)| y + NAME_ABOVE_MM).collect();
        for (y, (x, _, name)) in apart(&wanted, NAME_APART_MM).into_iter().zip(names) {
            let h = if x > place.x + place.width / 2.0 { HPos::Right } else { HPos::Left };
            let y = y.max(place.y + NAME_APART_MM / 2.0);
            // Below a level line that would go through it.
            let crossed = panel
                .rules
                .iter()
                .filter(|rule| rule.is_level)
                .filter_map(|rule| rule_at(rule, panel, place));
            let y = crossed
                .filter(|at| (at - y).abs() < NAME_APART_MM / 2.0)
                .fold(y, |_, at| at + 0.6 * NAME_APART_MM);
            self.text(name, (x - 0.6, y), TextFormat { colour: GREY, h, ..SMALL })?;
        }
        Ok(())
    }

    fn line(
        &self,
        line: &ChartLine,
        x_at: impl Fn(f64) -> f64,
        y_at: impl Fn(f64) -> f64,
    ) -> Result<(), DrawError> {
        let pieces = line.points.split(|(x, y)| !(x.is_finite() && y.is_finite()));
        for piece in pieces.filter(|piece| !piece.is_empty()) {
            let points: Vec<(f64, f64)> = piece.iter().map(|&(x, y)| (x_at(x), y_at(y))).collect();
            self.stroke(&points, line.stroke)?;
        }
        Ok(())
    }

    /// Draws a line through points in millimetres.
    fn stroke(&self, points: &[(f64, f64)], stroke: LineStyle) -> Result<(), DrawError> {
        let points = thinned(points);
        match stroke.dash {
            Dash::Solid => self.solid(&points, stroke),
            Dash::Dashed => self.dashed(&points, &[2.2, 1.3], stroke),
            Dash::Dotted => self.dashed(&points, &[0.6, 0.9], stroke),
            Dash::DashDotted => self.dashed(&points, &[2.2, 0.9, 0.6, 0.9], stroke),
        }
    }

    fn dashed(&self, points: &[(f64, f64)], pattern_mm: &[f64], stroke: LineStyle) -> Result<(), DrawError> {
        dashes(points, pattern_mm).iter().try_for_each(|dash| self.solid(dash, stroke))
    }

    fn solid(&self, points: &[(f64, f64)], stroke: LineStyle) -> Result<(), DrawError> {
        let width = stroke.width_pt * MM_PER_PT * self.per_mm;
        let colour = rgb(stroke.colour);
        if !self.is_raster {
            let style: ShapeStyle = colour.stroke_width((width.round() as u32).max(1));
            let path: Vec<(i32, i32)> = points.iter().map(|&point| self.at(point)).collect();
            return self.area.draw(&PathElement::new(path, style)).map_err(plot);
        }
        for pair in points.windows(2) {
            let [from, to] = [pair[0], pair[1]].map(|(x, y)| (x * self.per_mm, y * self.per_mm));
            let (dx, dy) = (to.0 - from.0, to.1 - from.1);
            let length = trig::hypot(dx, dy).max(1e-9);
            let (sx, sy) = (-dy / length * width / 2.0, dx / length * width / 2.0);
            let corners = [(from, 1.0), (to, 1.0), (to, -1.0), (from, -1.0)];
            let corners = corners
                .map(|((x, y), side)| ((x + sx * side).round() as i32, (y + sy * side).round() as i32));
            self.area.draw(&Polygon::new(corners.to_vec(), colour.filled())).map_err(plot)?;
        }
        // Round line joins.
        for &point in points.iter().skip(1).take(points.len().saturating_sub(2)) {
            let joint = Circle::new(self.at(point), (width / 2.0).floor() as i32, colour.filled());
            self.area.draw(&joint).map_err(plot)?;
        }
        Ok(())
    }
}

/// Ticks of both axes with their labels.
fn marks(panel: &Panel, place: PaperRect) -> [Vec<(f64, String)>; 2] {
    let round = |range, most: usize| {
        let (values, decimals) = ticks(range, most);
        values.into_iter().map(|value| (value, format!("{value:.decimals$}"))).collect()
    };
    let most = [((place.width / 11.0) as usize).max(2), ((place.height / 8.0) as usize).clamp(3, 10)];
    let [x, y] = panel.marks.clone();
    [x.unwrap_or_else(|| round(panel.x, most[0])), y.unwrap_or_else(|| round(panel.y, most[1]))]
}

/// Position of a reference line on the page; `None` outside the axes.
fn rule_at(rule: &ReferenceLine, panel: &Panel, place: PaperRect) -> Option<f64> {
    let range = if rule.is_level { panel.y } else { panel.x };
    let share = (rule.at - range.0) / (range.1 - range.0);
    let at =
        if rule.is_level { place.y + place.height * (1.0 - share) } else { place.x + place.width * share };
    (0.0..=1.0).contains(&share).then_some(at)
}

/// Label placement: positions near the wanted ones, in order, with a least distance.
fn apart(wanted: &[f64], least: f64) -> Vec<f64> {
    let mut groups: Vec<(f64, usize)> = Vec::new();
    for &at in wanted {
        groups.push((at, 1));
        // Overlapping labels are centred on their mean.
        while let [.., (a, n), (b, m)] = groups[..]
            && b - a < (n + m) as f64 / 2.0 * least
        {
            let middle = (a * n as f64 + b * m as f64) / (n + m) as f64;
            groups.truncate(groups.len() - 2);
            groups.push((middle, n + m));
        }
    }
    let spread = |(middle, count): (f64, usize)| {
        (0..count).map(move |k| middle + (k as f64 - (count - 1) as f64 / 2.0) * least)
    };
    groups.into_iter().flat_map(spread).collect()
}

fn rgb([red, green, blue]: Colour) -> RGBColor {
    RGBColor(red, green, blue)
}

/// Drops points closer than a visible distance.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    const SEEN_MM: f64 = 0.06;
    let mut kept: Vec<(f64, f64)> = Vec::new();
    for (index, &point) in points.iter().enumerate() {
        let is_far = |last: &(f64, f64)| trig::hypot(point.0 - last.0, point.1 - last.1) >= SEEN_MM;
        if index + 1 == points.len() || kept.last().is_none_or(is_far) {
            kept.push(point);
        }
    }
    kept
}

/// The drawn pieces of a dashed line. The pattern has the lengths of pieces and gaps by turns.
fn dashes(points: &[(f64, f64)], pattern_mm: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let mut found = Vec::new();
    let mut dash: Vec<(f64, f64)> = points.first().copied().into_iter().collect();
    let (mut part, mut is_on, mut left_mm) = (0, true, pattern_mm[0]);
    for pair in points.windows(2) {
        let (mut from, to) = (pair[0], pair[1]);
        loop {
            let length = trig::hypot(to.0 - from.0, to.1 - from.1);
            if length < left_mm {
                left_mm -= length;
                if is_on {
                    dash.push(to);
                }
                break;
            }
            let share = left_mm / length;
            from = (from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share);
            dash.push(from);
            if is_on {
                found.push(std::mem::take(&mut dash));
            } else {
                dash = vec![from];
            }
            part = (part + 1) % pattern_mm.len();
            is_on = part % 2 == 0;
            left_mm = pattern_mm[part];
        }
    }
    if is_on && dash.len() > 1 {
        found.push(dash);
    }
    found
}

/// Writes a figure into a folder: NAME.svg, NAME.png and NAME.csv.
///
/// # Errors
/// Where it cannot be drawn, or a file cannot be written; says which.
pub fn write(figure: &Figure, size: FigureSize, folder: &Path) -> Result<(), WriteError> {
    let write = |extension: &str, bytes: &[u8]| {
        let path = folder.join(format!("{}.{extension}", figure.name));
        WholeFile::write(&path, bytes)
            .map_err(|error| WriteError::File { path: path.display().to_string(), error })
    };
    write("svg", svg(figure, size)?.as_bytes())?;
    write("png", &png(figure, size)?)?;
    let table = figure.table.to_csv();
    write("csv", &table.map_err(|error| WriteError::File { path: format!("{}.csv", figure.name), error })?)
}

/// A figure that cannot be written.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The figure cannot be drawn.
    #[error(transparent)]
    Draw(#[from] DrawError),
    /// A file cannot be written, or the table cannot be encoded as CSV.
    #[error("{path}: cannot be written: {error}")]
    File {
        /// Path of the file; only its name where the CSV table cannot be encoded.
        path: String,
        /// Reason of the failure.
        error: std::io::Error,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_would_touch_are_moved_apart_and_others_stay() {
        assert_eq!(apart(&[1.0, 10.0], 3.0), [1.0, 10.0]);
        assert_eq!(apart(&[10.0, 11.0, 12.0], 3.0), [8.0, 11.0, 14.0]);
        assert_eq!(apart(&[], 3.0), [0.0; 0]);
    }

    #[test]
    fn a_dashed_line_is_as_long_as_its_dashes_and_goes_round_corners() {
        let line = [(0.0, 0.0), (1.0, 0.0), (1.0, 4.0)];
        let found = dashes(&line, &[2.0, 1.0]);
        assert_eq!(found, [vec![(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], vec![(1.0, 2.0), (1.0, 4.0)]]);
        let found = dashes(&[(0.0, 0.0), (8.0, 0.0)], &[2.0, 1.0, 0.5, 1.0]);
        assert_eq!(found[..2], [vec![(0.0, 0.0), (2.0, 0.0)], vec![(3.0, 0.0), (3.5, 0.0)]]);
        assert_eq!(found[2], [(4.5, 0.0), (6.5, 0.0)]);
    }
}
