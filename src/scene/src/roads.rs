//! The outline of the road surface from the union of all lanes, with pavements along it.

use super::CELL_M;
use super::field::{DistanceField, regions_of, simplified};
use super::ground_sheet::{GRASS_M, GroundSheet};
use super::kerbs::{self, Fall, Kerb};
use super::mesh::{Finish, Mesh, Vertex};
use super::outlines::{Corner, Cover};
use super::polygon::{Region, doubled_area, inset_union, mitre, without};
use super::smoothing::smooth_outlines;
use city3d_geometry::Segment;
use city3d_roadmap::{CityMap, Footprint, Lane, LaneId, SceneryKind};
use glam::{DVec2, Vec2, Vec3};

/// Grid spacing of the distance field.
const STEP_M: f64 = 0.25;
/// Fillet radius of corners between roads; narrower gaps become road.
const FILLET_M: f64 = 2.2;
/// Asphalt beyond the outermost lanes.
pub(super) const SHOULDER_M: f32 = 0.30;
pub(super) const PAVEMENT_M: f32 = 2.0;
/// Distances are computed this far beyond what is needed.
const BEYOND_M: f64 = 0.6;
/// Around everything.
const MARGIN_M: f64 = 14.0;
/// Taper length in front of a widened bend.
const TAPER_M: f64 = 5.0;
/// Clearance between smoothed outlines and obstacles.
const KEPT_M: f64 = 1.2;
/// Smaller holes in the asphalt are filled.
const LEAST_ISLAND_M2: f64 = 2.5;

/// The signed distance field of the road surface: negative on the road, corners rounded, infinite far away.
pub(super) struct RoadField {
    pub(super) distance: DistanceField,
}

/// Half widths along a lane, tapered in front of and behind widened bends.
struct WidthProfile {
    left: Vec<f64>,
    right: Vec<f64>,
    step: f64,
}

impl WidthProfile {
    fn new(map: &CityMap, lane: &Lane) -> Self {
        let length = lane.curve.length();
        let count = (length / 0.5).ceil().max(1.0) as usize;
        let step = length / count as f64;
        let raw: Vec<(f64, f64)> = (0..=count)
            .map(|k| lane.half_widths_at((k as f64 * step).clamp(1e-6, (length - 1e-6).max(1e-6))))
            .collect();
        let half = lane.width_m / 2.0;
        // Widening that bends of preceding and following lanes require at the ends of this lane.
        let beyond = |ids: &[LaneId], at_start: bool| {
            let near = |lane: &Lane| if at_start { (lane.curve.length() - 1e-6).max(0.0) } else { 1e-6 };
            ids.iter().map(|&id| map.lane(id)).map(|lane| lane.half_widths_at(near(lane))).collect::<Vec<_>>()
        };
        let (before, after) = (beyond(&lane.predecessors, true), beyond(&lane.successors, false));
        let smooth = |side: &dyn Fn(&(f64, f64)) -> f64| -> Vec<f64> {
            let reach = (TAPER_M / step) as usize;
            let widest = |widths: &[(f64, f64)]| widths.iter().map(side).fold(half, f64::max);
            let (before, after) = (widest(&before), widest(&after));
            let eased = |width: f64, away: f64| {
                let far = (away / TAPER_M).min(1.0);
                half + (width - half) * (1.0 - far * far * (3.0 - 2.0 * far))
            };
            (0..=count)
                .map(|k| {
                    let ends = eased(before, k as f64 * step).max(eased(after, (count - k) as f64 * step));
                    (k.saturating_sub(reach)..=(k + reach).min(count))
                        .map(|j| eased(side(&raw[j]), k.abs_diff(j) as f64 * step))
                        .fold(ends, f64::max)
                })
                .collect()
        };
        Self { left: smooth(&|w| w.0), right: smooth(&|w| w.1), step }
    }

    fn widest(&self) -> f64 {
        self.left.iter().chain(&self.right).fold(0.0, |widest, width| width.max(widest))
    }

    fn at(&self, s: f64, left: bool) -> f64 {
        let table = if left { &self.left } else { &self.right };
        let at = (s / self.step.max(1e-9)).clamp(0.0, (table.len() - 1) as f64);
        let k = (at as usize).min(table.len().saturating_sub(2));
        let next = table[(k + 1).min(table.len() - 1)];
        table[k] + (next - table[k]) * (at - k as f64)
    }
}

/// Arc length and lateral offset of a point relative to a segment, also beyond its ends.
fn on_segment(segment: &Segment, point: DVec2) -> (f64, f64) {
    let (Some(centre), Some(radius)) = (segment.centre(), segment.radius()) else {
        let offset = point - segment.start.position;
        let forward = segment.start.forward();
        return (offset.dot(forward), forward.perp_dot(offset));
    };
    let (from, start) = (point - centre, segment.start.position - centre);
    let sign = segment.curvature.signum();
    let middle = segment.length / radius / 2.0;
    let turned = sign * start.perp_dot(from).atan2(start.dot(from));
    let turned = middle + city3d_geometry::wrap_angle(turned - middle);
    (turned * radius, sign * (radius - from.length()))
}

/// The box of the closed ground of a map, from which the land goes on.
pub(super) fn closed_ground(map: &CityMap) -> [DVec2; 2] {
    let [low, high] = map.bounds();
    GroundSheet::closed_box([low - MARGIN_M, high + MARGIN_M])
}

impl RoadField {
    pub(super) fn new(map: &CityMap) -> Self {
        let [low, high] = map.bounds();
        let reach = FILLET_M + BEYOND_M;
        let mut raw = DistanceField::new([low - MARGIN_M, high + MARGIN_M], STEP_M);
        for lane in &map.lanes {
            let profile = WidthProfile::new(map, lane);
            let widest = profile.widest();
            for (index, segment) in lane.curve.segments().iter().enumerate() {
                let station = lane.curve.station(index);
                let margin = widest + reach;
                let ring = segment.centre().zip(segment.radius());
                let forward = segment.start.forward();
                // The whole circle or line gives a lower bound; far nodes are skipped.
                let least = |point: DVec2| {
                    let away = match ring {
                        Some((centre, radius)) => (point.distance(centre) - radius).abs(),
                        None => forward.perp_dot(point - segment.start.position).abs(),
                    };
                    if away > margin { f64::INFINITY } else { away - widest }
                };
                raw.lower(segment_box(segment, margin), least, |point| {
                    let (s, lateral) = on_segment(segment, point);
                    let beyond = (-s).max(s - segment.length).max(0.0);
                    let side =
                        lateral.abs() - profile.at(station + s.clamp(0.0, segment.length), lateral > 0.0);
                    if beyond > 0.0 { DVec2::new(beyond, side.max(0.0)).length() } else { side }
                });
            }
        }
        let standing = || raw.distance_to(&standing(map), 2.0 * KEPT_M);
        let (rounded, standing) = rayon::join(|| closed(&raw, FILLET_M, reach), standing);
        // Then smoothed, except near obstacles.
        let outline = smooth_outlines(&rounded.contours(0.0), &raw, |at| f64::from(standing.at(at)) < KEPT_M);
        let smoothed = rounded.signed_distance_to(&outline, FILLET_M);
        let distance = rounded.with(&smoothed, |was, now| if now.is_finite() { now } else { was });
        Self { distance }
    }
}

/// Morphological closing: dilation by a radius, then erosion, as far as `reach`.
fn closed(raw: &DistanceField, radius: f64, reach: f64) -> DistanceField {
    let out = simplified(&raw.contours(radius as f32), 0.01);
    let back = raw.distance_to(&out, reach);
    let (radius, deepest) = (radius as f32, reach as f32);
    raw.with(&back, |raw, back| if raw >= radius { raw } else { raw.min(radius - back.min(deepest)) })
}

/// Obstacles that kerbs keep clear of, as rings: trunks, lamp posts and footprints.
fn standing(map: &CityMap) -> Vec<Vec<DVec2>> {
    let pieces = map
        .scenery
        .iter()
        .filter(|piece| !matches!(piece.kind, SceneryKind::Grass | SceneryKind::Paving | SceneryKind::Water));
    pieces
        .map(|piece| match &piece.shape {
            Footprint::Circle { centre, .. } => vec![*centre],
            Footprint::Polygon(ring) => ring.clone(),
            // Out and back along the line.
            Footprint::Polyline(line) => line.iter().chain(line.iter().rev()).copied().collect(),
        })
        .collect()
}

/// The bounding box of a segment with a margin.
fn segment_box(segment: &Segment, margin: f64) -> [DVec2; 2] {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let pieces = ((segment.length / 2.0).ceil() as usize).max(1);
    for k in 0..=pieces {
        let at = segment.pose_at(segment.length * k as f64 / pieces as f64).position;
        (low, high) = (low.min(at), high.max(at));
    }
    [low - margin, high + margin]
}

/// Triangulates a region as a horizontal surface with planar texture coordinates in metres.
pub(super) fn level(mesh: &mut Mesh, region: &Region, z: f32, finish: Finish, metres_per_repeat: f32) {
    for triangle in region.in_squares(f64::from(CELL_M)).iter().flat_map(Region::triangulate) {
        let corners = triangle.map(|p| p.as_vec2().extend(z));
        let uvs = triangle.map(|p| p.as_vec2() / metres_per_repeat);
        mesh.face(&corners, &uvs, finish);
    }
}

/// A strip beside a closed ring, between two lateral offsets and heights, right of the ring. Rings of a
/// region have the region to their left, so right is outside.
pub(super) fn band(mesh: &mut Mesh, ring: &[DVec2], edges: [Vec2; 2], finish: Finish) {
    band_along(mesh, ring, |_| edges, finish, |along, edge| Vec2::new(along, edge.x + edge.y) / 2.0);
}

/// [`band`] with offsets per corner and texture coordinates from the arc length and the offset.
pub(super) fn band_along(
    mesh: &mut Mesh,
    ring: &[DVec2],
    edges: impl Fn(usize) -> [Vec2; 2],
    finish: Finish,
    uv: impl Fn(f32, Vec2) -> Vec2,
) {
    let count = ring.len();
    let mut along = 0.0;
    let base = mesh.vertices.len() as u32;
    for k in 0..=count {
        let [from, to] = edges(k % count);
        let facing = (to - from).perp();
        let out = mitre(ring, k).as_vec2();
        let at = ring[k % count].as_vec2();
        let normal = (out.normalize_or(Vec2::X) * facing.x).extend(facing.y).normalize_or(Vec3::Z);
        for edge in [from, to] {
            let position = (at + out * edge.x).extend(edge.y);
            mesh.vertex(Vertex { position, normal, uv: uv(along, edge), finish, openness: 255 });
        }
        along += ring[k % count].distance(ring[(k + 1) % count]) as f32;
    }
    for k in 0..count as u32 {
        let a = base + 2 * k;
        mesh.indices.extend([a, a + 1, a + 3, a, a + 3, a + 2]);
    }
}

/// Edge tolerance by level of detail.
pub(super) const LEVELS: [f32; 3] = [0.0, 0.08, 0.30];

/// Outlines of all ground covers, as fine as the grid.
pub(super) struct Outlines {
    kerbs: Vec<Vec<DVec2>>,
    /// Up to the backs of the kerbs.
    paved: Vec<Region>,
    pavement: Vec<Vec<DVec2>>,
}

fn rings_of(regions: Vec<Region>) -> Vec<Vec<DVec2>> {
    regions.into_iter().flat_map(|region| std::iter::once(region.outer).chain(region.holes)).collect()
}

/// Narrower strips between paved areas are paved.
const STRIP_M: f64 = 1.0;

/// Finest tolerance of kerb outlines, and of those of pavements.
const KERBS_WITHIN_M: f64 = 0.012;
const PAVEMENTS_WITHIN_M: f64 = 0.04;
/// Smaller pieces of pavement are left out.
const LEAST_PAVEMENT_M2: f64 = 0.2;
/// Smaller pieces of grass within pavements are paved.
const LEAST_LAWN_M2: f64 = 6.0;

impl Outlines {
    /// Outlines for a road field and further paved areas.
    pub(super) fn new(field: &RoadField, paving: &[Vec<DVec2>]) -> Self {
        let road = &field.distance;
        let kerbs = simplified(&road.contours(SHOULDER_M), KERBS_WITHIN_M);
        let kerbs = rings_of(regions_of(kerbs, LEAST_ISLAND_M2));
        let away = road.signed_distance_to(&kerbs, f64::from(PAVEMENT_M) + BEYOND_M);
        // Closes grass strips as narrow as this between pavements and other paved areas.
        let paved = rings_of(inset_union(paving.iter().map(Vec::as_slice), 0.0));
        let paved = road.signed_distance_to(&paved, BEYOND_M);
        let pavement = away.with(&paved, |away, paved| (away - PAVEMENT_M).min(paved));
        let pavement = closed(&pavement, STRIP_M / 2.0, BEYOND_M).contours(0.0);
        let mut pavement = regions_of(simplified(&pavement, PAVEMENTS_WITHIN_M), LEAST_PAVEMENT_M2);
        for region in &mut pavement {
            region.holes.retain(|hole| doubled_area(hole).abs() > 2.0 * LEAST_LAWN_M2);
        }
        let paved = simplified(&road.contours(SHOULDER_M + kerbs::WIDTH_M as f32), 3.0 * KERBS_WITHIN_M);
        Self { kerbs, paved: regions_of(paved, LEAST_ISLAND_M2), pavement: rings_of(pavement) }
    }

    /// The part of a ring that lies behind the kerbs.
    pub(super) fn beside_roads(&self, field: &RoadField, ring: &[DVec2]) -> Vec<Region> {
        /// Sampling distance along the ring.
        const LOOK_M: f64 = 1.0;
        let is_near = (0..ring.len()).any(|k| {
            let (from, to) = (ring[k], ring[(k + 1) % ring.len()]);
            let count = (from.distance(to) / LOOK_M).ceil().max(1.0);
            (0..count as usize)
                .any(|n| f64::from(field.distance.at(from.lerp(to, n as f64 / count))) < LOOK_M)
        });
        let whole = [Region::simple(ring)];
        if is_near { without(&whole, &self.paved) } else { whole.to_vec() }
    }

    /// Outlines of the asphalt, with the road to their left.
    pub(super) fn kerbs(&self) -> &[Vec<DVec2>] {
        &self.kerbs
    }

    /// The ground of a map: asphalt, kerbs with lowered parts at driveways, pavements and grass.
    pub(super) fn ground(self, map: &CityMap, drives: &[&Footprint]) -> GroundSheet {
        let kerbs: Vec<Kerb> = self.kerbs.iter().map(|ring| Kerb::new(ring, drives)).collect();
        let falls: Vec<Fall> = kerbs.iter().flat_map(Kerb::falls).collect();
        let backs = rings_of(self.paved);
        let on_grass = |at: &DVec2| Corner { at: *at, height_m: GRASS_M, is_kept: false };
        let rings: Vec<(Cover, Vec<Corner>)> = kerbs
            .iter()
            .map(|kerb| (Cover::Road, kerb.face_corners()))
            .chain(backs.iter().map(|ring| (Cover::Kerb, kerbs::back_corners(ring, &falls))))
            .chain(self.pavement.iter().map(|ring| (Cover::Pavement, ring.iter().map(on_grass).collect())))
            .collect();
        let [low, high] = map.bounds();
        let height_at = |at: DVec2| kerbs::pavement_height(&falls, at);
        let aprons = kerbs.iter().flat_map(Kerb::apron_backs);
        GroundSheet::new([low - MARGIN_M, high + MARGIN_M], &rings, height_at, aprons)
    }
}
