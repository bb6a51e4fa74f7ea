//! Where woods grow: inside of a level curve of noise, so that their outlines are natural.

use super::fields;
use super::relief::{Relief, hash_at, noise, smoothstep};
use glam::DVec2;

/// Woods keep this clear of the town.
pub(super) const FROM_M: f64 = 75.0;
/// From this distance on woods have fewer, broader trees.
pub(super) const SPARSE_FROM_M: f64 = 430.0;
/// Wavelengths of the outlines, and the level above which woods grow.
const WAVES_M: [f64; 2] = [270.0, 62.0];
const LEVEL: f64 = 0.66;
/// Spacing of the corners of their ground near the town and far from it, and the band around woods that has some.
const CORNERS_M: [f64; 2] = [30.0, 150.0];
const BAND: f64 = 0.05;

/// The woods of a land.
#[derive(Clone, Copy, Debug)]
pub(super) struct Woods<'a> {
    pub(super) relief: &'a Relief,
}

impl Woods<'_> {
    /// How far a place is inside of a wood, in units of the noise; negative outside.
    pub(super) fn depth_at(&self, at: DVec2) -> f64 {
        let [broad, fine] = WAVES_M;
        let edge = smoothstep([FROM_M, FROM_M + 90.0], self.relief.away_m(at));
        0.80 * noise(at / broad, 63) + 0.20 * noise(at / fine, 64) - LEVEL - 0.25 * (1.0 - edge)
    }

    /// Corners of the ground in woods and around them.
    pub(super) fn corners(&self) -> Vec<DVec2> {
        let near = self.lattice(CORNERS_M[0], 0.5, [0.0, SPARSE_FROM_M]);
        let far = self.lattice(CORNERS_M[1], 0.5, [SPARSE_FROM_M, fields::REACH_M]);
        near.chain(far).map(|(_, at)| at).filter(|at| self.depth_at(*at) > -BAND).collect()
    }

    /// Nodes of a lattice with a spacing and a jitter, within a range of distances from the town.
    pub(super) fn lattice(
        &self,
        spacing_m: f64,
        jitter: f64,
        [from_m, to_m]: [f64; 2],
    ) -> impl Iterator<Item = ([i32; 2], DVec2)> {
        let [low, high] = self.relief.town;
        let node = |at: DVec2| (at / spacing_m).floor().as_ivec2();
        let (first, last) = (node(low - to_m), node(high + to_m));
        let nodes = (first.x..=last.x).flat_map(move |x| (first.y..=last.y).map(move |y| [x, y]));
        let places = nodes.map(move |node| {
            let hash = |salt| f64::from(hash_at(node, salt)) - 0.5;
            let [x, y] = node.map(f64::from);
            (node, (DVec2::new(x, y) + jitter * DVec2::new(hash(65), hash(66))) * spacing_m)
        });
        places.filter(move |(_, at)| (from_m..to_m).contains(&self.relief.away_m(*at)))
    }
}
