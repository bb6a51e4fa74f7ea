//! Editing of the scenario in place of its run, which waits.

use super::{ViewedRun, ViewerState, WindowRequest};
use crate::ui::commands::EDITING;
use crate::ui::runs::{FilePurpose, LeaveQuestion, OpenRequest, Problem};
use crate::ui::{EditAction, EditTool, UiAction};
use crate::window::editor::{ScenarioEditor, keep_unsaved};
use crate::window::opening::Opening;
use crate::window::settings::runs_folder;
use city3d_session::{Order, RunPhase, RunState};
use city3d_simulation::scenario::Overrides;
use std::path::Path;
use std::sync::Arc;

impl ViewerState {
    /// Carries out an action of the editor.
    pub(super) fn edit(&mut self, action: EditAction, now_s: f64) -> Option<WindowRequest> {
        if action == EditAction::Begin {
            self.begin_editing(now_s);
            return None;
        }
        let editor = self.editor.as_mut()?;
        match action {
            EditAction::Begin => {}
            EditAction::Add { lane, at_m } => {
                let added = editor.add(lane, at_m);
                (self.state.selection.vehicle, self.state.table.reveal) = (Some(added), true);
            }
            EditAction::AddObstacle { lane, at_m } => {
                let added = editor.add_obstacle(lane, at_m);
                (self.state.selection.vehicle, self.state.table.reveal) = (Some(added), true);
            }
            EditAction::Move { vehicle, lane, at_m } => editor.move_to(vehicle, lane, at_m),
            EditAction::Change(vehicle, change) => editor.change(vehicle, change),
            EditAction::Describe(description) => editor.describe(&description),
            EditAction::Remove(vehicle) => {
                editor.remove(vehicle);
                self.state.selection.vehicle = None;
                self.state.editing.rest();
            }
            EditAction::Undo => {
                let undone = editor.undo().map(|change| format!("Undone: {change}"));
                undone.into_iter().for_each(|said| self.state.say(said, now_s));
            }
            EditAction::Redo => {
                let done = editor.redo().map(|change| format!("Done again: {change}"));
                done.into_iter().for_each(|said| self.state.say(said, now_s));
            }
            EditAction::Save => match editor.file().map(Path::to_path_buf) {
                Some(file) => _ = self.save(&file, now_s),
                None => self.state.runs.browse(FilePurpose::SaveScenario { runs: false }),
            },
            EditAction::SaveAs(file) => _ = self.save(&file, now_s),
            EditAction::Run => return self.run_edited(now_s),
            EditAction::End => self.end_editing(),
        }
        None
    }

    fn begin_editing(&mut self, now_s: f64) {
        let request = &self.request;
        self.editor = self.editor.take().filter(|editor| editor.is_of(request));
        if self.editor.is_none() {
            match ScenarioEditor::begin(&self.request, Arc::clone(&self.recording.on_update)) {
                Ok(editor) => self.editor = Some(editor),
                Err(error) => {
                    self.state.runs.problem =
                        Some(Problem::of_file("This cannot be edited", error.to_string()));
                    return;
                }
            }
        }
        self.give_back(now_s);
        let phase = self.run_state().phase.clone();
        if phase == RunPhase::Running {
            self.send(Order::Pause);
        }
        self.past.go_live();
        self.edits = true;
        self.state.open.editor = true;
        let said = match phase {
            RunPhase::Over => "Editing: the finished run is kept. Save and run what is edited",
            RunPhase::Ready => "Editing. Save and run what is edited",
            _ => "Editing: the run is paused, and kept. Save and run what is edited",
        };
        self.state.say(self.state.keys.tip(said, EDITING.run), now_s);
    }

    fn end_editing(&mut self) {
        self.edits = false;
        self.state.open.editor = false;
        self.state.editing.rest();
    }

    fn save(&mut self, file: &Path, now_s: f64) -> bool {
        let Some(editor) = &mut self.editor else { return false };
        match editor.save(file) {
            Ok(()) => {
                self.state.say(format!("Saved as {}", file.display()), now_s);
                self.remember_file(&file.to_string_lossy());
                true
            }
            Err(error) => {
                self.state.runs.problem = Some(Problem::of_file("This cannot be saved", error.to_string()));
                false
            }
        }
    }

    /// Asks before an action that would leave changes of the scenario without saving them; returns whether it does. Who closes
    /// the window once more while it asks has answered.
    pub fn asks_before(&mut self, action: &UiAction) -> bool {
        let leaves = matches!(
            action,
            UiAction::Scenario(_)
                | UiAction::Open(_)
                | UiAction::Replay
                | UiAction::RunAgain(_)
                | UiAction::Quit
        );
        let Some(editor) = self.editor.as_ref().filter(|editor| leaves && editor.is_changed()) else {
            return false;
        };
        if self.state.runs.leaving.as_ref().is_some_and(|question| question.then == *action) {
            return false;
        }
        let name = editor.view().name.to_owned();
        let has_file = editor.file().is_some();
        self.state.runs.leaving = Some(LeaveQuestion { then: action.clone(), name, has_file, is_new: true });
        true
    }

    /// Saves what is edited in its file; returns whether it is saved.
    pub(super) fn save_edited(&mut self, now_s: f64) -> bool {
        let file = self.editor.as_ref().and_then(ScenarioEditor::file).map(Path::to_path_buf);
        file.is_some_and(|file| self.save(&file, now_s))
    }

    /// Saves what is edited, and runs it.
    fn run_edited(&mut self, now_s: f64) -> Option<WindowRequest> {
        let editor = self.editor.as_ref()?;
        let Some(file) = editor.file().map(Path::to_path_buf) else {
            self.state.runs.browse(FilePurpose::SaveScenario { runs: true });
            return None;
        };
        if editor.is_changed() && !self.save(&file, now_s) {
            return None;
        }
        // What is run is what the file says, whatever the run before was given.
        let overrides = Overrides::default();
        match Opening::of(&OpenRequest { what: file, overrides, hours: None, starts: true }) {
            Ok(opening) => Some(WindowRequest::Open(self.in_this_light(opening))),
            Err(why) => {
                self.state.runs.problem = Some(Problem::of_file("This cannot be run", why));
                None
            }
        }
    }

    /// Another scenario or log is shown: what was edited and not saved is kept in a file; returns the message about it.
    pub(super) fn leave_editor(&mut self) -> Option<String> {
        self.edits = false;
        // Who runs what they have saved can still undo it afterwards.
        let editor = self.editor.take_if(|editor| editor.is_changed())?;
        let folder = runs_folder()?.parent()?.join("unsaved");
        Some(match keep_unsaved(&editor, &folder) {
            Ok(path) => format!("Changes that were not saved are kept in {}", path.display()),
            Err(error) => format!("Changes that were not saved are lost: {}: {error}", folder.display()),
        })
    }

    /// The state that is shown while the scenario is edited: its vehicles at their starts, waiting.
    pub(super) fn edited_state(&mut self, live: &Arc<RunState>) -> Option<Arc<RunState>> {
        let is_shown = self.edits && matches!(self.source, ViewedRun::Run(_) | ViewedRun::Ended(_));
        let editor = self.editor.as_mut().filter(|_| is_shown)?;
        editor.poll();
        let start = &editor.city()?.start;
        let (before, now) = (Arc::clone(start), Arc::clone(start));
        let edited = RunState {
            before,
            now,
            phase: RunPhase::Ready,
            clock: None,
            coordination: None,
            insight: None,
            goal: None,
            ..RunState::clone(live)
        };
        Some(super::before_start(Arc::new(edited)))
    }

    /// Tools follow what the user has closed.
    pub(super) fn follow_editor_panel(&mut self) {
        if self.edits && !self.state.open.editor {
            self.end_editing();
        }
        if !self.edits && self.state.editing.tool != EditTool::Select {
            self.state.editing.rest();
        }
    }
}
