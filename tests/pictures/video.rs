//! Videos as a user makes them: streams, files by ffmpeg, and what happens where there is none.

use crate::support::drawing;

use drawing::software;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const SIZE: [usize; 2] = [96, 64];

/// Whether the peer is there; without it a test is skipped loudly, and fails in CI.
fn has_ffmpeg() -> bool {
    let is_there =
        Command::new("ffmpeg").arg("-version").output().is_ok_and(|output| output.status.success());
    if !is_there {
        assert!(std::env::var_os("CI").is_none(), "ffmpeg is missing: run scripts/setup.sh tests");
        eprintln!("SKIPPED: ffmpeg is missing: run scripts/setup.sh tests");
    }
    is_there
}

/// One second behind a car, ten pictures a second.
fn frames(out: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_city3d"));
    let arguments = [
        ["--camera", "chase"],
        ["--vehicle", "leader"],
        ["--size", "96x64"],
        ["--fps", "10"],
        ["--duration", "1"],
        ["--adapter", "software"],
        ["--quality", "fast"],
    ];
    command.args(["frames", "straight", "--out"]).arg(out).args(arguments.as_flattened());
    command
}

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !said.contains("panicked"), "{command:?}: {said}");
    output
}

/// The single pictures of the same instants.
fn pictures(folder: &Path) -> Vec<image::RgbImage> {
    run(&mut frames(folder));
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "png"));
    files.sort();
    files.iter().map(|path| image::open(path).unwrap().into_rgb8()).collect()
}

/// Mean difference of channels between means of two by two pixels, which share their chroma; in steps
/// of 255.
fn difference(single: &image::RgbImage, rgb: &[u8]) -> f64 {
    let [width, height] = SIZE;
    let mean = |bytes: &[u8], x: usize, y: usize, c: usize| {
        let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
        let at = |(dx, dy)| f64::from(bytes[((2 * y + dy) * width + 2 * x + dx) * 3 + c]);
        corners.into_iter().map(at).sum::<f64>() / 4.0
    };
    let mut sum = 0.0;
    for (x, y) in (0..height / 2).flat_map(|y| (0..width / 2).map(move |x| (x, y))) {
        sum += (0..3).map(|c| (mean(single.as_raw(), x, y, c) - mean(rgb, x, y, c)).abs()).sum::<f64>();
    }
    sum / (width * height * 3 / 4) as f64
}

#[test]
fn the_stream_has_every_picture_and_nothing_else() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let singles = pictures(&folder.path().join("pictures"));
    assert_eq!(singles.len(), 11);
    let output = run(&mut frames(Path::new("-")));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("11 pictures of 96 x 64"), "{said}");
    let file = folder.path().join("run.y4m");
    assert!(run(&mut frames(&file)).stdout.is_empty());
    assert!(std::fs::read(&file).unwrap() == output.stdout, "the file is another stream");

    let header = b"YUV4MPEG2 W96 H64 F10:1 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n";
    assert!(output.stdout.starts_with(header));
    let pixels = SIZE[0] * SIZE[1];
    let frames: Vec<&[u8]> = output.stdout[header.len()..].chunks(6 + pixels * 3 / 2).collect();
    assert_eq!(frames.len(), singles.len());
    for (frame, single) in frames.iter().zip(&singles) {
        let luma = frame.strip_prefix(b"FRAME\n").unwrap();
        assert_eq!(luma.len(), pixels * 3 / 2);
        for (y, pixel) in luma.iter().zip(single.pixels()) {
            // ITU-R BT.601, limited range.
            let [r, g, b] = pixel.0.map(f64::from);
            let want = 16.0 + (65.481 * r + 128.553 * g + 24.966 * b) / 255.0;
            assert!((f64::from(*y) - want).abs() < 0.6, "{y} of {pixel:?}");
        }
    }
}

#[test]
fn a_reader_that_leaves_ends_it_quietly() {
    if software().is_none() {
        return;
    }
    let mut command = frames(Path::new("-"));
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut first = [0; 20];
    child.stdout.take().unwrap().read_exact(&mut first).unwrap();
    // The pipe is closed here.
    let output = child.wait_with_output().unwrap();
    assert!(first.starts_with(b"YUV4MPEG2 "));
    assert!(output.status.success(), "{output:?}");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!["panicked", "pictures of", "pipe", "output"].iter().any(|word| said.contains(word)), "{said}");
}

#[test]
fn ffmpeg_takes_the_stream_and_shows_the_same_colours() {
    if software().is_none() || !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let singles = pictures(&folder.path().join("pictures"));
    let stream = folder.path().join("run.y4m");
    run(&mut frames(&stream));
    let decode = |file: &Path| {
        let exact = ["-sws_flags", "neighbor+accurate_rnd+full_chroma_int"];
        let ffmpeg = ["-v", "error", exact[0], exact[1], "-f", "rawvideo", "-pix_fmt", "rgb24", "-"];
        run(Command::new("ffmpeg").arg("-i").arg(file).args(ffmpeg)).stdout
    };
    let decoded = decode(&stream);
    assert_eq!(decoded.len(), singles.len() * SIZE[0] * SIZE[1] * 3);
    for (single, rgb) in singles.iter().zip(decoded.chunks(SIZE[0] * SIZE[1] * 3)) {
        // By the matrix of BT.709 it would be 1.3, by the full range 9.
        assert!(difference(single, rgb) < 0.8, "{}", difference(single, rgb));
    }

    let video = folder.path().join("run.mp4");
    run(&mut frames(&video));
    let mut probe = Command::new("ffprobe");
    probe.args(["-v", "error", "-count_frames", "-of", "default=noprint_wrappers=1", "-show_entries"]);
    probe.arg("stream=width,height,pix_fmt,color_range,color_space,r_frame_rate,nb_read_frames");
    let told = String::from_utf8(run(probe.arg(&video)).stdout).unwrap();
    for line in [
        "width=96",
        "height=64",
        "pix_fmt=yuv420p",
        "color_range=tv",
        "color_space=smpte170m",
        "r_frame_rate=10/1",
        "nb_read_frames=11",
    ] {
        assert!(told.lines().any(|found| found == line), "{line} is not in\n{told}");
    }
    let decoded = decode(&video);
    for (single, rgb) in singles.iter().zip(decoded.chunks(SIZE[0] * SIZE[1] * 3)) {
        assert!(difference(single, rgb) < 4.0, "{}", difference(single, rgb));
    }
}

/// Runs with a program in the place of ffmpeg, or with none.
fn with_ffmpeg(folder: &Path, script: Option<&str>) -> (Option<i32>, String) {
    let tools = folder.join("tools");
    std::fs::create_dir_all(&tools).unwrap();
    let program = tools.join("ffmpeg");
    if let Some(script) = script {
        use std::os::unix::fs::PermissionsExt;
        std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
    let output = frames(&folder.join("run.mp4")).env("PATH", &tools).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!said.contains("panicked") && output.stdout.is_empty(), "{said}");
    (output.status.code(), said)
}

#[test]
fn without_ffmpeg_or_with_its_error_the_user_is_told() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (code, said) = with_ffmpeg(folder.path(), None);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("apt-get install ffmpeg") && said.contains("run.mp4"), "{said}");
    // It fails at the start, and it fails at the end.
    for script in [
        "echo 'Unknown encoder' >&2; exit 3",
        "while read -r line; do :; done; echo 'Unknown encoder' >&2; exit 3",
    ] {
        let (code, said) = with_ffmpeg(folder.path(), Some(script));
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("run.mp4: ffmpeg cannot write this video: Unknown encoder"), "{said}");
    }
    let (code, said) = with_ffmpeg(folder.path(), Some("while read -r line; do :; done; exit 0"));
    assert_eq!(code, Some(0), "{said}");
}
