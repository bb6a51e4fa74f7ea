//! Camera of the large view, and its control by mouse and keys.

#![allow(clippy::disallowed_methods, reason = "cameras draw; no state of a run depends on them")]

mod bookmark;
mod first_view;
mod flight;
mod raise;
#[cfg(test)]
mod tests;

pub use bookmark::{Bookmark, Bookmarks};
pub use flight::Flight;

use super::gaze::Gaze;
use super::occlusion;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleState};
use city3d_scene::Wall;
use city3d_sensors::{Camera, Extrinsics, Lens, Mount, View};
use first_view::FirstView;
use glam::{DMat3, DQuat, DVec2, DVec3};
use raise::Raise;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Modes of the large view's camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraMode {
    /// Around a point, or around a vehicle that is followed.
    #[default]
    Orbit,
    /// Behind a vehicle.
    Chase,
    /// Behind the windscreen of a vehicle.
    Onboard,
    /// Straight down, north at the top.
    Overhead,
    /// Free flight by keys.
    Free,
}

impl CameraMode {
    /// All modes, in the order of the toolbar and of the keys 1 to 5.
    pub const ALL: [Self; 5] = [Self::Orbit, Self::Chase, Self::Onboard, Self::Overhead, Self::Free];

    /// Name on the toolbar; in lower case also the value of `--mode`.
    pub fn label(self) -> &'static str {
        match self {
            Self::Orbit => "Orbit",
            Self::Chase => "Chase",
            Self::Onboard => "Onboard",
            Self::Overhead => "Overhead",
            Self::Free => "Free",
        }
    }
}

/// The large view's camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    /// Present mode. Chase and onboard fall back to orbit when no vehicle is followed.
    pub mode: CameraMode,
    /// The followed vehicle. Chase and onboard need one.
    pub follow: Option<VehicleId>,
    /// Looks backwards.
    pub rear: bool,
    /// Ground rectangle that the view fits, until the user moves the camera.
    whole: Option<[DVec2; 2]>,
    first: FirstView,
    /// Whether the best direction has been chosen.
    is_turned: bool,
    target: DVec3,
    distance_m: f64,
    azimuth_rad: f64,
    elevation_rad: f64,
    /// Position of the free camera.
    eye: DVec3,
    yaw_rad: f64,
    pitch_rad: f64,
    /// Chase and onboard cameras, relative to their usual view.
    gaze: Gaze,
    /// The orbit and the chase camera are so much higher than the user has put them, so that nothing hides the vehicle that
    /// they follow.
    raise: Raise,
    /// What the camera eases to.
    goal: Option<Goal>,
    /// The camera path that is being flown.
    flight: Option<Flight>,
}

/// Where the camera eases to.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Goal {
    distance_m: f64,
    elevation_rad: f64,
    /// From the target that it has reached to the one that it eases to.
    to_go: DVec3,
}

/// Margin around the vehicles.
const AROUND_M: f64 = 18.0;
/// Largest fraction of the picture that the fitted rectangle fills.
const MOST_OF_PICTURE: f64 = 0.92;
/// Range of distances of a fitted camera.
const UNMOVED_M: [f64; 2] = [50.0, 240.0];
/// Largest distance from which a whole city is shown.
const CITY_M: f64 = 4000.0;
/// Default azimuth and elevation.
const UNTURNED_RAD: [f64; 2] = [-1.9, 0.85];
/// Candidate directions where walls occlude vehicles: this many azimuths at the default elevation and at a steeper
/// one.
const SIDES: u32 = 8;
const STEEPER_RAD: f64 = 1.2;
/// Largest distance from which an event is shown.
const EVENT_M: f64 = 60.0;
/// Distance from which a vehicle is followed or framed.
const VEHICLE_M: f64 = 15.0;
/// Time constant of easing, and what is left when it ends.
const EASES_S: f64 = 0.15;
const EASED: f64 = 0.01;
const NEAREST_M: f64 = 3.0;
const FARTHEST_M: f64 = 600.0;
const LOWEST_RAD: f64 = 0.03;
const STEEPEST_RAD: f64 = FRAC_PI_2 - 0.02;
/// Roofs and what stands on them hide so far above the walls that are known, metres.
const ROOF_M: f32 = 2.0;
/// The camera rises before the followed vehicle is hidden, seconds.
const FORESIGHT_S: f64 = 0.7;
/// Largest distance of what is zoomed at from the middle of the view, in distances of the camera.
const MOST_OFF: f64 = 2.0;
/// Rotation per point of mouse motion.
const RAD_PER_POINT: f64 = 0.006;

impl Viewpoint {
    /// An orbit camera around all vehicles.
    pub fn around(snapshot: &FrameSnapshot) -> Self {
        let positions = || snapshot.vehicles.iter().map(|v| v.position);
        let low = positions().fold(DVec3::INFINITY, DVec3::min);
        let high = positions().fold(DVec3::NEG_INFINITY, DVec3::max);
        let (target, reach_m) =
            if low.is_finite() { ((low + high) / 2.0, (high - low).length()) } else { (DVec3::ZERO, 150.0) };
        let [nearest, farthest] = UNMOVED_M;
        let distance_m = (1.1 * reach_m).clamp(nearest, farthest);
        Self {
            mode: CameraMode::Orbit,
            follow: None,
            rear: false,
            whole: low.is_finite().then(|| [low.truncate() - AROUND_M, high.truncate() + AROUND_M]),
            first: FirstView::Unchosen,
            is_turned: false,
            target,
            distance_m,
            azimuth_rad: UNTURNED_RAD[0],
            elevation_rad: UNTURNED_RAD[1],
            eye: target + DVec3::new(-0.3, -0.75, 0.5) * distance_m,
            yaw_rad: 1.2,
            pitch_rad: -0.5,
            gaze: Gaze::default(),
            raise: Raise::default(),
            goal: None,
            flight: None,
        }
    }

    /// Fits all vehicles into the picture again, until the user moves the camera.
    pub fn frame_all(&mut self, snapshot: &FrameSnapshot) {
        let Self { whole, target, .. } = Self::around(snapshot);
        (self.follow, self.goal) = (None, None);
        if self.mode != CameraMode::Overhead {
            self.mode = CameraMode::Orbit;
        }
        (self.whole, self.target, self.is_turned) = (whole, target, true);
        self.first = FirstView::Chosen;
    }

    /// Eases to a place near a vehicle without following it, and as high as no house hides it.
    pub fn frame(&mut self, vehicle: &VehicleState, walls: &[Wall]) {
        (self.follow, self.whole) = (None, None);
        if self.mode != CameraMode::Overhead {
            self.mode = CameraMode::Orbit;
        }
        self.ease_to(vehicle.position);
        let Some(goal) = self.goal.as_mut().filter(|_| self.mode == CameraMode::Orbit) else { return };
        let point = vehicle.position + DVec3::Z;
        let hides = |raise_rad: f64| {
            let up_rad = (self.elevation_rad + raise_rad).min(STEEPEST_RAD);
            let (sin, cos) = self.azimuth_rad.sin_cos();
            let (up, out) = up_rad.sin_cos();
            let eye = point + DVec3::new(cos * out, sin * out, up) * goal.distance_m;
            occlusion::is_occluded_up_to(eye, point, (walls, ROOF_M))
        };
        let raise_rad = Raise::default().needed_rad(hides);
        goal.elevation_rad = (self.elevation_rad + raise_rad).min(STEEPEST_RAD);
    }

    /// Follows a vehicle, and eases to it where the camera was elsewhere; `None` stops following.
    pub fn follow(&mut self, vehicle: Option<&VehicleState>) {
        self.follow = vehicle.map(|vehicle| vehicle.id);
        self.gaze = Gaze::default();
        if let Some(vehicle) = vehicle.filter(|_| self.mode == CameraMode::Orbit) {
            self.ease_to(vehicle.position);
        }
    }

    fn ease_to(&mut self, position: DVec3) {
        let distance_m = self.distance_m.min(VEHICLE_M);
        self.goal =
            Some(Goal { distance_m, elevation_rad: self.elevation_rad, to_go: position - self.target });
    }

    /// Raises the camera over what hides the followed vehicle, and lowers it again once nothing does, in a frame of `dt_s`;
    /// returns whether it still moves.
    pub fn keep_in_sight(&mut self, seen: &FrameSnapshot, walls: &[Wall], dt_s: f64) -> bool {
        let followed = self.follow.and_then(|id| seen.vehicle(id));
        let is_raised = !self.rear && matches!(self.mode, CameraMode::Orbit | CameraMode::Chase);
        if self.follow.is_none() {
            // Who lets go of a vehicle goes on seeing what they saw.
            let raised_by_rad = std::mem::take(&mut self.raise).by_rad();
            self.elevation_rad = (self.elevation_rad + raised_by_rad).min(STEEPEST_RAD);
            return false;
        }
        let Some(vehicle) = followed.filter(|_| is_raised) else { return self.raise.ease_to(0.0, dt_s) };
        let mut raise = self.raise;
        let soon = (vehicle.forward() * (vehicle.speed_mps * FORESIGHT_S)).extend(0.0);
        let needed_rad = raise.needed_rad(|by_rad| {
            let eye = self.raised_view(seen, [16, 9], by_rad).extrinsics.position;
            // Seen by whoever rises only once it is hidden, it would be gone for a moment.
            [DVec3::ZERO, soon].into_iter().any(|by| {
                let point = vehicle.position + DVec3::Z + by;
                occlusion::is_occluded_up_to(eye + by, point, (walls, ROOF_M))
            })
        });
        self.raise = raise;
        self.raise.ease_to(needed_rad, dt_s)
    }

    /// Goes on easing for a frame of `dt_s`; returns whether it has not come to its end.
    pub fn ease(&mut self, dt_s: f64) -> bool {
        let Some(goal) = &mut self.goal else { return false };
        let left = (-dt_s / EASES_S).exp();
        let gone = goal.to_go * (1.0 - left);
        goal.to_go -= gone;
        self.target += gone;
        self.distance_m = goal.distance_m + (self.distance_m - goal.distance_m) * left;
        self.elevation_rad = goal.elevation_rad + (self.elevation_rad - goal.elevation_rad) * left;
        let off_m = (self.distance_m - goal.distance_m).abs()
            + goal.to_go.length()
            + (self.elevation_rad - goal.elevation_rad).abs() * goal.distance_m;
        if off_m < EASED * goal.distance_m {
            (self.distance_m, self.target) = (goal.distance_m, self.target + goal.to_go);
            self.elevation_rad = goal.elevation_rad;
            self.goal = None;
        }
        self.goal.is_some()
    }

    /// Fits all vehicles into the picture, as long as the user has not moved the camera.
    pub fn show_whole(&mut self, seen: &FrameSnapshot, extent: [u32; 2], walls: &[Wall]) {
        if self.mode == CameraMode::Free && self.whole.is_some() && !self.is_turned {
            // An unmoved free camera starts where the orbit camera would be.
            self.mode = CameraMode::Orbit;
            self.show_whole(seen, extent, walls);
            return self.set_mode(CameraMode::Free, None);
        }
        let is_apt = self.follow.is_none() && matches!(self.mode, CameraMode::Orbit | CameraMode::Overhead);
        let Some(whole) = self.whole.filter(|_| is_apt && extent.iter().all(|pixels| *pixels > 1)) else {
            return;
        };
        if self.mode == CameraMode::Orbit && !self.is_turned {
            *self = self.turned(whole, seen, extent, walls);
        }
        self.fit(whole, seen, extent);
    }

    /// The direction from which walls occlude the fewest vehicles.
    fn turned(&self, whole: [DVec2; 2], seen: &FrameSnapshot, extent: [u32; 2], walls: &[Wall]) -> Self {
        let sides = (0..SIDES).map(|k| TAU * f64::from(k) / f64::from(SIDES));
        let ways = [UNTURNED_RAD[1], STEEPER_RAD]
            .into_iter()
            .flat_map(|up| sides.clone().map(move |turn| (turn, up)));
        let look = |(turn, elevation_rad)| {
            let azimuth_rad = UNTURNED_RAD[0] + turn;
            let mut turned = Self { azimuth_rad, elevation_rad, is_turned: true, ..self.clone() };
            turned.fit(whole, seen, extent);
            let eye = turned.view(seen, extent).extrinsics.position;
            let is_hidden = |v: &&VehicleState| occlusion::is_occluded(eye, v.position + DVec3::Z, walls);
            (seen.vehicles.iter().filter(is_hidden).count(), turned)
        };
        // Of equals the first, which is the default.
        let best = ways.map(look).min_by_key(|(hidden, _)| *hidden);
        best.map_or_else(|| self.clone(), |(_, turned)| turned)
    }

    /// Fits a ground rectangle into the picture by fixed-point iteration over target and distance.
    fn fit(&mut self, [low, high]: [DVec2; 2], seen: &FrameSnapshot, extent: [u32; 2]) {
        let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
        let room = DVec2::from(extent.map(f64::from));
        let [nearest, farthest] = UNMOVED_M;
        let farthest = if self.first == FirstView::City { CITY_M } else { farthest };
        let focal = room.y / 2.0 / (Lens::default().vertical_fov_rad / 2.0).tan();
        let middle = ((low + high) / 2.0).extend(0.0);
        (self.target, self.distance_m) = (middle, farthest);
        for _ in 0..12 {
            let view = self.view(seen, extent);
            let on_screen = corners.map(|corner| view.project(corner.extend(0.0)));
            let [Some(a), Some(b), Some(c), Some(d)] = on_screen else {
                (self.target, self.distance_m) = (middle, farthest);
                break;
            };
            let (least, most) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
            let off_m = ((least + most) / 2.0 - room / 2.0) * (self.distance_m / focal);
            self.drag_ground(-off_m.x, -off_m.y);
            let share = ((most - least) / (room * MOST_OF_PICTURE)).max_element();
            self.distance_m = (self.distance_m * share).clamp(nearest, farthest);
        }
    }

    /// Pans: drags the ground by metres to the right and towards the viewer.
    fn drag_ground(&mut self, right_m: f64, near_m: f64) {
        let azimuth_rad = if self.mode == CameraMode::Overhead { -FRAC_PI_2 } else { self.azimuth_rad };
        let (sin, cos) = azimuth_rad.sin_cos();
        let (near, east) = (DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0));
        self.target -= east * right_m + near * near_m;
    }

    /// The vehicle nearest to the middle of the view.
    pub(super) fn nearest(&self, seen: &FrameSnapshot) -> Option<VehicleId> {
        let middle = if self.mode == CameraMode::Free { self.eye } else { self.target };
        let distance = |vehicle: &VehicleState| vehicle.position.distance_squared(middle);
        seen.vehicles.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|vehicle| vehicle.id)
    }

    /// Changes the mode for whoever has selected a vehicle: chase and onboard take that one.
    pub fn choose_mode(&mut self, mode: CameraMode, selected: Option<VehicleId>) {
        if matches!(mode, CameraMode::Chase | CameraMode::Onboard) {
            self.follow = selected.or(self.follow);
        }
        self.set_mode(mode, selected);
    }

    /// Changes the mode and keeps about the same position. A mode that needs a vehicle takes `nearest`.
    pub fn set_mode(&mut self, mode: CameraMode, nearest: Option<VehicleId>) {
        if matches!(mode, CameraMode::Chase | CameraMode::Onboard) {
            self.follow = self.follow.or(nearest);
        }
        if mode == CameraMode::Free && self.mode != CameraMode::Free {
            let (sin, cos) = self.azimuth_rad.sin_cos();
            let (up, out) = self.elevation_rad.sin_cos();
            self.eye = self.target + DVec3::new(cos * out, sin * out, up) * self.distance_m;
            (self.yaw_rad, self.pitch_rad) = (self.azimuth_rad + FRAC_PI_2 * 2.0, -self.elevation_rad);
            self.follow = None;
        }
        if mode != self.mode {
            (self.gaze, self.goal) = (Gaze::default(), None);
        }
        self.mode = mode;
    }

    /// Moves the target with the followed vehicle; stops following a vehicle that has left.
    pub fn update(&mut self, seen: &FrameSnapshot) {
        self.follow = self.follow.filter(|id| seen.vehicle(*id).is_some());
        if let Some(vehicle) = self.follow.and_then(|id| seen.vehicle(id)) {
            self.target = vehicle.position - self.goal.map_or(DVec3::ZERO, |goal| goal.to_go);
            self.whole = None;
            // A wheel that is turned back acts at once.
            if let Some(info) = seen.info(vehicle.id).filter(|_| self.mode == CameraMode::Chase) {
                self.gaze.keep_outside(&info.dimensions);
            }
        } else if matches!(self.mode, CameraMode::Chase | CameraMode::Onboard) {
            self.mode = CameraMode::Orbit;
        }
    }

    /// Comes near enough to show an event of the followed vehicle.
    pub fn come_near(&mut self) {
        self.distance_m = self.distance_m.min(EVENT_M);
        self.whole = None;
    }

    /// Moves the middle of the view to a point of the ground.
    pub fn look_at(&mut self, point: DVec2) {
        (self.follow, self.whole, self.goal) = (None, None, None);
        self.target = point.extend(0.0);
        if matches!(self.mode, CameraMode::Chase | CameraMode::Onboard) {
            self.mode = CameraMode::Orbit;
        }
        if self.mode == CameraMode::Free {
            self.eye = self.target - self.forward() * 40.0;
        }
    }

    fn forward(&self) -> DVec3 {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let (up, out) = self.pitch_rad.sin_cos();
        DVec3::new(cos * out, sin * out, up)
    }

    /// The camera, higher by an angle than the user has put it.
    fn camera(&self, raise_rad: f64) -> Camera {
        match (self.mode, self.follow) {
            (CameraMode::Chase, Some(vehicle)) => {
                let distance_m = if self.rear { -8.0 } else { 9.0 };
                Camera::Chase { vehicle, distance_m, height_m: 3.6 }
            }
            (CameraMode::Onboard, Some(vehicle)) => Camera::onboard(vehicle, Mount::Windscreen),
            (CameraMode::Overhead, _) => {
                Camera::Overhead { centre: self.target.truncate(), height_m: self.distance_m }
            }
            (CameraMode::Free, _) => {
                Camera::Fixed(Extrinsics::looking_at(self.eye, self.eye + self.forward()))
            }
            _ => Camera::Orbit {
                target: self.target + DVec3::Z,
                distance_m: self.distance_m,
                azimuth_rad: self.azimuth_rad,
                elevation_rad: (self.elevation_rad + raise_rad).min(STEEPEST_RAD),
            },
        }
    }

    /// The view of a snapshot for a picture of some pixels.
    pub fn view(&self, seen: &FrameSnapshot, extent: [u32; 2]) -> View {
        self.raised_view(seen, extent, self.raise.by_rad())
    }

    /// The same of a camera that is higher by an angle than the user has put it.
    fn raised_view(&self, seen: &FrameSnapshot, extent: [u32; 2], raise_rad: f64) -> View {
        let usual = Lens { extent, ..Lens::default() };
        let lens = if self.mode == CameraMode::Onboard { self.gaze.lens(usual) } else { usual };
        let fallback = || {
            let from = self.target + DVec3::new(0.0, -1.0, 1.0) * self.distance_m;
            View::new(Extrinsics::looking_at(from, self.target), &lens)
        };
        let view = self.camera(raise_rad).view(seen, &lens);
        let mut view = view.unwrap_or_else(|_| fallback());
        if let Some(state) = self.follow.and_then(|id| seen.vehicle(id)) {
            match self.mode {
                CameraMode::Chase if !self.rear => {
                    let dimensions = seen.info(state.id).map(|info| &info.dimensions);
                    view.extrinsics = self.gaze.raised(raise_rad).chase(state, dimensions);
                }
                CameraMode::Onboard => view.extrinsics = self.gaze.onboard(state, view.extrinsics),
                _ => {}
            }
        }
        if self.rear && self.mode == CameraMode::Onboard {
            let about = DQuat::from_mat3(&DMat3::from_cols(-DVec3::X, DVec3::Y, -DVec3::Z));
            view.extrinsics.orientation *= about;
        }
        if self.rear && self.mode == CameraMode::Chase {
            self.look_back(seen, &mut view);
        }
        view
    }

    /// Turns the chase camera backwards, over the vehicle.
    fn look_back(&self, seen: &FrameSnapshot, view: &mut View) {
        if let Some(state) = self.follow.and_then(|id| seen.vehicle(id)) {
            let back = -state.forward().extend(0.0);
            let target = state.position + back * 6.0 + DVec3::Z;
            view.extrinsics = Extrinsics::looking_at(view.extrinsics.position, target);
        }
    }

    /// Rotates the view by a mouse drag, points.
    pub fn turn(&mut self, right: f64, down: f64) {
        self.whole = None;
        match self.mode {
            CameraMode::Overhead => self.shift(right, down),
            CameraMode::Free => {
                self.yaw_rad = (self.yaw_rad - right * RAD_PER_POINT).rem_euclid(TAU);
                self.pitch_rad = (self.pitch_rad - down * RAD_PER_POINT).clamp(-1.5, 1.5);
            }
            CameraMode::Orbit => {
                self.azimuth_rad = (self.azimuth_rad - right * RAD_PER_POINT).rem_euclid(TAU);
                let elevation = self.elevation_rad + down * RAD_PER_POINT;
                self.elevation_rad = elevation.clamp(LOWEST_RAD, STEEPEST_RAD);
                // Who turns the view meanwhile decides.
                if let Some(goal) = &mut self.goal {
                    goal.elevation_rad = self.elevation_rad;
                }
            }
            CameraMode::Chase => self.gaze.turn_chase(right * RAD_PER_POINT, down * RAD_PER_POINT),
            CameraMode::Onboard => self.gaze.turn_onboard(right * RAD_PER_POINT, down * RAD_PER_POINT),
        }
    }

    /// Pans the view by a mouse drag, points.
    pub fn shift(&mut self, right: f64, down: f64) {
        let metres = self.distance_m * 0.0016;
        self.whole = None;
        match self.mode {
            CameraMode::Overhead | CameraMode::Orbit => {
                (self.follow, self.goal) = (None, None);
                self.drag_ground(right * metres, down * metres);
            }
            CameraMode::Free => self.fly(DVec3::new(-right, 0.0, down) * 0.05),
            CameraMode::Chase | CameraMode::Onboard => {}
        }
    }

    /// Zooms in for positive steps of the mouse wheel.
    pub fn zoom(&mut self, steps: f64) {
        self.whole = None;
        match self.mode {
            CameraMode::Free => self.fly(DVec3::new(0.0, steps * 3.0, 0.0)),
            CameraMode::Chase => self.gaze.zoom_chase(steps),
            CameraMode::Onboard => self.gaze.zoom_onboard(steps),
            CameraMode::Orbit | CameraMode::Overhead => {
                self.distance_m = (self.distance_m * 0.88_f64.powf(steps)).clamp(NEAREST_M, FARTHEST_M);
                if let Some(goal) = &mut self.goal {
                    goal.distance_m = self.distance_m;
                }
            }
        }
    }

    /// The same towards or away from a point of the ground, which stays at its place of the picture; a camera that follows a
    /// vehicle or looks from its place keeps to its own middle.
    pub fn zoom_at(&mut self, steps: f64, point: Option<DVec2>) {
        let before_m = self.distance_m;
        self.zoom(steps);
        let has_middle =
            matches!(self.mode, CameraMode::Orbit | CameraMode::Overhead) && self.follow.is_none();
        if let Some(point) = point.filter(|_| has_middle && self.goal.is_none()) {
            // Of a point near the horizon only the direction matters: the view would leap.
            let off = (point - self.target.truncate()).clamp_length_max(MOST_OFF * before_m);
            self.target += (off * (1.0 - self.distance_m / before_m)).extend(0.0);
        }
    }

    /// Moves by metres to the right, forward and up in the camera's heading.
    pub fn fly(&mut self, by: DVec3) {
        self.whole = None;
        match self.mode {
            CameraMode::Free => {
                let forward = self.forward();
                let right = forward.cross(DVec3::Z).normalize_or(DVec3::X);
                self.eye += right * by.x + forward * by.y + DVec3::Z * by.z;
                self.eye.z = self.eye.z.max(0.5);
            }
            CameraMode::Orbit | CameraMode::Overhead => {
                let ahead = if self.mode == CameraMode::Overhead {
                    FRAC_PI_2
                } else {
                    self.azimuth_rad + FRAC_PI_2 * 2.0
                };
                let (sin, cos) = ahead.sin_cos();
                self.target += DVec3::new(cos, sin, 0.0) * by.y + DVec3::new(sin, -cos, 0.0) * by.x;
                if by.x != 0.0 || by.y != 0.0 {
                    (self.follow, self.goal) = (None, None);
                }
            }
            CameraMode::Chase | CameraMode::Onboard => {}
        }
    }
}
