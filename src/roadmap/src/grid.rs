//! Grid maps: streets and avenues that cross at four-way junctions, drawn as any map is. The map for studies of
//! intersections, corridors and scale.

use super::dxf::{Drawing, EntityShape, Units};
use super::{LANE_WIDTH_M, MapErrors, layers, map_of_drawing};
use city3d_geometry::lab::{Curve, Segment};
use glam::DVec2;
use std::str::FromStr;
use thiserror::Error;

/// Distance between the centre lines of the two directions of a road, as in the shipped city.
const SPACING_M: f64 = 0.151;
/// Distance of a stop or yield line from the junction.
const LINE_SETBACK_M: f64 = 0.015;
/// Height of names in the drawing.
const NAME_HEIGHT_M: f64 = 0.02;
/// Most roads of each of the two directions.
const MOST_ROADS: u32 = 100;
/// Headings of traffic, in the order of quarter turns to the left.
const HEADINGS: [&str; 4] = ["east", "north", "west", "south"];

/// Number of roads of a grid: `2x3` has 2 streets from west to east, 3 avenues from south to north, and 6 junctions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GridSize {
    /// Roads from west to east, numbered from the south.
    pub streets: u32,
    /// Roads from south to north, numbered from the west.
    pub avenues: u32,
}

impl FromStr for GridSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse().ok().filter(|number| (1..=MOST_ROADS).contains(number));
        let parts = text.split_once(['x', 'X']).and_then(|(n, m)| number(n).zip(number(m)));
        parts.map(|(streets, avenues)| Self { streets, avenues }).ok_or_else(|| {
            format!("a number of streets and one of avenues from 1 to {MOST_ROADS} are needed, as in 5x5")
        })
    }
}

/// Who gives way at the junctions of a grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GridControl {
    /// Avenues have yield lines.
    #[default]
    Yield,
    /// Avenues have stop lines.
    Stop,
    /// Streets and avenues have stop lines.
    AllWayStop,
    /// No lines.
    None,
}

impl FromStr for GridControl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "yield" => Ok(Self::Yield),
            "stop" => Ok(Self::Stop),
            "all-way-stop" => Ok(Self::AllWayStop),
            "none" => Ok(Self::None),
            _ => Err("there are: yield, stop, all-way-stop, none".to_owned()),
        }
    }
}

/// A grid of two-way roads with one lane in each direction, traffic on the right. Laboratory metres.
///
/// ```
/// use city3d_roadmap::{Grid, load_map};
///
/// let grid = Grid { size: "1x3".parse().unwrap(), ..Grid::default() };
/// let map = load_map(grid.to_dxf().unwrap().as_bytes()).unwrap().map;
/// let block = map.lane_by_name("street-1/east/2").unwrap();
/// assert!((block.curve.length() - 6.0).abs() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Number of its roads.
    pub size: GridSize,
    /// Length of the lanes between two junctions.
    pub block_m: f64,
    /// Length of the lanes that lead into the grid and out of it.
    pub entry_m: f64,
    /// Radius of right turns; that of left turns is larger by the distance of the two lanes of a road.
    pub turn_radius_m: f64,
    /// Stop and yield lines.
    pub control: GridControl,
}

impl Default for Grid {
    /// One junction, with approaches of 250 m at full scale.
    fn default() -> Self {
        Self {
            size: GridSize { streets: 1, avenues: 1 },
            block_m: 6.0,
            entry_m: 10.0,
            turn_radius_m: 0.25,
            control: GridControl::Yield,
        }
    }
}

/// A grid that makes no map.
#[derive(Debug, Error)]
pub enum GridError {
    /// A dimension out of its range.
    #[error("{what} is {found} m; it must be between {least} and {most} m")]
    Dimension {
        /// The dimension.
        what: &'static str,
        /// Its value, laboratory metres.
        found: f64,
        /// Least value, laboratory metres.
        least: f64,
        /// Largest value, laboratory metres.
        most: f64,
    },
    /// The grid exceeds a limit of maps.
    #[error("this grid exceeds what a map may have: {0}; choose fewer or shorter roads")]
    Map(#[from] MapErrors),
}

/// The two lanes at one end of a road, where traffic enters and leaves the grid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GridArm {
    /// Name of the lane into the grid.
    pub entry: String,
    /// Name of the lane out of the grid.
    pub exit: String,
}

/// A lane's way through a junction: the traffic's heading before and after it.
struct Turn {
    /// Quarter turns to the left: 0 straight ahead, 1 left, 3 right.
    quarters: usize,
    shape: EntityShape,
    curve: Curve,
}

impl Grid {
    /// The drawing as the text of a DXF file, checked to be a map.
    ///
    /// # Errors
    /// When a dimension is out of its range, or the map would exceed a limit.
    pub fn to_dxf(&self) -> Result<String, GridError> {
        for (what, found, least, most) in [
            ("the length between junctions", self.block_m, 0.5, 100.0),
            ("the length of the entries", self.entry_m, 0.5, 100.0),
            ("the radius of turns", self.turn_radius_m, 0.15, 2.0),
        ] {
            if !(least..=most).contains(&found) {
                return Err(GridError::Dimension { what, found, least, most });
            }
        }
        let drawing = self.drawing();
        map_of_drawing(&drawing)?;
        Ok(drawing.to_dxf())
    }

    /// The arms of the grid, counter-clockwise: in the west, south, east and north, each by the number of the road.
    pub fn arms(&self) -> Vec<GridArm> {
        let arms = |heading: usize| {
            (0..self.roads(heading)).map(move |road| {
                let back = (heading + 2) % 4;
                GridArm {
                    entry: self.lane_name(heading, road, 0),
                    exit: self.lane_name(back, road, self.junctions(heading)),
                }
            })
        };
        // Who comes from the west drives east.
        [0, 1, 2, 3].into_iter().flat_map(arms).collect()
    }

    fn drawing(&self) -> Drawing {
        let mut drawing = Drawing { units: Units::Metres, entities: Vec::new() };
        let mut names = Vec::new();
        for heading in 0..4 {
            for road in 0..self.roads(heading) {
                for block in 0..=self.junctions(heading) {
                    let (from, to) = self.lane_ends(heading, road, block);
                    drawing.add(layers::LANES, EntityShape::Line { from, to });
                    names.push(((from + to) / 2.0, self.lane_name(heading, road, block)));
                }
            }
        }
        let turns = self.turns();
        for street in 0..self.size.streets {
            for avenue in 0..self.size.avenues {
                let centre = self.centre(street, avenue);
                for heading in 0..4 {
                    for turn in &turns {
                        drawing.add(layers::CONNECTORS, placed(&turn.shape, centre, heading));
                        let at = centre + rotated(name_place(turn, &turns), heading);
                        names.push((at, turn_name(street, avenue, heading, turn.quarters)));
                    }
                }
            }
        }
        for (at, text) in names {
            drawing.add(layers::NAMES, EntityShape::Text { at, height: NAME_HEIGHT_M, text });
        }
        self.add_lines(&mut drawing);
        drawing
    }

    fn add_lines(&self, drawing: &mut Drawing) {
        let (layer, headings): (_, &[usize]) = match self.control {
            GridControl::Yield => (layers::YIELD_LINES, &[1, 3]),
            GridControl::Stop => (layers::STOP_LINES, &[1, 3]),
            GridControl::AllWayStop => (layers::STOP_LINES, &[0, 1, 2, 3]),
            GridControl::None => return,
        };
        for &heading in headings {
            for road in 0..self.roads(heading) {
                for block in 0..self.junctions(heading) {
                    let (_, end) = self.lane_ends(heading, road, block);
                    let ends = [0.5, -0.5]
                        .map(|side| end + rotated(DVec2::new(-LINE_SETBACK_M, side * LANE_WIDTH_M), heading));
                    drawing.add(layer, EntityShape::Line { from: ends[0], to: ends[1] });
                }
            }
        }
    }

    /// Roads that a heading drives on.
    fn roads(&self, heading: usize) -> u32 {
        if heading.is_multiple_of(2) { self.size.streets } else { self.size.avenues }
    }

    /// Junctions along each of these roads.
    fn junctions(&self, heading: usize) -> u32 {
        if heading.is_multiple_of(2) { self.size.avenues } else { self.size.streets }
    }

    /// Half the width of a junction.
    fn half_junction_m(&self) -> f64 {
        self.turn_radius_m + SPACING_M / 2.0
    }

    fn centre(&self, street: u32, avenue: u32) -> DVec2 {
        let pitch_m = self.block_m + 2.0 * self.half_junction_m();
        let middle = |roads: u32| f64::from(roads - 1) / 2.0;
        let place = |road: u32, roads: u32| (f64::from(road) - middle(roads)) * pitch_m;
        DVec2::new(place(avenue, self.size.avenues), place(street, self.size.streets))
    }

    /// Junction of a road by its place along a heading.
    fn junction_centre(&self, heading: usize, road: u32, along: u32) -> DVec2 {
        let place = if heading < 2 { along } else { self.junctions(heading) - 1 - along };
        if heading.is_multiple_of(2) { self.centre(road, place) } else { self.centre(place, road) }
    }

    /// Ends of a lane between junctions, or between one and the edge, by its place along the heading.
    fn lane_ends(&self, heading: usize, road: u32, block: u32) -> (DVec2, DVec2) {
        let half_m = self.half_junction_m();
        let point = |along: u32, ahead_m: f64| {
            let aside = DVec2::new(ahead_m, -SPACING_M / 2.0);
            self.junction_centre(heading, road, along) + rotated(aside, heading)
        };
        let from = match block.checked_sub(1) {
            Some(before) => point(before, half_m),
            None => point(0, -half_m - self.entry_m),
        };
        let last = self.junctions(heading) - 1;
        let to = if block <= last { point(block, -half_m) } else { point(last, half_m + self.entry_m) };
        (from, to)
    }

    fn lane_name(&self, heading: usize, road: u32, block: u32) -> String {
        let kind = if heading.is_multiple_of(2) { "street" } else { "avenue" };
        format!("{kind}-{}/{}/{}", road + 1, HEADINGS[heading], block + 1)
    }

    /// The ways of eastbound traffic through a junction at the origin.
    fn turns(&self) -> [Turn; 3] {
        let (half_m, aside_m) = (self.half_junction_m(), SPACING_M / 2.0);
        let [from, to] = [-half_m, half_m].map(|x| DVec2::new(x, -aside_m));
        let straight = Turn {
            quarters: 0,
            shape: EntityShape::Line { from, to },
            curve: Curve::new(vec![Segment::line(from, to)]),
        };
        let turn = |quarters: usize, y: f64, radius: f64, from_deg: f64| {
            let centre = DVec2::new(-half_m, y);
            let shape = EntityShape::Arc { centre, radius, from_deg, to_deg: from_deg + 90.0 };
            let arc = Segment::arc(centre, radius, from_deg.to_radians(), 90_f64.to_radians());
            Turn { quarters, shape, curve: Curve::new(vec![arc]) }
        };
        let left = turn(1, half_m, half_m + aside_m, 270.0);
        let right = turn(3, -half_m, half_m - aside_m, 0.0);
        [straight, left, right]
    }
}

fn turn_name(street: u32, avenue: u32, heading: usize, quarters: usize) -> String {
    let (from, to) = (HEADINGS[(heading + 2) % 4], HEADINGS[(heading + quarters) % 4]);
    format!("junction-{}-{}/{from}-to-{to}", street + 1, avenue + 1)
}

/// A vector that points east, turned to a heading.
fn rotated(east: DVec2, heading: usize) -> DVec2 {
    match heading {
        0 => east,
        1 => east.perp(),
        2 => -east,
        _ => -east.perp(),
    }
}

/// A shape at the origin for eastbound traffic, moved to a junction and turned to a heading.
fn placed(shape: &EntityShape, at: DVec2, heading: usize) -> EntityShape {
    let place = |point: DVec2| at + rotated(point, heading);
    match *shape {
        EntityShape::Arc { centre, radius, from_deg, to_deg } => {
            let turned = |deg: f64| (deg + 90.0 * heading as f64) % 360.0;
            let (from_deg, to_deg) = (turned(from_deg), turned(to_deg));
            EntityShape::Arc { centre: place(centre), radius, from_deg, to_deg }
        }
        EntityShape::Line { from, to } => EntityShape::Line { from: place(from), to: place(to) },
        ref other => other.clone(),
    }
}

/// Where the name of a way through a junction stands: on it, as far as possible from all other ways.
fn name_place(turn: &Turn, turns: &[Turn; 3]) -> DVec2 {
    let clearance_m = |at: DVec2| {
        let mut least_m = f64::INFINITY;
        for heading in 0..4 {
            // Seen from the traffic of another heading, the place is turned back.
            let seen = rotated(at, (4 - heading) % 4);
            for other in turns.iter().filter(|other| heading != 0 || other.quarters != turn.quarters) {
                let foot = other.curve.at(other.curve.project(seen).s).pose.position;
                least_m = least_m.min(foot.distance(seen));
            }
        }
        least_m
    };
    let places = (1..40).map(|k| turn.curve.at(turn.curve.length() * f64::from(k) / 40.0).pose.position);
    let best = places.map(|at| (clearance_m(at), at)).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(DVec2::ZERO, |(_, at)| at)
}
