//! Vehicle models against closed forms, and how well they track trajectories.

mod models;
mod rig;
mod tracking;
