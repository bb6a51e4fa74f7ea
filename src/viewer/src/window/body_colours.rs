//! Lines of charts in the colours of the vehicles that they belong to, as bodies in the city have them, on the screen and in
//! files. On paper they are as dark as white ground needs.

use crate::ui::{colour_difference, legible_line};
use city3d_logbook::figures::chart::{Colour, Dash, Figure, LineStyle};
use city3d_protocol::snapshot::{VehicleId, VehicleInfo};
use egui::Color32;
use std::collections::BTreeMap;

/// Colours nearer to one another are one colour to whoever looks at thin lines (CIE 1976).
const ALIKE: f64 = 30.0;
/// What tells lines of like colours apart, in this order.
const DASHES: [Dash; 4] = [Dash::Solid, Dash::Dashed, Dash::Dotted, Dash::DashDotted];

/// Names and colours of vehicles.
#[derive(Clone, Debug, Default)]
pub(super) struct Bodies {
    of: BTreeMap<VehicleId, (String, Colour)>,
}

impl Bodies {
    /// Takes what is known of a vehicle.
    pub(super) fn meet(&mut self, info: &VehicleInfo) {
        self.of.entry(info.id).or_insert_with(|| (info.name.clone(), info.appearance.colour));
    }

    /// A figure whose legend names vehicles, with their lines in their colours.
    pub(super) fn painted(&self, mut figure: Figure) -> Figure {
        let mut styles: Vec<(LineStyle, LineStyle)> = Vec::new();
        for entry in &mut figure.legend {
            let Some(colour) = self.colour(&entry.name) else { continue };
            let is_alike = |style: &&(LineStyle, LineStyle)| difference(style.1.colour, colour) < ALIKE;
            let dash = DASHES[styles.iter().filter(is_alike).count() % DASHES.len()];
            let style = LineStyle { colour, dash, ..entry.stroke };
            styles.push((entry.stroke, style));
            entry.stroke = style;
        }
        for line in figure.panels.iter_mut().flat_map(|panel| &mut panel.lines) {
            let is_of = |(old, _): &&(LineStyle, LineStyle)| {
                (old.colour, old.dash) == (line.stroke.colour, line.stroke.dash)
            };
            if let Some((_, new)) = styles.iter().find(is_of) {
                (line.stroke.colour, line.stroke.dash) = (new.colour, new.dash);
            }
        }
        figure
    }

    /// The same for a white ground.
    pub(super) fn painted_on_paper(&self, figure: Figure) -> Figure {
        // Dashes tell the same vehicles apart as on the screen.
        let mut figure = self.painted(figure);
        let legend = figure.legend.iter_mut().map(|entry| &mut entry.stroke);
        let lines = figure.panels.iter_mut().flat_map(|panel| &mut panel.lines).map(|line| &mut line.stroke);
        for stroke in legend.chain(lines) {
            if self.of.values().any(|(_, colour)| *colour == stroke.colour) {
                stroke.colour = on_paper(stroke.colour);
            }
        }
        figure
    }

    /// The colour of the vehicle that an entry names: `1 car`, `car`, `Path 1: car`, with a remark behind it or none.
    fn colour(&self, entry: &str) -> Option<Colour> {
        let name = entry.split_once(": ").map_or(entry, |(_, name)| name);
        let name = name.split_once(" (").map_or(name, |(name, _)| name);
        let is_named = |(id, (known, _)): &(&VehicleId, &(String, Colour))| {
            name == known || name == format!("{id} {known}")
        };
        self.of.iter().find(is_named).map(|(_, (_, colour))| *colour)
    }
}

/// The colour as it is legible on white.
pub(super) fn on_paper([r, g, b]: Colour) -> Colour {
    let dark = legible_line(Color32::from_rgb(r, g, b), Color32::WHITE);
    [dark.r(), dark.g(), dark.b()]
}

/// How different two colours are, on white and on dark ground, which both make them legible.
fn difference(a: Colour, b: Colour) -> f64 {
    let on = |ground| {
        let [a, b] = [a, b].map(|[r, g, b]| legible_line(Color32::from_rgb(r, g, b), ground));
        colour_difference(a, b)
    };
    on(Color32::WHITE).min(on(Color32::from_gray(27)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_logbook::figures::TidyTable;
    use city3d_logbook::figures::chart::{ChartLine, LegendEntry, PALETTE, Panel};

    #[test]
    fn lines_have_the_colours_of_the_bodies_and_dashes_where_these_are_alike() {
        let mut bodies = Bodies::default();
        let colours = [[200, 30, 30], [30, 60, 200], [205, 35, 30]];
        for (k, colour) in colours.into_iter().enumerate() {
            bodies.of.insert(VehicleId(k as u32 + 1), (format!("car{}", k + 1), colour));
        }
        let names = ["1 car1", "Path 2: car2", "3 car3 (no leader)", "merging point"];
        let stroke = |k: usize| LineStyle::solid(PALETTE[k]);
        let entry = |(k, name): (usize, &&str)| LegendEntry { name: (*name).to_owned(), stroke: stroke(k) };
        let line = |k: usize| ChartLine { points: Vec::new(), stroke: stroke(k) };
        let figure = bodies.painted(Figure {
            name: String::new(),
            title: String::new(),
            panels: vec![Panel { lines: (0..4).rev().map(line).collect(), ..Panel::default() }],
            columns: 1,
            row_height: 1.0,
            legend: names.iter().enumerate().map(entry).collect(),
            scale: None,
            note: String::new(),
            table: TidyTable::default(),
        });
        let drawn = |style: LineStyle| (style.colour, style.dash);
        let legend: Vec<_> = figure.legend.iter().map(|entry| drawn(entry.stroke)).collect();
        assert_eq!(legend[..2], [0, 1].map(|k| (colours[k], Dash::Solid)));
        assert_eq!(legend[2], (colours[2], Dash::Dashed));
        assert_eq!(legend[3], drawn(stroke(3)), "what is no vehicle keeps its style");
        let lines: Vec<_> = figure.panels[0].lines.iter().rev().map(|line| drawn(line.stroke)).collect();
        assert_eq!(lines, legend);
    }
}
