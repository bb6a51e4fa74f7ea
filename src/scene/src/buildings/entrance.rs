//! Fronts of buildings: choice of the front side, doors, gates, name boards, awnings.

use super::super::SeededScenery;
use super::super::doorways::Doorway;
use super::super::lanes::LaneBoxIndex;
use super::super::mesh::{Finish, Mesh, Surface};
use super::super::surroundings::Surroundings;
use super::super::{lettering, special};
use super::side::Facade;
use super::storeys_up_to;
use super::style::{DARK, Style, TRIM, has, wall};
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
    if style.gates.is_some() { [0.0, 1.0] } else { bay_part(front, bay) }
}

/// A bay, in shares of the width.
pub(super) fn bay_part(side: &Facade, bay: f32) -> [f32; 2] {
    [bay / side.bays(), (bay + 1.0) / side.bays()]
}

/// The side of a back door and its bay: opposite the front, where people can go. Shops have none.
pub(super) fn back_door(
    sides: &[Facade],
    open: &[usize],
    front: usize,
    style: &Style,
    place: &SeededScenery<'_>,
    around: &Surroundings<'_>,
) -> Option<(usize, f32)> {
    if style.ground.surface.is_shopfront() {
        return None;
    }
    let ahead = sides[front].outward();
    let facing = |k: usize| sides[k].outward().dot(ahead);
    let behind = open.iter().copied().filter(|&k| facing(k) < -0.5);
    let side = behind.min_by(|&a, &b| facing(a).total_cmp(&facing(b)))?;
    let count = sides[side].bays() as u32;
    let first = (place.hash_to_unit(87) * count as f32) as u32;
    let is_clear = |bay: f32| {
        let before = |out: f32| sides[side].at((bay + 0.5) / count as f32, 0.0, out).truncate();
        [0.7, 1.4].into_iter().all(|out| !around.bars_the_way(before(out)))
    };
    let mut bays = (0..count).map(|k| ((first + k) % count) as f32);
    bays.find(|&bay| is_clear(bay)).map(|bay| (side, bay))
}

/// A plain door, and the way to it.
pub(super) fn draw_back_door(mesh: &mut Mesh, (side, bay): (&Facade, f32), style: &Style) -> Doorway {
    const HIGH_M: f32 = 2.12;
    let middle = (bay + 0.5) / side.bays() * side.width();
    let leaf = [Vec2::new(0.10, 0.0), Vec2::new(0.90, 0.80)];
    side.slab(mesh, [middle, 1.14], [0.02, HIGH_M + 0.10], 0.05, TRIM);
    side.picture(mesh, [middle, 0.96], [0.14, HIGH_M], (0.072, leaf), style.door.shaded(0.85));
    side.slab(mesh, [middle, 1.3], [0.02, 0.14], 0.45, TRIM.shaded(0.85));
    Doorway { at: side.at((bay + 0.5) / side.bays(), 0.0, 0.0).truncate(), out: side.outward() }
}

/// Width of a door with its frame.
const DOOR_M: f32 = 1.20;

/// Height of a door with its fanlight.
fn door_height(storey: f32) -> f32 {
    2.56_f32.min(storey - 0.14)
}

/// A house door, or two glazed shop doors, in their bay.
fn door(mesh: &mut Mesh, (front, bay): (&Facade, f32), style: &Style, [storey, eaves]: [f32; 2]) {
    let width = front.width();
    let middle = (bay + 0.5) / front.bays() * width;
    if style.ground.surface.is_shopfront() || style.ground.surface == Surface::Glazing {
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
    front.slab(mesh, [middle, 1.38], [0.02, high + 0.08], 0.05, TRIM);
    front.panel(mesh, [middle, DOOR_M], [0.16, high], 0.065, wall(Surface::Door, [255, 255, 255]));
    // The leaf in its own colour, before that of the frame: its part of the texture.
    let leaf = [Vec2::new(0.10, 0.0), Vec2::new(0.90, 0.80)];
    front.picture(
        mesh,
        [middle, DOOR_M * 0.8],
        [0.16, 0.16 + 0.8 * (high - 0.16)],
        (0.072, leaf),
        style.door,
    );
    front.slab(mesh, [middle, 1.9], [0.02, 0.16], 0.6, TRIM.shaded(0.9));
    if style.sign.is_none() && !style.gabled && eaves > 8.0 {
        front.slab(mesh, [middle, 2.2], [high + 0.18, high + 0.32], 0.95, DARK);
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

/// Draws door or gates, the name, and an awning where nothing stands in its place.
pub(super) fn entrance(
    mesh: &mut Mesh,
    (front, bay): (&Facade, f32),
    style: &Style,
    (name, eaves): (&str, f32),
    around: &Surroundings<'_>,
) {
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
    let has_awning = is_shop && has(name, &["cafe", "bakery", "flower", "hotel"]);
    // Height of the board between the door and the windows above.
    let room = [door_height(storey) + 0.12, storey * 1.21];
    let most = if has_awning {
        0.46
    } else if style.gates.is_some() || is_shop {
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
        // Over an awning under which people walk.
        let least = if has_awning { AWNING_HEM_M + AWNING_DROP_M + AWNING_HANGS_M + half } else { 0.0 };
        (storey * 0.93).max(least)
    } else {
        ((room[0] + room[1]) / 2.0).min(eaves - half - 0.05)
    };
    let (z, out) = special::board_on_portico(name, eaves).unwrap_or((z, 0.14));
    front.slab(mesh, [width / 2.0, board_width], [z - half, z + half], out, board);
    let face = front.at(0.5, z, out + 0.005);
    lettering::write(mesh, &text, face, front.across().extend(0.0), [board_width, letter], board);
    if let Some(part) = awning_part(front, around).filter(|_| has_awning) {
        awning(mesh, &front.between(part), z - half, board);
    }
}

/// Lower edge of an awning, its slope and its hanging edge, and how far it reaches.
const AWNING_HEM_M: f32 = 2.12;
const AWNING_DROP_M: f32 = 0.34;
const AWNING_HANGS_M: f32 = 0.16;
const AWNING_OUT_M: f32 = 1.2;

/// The longest part of a front, in shares of its width, before which an awning is clear of trees, lamps and the road.
fn awning_part(front: &Facade, around: &Surroundings<'_>) -> Option<[f32; 2]> {
    const STEP_M: f32 = 0.2;
    const LEAST_M: f32 = 1.8;
    const ENDS: f32 = 0.04;
    let steps = ((1.0 - 2.0 * ENDS) * front.width() / STEP_M) as u32;
    let share = |k: u32| ENDS + (1.0 - 2.0 * ENDS) * k as f32 / steps.max(1) as f32;
    let is_clear = |k: u32| {
        let outs = [0.4, 0.8, 1.2].map(|part| part * AWNING_OUT_M);
        outs.into_iter().all(|out| !around.bars_an_awning(front.at(share(k), 0.0, out).truncate()))
    };
    let (mut longest, mut first) = ([0, 0], None);
    for k in 0..=steps {
        if !is_clear(k) {
            first = None;
            continue;
        }
        let from = *first.get_or_insert(k);
        if k - from > longest[1] - longest[0] {
            longest = [from, k];
        }
    }
    let part = longest.map(share);
    ((part[1] - part[0]) * front.width() > LEAST_M).then_some(part)
}

/// An awning over shop windows in the colour of the board: it slopes from the wall with a hanging edge.
fn awning(mesh: &mut Mesh, front: &Facade, z: f32, board: Finish) {
    let striped = Finish { surface: Surface::Awning, ..board.shaded(1.1) };
    let stripes = (front.width() / 2.4).round().max(1.0);
    let (a, b) = (front.at(0.0, z, 0.1), front.at(1.0, z, 0.1));
    let drop = front.outward().extend(0.0) * AWNING_OUT_M - Vec3::Z * AWNING_DROP_M;
    let hem = drop - Vec3::Z * AWNING_HANGS_M;
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
