//! DXF drawings: the part of the file format that road maps use.

mod drawing;
mod edit;
mod groups;
mod reader;
mod text;
mod writer;

pub use drawing::{Drawing, Entity, EntityShape, PolyVertex, Units};
pub use edit::{EntityEdit, edit};
pub use groups::MAX_BYTES;
pub use reader::{ParsedDrawing, UnsupportedEntity};
