//! Which of many circles may touch.

use glam::DVec2;

/// No further item in a list.
const END: u32 = u32::MAX;
/// Cells beside and before a cell: with them and itself each pair of neighbouring cells is met once.
const BEFORE: [[i32; 2]; 4] = [[-1, 0], [-1, -1], [0, -1], [1, -1]];

/// Circles by square cells as large as the largest of them. Its work grows with their number alone, wherever they are and
/// however they move: a city has no end to its sides, and its cars go all ways, so that a list along one side has a
/// hundred others beside each and has to be put in order again all the time.
#[derive(Clone, Debug, Default)]
pub(super) struct Neighbours {
    /// By circle.
    cells: Vec<[i32; 2]>,
    /// The last circle of each list. Cells share lists.
    heads: Vec<u32>,
    /// By circle: the one before it in its list.
    links: Vec<u32>,
}

impl Neighbours {
    /// Calls `found` with the indices of any two circles that touch, in no order, and with some that do not; each pair once.
    pub(super) fn pairs(
        &mut self,
        circles: impl Iterator<Item = (DVec2, f64)> + Clone,
        mut found: impl FnMut(usize, usize),
    ) {
        let size_m = circles.clone().fold(1.0, |size: f64, (_, radius)| size.max(2.0 * radius));
        let cell_of = |centre: DVec2| (centre / size_m).floor().as_ivec2().to_array();
        self.cells.clear();
        self.cells.extend(circles.map(|(centre, _)| cell_of(centre)));
        let lists = (2 * self.cells.len()).next_power_of_two();
        self.heads.clear();
        self.heads.resize(lists, END);
        self.links.clear();
        for (index, cell) in self.cells.iter().enumerate() {
            let head = &mut self.heads[list_of(*cell, lists)];
            self.links.push(*head);
            *head = index as u32;
        }
        for (index, cell) in self.cells.iter().enumerate() {
            let mut earlier = self.links[index];
            while let Some(&link) = self.links.get(earlier as usize) {
                if self.cells[earlier as usize] == *cell {
                    found(earlier as usize, index);
                }
                earlier = link;
            }
            for [x, y] in BEFORE {
                let beside = [cell[0].wrapping_add(x), cell[1].wrapping_add(y)];
                let mut other = self.heads[list_of(beside, lists)];
                while let Some(&link) = self.links.get(other as usize) {
                    if self.cells[other as usize] == beside {
                        found(other as usize, index);
                    }
                    other = link;
                }
            }
        }
    }
}

/// The list of a cell; `lists` is a power of two.
fn list_of([x, y]: [i32; 2], lists: usize) -> usize {
    let mixed = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77);
    (mixed ^ mixed >> 15) as usize & (lists - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn any_two_circles_that_touch_are_found_once() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / (1_u64 << 31) as f64
        };
        let mut neighbours = Neighbours::default();
        for count in [0, 1, 2, 300] {
            let circles: Vec<(DVec2, f64)> = (0..count)
                .map(|_| (DVec2::new(random() - 0.5, random() - 0.5) * 120.0, 0.5 + 4.0 * random()))
                .collect();
            let mut found = BTreeSet::new();
            neighbours.pairs(circles.iter().copied(), |a, b| {
                assert!(found.insert((a.min(b), a.max(b))), "{a} and {b} twice");
            });
            for b in 0..circles.len() {
                for a in 0..b {
                    let reach = circles[a].1 + circles[b].1;
                    let touch = circles[a].0.distance(circles[b].0) < reach;
                    assert!(!touch || found.contains(&(a, b)), "{:?} {:?}", circles[a], circles[b]);
                }
            }
            assert!(found.len() < 10 * circles.len() + 1);
        }
    }
}
