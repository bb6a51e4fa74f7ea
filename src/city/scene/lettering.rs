//! Signs: names in capitals of five by seven cells, as flat faces on a wall.

use super::mesh::{Finish, Mesh};
use glam::{Vec2, Vec3};

/// Rows of A to Z from the top, five bits each, the highest on the left.
const CAPITALS: [[u8; 7]; 26] = [
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
];

/// Cells from one letter to the next.
const PITCH: f32 = 6.0;

/// Width of a text for a height of its letters.
pub(super) fn width_of(text: &str, height: f32) -> f32 {
    (text.chars().count() as f32 * PITCH - 1.0) * height / 7.0
}

/// Writes a text with the middle of its line at `centre`; `across` is where readers' right is, unit.
pub(super) fn write(mesh: &mut Mesh, text: &str, centre: Vec3, across: Vec3, height: f32, finish: Finish) {
    let cell = height / 7.0;
    let start = centre - across * (width_of(text, height) / 2.0) + Vec3::Z * (height / 2.0);
    for (k, letter) in text.chars().enumerate() {
        let Some(rows) = letter
            .to_ascii_uppercase()
            .is_ascii_uppercase()
            .then(|| &CAPITALS[(letter.to_ascii_uppercase() as u8 - b'A') as usize])
        else {
            continue;
        };
        let corner = start + across * (k as f32 * PITCH * cell);
        for (row, bits) in (0_u8..).zip(rows) {
            let mut column = 0;
            while column < 5 {
                let set = |c: u8| bits >> (4 - c) & 1 == 1;
                if !set(column) {
                    column += 1;
                    continue;
                }
                let first = column;
                while column < 5 && set(column) {
                    column += 1;
                }
                let left = corner + across * (f32::from(first) * cell) - Vec3::Z * (f32::from(row) * cell);
                let right = across * (f32::from(column - first) * cell);
                let down = -Vec3::Z * cell;
                mesh.face(&[left + down, left + down + right, left + right, left], &[Vec2::ZERO; 4], finish);
            }
        }
    }
}
