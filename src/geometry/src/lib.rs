//! Shared geometry: poses, curves of lines and arcs, outlines, trigonometry, and the scale of the city.
//!
//! There are two planar frames, both with x east, y north and angles counter-clockwise from east: that of the
//! laboratory ([`Lab`], metres on the floor of the testbed) and that of the city ([`City`], the same place at full
//! scale, laboratory metres times [`LengthScale`]). z points up.

mod curve;
pub mod digest;
mod frame;
pub mod hash;
mod outline;
mod pose;
pub mod trig;
mod units;

pub use curve::{Curve, CurvePoint, CurveProjection, Segment};
pub use frame::{City, Frame, Lab, lab};
pub use outline::{OrientedRect, Overlap, convex_hull, point_in_polygon};
pub use pose::Pose2;
pub use trig::wrap_angle;
pub use units::{KMH_PER_MPS, Length, LengthScale};
