//! Distance fields on a grid and their level curves (marching squares).
//!
//! The outline of a road network is the boundary of a union of hundreds of overlapping lanes. In a distance
//! field a union is a minimum, and rounding of corners is a morphological closing: a dilation, then an
//! erosion (J. Serra, *Image Analysis and Mathematical Morphology*, 1982). Level curves are extracted by
//! marching squares.

use super::polygon::{Region, doubled_area, simplify_ring};
use city3d_geometry::point_in_polygon;
use glam::DVec2;
use rustc_hash::FxHashMap;

/// A scalar field sampled at the nodes of a square grid.
#[derive(Clone, Debug)]
pub(super) struct DistanceField {
    low: DVec2,
    step: f64,
    columns: usize,
    rows: usize,
    values: Vec<f32>,
}

impl DistanceField {
    /// Infinite everywhere.
    pub(super) fn new([low, high]: [DVec2; 2], step: f64) -> Self {
        let size = ((high - low) / step).ceil();
        let (columns, rows) = (size.x as usize + 1, size.y as usize + 1);
        Self { low, step, columns, rows, values: vec![f32::INFINITY; columns * rows] }
    }

    /// An infinite field on the same grid.
    pub(super) fn like(&self) -> Self {
        Self { values: vec![f32::INFINITY; self.values.len()], ..*self }
    }

    fn node(&self, column: usize, row: usize) -> DVec2 {
        self.low + DVec2::new(column as f64, row as f64) * self.step
    }

    /// Takes the minimum with a function inside a box. `least` is a cheap lower bound: nodes that it cannot
    /// lower are skipped.
    pub(super) fn lower(
        &mut self,
        [low, high]: [DVec2; 2],
        least: impl Fn(DVec2) -> f64,
        value: impl Fn(DVec2) -> f64,
    ) {
        let first = ((low - self.low) / self.step).floor().max(DVec2::ZERO);
        let last = ((high - self.low) / self.step).ceil();
        let (last_column, last_row) =
            ((last.x as usize).min(self.columns - 1), (last.y as usize).min(self.rows - 1));
        for row in first.y as usize..=last_row {
            for column in first.x as usize..=last_column {
                let at = self.node(column, row);
                let kept = &mut self.values[row * self.columns + column];
                if least(at) < f64::from(*kept) {
                    *kept = kept.min(value(at) as f32);
                }
            }
        }
    }

    /// Unsigned distance field of closed rings, up to `reach`; farther nodes stay infinite.
    pub(super) fn distance_to(&self, rings: &[Vec<DVec2>], reach: f64) -> Self {
        // Square roots are taken once, at the end.
        let mut field = self.like();
        for ring in rings {
            for (k, &a) in ring.iter().enumerate() {
                let b = ring[(k + 1) % ring.len()];
                let along = b - a;
                let per_length = 1.0 / along.length_squared().max(1e-12);
                let squared = |p: DVec2| {
                    let t = ((p - a).dot(along) * per_length).clamp(0.0, 1.0);
                    p.distance_squared(a + along * t)
                };
                field.lower([a.min(b) - reach, a.max(b) + reach], |_| 0.0, squared);
            }
        }
        field.values.iter_mut().for_each(|value| *value = value.sqrt());
        field
    }

    /// Signed distance field: negative inside the rings (even-odd rule by scan lines).
    pub(super) fn signed_distance_to(&self, rings: &[Vec<DVec2>], reach: f64) -> Self {
        let mut field = self.distance_to(rings, reach);
        // Scan-line crossings by grid row.
        let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); self.rows];
        for ring in rings {
            for (k, &a) in ring.iter().enumerate() {
                let b = ring[(k + 1) % ring.len()];
                let row_above =
                    |y: f64| ((y - self.low.y) / self.step).ceil().clamp(0.0, self.rows as f64) as usize;
                let (from, to) = (row_above(a.y.min(b.y)), row_above(a.y.max(b.y)));
                for (row, xs) in (from..to).zip(&mut crossings[from..to]) {
                    let y = self.low.y + row as f64 * self.step;
                    xs.push(a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y));
                }
            }
        }
        for (row, mut xs) in crossings.into_iter().enumerate() {
            xs.sort_unstable_by(f64::total_cmp);
            for pair in xs.chunks_exact(2) {
                let [from, to] =
                    [pair[0], pair[1]].map(|x| ((x - self.low.x) / self.step).ceil().max(0.0) as usize);
                let inside =
                    row * self.columns + from.min(self.columns)..row * self.columns + to.min(self.columns);
                field.values[inside].iter_mut().for_each(|value| *value = -*value);
            }
        }
        field
    }

    /// Combines two fields node by node.
    pub(super) fn with(&self, other: &Self, combine: impl Fn(f32, f32) -> f32) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(&a, &b)| combine(a, b)).collect();
        Self { values, ..*self }
    }

    /// The bilinearly interpolated value at a point; infinite outside the grid.
    pub(super) fn at(&self, point: DVec2) -> f32 {
        let at = (point - self.low) / self.step;
        if !(at.x >= 0.0 && at.y >= 0.0) {
            return f32::INFINITY;
        }
        let (column, row) = (at.x as usize, at.y as usize);
        if column + 1 >= self.columns || row + 1 >= self.rows {
            return f32::INFINITY;
        }
        let (fx, fy) = ((at.x - column as f64) as f32, (at.y - row as f64) as f32);
        let value = |dc: usize, dr: usize| self.values[(row + dr) * self.columns + column + dc];
        let [sw, se, nw, ne] = [value(0, 0), value(1, 0), value(0, 1), value(1, 1)];
        // A weighted sum with infinity would be NaN.
        if [sw, se, nw, ne].iter().any(|v| !v.is_finite()) {
            return f32::INFINITY;
        }
        let (a, b) = (sw * (1.0 - fx) + se * fx, nw * (1.0 - fx) + ne * fx);
        a * (1.0 - fy) + b * fy
    }

    /// Closed level curves of the field by marching squares, lower values to their left.
    pub(super) fn contours(&self, level: f32) -> Vec<Vec<DVec2>> {
        // The rim counts as high, so that every curve closes.
        let value = |column: usize, row: usize| {
            let rim = column == 0 || row == 0 || column + 1 == self.columns || row + 1 == self.rows;
            let found = self.values[row * self.columns + column] - level;
            if rim { found.max(self.step as f32) } else { found.min(1e3) }
        };
        // A grid edge is identified by its lower node and its direction.
        let mut next: FxHashMap<(usize, bool), (usize, bool)> = FxHashMap::default();
        let mut starts = Vec::new();
        let is_low = |node: usize| self.values[node] < level;
        let mut mixed = Vec::new();
        for row in 0..self.rows - 1 {
            let (below, above) = (row * self.columns, (row + 1) * self.columns);
            // Cells without a crossing are skipped first.
            mixed.clear();
            let mut before = [is_low(below), is_low(above)];
            for column in 1..self.columns {
                let here = [is_low(below + column), is_low(above + column)];
                if here[0] != here[1] || here != before {
                    mixed.push(column - 1);
                }
                before = here;
            }
            if row == 0 || row + 2 == self.rows {
                // Cells at the rim, which counts as high.
                mixed = (0..self.columns - 1).collect();
            } else if mixed.last() != Some(&(self.columns - 2)) {
                mixed.push(self.columns - 2);
            }
            if mixed.first() != Some(&0) {
                mixed.insert(0, 0);
            }
            for &column in &mixed {
                let corner = [
                    value(column, row),
                    value(column + 1, row),
                    value(column + 1, row + 1),
                    value(column, row + 1),
                ];
                let low = corner.map(|v| v < 0.0);
                if low[0] == low[1] && low[1] == low[2] && low[2] == low[3] {
                    continue;
                }
                let node = |dc: usize, dr: usize| (row + dr) * self.columns + column + dc;
                // Bottom, right, top, left.
                let edges =
                    [(node(0, 0), false), (node(1, 0), true), (node(0, 1), false), (node(0, 0), true)];
                let crossing = |k: usize| low[k] != low[(k + 1) % 4];
                let middle_low = corner.iter().sum::<f32>() < 0.0;
                for k in (0..4).filter(|&k| crossing(k) && low[k]) {
                    // From the low corner k counter-clockwise: the curve enters here and leaves where the low
                    // side began, keeping low values to its left. The mean resolves saddle cells.
                    let order: [usize; 3] = if middle_low { [1, 2, 3] } else { [3, 2, 1] };
                    let exit = order.iter().map(|d| (k + d) % 4).find(|&e| crossing(e) && !low[e]);
                    if let Some(exit) = exit {
                        next.insert(edges[k], edges[exit]);
                        starts.push(edges[k]);
                    }
                }
            }
        }
        let place = |(node, upright): (usize, bool)| {
            let (column, row) = (node % self.columns, node / self.columns);
            let (to_column, to_row) = if upright { (column, row + 1) } else { (column + 1, row) };
            let (a, b) = (value(column, row), value(to_column, to_row));
            let t = f64::from(a / (a - b)).clamp(0.0, 1.0);
            self.node(column, row).lerp(self.node(to_column, to_row), t)
        };
        let mut rings = Vec::new();
        for start in starts {
            let mut ring = Vec::new();
            let mut at = start;
            while let Some(then) = next.remove(&at) {
                ring.push(place(at));
                at = then;
            }
            if ring.len() > 3 {
                rings.push(ring);
            }
        }
        rings
    }
}

/// Simplifies rings to within `tolerance` (Douglas-Peucker).
pub(super) fn simplified(rings: &[Vec<DVec2>], tolerance: f64) -> Vec<Vec<DVec2>> {
    let rings = rings.iter().map(|ring| simplify_ring(ring, tolerance));
    rings.filter(|ring| ring.len() > 2).collect()
}

/// Groups rings into outer rings with their holes; rings smaller than `least_area` are dropped.
pub(super) fn regions_of(rings: Vec<Vec<DVec2>>, least_area: f64) -> Vec<Region> {
    let large = rings.into_iter().filter(|ring| doubled_area(ring).abs() > 2.0 * least_area);
    let (outer, holes): (Vec<_>, Vec<_>) = large.partition(|ring| doubled_area(ring) > 0.0);
    let mut regions: Vec<Region> =
        outer.into_iter().map(|outer| Region { outer, holes: Vec::new() }).collect();
    regions.sort_by(|a, b| doubled_area(&a.outer).total_cmp(&doubled_area(&b.outer)));
    for hole in holes {
        let home = regions.iter_mut().find(|region| {
            doubled_area(&region.outer) > doubled_area(&hole).abs()
                && point_in_polygon(hole[0], &region.outer)
        });
        if let Some(region) = home {
            region.holes.push(hole);
        }
    }
    regions
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring_field(inner: f64, outer: f64) -> DistanceField {
        let mut field = DistanceField::new([DVec2::splat(-10.0), DVec2::splat(10.0)], 0.25);
        let distance = |p: DVec2| (p.length() - (inner + outer) / 2.0).abs() - (outer - inner) / 2.0;
        field.lower([DVec2::splat(-10.0), DVec2::splat(10.0)], distance, distance);
        field
    }

    #[test]
    fn a_ring_has_an_outline_and_a_hole() {
        let regions = regions_of(simplified(&ring_field(3.0, 6.0).contours(0.0), 0.01), 0.1);
        assert_eq!(regions.len(), 1);
        assert_eq!(regions[0].holes.len(), 1);
        let area: f64 = regions[0].triangulate().iter().map(|t| doubled_area(t) / 2.0).sum();
        assert!((area / (std::f64::consts::PI * 27.0) - 1.0).abs() < 0.01, "{area}");
    }

    #[test]
    fn the_complement_reaches_the_rim() {
        let field = ring_field(3.0, 6.0);
        let outside = field.with(&field, |a, _| -a);
        let mut regions = regions_of(simplified(&outside.contours(0.0), 0.01), 0.1);
        assert_eq!(regions.len(), 2);
        let whole = regions.remove(1);
        assert!(whole.holes.len() == 1 && doubled_area(&whole.outer) / 2.0 > 385.0);
    }

    #[test]
    fn distances_are_those_to_the_ring() {
        let field = ring_field(3.0, 6.0);
        let square = [(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)].map(DVec2::from).to_vec();
        let distance = field.distance_to(&[square], 3.0);
        assert!((distance.at(DVec2::new(5.0, 0.0)) - 1.0).abs() < 1e-5);
        assert!(distance.at(DVec2::new(7.0, 8.0)).is_infinite());
        // A hole is outside again.
        let square =
            |half: f64| [(-half, -half), (half, -half), (half, half), (-half, half)].map(DVec2::from);
        let signed = field.signed_distance_to(&[square(6.1).to_vec(), square(2.1).to_vec()], 1.5);
        for (x, want) in [(0.9, 1.2), (2.6, -0.5), (5.6, -0.5), (6.6, 0.5), (-6.6, 0.5), (-2.6, -0.5)] {
            let found = signed.at(DVec2::new(x, 0.3));
            assert!((found - want).abs() < 1e-4, "{found} at {x}");
        }
        assert!(distance.at(DVec2::new(90.0, 8.0)).is_infinite());
    }
}
