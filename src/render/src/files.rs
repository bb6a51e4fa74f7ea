//! Picture file formats: PNG and numpy's `.npy`, one file for each kind; OpenCV and numpy read each with one call.

use super::{Pictures, Plane, RenderError, write_png};
use city3d_outputs::WholeFile;
use city3d_scene::Class;
use city3d_sensors::PictureKind;
use std::io::{BufWriter, IntoInnerError, Write};
use std::path::Path;

/// File format of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PictureFormat {
    /// Colour, PNG of 8 bits a channel, sRGB.
    Rgb,
    /// Depth, 16-bit grey PNG: multiples of `metres_per_count`; 0 where nothing is seen or the depth exceeds the
    /// largest count.
    DepthPng {
        /// City metres of depth that one unit of a pixel value stands for.
        metres_per_count: f64,
    },
    /// Depth, numpy array (`.npy`) of 32-bit floats by row and column: metres, infinite where nothing is seen.
    DepthNpy,
    /// Numbers of [`Class`], grey PNG of 8 bits.
    Semantic,
    /// Numbers of [`Class`] as indices of a palette of [`Class::colour`], PNG of 8 bits.
    SemanticPalette,
    /// Numbers of vehicles, grey PNG of 16 bits, 0 for none.
    Instance,
}

/// File format of optical flow ([`Motion::flow`](super::Motion::flow)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlowFormat {
    /// PNG of KITTI: 16 bits a channel, red and green 64 times the pixels to the right and down, plus 32768; blue 1, or 0
    /// where the flow is not known or is beyond 512 pixels.
    Png,
    /// numpy array (`.npy`) of 32-bit floats by row, column, and right or down: pixels, nan where it is not known.
    Npy,
}

impl FlowFormat {
    /// Extension of the file name, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Npy => "npy",
        }
    }

    /// Writes a picture of flow.
    ///
    /// # Errors
    /// [`RenderError::File`] or [`RenderError::Encoding`] with the path.
    pub fn write(self, path: &Path, flow: &Plane<[f32; 2]>) -> Result<(), RenderError> {
        let extent = [flow.width, flow.height];
        match self {
            Self::Png => {
                let bytes: Vec<u8> = flow.values.iter().flat_map(|pixel| kitti_flow(*pixel)).collect();
                let png =
                    Png { color: ::png::ColorType::Rgb, depth: ::png::BitDepth::Sixteen, palette: None };
                png.write(path, extent, &bytes)
            }
            Self::Npy => write_npy(path, (extent, "2"), flow.values.as_flattened()),
        }
    }
}

/// Six bytes of a pixel of KITTI's flow.
fn kitti_flow(flow: [f32; 2]) -> [u8; 6] {
    let counts = flow.map(|pixels| (f64::from(pixels) * 64.0 + 32_768.0).round());
    let is_known = counts.iter().all(|count| (0.0..=65_535.0).contains(count));
    let [right, down] = counts.map(|count| if is_known { count as u16 } else { 0 });
    let [a, b] = right.to_be_bytes();
    let [c, d] = down.to_be_bytes();
    [a, b, c, d, 0, u8::from(is_known)]
}

impl PictureFormat {
    /// Kind of the pictures that a file of this format holds.
    pub fn kind(self) -> PictureKind {
        match self {
            Self::Rgb => PictureKind::Rgb,
            Self::DepthPng { .. } | Self::DepthNpy => PictureKind::Depth,
            Self::Semantic | Self::SemanticPalette => PictureKind::Semantic,
            Self::Instance => PictureKind::Instance,
        }
    }

    /// Extension of the file name, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::DepthNpy => "npy",
            _ => "png",
        }
    }

    /// Metres per unit of a value in the file, for depth maps.
    pub fn metres_per_value(self) -> Option<f64> {
        match self {
            Self::DepthPng { metres_per_count } => Some(metres_per_count),
            Self::DepthNpy => Some(1.0),
            _ => None,
        }
    }

    /// Writes the picture of this kind, if there is one.
    ///
    /// # Errors
    /// [`RenderError::File`] or [`RenderError::Encoding`] with the path.
    pub fn write(self, path: &Path, pictures: &Pictures) -> Result<(), RenderError> {
        match self {
            Self::Rgb => pictures.rgb.as_ref().map(|image| write_png(path, image)),
            Self::DepthPng { metres_per_count } => {
                pictures.depth.as_ref().map(|plane| write_depth(path, plane, metres_per_count))
            }
            Self::DepthNpy => pictures
                .depth
                .as_ref()
                .map(|plane| write_npy(path, ([plane.width, plane.height], ""), &plane.values)),
            Self::Semantic => pictures.semantic.as_ref().map(|plane| write_classes(path, plane, false)),
            Self::SemanticPalette => pictures.semantic.as_ref().map(|plane| write_classes(path, plane, true)),
            Self::Instance => {
                pictures.instance.as_ref().map(|plane| write_counts(path, plane, |&number| number))
            }
        }
        .unwrap_or(Ok(()))
    }
}

fn write_depth(path: &Path, plane: &Plane<f32>, metres_per_count: f64) -> Result<(), RenderError> {
    write_counts(path, plane, |&depth_m| {
        let counts = (f64::from(depth_m) / metres_per_count).round();
        // 0 means nothing seen, so a depth below half a count becomes 1.
        if counts <= f64::from(u16::MAX) { counts.max(1.0) as u16 } else { 0 }
    })
}

fn write_counts<T>(path: &Path, plane: &Plane<T>, count: impl Fn(&T) -> u16) -> Result<(), RenderError> {
    let bytes: Vec<u8> = plane.values.iter().flat_map(|value| count(value).to_be_bytes()).collect();
    let png = Png { color: ::png::ColorType::Grayscale, depth: ::png::BitDepth::Sixteen, palette: None };
    png.write(path, [plane.width, plane.height], &bytes)
}

fn write_classes(path: &Path, plane: &Plane<u8>, with_palette: bool) -> Result<(), RenderError> {
    let png = if with_palette {
        let palette = Class::ALL.into_iter().flat_map(Class::colour).collect();
        Png { color: ::png::ColorType::Indexed, depth: ::png::BitDepth::Eight, palette: Some(palette) }
    } else {
        Png { color: ::png::ColorType::Grayscale, depth: ::png::BitDepth::Eight, palette: None }
    };
    png.write(path, [plane.width, plane.height], &plane.values)
}

struct Png {
    color: ::png::ColorType,
    depth: ::png::BitDepth,
    palette: Option<Vec<u8>>,
}

impl Png {
    fn write(self, path: &Path, [width, height]: [u32; 2], bytes: &[u8]) -> Result<(), RenderError> {
        let at = |source| RenderError::File { path: path.to_owned(), source };
        let encoding = |source| RenderError::Encoding { path: path.to_owned(), source };
        let mut file = BufWriter::new(WholeFile::create(path).map_err(at)?);
        let mut encoder = ::png::Encoder::new(&mut file, width, height);
        encoder.set_color(self.color);
        encoder.set_depth(self.depth);
        encoder.set_compression(::png::Compression::Fast);
        if let Some(palette) = self.palette {
            encoder.set_palette(palette);
        }
        let mut writer = encoder.write_header().map_err(encoding)?;
        writer.write_image_data(bytes).map_err(encoding)?;
        writer.finish().map_err(encoding)?;
        file.into_inner().map_err(IntoInnerError::into_error).and_then(WholeFile::commit).map_err(at)
    }
}

/// Writes format 1.0 of numpy's arrays (numpy.lib.format) of a picture, whose pixels may have a further dimension.
fn write_npy(
    path: &Path,
    ([width, height], inner): ([u32; 2], &str),
    values: &[f32],
) -> Result<(), RenderError> {
    let at = |source| RenderError::File { path: path.to_owned(), source };
    let mut file = BufWriter::new(WholeFile::create(path).map_err(at)?);
    let inner = if inner.is_empty() { String::new() } else { format!(", {inner}") };
    let mut header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}{inner}), }}");
    const BEFORE: usize = 10;
    // The data begin at a multiple of 64 bytes.
    let end = (BEFORE + header.len() + 1).next_multiple_of(64);
    header.push_str(&" ".repeat(end - BEFORE - header.len() - 1));
    header.push('\n');
    let length = (header.len() as u16).to_le_bytes();
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    for part in [b"\x93NUMPY\x01\x00".as_slice(), &length, header.as_bytes(), &bytes] {
        file.write_all(part).map_err(at)?;
    }
    file.into_inner().map_err(IntoInnerError::into_error).and_then(WholeFile::commit).map_err(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane<T>(values: Vec<T>) -> Plane<T> {
        Plane { width: 3, height: 2, values }
    }

    fn written(format: PictureFormat, pictures: &Pictures) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture");
        format.write(&path, pictures).unwrap();
        std::fs::read(&path).unwrap()
    }

    #[test]
    fn depth_is_counted_and_what_cannot_be_counted_is_nothing() {
        let metres = vec![0.001, 1.0, 2.249, 655.35, 655.36, f32::INFINITY];
        let pictures = Pictures { depth: Some(plane(metres.clone())), ..Pictures::default() };
        let png = written(PictureFormat::DepthPng { metres_per_count: 0.01 }, &pictures);
        let counts = ::image::load_from_memory(&png).unwrap();
        assert_eq!(counts.color(), ::image::ColorType::L16);
        assert_eq!(counts.into_luma16().into_raw(), [1, 100, 225, 65_535, 0, 0]);
        let npy = written(PictureFormat::DepthNpy, &pictures);
        assert_eq!(npy.len(), 128 + 6 * 4);
        assert!(npy.starts_with(b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4'") && npy[127] == b'\n');
        let floats: Vec<f32> =
            npy[128..].chunks(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        assert_eq!(floats, metres);
    }

    #[test]
    fn flow_is_counted_as_kitti_does_and_what_is_not_known_is_marked() {
        let flow =
            plane(vec![[0.0, 0.0], [1.5, -2.0], [f32::NAN; 2], [511.9, 0.0], [600.0, 0.0], [-512.0, 0.25]]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flow");
        FlowFormat::Png.write(&path, &flow).unwrap();
        let png = ::image::load_from_memory(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(png.color(), ::image::ColorType::Rgb16);
        let counts = png.into_rgb16().into_raw();
        let expected: [[u16; 3]; 6] = [
            [32_768, 32_768, 1],
            [32_864, 32_640, 1],
            [0, 0, 0],
            [65_530, 32_768, 1],
            [0, 0, 0],
            [0, 32_784, 1],
        ];
        assert_eq!(counts, expected.as_flattened());
        FlowFormat::Npy.write(&path, &flow).unwrap();
        let npy = std::fs::read(&path).unwrap();
        let header = String::from_utf8_lossy(&npy[10..128]);
        assert!(header.contains("'shape': (2, 3, 2)") && npy.len() == 128 + 12 * 4, "{header}");
        assert_eq!(npy[128 + 8..128 + 16], [1.5_f32.to_le_bytes(), (-2.0_f32).to_le_bytes()].concat());
    }

    #[test]
    fn classes_and_vehicles_keep_their_numbers() {
        let pictures = Pictures {
            semantic: Some(plane(vec![0, 1, 2, 5, 10, 11])),
            instance: Some(plane(vec![0, 1, 2, 256, 65_534, 65_535])),
            ..Pictures::default()
        };
        let grey = ::image::load_from_memory(&written(PictureFormat::Semantic, &pictures)).unwrap();
        assert_eq!(grey.color(), ::image::ColorType::L8);
        assert_eq!(grey.into_luma8().into_raw(), [0, 1, 2, 5, 10, 11]);
        let numbers = ::image::load_from_memory(&written(PictureFormat::Instance, &pictures)).unwrap();
        assert_eq!(numbers.into_luma16().into_raw(), [0, 1, 2, 256, 65_534, 65_535]);
        let indexed = written(PictureFormat::SemanticPalette, &pictures);
        let colours = ::image::load_from_memory(&indexed).unwrap().into_rgb8();
        assert_eq!(colours.get_pixel(2, 1).0, Class::Vehicle.colour());
        let mut reader = ::png::Decoder::new(std::io::Cursor::new(indexed)).read_info().unwrap();
        assert_eq!(reader.info().color_type, ::png::ColorType::Indexed);
        let mut indices = vec![0; 6];
        reader.next_frame(&mut indices).unwrap();
        assert_eq!(indices, [0, 1, 2, 5, 10, 11]);
    }
}
