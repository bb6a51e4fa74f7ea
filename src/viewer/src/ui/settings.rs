//! The settings: a page of theme, status colours, size of the interface, units and the layout, and a page of keys.

use super::theme::{DecimalSeparator, SCALES, SpeedUnit, StatusColours, Theme};
use super::{UiState, commands, key_page, status};
use city3d_protocol::snapshot::Status;
use egui::{ComboBox, Grid, RichText, Ui};

/// The pages of the settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SettingsPage {
    /// Theme, colours, size and units.
    #[default]
    General,
    /// All actions with their keys.
    Keys,
}

/// Shows the settings while they are open. Each choice holds at once and is kept.
pub fn window(ui: &Ui, state: &mut UiState) {
    let mut is_open = state.open.settings;
    if !is_open {
        state.key_page.rest();
    }
    super::sheet(ui, "Settings").open(&mut is_open).show(ui.ctx(), |ui| {
        ui.horizontal(|ui| {
            ui.selectable_value(&mut state.settings_page, SettingsPage::General, "General");
            ui.selectable_value(&mut state.settings_page, SettingsPage::Keys, "Keys");
        });
        ui.separator();
        match state.settings_page {
            SettingsPage::General => {
                state.key_page.rest();
                general(ui, state);
            }
            SettingsPage::Keys => key_page::show(ui, state),
        }
        ui.label(RichText::new("Settings are kept in view.toml for the next window.").small().weak());
    });
    state.open.settings = is_open;
}

fn general(ui: &mut Ui, state: &mut UiState) {
    Grid::new("settings").num_columns(2).spacing([18.0, 8.0]).show(ui, |ui| choices(ui, state));
    ui.separator();
    ui.horizontal(|ui| {
        if ui.button("Restore the layout").on_hover_text("All panels back in their usual places").clicked() {
            state.restore_layout();
        }
        let keys = ui
            .button("Keys and statuses")
            .on_hover_text(commands::HELP.tip(ui.ctx(), "The list of all keys"));
        state.open.help |= keys.clicked();
    });
}

fn choices(ui: &mut Ui, state: &mut UiState) {
    let preferences = &mut state.preferences;
    ui.label("Theme");
    ui.horizontal(|ui| {
        ui.selectable_value(&mut preferences.theme, Theme::Dark, "Dark");
        ui.selectable_value(&mut preferences.theme, Theme::Light, "Light")
            .on_hover_text("For projectors and bright rooms");
        ui.selectable_value(&mut preferences.theme, Theme::HighContrast, "High contrast")
            .on_hover_text("White on black, with edges of all buttons: texts have a contrast of 7 and more");
    });
    ui.end_row();
    ui.label("Status colours");
    ui.horizontal(|ui| {
        ui.selectable_value(&mut preferences.colours, StatusColours::Usual, "Usual");
        ui.selectable_value(&mut preferences.colours, StatusColours::ColourBlind, "Colour-blind")
            .on_hover_text("Told apart by lightness, blue and yellow: for red-green colour blindness");
        for status in [Status::Driving, Status::Yielding, Status::Stopped, Status::Collided] {
            let (place, response) = ui.allocate_exact_size(egui::vec2(14.0, 14.0), egui::Sense::hover());
            let colour = super::theme::on_panel(ui.ctx(), status);
            status::paint_sign_in(ui.painter(), (place.center(), 4.5), status, colour);
            response.on_hover_text(status::label(status));
        }
    });
    ui.end_row();
    ui.label("Size of the interface");
    let keys = [&commands::LARGER, &commands::SMALLER].map(|command| command.key(ui.ctx())).join(" and ");
    ComboBox::from_id_salt("scale")
        .selected_text(percent(preferences.scale))
        .show_ui(ui, |ui| {
            for scale in SCALES {
                ui.selectable_value(&mut preferences.scale, scale, percent(scale));
            }
        })
        .response
        .on_hover_text(keys);
    ui.end_row();
    ui.label("Speeds in");
    let label =
        |unit| SpeedUnit::ALL.iter().find(|(other, _)| *other == unit).map_or("", |(_, label)| *label);
    let units = ComboBox::from_id_salt("units").selected_text(label(preferences.units)).show_ui(ui, |ui| {
        for (unit, label) in SpeedUnit::ALL {
            ui.selectable_value(&mut preferences.units, unit, label);
        }
    });
    units.response.on_hover_text("Unit of all speeds. With laboratory units charts are in laboratory metres; gaps, distances and accelerations of the panels stay full-scale");
    ui.end_row();
    ui.label("Numbers");
    ui.horizontal(|ui| {
        for (decimal, example, tip) in [
            (DecimalSeparator::Point, "12.5", "With a decimal point"),
            (DecimalSeparator::Comma, "12,5", "With a decimal comma"),
        ] {
            ui.selectable_value(&mut preferences.decimal, decimal, example).on_hover_text(tip);
        }
    });
    ui.end_row();
}

fn percent(scale: f32) -> String {
    format!("{:.0} %", scale * 100.0)
}
