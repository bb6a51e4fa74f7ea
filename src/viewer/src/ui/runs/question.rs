//! What stands before everything else: the question before a reset, and what could not be opened.

use super::super::{UiAction, theme};
use super::{FilePurpose, RunPanels};
use egui::{Id, Modal, RichText, ScrollArea, Ui};

/// A run that is about to be reset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResetQuestion {
    /// Where its log stays. The time that it has come to is that of each frame, for it goes on meanwhile.
    pub text: String,
    /// It has just come up: its button takes the keyboard.
    pub is_new: bool,
}

/// Something that ends the editor while changes are not saved.
#[derive(Clone, Debug, PartialEq)]
pub struct LeaveQuestion {
    /// What ends it.
    pub then: UiAction,
    /// Name of the scenario.
    pub name: String,
    /// It has a file to be saved in.
    pub has_file: bool,
    /// It has just come up: its button takes the keyboard.
    pub is_new: bool,
}

/// Something that could not be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// What could not be done.
    pub title: String,
    /// Why, and what to do.
    pub text: String,
    /// Another file may be opened instead.
    pub is_of_file: bool,
    /// It has just come up: its button takes the keyboard.
    pub is_new: bool,
}

impl Problem {
    /// A file that could not be opened, and why.
    pub fn of_file(title: impl Into<String>, text: impl Into<String>) -> Self {
        Self { title: title.into(), text: text.into(), is_of_file: true, is_new: true }
    }

    /// Something that cannot be done with runs, and why.
    pub fn of_run(title: impl Into<String>, text: impl Into<String>) -> Self {
        Self { is_of_file: false, ..Self::of_file(title, text) }
    }
}

/// Width of a question, points.
const WIDTH: f32 = 420.0;

/// Asks before a run is reset.
pub(super) fn reset(ui: &Ui, panels: &mut RunPanels, present_s: f64, actions: &mut Vec<UiAction>) {
    let Some(question) = &mut panels.question else { return };
    let mut is_done = false;
    let modal = Modal::new(Id::unique("reset")).show(ui.ctx(), |ui| {
        ui.set_width(WIDTH.min(ui.ctx().content_rect().width() - 40.0));
        ui.heading("Reset the run?");
        ui.add_space(4.0);
        let at = theme::decimal(ui.ctx()).fixed(present_s, 1);
        ui.label(format!("It is at {at} s. {}", question.text));
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let reset = ui.button("Reset");
            if std::mem::take(&mut question.is_new) {
                reset.request_focus();
            }
            if reset.clicked() {
                actions.push(UiAction::ResetConfirmed);
                is_done = true;
            }
            is_done |= ui.button("Cancel").on_hover_text("The run stays as it is (Esc)").clicked();
        });
    });
    if is_done || modal.should_close() {
        panels.question = None;
    }
}

/// Asks before changes of a scenario are left without being saved.
pub(super) fn leave(ui: &Ui, panels: &mut RunPanels, actions: &mut Vec<UiAction>) {
    let Some(question) = &mut panels.leaving else { return };
    let (mut is_done, mut saves_as) = (false, false);
    let modal = Modal::new(Id::unique("leave")).show(ui.ctx(), |ui| {
        ui.set_width(WIDTH.min(ui.ctx().content_rect().width() - 40.0));
        ui.heading(format!("Save the changes of {}?", question.name));
        ui.add_space(4.0);
        ui.label("The scenario was changed, and is not saved.");
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let save = ui.button(if question.has_file { "Save" } else { "Save as ..." });
            if std::mem::take(&mut question.is_new) {
                save.request_focus();
            }
            let leaves = ui.button("Leave without saving");
            let leaves = leaves.on_hover_text("What was changed is kept in a file beside the recorded runs");
            let leave = |saves| UiAction::Leave { then: Box::new(question.then.clone()), saves };
            if save.clicked() && question.has_file {
                actions.push(leave(true));
            } else if leaves.clicked() {
                actions.push(leave(false));
            }
            saves_as = save.clicked() && !question.has_file;
            let stays = ui.button("Cancel").on_hover_text("Go on editing (Esc)").clicked();
            is_done |= stays || save.clicked() || leaves.clicked();
        });
    });
    if is_done || modal.should_close() {
        panels.leaving = None;
    }
    if saves_as {
        panels.browse(FilePurpose::SaveScenario { runs: false });
    }
}

/// Says what could not be done.
pub(super) fn problem(ui: &Ui, panels: &mut RunPanels) {
    let Some(problem) = &mut panels.problem else { return };
    let (mut is_done, mut opens_another) = (false, false);
    let room = ui.ctx().content_rect().size();
    let modal = Modal::new(Id::unique("problem")).show(ui.ctx(), |ui| {
        ui.set_width(620.0_f32.min(room.x - 40.0));
        ui.heading(&problem.title);
        ui.add_space(4.0);
        ScrollArea::vertical().max_height((room.y - 220.0).max(60.0)).show(ui, |ui| {
            ui.label(RichText::new(&problem.text));
        });
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let close = ui.button("Close");
            if std::mem::take(&mut problem.is_new) {
                close.request_focus();
            }
            is_done |= close.clicked();
            if ui.button("Copy").on_hover_text("Copies the text").clicked() {
                ui.ctx().copy_text(problem.text.clone());
            }
            opens_another = problem.is_of_file && ui.button("Open another ...").clicked();
        });
    });
    if is_done || opens_another || modal.should_close() {
        panels.problem = None;
    }
    if opens_another {
        panels.browse(FilePurpose::Open);
    }
}
