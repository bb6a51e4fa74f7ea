//! Geometry that everything shares: poses, curves of lines and arcs, outlines, and the scale of the city.
//!
//! Two planar frames occur, both with x east, y north and angles counter-clockwise from east:
//! the *laboratory* frame (metres on the floor of the testbed) and the *city* frame (the same
//! place at full scale, laboratory metres times [`LengthScale`]). Height z points up.

mod curve;
mod outline;
mod pose;
pub mod scatter;
pub mod trig;
mod units;

pub use curve::{Curve, CurvePoint, Projection, Segment};
pub use outline::{OrientedRect, Overlap, convex_hull, point_in_polygon};
pub use pose::Pose2;
pub use trig::wrap_angle;
pub use units::LengthScale;
