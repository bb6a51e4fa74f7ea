//! `boxes.csv`: the boxes of all vehicles in each picture, in the city, in the camera frame and in pixels.

use super::picture_table::PictureCamera;
use city3d_outputs::WholeFile;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_sensors::{BoundingBox, View};
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The row of a vehicle in a picture. Metres, seconds, pixels.
#[derive(Debug, Serialize)]
struct BoxRow<'a> {
    /// Camera, owner and tick are those of the picture in `frames.csv`.
    camera: &'a str,
    vehicle: &'a str,
    tick: u64,
    t: f64,
    id: u32,
    name: &'a str,
    /// Centre of the box, city frame, and city from body.
    x: f64,
    y: f64,
    z: f64,
    qx: f64,
    qy: f64,
    qz: f64,
    qw: f64,
    length: f64,
    width: f64,
    height: f64,
    /// Its centre in the camera frame: right, down, forward.
    camera_x: f64,
    camera_y: f64,
    camera_z: f64,
    /// Amodal rectangle.
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
    /// Share of the rectangle that is outside the picture.
    truncated: f64,
}

/// Why the table of boxes cannot be written.
#[derive(Debug, Error)]
pub enum BoxTableError {
    /// A row cannot be written.
    #[error("{path}: {source}", path = path.display())]
    Row {
        /// Path of the table.
        path: PathBuf,
        /// What is wrong.
        source: csv::Error,
    },
    /// The table cannot be created or completed.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the table.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
}

/// The table of the boxes in the pictures of a folder; it appears when it is finished.
#[derive(Debug)]
pub struct BoxTable {
    path: PathBuf,
    writer: csv::Writer<WholeFile>,
}

impl BoxTable {
    /// Name of the file.
    pub const FILE: &str = "boxes.csv";

    /// Begins the table of an existing folder.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn create(folder: &Path) -> Result<Self, BoxTableError> {
        let path = folder.join(Self::FILE);
        match WholeFile::create(&path) {
            Ok(file) => Ok(Self { path, writer: csv::Writer::from_writer(file) }),
            Err(source) => Err(BoxTableError::File { path, source }),
        }
    }

    /// Adds the vehicles of a picture, in id order: those whose rectangles reach into it, whatever is in front of them, but
    /// not the one that carries the camera.
    ///
    /// # Errors
    /// When a row cannot be written.
    pub fn add(
        &mut self,
        taken_by: PictureCamera<'_>,
        snapshot: &FrameSnapshot,
        view: &View,
    ) -> Result<(), BoxTableError> {
        let camera_from_world = view.extrinsics.world_from_camera().inverse();
        for (state, info) in snapshot.iter().filter(|(state, _)| view.carrier != Some(state.id)) {
            let solid = BoundingBox::of(state, info);
            let Some(rect) = view.rect_of(&solid) else { continue };
            let inside = rect.share_within(view.extent);
            if inside <= 0.0 {
                continue;
            }
            let (q, seen) = (solid.orientation, camera_from_world.transform_point3(solid.centre));
            let row = BoxRow {
                camera: taken_by.camera,
                vehicle: taken_by.owner,
                tick: snapshot.tick,
                t: snapshot.time_s,
                id: state.id.0,
                name: &info.name,
                x: solid.centre.x,
                y: solid.centre.y,
                z: solid.centre.z,
                qx: q.x,
                qy: q.y,
                qz: q.z,
                qw: q.w,
                length: solid.size_m.x,
                width: solid.size_m.y,
                height: solid.size_m.z,
                camera_x: seen.x,
                camera_y: seen.y,
                camera_z: seen.z,
                left: rect.from.x,
                top: rect.from.y,
                right: rect.to.x,
                bottom: rect.to.y,
                truncated: 1.0 - inside,
            };
            let lost = |source| BoxTableError::Row { path: self.path.clone(), source };
            self.writer.serialize(row).map_err(lost)?;
        }
        Ok(())
    }

    /// Gives the table its name.
    ///
    /// # Errors
    /// When it cannot be completed.
    pub fn finish(self) -> Result<(), BoxTableError> {
        let Self { path, writer } = self;
        let file = writer.into_inner().map_err(|error| error.into_error());
        file.and_then(WholeFile::commit).map_err(|source| BoxTableError::File { path, source })
    }
}
