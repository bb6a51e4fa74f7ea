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
    /// When it ends by itself, seconds of video; `None` where the user ends it.
    pub lasts_s: Option<f64>,
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
    /// Time of the run that it spans so far, simulated seconds.
    pub spanned_s: f64,
}

/// Least and largest time between two pictures of a time-lapse, simulated seconds.
const LAPSE_S: std::ops::RangeInclusive<f64> = 0.1..=3600.0;
/// Least and largest length of a video that ends by itself, seconds.
const LENGTH_S: std::ops::RangeInclusive<f64> = 1.0..=3600.0;
/// Width of the button, so that its neighbours do not move while the length grows. While a video is recorded it has the room of its
/// menu, too.
const WIDTH: f32 = 66.0;

/// The button, which begins and ends a recording, with a menu of what is recorded and how beside it.
pub(super) fn button(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let text = match shown.video {
        Some(video) => {
            let text = RichText::new(words(video)).color(ui.visuals().error_fg_color);
            if video.request.kind == VideoKind::AsSeen { text } else { text.small() }
        }
        None => RichText::new("\u{23fa} Video"),
    };
    let both = ui.scope_id().with("video and menu");
    let width = match shown.video {
        Some(_) => ui.data(|data| data.get_temp::<f32>(both)).unwrap_or(WIDTH),
        None => WIDTH,
    };
    let subject = state.video_subject;
    let request = |kind, lasts_s| VideoRequest { subject, kind, lasts_s };
    let tip = match shown.video.map(|video| (video, video.request.kind)) {
        None if state.video_subject == VideoSubject::City => {
            VIDEO.tip(ui.ctx(), "Record the city without panels as a video")
        }
        None => VIDEO.tip(ui.ctx(), "Record what the window shows as a video"),
        Some((_, VideoKind::AsSeen)) => VIDEO.tip(ui.ctx(), "End the video and write its file"),
        Some((video, VideoKind::TimeLapse { every_s })) => {
            let decimal = theme::decimal(ui.ctx());
            let (length, spanned) = (decimal.fixed(video.length_s, 1), decimal.fixed(video.spanned_s, 1));
            let every = decimal.plain(every_s);
            let lasts = format!("Time-lapse: {length} s of video show {spanned} s of the run");
            VIDEO.tip(
                ui.ctx(),
                &format!("{lasts}, a picture each {every} simulated seconds. End it and write its file"),
            )
        }
    };
    let button = ui.add(Button::new(text).min_size(Vec2::new(width, 0.0))).on_hover_text(tip);
    let has_lasted =
        |video: VideoStatus| video.request.lasts_s.is_some_and(|lasts_s| video.length_s >= lasts_s);
    if button.clicked() || shown.video.is_some_and(has_lasted) {
        actions.push(UiAction::Video(request(VideoKind::AsSeen, None)));
    }
    if shown.video.is_some() {
        return;
    }
    let (menu, _) = MenuButton::new("\u{23f7}").config(super::menu_with_fields()).ui(ui, |ui| {
        // The menu opens upwards: what is above moves nothing.
        if let Some(file) = shown.last_video {
            ui.horizontal(|ui| {
                let name = file.file_name().unwrap_or_default().to_string_lossy();
                let whole = file.display().to_string();
                ui.label(RichText::new(format!("Last: {name}")).small()).on_hover_text(&whole);
                ui.visuals_mut().widgets.inactive = ui.ctx().global_style().visuals.widgets.inactive;
                if ui.small_button("Copy path").on_hover_text(&whole).clicked() {
                    ui.ctx().copy_text(whole);
                }
            });
            ui.separator();
        }
        for (subject, name) in VideoSubject::ALL {
            ui.radio_value(&mut state.video_subject, subject, name);
        }
        ui.separator();
        ui.horizontal(|ui| {
            ui.visuals_mut().widgets.inactive = ui.ctx().global_style().visuals.widgets.inactive;
            let is_chosen = ui.button("Record").on_hover_text("A video that ends by itself").clicked();
            ui.add(theme::number_field(&mut state.video_lasts_s).range(LENGTH_S).speed(0.1).suffix(" s"));
            if is_chosen {
                let lasts_s = Some(state.video_lasts_s);
                let kind = VideoKind::AsSeen;
                actions.push(UiAction::Video(VideoRequest { subject: state.video_subject, kind, lasts_s }));
                ui.close();
            }
        });
        ui.horizontal(|ui| {
            // Menus show buttons and fields as texts, and this row has both.
            ui.visuals_mut().widgets.inactive = ui.ctx().global_style().visuals.widgets.inactive;
            let is_chosen = ui.button("Time-lapse").clicked();
            ui.label("a picture each");
            ui.add(theme::number_field(&mut state.lapse_s).range(LAPSE_S).speed(0.1).suffix(" s"));
            if is_chosen {
                let kind = VideoKind::TimeLapse { every_s: state.lapse_s };
                let subject = state.video_subject;
                actions.push(UiAction::Video(VideoRequest { subject, kind, lasts_s: None }));
                ui.close();
            }
        });
        ui.separator();
        if ui.add(Button::new("Save a screenshot").shortcut_text(SCREENSHOT.key(ui.ctx()))).clicked() {
            actions.push(UiAction::Screenshot);
            ui.close();
        }
    });
    ui.data_mut(|data| data.insert_temp(both, menu.rect.right() - button.rect.left()));
    menu.on_hover_text(
        "What a video shows and how long it is; a time-lapse: one picture each so many simulated seconds; a screenshot",
    );
}

/// What the button says of a recording: the length of the video, and of a time-lapse what it spans of the run.
fn words(video: VideoStatus) -> String {
    let seconds = video.length_s as u64;
    let length = format!("\u{23f9} {}:{:02}", seconds / 60, seconds % 60);
    match video.request.kind {
        VideoKind::AsSeen => length,
        VideoKind::TimeLapse { .. } => format!("{length} of {}", span(video.spanned_s)),
    }
}

/// A time of the run in few characters, for it grows.
fn span(spanned_s: f64) -> String {
    let seconds = (spanned_s + 1e-6) as u64;
    match seconds {
        0..100 => format!("{seconds} s"),
        100..6000 => format!("{} min", seconds / 60),
        _ => format!("{} h", seconds / 3600),
    }
}

#[cfg(test)]
mod tests {
    use super::span;

    #[test]
    fn times_of_a_run_are_told_in_few_characters() {
        let told = [0.0, 36.999_999_9, 99.9, 119.0, 5999.0, 7300.0].map(span);
        assert_eq!(told, ["0 s", "37 s", "99 s", "1 min", "99 min", "2 h"]);
    }
}
