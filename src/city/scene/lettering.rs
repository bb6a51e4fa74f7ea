//! Names on boards: letters are cells of one texture, drawn from grids of five by seven.

use super::mesh::{Finish, Mesh, Surface};
use glam::{Vec2, Vec3};

/// Rows of A to Z and 0 to 9 from the top, five bits each, the highest on the left.
const GLYPHS: [[u8; 7]; 36] = [
    [14, 17, 17, 31, 17, 17, 17],
    [30, 17, 17, 30, 17, 17, 30],
    [14, 17, 16, 16, 16, 17, 14],
    [30, 17, 17, 17, 17, 17, 30],
    [31, 16, 16, 30, 16, 16, 31],
    [31, 16, 16, 30, 16, 16, 16],
    [14, 17, 16, 23, 17, 17, 14],
    [17, 17, 17, 31, 17, 17, 17],
    [14, 4, 4, 4, 4, 4, 14],
    [7, 2, 2, 2, 2, 18, 12],
    [17, 18, 20, 24, 20, 18, 17],
    [16, 16, 16, 16, 16, 16, 31],
    [17, 27, 21, 21, 17, 17, 17],
    [17, 25, 21, 19, 17, 17, 17],
    [14, 17, 17, 17, 17, 17, 14],
    [30, 17, 17, 30, 16, 16, 16],
    [14, 17, 17, 17, 21, 18, 13],
    [30, 17, 17, 30, 20, 18, 17],
    [15, 16, 16, 14, 1, 1, 30],
    [31, 4, 4, 4, 4, 4, 4],
    [17, 17, 17, 17, 17, 17, 14],
    [17, 17, 17, 17, 17, 10, 4],
    [17, 17, 17, 21, 21, 27, 17],
    [17, 17, 10, 4, 10, 17, 17],
    [17, 17, 10, 4, 4, 4, 4],
    [31, 1, 2, 4, 8, 16, 31],
    [14, 17, 19, 21, 25, 17, 14],
    [4, 12, 4, 4, 4, 4, 14],
    [14, 17, 1, 2, 4, 8, 31],
    [30, 1, 1, 14, 1, 1, 30],
    [2, 6, 10, 18, 31, 2, 2],
    [31, 16, 30, 1, 1, 17, 14],
    [14, 16, 16, 30, 17, 17, 14],
    [31, 1, 2, 4, 4, 4, 4],
    [14, 17, 17, 14, 17, 17, 14],
    [14, 17, 17, 15, 1, 1, 14],
];

/// Cells along and up the layer of [`Surface::Letters`].
const CELLS: [usize; 2] = [8, 5];

/// The letter drawn at a place of the layer and where in its cell that is.
pub fn glyph_cell([u, v]: [f32; 2]) -> Option<([u8; 7], [f32; 2])> {
    let (x, y) = (u * CELLS[0] as f32, v * CELLS[1] as f32);
    let index = y.floor() as usize * CELLS[0] + x.floor() as usize;
    GLYPHS.get(index).map(|rows| (*rows, [x.fract(), y.fract()]))
}

fn index_of(letter: char) -> Option<usize> {
    match letter.to_ascii_uppercase() {
        letter @ 'A'..='Z' => Some(letter as usize - 'A' as usize),
        digit @ '0'..='9' => Some(26 + digit as usize - '0' as usize),
        _ => None,
    }
}

/// Width of a text for a height of its letters.
pub(super) fn width_of(text: &str, height: f32) -> f32 {
    text.chars().count() as f32 * 6.0 * height / 7.0
}

/// Writes a text with the middle of its line at `centre` on a board of a colour; `across` is where
/// readers' right is, unit. Letters lie in the board's plane and need it behind them.
pub(super) fn write(mesh: &mut Mesh, text: &str, centre: Vec3, across: Vec3, height: f32, board: Finish) {
    let finish = Finish { surface: Surface::Letters, ..board };
    let unit = height / 7.0;
    let start = centre - across * (width_of(text, height) / 2.0) - Vec3::Z * (4.5 * unit);
    for (k, letter) in text.chars().enumerate() {
        let Some(index) = index_of(letter) else { continue };
        let corner = start + across * (k as f32 * 6.0 * unit);
        let (right, up) = (across * (6.0 * unit), Vec3::Z * (9.0 * unit));
        let cell = Vec2::new((index % CELLS[0]) as f32, (index / CELLS[0]) as f32);
        let size = Vec2::new(CELLS[0] as f32, CELLS[1] as f32);
        // A little inside the cell, so that neighbours do not bleed in.
        let uv = |x: f32, y: f32| (cell + Vec2::new(0.03 + 0.94 * x, 0.03 + 0.94 * y)) / size;
        mesh.face(
            &[corner, corner + right, corner + right + up, corner + up],
            &[uv(0.0, 0.0), uv(1.0, 0.0), uv(1.0, 1.0), uv(0.0, 1.0)],
            finish,
        );
    }
}
