//! Tables of the city blocks: buildings, grounds, water, walls and furniture.

use city3d_roadmap::SceneryKind::{self, Bed, Grass, Parking, Paving, Playground, Water};

/// An axis-aligned plot: name, west, south, east and north edge, height (zero if flat).
pub(super) struct Plot(pub &'static str, pub [f64; 4], pub f64);

/// Buildings whose front does not face the nearest road.
pub(super) const FRONTS: &[(&str, &str)] = &[
    ("fire station", "W"),
    ("theatre", "S"),
    ("hotel", "S"),
    ("cinema", "S"),
    ("town hall", "W"),
    ("filling station shop", "W"),
    ("garden house", "S"),
];

/// Detached buildings. Heights are the full-scale ones over 25: four to 25 m.
pub(super) const BUILDINGS: &[Plot] = &[
    // Town square: east row, south row, west.
    Plot("bookshop", [-0.66, 0.14, -0.40, 0.41], 0.36),
    Plot("bakery", [-0.66, 0.43, -0.40, 0.72], 0.32),
    Plot("pharmacy", [-0.66, 0.74, -0.40, 1.03], 0.44),
    Plot("town hall", [-0.66, 1.10, -0.36, 1.52], 0.60),
    Plot("toy shop", [-1.88, 0.10, -1.61, 0.29], 0.32),
    Plot("department store", [-1.58, 0.10, -1.24, 0.31], 0.52),
    Plot("shoe shop", [-1.21, 0.10, -0.97, 0.29], 0.32),
    Plot("flower shop", [-0.94, 0.10, -0.70, 0.29], 0.28),
    Plot("hat shop", [-2.05, 0.30, -1.83, 0.52], 0.32),
    // Between North and Second Avenue.
    Plot("corner house", [-0.45, 2.14, -0.25, 2.44], 0.52),
    Plot("office", [0.25, 2.14, 0.41, 2.44], 0.64),
    Plot("workshop", [1.64, 2.14, 1.80, 2.44], 0.28),
    // Inside the north-east loop.
    Plot("garden house", [2.32, 1.62, 2.60, 1.95], 0.32),
    Plot("summer house", [2.34, 2.12, 2.46, 2.24], 0.16),
    // East of Centre Street.
    Plot("fire station", [0.44, 0.98, 0.90, 1.34], 0.36),
    Plot("hose tower", [0.44, 1.40, 0.54, 1.50], 0.80),
    Plot("apartments", [0.40, 0.12, 0.62, 0.62], 0.72),
    Plot("apartments", [0.70, 0.12, 0.90, 0.62], 0.60),
    Plot("filling station canopy", [1.16, 0.24, 1.42, 0.42], 0.20),
    Plot("filling station shop", [1.54, 0.20, 1.74, 0.44], 0.18),
    Plot("bandstand", [1.56, 1.24, 1.68, 1.36], 0.20),
    // South-west.
    Plot("theatre", [-1.88, -1.06, -1.50, -0.72], 0.72),
    Plot("hotel", [-1.42, -1.10, -1.20, -0.72], 1.00),
    Plot("cinema", [-1.14, -1.06, -0.94, -0.80], 0.48),
    Plot("cafe", [-1.46, -1.36, -1.28, -1.18], 0.20),
    Plot("cafe", [-1.25, -1.36, -1.07, -1.18], 0.24),
    Plot("cafe", [-1.04, -1.34, -0.92, -1.18], 0.20),
    Plot("park cafe", [-1.30, -1.70, -1.08, -1.54], 0.18),
    // South-east.
    Plot("villa", [1.34, -1.04, 1.56, -0.74], 0.36),
    Plot("villa", [1.60, -1.02, 1.80, -0.74], 0.32),
    // Corners of the city.
    Plot("warehouse", [-3.12, -3.12, -2.84, -2.84], 0.40),
    Plot("mill", [1.40, -3.12, 1.80, -2.84], 0.56),
    Plot("factory", [1.88, -3.12, 2.26, -2.74], 0.48),
    Plot("depot", [2.34, -3.12, 2.74, -2.70], 0.40),
    Plot("school", [-3.10, 2.44, -2.72, 2.74], 0.44),
    Plot("chapel", [-2.90, 2.86, -2.52, 3.12], 0.60),
    Plot("observatory", [2.86, 2.76, 3.12, 3.10], 0.48),
];

/// A row of buildings of one size: south-west corner of the first, size, step to the next, number, and range
/// of heights.
pub(super) struct BuildingRow {
    pub name: &'static str,
    pub first: [f64; 2],
    pub size: [f64; 2],
    pub step: [f64; 2],
    pub count: usize,
    pub heights: [f64; 2],
}

const fn row(
    name: &'static str,
    first: [f64; 2],
    size: [f64; 2],
    step: [f64; 2],
    count: usize,
) -> BuildingRow {
    BuildingRow { name, first, size, step, count, heights: [0.24, 0.40] }
}

pub(super) const ROWS: &[BuildingRow] = &[
    row("row house", [-0.56, -1.72], [0.18, 0.20], [0.0, 0.24], 4),
    row("house", [2.32, 0.10], [0.24, 0.28], [0.29, 0.0], 3),
    row("house", [2.30, -0.34], [0.24, 0.30], [0.29, 0.0], 3),
    row("house", [2.30, -0.76], [0.24, 0.30], [0.29, 0.0], 3),
    row("house", [2.60, -1.16], [0.22, 0.28], [0.28, 0.0], 2),
    row("house", [2.87, -2.66], [0.25, 0.32], [0.0, 0.42], 3),
    row("house", [-3.12, -1.30], [0.29, 0.26], [0.0, 0.36], 5),
    row("house", [-3.12, 0.56], [0.29, 0.32], [0.0, 0.0], 1),
    row("house", [-3.11, 1.02], [0.34, 0.30], [0.0, 0.0], 1),
    row("house", [-3.07, 1.44], [0.40, 0.32], [0.0, 0.46], 2),
    BuildingRow {
        name: "apartments",
        first: [-2.34, 2.97],
        size: [0.36, 0.18],
        step: [0.46, 0.0],
        count: 11,
        heights: [0.32, 0.80],
    },
    BuildingRow {
        name: "terrace",
        first: [-2.06, -3.13],
        size: [0.36, 0.17],
        step: [0.43, 0.0],
        count: 8,
        heights: [0.28, 0.56],
    },
];

/// Ground and water areas with straight edges.
pub(super) struct GroundArea(pub SceneryKind, pub &'static str, pub &'static [[f64; 2]]);

pub(super) const AREAS: &[GroundArea] = &[
    GroundArea(
        Paving,
        "town square",
        &[
            [-2.07, 0.30],
            [-1.90, 0.05],
            [-0.42, 0.05],
            [-0.36, 0.12],
            [-0.36, 0.60],
            [-0.30, 1.05],
            [-0.30, 1.62],
            [-1.00, 1.62],
            [-1.17, 1.55],
            [-1.28, 1.40],
            [-1.33, 1.24],
            [-1.44, 1.04],
            [-1.60, 0.93],
            [-1.80, 0.89],
            [-1.98, 0.80],
            [-2.07, 0.64],
        ],
    ),
    GroundArea(
        Parking,
        "car park west of the square",
        &[[-2.06, 1.23], [-1.64, 1.23], [-1.64, 1.64], [-2.06, 1.64]],
    ),
    GroundArea(
        Parking,
        "car park on the square",
        &[[-1.20, 1.08], [-0.74, 1.08], [-0.74, 1.52], [-1.20, 1.52]],
    ),
    GroundArea(Parking, "car park north-west", &[[-1.95, 2.10], [-0.52, 2.10], [-0.52, 2.49], [-1.95, 2.49]]),
    GroundArea(Parking, "car park north-east", &[[0.46, 2.10], [1.58, 2.10], [1.58, 2.49], [0.46, 2.49]]),
    GroundArea(Grass, "garden", &[[2.28, 1.14], [2.62, 1.14], [2.62, 2.28], [2.28, 2.28]]),
    GroundArea(
        Paving,
        "fire station forecourt",
        &[[0.37, 0.74], [0.93, 0.74], [0.93, 1.60], [0.30, 1.60], [0.30, 1.05]],
    ),
    GroundArea(
        Paving,
        "filling station forecourt",
        &[[1.02, 0.16], [1.78, 0.16], [1.78, 0.48], [1.02, 0.48]],
    ),
    GroundArea(
        Grass,
        "small park",
        &[[1.38, 1.25], [1.43, 1.08], [1.56, 0.95], [1.82, 0.97], [1.82, 1.61], [1.40, 1.61]],
    ),
    GroundArea(
        Paving,
        "theatre court",
        &[[-1.92, -1.38], [-0.88, -1.38], [-0.88, -0.98], [-1.00, -0.76], [-1.20, -0.68], [-1.92, -0.68]],
    ),
    GroundArea(
        Grass,
        "cafe park",
        &[[-1.54, -1.45], [-0.86, -1.45], [-0.86, -1.92], [-0.98, -2.08], [-1.24, -2.12], [-1.45, -1.98]],
    ),
    GroundArea(
        Parking,
        "car park of the park",
        &[[0.45, -0.98], [1.24, -0.98], [1.24, -0.72], [0.45, -0.72]],
    ),
    GroundArea(
        Grass,
        "swan park",
        &[[0.40, -1.95], [0.70, -2.12], [1.00, -2.12], [1.25, -1.95], [1.25, -1.04], [0.40, -1.04]],
    ),
    GroundArea(Playground, "playground", &[[0.92, -1.42], [1.20, -1.42], [1.20, -1.12], [0.92, -1.12]]),
    GroundArea(Paving, "garden path", &[[2.235, -0.54], [2.30, -0.54], [2.30, -0.50], [2.235, -0.50]]),
    GroundArea(Paving, "garden path", &[[2.235, -0.12], [2.30, -0.12], [2.30, -0.08], [2.235, -0.08]]),
    GroundArea(Grass, "gardens", &[[2.44, -1.20], [3.13, -1.20], [3.13, 0.44], [2.28, 0.44], [2.28, -0.80]]),
];

/// Paved drives between car parks and kerbs, and a path to the park: west, south, east and north edge.
pub(super) const DRIVES: &[[f64; 4]] = &[
    [-1.32, 2.05, -1.13, 2.10],
    [0.93, 2.05, 1.12, 2.10],
    [-1.94, 1.64, -1.76, 1.69],
    [-0.94, 1.52, -0.76, 1.69],
    [0.76, -0.72, 0.94, -0.65],
    [0.80, -1.04, 0.89, -0.98],
    [1.30, 0.48, 1.46, 0.52],
    [0.19, 1.03, 0.31, 1.32],
];

/// Areas kept free: in front of wide doors, and where kerbs round off the ground between lanes.
pub(super) const CLEAR: &[[f64; 4]] = &[
    [0.18, 0.96, 0.44, 1.36],
    [1.00, 0.16, 1.54, 0.52],
    [-2.08, 2.05, -2.03, 2.09],
    [-0.71, -0.69, -0.66, -0.64],
    [-0.02, -2.21, 0.03, -2.16],
    [-0.69, -2.19, -0.64, -2.14],
];
/// Least distance between street lamps and driveways.
pub(super) const CLEAR_OF_DRIVES: f64 = 0.08;

/// Lamps away from the roads.
pub(super) const LAMPS: &[[f64; 2]] = &[
    [-1.50, 0.62],
    [-1.15, 0.92],
    [-0.80, 0.62],
    [-1.15, 0.44],
    [-0.70, 1.05],
    [-1.78, 0.62],
    [-1.80, -1.20],
    [-1.56, -1.20],
    [-1.36, -1.74],
    [0.62, -1.46],
    [0.98, -1.78],
    [1.62, 1.42],
];

/// Circular areas: kind, name, centre, radius.
pub(super) struct RoundArea(pub SceneryKind, pub &'static str, pub [f64; 2], pub f64);

pub(super) const ROUNDS: &[RoundArea] = &[
    RoundArea(Grass, "west roundabout's island", [-2.27, -2.17], 0.34),
    RoundArea(Grass, "east roundabout's island", [2.05, -1.91], 0.34),
    RoundArea(Bed, "roundabout bed", [-2.27, -2.17], 0.09),
    RoundArea(Bed, "roundabout bed", [2.05, -1.91], 0.09),
    RoundArea(Bed, "round bed", [-1.15, 0.68], 0.11),
    RoundArea(Bed, "rose bed", [1.62, 1.10], 0.05),
    RoundArea(Bed, "flower bed", [-1.16, -1.86], 0.06),
    RoundArea(Water, "garden pond", [2.45, 1.34], 0.10),
    RoundArea(Water, "swan pond", [0.78, -1.72], 0.17),
];

/// Low walls and hedges, along their centre lines.
pub(super) const WALLS: &[&[[f64; 2]]] = &[
    &[[2.28, 2.30], [2.28, 1.12], [2.62, 1.12]],
    &[[0.93, 0.76], [0.93, 1.58]],
    &[[-1.92, -0.70], [-1.92, -1.14]],
    &[[-0.90, -1.16], [-0.90, -1.02]],
    &[[1.00, 0.10], [1.76, 0.10]],
    &[[0.40, 0.08], [0.90, 0.08]],
    &[[-3.13, -1.42], [-2.80, -1.42]],
    &[[3.15, -2.70], [3.15, -1.25]],
];

pub(super) const HEDGES: &[&[[f64; 2]]] = &[
    &[[-1.95, 2.08], [-1.36, 2.08]],
    &[[-1.09, 2.08], [-0.52, 2.08]],
    &[[-1.95, 2.51], [-0.52, 2.51]],
    &[[0.46, 2.08], [0.89, 2.08]],
    &[[1.16, 2.08], [1.58, 2.08]],
    &[[0.46, 2.51], [1.58, 2.51]],
    &[[-2.08, 1.22], [-2.08, 1.62]],
    &[[-1.22, 1.08], [-1.22, 1.40]],
    &[[0.38, -1.10], [0.38, -1.60]],
    &[[0.45, -1.01], [0.79, -1.01]],
    &[[0.90, -1.01], [1.24, -1.01]],
    &[[1.815, 1.06], [1.815, 1.50]],
    &[[2.26, -0.70], [2.26, -0.55]],
    &[[2.26, -0.49], [2.26, -0.13]],
    &[[2.26, -0.07], [2.26, 0.28]],
    &[[3.085, 1.00], [3.085, 2.40]],
    &[[-3.08, -2.70], [-3.08, -1.60]],
    &[[1.30, -0.70], [1.30, -1.10], [1.80, -1.10]],
];

/// Benches and picnic tables: position and heading in degrees.
pub(super) const BENCHES: &[[f64; 3]] = &[
    [1.44, 1.42, 90.0],
    [1.62, 1.52, 0.0],
    [1.74, 1.20, 90.0],
    [1.50, 1.10, 45.0],
    [-1.40, -1.60, 90.0],
    [-1.00, -1.80, 90.0],
    [-1.20, -1.97, 0.0],
    [-1.30, -1.12, 0.0],
    [0.55, -1.55, 60.0],
    [0.78, -1.49, 0.0],
    [1.02, -1.60, 120.0],
    [0.56, -1.88, 130.0],
    [2.34, 1.48, 0.0],
    [0.88, -1.27, 90.0],
    [-0.98, 0.38, 0.0],
    [-1.40, 0.38, 0.0],
];

pub(super) const PICNIC_TABLES: &[[f64; 3]] = &[
    [0.50, -1.15, 10.0],
    [0.66, -1.13, 80.0],
    [0.52, -1.30, 45.0],
    [0.70, -1.28, 20.0],
    [1.10, -1.80, 60.0],
    [1.15, -1.60, 0.0],
    [-0.97, -1.64, 30.0],
    [-1.30, -1.82, 75.0],
];

/// Groves: bounds, and the spacing of the jittered grid on which trees are placed.
pub(super) const GROVES: &[([f64; 4], f64)] = &[
    ([0.42, -2.08, 1.24, -1.04], 0.13),
    ([-1.52, -2.06, -0.88, -1.42], 0.13),
    ([-1.96, -1.80, -1.54, -1.42], 0.13),
    ([1.40, 0.98, 1.82, 1.60], 0.12),
    ([2.28, 1.14, 2.62, 2.30], 0.14),
    ([2.28, -1.20, 3.13, 0.44], 0.10),
    ([2.30, -1.55, 3.13, -1.20], 0.16),
    ([2.20, -2.80, 2.85, -2.30], 0.17),
    ([1.28, -1.70, 1.80, -1.12], 0.15),
    ([-2.50, -2.40, -2.04, -1.94], 0.15),
    ([1.82, -2.14, 2.28, -1.68], 0.15),
    ([-1.64, 0.34, -0.72, 1.00], 0.20),
    ([0.94, 0.50, 1.15, 0.80], 0.14),
    ([1.00, -0.02, 1.80, 0.14], 0.13),
    ([-3.13, -1.45, -2.80, 2.40], 0.14),
    ([-3.13, -2.80, -3.02, -1.50], 0.12),
    ([2.80, -2.70, 3.13, -1.20], 0.14),
    ([3.04, 0.60, 3.15, 2.70], 0.11),
    ([-3.13, 2.76, 3.13, 3.15], 0.13),
    ([-2.80, -3.15, 3.13, -2.86], 0.13),
];
