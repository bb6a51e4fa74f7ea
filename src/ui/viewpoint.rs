//! Where the large view looks from, and how mouse and keys move it.

#![allow(clippy::disallowed_methods, reason = "cameras draw; no state of a run depends on them")]

use super::sight;
use crate::camera::{Camera, Extrinsics, Lens, Mount, View};
use crate::city::scene::Wall;
use crate::snapshot::{FrameSnapshot, VehicleId, VehicleState};
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, TAU};

/// The kinds of large view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Around a point, or around a vehicle that is followed.
    #[default]
    Orbit,
    /// Behind a vehicle.
    Chase,
    /// Behind the windscreen of a vehicle.
    Onboard,
    /// Straight down, north at the top.
    Overhead,
    /// Flies where the keys send it.
    Free,
}

impl Mode {
    pub const ALL: [Self; 5] = [Self::Orbit, Self::Chase, Self::Onboard, Self::Overhead, Self::Free];

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
    pub mode: Mode,
    /// Whose motion the camera shares. Chase and onboard need one; the others may go without.
    pub follow: Option<VehicleId>,
    /// Looks back from the vehicle.
    pub rear: bool,
    /// Corners of the ground that shall be seen whole, until somebody moves the camera.
    whole: Option<[DVec2; 2]>,
    /// Whether it has turned to the side from which most is seen.
    is_turned: bool,
    target: DVec3,
    distance_m: f64,
    azimuth_rad: f64,
    elevation_rad: f64,
    /// Of the free camera.
    eye: DVec3,
    yaw_rad: f64,
    pitch_rad: f64,
}

/// What drives is seen with so much of the city around it.
const AROUND_M: f64 = 18.0;
/// It takes no more than this share of the picture.
const MOST_OF_PICTURE: f64 = 0.92;
/// The distance of a camera that nobody has moved.
const UNMOVED_M: [f64; 2] = [50.0, 240.0];
/// Azimuth and elevation of a camera for which it makes no difference.
const UNTURNED_RAD: [f64; 2] = [-1.9, 0.85];
/// Tried where walls hide vehicles: so many sides, from the usual elevation and from a steeper one.
const SIDES: u32 = 8;
const STEEPER_RAD: f64 = 1.2;
/// What happens to a vehicle is looked at from no farther away.
const EVENT_M: f64 = 60.0;
const NEAREST_M: f64 = 3.0;
const FARTHEST_M: f64 = 600.0;
const LOWEST_RAD: f64 = 0.03;
const STEEPEST_RAD: f64 = FRAC_PI_2 - 0.02;
/// Turn of the camera for a pixel that the mouse is dragged.
const RAD_PER_POINT: f64 = 0.006;

impl Viewpoint {
    /// Around everything that drives.
    pub fn around(snapshot: &FrameSnapshot) -> Self {
        let positions = || snapshot.vehicles.iter().map(|v| v.position);
        let low = positions().fold(DVec3::INFINITY, DVec3::min);
        let high = positions().fold(DVec3::NEG_INFINITY, DVec3::max);
        let (target, reach_m) =
            if low.is_finite() { ((low + high) / 2.0, (high - low).length()) } else { (DVec3::ZERO, 150.0) };
        let [nearest, farthest] = UNMOVED_M;
        let distance_m = (1.1 * reach_m).clamp(nearest, farthest);
        Self {
            mode: Mode::Orbit,
            follow: None,
            rear: false,
            whole: low.is_finite().then(|| [low.truncate() - AROUND_M, high.truncate() + AROUND_M]),
            is_turned: false,
            target,
            distance_m,
            azimuth_rad: UNTURNED_RAD[0],
            elevation_rad: UNTURNED_RAD[1],
            eye: target + DVec3::new(-0.3, -0.75, 0.5) * distance_m,
            yaw_rad: 1.2,
            pitch_rad: -0.5,
        }
    }

    /// Goes to where everything that drives is seen, in a picture of some pixels, as long as nobody has moved it.
    pub fn show_whole(&mut self, seen: &FrameSnapshot, extent: [u32; 2], walls: &[Wall]) {
        if self.mode == Mode::Free && self.whole.is_some() && !self.is_turned {
            // A free camera that nobody has moved begins where the orbit would be.
            self.mode = Mode::Orbit;
            self.show_whole(seen, extent, walls);
            return self.set_mode(Mode::Free, None);
        }
        let is_apt = self.follow.is_none() && matches!(self.mode, Mode::Orbit | Mode::Overhead);
        let Some(whole) = self.whole.filter(|_| is_apt && extent.iter().all(|pixels| *pixels > 1)) else {
            return;
        };
        if self.mode == Mode::Orbit && !self.is_turned {
            *self = self.turned(whole, seen, extent, walls);
        }
        self.fit(whole, seen, extent);
    }

    /// From the side from which walls hide the fewest vehicles.
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
            let is_hidden = |v: &&VehicleState| sight::is_hidden(eye, v.position + DVec3::Z, walls);
            (seen.vehicles.iter().filter(is_hidden).count(), turned)
        };
        // Of equals the first, which is the usual one.
        let best = ways.map(look).min_by_key(|(hidden, _)| *hidden);
        best.map_or_else(|| self.clone(), |(_, turned)| turned)
    }

    /// Moves so that a part of the ground fills a picture.
    fn fit(&mut self, [low, high]: [DVec2; 2], seen: &FrameSnapshot, extent: [u32; 2]) {
        let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
        let room = DVec2::from(extent.map(f64::from));
        let [nearest, farthest] = UNMOVED_M;
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

    /// Takes the ground along by metres to the right and towards the viewer.
    fn drag_ground(&mut self, right_m: f64, near_m: f64) {
        let azimuth_rad = if self.mode == Mode::Overhead { -FRAC_PI_2 } else { self.azimuth_rad };
        let (sin, cos) = azimuth_rad.sin_cos();
        let (near, east) = (DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0));
        self.target -= east * right_m + near * near_m;
    }

    /// Takes another mode, from about where it is. A mode that needs a vehicle takes `nearest`.
    pub fn set_mode(&mut self, mode: Mode, nearest: Option<VehicleId>) {
        if matches!(mode, Mode::Chase | Mode::Onboard) {
            self.follow = self.follow.or(nearest);
        }
        if mode == Mode::Free && self.mode != Mode::Free {
            let (sin, cos) = self.azimuth_rad.sin_cos();
            let (up, out) = self.elevation_rad.sin_cos();
            self.eye = self.target + DVec3::new(cos * out, sin * out, up) * self.distance_m;
            (self.yaw_rad, self.pitch_rad) = (self.azimuth_rad + FRAC_PI_2 * 2.0, -self.elevation_rad);
            self.follow = None;
        }
        self.mode = mode;
    }

    /// Keeps up with what is followed. A vehicle that has left is not followed any longer.
    pub fn attend(&mut self, seen: &FrameSnapshot) {
        self.follow = self.follow.filter(|id| seen.vehicle(*id).is_some());
        if let Some(vehicle) = self.follow.and_then(|id| seen.vehicle(id)) {
            self.target = vehicle.position;
            self.whole = None;
        } else if matches!(self.mode, Mode::Chase | Mode::Onboard) {
            self.mode = Mode::Orbit;
        }
    }

    /// So near that what happens to the followed vehicle can be seen.
    pub fn come_near(&mut self) {
        self.distance_m = self.distance_m.min(EVENT_M);
        self.whole = None;
    }

    /// Moves the middle of the view to a point of the ground.
    pub fn look_at(&mut self, point: DVec2) {
        (self.follow, self.whole) = (None, None);
        self.target = point.extend(0.0);
        if matches!(self.mode, Mode::Chase | Mode::Onboard) {
            self.mode = Mode::Orbit;
        }
        if self.mode == Mode::Free {
            self.eye = self.target - self.forward() * 40.0;
        }
    }

    fn forward(&self) -> DVec3 {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let (up, out) = self.pitch_rad.sin_cos();
        DVec3::new(cos * out, sin * out, up)
    }

    fn camera(&self) -> Camera {
        match (self.mode, self.follow) {
            (Mode::Chase, Some(vehicle)) => {
                let distance_m = if self.rear { -8.0 } else { 9.0 };
                Camera::Chase { vehicle, distance_m, height_m: 3.6 }
            }
            (Mode::Onboard, Some(vehicle)) => Camera::onboard(vehicle, Mount::Windscreen),
            (Mode::Overhead, _) => {
                Camera::Overhead { centre: self.target.truncate(), height_m: self.distance_m }
            }
            (Mode::Free, _) => Camera::Fixed(Extrinsics::looking_at(self.eye, self.eye + self.forward())),
            _ => Camera::Orbit {
                target: self.target + DVec3::Z,
                distance_m: self.distance_m,
                azimuth_rad: self.azimuth_rad,
                elevation_rad: self.elevation_rad,
            },
        }
    }

    /// The view of an instant, in a picture of some pixels.
    pub fn view(&self, seen: &FrameSnapshot, extent: [u32; 2]) -> View {
        let lens = Lens { extent, ..Lens::default() };
        let fallback = || {
            let from = self.target + DVec3::new(0.0, -1.0, 1.0) * self.distance_m;
            View::new(Extrinsics::looking_at(from, self.target), &lens)
        };
        let view = self.camera().view(seen, &lens);
        let mut view = view.unwrap_or_else(|_| fallback());
        if self.rear && self.mode == Mode::Onboard {
            let about = DQuat::from_mat3(&DMat3::from_cols(-DVec3::X, DVec3::Y, -DVec3::Z));
            view.extrinsics.orientation *= about;
        }
        if self.rear && self.mode == Mode::Chase {
            self.look_back(seen, &mut view);
        }
        view
    }

    /// From before the vehicle, over it, at what comes behind.
    fn look_back(&self, seen: &FrameSnapshot, view: &mut View) {
        if let Some(state) = self.follow.and_then(|id| seen.vehicle(id)) {
            let back = -state.forward().extend(0.0);
            let target = state.position + back * 6.0 + DVec3::Z;
            view.extrinsics = Extrinsics::looking_at(view.extrinsics.position, target);
        }
    }

    /// The mouse was dragged by so many points: turns the view.
    pub fn turn(&mut self, right: f64, down: f64) {
        self.whole = None;
        match self.mode {
            Mode::Overhead => self.shift(right, down),
            Mode::Free => {
                self.yaw_rad = (self.yaw_rad - right * RAD_PER_POINT).rem_euclid(TAU);
                self.pitch_rad = (self.pitch_rad - down * RAD_PER_POINT).clamp(-1.5, 1.5);
            }
            Mode::Orbit => {
                self.azimuth_rad = (self.azimuth_rad - right * RAD_PER_POINT).rem_euclid(TAU);
                let elevation = self.elevation_rad + down * RAD_PER_POINT;
                self.elevation_rad = elevation.clamp(LOWEST_RAD, STEEPEST_RAD);
            }
            Mode::Chase | Mode::Onboard => {}
        }
    }

    /// The mouse was dragged by so many points: takes the ground with it.
    pub fn shift(&mut self, right: f64, down: f64) {
        let metres = self.distance_m * 0.0016;
        self.whole = None;
        match self.mode {
            Mode::Overhead | Mode::Orbit => {
                self.follow = None;
                self.drag_ground(right * metres, down * metres);
            }
            Mode::Free => self.fly(DVec3::new(-right, 0.0, down) * 0.05),
            Mode::Chase | Mode::Onboard => {}
        }
    }

    /// Nearer for positive steps of the mouse wheel.
    pub fn zoom(&mut self, steps: f64) {
        self.whole = None;
        if self.mode == Mode::Free {
            self.fly(DVec3::new(0.0, steps * 3.0, 0.0));
        } else {
            self.distance_m = (self.distance_m * 0.88_f64.powf(steps)).clamp(NEAREST_M, FARTHEST_M);
        }
    }

    /// Goes by metres to the right, forward and up, seen from the camera.
    pub fn fly(&mut self, by: DVec3) {
        self.whole = None;
        match self.mode {
            Mode::Free => {
                let forward = self.forward();
                let right = forward.cross(DVec3::Z).normalize_or(DVec3::X);
                self.eye += right * by.x + forward * by.y + DVec3::Z * by.z;
                self.eye.z = self.eye.z.max(0.5);
            }
            Mode::Orbit | Mode::Overhead => {
                let ahead =
                    if self.mode == Mode::Overhead { FRAC_PI_2 } else { self.azimuth_rad + FRAC_PI_2 * 2.0 };
                let (sin, cos) = ahead.sin_cos();
                self.target += DVec3::new(cos, sin, 0.0) * by.y + DVec3::new(sin, -cos, 0.0) * by.x;
                if by.x != 0.0 || by.y != 0.0 {
                    self.follow = None;
                }
            }
            Mode::Chase | Mode::Onboard => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::{Appearance, Dimensions, VehicleInfo, VehicleState};
    use std::sync::Arc;

    fn snapshot(x: f64) -> FrameSnapshot {
        let dimensions = Dimensions {
            length_m: 5.0,
            width_m: 2.5,
            height_m: 1.5,
            wheelbase_m: 3.0,
            track_m: 2.1,
            wheel_radius_m: 0.34,
        };
        let info = VehicleInfo {
            id: VehicleId(3),
            name: "car".into(),
            dimensions,
            appearance: Appearance::default(),
            model: String::new(),
        };
        let vehicle =
            VehicleState { id: VehicleId(3), position: DVec3::new(x, 4.0, 0.0), ..VehicleState::default() };
        FrameSnapshot { vehicles: vec![vehicle], roster: Arc::new(vec![info]), ..FrameSnapshot::default() }
    }

    fn sees(viewpoint: &Viewpoint, seen: &FrameSnapshot) -> bool {
        let pixel = viewpoint.view(seen, [400, 300]).project(seen.vehicles[0].position + DVec3::Z);
        pixel.is_some_and(|p| (0.0..400.0).contains(&p.x) && (0.0..300.0).contains(&p.y))
    }

    #[test]
    fn every_mode_but_onboard_sees_the_vehicle_that_it_follows() {
        let seen = snapshot(10.0);
        for mode in [Mode::Orbit, Mode::Chase, Mode::Overhead] {
            let mut viewpoint = Viewpoint::around(&snapshot(-200.0));
            viewpoint.follow = Some(VehicleId(3));
            viewpoint.set_mode(mode, None);
            viewpoint.attend(&seen);
            assert!(sees(&viewpoint, &seen), "{mode:?}");
        }
        let mut viewpoint = Viewpoint::around(&seen);
        viewpoint.set_mode(Mode::Free, None);
        assert!(sees(&viewpoint, &seen), "the free camera starts where the orbit was");
        viewpoint.set_mode(Mode::Onboard, Some(VehicleId(3)));
        assert_eq!(viewpoint.view(&seen, [400, 300]).carrier, Some(VehicleId(3)));
    }

    #[test]
    fn a_free_camera_that_is_asked_for_at_first_begins_where_the_orbit_would() {
        let mut seen = snapshot(-70.0);
        let far = DVec3::new(-10.0, 90.0, 0.0);
        seen.vehicles.push(VehicleState { id: VehicleId(4), position: far, ..seen.vehicles[0].clone() });
        let (mut orbit, mut free) = (Viewpoint::around(&seen), Viewpoint::around(&seen));
        free.set_mode(Mode::Free, None);
        for _ in 0..2 {
            orbit.show_whole(&seen, [400, 300], &[]);
            free.show_whole(&seen, [400, 300], &[]);
        }
        assert_eq!(free.mode, Mode::Free);
        let [orbit, free] =
            [orbit, free].map(|viewpoint| viewpoint.view(&seen, [400, 300]).extrinsics.position);
        assert!((orbit - free).length() < 1.5, "{free}, the orbit is at {orbit}");
    }

    #[test]
    fn at_first_everything_that_drives_is_seen_in_pictures_of_all_shapes() {
        let mut seen = snapshot(-70.0);
        seen.vehicles.push(VehicleState {
            id: VehicleId(4),
            position: DVec3::new(-10.0, 60.0, 0.0),
            ..seen.vehicles[0].clone()
        });
        for mode in [Mode::Orbit, Mode::Overhead] {
            for extent in [[586, 662], [1400, 500], [700, 900]] {
                let mut viewpoint = Viewpoint::around(&seen);
                viewpoint.set_mode(mode, None);
                viewpoint.show_whole(&seen, extent, &[]);
                let corners = [(-88.0, -14.0), (8.0, -14.0), (8.0, 78.0), (-88.0, 78.0)];
                let view = viewpoint.view(&seen, extent);
                let pixels = corners.map(|(x, y)| view.project(DVec3::new(x, y, 0.0)).unwrap());
                let size = DVec2::from(extent.map(f64::from));
                assert!(
                    pixels.iter().all(|p| p.min_element() >= 0.0 && p.cmple(size).all()),
                    "{mode:?} {pixels:?}"
                );
                let widest = |of: fn(&DVec2) -> f64| {
                    let values = pixels.iter().map(of);
                    values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
                };
                let share = (widest(|p| p.x) / size.x).max(widest(|p| p.y) / size.y);
                assert!(share > 0.8, "{mode:?} {extent:?}: no farther away than it has to be, {share}");
                // Whoever has moved it finds it where it was left.
                viewpoint.zoom(3.0);
                let left = viewpoint.clone();
                viewpoint.show_whole(&seen, extent, &[]);
                assert_eq!(viewpoint, left);
            }
        }
    }

    #[test]
    fn at_first_it_looks_from_where_walls_hide_the_fewest() {
        let seen = snapshot(10.0);
        let extent = [800, 600];
        let mut usual = Viewpoint::around(&seen);
        usual.show_whole(&seen, extent, &[]);
        assert_eq!([usual.azimuth_rad, usual.elevation_rad], UNTURNED_RAD);
        let eye = usual.view(&seen, extent).extrinsics.position;
        // Before the car, across the usual line of sight, and so high that it hides it from there.
        let car = seen.vehicles[0].position;
        let (towards, across) =
            ((eye - car).truncate().normalize(), (eye - car).truncate().normalize().perp());
        let end = |side: f64| (car.truncate() + towards * 6.0 + across * side).as_vec2();
        let wall = Wall { from: end(-5.0), to: end(5.0), height_m: 40.0 };
        let is_hidden = |viewpoint: &Viewpoint| {
            sight::is_hidden(viewpoint.view(&seen, extent).extrinsics.position, car + DVec3::Z, &[wall])
        };
        assert!(is_hidden(&usual));
        let mut turned = Viewpoint::around(&seen);
        turned.show_whole(&seen, extent, &[wall]);
        assert!(!is_hidden(&turned) && sees(&turned, &seen));
        // Once, not whenever something drives on.
        let azimuth_rad = turned.azimuth_rad;
        turned.show_whole(&snapshot(40.0), extent, &[]);
        assert_eq!(turned.azimuth_rad, azimuth_rad);
    }

    #[test]
    fn looking_back_sees_what_is_behind() {
        let seen = snapshot(10.0);
        let behind = DVec3::new(-15.0, 4.0, 0.5);
        for mode in [Mode::Chase, Mode::Onboard] {
            let mut viewpoint = Viewpoint::around(&seen);
            viewpoint.set_mode(mode, Some(VehicleId(3)));
            viewpoint.rear = true;
            let pixel = viewpoint.view(&seen, [400, 300]).project(behind);
            assert!(pixel.is_some_and(|p| (50.0..350.0).contains(&p.x)), "{mode:?} {pixel:?}");
        }
    }

    #[test]
    fn a_vehicle_that_has_left_is_not_followed_and_nothing_breaks_without_any() {
        let mut viewpoint = Viewpoint::around(&snapshot(10.0));
        viewpoint.set_mode(Mode::Chase, Some(VehicleId(3)));
        let empty = FrameSnapshot::default();
        viewpoint.attend(&empty);
        assert_eq!((viewpoint.mode, viewpoint.follow), (Mode::Orbit, None));
        assert!(viewpoint.view(&empty, [1, 1]).clip_from_world().is_finite());
        assert!(Viewpoint::around(&empty).view(&empty, [8, 8]).clip_from_world().is_finite());
    }

    #[test]
    fn dragging_takes_the_ground_along_and_zooming_brings_it_nearer() {
        let seen = snapshot(10.0);
        for mode in [Mode::Orbit, Mode::Overhead] {
            let mut viewpoint = Viewpoint::around(&seen);
            viewpoint.set_mode(mode, None);
            let at = |viewpoint: &Viewpoint| {
                viewpoint.view(&seen, [800, 600]).project(seen.vehicles[0].position).unwrap()
            };
            let before = at(&viewpoint);
            viewpoint.shift(40.0, 25.0);
            let moved = at(&viewpoint) - before;
            assert!(moved.x > 15.0 && moved.y > 8.0, "{mode:?} {moved}");
            let (near, far) = (viewpoint.distance_m, {
                viewpoint.zoom(-2.0);
                viewpoint.distance_m
            });
            assert!(far > near);
        }
    }
}
