//! Cities that run: live runs and playback of logs for the window, and the processes of the laboratory (served city,
//! remote control, emulated robots).

#![allow(clippy::disallowed_types, reason = "paces cities by the clock, and writes their files")]
#![allow(missing_debug_implementations, reason = "ends are trait objects, which have nothing to show")]

mod error;
pub mod live;
mod loss_reporter;
mod overwrite;
pub mod playback;
pub mod remote_control;
pub mod robots;
mod run_files;
pub mod served;

pub use city3d_simulation::scenario::LoadError;
pub use error::{ExistingResults, SessionError};
pub use overwrite::Overwrite;
pub use run_files::{FileOptions, RunFiles, folder_of};

use city3d_simulation::scenario::{Experiment, ScenarioRequest};
use std::sync::Arc;

/// Loads a scenario, and warns of vehicles that had to be moved because they overlapped at the start.
///
/// # Errors
/// When it cannot be read, or has problems; each has its place and remedy.
pub fn load(request: &ScenarioRequest) -> Result<Arc<Experiment>, LoadError> {
    let experiment = request.read()?;
    for moved in &experiment.moved {
        tracing::warn!(
            "vehicle {} overlaps vehicle {} at the start; it starts {:.2} m further back on its lane",
            moved.vehicle,
            moved.behind,
            moved.by_m
        );
    }
    Ok(Arc::new(experiment))
}
