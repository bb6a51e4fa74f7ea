//! Errors of a map drawing, each with its place in the file.

use super::dxf::Entity;
use std::fmt;

/// How many errors are listed; the rest is counted.
pub const MAX_LISTED: usize = 20;

/// The category of a map error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MapErrorKind {
    /// Not an ASCII DXF file, or a damaged one.
    Format,
    /// A number that cannot be parsed, is not finite, or exceeds what a map can hold.
    Number,
    /// An entity of a kind that its layer cannot take.
    Unsupported,
    /// A piece without length, a shape without area.
    Degenerate,
    /// Ends that should meet and do not.
    Gap,
    /// Ends that meet at an angle.
    Kink,
    /// The same lane drawn twice.
    Overlap,
    /// Directions of travel that contradict each other or are missing.
    Direction,
    /// A name given twice, or two texts for one thing.
    Name,
    /// A text that says nothing useful for its layer.
    Text,
    /// A text, arrow or line that belongs to nothing.
    Stray,
    /// A layer of a reserved name that means nothing.
    Layer,
    /// No lanes at all, or more than a map can hold.
    Size,
}

/// One fault of a drawing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct MapError {
    /// Category of the fault, whatever its wording.
    pub kind: MapErrorKind,
    /// Line of the file; 0 for a drawing made in memory.
    pub line: usize,
    /// Kind and handle of the entity ("ARC 2F"), empty where the fault is not in one.
    pub entity: String,
    /// What was found.
    pub message: String,
    /// How to fix it.
    pub remedy: String,
}

impl fmt::Display for MapError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_place(f, self.line, &self.entity)?;
        write!(f, "{}; {}", self.message, self.remedy)
    }
}

fn write_place(f: &mut fmt::Formatter<'_>, line: usize, entity: &str) -> fmt::Result {
    match (line, entity) {
        (0, "") => Ok(()),
        (0, _) => write!(f, "{entity}: "),
        (_, "") => write!(f, "line {line}: "),
        (..) => write!(f, "line {line}, {entity}: "),
    }
}

/// The faults of a drawing, one a line, in the order of the file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MapErrors {
    /// The first `MAX_LISTED`.
    pub listed: Vec<MapError>,
    /// How many more there are.
    pub left_out: usize,
}

impl std::error::Error for MapErrors {}

impl fmt::Display for MapErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, error) in self.listed.iter().enumerate() {
            let separator = if k == 0 { "" } else { "\n" };
            write!(f, "{separator}{error}")?;
        }
        if self.left_out > 0 {
            write!(f, "\nand {} more", self.left_out)?;
        }
        Ok(())
    }
}

/// Something that a map's author may want to know and that does not stop the map from loading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MapNote {
    /// Line of the file; 0 where the note is about the whole.
    pub line: usize,
    /// Kind and handle of the entity, or empty.
    pub entity: String,
    /// What was noticed, ignored or changed.
    pub message: String,
}

impl fmt::Display for MapNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_place(f, self.line, &self.entity)?;
        f.write_str(&self.message)
    }
}

/// Collects errors and notes while a drawing is read.
#[derive(Debug, Default)]
pub(super) struct Diagnostics {
    errors: Vec<MapError>,
    left_out: usize,
    pub(super) notes: Vec<MapNote>,
}

/// More errors are kept than listed, since they are not found in file order; this bounds their memory.
const MAX_KEPT: usize = 10 * MAX_LISTED;

impl Diagnostics {
    /// A fault at an entity.
    pub(super) fn error(&mut self, kind: MapErrorKind, entity: &Entity, message: String, remedy: &str) {
        self.error_at(kind, entity.line, entity.label(), message, remedy);
    }

    pub(super) fn error_at(
        &mut self,
        kind: MapErrorKind,
        line: usize,
        entity: String,
        message: String,
        remedy: &str,
    ) {
        if self.errors.len() < MAX_KEPT {
            self.errors.push(MapError { kind, line, entity, message, remedy: remedy.to_owned() });
        } else {
            self.left_out += 1;
        }
    }

    pub(super) fn note(&mut self, entity: &Entity, message: String) {
        self.notes.push(MapNote { line: entity.line, entity: entity.label(), message });
    }

    pub(super) fn note_all(&mut self, message: String) {
        self.notes.push(MapNote { line: 0, entity: String::new(), message });
    }

    /// Fails with the errors so far if one of them says that the map is too large to go on.
    pub(super) fn check_size(&mut self) -> Result<(), MapErrors> {
        if self.errors.iter().any(|error| error.kind == MapErrorKind::Size) { self.check() } else { Ok(()) }
    }

    /// Fails with the errors so far, if any.
    pub(super) fn check(&mut self) -> Result<(), MapErrors> {
        if self.errors.is_empty() {
            return Ok(());
        }
        let mut listed = std::mem::take(&mut self.errors);
        listed.sort_by_key(|error| error.line);
        let left_out = self.left_out + listed.len().saturating_sub(MAX_LISTED);
        listed.truncate(MAX_LISTED);
        Err(MapErrors { listed, left_out })
    }
}
