//! Repair of measured maps: ends that miss each other, joints a little off tangent, ways drawn twice.
//!
//! 1. Ends are grouped into joints (`joints`).
//! 2. Ways drawn twice are dropped or trimmed (`overlaps`), which changes the joints.
//! 3. The joints become a network (`layout`); gaps beyond the tolerance are errors.
//! 4. Least squares moves all joints by as little as possible (`adjust`).
//! 5. The file gets the new geometry, and stop lines that stood at the end of a lane stay there (`outcome`).

mod adjust;
mod along;
mod joints;
mod layout;
mod outcome;
mod overlaps;
mod sparse;
mod strokes;

use super::build::pieces::segments_of;
use super::build::{JOIN_TOLERANCE_M, KINK_TOLERANCE_DEG, MAX_PIECES, lane_kind, named, place};
use super::dxf::{self, Entity, ReadDrawing, Shape};
use super::error::{Findings, MapErrorKind, MapErrors};
use crate::geom::{trig, wrap_angle};
use glam::DVec2;
use layout::Planner;
pub use outcome::{RepairAction, RepairChange};
use std::f64::consts::PI;
use strokes::Strokes;

/// Half the distance of two lanes: a larger tolerance would join neighbours.
pub const MAX_REPAIR_TOLERANCE_M: f64 = super::build::REACH_M;

/// A drawing after its repair.
#[derive(Clone, Debug, PartialEq)]
pub struct RepairedMap {
    /// The DXF file. What is not a lane or a line across one is as it was, byte by byte.
    pub dxf: Vec<u8>,
    /// In the order of the file.
    pub changes: Vec<RepairChange>,
}

/// Repairs the lanes of a map drawing: moves ends together that are within `tolerance_m` (laboratory metres) of
/// each other, makes joints tangent, and drops or trims what is drawn twice. No end moves farther than the
/// tolerance, and lines stay lines, arcs stay arcs.
///
/// The result need not be a good map: texts and lines are not looked at, and [`super::load_map`] tells.
///
/// # Errors
/// What cannot be read, and what is beyond the tolerance: gaps, kinks, and ends that would have to move farther.
pub fn repair_map(bytes: &[u8], tolerance_m: f64) -> Result<RepairedMap, MapErrors> {
    let mut findings = Findings::default();
    if !(tolerance_m > 0.0 && tolerance_m <= MAX_REPAIR_TOLERANCE_M) {
        let message = format!("a tolerance of {} mm", tolerance_m * 1e3);
        let remedy =
            format!("use one over 0 and up to {} mm, half a lane width", MAX_REPAIR_TOLERANCE_M * 1e3);
        findings.error_at(MapErrorKind::Number, 0, String::new(), message, &remedy);
    }
    findings.check()?;
    let read = ReadDrawing::parse(bytes)?;
    let metres = read.drawing.units.metres();
    let entities = &read.drawing.entities;
    let mut changes = Vec::new();
    let kinds: Vec<_> = entities
        .iter()
        .map(|entity| lane_kind(&entity.layer).filter(|_| !is_speck(entity, metres, &mut changes)))
        .collect();
    let mut strokes = Strokes::of(entities, &kinds, metres, tolerance_m);
    if strokes.all.len() > MAX_PIECES {
        let message = format!("more than {MAX_PIECES} lines and arcs of lanes");
        findings.error_at(MapErrorKind::Size, 0, String::new(), message, "split the map");
    }
    findings.check()?;
    let mut cuts = Vec::new();
    let joints = overlaps::remove(&mut strokes, &mut cuts);
    let planner = Planner { strokes: &strokes, joints: &joints, entities };
    let mut network = planner.lay_out(&mut findings);
    findings.check()?;
    if !network.adjustment.solve() {
        let message = "no small movement makes all joints tangent".to_owned();
        let remedy = "look for joints that are no joints, and try a smaller tolerance";
        findings.error_at(MapErrorKind::Kink, 0, String::new(), message, remedy);
    }
    findings.check()?;
    let outcome = outcome::Outcome { strokes: &strokes, network: &network, entities, metres };
    outcome.check(&mut findings);
    findings.check()?;
    let mut edits = outcome.edits();
    outcome.report(&cuts, &mut changes);
    edits.extend(outcome.control_lines(&joints, &mut changes));
    edits.extend(changes.iter().filter_map(RepairChange::deleted_speck));
    changes.sort_by_key(|change| change.line);
    Ok(RepairedMap { dxf: dxf::edit(bytes, &edits), changes })
}

/// Whether a line or an arc is too short to be a lane; it is left out.
fn is_speck(entity: &Entity, metres: f64, changes: &mut Vec<RepairChange>) -> bool {
    let Some((segments, _)) = segments_of(&entity.shape, metres) else { return false };
    let length_m: f64 = segments.iter().map(|segment| segment.length).sum();
    let speck = length_m < JOIN_TOLERANCE_M && !matches!(entity.shape, Shape::Polyline { .. });
    if speck {
        changes.push(RepairChange::of(entity, RepairAction::TooShort { length_m }));
    }
    speck
}

/// The angle between two headings whatever their sense: 0 to a quarter turn.
fn turn_of(a: f64, b: f64) -> f64 {
    let turn = wrap_angle(a - b).abs();
    turn.min(PI - turn)
}

/// Whether a map that is loaded without repair would have an end joined there.
fn is_exact(distance_m: f64, turn_rad: f64) -> bool {
    distance_m <= JOIN_TOLERANCE_M && turn_rad <= KINK_TOLERANCE_DEG.to_radians()
}

fn unit(angle_rad: f64) -> DVec2 {
    let (sin, cos) = trig::sin_cos(angle_rad);
    DVec2::new(cos, sin)
}
