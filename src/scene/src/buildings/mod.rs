//! Procedural buildings from footprints: storeys of windows, doors, signs, flat and gabled roofs, details by
//! name.

mod church;
mod entrance;
mod roof;
mod roof_plant;
mod side;
mod style;
mod trimmings;

pub(super) use style::DARK;
pub(super) use trimmings::object as trimmings;

use super::aprons::{Apron, Gateway};
use super::doorways::Doorway;
use super::grounds::ring_of;
use super::lanes::LaneBoxIndex;
use super::mesh::{Finish, Mesh, Surface};
use super::special;
use super::surroundings::Surroundings;
use super::{SeededScenery, Wall};
use glam::{Vec2, Vec3};
use side::Facade;
use style::{BARE_BRICK, Style, TRIM};

const STOREY_M: f32 = 3.1;
/// Depth of walls below the ground.
const FOOT_M: f32 = 0.05;

/// The ways into a building.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Doors {
    pub(super) front: Option<Doorway>,
    pub(super) back: Option<Doorway>,
    pub(super) gates: Option<Gateway>,
}

/// Draws a building. Its front is not a side that other buildings block, and its door not where an obstacle
/// blocks the way. `trim` gets what is too small to be seen from afar. Returns its doors.
pub(super) fn building(
    [mesh, trim]: [&mut Mesh; 2],
    place: &SeededScenery<'_>,
    lanes: &LaneBoxIndex<'_>,
    around: &Surroundings<'_>,
) -> Doors {
    let ring = outline(place);
    if ring.len() < 3 {
        return Doors::default();
    }
    let name = place.piece.name.to_lowercase();
    let height = height_of(place);
    if special::pavilion(mesh, &name, &ring, height) {
        return Doors::default();
    }
    let sides: Vec<Facade> =
        (0..ring.len()).map(|k| Facade { from: ring[k], to: ring[(k + 1) % ring.len()] }).collect();
    let short = sides.iter().map(Facade::width).fold(f32::INFINITY, f32::min);
    let mut style = style::style(place, &name, short, height);
    let gabled = style.gabled && ring.len() == 4;
    let rise = if gabled { rise_of(&name, short, height) } else { 0.0 };
    let eaves = height - rise;
    if gabled {
        roof::gable_roof([mesh, trim], &ring, (eaves, rise), &style, place);
    } else {
        roof::flat_roof([mesh, trim], place, &ring, eaves);
    }
    if church::is_one(&name) {
        sides.iter().for_each(|side| storeys(mesh, side, &style, (eaves, false), None));
        special::additions(mesh, &name, &ring, height);
        let portal = church::church([mesh, trim], &sides, &ring, [eaves, height]);
        return Doors { front: Some(portal), ..Doors::default() };
    }
    let is_built = |at: Vec2| around.is_built(at, place.piece);
    // Sampling distance in front of a wall, as far as awnings and steps reach.
    let is_hidden =
        |side: &Facade| [0.1, 0.5, 0.9].iter().any(|&at| is_built(side.at(at, 0.0, 1.4).truncate()));
    let mut open: Vec<usize> = (0..sides.len()).filter(|&k| !is_hidden(&sides[k])).collect();
    if open.is_empty() {
        open = (0..sides.len()).collect();
    }
    let front = entrance::front_of(&sides, &open, lanes, place.piece.front_rad);
    let gates = Gateway { ends: [sides[front].from, sides[front].to], out: sides[front].outward() };
    // Gates without a drive would open onto a lawn.
    if Apron::new(&gates, around.map, around.field).is_none() {
        style.gates = None;
    }
    let bay = entrance::door_bay(&sides[front], &style, around);
    let back = entrance::back_door(&sides, &open, front, &style, place, around);
    let below = roof::eaves_over(&ring, gabled);
    for (k, side) in sides.iter().enumerate() {
        let windowless = if k == front {
            Some(entrance::windowless(side, &style, bay))
        } else {
            back.filter(|(side, _)| *side == k).map(|(_, bay)| entrance::bay_part(side, bay))
        };
        storeys(mesh, side, &style, (eaves, below(k)), windowless);
    }
    entrance::entrance(mesh, (&sides[front], bay), &style, (&name, eaves), around);
    let back_way = back.map(|(k, bay)| entrance::draw_back_door(mesh, (&sides[k], bay), &style));
    let drop = roof::overhang_drop(rise, short);
    let overhung: Vec<Option<f32>> = (0..sides.len()).map(|k| below(k).then_some(eaves - drop)).collect();
    let house = trimmings::House {
        place,
        sides: &sides,
        open: &open,
        front,
        bay,
        style: &style,
        eaves,
        storey: eaves / storeys_up_to(eaves),
        overhung: &overhung,
    };
    trimmings::of_walls(trim, &house);
    trimmings::bay_window(mesh, &house, |at| !around.bars_the_way(at) && !is_built(at));
    special::additions(mesh, &name, &ring, height);
    let door = (bay + 0.5) / sides[front].bays();
    let at = sides[front].at(door, 0.0, 0.0).truncate();
    let out = sides[front].outward();
    Doors {
        front: style.gates.is_none().then_some(Doorway { at, out }),
        back: back_way,
        gates: style.gates.map(|_| gates),
    }
}

/// The corners of its footprint.
fn outline(place: &SeededScenery<'_>) -> Vec<Vec2> {
    ring_of(&place.piece.shape).iter().map(|p| p.as_vec2()).collect()
}

/// Its fuel pumps: position and direction.
pub(super) fn pumps(place: &SeededScenery<'_>) -> Vec<(Vec3, Vec2)> {
    let ring = outline(place);
    special::pumps(&place.piece.name.to_lowercase(), &ring)
}

/// The clocks on its tower.
pub(super) fn clocks(place: &SeededScenery<'_>) -> Option<Mesh> {
    special::clocks(&place.piece.name.to_lowercase(), &outline(place), height_of(place))
}

/// Its lamps.
pub(super) fn lights(place: &SeededScenery<'_>) -> Vec<Vec3> {
    let ring = outline(place);
    special::lights(&place.piece.name.to_lowercase(), &ring, height_of(place))
}

/// Position and direction of its price board.
pub(super) fn price_board(place: &SeededScenery<'_>) -> Option<(Vec2, Vec2)> {
    let ring = outline(place);
    special::price_board(&place.piece.name.to_lowercase(), &ring)
}

fn height_of(place: &SeededScenery<'_>) -> f32 {
    let stated = place.piece.height_m.map_or(6.5 + 6.0 * place.hash_to_unit(9), |h| h as f32);
    let share = if church::is_one(&place.piece.name.to_lowercase()) { church::NAVE } else { 1.0 };
    (share * stated).clamp(2.2, 120.0)
}

/// Height of a gabled roof from eaves to ridge.
fn rise_of(name: &str, short_m: f32, height: f32) -> f32 {
    if church::is_one(name) {
        return church::STEEP * short_m;
    }
    (0.42 * short_m).min(0.42 * height)
}

/// Its occluders: outer walls up to the height at which they are opaque.
pub(super) fn opaque_walls(place: &SeededScenery<'_>) -> Vec<Wall> {
    let ring = outline(place);
    if ring.len() < 3 || special::is_open(&place.piece.name.to_lowercase()) {
        return Vec::new();
    }
    let sides = || (0..ring.len()).map(|k| (ring[k], ring[(k + 1) % ring.len()]));
    let short = sides().map(|(from, to)| from.distance(to)).fold(f32::INFINITY, f32::min);
    let height_m = height_of(place);
    // Up to the eaves, whatever the roof.
    let height_m = height_m - rise_of(&place.piece.name.to_lowercase(), short, height_m);
    sides().map(|(from, to)| Wall { from, to, height_m }).collect()
}

/// What hides above the eaves: the inner half of the roof, up to half its rise, and a tower. Not as exact as
/// [`opaque_walls`]: for labels, which need not be.
pub(super) fn upper_walls(place: &SeededScenery<'_>) -> Vec<Wall> {
    let outer = opaque_walls(place);
    let Some(eaves_m) = outer.first().map(|wall| wall.height_m) else { return Vec::new() };
    let (ring, height_m) = (outline(place), height_of(place));
    let middle = ring.iter().copied().sum::<Vec2>() / ring.len() as f32;
    let roof = outer.iter().map(|wall| Wall {
        from: middle.lerp(wall.from, 0.5),
        to: middle.lerp(wall.to, 0.5),
        height_m: (eaves_m + height_m) / 2.0,
    });
    let tower = special::tower(&place.piece.name.to_lowercase(), &ring, height_m);
    roof.chain(tower).collect()
}

/// Number of storeys of about [`STOREY_M`].
fn storeys_up_to(eaves: f32) -> f32 {
    (eaves / STOREY_M).round().max(1.0)
}

/// The same wall finish without windows.
fn bare(finish: Finish) -> Finish {
    let surface = match finish.surface {
        Surface::Sash => Surface::Brick,
        Surface::Windows | Surface::Shutters | Surface::Balcony => Surface::Concrete,
        _ => return finish,
    };
    let colour = match surface {
        // The brick of windows has its tint besides its own red.
        Surface::Brick => std::array::from_fn(|k| {
            (u16::from(BARE_BRICK.colour[k]) * u16::from(finish.colour[k]) / 255) as u8
        }),
        _ => finish.colour,
    };
    Finish { surface, colour, ..finish }
}

/// Draws one facade up to the eaves, which may hang over it; its ground floor has no windows between the given
/// shares of its width.
fn storeys(
    mesh: &mut Mesh,
    side: &Facade,
    style: &Style,
    (eaves, is_overhung): (f32, bool),
    windowless: Option<[f32; 2]>,
) {
    let storeys = storeys_up_to(eaves);
    let first = eaves / storeys;
    let uv = |finish: Finish, [a, b]: [f32; 2], from: f32, to: f32| {
        let across = match finish.surface {
            // Windowless walls have texture coordinates in metres.
            Surface::Brick | Surface::Concrete | Surface::Plain => Vec2::new(side.width(), first) / 2.0,
            _ => Vec2::new(side.bays(), 1.0),
        };
        [Vec2::new(a, from) * across, Vec2::new(b, to) * across]
    };
    // Overhanging eaves keep light from the wall under them.
    let under = if is_overhung { 165 } else { 250 };
    let above_ground = if storeys > 1.0 { 240 } else { under };
    let [from, to] = windowless.unwrap_or([1.0; 2]);
    for (parts, finish) in
        [([0.0, from], style.ground), ([from, to], bare(style.ground)), ([to, 1.0], style.ground)]
    {
        if parts[0] < parts[1] {
            side.between(parts).face(
                mesh,
                [FOOT_M, first],
                uv(finish, parts, 0.0, 1.0),
                finish,
                above_ground,
            );
        }
    }
    if storeys > 1.0 {
        let uv = uv(style.upper, [0.0, 1.0], 0.0, storeys - 1.0);
        side.face(mesh, [first, eaves], uv, style.upper, under);
    }
    // A plinth.
    if !style.ground.surface.is_shopfront() {
        side.slab(mesh, [side.width() / 2.0, side.width() + 0.08], [0.0, 0.45], 0.05, TRIM.shaded(0.8));
    }
}
