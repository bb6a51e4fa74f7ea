//! The legend of a picture of depth, classes or instances, below it.

use super::{ViewModel, occlusion};
use city3d_geometry::trig;
use city3d_protocol::snapshot::VehicleId;
use city3d_render::instance_colour;
use city3d_scene::Class;
use city3d_sensors::{BoundingBox, PictureKind, View};
use egui::{Align2, Color32, FontId, Painter, Rect, Vec2, pos2, vec2};
use glam::DVec3;

const FONT: FontId = FontId::proportional(11.0);
const ROW: f32 = 14.0;
const SWATCH: f32 = 9.0;
/// Between an entry and the next one, points.
const APART: f32 = 8.0;
/// Between the edge of the ground and what is written there, points.
const MARGIN: Vec2 = vec2(4.0, 2.0);
/// From which to which depth the greys of a picture are told apart, metres, and the grey of the far end: as in
/// `shaders/palette.wgsl`.
const NEAR_M: f64 = 1.0;
const FAR_M: f64 = 200.0;
const FAR_GREY: f64 = 0.08;
/// Depths that are written on the scale, metres.
const TICKS_M: [f64; 4] = [1.0, 5.0, 25.0, 200.0];

/// The vehicles in a picture that no wall hides, the nearest first. That of the camera is one: its bonnet is in the picture.
pub fn seen(view: &View, shown: &ViewModel<'_>) -> Vec<VehicleId> {
    let [width, height] = view.extent.map(f64::from);
    let eye = view.extrinsics.position;
    let in_picture = |point: DVec3| {
        let pixel = view.project(point);
        pixel.is_some_and(|pixel| (0.0..width).contains(&pixel.x) && (0.0..height).contains(&pixel.y))
    };
    let in_sight = shown.interpolated.iter().filter(|(vehicle, info)| {
        let corners = BoundingBox::of(vehicle, info).corners();
        let mut visible = corners.into_iter().filter(|corner| in_picture(*corner));
        let is_hidden = |corner| occlusion::is_occluded(eye, corner, shown.walls);
        view.carrier == Some(vehicle.id) || visible.any(|corner| !is_hidden(corner))
    });
    let mut found: Vec<_> =
        in_sight.map(|(vehicle, _)| (vehicle.position.distance(eye), vehicle.id)).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, id)| id).collect()
}

/// What the colours of a picture mean, for those who do not see them; empty for a picture in colour.
pub fn words(kind: PictureKind) -> String {
    match kind {
        PictureKind::Rgb => String::new(),
        PictureKind::Depth => {
            format!(
                "Depth: {NEAR_M:.0} m and nearer is white, {FAR_M:.0} m and farther dark; logarithmic. The sky is blue"
            )
        }
        PictureKind::Semantic => {
            let names = Class::ALL.map(Class::name).join(", ");
            format!("Classes by colour: {names}")
        }
        PictureKind::Instance => {
            "Instances: each vehicle has a colour of its own, not that of its body or of its line in a chart; all else is black".to_owned()
        }
    }
}

/// Height of the legend below a picture of some width, points; colour pictures have none.
pub fn height(painter: &Painter, width: f32, kind: PictureKind) -> f32 {
    let rows = match kind {
        PictureKind::Rgb => return 0.0,
        PictureKind::Depth => 2,
        PictureKind::Semantic => rows(painter, width - 2.0 * MARGIN.x).len(),
        PictureKind::Instance => 1,
    };
    ROW * rows as f32 + 2.0 * MARGIN.y
}

/// Paints the legend into the rectangle below a picture.
pub fn paint(painter: &Painter, below: Rect, kind: PictureKind, seen: &[VehicleId]) {
    match kind {
        PictureKind::Rgb => {}
        PictureKind::Depth => depth(painter, below),
        PictureKind::Semantic => classes(painter, below),
        PictureKind::Instance => instances(painter, below, seen),
    }
}

/// Numbers of the nearest vehicles with their colours.
fn instances(painter: &Painter, below: Rect, seen: &[VehicleId]) {
    let ground = ground(painter, below);
    let mut at = ground.left_center();
    let words = if seen.is_empty() { "a colour for each vehicle; none is near" } else { "instance" };
    at.x = text(painter, at, Align2::LEFT_CENTER, words).right() + APART;
    for id in seen {
        let number = painter.layout_no_wrap(id.to_string(), FONT, Color32::WHITE);
        if at.x + SWATCH + 3.0 + number.size().x > ground.right() {
            break;
        }
        let [r, g, b] = instance_colour(*id);
        swatch(painter, at, Color32::from_rgb(r, g, b));
        at.x =
            text(painter, at + vec2(SWATCH + 3.0, 0.0), Align2::LEFT_CENTER, &id.to_string()).right() + APART;
    }
}

/// A patch of a colour that begins at the middle of its left edge.
fn swatch(painter: &Painter, at: egui::Pos2, colour: Color32) {
    let swatch = Rect::from_center_size(at + vec2(SWATCH / 2.0, 0.0), Vec2::splat(SWATCH));
    painter.rect_filled(swatch, 1.0, colour);
    // Some of the colours are as dark as the ground.
    painter.rect_stroke(swatch, 1.0, (1.0, Color32::from_gray(150)), egui::StrokeKind::Outside);
}

/// The names of the classes, in rows as wide as the picture.
fn rows(painter: &Painter, width: f32) -> Vec<Vec<(Class, f32)>> {
    let mut rows: Vec<Vec<(Class, f32)>> = vec![Vec::new()];
    let mut left = 0.0;
    for class in Class::ALL {
        let galley = painter.layout_no_wrap(class.name().to_owned(), FONT, Color32::WHITE);
        let needed = SWATCH + 3.0 + galley.size().x;
        if left + needed > width && left > 0.0 {
            rows.push(Vec::new());
            left = 0.0;
        }
        if let Some(row) = rows.last_mut() {
            row.push((class, left));
        }
        left += needed + APART;
    }
    rows
}

fn classes(painter: &Painter, below: Rect) {
    let ground = ground(painter, below);
    let rows = rows(painter, ground.width());
    for (k, row) in rows.iter().enumerate() {
        for (class, left) in row {
            let middle = ground.left_top() + vec2(*left, ROW * (k as f32 + 0.5));
            let [r, g, b] = class.colour();
            swatch(painter, middle, Color32::from_rgb(r, g, b));
            text(painter, middle + vec2(SWATCH + 3.0, 0.0), Align2::LEFT_CENTER, class.name());
        }
    }
}

fn depth(painter: &Painter, below: Rect) {
    const STEPS: u8 = 48;
    let ground = ground(painter, below);
    let bar = Rect::from_min_size(ground.min + vec2(0.0, 3.0), vec2(ground.width(), ROW - 6.0));
    let x = |share: f32| bar.left() + share * bar.width();
    for step in 0..STEPS {
        let [from, to] = [step, step + 1].map(|step| f32::from(step) / f32::from(STEPS));
        let grey = 1.0 - (1.0 - FAR_GREY) * f64::from((from + to) / 2.0);
        let part = Rect::from_x_y_ranges(x(from)..=x(to), bar.y_range());
        painter.rect_filled(part, 0.0, Color32::from_gray((255.0 * grey).round() as u8));
    }
    let row = ground.bottom() - ROW / 2.0;
    for tick_m in TICKS_M {
        let share = trig::log10(tick_m / NEAR_M) / trig::log10(FAR_M / NEAR_M);
        let align = match tick_m {
            _ if tick_m <= NEAR_M => Align2::LEFT_CENTER,
            _ if tick_m >= FAR_M => Align2::RIGHT_CENTER,
            _ => Align2::CENTER_CENTER,
        };
        text(painter, pos2(x(share as f32), row), align, &format!("{tick_m:.0} m"));
    }
}

/// Paints the dark ground; returns where to write.
fn ground(painter: &Painter, below: Rect) -> Rect {
    painter.rect_filled(below, 0.0, Color32::from_gray(20));
    below.shrink2(MARGIN)
}

fn text(painter: &Painter, at: egui::Pos2, align: Align2, words: &str) -> Rect {
    painter.text(at, align, words, FONT, Color32::WHITE)
}
