//! A camera path: the free camera flies along the bookmarks, from one to the next.

use super::bookmark::{Bookmark, Bookmarks};
use super::{CameraMode, Viewpoint};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_sensors::Lens;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Time from one bookmark to the next, seconds.
const LEG_S: f64 = 4.0;

/// A flight that goes on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Flight {
    /// Places and directions of the camera: eye, and unit vector of the view.
    stops: Vec<[DVec3; 2]>,
    flown_s: f64,
}

impl Flight {
    /// A flight along all bookmarks whose cameras have a place of their own; `None` with fewer than two of them. Cameras that
    /// ride on a vehicle are left out.
    pub fn along(bookmarks: &Bookmarks) -> Option<Self> {
        let stops: Vec<_> = bookmarks.iter().filter_map(stop).collect();
        (stops.len() > 1).then_some(Self { stops, flown_s: 0.0 })
    }

    /// Flies on for a frame; `None` beyond the last stop.
    fn fly(&mut self, dt_s: f64) -> Option<[DVec3; 2]> {
        self.flown_s += dt_s;
        let at = self.flown_s / LEG_S;
        let leg = at as usize;
        if leg + 1 >= self.stops.len() {
            return None;
        }
        // Eased at both ends of a leg, so that the camera dwells at each bookmark.
        let share = at - leg as f64;
        let share = share * share * (3.0 - 2.0 * share);
        let [from, to] = [self.stops[leg], self.stops[leg + 1]];
        Some([from[0].lerp(to[0], share), turned(from[1], to[1], share)])
    }
}

/// A direction between two others, by the shorter way; over the zenith where they are opposite.
fn turned(from: DVec3, to: DVec3, share: f64) -> DVec3 {
    let between = from.lerp(to, share);
    between.try_normalize().unwrap_or(DVec3::Z)
}

/// The place and direction of a stored camera.
fn stop(bookmark: &Bookmark) -> Option<[DVec3; 2]> {
    let camera = Viewpoint::stored(bookmark);
    match camera.mode {
        CameraMode::Free | CameraMode::Orbit => {
            let extrinsics = camera.view(&FrameSnapshot::default(), Lens::default().extent).extrinsics;
            Some([extrinsics.position, -(extrinsics.orientation * DVec3::Z)])
        }
        // North stays above.
        CameraMode::Overhead => {
            let (up, out) = (FRAC_PI_2 - LEVEL_RAD).sin_cos();
            Some([camera.target + DVec3::Z * camera.distance_m, DVec3::new(0.0, out, -up)])
        }
        CameraMode::Chase | CameraMode::Onboard => None,
    }
}

/// Straight down has no heading: this much off it.
const LEVEL_RAD: f64 = 0.02;

impl Viewpoint {
    /// Begins a flight; the camera is free from then on.
    pub fn begin_flight(&mut self, flight: Flight) {
        self.set_mode(CameraMode::Free, None);
        self.whole = None;
        self.flight = Some(flight);
    }

    /// Whether it flies.
    pub fn is_flying(&self) -> bool {
        self.flight.is_some()
    }

    /// Ends a flight where it is.
    pub fn end_flight(&mut self) {
        self.flight = None;
    }

    /// Flies on for a frame of `dt_s`; returns whether it still flies. Another mode ends a flight.
    pub fn go_on_flying(&mut self, dt_s: f64) -> bool {
        if self.mode != CameraMode::Free {
            self.flight = None;
        }
        let Some(flight) = &mut self.flight else { return false };
        match flight.fly(dt_s) {
            Some([eye, forward]) => {
                self.eye = eye;
                self.yaw_rad = forward.y.atan2(forward.x).rem_euclid(2.0 * PI);
                self.pitch_rad = forward.z.clamp(-1.0, 1.0).asin();
                true
            }
            None => {
                self.flight = None;
                false
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_flies_from_bookmark_to_bookmark_and_stays_at_the_last() {
        let mut viewpoint = Viewpoint::around(&FrameSnapshot::default());
        let mut bookmarks = Bookmarks::default();
        assert_eq!(Flight::along(&bookmarks), None);
        let mut eyes = Vec::new();
        for number in [1, 2, 3] {
            viewpoint.zoom(3.0);
            viewpoint.turn(200.0, 30.0);
            bookmarks.set(number, &viewpoint);
            eyes.push(stop(bookmarks.get(number).unwrap()).unwrap());
        }
        let mut camera = viewpoint.clone();
        camera.begin_flight(Flight::along(&bookmarks).unwrap());
        let mut seen = Vec::new();
        let mut last = None;
        for _ in 0..1000 {
            if !camera.go_on_flying(0.02) {
                break;
            }
            let step_m = last.map_or(0.0, |last: DVec3| last.distance(camera.eye));
            assert!(step_m < 1.5, "it does not jump: {step_m} m");
            last = Some(camera.eye);
            seen.push(camera.eye);
        }
        assert!((380..=400).contains(&seen.len()), "two legs of four seconds: {}", seen.len());
        for (k, [eye, forward]) in eyes.iter().enumerate() {
            let nearest = seen.iter().map(|at| at.distance(*eye)).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.1, "bookmark {k}: {nearest} m");
            assert!((forward.length() - 1.0).abs() < 1e-9);
        }
        assert!(camera.forward().dot(eyes[2][1]) > 0.999 && camera.mode == CameraMode::Free);
        // Another mode ends it.
        camera.begin_flight(Flight::along(&bookmarks).unwrap());
        camera.set_mode(CameraMode::Orbit, None);
        assert!(!camera.go_on_flying(0.02) && !camera.is_flying());
    }
}
