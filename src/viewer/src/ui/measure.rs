//! The measure tool: a line through points of the ground, with the lengths of its parts and of the whole.

use super::layers::Canvas;
use super::overlay;
use super::theme::{self, DecimalSeparator};
use city3d_render::Overlay;
use egui::{Color32, Rect};
use glam::DVec2;

/// State of the measure tool.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measure {
    /// Clicks in the city add points.
    pub is_on: bool,
    /// Points of the ground, city frame.
    pub points: Vec<DVec2>,
    /// The place under the mouse, to which the line goes on.
    next: Option<DVec2>,
}

const COLOUR: Color32 = Color32::from_rgb(120, 240, 255);

impl Measure {
    /// Begins at a point of the ground.
    pub fn begin(&mut self, at: Option<DVec2>) {
        *self = Self { is_on: true, points: at.into_iter().collect(), next: None };
    }

    /// Ends, and removes the line.
    pub fn end(&mut self) {
        *self = Self::default();
    }

    /// The line goes on to the place under the mouse.
    pub(super) fn point_at(&mut self, next: Option<DVec2>) {
        self.next = next.filter(|_| self.is_on);
    }

    /// Adds a point, if the tool is on; returns whether it is.
    pub(super) fn click(&mut self, at: Option<DVec2>) -> bool {
        if self.is_on {
            self.points.extend(at);
        }
        self.is_on
    }

    fn line(&self) -> Vec<DVec2> {
        self.points.iter().copied().chain(self.next).collect()
    }

    /// Length of the line, metres.
    pub fn length_m(&self) -> f64 {
        self.line().windows(2).map(|pair| pair[0].distance(pair[1])).sum()
    }

    /// Adds the line to an overlay.
    pub(super) fn add(&self, to: &mut Overlay) {
        let line: Vec<_> = self.line().into_iter().map(overlay::above).collect();
        to.polyline(&line, 3.0, overlay::paint(COLOUR, 1.0));
        for point in &self.points {
            overlay::disc(to, *point, 0.4, overlay::paint(COLOUR, 1.0));
        }
    }

    /// Writes the lengths, and how the tool is used.
    pub(super) fn paint(&self, canvas: &Canvas<'_>) {
        if !self.is_on {
            return;
        }
        let decimal = theme::decimal(canvas.painter().ctx());
        let mut taken: Vec<Rect> = Vec::new();
        for pair in self.line().windows(2) {
            if let Some(place) = canvas.place(overlay::above((pair[0] + pair[1]) / 2.0)) {
                canvas.text(place, &metres(pair[0].distance(pair[1]), decimal), COLOUR, &mut taken);
            }
        }
        let text = match self.points.len() {
            0 => "Measure: click the first point. Esc ends".to_owned(),
            _ => format!(
                "Measure: {} in all. Click the next point, Esc ends",
                metres(self.length_m(), decimal)
            ),
        };
        canvas.hint(text);
    }
}

/// A length in words.
pub(super) fn metres(length_m: f64, decimal: DecimalSeparator) -> String {
    format!("{} m", decimal.fixed(length_m, usize::from(length_m < 100.0)))
}
