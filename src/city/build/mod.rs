//! From a drawing to a map: entities become pieces, pieces a network, the network lanes and zones.
//!
//! `docs/maps.md` states for map authors what is done here.

mod directions;
mod labels;
mod lanes;
mod lines;
mod neighbours;
mod network;
pub(super) mod pieces;
mod scenery;
mod zones;

use super::dxf::{Drawing, Entity, ReadDrawing};
use super::error::{Findings, MapErrorKind, MapErrors, MapNote};
use super::{LabMap, Lane, LaneKind, RoadMap, layers};
use glam::DVec2;
use std::collections::BTreeMap;

/// Width of every lane: that of the testbed.
pub const LANE_WIDTH_M: f64 = 0.1524;
/// Ends closer than this are one point; moving them together is reported unless they are closer
/// than `SILENT_JOIN_M`.
pub const JOIN_TOLERANCE_M: f64 = 1e-3;
pub const SILENT_JOIN_M: f64 = 1e-6;
/// Texts, arrows and gaps belong to a lane up to this distance.
pub const REACH_M: f64 = LANE_WIDTH_M / 2.0;
/// Headings at a joint may differ by this much.
pub const KINK_TOLERANCE_DEG: f64 = 1.0;
/// Posted speed where the drawing states none.
pub const DEFAULT_SPEED_MPS: f64 = 0.5;
/// No coordinate may be farther from the origin: 25 km at full scale.
pub const MAX_COORDINATE_M: f64 = 1000.0;
/// Most pieces of lanes, and most metres of them, that a map may have.
pub const MAX_PIECES: usize = 5000;
/// Most entities on any one layer that means something.
pub const MAX_ENTITIES_OF_LAYER: usize = 5000;
pub const MAX_LANES_LENGTH_M: f64 = 1000.0;

/// A map and what its author may want to know about it.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedMap {
    pub map: LabMap,
    pub notes: Vec<MapNote>,
}

/// Reads a map from the bytes of an ASCII DXF file.
///
/// # Errors
/// Everything that is wrong with the drawing, each fault with its line, entity, finding and remedy.
/// Faults of the file hide those of the lanes, and faults of the lanes those of texts and lines.
pub fn load_map(bytes: &[u8]) -> Result<LoadedMap, MapErrors> {
    build_map(&ReadDrawing::parse(bytes)?)
}

/// Builds a map from a drawing in memory.
///
/// # Errors
/// As [`load_map`]. Entities of a drawing in memory have no lines, and handles only where given.
pub fn map_of_drawing(drawing: &Drawing) -> Result<LoadedMap, MapErrors> {
    build_map(&ReadDrawing { drawing: drawing.clone(), unread: Vec::new() })
}

/// Entities in file order by layer, layer names in capitals.
type Layers<'a> = BTreeMap<String, Vec<&'a Entity>>;

fn build_map(read: &ReadDrawing) -> Result<LoadedMap, MapErrors> {
    let mut findings = Findings::default();
    let metres = read.drawing.units.metres();
    let mut by_layer = Layers::new();
    for entity in &read.drawing.entities {
        by_layer.entry(entity.layer.to_ascii_uppercase()).or_default().push(entity);
    }
    check_layers(&by_layer, read, &mut findings);
    findings.check_size()?;
    let scenery = scenery::build(&by_layer, metres, &mut findings);
    let models = scenery::models(&by_layer, metres, &mut findings);

    let pieces = pieces::build(&read.drawing, metres, &mut findings);
    findings.check()?;
    let mut network = network::Network::join(pieces, &read.drawing, &mut findings);
    findings.check()?;
    let arrows = pieces::lines_of(&by_layer, layers::ARROWS, metres, &mut findings);
    directions::assign(&mut network, &arrows, &read.drawing, &mut findings);
    findings.check()?;
    let mut roads = lanes::build(&network, &read.drawing, &mut findings);
    labels::apply(&mut roads, &by_layer, metres, &mut findings);
    let lines = lines::build(&roads.lanes, &by_layer, metres, &mut findings);
    findings.check()?;

    neighbours::link(&mut roads.lanes);
    let zones = zones::find(&roads, &mut findings);
    findings.check()?;
    let mut map = RoadMap::new(roads.lanes, zones, lines, scenery);
    map.models = models;
    Ok(LoadedMap { map: LabMap(map), notes: findings.notes })
}

/// Whether a point lies where a map may.
fn in_map(at: DVec2) -> bool {
    at.is_finite() && at.abs().max_element() <= MAX_COORDINATE_M
}

/// Whether the layer holds lanes, and of which kind.
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
    const KNOWN: [&str; 8] = [
        layers::LANES,
        layers::CONNECTORS,
        layers::STOP_LINES,
        layers::YIELD_LINES,
        layers::ARROWS,
        layers::NAMES,
        layers::SPEEDS,
        layers::MODELS,
    ];
    KNOWN.contains(&layer) || layers::scenery_kind(layer).is_some()
}

/// Entities that cannot be read are errors on layers that mean something and counted elsewhere;
/// foreign layers are counted, and those that look like scenery are errors.
fn check_layers(by_layer: &Layers, read: &ReadDrawing, findings: &mut Findings) {
    let mut ignored: BTreeMap<String, usize> = BTreeMap::new();
    for (layer, entities) in by_layer {
        if is_known(layer) {
            if entities.len() > MAX_ENTITIES_OF_LAYER {
                let message = format!("layer {layer} has more than {MAX_ENTITIES_OF_LAYER} entities");
                findings.error(MapErrorKind::Size, entities[0], message, "split the map");
            }
            continue;
        }
        if layer.starts_with(layers::SCENERY_PREFIX) {
            let message = format!("{layer} is no kind of scenery");
            findings.error(MapErrorKind::Layer, entities[0], message, &scenery::kinds_remedy());
        } else {
            *ignored.entry(layer.clone()).or_default() += entities.len();
        }
    }
    for unread in &read.unread {
        let layer = unread.layer.to_ascii_uppercase();
        if !is_known(&layer) || unread.kind == "POINT" {
            *ignored.entry(layer).or_default() += 1;
            continue;
        }
        let entity = format!("{} {}", unread.kind, unread.handle).trim_end().to_owned();
        let message = format!("this entity cannot be taken from layer {layer}");
        findings.error_at(MapErrorKind::Unsupported, unread.line, entity, message, unread.remedy);
    }
    for (layer, count) in ignored {
        let entities = if count == 1 { "entity" } else { "entities" };
        findings.note_all(format!("layer {layer}: {count} {entities} ignored"));
    }
}

/// A place for a message, in laboratory metres.
pub(super) fn place(at: DVec2) -> String {
    format!("({:.3}, {:.3})", at.x, at.y)
}

/// An entity with its line, for messages about two.
pub(super) fn named(entity: &Entity) -> String {
    if entity.line == 0 { entity.label() } else { format!("{} (line {})", entity.label(), entity.line) }
}

/// The lane nearest to a point within reach; of lanes that coincide there, one of a road rather than
/// a way across a junction, and the first.
fn nearest_lane(lanes: &[Lane], point: DVec2) -> Option<usize> {
    const SAME_M: f64 = 1e-6;
    let mut best: Option<(f64, usize)> = None;
    for (k, lane) in lanes.iter().enumerate() {
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
