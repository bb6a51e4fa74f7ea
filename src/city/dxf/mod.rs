//! DXF drawings: what a road map needs of the format, apart from what it means.

mod drawing;
mod edit;
mod groups;
mod reader;
mod text;
mod writer;

pub use drawing::{Drawing, Entity, PolyVertex, Shape, Units};
pub use edit::{Edit, edit};
pub use groups::MAX_BYTES;
pub use reader::{ReadDrawing, Unread};
