//! The help window: all keys and statuses.

use super::{UiState, status};
use city3d_protocol::snapshot::Status;
use egui::{RichText, Ui};

type KeySection = (&'static str, &'static [(&'static str, &'static str)]);

const REPLAY: KeySection = (
    "Replay",
    &[
        ("Space", "play, pause"),
        ("J", "play backwards"),
        (",  .", "one recorded step back, forward"),
        ("left  right", "5 seconds back, forward"),
        ("[  ]", "event before, next event (Shift+left, right)"),
        ("Home  End", "start, end"),
        ("+  -", "faster, slower"),
        ("F3", "list of events"),
        ("F4", "traffic: delay, safety, time-space diagram"),
        ("wheel on the timeline", "zoom: less or more of the run"),
        ("F12", "screenshot"),
        ("Ctrl+Q", "quit"),
    ],
);

const SECTIONS: [KeySection; 4] = [
    (
        "Experiment",
        &[
            ("Space", "start, pause"),
            ("N", "one tick"),
            ("Ctrl+R", "reset"),
            ("+  -", "faster, slower"),
            ("F3", "list of events"),
            ("F4", "traffic: delay, safety, time-space diagram"),
            ("F12", "screenshot"),
            ("Ctrl+Q", "quit"),
        ],
    ),
    (
        "Look",
        &[
            ("1 to 5", "orbit, chase, onboard, overhead, free camera"),
            ("drag", "turn the view, in chase and onboard too"),
            ("right-drag", "move the view"),
            ("wheel", "zoom"),
            ("Z", "come near the selected vehicle; with Shift: all vehicles"),
            ("W A S D  Q E", "move the camera (arrows too)"),
            ("L", "labels over cars"),
            ("M", "map"),
            ("Ctrl +  -  0", "larger, smaller, usual panels"),
        ],
    ),
    (
        "Vehicles",
        &[
            ("click", "select, in the city or in the table"),
            ("double click", "follow"),
            ("PgUp  PgDn", "select the next one"),
            ("F", "follow the selected one, or stop following"),
            ("P", "open or close its preview"),
            ("Enter", "take the wheel, give it back"),
            ("Esc", "give back, deselect"),
        ],
    ),
    (
        "Driving",
        &[
            ("W  S", "gas, brake (arrows too)"),
            ("A  D", "steer (arrows too)"),
            ("B", "handbrake"),
            ("R", "reverse gear, at standstill"),
            ("Q  E  H", "indicators left, right, both"),
            ("V", "look back"),
            ("F2", "gamepad and steering wheel"),
        ],
    ),
];

/// Width of two columns, points.
const TWO_COLUMNS: f32 = 700.0;
/// Narrower windows show one column, points.
const TWO_COLUMNS_FROM: f32 = 720.0;

/// Shows the window while it is open; a replay has the keys of the player in place of those of a run.
pub fn window(ui: &Ui, state: &mut UiState, is_replay: bool) {
    // Nobody drives in a replay.
    let [experiment, look, vehicles, driving] = &SECTIONS;
    let sections =
        if is_replay { vec![&REPLAY, look, vehicles] } else { vec![experiment, look, vehicles, driving] };
    let room = ui.ctx().content_rect().shrink2(egui::vec2(12.0, 48.0));
    let sheet = super::sheet(ui, "Keys and statuses").open(&mut state.open.help);
    let count = if room.width() < TWO_COLUMNS_FROM { 1 } else { 2 };
    let sheet = sheet.scroll([count == 1, true]).default_height(room.height());
    sheet.max_size(room.size()).constrain_to(room).show(ui.ctx(), |ui| {
        if count == 2 {
            // Columns share the available width.
            ui.set_min_width(TWO_COLUMNS.min(room.width() - 24.0));
        }
        ui.columns(count, |columns| {
            for (index, (title, keys)) in sections.into_iter().enumerate() {
                let ui = &mut columns[index % count];
                ui.label(RichText::new(*title).strong());
                egui::Grid::new(*title).num_columns(2).show(ui, |ui| {
                    let keys = keys.iter().filter(|(key, _)| !(is_replay && *key == "Enter"));
                    for (key, what) in keys {
                        let what = if is_replay && *key == "Esc" { "close a list, deselect" } else { what };
                        ui.monospace(*key);
                        ui.label(what);
                        ui.end_row();
                    }
                });
                ui.add_space(8.0);
            }
        });
        ui.separator();
        for status in Status::ALL {
            ui.horizontal(|ui| {
                let (place, _) = ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
                status::paint_sign(ui.painter(), place.center(), 4.0, status);
                ui.label(RichText::new(status.label()).color(status::colour(status)).strong());
                ui.label(status::meaning(status));
            });
        }
    });
}
