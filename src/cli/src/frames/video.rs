//! Video output: a Y4M stream to standard output or to a file, or a file that ffmpeg encodes.

use super::super::Failure;
use super::super::overwrite::OverwriteArgs;
use super::y4m::{self, FrameRate};
use city3d_render::Image;
use std::fs::File;
use std::io::{self, BufWriter, Read, Stdout, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

/// Extensions of files that ffmpeg encodes.
const ENCODED: [&str; 5] = ["mp4", "webm", "mkv", "mov", "avi"];

/// Extensions that are not written; they must not become folder names.
const OTHERS: [&str; 9] = ["gif", "png", "jpg", "jpeg", "mpg", "mpeg", "wmv", "flv", "ogv"];

/// The destination of `--out`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Destination {
    Folder(PathBuf),
    Stdout,
    Y4m(PathBuf),
    Encoded(PathBuf),
}

impl Destination {
    /// Chooses by extension and by an existing folder.
    ///
    /// # Errors
    /// The permitted values, for other files.
    pub(super) fn of(out: &Path) -> Result<Self, String> {
        let extension = out.extension().and_then(|text| text.to_str()).unwrap_or_default().to_lowercase();
        Ok(match extension.as_str() {
            _ if out.as_os_str() == "-" => Self::Stdout,
            _ if out.is_dir() => Self::Folder(out.to_owned()),
            "y4m" => Self::Y4m(out.to_owned()),
            known if ENCODED.contains(&known) => Self::Encoded(out.to_owned()),
            other if OTHERS.contains(&other) => {
                return Err(format!(
                    "--out {}: the format .{other} is not supported; give a folder for pictures, or a video: .y4m, or \
                     with ffmpeg .{}",
                    out.display(),
                    ENCODED.join(", .")
                ));
            }
            _ => Self::Folder(out.to_owned()),
        })
    }
}

impl Destination {
    /// Refuses to overwrite existing pictures or videos.
    pub(super) fn check(&self, overwrite: OverwriteArgs) -> Result<(), Failure> {
        match self {
            Self::Folder(folder) => Ok(overwrite.policy().check_files(folder, &[super::table::FILE])?),
            Self::Y4m(file) | Self::Encoded(file) => Ok(overwrite.policy().check_file(file)?),
            Self::Stdout => Ok(()),
        }
    }
}

/// Whether the reader of the stream still reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReaderState {
    Listens,
    /// The reader has closed the pipe.
    Left,
}

/// A video that is being written.
#[derive(Debug)]
pub(super) struct Video {
    sink: VideoSink,
    frame: Vec<u8>,
}

#[derive(Debug)]
enum VideoSink {
    Stdout(BufWriter<Stdout>),
    File(BufWriter<File>, PathBuf),
    Ffmpeg(Ffmpeg),
}

/// A running ffmpeg process.
#[derive(Debug)]
struct Ffmpeg {
    child: Child,
    /// Its standard input, until all frames are written.
    pictures: Option<BufWriter<ChildStdin>>,
    /// Collects its standard error.
    said: Option<JoinHandle<String>>,
    path: PathBuf,
}

impl Video {
    /// Opens the destination and writes the stream header; `None` for a folder, which takes single pictures.
    pub(super) fn create(
        destination: &Destination,
        extent: [u32; 2],
        rate: FrameRate,
    ) -> Result<Option<Self>, Failure> {
        let sink = match destination {
            Destination::Folder(_) => return Ok(None),
            Destination::Stdout => VideoSink::Stdout(BufWriter::new(io::stdout())),
            Destination::Y4m(path) => {
                let file = File::create(path).map_err(|error| lost(path, &error))?;
                VideoSink::File(BufWriter::new(file), path.clone())
            }
            Destination::Encoded(path) => VideoSink::Ffmpeg(Ffmpeg::start(path)?),
        };
        let mut video = Self { sink, frame: Vec::new() };
        video.send(y4m::header(extent, rate).as_bytes())?;
        Ok(Some(video))
    }

    /// Appends a picture.
    pub(super) fn add(&mut self, image: &Image) -> Result<ReaderState, Failure> {
        let mut frame = std::mem::take(&mut self.frame);
        y4m::frame(image, &mut frame);
        let result = self.send(&frame);
        self.frame = frame;
        result
    }

    /// Flushes and waits for the encoder.
    pub(super) fn finish(self) -> Result<ReaderState, Failure> {
        match self.sink {
            VideoSink::Stdout(mut out) => of_stream(out.flush()),
            VideoSink::File(mut file, path) => {
                file.flush().map_err(|error| lost(&path, &error))?;
                Ok(ReaderState::Listens)
            }
            VideoSink::Ffmpeg(mut ffmpeg) => {
                // ffmpeg reports its own errors.
                let _ = ffmpeg.pictures.as_mut().map(Write::flush);
                ffmpeg.end().map(|()| ReaderState::Listens)
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<ReaderState, Failure> {
        match &mut self.sink {
            // Flushed at once, so that the reader sees each picture.
            VideoSink::Stdout(out) => of_stream(out.write_all(bytes).and_then(|()| out.flush())),
            VideoSink::File(file, path) => {
                file.write_all(bytes).map_err(|error| lost(path, &error))?;
                Ok(ReaderState::Listens)
            }
            VideoSink::Ffmpeg(ffmpeg) => {
                let written = ffmpeg.pictures.as_mut().map(|pipe| pipe.write_all(bytes));
                match written {
                    Some(Err(error)) => Err(ffmpeg.end().err().unwrap_or_else(|| lost(&ffmpeg.path, &error))),
                    _ => Ok(ReaderState::Listens),
                }
            }
        }
    }
}

fn lost(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::failed(format!("{}: {error}", path.display()))
}

/// A closed pipe is no failure.
fn of_stream(written: io::Result<()>) -> Result<ReaderState, Failure> {
    match written {
        Ok(()) => Ok(ReaderState::Listens),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(ReaderState::Left),
        Err(error) => Err(Failure::failed(format!("standard output: {error}"))),
    }
}

impl Ffmpeg {
    fn start(path: &Path) -> Result<Self, Failure> {
        let mut command = Command::new("ffmpeg");
        command.args([
            "-hide_banner",
            "-loglevel",
            "error",
            "-nostats",
            "-y",
            "-f",
            "yuv4mpegpipe",
            "-i",
            "-",
        ]);
        // Players guess the matrix by the size where a file does not state it.
        command.args(["-pix_fmt", "yuv420p", "-color_range", "tv", "-colorspace", "smpte170m"]);
        command.args(["-color_primaries", "bt709", "-color_trc", "iec61966-2-1"]);
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mp4")) {
            command.args(["-movflags", "+faststart"]);
        }
        // A name that begins with a dash, or with what looks like a protocol, is a file all the same.
        let mut file = std::ffi::OsString::from("file:");
        file.push(path);
        command.arg(file).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| {
            let name = path.display();
            match error.kind() {
                io::ErrorKind::NotFound => Failure::failed(format!(
                    "{name}: this format needs ffmpeg, which is not installed; install it (Debian and Ubuntu: \
                     apt-get install ffmpeg), or write a stream without it: --out {}",
                    path.with_extension("y4m").display()
                )),
                _ => Failure::failed(format!("{name}: ffmpeg cannot be started: {error}")),
            }
        })?;
        let mut errors = child.stderr.take();
        let read = move || {
            let mut said = String::new();
            // Bytes that are no text are dropped.
            let _ = errors.as_mut().map(|errors| errors.read_to_string(&mut said));
            said
        };
        let said = std::thread::Builder::new().name("ffmpeg".to_owned()).spawn(read);
        let said = Some(said.map_err(|error| lost(path, &error))?);
        let pictures = child.stdin.take().map(BufWriter::new);
        Ok(Self { child, pictures, said, path: path.to_owned() })
    }

    /// Waits until the file is complete.
    fn end(&mut self) -> Result<(), Failure> {
        self.pictures = None;
        let status = self.child.wait().map_err(|error| lost(&self.path, &error))?;
        let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        if status.success() {
            return Ok(());
        }
        let name = self.path.display();
        let said = if said.trim().is_empty() { status.to_string() } else { said.trim().to_owned() };
        Err(Failure::failed(format!("{name}: ffmpeg cannot write this video: {said}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_pictures_go_is_told_by_the_name() {
        let of = |out: &str| Destination::of(Path::new(out)).unwrap();
        assert_eq!(of("-"), Destination::Stdout);
        assert_eq!(of("out/run.mp4"), Destination::Encoded("out/run.mp4".into()));
        assert_eq!(of("RUN.MKV"), Destination::Encoded("RUN.MKV".into()));
        assert_eq!(of("run.y4m"), Destination::Y4m("run.y4m".into()));
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
