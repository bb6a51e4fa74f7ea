//! Facade textures: walls with windows, shop fronts, doors. One repeat is a bay of a storey, v upwards.

use super::noise::{hash, octaves, value};
use super::patterns::{Texel, brick, grey};

fn within([u, v]: [f32; 2], [left, right]: [f32; 2], [low, high]: [f32; 2]) -> bool {
    u > left && u < right && v > low && v < high
}

fn tinted([r, g, b]: [f32; 3], level: f32) -> Texel {
    ([r * level, g * level, b * level], 1.0)
}

/// Window pane: a dark room with curtains. Shaders add the reflection; they tell panes and frames by roughness.
fn pane([x, y]: [f32; 2], seed: i32) -> Texel {
    let level = 0.1 + 0.13 * y * y;
    let fold = 0.5 + 0.5 * (x * 95.0).sin();
    if !(0.17..=0.83).contains(&x) && seed % 3 != 2 {
        // Curtains behind glass.
        let cloth = 0.34 + 0.10 * fold + 0.08 * y;
        return ([cloth * 0.95, cloth * 0.94, cloth * 0.90], 0.13);
    }
    if seed % 4 == 1 && y > 0.72 {
        let blind = 0.52 - 0.05 * ((y * 60.0).fract() - 0.5).abs();
        return ([blind, blind * 0.98, blind * 0.92], 0.13);
    }
    ([level * 0.74, level * 0.94, level * 1.14], 0.13)
}

/// Rendered (plastered) wall with faint vertical stains.
fn render_wall(at: [f32; 2]) -> f32 {
    let run = value(at, [40, 3], 63) - 0.5;
    0.92 + 0.07 * (octaves(at, [10, 10], 3, 61) - 0.5) + 0.035 * run
}

/// Window in an opening: frame, sashes, shade of the reveal at the top and left.
struct WindowPattern {
    across: [f32; 2],
    up: [f32; 2],
    frame: [f32; 3],
    /// Height of the horizontal glazing bar, as a share of the window.
    bar: f32,
    seed: i32,
}

impl WindowPattern {
    fn at(&self, [u, v]: [f32; 2]) -> Option<Texel> {
        let x = (u - self.across[0]) / (self.across[1] - self.across[0]);
        let y = (v - self.up[0]) / (self.up[1] - self.up[0]);
        if !(0.0..1.0).contains(&x) || !(0.0..1.0).contains(&y) {
            return None;
        }
        let (wide, high) = (3.0 * (self.across[1] - self.across[0]), 3.1 * (self.up[1] - self.up[0]));
        let edge = (x * wide).min((1.0 - x) * wide).min(y * high).min((1.0 - y) * high);
        // The reveal shades what lies behind it.
        let shade = if (1.0 - y) * high < 0.13 {
            0.55
        } else if x * wide < 0.06 {
            0.72
        } else {
            1.0
        };
        if edge < 0.048 || (x - 0.5).abs() * wide < 0.024 || (y - self.bar).abs() * high < 0.019 {
            return Some(tinted(self.frame, shade));
        }
        let (colour, dull) = pane([x, y], self.seed);
        Some((colour.map(|c| c * shade), dull))
    }
}

const WHITE: [f32; 3] = [0.94, 0.94, 0.92];
const DARK: [f32; 3] = [0.17, 0.18, 0.19];
const RED: [f32; 3] = [0.64, 0.40, 0.32];

/// Height of the string course at the foot of a storey, as a share of it.
const COURSE: f32 = 0.05;

/// Casement window under a small cornice.
pub(super) fn windows(at: [f32; 2]) -> Texel {
    let window = WindowPattern { across: [0.30, 0.70], up: [0.28, 0.80], frame: WHITE, bar: 0.66, seed: 4 };
    if let Some(texel) = window.at(at) {
        return texel;
    }
    let wall = render_wall(at);
    // Surround, sill with its shade, cornice with its shade.
    if within(at, [0.25, 0.75], [0.245, 0.28]) || within(at, [0.25, 0.75], [0.83, 0.865]) {
        return grey(1.0);
    }
    // The shade of the cornice falls on the surround too.
    if within(at, [0.26, 0.76], [0.215, 0.245]) || within(at, [0.26, 0.76], [0.815, 0.83]) {
        return grey(wall * 0.68);
    }
    if within(at, [0.27, 0.73], [0.28, 0.83]) {
        return grey(0.99);
    }
    // Stains run from the ends of the sill down to the string course.
    let is_below_end = (at[0] - 0.29).abs() < 0.012 || (at[0] - 0.71).abs() < 0.012;
    let run = if is_below_end && at[1] < 0.215 { (at[1] - COURSE).max(0.0) * 0.40 } else { 0.0 };
    let band = if at[1] < 0.022 {
        0.84
    } else if at[1] < COURSE {
        1.04
    } else {
        1.0
    };
    grey((wall - run) * band)
}

/// Sash window in brick. The brick has its own red, so that frames stay white under a tint near white.
pub(super) fn sash(at: [f32; 2]) -> Texel {
    let window = WindowPattern { across: [0.32, 0.68], up: [0.26, 0.80], frame: WHITE, bar: 0.50, seed: 7 };
    if let Some((colour, dull)) = window.at(at) {
        return (colour, dull);
    }
    if within(at, [0.28, 0.72], [0.225, 0.26]) {
        return ([1.0, 1.0, 1.0], 1.0);
    }
    if within(at, [0.285, 0.715], [0.80, 0.875]) {
        // Soldier bricks over the opening, a keystone in their middle.
        let joint = (at[0] * 44.0).fract() < 0.16;
        let key = (at[0] - 0.5).abs() < 0.035;
        let level = if joint { 1.25 } else { 0.92 };
        return if key { grey(0.96) } else { tinted(RED, level) };
    }
    // A bay of 3 m has one and a half repeats of 2 m of brick.
    let (colour, dull) = brick([at[0] * 1.5, at[1] * 1.5]);
    let shade = if within(at, [0.29, 0.73], [0.195, 0.225]) { 0.64 } else { 1.0 };
    let course = if at[1] > 0.965 { 1.14 } else { 1.0 };
    ([0, 1, 2].map(|k| colour[k] * 1.16 * RED[k] * shade * course), dull)
}

pub(super) fn shutters(at: [f32; 2]) -> Texel {
    let window = WindowPattern { across: [0.345, 0.655], up: [0.27, 0.78], frame: WHITE, bar: 0.34, seed: 9 };
    if let Some(texel) = window.at(at) {
        return texel;
    }
    for [left, right] in [[0.205, 0.335], [0.665, 0.795]] {
        if within(at, [left, right], [0.265, 0.785]) {
            let slat = ((at[1] - 0.265) * 46.0).fract();
            let x = (at[0] - left) / (right - left);
            let rim = !(0.10..=0.90).contains(&x);
            let level = if rim { 0.40 } else { 0.27 + 0.16 * slat };
            return tinted([0.78, 1.0, 0.92], level);
        }
        if within(at, [left + 0.008, right + 0.014], [0.25, 0.785]) {
            return grey(render_wall(at) * 0.76);
        }
    }
    if within(at, [0.33, 0.67], [0.235, 0.27]) {
        return grey(1.0);
    }
    // The shade of the sill.
    let shade = if within(at, [0.34, 0.68], [0.212, 0.235]) { 0.68 } else { 1.0 };
    grey(render_wall(at) * shade)
}

/// Windows to the floor behind a railing, every other bay a closed wall beside them.
pub(super) fn balcony(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    if v < 0.055 {
        return grey(if v < 0.012 { 0.50 } else { 0.97 });
    }
    if within(at, [0.10, 0.90], [0.055, 0.37]) {
        let rail = !(0.075..=0.345).contains(&v);
        let bar = (u * 34.0).fract() < 0.26;
        if rail || bar {
            return tinted(DARK, 1.0);
        }
    }
    let window = WindowPattern { across: [0.18, 0.82], up: [0.06, 0.76], frame: DARK, bar: 0.86, seed: 5 };
    if let Some((colour, dull)) = window.at(at) {
        // The railing's shade.
        return (colour, dull);
    }
    if within(at, [0.06, 0.94], [0.86, 1.0]) {
        // Under the next balcony.
        return grey(0.70 + 0.22 * (1.0 - v) / 0.14);
    }
    grey(render_wall(at))
}

pub(super) fn glazing(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    if v < 0.22 {
        return grey(if !(0.02..=0.2).contains(&v) { 0.62 } else { render_wall(at) });
    }
    let mullion = !(0.03..=0.97).contains(&u) || (u - 0.5).abs() < 0.014 || v > 0.975;
    if mullion {
        return grey(0.42);
    }
    let y = (v - 0.22) / 0.755;
    // Desks and lamps of the storey behind, dim.
    let lamp = (0.80..0.86).contains(&y) && ((u * 2.0).fract() - 0.5).abs() < 0.34;
    let room = if lamp {
        0.17
    } else if y < 0.28 && hash((u * 10.0) as i32, 4, 71) > 0.5 {
        0.05
    } else {
        0.10
    };
    let level = room + 0.02 + 0.10 * y;
    ([level * 0.78, level * 0.97, level * 1.16], 0.10)
}

/// Shop front with shelves of goods behind the windows.
pub(super) fn shopfront(at: [f32; 2]) -> Texel {
    shop(at, shop_room)
}

/// Shop front with clothes.
pub(super) fn boutique(at: [f32; 2]) -> Texel {
    shop(at, clothes_room)
}

/// Shop front with tables.
pub(super) fn tearoom(at: [f32; 2]) -> Texel {
    shop(at, tea_room)
}

/// Shop front; `room` is the interior behind one of the two panes.
fn shop(at: [f32; 2], room: impl Fn([f32; 2], i32) -> [f32; 3]) -> Texel {
    let [u, v] = at;
    if v > 0.82 {
        // The board above the window takes the tint at full strength.
        let moulding = !(0.845..=0.975).contains(&v);
        return grey(if moulding { 0.62 } else { 0.92 });
    }
    if !(0.045..=0.955).contains(&u) {
        // Pilasters in the colour of the board.
        let middle = ((u + 0.5).fract() - 0.5).abs();
        return grey(if middle < 0.03 { 0.80 } else { 0.60 });
    }
    if v < 0.13 {
        let panel = within(at, [0.10, 0.47], [0.035, 0.105]) || within(at, [0.53, 0.90], [0.035, 0.105]);
        return grey(if panel { 0.46 } else { 0.60 });
    }
    let frame =
        !within(at, [0.06, 0.94], [0.145, 0.80]) || (u - 0.5).abs() < 0.012 || (v - 0.66).abs() < 0.009;
    if frame {
        return tinted(DARK, 0.9);
    }
    let half = usize::from(u > 0.5);
    let x = if half == 0 { (u - 0.06) / 0.428 } else { (u - 0.512) / 0.428 };
    let y = (v - 0.145) / 0.655;
    let sheen = if ((u * 1.1 + v * 0.8) * 2.3).fract() < 0.22 { 0.04 } else { 0.0 };
    (room([x, y], half as i32).map(|c| c + sheen), 0.25)
}

/// Interior of a shop: lamps, shelves of goods at the back, larger goods on stands in front.
fn shop_room([x, y]: [f32; 2], half: i32) -> [f32; 3] {
    const WALL: [f32; 3] = [0.44, 0.39, 0.32];
    let hue = |a: i32, b: i32| {
        let grey = 0.30 + 0.36 * hash(a * 7 + 5, b + 40 * half, 77);
        [0, 1, 2].map(|k| grey + 0.30 * (hash(a * 7 + k, b + 40 * half, 77) - 0.5))
    };
    // Stands close to the glass.
    for (stand, left) in [(0, 0.10_f32), (1, 0.58)] {
        let place = (x - left) / 0.32;
        let top = 0.13 + 0.07 * hash(stand, half, 71);
        if (0.0..1.0).contains(&place) && y < top {
            return if y > top - 0.02 { [0.62, 0.58, 0.52] } else { [0.36, 0.33, 0.30] };
        }
        let high = 0.16 + 0.12 * hash(stand, half, 72);
        let wide = 0.20 + 0.14 * hash(stand, half, 73);
        let (dx, dy) = ((place - 0.5) / wide, (y - top) / high);
        let is_round = hash(stand, half, 74) < 0.5;
        let inside =
            if is_round { dx * dx + (dy - 0.5).powi(2) * 4.0 < 1.0 } else { dx.abs() < 0.8 && dy < 1.0 };
        if dy > 0.0 && inside {
            return hue(stand + 60, 3).map(|c| c * (1.0 - 0.28 * dx.max(-0.4)));
        }
    }
    let (left, right, floor, ceiling) = (0.09, 0.91, 0.10, 0.86);
    if y > ceiling + 0.9 * (left - x).max(x - right).max(0.0) {
        let is_lamp = (y - 0.93).abs() < 0.022 && ((x * 3.0).fract() - 0.5).abs() < 0.24;
        return if is_lamp { [0.98, 0.94, 0.84] } else { [0.46, 0.44, 0.40] };
    }
    if y < floor - 0.9 * (left - x).max(x - right).max(0.0) {
        return [0.40, 0.31, 0.23];
    }
    if !(left..right).contains(&x) {
        return WALL.map(|c| c * 0.80);
    }
    let (px, py) = ((x - left) / (right - left), (y - floor) / (ceiling - floor));
    let (row, column) = ((py * 4.6) as i32, (px * 8.0) as i32);
    let (fx, fy) = ((px * 8.0).fract(), (py * 4.6).fract());
    // The lamps light the upper part of the wall more.
    let light = 0.72 + 0.38 * py;
    if row < 4 && fy < 0.07 {
        return WALL.map(|c| c * 0.62);
    }
    let is_there = hash(row, column + 40 * half, 76) > 0.2;
    if row < 4 && is_there && (0.10..0.90).contains(&fx) && fy < 0.32 + 0.46 * hash(row, column, 75) {
        return hue(row, column).map(|c| c * light * 0.92);
    }
    WALL.map(|c| c * light)
}

/// Floor, ceiling with lamps or a plain wall, whose lower part gets less light.
fn empty_room([x, y]: [f32; 2], wall: [f32; 3], floor: f32) -> [f32; 3] {
    if y > 0.88 {
        let is_lamp = (y - 0.94).abs() < 0.02 && ((x * 4.0).fract() - 0.5).abs() < 0.16;
        return if is_lamp { [0.98, 0.94, 0.84] } else { [0.48, 0.46, 0.43] };
    }
    if y < floor {
        let board = if (x * 9.0 + y * 2.0).fract() < 0.06 { 0.85 } else { 1.0 };
        return [0.42, 0.32, 0.23].map(|c| c * board);
    }
    wall.map(|c| c * (0.70 + 0.34 * y))
}

/// Interior of a boutique: a rail of clothes at the back, mannequins in front.
fn clothes_room([x, y]: [f32; 2], half: i32) -> [f32; 3] {
    let cloth = |a: i32, b: i32| {
        let grey = 0.22 + 0.42 * hash(a * 5 + 3, b + 30 * half, 81);
        [0, 1, 2].map(|k| grey + 0.26 * (hash(a * 5 + k, b + 30 * half, 82) - 0.5))
    };
    for (figure, middle) in [(0, 0.27_f32), (1, 0.74)] {
        if hash(figure, half, 83) < 0.3 {
            continue;
        }
        let dx = (x - middle).abs();
        // Head, upper part, skirt or trousers, stand.
        if (dx / 0.045).powi(2) + ((y - 0.72) / 0.055).powi(2) < 1.0 {
            return [0.66, 0.58, 0.50];
        }
        let waist = 0.055 + 0.05 * ((y - 0.48).abs() / 0.18);
        if (0.44..0.655).contains(&y) && dx < waist.min(0.105) {
            return cloth(figure, 1).map(|c| c * (1.0 - 2.2 * dx));
        }
        if (0.16..0.44).contains(&y) && dx < 0.06 + 0.10 * (0.44 - y) * f32::from(u8::from(half == 0)) {
            return cloth(figure, 2).map(|c| c * (1.0 - 2.2 * dx));
        }
        if (0.05..0.16).contains(&y) && dx < 0.012 || (0.03..0.055).contains(&y) && dx < 0.08 {
            return [0.24, 0.23, 0.22];
        }
    }
    let column = (x * 15.0) as i32;
    let long = 0.30 + 0.16 * hash(column, half, 84);
    if (0.635..0.65).contains(&y) {
        return [0.20, 0.20, 0.21];
    }
    let gap = (x * 15.0).fract() < 0.14 || (x * 3.1 + 0.3 * half as f32).fract() < 0.2;
    if !gap && y < 0.635 && y > 0.635 - long {
        return cloth(column, 7).map(|c| c * 0.85);
    }
    empty_room([x, y], [0.56, 0.54, 0.52], 0.14)
}

/// Interior of a tearoom: tables with chairs and pendant lamps, a counter behind.
fn tea_room([x, y]: [f32; 2], half: i32) -> [f32; 3] {
    let wood = |level: f32| [0.46 * level, 0.31 * level, 0.20 * level];
    for (table, middle) in [(0, 0.26_f32), (1, 0.72)] {
        let dx = x - middle + 0.05 * (hash(table, half, 91) - 0.5);
        // Lamp on its cord, cups, table top, foot, backs of chairs.
        if (0.70..0.78).contains(&y) && dx.abs() < 0.03 + 0.7 * (0.78 - y) {
            return if y < 0.712 { [1.0, 0.93, 0.74] } else { [0.30, 0.34, 0.32] };
        }
        if (0.78..0.88).contains(&y) && dx.abs() < 0.006 {
            return [0.16, 0.16, 0.16];
        }
        if (0.345..0.385).contains(&y) && (dx.abs() - 0.05).abs() < 0.022 {
            return [0.86, 0.84, 0.80];
        }
        if (0.32..0.345).contains(&y) && dx.abs() < 0.14 {
            return wood(1.25);
        }
        if (0.06..0.32).contains(&y) && dx.abs() < 0.014 || (0.05..0.07).contains(&y) && dx.abs() < 0.07 {
            return [0.18, 0.17, 0.17];
        }
        let chair = dx.abs() - 0.185;
        if chair.abs() < 0.016 && (0.05..0.46).contains(&y)
            || (0.0..0.05).contains(&-chair) && (0.22..0.245).contains(&y)
        {
            return wood(0.62);
        }
    }
    // The counter, and bottles on a board behind it.
    if (0.14..0.40).contains(&y) {
        let panel = (x * 5.0).fract() < 0.06 || y > 0.375;
        return wood(if panel { 0.95 } else { 0.72 });
    }
    if (0.52..0.535).contains(&y) {
        return wood(0.9);
    }
    let column = (x * 18.0) as i32;
    if y >= 0.535 && y < 0.575 + 0.07 * hash(column, half, 92) && (0.2..0.8).contains(&(x * 18.0).fract()) {
        let hue = hash(column, half, 93);
        return [0.24 + 0.3 * hue, 0.40 - 0.12 * hue, 0.26 + 0.1 * hue];
    }
    empty_room([x, y], [0.60, 0.48, 0.34], 0.14)
}

/// A panelled door in a white frame, a fanlight above.
pub(super) fn door(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    if !(0.10..=0.90).contains(&u) || v > 0.955 {
        return ([0.95, 0.94, 0.92], 1.0);
    }
    if v > 0.80 {
        let bar = v < 0.825 || (u - 0.5).abs() < 0.015;
        return if bar { ([0.95, 0.94, 0.92], 1.0) } else { ([0.14, 0.18, 0.22], 0.12) };
    }
    // The tint of the building colours the leaf.
    let base = 0.85 + 0.25 * (value([u, v], [24, 5], 111) - 0.5);
    let mut level = base;
    for [low, high] in [[0.06, 0.34], [0.40, 0.74]] {
        for [left, right] in [[0.18, 0.46], [0.54, 0.82]] {
            if within(at, [left, right], [low, high]) {
                let rim = !within(at, [left + 0.03, right - 0.03], [low + 0.015, high - 0.015]);
                level = if rim { base * 0.62 } else { base * 0.92 };
            }
        }
    }
    if (u - 0.85).abs() < 0.018 && (v - 0.385).abs() < 0.022 {
        return ([0.82, 0.74, 0.50], 0.4);
    }
    if v < 0.03 {
        level *= 0.6;
    }
    ([0.92 * level; 3], 0.7)
}

/// Sectional gate: panels with a row of windows; the tint colours the panels.
pub(super) fn gate(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    if !(0.02..=0.98).contains(&u) || v > 0.985 {
        return grey(0.55);
    }
    let row = (v * 6.0).fract();
    let joint = row < 0.05 || (u * 4.0).fract() < 0.02;
    let cell = (u * 4.0).fract();
    if (0.50..0.84).contains(&v) && (0.10..0.90).contains(&cell) && (0.14..0.86).contains(&row) {
        return ([0.12, 0.15, 0.18], 0.15);
    }
    let panel = (0.08..0.92).contains(&cell) && (0.16..0.88).contains(&row);
    grey(if joint {
        0.62
    } else if panel {
        0.96
    } else {
        0.88
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(u: f32, v: f32) -> f32 {
        windows([u, v]).0[1]
    }

    /// Else specks are left of it where it ends.
    #[test]
    fn the_shade_of_a_cornice_runs_from_end_to_end() {
        for u in [0.28, 0.35, 0.5, 0.65, 0.72, 0.74] {
            assert!(
                level(u, 0.822) < 0.85 * level(u, 0.85),
                "{u}: {} of {}",
                level(u, 0.822),
                level(u, 0.85)
            );
        }
    }

    #[test]
    fn stains_run_from_the_sill_down_to_the_string_course() {
        let darker = |v: f32| level(0.255, v) - level(0.29, v);
        assert!(darker(0.20) > 0.03, "{}", darker(0.20));
        for v in [0.03, 0.048, 0.88, 0.95, 0.99] {
            assert!(darker(v).abs() < 0.035, "{v}: {}", darker(v));
        }
    }
}
