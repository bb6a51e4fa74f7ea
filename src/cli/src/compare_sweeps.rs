//! `city3d compare` of sweeps: delays by curve, with confidence intervals, in one table and one figure.

use super::compare::CompareArgs;
use super::say::say;
use super::{Failure, on_end, plot};
use city3d_logbook::sweep::{DelayCurves, DelayPoint, MeanInterval, RecordedSweep};
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};

/// Compares sweeps by their folders.
pub fn compare(args: &CompareArgs, folders: &[PathBuf]) -> Result<(), Failure> {
    let curves = folders.iter().map(|folder| read(folder)).collect::<Result<Vec<_>, _>>()?;
    let joined = DelayCurves::joined(curves).map_err(Failure::bad_input)?;
    let Some(curves) = joined else { return Err(Failure::bad_input("no sweep is given")) };
    let figure = curves.figure();
    let files = plot::files_of(std::iter::once(figure.name.as_str()));
    // Sweeps have figures of the same names in their folders.
    let own: Vec<PathBuf> =
        folders.iter().flat_map(|sweep| files.iter().map(|file| sweep.join(file))).collect();
    let claim = |folder| plot::claim(folder, &files, args.overwrite, &own);
    let _locked = args.out.as_deref().map(claim).transpose()?;
    if args.json {
        let points: Vec<Json> = curves.points().iter().map(|point| as_json(&curves, point)).collect();
        say(serde_json::to_string_pretty(&points).map_err(Failure::failed)?)?;
    } else {
        print(&curves)?;
    }
    let Some(folder) = &args.out else { return Ok(()) };
    plot::write_all(std::slice::from_ref(&figure), args.figures.size(), folder, &*on_end()?)?;
    if args.json {
        Ok(())
    } else {
        say(format_args!("{}: {} (SVG, PNG, CSV)", folder.display(), figure.name))
    }
}

/// The label of a sweep and its delays.
fn read(folder: &Path) -> Result<(String, DelayCurves), Failure> {
    let sweep = RecordedSweep::read(folder).map_err(Failure::bad_input)?;
    let curves = DelayCurves::of(&sweep.results()).ok_or_else(|| {
        let folder = folder.display();
        Failure::bad_input(format!(
            "{folder} has no delays to compare: a sweep needs an axis of several numbers, and runs with passages"
        ))
    })?;
    Ok((sweep.label, curves))
}

fn as_json(curves: &DelayCurves, point: &DelayPoint) -> Json {
    let interval = |of: &MeanInterval| json!({ "mean": of.mean, "ci95": of.half_width, "runs": of.count });
    json!({
        "curve": point.curve,
        "axis": curves.axis().name,
        "value": point.value,
        "mean_delay_s": interval(&point.delay_s),
        "throughput_per_h": point.throughput_per_h.as_ref().map(interval),
        "collisions": point.collisions,
    })
}

fn print(curves: &DelayCurves) -> Result<(), Failure> {
    say(
        "mean delay [s] with half the width of its 95 % confidence interval, and vehicles an hour that left",
    )?;
    let (names, values) = (curves.names(), curves.values());
    let width =
        names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(curves.axis().name.len()) + 2;
    let cells: String = values.iter().map(|value| format!("{value:>24}")).collect();
    say(format_args!("{:<width$}{cells}", curves.axis().name))?;
    for name in names {
        let cell = |value: &&str| {
            let here = curves.points().iter().find(|point| point.curve == name && point.value == **value);
            format!("{:>24}", here.map_or_else(|| "-".to_owned(), cell_of))
        };
        say(format_args!("{name:<width$}{}", values.iter().map(cell).collect::<String>()))?;
    }
    match curves.points().iter().map(|point| point.collisions).sum::<u64>() {
        0 => say("no run had a collision"),
        _ => curves.points().iter().filter(|point| point.collisions > 0).try_for_each(|point| {
            say(format_args!("collisions: {} in {}, {}", point.collisions, point.curve, point.value))
        }),
    }
}

/// Delay and flow of a point.
fn cell_of(point: &DelayPoint) -> String {
    let half = point.delay_s.half_width.map_or_else(String::new, |half| format!(" ± {half:.2}"));
    let flow = point.throughput_per_h.map_or_else(String::new, |flow| format!(" ({:.0})", flow.mean));
    format!("{:.2}{half}{flow}", point.delay_s.mean)
}
