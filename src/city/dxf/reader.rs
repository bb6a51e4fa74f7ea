//! Reading a DXF file into a [`Drawing`]: sections, entities and their numbers, each with its line.

use super::groups::{Broken, Group, Groups, shown};
use super::text::{decode, without_formatting};
use super::{Drawing, Entity, PolyVertex, Shape, Units};
use crate::city::error::{Findings, MapErrorKind, MapErrors};
use glam::DVec2;

/// An entity that stands in the drawing and is of no kind that maps are made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unread {
    /// As the file calls it: "SPLINE".
    pub kind: String,
    pub layer: String,
    pub handle: String,
    pub line: usize,
    /// What its author could draw instead.
    pub remedy: &'static str,
}

/// A drawing and what of the file is not in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadDrawing {
    pub drawing: Drawing,
    pub unread: Vec<Unread>,
}

impl Drawing {
    /// Reads the model space of an ASCII DXF file.
    ///
    /// Takes LINE, ARC, LWPOLYLINE, CIRCLE, TEXT and MTEXT; heights above the plane are ignored.
    /// Entities of other kinds are left out; [`ReadDrawing::parse`] tells which.
    ///
    /// # Errors
    /// A file that is not ASCII DXF or is cut off, numbers that are none or not finite, entities
    /// that lack a coordinate.
    pub fn parse(bytes: &[u8]) -> Result<Self, MapErrors> {
        ReadDrawing::parse(bytes).map(|read| read.drawing)
    }
}

impl ReadDrawing {
    /// As [`Drawing::parse`], and keeps account of what was left out.
    ///
    /// # Errors
    /// The same.
    pub fn parse(bytes: &[u8]) -> Result<Self, MapErrors> {
        let mut reader = Reader::default();
        // What broke the file off is among the findings.
        let _ = reader.read(bytes);
        reader.findings.check()?;
        Ok(reader.read)
    }
}

/// Most entities that a drawing may have, of all kinds and layers.
pub const MAX_ENTITIES: usize = 500_000;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Section {
    Outside,
    /// After `0 SECTION`, before its name.
    Unnamed,
    Header,
    Entities,
    Other,
}

#[derive(Default)]
struct Reader {
    read: ReadDrawing,
    findings: Findings,
}

impl Reader {
    fn read(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        let mut groups = Groups::new(bytes, &mut self.findings)?;
        let mut section = Section::Outside;
        let mut any_section = false;
        let mut entities_seen = false;
        let mut variable = String::new();
        let mut raw: Option<Raw> = None;
        while let Some(group) = groups.next(&mut self.findings)? {
            if group.code != 0 {
                match section {
                    Section::Unnamed if group.code == 2 => {
                        section = match group.keyword().as_str() {
                            "HEADER" => Section::Header,
                            "ENTITIES" => Section::Entities,
                            _ => Section::Other,
                        };
                        entities_seen |= section == Section::Entities;
                    }
                    Section::Unnamed if group.code != 999 => {
                        return self.broken(group, "the name of the section (group 2) is due");
                    }
                    Section::Header if group.code == 9 => variable = group.keyword(),
                    Section::Header if variable == "$INSUNITS" && group.code == 70 => self.units(group),
                    Section::Entities if group.code != 999 => match &mut raw {
                        Some(raw) => raw.groups.push(group),
                        None => return self.broken(group, "the kind of an entity (group 0) is due"),
                    },
                    Section::Outside if group.code != 999 => {
                        return self.broken(group, "a section (0, SECTION) is due");
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
                (Section::Outside, "SECTION") => {
                    section = Section::Unnamed;
                    any_section = true;
                }
                (Section::Outside, "EOF") => {
                    if !any_section || !entities_seen {
                        self.format(group.line, "the file has no ENTITIES section", "save the drawing again");
                    }
                    return Ok(());
                }
                (Section::Outside, _) => return self.broken(group, "a section (0, SECTION) is due"),
                (Section::Unnamed, _) => {
                    return self.broken(group, "the name of the section (group 2) is due");
                }
                (_, "ENDSEC") => section = Section::Outside,
                (_, "SECTION" | "EOF") => {
                    return self.broken(group, "the section before is not ended (ENDSEC)");
                }
                (Section::Entities, _) => raw = Some(Raw::new(keyword, group.line)),
                _ => {}
            }
        }
        self.format(groups.line(), "the file ends without EOF", "the file is cut off: save or copy it again");
        Err(Broken)
    }

    fn format(&mut self, line: usize, message: &str, remedy: &str) {
        self.findings.error_at(MapErrorKind::Format, line, String::new(), message.to_owned(), remedy);
    }

    fn broken(&mut self, group: Group, due: &str) -> Result<(), Broken> {
        let message = format!("{due}, found group {} \"{}\"", group.code, shown(group.value));
        self.format(group.line, &message, "the file is damaged: save it again");
        Err(Broken)
    }

    fn units(&mut self, group: Group) {
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
                self.findings.error_at(MapErrorKind::Number, group.line + 1, String::new(), message, remedy);
                return;
            }
        };
    }

    fn finish(&mut self, raw: &Raw) -> Result<(), Broken> {
        if self.read.drawing.entities.len() + self.read.unread.len() >= MAX_ENTITIES {
            let message = format!("more than {MAX_ENTITIES} entities");
            let remedy = "keep only the map in the drawing";
            self.findings.error_at(MapErrorKind::Size, raw.line, String::new(), message, remedy);
            return Err(Broken);
        }
        self.take(raw);
        Ok(())
    }

    fn take(&mut self, raw: &Raw) {
        let head = Head::of(raw);
        // Parts of an entity that went before, and drawings of a sheet rather than of the map.
        if matches!(raw.kind.as_str(), "VERTEX" | "SEQEND" | "ATTRIB") || head.paper_space {
            return;
        }
        match raw.shape() {
            Ok(Some(shape)) => {
                let Head { layer, handle, .. } = head;
                self.read.drawing.entities.push(Entity { layer, shape, handle, line: raw.line });
            }
            Ok(None) => self.read.unread.push(Unread {
                kind: if raw.kind.len() <= 32 {
                    raw.kind.clone()
                } else {
                    "entity of a long name".to_owned()
                },
                layer: head.layer,
                handle: head.handle,
                line: raw.line,
                remedy: remedy_for(&raw.kind),
            }),
            Err(fault) => {
                let entity = format!("{} {}", raw.kind, head.handle).trim_end().to_owned();
                self.findings.error_at(fault.kind, fault.line, entity, fault.message, fault.remedy);
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

/// What all entities have.
#[derive(Default)]
struct Head {
    layer: String,
    handle: String,
    paper_space: bool,
}

impl Head {
    fn of(raw: &Raw) -> Self {
        let mut head = Self { layer: "0".to_owned(), ..Self::default() };
        for group in raw.own_groups() {
            match group.code {
                5 => head.handle = decode(group.value.trim_ascii()).chars().take(16).collect(),
                8 => head.layer = decode(group.value.trim_ascii()),
                67 => head.paper_space = group.value.trim_ascii() == b"1",
                _ => {}
            }
        }
        head
    }
}

struct Fault {
    kind: MapErrorKind,
    line: usize,
    message: String,
    remedy: &'static str,
}

/// An entity as the file has it.
struct Raw<'a> {
    kind: String,
    line: usize,
    groups: Vec<Group<'a>>,
}

impl<'a> Raw<'a> {
    fn new(kind: String, line: usize) -> Self {
        Self { kind, line, groups: Vec::new() }
    }

    /// The groups of the entity itself, without what applications have hung on it.
    fn own_groups(&self) -> impl Iterator<Item = &Group<'a>> {
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
    fn last(&self, code: i32) -> Option<&Group<'a>> {
        self.own_groups().filter(|group| group.code == code).last()
    }

    fn number(&self, code: i32) -> Result<f64, Fault> {
        self.number_or(code, None)
    }

    fn number_or(&self, code: i32, default: Option<f64>) -> Result<f64, Fault> {
        match (self.last(code), default) {
            (Some(group), _) => number(group),
            (None, Some(default)) => Ok(default),
            (None, None) => Err(Fault {
                kind: MapErrorKind::Format,
                line: self.line,
                message: format!("group {code} is missing"),
                remedy: "the entity is damaged: draw it again",
            }),
        }
    }

    fn point(&self, code: i32) -> Result<DVec2, Fault> {
        Ok(DVec2::new(self.number(code)?, self.number(code + 10)?))
    }

    fn positive(&self, code: i32, name: &str) -> Result<f64, Fault> {
        let value = self.number(code)?;
        if value > 0.0 {
            return Ok(value);
        }
        Err(Fault {
            kind: MapErrorKind::Degenerate,
            line: self.last(code).map_or(self.line, |group| group.line + 1),
            message: format!("the {name} is {value}"),
            remedy: "it must be greater than zero: draw the entity again",
        })
    }

    /// The side from which the entity is seen: `Some(false)` from above, `Some(true)` from below,
    /// which mirrors its own x axis (DXF reference, arbitrary axis algorithm), `None` if it is tilted.
    fn mirrored(&self) -> Result<Option<bool>, Fault> {
        let normal = [
            self.number_or(210, Some(0.0))?,
            self.number_or(220, Some(0.0))?,
            self.number_or(230, Some(1.0))?,
        ];
        let flat = normal[0].abs() < 1e-9 && normal[1].abs() < 1e-9 && normal[2] != 0.0;
        Ok(flat.then_some(normal[2] < 0.0))
    }

    /// The shape; `None` of entities of other kinds and of tilted ones.
    fn shape(&self) -> Result<Option<Shape>, Fault> {
        if self.kind == "LINE" {
            // The only one of them in world coordinates whatever its extrusion.
            return Ok(Some(Shape::Line { from: self.point(10)?, to: self.point(11)? }));
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
                Shape::Arc { centre: place(self.point(10)?), radius, from_deg, to_deg }
            }
            "CIRCLE" => {
                Shape::Circle { centre: place(self.point(10)?), radius: self.positive(40, "radius")? }
            }
            "LWPOLYLINE" => {
                let mut vertices = self.vertices()?;
                if mirrored {
                    for vertex in &mut vertices {
                        *vertex = PolyVertex { at: place(vertex.at), bulge: -vertex.bulge };
                    }
                }
                let closed = self.flags(70)? & 1 != 0;
                Shape::Polyline { vertices, closed }
            }
            "TEXT" => {
                // Text that is justified stands at its second point, stretched text (3, 5) at its first.
                let (across, along) = (self.flags(72)?, self.flags(73)?);
                let justified = (across != 0 || along != 0) && !matches!(across, 3 | 5);
                let code = if justified && self.last(11).is_some() { 11 } else { 10 };
                let text = self.last(1).map(|group| decode(group.value)).unwrap_or_default();
                let height = self.number_or(40, Some(0.0))?;
                Shape::Text { at: place(self.point(code)?), height, text }
            }
            _ => {
                if mirrored {
                    return Ok(None);
                }
                let parts = self.own_groups().filter(|g| matches!(g.code, 1 | 3)).map(|g| decode(g.value));
                let text = without_formatting(&parts.collect::<String>());
                Shape::Text { at: self.point(10)?, height: self.number_or(40, Some(0.0))?, text }
            }
        };
        Ok(Some(shape))
    }

    fn flags(&self, code: i32) -> Result<i32, Fault> {
        let Some(group) = self.last(code) else { return Ok(0) };
        group.keyword().parse().map_err(|_| Fault {
            kind: MapErrorKind::Number,
            line: group.line + 1,
            message: format!("group {code} is \"{}\"", shown(group.value)),
            remedy: "a whole number is due: the entity is damaged, draw it again",
        })
    }

    fn vertices(&self) -> Result<Vec<PolyVertex>, Fault> {
        let damaged = |line: usize, message: String| Fault {
            kind: MapErrorKind::Format,
            line,
            message,
            remedy: "the entity is damaged: draw it again",
        };
        let mut vertices: Vec<PolyVertex> = Vec::new();
        // The x of a vertex whose y is still due.
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
        let stated = self.last(90).map(Group::keyword);
        if let Some(stated) = stated.filter(|stated| *stated != vertices.len().to_string()) {
            let message =
                format!("{} vertices, the entity states {}", vertices.len(), shown(stated.as_bytes()));
            return Err(damaged(self.line, message));
        }
        Ok(vertices)
    }
}

fn number(group: &Group) -> Result<f64, Fault> {
    let fault = |found: &str| Fault {
        kind: MapErrorKind::Number,
        line: group.line + 1,
        message: format!("group {} is \"{}\", {found}", group.code, shown(group.value)),
        remedy: "a finite number is due: draw the entity again",
    };
    let value: f64 = group.keyword().parse().map_err(|_| fault("not a number"))?;
    match value {
        _ if value.is_finite() => Ok(value),
        _ if value.is_nan() => Err(fault("not a number")),
        _ => Err(fault("not finite")),
    }
}
