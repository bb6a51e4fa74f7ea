//! Fronts of buildings: choice of the front side, doors, gates, name boards, awnings.

use super::super::lanes::LaneBoxIndex;
use super::super::mesh::{Finish, Mesh, Surface};
use super::super::surroundings::Surroundings;
use super::super::{lettering, special};
use super::side::Facade;
use super::storeys_up_to;
use super::style::{Style, TRIM, has, wall};
use glam::{Vec2, Vec3};

/// The front: the side nearest to a road, wide sides before narrow ones.
pub(super) fn front_of(
    sides: &[Facade],
    open: &[usize],
    lanes: &LaneBoxIndex<'_>,
    stated_rad: Option<f64>,
) -> usize {
    let less = |worth: &dyn Fn(&Facade) -> f32| {
        open.iter().copied().min_by(|&a, &b| worth(&sides[a]).total_cmp(&worth(&sides[b]))).unwrap_or(0)
    };
    if let Some(angle) = stated_rad {
        let wanted = Vec2::from_angle(angle as f32);
        return less(&|side| -side.outward().dot(wanted) - 0.02 * side.width().min(20.0));
    }
    less(&|side| {
        let at = side.at(0.5, 0.0, 1.0).truncate().as_dvec2();
        let away = lanes.nearest(at).map_or(f64::INFINITY, |nearest| nearest.distance(at));
        away as f32 - side.width().min(12.0)
    })
}

/// The bay of the door: the middle one of public buildings, else the first that is accessible, through a hedge if need be.
pub(super) fn door_bay(front: &Facade, style: &Style, around: &Surroundings<'_>) -> f32 {
    let count = front.bays();
    if style.sign.is_some() {
        return (count / 2.0).floor();
    }
    // On the step and on the way to it.
    let is_clear = |bay: f32, bars: &dyn Fn(Vec2) -> bool| {
        let before = |out: f32| front.at((bay + 0.5) / count, 0.0, out).truncate();
        [0.7, 1.6, 2.6].into_iter().all(|out| !bars(before(out)))
    };
    let first = |bars: &dyn Fn(Vec2) -> bool| {
        (0..count as u32).map(|bay| bay as f32).find(|&bay| is_clear(bay, bars))
    };
    first(&|at| around.bars_the_way(at)).or_else(|| first(&|at| around.has_post(at))).unwrap_or(0.0)
}

/// Share of the front without ground-floor windows, for gates or the door in its bay.
pub(super) fn windowless(front: &Facade, style: &Style, bay: f32) -> [f32; 2] {
    let count = front.bays();
    if style.gates.is_some() { [0.0, 1.0] } else { [bay / count, (bay + 1.0) / count] }
}

/// Height of a door with its fanlight.
fn door_height(storey: f32) -> f32 {
    2.66_f32.min(storey - 0.14)
}

/// A house door, or two glazed shop doors, in their bay.
fn door(mesh: &mut Mesh, (front, bay): (&Facade, f32), style: &Style, [storey, eaves]: [f32; 2]) {
    let width = front.width();
    let middle = (bay + 0.5) / front.bays() * width;
    if style.ground.surface.is_shopfront() {
        let frame = style.ground.shaded(0.55);
        let frame = Finish { surface: Surface::Plain, ..frame };
        // Under the fascia.
        let high = 2.52_f32.min(0.8 * storey);
        front.slab(mesh, [middle, 1.9], [0.02, high], 0.06, frame);
        for (leaf, across) in [(-0.45, [0.10, 0.35]), (0.45, [0.62, 0.87])] {
            // Interior behind the glass.
            let behind = [Vec2::new(across[0], 0.16), Vec2::new(across[1], 0.64)];
            front.picture(mesh, [middle + leaf, 0.76], [0.22, high - 0.12], (0.068, behind), style.ground);
            front.slab(mesh, [middle + 0.16 * leaf, 0.04], [0.95, 1.35], 0.11, TRIM);
        }
        front.slab(mesh, [middle, 2.1], [0.02, 0.13], 0.4, TRIM.shaded(0.9));
        return;
    }
    let high = door_height(storey);
    front.slab(mesh, [middle, 1.56], [0.02, high + 0.08], 0.05, TRIM);
    front.panel(mesh, [middle, 1.34], [0.16, high], 0.065, wall(Surface::Door, [255, 255, 255]));
    // The leaf in its own colour, before that of the frame: its part of the texture.
    let leaf = [Vec2::new(0.10, 0.0), Vec2::new(0.90, 0.80)];
    front.picture(mesh, [middle, 1.34 * 0.8], [0.16, 0.16 + 0.8 * (high - 0.16)], (0.072, leaf), style.door);
    front.slab(mesh, [middle, 1.9], [0.02, 0.16], 0.6, TRIM.shaded(0.9));
    if style.sign.is_none() && !style.gabled && eaves > 8.0 {
        front.slab(mesh, [middle, 2.2], [high + 0.18, high + 0.32], 0.95, TRIM.shaded(0.95));
    }
    if style.sign.is_none() && style.gabled && style.has_porch && eaves > high + 0.75 {
        porch(mesh, front, middle, high + 0.16, style.tiles);
    }
}

/// A small roof over a door on two brackets.
fn porch(mesh: &mut Mesh, front: &Facade, middle: f32, low: f32, tiles: Finish) {
    const HALF_M: f32 = 0.98;
    const OUT_M: f32 = 0.78;
    const RISE_M: f32 = 0.42;
    let at = |x: f32, z: f32, out: f32| front.at((middle + x) / front.width(), low + z, out);
    let eaves = [at(-HALF_M, 0.06, OUT_M), at(HALF_M, 0.06, OUT_M)];
    let top = [at(HALF_M, RISE_M, 0.0), at(-HALF_M, RISE_M, 0.0)];
    mesh.plate(&[eaves[0], eaves[1], top[0], top[1]], tiles, 2.0);
    let under =
        [at(-HALF_M, 0.0, 0.0), at(HALF_M, 0.0, 0.0), at(HALF_M, 0.0, OUT_M), at(-HALF_M, 0.0, OUT_M)];
    mesh.plate(&under, TRIM.shaded(0.7), 2.0);
    mesh.plate(&[under[3], under[2], eaves[1], eaves[0]], TRIM, 2.0);
    mesh.plate(&[under[0], under[3], eaves[0], top[1]], TRIM, 2.0);
    mesh.plate(&[under[2], under[1], top[0], eaves[1]], TRIM, 2.0);
    for x in [-HALF_M + 0.12, HALF_M - 0.12] {
        front.slab(mesh, [middle + x, 0.09], [low - 0.42, low], 0.12, TRIM.shaded(0.9));
        front.slab(mesh, [middle + x, 0.08], [low - 0.10, low], 0.60, TRIM.shaded(0.9));
    }
}

pub(super) fn entrance(mesh: &mut Mesh, (front, bay): (&Facade, f32), style: &Style, name: &str, eaves: f32) {
    let width = front.width();
    let storey = eaves / storeys_up_to(eaves);
    if let Some(colour) = style.gates {
        let count = ((width - 0.6) / 4.1).floor().max(1.0);
        for k in 0..count as u32 {
            let middle = width * (k as f32 + 0.5) / count;
            let high = (storey * 1.15).clamp(2.6, eaves - 0.6);
            front.slab(mesh, [middle, 3.8], [0.02, high + 0.2], 0.06, TRIM);
            front.panel(mesh, [middle, 3.4], [0.05, high], 0.075, wall(Surface::Gate, colour));
        }
    } else {
        door(mesh, (front, bay), style, [storey, eaves]);
    }
    let Some(board) = style.sign else { return };
    let text = name.trim().to_uppercase();
    if text.is_empty() {
        return;
    }
    let is_shop = style.ground.surface.is_shopfront();
    // Height of the board between the door and the windows above.
    let room = [door_height(storey) + 0.12, storey * 1.21];
    let most = if style.gates.is_some() || is_shop {
        0.62
    } else {
        lettering::letters_on(room[1] - room[0]).min(0.62)
    };
    let letter = (0.86 * width / lettering::width_of(&text, 1.0)).min(most);
    let board_width = lettering::width_of(&text, letter) + 0.7;
    let half = lettering::half_board(letter);
    let z = if style.gates.is_some() {
        // With gates, on the parapet or under the roof: there is no space between gates and windows.
        if style.gabled { eaves - half - 0.05 } else { eaves + 0.1 }
    } else if is_shop {
        storey * 0.93
    } else {
        ((room[0] + room[1]) / 2.0).min(eaves - half - 0.05)
    };
    let (z, out) = special::board_on_portico(name, eaves).unwrap_or((z, 0.14));
    front.slab(mesh, [width / 2.0, board_width], [z - half, z + half], out, board);
    let face = front.at(0.5, z, out + 0.005);
    lettering::write(mesh, &text, face, front.across().extend(0.0), [board_width, letter], board);
    if is_shop && has(name, &["cafe", "bakery", "flower", "hotel"]) {
        awning(mesh, front, z - half, board);
    }
}

/// An awning over shop windows in the colour of the board: it slopes from the wall with a hanging edge.
fn awning(mesh: &mut Mesh, front: &Facade, z: f32, board: Finish) {
    const HANGS_M: f32 = 0.24;
    let striped = Finish { surface: Surface::Awning, ..board.shaded(1.1) };
    let stripes = (front.width() / 2.4).round().max(1.0);
    let (a, b) = (front.at(0.04, z, 0.1), front.at(0.96, z, 0.1));
    let drop = front.outward().extend(0.0) * 1.3 - Vec3::Z * 0.45;
    let hem = drop - Vec3::Z * HANGS_M;
    let mut both_sides = |corners: [Vec3; 4], v: [f32; 2]| {
        let uvs = [(0.0, v[0]), (stripes, v[0]), (stripes, v[1]), (0.0, v[1])].map(Vec2::from);
        mesh.face(&corners, &uvs, striped);
        let [c, d, e, f] = corners;
        let behind = [uvs[3], uvs[2], uvs[1], uvs[0]];
        mesh.shaded_face(&[f, e, d, c], &behind, striped.shaded(0.6), &[90, 90, 170, 170]);
    };
    both_sides([a + drop, b + drop, b, a], [0.0, 1.0]);
    both_sides([a + hem, b + hem, b + drop, a + drop], [0.0, 0.0]);
    let cheek = Finish { surface: Surface::Plain, ..striped.shaded(0.85) };
    for end in [a, b] {
        let mut ring = [end, end + Vec3::Z * hem.z, end + hem, end + drop];
        mesh.plate(&ring, cheek, 1.0);
        ring.reverse();
        mesh.plate(&ring, cheek, 1.0);
    }
}
