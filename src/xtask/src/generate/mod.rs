//! Generates the shipped city: the layout of the IDS3C testbed as a DXF drawing in laboratory metres.
//!
//! The output is deterministic. Roads are tables of tangent lines and arcs (`roads`); turns between them are
//! fillets of a given radius (`junctions`); centre lines are cut into lanes where they branch and named
//! (`network`); the blocks between the roads are tables (`blocks`) that `scenery` draws.

mod blocks;
mod junctions;
mod network;
mod path;
mod roads;
mod scenery;

pub use network::OmittedTurn;

use city3d_geometry::lab::{Curve, Segment};
use city3d_geometry::trig;
use city3d_roadmap::ControlLineKind;
use city3d_roadmap::dxf::{Drawing, EntityShape, Units};
use glam::DVec2;
use network::{DraftLane, RoadNetwork};

/// Height of names in the drawing.
const NAME_HEIGHT: f64 = 0.02;
/// A name is drawn in the middle of its lane unless another lane is closer to it than this.
const NAME_CLEARANCE: f64 = 0.05;

/// The city of the IDS3C testbed, scale 1:25, x east and y north from the middle of the floor:
/// layers LANES, CONNECTORS, NAMES, SPEEDS, STOP_LINES, YIELD_LINES and the scenery.
pub fn ids3c() -> Drawing {
    let network = network();
    let lanes = network.lanes();
    let mut drawing = Drawing { units: Units::Metres, entities: Vec::new() };
    for lane in &lanes {
        let layer = if lane.connector { "CONNECTORS" } else { "LANES" };
        lane.curve.segments().iter().for_each(|segment| drawing.add(layer, entity(segment)));
    }
    for (index, lane) in lanes.iter().enumerate() {
        let at = name_place(&lanes, index);
        drawing.add("NAMES", EntityShape::Text { at, height: NAME_HEIGHT, text: lane.name.clone() });
        if let Some(speed) = lane.speed_mps {
            drawing.add("SPEEDS", EntityShape::Text { at, height: NAME_HEIGHT, text: format!("{speed:.2}") });
        }
    }
    for line in &network.lines {
        let layer = match line.kind {
            ControlLineKind::Stop => "STOP_LINES",
            ControlLineKind::Yield => "YIELD_LINES",
        };
        let [from, to] = line.ends;
        drawing.add(layer, EntityShape::Line { from, to });
    }
    scenery::add_all(&mut drawing, &lanes);
    drawing
}

/// The turns that junctions of the city do not have, with the reason.
pub fn omitted_turns() -> Vec<OmittedTurn> {
    network().omitted
}

fn network() -> RoadNetwork {
    let mut network = RoadNetwork::default();
    roads::add_all(&mut network);
    junctions::add_all(&mut network);
    network
}

fn entity(segment: &Segment) -> EntityShape {
    let (from, to) = (segment.start.position, segment.end().position);
    let Some((centre, radius)) = segment.centre().zip(segment.radius()) else {
        return EntityShape::Line { from, to };
    };
    let degrees = |p: DVec2| {
        let angle = trig::atan2(p.y - centre.y, p.x - centre.x).to_degrees();
        if angle < 0.0 { angle + 360.0 } else { angle }
    };
    let (from_deg, to_deg) = (degrees(from), degrees(to));
    let (from_deg, to_deg) = if segment.curvature > 0.0 { (from_deg, to_deg) } else { (to_deg, from_deg) };
    EntityShape::Arc { centre, radius, from_deg, to_deg }
}

/// The position of a lane's name: the middle of its centre line, or the point farthest from other lanes if
/// one passes near the middle.
fn name_place(lanes: &[DraftLane], index: usize) -> DVec2 {
    let curve = &lanes[index].curve;
    let clearance = |at: DVec2| {
        let others = lanes.iter().enumerate().filter(|(k, _)| *k != index);
        others.map(|(_, other)| distance(&other.curve, at)).fold(f64::INFINITY, f64::min)
    };
    let place = |share: f64| curve.at(curve.length() * share).pose.position;
    let middle = place(0.5);
    if clearance(middle) >= NAME_CLEARANCE {
        return middle;
    }
    let shares = (1..40).map(|k| f64::from(k) / 40.0);
    shares.map(place).max_by(|a, b| clearance(*a).total_cmp(&clearance(*b))).unwrap_or(middle)
}

fn distance(curve: &Curve, point: DVec2) -> f64 {
    curve.at(curve.project(point).s).pose.position.distance(point)
}

#[cfg(test)]
mod tests;
