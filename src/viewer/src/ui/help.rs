//! The help window: all actions with their keys, the use of the mouse, all statuses, and words of the field. It can be searched.

mod glossary;

use super::commands::{self, KeyMap, SECTIONS, Section};
use super::{CityKind, UiState, ViewModel, status, theme};
use city3d_protocol::snapshot::Status;
use egui::{Key, RichText, ScrollArea, Ui};
use glossary::WORDS;

/// Width of two columns, points.
const TWO_COLUMNS: f32 = 860.0;
/// Narrower windows show one column, points.
const TWO_COLUMNS_FROM: f32 = 880.0;
/// Width of the keys, points.
const KEYS: f32 = 192.0;
/// Width of the field for words.
const FIELD: f32 = 220.0;

/// Shows the window while it is open, with what this window has: nobody drives in a replay.
pub fn window(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    let words: Vec<String> = state.help_words.split_whitespace().map(str::to_lowercase).collect();
    let sections: Vec<_> = SECTIONS
        .iter()
        .filter(|section| section.is_in(shown))
        .map(|section| (section.title, rows(&state.keys, section, &words)))
        .filter(|(_, rows)| !rows.is_empty())
        .collect();
    let room = ui.ctx().content_rect().shrink2(egui::vec2(12.0, 48.0));
    let mut is_open = state.open.help;
    let was_focused = egui::Id::unique("field of the help");
    if !is_open {
        ui.data_mut(|data| data.remove::<bool>(was_focused));
    }
    // Who opens the help wants to find something; but who drives keeps the keys.
    let may_focus = state.driving.is_none() && !state.palette.is_open;
    let mut is_left = false;
    let sheet = super::sheet(ui, "Keys and statuses").open(&mut is_open);
    let count = if room.width() < TWO_COLUMNS_FROM { 1 } else { 2 };
    let width = if count == 1 { room.width() - 24.0 } else { TWO_COLUMNS };
    sheet.max_size(room.size()).constrain_to(room).show(ui.ctx(), |ui| {
        ui.set_width(width.min(room.width() - 24.0).max(0.0));
        ui.horizontal(|ui| {
            let field = egui::TextEdit::singleline(&mut state.help_words)
                .hint_text("Search: key or words")
                .desired_width(FIELD);
            let field = ui.add(field);
            if field.has_focus() {
                ui.data_mut(|data| data.insert_temp(was_focused, true));
            } else if may_focus && !ui.data(|data| data.get_temp(was_focused).unwrap_or(false)) {
                field.request_focus();
            }
            is_left = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Escape));
        });
        ui.add_space(4.0);
        // A short list makes a low window.
        ScrollArea::vertical().auto_shrink([false, true]).max_height(room.height() - 90.0).show(ui, |ui| {
            if sections.is_empty() && !has_status(&words) && !has_term(&words) {
                ui.label(RichText::new("Nothing has these words.").weak());
            }
            columns(ui, count, &sections);
            statuses(ui, &words);
            terms(ui, &words);
        });
    });
    is_open &= !is_left;
    state.open.help = is_open;
    if !is_open {
        state.help_words.clear();
    }
}

/// What somebody who is new here needs first, with the keys that do it.
pub fn reminder(keys: &KeyMap, shown: &ViewModel<'_>) -> String {
    let of = |command: &commands::Command| keys.first(&command.binding());
    let with = |key: String, what: &str| (!key.is_empty()).then(|| format!("{key} {what}"));
    let time = [commands::LEAP_BACK.binding(), commands::LEAP_FORWARD.binding()].map(|key| keys.first(&key));
    let events =
        [commands::PREVIOUS_EVENT.binding(), commands::NEXT_EVENT.binding()].map(|key| keys.first(&key));
    let may_drive = match shown.city {
        CityKind::Elsewhere => shown.run_state.link.as_ref().is_some_and(|link| link.own_vehicle.is_some()),
        CityKind::Local | CityKind::Served => true,
    };
    let click = || Some("click a car to select".to_owned());
    let mut parts = if shown.edit.is_some() {
        vec![
            click(),
            with(of(&commands::ADD_VEHICLE), "add a vehicle"),
            with(of(&commands::RUN_EDITED), "save and run"),
            with(of(&commands::EDIT), "back to the run"),
        ]
    } else if shown.replay.is_some() {
        vec![
            with(of(&commands::PLAY_OR_PAUSE), "play/pause"),
            with(time.join(" "), "5 s"),
            with(events.join(" "), "event"),
            click(),
        ]
    } else {
        let of_run = |key, what| with(key, what).filter(|_| may_drive);
        vec![
            of_run(of(&commands::START_OR_PAUSE), "start/pause"),
            click(),
            with(of(&commands::FOLLOW), "follow"),
            with(of(&commands::PREVIEW), "camera"),
            of_run(of(&commands::TAKE_CONTROL), "drive"),
        ]
    };
    parts.extend([with(of(&commands::PALETTE), "all actions"), with(of(&commands::HELP), "help")]);
    parts.into_iter().flatten().collect::<Vec<_>>().join("   ")
}

type Row = (String, String);

/// Keys and actions of a section that have all words; an action without a key is only found by words.
fn rows(keys: &KeyMap, section: &Section, words: &[String]) -> Vec<Row> {
    let bindings = section.bindings().map(|binding| (keys.words(&binding), binding.name.to_owned()));
    let bindings = bindings.filter(|(key, _)| !key.is_empty() || !words.is_empty());
    // Who searches for one of a series finds it by its own words.
    let bindings = if words.is_empty() { in_series(bindings.collect()) } else { bindings.collect() };
    let bindings = bindings.into_iter();
    let gestures = section.gestures.iter().map(|(how, what)| ((*how).to_owned(), (*what).to_owned()));
    bindings.chain(gestures).filter(|(key, what)| has_words(&format!("{key} {what}"), words)).collect()
}

/// Rows whose keys and actions differ in a number at their ends alone, which counts on, become one row: bookmarks.
fn in_series(rows: Vec<Row>) -> Vec<Row> {
    let is_next = |a: &Row, b: &Row| counts_on(&a.0, &b.0) && counts_on(&a.1, &b.1);
    let of_series = |series: &[Row]| match series {
        [(first, what), .., (last_key, last)] => {
            let [key_end, end] = [last_key, last].map(|text| text.chars().next_back().unwrap_or_default());
            (format!("{first} ... {key_end}"), format!("{what} to {end}"))
        }
        [row] => row.clone(),
        [] => Row::default(),
    };
    rows.chunk_by(is_next).map(of_series).collect()
}

/// Whether a text is another one with the next digit at its end.
fn counts_on(text: &str, next: &str) -> bool {
    let parts = |text: &str| {
        let digit = text.chars().next_back()?.to_digit(10)?;
        Some((text[..text.len() - 1].to_owned(), digit))
    };
    let of_next = parts(text).map(|(stem, digit)| (stem, digit + 1));
    of_next.is_some() && of_next == parts(next)
}

fn has_words(text: &str, words: &[String]) -> bool {
    let text = text.to_lowercase();
    words.iter().all(|word| text.contains(word))
}

/// Sections in columns of about the same height.
fn columns(ui: &mut Ui, count: usize, sections: &[(&str, Vec<Row>)]) {
    let all: usize = sections.iter().map(|(_, rows)| rows.len() + 2).sum();
    ui.columns(count, |columns| {
        let mut above = 0;
        for (title, rows) in sections {
            let ui = &mut columns[(above * count / all.max(1)).min(count - 1)];
            above += rows.len() + 2;
            ui.label(RichText::new(*title).strong());
            rows.iter().for_each(|row| key_and_action(ui, row));
            ui.add_space(8.0);
        }
    });
}

/// A row; a long text takes several lines beside its key.
fn key_and_action(ui: &mut Ui, (key, what): &Row) {
    ui.horizontal_top(|ui| {
        let left = ui.cursor().left();
        ui.label(RichText::new(key).monospace().size(12.0));
        ui.add_space((left + KEYS - ui.cursor().left()).max(0.0));
        ui.add(egui::Label::new(what).wrap());
    });
}

fn status_words(status: Status) -> String {
    format!("{} {}", status::label(status), status::meaning(status))
}

fn has_status(words: &[String]) -> bool {
    Status::ALL.into_iter().any(|status| has_words(&status_words(status), words))
}

fn statuses(ui: &mut Ui, words: &[String]) {
    if has_status(words) {
        ui.label(RichText::new("Statuses").strong());
    }
    for status in Status::ALL.into_iter().filter(|status| has_words(&status_words(*status), words)) {
        ui.horizontal_top(|ui| {
            let (place, _) = ui.allocate_exact_size(egui::vec2(12.0, 16.0), egui::Sense::hover());
            let colour = theme::on_panel(ui.ctx(), status);
            status::paint_sign_in(ui.painter(), (place.center(), 4.0), status, colour);
            ui.label(RichText::new(status::label(status)).color(colour).strong());
            ui.add(egui::Label::new(status::meaning(status)).wrap());
        });
    }
}

fn is_asked((term, meaning): &(&str, &str), words: &[String]) -> bool {
    has_words(&format!("{term} {meaning}"), words)
}

fn has_term(words: &[String]) -> bool {
    WORDS.iter().any(|term| is_asked(term, words))
}

/// Words of the field with what they mean.
fn terms(ui: &mut Ui, words: &[String]) {
    if has_term(words) {
        ui.add_space(8.0);
        ui.label(RichText::new("Words").strong());
    }
    for (term, meaning) in WORDS.iter().filter(|term| is_asked(term, words)) {
        ui.horizontal_top(|ui| {
            let left = ui.cursor().left();
            ui.label(RichText::new(*term).strong());
            ui.add_space((left + KEYS - ui.cursor().left()).max(0.0));
            ui.add(egui::Label::new(*meaning).wrap());
        });
    }
}
