//! The lowest bar of the window.

use super::{CityKind, ViewModel, commands, help};
use egui::{Align, Label, Layout, RichText, Ui};

/// Room of a text that is cut, points.
const LEAST_TEXT: f32 = 60.0;

/// The lowest bar: keys, where the run is recorded, its conditions, pictures a second.
pub(super) fn show(ui: &mut Ui, shown: &ViewModel<'_>, has_dialog: bool) {
    let cut = |ui: &mut Ui, text: RichText| ui.add(Label::new(text.small()).truncate());
    let from_right = Layout::right_to_left(Align::Center);
    let row = |ui: &mut Ui| {
        if shown.frames_per_s > 0.0 {
            // Fixed width, so that its neighbours do not move.
            let text = format!("{:3.0} fps", shown.frames_per_s);
            ui.label(RichText::new(text).small().monospace());
        }
        // What tells its runs apart; an edited scenario has none yet.
        if shown.city != CityKind::Elsewhere && shown.edit.is_none() {
            let tip = "Seed and environment of this run: the same pair repeats it, unless a person drives or other values were set. \
                       \"Ideal\" is without delays, noise and losses; vehicles of the laboratory are measured, and have those of the testbed always";
            ui.small(shown.conditions).on_hover_text(tip);
        }
        // Where there is little room, the keys are cut and the rest is left out.
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
            // A dialog takes the keys.
            if !has_dialog {
                cut(ui, help::reminder(&commands::key_map::of(ui.ctx()), shown).into());
            }
            if ui.available_width() > LEAST_TEXT {
                ui.with_layout(from_right, |ui| cut(ui, RichText::new(shown.footer).weak()));
            }
        });
    };
    ui.horizontal(|ui| ui.with_layout(from_right, row));
}
