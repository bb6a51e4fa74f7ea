//! Maps of the project and of others: what is read from a drawing, what is refused, what is repaired, and grids.

mod grid;
mod map_corpus;
mod maps;
mod repair;
