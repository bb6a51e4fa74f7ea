//! What an onboard camera sees of its carrier: the triangles of the body that are drawn, and the bottom rows of the picture
//! that it covers entirely. The body is rasterised on the CPU with its depth; nothing else is drawn in those rows.

use glam::{Mat3, Mat4, Vec2, Vec3, Vec4};
use std::ops::Range;

/// Rows kept visible beyond the first covered row, against rounding.
const MARGIN_ROWS: u32 = 2;
/// Software adapters rasterise blocks of this many rows.
const BLOCK_ROWS: u32 = 4;
/// Projections whose entries differ by less share a view: a tenth of a pixel.
const PROJECTION_TOLERANCE: f32 = 1e-4;
/// Capacity of the cache, per vehicle mesh.
const MAX_CACHED_VIEWS: usize = 256;
/// Margins of what may be seen: as a share of half the picture, and of the sine of the angle to a face.
const EDGE_MARGIN: f32 = 0.01;
const FACING_MARGIN: f32 = 3e-3;
/// A face is looked for so many pixels around it: samples are beside the centres of pixels, and cameras share views.
const REACH_PX: f32 = 1.0;
/// Faces no farther behind others than this share of their distance are drawn: what lies on a surface.
const DEPTH_MARGIN: f32 = 2e-3;

/// What cameras see of the vehicles of one mesh that carried them, with what is kept to draw it.
#[derive(Clone, Debug)]
pub(super) struct EgoViews<T> {
    known: Vec<EgoView<T>>,
}

/// What a camera sees of its carrier.
#[derive(Clone, Debug)]
pub(super) struct EgoView<T> {
    clip_from_body: Mat4,
    extent: [u32; 2],
    /// Number of rows from the top that the carrier does not cover entirely.
    pub(super) visible_rows: u32,
    /// Made of the triangles in the picture that may face the camera and are not behind others.
    pub(super) drawn: T,
}

impl<T> Default for EgoViews<T> {
    fn default() -> Self {
        Self { known: Vec::new() }
    }
}

impl<T> EgoViews<T> {
    /// What a camera sees. `triangles` are in clip coordinates; `keep` gets the numbers of those that it may see.
    pub(super) fn of<I: Iterator<Item = [Vec4; 3]>>(
        &mut self,
        clip_from_body: Mat4,
        extent: [u32; 2],
        triangles: impl FnOnce() -> I,
        keep: impl FnOnce(&[usize]) -> T,
    ) -> &EgoView<T> {
        let is_same = |known: &EgoView<T>| {
            known.extent == extent && known.clip_from_body.abs_diff_eq(clip_from_body, PROJECTION_TOLERANCE)
        };
        let index = self.known.iter().position(is_same).unwrap_or_else(|| {
            let triangles: Vec<[Vec4; 3]> = triangles().collect();
            let faces: Vec<Option<FrontFace>> =
                triangles.iter().map(|triangle| FrontFace::of(triangle, extent)).collect();
            let nearest = NearestFaces::new(faces.iter().flatten(), extent);
            let may_show = |k: usize| faces[k].as_ref().is_none_or(|face| nearest.may_show(face));
            let is_seen = |&k: &usize| may_be_seen(&triangles[k]) && may_show(k);
            let seen: Vec<usize> = (0..triangles.len()).filter(is_seen).collect();
            let visible_rows = nearest.visible_rows();
            if self.known.len() == MAX_CACHED_VIEWS {
                self.known.remove(0);
            }
            self.known.push(EgoView { clip_from_body, extent, visible_rows, drawn: keep(&seen) });
            self.known.len() - 1
        });
        &self.known[index]
    }
}

/// Whether some part of a triangle may be in the picture with its front: not beyond one of its edges, behind the eye or
/// turned away, each by a margin for cameras that share a view.
fn may_be_seen(triangle: &[Vec4; 3]) -> bool {
    let beyond = |side: &dyn Fn(&Vec4) -> f32| triangle.iter().all(|at| side(at) > EDGE_MARGIN * at.w.abs());
    let is_outside = beyond(&|at| at.x - at.w)
        || beyond(&|at| -at.x - at.w)
        || beyond(&|at| at.y - at.w)
        || beyond(&|at| -at.y - at.w)
        || triangle.iter().all(|at| at.w < 0.0);
    !is_outside && facing(triangle) > -FACING_MARGIN
}

/// The sine of the angle under which a ray to a triangle meets it, negative from behind; in the frame of the picture, whose
/// axes are stretched.
fn facing(triangle: &[Vec4; 3]) -> f32 {
    let [a, b, c] = triangle.map(|at| Vec3::new(at.x, at.y, at.w));
    let normal = (b - a).cross(c - a);
    a.dot(normal) / (a.length() * normal.length()).max(f32::MIN_POSITIVE)
}

/// A triangle that faces the eye, in the picture.
struct FrontFace {
    /// Corners in pixels from the upper left, y downwards.
    outline: Vec<Vec2>,
    /// Its inverse distance along the optical axis is `x * plane.x + y * plane.y + plane.z`.
    plane: Vec3,
}

impl FrontFace {
    /// `None` for a triangle that is turned away or seen edge on, and where nothing of it is in front of the near plane.
    fn of(triangle: &[Vec4; 3], [width, height]: [u32; 2]) -> Option<Self> {
        if facing(triangle) <= FACING_MARGIN {
            return None;
        }
        let scale = Vec2::new(width as f32, -(height as f32)) / 2.0;
        let outline: Vec<Vec2> = clip_to_near_plane(triangle)
            .map(|corner| (corner.truncate().truncate() / corner.w + Vec2::new(1.0, -1.0)) * scale)
            .collect();
        // 1/w is linear on the screen: a x + b y + c w = 1 at all corners (Olano, Greer 1997).
        let [p, q, r] = triangle.map(|at| Vec3::new(at.x, at.y, at.w));
        let [a, b, c] = (Mat3::from_cols(p, q, r).transpose().inverse() * Vec3::ONE).to_array();
        let plane = Vec3::new(a / scale.x, b / scale.y, c - a + b);
        (outline.len() > 2).then_some(Self { outline, plane })
    }

    fn inverse_distance(&self, at: Vec2) -> f32 {
        self.plane.truncate().dot(at) + self.plane.z
    }
}

/// The nearest front face at the centre of each pixel (z-buffer; Catmull 1974).
struct NearestFaces {
    extent: [u32; 2],
    /// Inverse distances; 0 where there is none.
    inverse_distances: Vec<f32>,
}

impl NearestFaces {
    fn new<'a>(faces: impl Iterator<Item = &'a FrontFace>, extent: [u32; 2]) -> Self {
        let mut inverse_distances = vec![0.0_f32; (extent[0] * extent[1]) as usize];
        for face in faces {
            for (row, columns) in spans(&face.outline, 0.0, extent) {
                for column in columns {
                    let nearest = &mut inverse_distances[row * extent[0] as usize + column];
                    *nearest = nearest.max(face.inverse_distance(centre(column, row)));
                }
            }
        }
        Self { extent, inverse_distances }
    }

    /// Whether some part of a face may be in front of the others. Errs towards yes.
    fn may_show(&self, face: &FrontFace) -> bool {
        let slack = 1.5 * REACH_PX * (face.plane.x.abs() + face.plane.y.abs());
        let most = face.outline.iter().map(|&at| face.inverse_distance(at)).fold(0.0, f32::max);
        spans(&face.outline, REACH_PX, self.extent).any(|(row, mut columns)| {
            columns.any(|column| {
                let here = (face.inverse_distance(centre(column, row)) + slack).min(most);
                here >= (1.0 - DEPTH_MARGIN) * self.inverse_distances[row * self.extent[0] as usize + column]
            })
        })
    }

    /// Counts the rows above the covered block at the bottom.
    fn visible_rows(&self) -> u32 {
        let [width, height] = self.extent;
        let rows = self.inverse_distances.chunks_exact(width as usize).rev();
        let hidden = rows.take_while(|row| row.iter().all(|&nearest| nearest > 0.0)).count() as u32;
        (height - hidden.saturating_sub(MARGIN_ROWS)).next_multiple_of(BLOCK_ROWS).min(height)
    }
}

/// The centre of pixel k is at k + 0.5.
fn centre(column: usize, row: usize) -> Vec2 {
    Vec2::new(column as f32, row as f32) + 0.5
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

/// Scan-line rasterisation: rows and columns of the pixels whose centres are in a convex polygon, or so close to it.
fn spans(
    outline: &[Vec2],
    reach: f32,
    [width, height]: [u32; 2],
) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
    let ys = || outline.iter().map(|at| at.y);
    let [top, bottom] = [ys().fold(f32::INFINITY, f32::min), ys().fold(f32::NEG_INFINITY, f32::max)];
    let pixels = move |from: f32, to: f32, size: u32| {
        let from = (from - reach - 0.5).ceil().clamp(0.0, size as f32) as usize;
        from..(((to + reach - 0.5).floor() + 1.0).clamp(0.0, size as f32) as usize).max(from)
    };
    pixels(top, bottom, height).map(move |row| {
        let y = row as f32 + 0.5;
        let crossings = |y: f32| {
            let sides = outline.iter().zip(outline.iter().cycle().skip(1));
            let crossed = sides.filter(move |(a, b)| (a.y <= y) != (b.y <= y));
            crossed.map(move |(a, b)| a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y))
        };
        let corners = outline.iter().filter(move |at| (at.y - y).abs() < reach).map(|at| at.x);
        let (left, right) = crossings(y - reach)
            .chain(crossings(y + reach))
            .chain(corners)
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(l, r), x| (l.min(x), r.max(x)));
        (row, pixels(left, right, width))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_sensors::{Extrinsics, Lens, View};
    use glam::DVec3;

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
        EgoViews::default().of(clip, lens.extent, triangles, |_| ()).visible_rows
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
        let mut views = EgoViews::default();
        let mut rows = |clip: Mat4, extent: [u32; 2], triangle: Option<[Vec4; 3]>| {
            views.of(clip, extent, || triangle.into_iter(), |_| ()).visible_rows
        };
        let clip = Mat4::IDENTITY;
        assert_eq!(rows(clip, [8, 8], None), 8);
        let full =
            [Vec4::new(-9.0, -9.0, 0.5, 1.0), Vec4::new(9.0, -9.0, 0.5, 1.0), Vec4::new(0.0, 90.0, 0.5, 1.0)];
        assert_eq!(rows(Mat4::from_translation(Vec3::splat(1e-5)), [8, 8], Some(full)), 8);
        assert_eq!(rows(Mat4::from_translation(Vec3::splat(1e-2)), [8, 8], Some(full)), 4);
        assert_eq!(rows(clip, [8, 4], Some(full)), 4);
        for k in 0..2 * MAX_CACHED_VIEWS {
            rows(Mat4::from_translation(Vec3::splat(k as f32)), [8, 8], None);
        }
        assert_eq!(views.known.len(), MAX_CACHED_VIEWS);
    }

    #[test]
    fn what_is_beside_behind_or_turned_away_is_not_drawn() {
        let lens = Lens { extent: [64, 48], ..Lens::default() };
        let eye = DVec3::new(0.0, 0.0, 1.4);
        let clip = View::new(Extrinsics::looking_at(eye, eye + DVec3::X), &lens).clip_from_world().as_mat4();
        let seen = |faces: Vec<[Vec3; 3]>| {
            let triangles = || faces.iter().map(|face| face.map(|at| clip * at.extend(1.0)));
            EgoViews::default().of(clip, lens.extent, triangles, <[usize]>::len).drawn
        };
        assert_eq!(seen(sheet(2.0, [1.0, 1.8], 0.5)), 2);
        // It surrounds the whole picture.
        assert_eq!(seen(sheet(2.0, [-90.0, 90.0], 90.0)), 2);
        let turned = sheet(2.0, [1.0, 1.8], 0.5).into_iter().map(|[a, b, c]| [a, c, b]).collect();
        assert_eq!(seen(turned), 0);
        assert_eq!(seen(sheet(-2.0, [1.0, 1.8], 0.5)), 0);
        let aside = sheet(2.0, [1.0, 1.8], 0.5).into_iter().map(|face| face.map(|at| at + Vec3::Y * 3.0));
        assert_eq!(seen(aside.collect()), 0);
        // A floor that reaches from behind the eye to far ahead.
        let [a, b, c] = [(-3.0, 9.0), (-3.0, -9.0), (40.0, 0.0)].map(|(x, y)| Vec3::new(x, y, 0.9));
        assert_eq!(seen(vec![[a, b, c]]), 1);
    }

    #[test]
    fn what_is_behind_other_faces_is_not_drawn() {
        let lens = Lens { extent: [64, 48], ..Lens::default() };
        let eye = DVec3::new(0.0, 0.0, 1.4);
        let clip = View::new(Extrinsics::looking_at(eye, eye + DVec3::X), &lens).clip_from_world().as_mat4();
        let seen = |sheets: &[Vec<[Vec3; 3]>]| {
            let faces = sheets.concat();
            let triangles = || faces.iter().map(|face| face.map(|at| clip * at.extend(1.0)));
            EgoViews::default().of(clip, lens.extent, triangles, <[usize]>::to_vec).drawn.clone()
        };
        let screen = || sheet(2.0, [1.0, 1.8], 0.5);
        // Behind it, before it, on it, beside it and beyond its edge by three pixels.
        assert_eq!(seen(&[screen(), sheet(4.0, [1.0, 1.8], 0.5)]), [0, 1]);
        assert_eq!(seen(&[screen(), sheet(1.0, [1.3, 1.5], 0.1)]), [0, 1, 2, 3]);
        assert_eq!(seen(&[screen(), sheet(1.999, [1.3, 1.5], 0.1)]), [0, 1, 2, 3]);
        assert_eq!(seen(&[screen(), sheet(4.0, [2.0, 2.6], 0.5)]), [0, 1, 2, 3]);
        assert_eq!(seen(&[screen(), sheet(4.0, [1.0, 2.4], 0.5)]), [0, 1, 2, 3]);
        // Of a floor that goes on under the screen, what is nearer is seen.
        let floor = |[from, to]: [f32; 2]| {
            let [a, b, c, d] =
                [(from, 0.4), (from, -0.4), (to, -0.4), (to, 0.4)].map(|(x, y)| Vec3::new(x, y, 1.05));
            vec![[a, b, c], [a, c, d]]
        };
        assert_eq!(seen(&[screen(), floor([1.0, 2.5])]), [0, 1, 2, 3]);
        assert_eq!(seen(&[screen(), floor([2.2, 2.5])]), [0, 1]);
    }
}
