//! Vehicle dynamics: rigid bodies, wheeled vehicles, the tracking control of trajectories, and pedals.

pub mod physics;
pub mod vehicle;
