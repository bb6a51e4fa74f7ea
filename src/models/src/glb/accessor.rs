//! Reads glTF accessors, checked against the length of the buffer.

use super::read::ModelError;
use gltf::accessor::{DataType, Dimensions};

/// The required layout of an accessor.
#[derive(Clone, Copy, Debug)]
pub(super) struct AccessorSpec {
    /// "POSITION" or "indices".
    pub(super) what: &'static str,
    /// Least and largest number of components.
    pub(super) numbers: [usize; 2],
    /// Whether integers are normalised.
    pub(super) whole_are_parts: bool,
}

fn bytes_of(kind: DataType) -> usize {
    match kind {
        DataType::I8 | DataType::U8 => 1,
        DataType::I16 | DataType::U16 => 2,
        DataType::U32 | DataType::F32 => 4,
    }
}

/// All elements with at least the required components; further ones are dropped. The caller limits their count.
pub(super) fn numbers<const N: usize>(
    accessor: &gltf::Accessor<'_>,
    blob: &[u8],
    wanted: AccessorSpec,
) -> Result<Vec<[f32; N]>, ModelError> {
    let AccessorSpec { what, numbers: [least, most], whole_are_parts } = wanted;
    let index = accessor.index();
    let fail = |message: String, remedy: &'static str| ModelError {
        place: format!("accessor {index} ({what})"),
        message,
        remedy,
    };
    let dimensions = match accessor.dimensions() {
        Dimensions::Scalar => 1,
        Dimensions::Vec2 => 2,
        Dimensions::Vec3 => 3,
        Dimensions::Vec4 => 4,
        _ => 0,
    };
    if !(least..=most).contains(&dimensions) {
        let message = format!("elements of type {:?}", accessor.dimensions());
        return Err(fail(message, "export it as the glTF specification requires"));
    }
    if accessor.sparse().is_some() {
        return Err(fail("a sparse accessor".to_owned(), "export without sparse accessors"));
    }
    let count = accessor.count();
    let Some(view) = accessor.view() else {
        return Ok(vec![[0.0; N]; count]);
    };
    if view.buffer().index() > 0 || !matches!(view.buffer().source(), gltf::buffer::Source::Bin) {
        return Err(fail(
            "its numbers lie in another file".to_owned(),
            "save as .glb, with everything in one file",
        ));
    }
    let kind = accessor.data_type();
    let size = bytes_of(kind) * dimensions;
    let stride = view.stride().unwrap_or(size);
    // Checked arithmetic: all numbers come from the file.
    let span = count.checked_sub(1).map_or(Some(0), |gaps| gaps.checked_mul(stride)?.checked_add(size));
    let end = span.and_then(|span| accessor.offset().checked_add(span));
    if stride < size || end.is_none_or(|end| end > view.length()) {
        let message = format!("{count} elements do not fit into the {} bytes of its view", view.length());
        return Err(fail(message, "the file is damaged: export it again"));
    }
    let from = view.offset();
    let Some(bytes) = from.checked_add(view.length()).and_then(|to| blob.get(from..to)) else {
        let message = format!("its view reaches beyond the {} bytes of the file's binary part", blob.len());
        return Err(fail(message, "the file is damaged or cut off: export it again"));
    };
    let part = |value: f32, largest: f32| if whole_are_parts { (value / largest).max(-1.0) } else { value };
    let number = |at: usize| -> f32 {
        let byte = |k: usize| bytes.get(at + k).copied().unwrap_or_default();
        match kind {
            DataType::I8 => part(f32::from(byte(0) as i8), 127.0),
            DataType::U8 => part(f32::from(byte(0)), 255.0),
            DataType::I16 => part(f32::from(i16::from_le_bytes([byte(0), byte(1)])), 32_767.0),
            DataType::U16 => part(f32::from(u16::from_le_bytes([byte(0), byte(1)])), 65_535.0),
            DataType::U32 => u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]) as f32,
            DataType::F32 => f32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]),
        }
    };
    let element = |k: usize| {
        let base = accessor.offset() + k * stride;
        std::array::from_fn(|j| if j < dimensions { number(base + j * bytes_of(kind)) } else { 1.0 })
    };
    let all: Vec<[f32; N]> = (0..count).map(element).collect();
    if let Some(k) = all.iter().position(|element| element.iter().any(|x| !x.is_finite())) {
        return Err(fail(format!("element {k} is not finite"), "the file is damaged: export it again"));
    }
    Ok(all)
}
