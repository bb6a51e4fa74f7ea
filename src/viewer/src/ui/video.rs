//! Recording what the window shows: the button, its menu, and what it says.

use super::commands::VIDEO;
use super::{UiAction, UiState, ViewModel};
use egui::{Button, DragValue, RichText, Ui, Vec2};

/// How a video is recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VideoKind {
    /// As fast as the window shows it.
    AsSeen,
    /// One picture each so many simulated seconds.
    TimeLapse {
        /// Simulated seconds from picture to picture.
        every_s: f64,
    },
}

/// A recording that goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VideoStatus {
    /// How it is recorded.
    pub kind: VideoKind,
    /// Length of the video so far, seconds.
    pub length_s: f64,
}

/// Least and largest time between two pictures of a time-lapse, simulated seconds.
const LAPSE_S: std::ops::RangeInclusive<f64> = 0.1..=3600.0;
/// Width of the button, so that its neighbours do not move while the length grows.
const WIDTH: f32 = 66.0;

/// The button, which begins and ends a recording, with the choice of a time-lapse beside it.
pub(super) fn button(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let text = match shown.video {
        Some(video) => {
            let seconds = video.length_s as u64;
            let text = format!("\u{23f9} {}:{:02}", seconds / 60, seconds % 60);
            RichText::new(text).color(ui.visuals().error_fg_color)
        }
        None => RichText::new("\u{23fa} Video"),
    };
    let tip = match shown.video.map(|video| video.kind) {
        None => VIDEO.tip("Record what the window shows as a video"),
        Some(VideoKind::AsSeen) => VIDEO.tip("End the video and write its file"),
        Some(VideoKind::TimeLapse { every_s }) => VIDEO
            .tip(&format!("A picture each {every_s} simulated seconds. End the video and write its file")),
    };
    if ui.add(Button::new(text).min_size(Vec2::new(WIDTH, 0.0))).on_hover_text(tip).clicked() {
        actions.push(UiAction::Video(VideoKind::AsSeen));
    }
    if shown.video.is_some() {
        return;
    }
    let menu = ui.menu_button("\u{23f7}", |ui| {
        ui.horizontal(|ui| {
            let is_chosen = ui.button("Time-lapse").clicked();
            ui.label("a picture each");
            ui.add(DragValue::new(&mut state.lapse_s).range(LAPSE_S).speed(0.1).suffix(" s"));
            if is_chosen {
                actions.push(UiAction::Video(VideoKind::TimeLapse { every_s: state.lapse_s }));
                ui.close();
            }
        });
    });
    menu.response.on_hover_text("Record a time-lapse: one picture each so many simulated seconds");
}
