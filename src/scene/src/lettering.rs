//! Lettering of boards: glyphs are cells of one texture atlas, drawn from bitmaps of five by seven.

use super::mesh::{Finish, Mesh, Surface};
use glam::{Vec2, Vec3};

/// Glyph rows of A to Z and 0 to 9 from the top, five bits each, the highest on the left.
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

/// Atlas cells along and up the layer of [`Surface::Letters`].
const CELLS: [usize; 2] = [8, 5];

/// The glyph at a texture coordinate, and the position inside its cell.
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

/// The first and the last set column of a glyph.
fn columns_of(index: usize) -> [usize; 2] {
    let set = GLYPHS[index].iter().fold(0, |set, row| set | row);
    [set.leading_zeros() as usize - 3, 4 - set.trailing_zeros() as usize]
}

/// Advance of a space, in columns.
const SPACE: f32 = 4.0;

/// Advance of a glyph, in columns.
fn advance(letter: char) -> f32 {
    index_of(letter).map(columns_of).map_or(SPACE, |[first, last]| (last - first) as f32 + 2.0)
}

/// Width of a text for a height of its letters.
pub(super) fn width_of(text: &str, height: f32) -> f32 {
    text.chars().map(advance).sum::<f32>() * height / 7.0
}

/// Half the height of a board for a letter height.
pub(super) fn half_board(height: f32) -> f32 {
    4.5 * height / 7.0
}

/// Letter height on a board of a height.
pub(super) fn letters_on(board: f32) -> f32 {
    board / (2.0 * half_board(1.0))
}

/// Draws the face of a board with centred text at `centre`; `across` is the reading direction, unit length.
/// Board width and letter height in metres.
pub(super) fn write(
    mesh: &mut Mesh,
    text: &str,
    centre: Vec3,
    across: Vec3,
    [width, height]: [f32; 2],
    board: Finish,
) {
    let finish = Finish { surface: Surface::Letters, ..board };
    let unit = height / 7.0;
    let cells = Vec2::new(CELLS[0] as f32, CELLS[1] as f32);
    // Uses a cell per position, also empty ones, so that lighting varies evenly.
    let empty = Vec2::new(GLYPHS.len() as f32 % cells.x, (GLYPHS.len() / CELLS[0]) as f32) + 0.5;
    let mut face = |from: f32, to: f32, cell: Option<usize>| {
        let at = |x: f32, up: f32| centre + across * x + Vec3::Z * (up * half_board(height));
        let uvs = match cell {
            None => [empty / cells; 4],
            Some(index) => {
                let [first, last] = columns_of(index).map(|column| column as f32);
                let corner = Vec2::new((index % CELLS[0]) as f32, (index / CELLS[0]) as f32);
                // Inset, so that neighbouring cells do not bleed in.
                let uv =
                    |x: f32, y: f32| (corner + Vec2::new(x / 6.0, y).map(|part| 0.03 + 0.94 * part)) / cells;
                [uv(first, 0.0), uv(last + 2.0, 0.0), uv(last + 2.0, 1.0), uv(first, 1.0)]
            }
        };
        mesh.face(&[at(from, -1.0), at(to, -1.0), at(to, 1.0), at(from, 1.0)], &uvs, finish);
    };
    let mut x = -width_of(text, height) / 2.0;
    face(-width / 2.0, x, None);
    for letter in text.chars() {
        let next = x + advance(letter) * unit;
        face(x, next, index_of(letter));
        x = next;
    }
    face(x, width / 2.0, None);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_take_the_room_they_need() {
        assert_eq!([columns_of(0), columns_of(8), columns_of(27)], [[0, 4], [1, 3], [1, 3]]);
        assert!((width_of("OIO", 7.0) - 16.0).abs() < 1e-6 && (width_of("O O", 7.0) - 16.0).abs() < 1e-6);
    }

    #[test]
    fn a_board_is_covered_from_end_to_end() {
        let mut mesh = Mesh::default();
        let board = Finish::new(Surface::Plain, [200; 3], super::super::Class::Wall);
        write(&mut mesh, "NO 7", Vec3::ZERO, Vec3::X, [3.0, 0.4], board);
        let area: f32 = mesh
            .indices
            .chunks_exact(3)
            .map(|t| [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position))
            .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
            .sum();
        assert!((area - 3.0 * 2.0 * half_board(0.4)).abs() < 1e-5, "{area}");
        // The empty cells have no letter.
        let empty = mesh.vertices[0].uv;
        assert!(glyph_cell(empty.to_array()).is_none(), "{empty}");
    }
}
