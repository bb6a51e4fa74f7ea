//! Pictures to disk while the next ones are drawn.

use super::{Image, Pending, RenderError, Renderer, write_png};
use crate::camera::View;
use crate::snapshot::FrameSnapshot;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::mpsc;

/// Batches that may be on the adapter at a time.
const IN_FLIGHT: usize = 2;
/// Pictures that may wait for their encoder at a time.
const IN_QUEUE: usize = 32;

/// Writes a PNG for every view of every snapshot that is pushed. Drawing, reading back and encoding
/// overlap; when pictures come faster than they can be written, pushing waits, so that memory stays
/// bounded.
#[derive(Debug)]
pub struct PngStream<'a> {
    renderer: &'a mut Renderer,
    in_flight: VecDeque<(Pending, Vec<PathBuf>)>,
    done: mpsc::Receiver<Result<(), RenderError>>,
    report: mpsc::Sender<Result<(), RenderError>>,
    in_queue: usize,
    written: u64,
}

impl<'a> PngStream<'a> {
    pub fn new(renderer: &'a mut Renderer) -> Self {
        let (report, done) = mpsc::channel();
        Self { renderer, in_flight: VecDeque::new(), done, report, in_queue: 0, written: 0 }
    }

    /// Draws views of one snapshot and writes each to the path of the same index. Returns as soon as
    /// there is room for more.
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
        let pending = self.renderer.begin(snapshot, views)?;
        self.in_flight.push_back((pending, paths));
        if self.in_flight.len() > IN_FLIGHT {
            self.deliver()?;
        }
        Ok(())
    }

    /// Waits until every picture lies on disk; says how many.
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

    fn deliver(&mut self) -> Result<(), RenderError> {
        let Some((pending, paths)) = self.in_flight.pop_front() else { return Ok(()) };
        let images = self.renderer.finish(pending)?;
        for (image, path) in images.into_iter().zip(paths) {
            while self.in_queue >= IN_QUEUE {
                self.wait_for_one()?;
            }
            self.in_queue += 1;
            let report = self.report.clone();
            rayon::spawn(move || encode(&image, path, &report));
        }
        Ok(())
    }

    fn wait_for_one(&mut self) -> Result<(), RenderError> {
        // The stream holds a sender itself, so that receiving cannot fail.
        if let Ok(result) = self.done.recv() {
            self.in_queue -= 1;
            result?;
            self.written += 1;
        }
        Ok(())
    }
}

#[allow(clippy::needless_pass_by_value, reason = "runs on another thread, which owns the path")]
fn encode(image: &Image, path: PathBuf, report: &mpsc::Sender<Result<(), RenderError>>) {
    // The stream was dropped with an error when nobody listens.
    let _ = report.send(write_png(&path, image));
}
