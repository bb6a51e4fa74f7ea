//! `city3d generate`: writes what lies in `assets/`.

use super::say::say;
use super::{Failure, create_folder};
use crate::city::generate::ids3c;
use crate::model::{glb, made};
use clap::{Args, Subcommand};
use std::path::PathBuf;

#[derive(Debug, Args)]
pub struct GenerateArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// The map of the IDS 3D City as a DXF drawing
    Map {
        /// Folder that the map is written into
        #[arg(long, value_name = "DIR", default_value = "assets/maps")]
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
        What::Map { out } => write(out, "ids3c.dxf", ids3c().to_dxf().as_ref()),
        What::Models { out } => {
            made().iter().try_for_each(|(name, model)| write(out, name, &glb::write(model)))
        }
    }
}

fn write(folder: &PathBuf, name: &str, bytes: &[u8]) -> Result<(), Failure> {
    create_folder(folder)?;
    let path = folder.join(name);
    std::fs::write(&path, bytes).map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
    say(path.display())
}
