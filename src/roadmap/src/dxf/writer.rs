//! Writes drawings as ASCII DXF of release 2000 (AC1015), complete enough for CAD programs to open without
//! repair.

use super::text::encode;
use super::{Drawing, Entity, EntityShape, Units};
use crate::layers;
use glam::DVec2;
use std::collections::BTreeSet;
use std::fmt::{Display, Write};

impl Drawing {
    /// The drawing as the text of a DXF file.
    ///
    /// Numbers are the shortest that parse to the same `f64`. Hexadecimal, unique handles are kept; other
    /// entities get new ones. Text is ASCII, other characters as `\U+XXXX`. Numbers that are not finite are
    /// written as they are; [`Drawing::parse`] rejects them.
    pub fn to_dxf(&self) -> String {
        let mut handles = HandleAllocator::of(&self.entities);
        let fixed = FixedHandles::new(&mut handles);
        let entity_handles: Vec<u64> =
            self.entities.iter().map(|entity| handles.keep_or_next(&entity.handle)).collect();

        // The header is written last, since it states the next free handle.
        let mut body = DxfWriter::default();
        let bounds = self.bounds();
        body.tables(&self.layers(), bounds, &fixed, &mut handles);
        body.blocks(&fixed, &mut handles);
        body.section("ENTITIES");
        for (entity, &handle) in self.entities.iter().zip(&entity_handles) {
            body.entity(entity, handle, fixed.model_space);
        }
        body.group(0, "ENDSEC");
        body.objects(&fixed, &mut handles);
        body.group(0, "EOF");

        let mut file = DxfWriter::default();
        file.header(self.units, bounds, handles.seed());
        file.0.push_str(&body.0);
        file.0
    }

    /// Layers in the order of their first use, the layer `0` first.
    fn layers(&self) -> Vec<&str> {
        let mut seen = BTreeSet::from(["0".to_owned()]);
        let mut layers = vec!["0"];
        for entity in &self.entities {
            if seen.insert(entity.layer.to_uppercase()) {
                layers.push(&entity.layer);
            }
        }
        layers
    }

    /// Corners of a box around all points and circles; arcs count as their circle.
    fn bounds(&self) -> [DVec2; 2] {
        let mut low = DVec2::splat(f64::INFINITY);
        let mut high = DVec2::splat(f64::NEG_INFINITY);
        let mut add = |at: DVec2, margin: f64| {
            if at.is_finite() && margin.is_finite() {
                low = low.min(at - margin);
                high = high.max(at + margin);
            }
        };
        for entity in &self.entities {
            match &entity.shape {
                EntityShape::Line { from, to } => [from, to].into_iter().for_each(|&p| add(p, 0.0)),
                EntityShape::Arc { centre, radius, .. } | EntityShape::Circle { centre, radius } => {
                    add(*centre, *radius);
                }
                EntityShape::Polyline { vertices, .. } => vertices.iter().for_each(|v| add(v.at, 0.0)),
                EntityShape::Text { at, .. } => add(*at, 0.0),
            }
        }
        if low.is_finite() && high.is_finite() { [low, high] } else { [DVec2::ZERO, DVec2::ONE] }
    }
}

/// Allocates handles that no entity has claimed.
struct HandleAllocator {
    claimed: BTreeSet<u64>,
    kept: BTreeSet<u64>,
    last: u64,
}

/// Larger handles than this are not kept, so that counting on from them cannot overflow.
const LARGEST_HANDLE: u64 = 1 << 60;

impl HandleAllocator {
    fn of(entities: &[Entity]) -> Self {
        let claimed = entities.iter().filter_map(|e| parse_handle(&e.handle)).collect();
        Self { claimed, kept: BTreeSet::new(), last: 0 }
    }

    fn next(&mut self) -> u64 {
        self.last += 1;
        while self.claimed.contains(&self.last) {
            self.last += 1;
        }
        self.last
    }

    fn keep_or_next(&mut self, handle: &str) -> u64 {
        match parse_handle(handle) {
            Some(handle) if self.kept.insert(handle) => handle,
            _ => self.next(),
        }
    }

    fn seed(&self) -> u64 {
        self.last.max(self.claimed.last().copied().unwrap_or(0)) + 1
    }
}

fn parse_handle(handle: &str) -> Option<u64> {
    u64::from_str_radix(handle, 16).ok().filter(|h| (1..LARGEST_HANDLE).contains(h))
}

/// Handles that several sections refer to.
struct FixedHandles {
    block_records: u64,
    model_space: u64,
    paper_space: u64,
    root: u64,
    plot_style: u64,
    model_layout: u64,
    paper_layout: u64,
}

impl FixedHandles {
    fn new(handles: &mut HandleAllocator) -> Self {
        Self {
            block_records: handles.next(),
            model_space: handles.next(),
            paper_space: handles.next(),
            root: handles.next(),
            plot_style: handles.next(),
            model_layout: handles.next(),
            paper_layout: handles.next(),
        }
    }
}

#[derive(Default)]
struct DxfWriter(String);

impl DxfWriter {
    fn group(&mut self, code: u16, value: impl Display) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "{code:>3}\n{value}");
    }

    fn number(&mut self, code: u16, value: f64) {
        self.group(code, format_args!("{value:?}"));
    }

    fn handle(&mut self, code: u16, handle: u64) {
        self.group(code, format_args!("{handle:X}"));
    }

    /// A point; `code` is that of its x. DXF wants a z almost everywhere.
    fn point(&mut self, code: u16, at: DVec2) {
        self.number(code, at.x);
        self.number(code + 10, at.y);
        self.number(code + 20, 0.0);
    }

    fn section(&mut self, name: &str) {
        self.group(0, "SECTION");
        self.group(2, name);
    }

    fn header(&mut self, units: Units, [low, high]: [DVec2; 2], seed: u64) {
        let code = match units {
            Units::Unitless => 0,
            Units::Inches => 1,
            Units::Feet => 2,
            Units::Millimetres => 4,
            Units::Centimetres => 5,
            Units::Metres => 6,
        };
        self.section("HEADER");
        self.group(9, "$ACADVER");
        self.group(1, "AC1015");
        self.group(9, "$DWGCODEPAGE");
        self.group(3, "ANSI_1252");
        self.group(9, "$INSUNITS");
        self.group(70, code);
        self.group(9, "$MEASUREMENT");
        self.group(70, u8::from(!matches!(units, Units::Inches | Units::Feet)));
        self.group(9, "$EXTMIN");
        self.point(10, low);
        self.group(9, "$EXTMAX");
        self.point(10, high);
        self.group(9, "$HANDSEED");
        self.handle(5, seed);
        self.group(0, "ENDSEC");
    }

    fn table(&mut self, name: &str, handle: u64, records: usize) {
        self.group(0, "TABLE");
        self.group(2, name);
        self.handle(5, handle);
        self.group(330, 0);
        self.group(100, "AcDbSymbolTable");
        self.group(70, records);
    }

    fn record(&mut self, kind: &str, handle: u64, table: u64) {
        self.group(0, kind);
        self.handle(if kind == "DIMSTYLE" { 105 } else { 5 }, handle);
        self.handle(330, table);
        self.group(100, "AcDbSymbolTableRecord");
    }

    fn tables(
        &mut self,
        layers: &[&str],
        bounds: [DVec2; 2],
        fixed: &FixedHandles,
        handles: &mut HandleAllocator,
    ) {
        self.section("TABLES");

        let table = handles.next();
        self.table("VPORT", table, 1);
        self.view(bounds, table, handles);
        self.group(0, "ENDTAB");

        let table = handles.next();
        self.table("LTYPE", table, 3);
        for (name, description) in [("ByBlock", ""), ("ByLayer", ""), ("Continuous", "Solid line")] {
            self.record("LTYPE", handles.next(), table);
            self.group(100, "AcDbLinetypeTableRecord");
            self.group(2, name);
            self.group(70, 0);
            self.group(3, description);
            self.group(72, 65);
            self.group(73, 0);
            self.number(40, 0.0);
        }
        self.group(0, "ENDTAB");

        let table = handles.next();
        self.table("LAYER", table, layers.len());
        for layer in layers {
            self.record("LAYER", handles.next(), table);
            self.group(100, "AcDbLayerTableRecord");
            self.group(2, encode(layer));
            self.group(70, 0);
            self.group(62, layers::colour(layer));
            self.group(6, "Continuous");
            self.group(370, -3);
            self.handle(390, fixed.plot_style);
        }
        self.group(0, "ENDTAB");

        let table = handles.next();
        self.table("STYLE", table, 1);
        self.record("STYLE", handles.next(), table);
        self.group(100, "AcDbTextStyleTableRecord");
        self.group(2, "Standard");
        self.group(70, 0);
        for (code, value) in [(40, 0.0), (41, 1.0), (50, 0.0)] {
            self.number(code, value);
        }
        self.group(71, 0);
        self.number(42, 1.0);
        self.group(3, "txt");
        self.group(4, "");
        self.group(0, "ENDTAB");

        for empty in ["VIEW", "UCS"] {
            self.table(empty, handles.next(), 0);
            self.group(0, "ENDTAB");
        }

        let table = handles.next();
        self.table("APPID", table, 1);
        self.record("APPID", handles.next(), table);
        self.group(100, "AcDbRegAppTableRecord");
        self.group(2, "ACAD");
        self.group(70, 0);
        self.group(0, "ENDTAB");

        let table = handles.next();
        self.table("DIMSTYLE", table, 1);
        self.group(100, "AcDbDimStyleTable");
        self.group(71, 0);
        self.record("DIMSTYLE", handles.next(), table);
        self.group(100, "AcDbDimStyleTableRecord");
        self.group(2, "Standard");
        self.group(70, 0);
        self.group(0, "ENDTAB");

        self.table("BLOCK_RECORD", fixed.block_records, 2);
        for (name, handle, layout) in [
            ("*Model_Space", fixed.model_space, fixed.model_layout),
            ("*Paper_Space", fixed.paper_space, fixed.paper_layout),
        ] {
            self.record("BLOCK_RECORD", handle, fixed.block_records);
            self.group(100, "AcDbBlockTableRecord");
            self.group(2, name);
            self.handle(340, layout);
        }
        self.group(0, "ENDTAB");
        self.group(0, "ENDSEC");
    }

    /// The initial view: the whole drawing with a margin.
    fn view(&mut self, [low, high]: [DVec2; 2], table: u64, handles: &mut HandleAllocator) {
        let size = (high - low).max(DVec2::splat(1e-3));
        self.record("VPORT", handles.next(), table);
        self.group(100, "AcDbViewportTableRecord");
        self.group(2, "*Active");
        self.group(70, 0);
        let pairs = [
            (10, DVec2::ZERO),
            (11, DVec2::ONE),
            (12, (low + high) / 2.0),
            (13, DVec2::ZERO),
            (14, DVec2::ONE),
            (15, DVec2::ONE),
        ];
        for (code, at) in pairs {
            self.number(code, at.x);
            self.number(code + 10, at.y);
        }
        // Seen from straight above.
        for (code, value) in [(16, 0.0), (26, 0.0), (36, 1.0), (17, 0.0), (27, 0.0), (37, 0.0)] {
            self.number(code, value);
        }
        const ASPECT: f64 = 1.5;
        self.number(40, size.y.max(size.x / ASPECT) * 1.05);
        self.number(41, ASPECT);
        self.number(42, 50.0);
    }

    fn blocks(&mut self, fixed: &FixedHandles, handles: &mut HandleAllocator) {
        self.section("BLOCKS");
        for (name, record, paper) in
            [("*Model_Space", fixed.model_space, false), ("*Paper_Space", fixed.paper_space, true)]
        {
            for end in [false, true] {
                self.group(0, if end { "ENDBLK" } else { "BLOCK" });
                self.handle(5, handles.next());
                self.handle(330, record);
                self.group(100, "AcDbEntity");
                if paper {
                    self.group(67, 1);
                }
                self.group(8, "0");
                self.group(100, if end { "AcDbBlockEnd" } else { "AcDbBlockBegin" });
                if !end {
                    self.group(2, name);
                    self.group(70, 0);
                    self.point(10, DVec2::ZERO);
                    self.group(3, name);
                    self.group(1, "");
                }
            }
        }
        self.group(0, "ENDSEC");
    }

    fn entity(&mut self, entity: &Entity, handle: u64, owner: u64) {
        self.group(
            0,
            match entity.shape {
                EntityShape::Line { .. } => "LINE",
                EntityShape::Arc { .. } => "ARC",
                EntityShape::Polyline { .. } => "LWPOLYLINE",
                EntityShape::Circle { .. } => "CIRCLE",
                EntityShape::Text { .. } => "TEXT",
            },
        );
        self.handle(5, handle);
        self.handle(330, owner);
        self.group(100, "AcDbEntity");
        self.group(8, encode(&entity.layer));
        match &entity.shape {
            EntityShape::Line { from, to } => {
                self.group(100, "AcDbLine");
                self.point(10, *from);
                self.point(11, *to);
            }
            EntityShape::Arc { centre, radius, from_deg, to_deg } => {
                self.circle(*centre, *radius);
                self.group(100, "AcDbArc");
                self.number(50, *from_deg);
                self.number(51, *to_deg);
            }
            EntityShape::Circle { centre, radius } => self.circle(*centre, *radius),
            EntityShape::Polyline { vertices, closed } => {
                self.group(100, "AcDbPolyline");
                self.group(90, vertices.len());
                self.group(70, u8::from(*closed));
                for vertex in vertices {
                    self.number(10, vertex.at.x);
                    self.number(20, vertex.at.y);
                    if vertex.bulge != 0.0 {
                        self.number(42, vertex.bulge);
                    }
                }
            }
            EntityShape::Text { at, height, text } => {
                self.group(100, "AcDbText");
                self.point(10, *at);
                self.number(40, *height);
                self.group(1, encode(text));
                self.group(100, "AcDbText");
            }
        }
    }

    fn circle(&mut self, centre: DVec2, radius: f64) {
        self.group(100, "AcDbCircle");
        self.point(10, centre);
        self.number(40, radius);
    }

    fn objects(&mut self, fixed: &FixedHandles, handles: &mut HandleAllocator) {
        let (group, layouts, plot_styles) = (handles.next(), handles.next(), handles.next());
        self.section("OBJECTS");
        self.dictionary(
            fixed.root,
            0,
            &[("ACAD_GROUP", group), ("ACAD_LAYOUT", layouts), ("ACAD_PLOTSTYLENAME", plot_styles)],
        );
        self.dictionary(group, fixed.root, &[]);
        self.dictionary(
            layouts,
            fixed.root,
            &[("Model", fixed.model_layout), ("Layout1", fixed.paper_layout)],
        );
        self.layout("Model", fixed.model_layout, layouts, fixed.model_space);
        self.layout("Layout1", fixed.paper_layout, layouts, fixed.paper_space);

        self.group(0, "ACDBDICTIONARYWDFLT");
        self.handle(5, plot_styles);
        self.handle(330, fixed.root);
        self.group(100, "AcDbDictionary");
        self.group(281, 1);
        self.group(3, "Normal");
        self.handle(350, fixed.plot_style);
        self.group(100, "AcDbDictionaryWithDefault");
        self.handle(340, fixed.plot_style);
        self.group(0, "ACDBPLACEHOLDER");
        self.handle(5, fixed.plot_style);
        self.handle(330, plot_styles);
        self.group(0, "ENDSEC");
    }

    fn dictionary(&mut self, handle: u64, owner: u64, entries: &[(&str, u64)]) {
        self.group(0, "DICTIONARY");
        self.handle(5, handle);
        self.handle(330, owner);
        self.group(100, "AcDbDictionary");
        self.group(281, 1);
        for &(name, entry) in entries {
            self.group(3, name);
            self.handle(350, entry);
        }
    }

    fn layout(&mut self, name: &str, handle: u64, owner: u64, block_record: u64) {
        let model = name == "Model";
        self.group(0, "LAYOUT");
        self.handle(5, handle);
        self.handle(330, owner);
        self.group(100, "AcDbPlotSettings");
        self.group(1, "");
        self.group(4, "A3");
        self.group(6, "");
        for (code, value) in [(40, 7.5), (41, 20.0), (42, 7.5), (43, 20.0), (44, 420.0), (45, 297.0)] {
            self.number(code, value);
        }
        // 1024: a model layout.
        self.group(70, if model { 1024 } else { 0 });
        self.group(100, "AcDbLayout");
        self.group(1, name);
        self.group(70, 1);
        self.group(71, u8::from(!model));
        for (code, value) in [(10, 0.0), (20, 0.0), (11, 420.0), (21, 297.0)] {
            self.number(code, value);
        }
        for (code, at) in [(12, DVec2::ZERO), (14, DVec2::ZERO), (15, DVec2::ZERO), (13, DVec2::ZERO)] {
            self.point(code, at);
        }
        // The layout's axes are the world's.
        self.point(16, DVec2::X);
        self.point(17, DVec2::Y);
        self.group(76, 0);
        self.handle(330, block_record);
    }
}
