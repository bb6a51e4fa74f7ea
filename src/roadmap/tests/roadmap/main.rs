//! Maps of the project and of others: what is read from a drawing, what is refused, and what is repaired.

mod map_corpus;
mod maps;
mod repair;
