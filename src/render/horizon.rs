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

/// What hides things from one eye.
#[derive(Clone, Debug)]
pub(super) struct Horizon {
    eye: Vec3,
    buckets: Vec<[Screen; DEPTH]>,
}

/// An upright cylinder around something.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pillar {
    pub(super) middle: Vec2,
    pub(super) radius_m: f32,
    pub(super) top_m: f32,
}

impl Horizon {
    pub(super) fn new<'w>(eye: Vec3, walls: impl IntoIterator<Item = &'w Wall>) -> Self {
        let mut horizon = Self { eye, buckets: vec![[NOTHING; DEPTH]; BUCKETS] };
        for wall in walls {
            horizon.raise(wall);
        }
        horizon
    }

    /// One that hides nothing.
    pub(super) fn open() -> Self {
        Self::new(Vec3::ZERO, &[])
    }

    fn raise(&mut self, wall: &Wall) {
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
        let right = to.to_angle();
        let span = (from.to_angle() - right).rem_euclid(TAU);
        let first = ((right + PI) / BUCKET_RAD).ceil() as i64;
        let end = ((right + span + PI) / BUCKET_RAD).floor() as i64;
        for k in first..end {
            let edges = [k, k + 1].map(|k| k as f32 * BUCKET_RAD - PI);
            let distances = edges.map(|azimuth| distance_m / (azimuth - facing).cos().max(1e-3));
            let distance_m = distances[0].max(distances[1]);
            let screen = Screen { distance_m, slope: rise / distance_m };
            remember(&mut self.buckets[k.rem_euclid(BUCKETS as i64) as usize], screen);
        }
    }

    /// Whether a thing that stands on the ground is certainly out of sight.
    pub(super) fn hides(&self, pillar: &Pillar) -> bool {
        let offset = pillar.middle - self.eye.truncate();
        let distance = offset.length();
        let [near, far] = [distance - pillar.radius_m, distance + pillar.radius_m];
        let half = (pillar.radius_m / distance).asin();
        self.hides_span(offset.to_angle(), [-half, half], [near, far], pillar.top_m)
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
        self.hides_span(middle.to_angle(), span, [near, far], top_m)
    }

    /// Of what is seen between two turns from an azimuth, between two distances, no higher than `top_m`.
    fn hides_span(&self, azimuth: f32, [right, left]: [f32; 2], [near, far]: [f32; 2], top_m: f32) -> bool {
        if near < 0.1 {
            return false;
        }
        let rise = top_m - self.eye.z;
        let slope = rise / if rise > 0.0 { near } else { far };
        let bucket_of = |turn: f32| ((azimuth + turn + PI) / BUCKET_RAD).floor() as i64;
        (bucket_of(right)..=bucket_of(left)).all(|k| {
            let bucket = &self.buckets[k.rem_euclid(BUCKETS as i64) as usize];
            bucket.iter().any(|screen| screen.distance_m < near && screen.slope > slope)
        })
    }
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
        let horizon = Horizon::new(Vec3::new(0.0, 0.0, 1.5), &block());
        assert!(horizon.hides(&pillar(0.0, 40.0, 3.0)));
        assert!(horizon.hides(&pillar(-12.0, 36.0, 3.0)));
        // In front, beside, on the other side, and above the roof's edge.
        assert!(!horizon.hides(&pillar(0.0, 15.0, 3.0)));
        assert!(!horizon.hides(&pillar(24.0, 40.0, 3.0)));
        assert!(!horizon.hides(&pillar(0.0, -40.0, 3.0)));
        assert!(!horizon.hides(&pillar(0.0, 40.0, 16.0)));
    }

    #[test]
    fn an_eye_above_the_roof_sees_over_it() {
        let horizon = Horizon::new(Vec3::new(0.0, 0.0, 12.0), &block());
        assert!(!horizon.hides(&pillar(0.0, 40.0, 3.0)));
    }

    /// Against sight lines: what is hidden has no free line to any point of its upper rim.
    #[test]
    fn never_hides_what_a_line_of_sight_reaches() {
        let walls = block();
        let (mut hidden, mut hidden_boxes) = (0, 0);
        for k in 0..400 {
            let eye = Vec3::new(-30.0 + 0.15 * k as f32, -4.0 + 0.05 * k as f32, 1.4);
            let horizon = Horizon::new(eye, &walls);
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
        assert!(hidden > 1000 && hidden_boxes > 500, "{hidden} {hidden_boxes}");
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
