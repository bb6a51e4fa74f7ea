//! Video output: a Y4M stream to standard output or to a file, or a file that ffmpeg encodes.

mod y4m;

pub use y4m::FrameRate;

use crate::Image;
use city3d_outputs::WholeFile;
use std::io::{self, BufWriter, IntoInnerError, Read, Stdout, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;
use thiserror::Error;

/// Where a video is written to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VideoOutput {
    /// A Y4M stream to standard output.
    Stdout,
    /// A file with a Y4M stream.
    Y4m(PathBuf),
    /// A file that ffmpeg encodes, in the format of its extension.
    Encoded(PathBuf),
}

impl VideoOutput {
    /// Extensions of files that ffmpeg encodes.
    pub const ENCODED: [&str; 5] = ["mp4", "webm", "mkv", "mov", "avi"];
}

/// Why a video cannot be written.
#[derive(Debug, Error)]
pub enum VideoError {
    /// The file cannot be written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// Standard output cannot be written.
    #[error("standard output: {0}")]
    Stdout(io::Error),
    /// There is no ffmpeg.
    #[error(
        "{path}: this format needs ffmpeg, which is not installed; install it (Debian and Ubuntu: \
         apt-get install ffmpeg)",
        path = path.display()
    )]
    NoFfmpeg {
        /// Path of the file.
        path: PathBuf,
    },
    /// There is an ffmpeg that the operating system does not start.
    #[error("{path}: ffmpeg cannot be started: {source}", path = path.display())]
    FfmpegStart {
        /// Path of the file.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// ffmpeg has failed.
    #[error("{path}: ffmpeg cannot write this video: {reason}", path = path.display())]
    Encoding {
        /// Path of the file.
        path: PathBuf,
        /// What it has written to its standard error, or its exit status.
        reason: String,
    },
}

/// Whether the reader of the stream still reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReaderState {
    /// It does, or the stream is a file.
    Listens,
    /// The reader has closed the pipe.
    Left,
}

/// A video that is being written.
#[derive(Debug)]
pub struct Video {
    sink: VideoSink,
    frame: Vec<u8>,
}

#[derive(Debug)]
enum VideoSink {
    Stdout(BufWriter<Stdout>),
    File(BufWriter<WholeFile>, PathBuf),
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
    /// The file that it writes into, until it is whole.
    file: Option<WholeFile>,
}

impl Video {
    /// Opens the output and writes the stream header; width and height of the pictures are even.
    ///
    /// # Errors
    /// When the file cannot be created, or ffmpeg cannot be started.
    pub fn create(output: &VideoOutput, extent: [u32; 2], rate: FrameRate) -> Result<Self, VideoError> {
        let sink = match output {
            VideoOutput::Stdout => VideoSink::Stdout(BufWriter::new(io::stdout())),
            VideoOutput::Y4m(path) => {
                let file = WholeFile::create(path).map_err(lost(path))?;
                VideoSink::File(BufWriter::new(file), path.clone())
            }
            VideoOutput::Encoded(path) => VideoSink::Ffmpeg(Ffmpeg::start(path)?),
        };
        let mut video = Self { sink, frame: Vec::new() };
        video.send(y4m::header(extent, rate).as_bytes())?;
        Ok(video)
    }

    /// Appends a picture of the size that the video was created with.
    ///
    /// # Errors
    /// When it cannot be written, or ffmpeg has failed.
    pub fn add(&mut self, image: &Image) -> Result<ReaderState, VideoError> {
        let mut frame = std::mem::take(&mut self.frame);
        y4m::frame(image, &mut frame);
        let result = self.send(&frame);
        self.frame = frame;
        result
    }

    /// Flushes, waits for the encoder, and gives the file its name.
    ///
    /// # Errors
    /// When the rest cannot be written, or ffmpeg has failed.
    pub fn finish(self) -> Result<ReaderState, VideoError> {
        match self.sink {
            VideoSink::Stdout(mut out) => of_stream(out.flush()),
            VideoSink::File(file, path) => {
                let file = file.into_inner().map_err(IntoInnerError::into_error);
                file.and_then(WholeFile::commit).map_err(lost(&path))?;
                Ok(ReaderState::Listens)
            }
            VideoSink::Ffmpeg(mut ffmpeg) => {
                // ffmpeg reports its own errors.
                let _ = ffmpeg.pictures.as_mut().map(Write::flush);
                ffmpeg.end().map(|()| ReaderState::Listens)
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<ReaderState, VideoError> {
        match &mut self.sink {
            // Flushed at once, so that the reader sees each picture.
            VideoSink::Stdout(out) => of_stream(out.write_all(bytes).and_then(|()| out.flush())),
            VideoSink::File(file, path) => {
                file.write_all(bytes).map_err(lost(path))?;
                Ok(ReaderState::Listens)
            }
            VideoSink::Ffmpeg(ffmpeg) => {
                let written = ffmpeg.pictures.as_mut().map(|pipe| pipe.write_all(bytes));
                match written {
                    Some(Err(error)) => Err(ffmpeg.end().err().unwrap_or_else(|| lost(&ffmpeg.path)(error))),
                    _ => Ok(ReaderState::Listens),
                }
            }
        }
    }
}

/// The error of a file.
fn lost(path: &Path) -> impl FnOnce(io::Error) -> VideoError + use<> {
    let path = path.to_path_buf();
    move |source| VideoError::File { path, source }
}

/// A closed pipe is no failure.
fn of_stream(written: io::Result<()>) -> Result<ReaderState, VideoError> {
    match written {
        Ok(()) => Ok(ReaderState::Listens),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(ReaderState::Left),
        Err(error) => Err(VideoError::Stdout(error)),
    }
}

/// ffmpeg's name of the format of a file, by its extension.
fn format_of(path: &Path) -> &'static str {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let known = VideoOutput::ENCODED.into_iter().find(|known| extension.eq_ignore_ascii_case(known));
    match known {
        None | Some("mkv") => "matroska",
        Some(known) => known,
    }
}

impl Ffmpeg {
    fn start(path: &Path) -> Result<Self, VideoError> {
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
        // The file has another name until it is whole, which does not tell its format.
        let file = WholeFile::create(path).map_err(lost(path))?;
        command.args(["-f", format_of(path)]);
        // A name that begins with a dash, or with what looks like a protocol, is a file all the same.
        let mut name = std::ffi::OsString::from("file:");
        name.push(file.unfinished_path());
        command.arg(name).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        #[cfg(unix)]
        {
            use std::os::unix::process::CommandExt;
            // Ctrl-C is for this program, which then lets ffmpeg complete the file.
            command.process_group(0);
        }
        let mut child = command.spawn().map_err(|source| {
            let path = path.to_path_buf();
            match source.kind() {
                io::ErrorKind::NotFound => VideoError::NoFfmpeg { path },
                _ => VideoError::FfmpegStart { path, source },
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
        let said = Some(said.map_err(lost(path))?);
        let pictures = child.stdin.take().map(BufWriter::new);
        Ok(Self { child, pictures, said, path: path.to_owned(), file: Some(file) })
    }

    /// Waits until the file is complete.
    fn end(&mut self) -> Result<(), VideoError> {
        self.pictures = None;
        let status = self.child.wait().map_err(lost(&self.path))?;
        let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        if status.success() {
            return self.file.take().map_or(Ok(()), WholeFile::commit).map_err(lost(&self.path));
        }
        let reason = if said.trim().is_empty() { status.to_string() } else { said.trim().to_owned() };
        Err(VideoError::Encoding { path: self.path.clone(), reason })
    }
}
