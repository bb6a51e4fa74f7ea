//! Pipelined writing of picture files: drawing, read-back and encoding overlap, with back-pressure on the caller.

use super::grid::tile_bytes;
use super::{
    FlowFormat, MappedReadback, Motion, PendingReadback, PictureFormat, Pictures, RenderError, RenderRequest,
    Renderer,
};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_sensors::{PictureKind, PictureKinds, View};
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::{Arc, mpsc};

/// What optical flow is computed from.
const FLOW_KINDS: PictureKinds = PictureKinds::NONE.with(PictureKind::Depth).with(PictureKind::Instance);

/// Limit of the bytes of pictures in flight, on the adapter or queued for an encoder; a larger batch goes alone.
const MAX_BYTES_IN_FLIGHT: u64 = 384 << 20;

/// View and the picture files to write of it.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureJob {
    /// Camera pose, projection and resolution.
    pub view: View,
    /// Format and path of each file; a file that is there is replaced.
    pub files: Vec<(PictureFormat, PathBuf)>,
    /// Optical flow since an earlier picture; its file is the last one.
    pub flow: Option<FlowJob>,
}

/// A file of optical flow.
#[derive(Clone, Debug, PartialEq)]
pub struct FlowJob {
    /// What has moved since the earlier picture.
    pub motion: Motion,
    /// Format of the file.
    pub format: FlowFormat,
    /// Path of the file; one that is there is replaced.
    pub path: PathBuf,
}

/// One file of a job.
enum JobFile {
    Picture(PictureFormat, PathBuf),
    Flow(Box<FlowJob>),
}

impl JobFile {
    /// Writes the file from the pictures of a view.
    fn write(self, readback: &MappedReadback, index: usize) -> Result<(), RenderError> {
        match self {
            Self::Picture(PictureFormat::Rgb, path) => readback.write_png(index, &path),
            Self::Picture(format, path) => {
                format.write(&path, &readback.some_pictures(index, PictureKinds::NONE.with(format.kind())))
            }
            Self::Flow(flow) => {
                let FlowJob { motion, format, path } = *flow;
                let Pictures { depth: Some(depth), instance: Some(instance), .. } =
                    readback.some_pictures(index, FLOW_KINDS)
                else {
                    return Ok(());
                };
                format.write(&path, &motion.flow(&depth, &instance))
            }
        }
    }
}

/// Bounded pipeline that writes picture files of each pushed snapshot. Drawing, read-back and encoding overlap. Pushing
/// blocks while too many bytes are in flight (back-pressure), so that memory stays bounded.
#[derive(Debug)]
pub struct PngStream<'a> {
    renderer: &'a mut Renderer,
    in_flight: VecDeque<(PendingReadback, Vec<CaptureJob>)>,
    done: mpsc::Receiver<WrittenFile>,
    report: mpsc::Sender<WrittenFile>,
    /// Bytes in flight: pushed and not yet written.
    bytes: u64,
    /// Files queued for encoders.
    in_queue: usize,
    written: u64,
    /// Number of files queued so far, which numbers them.
    queued: u64,
    /// Whether each file could be written: those that nobody has asked about, by their numbers.
    outcomes: BTreeMap<u64, bool>,
    /// Number of the file that is asked about next.
    next: u64,
}

/// Outcome of one file.
#[derive(Debug)]
struct WrittenFile {
    number: u64,
    bytes: u64,
    result: Result<(), RenderError>,
}

impl<'a> PngStream<'a> {
    /// A pipeline with nothing in flight.
    pub fn new(renderer: &'a mut Renderer) -> Self {
        let (report, done) = mpsc::channel();
        Self {
            renderer,
            in_flight: VecDeque::new(),
            done,
            report,
            bytes: 0,
            in_queue: 0,
            written: 0,
            queued: 0,
            outcomes: BTreeMap::new(),
            next: 0,
        }
    }

    /// Draws views of one snapshot in colour and writes each to the path of the same index. Returns once the pictures
    /// are in flight.
    ///
    /// # Errors
    /// Those of [`Renderer::render`], and the first error of a file pushed earlier.
    ///
    /// # Panics
    /// When there are not as many paths as views.
    pub fn push(
        &mut self,
        snapshot: &FrameSnapshot,
        views: &[View],
        paths: Vec<PathBuf>,
    ) -> Result<(), RenderError> {
        assert_eq!(views.len(), paths.len(), "every view needs a path");
        let jobs = views.iter().zip(paths).map(|(&view, path)| CaptureJob {
            view,
            files: vec![(PictureFormat::Rgb, path)],
            flow: None,
        });
        self.push_jobs(snapshot, jobs.collect())
    }

    /// Draws views of one snapshot in all kinds that their files need, in batches as large as the adapter takes.
    /// Returns once the pictures are in flight.
    ///
    /// # Errors
    /// Those of [`Renderer::render_kinds`], and the first error of a file pushed earlier.
    pub fn push_jobs(
        &mut self,
        snapshot: &FrameSnapshot,
        mut jobs: Vec<CaptureJob>,
    ) -> Result<(), RenderError> {
        while !jobs.is_empty() {
            let requests: Vec<RenderRequest> = jobs.iter().map(CaptureJob::request).collect();
            let count = self.renderer.max_batch_len(&requests);
            let rest = jobs.split_off(count);
            let bytes: u64 = jobs.iter().map(CaptureJob::bytes).sum();
            while self.bytes > 0 && self.bytes + bytes > MAX_BYTES_IN_FLIGHT {
                self.make_room()?;
            }
            let pending = self.renderer.submit_kinds(snapshot, &requests[..count])?;
            self.bytes += bytes;
            self.in_flight.push_back((pending, jobs));
            if self.in_flight.len() > self.renderer.batches_in_flight(count) {
                self.deliver()?;
            }
            jobs = rest;
        }
        Ok(())
    }

    /// Waits until every file is written and returns their number.
    ///
    /// # Errors
    /// The first that occurred; all files that could be written are, nevertheless.
    pub fn finish(&mut self) -> Result<u64, RenderError> {
        let mut outcome = Ok(());
        while !self.in_flight.is_empty() {
            outcome = outcome.and(self.deliver());
        }
        while self.in_queue > 0 {
            outcome = outcome.and(self.wait_for_one());
        }
        outcome.map(|()| self.written)
    }

    /// Whether each file could be written, in the order in which they were pushed and as far as all files before it are
    /// done; each outcome once.
    pub fn take_outcomes(&mut self) -> Vec<bool> {
        std::iter::from_fn(|| {
            let outcome = self.outcomes.remove(&self.next)?;
            self.next += 1;
            Some(outcome)
        })
        .collect()
    }

    fn make_room(&mut self) -> Result<(), RenderError> {
        if self.in_flight.is_empty() { self.wait_for_one() } else { self.deliver() }
    }

    /// Waits for the oldest batch and queues its pictures for the encoders, on rayon's threads.
    fn deliver(&mut self) -> Result<(), RenderError> {
        let Some((pending, jobs)) = self.in_flight.pop_front() else { return Ok(()) };
        let readback = match self.renderer.wait(pending) {
            Ok(readback) => Arc::new(readback),
            Err(error) => {
                for _ in 0..jobs.iter().map(CaptureJob::file_count).sum() {
                    self.outcomes.insert(self.queued, false);
                    self.queued += 1;
                }
                return Err(error);
            }
        };
        for (index, job) in jobs.into_iter().enumerate() {
            let bytes = tile_bytes(job.view.extent);
            let files = job.files.into_iter().map(|(format, path)| JobFile::Picture(format, path));
            for file in files.chain(job.flow.map(|flow| JobFile::Flow(Box::new(flow)))) {
                self.in_queue += 1;
                let number = self.queued;
                self.queued += 1;
                let (readback, report) = (Arc::clone(&readback), self.report.clone());
                rayon::spawn(move || {
                    let result = file.write(&readback, index);
                    // The last drop returns the staging buffer to its pool.
                    drop(readback);
                    // The receiver is gone if the stream was dropped with an error.
                    let _ = report.send(WrittenFile { number, bytes, result });
                });
            }
        }
        Ok(())
    }

    fn wait_for_one(&mut self) -> Result<(), RenderError> {
        // The stream holds a sender itself, so receiving cannot fail.
        match self.done.recv() {
            Ok(done) => self.settle(done),
            Err(_) => Ok(()),
        }
    }

    /// Counts a file that is done.
    fn settle(&mut self, done: WrittenFile) -> Result<(), RenderError> {
        self.in_queue -= 1;
        self.bytes -= done.bytes;
        self.outcomes.insert(done.number, done.result.is_ok());
        done.result?;
        self.written += 1;
        Ok(())
    }
}

impl CaptureJob {
    fn request(&self) -> RenderRequest {
        let flow = self.flow.iter().flat_map(|_| FLOW_KINDS.iter());
        let kinds = self.files.iter().map(|(format, _)| format.kind()).chain(flow).collect();
        RenderRequest { view: self.view, kinds }
    }

    fn file_count(&self) -> usize {
        self.files.len() + usize::from(self.flow.is_some())
    }

    /// Approximate memory of its pictures in flight.
    fn bytes(&self) -> u64 {
        tile_bytes(self.view.extent) * self.file_count() as u64
    }
}
