//! `city3d frames`: camera pictures of a scenario or of a recorded run as files, with `frames.csv` beside them, or
//! as a video.
//!
//! Files are `<camera>_<vehicle>_<tick, 8 digits>.png`, which sorts each camera's pictures by time; other kinds than
//! rgb add `_<kind>`; cameras of no vehicle have `city` in its place. `docs/cameras.md` describes the files, the
//! columns of the table and the axes.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

mod cameras;
mod destination;
mod kinds;
mod shots;
mod source;
mod table;

use super::files::new_folder;
use super::look::{self, LookArgs, failure};
use super::overwrite::OverwriteArgs;
use super::say::{complain, say};
use super::{Failure, ScenarioArgs, on_end, progress, values};
use cameras::CameraArgs;
use city3d_outputs::OutputFolder;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::video::{FrameRate, ReaderState, Video, VideoOutput};
use city3d_render::{
    BoxTable, CaptureJob, FlowJob, Image, Motion, PendingReadback, PictureRow, PictureTable, PngStream,
    Renderer,
};
use city3d_sensors::{PictureKinds, View};
use city3d_session::capture::{CaptureError, CaptureSchedule, CapturedRun};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use destination::{ClaimedDestination, Destination};
use kinds::{KindArgs, file_name};
use shots::{CameraOverrides, Shot};
use source::FrameSource;
use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

#[derive(Debug, Args)]
pub struct FramesArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Folder for the pictures and frames.csv; or a video of one camera: a file such as run.mp4 (with
    /// ffmpeg) or run.y4m, or "-" for a Y4M stream to standard output [default: a new folder, such as
    /// out/roundabout-frames-1]
    #[arg(long, value_name = "DIR|FILE|-")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    cameras: CameraArgs,
    #[command(flatten)]
    kinds: KindArgs,
    /// Width and height of the pictures in pixels [default: the sensors', or 640x480]
    #[arg(long, value_name = "WxH", value_parser = values::size)]
    size: Option<[u32; 2]>,
    /// Simulated seconds between two pictures of a camera [default: by the sensors' rates, or 1]
    #[arg(long, value_name = "S", value_parser = values::positive)]
    every: Option<f64>,
    /// Pictures per simulated second, instead of --every [default for a video: 30]
    #[arg(long, value_name = "HZ", value_parser = values::positive, conflicts_with = "every")]
    fps: Option<f64>,
    /// Simulated time of the first pictures in seconds; the run ends at --duration
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = values::not_negative)]
    from: f64,
    /// Vertical field of view of the cameras in degrees [default: the sensors', or 50]
    #[arg(long, value_name = "DEG", value_parser = field_of_view)]
    fov: Option<f64>,
    #[command(flatten)]
    look: LookArgs,
}

fn field_of_view(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (1.0..=150.0).contains(&number) => Ok(number),
        _ => Err("degrees from 1 to 150 are needed".to_owned()),
    }
}

pub fn frames(args: &FramesArgs) -> Result<(), Failure> {
    let source = FrameSource::of(&args.scenario)?;
    let experiment = Arc::clone(source.experiment());
    let out = args.out.clone().unwrap_or_else(|| new_folder(&format!("{}-frames", experiment.name)));
    let destination = Destination::of(&out).map_err(Failure::bad_input)?;
    let claimed = destination.claim(args.overwrite, &source.inputs(&args.scenario))?;
    let overrides = overrides(args, &destination, &experiment)?;
    let shots = shots::shots(&args.cameras, &overrides, &experiment, &source.carriers())?;
    let schedule = schedule(args.from, &shots, &experiment)?;
    let stop = on_end()?;
    let capture = FrameCapture { args, experiment: &experiment, shots: &shots, out: &out, stop: &stop };
    match &claimed {
        ClaimedDestination::Folder(folder) => capture.take_pictures(source, schedule, folder),
        ClaimedDestination::Video(output) => capture.take_video(source, schedule, output),
    }
}

/// The overrides of the command line for all cameras.
fn overrides(
    args: &FramesArgs,
    destination: &Destination,
    experiment: &Experiment,
) -> Result<CameraOverrides, Failure> {
    let is_video = !matches!(destination, Destination::Folder(_));
    let kinds = args.kinds.overrides();
    if let Some(option) = args.kinds.beside_pictures().filter(|_| is_video) {
        return Err(Failure::bad_input(format!(
            "a video holds pictures alone; leave {option} out, or give --out a folder for single pictures"
        )));
    }
    if is_video && kinds.is_some_and(|kinds| kinds != PictureKinds::RGB) {
        return Err(Failure::bad_input(
            "a video has kind rgb only; leave --kind out, or give --out a folder for single pictures",
        ));
    }
    let video_hz = experiment.rates.physics_hz.min(30);
    Ok(CameraOverrides {
        extent: args.size,
        vertical_fov_rad: args.fov.map(f64::to_radians),
        every_s: args.every.or(args.fps.map(|fps| 1.0 / fps)),
        default_every_s: if is_video { 1.0 / f64::from(video_hz) } else { 1.0 },
        kinds: if is_video { Some(PictureKinds::RGB) } else { kinds },
    })
}

/// When the cameras are due.
fn schedule(from_s: f64, shots: &[Shot], experiment: &Experiment) -> Result<CaptureSchedule, Failure> {
    let periods = shots.iter().map(|shot| shot.every_s).collect();
    CaptureSchedule::new(from_s, periods, experiment).ok_or_else(|| {
        Failure::bad_input(format!(
            "--from {from_s} s lies after the end of the run at {} s; take an earlier time or a longer --duration",
            experiment.duration_s
        ))
    })
}

impl From<CaptureError> for Failure {
    fn from(error: CaptureError) -> Self {
        if error.is_bad_input() { Self::bad_input(error) } else { Self::failed(error) }
    }
}

/// The tables beside the pictures.
struct FrameTables {
    pictures: PictureTable,
    /// Where boxes are wanted.
    boxes: Option<BoxTable>,
}

impl FrameTables {
    fn finish(self) -> Result<&'static str, Failure> {
        self.pictures.finish()?;
        match self.boxes {
            Some(boxes) => boxes.finish().map(|()| "frames.csv and boxes.csv").map_err(Failure::from),
            None => Ok("frames.csv"),
        }
    }
}

/// The last picture of a camera, since which optical flow is told.
#[derive(Clone)]
struct EarlierPicture {
    snapshot: Arc<FrameSnapshot>,
    view: View,
}

/// Takes the pictures of a run.
struct FrameCapture<'a> {
    args: &'a FramesArgs,
    experiment: &'a Arc<Experiment>,
    shots: &'a [Shot],
    out: &'a Path,
    /// The pictures end where this is set.
    stop: &'a AtomicBool,
}

impl FrameCapture<'_> {
    fn open(&self, schedule: &CaptureSchedule) -> Result<Renderer, Failure> {
        let is_many = schedule.clone().has(look::PictureCount::MANY);
        let pictures = if is_many { look::PictureCount::Many } else { look::PictureCount::Few };
        look::open(&self.args.look, self.experiment, (look::QualityArg::High, pictures))
            .map_err(look::failure)
    }

    /// Writes pictures and table into a folder.
    fn take_pictures(
        &self,
        source: FrameSource,
        schedule: CaptureSchedule,
        folder: &OutputFolder,
    ) -> Result<(), Failure> {
        let mut tables = FrameTables {
            pictures: table::create(folder)?,
            boxes: table::create_boxes(folder, self.args.kinds.boxes)?,
        };
        let mut renderer = self.open(&schedule)?;
        let adapter = renderer.context().adapter_name.clone();
        let start = Instant::now();
        let mut playback = source.begin()?;
        let mut stream = PngStream::new(&mut renderer);
        let taken = self.push_pictures(&mut playback, schedule, &mut stream, (folder.path(), &mut tables));
        // Pictures under way are completed, and the table lists all that are whole: also after a failure.
        let count = stream.finish().map_err(failure);
        let listed = tables.pictures.settle(&stream.take_outcomes()).map_err(Failure::from);
        let named = tables.finish();
        let (count, tables) = taken.and(count).and_then(|count| Ok((count, listed.and(named)?)))?;
        self.fail_if_stopped(&playback)?;
        let speed = count as f64 / start.elapsed().as_secs_f64().max(1e-9);
        let sizes: BTreeSet<[u32; 2]> = self.shots.iter().map(|shot| shot.lens.extent).collect();
        let sizes: Vec<String> = sizes.iter().map(|[width, height]| format!("{width} x {height}")).collect();
        let (sizes, folder) = (sizes.join(" and "), folder.path().display());
        say(format_args!(
            "{count} pictures of {sizes} and {tables} in {folder}: {speed:.1} images/s on {adapter}"
        ))
    }

    /// Draws the pictures of the schedule one after another, and lists those that are written.
    fn push_pictures(
        &self,
        playback: &mut CapturedRun,
        mut schedule: CaptureSchedule,
        stream: &mut PngStream<'_>,
        (folder, tables): (&Path, &mut FrameTables),
    ) -> Result<(), Failure> {
        let mut earlier: Vec<Option<EarlierPicture>> = vec![None; self.shots.len()];
        let bar = progress::simulated_seconds(self.experiment.duration_s);
        while let Some((tick, due)) = schedule.next_due() {
            playback.advance(tick, self.stop, &mut |time_s| progress::show(&bar, time_s))?;
            if self.is_stopped() {
                break;
            }
            let orders = self.order(playback.snapshot(), &due, (folder, &mut *tables), &mut earlier)?;
            stream.push_jobs(playback.snapshot(), orders).map_err(failure)?;
            tables.pictures.settle(&stream.take_outcomes())?;
        }
        bar.finish_and_clear();
        Ok(())
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The failure of pictures that were stopped before their end; what is written is whole.
    fn fail_if_stopped(&self, playback: &CapturedRun) -> Result<(), Failure> {
        let (done_s, all_s) = (playback.snapshot().time_s, self.experiment.duration_s);
        if !self.is_stopped() {
            return Ok(());
        }
        let out = self.out.display();
        Err(Failure::failed(format!("stopped after {done_s:.2} of {all_s:.2} s; {out} is whole up to there")))
    }

    /// The files of the due cameras, each with its row.
    fn order(
        &self,
        snapshot: &FrameSnapshot,
        due: &[usize],
        (folder, tables): (&Path, &mut FrameTables),
        earlier: &mut [Option<EarlierPicture>],
    ) -> Result<Vec<CaptureJob>, Failure> {
        let mut orders = Vec::with_capacity(due.len());
        let now = self.args.kinds.flow_format().map(|_| Arc::new(snapshot.clone()));
        for &index in due {
            let shot = &self.shots[index];
            // A vehicle that has left takes no pictures.
            let Some(view) = shot.view(snapshot).map_err(Failure::failed)? else { continue };
            let mut files = Vec::with_capacity(shot.kinds.len());
            for format in shot.kinds.iter().map(|kind| self.args.kinds.format(kind)) {
                let file = file_name(&shot.stem(snapshot.tick), format);
                tables.pictures.add(&PictureRow::new((&file, format), shot.taken_by(), snapshot, &view))?;
                files.push((format, folder.join(file)));
            }
            let present = now.as_ref().map(|now| EarlierPicture { snapshot: Arc::clone(now), view });
            let before = std::mem::replace(&mut earlier[index], present);
            let flow = before.zip(self.args.kinds.flow_format()).map(|(before, format)| {
                let file = format!("{}_flow.{}", shot.stem(snapshot.tick), format.extension());
                tables.pictures.add(&PictureRow::of_flow(&file, shot.taken_by(), snapshot, &view))?;
                let motion = Motion::between((&before.snapshot, before.view), (snapshot, view));
                Ok::<_, Failure>(FlowJob { motion, format, path: folder.join(file) })
            });
            if let Some(boxes) = &mut tables.boxes {
                boxes.add(shot.taken_by(), snapshot, &view)?;
            }
            orders.push(CaptureJob { view, files, flow: flow.transpose()? });
        }
        Ok(orders)
    }

    /// Writes the video of one camera. Messages go to standard error: standard output may carry the stream.
    fn take_video(
        &self,
        source: FrameSource,
        mut schedule: CaptureSchedule,
        output: &VideoOutput,
    ) -> Result<(), Failure> {
        let shot = self.only_shot()?;
        let rate = FrameRate::of_period(shot.every_s);
        let mut renderer = self.open(&schedule)?;
        let mut video = Video::create(output, shot.lens.extent, rate)?;
        let start = Instant::now();
        let mut playback = source.begin()?;
        let bar = progress::simulated_seconds(self.experiment.duration_s);
        let mut drawn: VecDeque<PendingReadback> = VecDeque::new();
        let mut count = 0_u64;
        loop {
            let next = schedule.next_due().filter(|_| !self.is_stopped());
            if let Some((tick, _)) = next {
                playback.advance(tick, self.stop, &mut |time_s| progress::show(&bar, time_s))?;
                if self.is_stopped() {
                    continue;
                }
                let snapshot = playback.snapshot();
                let Some(view) = shot.view(snapshot).map_err(Failure::failed)? else { continue };
                drawn.push_back(renderer.submit(snapshot, &[view]).map_err(failure)?);
            }
            if next.is_some() && drawn.len() <= renderer.batches_in_flight(1) {
                continue;
            }
            let Some(pending) = drawn.pop_front() else { break };
            let images: Vec<Image> = renderer.finish(pending).map_err(failure)?;
            for image in &images {
                if video.add(image)? == ReaderState::Left {
                    bar.finish_and_clear();
                    return Ok(());
                }
                count += 1;
            }
        }
        let reader = video.finish()?;
        bar.finish_and_clear();
        self.fail_if_stopped(&playback)?;
        if reader == ReaderState::Listens {
            let speed = count as f64 / start.elapsed().as_secs_f64().max(1e-9);
            let [width, height] = shot.lens.extent;
            let (out, adapter) = (self.out.display(), &renderer.context().adapter_name);
            complain(format_args!(
                "{count} pictures of {width} x {height} in {out}: {speed:.1} images/s on {adapter}"
            ));
        }
        Ok(())
    }

    fn only_shot(&self) -> Result<&Shot, Failure> {
        let [shot] = self.shots else {
            let count = self.shots.len();
            return Err(Failure::bad_input(format!(
                "a video shows one camera, and {count} are chosen; choose one with --vehicle and --camera or --sensor"
            )));
        };
        let [width, height] = shot.lens.extent;
        if !(width.is_multiple_of(2) && height.is_multiple_of(2)) {
            return Err(Failure::bad_input(format!(
                "a video of {width} x {height} pixels cannot be encoded; give it an even width and height with --size"
            )));
        }
        Ok(shot)
    }
}
