//! Options for the kinds of pictures, and their file formats.

use city3d_render::{FlowFormat, PictureFormat};
use city3d_sensors::{PictureKind, PictureKinds};
use clap::{Args, ValueEnum};

#[derive(Debug, Args)]
pub(super) struct KindArgs {
    /// Kinds of pictures, separated by commas [default: those of the scenario's sensors; rgb for a --camera]
    #[arg(long, value_name = "KIND", value_delimiter = ',')]
    kind: Vec<KindArg>,
    /// File format of depth pictures
    #[arg(long, value_name = "FORMAT", default_value = "png")]
    depth_format: DepthFormat,
    /// Metres per count of a depth PNG
    #[arg(long, value_name = "M", default_value_t = 1.0 / 256.0, value_parser = metres)]
    depth_scale: f64,
    /// Write semantic pictures with a colour palette, whose indices are the classes
    #[arg(long)]
    palette: bool,
    /// Write the optical flow of each picture since the one before of the same camera, too
    #[arg(long, value_name = "FORMAT", num_args = 0..=1, require_equals = true, default_missing_value = "png")]
    flow: Option<FlowArg>,
    /// Write boxes.csv with the boxes of the vehicles in each picture, in 3D and in pixels
    #[arg(long)]
    pub(super) boxes: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FlowArg {
    /// KITTI's PNG: 64 counts a pixel
    Png,
    /// NumPy file (.npy) of 32-bit floats in pixels, nan where the flow is not known
    F32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum KindArg {
    /// Colour
    Rgb,
    /// Metres along the optical axis
    Depth,
    /// Class number of each pixel; docs/cameras.md lists the classes
    Semantic,
    /// Vehicle id of each pixel, 0 where there is no vehicle
    Instance,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DepthFormat {
    /// 16 bits: counts of --depth-scale, 0 for the sky and beyond 65535 counts
    Png,
    /// NumPy file (.npy) of 32-bit floats in metres, infinite for the sky
    F32,
}

fn metres(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(metres) if (1e-6..=1.0).contains(&metres) => Ok(metres),
        _ => Err("metres from 0.000001 to 1 are needed".to_owned()),
    }
}

impl From<KindArg> for PictureKind {
    fn from(kind: KindArg) -> Self {
        match kind {
            KindArg::Rgb => Self::Rgb,
            KindArg::Depth => Self::Depth,
            KindArg::Semantic => Self::Semantic,
            KindArg::Instance => Self::Instance,
        }
    }
}

impl KindArgs {
    /// The kinds of the command line, if it states some.
    pub(super) fn overrides(&self) -> Option<PictureKinds> {
        (!self.kind.is_empty()).then(|| self.kind.iter().copied().map(PictureKind::from).collect())
    }

    /// The format of optical flow, if it is wanted.
    pub(super) fn flow_format(&self) -> Option<FlowFormat> {
        self.flow.map(|flow| match flow {
            FlowArg::Png => FlowFormat::Png,
            FlowArg::F32 => FlowFormat::Npy,
        })
    }

    /// What a video cannot hold, if something of it is wanted.
    pub(super) fn beside_pictures(&self) -> Option<&'static str> {
        match (self.flow, self.boxes) {
            (Some(_), _) => Some("--flow"),
            (None, true) => Some("--boxes"),
            (None, false) => None,
        }
    }

    pub(super) fn format(&self, kind: PictureKind) -> PictureFormat {
        match kind {
            PictureKind::Rgb => PictureFormat::Rgb,
            PictureKind::Depth => match self.depth_format {
                DepthFormat::Png => PictureFormat::DepthPng { metres_per_count: self.depth_scale },
                DepthFormat::F32 => PictureFormat::DepthNpy,
            },
            PictureKind::Semantic if self.palette => PictureFormat::SemanticPalette,
            PictureKind::Semantic => PictureFormat::Semantic,
            PictureKind::Instance => PictureFormat::Instance,
        }
    }
}

/// The file name; kinds other than rgb add their name.
pub(super) fn file_name(stem: &str, format: PictureFormat) -> String {
    match format.kind() {
        PictureKind::Rgb => format!("{stem}.{}", format.extension()),
        kind => format!("{stem}_{}.{}", kind.name(), format.extension()),
    }
}
