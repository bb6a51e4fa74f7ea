//! `frames.csv`: file, extrinsics and intrinsics of each picture.

use super::PictureFormat;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_sensors::{Lens, View};
use serde::Serialize;
use std::fs::File;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The camera of a picture, as the table names it.
#[derive(Clone, Copy, Debug)]
pub struct PictureCamera<'a> {
    /// Name of the camera.
    pub camera: &'a str,
    /// Name of the vehicle that it belongs to, or `city`.
    pub owner: &'a str,
    /// That vehicle.
    pub vehicle: Option<VehicleId>,
    /// Its lens, which has the intrinsics.
    pub lens: Lens,
}

/// The row of a picture. Metres in the city frame, seconds, pixels.
#[derive(Debug, Serialize)]
pub struct PictureRow<'a> {
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

impl<'a> PictureRow<'a> {
    /// The row of a file with the picture of a view at an instant.
    pub fn new(
        (file, format): (&'a str, PictureFormat),
        taken_by: PictureCamera<'a>,
        snapshot: &FrameSnapshot,
        view: &View,
    ) -> Self {
        let (p, q, k) = (view.extrinsics.position, view.extrinsics.orientation, taken_by.lens.intrinsics());
        let carrier = taken_by.vehicle.and_then(|id| snapshot.vehicle(id));
        let position = carrier.map(|state| state.position);
        let orientation = carrier.map(|state| state.orientation);
        Self {
            file,
            kind: format.kind().name(),
            scale: format.metres_per_value(),
            vehicle: taken_by.owner,
            camera: taken_by.camera,
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

/// Why the table of pictures cannot be written.
#[derive(Debug, Error)]
pub enum PictureTableError {
    /// The folder or the table in it cannot be created.
    #[error("{folder}: pictures cannot be written into this folder: {source}", folder = folder.display())]
    Folder {
        /// Path of the folder.
        folder: PathBuf,
        /// Reason of the operating system.
        source: std::io::Error,
    },
    /// A row cannot be written.
    #[error("{path}: {source}", path = path.display())]
    Row {
        /// Path of the table.
        path: PathBuf,
        /// What is wrong with the row or the file.
        source: csv::Error,
    },
    /// The last rows cannot be written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the table.
        path: PathBuf,
        /// Reason of the operating system.
        source: std::io::Error,
    },
}

/// The table of the pictures in a folder.
#[derive(Debug)]
pub struct PictureTable {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl PictureTable {
    /// Name of the file.
    pub const FILE: &str = "frames.csv";

    /// Creates the folder and the table in it; a table that is there is replaced.
    ///
    /// # Errors
    /// [`PictureTableError::Folder`].
    pub fn create(folder: &Path) -> Result<Self, PictureTableError> {
        let path = folder.join(Self::FILE);
        let file = std::fs::create_dir_all(folder).and_then(|()| File::create(&path));
        let file =
            file.map_err(|source| PictureTableError::Folder { folder: folder.to_path_buf(), source })?;
        Ok(Self { path, writer: csv::Writer::from_writer(file) })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn add(&mut self, row: &PictureRow<'_>) -> Result<(), PictureTableError> {
        let lost = |source| PictureTableError::Row { path: self.path.clone(), source };
        self.writer.serialize(row).map_err(lost)
    }

    /// Writes the rows that are still in memory.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn finish(&mut self) -> Result<(), PictureTableError> {
        let lost = |source| PictureTableError::File { path: self.path.clone(), source };
        self.writer.flush().map_err(lost)
    }
}
