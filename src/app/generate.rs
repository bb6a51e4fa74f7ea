//! `city3d generate`: writes what lies in `assets/`.

use super::say::say;
use super::{Failure, create_folder};
use crate::city::generate::ids3c;
use crate::model::{glb, made};
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub struct GenerateArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// The map of the IDS 3D City as a DXF drawing
    Map {
        /// Folder that the map is written into, or a file whose name ends in .dxf
        #[arg(long, value_name = "PATH", default_value = "assets/maps")]
        out: PathBuf,
    },
    /// Cars and what stands in the streets, as glTF binary files
    Models {
        /// Folder that the models are written into
        #[arg(long, value_name = "DIR", default_value = "assets/models")]
        out: PathBuf,
    },
}

pub fn generate(args: &GenerateArgs) -> Result<(), Failure> {
    match &args.what {
        What::Map { out } => {
            let is_file = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("dxf"));
            let path = if is_file { out.clone() } else { out.join("ids3c.dxf") };
            write(&path, ids3c().to_dxf().as_ref())
        }
        What::Models { out } => {
            made().iter().try_for_each(|(name, model)| write(&out.join(name), &glb::write(model)))
        }
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if let Some(folder) = path.parent() {
        create_folder(folder)?;
    }
    std::fs::write(path, bytes).map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
    say(path.display())
}
