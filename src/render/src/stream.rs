//! Pipelined writing of picture files: drawing, read-back and encoding overlap, with back-pressure on the caller.

use super::grid::tile_bytes;
use super::{PendingReadback, PictureFormat, RenderError, RenderRequest, Renderer};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_sensors::{PictureKinds, View};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, mpsc};

/// Limit of the bytes of pictures in flight, on the adapter or queued for an encoder; a larger batch goes alone.
const MAX_BYTES_IN_FLIGHT: u64 = 384 << 20;

/// View and the picture files to write of it.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureJob {
    /// Camera pose, projection and resolution.
    pub view: View,
    /// Format and path of each file; a file that is there is replaced.
    pub files: Vec<(PictureFormat, PathBuf)>,
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
}

/// Outcome of one file.
#[derive(Debug)]
struct WrittenFile {
    bytes: u64,
    result: Result<(), RenderError>,
}

impl<'a> PngStream<'a> {
    /// A pipeline with nothing in flight.
    pub fn new(renderer: &'a mut Renderer) -> Self {
        let (report, done) = mpsc::channel();
        Self { renderer, in_flight: VecDeque::new(), done, report, bytes: 0, in_queue: 0, written: 0 }
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
        let jobs = views
            .iter()
            .zip(paths)
            .map(|(&view, path)| CaptureJob { view, files: vec![(PictureFormat::Rgb, path)] });
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
    /// The first that occurred.
    pub fn finish(mut self) -> Result<u64, RenderError> {
        while !self.in_flight.is_empty() {
            self.deliver()?;
        }
        while self.in_queue > 0 {
            self.wait_for_one()?;
        }
        Ok(self.written)
    }

    fn make_room(&mut self) -> Result<(), RenderError> {
        if self.in_flight.is_empty() { self.wait_for_one() } else { self.deliver() }
    }

    /// Waits for the oldest batch and queues its pictures for the encoders, on rayon's threads.
    fn deliver(&mut self) -> Result<(), RenderError> {
        let Some((pending, jobs)) = self.in_flight.pop_front() else { return Ok(()) };
        let readback = Arc::new(self.renderer.wait(pending)?);
        for (index, job) in jobs.into_iter().enumerate() {
            let bytes = tile_bytes(job.view.extent);
            for (format, path) in job.files {
                self.in_queue += 1;
                let (readback, report) = (Arc::clone(&readback), self.report.clone());
                rayon::spawn(move || {
                    let result = match format {
                        PictureFormat::Rgb => readback.write_png(index, &path),
                        _ => {
                            let pictures =
                                readback.some_pictures(index, PictureKinds::NONE.with(format.kind()));
                            format.write(&path, &pictures)
                        }
                    };
                    // The last drop returns the staging buffer to its pool.
                    drop(readback);
                    // The receiver is gone if the stream was dropped with an error.
                    let _ = report.send(WrittenFile { bytes, result });
                });
            }
        }
        Ok(())
    }

    fn wait_for_one(&mut self) -> Result<(), RenderError> {
        // The stream holds a sender itself, so receiving cannot fail.
        if let Ok(done) = self.done.recv() {
            self.in_queue -= 1;
            self.bytes -= done.bytes;
            done.result?;
            self.written += 1;
        }
        Ok(())
    }
}

impl CaptureJob {
    fn request(&self) -> RenderRequest {
        RenderRequest { view: self.view, kinds: self.files.iter().map(|(format, _)| format.kind()).collect() }
    }

    /// Approximate memory of its pictures in flight.
    fn bytes(&self) -> u64 {
        tile_bytes(self.view.extent) * self.files.len() as u64
    }
}
