//! The columns of the table: which find room, and how wide they are. By their places in the table: number, name, driver, status,
//! position and speed.

use egui::Ui;

/// Column widths of usual texts, points.
pub(super) const WIDTHS: [f32; 7] = [40.0, 52.0, 54.0, 76.0, 47.0, 47.0, 50.0];
/// In a narrow table, where positions are whole metres and names are cut.
const COMPACT_WIDTHS: [f32; 7] = [38.0, 50.0, 54.0, 60.0, 34.0, 34.0, 48.0];
/// Weights by which columns share the remaining width.
const SHARES: [f32; 7] = [0.0, 12.0, 4.0, 1.0, 1.0, 1.0, 1.0];

/// Place of the names among the columns, and their least width, points: enough to tell names apart.
const NAME: usize = 1;
const LEAST_NAME: f32 = 34.0;
/// Columns of a table as wide as it is at first: the driver is in the tip.
const USUAL: [usize; 6] = [0, 1, 3, 4, 5, 6];
/// What is left where nothing else finds room.
const FEWEST: [usize; 3] = [0, 3, 6];
/// In a narrower window the city needs the room of whole names and of tenths of a metre, points.
const COMPACT_BELOW: f32 = 820.0;
/// Between columns, points.
pub(super) const SPACING: f32 = 5.0;

/// Width of a panel in which number, name, status, position and speed find room, in a window of some width, points.
pub fn least_width(ui: &Ui, window: f32) -> f32 {
    width_of(ui, &USUAL, if window < COMPACT_BELOW { &COMPACT_WIDTHS } else { &WIDTHS })
}

/// Usual width in a window of some width: in a wide window the drivers find room, too, points.
pub fn usual_width(ui: &Ui, window: f32) -> f32 {
    const SHARE: f32 = 0.29;
    let all: Vec<usize> = (0..WIDTHS.len()).collect();
    (SHARE * window).min(width_of(ui, &all, &WIDTHS)).max(width_of(ui, &USUAL, &WIDTHS))
}

fn width_of(ui: &Ui, columns: &[usize], widths: &[f32; 7]) -> f32 {
    /// For edges that egui rounds to pixels.
    const SLACK: f32 = 4.0;
    let frame = egui::Frame::side_top_panel(ui.style()).total_margin().sum().x;
    SLACK + needed(columns, widths) + scrollbar(ui) + frame
}

/// Width of columns with the spacing after each.
fn needed(columns: &[usize], widths: &[f32; 7]) -> f32 {
    columns.iter().map(|&k| widths[k] + SPACING).sum()
}

/// Width of the bar of a table.
pub(super) fn scrollbar(ui: &Ui) -> f32 {
    ui.spacing().scroll.bar_width + ui.spacing().scroll.bar_inner_margin
}

/// The columns that fit into some width.
#[derive(Debug, PartialEq)]
pub(super) struct TableColumns {
    /// Places among [`SortKey::COLUMNS`](super::SortKey::COLUMNS), each with its width.
    pub(super) shown: Vec<(usize, f32)>,
    /// Positions are whole metres.
    pub(super) is_compact: bool,
}

impl TableColumns {
    /// All of them, or without drivers, or narrow ones, or those that are left where nothing else finds room.
    pub(super) fn fitting(width: f32) -> Self {
        let all: Vec<usize> = (0..WIDTHS.len()).collect();
        // Names are cut before numbers are: how much, at most.
        let cut = WIDTHS[NAME] - LEAST_NAME;
        let tables: [(&[usize], &[f32; 7], f32); 3] = [
            (&all, &WIDTHS, 0.0),
            (&USUAL, &WIDTHS, cut),
            (&USUAL, &COMPACT_WIDTHS, COMPACT_WIDTHS[NAME] - LEAST_NAME),
        ];
        let fits =
            |(columns, widths, cut): &(&[usize], &[f32; 7], f32)| needed(columns, widths) - cut <= width;
        let (columns, widths, _) = tables.into_iter().find(fits).unwrap_or((&FEWEST, &COMPACT_WIDTHS, 0.0));
        let left = width - needed(columns, widths);
        let shares: f32 = columns.iter().map(|&k| SHARES[k]).sum();
        let wide = |k: usize| match k {
            NAME if left < 0.0 => widths[k] + left,
            _ => widths[k] + SHARES[k] * (left / shares).max(0.0),
        };
        let shown = columns.iter().map(|&k| (k, wide(k))).collect();
        Self { shown, is_compact: *widths == COMPACT_WIDTHS }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_table_drops_what_matters_least() {
        let of = |width: f32| {
            let columns = TableColumns::fitting(width);
            let taken: f32 = columns.shown.iter().map(|(_, width)| width + SPACING).sum();
            assert!(taken < width + 0.1 || width < 285.0, "{columns:?} in {width}");
            (columns.shown.iter().map(|(k, _)| *k).collect::<Vec<_>>(), columns.is_compact)
        };
        assert_eq!(of(402.0), ((0..7).collect(), false));
        assert_eq!(of(343.0), (USUAL.to_vec(), false));
        assert_eq!(of(331.0), (USUAL.to_vec(), false), "names are cut short, not left out");
        assert_eq!(of(320.0), (USUAL.to_vec(), true), "metres alone, and the names stay");
        assert_eq!(of(288.0), (USUAL.to_vec(), true));
        assert_eq!(of(170.0), (FEWEST.to_vec(), true));
    }
}
