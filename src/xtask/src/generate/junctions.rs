//! Junctions: turns between the roads, straight connectors, stop and yield lines.

use super::network::{BEND_SPEED, DraftControlLine, LANE_WIDTH, LINE_SETBACK, OmittedTurn, RoadNetwork};
use super::path::{Fit, TurnDirection, fit};
use super::roads::SPACING;
use city3d_roadmap::ControlLineKind;
use glam::DVec2;

/// Smallest turning radius.
pub(super) const MIN_TURN_RADIUS: f64 = 0.20;
/// Least distance, centre to centre, between a yielding vehicle and the lane that it yields to.
const YIELD_CLEARANCE: f64 = 0.16;

/// The side of a junction on which an arm lies, clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CompassSide {
    North,
    East,
    South,
    West,
}

impl CompassSide {
    fn name(self) -> &'static str {
        ["north", "east", "south", "west"][self as usize]
    }

    /// The direction of the turn from this arm to another; `None` straight ahead.
    fn turn_to(self, other: Self) -> Option<TurnDirection> {
        match (other as usize + 4 - self as usize) % 4 {
            1 => Some(TurnDirection::Left),
            3 => Some(TurnDirection::Right),
            _ => None,
        }
    }
}

/// An arm of a junction with its inbound and outbound lanes, inner lanes first.
struct Arm {
    side: CompassSide,
    inbound: &'static [&'static str],
    outbound: &'static [&'static str],
    /// Whether inbound traffic has a stop line.
    stops: bool,
}

struct Junction {
    name: &'static str,
    /// Radius of its right turns. Left turns start and end beside them, so their radius is larger by the
    /// width of the road between.
    reach: f64,
    arms: &'static [Arm],
    /// Turns with another fit: onto or from an arc, the radius follows from the start or the end.
    fits: &'static [(CompassSide, CompassSide, Fit)],
}

const fn arm(side: CompassSide, inbound: &'static [&'static str], outbound: &'static [&'static str]) -> Arm {
    Arm { side, inbound, outbound, stops: false }
}

const fn stop(side: CompassSide, inbound: &'static [&'static str], outbound: &'static [&'static str]) -> Arm {
    Arm { side, inbound, outbound, stops: true }
}

use CompassSide::{East, North, South, West};

const WEST_SOUTH: &[&str] = &["west-street/south/inner", "west-street/south/outer"];
const WEST_NORTH: &[&str] = &["west-street/north/inner", "west-street/north/outer"];
const CENTRE_SOUTH: &[&str] = &["centre-street/south/inner", "centre-street/south/outer"];
const CENTRE_NORTH: &[&str] = &["centre-street/north/inner", "centre-street/north/outer"];
const MAIN_WEST: &[&str] = &["main-boulevard/west/inner", "main-boulevard/west/outer"];
const MAIN_EAST: &[&str] = &["main-boulevard/east/inner", "main-boulevard/east/outer"];
const WEST_SOUTH_1: &[&str] = &["west-street/south/inner"];
const WEST_NORTH_1: &[&str] = &["west-street/north/inner"];
const CENTRE_SOUTH_1: &[&str] = &["centre-street/south/inner"];
const CENTRE_NORTH_1: &[&str] = &["centre-street/north/inner"];
const MAIN_WEST_1: &[&str] = &["main-boulevard/west/inner"];
const MAIN_EAST_1: &[&str] = &["main-boulevard/east/inner"];
const EAST_SOUTH: &[&str] = &["east-street/south/inner"];
const EAST_NORTH: &[&str] = &["east-street/north/inner"];
const NORTH_WEST: &[&str] = &["north-avenue/west"];
const NORTH_EAST: &[&str] = &["north-avenue/east"];
const SECOND_WEST: &[&str] = &["second-avenue/west"];
const SECOND_EAST: &[&str] = &["second-avenue/east"];
const LOOP_SOUTH: &[&str] = &["north-east-loop/south"];
const LOOP_NORTH: &[&str] = &["north-east-loop/north"];
const CRESCENT_NORTH: &[&str] = &["crescent/north"];
const CRESCENT_SOUTH: &[&str] = &["crescent/south"];

/// The blocks between North and Second Avenue are 0.70 deep: the radii beside them leave room for a vehicle
/// of 0.2 between a stop line and the junction behind it.
const JUNCTIONS: &[Junction] = &[
    Junction {
        name: "junction-centre-north",
        reach: 0.229,
        arms: &[
            arm(West, NORTH_EAST, NORTH_WEST),
            arm(East, NORTH_WEST, NORTH_EAST),
            stop(South, CENTRE_NORTH_1, CENTRE_SOUTH_1),
        ],
        fits: &[],
    },
    Junction {
        name: "junction-east-north",
        reach: 0.237,
        arms: &[
            arm(West, NORTH_EAST, NORTH_WEST),
            arm(East, LOOP_NORTH, LOOP_SOUTH),
            stop(South, EAST_NORTH, EAST_SOUTH),
        ],
        fits: &[(South, East, Fit::Start(2.1255, 2.409)), (East, South, Fit::End(1.9745, 2.409))],
    },
    Junction {
        name: "junction-west-second",
        reach: 0.229,
        arms: &[
            arm(North, WEST_SOUTH_1, WEST_NORTH_1),
            arm(South, WEST_NORTH_1, WEST_SOUTH_1),
            stop(East, SECOND_WEST, SECOND_EAST),
        ],
        fits: &[],
    },
    Junction {
        name: "junction-centre-second",
        reach: 0.20,
        arms: &[
            stop(North, CENTRE_SOUTH_1, CENTRE_NORTH_1),
            arm(East, SECOND_WEST, SECOND_EAST),
            stop(South, CENTRE_NORTH_1, CENTRE_SOUTH_1),
            arm(West, SECOND_EAST, SECOND_WEST),
        ],
        fits: &[],
    },
    Junction {
        name: "junction-crescent-second",
        reach: 0.25,
        arms: &[
            arm(East, SECOND_WEST, SECOND_EAST),
            stop(South, CRESCENT_NORTH, CRESCENT_SOUTH),
            arm(West, SECOND_EAST, SECOND_WEST),
        ],
        fits: &[],
    },
    Junction {
        name: "junction-east-second",
        reach: 0.20,
        arms: &[
            arm(North, EAST_SOUTH, EAST_NORTH),
            arm(South, EAST_NORTH, EAST_SOUTH),
            stop(West, SECOND_EAST, SECOND_WEST),
        ],
        fits: &[],
    },
    Junction {
        name: "junction-east-crescent",
        reach: 0.25,
        arms: &[
            arm(North, EAST_SOUTH, EAST_NORTH),
            stop(East, LOOP_SOUTH, LOOP_NORTH),
            arm(South, EAST_NORTH, EAST_SOUTH),
            stop(West, CRESCENT_SOUTH, CRESCENT_NORTH),
        ],
        fits: &[
            (East, North, Fit::End(2.1255, 1.034)),
            (East, South, Fit::End(1.9745, 0.383)),
            (South, East, Fit::Start(2.1255, 0.383)),
            (North, East, Fit::Start(1.9745, 1.034)),
        ],
    },
    Junction {
        name: "junction-main-west",
        reach: 0.25,
        arms: &[
            arm(North, WEST_SOUTH, WEST_NORTH),
            stop(East, MAIN_WEST, MAIN_EAST),
            arm(South, WEST_NORTH, WEST_SOUTH),
        ],
        // Dedicated right-turn lanes, wide enough for cars that steer 20 degrees.
        fits: &[(East, North, Fit::Radius(0.38)), (South, East, Fit::Radius(0.38))],
    },
    Junction {
        name: "junction-main-centre",
        reach: 0.25,
        arms: &[
            stop(North, CENTRE_SOUTH, CENTRE_NORTH),
            arm(East, MAIN_WEST, MAIN_EAST),
            stop(South, CENTRE_NORTH, CENTRE_SOUTH),
            arm(West, MAIN_EAST, MAIN_WEST),
        ],
        fits: &[],
    },
    Junction {
        name: "junction-main-east",
        reach: 0.25,
        arms: &[
            arm(North, EAST_SOUTH, EAST_NORTH),
            arm(South, EAST_NORTH, EAST_SOUTH),
            stop(West, MAIN_EAST_1, MAIN_WEST_1),
        ],
        fits: &[],
    },
];

/// Adds turns, connectors and control lines of all junctions.
pub(super) fn add_all(net: &mut RoadNetwork) {
    JUNCTIONS.iter().for_each(|junction| add(net, junction));
    add_yielding(net);
    for turn in ["north-to-east", "west-to-north"] {
        net.omitted.push(OmittedTurn {
            turn: format!("junction-centre-south/{turn}"),
            reason: "eastbound South Boulevard passes the south end of Centre Street without a turn"
                .to_owned(),
        });
    }
}

/// Arc lengths at which turns leave and join the centre lines: (centre line, arc length).
#[derive(Default)]
struct Stations {
    departures: Vec<(&'static str, f64)>,
    arrivals: Vec<(&'static str, f64)>,
}

fn add(net: &mut RoadNetwork, junction: &Junction) {
    let mut stations = Stations::default();
    let pairs = || junction.arms.iter().flat_map(|a| junction.arms.iter().map(move |b| (a, b)));
    for (from, to) in pairs() {
        if let Some(turn) = from.side.turn_to(to.side) {
            add_turn(net, junction, (from, to, turn), &mut stations);
        }
    }
    for (from, to) in pairs().filter(|(a, b)| a.side != b.side && a.side.turn_to(b.side).is_none()) {
        for (lane, (&inbound, &outbound)) in from.inbound.iter().zip(to.outbound).enumerate() {
            let start = least(&stations.departures, inbound)
                .unwrap_or_else(|| beside(net, &stations.departures, from.inbound, inbound));
            let end = most(&stations.arrivals, outbound)
                .unwrap_or_else(|| beside(net, &stations.arrivals, to.outbound, outbound));
            let suffix = if from.inbound.len() > 1 { ["/inner", "/outer"][lane] } else { "" };
            let name = format!("{}/{}-to-{}{suffix}", junction.name, from.side.name(), to.side.name());
            if inbound == outbound {
                net.cross(inbound, start, end, name);
            } else {
                net.cross(inbound, start, net.curve(inbound).length(), name.clone());
                net.cross(outbound, 0.0, end, name);
            }
        }
    }
    for arm in junction.arms.iter().filter(|arm| arm.stops) {
        for &lane in arm.inbound {
            if let Some(s) = least(&stations.departures, lane) {
                net.line(ControlLineKind::Stop, lane, s);
            }
        }
    }
}

/// Right turns go from outer lane to outer lane, left turns from inner to inner.
fn add_turn(
    net: &mut RoadNetwork,
    junction: &Junction,
    (from, to, turn): (&Arm, &Arm, TurnDirection),
    at: &mut Stations,
) {
    let lanes = junction.arms.iter().map(|arm| arm.inbound.len()).max().unwrap_or(1);
    let (inbound, outbound, radius) = match turn {
        TurnDirection::Right => (from.inbound.last(), to.outbound.last(), junction.reach),
        TurnDirection::Left => {
            (from.inbound.first(), to.outbound.first(), junction.reach + SPACING * lanes as f64)
        }
    };
    let (Some(&inbound), Some(&outbound)) = (inbound, outbound) else { return };
    let special = junction.fits.iter().find(|(a, b, _)| (*a, *b) == (from.side, to.side));
    let chosen = special.map_or(Fit::Radius(radius), |(_, _, fit)| *fit);
    let name = format!("{}/{}-to-{}", junction.name, from.side.name(), to.side.name());
    match fit(net.curve(inbound), net.curve(outbound), turn, chosen) {
        Some(fillet) if fillet.radius() >= MIN_TURN_RADIUS - 1e-9 => {
            at.departures.push((inbound, fillet.from_s));
            at.arrivals.push((outbound, fillet.to_s));
            net.add_turn(name, BEND_SPEED, &fillet);
        }
        _ => {
            let reason = format!("no arc of {MIN_TURN_RADIUS} m or more fits");
            net.omitted.push(OmittedTurn { turn: name, reason });
        }
    }
}

fn least(stations: &[(&str, f64)], track: &str) -> Option<f64> {
    stations.iter().filter(|(name, _)| *name == track).map(|(_, s)| *s).reduce(f64::min)
}

fn most(stations: &[(&str, f64)], track: &str) -> Option<f64> {
    stations.iter().filter(|(name, _)| *name == track).map(|(_, s)| *s).reduce(f64::max)
}

/// A through lane without turns crosses the junction beside its neighbour.
///
/// # Panics
/// If no lane of the arm has a turn.
fn beside(net: &RoadNetwork, stations: &[(&str, f64)], lanes: &[&str], track: &str) -> f64 {
    let neighbour = lanes.iter().find_map(|lane| Some((*lane, least(stations, lane)?)));
    let (lane, s) = neighbour.unwrap_or_else(|| panic!("no turn at this junction beside {track}"));
    net.curve(track).project(net.curve(lane).at(s).pose.position).s
}

/// Entries that give way: (lane, lanes it gives way to, name of the connector).
const YIELDING: &[(&str, &[&str], &str)] = &[
    ("south-boulevard/west/outer", WEST_RINGS, "west-roundabout/east-to-ring/outer"),
    ("south-boulevard/west/inner", WEST_RINGS, "west-roundabout/east-to-ring/inner"),
    ("south-boulevard/east/outer", EAST_RINGS, "east-roundabout/west-to-ring/outer"),
    ("south-boulevard/east/inner", EAST_RINGS, "east-roundabout/west-to-ring/inner"),
    ("centre-street/south/outer", SOUTH_WESTBOUND, "junction-centre-south/north-to-west/outer"),
    ("centre-street/south/inner", SOUTH_WESTBOUND, "junction-centre-south/north-to-west/inner"),
    ("ramp/south", SOUTH_WESTBOUND, "junction-ramp-south/north-to-west"),
    ("square-lane/east", SECOND_EAST, "junction-square-second/south-to-east"),
];

/// Exits that cross or leave an adjacent lane, likewise.
const LEAVING: &[(&str, &[&str], &str)] = &[
    ("west-street/north/outer", WEST_RINGS, "west-roundabout/ring-to-north/outer"),
    ("west-street/north/inner", WEST_RINGS, "west-roundabout/ring-to-north/inner"),
    ("south-boulevard/east/outer", WEST_RINGS, "west-roundabout/ring-to-east/outer"),
    ("south-boulevard/east/inner", WEST_RINGS, "west-roundabout/ring-to-east/inner"),
    ("east-street/north/outer", EAST_RINGS, "east-roundabout/ring-to-north/outer"),
    ("east-street/north/inner", EAST_RINGS, "east-roundabout/ring-to-north/inner"),
    ("south-boulevard/west/outer", EAST_RINGS, "east-roundabout/ring-to-west/outer"),
    ("south-boulevard/west/inner", EAST_RINGS, "east-roundabout/ring-to-west/inner"),
    ("centre-street/north/outer", SOUTH_WESTBOUND, "junction-centre-south/east-to-north/outer"),
    ("centre-street/north/inner", SOUTH_WESTBOUND, "junction-centre-south/east-to-north/inner"),
];

const WEST_RINGS: &[&str] = &["west-roundabout/ring/outer", "west-roundabout/ring/inner"];
const EAST_RINGS: &[&str] = &["east-roundabout/ring/outer", "east-roundabout/ring/inner"];
const SOUTH_WESTBOUND: &[&str] = &["south-boulevard/west/outer", "south-boulevard/west/inner"];

/// The yield line of the western roundabout's northern entry, as in the experiment.
const NORTHERN_YIELD_Y: f64 = -1.35;
/// Yield position of East Street's two entries into the eastern roundabout: more than the yield clearance
/// before its outer lane on both.
const EAST_YIELD: DVec2 = DVec2::new(1.965, -1.12);
/// Middle between the southbound lanes of West Street.
const WEST_STREET_X: f64 = -2.57;

fn add_yielding(net: &mut RoadNetwork) {
    for lane in ["outer", "inner"] {
        let track = format!("west-street/south/{lane}");
        let s = net.curve(&track).project(DVec2::new(WEST_STREET_X, NORTHERN_YIELD_Y)).s;
        net.yield_at(&track, s, &format!("west-roundabout/north-to-ring/{lane}"));
    }
    // Inner and outer entry have only just diverged: one line serves both.
    let at = ["outer", "inner"].map(|lane| {
        let track = format!("east-street/south/{lane}");
        let curve = net.curve(&track);
        let s = curve.project(EAST_YIELD).s;
        let at = curve.at(s).pose.position;
        net.cross(
            &track,
            s + LINE_SETBACK,
            net.curve(&track).length(),
            format!("east-roundabout/north-to-ring/{lane}"),
        );
        at
    });
    let along = (at[1] - at[0]).normalize_or(DVec2::X) * (LANE_WIDTH / 2.0);
    net.lines.push(DraftControlLine { kind: ControlLineKind::Yield, ends: [at[1] + along, at[0] - along] });
    for (track, others, name) in YIELDING {
        net.yield_before(track, others, YIELD_CLEARANCE, name);
    }
    for (track, others, name) in LEAVING {
        net.leave(track, others, YIELD_CLEARANCE, name);
    }
}
