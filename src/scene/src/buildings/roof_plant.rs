//! Plant on flat roofs: air handlers with fans and louvres, vents and roof lights, clear of parapets and spires.

use super::super::grounds::distance_to;
use super::super::mesh::{Finish, Mesh, Surface};
use super::super::{SeededScenery, special};
use super::style::{DARK, wall};
use city3d_roadmap::Footprint;
use glam::{Vec2, Vec3};

const CASING: Finish = wall(Surface::Metal, [150, 153, 154]);
const LIGHT: Finish = wall(Surface::Glass, [150, 164, 172]);
const CURB: Finish = wall(Surface::Plain, [176, 176, 172]);
/// Height of a slat of a louvre, from one to the next, and how far it stands out.
const SLAT_M: [f32; 3] = [0.07, 0.15, 0.012];
const FAN_M: f32 = 0.34;

/// The free part of a flat roof.
struct Roof<'a> {
    place: &'a SeededScenery<'a>,
    ring: &'a [Vec2],
    edge: Footprint,
    centre: Vec2,
    eaves: f32,
    yaw: f32,
    spire: Option<f32>,
}

impl Roof<'_> {
    /// Whether something this wide has room, with a way around it.
    fn has_room(&self, at: Vec2, reach: f32) -> bool {
        distance_to(&self.edge, at.as_dvec2()) > f64::from(reach)
            && self.spire.is_none_or(|spire| at.distance(self.centre) > reach + spire)
    }

    /// A place between the middle and a corner.
    fn towards(&self, corner: usize, share: f32) -> Vec2 {
        self.centre.lerp(self.ring[corner % self.ring.len()], share)
    }
}

/// Adds the plant of a roof; `trim` gets what is too small to be seen from afar.
pub(super) fn plant([mesh, trim]: [&mut Mesh; 2], place: &SeededScenery<'_>, ring: &[Vec2], eaves: f32) {
    let closed = ring.iter().chain(ring.first()).map(|p| p.as_dvec2());
    let roof = Roof {
        place,
        ring,
        edge: Footprint::Polyline(closed.collect()),
        centre: ring.iter().copied().sum::<Vec2>() / ring.len() as f32,
        eaves,
        yaw: (ring[1] - ring[0]).to_angle(),
        spire: special::spire_reach(&place.piece.name.to_lowercase(), ring),
    };
    let mut taken = Vec::new();
    for k in 0..3 {
        taken.extend(air_handler([&mut *mesh, &mut *trim], &roof, k));
    }
    for k in 0..5 {
        let at = roof.towards(k as usize, 0.2 + 0.6 * place.hash_to_unit(130 + k));
        let is_free = taken.iter().all(|&(other, reach): &(Vec2, f32)| at.distance(other) > reach + 0.7);
        if !is_free || !roof.has_room(at, 0.9) {
            continue;
        }
        taken.push((at, 0.7));
        if place.hash_to_unit(140 + k) < 0.4 {
            roof_light(trim, at.extend(eaves), roof.yaw);
        } else {
            vent(trim, at.extend(eaves), 0.35 + 0.4 * place.hash_to_unit(150 + k));
        }
    }
}

/// A box with louvres at its sides and fans on top; its place and how far it reaches, where there is room for it.
fn air_handler([mesh, trim]: [&mut Mesh; 2], roof: &Roof<'_>, k: u32) -> Option<(Vec2, f32)> {
    let draw = |salt: u32| roof.place.hash_to_unit(salt + k);
    let size = Vec3::new(1.0 + 1.6 * draw(40), 1.0 + draw(50), 0.7 + 0.9 * draw(60));
    let at = roof.towards(k as usize, 0.25 + 0.3 * draw(30));
    let reach = size.truncate().length() / 2.0 + 0.3;
    if draw(20) >= 0.6 || !roof.has_room(at, reach) {
        return None;
    }
    let foot = at.extend(roof.eaves);
    mesh.block(foot, size, roof.yaw, CASING);
    trim.block(foot, Vec3::new(size.x + 0.12, size.y + 0.12, 0.10), roof.yaw, DARK);
    let (ahead, left) =
        (Vec2::from_angle(roof.yaw).extend(0.0), Vec2::from_angle(roof.yaw).perp().extend(0.0));
    for side in [-1.0, 1.0] {
        louvres(
            trim,
            foot + left * (side * (size.y / 2.0 + SLAT_M[2])),
            ahead * (side * (size.x / 2.0 - 0.18)),
            size.z,
        );
    }
    let fans = if size.x > 1.7 { [-0.25, 0.25].as_slice() } else { &[0.0] };
    for &fan in fans {
        let hub = foot + ahead * (fan * size.x) + Vec3::Z * size.z;
        trim.frustum(hub, [FAN_M, FAN_M * 0.94], 0.14, 10, CASING.shaded(0.86));
        trim.frustum(hub + Vec3::Z * 0.14, [FAN_M * 0.80, FAN_M * 0.80], 0.004, 10, DARK.shaded(0.7));
        trim.frustum(hub + Vec3::Z * 0.144, [FAN_M * 0.2, FAN_M * 0.2], 0.03, 6, CASING);
    }
    Some((at, reach))
}

/// Dark slats on a side, whose middle at the foot is given with half of its width.
fn louvres(trim: &mut Mesh, foot: Vec3, half: Vec3, height: f32) {
    let [slat, step, _] = SLAT_M;
    let mut low = 0.22;
    while low + slat < height - 0.12 {
        let at = |side: f32, z: f32| foot - half * side + Vec3::Z * z;
        trim.plate(
            &[at(-1.0, low), at(1.0, low), at(1.0, low + slat), at(-1.0, low + slat)],
            DARK.shaded(0.75),
            2.0,
        );
        low += step;
    }
}

/// A pipe with a cowl.
fn vent(trim: &mut Mesh, foot: Vec3, height: f32) {
    trim.frustum(foot, [0.20, 0.13], 0.10, 8, CURB);
    trim.frustum(foot, [0.10, 0.10], height, 8, CASING);
    trim.frustum(foot + Vec3::Z * (height + 0.05), [0.17, 0.06], 0.12, 8, CASING.shaded(0.9));
}

/// A pane on a curb.
fn roof_light(trim: &mut Mesh, foot: Vec3, yaw: f32) {
    trim.block(foot, Vec3::new(1.10, 0.90, 0.26), yaw, CURB);
    trim.block(foot + Vec3::Z * 0.26, Vec3::new(0.98, 0.78, 0.07), yaw, LIGHT);
}
