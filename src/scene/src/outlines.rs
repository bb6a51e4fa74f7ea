//! Outlines of ground covers, cut along the lines of the cell grid.
//!
//! Where an outline meets a line of the grid it has a corner that every level of detail keeps, so that cells at
//! different levels have the same corners on their common edge.

use super::CELL_M;
use super::polygon::simplify_line;
use glam::DVec2;
use std::collections::BTreeMap;

/// Resolution of corners: a power of two, so that `f32` holds them exactly up to 16 km from the origin.
const UNIT_M: f64 = 1.0 / 1024.0;
const CELL: f64 = CELL_M as f64;

/// What an outline encloses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Cover {
    /// Asphalt up to the kerb.
    Road,
    /// Up to the back of the kerbstones.
    Kerb,
    /// Up to the grass.
    Pavement,
}

impl Cover {
    /// The narrower ones first.
    pub(super) const ALL: [Self; 3] = [Self::Road, Self::Kerb, Self::Pavement];
}

/// A corner of an outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corner {
    /// City metres.
    pub(super) at: DVec2,
    /// Height of the ground there, off the road.
    pub(super) height_m: f32,
    /// Whether every level of detail has it.
    pub(super) is_kept: bool,
}

/// A stretch of an outline within a cell: from edge to edge of the cell, or a ring, whose first corner comes
/// again at its end.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    pub(super) cover: Cover,
    pub(super) corners: Vec<Corner>,
}

/// Positions along a line of the grid where outlines of each cover cross it.
type Crossings = BTreeMap<i32, [Vec<f64>; Cover::ALL.len()]>;

/// All outlines by the cells of the grid.
#[derive(Clone, Debug, Default)]
pub(super) struct CellOutlines {
    /// Stretches in each cell.
    chains: BTreeMap<[i32; 2], Vec<Chain>>,
    /// Ordinates on lines x = k cells, and abscissae on lines y = k cells.
    upright: Crossings,
    level: Crossings,
}

/// Number of outlines that cross a line of the grid between two places.
fn crossed_between(lines: &Crossings, cover: Cover, line: i32, [from, to]: [f64; 2]) -> usize {
    let Some(places) = lines.get(&line).map(|covers| &covers[cover as usize]) else { return 0 };
    places.partition_point(|place| *place <= to) - places.partition_point(|place| *place <= from)
}

/// Moved to the next multiple of [`UNIT_M`] that is on no line of the grid.
fn off_lines(value: f64) -> f64 {
    let snapped = snapped(value);
    if is_on_line(snapped) { snapped + UNIT_M } else { snapped }
}

fn snapped(value: f64) -> f64 {
    (value / UNIT_M).round() * UNIT_M
}

fn is_on_line(value: f64) -> bool {
    (value / CELL).round() * CELL == value
}

/// Whether both points are on one line of the grid.
fn is_along_line(a: DVec2, b: DVec2) -> bool {
    a.x == b.x && is_on_line(a.x) || a.y == b.y && is_on_line(a.y)
}

/// The point of a line farthest from the chord between its ends.
fn farthest_from_chord(line: &[DVec2]) -> Option<DVec2> {
    let (first, last) = (*line.first()?, *line.last()?);
    let off = |p: &DVec2| (last - first).perp_dot(*p - first).abs();
    line.iter().copied().max_by(|a, b| off(a).total_cmp(&off(b)))
}

fn cell_of(value: f64) -> i32 {
    (value / CELL).floor() as i32
}

/// The grid lines between two values, in the order from the first to the second.
fn lines_between(from: f64, to: f64) -> Vec<i32> {
    let lines = cell_of(from.min(to)) + 1..=(from.max(to) / CELL).ceil() as i32 - 1;
    if from < to { lines.collect() } else { lines.rev().collect() }
}

fn lerp(a: &Corner, b: &Corner, share: f64) -> Corner {
    let height_m = a.height_m + (b.height_m - a.height_m) * share as f32;
    Corner { at: a.at.lerp(b.at, share), height_m, is_kept: true }
}

/// A ring with further corners on each edge.
fn with_crossings(ring: &[Corner], crossings: impl Fn(&Corner, &Corner) -> Vec<Corner>) -> Vec<Corner> {
    let edges = ring.iter().enumerate().map(|(k, a)| (a, &ring[(k + 1) % ring.len()]));
    edges.flat_map(|(a, b)| std::iter::once(*a).chain(crossings(a, b))).collect()
}

impl CellOutlines {
    /// Adds a closed outline.
    pub(super) fn add(&mut self, cover: Cover, ring: &[Corner]) {
        let mut ring: Vec<Corner> = ring
            .iter()
            .map(|c| Corner { at: DVec2::new(off_lines(c.at.x), off_lines(c.at.y)), ..*c })
            .collect();
        ring.dedup_by(|b, a| {
            let same = a.at == b.at;
            a.is_kept |= same && b.is_kept;
            same
        });
        if ring.len() < 3 {
            return;
        }
        // First the lines x = k cells, then, within columns, the lines y = k cells: no crossing is a node.
        let ring = with_crossings(&ring, |a, b| {
            let crossing = |k: i32| {
                let x = f64::from(k) * CELL;
                let found = lerp(a, b, (x - a.at.x) / (b.at.x - a.at.x));
                Corner { at: DVec2::new(x, off_lines(found.at.y)), ..found }
            };
            lines_between(a.at.x, b.at.x).into_iter().map(crossing).collect()
        });
        let ring = with_crossings(&ring, |a, b| {
            let column = f64::from(cell_of((a.at.x + b.at.x) / 2.0)) * CELL;
            let crossing = |k: i32| {
                let y = f64::from(k) * CELL;
                let found = lerp(a, b, (y - a.at.y) / (b.at.y - a.at.y));
                let x = snapped(found.at.x).clamp(column + UNIT_M, column + CELL - UNIT_M);
                Corner { at: DVec2::new(x, y), ..found }
            };
            lines_between(a.at.y, b.at.y).into_iter().map(crossing).collect()
        });
        self.add_stretches(cover, ring);
    }

    /// Notes the crossings of a ring that has a corner at each, and its stretches between them.
    fn add_stretches(&mut self, cover: Cover, mut ring: Vec<Corner>) {
        let is_crossing = |c: &Corner| is_on_line(c.at.x) || is_on_line(c.at.y);
        for DVec2 { x, y } in ring.iter().map(|corner| corner.at) {
            if is_on_line(x) {
                self.upright.entry((x / CELL).round() as i32).or_default()[cover as usize].push(y);
            } else if is_on_line(y) {
                self.level.entry((y / CELL).round() as i32).or_default()[cover as usize].push(x);
            }
        }
        let first = ring.iter().position(is_crossing).unwrap_or(0);
        ring.rotate_left(first);
        ring.push(ring[0]);
        let mut start = 0;
        for end in 1..ring.len() {
            if !is_crossing(&ring[end]) && end + 1 < ring.len() {
                continue;
            }
            let middle = (ring[start].at + ring[start + 1].at) / 2.0;
            let corners = ring[start..=end].to_vec();
            self.chains
                .entry([cell_of(middle.x), cell_of(middle.y)])
                .or_default()
                .push(Chain { cover, corners });
            start = end;
        }
    }

    /// Sorts the crossings, once all outlines are there.
    pub(super) fn finish(&mut self) {
        let lines = self.upright.values_mut().chain(self.level.values_mut());
        lines.flatten().for_each(|places| places.sort_by(f64::total_cmp));
    }

    /// The stretches in a cell.
    pub(super) fn chains(&self, cell: [i32; 2]) -> &[Chain] {
        self.chains.get(&cell).map_or(&[], Vec::as_slice)
    }

    /// Whether a cover encloses the point: even-odd rule along the south edge of the row, the west edge of the
    /// cell, and across the cell, of whose stretches these are given.
    pub(super) fn encloses(
        &self,
        cover: Cover,
        [column, row]: [i32; 2],
        chains: &[Chain],
        at: DVec2,
    ) -> bool {
        let [west, south] = [column, row].map(|k| f64::from(k) * CELL);
        let mut crossed = crossed_between(&self.level, cover, row, [f64::NEG_INFINITY, west]);
        crossed += crossed_between(&self.upright, cover, column, [south, at.y]);
        for chain in chains.iter().filter(|chain| chain.cover == cover) {
            for pair in chain.corners.windows(2) {
                let [a, b] = [pair[0].at, pair[1].at];
                if (a.y > at.y) != (b.y > at.y) {
                    crossed += usize::from(a.x + (b.x - a.x) * (at.y - a.y) / (b.y - a.y) < at.x);
                }
            }
        }
        crossed % 2 == 1
    }
}

/// Where two edges cross between their ends, as shares of both.
fn crossing([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> Option<[f64; 2]> {
    let (along, other) = (b - a, d - c);
    let det = along.perp_dot(other);
    let shares = [(c - a).perp_dot(other) / det, (c - a).perp_dot(along) / det];
    (det != 0.0 && shares.iter().all(|share| (0.0..=1.0).contains(share))).then_some(shares)
}

/// Gives chains a corner wherever they cross themselves or one another.
pub(super) fn split_at_crossings(chains: &mut [Chain]) {
    let edges: Vec<(usize, usize, [Corner; 2])> = chains
        .iter()
        .enumerate()
        .flat_map(|(k, chain)| {
            chain.corners.windows(2).enumerate().map(move |(edge, pair)| (k, edge, [pair[0], pair[1]]))
        })
        .collect();
    // By chain and edge: shares of the edge.
    let mut cuts: BTreeMap<(usize, usize), Vec<(f64, Corner)>> = BTreeMap::new();
    for (k, (chain, edge, ends)) in edges.iter().enumerate() {
        for (other_chain, other_edge, other_ends) in &edges[k + 1..] {
            let [p, q] = [ends, other_ends].map(|ends| ends.map(|corner| corner.at));
            let is_joined = p.iter().any(|end| q.contains(end));
            if is_joined
                || p[0].max(p[1]).cmplt(q[0].min(q[1])).any()
                || q[0].max(q[1]).cmplt(p[0].min(p[1])).any()
            {
                continue;
            }
            let Some([share, other_share]) = crossing(p, q) else { continue };
            let (here, there) =
                (lerp(&ends[0], &ends[1], share), lerp(&other_ends[0], &other_ends[1], other_share));
            let corner = Corner { height_m: here.height_m.min(there.height_m), ..here };
            for (key, ends, share) in
                [((*chain, *edge), p, share), ((*other_chain, *other_edge), q, other_share)]
            {
                if !ends.contains(&corner.at) {
                    cuts.entry(key).or_default().push((share, corner));
                }
            }
        }
    }
    for ((chain, edge), mut corners) in cuts.into_iter().rev() {
        corners.sort_by(|a, b| a.0.total_cmp(&b.0));
        chains[chain].corners.splice(edge + 1..edge + 1, corners.into_iter().map(|(_, corner)| corner));
    }
}

impl CellOutlines {
    /// [`Self::encloses`] for the middle of an edge on a line of the grid, as the cells on both sides find it; nothing for
    /// other edges.
    pub(super) fn encloses_edge(&self, cover: Cover, [a, b]: [DVec2; 2]) -> Option<bool> {
        let middle = (a + b) / 2.0;
        if a.y == b.y && is_on_line(a.y) {
            let row = (a.y / CELL).round() as i32;
            return Some(crossed_between(&self.level, cover, row, [f64::NEG_INFINITY, middle.x]) % 2 == 1);
        }
        let cell = [(a.x / CELL).round() as i32, cell_of(middle.y)];
        (a.x == b.x && is_on_line(a.x)).then(|| self.encloses(cover, cell, &[], middle))
    }
}

impl Chain {
    /// Its ends on the edge of the cell; none of a ring.
    pub(super) fn ends(&self) -> impl Iterator<Item = DVec2> {
        let ends = [self.corners.first(), self.corners.last()].into_iter().flatten();
        ends.map(|corner| corner.at).filter(|at| is_on_line(at.x) || is_on_line(at.y))
    }

    /// Simplified to within a tolerance between the corners that are kept.
    pub(super) fn simplified(&self, tolerance_m: f64) -> Self {
        let mut corners = Vec::new();
        let mut start = 0;
        for end in 1..self.corners.len() {
            if !self.corners[end].is_kept && end + 1 < self.corners.len() {
                continue;
            }
            let stretch = &self.corners[start..=end];
            let line: Vec<DVec2> = stretch.iter().map(|corner| corner.at).collect();
            let mut kept = simplify_line(&line, tolerance_m);
            // A bulge over an edge of the cell stays: the neighbour has the other part of it.
            if kept.len() == 2 && is_along_line(kept[0], kept[1]) {
                kept.splice(1..1, farthest_from_chord(&line));
            }
            let mut left = stretch.iter();
            for at in kept {
                corners.extend(left.find(|corner| corner.at == at));
            }
            corners.pop();
            start = end;
        }
        corners.extend(self.corners.last());
        Self { cover: self.cover, corners }
    }
}
