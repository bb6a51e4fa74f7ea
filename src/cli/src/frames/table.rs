//! `frames.csv`: file, extrinsics and intrinsics of each picture.

use super::super::Failure;
use super::shots::Shot;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::PictureFormat;
use city3d_sensors::View;
use serde::Serialize;
use std::fs::File;
use std::path::{Path, PathBuf};

/// The row of a picture. Metres in the city frame, seconds, pixels.
#[derive(Debug, Serialize)]
pub(super) struct FrameRow<'a> {
    file: &'a str,
    kind: &'static str,
    /// Metres per file value, of depth maps.
    scale: Option<f64>,
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
    id: Option<u32>,
    /// Middle of the vehicle's outline on the ground, and city from body.
    vehicle_x: Option<f64>,
    vehicle_y: Option<f64>,
    vehicle_z: Option<f64>,
    vehicle_qx: Option<f64>,
    vehicle_qy: Option<f64>,
    vehicle_qz: Option<f64>,
    vehicle_qw: Option<f64>,
}

impl<'a> FrameRow<'a> {
    pub(super) fn new(
        (file, format): (&'a str, PictureFormat),
        shot: &'a Shot,
        snapshot: &FrameSnapshot,
        view: &View,
    ) -> Self {
        let (p, q, k) = (view.extrinsics.position, view.extrinsics.orientation, shot.lens.intrinsics());
        let carrier = shot.vehicle.and_then(|id| snapshot.vehicle(id));
        let position = carrier.map(|state| state.position);
        let orientation = carrier.map(|state| state.orientation);
        Self {
            file,
            kind: format.kind().name(),
            scale: format.metres_per_value(),
            vehicle: &shot.owner,
            camera: &shot.camera,
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
            id: carrier.map(|state| state.id.0),
            vehicle_x: position.map(|p| p.x),
            vehicle_y: position.map(|p| p.y),
            vehicle_z: position.map(|p| p.z),
            vehicle_qx: orientation.map(|q| q.x),
            vehicle_qy: orientation.map(|q| q.y),
            vehicle_qz: orientation.map(|q| q.z),
            vehicle_qw: orientation.map(|q| q.w),
        }
    }
}

/// Name of the table.
pub(super) const FILE: &str = "frames.csv";

#[derive(Debug)]
pub(super) struct FrameTable {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl FrameTable {
    /// Creates the folder and the table in it. A folder that cannot be used is bad input: nothing has
    /// been done yet.
    pub(super) fn create(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join(FILE);
        if path.exists() {
            let folder = folder.display();
            tracing::warn!(
                "{folder}: pictures of the same names are replaced, others stay, and {FILE} lists only the new ones"
            );
        }
        let file = std::fs::create_dir_all(folder).and_then(|()| File::create(&path)).map_err(|error| {
            let folder = folder.display();
            Failure::bad_input(format!("{folder}: pictures cannot be written into this folder: {error}"))
        })?;
        Ok(Self { path, writer: csv::Writer::from_writer(file) })
    }

    pub(super) fn add(&mut self, row: &FrameRow<'_>) -> Result<(), Failure> {
        self.writer.serialize(row).map_err(|error| self.lost(&error))
    }

    pub(super) fn finish(&mut self) -> Result<(), Failure> {
        self.writer.flush().map_err(|error| self.lost(&error))
    }

    fn lost(&self, error: &dyn std::fmt::Display) -> Failure {
        Failure::failed(format!("{}: {error}", self.path.display()))
    }
}
