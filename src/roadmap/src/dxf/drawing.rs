//! A DXF drawing as plain data: entities on layers, in drawing units.

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// The unit that a drawing's header states (`$INSUNITS`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Units {
    /// Code 0: taken as metres.
    Unitless,
    Inches,
    Feet,
    Millimetres,
    Centimetres,
    #[default]
    Metres,
}

impl Units {
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
    pub at: DVec2,
    pub bulge: f64,
}

/// The geometry of an entity. Angles in degrees, as DXF has them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum EntityShape {
    Line {
        from: DVec2,
        to: DVec2,
    },
    /// Always counter-clockwise from one angle to the other: DXF arcs have no direction of travel.
    Arc {
        centre: DVec2,
        radius: f64,
        from_deg: f64,
        to_deg: f64,
    },
    Polyline {
        vertices: Vec<PolyVertex>,
        closed: bool,
    },
    Circle {
        centre: DVec2,
        radius: f64,
    },
    Text {
        at: DVec2,
        height: f64,
        text: String,
    },
}

/// A drawing entity with its layer, handle and line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entity {
    pub layer: String,
    pub shape: EntityShape,
    /// Hexadecimal, as CAD programs show it; empty where the drawing has none.
    pub handle: String,
    /// Line of the file at which the entity starts; 0 for a drawing made in memory.
    pub line: usize,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Drawing {
    pub units: Units,
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
