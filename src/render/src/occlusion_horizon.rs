//! Occlusion culling by an occlusion horizon: the skyline of the walls around an eye (after Downs, Moller and Sequin
//! 2001, "Occlusion horizons for driving through urban scenery").
//!
//! Buckets divide the azimuth around the eye by its diamond angle, which takes no trigonometry: thousands of boxes are
//! tested for a picture. A bucket keeps distance and slope of the upper edge of the nearest walls
//! that fill it from side to side. An object on the ground behind such a wall is hidden if it rises no more steeply
//! than the wall's top. The test is conservative: it never hides anything visible.

use city3d_scene::Wall;
use glam::{Vec2, Vec3};

/// A power of two.
const BUCKETS: usize = 512;
/// A bucket keeps this many occluders, the nearest.
const OCCLUDERS_PER_BUCKET: usize = 4;
/// Diamond angle of a whole turn, and of a bucket.
const TURN: f32 = 4.0;
const BUCKET: f32 = TURN / BUCKETS as f32;

/// Diamond angle of a direction, from -2 to 2: the way along the square with corners on the axes. It grows as the azimuth
/// does.
fn diamond_angle(direction: Vec2) -> f32 {
    let along = direction.y / (direction.x.abs() + direction.y.abs()).max(f32::MIN_POSITIVE);
    if direction.x >= 0.0 {
        along
    } else if direction.y >= 0.0 {
        TURN / 2.0 - along
    } else {
        -TURN / 2.0 - along
    }
}

/// A direction with a diamond angle between -2 and 2.
fn direction_of(angle: f32) -> Vec2 {
    let turned = angle.abs();
    Vec2::new(1.0 - turned, if turned <= 1.0 { angle } else { (TURN / 2.0 - turned).copysign(angle) })
}

/// The same diamond angle between -2 and 2.
fn wrapped(angle: f32) -> f32 {
    if angle >= TURN / 2.0 {
        angle - TURN
    } else if angle < -TURN / 2.0 {
        angle + TURN
    } else {
        angle
    }
}

/// Wall or row of walls that fills a bucket.
#[derive(Clone, Copy, Debug)]
struct Occluder {
    /// Objects farther away than this can be hidden.
    distance_m: f32,
    /// Rise over distance of the upper edge, where it is lowest.
    slope: f32,
}

const NO_OCCLUDER: Occluder = Occluder { distance_m: f32::INFINITY, slope: f32::NEG_INFINITY };

/// Wall that covers part of a bucket, between two positions as shares of its width.
#[derive(Clone, Copy, Debug)]
struct BucketSegment {
    bucket: usize,
    right: f32,
    left: f32,
    occluder: Occluder,
}

/// Segments with a smaller gap than this share of a bucket, about a hundredth of a pixel, touch each other.
const GAP_TOLERANCE: f32 = 1e-3;

impl Occluder {
    /// Occluder that stands for two side by side: the farther distance, the lower slope.
    fn beside(self, other: Self) -> Self {
        Self { distance_m: self.distance_m.max(other.distance_m), slope: self.slope.min(other.slope) }
    }
}

/// Occlusion horizon of one eye.
#[derive(Clone, Debug)]
pub(super) struct OcclusionHorizon {
    eye: Vec3,
    buckets: Vec<[Occluder; OCCLUDERS_PER_BUCKET]>,
    /// Only what lies between these azimuths is tested.
    sector: AzimuthSector,
}

/// Range of azimuths, as diamond angles: so far to the right and to the left of a middle.
#[derive(Clone, Copy, Debug)]
pub(super) struct AzimuthSector {
    middle: f32,
    right: f32,
    left: f32,
}

impl AzimuthSector {
    pub(super) const ALL: Self = Self { middle: 0.0, right: TURN / 2.0, left: TURN / 2.0 };

    /// Sector of a view with these rays to the corners of its picture; all azimuths if it looks too far up or down.
    pub(super) fn of_view(rays: &[Vec3; 4]) -> Self {
        let ahead: Vec2 = rays.iter().map(|ray| ray.truncate()).sum();
        let half = rays.iter().map(|ray| ahead.angle_to(ray.truncate()).abs()).fold(0.0, f32::max);
        // A view straight down has corners on all sides and no forward azimuth.
        let length = |ray: Vec3| 0.3 * ray.length();
        let is_level =
            rays.iter().all(|&ray| ray.truncate().length() > length(ray)) && ahead.length() > length(rays[0]);
        if !is_level || half >= 1.4 {
            return Self::ALL;
        }
        let middle = diamond_angle(ahead);
        let edge = |turn: f32| wrapped(diamond_angle(Vec2::from_angle(turn).rotate(ahead)) - middle).abs();
        Self { middle, right: edge(-half), left: edge(half) }
    }

    fn is_all(self) -> bool {
        self.right + self.left >= TURN
    }

    /// Clips a span of angles relative to an azimuth to the sector.
    fn clip(self, azimuth: f32, [right, left]: [f32; 2]) -> [f32; 2] {
        if self.is_all() {
            return [right, left];
        }
        let ahead = wrapped(self.middle - azimuth);
        [right.max(ahead - self.right), left.min(ahead + self.left)]
    }
}

/// Upright bounding cylinder of an object on the ground.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoundingCylinder {
    pub(super) middle: Vec2,
    pub(super) radius_m: f32,
    pub(super) top_m: f32,
}

impl OcclusionHorizon {
    /// Horizon of the walls that are visible in a sector.
    pub(super) fn new<'w>(
        eye: Vec3,
        sector: AzimuthSector,
        walls: impl IntoIterator<Item = &'w Wall>,
    ) -> Self {
        let mut horizon = Self { eye, buckets: vec![[NO_OCCLUDER; OCCLUDERS_PER_BUCKET]; BUCKETS], sector };
        let mut segments = Vec::new();
        for wall in walls {
            horizon.add_wall(wall, &mut segments);
        }
        horizon.join_segments(segments);
        horizon
    }

    /// Horizon that hides nothing.
    pub(super) fn empty() -> Self {
        Self::new(Vec3::ZERO, AzimuthSector::ALL, &[])
    }

    /// Adds a wall: an occluder to each bucket that it fills, a segment to those at its ends.
    fn add_wall(&mut self, wall: &Wall, segments: &mut Vec<BucketSegment>) {
        let from = wall.from - self.eye.truncate();
        let to = wall.to - self.eye.truncate();
        let length = from.distance(to);
        let rise = wall.height_m - self.eye.z;
        // Walls run counter-clockwise around their building: a positive distance means that this one faces the eye.
        let distance_m = to.perp_dot(from) / length.max(1e-3);
        if rise <= 0.0 || distance_m < 0.05 {
            return;
        }
        let facing = (to - from).perp() / length;
        let azimuth = diamond_angle(to);
        let span = (diamond_angle(from) - azimuth).rem_euclid(TURN);
        // Azimuths in units of buckets, from right to left.
        let right = (azimuth + TURN / 2.0) / BUCKET;
        let left = right + span / BUCKET;
        let occluder = |right: f32, left: f32| {
            let distances = [right, left].map(|at| {
                let direction = direction_of((at * BUCKET).rem_euclid(TURN) - TURN / 2.0);
                distance_m / (direction.dot(facing) / direction.length()).max(1e-3)
            });
            let distance_m = distances[0].max(distances[1]);
            Occluder { distance_m, slope: rise / distance_m }
        };
        let (first, end) = (right.ceil() as i64, left.floor() as i64);
        let bucket = |k: i64| k.rem_euclid(BUCKETS as i64) as usize;
        for k in first..end {
            insert_occluder(&mut self.buckets[bucket(k)], occluder(k as f32, (k + 1) as f32));
        }
        let mut segment = |k: i64| {
            let (from, to) = (right.max(k as f32), left.min((k + 1) as f32));
            let place = |at: f32| at - k as f32;
            segments.push(BucketSegment {
                bucket: bucket(k),
                right: place(from),
                left: place(to),
                occluder: occluder(from, to),
            });
        };
        segment(first - 1);
        if first <= end {
            segment(end);
        }
    }

    /// Adds occluders made of several segments that fill a bucket together: at corners of a building, and where one
    /// house joins the next.
    fn join_segments(&mut self, mut segments: Vec<BucketSegment>) {
        let max_slope = |a: &BucketSegment, b: &BucketSegment| b.occluder.slope.total_cmp(&a.occluder.slope);
        segments.sort_by(|a, b| a.bucket.cmp(&b.bucket).then_with(|| max_slope(a, b)));
        for segments in segments.chunk_by(|a, b| a.bucket == b.bucket) {
            // The fewest of the steepest: each further one would lower the slope or move the occluder away.
            let filling = (2..=segments.len()).find(|&count| covers_bucket(&segments[..count]));
            if let Some(all) = filling
                .and_then(|count| segments[..count].iter().map(|p| p.occluder).reduce(Occluder::beside))
            {
                insert_occluder(&mut self.buckets[segments[0].bucket], all);
            }
        }
    }

    /// Whether an object on the ground within a bounding cylinder is certainly hidden.
    pub(super) fn hides_cylinder(&self, cylinder: &BoundingCylinder) -> bool {
        let offset = cylinder.middle - self.eye.truncate();
        let distance = offset.length();
        let [near, far] = [distance - cylinder.radius_m, distance + cylinder.radius_m];
        let slope = self.max_slope(cylinder.top_m, near, far);
        let middle = diamond_angle(offset);
        if self.is_open_towards(middle, near, slope) {
            return false;
        }
        let sin = cylinder.radius_m / distance;
        let aside = offset.perp() * (sin / (1.0 - sin * sin).max(1e-6).sqrt());
        let span = [offset - aside, offset + aside].map(|edge| wrapped(diamond_angle(edge) - middle));
        self.hides_span(middle, span, near, slope)
    }

    /// Whether everything in a box on the ground is certainly hidden.
    pub(super) fn hides_box(&self, [low, high]: [Vec3; 2]) -> bool {
        let top_m = high.z;
        let [low, high, eye] = [low, high, self.eye].map(Vec3::truncate);
        let corners = [low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)].map(|at| at - eye);
        let near = eye.clamp(low, high).distance(eye);
        let far = corners.iter().map(|corner| corner.length()).fold(0.0, f32::max);
        let slope = self.max_slope(top_m, near, far);
        let middle = diamond_angle((low + high) / 2.0 - eye);
        if self.is_open_towards(middle, near, slope) {
            return false;
        }
        // From an eye outside a box spans less than half a turn.
        let turns = corners.map(|corner| wrapped(diamond_angle(corner) - middle));
        let span = [turns.into_iter().fold(0.0, f32::min), turns.into_iter().fold(0.0, f32::max)];
        self.hides_span(middle, span, near, slope)
    }

    /// Slope of the steepest ray to a point no higher than `top_m` between two distances.
    fn max_slope(&self, top_m: f32, near: f32, far: f32) -> f32 {
        let rise = top_m - self.eye.z;
        rise / if rise > 0.0 { near } else { far }
    }

    /// Whether the convex hull of some points and everything below it is certainly hidden.
    pub(super) fn hides_hull(&self, tops: &[Vec3]) -> bool {
        if tops.len() < 3 {
            return false;
        }
        let eye = self.eye.truncate();
        let middle = tops.iter().map(|top| top.truncate()).sum::<Vec2>() / tops.len() as f32 - eye;
        let (mut right, mut left, mut slope) = (0.0_f32, 0.0_f32, f32::NEG_INFINITY);
        let mut near = f32::INFINITY;
        for top in tops {
            let at = top.truncate() - eye;
            let (ahead, aside) = (middle.dot(at), middle.perp_dot(at));
            if ahead <= 0.0 {
                return false;
            }
            (right, left) = (right.min(aside / ahead), left.max(aside / ahead));
            let distance = at.length();
            near = near.min(distance);
            slope = slope.max((top.z - self.eye.z) / distance);
        }
        let azimuth = diamond_angle(middle);
        if self.is_open_towards(azimuth, near, slope) {
            return false;
        }
        // A point between two corners may be nearer than either, and steeper: by the cosine of half the angle that they
        // are apart.
        let lengths = ((1.0 + right * right) * (1.0 + left * left)).sqrt();
        let between = (((1.0 + right * left) / lengths + 1.0) / 2.0).max(0.0).sqrt();
        let slope = if slope > 0.0 { slope / between } else { slope };
        let edges = [right, left].map(|aside| middle + middle.perp() * aside);
        let span = edges.map(|edge| wrapped(diamond_angle(edge) - azimuth));
        self.hides_span(azimuth, span, near * between, slope)
    }

    /// Whether something no nearer than `near` and no steeper than `slope` is to be seen in a direction: most things are
    /// found visible by one look, without their outlines.
    fn is_open_towards(&self, azimuth: f32, near: f32, slope: f32) -> bool {
        let [right, left] = self.sector.clip(azimuth, [0.0; 2]);
        near < NEAREST_M || (right <= left && !self.hides_at(bucket_of(azimuth), near, slope))
    }

    /// Whether everything in a span of angles relative to an azimuth, no nearer than `near` and no steeper than
    /// `slope`, is hidden.
    fn hides_span(&self, azimuth: f32, span: [f32; 2], near: f32, slope: f32) -> bool {
        let [right, left] = self.sector.clip(azimuth, span);
        near >= NEAREST_M
            && (bucket_of(azimuth + right)..=bucket_of(azimuth + left)).all(|k| self.hides_at(k, near, slope))
    }

    fn hides_at(&self, bucket: i32, near: f32, slope: f32) -> bool {
        let occluders = &self.buckets[bucket.rem_euclid(BUCKETS as i32) as usize];
        occluders.iter().any(|occluder| occluder.distance_m < near && occluder.slope > slope)
    }
}

/// Nearer things are never hidden.
const NEAREST_M: f32 = 0.1;

/// Number of the bucket of an azimuth, which may be some turns off.
fn bucket_of(azimuth: f32) -> i32 {
    ((azimuth + TURN / 2.0) / BUCKET).floor() as i32
}

/// Whether segments fill a bucket without a gap.
fn covers_bucket(segments: &[BucketSegment]) -> bool {
    let mut filled = 0.0;
    while filled < 1.0 - GAP_TOLERANCE {
        let reached = segments
            .iter()
            .filter(|segment| segment.right <= filled + GAP_TOLERANCE)
            .map(|segment| segment.left);
        match reached.fold(filled, f32::max) {
            farther if farther > filled => filled = farther,
            _ => return false,
        }
    }
    true
}

/// Keeps an occluder if it is not dominated by a nearer and steeper one and is nearer than the farthest one kept.
fn insert_occluder(bucket: &mut [Occluder; OCCLUDERS_PER_BUCKET], new: Occluder) {
    let is_dominated = |known: &Occluder| known.distance_m <= new.distance_m && known.slope >= new.slope;
    if bucket.iter().any(is_dominated) {
        return;
    }
    let farthest = bucket.iter_mut().max_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    if let Some(farthest) = farthest.filter(|known| known.distance_m > new.distance_m) {
        *farthest = new;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::TAU;

    #[test]
    fn diamond_angles_grow_with_the_azimuth_and_lead_back_to_their_direction() {
        let mut last = -TURN / 2.0;
        for k in 1..720 {
            let direction = Vec2::from_angle(k as f32 / 720.0 * TAU - TAU / 2.0) * 7.0;
            let angle = diamond_angle(direction);
            assert!(angle > last && angle < TURN / 2.0, "{k}: {angle}");
            assert!(direction_of(angle).angle_to(direction).abs() < 1e-3, "{k}");
            last = angle;
        }
    }

    /// A block of 20 by 10 metres, 8 high, 20 m north of the origin.
    fn block() -> Vec<Wall> {
        let ring = [(-10.0, 20.0), (10.0, 20.0), (10.0, 30.0), (-10.0, 30.0)].map(Vec2::from);
        (0..4).map(|k| Wall { from: ring[k], to: ring[(k + 1) % 4], height_m: 8.0 }).collect()
    }

    fn cylinder(x: f32, y: f32, top_m: f32) -> BoundingCylinder {
        BoundingCylinder { middle: Vec2::new(x, y), radius_m: 1.0, top_m }
    }

    #[test]
    fn hides_what_stands_behind_and_no_more() {
        let horizon = OcclusionHorizon::new(Vec3::new(0.0, 0.0, 1.5), AzimuthSector::ALL, &block());
        assert!(horizon.hides_cylinder(&cylinder(0.0, 40.0, 3.0)));
        assert!(horizon.hides_cylinder(&cylinder(-12.0, 36.0, 3.0)));
        // In front, beside, on the other side, and above the roof's edge.
        assert!(!horizon.hides_cylinder(&cylinder(0.0, 15.0, 3.0)));
        assert!(!horizon.hides_cylinder(&cylinder(24.0, 40.0, 3.0)));
        assert!(!horizon.hides_cylinder(&cylinder(0.0, -40.0, 3.0)));
        assert!(!horizon.hides_cylinder(&cylinder(0.0, 40.0, 16.0)));
    }

    /// Whatever the buckets that its corners fall into, and wherever around it begins.
    #[test]
    fn a_corner_hides_as_its_walls_do() {
        for begin in 0..4 {
            let mut walls = block();
            walls.rotate_left(begin);
            for k in 0..200 {
                let eye = Vec3::new(-32.0 + 0.05 * k as f32, 2.0, 1.5);
                let horizon = OcclusionHorizon::new(eye, AzimuthSector::ALL, &walls);
                // Behind the corner towards the eye, seen past it in the middle of the block.
                let corner = Vec2::new(-10.0, 20.0);
                let behind = corner + (corner - eye.truncate()).normalize() * 25.0;
                let thing = BoundingCylinder { middle: behind, radius_m: 0.3, top_m: 3.0 };
                assert!(horizon.hides_cylinder(&thing), "from {eye}, beginning with wall {begin}");
            }
        }
    }

    #[test]
    fn what_is_out_of_a_view_needs_no_wall_before_it() {
        let eye = Vec3::new(0.0, 0.0, 1.5);
        // From the middle of the block to behind its left end.
        let thing = [Vec3::new(-40.0, 40.0, 0.0), Vec3::new(0.0, 42.0, 3.0)];
        let ray = |x: f32, z: f32| Vec3::new(x, 1.0, z);
        let view = [ray(-0.4, 0.3), ray(0.4, 0.3), ray(0.4, -0.3), ray(-0.4, -0.3)];
        let hides = |sector: AzimuthSector| OcclusionHorizon::new(eye, sector, &block()).hides_box(thing);
        assert!(!hides(AzimuthSector::ALL) && hides(AzimuthSector::of_view(&view)));
        let wide = view.map(|ray| ray * Vec3::new(2.0, 1.0, 1.0));
        assert!(!hides(AzimuthSector::of_view(&wide)));
        // Wherever north is, and looking down.
        for k in 0..12 {
            let turn = glam::Quat::from_rotation_z(k as f32 * TAU / 12.0 + 0.01);
            let sector = AzimuthSector::of_view(&view.map(|ray| turn * ray));
            let ahead = direction_of(sector.middle);
            let edges = [sector.middle - sector.right, sector.middle + sector.left];
            for (edge, side) in edges.into_iter().zip([-1.0, 1.0]) {
                let turned = ahead.angle_to(direction_of(wrapped(edge)));
                assert!((turned - side * 0.4_f32.atan()).abs() < 1e-4, "{sector:?}");
            }
            let [right, left] = sector.clip(wrapped(sector.middle + 0.3), [-1.0, 1.0]);
            assert!((left - (sector.left - 0.3)).abs() < 1e-4 && (right + sector.right + 0.3).abs() < 1e-4);
        }
        assert!(AzimuthSector::of_view(&view.map(|ray| ray - Vec3::Z * 9.0)).is_all());
        for aside in [0.0, 1e-6, 0.1] {
            let down = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(x, y)| Vec3::new(0.6 * x + aside, 0.45 * y, -1.0));
            assert!(AzimuthSector::of_view(&down).is_all(), "{aside}");
        }
    }

    #[test]
    fn houses_that_join_hide_what_is_behind_the_joint() {
        let house = |x: f32| -> Vec<Wall> {
            let ring = [(x, 20.0), (x + 7.3, 20.0), (x + 7.3, 30.0), (x, 30.0)].map(Vec2::from);
            (0..4).map(|k| Wall { from: ring[k], to: ring[(k + 1) % 4], height_m: 8.0 }).collect()
        };
        let hidden = |gap: f32| {
            let walls = [house(-7.3 - gap), house(0.0)].concat();
            let eyes = (0..200).map(|k| Vec3::new(-3.0 + 0.03 * k as f32, 0.0, 1.5));
            eyes.filter(|&eye| {
                let behind = eye.truncate() * -0.9 + Vec2::new(0.0, 38.0);
                let thing = BoundingCylinder { middle: behind, radius_m: 0.3, top_m: 3.0 };
                OcclusionHorizon::new(eye, AzimuthSector::ALL, &walls).hides_cylinder(&thing)
            })
            .count()
        };
        assert_eq!(hidden(0.0), 200);
        // Through a gap of a metre it is seen from where the gap opens to it.
        assert!((1..190).contains(&hidden(1.0)), "{}", hidden(1.0));
    }

    #[test]
    fn an_eye_above_the_roof_sees_over_it() {
        let horizon = OcclusionHorizon::new(Vec3::new(0.0, 0.0, 12.0), AzimuthSector::ALL, &block());
        assert!(!horizon.hides_cylinder(&cylinder(0.0, 40.0, 3.0)));
    }

    /// Against sight lines: what is hidden has no free line to any point of its upper rim.
    #[test]
    fn never_hides_what_a_line_of_sight_reaches() {
        let walls = block();
        let (mut hidden, mut hidden_boxes, mut hidden_hulls) = (0, 0, 0);
        for k in 0..400 {
            let eye = Vec3::new(-30.0 + 0.15 * k as f32, -4.0 + 0.05 * k as f32, 1.4);
            let horizon = OcclusionHorizon::new(eye, AzimuthSector::ALL, &walls);
            for j in 0..60 {
                let thing = cylinder(-30.0 + j as f32, 36.0 + 0.3 * j as f32, 2.0 + 0.1 * j as f32);
                // Long and narrow, one way or the other.
                let half = if j % 2 == 0 { Vec2::new(9.0, 0.5) } else { Vec2::new(0.5, 7.0) };
                let [low, high] = [thing.middle - half, thing.middle + half];
                if horizon.hides_box([low.extend(0.0), high.extend(thing.top_m)]) {
                    hidden_boxes += 1;
                    for corner in [low, high, Vec2::new(low.x, high.y), Vec2::new(high.x, low.y)] {
                        let rim = corner.extend(thing.top_m);
                        assert!(
                            walls.iter().any(|wall| crosses(wall, eye, rim)),
                            "{eye} sees {low} to {high}"
                        );
                    }
                }
                // A roof that leans, seen at its corners and between them.
                let roof = [low.extend(1.0), Vec2::new(high.x, low.y).extend(2.0), high.extend(thing.top_m)];
                if horizon.hides_hull(&roof) {
                    hidden_hulls += 1;
                    for share in 0..30 {
                        let (k, part) = (share / 10, (share % 10) as f32 / 10.0);
                        let rim = roof[k].lerp(roof[(k + 1) % 3], part);
                        assert!(walls.iter().any(|wall| crosses(wall, eye, rim)), "{eye} sees {roof:?}");
                    }
                }
                if !horizon.hides_cylinder(&thing) {
                    continue;
                }
                hidden += 1;
                for turn in 0..12 {
                    let out = Vec2::from_angle(turn as f32 * TAU / 12.0) * thing.radius_m;
                    let rim = (thing.middle + out).extend(thing.top_m);
                    assert!(walls.iter().any(|wall| crosses(wall, eye, rim)), "{eye} sees {thing:?}");
                }
            }
        }
        let all = [hidden, hidden_boxes, hidden_hulls];
        assert!(all[0] > 1000 && all[1] > 500 && all[2] > all[1], "{all:?}");
    }

    fn crosses(wall: &Wall, eye: Vec3, point: Vec3) -> bool {
        let (along, ray) = (wall.to - wall.from, (point - eye).truncate());
        let across = along.perp_dot(ray);
        // eye + t look = from + u along
        let start = eye.truncate() - wall.from;
        let (u, t) = (start.perp_dot(ray) / across, start.perp_dot(along) / across);
        across != 0.0
            && (0.0..=1.0).contains(&u)
            && (0.0..=1.0).contains(&t)
            && eye.z + t * (point.z - eye.z) <= wall.height_m
    }
}
