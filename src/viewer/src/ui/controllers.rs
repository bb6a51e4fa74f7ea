//! The window of gamepads and steering wheels: mapping and calibration of axes and buttons.

use super::commands::{DRIVING_KEYS, HELP, key_map};
use super::{UiAction, UiState, theme};
use crate::cockpit::{ControlFunction, Device, DeviceControl, Devices};
use egui::{RichText, Sense, Ui, Vec2};

/// Shows all devices.
pub fn show(ui: &mut Ui, state: &mut UiState, actions: &mut Vec<UiAction>) {
    finish(ui, state, actions);
    egui::ScrollArea::both().auto_shrink([false, true]).show(ui, |ui| {
        let devices = &mut state.devices;
        let numbers: Vec<usize> = devices.iter().map(|(number, _)| number).collect();
        if numbers.is_empty() {
            nothing(ui, devices);
        }
        for number in numbers {
            ui.push_id(number, |ui| device(ui, devices, number, actions));
        }
    });
}

/// Applies a finished calibration.
fn finish(ui: &Ui, state: &mut UiState, actions: &mut Vec<UiAction>) {
    let now_s = ui.input(|input| input.time);
    if let Some(taken) = state.devices.try_finish(now_s) {
        actions.push(UiAction::KeepDevices);
        if !taken.is_empty() {
            let names: Vec<&str> = taken.into_iter().map(ControlFunction::label).collect();
            state.say(format!("Its former function has no control now: {}.", names.join(", ")), now_s);
        }
    }
    if state.devices.learning().is_some() {
        ui.ctx().request_repaint();
    }
}

fn nothing(ui: &mut Ui, devices: &Devices) {
    let keys = key_map::of(ui.ctx());
    let held = &DRIVING_KEYS;
    let drives = [held.gas, held.left, held.brake, held.right].map(|binding| keys.first(&binding)).join(" ");
    let help = keys.tip("Help lists its keys", &HELP);
    ui.label(format!("No gamepad or steering wheel is plugged in. The keyboard drives: {drives}. {help}."));
    ui.label(RichText::new("Plug one in at any time; it appears here.").weak());
    if let Some(reason) = devices.missing() {
        ui.label(RichText::new(reason).weak());
    }
}

/// Shows the assignments of a device.
fn device(ui: &mut Ui, devices: &mut Devices, number: usize, actions: &mut Vec<UiAction>) {
    let Some(device) = devices.get(number).cloned() else { return };
    ui.horizontal(|ui| {
        ui.label(RichText::new(&device.name).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if ui.small_button("Restore").on_hover_text("Restore the default assignments").clicked() {
                devices.restore(number);
                actions.push(UiAction::KeepDevices);
            }
        });
    });
    egui::Grid::new("functions").num_columns(5).show(ui, |ui| {
        for function in ControlFunction::ALL {
            row(ui, devices, (number, &device), function, actions);
            ui.end_row();
        }
    });
    let mut speed_sensitive = device.profile.speed_sensitive;
    let tip = "For thumb sticks; a steering wheel turns the car's wheel directly";
    if ui.checkbox(&mut speed_sensitive, "Steers less the faster the car is").on_hover_text(tip).changed() {
        devices.change(number, |profile| profile.speed_sensitive = speed_sensitive);
        actions.push(UiAction::KeepDevices);
    }
    let request = devices.learning().filter(|(of, _)| *of == number);
    let text = request.map_or_else(
        || {
            "Assign asks you to move the axis or pedal, or to press the button; its range is learnt."
                .to_owned()
        },
        |(_, learner)| format!("{}: {} Esc cancels.", learner.function().label(), learner.request()),
    );
    let text = RichText::new(text);
    ui.label(if request.is_some() { text.strong() } else { text.weak() });
    ui.separator();
}

fn row(
    ui: &mut Ui,
    devices: &mut Devices,
    (number, device): (usize, &Device),
    function: ControlFunction,
    actions: &mut Vec<UiAction>,
) {
    ui.label(function.label());
    let control = device.profile.control(function);
    let text = control.map_or_else(|| "not assigned".to_owned(), |control| control.to_string());
    ui.label(if control.is_some() { RichText::new(text) } else { RichText::new(text).weak() });
    meter(ui, device, function);
    let learns =
        devices.learning().is_some_and(|(of, learner)| of == number && learner.function() == function);
    ui.horizontal(|ui| {
        let label = format!("Assign {}", function.label());
        let assign = ui
            .add(egui::Button::selectable(learns, if learns { "move it ..." } else { "Assign" }).frame(true));
        assign.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, label.clone()));
        if assign.clicked() {
            if learns { devices.stop_learning() } else { devices.learn(number, function) }
        }
        if control.is_some() {
            adjust(ui, devices, number, (function, control), actions);
        }
    });
}

/// Buttons to invert a control, to clear it, and to set its dead zone.
fn adjust(
    ui: &mut Ui,
    devices: &mut Devices,
    number: usize,
    (function, control): (ControlFunction, Option<DeviceControl>),
    actions: &mut Vec<UiAction>,
) {
    let mut changed = false;
    let has_way = matches!(control, Some(DeviceControl::Axis(_))) || function.is_lever();
    if has_way
        && ui.small_button("Invert").on_hover_text("Left becomes right, pressed becomes released").clicked()
    {
        devices.change(number, |profile| profile.invert(function));
        changed = true;
    }
    if ui.small_button("x").on_hover_text("Remove the assignment").clicked() {
        devices.change(number, |profile| profile.clear(function));
        changed = true;
    }
    let dead = devices.get(number).and_then(|device| device.profile.dead_zone(function));
    if let (true, Some(before)) = (has_way, dead) {
        let mut percent = before * 100.0;
        let value = theme::number_field(&mut percent).range(0.0..=60.0).fixed_decimals(0).suffix(" %");
        if ui.add(value).on_hover_text("Dead zone: share of the travel that has no effect").changed() {
            devices.change(number, |profile| profile.set_dead_zone(function, percent / 100.0));
            changed = true;
        }
    }
    if changed {
        actions.push(UiAction::KeepDevices);
    }
}

/// Shows the present position of a control. Left is left.
fn meter(ui: &mut Ui, device: &Device, function: ControlFunction) {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(90.0, 10.0), Sense::hover());
    let position = device.position(function);
    let number = theme::decimal(ui.ctx()).fixed(position, 2);
    response.widget_info(|| {
        let text = format!("{} {number}", function.label());
        egui::WidgetInfo::labeled(egui::Role::ProgressIndicator, true, text)
    });
    let painter = ui.painter();
    painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    let (from, to) = if function == ControlFunction::Steering {
        let middle = rect.center().x;
        (middle, middle - position as f32 * rect.width() / 2.0)
    } else {
        (rect.left(), rect.left() + position as f32 * rect.width())
    };
    let part = egui::Rect::from_x_y_ranges(from.min(to)..=from.max(to), rect.y_range());
    painter.rect_filled(part, 2.0, egui::Color32::from_rgb(90, 140, 210));
}
