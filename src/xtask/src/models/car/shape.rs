//! Side views of the body types, in metres: x from the middle forward, z above the road.

use super::{WHEEL_RADIUS_M, WHEELBASE_M};

/// The parameters of a body type.
#[derive(Clone, Copy, Debug)]
pub struct CarShape {
    pub name: &'static str,
    pub height: f32,
    /// Lower edge between the wheels.
    pub(super) sill: f32,
    /// Height of the shoulder: the edge between side and bonnet, window or boot; from the rear to the front.
    pub(super) shoulder: &'static [(f32, f32)],
    /// How far the middle of the bonnet lies above its edges.
    pub(super) crown: f32,
    /// How far the upper and the lower edge recede behind the bumper: front, rear.
    pub(super) rake: [[f32; 2]; 2],
    /// How far corners recede behind the middle: front, rear.
    pub(super) bow: [f32; 2],
    pub(super) cabin: Cabin,
    pub(super) rear: Rear,
    /// Dark plastic along the sills and around the wheels.
    pub(super) clad: bool,
    /// Rails along the roof.
    pub(super) rails: bool,
    /// A lit sign on the roof.
    pub(super) sign: bool,
    /// Darker glass behind the front doors.
    pub(super) tinted: bool,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Cabin {
    /// Foot of the rear window, rear end of the roof, rear end of the side windows, pillar between the
    /// doors, front end of the roof, foot of the windscreen.
    pub(super) stations: [f32; 6],
    /// Height of the roof above the rear window, at its highest and above the windscreen.
    pub(super) roof: [f32; 3],
    /// Half width of the roof.
    pub(super) roof_half: f32,
}

/// The rear of a body type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rear {
    Boot,
    Hatch,
    /// Sheet metal instead of side windows, two doors at the back.
    Cargo,
    /// An open bed.
    Bed,
}

pub const SEDAN: CarShape = CarShape {
    name: "sedan",
    height: 1.45,
    sill: 0.19,
    shoulder: &[
        (-2.5, 0.90),
        (-2.3, 0.94),
        (-1.6, 0.955),
        (-0.6, 0.93),
        (0.6, 0.90),
        (1.2, 0.89),
        (1.8, 0.83),
        (2.25, 0.74),
        (2.5, 0.68),
    ],
    crown: 0.05,
    rake: [[0.10, 0.06], [0.10, 0.08]],
    bow: [0.20, 0.13],
    cabin: Cabin {
        stations: [-1.86, -0.98, -1.12, -0.22, 0.40, 1.26],
        roof: [1.39, 1.45, 1.41],
        roof_half: 0.72,
    },
    rear: Rear::Boot,
    clad: false,
    rails: false,
    sign: false,
    tinted: false,
};

pub const TAXI: CarShape = CarShape { name: "taxi", height: 1.59, sign: true, ..SEDAN };

pub const ESTATE: CarShape = CarShape {
    name: "estate",
    height: 1.48,
    shoulder: &[
        (-2.5, 0.92),
        (-2.2, 0.965),
        (-1.4, 0.955),
        (-0.4, 0.93),
        (0.6, 0.90),
        (1.2, 0.89),
        (1.8, 0.83),
        (2.25, 0.74),
        (2.5, 0.68),
    ],
    rake: [[0.10, 0.06], [0.05, 0.08]],
    cabin: Cabin {
        stations: [-2.36, -1.92, -2.02, -0.22, 0.40, 1.26],
        roof: [1.40, 1.45, 1.41],
        roof_half: 0.73,
    },
    rear: Rear::Hatch,
    rails: true,
    tinted: true,
    ..SEDAN
};

pub const HATCHBACK: CarShape = CarShape {
    name: "hatchback",
    height: 1.48,
    sill: 0.20,
    shoulder: &[
        (-2.5, 0.95),
        (-2.2, 1.0),
        (-1.4, 0.985),
        (-0.4, 0.94),
        (0.8, 0.91),
        (1.5, 0.88),
        (2.1, 0.77),
        (2.5, 0.66),
    ],
    crown: 0.06,
    rake: [[0.12, 0.06], [0.06, 0.10]],
    bow: [0.24, 0.14],
    cabin: Cabin {
        stations: [-2.34, -1.70, -1.84, -0.12, 0.52, 1.46],
        roof: [1.40, 1.48, 1.43],
        roof_half: 0.74,
    },
    rear: Rear::Hatch,
    clad: false,
    rails: false,
    sign: false,
    tinted: true,
};

pub const SUV: CarShape = CarShape {
    name: "suv",
    height: 1.74,
    sill: 0.26,
    shoulder: &[
        (-2.5, 1.02),
        (-2.2, 1.08),
        (-1.0, 1.06),
        (0.4, 1.04),
        (1.2, 1.03),
        (1.9, 0.99),
        (2.3, 0.94),
        (2.5, 0.90),
    ],
    crown: 0.05,
    rake: [[0.05, 0.10], [0.03, 0.10]],
    bow: [0.16, 0.10],
    cabin: Cabin {
        stations: [-2.36, -2.06, -2.12, -0.24, 0.36, 1.10],
        roof: [1.66, 1.72, 1.69],
        roof_half: 0.78,
    },
    rear: Rear::Hatch,
    clad: true,
    rails: true,
    sign: false,
    tinted: true,
};

pub const VAN: CarShape = CarShape {
    name: "van",
    height: 2.10,
    sill: 0.24,
    shoulder: &[(-2.5, 1.12), (-1.0, 1.14), (0.8, 1.14), (1.6, 1.12), (2.0, 1.06), (2.3, 0.96), (2.5, 0.86)],
    crown: 0.05,
    rake: [[0.06, 0.06], [0.0, 0.05]],
    bow: [0.18, 0.05],
    cabin: Cabin {
        stations: [-2.44, -2.38, 0.42, 0.34, 1.02, 1.86],
        roof: [2.06, 2.10, 2.02],
        roof_half: 0.98,
    },
    rear: Rear::Cargo,
    clad: false,
    rails: false,
    sign: false,
    tinted: false,
};

pub const PICKUP: CarShape = CarShape {
    name: "pickup",
    height: 1.72,
    sill: 0.27,
    shoulder: &[(-2.5, 1.06), (-0.9, 1.06), (-0.4, 1.04), (1.0, 1.03), (1.9, 1.00), (2.3, 0.95), (2.5, 0.91)],
    crown: 0.05,
    rake: [[0.05, 0.09], [0.0, 0.06]],
    bow: [0.15, 0.05],
    cabin: Cabin {
        stations: [-0.86, -0.66, -0.72, 0.02, 0.54, 1.22],
        roof: [1.68, 1.72, 1.69],
        roof_half: 0.76,
    },
    rear: Rear::Bed,
    clad: true,
    rails: false,
    sign: false,
    tinted: false,
};

impl CarShape {
    /// Rear edge of the rear doors.
    pub(super) fn rear_door(&self) -> f32 {
        let [_, _, _, pillar, ..] = self.cabin.stations;
        (pillar - 0.95).max(-WHEELBASE_M / 2.0 + WHEEL_RADIUS_M * 0.7)
    }

    /// Whether the tail lamps stand upright beside a door or tailgate.
    pub(super) fn has_tall_lamps(&self) -> bool {
        matches!(self.rear, Rear::Cargo | Rear::Bed)
    }
}

/// Monotone interpolation between points: linear with slightly rounded corners.
pub(super) fn along(points: &[(f32, f32)], x: f32) -> f32 {
    let linear = |x: f32| {
        let after = points.partition_point(|p| p.0 < x).clamp(1, points.len() - 1);
        let (a, b) = (points[after - 1], points[after]);
        a.1 + (b.1 - a.1) * ((x - a.0) / (b.0 - a.0)).clamp(0.0, 1.0)
    };
    (linear(x - 0.12) + 2.0 * linear(x) + linear(x + 0.12)) / 4.0
}
