//! What the rows of a study depend on, as digests: shards of the same identity belong together.

use city3d_geometry::digest::REVISION;
use city3d_simulation::scenario::{Experiment, Library, Overrides};
use city3d_simulation::sweep::Grid;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Version, scenario and runs of a study. Two sweeps of the same identity have the same rows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SweepIdentity {
    /// Version of the program.
    pub version: String,
    /// Revision of the states that it simulates.
    pub revision: u32,
    /// SHA-256 of the scenario's text, its map and its models.
    pub scenario: String,
    /// SHA-256 of what is set otherwise, of the axes and of the seeds.
    pub runs: String,
}

impl SweepIdentity {
    /// The identity of the runs of a grid. `unchanged` is the experiment before the values of the axes are set, from the
    /// files of `library`.
    pub fn new(unchanged: &Experiment, library: &Library, overrides: &Overrides, grid: &Grid) -> Self {
        let mut scenario = Parts::default();
        scenario.add(unchanged.scenario_text.as_bytes());
        scenario.add(&unchanged.map_bytes);
        for (name, bytes) in &unchanged.models.files {
            scenario.add(name.as_bytes());
            scenario.add(bytes);
        }
        let mut runs = Parts::default();
        let Overrides { seed, duration_s, model, environment, .. } = overrides;
        runs.add(format!("{seed:?} {duration_s:?} {model:?} {environment:?}").as_bytes());
        for axis in &grid.axes {
            runs.add(axis.key.as_bytes());
            for value in &axis.values {
                runs.add(value.to_string().as_bytes());
                // A map or a model that a value names.
                if let Some(bytes) = value.as_str().and_then(|name| library.own_file(name)) {
                    scenario.add(&bytes);
                }
            }
        }
        runs.add(grid.seeds.as_ref().map_or_else(String::new, ToString::to_string).as_bytes());
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            revision: REVISION,
            scenario: scenario.hex(),
            runs: runs.hex(),
        }
    }

    /// In which part another identity differs, in words that follow "of"; `None` where they are the same.
    pub fn difference(&self, other: &Self) -> Option<String> {
        if (&self.version, self.revision) != (&other.version, other.revision) {
            let told = |of: &Self| format!("{} (states of revision {})", of.version, of.revision);
            return Some(format!("version {}, and this is {}", told(other), told(self)));
        }
        if self.scenario != other.scenario {
            return Some("another scenario, map or model".to_owned());
        }
        (self.runs != other.runs).then(|| "other parameters or seeds of the same scenario".to_owned())
    }
}

/// A digest of parts, each with its length, so that no two lists of parts have the same bytes.
#[derive(Default)]
struct Parts(Sha256);

impl Parts {
    fn add(&mut self, part: &[u8]) {
        self.0.update((part.len() as u64).to_le_bytes());
        self.0.update(part);
    }

    fn hex(self) -> String {
        hex(&self.0.finalize())
    }
}

/// SHA-256 of bytes, in hexadecimal digits.
pub(super) fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_simulation::scenario::read_experiment;

    fn identity(scenario: &str, overrides: &Overrides, axis: &str, seeds: &str) -> SweepIdentity {
        let (text, library) = Library::scenario(scenario).unwrap();
        let unchanged = read_experiment(scenario, &text, &library, *overrides).unwrap();
        let grid = Grid::new(vec![axis.parse().unwrap()], Some(seeds.parse().unwrap())).unwrap();
        SweepIdentity::new(&unchanged, &library, overrides, &grid)
    }

    #[test]
    fn whatever_the_rows_depend_on_is_in_the_identity() {
        let (axis, none) = ("environment.loss=0,0.1", Overrides::default());
        let one = identity("straight", &none, axis, "1..4");
        assert_eq!(one.difference(&identity("straight", &none, axis, "1,2,3,4")), None);
        let shorter = Overrides { duration_s: Some(5.0), ..none };
        let others = [
            (identity("roundabout", &none, axis, "1..4"), "another scenario"),
            (identity("straight", &none, axis, "1..5"), "other parameters or seeds"),
            (identity("straight", &none, "environment.loss=0,0.2", "1..4"), "other parameters or seeds"),
            (identity("straight", &shorter, axis, "1..4"), "other parameters or seeds"),
            (
                SweepIdentity { version: "0.0.9".to_owned(), ..one.clone() },
                "version 0.0.9 (states of revision",
            ),
        ];
        for (other, told) in others {
            let difference = one.difference(&other).unwrap();
            assert!(difference.starts_with(told), "{difference}");
        }
    }

    #[test]
    fn digests_are_those_of_the_standard() {
        // FIPS 180-2, appendix B.1.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256(b"abc"), abc);
    }
}
