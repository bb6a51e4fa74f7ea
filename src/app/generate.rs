//! `city3d generate`: writes what lies in `assets/`.

use super::say::say;
use super::{Failure, create_folder};
use crate::city::generate::ids3c;
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
}

pub fn generate(args: &GenerateArgs) -> Result<(), Failure> {
    let What::Map { out } = &args.what;
    create_folder(out)?;
    let path = out.join("ids3c.dxf");
    std::fs::write(&path, ids3c().to_dxf())
        .map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
    say(path.display())
}
