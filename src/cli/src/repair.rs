//! `city3d check --repair`: a measured map becomes one that loads.

use super::Failure;
use super::say::{complain, say};
use city3d_outputs::{WholeFile, refuse_inputs};
use city3d_roadmap::repair_map;
use city3d_simulation::scenario::Library;
use std::path::Path;
use std::str::FromStr;

/// A length with its unit, as on the command line: `15mm`, `1.5cm`, `0.015m`, `0.5in`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Length {
    pub metres: f64,
}

impl FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const UNITS: [(&str, f64); 5] =
            [("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254), ("ft", 0.3048), ("m", 1.0)];
        let text = text.trim();
        let found = UNITS.iter().find_map(|&(unit, metres)| Some((text.strip_suffix(unit)?, metres)));
        let (number, metres) = found.ok_or("write a length with its unit, such as 15mm, 1.5cm or 0.5in")?;
        match number.trim().parse::<f64>() {
            Ok(value) if value.is_finite() && value > 0.0 => Ok(Self { metres: value * metres }),
            _ => Err(format!("\"{}\" is not a length above 0", number.trim())),
        }
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        let metres = |text: &str| text.parse::<Length>().map(|length| length.metres);
        for (text, wanted) in [("15mm", 0.015), ("0.5in", 0.0127), ("0.015m", 0.015), (" 1.5 cm", 0.015)] {
            assert!((metres(text).unwrap() - wanted).abs() < 1e-12, "{text}");
        }
        for text in ["15", "mm", "-1mm", "0m", "infm", "NaNmm", "15 miles"] {
            assert!(metres(text).is_err(), "{text}");
        }
    }
}
