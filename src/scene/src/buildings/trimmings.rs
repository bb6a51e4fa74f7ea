//! What is fixed to walls and roofs: gutters, downpipes, house numbers, flower boxes, chimney pots, aerials, roof
//! windows. From afar nobody misses it.

use super::super::foliage::limb;
use super::super::lettering;
use super::super::mesh::{Finish, Mesh, Surface};
use super::super::{LodMesh, SceneObject, SeededScenery};
use super::side::Facade;
use super::style::{DARK, Style, TRIM, wall};
use glam::{Vec2, Vec3};

/// From which error on it is not drawn: that is how thick most of it is.
const UNDRAWN_M: f32 = 0.12;
const PIPE_M: f32 = 0.042;
const GUTTER_M: f32 = 0.062;
const NUMBER_M: f32 = 0.13;

const POT: Finish = wall(Surface::Plain, [164, 96, 70]);
const ZINC: Finish = wall(Surface::Metal, [142, 146, 150]);
const NUMBER: Finish = wall(Surface::Plain, [158, 152, 136]);
const BOX: Finish = wall(Surface::Wood, [112, 84, 62]);
const FLOWERS: [[u8; 3]; 4] = [[230, 150, 150], [236, 214, 160], [214, 170, 214], [240, 236, 230]];
const PANE: Finish = wall(Surface::Glass, [120, 132, 146]);

/// An object of trimmings.
pub(in super::super) fn object(trim: Mesh) -> SceneObject {
    let mut object = SceneObject::of_one_level(trim);
    object.levels.push(LodMesh { mesh: Mesh::default(), error_m: UNDRAWN_M });
    object
}

/// What trimmings are fixed to.
pub(super) struct House<'a> {
    pub(super) place: &'a SeededScenery<'a>,
    pub(super) sides: &'a [Facade],
    /// Numbers of the sides that no other building blocks.
    pub(super) open: &'a [usize],
    /// Number of the side with the door, and its bay there.
    pub(super) front: usize,
    pub(super) bay: f32,
    pub(super) style: &'a Style,
    pub(super) eaves: f32,
    pub(super) storey: f32,
    /// Height of eaves that hang over a wall, by side.
    pub(super) overhung: &'a [Option<f32>],
}

/// All trimmings of the walls.
pub(super) fn of_walls(mesh: &mut Mesh, house: &House<'_>) {
    pipes(mesh, house);
    let is_dwelling = house.style.sign.is_none() && house.style.gates.is_none();
    if is_dwelling {
        number(mesh, house);
        if house.place.hash_to_unit(80) < 0.5 {
            flower_boxes(mesh, house);
        }
    }
}

/// Gutters under overhanging eaves, and pipes from there or from the parapet to the ground.
fn pipes(mesh: &mut Mesh, house: &House<'_>) {
    const HANGS_OUT_M: f32 = 0.46;
    const FLAT_LEAST_M: f32 = 6.0;
    let finish = if house.place.hash_to_unit(81) < 0.5 { ZINC } else { DARK };
    for (k, side) in house.sides.iter().enumerate() {
        let width = side.width();
        let at = |x: f32, z: f32, out: f32| side.at(x / width.max(1e-3), z, out);
        let is_open = house.open.contains(&k);
        if let Some(low) = house.overhung[k] {
            let z = low + 0.05;
            let ends = [at(-0.4, z, HANGS_OUT_M), at(width + 0.4, z, HANGS_OUT_M)];
            limb(mesh, &ends.map(|end| (end, GUTTER_M)), 5, finish);
            if is_open {
                let line = [at(0.3, z, HANGS_OUT_M), at(0.3, z - 0.45, 0.07), at(0.3, 0.1, 0.07)];
                limb(mesh, &line.map(|at| (at, PIPE_M)), 5, finish);
            }
        } else if is_open && house.overhung.iter().all(Option::is_none) && width > FLAT_LEAST_M {
            let top = house.eaves - 0.34;
            let line = [at(width - 0.14, top, 0.08), at(width - 0.14, 0.1, 0.08)];
            limb(mesh, &line.map(|at| (at, PIPE_M)), 5, finish);
            side.slab(mesh, [width - 0.14, 0.24], [top, top + 0.24], 0.2, finish);
        }
    }
}

/// The number of the house beside its door.
fn number(mesh: &mut Mesh, house: &House<'_>) {
    let side = &house.sides[house.front];
    let middle = (house.bay + 0.5) / side.bays() * side.width();
    let x = if middle + 1.35 < side.width() { middle + 1.08 } else { middle - 1.08 };
    if x < 0.25 {
        return;
    }
    let text = (1 + house.place.seed % 97).to_string();
    let width = lettering::width_of(&text, NUMBER_M) + 0.10;
    let half = lettering::half_board(NUMBER_M);
    side.slab(mesh, [x, width], [1.70 - half, 1.70 + half], 0.02, NUMBER);
    let face = side.at(x / side.width(), 1.70, 0.024);
    lettering::write(mesh, &text, face, side.across().extend(0.0), [width, NUMBER_M], NUMBER);
}

/// Height of the sill of a window over the foot of its storey, as a share of it.
fn sill_of(surface: Surface) -> Option<f32> {
    match surface {
        Surface::Windows => Some(0.262),
        Surface::Sash => Some(0.240),
        Surface::Shutters => Some(0.262),
        _ => None,
    }
}

/// Boxes of flowers before some windows of the front.
fn flower_boxes(mesh: &mut Mesh, house: &House<'_>) {
    let side = &house.sides[house.front];
    let bays = side.bays();
    let bay_m = side.width() / bays;
    let storeys = (house.eaves / house.storey).round().clamp(1.0, 3.0) as u32;
    for storey in 0..storeys {
        let finish = if storey == 0 { house.style.ground } else { house.style.upper };
        let Some(sill) = sill_of(finish.surface) else { continue };
        let z = (storey as f32 + sill) * house.storey;
        for bay in 0..bays as u32 {
            let draw = |salt: u32| house.place.hash_to_unit(90 + 16 * salt + 4 * storey + bay);
            if (storey == 0 && bay as f32 == house.bay) || draw(0) < 0.35 {
                continue;
            }
            let middle = (bay as f32 + 0.5) * bay_m;
            let colour = FLOWERS[(draw(1) * FLOWERS.len() as f32) as usize % FLOWERS.len()];
            side.slab(mesh, [middle, 0.40 * bay_m], [z, z + 0.17], 0.20, BOX);
            let flowers = wall(Surface::Flowers, colour);
            side.slab(mesh, [middle, 0.37 * bay_m], [z + 0.16, z + 0.31], 0.19, flowers);
        }
    }
}

/// Pots on a chimney, whose top is here, and for some an aerial.
pub(super) fn on_chimney(mesh: &mut Mesh, place: &SeededScenery<'_>, top: Vec3, along: Vec2) {
    let along = along.normalize_or(Vec2::X).extend(0.0);
    for side in [-0.17, 0.17] {
        mesh.frustum(top + along * side, [0.11, 0.085], 0.30, 6, POT);
    }
    if place.hash_to_unit(82) < 0.45 {
        let mast = top + along * 0.30;
        limb(mesh, &[(mast - Vec3::Z * 0.4, 0.016), (mast + Vec3::Z * 1.3, 0.013)], 3, ZINC);
        let boom = [-0.45, 0.45].map(|x| mast + along * x + Vec3::Z * 1.22);
        limb(mesh, &boom.map(|end| (end, 0.012)), 3, ZINC);
        let across = Vec3::Z.cross(along);
        for k in 0..5_u8 {
            let middle = boom[0].lerp(boom[1], f32::from(k) / 4.0);
            let half = across * (0.30 - 0.04 * f32::from(k));
            limb(mesh, &[(middle - half, 0.008), (middle + half, 0.008)], 3, ZINC);
        }
    }
}

/// Windows in a slope of a roof, whose corners are at the left and the right eaves, and at the right and the left end of
/// the ridge.
pub(super) fn roof_windows(mesh: &mut Mesh, place: &SeededScenery<'_>, slope: [Vec3; 4], salt: u32) {
    const HALF_M: [f32; 2] = [0.40, 0.55];
    let length = slope[0].distance(slope[1]);
    if place.hash_to_unit(83 + salt) > 0.55 || length < 5.0 {
        return;
    }
    let across = (slope[1] - slope[0]).normalize_or(Vec3::X);
    let up = (slope[3] - slope[0]).normalize_or(Vec3::Z);
    let out = across.cross(up);
    let run = slope[0].distance(slope[3]);
    let count = if length > 9.0 { 2 } else { 1 };
    for k in 0..count {
        let share = (k as f32 + 0.35 + 0.3 * place.hash_to_unit(85 + salt)) / count as f32;
        let middle = slope[0] + across * (share * length) + up * (0.52 * run);
        for (grow, lift, finish) in [(0.07, 0.05, DARK), (0.0, 0.06, PANE)] {
            let at = |x: f32, y: f32| {
                middle + across * (x * (HALF_M[0] + grow)) + up * (y * (HALF_M[1] + grow)) + out * lift
            };
            mesh.plate(&[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)], finish, 2.0);
        }
        // The frame stands on the tiles.
        let edge = |x: f32, y: f32, lift: f32| {
            middle + across * (x * (HALF_M[0] + 0.07)) + up * (y * (HALF_M[1] + 0.07)) + out * lift
        };
        let ring = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        for k in 0..4 {
            let [(ax, ay), (bx, by)] = [ring[k], ring[(k + 1) % 4]];
            mesh.plate(
                &[edge(ax, ay, 0.0), edge(bx, by, 0.0), edge(bx, by, 0.05), edge(ax, ay, 0.05)],
                DARK,
                2.0,
            );
        }
    }
}

/// Depth of a bay window, and its half widths at the wall and in front, in bays.
const BAY_OUT_M: f32 = 0.44;
const BAY_HALF: [f32; 2] = [0.36, 0.25];
/// Half of the part of a bay's pattern that its slanted sides show: the window without the wall beside it.
const SIDE_HALF: f32 = 0.22;

/// A bay window on the ground floor of some houses, in the bay farthest from the door; part of the house at all distances.
pub(super) fn bay_window(mesh: &mut Mesh, house: &House<'_>, is_clear: impl Fn(Vec2) -> bool) {
    let side = &house.sides[house.front];
    let (bays, style) = (side.bays(), house.style);
    let is_apt = matches!(style.ground.surface, Surface::Windows | Surface::Sash);
    let is_dwelling = style.sign.is_none() && style.gates.is_none() && style.gabled;
    if !is_apt || !is_dwelling || bays < 2.0 || house.place.hash_to_unit(84) < 0.4 {
        return;
    }
    let bay = if house.bay > (bays - 1.0) / 2.0 { 0.0 } else { bays - 1.0 };
    let share = |across: f32| (bay + 0.5 + across) / bays;
    if bay == house.bay || !is_clear(side.at(share(0.0), 0.0, 1.1).truncate()) {
        return;
    }
    let [wide, narrow] = BAY_HALF;
    let top = 0.93 * house.storey;
    let foot = super::FOOT_M;
    let plan = [(-wide, 0.0), (-narrow, BAY_OUT_M), (narrow, BAY_OUT_M), (wide, 0.0)];
    let at = |k: usize, z: f32| side.at(share(plan[k].0), z, plan[k].1);
    let up = Vec2::new(0.0, top / house.storey);
    let u = |across: f32| Vec2::new(bay + 0.5 + across, 0.0);
    let front = [at(1, foot), at(2, foot), at(2, top), at(1, top)];
    let uvs = [u(-narrow), u(narrow), u(narrow) + up, u(-narrow) + up];
    mesh.shaded_face(&front, &uvs, style.ground, &[140, 140, 220, 220]);
    // Narrow windows of the same kind in the slanted sides.
    for [a, b] in [[0, 1], [2, 3]] {
        let uvs = [u(-SIDE_HALF), u(SIDE_HALF), u(SIDE_HALF) + up, u(-SIDE_HALF) + up];
        let corners = [at(a, foot), at(b, foot), at(b, top), at(a, top)];
        mesh.shaded_face(&corners, &uvs, style.ground, &[130, 130, 210, 210]);
    }
    // A lean-to roof, which juts out.
    let eave = |k: usize| {
        let jut = if plan[k].1 > 0.0 { 0.08 } else { 0.0 };
        side.at(share(plan[k].0 * 1.12), top, plan[k].1 + jut)
    };
    let ridge = |k: usize| side.at(share(plan[k].0.signum() * narrow), top + 0.42, 0.0);
    mesh.plate(&[eave(1), eave(2), ridge(2), ridge(1)], style.tiles, 2.0);
    mesh.plate(&[eave(0), eave(1), ridge(1)], style.tiles, 2.0);
    mesh.plate(&[eave(2), eave(3), ridge(2)], style.tiles, 2.0);
    mesh.plate(&[eave(0), eave(3), eave(2), eave(1)], TRIM.shaded(0.7), 2.0);
}
