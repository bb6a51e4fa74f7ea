//! `cargo xtask`: runs a task of the project's own.

use clap::{Parser, Subcommand};
use std::io::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use xtask::generate::ids3c;
use xtask::ground_truth::{GroundTruthArgs, ground_truth};
use xtask::models;
use xtask::neutral::{NeutralArgs, neutral};
use xtask::notices;
use xtask::reference::{ReferenceArgs, reference};
use xtask::soak::{SoakArgs, soak};

/// Tasks of the project's own
#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Xtask {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Generate the files of assets/, and the notices of third-party software
    #[command(subcommand)]
    Generate(GenerateTask),
    /// Draw cities from random places in every quality: nothing is missing below the horizon, and classes agree
    GroundTruth(GroundTruthArgs),
    /// Measure camera pictures per second of a neutral scene that other engines can draw
    Neutral(NeutralArgs),
    /// Export the city for a path tracer, and draw what its pictures are compared with: see scripts/reference.sh
    Reference(ReferenceArgs),
    /// Serve a city for hours in simulated time, while its mainframe comes and goes
    Soak(SoakArgs),
}

#[derive(Debug, Subcommand)]
enum GenerateTask {
    /// The map of the IDS 3D City as a DXF drawing
    Map {
        /// Folder for the map, or a file name that ends in .dxf
        #[arg(long, value_name = "PATH", default_value = "assets/maps")]
        out: PathBuf,
    },
    /// Cars and street furniture as glTF binary files
    Models {
        /// Folder for the models
        #[arg(long, value_name = "DIR", default_value = "assets/models")]
        out: PathBuf,
    },
    /// Licences and copyright lines of the crates that the program consists of
    Notices,
}

fn main() -> ExitCode {
    let result = match Xtask::parse().task {
        Task::Generate(task) => generate(&task).map_err(Into::into),
        Task::GroundTruth(args) => ground_truth(&args),
        Task::Neutral(args) => neutral(&args),
        Task::Reference(args) => reference(&args),
        Task::Soak(args) => soak(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn generate(task: &GenerateTask) -> Result<(), String> {
    match task {
        GenerateTask::Map { out } => {
            let is_file = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("dxf"));
            let path = if is_file { out.clone() } else { out.join("ids3c.dxf") };
            write(&path, ids3c().to_dxf().as_ref())
        }
        GenerateTask::Notices => {
            let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
            write(Path::new(notices::FILE), notices::notices(&root)?.as_bytes())
        }
        GenerateTask::Models { out } => {
            models::made().iter().try_for_each(|(name, model)| write(&out.join(name), &models::write(model)))
        }
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let place = |error: Error| format!("{}: {error}", path.display());
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(place)?;
    }
    std::fs::write(path, bytes).map_err(place)?;
    println!("{}", path.display());
    Ok(())
}
