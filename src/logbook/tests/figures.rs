//! Figures and comparisons of runs that were simulated here: what a reader sees has one meaning.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]

use city3d_logbook::figures::chart::{ChartLine, Colour, Dash, Figure, LineStyle};
use city3d_logbook::figures::{
    Comparison, FigureScale, FigureSet, FigureSize, GiveWayKind, Quantity, RunLog, RunPair, SeriesFigure,
    StreamLayout, TraceBuilder, WAY_AHEAD_M, WAY_BEHIND_M, WayFigure, moving_average, svg,
};
use city3d_logbook::record::LogOrigin;
use city3d_protocol::snapshot::{Event, EventKind, Status, VehicleId};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use std::collections::BTreeSet;
use std::sync::Arc;

/// A run of a shipped scenario with other text in places, seen ten times per second.
fn run_with(name: &str, changes: &[(&str, &str)], duration_s: f64) -> RunLog {
    let (mut text, library) = Library::scenario(name).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    let experiment = Arc::new(read_experiment(name, &text, &library, overrides).unwrap());
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let (mut builder, mut events) = (TraceBuilder::new(Arc::clone(&experiment)), Vec::<Event>::new());
    loop {
        let snapshot = run.snapshot();
        if snapshot.tick.is_multiple_of(10) {
            builder.see_signals(snapshot.time_s, &snapshot.signals);
            for vehicle in &snapshot.vehicles {
                builder.see(snapshot.time_s, vehicle);
            }
        }
        events.extend(snapshot.events.iter().cloned());
        if snapshot.tick >= experiment.ticks() {
            break;
        }
        run.step();
    }
    RunLog { events, ..builder.finish(LogOrigin::Run) }
}

fn run(name: &str, duration_s: f64) -> RunLog {
    run_with(name, &[], duration_s)
}

fn figures(runs: &[RunLog], merge: Option<&str>) -> (Vec<Figure>, Vec<String>, Option<String>) {
    let layout = StreamLayout::of(&runs[0], merge, None).unwrap();
    let set = FigureSet::new(runs, &layout, &BTreeSet::new());
    let (figures, notes) = set.all();
    (figures, notes, set.merge_note())
}

fn key(style: LineStyle) -> (Colour, Dash) {
    (style.colour, style.dash)
}

fn of<'f>(figures: &'f [Figure], name: &str) -> &'f Figure {
    figures.iter().find(|figure| figure.name == name).unwrap_or_else(|| panic!("{name}"))
}

#[test]
fn eight_cars_of_a_platoon_have_eight_line_styles_and_the_legend_has_them() {
    let (figures, ..) = figures(&[run("platoon", 12.0)], None);
    for name in ["speed_path_1", "lateral_error"] {
        let figure = of(&figures, name);
        let keys: Vec<_> = figure.legend.iter().map(|entry| key(entry.stroke)).collect();
        assert_eq!(keys.len(), 8, "{name}");
        assert!((1..8).all(|k| !keys[..k].contains(&keys[k])), "{name}: {keys:?}");
        let drawn: Vec<_> = figure.panels[0].lines.iter().map(|line| key(line.stroke)).collect();
        assert_eq!(drawn, keys, "{name}");
    }
}

/// Every line of a figure has a colour of its legend.
fn check_legends(figures: &[Figure]) {
    for figure in figures.iter().filter(|figure| figure.scale.is_none() && figure.name != "pedals") {
        let named: Vec<_> = figure.legend.iter().map(|entry| entry.stroke.colour).collect();
        for line in figure.panels.iter().flat_map(|panel| &panel.lines) {
            assert!(named.contains(&line.stroke.colour), "{}: {:?}", figure.name, line.stroke);
        }
    }
}

#[test]
fn a_crowd_has_the_colours_of_its_paths_and_a_median() {
    let runs = [run("merge", 120.0)];
    let (figures, _, note) = figures(&runs, None);
    check_legends(&figures);
    assert_eq!(note, None, "there is one merging point alone");
    let names: Vec<&str> =
        of(&figures, "speed_path_1").legend.iter().map(|entry| entry.name.as_str()).collect();
    assert!(names[0].ends_with(" vehicles") && names[1].starts_with("median"), "{names:?}");
    assert!(of(&figures, "position").legend[0].name.starts_with("Path 1 ("));
}

#[test]
fn of_many_vehicles_the_few_on_the_paths_have_line_styles_of_their_own() {
    let runs = [run("intersection", 120.0)];
    assert!(runs[0].vehicles.len() > 12);
    let (figures, _, note) = figures(&runs, None);
    check_legends(&figures);
    let legend = &of(&figures, "position").legend;
    assert!((2..=12).contains(&legend.len()), "{legend:?}");
    let name = |entry: &str| entry.rsplit(' ').next().unwrap().to_owned();
    assert!(legend.iter().all(|entry| runs[0].vehicles.iter().any(|trace| trace.name == name(&entry.name))));
    for stream in StreamLayout::of(&runs[0], None, None).unwrap().streams(&runs[0]) {
        let of_path = legend.iter().filter(|entry| entry.name.starts_with(&format!("{}: ", stream.name)));
        assert_eq!(of_path.count(), 1, "{}: {legend:?}", stream.name);
    }
    // Zones are those that vehicles of the paths pass, and who else passes them is grey.
    let occupancy = of(&figures, "occupancy");
    assert_eq!(occupancy.legend.last().unwrap().name, "vehicles of other paths");
    let bars = &occupancy.panels.last().unwrap().lines;
    let other = occupancy.legend.last().unwrap().stroke.colour;
    let rows = |is_other: bool| -> BTreeSet<i64> {
        let of = bars.iter().filter(|bar| (bar.stroke.colour == other) == is_other);
        of.map(|bar| bar.points[0].1.round() as i64).collect()
    };
    assert!(
        !rows(true).is_empty() && rows(true).is_subset(&rows(false)),
        "{:?} {:?}",
        rows(true),
        rows(false)
    );
    // Several streams merge: which one is shown, and how to see another one.
    let note = note.unwrap();
    let layout = StreamLayout::of(&runs[0], None, None).unwrap();
    let (shown, other) = (&layout.merge.as_ref().unwrap().name, &layout.other_merges[0].name);
    for told in [&format!("the beginning of {shown} ("), "--merge LANE", &format!(": {other} (")] {
        assert!(note.contains(told), "{told}: {note}");
    }
    assert!(of(&figures, "position").note.contains("--merge LANE"));
    let (_, _, requested) = self::figures(&runs, Some(other));
    let requested = requested.unwrap();
    assert!(requested.contains(&format!("the beginning of {other} (")), "{requested}");
    assert!(requested.contains("as requested") && requested.contains(&format!(": {shown} (")), "{requested}");
}

#[test]
fn the_median_of_a_crowd_is_that_of_its_vehicles() {
    let runs = [run("merge", 120.0)];
    let (figures, ..) = figures(&runs, None);
    let figure = of(&figures, "speed_path_1");
    let value = |row: &Vec<String>, column: &str| {
        let index = figure.table.columns.iter().position(|name| *name == column).unwrap();
        row[index].clone()
    };
    let number = |row: &Vec<String>, column: &str| value(row, column).parse::<f64>().unwrap();
    let (medians, single): (Vec<_>, Vec<_>) =
        figure.table.rows.iter().partition(|row| value(row, "name") == "median");
    let vehicles: BTreeSet<String> = single.iter().map(|row| value(row, "vehicle")).collect();
    let mut checked = 0;
    for median in medians.iter().filter(|row| !value(row, "speed_mps").is_empty()).step_by(20) {
        let at = number(median, "position_m");
        let near = |id: &String| {
            let own = single.iter().filter(|row| value(row, "vehicle") == *id);
            let off = |row: &&&Vec<String>| (number(row, "position_m") - at).abs();
            let nearest = own.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            (off(&nearest) < 0.03).then(|| number(nearest, "speed_mps"))
        };
        let speeds: Vec<f64> = vehicles.iter().filter_map(near).collect();
        let below = speeds.iter().filter(|speed| **speed < number(median, "speed_mps") - 0.01).count();
        let above = speeds.iter().filter(|speed| **speed > number(median, "speed_mps") + 0.01).count();
        assert!(2 * below.max(above) <= speeds.len() + 1, "{median:?}: {speeds:?}");
        checked += 1;
    }
    assert!(checked > 4, "{checked}");
}

#[test]
fn lines_are_named_by_what_stands_there() {
    let runs = [run("intersection-signals", 120.0)];
    let layout = StreamLayout::of(&runs[0], None, None).unwrap();
    assert!(
        layout
            .streams(&runs[0])
            .iter()
            .any(|s| s.line.is_some_and(|l| matches!(l.kind, GiveWayKind::Signal(_))))
    );
    let (figures, ..) = figures(&runs, None);
    for name in ["position", "space_time", "speed_path_1"] {
        let rules: Vec<&str> = of(&figures, name)
            .panels
            .iter()
            .flat_map(|panel| &panel.rules)
            .map(|rule| rule.name.as_str())
            .collect();
        assert!(rules.iter().any(|name| name.starts_with("signal")), "{name}: {rules:?}");
        assert!(!rules.iter().any(|name| name.contains("yield line")), "{name}: {rules:?}");
    }
    // What the signal of a path shows is at its line: each second of the run is red, yellow or neither.
    let figure = of(&figures, "space_time");
    let names: Vec<&str> = figure.legend.iter().map(|entry| entry.name.as_str()).collect();
    assert_eq!(names, ["signal red", "signal yellow"]);
    // Each line of a vehicle has its name at its end.
    let panel = &figure.panels[0];
    let at_end = |at: &(f64, f64)| panel.lines.iter().any(|line| line.points.last() == Some(at));
    assert!(!panel.names.is_empty() && panel.names.iter().all(|name| at_end(&name.at)), "{:?}", panel.names);
    assert!(panel.names.iter().all(|name| !name.name.is_empty()), "{:?}", panel.names);
    let red = figure.legend[0].stroke;
    let bars: Vec<_> = figure.panels[0].lines.iter().filter(|line| line.stroke == red).collect();
    let line_at = figure.panels[0].rules.iter().find(|rule| rule.name == "signal").unwrap().at;
    assert!(!bars.is_empty() && bars.iter().all(|bar| bar.points.iter().all(|(_, at)| *at == line_at)));
    let red_s: f64 = bars.iter().map(|bar| bar.points[1].0 - bar.points[0].0).sum();
    assert!((20.0..100.0).contains(&red_s), "{red_s}");
    // Beside a run with yield lines both are named.
    let runs = [run("intersection-signals", 120.0), run("intersection", 120.0)];
    let pair = {
        let [a, b] = runs;
        RunPair::new(a, b).unwrap()
    };
    let (figures, ..) = self::figures(pair.runs(), None);
    let names: Vec<&str> =
        of(&figures, "position").panels[1].rules.iter().map(|rule| rule.name.as_str()).collect();
    assert!(names.iter().any(|name| name.starts_with("signal (a), yield line (b) of Path ")), "{names:?}");
}

#[test]
fn an_algorithm_is_compared_with_none_on_the_same_road() {
    let pair = RunPair::new(run("roundabout", 25.0), run("roundabout-coordinated", 25.0)).unwrap();
    let layout = StreamLayout::of(&pair.runs()[0], None, None).unwrap();
    let set = FigureSet::new(pair.runs(), &layout, &BTreeSet::new());
    assert_eq!(set.labels(), ["roundabout, right of way", "roundabout-coordinated, insert"]);
    let comparison = Comparison::of(&pair, &layout, set.labels());
    let scenarios = comparison.runs.each_ref().map(|run| run.scenario.as_str());
    assert_eq!(scenarios, ["roundabout", "roundabout-coordinated"]);
    assert!(comparison.settings.iter().any(|line| line == "coordination.algorithm: none, \"insert\""));
    assert!(comparison.settings.iter().all(|line| !line.starts_with("name:")), "{:?}", comparison.settings);
    assert_eq!((comparison.apart.len(), &comparison.only), (6, &[Vec::<String>::new(), Vec::new()]));
    for figure in set.all().0.iter().chain([&set.difference()]) {
        for size in [FigureSize::Column, FigureSize::Page] {
            let drawn = svg(figure, size).unwrap();
            for label in set.labels() {
                // Text of an SVG is escaped, and may be broken into lines.
                let first = label.split(' ').next().unwrap();
                assert!(drawn.contains(first), "{}: {label}", figure.name);
            }
        }
    }
}

#[test]
fn labels_say_what_differs() {
    let labels = |a: RunLog, b: RunLog| {
        let pair = RunPair::new(a, b).unwrap();
        let layout = StreamLayout::of(&pair.runs()[0], None, None).unwrap();
        FigureSet::new(pair.runs(), &layout, &BTreeSet::new()).labels().to_vec()
    };
    let straight = || run("straight", 1.0);
    let other = |changes: &[(&str, &str)]| run_with("straight", changes, 1.0);
    assert_eq!(labels(straight(), other(&[("seed = 1", "seed = 5")])), ["seed 1", "seed 5"]);
    let testbed = other(&[("[[vehicle_type", "[environment]\nprofile = \"testbed\"\n\n[[vehicle_type")]);
    assert_eq!(labels(straight(), testbed), ["ideal", "testbed emulator"]);
    assert_eq!(labels(straight(), straight()), ["ideal, run A", "ideal, run B"]);
    let ploeg = run_with("platoon", &[("controller = \"cacc\"", "controller = \"ploeg\"")], 1.0);
    assert_eq!(labels(run("platoon", 1.0), ploeg), ["cacc and sinusoid", "ploeg and sinusoid"]);
}

#[test]
fn vehicles_are_paired_by_name_and_those_of_one_run_alone_are_told() {
    // The first vehicle of the other scenario has another name, so that all numbers are those of other names.
    let other = run_with("straight", &[("name = \"leader\"", "name = \"tram\"")], 2.0);
    let pair = RunPair::new(run("straight", 2.0), other).unwrap();
    assert_eq!(pair.only(), &[vec!["leader".to_owned()], vec!["tram".to_owned()]]);
    let names =
        |run: &RunLog| run.vehicles.iter().map(|trace| (trace.id.0, trace.name.clone())).collect::<Vec<_>>();
    assert_eq!(names(&pair.runs()[1]), [(2, "follower".to_owned()), (3, "tram".to_owned())]);
    // Events follow the numbers.
    let spawned = |run: &RunLog| -> Vec<u32> {
        let spawns = run.events.iter().filter(|event| event.kind == EventKind::Spawn);
        spawns.map(|event| event.vehicle.0).collect()
    };
    assert_eq!(spawned(&pair.runs()[0]), [1, 2]);
    assert_eq!(spawned(&pair.runs()[1]), [3, 2]);
    assert!(pair.runs()[1].vehicle(VehicleId(1)).is_none());

    let strangers = [("name = \"leader\"", "name = \"tram\""), ("name = \"follower\"", "name = \"bus\"")];
    let error = RunPair::new(run("straight", 1.0), run_with("straight", &strangers, 1.0)).unwrap_err();
    let said = error.to_string();
    assert!(said.contains("no vehicle in common, by name: leader, follower, and tram, bus"), "{said}");
    let said = RunPair::new(run("straight", 1.0), run("platoon", 1.0)).unwrap_err().to_string();
    assert!(said.contains("the maps differ ("), "{said}");
}

/// A run of the roundabout of which one vehicle is not measured for a while: the city keeps it at a place, with zeros.
fn with_an_unseen_vehicle(id: VehicleId, (from_s, to_s): (f64, f64)) -> RunLog {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let overrides = Overrides { duration_s: Some(20.0), ..Overrides::default() };
    let experiment = Arc::new(read_experiment("roundabout", &text, &library, overrides).unwrap());
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let mut builder = TraceBuilder::new(Arc::clone(&experiment));
    let mut kept = None;
    while run.snapshot().tick < experiment.ticks() {
        let snapshot = run.snapshot();
        for vehicle in snapshot.vehicles.iter().filter(|_| snapshot.tick.is_multiple_of(2)) {
            let mut state = vehicle.clone();
            if state.id == id && (from_s..to_s).contains(&snapshot.time_s) {
                let pose = *kept.get_or_insert((state.position, state.orientation));
                (state.position, state.orientation) = pose;
                (state.status, state.speed_mps, state.acceleration_mps2) = (Status::Unseen, 0.0, 0.0);
            }
            builder.see(snapshot.time_s, &state);
        }
        run.step();
    }
    builder.finish(LogOrigin::Run)
}

#[test]
fn a_vehicle_that_is_not_tracked_has_gaps_and_no_zeros() {
    let (id, hidden_s) = (VehicleId(4), (3.0, 5.0));
    let is_hidden = |time_s: f64| time_s > hidden_s.0 + 1e-6 && time_s < hidden_s.1 - 0.021;
    let log = with_an_unseen_vehicle(id, hidden_s);
    let trace = log.vehicle(id).unwrap();
    let least_mps = trace.samples.iter().map(|sample| sample.speed_mps).fold(f64::INFINITY, f64::min);
    assert!(least_mps > 1.0, "it drives all the time: {least_mps}");
    let [run] = [&log];
    for quantity in [Quantity::Speed, Quantity::Acceleration, Quantity::Distance, Quantity::Gap] {
        let figure = SeriesFigure {
            quantity,
            scale: FigureScale::City,
            experiment: &run.experiment,
            span_s: (0.0, 20.0),
            shown: vec![trace],
            all: &run.vehicles,
        };
        let figure = figure.draw(true);
        let line = &figure.panels[0].lines[0].points;
        assert!(line.iter().filter(|(s, _)| is_hidden(*s)).all(|(_, value)| value.is_nan()), "{quantity:?}");
        assert!(figure.note.ends_with("A gap: the vehicle was not tracked."), "{}", figure.note);
        let cell = |row: &&Vec<String>| row[3] == "4.000";
        assert_eq!(figure.table.rows.iter().find(cell).unwrap()[4], "", "{quantity:?}");
    }
    let runs = [log];
    let (figures, ..) = figures(&runs, None);
    for name in ["space_time", "position", "speed_path_1", "speed_path_2"] {
        let rows = &of(&figures, name).table.rows;
        let times = rows.iter().filter(|row| row[2] == "4").map(|row| row[4].parse::<f64>().unwrap());
        assert_eq!(times.filter(|time_s| is_hidden(*time_s)).count(), 0, "{name}");
    }
    let is_line = |line: &&ChartLine| line.points.iter().all(|(s, m)| s.is_finite() && m.is_finite());
    let across = |line: &&ChartLine| {
        line.points.windows(2).any(|pair| pair[0].0 < hidden_s.0 && pair[1].0 > hidden_s.1)
    };
    let panels = &of(&figures, "space_time").panels;
    let lines = panels.iter().flat_map(|panel| &panel.lines);
    assert_eq!(lines.filter(is_line).filter(across).count(), 0, "no line leads over the gap");
    let speeds = &of(&figures, "speed_time").panels[0].lines;
    let means = speeds.iter().flat_map(|line| &line.points).filter(|(_, value)| value.is_finite());
    assert!(means.map(|(_, value)| *value).fold(f64::INFINITY, f64::min) > -0.01);
    let own = &runs[0].vehicle(id).unwrap();
    let mean = moving_average(own);
    let zeros = mean.iter().filter(|value| **value < 1.0).count();
    assert_eq!((zeros, mean.iter().filter(|value| value.is_nan()).count()), (0, 100));
}

#[test]
fn titles_and_tables_of_one_run_tell_scenario_seed_and_environment() {
    let (figures, ..) = figures(&[run("roundabout", 8.0)], None);
    let figure = of(&figures, "space_time");
    assert_eq!(figure.title, "roundabout, seed 2, ideal environment: space-time diagram");
    assert_eq!(figure.table.rows[0][0], "roundabout, seed 2, ideal environment");
}

#[test]
fn the_way_of_a_vehicle_shows_everybody_on_its_lanes_from_its_front() {
    let log = run("roundabout", 20.0);
    let way = |of: u32, is_whole: bool| {
        let (scale, span_s) = (FigureScale::City, if is_whole { (0.0, 20.0) } else { (10.0, 20.0) });
        WayFigure { run: &log, of: VehicleId(of), scale, span_s, is_whole }.draw().unwrap()
    };
    let figure = way(2, true);
    assert_eq!(figure.legend[0].name, "2 path1_b");
    let panel = &figure.panels[0];
    let own = &panel.lines[0].points;
    assert!(own.last().unwrap().1.abs() < 0.01 && own[0].1 < -30.0, "{own:?}");
    assert!(panel.lines[0].stroke.width_pt > panel.lines[1].stroke.width_pt);
    // Who is ahead on the same lanes is as far ahead as the poses say.
    let first = figure.legend.iter().position(|entry| entry.name == "1 path1_a").unwrap();
    let of = |id| &log.vehicle(VehicleId(id)).unwrap().samples[10];
    let apart_m = of(1).pose.position.distance(of(2).pose.position);
    let (ahead_m, own_m) = (panel.lines[first].points[10].1, own[10].1);
    assert!((ahead_m - own_m - apart_m).abs() < 0.5, "{ahead_m} {own_m} {apart_m}");
    // The axis reaches as far as lines do.
    let all = || panel.lines.iter().flat_map(|line| &line.points).map(|(_, m)| *m).filter(|m| m.is_finite());
    let (low_m, high_m) = (all().fold(0.0, f64::min), all().fold(0.0, f64::max));
    let apart_m = (low_m - panel.y.0).max(panel.y.1 - high_m);
    assert!(panel.y.0 < low_m && panel.y.1 > high_m && apart_m < 0.1 * (high_m - low_m), "{:?}", panel.y);
    let near = way(2, false);
    assert_eq!((near.panels[0].x, near.panels[0].y), ((10.0, 20.0), (-WAY_BEHIND_M, WAY_AHEAD_M)));
    assert!(near.table.rows.iter().all(|row| row[3].parse::<f64>().unwrap() >= 10.0));
    assert!(figure.title.ends_with("space-time diagram, the way of 2 path1_b"), "{}", figure.title);
}
