//! Ego occlusion mask: the bottom rows of an onboard camera's picture that the carrier's own body covers entirely. The
//! body is rasterised on the CPU; nothing else is drawn in those rows.

use glam::{Mat4, Vec2, Vec4};

/// Rows kept visible beyond the first covered row, against rounding.
const MARGIN_ROWS: u32 = 2;
/// Software adapters rasterise blocks of this many rows.
const BLOCK_ROWS: u32 = 4;
/// Projections whose entries differ by less share a mask: a tenth of a pixel.
const PROJECTION_TOLERANCE: f32 = 1e-4;
/// Capacity of the cache, per vehicle mesh.
const MAX_CACHED_MASKS: usize = 256;

/// Cache of ego occlusion masks: one for each camera that vehicles of one mesh carried.
#[derive(Clone, Debug, Default)]
pub(super) struct EgoOcclusionMask {
    known: Vec<CachedMask>,
}

#[derive(Clone, Copy, Debug)]
struct CachedMask {
    clip_from_body: Mat4,
    extent: [u32; 2],
    visible_rows: u32,
}

impl EgoOcclusionMask {
    /// Number of rows from the top that the vehicle does not cover entirely. `triangles` are in clip coordinates.
    pub(super) fn visible_rows<I: Iterator<Item = [Vec4; 3]>>(
        &mut self,
        clip_from_body: Mat4,
        extent: [u32; 2],
        triangles: impl FnOnce() -> I,
    ) -> u32 {
        let is_same = |known: &&CachedMask| {
            known.extent == extent && known.clip_from_body.abs_diff_eq(clip_from_body, PROJECTION_TOLERANCE)
        };
        if let Some(known) = self.known.iter().find(is_same) {
            return known.visible_rows;
        }
        let visible_rows = visible_rows(triangles(), extent);
        if self.known.len() == MAX_CACHED_MASKS {
            self.known.remove(0);
        }
        self.known.push(CachedMask { clip_from_body, extent, visible_rows });
        visible_rows
    }
}

/// Rasterises the front faces and counts the rows above the covered block at the bottom.
fn visible_rows(triangles: impl Iterator<Item = [Vec4; 3]>, [width, height]: [u32; 2]) -> u32 {
    let mut covered = vec![false; (width * height) as usize];
    let scale = Vec2::new(width as f32, -(height as f32)) / 2.0;
    for triangle in triangles {
        let outline: Vec<Vec2> = clip_to_near_plane(&triangle)
            .map(|corner| (corner.truncate().truncate() / corner.w + Vec2::new(1.0, -1.0)) * scale)
            .collect();
        rasterize(&outline, &mut covered, width as usize);
    }
    let rows = covered.chunks_exact(width as usize).rev();
    let hidden = rows.take_while(|row| row.iter().all(|&is_covered| is_covered)).count() as u32;
    (height - hidden.saturating_sub(MARGIN_ROWS)).next_multiple_of(BLOCK_ROWS).min(height)
}

/// Clips a triangle against the near plane of the reversed depth, where depth is less than 1.
fn clip_to_near_plane(triangle: &[Vec4; 3]) -> impl Iterator<Item = Vec4> {
    let inside = |corner: Vec4| corner.w - corner.z;
    (0..3).flat_map(move |k| {
        let (from, to) = (triangle[k], triangle[(k + 1) % 3]);
        let (a, b) = (inside(from), inside(to));
        let crossing = ((a > 0.0) != (b > 0.0)).then(|| from.lerp(to, a / (a - b)));
        (a > 0.0).then_some(from).into_iter().chain(crossing)
    })
}

/// Scan-line rasterisation: marks the pixels whose centres a front-facing convex polygon covers. It is
/// counter-clockwise, so clockwise with y downwards.
fn rasterize(outline: &[Vec2], covered: &mut [bool], width: usize) {
    let sides = || outline.iter().zip(outline.iter().cycle().skip(1));
    let twice_area: f32 = sides().map(|(a, b)| a.perp_dot(*b)).sum();
    if twice_area >= 0.0 {
        return;
    }
    let height = covered.len() / width;
    let ys = || outline.iter().map(|at| at.y);
    let [top, bottom] = [ys().fold(f32::INFINITY, f32::min), ys().fold(f32::NEG_INFINITY, f32::max)];
    // The centre of pixel k is at k + 0.5.
    let first = (top - 0.5).ceil().max(0.0) as usize;
    let end = ((bottom - 0.5).floor() + 1.0).clamp(0.0, height as f32) as usize;
    for row in first..end {
        let y = row as f32 + 0.5;
        let crossings = sides()
            .filter(|(a, b)| (a.y <= y) != (b.y <= y))
            .map(|(a, b)| a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y));
        let (left, right) =
            crossings.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, r), x| (l.min(x), r.max(x)));
        let from = (left - 0.5).ceil().clamp(0.0, width as f32) as usize;
        let to = ((right - 0.5).floor() + 1.0).clamp(0.0, width as f32) as usize;
        if from < to {
            covered[row * width + from..row * width + to].fill(true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_sensors::{Extrinsics, Lens, View};
    use glam::{DVec3, Vec3};

    /// Upright rectangle that faces the eye, which is 1.4 m above the ground and looks along x.
    fn sheet(x: f32, [low, high]: [f32; 2], half_width: f32) -> Vec<[Vec3; 3]> {
        let [a, b, c, d] = [(-1.0, low), (1.0, low), (1.0, high), (-1.0, high)]
            .map(|(side, z)| Vec3::new(x, -side * half_width, z));
        vec![[a, b, c], [a, c, d]]
    }

    fn rows(faces: &[[Vec3; 3]]) -> u32 {
        let lens = Lens { extent: [64, 48], ..Lens::default() };
        let eye = DVec3::new(0.0, 0.0, 1.4);
        let clip = View::new(Extrinsics::looking_at(eye, eye + DVec3::X), &lens).clip_from_world().as_mat4();
        let triangles = || faces.iter().map(|face| face.map(|at| clip * at.extend(1.0)));
        EgoOcclusionMask::default().visible_rows(clip, lens.extent, triangles)
    }

    #[test]
    fn rows_that_a_sheet_fills_are_masked_but_for_a_margin() {
        // One metre below the eye at 2 m: 48 / 2 / tan 25° = 51.5 pixels a unit of slope, row 24 + 51.5 * 0.4.
        let reaching = |high| sheet(2.0, [-1.0, high], 5.0);
        assert_eq!(rows(&reaching(0.6)), 48);
        // From row 24 + 51.5 * 0.15 = 31.7 on: 32 and the margin.
        assert_eq!(rows(&reaching(1.1)), 36);
        assert_eq!(rows(&[]), 48);
        // Seen from behind, too narrow, and with a gap between two halves.
        let turned: Vec<_> = reaching(1.1).iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        assert_eq!(rows(&turned), 48);
        assert_eq!(rows(&sheet(2.0, [-1.0, 1.1], 1.0)), 48);
        let halves = [sheet(2.0, [-1.0, 0.8], 5.0), sheet(2.0, [0.9, 1.1], 5.0)].concat();
        assert_eq!(rows(&halves), 44);
    }

    #[test]
    fn what_reaches_behind_the_eye_is_cut_at_the_near_plane() {
        // A floor half a metre below the eye, from behind it to 4 m in front: row 24 + 51.5 / 8 = 30.4.
        let [a, b, c, d] =
            [(-3.0, 9.0), (-3.0, -9.0), (4.0, -9.0), (4.0, 9.0)].map(|(x, y)| Vec3::new(x, y, 0.9));
        assert_eq!(rows(&[[a, b, c], [a, c, d]]), 32);
    }

    #[test]
    fn a_camera_is_known_again_and_another_is_not() {
        let mut masks = EgoOcclusionMask::default();
        let clip = Mat4::IDENTITY;
        let none = || std::iter::empty::<[Vec4; 3]>();
        assert_eq!(masks.visible_rows(clip, [8, 8], none), 8);
        let full_triangle =
            [Vec4::new(-9.0, -9.0, 0.5, 1.0), Vec4::new(9.0, -9.0, 0.5, 1.0), Vec4::new(0.0, 90.0, 0.5, 1.0)];
        let full = || std::iter::once(full_triangle);
        assert_eq!(masks.visible_rows(Mat4::from_translation(Vec3::splat(1e-5)), [8, 8], full), 8);
        assert_eq!(masks.visible_rows(Mat4::from_translation(Vec3::splat(1e-2)), [8, 8], full), 4);
        assert_eq!(masks.visible_rows(clip, [8, 4], full), 4);
        for k in 0..2 * MAX_CACHED_MASKS {
            masks.visible_rows(Mat4::from_translation(Vec3::splat(k as f32)), [8, 8], none);
        }
        assert_eq!(masks.known.len(), MAX_CACHED_MASKS);
    }
}
