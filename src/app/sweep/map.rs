//! The map of a sweep: in which share of the seeds a vehicle that has to give way gets in before the others are through.

use super::grid::Axis;
use super::table::column;
use crate::figures::chart::{Cell, Figure, Panel, Scale};
use crate::figures::{Table, number};

/// `None` where nothing merges, or the sweep has not one or two axes.
pub fn figure(
    axes: &[Axis],
    rows: &[Vec<String>],
    document: &toml::Table,
    is_testbed: bool,
) -> Option<Figure> {
    let (x, y) = match axes {
        [x] => (x, None),
        [x, y] => (x, Some(y)),
        _ => return None,
    };
    let squeezed = column(axes.len(), "squeezed_in")?;
    let collisions = column(axes.len(), "collisions")?;
    if rows.iter().any(|row| row[squeezed].is_empty()) {
        return None;
    }
    let name = document.get("name").and_then(toml::Value::as_str).unwrap_or_default();
    let mut table = Table::new(&["x", "y", "runs", "share_squeezed_in", "runs_with_collisions"]);
    let mut panel = Panel {
        x_label: x.key.clone(),
        y_label: y.map_or_else(String::new, |axis| axis.key.clone()),
        x: (-0.5, x.values.len() as f64 - 0.5),
        y: (-0.5, y.map_or(1, |axis| axis.values.len()) as f64 - 0.5),
        marks: Some([words(x), y.map(words).unwrap_or_default()]),
        ..Panel::default()
    };
    // Rows are in the order of the axes, seeds last.
    let per_y = rows.len() / (x.values.len() * y.map_or(1, |axis| axis.values.len()));
    for (index, cell) in rows.chunks(per_y.max(1)).enumerate() {
        let (column, row) =
            y.map_or((index, 0), |axis| (index / axis.values.len(), index % axis.values.len()));
        let count = |index: usize| cell.iter().filter(|row| row[index] != "0").count();
        let share = count(squeezed) as f64 / cell.len() as f64;
        let crashed = count(collisions);
        let word =
            if crashed > 0 { format!("{:.0} % *", 100.0 * share) } else { format!("{:.0} %", 100.0 * share) };
        let (left, low) = (column as f64 - 0.5, row as f64 - 0.5);
        panel.cells.push(Cell { x: (left, left + 1.0), y: (low, low + 1.0), share, word });
        table.rows.push(vec![
            x.values[column].to_string(),
            y.map_or_else(String::new, |axis| axis.values[row].to_string()),
            cell.len().to_string(),
            number(share, 4),
            crashed.to_string(),
        ]);
    }
    Some(Figure {
        name: "merge_success".to_owned(),
        title: format!("{name}: a vehicle of Path 1 merges before Path 2 is through"),
        panels: vec![panel],
        columns: 1,
        row_height: if y.is_some() { 0.5 } else { 0.12 },
        legend: Vec::new(),
        scale: Some(Scale { label: format!("share of {per_y} runs"), from: 0.0, to: 1.0 }),
        note: format!(
            "{}Path 1 is the stream that gives way. *: a collision in at least one run.",
            if is_testbed { "Testbed emulator. " } else { "" }
        ),
        table,
    })
}

fn words(axis: &Axis) -> Vec<(f64, String)> {
    axis.values.iter().enumerate().map(|(k, value)| (k as f64, value.to_string())).collect()
}
