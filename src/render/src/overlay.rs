//! Overlays: lines and surfaces in the city that are no part of its scene, hidden by what is in front of them.

use glam::{DVec3, Vec3};

/// Lines and surfaces over one view, in city metres. They have colours of their own, without light and fog.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overlay {
    /// Straight lines of constant width on the screen.
    pub lines: Vec<OverlayLine>,
    /// Triangles. They are drawn before the lines, in their order.
    pub triangles: Vec<OverlayTriangle>,
    /// Pixels of the picture for one unit of [`OverlayLine::width`].
    pub scale: f32,
}

/// A straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverlayLine {
    /// Its ends, city metres.
    pub ends: [Vec3; 2],
    /// Its width on the screen, see [`Overlay::scale`].
    pub width: f32,
    /// Its paint.
    pub paint: OverlayPaint,
}

/// A triangle, seen from both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverlayTriangle {
    /// City metres.
    pub corners: [Vec3; 3],
    /// Its paint.
    pub paint: OverlayPaint,
}

/// The paint of a line or a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverlayPaint {
    /// sRGB and opacity, not premultiplied.
    pub colour: [u8; 4],
    /// Share of the opacity where something is in front: 0 hides it there.
    pub behind: f32,
}

impl OverlayPaint {
    /// A colour that is hidden by what is in front.
    pub fn hidden(colour: [u8; 4]) -> Self {
        Self { colour, behind: 0.0 }
    }
}

impl Overlay {
    /// An empty overlay for a picture with so many pixels for one unit of width.
    pub fn new(scale: f32) -> Self {
        Self { scale, ..Self::default() }
    }

    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty() && self.triangles.is_empty()
    }

    /// Adds a line.
    pub fn line(&mut self, ends: [DVec3; 2], width: f32, paint: OverlayPaint) {
        self.lines.push(OverlayLine { ends: ends.map(|end| end.as_vec3()), width, paint });
    }

    /// Adds a line through points.
    pub fn polyline(&mut self, points: &[DVec3], width: f32, paint: OverlayPaint) {
        for pair in points.windows(2) {
            self.line([pair[0], pair[1]], width, paint);
        }
    }

    /// Adds a triangle.
    pub fn triangle(&mut self, corners: [DVec3; 3], paint: OverlayPaint) {
        self.triangles.push(OverlayTriangle { corners: corners.map(|corner| corner.as_vec3()), paint });
    }

    /// Adds a strip between two lines of as many points.
    pub fn strip(&mut self, left: &[DVec3], right: &[DVec3], paint: OverlayPaint) {
        for (left, right) in left.windows(2).zip(right.windows(2)) {
            self.triangle([left[0], right[0], left[1]], paint);
            self.triangle([right[0], right[1], left[1]], paint);
        }
    }
}
