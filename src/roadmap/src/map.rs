//! The road map: a directed lane graph with conflict zones, control lines and scenery.

use city3d_geometry::{City, Curve, Frame, Lab, LengthScale};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Index of a lane in its map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct LaneId(pub u32);

impl LaneId {
    /// Position of the lane in [`RoadMap::lanes`].
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for LaneId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "lane {}", self.0)
    }
}

/// Whether a lane is part of a road or leads across a junction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LaneKind {
    /// A lane of a road, with markings.
    Lane,
    /// A lane across a junction, without markings.
    Connector,
}

/// A directed lane between two branchings of the lane graph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Lane<F: Frame = City> {
    /// Its index in [`RoadMap::lanes`].
    pub id: LaneId,
    /// Unique in the map and stable as long as the drawing is.
    pub name: String,
    /// Follows from the layer on which it is drawn.
    pub kind: LaneKind,
    /// Centre line in driving direction.
    pub curve: Curve<F>,
    /// Width of the straight lane. On tight arcs a lane is wider on the inside, by [`Lane::widening`].
    pub width_m: f64,
    /// Posted speed limit. Curve speeds may be lower.
    pub speed_limit_mps: f64,
    /// Lanes that start at its end, in id order.
    pub successors: Vec<LaneId>,
    /// Lanes that end at its start, in id order.
    pub predecessors: Vec<LaneId>,
    /// Adjacent lanes of the same direction, alongside for at least half of the lane.
    pub left: Option<LaneId>,
    /// As [`Self::left`], on the other side; `None` if there is none.
    pub right: Option<LaneId>,
}

/// Wheelbase of the testbed's car in lane widths: the vehicle that tight arcs are widened for.
const REFERENCE_WHEELBASE: f64 = 0.12 / 0.1524;
/// Arcs tighter than this many lane widths are widened.
const WIDENED_BELOW: f64 = 2.5;

impl<F: Frame> Lane<F> {
    /// Curve widening: the addition to the inner half width in a bend of this curvature. It equals the
    /// off-tracking of the testbed's car, whose rear axle cuts the inside of a bend that its front axle
    /// follows. Only arcs tighter than 2.5 lane widths are widened.
    pub fn widening(&self, curvature: f64) -> f64 {
        let radius = 1.0 / curvature.abs();
        if radius >= WIDENED_BELOW * self.width_m {
            return 0.0;
        }
        let wheelbase = REFERENCE_WHEELBASE * self.width_m;
        radius - (radius * radius - wheelbase * wheelbase).max(0.0).sqrt()
    }

    /// Distance from the centre line to the left and to the right edge at an arc length.
    pub fn half_widths_at(&self, s: f64) -> (f64, f64) {
        let curvature = self.curve.curvature_at(s);
        let (half, widening) = (self.width_m / 2.0, self.widening(curvature));
        if curvature > 0.0 { (half + widening, half) } else { (half, half + widening) }
    }
}

/// Index of a conflict zone in its map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ZoneId(pub u32);

impl ZoneId {
    /// Position of the zone in [`RoadMap::zones`].
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// How the lanes of a conflict zone meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ZoneKind {
    /// The lanes cross, or pass so close that two vehicles would touch.
    Cross,
    /// The lanes end in the same place.
    Merge,
    /// The lanes start in the same place.
    Diverge,
}

/// The part of a lane that lies in a conflict zone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ZoneSide {
    /// One of the two lanes of the zone.
    pub lane: LaneId,
    /// Arc length along the lane where the zone begins, metres of the map.
    pub from_m: f64,
    /// Arc length along the lane where the zone ends, metres of the map.
    pub to_m: f64,
}

/// A conflict zone: the parts of two lanes on which vehicles can touch. Ids are stable: zones are ordered by
/// their lanes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConflictZone {
    /// Its index in [`RoadMap::zones`].
    pub id: ZoneId,
    /// A merge or a diverge where the lanes share an end, otherwise a crossing.
    pub kind: ZoneKind,
    /// The side of the lane with the smaller id, then the other.
    pub sides: [ZoneSide; 2],
}

/// What a vehicle does at a control line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlLineKind {
    /// Stop first, then go when the junction is clear.
    Stop,
    /// Give way; stop only if necessary.
    Yield,
}

/// A stop or yield line across a lane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlLine {
    /// Follows from the layer on which it is drawn.
    pub kind: ControlLineKind,
    /// Lane that it applies to. A drawn line across several lanes yields a control line for each.
    pub lane: LaneId,
    /// Arc length along the lane.
    pub at_m: f64,
    /// As drawn.
    pub ends: [DVec2; 2],
}

/// A signal head: where the traffic of a lane waits for a traffic signal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SignalHead {
    /// Lane that leads to the junction.
    pub lane: LaneId,
    /// Where its traffic waits: arc length along the lane, metres of the map.
    pub at_m: f64,
}

/// The kind of a scenery item. Its DXF layer is `SCENERY_` and the name in capitals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneryKind {
    /// Solid; its text names it ("fire station"), a number in the text is its height.
    Building,
    /// Solid, low.
    Wall,
    /// Solid.
    Hedge,
    /// Circle of the crown.
    Tree,
    /// Street lamp.
    Lamp,
    /// Park bench.
    Bench,
    /// Grass of a park or a garden.
    Grass,
    /// Flower bed.
    Bed,
    /// Pond.
    Water,
    /// Paved ground: squares, forecourts.
    Paving,
    /// Asphalt with slanted parking bays.
    Parking,
    /// Playground.
    Playground,
    /// Table with benches.
    PicnicTable,
}

impl SceneryKind {
    /// In the order in which a map lists its scenery.
    pub const ALL: [Self; 13] = [
        Self::Building,
        Self::Wall,
        Self::Hedge,
        Self::Tree,
        Self::Lamp,
        Self::Bench,
        Self::Grass,
        Self::Bed,
        Self::Water,
        Self::Paving,
        Self::Parking,
        Self::Playground,
        Self::PicnicTable,
    ];

    /// The name of its DXF layer.
    pub fn layer(self) -> &'static str {
        match self {
            Self::Building => "SCENERY_BUILDING",
            Self::Wall => "SCENERY_WALL",
            Self::Hedge => "SCENERY_HEDGE",
            Self::Tree => "SCENERY_TREE",
            Self::Lamp => "SCENERY_LAMP",
            Self::Bench => "SCENERY_BENCH",
            Self::Grass => "SCENERY_GRASS",
            Self::Bed => "SCENERY_BED",
            Self::Water => "SCENERY_WATER",
            Self::Paving => "SCENERY_PAVING",
            Self::Parking => "SCENERY_PARKING",
            Self::Playground => "SCENERY_PLAYGROUND",
            Self::PicnicTable => "SCENERY_PICNIC_TABLE",
        }
    }

    /// Whether a vehicle that reaches into it has collided.
    pub fn is_solid(self) -> bool {
        matches!(self, Self::Building | Self::Wall | Self::Hedge)
    }
}

/// The footprint of a scenery item: its outline on the ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Footprint {
    /// Closed, corners in order, the first not repeated; bulges already flattened.
    Polygon(Vec<DVec2>),
    /// Open: a wall or a hedge along a line.
    Polyline(Vec<DVec2>),
    /// A disc: the crown of a tree, or another item drawn as a circle.
    Circle {
        /// Metres of the map.
        centre: DVec2,
        /// Metres of the map.
        radius_m: f64,
    },
}

/// An item of scenery beside the road.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scenery {
    /// Follows from the layer on which it is drawn.
    pub kind: SceneryKind,
    /// The text placed on it in the drawing, empty without one: "fire station".
    pub name: String,
    /// Height above ground where the drawing states one.
    pub height_m: Option<f64>,
    /// Heading of its front, counter-clockwise from east, if the drawing states it.
    pub front_rad: Option<f64>,
    /// Its outline on the ground, metres of the map.
    pub shape: Footprint,
}

/// A 3D model file placed on the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlacedModel {
    /// File name as in the drawing: "shed.glb".
    pub file: String,
    /// Position of its origin.
    pub at: DVec2,
    /// Heading of its front, counter-clockwise from east.
    pub front_rad: f64,
    /// Scale factor; the file is in full-scale metres.
    pub size: f64,
    /// Line of the drawing, 0 for one made in memory.
    pub line: usize,
}

/// A road map: lanes, zones, lines and scenery in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct RoadMap<F: Frame = City> {
    /// By id.
    pub lanes: Vec<Lane<F>>,
    /// By id.
    pub zones: Vec<ConflictZone>,
    /// Stop lines, then yield lines, each in the order of the file.
    pub lines: Vec<ControlLine>,
    /// Signal heads. A drawing has them in the order of the file; the map of an experiment has those that its
    /// signals control, in the order of their ids.
    pub signals: Vec<SignalHead>,
    /// By kind, in the order of [`SceneryKind::ALL`], then as in the file.
    pub scenery: Vec<Scenery>,
    /// Models from files. They are drawn only: nothing collides with them.
    pub models: Vec<PlacedModel>,
    /// Conflict zones by lane, sorted by where they begin.
    pub(super) zones_of_lane: Vec<Vec<ZoneId>>,
}

impl<F: Frame> RoadMap<F> {
    /// The lane with this id.
    ///
    /// # Panics
    /// If the map has no such lane: the id is that of another map.
    pub fn lane(&self, id: LaneId) -> &Lane<F> {
        &self.lanes[id.index()]
    }

    /// The conflict zone with this id.
    ///
    /// # Panics
    /// If the map has no such zone: the id is that of another map.
    pub fn zone(&self, id: ZoneId) -> &ConflictZone {
        &self.zones[id.index()]
    }

    /// The lane with exactly this name; `None` if the map has none.
    pub fn lane_by_name(&self, name: &str) -> Option<&Lane<F>> {
        self.lanes.iter().find(|lane| lane.name == name)
    }

    /// Zones on a lane, by where they begin on it.
    pub fn zones_on(&self, lane: LaneId) -> impl Iterator<Item = &ConflictZone> {
        self.zones_of_lane[lane.index()].iter().map(|&id| self.zone(id))
    }

    /// South-west and north-east corner of all lanes and scenery.
    pub fn bounds(&self) -> [DVec2; 2] {
        let mut low = DVec2::splat(f64::INFINITY);
        let mut high = DVec2::splat(f64::NEG_INFINITY);
        let mut add = |point: DVec2, margin: f64| {
            low = low.min(point - margin);
            high = high.max(point + margin);
        };
        for lane in &self.lanes {
            for (_, point) in lane.curve.sample(lane.width_m * 3.0) {
                add(point.pose.position, lane.width_m / 2.0);
            }
        }
        for scenery in &self.scenery {
            match &scenery.shape {
                Footprint::Polygon(points) | Footprint::Polyline(points) => {
                    points.iter().for_each(|&p| add(p, 0.0));
                }
                Footprint::Circle { centre, radius_m } => add(*centre, *radius_m),
            }
        }
        [low, high]
    }
}

/// The map as drawn, in laboratory metres. The control framework uses it.
///
/// ```
/// use city3d_roadmap::load_map;
/// use city3d_geometry::LengthScale;
/// use city3d_simulation::scenario::Library;
///
/// let map = load_map(&Library::default().map("ids3c")?)?.map;
/// let city = map.to_city(LengthScale::TESTBED);
/// let (lane, full_size) = (&map.lanes[0], &city.lanes[0]);
/// assert!((full_size.curve.length() - 25.0 * lane.curve.length()).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type LabMap = RoadMap<Lab>;

/// The map at full scale, in city metres. Simulation and rendering use it.
pub type CityMap = RoadMap<City>;

impl LabMap {
    /// The map at full scale.
    pub fn to_city(&self, scale: LengthScale) -> CityMap {
        let factor = scale.factor();
        let lanes = self.lanes.iter().map(|lane| Lane {
            curve: lane.curve.to_city(scale),
            width_m: lane.width_m * factor,
            speed_limit_mps: lane.speed_limit_mps * factor,
            id: lane.id,
            name: lane.name.clone(),
            kind: lane.kind,
            successors: lane.successors.clone(),
            predecessors: lane.predecessors.clone(),
            left: lane.left,
            right: lane.right,
        });
        let side = |s: ZoneSide| ZoneSide { from_m: s.from_m * factor, to_m: s.to_m * factor, ..s };
        let zones = self.zones.iter().map(|zone| ConflictZone { sides: zone.sides.map(side), ..*zone });
        let lines = self.lines.iter().map(|line| ControlLine {
            at_m: line.at_m * factor,
            ends: line.ends.map(|p| p * factor),
            ..*line
        });
        let points = |points: &[DVec2]| points.iter().map(|&p| p * factor).collect();
        let scenery = self.scenery.iter().map(|s| Scenery {
            front_rad: s.front_rad,
            height_m: s.height_m.map(|h| h * factor),
            shape: match &s.shape {
                Footprint::Polygon(p) => Footprint::Polygon(points(p)),
                Footprint::Polyline(p) => Footprint::Polyline(points(p)),
                Footprint::Circle { centre, radius_m } => {
                    Footprint::Circle { centre: *centre * factor, radius_m: radius_m * factor }
                }
            },
            ..s.clone()
        });
        RoadMap {
            lanes: lanes.collect(),
            zones: zones.collect(),
            lines: lines.collect(),
            signals: self.signals.iter().map(|h| SignalHead { at_m: h.at_m * factor, ..*h }).collect(),
            scenery: scenery.collect(),
            models: self.models.iter().map(|m| PlacedModel { at: m.at * factor, ..m.clone() }).collect(),
            zones_of_lane: self.zones_of_lane.clone(),
        }
    }
}
