//! Heights of the land: level near the town, then gently rolling, with hills at the horizon.

use super::super::ground_sheet::GRASS_M;
use super::super::hash_to_unit;
use glam::{DVec2, Vec3};

/// So far around the town the land is level: vehicles that leave the road drive on a plane.
pub(super) const LEVEL_M: f64 = 70.0;
/// Where the land rolls in full.
const ROLLING_M: f64 = 420.0;
/// Where hills begin, and where they have their full height.
const HILLS_M: [f64; 2] = [1500.0, 3800.0];
/// Mean rise of the rolling land: from a street one looks onto fields, not along them.
const RISE_M: f64 = 16.0;
/// Wavelength and amplitude of the rolling land.
const ROLLS: [(f64, f64); 2] = [(520.0, 17.0), (190.0, 5.0)];
/// Wavelength and height of the hills.
const HILLS: (f64, f64) = (1900.0, 260.0);
/// A yard is level up to its radius and joins the land at this multiple of it.
const YARD_EDGE: f64 = 1.7;

/// A level place in the land.
#[derive(Clone, Copy, Debug)]
pub(super) struct Yard {
    pub(super) at: DVec2,
    pub(super) radius_m: f64,
    pub(super) height_m: f64,
}

impl Yard {
    /// Corners of the ground within which it is level, and where it joins the land.
    pub(super) fn corners(&self) -> impl Iterator<Item = DVec2> {
        const CORNERS: u32 = 12;
        let (at, radius_m) = (self.at, self.radius_m);
        [1.0, YARD_EDGE].into_iter().flat_map(move |part| {
            (0..CORNERS).map(move |k| {
                let turn = std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS);
                at + DVec2::from_angle(turn) * (radius_m * part)
            })
        })
    }
}

/// The height field of the land around a box, metres.
#[derive(Clone, Debug)]
pub(super) struct Relief {
    /// The box of the closed ground.
    pub(super) town: [DVec2; 2],
    pub(super) yards: Vec<Yard>,
}

impl Relief {
    /// Distance from the box of the closed ground, 0 within it.
    pub(super) fn away_m(&self, at: DVec2) -> f64 {
        at.clamp(self.town[0], self.town[1]).distance(at)
    }

    /// Height at a place.
    pub(super) fn height_at(&self, at: DVec2) -> f64 {
        let open = self.open_height_at(at);
        let yard = self.yards.iter().find(|yard| yard.at.distance(at) < yard.radius_m * YARD_EDGE);
        yard.map_or(open, |yard| {
            let part = smoothstep([yard.radius_m, yard.radius_m * YARD_EDGE], yard.at.distance(at));
            yard.height_m + (open - yard.height_m) * part
        })
    }

    /// Height of the land without yards.
    pub(super) fn open_height_at(&self, at: DVec2) -> f64 {
        let away = self.away_m(at);
        let rolling = smoothstep([LEVEL_M, ROLLING_M], away);
        let rise = RISE_M * smoothstep([LEVEL_M, HILLS_M[0]], away);
        let rolls: f64 =
            ROLLS.iter().zip(1..).map(|(&(wave, tall), salt)| tall * (noise(at / wave, salt) - 0.5)).sum();
        let (wave, tall) = HILLS;
        let hills = tall * (noise(at / wave, 7) - 0.18).max(0.0) * smoothstep(HILLS_M, away);
        f64::from(GRASS_M) + rolling * rolls + rise + hills
    }

    /// Unit normal at a place.
    pub(super) fn normal_at(&self, at: DVec2) -> Vec3 {
        /// Distance of the samples: slopes between them do not count.
        const STEP_M: f64 = 12.0;
        let slope =
            |step: DVec2| ((self.height_at(at + step) - self.height_at(at - step)) / (2.0 * STEP_M)) as f32;
        Vec3::new(-slope(DVec2::X * STEP_M), -slope(DVec2::Y * STEP_M), 1.0).normalize_or(Vec3::Z)
    }
}

/// 0 below the first value, 1 above the second.
pub(super) fn smoothstep([from, to]: [f64; 2], value: f64) -> f64 {
    let part = ((value - from) / (to - from)).clamp(0.0, 1.0);
    part * part * (3.0 - 2.0 * part)
}

/// Value noise in [0, 1] with lattice cells of size 1 (Perlin 1985).
pub(super) fn noise(at: DVec2, salt: u32) -> f64 {
    let cell = at.floor();
    let within = at - cell;
    let part = within * within * (3.0 - 2.0 * within);
    let [x, y] = cell.as_ivec2().to_array();
    let node = |dx: i32, dy: i32| f64::from(hash_at([x + dx, y + dy], salt));
    let row = |dy: i32| node(0, dy) + (node(1, dy) - node(0, dy)) * part.x;
    row(0) + (row(1) - row(0)) * part.y
}

/// A hashed number in [0, 1) for a node of a lattice.
pub(super) fn hash_at(node: [i32; 2], salt: u32) -> f32 {
    hash_to_unit(seed_at(node), salt)
}

/// A seed for a node of a lattice.
pub(super) fn seed_at([x, y]: [i32; 2]) -> u32 {
    (x as u32).wrapping_mul(0x27D4_EB2F) ^ (y as u32).wrapping_mul(0x1656_67B1).rotate_left(13)
}
