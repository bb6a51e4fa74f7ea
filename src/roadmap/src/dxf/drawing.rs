//! A DXF drawing as plain data: entities on layers, in drawing units.

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// The unit that a drawing's header states (`$INSUNITS`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Units {
    /// Code 0: taken as metres.
    Unitless,
    /// Code 1.
    Inches,
    /// Code 2.
    Feet,
    /// Code 4.
    Millimetres,
    /// Code 5.
    Centimetres,
    /// Code 6.
    #[default]
    Metres,
}

impl Units {
    /// Length of one drawing unit in metres.
    pub fn metres(self) -> f64 {
        match self {
            Self::Unitless | Self::Metres => 1.0,
            Self::Inches => 0.0254,
            Self::Feet => 0.3048,
            Self::Millimetres => 0.001,
            Self::Centimetres => 0.01,
        }
    }
}

/// A polyline vertex with the bulge of the piece that follows it: the tangent of a quarter of the swept
/// angle, positive counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PolyVertex {
    /// Drawing units.
    pub at: DVec2,
    /// 0 for a straight piece.
    pub bulge: f64,
}

/// The geometry of an entity. Angles in degrees, as DXF has them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum EntityShape {
    /// A LINE; a lane runs from its first point to its last.
    Line {
        /// First point, drawing units.
        from: DVec2,
        /// Last point, drawing units.
        to: DVec2,
    },
    /// Always counter-clockwise from one angle to the other: DXF arcs have no direction of travel.
    Arc {
        /// Drawing units.
        centre: DVec2,
        /// Drawing units.
        radius: f64,
        /// Angle of the start, counter-clockwise from the x axis.
        from_deg: f64,
        /// Angle of the end, counter-clockwise from the x axis.
        to_deg: f64,
    },
    /// An LWPOLYLINE of straight and circular pieces.
    Polyline {
        /// In drawing order, which is the direction of travel of a lane.
        vertices: Vec<PolyVertex>,
        /// Whether a further piece leads from the last vertex to the first.
        closed: bool,
    },
    /// A CIRCLE, for footprints of scenery: no lane can start on it.
    Circle {
        /// Drawing units.
        centre: DVec2,
        /// Drawing units.
        radius: f64,
    },
    /// A TEXT or MTEXT.
    Text {
        /// Insertion point, or alignment point of a justified text, drawing units.
        at: DVec2,
        /// Height of the letters, drawing units; 0 where the file states none.
        height: f64,
        /// Its characters, without the formatting codes of MTEXT.
        text: String,
    },
}

/// A drawing entity with its layer, handle and line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entity {
    /// Layer name as written in the file; comparisons ignore capitals.
    pub layer: String,
    /// Geometry in drawing units.
    pub shape: EntityShape,
    /// Hexadecimal, as CAD programs show it; empty where the drawing has none.
    pub handle: String,
    /// Line of the file at which the entity starts; 0 for a drawing made in memory.
    pub line: usize,
}

/// A drawing: the entities of its model space and their unit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Drawing {
    /// Unit of all coordinates, radii and text heights.
    pub units: Units,
    /// In the order of the file.
    pub entities: Vec<Entity>,
}

impl Drawing {
    /// Adds an entity without a line in a file.
    pub fn add(&mut self, layer: &str, shape: EntityShape) {
        self.entities.push(Entity { layer: layer.to_owned(), shape, handle: String::new(), line: 0 });
    }
}

impl Entity {
    /// The label for messages: kind and handle, as in "ARC 2F".
    pub fn label(&self) -> String {
        let kind = match self.shape {
            EntityShape::Line { .. } => "LINE",
            EntityShape::Arc { .. } => "ARC",
            EntityShape::Polyline { .. } => "LWPOLYLINE",
            EntityShape::Circle { .. } => "CIRCLE",
            EntityShape::Text { .. } => "TEXT",
        };
        if self.handle.is_empty() { kind.to_owned() } else { format!("{kind} {}", self.handle) }
    }
}
