//! `city3d generate`: writes the files that the program carries, to draw or to model from them.

use super::say::say;
use super::{Failure, create_folder, on_end};
use city3d_models::SHIPPED;
use city3d_outputs::WholeFile;
use city3d_simulation::scenario::Library;
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

#[derive(Debug, Args)]
pub struct GenerateArgs {
    #[command(subcommand)]
    what: GenerateCommand,
}

#[derive(Debug, Subcommand)]
enum GenerateCommand {
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
}

pub fn generate(args: &GenerateArgs) -> Result<(), Failure> {
    match &args.what {
        GenerateCommand::Map { out } => {
            let is_file = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("dxf"));
            let path = if is_file { out.clone() } else { out.join("ids3c.dxf") };
            write(&path, &Library::default().map("ids3c").map_err(Failure::failed)?)
        }
        GenerateCommand::Models { out } => {
            let stop = on_end()?;
            for (done, (name, bytes)) in SHIPPED.iter().enumerate() {
                if stop.load(Ordering::Relaxed) {
                    let all = SHIPPED.len();
                    return Err(Failure::failed(format!("stopped after {done} of {all} models")));
                }
                write(&out.join(name), bytes)?;
            }
            Ok(())
        }
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if let Some(folder) = path.parent() {
        create_folder(folder)?;
    }
    WholeFile::write(path, bytes).map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
    say(path.display())
}
