//! Sparse direct solver for symmetric positive definite systems of 3 x 3 blocks: Gaussian elimination in
//! minimum-degree order (Tinney and Walker 1967). Road networks are nearly planar, so fill-in is small.

use glam::{DMat3, DVec3};
use std::collections::{BTreeMap, BTreeSet};

/// A symmetric block matrix with its right-hand side.
#[derive(Clone, Debug)]
pub(super) struct BlockSystem {
    /// By row: blocks by column, both triangles.
    rows: Vec<BTreeMap<usize, DMat3>>,
    right: Vec<DVec3>,
}

/// An eliminated node.
struct Pivot {
    node: usize,
    /// Inverse of its diagonal block.
    inverse: DMat3,
    /// Blocks to the nodes that are eliminated later.
    others: Vec<(usize, DMat3)>,
}

impl BlockSystem {
    pub(super) fn new(nodes: usize) -> Self {
        Self { rows: vec![BTreeMap::new(); nodes], right: vec![DVec3::ZERO; nodes] }
    }

    /// Adds to the block of two nodes; its transpose goes to the other triangle.
    pub(super) fn add(&mut self, row: usize, column: usize, block: DMat3) {
        *self.rows[row].entry(column).or_insert(DMat3::ZERO) += block;
        if row != column {
            *self.rows[column].entry(row).or_insert(DMat3::ZERO) += block.transpose();
        }
    }

    pub(super) fn add_right(&mut self, row: usize, value: DVec3) {
        self.right[row] += value;
    }

    /// The solution, one vector for each node. Every node needs a diagonal block.
    pub(super) fn solve(mut self) -> Vec<DVec3> {
        let count = self.rows.len();
        let mut by_degree: BTreeSet<(usize, usize)> =
            self.rows.iter().enumerate().map(|(node, row)| (row.len(), node)).collect();
        let mut eliminated: Vec<Pivot> = Vec::with_capacity(count);
        while let Some((_, node)) = by_degree.pop_first() {
            let row = std::mem::take(&mut self.rows[node]);
            let inverse = row.get(&node).map_or(DMat3::IDENTITY, DMat3::inverse);
            let others: Vec<(usize, DMat3)> = row.into_iter().filter(|&(other, _)| other != node).collect();
            for &(i, block_i) in &others {
                by_degree.remove(&(self.rows[i].len(), i));
                self.rows[i].remove(&node);
                let factor = block_i.transpose() * inverse;
                let known = factor * self.right[node];
                self.right[i] -= known;
                for &(j, block_j) in &others {
                    *self.rows[i].entry(j).or_insert(DMat3::ZERO) -= factor * block_j;
                }
            }
            for &(i, _) in &others {
                by_degree.insert((self.rows[i].len(), i));
            }
            eliminated.push(Pivot { node, inverse, others });
        }
        let mut solution = vec![DVec3::ZERO; count];
        for Pivot { node, inverse, others } in eliminated.into_iter().rev() {
            let known: DVec3 = others.iter().map(|&(other, block)| block * solution[other]).sum();
            solution[node] = inverse * (self.right[node] - known);
        }
        solution
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solution_satisfies_a_system_with_loops() {
        // A ring of nodes with chords: J^T J + I of arbitrary J is positive definite.
        let nodes = 23;
        let mut blocks: Vec<(usize, usize, DMat3)> = Vec::new();
        for i in 0..nodes {
            blocks.push((i, i, DMat3::from_diagonal(DVec3::new(20.0, 31.0, 25.0 + i as f64))));
            for step in [1, 7] {
                let j = (i + step) % nodes;
                let (a, b) = (i as f64 / 7.0, j as f64 / 3.0);
                let block = DMat3::from_cols_array(&[a, -b, 1.0, 0.3, b - a, -2.0, 0.7, 1.1, a * b / 8.0]);
                blocks.push((i, j, block));
            }
        }
        let mut system = BlockSystem::new(nodes);
        let wanted: Vec<DVec3> =
            (0..nodes).map(|k| DVec3::new(k as f64, 1.0 / (k + 1) as f64, -3.0)).collect();
        for &(i, j, block) in &blocks {
            system.add(i, j, block);
            system.add_right(i, block * wanted[j]);
            if i != j {
                system.add_right(j, block.transpose() * wanted[i]);
            }
        }
        for (found, wanted) in system.solve().iter().zip(&wanted) {
            assert!(found.distance(*wanted) < 1e-9, "{found} {wanted}");
        }
    }
}
