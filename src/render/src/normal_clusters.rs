//! Cluster back-face culling: triangles grouped by quantised normal, so that a view skips groups that face away from it
//! as a whole, half of a city. The adapter's own culling comes only after the vertex stage.

use glam::Vec3;
use std::collections::BTreeMap;
use std::ops::Range;

/// Normals are quantised to steps of 1 over this.
const DIRECTION_STEPS: f32 = 3.0;

/// Triangles of a mesh with similar normals.
#[derive(Clone, Debug)]
pub(super) struct NormalCluster {
    /// Range of the index list of the scene.
    pub(super) indices: Range<u32>,
    normal: Vec3,
    /// Largest distance of a triangle's normal from `normal`.
    spread: f32,
    /// Least coordinate of a corner along `normal`, metres.
    least_m: f32,
}

impl NormalCluster {
    /// Moves its range in an index list that begins so much later.
    pub(super) fn move_by(&mut self, start: u32) {
        self.indices = self.indices.start + start..self.indices.end + start;
    }

    /// Whether all triangles certainly face away from an eye that is at most `reach_m` from every corner, and would from a
    /// place `slack_m` nearer to their front.
    pub(super) fn is_backfacing(&self, eye: Vec3, reach_m: f32, slack_m: f32) -> bool {
        self.normal.dot(eye) - self.least_m + self.spread * reach_m + slack_m < 0.0
    }
}

/// Appends the triangles of a mesh to `indices`, cluster by cluster. Drops degenerate triangles.
pub(super) fn append(
    indices: &mut Vec<u32>,
    position: impl Fn(u32) -> Vec3,
    triangles: &[&[u32]],
) -> Vec<NormalCluster> {
    let mut by_direction: BTreeMap<[i32; 3], Vec<(Vec3, &[u32])>> = BTreeMap::new();
    for triangle in triangles {
        let [a, b, c] = [0, 1, 2].map(|k| position(triangle[k]));
        let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
        let direction = (normal * DIRECTION_STEPS).round().as_ivec3().to_array();
        by_direction.entry(direction).or_default().push((normal, triangle));
    }
    let mut clusters = Vec::with_capacity(by_direction.len());
    for group in by_direction.values() {
        let sum: Vec3 = group.iter().map(|(normal, _)| *normal).sum();
        let normal = sum.normalize_or_zero();
        let corners = group.iter().flat_map(|(_, triangle)| triangle.iter());
        let start = indices.len() as u32;
        indices.extend(corners.clone());
        clusters.push(NormalCluster {
            indices: start..indices.len() as u32,
            normal,
            spread: group.iter().map(|(of, _)| of.distance(normal)).fold(0.0, f32::max),
            least_m: corners.map(|&k| position(k).dot(normal)).fold(f32::INFINITY, f32::min),
        });
    }
    clusters
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clusters_are_culled_only_where_all_of_their_triangles_face_away() {
        // Triangles on a ball and far from it, and eyes all around.
        let at = |k: u32| {
            let k = k as f32;
            let turn = Vec3::new((k * 1.7).sin(), (k * 2.3).cos(), (k * 0.9).sin()).normalize_or(Vec3::Z);
            Vec3::new(40.0, -10.0, 3.0) + turn * (1.0 + k % 5.0)
        };
        let corners: Vec<u32> = (0..600).collect();
        let triangles: Vec<&[u32]> = corners.chunks_exact(3).collect();
        let mut indices = Vec::new();
        let clusters = append(&mut indices, at, &triangles);
        assert_eq!(indices.len(), 600);
        assert!(
            clusters.iter().map(|cluster| cluster.indices.len()).sum::<usize>() == 600 && clusters.len() > 20
        );
        let mut left_out = 0;
        for k in 0..500 {
            let eye = at(7 * k) + Vec3::new(30.0, 0.5 * k as f32 - 100.0, 8.0);
            let reach_m = (0..600).map(|k| at(k).distance(eye)).fold(0.0, f32::max);
            for cluster in clusters.iter().filter(|cluster| cluster.is_backfacing(eye, reach_m, 0.0)) {
                left_out += 1;
                for triangle in
                    indices[cluster.indices.start as usize..cluster.indices.end as usize].chunks(3)
                {
                    let [a, b, c] = [0, 1, 2].map(|k| at(triangle[k]));
                    assert!((b - a).cross(c - a).dot(eye - a) <= 1e-3, "{cluster:?} {eye}");
                }
            }
        }
        assert!(left_out > 2000, "{left_out}");
    }

    #[test]
    fn a_wall_is_backfacing_behind_its_plane() {
        let corners = [Vec3::ZERO, Vec3::new(0.0, 5.0, 0.0), Vec3::new(0.0, 5.0, 3.0)];
        let mut indices = Vec::new();
        let mut clusters = append(&mut indices, |k| corners[k as usize], &[&[0, 1, 2], &[1, 1, 2]]);
        assert_eq!((indices.as_slice(), clusters.len()), (&[0, 1, 2][..], 1));
        clusters[0].move_by(10);
        assert_eq!(clusters[0].indices, 10..13);
        assert!(!clusters[0].is_backfacing(Vec3::new(0.1, 90.0, 90.0), 130.0, 0.0));
        assert!(clusters[0].is_backfacing(Vec3::new(-0.1, 90.0, 90.0), 130.0, 0.0));
        assert!(!clusters[0].is_backfacing(Vec3::new(-0.1, 90.0, 90.0), 130.0, 0.2));
    }
}
