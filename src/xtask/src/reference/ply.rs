//! Triangle meshes as binary PLY files (Turk 1994), with normals, texture coordinates and linear colours.

use super::Group;
use std::io;
use std::path::Path;

/// Writes a group. The properties have the names that Mitsuba's plugin `ply` looks for.
pub(super) fn write(path: &Path, group: &Group) -> io::Result<()> {
    std::fs::write(path, bytes(group))
}

fn bytes(group: &Group) -> Vec<u8> {
    let Group { vertices, indices } = group;
    let properties: String = ["x", "y", "z", "nx", "ny", "nz", "u", "v", "r", "g", "b"]
        .map(|name| format!("property float {name}\n"))
        .concat();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{properties}element face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        indices.len() / 3
    );
    let mut bytes = header.into_bytes();
    for vertex in vertices {
        let floats = vertex.position.to_array().into_iter().chain(vertex.normal.to_array());
        let floats = floats.chain(vertex.uv.to_array()).chain(vertex.colour);
        bytes.extend(floats.flat_map(f32::to_le_bytes));
    }
    for triangle in indices.chunks_exact(3) {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|index| index.to_le_bytes()));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::super::geometry::ExportVertex;
    use super::*;
    use glam::{Vec2, Vec3};

    #[test]
    fn a_triangle_takes_the_bytes_that_the_header_says() {
        let vertex =
            ExportVertex { position: Vec3::X, normal: Vec3::Z, uv: Vec2::ONE, colour: [0.25, 0.5, 1.0] };
        let group = Group { vertices: vec![vertex; 3], indices: vec![0, 1, 2] };
        let bytes = bytes(&group);
        let end = b"end_header\n";
        let at = bytes.windows(end.len()).position(|window| window == end).expect("a header") + end.len();
        assert_eq!(bytes.len() - at, 3 * 11 * 4 + 1 + 3 * 4);
        assert!(bytes[at..].starts_with(&1.0_f32.to_le_bytes()));
        assert_eq!(bytes[bytes.len() - 13..], [3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    }
}
