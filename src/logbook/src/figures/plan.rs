//! Page layout of a figure.

use super::chart::{Figure, GREY, LegendEntry, LineStyle};
use super::draw::{DrawError, FAMILY, FigureSize, MM_PER_PT, RASTER_SIZE, SMALL_PT, TEXT_PT, plot};
use miniz_oxide::inflate::decompress_to_vec_zlib;
use plotters::style::{FontFamily, FontStyle, TextStyle, register_font};
use std::sync::OnceLock;

/// A rectangle in millimetres from the upper left corner.
#[derive(Clone, Copy, Debug)]
pub struct PaperRect {
    /// Distance of the left edge from the left edge of the page.
    pub x: f64,
    /// Distance of the upper edge from the top of the page.
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

/// Page layout of a figure, millimetres.
pub struct PageLayout {
    /// Width of the page, that of its [`FigureSize`].
    pub width_mm: f64,
    /// Height of the page, rounded up to a whole millimetre.
    pub height_mm: f64,
    /// Lines of the title, each with the height of its upper edge below the top.
    pub title: Vec<(f64, String)>,
    /// Legend entries with their upper left corners.
    pub keys: Vec<(LegendEntry, (f64, f64))>,
    /// Place of the colour bar; `None` where the figure has none.
    pub scale: Option<PaperRect>,
    /// Lines of each panel's title, each with the height of its middle below the top of the page.
    pub panel_titles: Vec<Vec<(f64, String)>>,
    /// Axes of each panel, without title and labels.
    pub panels: Vec<PaperRect>,
    /// Whether each panel labels its horizontal reference lines: the last one of a row.
    pub have_names: Vec<bool>,
    /// Lines of the note, each with the height of its upper edge below the top.
    pub note: Vec<(f64, String)>,
}

/// Margin of the page.
pub const EDGE_MM: f64 = 2.0;
/// Line spacing of the text.
pub const LINE_MM: f64 = 4.0;
/// Length of the line sample of a legend entry.
pub const KEY_MM: f64 = 8.0;

/// Width of bold over normal letters.
const BOLD: f64 = 1.12;

/// The legend. In a column there is no room beside the axes, so it lists the horizontal reference lines too.
fn legend(figure: &Figure, size: FigureSize) -> Vec<LegendEntry> {
    let mut keys = figure.legend.clone();
    if size == FigureSize::Column {
        for rule in figure.panels.iter().flat_map(|panel| &panel.rules).filter(|rule| rule.is_level) {
            let stroke = LineStyle { colour: GREY, dash: rule.dash, width_pt: 0.8 };
            let key = LegendEntry { name: rule.name.clone(), stroke };
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
    }
    keys
}

impl PageLayout {
    /// Lays out title, legend, colour bar, panels and note from top to bottom.
    ///
    /// # Errors
    /// [`DrawError`] where the font cannot be used.
    pub fn of(figure: &Figure, size: FigureSize) -> Result<Self, DrawError> {
        font()?;
        let width_mm = size.width_mm();
        // A column has no room for two panels side by side.
        let columns = if size == FigureSize::Column { 1 } else { figure.columns.max(1) };
        let inner_mm = width_mm - 2.0 * EDGE_MM;
        let mut y = EDGE_MM;
        let mut title = Vec::new();
        for line in wrapped(&figure.title, TEXT_PT * BOLD, inner_mm)? {
            title.push((y, line));
            y += LINE_MM;
        }
        y += 1.0;
        let legend = legend(figure, size);
        let (mut keys, mut x) = (Vec::new(), EDGE_MM);
        for key in legend {
            let wide = KEY_MM + 1.0 + self::width_mm(&key.name, SMALL_PT)? + 4.0;
            if x > EDGE_MM && x + wide > width_mm - EDGE_MM + 4.0 {
                (x, y) = (EDGE_MM, y + LINE_MM);
            }
            keys.push((key, (x, y)));
            x += wide;
        }
        if !keys.is_empty() {
            y += LINE_MM + 0.5;
        }
        let scale = figure.scale.as_ref().map(|_| PaperRect {
            x: EDGE_MM + 2.0,
            y,
            width: (inner_mm - 25.0).min(70.0),
            height: 2.5,
        });
        if scale.is_some() {
            y += 2.5 + LINE_MM + 0.5;
        }
        let rules = || figure.panels.iter().flat_map(|panel| &panel.rules);
        let mut right = 3.0;
        let has_names = size == FigureSize::Page;
        for rule in rules().filter(|rule| rule.is_level && has_names) {
            right = f64::max(right, self::width_mm(&rule.name, SMALL_PT)? + 2.0);
        }
        let left = 14.0;
        let over = if rules().any(|rule| !rule.is_level) { LINE_MM } else { 1.5 };
        // Labels of horizontal lines are right of the last column.
        let cell = (inner_mm - right + 3.0) / columns as f64;
        let titles = figure.panels.iter().map(|panel| wrapped(&panel.title, TEXT_PT, cell - left - 3.0));
        let titles: Vec<Vec<String>> = titles.collect::<Result<_, _>>()?;
        let most = titles.iter().map(Vec::len).max().unwrap_or(0);
        let titles_mm = if most > 0 { most as f64 * LINE_MM + 1.0 } else { 0.0 };
        let (top, bottom) = (titles_mm + over, 2.0 * LINE_MM + 1.5);
        let height = figure.row_height * if size == FigureSize::Column { inner_mm * 1.1 } else { inner_mm };
        let height = if columns == 1 && size == FigureSize::Page { height.min(85.0) } else { height };
        let (mut panels, mut have_names, mut panel_titles) = (Vec::new(), Vec::new(), Vec::new());
        for (index, (panel, title)) in figure.panels.iter().zip(titles).enumerate() {
            let column = index % columns;
            // The last line is nearest to the axes.
            let first_mm = y + top - over - LINE_MM * title.len() as f64 + LINE_MM / 2.0 + 0.5;
            let places = (0..title.len()).map(|line| first_mm + LINE_MM * line as f64);
            panel_titles.push(places.zip(title).collect());
            let under = if panel.x_label.is_empty() { 2.0 } else { bottom };
            let height = height * panel.height_share;
            panels.push(PaperRect {
                x: EDGE_MM + cell * column as f64 + left,
                y: y + top,
                width: cell - left - 3.0,
                height,
            });
            let is_last = column + 1 == columns;
            have_names.push(is_last && has_names);
            if is_last || index + 1 == figure.panels.len() {
                y += top + height + under;
            }
        }
        let mut note = Vec::new();
        for line in wrapped(&figure.note, SMALL_PT, inner_mm)? {
            note.push((y + 0.5, line));
            y += LINE_MM - 0.6;
        }
        Ok(Self {
            width_mm,
            height_mm: (y + EDGE_MM).ceil(),
            title,
            keys,
            scale,
            panel_titles,
            panels,
            have_names,
            note,
        })
    }

    /// Width and height of the page in units of which a millimetre has so many.
    pub fn extent(&self, per_mm: f64) -> (u32, u32) {
        ((self.width_mm * per_mm).round() as u32, (self.height_mm * per_mm).round() as u32)
    }
}

/// Breaks a text into lines (greedy).
fn wrapped(text: &str, points: f64, most_mm: f64) -> Result<Vec<String>, DrawError> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width_mm(&format!("{line} {word}"), points)? <= most_mm => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    Ok(lines)
}

/// DejaVu Sans, compressed by `build.rs`.
static SANS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/regular"));
static SANS_BOLD: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/bold"));

/// Registers the embedded font once.
fn font() -> Result<(), DrawError> {
    static IS_THERE: OnceLock<bool> = OnceLock::new();
    let add = |style, compressed| {
        // Fonts stay registered until the program ends.
        let font = decompress_to_vec_zlib(compressed).ok()?.leak();
        register_font(FAMILY, style, font).ok()
    };
    let register = || add(FontStyle::Normal, SANS).and_then(|()| add(FontStyle::Bold, SANS_BOLD)).is_some();
    IS_THERE.get_or_init(register).then_some(()).ok_or(DrawError::Font)
}

/// Width of a text in print.
fn width_mm(text: &str, points: f64) -> Result<f64, DrawError> {
    // Measured large, because widths are whole pixels.
    let large = 200.0;
    let style = TextStyle::from((FontFamily::Name(FAMILY), large * RASTER_SIZE));
    let ((left, _), (right, _)) = style.font.layout_box(text).map_err(plot)?;
    Ok(f64::from(right - left) / large * points * MM_PER_PT)
}
