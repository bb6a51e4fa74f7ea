//! The page of settings: theme, status colours, size of the interface, units, and the layout.

use super::theme::{SCALES, SpeedUnit, StatusColours, Theme};
use super::{UiState, commands, status};
use city3d_protocol::snapshot::Status;
use egui::{ComboBox, Grid, RichText, Ui};

/// Shows the page while it is open. Each choice holds at once and is kept.
pub fn window(ui: &Ui, state: &mut UiState) {
    let mut is_open = state.open.settings;
    super::sheet(ui, "Settings").open(&mut is_open).show(ui.ctx(), |ui| {
        Grid::new("settings").num_columns(2).spacing([18.0, 8.0]).show(ui, |ui| choices(ui, state));
        ui.separator();
        ui.horizontal(|ui| {
            if ui
                .button("Restore the layout")
                .on_hover_text("All panels back in their usual places")
                .clicked()
            {
                state.restore_layout();
            }
            let keys =
                ui.button("Keys and statuses").on_hover_text(commands::HELP.tip("The list of all keys"));
            state.open.help |= keys.clicked();
        });
        ui.label(RichText::new("Settings are kept in view.toml for the next window.").small().weak());
    });
    state.open.settings = is_open;
}

fn choices(ui: &mut Ui, state: &mut UiState) {
    let preferences = &mut state.preferences;
    ui.label("Theme");
    ui.horizontal(|ui| {
        ui.selectable_value(&mut preferences.theme, Theme::Dark, "Dark");
        ui.selectable_value(&mut preferences.theme, Theme::Light, "Light")
            .on_hover_text("For projectors and bright rooms");
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
    ComboBox::from_id_salt("scale")
        .selected_text(percent(preferences.scale))
        .show_ui(ui, |ui| {
            for scale in SCALES {
                ui.selectable_value(&mut preferences.scale, scale, percent(scale));
            }
        })
        .response
        .on_hover_text(format!("{} and {}", commands::LARGER.key(), commands::SMALLER.key()));
    ui.end_row();
    ui.label("Speeds in");
    let label =
        |unit| SpeedUnit::ALL.iter().find(|(other, _)| *other == unit).map_or("", |(_, label)| *label);
    let units = ComboBox::from_id_salt("units").selected_text(label(preferences.units)).show_ui(ui, |ui| {
        for (unit, label) in SpeedUnit::ALL {
            ui.selectable_value(&mut preferences.units, unit, label);
        }
    });
    units.response.on_hover_text("Unit of all speeds");
    ui.end_row();
}

fn percent(scale: f32) -> String {
    format!("{:.0} %", scale * 100.0)
}
