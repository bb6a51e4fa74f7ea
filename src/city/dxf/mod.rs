//! DXF drawings: what a road map needs of the format, apart from what it means.

mod drawing;
mod writer;

pub use drawing::{Drawing, Entity, PolyVertex, Shape, Units};
