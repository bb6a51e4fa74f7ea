//! Repairs measured maps: joins ends that miss each other, makes joints tangent, removes duplicate lanes.
//!
//! 1. Ends are clustered into joints (`joints`).
//! 2. Duplicate lanes are dropped or trimmed (`overlaps`), which changes the joints.
//! 3. The joints become an adjustment network (`network`); gaps beyond the tolerance are errors.
//! 4. A least-squares adjustment moves all joints by as little as possible (`adjust`).
//! 5. The new geometry is written to the file; stop lines at lane ends move along (`outcome`).

mod adjust;
mod along;
mod joints;
mod network;
mod outcome;
mod overlaps;
mod sparse;
mod strokes;

use super::build::pieces::{check_extent, segments_of};
use super::build::{JOIN_TOLERANCE_M, KINK_TOLERANCE_DEG, MAX_PIECES, lane_kind, named, place};
use super::dxf::{self, Entity, EntityShape, ParsedDrawing};
use super::error::{Diagnostics, MapErrorKind, MapErrors};
use city3d_geometry::{trig, wrap_angle};
use glam::DVec2;
use network::NetworkBuilder;
pub use outcome::{RepairAction, RepairChange};
use std::f64::consts::PI;
use strokes::LaneStrokes;

/// Half the lane spacing: a larger tolerance would join neighbours.
pub const MAX_REPAIR_TOLERANCE_M: f64 = super::build::REACH_M;

/// A repaired drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct RepairedMap {
    /// The DXF file. Everything but lanes and the control lines across them is unchanged, byte by byte.
    pub dxf: Vec<u8>,
    /// In the order of the file.
    pub changes: Vec<RepairChange>,
}

/// Repairs the lanes of a map drawing: joins ends within `tolerance_m` (laboratory metres), makes joints
/// tangent, and drops or trims duplicates. No end moves farther than the tolerance; lines stay lines and arcs
/// stay arcs.
///
/// The result may still have errors in texts and lines; [`super::load_map`] reports them.
///
/// # Errors
/// Unreadable files, and faults beyond the tolerance: gaps, kinks, and ends that would have to move farther.
pub fn repair_map(bytes: &[u8], tolerance_m: f64) -> Result<RepairedMap, MapErrors> {
    let mut diagnostics = Diagnostics::default();
    if !(tolerance_m > 0.0 && tolerance_m <= MAX_REPAIR_TOLERANCE_M) {
        let message = format!("the tolerance is {} mm", tolerance_m * 1e3);
        let remedy =
            format!("use one over 0 and up to {} mm, half a lane width", MAX_REPAIR_TOLERANCE_M * 1e3);
        diagnostics.error_at(MapErrorKind::Number, 0, String::new(), message, &remedy);
    }
    diagnostics.check()?;
    let read = ParsedDrawing::parse(bytes)?;
    let metres = read.drawing.units.metres();
    let entities = &read.drawing.entities;
    let mut changes = Vec::new();
    let kinds: Vec<_> = entities
        .iter()
        .map(|entity| lane_kind(&entity.layer).filter(|_| !is_degenerate(entity, metres, &mut changes)))
        .collect();
    let mut strokes = LaneStrokes::of(entities, &kinds, metres, tolerance_m);
    for stroke in &strokes.all {
        check_extent(&stroke.drawn, &entities[stroke.entity], &mut diagnostics);
    }
    if strokes.all.len() > MAX_PIECES {
        let message = format!("more than {MAX_PIECES} lines and arcs of lanes");
        diagnostics.error_at(MapErrorKind::Size, 0, String::new(), message, "split the map");
    }
    diagnostics.check()?;
    let mut cuts = Vec::new();
    let joints = overlaps::remove(&mut strokes, &mut cuts);
    let planner = NetworkBuilder { strokes: &strokes, joints: &joints, entities };
    let mut network = planner.build(&mut diagnostics);
    diagnostics.check()?;
    if !network.adjustment.solve() {
        let message = "no small movement makes all joints tangent".to_owned();
        let remedy = "look for ends that do not belong together, and try a smaller tolerance";
        diagnostics.error_at(MapErrorKind::Kink, 0, String::new(), message, remedy);
    }
    diagnostics.check()?;
    let outcome = outcome::RepairOutcome { strokes: &strokes, network: &network, entities, metres };
    outcome.check(&mut diagnostics);
    diagnostics.check()?;
    let mut edits = outcome.edits();
    outcome.report(&cuts, &mut changes);
    edits.extend(outcome.control_lines(&joints, &mut changes));
    edits.extend(changes.iter().filter_map(RepairChange::deleted_degenerate));
    changes.sort_by_key(|change| change.line);
    Ok(RepairedMap { dxf: dxf::edit(bytes, &edits), changes })
}

/// Whether a line or an arc is too short to be a lane; it is dropped.
fn is_degenerate(entity: &Entity, metres: f64, changes: &mut Vec<RepairChange>) -> bool {
    let Some((segments, _)) = segments_of(&entity.shape, metres) else { return false };
    let length_m: f64 = segments.iter().map(|segment| segment.length).sum();
    let speck = length_m < JOIN_TOLERANCE_M && !matches!(entity.shape, EntityShape::Polyline { .. });
    if speck {
        changes.push(RepairChange::of(entity, RepairAction::TooShort { length_m }));
    }
    speck
}

/// The unsigned angle between two undirected headings: 0 to a quarter turn.
fn turn_of(a: f64, b: f64) -> f64 {
    let turn = wrap_angle(a - b).abs();
    turn.min(PI - turn)
}

/// Whether [`super::load_map`] would join an end there without repair.
fn is_exact(distance_m: f64, turn_rad: f64) -> bool {
    distance_m <= JOIN_TOLERANCE_M && turn_rad <= KINK_TOLERANCE_DEG.to_radians()
}

fn unit(angle_rad: f64) -> DVec2 {
    let (sin, cos) = trig::sin_cos(angle_rad);
    DVec2::new(cos, sin)
}
