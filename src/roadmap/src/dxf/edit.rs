//! Edits entities of a DXF file in place; all other bytes stay as they are.

use super::{EntityShape, PolyVertex};
use glam::DVec2;
use std::collections::BTreeMap;
use std::ops::Range;

/// Replacement geometry of one entity, in drawing units and world coordinates. An empty list deletes the
/// entity; further shapes become copies with new handles.
#[derive(Clone, Debug, PartialEq)]
pub struct EntityEdit {
    /// Line of the file at which the entity starts.
    pub line: usize,
    /// The first replaces the geometry of the entity itself.
    pub shapes: Vec<EntityShape>,
}

/// Applies edits to a file that [`super::ParsedDrawing::parse`] accepts. Each shape has the kind of its
/// entity: LINE, ARC or LWPOLYLINE; other kinds are left as they are.
pub fn edit(bytes: &[u8], edits: &[EntityEdit]) -> Vec<u8> {
    let file = DxfLines::of(bytes);
    let mut handles = FreeHandles::default();
    let mut replaced: BTreeMap<usize, (Range<usize>, Vec<u8>)> = BTreeMap::new();
    for edit in edits {
        let range = file.entity(edit.line);
        let mut text = Vec::new();
        for (copy, shape) in edit.shapes.iter().enumerate() {
            let handle = (copy > 0).then(|| handles.next(&file));
            file.write_entity(range.clone(), shape, handle, &mut text);
        }
        replaced.insert(range.start, (range, text));
    }
    let mut edited = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < file.lines.len() {
        if let Some((range, text)) = replaced.get(&at) {
            edited.extend_from_slice(text);
            at = range.end;
            continue;
        }
        match handles.given.filter(|_| file.is_seed(at)) {
            Some(last) => edited.extend_from_slice(&file.value_line(at, &format!("{:X}", last + 1))),
            None => edited.extend_from_slice(file.lines[at]),
        }
        at += 1;
    }
    edited
}

/// Allocates handles above the largest one of the file.
#[derive(Default)]
struct FreeHandles {
    given: Option<u64>,
}

impl FreeHandles {
    fn next(&mut self, file: &DxfLines) -> u64 {
        let last = self.given.unwrap_or_else(|| file.largest_handle());
        self.given = Some(last + 1);
        last + 1
    }
}

/// The lines of a DXF file with their endings; codes and values alternate.
struct DxfLines<'a> {
    lines: Vec<&'a [u8]>,
}

/// A group code and the index of its line; the value is on the next line.
type GroupIndex = (i32, usize);

impl<'a> DxfLines<'a> {
    fn of(bytes: &'a [u8]) -> Self {
        Self { lines: bytes.split_inclusive(|&b| b == b'\n').collect() }
    }

    fn text(&self, at: usize) -> &str {
        self.lines.get(at).and_then(|line| std::str::from_utf8(line).ok()).map_or("", str::trim)
    }

    fn code(&self, at: usize) -> Option<i32> {
        self.text(at).trim_start_matches('\u{feff}').parse().ok()
    }

    /// The lines of the entity that starts at a line, counted from 1.
    fn entity(&self, line: usize) -> Range<usize> {
        let start = line.saturating_sub(1);
        let mut end = start + 2;
        while end < self.lines.len() && self.code(end) != Some(0) {
            end += 2;
        }
        start..end.min(self.lines.len())
    }

    /// Whether the line is the value of the header's next free handle.
    fn is_seed(&self, at: usize) -> bool {
        at >= 3 && self.text(at - 2) == "$HANDSEED" && self.code(at - 3) == Some(9)
    }

    fn largest_handle(&self) -> u64 {
        let handles = (0..self.lines.len().saturating_sub(1))
            .step_by(2)
            .filter(|&at| matches!(self.code(at), Some(5 | 105)));
        handles.filter_map(|at| u64::from_str_radix(self.text(at + 1), 16).ok()).max().unwrap_or(0)
    }

    /// A value with the line ending of the line that it replaces.
    fn value_line(&self, at: usize, value: &str) -> Vec<u8> {
        let ending: &[u8] = if self.lines[at].ends_with(b"\r\n") { b"\r\n" } else { b"\n" };
        [value.as_bytes(), ending].concat()
    }

    /// The groups of an entity; `true` marks its own, `false` those that applications have attached.
    fn groups(&self, range: Range<usize>) -> Vec<(GroupIndex, bool)> {
        let mut foreign = false;
        let mut groups = Vec::new();
        for at in range.step_by(2) {
            let code = self.code(at).unwrap_or(-1);
            let bracket = code == 102;
            if bracket {
                foreign = self.text(at + 1).starts_with('{');
            }
            groups.push(((code, at), !foreign && !bracket && code < 1000));
        }
        groups
    }

    fn write_entity(
        &self,
        range: Range<usize>,
        shape: &EntityShape,
        handle: Option<u64>,
        text: &mut Vec<u8>,
    ) {
        let groups = self.groups(range);
        let mirrored = groups.iter().any(|&((code, at), own)| {
            own && code == 230 && self.text(at + 1).parse::<f64>().is_ok_and(|z| z < 0.0)
        });
        let values = values_of(shape, mirrored);
        let is_polyline = matches!(shape, EntityShape::Polyline { .. });
        let of_vertex = |&((code, _), own): &(GroupIndex, bool)| {
            is_polyline && own && matches!(code, 10 | 20 | 40 | 41 | 42 | 91)
        };
        let mut vertices = Some(groups.iter().copied().filter(of_vertex).map(|(group, _)| group).collect());
        for &((code, at), own) in &groups {
            if of_vertex(&((code, at), own)) {
                if let (EntityShape::Polyline { vertices: new, .. }, Some(old)) = (shape, vertices.take()) {
                    self.write_vertices(old, new, mirrored, text);
                }
                continue;
            }
            let value = match code {
                5 if own => handle.map(|handle| format!("{handle:X}")),
                70 if own && is_polyline => Some(self.polyline_flags(at + 1, shape)),
                _ if own => values.get(&code).cloned(),
                _ => None,
            };
            text.extend_from_slice(self.lines[at]);
            match (value, self.lines.get(at + 1)) {
                (Some(value), _) => text.extend(self.value_line(at, &value)),
                (None, line) => text.extend_from_slice(line.copied().unwrap_or_default()),
            }
        }
    }

    /// Replaces the vertices. Widths are kept if the number of vertices is the same.
    fn write_vertices(&self, old: Vec<GroupIndex>, new: &[PolyVertex], mirrored: bool, text: &mut Vec<u8>) {
        let starts: Vec<usize> = (0..old.len()).filter(|&k| old[k].0 == 10).collect();
        let Some(&(_, first)) = old.first() else { return };
        let mut write = |code: i32, value: f64| {
            text.extend(self.value_line(first, &format!("{code:>3}")));
            text.extend(self.value_line(first, &format!("{value:?}")));
        };
        let mut extra: Vec<Vec<(i32, f64)>> = vec![Vec::new(); new.len()];
        if starts.len() == new.len() {
            for (k, &start) in starts.iter().enumerate() {
                let end = starts.get(k + 1).copied().unwrap_or(old.len());
                let marks = old[start..end].iter().filter(|(code, _)| matches!(code, 40 | 41));
                extra[k] = marks.filter_map(|&(c, at)| Some((c, self.text(at + 1).parse().ok()?))).collect();
            }
        }
        for (vertex, extra) in new.iter().zip(extra) {
            let sign = if mirrored { -1.0 } else { 1.0 };
            write(10, sign * vertex.at.x);
            write(20, vertex.at.y);
            for (code, value) in extra {
                write(code, value);
            }
            if vertex.bulge != 0.0 {
                write(42, sign * vertex.bulge);
            }
        }
    }

    /// The flags of a polyline, closed or not as the shape is.
    fn polyline_flags(&self, at: usize, shape: &EntityShape) -> String {
        let flags: i32 = self.text(at).parse().unwrap_or(0);
        let closed = matches!(shape, EntityShape::Polyline { closed: true, .. });
        ((flags & !1) | i32::from(closed)).to_string()
    }
}

/// The values of a shape by group code, those of vertices apart.
fn values_of(shape: &EntityShape, mirrored: bool) -> BTreeMap<i32, String> {
    let number = |value: f64| format!("{value:?}");
    let point = |code: i32, at: DVec2| [(code, number(at.x)), (code + 10, number(at.y))];
    match shape {
        EntityShape::Line { from, to } => point(10, *from).into_iter().chain(point(11, *to)).collect(),
        EntityShape::Arc { centre, radius, from_deg, to_deg } => {
            let (x, from, to) = if mirrored {
                (-centre.x, 180.0 - to_deg, 180.0 - from_deg)
            } else {
                (centre.x, *from_deg, *to_deg)
            };
            let angles = [(40, number(*radius)), (50, number(from)), (51, number(to))];
            point(10, DVec2::new(x, centre.y)).into_iter().chain(angles).collect()
        }
        EntityShape::Polyline { vertices, .. } => BTreeMap::from([(90, vertices.len().to_string())]),
        EntityShape::Circle { .. } | EntityShape::Text { .. } => BTreeMap::new(),
    }
}
