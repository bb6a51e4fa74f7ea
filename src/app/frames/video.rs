//! Where a video goes: a stream to standard output, a file of such a stream, or a file that ffmpeg
//! encodes.

use super::super::Failure;
use super::super::overwrite::OverwriteArgs;
use super::y4m::{self, FrameRate};
use crate::render::Image;
use std::fs::File;
use std::io::{self, BufWriter, Read, Stdout, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

/// Extensions of files that ffmpeg encodes.
const ENCODED: [&str; 5] = ["mp4", "webm", "mkv", "mov", "avi"];

/// What somebody who names such a file wants is no folder.
const OTHERS: [&str; 9] = ["gif", "png", "jpg", "jpeg", "mpg", "mpeg", "wmv", "flv", "ogv"];

/// What `--out` says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Destination {
    Folder(PathBuf),
    Stdout,
    Y4m(PathBuf),
    Encoded(PathBuf),
}

impl Destination {
    /// By the extension, and by what is there.
    ///
    /// # Errors
    /// For files that are neither, what may stand there.
    pub(super) fn of(out: &Path) -> Result<Self, String> {
        let extension = out.extension().and_then(|text| text.to_str()).unwrap_or_default().to_lowercase();
        Ok(match extension.as_str() {
            _ if out.as_os_str() == "-" => Self::Stdout,
            _ if out.is_dir() => Self::Folder(out.to_owned()),
            "y4m" => Self::Y4m(out.to_owned()),
            known if ENCODED.contains(&known) => Self::Encoded(out.to_owned()),
            other if OTHERS.contains(&other) => {
                return Err(format!(
                    "--out {}: .{other} is not written; give a folder for pictures, or a video: .y4m, or with ffmpeg .{}",
                    out.display(),
                    ENCODED.join(", .")
                ));
            }
            _ => Self::Folder(out.to_owned()),
        })
    }
}

impl Destination {
    /// Refuses to write over pictures or a video that are there.
    pub(super) fn check(&self, overwrite: OverwriteArgs) -> Result<(), Failure> {
        match self {
            Self::Folder(folder) => overwrite.check_files(folder, &[super::table::FILE]),
            Self::Y4m(file) | Self::Encoded(file) => overwrite.check_file(file),
            Self::Stdout => Ok(()),
        }
    }
}

/// Whether more pictures are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reader {
    Listens,
    /// It has gone: there is nobody to write for.
    Left,
}

/// A video that is being written.
#[derive(Debug)]
pub(super) struct Video {
    sink: Sink,
    frame: Vec<u8>,
}

#[derive(Debug)]
enum Sink {
    Stdout(BufWriter<Stdout>),
    File(BufWriter<File>, PathBuf),
    Ffmpeg(Ffmpeg),
}

/// The program while it encodes.
#[derive(Debug)]
struct Ffmpeg {
    child: Child,
    /// Until everything has been given to it.
    pictures: Option<BufWriter<ChildStdin>>,
    /// What it says of errors.
    said: Option<JoinHandle<String>>,
    path: PathBuf,
}

impl Video {
    /// Opens where a video goes and writes what comes before the pictures; `None` for a folder, which
    /// takes single pictures.
    pub(super) fn create(
        destination: &Destination,
        extent: [u32; 2],
        rate: FrameRate,
    ) -> Result<Option<Self>, Failure> {
        let sink = match destination {
            Destination::Folder(_) => return Ok(None),
            Destination::Stdout => Sink::Stdout(BufWriter::new(io::stdout())),
            Destination::Y4m(path) => {
                let file = File::create(path).map_err(|error| lost(path, &error))?;
                Sink::File(BufWriter::new(file), path.clone())
            }
            Destination::Encoded(path) => Sink::Ffmpeg(Ffmpeg::start(path)?),
        };
        let mut video = Self { sink, frame: Vec::new() };
        video.send(y4m::header(extent, rate).as_bytes())?;
        Ok(Some(video))
    }

    /// Appends a picture.
    pub(super) fn add(&mut self, image: &Image) -> Result<Reader, Failure> {
        let mut frame = std::mem::take(&mut self.frame);
        y4m::frame(image, &mut frame);
        let result = self.send(&frame);
        self.frame = frame;
        result
    }

    /// Writes out what is left and waits for the encoder.
    pub(super) fn finish(self) -> Result<Reader, Failure> {
        match self.sink {
            Sink::Stdout(mut out) => of_stream(out.flush()),
            Sink::File(mut file, path) => {
                file.flush().map_err(|error| lost(&path, &error))?;
                Ok(Reader::Listens)
            }
            Sink::Ffmpeg(mut ffmpeg) => {
                // What goes wrong here it says itself.
                let _ = ffmpeg.pictures.as_mut().map(Write::flush);
                ffmpeg.end().map(|()| Reader::Listens)
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Reader, Failure> {
        match &mut self.sink {
            // At once, so that who reads sees pictures as they are taken.
            Sink::Stdout(out) => of_stream(out.write_all(bytes).and_then(|()| out.flush())),
            Sink::File(file, path) => {
                file.write_all(bytes).map_err(|error| lost(path, &error))?;
                Ok(Reader::Listens)
            }
            Sink::Ffmpeg(ffmpeg) => {
                let written = ffmpeg.pictures.as_mut().map(|pipe| pipe.write_all(bytes));
                match written {
                    Some(Err(error)) => Err(ffmpeg.end().err().unwrap_or_else(|| lost(&ffmpeg.path, &error))),
                    _ => Ok(Reader::Listens),
                }
            }
        }
    }
}

fn lost(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::failed(format!("{}: {error}", path.display()))
}

/// A reader that has seen enough is no failure.
fn of_stream(written: io::Result<()>) -> Result<Reader, Failure> {
    match written {
        Ok(()) => Ok(Reader::Listens),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(Reader::Left),
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
                    "{name}: ffmpeg encodes videos and is not installed; install it (Debian and Ubuntu: \
                     apt-get install ffmpeg), or write a stream without it: --out {}",
                    path.with_extension("y4m").display()
                )),
                _ => Failure::failed(format!("{name}: ffmpeg does not start: {error}")),
            }
        })?;
        let mut errors = child.stderr.take();
        let read = move || {
            let mut said = String::new();
            // What is no text is not shown.
            let _ = errors.as_mut().map(|errors| errors.read_to_string(&mut said));
            said
        };
        let said = std::thread::Builder::new().name("ffmpeg".to_owned()).spawn(read);
        let said = Some(said.map_err(|error| lost(path, &error))?);
        let pictures = child.stdin.take().map(BufWriter::new);
        Ok(Self { child, pictures, said, path: path.to_owned() })
    }

    /// Waits until the file is whole.
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
