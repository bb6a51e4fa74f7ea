//! An example scenario for a grid map: traffic from all its arms to all others.

use city3d_roadmap::Grid;
use std::fmt::Write;
use std::path::Path;

/// Arrivals in an hour at each arm: below the capacity of a junction with yield lines.
const RATE_VEH_H: u32 = 200;

/// The text of a scenario for a grid, at the path where it is to be written; `map` is the path of the grid's map.
pub fn grid_scenario(grid: &Grid, map: &Path, scenario: &Path) -> String {
    // A map is searched beside its scenario first.
    let name = map.file_name().filter(|_| map.parent() == scenario.parent());
    let map = name.map_or(map, Path::new).to_string_lossy().into_owned();
    let size = format!("{}x{}", grid.size.streets, grid.size.avenues);
    let mut text = format!(
        "# Traffic from all arms of a grid of {size} junctions to all others. Format: docs/scenarios.md.\n\n\
         name = \"grid-{size}\"\n\
         description = \"Traffic from all sides through a grid of {size} junctions\"\n\
         map = {}\n\
         seed = 1\n\
         duration_s = 300.0\n\
         collisions_forbidden = true\n\n\
         [driver.default]\n\
         desired_speed_mps = 0.35\n",
        toml::Value::String(map)
    );
    let arms = grid.arms();
    for arm in &arms {
        let name = arm.entry.rsplit_once('/').map_or(arm.entry.as_str(), |(road, _)| road);
        let others = arms.iter().filter(|other| *other != arm);
        let destinations: Vec<String> = others.map(|other| format!("\"{}\"", other.exit)).collect();
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n[[inflow]]\nname = \"{name}\"\nlane = \"{}\"\nrate_veh_h = {RATE_VEH_H}\ndestinations = [\n",
            arm.entry
        );
        for line in destinations.chunks(4) {
            let _ = writeln!(text, "    {},", line.join(", "));
        }
        text.push_str("]\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Library, Overrides, read_experiment};
    use std::collections::BTreeMap;

    #[test]
    fn traffic_enters_at_all_arms_and_goes_to_all_others() {
        for size in ["1x1", "1x3", "3x2"] {
            let grid = Grid { size: size.parse().unwrap(), ..Grid::default() };
            let text = grid_scenario(&grid, Path::new("maps/grid.dxf"), Path::new("maps/grid.toml"));
            assert!(text.contains("map = \"grid.dxf\""), "{text}");
            let library = Library::kept(grid.to_dxf().unwrap().into_bytes(), BTreeMap::new());
            let experiment = read_experiment(size, &text, &library, Overrides::default()).unwrap();
            let arms = grid.arms();
            assert_eq!(experiment.inflows.len(), arms.len());
            for (index, arm) in arms.iter().enumerate() {
                let lane = |id| experiment.lab_map.lane(id).name.as_str();
                let own = experiment.arrivals.iter().filter(|arrival| arrival.inflow == index);
                let own: Vec<_> = own.collect();
                // 300 s at 200 an hour, give or take four standard deviations.
                assert!(own.len().abs_diff(17) <= 17, "{size} {}: {}", arm.entry, own.len());
                for arrival in own {
                    let route = &arrival.vehicle.route;
                    assert_eq!(lane(route[0]), arm.entry);
                    let exit = lane(route[route.len() - 1]);
                    assert!(exit != arm.exit && arms.iter().any(|other| other.exit == exit), "{exit}");
                    assert!(arrival.vehicle.leaves);
                }
            }
        }
        let elsewhere = grid_scenario(&Grid::default(), Path::new("maps/grid.dxf"), Path::new("grid.toml"));
        assert!(elsewhere.contains("map = \"maps/grid.dxf\""), "{elsewhere}");
    }
}
