//! `city3d generate`: writes the files that the program carries, to draw or to model from them.

use super::say::say;
use super::{Failure, create_folder, on_end};
use city3d_geometry::Length;
use city3d_models::{SHIPPED, shipped};
use city3d_outputs::WholeFile;
use city3d_roadmap::{Grid, GridControl, GridSize};
use city3d_simulation::scenario::{Library, grid_scenario};
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
    /// A map as a DXF drawing: the IDS 3D City, or a grid of streets
    Map {
        /// Folder for the map, or a file name that ends in .dxf
        #[arg(long, value_name = "PATH", default_value = "assets/maps")]
        out: PathBuf,
        /// A grid of N streets and M avenues in place of the city
        #[arg(long, value_name = "NxM")]
        grid: Option<GridSize>,
        #[command(flatten)]
        shape: GridArgs,
    },
    /// Cars and street furniture as glTF binary files
    Models {
        /// Folder for the models
        #[arg(long, value_name = "DIR", default_value = "assets/models")]
        out: PathBuf,
    },
}

/// How a grid is made. Lengths are those of the laboratory.
#[derive(Debug, Args)]
struct GridArgs {
    /// Length of the lanes between two junctions
    #[arg(long, value_name = "LENGTH", requires = "grid", default_value = "6m")]
    block: Length,
    /// Length of the lanes into the grid and out of it
    #[arg(long, value_name = "LENGTH", requires = "grid", default_value = "10m")]
    entry: Length,
    /// Radius of right turns
    #[arg(long, value_name = "LENGTH", requires = "grid", default_value = "0.25m")]
    turn_radius: Length,
    /// Lines at the junctions: yield or stop (for avenues), all-way-stop, none
    #[arg(long, value_name = "LINES", requires = "grid", default_value = "yield")]
    control: GridControl,
    /// Also write a scenario for the grid, with traffic from all sides, to this file
    #[arg(long, value_name = "FILE", requires = "grid")]
    scenario: Option<PathBuf>,
}

impl GridArgs {
    fn grid(&self, size: GridSize) -> Grid {
        let [block_m, entry_m, turn_radius_m] = [self.block, self.entry, self.turn_radius].map(|l| l.metres);
        Grid { size, block_m, entry_m, turn_radius_m, control: self.control }
    }
}

pub fn generate(args: &GenerateArgs) -> Result<(), Failure> {
    match &args.what {
        GenerateCommand::Map { out, grid, shape } => {
            let is_file = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("dxf"));
            let path_of = |name: &str| if is_file { out.clone() } else { out.join(name) };
            let Some(size) = *grid else {
                let map = Library::default().map("ids3c").map_err(Failure::failed)?;
                return write(&path_of("ids3c.dxf"), &map);
            };
            let name = format!("grid-{}x{}.dxf", size.streets, size.avenues);
            let (grid, path) = (shape.grid(size), path_of(&name));
            write(&path, grid.to_dxf().map_err(Failure::bad_input)?.as_bytes())?;
            let Some(scenario) = &shape.scenario else { return Ok(()) };
            write(scenario, grid_scenario(&grid, &path, scenario).as_bytes())
        }
        GenerateCommand::Models { out } => {
            let stop = on_end()?;
            for (done, name) in SHIPPED.into_iter().enumerate() {
                if stop.load(Ordering::Relaxed) {
                    let all = SHIPPED.len();
                    return Err(Failure::failed(format!("stopped after {done} of {all} models")));
                }
                write(&out.join(name), shipped(name).unwrap_or_default())?;
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
