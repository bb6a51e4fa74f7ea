//! Builds a road map from a drawing: entities become pieces, pieces a graph, and the graph lanes and conflict
//! zones.
//!
//! `docs/maps.md` documents this for map authors.

mod directions;
mod labels;
mod lanes;
mod lines;
mod neighbours;
pub(super) mod network;
pub(super) mod pieces;
mod scenery;
mod zones;

use super::dxf::{Drawing, Entity, ParsedDrawing};
use super::error::{Diagnostics, MapErrorKind, MapErrors, MapNote};
use super::{LabMap, Lane, LaneKind, RoadMap, layers};
use city3d_geometry::Lab;
use glam::DVec2;
use std::collections::BTreeMap;

/// Width of every lane: that of the testbed.
pub const LANE_WIDTH_M: f64 = 0.1524;
/// Ends closer than this are one point; moving them together is reported unless they are closer
/// than `SILENT_JOIN_M`.
pub const JOIN_TOLERANCE_M: f64 = 1e-3;
/// Ends closer than this are joined without a note.
pub const SILENT_JOIN_M: f64 = 1e-6;
/// Texts, arrows and gaps belong to a lane up to this distance.
pub const REACH_M: f64 = LANE_WIDTH_M / 2.0;
/// Headings at a joint may differ by this much.
pub const KINK_TOLERANCE_DEG: f64 = 1.0;
/// Posted speed where the drawing states none.
pub const DEFAULT_SPEED_MPS: f64 = 0.5;
/// Largest distance of a coordinate from the origin: 25 km at full scale.
pub const MAX_COORDINATE_M: f64 = 1000.0;
/// Most pieces of lanes, that a map may have.
pub const MAX_PIECES: usize = 5000;
/// Most entities on any layer that the map uses.
pub const MAX_ENTITIES_OF_LAYER: usize = 5000;
/// Largest sum of the lengths of all lanes, laboratory metres.
pub const MAX_LANES_LENGTH_M: f64 = 10_000.0;

/// A map, and notes for its author.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedMap {
    /// The map in laboratory metres.
    pub map: LabMap,
    /// What the author may want to know; empty if there is nothing to report.
    pub notes: Vec<MapNote>,
}

/// Reads a map from the bytes of an ASCII DXF file.
///
/// # Errors
/// All errors of the drawing, each with line, entity, finding and remedy. Errors of the file hide those of
/// the lanes, and errors of the lanes those of texts and lines.
pub fn load_map(bytes: &[u8]) -> Result<LoadedMap, MapErrors> {
    build_map(&ParsedDrawing::parse(bytes)?)
}

/// Builds a map from a drawing in memory.
///
/// # Errors
/// As [`load_map`]. Entities of a drawing in memory have no lines, and handles only where given.
pub fn map_of_drawing(drawing: &Drawing) -> Result<LoadedMap, MapErrors> {
    build_map(&ParsedDrawing { drawing: drawing.clone(), unsupported: Vec::new() })
}

/// Entities in file order by layer, layer names in capitals.
type EntitiesByLayer<'a> = BTreeMap<String, Vec<&'a Entity>>;

fn build_map(read: &ParsedDrawing) -> Result<LoadedMap, MapErrors> {
    let mut diagnostics = Diagnostics::default();
    let metres = read.drawing.units.metres();
    let mut by_layer = EntitiesByLayer::new();
    for entity in &read.drawing.entities {
        by_layer.entry(entity.layer.to_ascii_uppercase()).or_default().push(entity);
    }
    check_layers(&by_layer, read, &mut diagnostics);
    diagnostics.check_size()?;
    let scenery = scenery::build(&by_layer, metres, &mut diagnostics);
    let models = scenery::models(&by_layer, metres, &mut diagnostics);

    let pieces = pieces::build(&read.drawing, metres, &mut diagnostics);
    diagnostics.check()?;
    let mut network = network::PieceGraph::join(pieces, &read.drawing, &mut diagnostics);
    diagnostics.check()?;
    let arrows = pieces::lines_of(&by_layer, layers::ARROWS, metres, &mut diagnostics);
    directions::assign(&mut network, &arrows, &read.drawing, &mut diagnostics);
    diagnostics.check()?;
    let mut roads = lanes::build(&network, &read.drawing, &mut diagnostics);
    labels::apply(&mut roads, &by_layer, metres, &mut diagnostics);
    let lines = lines::build(&roads.lanes, &by_layer, metres, &mut diagnostics);
    let signals = lines::signal_heads(&roads.lanes, &by_layer, metres, &mut diagnostics);
    diagnostics.check()?;

    neighbours::link(&mut roads.lanes);
    let zones = zones::find(&roads, &mut diagnostics);
    diagnostics.check()?;
    let mut map = RoadMap::new(roads.lanes, zones, lines, scenery);
    (map.models, map.signals) = (models, signals);
    Ok(LoadedMap { map, notes: diagnostics.notes })
}

/// Whether a point is within the permitted coordinates.
fn in_map(at: DVec2) -> bool {
    at.is_finite() && at.abs().max_element() <= MAX_COORDINATE_M
}

/// The kind of lane that a layer holds, if it holds lanes.
pub(super) fn lane_kind(layer: &str) -> Option<LaneKind> {
    if layer.eq_ignore_ascii_case(layers::LANES) {
        Some(LaneKind::Lane)
    } else if layer.eq_ignore_ascii_case(layers::CONNECTORS) {
        Some(LaneKind::Connector)
    } else {
        None
    }
}

fn is_known(layer: &str) -> bool {
    const KNOWN: [&str; 9] = [
        layers::LANES,
        layers::CONNECTORS,
        layers::STOP_LINES,
        layers::YIELD_LINES,
        layers::SIGNALS,
        layers::ARROWS,
        layers::NAMES,
        layers::SPEEDS,
        layers::MODELS,
    ];
    KNOWN.contains(&layer) || layers::scenery_kind(layer).is_some()
}

/// Checks layer names. Unsupported entities are errors on layers that the map uses, and are only counted
/// elsewhere. Unknown layers are counted; those that look like scenery are errors.
fn check_layers(by_layer: &EntitiesByLayer, read: &ParsedDrawing, diagnostics: &mut Diagnostics) {
    let mut ignored: BTreeMap<String, usize> = BTreeMap::new();
    for (layer, entities) in by_layer {
        if is_known(layer) {
            if entities.len() > MAX_ENTITIES_OF_LAYER {
                let message = format!("layer {layer} has more than {MAX_ENTITIES_OF_LAYER} entities");
                diagnostics.error(MapErrorKind::Size, entities[0], message, "split the map");
            }
            continue;
        }
        if layer.starts_with(layers::SCENERY_PREFIX) {
            let message = format!("{layer} is not a layer of scenery");
            diagnostics.error(MapErrorKind::Layer, entities[0], message, &scenery::kinds_remedy());
        } else {
            *ignored.entry(layer.clone()).or_default() += entities.len();
        }
    }
    for unsupported in &read.unsupported {
        let layer = unsupported.layer.to_ascii_uppercase();
        if !is_known(&layer) || unsupported.kind == "POINT" {
            *ignored.entry(layer).or_default() += 1;
            continue;
        }
        let entity = format!("{} {}", unsupported.kind, unsupported.handle).trim_end().to_owned();
        let message = format!("layer {layer} cannot have an entity of this kind");
        diagnostics.error_at(
            MapErrorKind::Unsupported,
            unsupported.line,
            entity,
            message,
            unsupported.remedy,
        );
    }
    for (layer, count) in ignored {
        let entities = if count == 1 { "entity" } else { "entities" };
        diagnostics.note_all(format!("layer {layer}: {count} {entities} ignored"));
    }
}

/// A position for a message, in laboratory metres.
pub(super) fn place(at: DVec2) -> String {
    format!("({:.3}, {:.3})", at.x, at.y)
}

/// An entity with its line, for messages that name two.
pub(super) fn named(entity: &Entity) -> String {
    if entity.line == 0 { entity.label() } else { format!("{} (line {})", entity.label(), entity.line) }
}

/// The lane nearest to a point within reach. Where lanes coincide, a road lane comes before a connector, then
/// the first.
fn nearest_lane(lanes: &[Lane<Lab>], point: DVec2) -> Option<usize> {
    const SAME_M: f64 = 1e-6;
    let mut best: Option<(f64, usize)> = None;
    for (k, lane) in lanes.iter().enumerate() {
        // No point of a lane is farther from its start than it is long.
        if lane.curve.start().position.distance(point) - lane.curve.length() > REACH_M + SAME_M {
            continue;
        }
        let foot = lane.curve.at(lane.curve.project(point).s).pose.position;
        let distance = foot.distance(point);
        let better = match best {
            None => distance <= REACH_M,
            Some((least, other)) => {
                let road_first = lane.kind == LaneKind::Lane && lanes[other].kind == LaneKind::Connector;
                distance < least - SAME_M || (road_first && distance < least + SAME_M)
            }
        };
        if better {
            best = Some((distance, k));
        }
    }
    best.map(|(_, k)| k)
}
