//! Which kinds of pictures are taken, and what files they become.

use crate::camera::{Kinds, PictureKind};
use crate::render::Format;
use clap::{Args, ValueEnum};

#[derive(Debug, Args)]
pub(super) struct KindArgs {
    /// Kinds of pictures, with commas between them; without it those of the scenario's sensors, and of
    /// cameras of the command line rgb
    #[arg(long, value_name = "KIND", value_delimiter = ',')]
    kind: Vec<Kind>,
    /// How depth is written
    #[arg(long, value_name = "FORMAT", default_value = "png")]
    depth_format: DepthFormat,
    /// Metres for one count of a depth PNG
    #[arg(long, value_name = "M", default_value_t = 1.0 / 256.0, value_parser = metres)]
    depth_scale: f64,
    /// Give pictures of classes a palette: they look coloured, and their indices are the classes
    #[arg(long)]
    palette: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Colour
    Rgb,
    /// Metres along the optical axis
    Depth,
    /// Numbers of classes: docs/cameras.md lists them
    Semantic,
    /// Numbers of vehicles, 0 for none
    Instance,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DepthFormat {
    /// 16 bits: counts of --depth-scale, 0 for the sky and beyond 65535 counts
    Png,
    /// Exact: .npy of numpy with 32-bit floats in metres, infinite for the sky
    F32,
}

fn metres(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(metres) if (1e-6..=1.0).contains(&metres) => Ok(metres),
        _ => Err("metres from 0.000001 to 1 are needed".to_owned()),
    }
}

impl From<Kind> for PictureKind {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Rgb => Self::Rgb,
            Kind::Depth => Self::Depth,
            Kind::Semantic => Self::Semantic,
            Kind::Instance => Self::Instance,
        }
    }
}

impl KindArgs {
    /// Those that the command line states.
    pub(super) fn stated(&self) -> Option<Kinds> {
        (!self.kind.is_empty()).then(|| self.kind.iter().copied().map(PictureKind::from).collect())
    }

    pub(super) fn format(&self, kind: PictureKind) -> Format {
        match kind {
            PictureKind::Rgb => Format::Rgb,
            PictureKind::Depth => match self.depth_format {
                DepthFormat::Png => Format::DepthPng { metres_per_count: self.depth_scale },
                DepthFormat::F32 => Format::DepthNpy,
            },
            PictureKind::Semantic if self.palette => Format::SemanticPalette,
            PictureKind::Semantic => Format::Semantic,
            PictureKind::Instance => Format::Instance,
        }
    }
}

/// Colours keep the plain name, the others say what they are.
pub(super) fn file_name(stem: &str, format: Format) -> String {
    match format.kind() {
        PictureKind::Rgb => format!("{stem}.{}", format.extension()),
        kind => format!("{stem}_{}.{}", kind.name(), format.extension()),
    }
}
