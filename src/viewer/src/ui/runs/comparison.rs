//! Two runs side by side: by the measures of their summaries, and by the curves of their vehicles in one chart.

use super::super::{Preferences, SpeedUnit, UiAction, UiState, ViewModel};
use super::super::{charts, traffic};
use super::{FilePurpose, RunEntry};
use city3d_geometry::LengthScale;
use city3d_logbook::figures::Quantity;
use city3d_logbook::figures::chart::Figure;
use city3d_logbook::measures::{MeasurePair, MeasureUnit};
use city3d_protocol::snapshot::VehicleId;
use egui::{Align, ComboBox, Layout, Response, RichText, ScrollArea, Ui};
use egui_extras::{Column, TableBuilder};
use std::path::{Path, PathBuf};

/// Two runs with their measures.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedRuns {
    /// Names of the present run and of the other one.
    pub names: [String; 2],
    /// Measures of the whole run, then those of the vehicles that both have.
    pub pairs: Vec<MeasurePair>,
    /// What the reader has to know about the two, such as that their scenarios differ.
    pub note: Option<String>,
}

/// The pages of the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum ComparisonPage {
    #[default]
    Measures,
    Curves,
}

/// Which curves of two runs are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CurveChoice {
    /// What is drawn over time.
    pub quantity: Quantity,
    /// The vehicle; `None` for the first one.
    pub vehicle: Option<VehicleId>,
}

/// The curves of two runs as they are known.
#[derive(Clone, Copy, Debug, Default)]
pub struct CurvesView<'a> {
    /// The figure; `None` until both runs are read.
    pub figure: Option<&'a Figure>,
    /// Vehicles with their names: first those that both runs have, then those of one run alone.
    pub vehicles: &'a [(VehicleId, String)],
    /// Why there is no figure.
    pub trouble: Option<&'a str>,
}

/// State of the window.
#[derive(Clone, Debug, Default)]
pub struct ComparisonPanel {
    is_open: bool,
    /// It was asked for since the last frame, and comes to the front.
    is_asked: bool,
    /// Its table has not been shown yet since then: it begins at its top.
    is_unread: bool,
    /// `None` while the other run is chosen.
    compared: Option<ComparedRuns>,
    page: ComparisonPage,
    curves: CurveChoice,
}

impl ComparisonPanel {
    /// Shows the runs that can be chosen.
    pub fn choose(&mut self) {
        (self.is_open, self.is_asked, self.compared) = (true, true, None);
    }

    /// Shows two runs.
    pub fn show(&mut self, compared: ComparedRuns) {
        (self.is_open, self.is_asked, self.compared) = (true, true, Some(compared));
        (self.is_unread, self.curves.vehicle) = (true, None);
    }

    /// The runs that are shown; `None` while the other one is chosen.
    pub fn compared(&self) -> Option<&ComparedRuns> {
        self.compared.as_ref()
    }

    /// Closes the window.
    pub fn close(&mut self) {
        self.is_open = false;
    }

    /// Whether the window is shown.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// The curves on display.
    pub fn shown_curves(&self) -> Option<CurveChoice> {
        let is_shown = self.is_open && self.compared.is_some() && self.page == ComparisonPage::Curves;
        is_shown.then_some(self.curves)
    }
}

const ROW_HEIGHT: f32 = 18.0;

/// Shows the window while it is open.
pub(super) fn window(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let (preferences, selected) = (state.preferences, state.selection.vehicle);
    let panel = &mut state.runs.comparison;
    if !panel.is_open {
        return;
    }
    let (mut is_open, mut chooses, mut browses) = (true, false, false);
    let room = ui.ctx().content_rect().shrink2(egui::vec2(12.0, 48.0));
    let window =
        super::super::sheet(ui, "Compare runs").resizable(true).open(&mut is_open).constrain_to(room);
    let window = window.default_size(egui::vec2(560.0, 420.0).min(room.size()));
    let shown_window = window.show(ui.ctx(), |ui| match &panel.compared {
        Some(compared) => {
            for (letter, name) in ["A", "B"].iter().zip(&compared.names) {
                ui.label(format!("{letter}  {name}"));
            }
            if let Some(note) = &compared.note {
                ui.label(RichText::new(note).color(ui.visuals().warn_fg_color));
            }
            ui.horizontal(|ui| {
                ui.selectable_value(&mut panel.page, ComparisonPage::Measures, "Measures");
                ui.selectable_value(&mut panel.page, ComparisonPage::Curves, "Curves");
                chooses = ui.button("Another run ...").clicked();
            });
            match panel.page {
                ComparisonPage::Measures => {
                    let is_unread = std::mem::take(&mut panel.is_unread);
                    table(ui, (compared.pairs.as_slice(), is_unread), (preferences, shown.scale()));
                }
                ComparisonPage::Curves => {
                    // At first that of the vehicle that one looks at.
                    let is_there = |id: &VehicleId| shown.runs.curves.vehicles.iter().any(|(of, _)| of == id);
                    panel.curves.vehicle = panel.curves.vehicle.or(selected.filter(is_there));
                    curves(ui, &mut panel.curves, shown.runs.curves);
                }
            }
        }
        None => browses = choices(ui, shown, actions),
    });
    if let Some(response) = shown_window.filter(|_| std::mem::take(&mut panel.is_asked)) {
        ui.ctx().move_to_top(response.response.layer_id);
    }
    panel.is_open = is_open;
    if chooses {
        panel.choose();
    }
    if browses {
        state.runs.browse(FilePurpose::Compare);
    }
}

/// Folder of the run that is shown: of a log, which is the scenario then, the one that it lies in.
fn present_folder(shown: &ViewModel<'_>) -> Option<PathBuf> {
    let of_log = shown.replay.and_then(|_| Path::new(shown.scenario).parent());
    absolute(of_log.or(shown.run_state.folder.as_deref())?)
}

fn absolute(path: &Path) -> Option<PathBuf> {
    std::path::absolute(path).ok()
}

/// The recorded runs; returns whether the user looks for another one.
fn choices(ui: &mut Ui, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) -> bool {
    ui.label("Which run shall the present one be compared with?");
    let browses = ui.button("Another folder ...").clicked();
    ui.separator();
    let present = present_folder(shown);
    let is_other = |run: &&RunEntry| run.has_summary && absolute(&run.folder) != present;
    let runs: Vec<&RunEntry> = shown.runs.lists.runs.iter().filter(is_other).collect();
    if runs.is_empty() {
        ui.label(RichText::new("No other run is recorded yet: run again, then compare.").weak());
    }
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        for run in runs {
            let parts = [&run.name, &run.outcome, &run.began, &run.age];
            let parts: Vec<&str> =
                parts.into_iter().map(String::as_str).filter(|part| !part.is_empty()).collect();
            let text = parts.join("   ");
            let row = ui.selectable_label(false, text).on_hover_text(run.folder.display().to_string());
            if row.clicked() {
                actions.push(UiAction::CompareWith(run.folder.clone()));
            }
        }
    });
    browses
}

/// How a measure is shown: its unit, the factor to it, and its decimals.
fn shown_in(pair: &MeasurePair, units: SpeedUnit, scale: LengthScale) -> (&'static str, f64, usize) {
    match pair.unit {
        MeasureUnit::Count => ("", 1.0, pair.digits),
        MeasureUnit::Seconds => ("s", 1.0, pair.digits),
        MeasureUnit::Metres => ("m", 1.0, pair.digits),
        MeasureUnit::Millilitres => ("ml", 1.0, pair.digits),
        MeasureUnit::MetresPerSecond => {
            (units.label(), units.of(1.0, scale), pair.digits + units.more_digits())
        }
    }
}

fn table(
    ui: &mut Ui,
    (pairs, is_unread): (&[MeasurePair], bool),
    (preferences, scale): (Preferences, LengthScale),
) {
    let decimal = preferences.decimal;
    let mut builder = TableBuilder::new(ui)
        // By itself it is as high as 200 points, beyond the edge of a low panel.
        .min_scrolled_height(0.0)
        .striped(true)
        .auto_shrink(false)
        .cell_layout(Layout::left_to_right(Align::Center))
        .column(Column::remainder().at_least(180.0).clip(true))
        .columns(Column::exact(84.0), 3);
    if is_unread {
        builder = builder.vertical_scroll_offset(0.0);
    }
    let table = builder.header(ROW_HEIGHT, |mut header| {
        header.col(|ui| _ = ui.strong("Measure"));
        for title in ["A", "B"] {
            header.col(|ui| _ = at_right(ui, RichText::new(title).strong()));
        }
        header.col(|ui| {
            let title = RichText::new("A - B").strong();
            at_right(ui, title).on_hover_text("How much more the present run has than the other one");
        });
    });
    table.body(|body| {
        body.rows(ROW_HEIGHT, pairs.len(), |mut line| {
            let pair = &pairs[line.index()];
            let (unit, factor, digits) = shown_in(pair, preferences.units, scale);
            let unit = if unit.is_empty() { String::new() } else { format!(", {unit}") };
            let of = pair.vehicle.as_ref().map_or_else(String::new, |name| format!("{name}: "));
            line.col(|ui| {
                let named = ui.label(format!("{of}{}{unit}", pair.quantity));
                if let Some(tip) = tip_of(pair.quantity) {
                    named.on_hover_text(tip);
                }
            });
            for value in pair.values {
                let text =
                    value.map_or_else(|| "-".to_owned(), |value| decimal.fixed(value * factor, digits));
                line.col(|ui| _ = at_right(ui, RichText::new(text).monospace()));
            }
            line.col(|ui| {
                let text = difference_words(pair.values, (factor, digits));
                let text = text.map_or_else(|| "-".to_owned(), |text| decimal.written(text));
                at_right(ui, RichText::new(text).monospace());
            });
        });
    });
}

/// What a measure is.
fn tip_of(quantity: &str) -> Option<&'static str> {
    match quantity {
        "slow stops" => Some(traffic::STOPS),
        "time standing, the start too" => Some(
            "All together, from below 0.5 m/s until above 1 m/s, of vehicles on their routes: from when they are there, before they have set off, \
             until these end. One that has collided counts no longer, and a parked one never",
        ),
        "mean speed" => Some(traffic::MEAN_SPEED),
        "mean delay" => Some(traffic::DELAY),
        "longest stand" => Some(traffic::LONGEST_STAND),
        "least time to collision" => {
            Some("Gap to the leader over the speed at which it closes (Hayward 1972); the least of the run")
        }
        "least post-encroachment time" => Some(
            "From when one vehicle has left a conflict zone until the next one enters it; 0 or less where both were in it, \
             which is no collision by itself",
        ),
        "least gap" => Some(
            "From bumper to bumper to the leader on the same way, along its lane; 0 or less where bodies met, also beside one another, where charts may still have some centimetres",
        ),
        _ => None,
    }
}

/// How much more the first of two values is, as they are written, so that the three numbers of a row agree.
fn difference_words(values: [Option<f64>; 2], (factor, digits): (f64, usize)) -> Option<String> {
    let written = |value: Option<f64>| format!("{:.digits$}", value? * factor).parse::<f64>().ok();
    let text = format!("{:+.digits$}", written(values[0])? - written(values[1])?);
    // No difference is said without a sign.
    let is_zero = text.parse() == Ok(0.0);
    Some(if is_zero { "0".to_owned() } else { text })
}

fn at_right(ui: &mut Ui, text: RichText) -> Response {
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| ui.label(text)).inner
}

/// One quantity of one vehicle in both runs.
fn curves(ui: &mut Ui, choice: &mut CurveChoice, view: CurvesView<'_>) {
    if let Some(trouble) = view.trouble.filter(|_| view.vehicles.is_empty()) {
        ui.label(trouble);
        return;
    }
    if view.figure.is_none() && view.trouble.is_none() {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label("Both runs are being read ...");
        });
        return;
    }
    ui.horizontal(|ui| {
        ComboBox::from_id_salt("curve")
            .selected_text(choice.quantity.label())
            .width(130.0)
            .show_ui(ui, |ui| {
                for quantity in Quantity::ALL {
                    ui.selectable_value(&mut choice.quantity, quantity, quantity.label());
                }
            })
            .response
            .on_hover_text("What is drawn over time");
        let name = |(id, name): &(VehicleId, String)| format!("{id} {name}");
        let present = choice.vehicle.or(view.vehicles.first().map(|(id, _)| *id));
        let present_name =
            view.vehicles.iter().find(|(id, _)| Some(*id) == present).map_or_else(String::new, name);
        ComboBox::from_id_salt("curve of")
            .selected_text(present_name)
            .width(150.0)
            .show_ui(ui, |ui| {
                for vehicle in view.vehicles {
                    ui.selectable_value(&mut choice.vehicle, Some(vehicle.0), name(vehicle));
                }
            })
            .response
            .on_hover_text("A vehicle of both runs, or of one of them");
    });
    match (view.figure, view.trouble) {
        (Some(figure), None) => charts::draw_over_time(ui, figure),
        (_, trouble) => _ = ui.label(trouble.unwrap_or_default()),
    }
}

#[cfg(test)]
mod tests {
    use super::difference_words;

    #[test]
    fn a_difference_is_that_of_the_numbers_beside_it() {
        let of = |a: f64, b: f64, digits| difference_words([Some(a), Some(b)], (1.0, digits)).unwrap();
        assert_eq!(of(11.24, 11.26, 1), "-0.1", "11.2 and 11.3");
        assert_eq!(of(11.26, 11.24, 1), "+0.1");
        assert_eq!(of(11.16, 11.24, 1), "0", "11.2 twice");
        assert_eq!((of(5.0, 3.0, 0).as_str(), of(5.0, 5.0, 0).as_str()), ("+2", "0"));
        assert_eq!(difference_words([None, Some(1.0)], (1.0, 1)), None);
    }
}
