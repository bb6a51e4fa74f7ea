//! The table of roads: one centre line per lane, in driving direction.

use super::network::{BEND_SPEED, RoadNetwork};
use super::path::{CurveBuilder, EAST, NORTH, QUARTER, SOUTH, TurnDirection, WEST, fillet, ring};
use city3d_geometry::lab::Curve;
use glam::DVec2;
use std::f64::consts::FRAC_PI_4;

/// Lane spacing: the difference of the two radii of the corners and roundabouts.
pub(super) const SPACING: f64 = 0.151;
/// Radii of the corners and roundabouts.
const INNER: f64 = 0.466;
const OUTER: f64 = 0.617;
/// Radius of the arcs into and out of the roundabouts, and of the ramp's.
const ENTRY_RADIUS: f64 = 0.45;

const WEST_RING: DVec2 = DVec2::new(-2.27, -2.17);
const EAST_RING: DVec2 = DVec2::new(2.05, -1.91);

// Street centres (x) and avenue centres (y), by driving direction; inner lanes.
const WEST_SB: f64 = -2.497;
const WEST_NB: f64 = -2.346;
const CENTRE_SB: f64 = -0.08;
const CENTRE_NB: f64 = 0.071;
const EAST_SB: f64 = 1.9745;
const EAST_NB: f64 = 2.1255;
const NORTH_WB: f64 = 2.797;
const NORTH_EB: f64 = 2.646;
const SECOND_WB: f64 = 1.944;
const SECOND_EB: f64 = 1.793;
const MAIN_WB: f64 = -0.241;
const MAIN_EB: f64 = -0.392;
const SOUTH_WB: f64 = -2.461;
const SOUTH_EB: f64 = -2.636;

/// Streets have two lanes each way south of the first, one north of the second.
const WIDE_SOUTH_OF: f64 = 0.6;
const NARROW_NORTH_OF: f64 = 1.1;
const TAPER: f64 = NARROW_NORTH_OF - WIDE_SOUTH_OF;
/// Main Boulevard likewise between these.
const WIDE_WEST_OF: f64 = 1.0;
const NARROW_EAST_OF: f64 = 1.6;
const MAIN_TAPER: f64 = NARROW_EAST_OF - WIDE_WEST_OF;

/// Adds every centre line of the city except the turns.
pub(super) fn add_all(network: &mut RoadNetwork) {
    northern(network);
    streets(network);
    boulevards(network);
    byways(network);
}

/// North Avenue, Second Avenue, the north-east loop and the Crescent.
fn northern(net: &mut RoadNetwork) {
    let table = [
        ("north-avenue/west", CurveBuilder::at(2.294, NORTH_WB, WEST).until_x(-1.88).left(OUTER, QUARTER)),
        ("north-avenue/east", CurveBuilder::at(WEST_NB, 2.18, NORTH).right(INNER, QUARTER).until_x(2.294)),
        (
            "north-east-loop/south",
            CurveBuilder::at(2.294, NORTH_EB, EAST).right(INNER, QUARTER).until_y(1.25).right(INNER, QUARTER),
        ),
        (
            "north-east-loop/north",
            CurveBuilder::at(2.294, 0.633, EAST).left(OUTER, QUARTER).until_y(2.18).left(OUTER, QUARTER),
        ),
        (
            "crescent/north",
            CurveBuilder::at(2.294, 0.784, WEST).until_x(1.70).right(INNER, QUARTER).until_y(SECOND_WB),
        ),
        (
            "crescent/south",
            CurveBuilder::at(1.083, SECOND_WB, SOUTH).until_y(1.25).left(OUTER, QUARTER).until_x(2.294),
        ),
        ("second-avenue/west", CurveBuilder::at(EAST_NB, SECOND_WB, WEST).until_x(WEST_SB)),
        ("second-avenue/east", CurveBuilder::at(WEST_SB, SECOND_EB, EAST).until_x(EAST_NB)),
    ];
    for (name, pen) in table {
        net.add(name, None, pen.curve());
    }
}

/// The arc from a lane into a ring, with the lane up to there.
///
/// # Panics
/// If the tables place a lane where the arc does not fit.
fn into_ring(lane: &Curve, ring: &Curve) -> Curve {
    let f = fillet(lane, ring, TurnDirection::Right, ENTRY_RADIUS)
        .expect("the entry's arc fits between lane and ring");
    let lane = lane.slice(0.0, f.from_s);
    Curve::new([lane.segments(), &[f.arc]].concat())
}

/// The arc from a ring into a lane, with the lane from there on.
///
/// # Panics
/// As [`into_ring`].
fn out_of_ring(ring: &Curve, lane: &Curve) -> Curve {
    let f = fillet(ring, lane, TurnDirection::Right, ENTRY_RADIUS)
        .expect("the exit's arc fits between ring and lane");
    let lane = lane.slice(f.to_s, lane.length());
    Curve::new([&[f.arc], lane.segments()].concat())
}

fn last_segment(curve: &Curve) -> Curve {
    Curve::new(curve.segments()[curve.segments().len() - 1..].to_vec())
}

fn first_segment(curve: &Curve) -> Curve {
    Curve::new(curve.segments()[..1].to_vec())
}

/// West, Centre and East Street with their parts of the roundabouts.
fn streets(net: &mut RoadNetwork) {
    let [west_inner, west_outer] = [INNER, OUTER].map(|r| ring(WEST_RING, r));
    let [east_inner, east_outer] = [INNER, OUTER].map(|r| ring(EAST_RING, r));

    let lane = CurveBuilder::at(WEST_SB, 2.18, SOUTH).until_y(WEST_RING.y).curve();
    net.add("west-street/south/inner", None, into_ring(&lane, &west_inner));
    let lane = CurveBuilder::at(WEST_SB, NARROW_NORTH_OF, SOUTH)
        .shift(TurnDirection::Right, TAPER, SPACING)
        .until_y(WEST_RING.y)
        .curve();
    net.add("west-street/south/outer", None, into_ring(&lane, &west_outer));
    let lane = CurveBuilder::at(WEST_NB, WEST_RING.y, NORTH).until_y(2.18).curve();
    net.add("west-street/north/inner", None, out_of_ring(&west_inner, &lane));
    let lane = CurveBuilder::at(WEST_NB + SPACING, WEST_RING.y, NORTH).until_y(WIDE_SOUTH_OF);
    let lane = lane.shift(TurnDirection::Left, TAPER, SPACING).curve();
    net.add("west-street/north/outer", None, out_of_ring(&west_outer, &lane));

    // The south end opens into concentric arcs onto, and from, westbound South Boulevard.
    let (small, large) = (0.46, 0.46 + SPACING);
    let arcs_from_y = SOUTH_WB + large;
    let arcs_from_x = CENTRE_NB + large;
    let pen = CurveBuilder::at(CENTRE_SB, NORTH_WB, SOUTH).until_y(arcs_from_y).right(large, QUARTER);
    net.add("centre-street/south/inner", None, pen.curve());
    let pen = CurveBuilder::at(CENTRE_SB, NARROW_NORTH_OF, SOUTH).shift(TurnDirection::Right, TAPER, SPACING);
    net.add("centre-street/south/outer", None, pen.until_y(arcs_from_y).right(small, QUARTER).curve());
    let pen = CurveBuilder::at(arcs_from_x, SOUTH_WB, WEST).right(large, QUARTER).until_y(NORTH_WB);
    net.add("centre-street/north/inner", None, pen.curve());
    let pen =
        CurveBuilder::at(arcs_from_x, SOUTH_WB + SPACING, WEST).right(small, QUARTER).until_y(WIDE_SOUTH_OF);
    net.add("centre-street/north/outer", None, pen.shift(TurnDirection::Left, TAPER, SPACING).curve());

    // One lane each way, connected to the roundabout's outer entry and exit.
    let lane = CurveBuilder::at(EAST_SB, NORTH_WB, SOUTH).until_y(EAST_RING.y).curve();
    net.add("east-street/south/inner", None, into_ring(&lane, &east_inner));
    net.add("east-street/south/outer", None, last_segment(&into_ring(&lane, &east_outer)));
    let lane = CurveBuilder::at(EAST_NB, EAST_RING.y, NORTH).until_y(NORTH_WB).curve();
    net.add("east-street/north/inner", None, out_of_ring(&east_inner, &lane));
    net.add("east-street/north/outer", None, first_segment(&out_of_ring(&east_outer, &lane)));

    net.add("west-roundabout/ring/inner", Some(BEND_SPEED), west_inner);
    net.add("west-roundabout/ring/outer", Some(BEND_SPEED), west_outer);
    net.add("east-roundabout/ring/inner", Some(BEND_SPEED), east_inner);
    net.add("east-roundabout/ring/outer", Some(BEND_SPEED), east_outer);
}

/// Main Boulevard and South Boulevard.
fn boulevards(net: &mut RoadNetwork) {
    let table = [
        ("main-boulevard/west/inner", CurveBuilder::at(EAST_NB, MAIN_WB, WEST).until_x(WEST_SB)),
        (
            "main-boulevard/west/outer",
            CurveBuilder::at(NARROW_EAST_OF, MAIN_WB, WEST)
                .shift(TurnDirection::Right, MAIN_TAPER, SPACING)
                .until_x(WEST_NB),
        ),
        ("main-boulevard/east/inner", CurveBuilder::at(WEST_SB, MAIN_EB, EAST).until_x(EAST_NB)),
        (
            "main-boulevard/east/outer",
            CurveBuilder::at(WEST_NB, MAIN_EB - SPACING, EAST).until_x(WIDE_WEST_OF).shift(
                TurnDirection::Left,
                MAIN_TAPER,
                SPACING,
            ),
        ),
    ];
    for (name, pen) in table {
        net.add(name, None, pen.curve());
    }

    // Concentric long arcs lift the eastbound lanes into the eastern roundabout.
    const RISE_FROM_X: f64 = 0.6;
    const RISE_RADIUS: f64 = 4.0;
    for (lane, radius, y) in [("outer", OUTER, SOUTH_EB - SPACING), ("inner", INNER, SOUTH_EB)] {
        let rise = RISE_RADIUS + SOUTH_EB - SPACING - y;
        let [west, east] =
            ["west", "east"].map(|side| net.curve(&format!("{side}-roundabout/ring/{lane}")).clone());
        let pen = CurveBuilder::at(WEST_RING.x, WEST_RING.y - radius, EAST)
            .until_x(RISE_FROM_X)
            .left(rise, FRAC_PI_4);
        net.add(&format!("south-boulevard/east/{lane}"), None, into_ring(&pen.curve(), &east));

        let y = if lane == "outer" { SOUTH_WB + SPACING } else { SOUTH_WB };
        let pen = CurveBuilder::at(EAST_RING.x, y, WEST).until_x(WEST_RING.x);
        let from_ring = out_of_ring(&east, &pen.curve());
        net.add(&format!("south-boulevard/west/{lane}"), None, into_ring(&from_ring, &west));
    }
}

/// The ramp and the square lane.
fn byways(net: &mut RoadNetwork) {
    let (leave_x, leave_y, join_y) = (-1.16, MAIN_EB - SPACING, SOUTH_WB + SPACING);
    let ramp = CurveBuilder::at(leave_x, leave_y, EAST)
        .right(ENTRY_RADIUS, QUARTER)
        .until_y(join_y + ENTRY_RADIUS)
        .right(ENTRY_RADIUS, QUARTER);
    net.add("ramp/south", Some(BEND_SPEED), ramp.curve());

    // Four arcs through (-1.81, 1.02) and (-1.43, 1.40); the straight start takes up the rest.
    let (first, second, third, fourth) = (0.384, 0.3808, 0.333, 0.527);
    let half = FRAC_PI_4;
    let rise =
        first + second + (third + (std::f64::consts::SQRT_2 - 1.0) * fourth) / std::f64::consts::SQRT_2;
    let square = CurveBuilder::at(WEST_NB + SPACING, WIDE_SOUTH_OF, NORTH)
        .until_y(SECOND_EB - rise)
        .right(first, QUARTER)
        .left(second, QUARTER)
        .right(third, half)
        .right(fourth, half);
    net.add("square-lane/east", Some(BEND_SPEED), square.curve());
}
