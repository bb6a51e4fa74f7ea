//! Bookmarks of the large view's camera: nine places to come back to.

use super::{CameraMode, FirstView, Raise, Viewpoint};
use crate::ui::gaze::Gaze;
use city3d_protocol::snapshot::VehicleId;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A stored camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bookmark {
    /// From 1 to 9: its key.
    pub number: u8,
    mode: CameraMode,
    /// The followed vehicle.
    follow: Option<VehicleId>,
    target: DVec3,
    distance_m: f64,
    azimuth_rad: f64,
    elevation_rad: f64,
    eye: DVec3,
    yaw_rad: f64,
    pitch_rad: f64,
    /// Turn and zoom of a chase or onboard camera.
    #[serde(default)]
    gaze: Gaze,
}

/// The stored cameras, in the order of their numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Bookmarks(Vec<Bookmark>);

impl Bookmarks {
    /// Stores a camera under a number.
    pub fn set(&mut self, number: u8, viewpoint: &Viewpoint) {
        self.0.retain(|bookmark| bookmark.number != number);
        self.0.push(viewpoint.bookmark(number));
        self.0.sort_by_key(|bookmark| bookmark.number);
    }

    /// All stored cameras, by their numbers.
    pub fn iter(&self) -> impl Iterator<Item = &Bookmark> {
        self.0.iter()
    }

    /// The camera that is stored under a number.
    pub fn get(&self, number: u8) -> Option<&Bookmark> {
        self.0.iter().find(|bookmark| bookmark.number == number)
    }
}

impl Viewpoint {
    fn bookmark(&self, number: u8) -> Bookmark {
        Bookmark {
            number,
            mode: self.mode,
            follow: self.follow,
            target: self.target,
            distance_m: self.distance_m,
            azimuth_rad: self.azimuth_rad,
            elevation_rad: self.elevation_rad,
            eye: self.eye,
            yaw_rad: self.yaw_rad,
            pitch_rad: self.pitch_rad,
            gaze: self.gaze,
        }
    }

    /// Goes to a stored camera. A vehicle that has left is not followed.
    pub fn recall(&mut self, bookmark: &Bookmark) {
        *self = Self::stored(bookmark);
    }

    /// A stored camera.
    pub(super) fn stored(bookmark: &Bookmark) -> Self {
        Self {
            mode: bookmark.mode,
            follow: bookmark.follow,
            rear: false,
            whole: None,
            first: FirstView::Chosen,
            is_turned: true,
            target: bookmark.target,
            distance_m: bookmark.distance_m,
            azimuth_rad: bookmark.azimuth_rad,
            elevation_rad: bookmark.elevation_rad,
            eye: bookmark.eye,
            yaw_rad: bookmark.yaw_rad,
            pitch_rad: bookmark.pitch_rad,
            gaze: bookmark.gaze,
            raise: Raise::default(),
            goal: None,
            flight: None,
        }
    }
}
