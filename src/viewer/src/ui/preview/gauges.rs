//! Pedals and steering of a vehicle as bars and numbers.

use crate::ui::{status, theme};
use city3d_protocol::snapshot::VehicleState;
use egui::{Align2, Color32, FontId, Rect, Sense, Ui, Vec2};

/// Steering, gas, brake and handbrake as bars and numbers; without numbers where they are not known.
pub(super) fn pedals(ui: &mut Ui, vehicle: &VehicleState, (is_physical, has_control_data): (bool, bool)) {
    let unknown = |ui: &mut Ui, names: &[&str], tip: &str| {
        names.iter().for_each(|name| gauge(ui, (name, tip), "-", |_, _| {}));
    };
    let pedals = ["Gas", "Brake", "Handbrake"];
    let is_tracked = status::is_tracked(vehicle.status);
    if !is_tracked || !has_control_data {
        let tip =
            if is_tracked { "Only poses are known here, not the pedals" } else { status::NOT_MEASURED_TIP };
        unknown(ui, &["Steering"], tip);
        return unknown(ui, &pedals, tip);
    }
    if is_physical {
        steering(ui, vehicle.steering_rad.to_degrees(), "Estimated from how it turns; + to the left");
        return unknown(ui, &pedals, "A lab vehicle: its poses are measured, its pedals are not");
    }
    steering(ui, vehicle.steering_rad.to_degrees(), "Angle of the front wheels; + to the left");
    bar(ui, ("Gas", "How far the gas pedal is down, 0 to 1"), vehicle.gas, Color32::from_rgb(90, 170, 90));
    bar(
        ui,
        ("Brake", "How far the brake pedal is down, 0 to 1"),
        vehicle.brake,
        Color32::from_rgb(205, 80, 70),
    );
    bar(ui, ("Handbrake", "0 released, 1 pulled"), vehicle.handbrake, Color32::from_rgb(205, 140, 60));
}

const NAME_WIDTH: f32 = 72.0;
const NUMBER_WIDTH: f32 = 56.0;
const BAR_HEIGHT: f32 = 14.0;
/// A shorter bar tells nothing beside its name and number: it has a row of its own, points.
const LEAST_BAR: f32 = 40.0;
/// Steering angle at the end of the bar.
const STEERING_END_DEG: f64 = 45.0;

fn bar(ui: &mut Ui, name: (&str, &str), value: f64, colour: Color32) {
    let number = theme::decimal(ui.ctx()).fixed(value, 2);
    gauge(ui, name, &number, |painter, rect| {
        let width = rect.width() * value.clamp(0.0, 1.0) as f32;
        painter.rect_filled(Rect::from_min_size(rect.min, Vec2::new(width, rect.height())), 2.0, colour);
    });
}

/// Left is left.
fn steering(ui: &mut Ui, angle_deg: f64, tip: &str) {
    let number = theme::decimal(ui.ctx()).tenths(angle_deg);
    let sign = if number.starts_with('-') { "" } else { "+" };
    gauge(ui, ("Steering", tip), &format!("{sign}{number}\u{b0}"), |painter, rect| {
        let share = (-angle_deg / STEERING_END_DEG).clamp(-1.0, 1.0) as f32;
        let middle = rect.center().x;
        let end = middle + share * rect.width() / 2.0;
        let part = Rect::from_x_y_ranges(middle.min(end)..=middle.max(end), rect.y_range());
        painter.rect_filled(part, 0.0, Color32::from_rgb(90, 140, 210));
        painter.vline(middle, rect.y_range(), egui::Stroke::new(1.0, Color32::GRAY));
    });
}

fn gauge(ui: &mut Ui, (name, tip): (&str, &str), number: &str, fill: impl FnOnce(&egui::Painter, Rect)) {
    let width = ui.available_width();
    let is_below = width < NAME_WIDTH + LEAST_BAR + NUMBER_WIDTH;
    let size = Vec2::new(width, if is_below { 2.0 * BAR_HEIGHT } else { BAR_HEIGHT });
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    response.widget_info(|| {
        egui::WidgetInfo::labeled(egui::Role::ProgressIndicator, true, format!("{name} {number}"))
    });
    response.on_hover_text(tip);
    let painter = ui.painter_at(rect);
    let colour = ui.visuals().text_color();
    let font = FontId::proportional(12.0);
    let row = Rect::from_min_size(rect.min, Vec2::new(width, BAR_HEIGHT));
    painter.text(row.left_center(), Align2::LEFT_CENTER, name, font, colour);
    painter.text(row.right_center(), Align2::RIGHT_CENTER, number, FontId::monospace(12.0), colour);
    let track = match is_below {
        true => row.translate(Vec2::new(0.0, BAR_HEIGHT)),
        false => Rect::from_x_y_ranges(row.left() + NAME_WIDTH..=row.right() - NUMBER_WIDTH, row.y_range()),
    };
    let track = track.shrink2(Vec2::new(0.0, 2.0));
    painter.rect_filled(track, 2.0, ui.visuals().extreme_bg_color);
    let edge = ui.visuals().widgets.noninteractive.bg_stroke;
    painter.rect_stroke(track, 2.0, edge, egui::StrokeKind::Outside);
    fill(&painter, track);
}
