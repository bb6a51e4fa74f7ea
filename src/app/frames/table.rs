//! `frames.csv`: where each picture was taken and with which lens.

use super::super::Failure;
use super::cameras::Shot;
use crate::camera::{Lens, View};
use crate::snapshot::FrameSnapshot;
use serde::Serialize;
use std::fs::File;
use std::path::{Path, PathBuf};

/// A picture. Metres in the city frame, seconds, pixels.
#[derive(Debug, Serialize)]
pub(super) struct Row<'a> {
    file: &'a str,
    vehicle: &'a str,
    camera: &'a str,
    tick: u64,
    t: f64,
    x: f64,
    y: f64,
    z: f64,
    /// City from camera; camera axes right, down, forward.
    qx: f64,
    qy: f64,
    qz: f64,
    qw: f64,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: u32,
    height: u32,
}

impl<'a> Row<'a> {
    pub(super) fn new(
        file: &'a str,
        shot: &'a Shot,
        snapshot: &FrameSnapshot,
        view: &View,
        lens: &Lens,
    ) -> Self {
        let (p, q, k) = (view.extrinsics.position, view.extrinsics.orientation, lens.intrinsics());
        Self {
            file,
            vehicle: &shot.name,
            camera: shot.kind.name(),
            tick: snapshot.tick,
            t: snapshot.time_s,
            x: p.x,
            y: p.y,
            z: p.z,
            qx: q.x,
            qy: q.y,
            qz: q.z,
            qw: q.w,
            fx: k.fx,
            fy: k.fy,
            cx: k.cx,
            cy: k.cy,
            width: view.extent[0],
            height: view.extent[1],
        }
    }
}

#[derive(Debug)]
pub(super) struct Table {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl Table {
    /// Creates the folder and the table in it. A folder that cannot be used is bad input: nothing has
    /// been done yet.
    pub(super) fn create(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join("frames.csv");
        let file = std::fs::create_dir_all(folder).and_then(|()| File::create(&path)).map_err(|error| {
            let folder = folder.display();
            Failure::bad_input(format!("{folder}: pictures cannot be written into this folder: {error}"))
        })?;
        Ok(Self { path, writer: csv::Writer::from_writer(file) })
    }

    pub(super) fn add(&mut self, row: &Row<'_>) -> Result<(), Failure> {
        self.writer.serialize(row).map_err(|error| self.lost(&error))
    }

    pub(super) fn finish(&mut self) -> Result<(), Failure> {
        self.writer.flush().map_err(|error| self.lost(&error))
    }

    fn lost(&self, error: &dyn std::fmt::Display) -> Failure {
        Failure::failed(format!("{}: {error}", self.path.display()))
    }
}
