//! Grid maps: they load as they are, their ways and names are those of a grid, and bad dimensions are refused.

use city3d_roadmap::{ControlLineKind, Grid, GridControl, GridSize, LabMap, LaneKind, ZoneKind, load_map};
use std::collections::BTreeSet;

fn grid(size: &str) -> Grid {
    Grid { size: size.parse().unwrap(), ..Grid::default() }
}

fn map_of(grid: &Grid) -> LabMap {
    let loaded = load_map(grid.to_dxf().unwrap().as_bytes()).unwrap_or_else(|errors| panic!("{errors}"));
    // Nothing had to be moved: the only notes count the lanes at the edge.
    let notes: Vec<String> = loaded.notes.iter().map(ToString::to_string).collect();
    assert!(notes.len() == 2 && notes.iter().all(|note| note.contains("have no lane")), "{notes:?}");
    loaded.map
}

#[test]
fn a_grid_has_the_lanes_of_its_roads_and_junctions() {
    for size in ["1x1", "1x3", "3x1", "2x3", "5x5"] {
        let grid = grid(size);
        let map = map_of(&grid);
        let (n, m) = (grid.size.streets as usize, grid.size.avenues as usize);
        let of_kind = |kind| map.lanes.iter().filter(|lane| lane.kind == kind).count();
        assert_eq!(of_kind(LaneKind::Lane), 2 * (n * (m + 1) + m * (n + 1)), "{size}");
        assert_eq!(of_kind(LaneKind::Connector), 12 * n * m, "{size}");
        for lane in &map.lanes {
            let length_m = lane.curve.length();
            assert_eq!(lane.speed_limit_mps, 0.5);
            if lane.kind == LaneKind::Lane {
                let is_edge = lane.predecessors.is_empty() || lane.successors.is_empty();
                let wanted_m = if is_edge { grid.entry_m } else { grid.block_m };
                assert!((length_m - wanted_m).abs() < 1e-9, "{size} {} {length_m}", lane.name);
            } else {
                assert_eq!((lane.predecessors.len(), lane.successors.len()), (1, 1), "{size} {}", lane.name);
            }
        }
        // Every junction is like every other.
        assert_eq!(map.zones.len() % (n * m), 0, "{size}");
        let of_kind = |kind| map.zones.iter().filter(|zone| zone.kind == kind).count();
        assert_eq!(
            (of_kind(ZoneKind::Merge), of_kind(ZoneKind::Diverge)),
            (12 * n * m, 12 * n * m),
            "{size}"
        );
    }
}

#[test]
fn ways_through_a_junction_have_the_names_of_their_sides() {
    let map = map_of(&grid("2x3"));
    let next = |name: &str| -> Vec<&str> {
        let lane = map.lane_by_name(name).unwrap_or_else(|| panic!("{name}"));
        lane.successors.iter().map(|id| map.lane(*id).name.as_str()).collect()
    };
    for (way, from, to) in [
        ("junction-1-2/west-to-east", "street-1/east/2", "street-1/east/3"),
        ("junction-1-2/east-to-west", "street-1/west/2", "street-1/west/3"),
        ("junction-2-1/west-to-south", "street-2/east/1", "avenue-1/south/2"),
        ("junction-2-1/west-to-north", "street-2/east/1", "avenue-1/north/3"),
        ("junction-2-3/south-to-west", "avenue-3/north/2", "street-2/west/2"),
        ("junction-1-3/north-to-east", "avenue-3/south/2", "street-1/east/4"),
    ] {
        assert!(next(from).contains(&way), "{from}: {:?}", next(from));
        assert_eq!(next(way), [to]);
    }
    let radius = |name: &str| map.min_radius(map.lane_by_name(name).unwrap().id);
    assert!((radius("junction-1-1/west-to-south") - 0.25).abs() < 1e-9);
    assert!((radius("junction-1-1/west-to-north") - 0.401).abs() < 1e-9);
    assert!(radius("junction-1-1/west-to-east").is_infinite());
}

#[test]
fn every_arm_leads_to_every_other_one_and_not_back() {
    let grid = grid("1x3");
    let map = map_of(&grid);
    let arms = grid.arms();
    let edges: BTreeSet<&str> = map
        .lanes
        .iter()
        .filter(|lane| lane.predecessors.is_empty() || lane.successors.is_empty())
        .map(|lane| lane.name.as_str())
        .collect();
    let named: BTreeSet<&str> = arms.iter().flat_map(|arm| [arm.entry.as_str(), arm.exit.as_str()]).collect();
    assert_eq!(edges, named);
    let id = |name: &str| map.lane_by_name(name).unwrap().id;
    for from in &arms {
        assert!(map.lane(id(&from.entry)).predecessors.is_empty(), "{}", from.entry);
        for to in &arms {
            assert!(map.lane(id(&to.exit)).successors.is_empty(), "{}", to.exit);
            let way = map.shortest_route(id(&from.entry), id(&to.exit), |_| true);
            assert_eq!(way.is_some(), from != to, "{} {}", from.entry, to.exit);
        }
    }
}

#[test]
fn lines_are_those_asked_for_before_every_junction() {
    for (control, kind, of_each) in [
        (GridControl::Yield, Some(ControlLineKind::Yield), 2),
        (GridControl::Stop, Some(ControlLineKind::Stop), 2),
        (GridControl::AllWayStop, Some(ControlLineKind::Stop), 4),
        (GridControl::None, None, 0),
    ] {
        let grid = Grid { control, ..grid("2x2") };
        let map = map_of(&grid);
        assert_eq!(map.lines.len(), 4 * of_each, "{control:?}");
        for line in &map.lines {
            let lane = map.lane(line.lane);
            assert_eq!(Some(line.kind), kind);
            assert!((lane.curve.length() - line.at_m - 0.015).abs() < 1e-9, "{} {}", lane.name, line.at_m);
            assert!(control == GridControl::AllWayStop || lane.name.starts_with("avenue"), "{}", lane.name);
        }
    }
}

#[test]
fn dimensions_out_of_range_and_grids_too_large_are_told() {
    for text in ["", "5", "0x5", "5x0", "101x1", "ax5", "5x5x5", "-1x3"] {
        let error = text.parse::<GridSize>().unwrap_err();
        assert!(error.contains("as in 5x5"), "{text}: {error}");
    }
    assert!("yeld".parse::<GridControl>().unwrap_err().contains("all-way-stop"));
    let told = |grid: Grid| grid.to_dxf().unwrap_err().to_string();
    let long = told(Grid { block_m: 101.0, ..Grid::default() });
    assert_eq!(long, "the length between junctions is 101 m; it must be between 0.5 and 100 m");
    assert!(told(Grid { turn_radius_m: f64::NAN, ..Grid::default() }).contains("radius"));
    assert!(told(grid("100x100")).contains("choose fewer or shorter roads"));
}

#[test]
fn a_grid_of_a_hundred_junctions_is_a_map() {
    let grid = grid("10x10");
    let map = map_of(&grid);
    assert_eq!(map.lanes.len(), 12 * 100 + 2 * 2 * 10 * 11);
}
