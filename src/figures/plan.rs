//! Where everything of a figure is on the paper.

use super::chart::Figure;
use super::draw::{DrawError, FAMILY, MM_PER_PT, RASTER_SIZE, SMALL_PT, Size, plot};
use plotters::style::{FontFamily, FontStyle, TextStyle, register_font};
use std::sync::OnceLock;

/// A rectangle in millimetres from the upper left corner.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

/// Where everything of a figure is, millimetres.
pub struct Plan {
    pub width_mm: f64,
    pub height_mm: f64,
    pub title_y: f64,
    /// Upper left corner of each key.
    pub keys: Vec<(f64, f64)>,
    pub scale: Option<Place>,
    /// Of the space above axes, under the title of the panel.
    pub over: f64,
    pub panels: Vec<Place>,
    /// Whether each one is the last of its row.
    pub are_last: Vec<bool>,
    pub note: Vec<(f64, String)>,
}

pub const EDGE_MM: f64 = 2.0;
pub const LINE_MM: f64 = 4.0;
pub const KEY_MM: f64 = 8.0;

impl Plan {
    pub fn of(figure: &Figure, size: Size) -> Result<Self, DrawError> {
        font()?;
        let width_mm = size.width_mm();
        // A column has no room for two panels side by side.
        let columns = if size == Size::Column { 1 } else { figure.columns.max(1) };
        let inner_mm = width_mm - 2.0 * EDGE_MM;
        let mut y = EDGE_MM;
        let title_y = y;
        y += LINE_MM + 1.0;
        let (mut keys, mut x) = (Vec::new(), EDGE_MM);
        for key in &figure.legend {
            let wide = KEY_MM + 1.0 + self::width_mm(&key.name, SMALL_PT)? + 4.0;
            if x > EDGE_MM && x + wide > width_mm - EDGE_MM + 4.0 {
                (x, y) = (EDGE_MM, y + LINE_MM);
            }
            keys.push((x, y));
            x += wide;
        }
        if !figure.legend.is_empty() {
            y += LINE_MM + 0.5;
        }
        let scale = figure.scale.as_ref().map(|_| Place {
            x: EDGE_MM + 2.0,
            y,
            width: (inner_mm - 25.0).min(70.0),
            height: 2.5,
        });
        if scale.is_some() {
            y += 2.5 + LINE_MM + 0.5;
        }
        let has_titles = figure.panels.iter().any(|panel| !panel.title.is_empty());
        let rules = || figure.panels.iter().flat_map(|panel| &panel.rules);
        let mut right = 3.0;
        for rule in rules().filter(|rule| rule.is_level) {
            right = f64::max(right, self::width_mm(&rule.name, SMALL_PT)? + 2.0);
        }
        let left = 14.0;
        let over = if rules().any(|rule| !rule.is_level) { LINE_MM } else { 1.5 };
        let (top, bottom) = (if has_titles { LINE_MM + 1.0 } else { 0.0 } + over, 2.0 * LINE_MM + 1.5);
        // Names of level lines stand to the right of the last column.
        let cell = (inner_mm - right + 3.0) / columns as f64;
        let height = figure.row_height * if size == Size::Column { inner_mm * 1.1 } else { inner_mm };
        let height = if columns == 1 && size == Size::Page { height.min(85.0) } else { height };
        let (mut panels, mut are_last) = (Vec::new(), Vec::new());
        for (index, panel) in figure.panels.iter().enumerate() {
            let column = index % columns;
            let under = if panel.x_label.is_empty() { 2.0 } else { bottom };
            panels.push(Place {
                x: EDGE_MM + cell * column as f64 + left,
                y: y + top,
                width: cell - left - 3.0,
                height,
            });
            let is_last = column + 1 == columns;
            are_last.push(is_last);
            if is_last || index + 1 == figure.panels.len() {
                y += top + height + under;
            }
        }
        let mut note = Vec::new();
        for line in wrapped(&figure.note, inner_mm)? {
            note.push((y + 0.5, line));
            y += LINE_MM - 0.6;
        }
        Ok(Self {
            width_mm,
            height_mm: (y + EDGE_MM).ceil(),
            title_y,
            keys,
            scale,
            over,
            panels,
            are_last,
            note,
        })
    }

    pub fn extent(&self, per_mm: f64) -> (u32, u32) {
        ((self.width_mm * per_mm).round() as u32, (self.height_mm * per_mm).round() as u32)
    }
}

/// Lines of a note that are not wider than a figure.
fn wrapped(text: &str, most_mm: f64) -> Result<Vec<String>, DrawError> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width_mm(&format!("{line} {word}"), SMALL_PT)? <= most_mm => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    Ok(lines)
}

/// The program's own font, registered once.
fn font() -> Result<(), DrawError> {
    static IS_THERE: OnceLock<bool> = OnceLock::new();
    let register = || {
        let normal = register_font(FAMILY, FontStyle::Normal, dejavu::sans::regular());
        normal.and_then(|()| register_font(FAMILY, FontStyle::Bold, dejavu::sans::bold())).is_ok()
    };
    IS_THERE.get_or_init(register).then_some(()).ok_or(DrawError::Font)
}

/// Width of a text in print.
fn width_mm(text: &str, points: f64) -> Result<f64, DrawError> {
    // Measured large, for widths come in whole pixels.
    let large = 200.0;
    let style = TextStyle::from((FontFamily::Name(FAMILY), large * RASTER_SIZE));
    let ((left, _), (right, _)) = style.font.layout_box(text).map_err(plot)?;
    Ok(f64::from(right - left) / large * points * MM_PER_PT)
}
