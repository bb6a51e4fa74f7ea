//! Planar frames of reference as types, so that a pose of the laboratory is no pose of the city.
//!
//! ```compile_fail,E0308
//! use city3d_geometry::{City, Lab, Pose2};
//!
//! let on_the_floor = Pose2::<Lab>::new(0.2, 0.0, 0.0);
//! let in_the_city: Pose2<City> = on_the_floor;
//! ```

use std::fmt::Debug;

/// A planar frame with x east, y north and angles counter-clockwise from east, in metres.
pub trait Frame: Copy + Debug + Default + PartialEq + Send + Sync + 'static {}

/// The floor of the laboratory. A metre of it is [`LengthScale`](super::LengthScale) metres of the city.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lab;

/// The full-scale city: the same place, with lengths and speeds multiplied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct City;

impl Frame for Lab {}
impl Frame for City {}

/// Geometry of the laboratory's frame, for modules that know no other.
pub mod lab {
    /// A planar pose on the laboratory's floor.
    pub type Pose2 = crate::Pose2<super::Lab>;
    /// A straight line or an arc on the laboratory's floor.
    pub type Segment = crate::Segment<super::Lab>;
    /// A point of a curve on the laboratory's floor.
    pub type CurvePoint = crate::CurvePoint<super::Lab>;
    /// A curve of lines and arcs on the laboratory's floor.
    pub type Curve = crate::Curve<super::Lab>;
}
