//! Pictures to disk while the next ones are drawn.

use super::grid::tile_bytes;
use super::{Format, Pending, RenderError, Renderer, Request};
use crate::camera::{Kinds, View};
use crate::snapshot::FrameSnapshot;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, mpsc};

/// Bytes of pictures that may be on the adapter or wait for their encoder at a time; a larger batch is
/// alone.
const MOST_BYTES: u64 = 384 << 20;

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
    /// Of everything that has been pushed and is not written yet.
    bytes: u64,
    /// Files at the encoders.
    in_queue: usize,
    written: u64,
}

/// A file that is written, or could not be.
#[derive(Debug)]
struct Done {
    bytes: u64,
    result: Result<(), RenderError>,
}

impl<'a> PngStream<'a> {
    pub fn new(renderer: &'a mut Renderer) -> Self {
        let (report, done) = mpsc::channel();
        Self { renderer, in_flight: VecDeque::new(), done, report, bytes: 0, in_queue: 0, written: 0 }
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
            let bytes: u64 = orders.iter().map(Order::bytes).sum();
            while self.bytes > 0 && self.bytes + bytes > MOST_BYTES {
                self.make_room()?;
            }
            let pending = self.renderer.begin_kinds(snapshot, &requests[..count])?;
            self.bytes += bytes;
            self.in_flight.push_back((pending, orders));
            if self.in_flight.len() > self.renderer.batches_ahead(count) {
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
        while self.in_queue > 0 {
            self.wait_for_one()?;
        }
        Ok(self.written)
    }

    fn make_room(&mut self) -> Result<(), RenderError> {
        if self.in_flight.is_empty() { self.wait_for_one() } else { self.deliver() }
    }

    /// Hands the pictures of the oldest batch to the encoders.
    fn deliver(&mut self) -> Result<(), RenderError> {
        let Some((pending, orders)) = self.in_flight.pop_front() else { return Ok(()) };
        let arrived = Arc::new(self.renderer.wait(pending)?);
        for (index, order) in orders.into_iter().enumerate() {
            let bytes = tile_bytes(order.view.extent);
            for (format, path) in order.files {
                self.in_queue += 1;
                let (arrived, report) = (Arc::clone(&arrived), self.report.clone());
                rayon::spawn(move || {
                    let result = match format {
                        Format::Rgb => arrived.write_png(index, &path),
                        _ => {
                            let pictures = arrived.some_pictures(index, Kinds::NONE.with(format.kind()));
                            format.write(&path, &pictures)
                        }
                    };
                    // The last one gives the memory of the batch back.
                    drop(arrived);
                    // The stream was dropped with an error when nobody listens.
                    let _ = report.send(Done { bytes, result });
                });
            }
        }
        Ok(())
    }

    fn wait_for_one(&mut self) -> Result<(), RenderError> {
        // The stream holds a sender itself, so that receiving cannot fail.
        if let Ok(done) = self.done.recv() {
            self.in_queue -= 1;
            self.bytes -= done.bytes;
            done.result?;
            self.written += 1;
        }
        Ok(())
    }
}

impl Order {
    fn request(&self) -> Request {
        Request { view: self.view, kinds: self.files.iter().map(|(format, _)| format.kind()).collect() }
    }

    /// Memory that its pictures take on their way, about.
    fn bytes(&self) -> u64 {
        tile_bytes(self.view.extent) * self.files.len() as u64
    }
}
