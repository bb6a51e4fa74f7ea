//! The destination of `--out`: a folder for pictures, or a video.

use super::super::Failure;
use super::super::overwrite::OverwriteArgs;
use city3d_outputs::{OutputFolder, refuse_inputs};
use city3d_render::video::{VideoError, VideoOutput};
use city3d_render::{BoxTable, PictureTable};
use std::path::{Path, PathBuf};

/// Extensions that are not written; they must not become folder names.
const OTHERS: [&str; 9] = ["gif", "png", "jpg", "jpeg", "mpg", "mpeg", "wmv", "flv", "ogv"];

/// The destination of `--out`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Destination {
    Folder(PathBuf),
    Video(VideoOutput),
}

/// A destination that may be written: a folder is locked.
#[derive(Debug)]
pub(super) enum ClaimedDestination {
    Folder(OutputFolder),
    Video(VideoOutput),
}

impl Destination {
    /// Chooses by extension and by an existing folder.
    ///
    /// # Errors
    /// The permitted values, for other files.
    pub(super) fn of(out: &Path) -> Result<Self, String> {
        let extension = out.extension().and_then(|text| text.to_str()).unwrap_or_default().to_lowercase();
        Ok(match extension.as_str() {
            _ if out.as_os_str() == "-" => Self::Video(VideoOutput::Stdout),
            _ if out.is_dir() => Self::Folder(out.to_owned()),
            "y4m" => Self::Video(VideoOutput::Y4m(out.to_owned())),
            known if VideoOutput::ENCODED.contains(&known) => {
                Self::Video(VideoOutput::Encoded(out.to_owned()))
            }
            other if OTHERS.contains(&other) => {
                return Err(format!(
                    "--out {}: the format .{other} is not supported; give a folder for pictures, or a video: .y4m, or \
                     with ffmpeg .{}",
                    out.display(),
                    VideoOutput::ENCODED.join(", .")
                ));
            }
            _ => Self::Folder(out.to_owned()),
        })
    }

    /// Locks a folder for pictures. Refuses to overwrite inputs, and pictures or videos of an earlier command.
    pub(super) fn claim(
        &self,
        overwrite: OverwriteArgs,
        inputs: &[PathBuf],
    ) -> Result<ClaimedDestination, Failure> {
        match self {
            Self::Folder(folder) => {
                let tables = [PictureTable::FILE, BoxTable::FILE];
                refuse_inputs(inputs, tables.map(|table| folder.join(table)))?;
                let locked = OutputFolder::open(folder)?;
                overwrite.policy().check_files(folder, &tables)?;
                Ok(ClaimedDestination::Folder(locked))
            }
            Self::Video(output) => {
                if let VideoOutput::Y4m(file) | VideoOutput::Encoded(file) = output {
                    refuse_inputs(inputs, [file.clone()])?;
                    overwrite.policy().check_file(file)?;
                }
                Ok(ClaimedDestination::Video(output.clone()))
            }
        }
    }
}

impl From<VideoError> for Failure {
    fn from(error: VideoError) -> Self {
        match &error {
            VideoError::NoFfmpeg { path } => Self::failed(format!(
                "{error}, or write a stream without it: --out {}",
                path.with_extension("y4m").display()
            )),
            _ => Self::failed(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_pictures_go_is_told_by_the_name() {
        let of = |out: &str| Destination::of(Path::new(out)).unwrap();
        assert_eq!(of("-"), Destination::Video(VideoOutput::Stdout));
        assert_eq!(of("out/run.mp4"), Destination::Video(VideoOutput::Encoded("out/run.mp4".into())));
        assert_eq!(of("RUN.MKV"), Destination::Video(VideoOutput::Encoded("RUN.MKV".into())));
        assert_eq!(of("run.y4m"), Destination::Video(VideoOutput::Y4m("run.y4m".into())));
        assert_eq!(of("out/pictures"), Destination::Folder("out/pictures".into()));
        assert_eq!(of("v1.2"), Destination::Folder("v1.2".into()));
        let wrong = Destination::of(Path::new("out/run.gif")).unwrap_err();
        assert!(wrong.contains("run.gif") && wrong.contains(".mp4"), "{wrong}");
        let folder = tempfile::tempdir().unwrap();
        let named = folder.path().join("run.mp4");
        std::fs::create_dir(&named).unwrap();
        assert_eq!(Destination::of(&named), Ok(Destination::Folder(named.clone())));
    }
}
