//! Buildings from their ground plans: storeys of windows, doors, signs, flat and gabled roofs, and
//! what names ask for.

use super::grounds::{distance_to, ring_of};
use super::lanes::LaneBoxes;
use super::lettering;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::Region;
use super::roads::level;
use super::special;
use super::{Place, Wall};
use crate::city::Shape;
use glam::{Vec2, Vec3};

const STOREY_M: f32 = 3.1;
const BAY_M: f32 = 3.0;
const PARAPET_M: f32 = 0.55;
/// Walls begin here, in the ground.
const FOOT_M: f32 = 0.05;

const fn wall(surface: Surface, colour: [u8; 3]) -> Finish {
    Finish::new(surface, colour, Class::Building)
}

const PLASTERS: [[u8; 3]; 7] = [
    [236, 226, 204],
    [222, 206, 178],
    [206, 214, 216],
    [232, 208, 176],
    [214, 186, 160],
    [226, 226, 220],
    [196, 206, 190],
];
/// Tints of brick, whose red is its own.
const BRICKS: [[u8; 3]; 3] = [[255, 250, 244], [236, 216, 200], [255, 236, 214]];
const TILES: [[u8; 3]; 4] = [[170, 92, 66], [146, 82, 64], [104, 102, 106], [134, 98, 78]];
/// Boards, light enough for dark letters.
const SIGNS: [[u8; 3]; 6] =
    [[150, 176, 150], [206, 122, 104], [140, 168, 196], [226, 186, 96], [226, 214, 190], [184, 166, 190]];
const TRIM: Finish = wall(Surface::Concrete, [206, 202, 194]);
const FLAT_ROOF: Finish = wall(Surface::Gravel, [150, 148, 144]);
pub(super) const DARK: Finish = wall(Surface::Metal, [72, 76, 80]);

/// What a building's name says about it.
struct Style {
    upper: Finish,
    ground: Finish,
    tiles: Finish,
    gabled: bool,
    sign: Option<Finish>,
    /// Wide doors on the front instead of one entrance.
    gates: Option<[u8; 3]>,
}

fn has(name: &str, words: &[&str]) -> bool {
    words.iter().any(|word| name.contains(word))
}

/// What stands behind the windows of a shop of a name.
fn shop_of(name: &str) -> Surface {
    if has(name, &["cafe", "bakery", "hotel", "restaurant", "theatre", "cinema"]) {
        Surface::Tearoom
    } else if has(name, &["shoe", "hat", "department", "fashion", "tailor"]) {
        Surface::Boutique
    } else {
        Surface::Shopfront
    }
}

fn style(place: &Place<'_>, name: &str, short_m: f32, height: f32) -> Style {
    let pick = |colours: &[[u8; 3]], salt: u32| {
        colours[(place.dice(salt) * colours.len() as f32) as usize % colours.len()]
    };
    let plaster = wall(Surface::Windows, pick(&PLASTERS, 1));
    let tiles = wall(Surface::RoofTiles, pick(&TILES, 2));
    let sign = Some(wall(Surface::Plain, pick(&SIGNS, 3)));
    let shop = wall(shop_of(name), pick(&SIGNS, 3));
    let dwelling = has(name, &["house", "villa", "terrace", "cottage", "chapel", "school", "farm"]);
    let base = Style {
        upper: plaster,
        ground: plaster.shaded(0.95),
        tiles,
        gabled: dwelling && short_m < 11.0 && height < 16.0,
        sign: None,
        gates: None,
    };
    let sash = wall(Surface::Sash, pick(&BRICKS, 6));
    let balcony = wall(Surface::Balcony, pick(&PLASTERS, 1));
    if has(name, &["fire station"]) {
        let sign = Some(wall(Surface::Plain, [232, 226, 214]));
        let brick = Finish { colour: BRICKS[0], ..sash };
        return Style { upper: brick, ground: brick, sign, gates: Some([196, 34, 30]), ..base };
    }
    if has(name, &["hose tower", "mill"]) {
        return Style { upper: BARE_BRICK, ground: BARE_BRICK, ..base };
    }
    if has(name, &["warehouse", "factory", "depot", "workshop"]) {
        let sheet = wall(Surface::Concrete, pick(&[[186, 190, 190], [170, 182, 188], [196, 188, 174]], 4));
        return Style { upper: sheet, ground: sheet, sign, gates: Some([112, 124, 134]), ..base };
    }
    if has(name, &["office", "department"]) {
        let glazing = wall(Surface::Glazing, [214, 218, 220]);
        return Style { upper: glazing, ground: shop, sign, ..base };
    }
    if has(name, &["theatre", "hotel", "cinema"]) {
        let stone =
            wall(Surface::Windows, if has(name, &["hotel"]) { [214, 196, 168] } else { [228, 218, 198] });
        return Style { upper: stone, ground: shop, sign, ..base };
    }
    if has(name, &["shop", "bakery", "pharmacy", "cafe", "cinema", "theatre", "hotel", "store", "station"]) {
        let upper = if place.dice(5) < 0.3 { sash } else { plaster };
        return Style { upper, ground: shop, sign, ..base };
    }
    if has(name, &["town hall", "observatory", "school"]) {
        let stone = wall(Surface::Windows, [222, 208, 182]);
        return Style { upper: stone, ground: stone, sign, ..base };
    }
    if has(name, &["apartments"]) {
        let upper = match place.dice(5) {
            d if d < 0.40 => balcony,
            d if d < 0.75 => sash,
            _ => plaster,
        };
        let ground =
            if upper.surface == Surface::Balcony { wall(Surface::Windows, balcony.colour) } else { upper };
        return Style { upper, ground: ground.shaded(0.95), ..base };
    }
    if has(name, &["row house", "terrace"]) && place.dice(5) < 0.55 {
        return Style { upper: sash, ground: sash, ..base };
    }
    if dwelling && !has(name, &["chapel", "terrace"]) && place.dice(5) < 0.5 {
        let shutters = Finish { surface: Surface::Shutters, ..plaster };
        return Style { upper: shutters, ground: shutters.shaded(0.97), ..base };
    }
    base
}

/// Bricks of the colour that [`Surface::Sash`] has.
const BARE_BRICK: Finish = wall(Surface::Brick, [190, 118, 95]);

/// One wall: where it stands and how wide it is, seen from outside.
#[derive(Clone, Copy)]
struct Side {
    from: Vec2,
    to: Vec2,
}

impl Side {
    fn width(&self) -> f32 {
        self.from.distance(self.to)
    }

    /// To the right, for someone who looks at it.
    fn across(&self) -> Vec2 {
        (self.to - self.from).normalize_or(Vec2::X)
    }

    fn outward(&self) -> Vec2 {
        -self.across().perp()
    }

    /// A point on it: part of its width, height, and how far in front of it.
    fn at(&self, part: f32, z: f32, out: f32) -> Vec3 {
        (self.from.lerp(self.to, part) + self.outward() * out).extend(z)
    }

    /// A face on it between two heights; `open` is how much light its upper edge gets.
    fn face(&self, mesh: &mut Mesh, z: [f32; 2], uv: [Vec2; 2], finish: Finish, open: u8) {
        let corners = [
            self.at(0.0, z[0], 0.0),
            self.at(1.0, z[0], 0.0),
            self.at(1.0, z[1], 0.0),
            self.at(0.0, z[1], 0.0),
        ];
        let uvs = [uv[0], Vec2::new(uv[1].x, uv[0].y), uv[1], Vec2::new(uv[0].x, uv[1].y)];
        // The ground hides half of the sky's neighbourhood from the foot of a wall.
        let low = if z[0] < 0.5 { 140 } else { 235 };
        mesh.shaded_face(&corners, &uvs, finish, &[low, low, open, open]);
    }

    /// A picture in front of it: middle and width in metres along it, heights, how far in front.
    fn panel(&self, mesh: &mut Mesh, [middle, width]: [f32; 2], z: [f32; 2], out: f32, finish: Finish) {
        let part = |x: f32| x / self.width().max(1e-3);
        let (a, b) = (part(middle - width / 2.0), part(middle + width / 2.0));
        let corners =
            [self.at(a, z[0], out), self.at(b, z[0], out), self.at(b, z[1], out), self.at(a, z[1], out)];
        mesh.shaded_face(&corners, &[Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y], finish, &[170, 170, 235, 235]);
    }

    /// A slab in front of it: middle and width in metres along it, heights, thickness.
    fn slab(&self, mesh: &mut Mesh, [middle, width]: [f32; 2], z: [f32; 2], thick: f32, finish: Finish) {
        let centre = self.from + self.across() * middle + self.outward() * (thick / 2.0 - 0.02);
        let size = Vec3::new(width, thick + 0.04, z[1] - z[0]);
        mesh.block(centre.extend(z[0]), size, self.across().to_angle(), finish);
    }
}

/// A building with everything on it.
/// Its front is none of the sides before which the ground `is_built` up.
pub(super) fn building(
    mesh: &mut Mesh,
    place: &Place<'_>,
    lanes: &LaneBoxes<'_>,
    is_built: impl Fn(Vec2) -> bool,
) {
    let ring = outline(place);
    if ring.len() < 3 {
        return;
    }
    let name = place.piece.name.to_lowercase();
    let height = height_of(place);
    if special::pavilion(mesh, &name, &ring, height) {
        return;
    }
    let sides: Vec<Side> =
        (0..ring.len()).map(|k| Side { from: ring[k], to: ring[(k + 1) % ring.len()] }).collect();
    let short = sides.iter().map(Side::width).fold(f32::INFINITY, f32::min);
    let style = style(place, &name, short, height);
    let gabled = style.gabled && ring.len() == 4;
    let rise = if gabled { rise_of(short, height) } else { 0.0 };
    let eaves = height - rise;
    for side in &sides {
        storeys(mesh, side, &style, eaves);
    }
    if gabled {
        gable_roof(mesh, &ring, eaves, rise, &style, place);
    } else {
        flat_roof(mesh, place, &ring, eaves);
    }
    // As far out as awnings and steps reach, all along.
    let is_hidden =
        |side: &Side| [0.1, 0.5, 0.9].iter().any(|&at| is_built(side.at(at, 0.0, 1.4).truncate()));
    let open: Vec<Side> = sides.iter().copied().filter(|side| !is_hidden(side)).collect();
    let front = front_of(if open.is_empty() { &sides } else { &open }, lanes, place.piece.front_rad);
    entrance(mesh, &front, &style, &name, eaves);
    special::additions(mesh, &name, &ring, height);
}

/// Its corners on the ground.
fn outline(place: &Place<'_>) -> Vec<Vec2> {
    ring_of(&place.piece.shape).iter().map(|p| p.as_vec2()).collect()
}

/// Fuel pumps that belong to it: where each stands and looks to.
pub(super) fn pumps(place: &Place<'_>) -> Vec<(Vec3, Vec2)> {
    let ring = outline(place);
    special::pumps(&place.piece.name.to_lowercase(), &ring)
}

/// Lamps that belong to it.
pub(super) fn lights(place: &Place<'_>) -> Vec<Vec3> {
    let ring = outline(place);
    special::lights(&place.piece.name.to_lowercase(), &ring, height_of(place))
}

/// Where the board with its prices stands, and the way along it.
pub(super) fn price_board(place: &Place<'_>) -> Option<(Vec2, Vec2)> {
    let ring = outline(place);
    special::price_board(&place.piece.name.to_lowercase(), &ring)
}

fn height_of(place: &Place<'_>) -> f32 {
    place.piece.height_m.map_or(6.5 + 6.0 * place.dice(9), |h| h as f32).clamp(2.2, 120.0)
}

/// Of a gabled roof, from the eaves to the ridge.
fn rise_of(short_m: f32, height: f32) -> f32 {
    (0.42 * short_m).min(0.42 * height)
}

/// The outer walls, as high as nothing can be seen through them.
pub(super) fn opaque_walls(place: &Place<'_>) -> Vec<Wall> {
    let ring = outline(place);
    if ring.len() < 3 || special::is_open(&place.piece.name.to_lowercase()) {
        return Vec::new();
    }
    let sides = || (0..ring.len()).map(|k| (ring[k], ring[(k + 1) % ring.len()]));
    let short = sides().map(|(from, to)| from.distance(to)).fold(f32::INFINITY, f32::min);
    let height_m = height_of(place);
    // Under the eaves, whatever the roof is.
    let height_m = height_m - rise_of(short, height_m);
    sides().map(|(from, to)| Wall { from, to, height_m }).collect()
}

/// The side that is nearest to a road, wide ones before narrow ones.
fn front_of(sides: &[Side], lanes: &LaneBoxes<'_>, stated_rad: Option<f64>) -> Side {
    if let Some(angle) = stated_rad {
        let wanted = Vec2::from_angle(angle as f32);
        let facing = |side: &Side| side.outward().dot(wanted) + 0.02 * side.width().min(20.0);
        return sides.iter().copied().max_by(|a, b| facing(a).total_cmp(&facing(b))).unwrap_or(sides[0]);
    }
    let far = |side: &Side| {
        let at = side.at(0.5, 0.0, 1.0).truncate().as_dvec2();
        let away = lanes.nearest(at).map_or(f64::INFINITY, |nearest| nearest.distance(at));
        away as f32 - side.width().min(12.0)
    };
    let fallback = sides[0];
    sides.iter().copied().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(fallback)
}

fn storeys(mesh: &mut Mesh, side: &Side, style: &Style, eaves: f32) {
    let storeys = (eaves / STOREY_M).round().max(1.0);
    let bays = (side.width() / BAY_M).round().max(1.0);
    let first = eaves / storeys;
    let uv = |finish: Finish, from: f32, to: f32| match finish.surface {
        // Patterns of walls without windows are laid on in metres.
        Surface::Brick | Surface::Concrete | Surface::Plain => {
            [Vec2::new(0.0, from * first / 2.0), Vec2::new(side.width() / 2.0, to * first / 2.0)]
        }
        _ => [Vec2::new(0.0, from), Vec2::new(bays, to)],
    };
    // Overhanging eaves keep light from the wall under them.
    let under = if style.gabled { 165 } else { 250 };
    let above_ground = if storeys > 1.0 { 240 } else { under };
    side.face(mesh, [FOOT_M, first], uv(style.ground, 0.0, 1.0), style.ground, above_ground);
    if storeys > 1.0 {
        side.face(mesh, [first, eaves], uv(style.upper, 0.0, storeys - 1.0), style.upper, under);
    }
    // A plinth, so that walls do not grow out of the lawn.
    if !style.ground.surface.is_shopfront() {
        side.slab(mesh, [side.width() / 2.0, side.width() + 0.08], [0.0, 0.45], 0.05, TRIM.shaded(0.8));
    }
}

fn entrance(mesh: &mut Mesh, front: &Side, style: &Style, name: &str, eaves: f32) {
    let width = front.width();
    let storey = eaves / (eaves / STOREY_M).round().max(1.0);
    if let Some(colour) = style.gates {
        let count = ((width - 0.6) / 4.1).floor().max(1.0);
        for k in 0..count as u32 {
            let middle = width * (k as f32 + 0.5) / count;
            let high = (storey * 1.15).clamp(2.6, eaves - 0.6);
            front.slab(mesh, [middle, 3.8], [0.02, high + 0.2], 0.06, TRIM);
            front.panel(mesh, [middle, 3.4], [0.05, high], 0.075, wall(Surface::Gate, colour));
        }
    } else {
        let middle =
            if style.ground.surface.is_shopfront() { 0.5 } else { 0.5 / (width / BAY_M).round().max(1.0) };
        let middle = if width < 4.0 { width / 2.0 } else { middle * width };
        // The opening is as wide as the texture's window that it replaces.
        front.slab(mesh, [middle, 1.56], [0.02, 2.74], 0.05, TRIM);
        front.panel(mesh, [middle, 1.34], [0.16, 2.66], 0.065, wall(Surface::Door, [255, 255, 255]));
        front.slab(mesh, [middle, 1.9], [0.02, 0.16], 0.6, TRIM.shaded(0.9));
        let canopy = !style.ground.surface.is_shopfront() && !style.gabled && eaves > 8.0;
        if canopy {
            front.slab(mesh, [middle, 2.2], [2.84, 2.98], 0.95, TRIM.shaded(0.95));
        }
    }
    let Some(board) = style.sign else { return };
    let text = name.trim().to_uppercase();
    if text.is_empty() {
        return;
    }
    let letter = (0.86 * width / lettering::width_of(&text, 1.0)).min(0.62);
    let board_width = lettering::width_of(&text, letter) + 0.7;
    let half = letter * 0.72;
    let z = if style.gates.is_some() {
        (storey * 1.15).clamp(2.6, eaves - 0.6) + 0.62
    } else if style.ground.surface.is_shopfront() {
        storey * 0.93
    } else {
        // Between the windows of two storeys.
        (storey * 1.04).min(eaves - half - 0.05)
    };
    front.slab(mesh, [width / 2.0, board_width], [z - half, z + half], 0.14, board);
    lettering::write(mesh, &text, front.at(0.5, z, 0.145), front.across().extend(0.0), letter, board);
    // Awnings over shop windows, in the colour of the board.
    if style.ground.surface.is_shopfront() && has(name, &["cafe", "bakery", "flower", "hotel"]) {
        let (a, b) = (front.at(0.04, z - half, 0.1), front.at(0.96, z - half, 0.1));
        let drop = front.outward().extend(0.0) * 1.3 - Vec3::Z * 0.45;
        let striped = Finish { surface: Surface::Awning, ..board.shaded(1.1) };
        let stripes = (width / 2.4).round().max(1.0);
        let uvs = [Vec2::ZERO, Vec2::new(stripes, 0.0), Vec2::new(stripes, 1.0), Vec2::Y];
        mesh.face(&[a + drop, b + drop, b, a], &uvs, striped);
        let under = striped.shaded(0.6);
        mesh.shaded_face(
            &[a, b, b + drop, a + drop],
            &[uvs[3], uvs[2], uvs[1], uvs[0]],
            under,
            &[90, 90, 170, 170],
        );
    }
}

fn flat_roof(mesh: &mut Mesh, place: &Place<'_>, ring: &[Vec2], eaves: f32) {
    let plan: Vec<_> = ring.iter().map(|p| p.as_dvec2()).collect();
    level(mesh, &Region::simple(&plan), eaves, FLAT_ROOF, 3.0);
    let top = eaves + PARAPET_M;
    let profile = [
        Vec2::new(0.06, eaves - 0.25),
        Vec2::new(0.06, top),
        Vec2::new(-0.24, top),
        Vec2::new(-0.24, eaves - 0.02),
    ];
    for pair in profile.windows(2) {
        sharp_band(mesh, ring, [pair[0], pair[1]], TRIM);
    }
    // Plant on the roof.
    let centre = ring.iter().copied().sum::<Vec2>() / ring.len() as f32;
    let yaw = (ring[1] - ring[0]).to_angle();
    let edge = Shape::Polyline(plan.iter().copied().chain(plan.first().copied()).collect());
    for k in 0..3 {
        if place.dice(20 + k) < 0.6 {
            let corner = ring[k as usize % ring.len()];
            let at = centre.lerp(corner, 0.25 + 0.3 * place.dice(30 + k));
            let size = Vec3::new(
                1.0 + 1.6 * place.dice(40 + k),
                1.0 + place.dice(50 + k),
                0.7 + 0.9 * place.dice(60 + k),
            );
            // Nothing sticks out, and towers stand alone on their roofs.
            let reach = size.truncate().length() / 2.0 + 0.3;
            let has_room = distance_to(&edge, at.as_dvec2()) > f64::from(reach);
            let spire = special::spire_reach(&place.piece.name.to_lowercase(), ring);
            if has_room && spire.is_none_or(|spire| at.distance(centre) > reach + spire) {
                mesh.block(at.extend(eaves), size, yaw, DARK.shaded(1.9));
            }
        }
    }
}

/// A band along a ring whose corners stay corners: profile points are (outwards, height).
fn sharp_band(mesh: &mut Mesh, ring: &[Vec2], [from, to]: [Vec2; 2], finish: Finish) {
    let count = ring.len();
    let moved = |k: usize, out: f32| {
        let (before, at, after) = (ring[(k + count - 1) % count], ring[k], ring[(k + 1) % count]);
        let (a, b) = ((at - before).normalize_or(Vec2::X), (after - at).normalize_or(Vec2::X));
        let mean = (a + b).normalize_or(a);
        at - mean.perp() * (out / mean.dot(a).max(0.3))
    };
    for k in 0..count {
        let next = (k + 1) % count;
        let corners = [
            moved(k, from.x).extend(from.y),
            moved(next, from.x).extend(from.y),
            moved(next, to.x).extend(to.y),
            moved(k, to.x).extend(to.y),
        ];
        mesh.plate(&corners, finish, 2.0);
    }
}

/// Two slopes with overhanging eaves along the longer axis of a rectangle, gables and a chimney.
fn gable_roof(mesh: &mut Mesh, ring: &[Vec2], eaves: f32, rise: f32, style: &Style, place: &Place<'_>) {
    const OVERHANG_M: f32 = 0.4;
    // a to b is the longer side.
    let turn = usize::from(ring[0].distance(ring[1]) < ring[1].distance(ring[2]));
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| ring[(k + turn) % 4]);
    let (ridge_a, ridge_b) = ((a + d) / 2.0, (b + c) / 2.0);
    let along = (b - a).normalize_or(Vec2::X) * OVERHANG_M;
    let out = (a - d).normalize_or(Vec2::Y);
    let half = a.distance(d) / 2.0;
    let slope_drop = rise / half * OVERHANG_M;
    let ridge = |p: Vec2, end: f32| (p + along * end).extend(eaves + rise);
    let eave = |p: Vec2, side: f32, end: f32| {
        (p + along * end + out * (side * OVERHANG_M)).extend(eaves - slope_drop)
    };
    let length = a.distance(b) + 2.0 * OVERHANG_M;
    let run = (half + OVERHANG_M).hypot(rise + slope_drop);
    let uvs =
        [Vec2::ZERO, Vec2::new(length, 0.0), Vec2::new(length, run), Vec2::new(0.0, run)].map(|uv| uv / 3.0);
    for (corners, lift) in [
        ([eave(a, 1.0, -1.0), eave(b, 1.0, 1.0), ridge(ridge_b, 1.0), ridge(ridge_a, -1.0)], 0.14),
        ([eave(c, -1.0, 1.0), eave(d, -1.0, -1.0), ridge(ridge_a, -1.0), ridge(ridge_b, 1.0)], 0.14),
    ] {
        let top = corners.map(|p| p + Vec3::Z * lift);
        mesh.face(&top, &uvs, style.tiles);
        // Underside and fascia.
        let [p, q, r, s] = corners;
        let first = mesh.vertices.len();
        mesh.plate(&[q, p, s, r], TRIM.shaded(0.85), 2.0);
        mesh.set_openness(first, 90);
        mesh.plate(&[p, q, top[1], top[0]], TRIM, 2.0);
        mesh.plate(&[q, r, top[2], top[1]], TRIM, 2.0);
        mesh.plate(&[s, p, top[0], top[3]], TRIM, 2.0);
    }
    let plain = if style.upper.surface == Surface::Sash {
        BARE_BRICK
    } else {
        wall(Surface::Concrete, style.upper.colour)
    };
    for [left, right, top] in [[d, a, ridge_a], [b, c, ridge_b]] {
        let corners = [left.extend(eaves), right.extend(eaves), top.extend(eaves + rise)];
        mesh.plate(&corners, plain, 2.0);
    }
    let at = ridge_a.lerp(ridge_b, 0.22 + 0.5 * place.dice(12)) + out * (0.25 * half);
    let chimney = wall(Surface::Brick, [150, 96, 80]);
    mesh.block(
        at.extend(eaves + 0.4 * rise),
        Vec3::new(0.7, 0.6, 0.6 * rise + 0.7),
        along.to_angle(),
        chimney,
    );
}
