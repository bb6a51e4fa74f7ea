//! `frames.csv`: file, extrinsics and intrinsics of each picture.

use super::PictureFormat;
use city3d_outputs::WholeFile;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_sensors::{Lens, View};
use serde::Serialize;
use std::collections::VecDeque;
use std::io::{self, Write};
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
        let kind = format.kind().name();
        Self { scale: format.metres_per_value(), ..Self::of_kind((file, kind), taken_by, snapshot, view) }
    }

    /// The row of a file with the optical flow of a picture.
    pub fn of_flow(
        file: &'a str,
        taken_by: PictureCamera<'a>,
        snapshot: &FrameSnapshot,
        view: &View,
    ) -> Self {
        Self::of_kind((file, "flow"), taken_by, snapshot, view)
    }

    fn of_kind(
        (file, kind): (&'a str, &'static str),
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
            kind,
            scale: None,
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
    /// A row cannot be encoded.
    #[error("{path}: {source}", path = path.display())]
    Row {
        /// Path of the table.
        path: PathBuf,
        /// What is wrong with the row.
        source: csv::Error,
    },
    /// The table cannot be written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the table.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
}

/// The table of the pictures in a folder: it lists those whose files are whole, and appears when it is finished.
#[derive(Debug)]
pub struct PictureTable {
    path: PathBuf,
    file: WholeFile,
    /// Bytes of the whole rows in the file, with the header.
    length: u64,
    has_header: bool,
    /// Encoded rows of pictures that are not written yet, in their order.
    waiting: VecDeque<Vec<u8>>,
}

impl PictureTable {
    /// Name of the file.
    pub const FILE: &str = "frames.csv";

    /// Begins the table of an existing folder.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn create(folder: &Path) -> Result<Self, PictureTableError> {
        let path = folder.join(Self::FILE);
        match WholeFile::create(&path) {
            Ok(file) => Ok(Self { path, file, length: 0, has_header: false, waiting: VecDeque::new() }),
            Err(source) => Err(PictureTableError::File { path, source }),
        }
    }

    /// Adds the row of a picture that is about to be written.
    ///
    /// # Errors
    /// When it cannot be encoded, or the header cannot be written.
    pub fn add(&mut self, row: &PictureRow<'_>) -> Result<(), PictureTableError> {
        let unencoded = |source| PictureTableError::Row { path: self.path.clone(), source };
        let mut encoder = csv::WriterBuilder::new().has_headers(!self.has_header).from_writer(Vec::new());
        encoder.serialize(row).map_err(unencoded)?;
        let mut bytes = encoder.into_inner().map_err(|error| unencoded(error.into_error().into()))?;
        if !self.has_header {
            let header = bytes.iter().position(|&byte| byte == b'\n').map_or(0, |end| end + 1);
            let row = bytes.split_off(header);
            self.write(&bytes)?;
            (self.has_header, bytes) = (true, row);
        }
        self.waiting.push_back(bytes);
        Ok(())
    }

    /// Writes the rows of the next pictures, as far as these could be written.
    ///
    /// # Errors
    /// When a row cannot be written; those before it stay whole.
    pub fn settle(&mut self, written: &[bool]) -> Result<(), PictureTableError> {
        for &is_written in written {
            let Some(row) = self.waiting.pop_front() else { break };
            if is_written {
                self.write(&row)?;
            }
        }
        Ok(())
    }

    /// Gives the table its name. It has the rows so far, also after an error.
    ///
    /// # Errors
    /// When it cannot be renamed.
    pub fn finish(self) -> Result<(), PictureTableError> {
        let Self { path, file, length, .. } = self;
        let finished = file.cut(length).and_then(|()| file.commit());
        finished.map_err(|source| PictureTableError::File { path, source })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), PictureTableError> {
        let lost = |source| PictureTableError::File { path: self.path.clone(), source };
        self.file.write_all(bytes).map_err(lost)?;
        self.length += bytes.len() as u64;
        Ok(())
    }
}
