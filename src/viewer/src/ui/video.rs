//! Recording the window or the city alone: the button, its menu, and what it says.

use super::commands::{SCREENSHOT, VIDEO};
use super::{UiAction, UiState, ViewModel, theme};
use egui::containers::menu::MenuButton;
use egui::{Button, RichText, Ui, Vec2};
use serde::{Deserialize, Serialize};

/// What a video shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VideoSubject {
    /// The window with its panels.
    #[default]
    Window,
    /// The picture of the large view with what its layers draw in the city, without panels, labels and notices.
    City,
}

impl VideoSubject {
    /// Both, with their names in the menu.
    const ALL: [(Self, &'static str); 2] = [(Self::Window, "Whole window"), (Self::City, "City alone")];

    /// The other one.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Window => Self::City,
            Self::City => Self::Window,
        }
    }
}

/// A video as it was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VideoRequest {
    /// What it shows.
    pub subject: VideoSubject,
    /// How it is recorded.
    pub kind: VideoKind,
}

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
    /// What is recorded, and how.
    pub request: VideoRequest,
    /// Length of the video so far, seconds.
    pub length_s: f64,
}

/// Least and largest time between two pictures of a time-lapse, simulated seconds.
const LAPSE_S: std::ops::RangeInclusive<f64> = 0.1..=3600.0;
/// Width of the button, so that its neighbours do not move while the length grows.
const WIDTH: f32 = 66.0;

/// The button, which begins and ends a recording, with a menu of what is recorded and how beside it.
pub(super) fn button(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let text = match shown.video {
        Some(video) => {
            let seconds = video.length_s as u64;
            let text = format!("\u{23f9} {}:{:02}", seconds / 60, seconds % 60);
            RichText::new(text).color(ui.visuals().error_fg_color)
        }
        None => RichText::new("\u{23fa} Video"),
    };
    let request = |kind| VideoRequest { subject: state.video_subject, kind };
    let tip = match shown.video.map(|video| video.request.kind) {
        None if state.video_subject == VideoSubject::City => {
            VIDEO.tip(ui.ctx(), "Record the city without panels as a video")
        }
        None => VIDEO.tip(ui.ctx(), "Record what the window shows as a video"),
        Some(VideoKind::AsSeen) => VIDEO.tip(ui.ctx(), "End the video and write its file"),
        Some(VideoKind::TimeLapse { every_s }) => VIDEO.tip(
            ui.ctx(),
            &format!(
                "A picture each {} simulated seconds. End the video and write its file",
                theme::decimal(ui.ctx()).plain(every_s)
            ),
        ),
    };
    if ui.add(Button::new(text).min_size(Vec2::new(WIDTH, 0.0))).on_hover_text(tip).clicked() {
        actions.push(UiAction::Video(request(VideoKind::AsSeen)));
    }
    if shown.video.is_some() {
        return;
    }
    let (menu, _) = MenuButton::new("\u{23f7}").config(super::menu_with_fields()).ui(ui, |ui| {
        for (subject, name) in VideoSubject::ALL {
            ui.radio_value(&mut state.video_subject, subject, name);
        }
        ui.separator();
        ui.horizontal(|ui| {
            // Menus show buttons and fields as texts, and this row has both.
            ui.visuals_mut().widgets.inactive = ui.ctx().global_style().visuals.widgets.inactive;
            let is_chosen = ui.button("Time-lapse").clicked();
            ui.label("a picture each");
            ui.add(theme::number_field(&mut state.lapse_s).range(LAPSE_S).speed(0.1).suffix(" s"));
            if is_chosen {
                let kind = VideoKind::TimeLapse { every_s: state.lapse_s };
                actions.push(UiAction::Video(VideoRequest { subject: state.video_subject, kind }));
                ui.close();
            }
        });
        ui.separator();
        if ui.add(Button::new("Save a screenshot").shortcut_text(SCREENSHOT.key(ui.ctx()))).clicked() {
            actions.push(UiAction::Screenshot);
            ui.close();
        }
    });
    menu.on_hover_text(
        "What a video shows; a time-lapse: one picture each so many simulated seconds; a screenshot",
    );
}
