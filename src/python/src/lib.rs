//! The extension module `city3d._native`: simulated cities, their pictures and the program's command in a process of
//! Python. The package `city3d` around it has the types and the environments for reinforcement learning.

mod actions;
mod animation;
mod cameras;
mod city;
mod commanded;
mod convert;
mod coordinators;
mod drivers;
mod logs;
mod observations;
mod pictures;
mod states;
mod tables;
mod trouble;
mod world;

use pyo3::prelude::*;

/// Simulated cities for Python.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::animation::Animation;
    #[pymodule_export]
    use super::cameras::Camera;
    #[pymodule_export]
    use super::coordinators::{Plan, Request, ZoneView};
    #[pymodule_export]
    use super::logs::{Figure, Log, read};
    #[pymodule_export]
    use super::tables::Table;
    #[pymodule_export]
    use super::world::{SavedWorld, World, picture_worlds, step_worlds};
    use pyo3::prelude::*;
    use std::collections::BTreeMap;

    /// Runs the program with these arguments, of which the first is its name; returns its exit code.
    #[pyfunction]
    fn run_program(py: Python<'_>, arguments: Vec<std::ffi::OsString>) -> u8 {
        py.detach(|| super::program(arguments))
    }

    #[pymodule_init]
    fn constants(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("ACTIONS", BTreeMap::from(super::actions::ACTIONS))?;
        module.add("COLUMNS", super::states::COLUMNS)?;
        module.add("STATUSES", super::states::statuses())?;
        module.add("CLASSES", super::pictures::classes())?;
        module.add("SCENARIOS", super::world::scenarios())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

#[cfg(feature = "command")]
fn program(arguments: Vec<std::ffi::OsString>) -> u8 {
    city3d_cli::run_program(arguments)
}

#[cfg(not(feature = "command"))]
fn program(_: Vec<std::ffi::OsString>) -> u8 {
    eprintln!("this package was built without the program's command");
    2
}
