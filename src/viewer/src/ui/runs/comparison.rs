//! Two runs side by side, by the measures of their summaries.

use super::super::{UiAction, UiState, ViewModel};
use super::{FilePurpose, RunEntry};
use city3d_logbook::measures::MeasurePair;
use egui::{Align, Layout, RichText, ScrollArea, Ui};
use egui_extras::{Column, TableBuilder};

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

/// State of the window.
#[derive(Clone, Debug, Default)]
pub struct ComparisonPanel {
    is_open: bool,
    /// `None` while the other run is chosen.
    compared: Option<ComparedRuns>,
}

impl ComparisonPanel {
    /// Shows the runs that can be chosen.
    pub fn choose(&mut self) {
        (self.is_open, self.compared) = (true, None);
    }

    /// Shows two runs.
    pub fn show(&mut self, compared: ComparedRuns) {
        (self.is_open, self.compared) = (true, Some(compared));
    }

    /// The runs that are shown; `None` while the other one is chosen.
    pub fn compared(&self) -> Option<&ComparedRuns> {
        self.compared.as_ref()
    }

    /// Whether the window is shown.
    pub fn is_open(&self) -> bool {
        self.is_open
    }
}

const ROW_HEIGHT: f32 = 18.0;

/// Shows the window while it is open.
pub(super) fn window(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let panel = &mut state.runs.comparison;
    if !panel.is_open {
        return;
    }
    let (mut is_open, mut chooses, mut browses) = (true, false, false);
    let room = ui.ctx().content_rect().shrink2(egui::vec2(12.0, 48.0));
    let window =
        super::super::sheet(ui, "Compare runs").resizable(true).open(&mut is_open).constrain_to(room);
    window.default_size(egui::vec2(560.0, 420.0).min(room.size())).show(ui.ctx(), |ui| {
        match &panel.compared {
            Some(compared) => {
                for (letter, name) in ["A", "B"].iter().zip(&compared.names) {
                    ui.label(format!("{letter}  {name}"));
                }
                if let Some(note) = &compared.note {
                    ui.label(RichText::new(note).color(ui.visuals().warn_fg_color));
                }
                chooses = ui.button("Another run ...").clicked();
                table(ui, &compared.pairs);
            }
            None => browses = choices(ui, shown, actions),
        }
    });
    panel.is_open = is_open;
    if chooses {
        panel.choose();
    }
    if browses {
        state.runs.browse(FilePurpose::Compare);
    }
}

/// The recorded runs; returns whether the user looks for another one.
fn choices(ui: &mut Ui, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) -> bool {
    ui.label("Which run shall the present one be compared with?");
    let browses = ui.button("Another folder ...").clicked();
    ui.separator();
    let present = shown.run_state.folder.as_ref();
    let is_other = |run: &&RunEntry| run.has_summary && Some(&run.folder) != present;
    let runs: Vec<&RunEntry> = shown.runs.lists.runs.iter().filter(is_other).collect();
    if runs.is_empty() {
        ui.label(RichText::new("No other run is recorded yet: run again, then compare.").weak());
    }
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        for run in runs {
            let text = format!("{}   {}", run.name, run.age);
            let row = ui.selectable_label(false, text).on_hover_text(run.folder.display().to_string());
            if row.clicked() {
                actions.push(UiAction::CompareWith(run.folder.clone()));
            }
        }
    });
    browses
}

fn table(ui: &mut Ui, pairs: &[MeasurePair]) {
    let number = |value: Option<f64>, pair: &MeasurePair| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.*}", pair.digits))
    };
    let builder = TableBuilder::new(ui)
        .striped(true)
        .auto_shrink(false)
        .cell_layout(Layout::left_to_right(Align::Center))
        .column(Column::remainder().at_least(180.0).clip(true))
        .columns(Column::exact(84.0), 3);
    let table = builder.header(ROW_HEIGHT, |mut header| {
        for title in ["Measure", "A", "B", "B - A"] {
            header.col(|ui| _ = ui.strong(title));
        }
    });
    table.body(|body| {
        body.rows(ROW_HEIGHT, pairs.len(), |mut line| {
            let pair = &pairs[line.index()];
            let unit = if pair.unit.is_empty() { String::new() } else { format!(", {}", pair.unit) };
            let of = pair.vehicle.as_ref().map_or_else(String::new, |name| format!("{name}: "));
            line.col(|ui| _ = ui.label(format!("{of}{}{unit}", pair.quantity)));
            for value in pair.values {
                line.col(|ui| _ = ui.monospace(number(value, pair)));
            }
            line.col(|ui| {
                let text = pair.difference().map(|difference| format!("{difference:+.*}", pair.digits));
                // No difference is said without a sign.
                let is_zero = text.as_deref().is_some_and(|text| text.parse() == Ok(0.0));
                _ = ui.monospace(match text {
                    Some(_) if is_zero => "0".to_owned(),
                    Some(text) => text,
                    None => "-".to_owned(),
                });
            });
        });
    });
}
