//! The start page: cards of the shipped scenarios, recent files and recorded runs.

use super::super::commands::OPEN;
use super::super::{ScenarioChoice, UiAction, UiState, ViewModel};
use super::{FilePurpose, OpenFields, OpenRequest, RunEntry, file_panel, pictures, short_path};
use egui::{
    Align2, Color32, FontId, Id, Key, Modal, Modifiers, Rect, Response, RichText, Role, ScrollArea, Sense,
    StrokeKind, TextStyle, Ui, Vec2, WidgetInfo,
};
use std::path::PathBuf;

/// State of the start page.
#[derive(Clone, Debug, Default)]
pub struct StartPage {
    /// It is shown.
    pub is_open: bool,
    /// What replaces values of the scenario that is opened.
    pub fields: OpenFields,
    /// The first card takes the keyboard, once.
    has_opened: bool,
}

impl StartPage {
    /// Shows the page.
    pub fn open(&mut self) {
        (self.is_open, self.has_opened) = (true, true);
    }
}

/// Width of the lists at the left, points.
const LISTS: f32 = 300.0;
/// Height of a card's text, and space between cards.
const TEXT: f32 = 67.0;
const GAP: f32 = 10.0;
/// Rows of recent files.
const MOST_RECENT: usize = 6;

/// Shows the page while it is open.
pub(super) fn show(ui: &Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let page = &mut state.runs.start_page;
    if !page.is_open {
        return;
    }
    let room = ui.ctx().content_rect().size() - egui::vec2(60.0, 60.0);
    let mut chosen: Option<PathBuf> = None;
    let (mut browses, mut is_closed) = (false, false);
    let modal = Modal::new(Id::unique("start page")).show(ui.ctx(), |ui| {
        // Tips of the page would cover a dialog over it.
        if state.runs.files.is_some() {
            ui.disable();
        }
        ui.set_width(room.x.min(1180.0));
        ui.set_height(room.y.min(620.0));
        ui.horizontal_top(|ui| {
            ui.vertical(|ui| {
                ui.set_width(LISTS);
                ui.heading("City3D");
                ui.add_space(6.0);
                ui.horizontal(|ui| {
                    browses = ui
                        .button("Open file ...")
                        .on_hover_text(OPEN.tip(ui.ctx(), "A scenario, a map or a log"))
                        .clicked();
                    is_closed = ui.button("Close").on_hover_text("Back to the city (Esc)").clicked();
                });
                ui.add_space(10.0);
                ScrollArea::vertical().id_salt("lists").auto_shrink(false).show(ui, |ui| {
                    chosen = lists(ui, shown);
                });
            });
            ui.separator();
            ui.vertical(|ui| {
                page.fields.show(ui);
                ui.add_space(6.0);
                let takes_focus = std::mem::take(&mut page.has_opened);
                ScrollArea::vertical().id_salt("cards").auto_shrink(false).show(ui, |ui| {
                    let card = cards(ui, shown.scenarios, takes_focus);
                    chosen = chosen.take().or(card);
                });
            });
        });
    });
    browses |=
        state.runs.files.is_none() && ui.input_mut(|input| input.consume_key(Modifiers::COMMAND, Key::O));
    is_closed |= modal.should_close();
    if let (Some(what), Ok(overrides)) = (chosen, page.fields.overrides()) {
        let request = OpenRequest { what, overrides, hours: page.fields.hours, starts: false };
        actions.push(UiAction::Open(request));
        is_closed = true;
    }
    if is_closed {
        page.is_open = false;
    }
    if browses {
        state.runs.browse(FilePurpose::Open);
    }
    if state.runs.files.is_some() {
        // The press on the page's button brings the page to the front, in some frames after the panel.
        ui.ctx().move_to_top(file_panel::layer());
    }
}

/// Recent files and recorded runs; returns the one that was clicked.
fn lists(ui: &mut Ui, shown: &ViewModel<'_>) -> Option<PathBuf> {
    let mut clicked = None;
    let lists = shown.runs.lists;
    ui.label(RichText::new("Recent files").strong());
    if lists.recent.is_empty() {
        ui.label(RichText::new("None yet").weak());
    }
    for path in lists.recent.iter().take(MOST_RECENT) {
        if row(ui, &short_path(path)).on_hover_text(path.display().to_string()).clicked() {
            clicked = Some(path.clone());
        }
    }
    ui.add_space(10.0);
    ui.label(RichText::new("Recorded runs").strong());
    if lists.runs.is_empty() {
        ui.label(RichText::new("None yet: every run of this window is recorded").weak());
    }
    for RunEntry { folder, name, outcome, began, age, .. } in &lists.runs {
        let began = if began.is_empty() { age } else { began };
        let run = ui.add(egui::Button::selectable(false, name).truncate().shortcut_text(began));
        let told = [name, outcome, age].into_iter().filter(|line| !line.is_empty());
        let told: Vec<&str> = told.map(String::as_str).collect();
        if run.on_hover_text(format!("{}\n{}", told.join("\n"), folder.display())).clicked() {
            clicked = Some(folder.clone());
        }
    }
    clicked
}

fn row(ui: &mut Ui, text: &str) -> Response {
    ui.add(egui::Button::selectable(false, text).truncate())
}

/// Shows the cards side by side; returns the scenario of the one that was clicked.
fn cards(ui: &mut Ui, scenarios: &[ScenarioChoice], takes_focus: bool) -> Option<PathBuf> {
    let mut clicked = None;
    let columns = (((ui.available_width() + GAP) / (pictures::SIZE.x + GAP)) as usize).max(1);
    for (row, scenarios) in scenarios.chunks(columns).enumerate() {
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = GAP;
            for (column, scenario) in scenarios.iter().enumerate() {
                let card = card(ui, scenario);
                if takes_focus && (row, column) == (0, 0) {
                    card.request_focus();
                }
                if card.clicked() {
                    clicked = Some(PathBuf::from(&scenario.name));
                }
            }
        });
        ui.add_space(GAP);
    }
    clicked
}

/// Picture, name and description of a scenario.
fn card(ui: &mut Ui, scenario: &ScenarioChoice) -> Response {
    let (rect, response) = ui.allocate_exact_size(pictures::SIZE + egui::vec2(0.0, TEXT), Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &scenario.name));
    if response.has_focus() {
        response.scroll_to_me(None);
    }
    // Who has come to it by the keyboard sees its edge: the ground of a pressed button would be no ground for its texts.
    let visuals = match response.has_focus() {
        true => ui.visuals().widgets.inactive,
        false => *ui.style().interact(&response),
    };
    let painter = ui.painter_at(rect.expand(2.0));
    painter.rect_filled(rect, 4.0, visuals.weak_bg_fill);
    let place = Rect::from_min_size(rect.min, pictures::SIZE);
    match pictures::picture(ui.ctx(), &scenario.name) {
        Some(picture) => {
            let whole = Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
            painter.image(picture.id(), place, whole, Color32::WHITE);
        }
        None => {
            let font = FontId::proportional(18.0);
            painter.rect_filled(place, 4.0, ui.visuals().extreme_bg_color);
            painter.text(place.center(), Align2::CENTER_CENTER, "scenario", font, ui.visuals().text_color());
        }
    }
    let name = std::path::Path::new(&scenario.name).file_stem().unwrap_or_default().to_string_lossy();
    let (body, small) = (TextStyle::Body.resolve(ui.style()), TextStyle::Small.resolve(ui.style()));
    let at = place.left_bottom() + Vec2::new(6.0, 3.0);
    let title = painter.text(at, Align2::LEFT_TOP, name, body, ui.visuals().strong_text_color());
    let mut job = egui::text::LayoutJob::simple(
        scenario.description.clone(),
        small,
        ui.visuals().text_color(),
        rect.width() - 12.0,
    );
    // Whoever points at the card, or has come to it by the keyboard, reads all of it, over its picture.
    let is_whole = response.hovered() || response.has_focus();
    job.wrap.max_rows = if is_whole { usize::MAX } else { 3 };
    let about = painter.layout_job(job);
    let below_title = title.left_bottom() + Vec2::new(0.0, 1.0);
    let top = below_title.y.min(rect.bottom() - about.size().y - 3.0);
    if top < below_title.y {
        let ground = Rect::from_min_max(egui::pos2(rect.left(), top - 3.0), rect.max);
        painter.rect_filled(ground, 4.0, visuals.bg_fill);
    }
    painter.galley(egui::pos2(below_title.x, top), about, ui.visuals().text_color());
    let edge = if response.has_focus() { ui.visuals().selection.stroke } else { visuals.bg_stroke };
    painter.rect_stroke(rect, 4.0, edge, StrokeKind::Inside);
    if response.has_focus() || response.hovered() {
        painter.rect_stroke(rect, 4.0, (2.0, ui.visuals().selection.bg_fill), StrokeKind::Outside);
    }
    response.on_hover_text(&scenario.description)
}
