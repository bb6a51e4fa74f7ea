//! Pictures to disk while the next ones are drawn.

use super::{Format, Pending, Pictures, RenderError, Renderer, Request};
use crate::camera::View;
use crate::snapshot::FrameSnapshot;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::mpsc;

/// Batches that may be on the adapter at a time.
const IN_FLIGHT: usize = 2;
/// Bytes of pictures that may wait for their encoder at a time; a larger picture waits alone.
const QUEUE_BYTES: usize = 96 << 20;

/// A view and the files that are made of its pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    pub view: View,
    pub files: Vec<(Format, PathBuf)>,
}

/// Writes files of the pictures of every snapshot that is pushed. Drawing, reading back and encoding
/// overlap; when pictures come faster than they can be written, pushing waits, so that memory stays
/// bounded.
#[derive(Debug)]
pub struct PngStream<'a> {
    renderer: &'a mut Renderer,
    in_flight: VecDeque<(Pending, Vec<Order>)>,
    done: mpsc::Receiver<Done>,
    report: mpsc::Sender<Done>,
    queue: Queue,
    written: u64,
}

/// What waits for its encoder.
#[derive(Clone, Copy, Debug, Default)]
struct Queue {
    views: usize,
    bytes: usize,
}

/// A view whose files are written, or could not be.
#[derive(Debug)]
struct Done {
    bytes: usize,
    result: Result<u64, RenderError>,
}

impl<'a> PngStream<'a> {
    pub fn new(renderer: &'a mut Renderer) -> Self {
        let (report, done) = mpsc::channel();
        Self { renderer, in_flight: VecDeque::new(), done, report, queue: Queue::default(), written: 0 }
    }

    /// Draws views of one snapshot in colour and writes each to the path of the same index. Returns as
    /// soon as there is room for more.
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
        let orders =
            views.iter().zip(paths).map(|(&view, path)| Order { view, files: vec![(Format::Rgb, path)] });
        self.push_orders(snapshot, orders.collect())
    }

    /// Draws views of one snapshot in all kinds that their files need, as many at once as the adapter
    /// takes. Returns as soon as there is room for more.
    ///
    /// # Errors
    /// Those of [`Renderer::render_kinds`], and the first error of a file pushed earlier.
    pub fn push_orders(
        &mut self,
        snapshot: &FrameSnapshot,
        mut orders: Vec<Order>,
    ) -> Result<(), RenderError> {
        while !orders.is_empty() {
            let requests: Vec<Request> = orders.iter().map(Order::request).collect();
            let count = self.renderer.requests_at_once(&requests);
            let rest = orders.split_off(count);
            let pending = self.renderer.begin_kinds(snapshot, &requests[..count])?;
            self.in_flight.push_back((pending, orders));
            if self.in_flight.len() > IN_FLIGHT {
                self.deliver()?;
            }
            orders = rest;
        }
        Ok(())
    }

    /// Waits until every picture lies on disk; says how many files there are.
    ///
    /// # Errors
    /// The first that occurred.
    pub fn finish(mut self) -> Result<u64, RenderError> {
        while !self.in_flight.is_empty() {
            self.deliver()?;
        }
        while self.queue.views > 0 {
            self.wait_for_one()?;
        }
        Ok(self.written)
    }

    fn deliver(&mut self) -> Result<(), RenderError> {
        let Some((pending, orders)) = self.in_flight.pop_front() else { return Ok(()) };
        let pictures = self.renderer.finish_kinds(pending)?;
        for (pictures, order) in pictures.into_iter().zip(orders) {
            let bytes = pictures.bytes();
            while self.queue.views > 0 && self.queue.bytes + bytes > QUEUE_BYTES {
                self.wait_for_one()?;
            }
            self.queue = Queue { views: self.queue.views + 1, bytes: self.queue.bytes + bytes };
            let report = self.report.clone();
            rayon::spawn(move || encode(pictures, order, &report));
        }
        Ok(())
    }

    fn wait_for_one(&mut self) -> Result<(), RenderError> {
        // The stream holds a sender itself, so that receiving cannot fail.
        if let Ok(done) = self.done.recv() {
            self.queue = Queue { views: self.queue.views - 1, bytes: self.queue.bytes - done.bytes };
            self.written += done.result?;
        }
        Ok(())
    }
}

impl Order {
    fn request(&self) -> Request {
        Request { view: self.view, kinds: self.files.iter().map(|(format, _)| format.kind()).collect() }
    }
}

#[allow(clippy::needless_pass_by_value, reason = "runs on another thread, which owns what it writes")]
fn encode(pictures: Pictures, order: Order, report: &mpsc::Sender<Done>) {
    let files = order.files.len() as u64;
    let written = order.files.par_iter().try_for_each(|(format, path)| format.write(path, &pictures));
    // The stream was dropped with an error when nobody listens.
    let _ = report.send(Done { bytes: pictures.bytes(), result: written.map(|()| files) });
}
