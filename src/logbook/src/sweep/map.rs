//! Heat maps of a sweep over one or two axes: the share of seeds with a collision and, where streams merge, the share
//! in which a yielding vehicle merges before the others are through.

use super::delay::DelayCurves;
use super::delay_figure::{DELAY, DELAY_FLOW};
use super::table::{SweepRow, column};
use crate::figures::chart::{ColourBar, Figure, HeatMapCell, Panel};
use crate::figures::{TidyTable, number};
use city3d_simulation::scenario::counted;
use city3d_simulation::sweep::Axis;

/// Names of the figures.
pub const MAPS: [&str; 4] = ["merge_success", "collisions", DELAY_FLOW, DELAY];

/// Results of a whole sweep.
#[derive(Debug)]
pub struct SweepResults<'s> {
    /// The parameters that were varied.
    pub axes: &'s [Axis],
    /// Rows of [`row`](super::row), in the order of the axes, seeds last.
    pub rows: &'s [SweepRow],
    /// The scenario before its parameters are set.
    pub document: &'s toml::Table,
    /// Whether the runs had the environment of a laboratory, which the notes of the maps tell.
    pub is_testbed: bool,
}

/// One cell of a map: its share and its text.
struct MapCell {
    share: f64,
    word: String,
    /// Columns of the table after x, y and the number of runs.
    figures: Vec<String>,
}

/// Texts of a map.
struct MapText {
    name: &'static str,
    title: String,
    note: &'static str,
    /// Names of the columns [`MapCell::figures`].
    columns: [&'static str; 2],
}

impl SweepResults<'_> {
    /// Every figure that can be drawn: maps where the sweep has one or two axes, and the delay where one has several
    /// numbers.
    pub fn figures(&self) -> Vec<Figure> {
        let delay = DelayCurves::of(self).map(|curves| curves.figure());
        self.merging().into_iter().chain(self.collisions()).chain(delay).collect()
    }

    fn merging(&self) -> Option<Figure> {
        let squeezed = column(self.axes.len(), "squeezed_in")?;
        let collisions = column(self.axes.len(), "collisions")?;
        // Random traffic has no streams that one map could show.
        let has_traffic = self.document.contains_key("traffic");
        if has_traffic || self.rows.iter().any(|row| row[squeezed].is_empty()) {
            return None;
        }
        let words = MapText {
            name: MAPS[0],
            title: format!("{}: a vehicle of Path 1 merges before Path 2 is through", self.name()),
            note: "Path 1 is the stream that gives way. *: a collision in at least one run.",
            columns: ["share_squeezed_in", "runs_with_collisions"],
        };
        self.figure(words, |cell| {
            let (share, crashed) = (share_of(cell, squeezed), count_of(cell, collisions));
            let mark = if crashed > 0 { " *" } else { "" };
            let figures = vec![number(share, 4), crashed.to_string()];
            MapCell { share, word: format!("{:.0} %{mark}", 100.0 * share), figures }
        })
    }

    fn collisions(&self) -> Option<Figure> {
        let collisions = column(self.axes.len(), "collisions")?;
        let speed = column(self.axes.len(), "mean_speed_mps")?;
        let words = MapText {
            name: MAPS[1],
            title: format!("{}: runs with a collision", self.name()),
            note: "Beside the share: mean speed of all vehicles, laboratory m/s.",
            columns: ["share_with_collisions", "mean_speed_mps"],
        };
        self.figure(words, |cell| {
            let share = share_of(cell, collisions);
            let speeds = cell.iter().filter_map(|row| row[speed].parse::<f64>().ok());
            let mean_mps = speeds.sum::<f64>() / cell.len() as f64;
            let figures = vec![number(share, 4), number(mean_mps, 5)];
            MapCell { share, word: format!("{:.0} %  {mean_mps:.3}", 100.0 * share), figures }
        })
    }

    pub(super) fn name(&self) -> &str {
        self.document.get("name").and_then(toml::Value::as_str).unwrap_or_default()
    }

    fn figure(&self, words: MapText, entry: impl Fn(&[SweepRow]) -> MapCell) -> Option<Figure> {
        let (x, y) = match self.axes {
            [x] => (x, None),
            [x, y] => (x, Some(y)),
            _ => return None,
        };
        let heights = y.map_or(1, |axis| axis.values.len());
        let mut table = TidyTable::new(&["x", "y", "runs", words.columns[0], words.columns[1]]);
        let mut panel = Panel {
            x_label: x.key.clone(),
            y_label: y.map_or_else(String::new, |axis| axis.key.clone()),
            x: (-0.5, x.values.len() as f64 - 0.5),
            y: (-0.5, heights as f64 - 0.5),
            marks: [Some(marks(x)), Some(y.map(marks).unwrap_or_default())],
            ..Panel::default()
        };
        let per_cell = (self.rows.len() / (x.values.len() * heights)).max(1);
        for (index, cell) in self.rows.chunks(per_cell).enumerate() {
            let (column, row) = (index / heights, index % heights);
            let MapCell { share, word, figures } = entry(cell);
            let (left, low) = (column as f64 - 0.5, row as f64 - 0.5);
            panel.cells.push(HeatMapCell { x: (left, left + 1.0), y: (low, low + 1.0), share, word });
            let place = [
                x.values[column].to_string(),
                y.map_or_else(String::new, |axis| axis.values[row].to_string()),
                cell.len().to_string(),
            ];
            table.rows.push(place.into_iter().chain(figures).collect());
        }
        let setting = if self.is_testbed { "Testbed emulator. " } else { "" };
        Some(Figure {
            name: words.name.to_owned(),
            title: words.title,
            panels: vec![panel],
            columns: 1,
            row_height: if y.is_some() { 0.5 } else { 0.12 },
            legend: Vec::new(),
            scale: Some(ColourBar {
                label: format!("share of {}", counted(per_cell, "run")),
                from: 0.0,
                to: 1.0,
            }),
            note: format!("{setting}{}", words.note),
            table,
        })
    }
}

/// Rows of a cell whose column is not zero.
fn count_of(cell: &[SweepRow], column: usize) -> usize {
    cell.iter().filter(|row| &row[column] != "0").count()
}

fn share_of(cell: &[SweepRow], column: usize) -> f64 {
    count_of(cell, column) as f64 / cell.len() as f64
}

fn marks(axis: &Axis) -> Vec<(f64, String)> {
    axis.values.iter().enumerate().map(|(k, value)| (k as f64, value.to_string())).collect()
}
