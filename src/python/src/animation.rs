//! Pictures and short animations that notebooks show.

use city3d_render::video::{FrameRate, Video, VideoOutput};
use city3d_render::{Image, encode_png};
use png::{BlendOp, ColorType, Compression, DisposeOp, Encoder, EncodingError};
use pyo3::exceptions::{PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};

/// A picture as PNG.
///
/// # Errors
/// Where the encoder refuses it.
pub fn png_of(image: &Image) -> PyResult<Vec<u8>> {
    encode_png(image).map_err(not_encoded)
}

fn not_encoded(error: EncodingError) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

/// Pictures of a run in equal steps of time. Notebooks show it as an animated PNG.
#[pyclass(module = "city3d", frozen)]
#[derive(Debug)]
pub struct Animation {
    images: Vec<Image>,
    /// Simulated time of a picture, seconds.
    period_s: f64,
    /// Times as fast as it was simulated.
    speed: f64,
}

impl Animation {
    pub fn new(images: Vec<Image>, period_s: f64, speed: f64) -> Self {
        Self { images, period_s, speed }
    }

    fn shown_s(&self) -> f64 {
        self.period_s / self.speed
    }

    /// All pictures in one file, each with only what differs from the one before: a standing camera leaves little.
    fn animated_png(&self) -> Result<Vec<u8>, EncodingError> {
        let mut bytes = Vec::new();
        let Some(first) = self.images.first() else { return Ok(bytes) };
        let mut encoder = Encoder::new(&mut bytes, first.width, first.height);
        encoder.set_color(ColorType::Rgba);
        encoder.set_compression(Compression::Fast);
        encoder.set_animated(self.images.len() as u32, 0)?;
        encoder.set_frame_delay((self.shown_s() * 1000.0).round().clamp(1.0, 60_000.0) as u16, 1000)?;
        encoder.set_dispose_op(DisposeOp::None)?;
        encoder.set_blend_op(BlendOp::Over)?;
        let mut writer = encoder.write_header()?;
        let mut before: Option<&Image> = None;
        for image in &self.images {
            writer.write_image_data(&changes(before, image))?;
            before = Some(image);
        }
        writer.finish()?;
        Ok(bytes)
    }

    fn write_video(&self, path: &Path) -> PyResult<()> {
        let Some(first) = self.images.first() else { return Ok(()) };
        let wrong = |error: city3d_render::video::VideoError| PyOSError::new_err(error.to_string());
        let rate = FrameRate::of_period(self.shown_s());
        let mut video = Video::create(&VideoOutput::Encoded(path.into()), [first.width, first.height], rate)
            .map_err(wrong)?;
        for image in &self.images {
            video.add(image).map_err(wrong)?;
        }
        video.finish().map(drop).map_err(wrong)
    }
}

/// The pixels of a picture that differ from the one before; the others are transparent.
fn changes(before: Option<&Image>, image: &Image) -> Vec<u8> {
    let pixels = image.rgb.as_chunks::<3>().0;
    match before {
        None => pixels.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect(),
        Some(before) => {
            let old = before.rgb.as_chunks::<3>().0;
            let change = |(new, old): (&[u8; 3], &[u8; 3])| match new == old {
                true => [0; 4],
                false => [new[0], new[1], new[2], 255],
            };
            pixels.iter().zip(old).flat_map(change).collect()
        }
    }
}

#[pymethods]
impl Animation {
    fn __len__(&self) -> usize {
        self.images.len()
    }

    /// How long it lasts, seconds.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.shown_s() * self.images.len() as f64
    }

    /// The animation as one PNG, which browsers and notebooks play.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| self.animated_png()).map_err(not_encoded)?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Writes it as an animated PNG, or as a video that ffmpeg encodes, by the name's extension: png, mp4, webm, mkv, mov or avi.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("png") => py.detach(|| {
                let bytes = self.animated_png().map_err(not_encoded)?;
                Ok(city3d_outputs::WholeFile::write(&path, &bytes)?)
            }),
            Some(known) if VideoOutput::ENCODED.contains(&known) => py.detach(|| self.write_video(&path)),
            _ => {
                let known = VideoOutput::ENCODED.join(", ");
                let path = path.display();
                Err(PyValueError::new_err(format!("{path}: animations are written as png, {known}")))
            }
        }
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.png(py)
    }

    fn __repr__(&self) -> String {
        let extent = self.images.first().map_or([0, 0], |image| [image.width, image.height]);
        let (count, [width, height]) = (self.images.len(), extent);
        format!("<city3d.Animation of {count} pictures, {width} x {height}, {:.1} s>", self.duration_s())
    }
}
