//! Parses a DXF file into a [`Drawing`]: sections, entities and their values, each with its line.

use super::groups::{DxfGroup, GroupReader, MalformedFile, shown};
use super::text::{decode, without_formatting};
use super::{Drawing, Entity, EntityShape, PolyVertex, Units};
use crate::error::{Diagnostics, MapErrorKind, MapErrors};
use glam::DVec2;

/// An entity of a kind that maps do not use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnsupportedEntity {
    /// Its type name in the file: "SPLINE".
    pub kind: String,
    /// Layer name as written in the file; `0` where it states none.
    pub layer: String,
    /// Hexadecimal, as CAD programs show it; empty where the file has none.
    pub handle: String,
    /// Line of the file at which the entity starts.
    pub line: usize,
    /// What the author could draw instead.
    pub remedy: &'static str,
}

/// A parsed drawing and its unsupported entities.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParsedDrawing {
    /// The entities that maps can use.
    pub drawing: Drawing,
    /// The entities of other kinds, and tilted ones, in the order of the file.
    pub unsupported: Vec<UnsupportedEntity>,
}

impl Drawing {
    /// Reads the model space of an ASCII DXF file.
    ///
    /// Reads LINE, ARC, LWPOLYLINE, CIRCLE, TEXT and MTEXT; elevations are ignored. [`ParsedDrawing::parse`]
    /// also lists the entities of other kinds.
    ///
    /// # Errors
    /// A file that is not ASCII DXF or is truncated, numbers that cannot be parsed or are not finite,
    /// entities that lack a coordinate.
    pub fn parse(bytes: &[u8]) -> Result<Self, MapErrors> {
        ParsedDrawing::parse(bytes).map(|read| read.drawing)
    }
}

impl ParsedDrawing {
    /// As [`Drawing::parse`], and lists the unsupported entities.
    ///
    /// # Errors
    /// As [`Drawing::parse`].
    pub fn parse(bytes: &[u8]) -> Result<Self, MapErrors> {
        let mut reader = DxfReader::default();
        // The diagnostics hold the reason of a failure.
        let _ = reader.read(bytes);
        reader.diagnostics.check()?;
        Ok(reader.read)
    }
}

/// Most entities that a drawing may have, of all kinds and layers.
pub const MAX_ENTITIES: usize = 500_000;

#[derive(Clone, Copy, PartialEq, Eq)]
enum DxfSection {
    Outside,
    /// After `0 SECTION`, before its name.
    Unnamed,
    Header,
    Entities,
    Other,
}

#[derive(Default)]
struct DxfReader {
    read: ParsedDrawing,
    diagnostics: Diagnostics,
}

impl DxfReader {
    fn read(&mut self, bytes: &[u8]) -> Result<(), MalformedFile> {
        let mut groups = GroupReader::new(bytes, &mut self.diagnostics)?;
        let mut section = DxfSection::Outside;
        let mut any_section = false;
        let mut entities_seen = false;
        let mut variable = String::new();
        let mut raw: Option<RawEntity> = None;
        while let Some(group) = groups.next(&mut self.diagnostics)? {
            if group.code != 0 {
                match section {
                    DxfSection::Unnamed if group.code == 2 => {
                        section = match group.keyword().as_str() {
                            "HEADER" => DxfSection::Header,
                            "ENTITIES" => DxfSection::Entities,
                            _ => DxfSection::Other,
                        };
                        entities_seen |= section == DxfSection::Entities;
                    }
                    DxfSection::Unnamed if group.code != 999 => {
                        return self.broken(group, "expected the name of the section (group 2)");
                    }
                    DxfSection::Header if group.code == 9 => variable = group.keyword(),
                    DxfSection::Header if variable == "$INSUNITS" && group.code == 70 => self.units(group),
                    DxfSection::Entities if group.code != 999 => match &mut raw {
                        Some(raw) => raw.groups.push(group),
                        None => return self.broken(group, "expected the kind of an entity (group 0)"),
                    },
                    DxfSection::Outside if group.code != 999 => {
                        return self.broken(group, "expected a section (0, SECTION)");
                    }
                    _ => {}
                }
                continue;
            }
            if let Some(raw) = raw.take() {
                self.finish(&raw)?;
            }
            let keyword = group.keyword();
            match (section, keyword.as_str()) {
                (DxfSection::Outside, "SECTION") => {
                    section = DxfSection::Unnamed;
                    any_section = true;
                }
                (DxfSection::Outside, "EOF") => {
                    if !any_section || !entities_seen {
                        self.format(group.line, "the file has no ENTITIES section", "save the drawing again");
                    }
                    return Ok(());
                }
                (DxfSection::Outside, _) => return self.broken(group, "expected a section (0, SECTION)"),
                (DxfSection::Unnamed, _) => {
                    return self.broken(group, "expected the name of the section (group 2)");
                }
                (_, "ENDSEC") => section = DxfSection::Outside,
                (_, "SECTION" | "EOF") => {
                    return self.broken(group, "expected the end of the section before (ENDSEC)");
                }
                (DxfSection::Entities, _) => raw = Some(RawEntity::new(keyword, group.line)),
                _ => {}
            }
        }
        self.format(groups.line(), "the file ends without EOF", "the file is cut off: save or copy it again");
        Err(MalformedFile)
    }

    fn format(&mut self, line: usize, message: &str, remedy: &str) {
        self.diagnostics.error_at(MapErrorKind::Format, line, String::new(), message.to_owned(), remedy);
    }

    fn broken(&mut self, group: DxfGroup, due: &str) -> Result<(), MalformedFile> {
        let message = format!("{due}, found group {} \"{}\"", group.code, shown(group.value));
        self.format(group.line, &message, "the file is damaged: save it again");
        Err(MalformedFile)
    }

    fn units(&mut self, group: DxfGroup) {
        self.read.drawing.units = match group.keyword().as_str() {
            "0" => Units::Unitless,
            "1" => Units::Inches,
            "2" => Units::Feet,
            "4" => Units::Millimetres,
            "5" => Units::Centimetres,
            "6" => Units::Metres,
            _ => {
                let message = format!("$INSUNITS is \"{}\"", shown(group.value));
                let remedy = "use 1 inches, 2 feet, 4 millimetres, 5 centimetres, 6 metres or 0 (metres)";
                self.diagnostics.error_at(
                    MapErrorKind::Number,
                    group.line + 1,
                    String::new(),
                    message,
                    remedy,
                );
                return;
            }
        };
    }

    fn finish(&mut self, raw: &RawEntity) -> Result<(), MalformedFile> {
        if self.read.drawing.entities.len() + self.read.unsupported.len() >= MAX_ENTITIES {
            let message = format!("more than {MAX_ENTITIES} entities");
            let remedy = "keep only the map in the drawing";
            self.diagnostics.error_at(MapErrorKind::Size, raw.line, String::new(), message, remedy);
            return Err(MalformedFile);
        }
        self.take(raw);
        Ok(())
    }

    fn take(&mut self, raw: &RawEntity) {
        let header = EntityHeader::of(raw);
        // Parts of a preceding entity, and entities of paper space.
        if matches!(raw.kind.as_str(), "VERTEX" | "SEQEND" | "ATTRIB") || header.paper_space {
            return;
        }
        match raw.shape() {
            Ok(Some(shape)) => {
                let EntityHeader { layer, handle, .. } = header;
                self.read.drawing.entities.push(Entity { layer, shape, handle, line: raw.line });
            }
            Ok(None) => self.read.unsupported.push(UnsupportedEntity {
                kind: if raw.kind.len() <= 32 {
                    raw.kind.clone()
                } else {
                    "entity of a long name".to_owned()
                },
                layer: header.layer,
                handle: header.handle,
                line: raw.line,
                remedy: remedy_for(&raw.kind),
            }),
            Err(fault) => {
                let entity = format!("{} {}", raw.kind, header.handle).trim_end().to_owned();
                self.diagnostics.error_at(fault.kind, fault.line, entity, fault.message, fault.remedy);
            }
        }
    }
}

fn remedy_for(kind: &str) -> &'static str {
    match kind {
        "SPLINE" | "ELLIPSE" => "draw it with lines and circular arcs",
        "POLYLINE" => "convert it to an LWPOLYLINE (CONVERTPOLY, or save as release 2000)",
        "INSERT" => "explode the block (EXPLODE)",
        "ARC" | "CIRCLE" | "LWPOLYLINE" | "TEXT" | "MTEXT" => "lay it flat in the xy plane (FLATTEN)",
        _ => "draw it with LINE, ARC or LWPOLYLINE, or move it to a layer of another name",
    }
}

/// The properties that all entities share.
#[derive(Default)]
struct EntityHeader {
    layer: String,
    handle: String,
    paper_space: bool,
}

impl EntityHeader {
    fn of(raw: &RawEntity) -> Self {
        let mut header = Self { layer: "0".to_owned(), ..Self::default() };
        for group in raw.own_groups() {
            match group.code {
                5 => header.handle = decode(group.value.trim_ascii()).chars().take(16).collect(),
                8 => header.layer = decode(group.value.trim_ascii()),
                67 => header.paper_space = group.value.trim_ascii() == b"1",
                _ => {}
            }
        }
        header
    }
}

struct EntityError {
    kind: MapErrorKind,
    line: usize,
    message: String,
    remedy: &'static str,
}

/// An entity as a list of groups.
struct RawEntity<'a> {
    kind: String,
    line: usize,
    groups: Vec<DxfGroup<'a>>,
}

impl<'a> RawEntity<'a> {
    fn new(kind: String, line: usize) -> Self {
        Self { kind, line, groups: Vec::new() }
    }

    /// The groups of the entity itself, without those that applications have attached.
    fn own_groups(&self) -> impl Iterator<Item = &DxfGroup<'a>> {
        let mut foreign = false;
        self.groups.iter().filter(move |group| {
            if group.code == 102 {
                foreign = group.value.trim_ascii().starts_with(b"{");
                return false;
            }
            !foreign && group.code < 1000
        })
    }

    /// The last value of a group code.
    fn last(&self, code: i32) -> Option<&DxfGroup<'a>> {
        self.own_groups().filter(|group| group.code == code).last()
    }

    fn number(&self, code: i32) -> Result<f64, EntityError> {
        self.number_or(code, None)
    }

    fn number_or(&self, code: i32, default: Option<f64>) -> Result<f64, EntityError> {
        match (self.last(code), default) {
            (Some(group), _) => number(group),
            (None, Some(default)) => Ok(default),
            (None, None) => Err(EntityError {
                kind: MapErrorKind::Format,
                line: self.line,
                message: format!("group {code} is missing"),
                remedy: "the entity is damaged: draw it again",
            }),
        }
    }

    fn point(&self, code: i32) -> Result<DVec2, EntityError> {
        Ok(DVec2::new(self.number(code)?, self.number(code + 10)?))
    }

    fn positive(&self, code: i32, name: &str) -> Result<f64, EntityError> {
        let value = self.number(code)?;
        if value > 0.0 {
            return Ok(value);
        }
        Err(EntityError {
            kind: MapErrorKind::Degenerate,
            line: self.last(code).map_or(self.line, |group| group.line + 1),
            message: format!("the {name} is {value}"),
            remedy: "it must be greater than zero: draw the entity again",
        })
    }

    /// Whether the entity is mirrored: `Some(false)` seen from above, `Some(true)` from below, where its own
    /// x axis is mirrored (DXF reference, arbitrary axis algorithm), `None` if it is tilted.
    fn mirrored(&self) -> Result<Option<bool>, EntityError> {
        let normal = [
            self.number_or(210, Some(0.0))?,
            self.number_or(220, Some(0.0))?,
            self.number_or(230, Some(1.0))?,
        ];
        let flat = normal[0].abs() < 1e-9 && normal[1].abs() < 1e-9 && normal[2] != 0.0;
        Ok(flat.then_some(normal[2] < 0.0))
    }

    /// The shape; `None` for entities of other kinds and tilted ones.
    fn shape(&self) -> Result<Option<EntityShape>, EntityError> {
        if self.kind == "LINE" {
            // LINE alone is in world coordinates whatever its extrusion.
            return Ok(Some(EntityShape::Line { from: self.point(10)?, to: self.point(11)? }));
        }
        if !matches!(self.kind.as_str(), "ARC" | "CIRCLE" | "LWPOLYLINE" | "TEXT" | "MTEXT") {
            return Ok(None);
        }
        let Some(mirrored) = self.mirrored()? else { return Ok(None) };
        let place = |at: DVec2| if mirrored { DVec2::new(-at.x, at.y) } else { at };
        let shape = match self.kind.as_str() {
            "ARC" => {
                let (from, to) = (self.number(50)?, self.number(51)?);
                let (from_deg, to_deg) = if mirrored { (180.0 - to, 180.0 - from) } else { (from, to) };
                let radius = self.positive(40, "radius")?;
                EntityShape::Arc { centre: place(self.point(10)?), radius, from_deg, to_deg }
            }
            "CIRCLE" => {
                EntityShape::Circle { centre: place(self.point(10)?), radius: self.positive(40, "radius")? }
            }
            "LWPOLYLINE" => {
                let mut vertices = self.vertices()?;
                if mirrored {
                    for vertex in &mut vertices {
                        *vertex = PolyVertex { at: place(vertex.at), bulge: -vertex.bulge };
                    }
                }
                let closed = self.flags(70)? & 1 != 0;
                EntityShape::Polyline { vertices, closed }
            }
            "TEXT" => {
                // Justified text is placed at its second point, stretched text (3, 5) at its first.
                let (across, along) = (self.flags(72)?, self.flags(73)?);
                let justified = (across != 0 || along != 0) && !matches!(across, 3 | 5);
                let code = if justified && self.last(11).is_some() { 11 } else { 10 };
                let text = self.last(1).map(|group| decode(group.value)).unwrap_or_default();
                let height = self.number_or(40, Some(0.0))?;
                EntityShape::Text { at: place(self.point(code)?), height, text }
            }
            _ => {
                if mirrored {
                    return Ok(None);
                }
                let parts = self.own_groups().filter(|g| matches!(g.code, 1 | 3)).map(|g| decode(g.value));
                let text = without_formatting(&parts.collect::<String>());
                EntityShape::Text { at: self.point(10)?, height: self.number_or(40, Some(0.0))?, text }
            }
        };
        Ok(Some(shape))
    }

    fn flags(&self, code: i32) -> Result<i32, EntityError> {
        let Some(group) = self.last(code) else { return Ok(0) };
        group.keyword().parse().map_err(|_| EntityError {
            kind: MapErrorKind::Number,
            line: group.line + 1,
            message: format!("group {code} is \"{}\"", shown(group.value)),
            remedy: "it must be a whole number: the entity is damaged, draw it again",
        })
    }

    fn vertices(&self) -> Result<Vec<PolyVertex>, EntityError> {
        let damaged = |line: usize, message: String| EntityError {
            kind: MapErrorKind::Format,
            line,
            message,
            remedy: "the entity is damaged: draw it again",
        };
        let mut vertices: Vec<PolyVertex> = Vec::new();
        // The x of a vertex without its y yet.
        let mut open: Option<f64> = None;
        for group in self.own_groups() {
            match (group.code, open) {
                (10, None) => open = Some(number(group)?),
                (20, Some(x)) => {
                    vertices.push(PolyVertex { at: DVec2::new(x, number(group)?), bulge: 0.0 });
                    open = None;
                }
                (10, Some(_)) => return Err(damaged(group.line, "a vertex has no y (group 20)".to_owned())),
                (20, None) => {
                    return Err(damaged(group.line, "a y (group 20) without its x (group 10)".to_owned()));
                }
                (42, None) => match vertices.last_mut() {
                    Some(vertex) => vertex.bulge = number(group)?,
                    None => return Err(damaged(group.line, "a bulge before the first vertex".to_owned())),
                },
                _ => {}
            }
        }
        if open.is_some() {
            return Err(damaged(self.line, "the last vertex has no y (group 20)".to_owned()));
        }
        let stated = self.last(90).map(DxfGroup::keyword);
        if let Some(stated) = stated.filter(|stated| *stated != vertices.len().to_string()) {
            let message =
                format!("{} vertices, the entity states {}", vertices.len(), shown(stated.as_bytes()));
            return Err(damaged(self.line, message));
        }
        Ok(vertices)
    }
}

fn number(group: &DxfGroup) -> Result<f64, EntityError> {
    let fault = |found: &str| EntityError {
        kind: MapErrorKind::Number,
        line: group.line + 1,
        message: format!("group {} is \"{}\", {found}", group.code, shown(group.value)),
        remedy: "it must be a finite number: draw the entity again",
    };
    let value: f64 = group.keyword().parse().map_err(|_| fault("not a number"))?;
    match value {
        _ if value.is_finite() => Ok(value),
        _ if value.is_nan() => Err(fault("not a number")),
        _ => Err(fault("not finite")),
    }
}
