//! What walls hide from an eye: the city seen as a skyline.
//!
//! Around the eye lie buckets of azimuth. Each knows of a few walls that fill it from side to side how far
//! away they are and how steeply one has to look up to see over them. What stands on the ground behind a wall
//! and rises no more steeply than its top is hidden (after Downs, Moller and Sequin 2001, "Occlusion horizons
//! for driving through urban scenery"). The answer errs on the side of seeing.

use crate::city::scene::Wall;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

const BUCKETS: usize = 512;
/// Walls that a bucket remembers: the nearest.
const DEPTH: usize = 4;
const BUCKET_RAD: f32 = TAU / BUCKETS as f32;

#[derive(Clone, Copy, Debug)]
struct Screen {
    /// Behind it things are hidden.
    distance_m: f32,
    /// Rise over distance of the least steep look over it.
    slope: f32,
}

const NOTHING: Screen = Screen { distance_m: f32::INFINITY, slope: f32::NEG_INFINITY };

/// What hides a part of a bucket: from one place in it to another, as shares of its width.
#[derive(Clone, Copy, Debug)]
struct Part {
    bucket: usize,
    right: f32,
    left: f32,
    screen: Screen,
}

/// Parts that lie no farther apart than this share of a bucket, a hundredth of a pixel or so, touch each other.
const APART: f32 = 1e-3;

impl Screen {
    /// What both hide, one beside the other.
    fn and(self, other: Self) -> Self {
        Self { distance_m: self.distance_m.max(other.distance_m), slope: self.slope.min(other.slope) }
    }
}

/// What hides things from one eye.
#[derive(Clone, Debug)]
pub(super) struct Horizon {
    eye: Vec3,
    buckets: Vec<[Screen; DEPTH]>,
    /// What it is asked about counts only between these azimuths.
    sector: Sector,
}

/// Azimuths around a middle, up to so far to either side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sector {
    pub(super) middle: f32,
    pub(super) half: f32,
}

impl Sector {
    pub(super) const ALL: Self = Self { middle: 0.0, half: PI };

    /// What a view with these looks to its corners sees; all around where it looks too far up or down.
    pub(super) fn of_view(looks: &[Vec3; 4]) -> Self {
        let ahead: Vec2 = looks.iter().map(|look| look.truncate()).sum();
        let half = looks.iter().map(|look| ahead.angle_to(look.truncate()).abs()).fold(0.0, f32::max);
        // Straight down corners lie on all sides: there is no ahead.
        let length = |look: Vec3| 0.3 * look.length();
        let is_level = looks.iter().all(|&look| look.truncate().length() > length(look))
            && ahead.length() > length(looks[0]);
        if is_level && half < 1.4 { Self { middle: ahead.to_angle(), half } } else { Self::ALL }
    }

    /// The part of a span between two turns from an azimuth that lies in it.
    fn cut(self, azimuth: f32, [right, left]: [f32; 2]) -> [f32; 2] {
        let ahead = (self.middle - azimuth + PI).rem_euclid(TAU) - PI;
        if self.half >= PI {
            [right, left]
        } else {
            [right.max(ahead - self.half), left.min(ahead + self.half)]
        }
    }
}

/// An upright cylinder around something.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pillar {
    pub(super) middle: Vec2,
    pub(super) radius_m: f32,
    pub(super) top_m: f32,
}

impl Horizon {
    /// Of the walls that are seen in a sector.
    pub(super) fn new<'w>(eye: Vec3, sector: Sector, walls: impl IntoIterator<Item = &'w Wall>) -> Self {
        let mut horizon = Self { eye, buckets: vec![[NOTHING; DEPTH]; BUCKETS], sector };
        let mut parts = Vec::new();
        for wall in walls {
            horizon.raise(wall, &mut parts);
        }
        horizon.join(parts);
        horizon
    }

    /// One that hides nothing.
    pub(super) fn open() -> Self {
        Self::new(Vec3::ZERO, Sector::ALL, &[])
    }

    /// Raises a wall; of the buckets that it ends in it fills parts.
    fn raise(&mut self, wall: &Wall, parts: &mut Vec<Part>) {
        let from = wall.from - self.eye.truncate();
        let to = wall.to - self.eye.truncate();
        let length = from.distance(to);
        let rise = wall.height_m - self.eye.z;
        // Walls run counter-clockwise around their building: this one turns its face to the eye.
        let distance_m = to.perp_dot(from) / length.max(1e-3);
        if rise <= 0.0 || distance_m < 0.05 {
            return;
        }
        let facing = (to - from).perp().to_angle();
        let azimuth = to.to_angle();
        let span = (from.to_angle() - azimuth).rem_euclid(TAU);
        // In buckets, from right to left.
        let right = (azimuth + PI) / BUCKET_RAD;
        let left = right + span / BUCKET_RAD;
        let screen = |right: f32, left: f32| {
            let distances =
                [right, left].map(|at| distance_m / (at * BUCKET_RAD - PI - facing).cos().max(1e-3));
            let distance_m = distances[0].max(distances[1]);
            Screen { distance_m, slope: rise / distance_m }
        };
        let (first, end) = (right.ceil() as i64, left.floor() as i64);
        let bucket = |k: i64| k.rem_euclid(BUCKETS as i64) as usize;
        for k in first..end {
            remember(&mut self.buckets[bucket(k)], screen(k as f32, (k + 1) as f32));
        }
        let mut part = |k: i64| {
            let (from, to) = (right.max(k as f32), left.min((k + 1) as f32));
            let place = |at: f32| at - k as f32;
            parts.push(Part {
                bucket: bucket(k),
                right: place(from),
                left: place(to),
                screen: screen(from, to),
            });
        };
        part(first - 1);
        if first <= end {
            part(end);
        }
    }

    /// Remembers what walls hide together that each fill a part of a bucket: at the corners of a building, and
    /// where one house joins the next.
    fn join(&mut self, mut parts: Vec<Part>) {
        let steepest = |a: &Part, b: &Part| b.screen.slope.total_cmp(&a.screen.slope);
        parts.sort_by(|a, b| a.bucket.cmp(&b.bucket).then_with(|| steepest(a, b)));
        for parts in parts.chunk_by(|a, b| a.bucket == b.bucket) {
            // No more than are needed: of the others some are farther away, and all are lower.
            let filling = (2..=parts.len()).find(|&count| fill(&parts[..count]));
            if let Some(all) =
                filling.and_then(|count| parts[..count].iter().map(|p| p.screen).reduce(Screen::and))
            {
                remember(&mut self.buckets[parts[0].bucket], all);
            }
        }
    }

    /// Whether a thing that stands on the ground is certainly out of sight.
    pub(super) fn hides(&self, pillar: &Pillar) -> bool {
        let offset = pillar.middle - self.eye.truncate();
        let distance = offset.length();
        let [near, far] = [distance - pillar.radius_m, distance + pillar.radius_m];
        let half = (pillar.radius_m / distance).asin();
        self.hides_span(offset.to_angle(), [-half, half], near, self.steepest(pillar.top_m, near, far))
    }

    /// The same of whatever is in a box that stands on the ground.
    pub(super) fn hides_box(&self, [low, high]: [Vec3; 2]) -> bool {
        let top_m = high.z;
        let [low, high, eye] = [low, high, self.eye].map(Vec3::truncate);
        let corners = [low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)].map(|at| at - eye);
        let near = eye.clamp(low, high).distance(eye);
        let far = corners.iter().map(|corner| corner.length()).fold(0.0, f32::max);
        // An eye outside sees it within half a turn.
        let middle = (low + high) / 2.0 - eye;
        let turns = corners.map(|corner| middle.angle_to(corner));
        let span = [turns.into_iter().fold(0.0, f32::min), turns.into_iter().fold(0.0, f32::max)];
        self.hides_span(middle.to_angle(), span, near, self.steepest(top_m, near, far))
    }

    /// Slope of the steepest look at something no higher than `top_m` between two distances.
    fn steepest(&self, top_m: f32, near: f32, far: f32) -> f32 {
        let rise = top_m - self.eye.z;
        rise / if rise > 0.0 { near } else { far }
    }

    /// The same of whatever is in the convex hull of some points and of those below them.
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
        let span = [right.atan(), left.atan()];
        // What lies between two points may be nearer than either, and is seen the more steeply.
        let between = ((span[1] - span[0]) / 2.0).cos();
        let slope = if slope > 0.0 { slope / between } else { slope };
        self.hides_span(middle.to_angle(), span, near * between, slope)
    }

    /// Of what is seen between two turns from an azimuth, no nearer than a distance and no more steeply than a slope.
    fn hides_span(&self, azimuth: f32, span: [f32; 2], near: f32, slope: f32) -> bool {
        if near < 0.1 {
            return false;
        }
        let [right, left] = self.sector.cut(azimuth, span);
        let bucket_of = |turn: f32| ((azimuth + turn + PI) / BUCKET_RAD).floor() as i64;
        (bucket_of(right)..=bucket_of(left)).all(|k| {
            let bucket = &self.buckets[k.rem_euclid(BUCKETS as i64) as usize];
            bucket.iter().any(|screen| screen.distance_m < near && screen.slope > slope)
        })
    }
}

/// Whether parts of a bucket leave nothing of it open.
fn fill(parts: &[Part]) -> bool {
    let mut filled = 0.0;
    while filled < 1.0 - APART {
        let reached = parts.iter().filter(|part| part.right <= filled + APART).map(|part| part.left);
        match reached.fold(filled, f32::max) {
            farther if farther > filled => filled = farther,
            _ => return false,
        }
    }
    true
}

fn remember(bucket: &mut [Screen; DEPTH], new: Screen) {
    let is_idle = |known: &Screen| known.distance_m <= new.distance_m && known.slope >= new.slope;
    if bucket.iter().any(is_idle) {
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

    /// A block of 20 by 10 metres, 8 high, 20 m north of the origin.
    fn block() -> Vec<Wall> {
        let ring = [(-10.0, 20.0), (10.0, 20.0), (10.0, 30.0), (-10.0, 30.0)].map(Vec2::from);
        (0..4).map(|k| Wall { from: ring[k], to: ring[(k + 1) % 4], height_m: 8.0 }).collect()
    }

    fn pillar(x: f32, y: f32, top_m: f32) -> Pillar {
        Pillar { middle: Vec2::new(x, y), radius_m: 1.0, top_m }
    }

    #[test]
    fn hides_what_stands_behind_and_no_more() {
        let horizon = Horizon::new(Vec3::new(0.0, 0.0, 1.5), Sector::ALL, &block());
        assert!(horizon.hides(&pillar(0.0, 40.0, 3.0)));
        assert!(horizon.hides(&pillar(-12.0, 36.0, 3.0)));
        // In front, beside, on the other side, and above the roof's edge.
        assert!(!horizon.hides(&pillar(0.0, 15.0, 3.0)));
        assert!(!horizon.hides(&pillar(24.0, 40.0, 3.0)));
        assert!(!horizon.hides(&pillar(0.0, -40.0, 3.0)));
        assert!(!horizon.hides(&pillar(0.0, 40.0, 16.0)));
    }

    /// Whatever the buckets that its corners fall into, and wherever around it begins.
    #[test]
    fn a_corner_hides_as_its_walls_do() {
        for begin in 0..4 {
            let mut walls = block();
            walls.rotate_left(begin);
            for k in 0..200 {
                let eye = Vec3::new(-32.0 + 0.05 * k as f32, 2.0, 1.5);
                let horizon = Horizon::new(eye, Sector::ALL, &walls);
                // Behind the corner towards the eye, seen past it in the middle of the block.
                let corner = Vec2::new(-10.0, 20.0);
                let behind = corner + (corner - eye.truncate()).normalize() * 25.0;
                let thing = Pillar { middle: behind, radius_m: 0.3, top_m: 3.0 };
                assert!(horizon.hides(&thing), "from {eye}, beginning with wall {begin}");
            }
        }
    }

    #[test]
    fn what_is_out_of_a_view_needs_no_wall_before_it() {
        let eye = Vec3::new(0.0, 0.0, 1.5);
        // From the middle of the block to behind its left end.
        let thing = [Vec3::new(-40.0, 40.0, 0.0), Vec3::new(0.0, 42.0, 3.0)];
        let look = |x: f32, z: f32| Vec3::new(x, 1.0, z);
        let view = [look(-0.4, 0.3), look(0.4, 0.3), look(0.4, -0.3), look(-0.4, -0.3)];
        let hides = |sector: Sector| Horizon::new(eye, sector, &block()).hides_box(thing);
        assert!(!hides(Sector::ALL) && hides(Sector::of_view(&view)));
        let wide = view.map(|look| look * Vec3::new(2.0, 1.0, 1.0));
        assert!(!hides(Sector::of_view(&wide)));
        // Wherever north is, and looking down.
        for k in 0..12 {
            let turn = glam::Quat::from_rotation_z(k as f32 * TAU / 12.0 + 0.01);
            let sector = Sector::of_view(&view.map(|look| turn * look));
            assert!((sector.half - 0.4_f32.atan()).abs() < 1e-4, "{sector:?}");
            let [right, left] = sector.cut(sector.middle + 0.3, [-1.0, 1.0]);
            assert!((left - (sector.half - 0.3)).abs() < 1e-4 && (right + sector.half + 0.3).abs() < 1e-4);
        }
        assert!(Sector::of_view(&view.map(|look| look - Vec3::Z * 9.0)).half >= PI);
        for aside in [0.0, 1e-6, 0.1] {
            let down = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(x, y)| Vec3::new(0.6 * x + aside, 0.45 * y, -1.0));
            assert!(Sector::of_view(&down).half >= PI, "{aside}");
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
                let thing = Pillar { middle: behind, radius_m: 0.3, top_m: 3.0 };
                Horizon::new(eye, Sector::ALL, &walls).hides(&thing)
            })
            .count()
        };
        assert_eq!(hidden(0.0), 200);
        // Through a gap of a metre it is seen from where the gap opens to it.
        assert!((1..190).contains(&hidden(1.0)), "{}", hidden(1.0));
    }

    #[test]
    fn an_eye_above_the_roof_sees_over_it() {
        let horizon = Horizon::new(Vec3::new(0.0, 0.0, 12.0), Sector::ALL, &block());
        assert!(!horizon.hides(&pillar(0.0, 40.0, 3.0)));
    }

    /// Against sight lines: what is hidden has no free line to any point of its upper rim.
    #[test]
    fn never_hides_what_a_line_of_sight_reaches() {
        let walls = block();
        let (mut hidden, mut hidden_boxes, mut hidden_hulls) = (0, 0, 0);
        for k in 0..400 {
            let eye = Vec3::new(-30.0 + 0.15 * k as f32, -4.0 + 0.05 * k as f32, 1.4);
            let horizon = Horizon::new(eye, Sector::ALL, &walls);
            for j in 0..60 {
                let thing = pillar(-30.0 + j as f32, 36.0 + 0.3 * j as f32, 2.0 + 0.1 * j as f32);
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
                if !horizon.hides(&thing) {
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
        let (along, look) = (wall.to - wall.from, (point - eye).truncate());
        let across = along.perp_dot(look);
        // eye + t look = from + u along
        let start = eye.truncate() - wall.from;
        let (u, t) = (start.perp_dot(look) / across, start.perp_dot(along) / across);
        across != 0.0
            && (0.0..=1.0).contains(&u)
            && (0.0..=1.0).contains(&t)
            && eye.z + t * (point.z - eye.z) <= wall.height_m
    }
}
