//! DXF drawings: what a road map needs of the format, apart from what it means.

mod drawing;

pub use drawing::{Drawing, Entity, PolyVertex, Shape, Units};
