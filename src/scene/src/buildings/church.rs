//! A church: a nave without storeys under a steep roof, lancet windows between buttresses, and a tower with the portal.

use super::super::doorways::Doorway;
use super::super::mesh::{Finish, Mesh, Surface};
use super::side::Facade;
use super::style::wall;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_3, SQRT_2};

/// Height of a nave as a share of that of the drawing, which counts the tower, and of its roof as a share of its width.
pub(super) const NAVE: f32 = 0.80;
pub(super) const STEEP: f32 = 0.78;
/// Where the tower is between the first corner and the middle, its half width, and its height over that of the nave.
const TOWER_AT: f32 = 0.35;
const TOWER_HALF_M: f32 = 1.6;
const TOWER_OVER_M: f32 = 2.6;
/// Segments of each half of an arch.
const ARCH: usize = 3;
/// How far frames stand out of the wall and panes lie in it.
const FRAME_M: f32 = 0.11;
const FRAME_WIDE_M: f32 = 0.13;

const STONE: Finish = wall(Surface::Concrete, [214, 204, 182]);
const PANE: Finish = wall(Surface::Glass, [58, 66, 88]);
const LEAD: Finish = wall(Surface::Metal, [52, 54, 58]);
const LOUVRE: Finish = wall(Surface::Wood, [92, 84, 74]);
const OAK: Finish = wall(Surface::Wood, [116, 78, 50]);

pub(super) fn is_one(name: &str) -> bool {
    name.contains("chapel")
}

/// An opening with a pointed arch: middle along the facade, foot, width, height up to where the arch begins.
#[derive(Clone, Copy)]
struct Lancet {
    middle_m: f32,
    foot_m: f32,
    wide_m: f32,
    tall_m: f32,
}

impl Lancet {
    /// Its outline, wider by a margin, from the lower left corner counter-clockwise: along the facade and up. The arch is an
    /// equilateral one.
    fn outline(&self, margin_m: f32) -> Vec<Vec2> {
        let half = self.wide_m / 2.0;
        let spring = self.foot_m + self.tall_m;
        let mut points = vec![
            Vec2::new(-half - margin_m, self.foot_m - margin_m),
            Vec2::new(half + margin_m, self.foot_m - margin_m),
        ];
        let radius = self.wide_m + margin_m;
        for (side, order) in [(1.0, false), (-1.0, true)] {
            // The apex belongs to both halves.
            for k in 0..ARCH + usize::from(!order) {
                let step = if order { ARCH - 1 - k } else { k };
                let (up, out) = (FRAC_PI_3 * step as f32 / ARCH as f32).sin_cos();
                let x = side * (radius * out - half);
                points.push(Vec2::new(if step == ARCH { 0.0 } else { x }, spring + radius * up));
            }
        }
        points
    }

    fn on(&self, side: &Facade, at: Vec2, out: f32) -> Vec3 {
        side.at((self.middle_m + at.x) / side.width().max(1e-3), at.y, out)
    }

    /// Draws what fills it into one mesh, its frame into another.
    fn draw(&self, [mesh, trim]: [&mut Mesh; 2], side: &Facade, fill: Finish) {
        let [inner, outer] = [self.outline(0.0), self.outline(FRAME_WIDE_M)];
        let pane: Vec<Vec3> = inner.iter().map(|&at| self.on(side, at, 0.02)).collect();
        mesh.plate(&pane, fill, 1.6);
        let frame = STONE.shaded(0.86);
        for k in 0..inner.len() {
            let next = (k + 1) % inner.len();
            let at = |ring: &[Vec2], k: usize, out: f32| self.on(side, ring[k], out);
            let face = [
                at(&outer, k, FRAME_M),
                at(&outer, next, FRAME_M),
                at(&inner, next, FRAME_M),
                at(&inner, k, FRAME_M),
            ];
            let reveal = [
                at(&inner, k, FRAME_M),
                at(&inner, next, FRAME_M),
                at(&inner, next, 0.0),
                at(&inner, k, 0.0),
            ];
            let edge = [
                at(&outer, next, FRAME_M),
                at(&outer, k, FRAME_M),
                at(&outer, k, 0.0),
                at(&outer, next, 0.0),
            ];
            mesh.plate(&face, frame, 2.0);
            trim.plate(&reveal, frame.shaded(0.6), 2.0);
            trim.plate(&edge, frame.shaded(0.9), 2.0);
        }
    }

    /// Bars over its pane: an upright one and some across.
    fn bars(&self, trim: &mut Mesh, side: &Facade, across: u32) {
        let top = self.foot_m + self.tall_m + 0.8 * self.wide_m;
        side.slab(trim, [self.middle_m, 0.05], [self.foot_m, top], 0.05, LEAD);
        for k in 1..=across {
            let z = self.foot_m + self.tall_m * k as f32 / across as f32;
            side.slab(trim, [self.middle_m, self.wide_m], [z, z + 0.04], 0.045, LEAD);
        }
    }
}

/// Everything but walls, roof and spire, and its door. `trim` gets what is too small to be seen from afar.
pub(super) fn church(
    [mesh, trim]: [&mut Mesh; 2],
    sides: &[Facade],
    ring: &[Vec2],
    [eaves, height]: [f32; 2],
) -> Doorway {
    for (number, side) in sides.iter().enumerate() {
        let is_long = side.width() > sides[(number + 1) % sides.len()].width();
        if is_long {
            nave([&mut *mesh, &mut *trim], side, number == 0, eaves);
        } else if number != sides.len() - 1 {
            // A large window in the gable.
            let large =
                Lancet { middle_m: side.width() / 2.0, foot_m: 2.6, wide_m: 2.2, tall_m: 0.42 * eaves };
            large.draw([&mut *mesh, &mut *trim], side, PANE);
            large.bars(trim, side, 4);
        }
    }
    tower([mesh, trim], ring, height)
}

/// Windows and buttresses of a long wall, of which the tower may hide the first part.
fn nave([mesh, trim]: [&mut Mesh; 2], side: &Facade, has_tower: bool, eaves: f32) {
    const BAY_M: f32 = 2.3;
    let from = if has_tower { 2.0 * TOWER_HALF_M + 0.4 } else { 0.3 };
    let length = side.width() - from - 0.3;
    let bays = (length / BAY_M).floor().max(1.0);
    let at = |bay: f32| from + length * bay / bays;
    for k in 0..bays as u32 {
        let window = Lancet { middle_m: at(k as f32 + 0.5), foot_m: 1.9, wide_m: 1.0, tall_m: 0.48 * eaves };
        window.draw([&mut *mesh, &mut *trim], side, PANE);
        window.bars(trim, side, 5);
    }
    for k in u32::from(has_tower)..=bays as u32 {
        side.slab(mesh, [at(k as f32), 0.42], [0.0, 0.46 * eaves], 0.62, STONE.shaded(0.95));
        side.slab(mesh, [at(k as f32), 0.42], [0.0, 0.80 * eaves], 0.34, STONE.shaded(0.95));
    }
}

/// Louvres, courses and portal of the tower, which stands on the first corner.
fn tower([mesh, trim]: [&mut Mesh; 2], ring: &[Vec2], height: f32) -> Doorway {
    let centre = ring.iter().copied().sum::<Vec2>() / ring.len() as f32;
    let foot = ring[0].lerp(centre, TOWER_AT);
    let yaw = (ring[1] - ring[0]).to_angle();
    let corner =
        |k: usize| foot + Vec2::from_angle(yaw + FRAC_PI_2 * (k as f32 + 0.5)) * (TOWER_HALF_M * SQRT_2);
    let top = height + TOWER_OVER_M;
    let mut portal_side = Facade { from: corner(2), to: corner(3) };
    for k in 0..4 {
        let side = Facade { from: corner(k), to: corner((k + 1) % 4) };
        let belfry = Lancet { middle_m: TOWER_HALF_M, foot_m: top - 2.9, wide_m: 1.0, tall_m: 1.3 };
        belfry.draw([&mut *mesh, &mut *trim], &side, LOUVRE.shaded(0.5));
        for slat in 0..6 {
            let z = belfry.foot_m + 0.12 + 0.24 * slat as f32;
            side.slab(trim, [TOWER_HALF_M, 0.98], [z, z + 0.09], 0.06, LOUVRE);
        }
        for z in [0.36 * top, 0.72 * top, top - 0.22] {
            side.slab(mesh, [TOWER_HALF_M, 2.0 * TOWER_HALF_M + 0.2], [z, z + 0.16], 0.1, STONE.shaded(0.9));
        }
        if k == 2 {
            portal_side = side;
        }
    }
    let portal = Lancet { middle_m: TOWER_HALF_M, foot_m: 0.12, wide_m: 1.5, tall_m: 1.75 };
    portal.draw([&mut *mesh, &mut *trim], &portal_side, OAK);
    portal_side.slab(trim, [TOWER_HALF_M, 0.03], [0.14, 3.0], 0.035, LEAD);
    portal_side.slab(mesh, [TOWER_HALF_M, 2.2], [0.02, 0.14], 0.6, STONE.shaded(0.85));
    let light = Lancet { middle_m: TOWER_HALF_M, foot_m: 0.44 * top, wide_m: 0.7, tall_m: 1.5 };
    light.draw([mesh, trim], &portal_side, PANE);
    Doorway { at: portal_side.at(0.5, 0.0, 0.0).truncate(), out: portal_side.outward() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lancet_is_a_convex_outline_that_ends_in_a_point_over_its_middle() {
        let window = Lancet { middle_m: 0.0, foot_m: 1.0, wide_m: 1.0, tall_m: 2.0 };
        let outline = window.outline(0.0);
        let top = outline.iter().copied().max_by(|a, b| a.y.total_cmp(&b.y)).unwrap();
        assert!(top.x.abs() < 1e-5 && (top.y - 3.0 - 0.75_f32.sqrt()).abs() < 1e-4, "{top}");
        for k in 0..outline.len() {
            let [a, b, c] = [0, 1, 2].map(|more| outline[(k + more) % outline.len()]);
            assert!((b - a).perp_dot(c - b) > 1e-4, "{outline:?}");
        }
    }
}
