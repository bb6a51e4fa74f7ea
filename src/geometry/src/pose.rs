//! A planar pose: position and heading.

use super::{City, Frame, Lab, LengthScale, trig};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::marker::PhantomData;

/// A planar pose (SE(2)): position and heading, in the laboratory's frame or the city's.
///
/// ```
/// use city3d_geometry::{City, Lab, LengthScale, Pose2};
///
/// let on_the_floor = Pose2::<Lab>::new(0.2, 0.0, 0.0);
/// assert_eq!(on_the_floor.to_city(LengthScale::TESTBED), Pose2::<City>::new(5.0, 0.0, 0.0));
/// ```
#[derive(Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Pose2<F: Frame = City> {
    /// Metres of the frame.
    pub position: DVec2,
    /// Counter-clockwise from the x axis (east).
    pub yaw_rad: f64,
    #[serde(skip)]
    frame: PhantomData<F>,
}

impl<F: Frame> Pose2<F> {
    /// The pose at two coordinates, metres of the frame.
    pub fn new(x: f64, y: f64, yaw_rad: f64) -> Self {
        Self::at(DVec2::new(x, y), yaw_rad)
    }

    /// The pose at a position, metres of the frame.
    pub const fn at(position: DVec2, yaw_rad: f64) -> Self {
        Self { position, yaw_rad, frame: PhantomData }
    }

    /// Unit vector of the heading.
    pub fn forward(&self) -> DVec2 {
        let (sin, cos) = trig::sin_cos(self.yaw_rad);
        DVec2::new(cos, sin)
    }

    /// Unit vector a quarter turn to the left of the heading.
    pub fn left(&self) -> DVec2 {
        self.forward().perp()
    }

    /// The point `ahead` metres in front of the pose and `left` metres to its left.
    pub fn point_at(&self, ahead: f64, left: f64) -> DVec2 {
        self.point_towards(self.forward(), ahead, left)
    }

    /// [`Self::point_at`] with the [unit vector of the heading](Self::forward), whose sine and cosine are then computed once.
    pub fn point_towards(&self, forward: DVec2, ahead: f64, left: f64) -> DVec2 {
        self.position + forward * ahead + forward.perp() * left
    }

    /// The pose moved along its own heading.
    pub fn advanced(&self, ahead: f64) -> Self {
        Self::at(self.point_at(ahead, 0.0), self.yaw_rad)
    }

    /// Whether no coordinate and no angle is infinite or NaN.
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.yaw_rad.is_finite()
    }

    /// The same numbers in another frame, lengths multiplied.
    pub(crate) fn scaled_to<G: Frame>(self, factor: f64) -> Pose2<G> {
        Pose2::at(self.position * factor, self.yaw_rad)
    }
}

impl Pose2<Lab> {
    /// The same place in the city.
    pub fn to_city(self, scale: LengthScale) -> Pose2<City> {
        self.scaled_to(scale.factor())
    }
}

impl Pose2<City> {
    /// The same place in the laboratory.
    pub fn to_lab(self, scale: LengthScale) -> Pose2<Lab> {
        self.scaled_to(1.0 / scale.factor())
    }
}

impl<F: Frame> fmt::Debug for Pose2<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { position, yaw_rad, frame: _ } = self;
        f.debug_struct("Pose2").field("position", position).field("yaw_rad", yaw_rad).finish()
    }
}
