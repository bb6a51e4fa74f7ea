//! Skins stretched over cross-sections: smooth normals across, a material for each patch.

use super::{Skin, VehicleMesh};
use glam::Vec3;

/// A grid of points: sections one after the other, each with the same number of points. Patches
/// between them are smooth; what `skin` says decides their material, `None` leaves a patch out.
pub(super) struct Loft {
    pub(super) sections: Vec<Vec<Vec3>>,
}

impl Loft {
    fn normal(&self, section: usize, point: usize) -> Vec3 {
        let points = self.sections[section].len();
        let (before, after) = (section.saturating_sub(1), (section + 1).min(self.sections.len() - 1));
        let along = self.sections[after][point] - self.sections[before][point];
        let ring = &self.sections[section];
        let around = ring[(point + 1).min(points - 1)] - ring[point.saturating_sub(1)];
        along.cross(around).normalize_or(Vec3::Z)
    }

    /// Adds the patches to a mesh. Sections run from the rear to the front, points of a section from
    /// the right side over the top to the left.
    pub(super) fn add_to(&self, mesh: &mut VehicleMesh, skin: impl Fn(usize, usize) -> Option<Skin>) {
        let mut slots = std::collections::HashMap::new();
        for section in 0..self.sections.len() - 1 {
            for point in 0..self.sections[section].len() - 1 {
                let Some(skin) = skin(section, point) else { continue };
                let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(ds, dp)| {
                    let (s, p) = (section + ds, point + dp);
                    *slots.entry((s, p, skin)).or_insert_with(|| {
                        let position = self.sections[s][p];
                        // Low and inwards-facing parts see less of the sky.
                        let normal = self.normal(s, p);
                        let open = 0.62 + 0.38 * (position.z / 0.7).clamp(0.0, 1.0);
                        mesh.vertex(position, normal, skin, (255.0 * open) as u8)
                    })
                });
                let [a, b, c, d] = corners;
                mesh.indices.extend([a, b, c, a, c, d]);
            }
        }
    }
}
