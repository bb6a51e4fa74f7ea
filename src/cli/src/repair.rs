//! `city3d check --repair`: a measured map becomes one that loads.

use super::Failure;
use super::say::{complain, say};
use city3d_geometry::Length;
use city3d_outputs::{WholeFile, refuse_inputs};
use city3d_roadmap::repair_map;
use city3d_simulation::scenario::Library;
use std::path::Path;

/// Repairs the one map of `files` into `out` and tells every change.
pub fn repair(files: &[String], tolerance: Length, out: &Path, json: bool) -> Result<(), Failure> {
    let [file] = files else {
        return Err(Failure::bad_input("--repair takes exactly one map"));
    };
    refuse_inputs(&[file.into()], [out.to_path_buf()])?;
    let bytes = Library::default().map(file).map_err(Failure::bad_input)?;
    let repaired = match repair_map(&bytes, tolerance.metres) {
        Ok(repaired) => repaired,
        Err(errors) => {
            for error in &errors.listed {
                complain(format_args!("{file}: {error}"));
            }
            return Err(Failure::bad_input(format!(
                "{file} cannot be repaired within {:.1} mm; {} is not written",
                tolerance.metres * 1e3,
                out.display()
            )));
        }
    };
    WholeFile::write(out, &repaired.dxf)
        .map_err(|error| Failure::failed(format!("{}: {error}", out.display())))?;
    if json {
        let changes: Vec<String> = repaired.changes.iter().map(ToString::to_string).collect();
        let written = out.display().to_string();
        return say(serde_json::json!({ "file": file, "written": written, "changes": changes }));
    }
    for change in &repaired.changes {
        say(format_args!("{file}: {change}"))?;
    }
    say(format_args!("{file}: {} changes, written to {}", repaired.changes.len(), out.display()))
}
