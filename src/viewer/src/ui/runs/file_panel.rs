//! The panel that opens files: a folder's list, a path with completion, and a filter by kind. Everything goes by keyboard.

use super::folder::{EntryKind, FileFilter, Folder, FolderEntry, READABLE, has_run, kind_of, matching};
use super::{OpenRequest, RunPanels, StartLists, UiAction};
use crate::ui::EditAction;
use egui::text::{CCursor, CCursorRange};
use egui::{
    Align, Context, Event, Id, Key, LayerId, Layout, Modal, Order, RichText, ScrollArea, TextEdit, Ui,
};
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

/// What the chosen file is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilePurpose {
    /// It is opened.
    Open,
    /// A recorded run that the present one is compared with.
    Compare,
    /// The edited scenario is written there, and run if wanted.
    SaveScenario {
        /// It is run.
        runs: bool,
    },
}

/// State of the panel.
#[derive(Clone, Debug)]
pub struct FilePanel {
    purpose: FilePurpose,
    folder: Folder,
    /// What is in the program, below what is in the folder; empty where nothing is opened from there.
    shipped: Vec<FolderEntry>,
    /// Nothing but that is listed.
    only_shipped: bool,
    /// The path as it is typed: a folder, and the beginning of a name.
    typed: String,
    filter: FileFilter,
    /// Index of the marked entry among those that are listed.
    marked: usize,
    /// The mark was set by a click: another one opens the entry.
    is_clicked: bool,
    scrolls_to_marked: bool,
    trouble: Option<String>,
    is_new: bool,
    /// The file of which the user was asked whether it shall be replaced.
    replaces: Option<PathBuf>,
}

/// Where a path from the root on begins behind another one.
const ROOT_AGAIN: &str = "//";

/// What the user wants with the marked entry, or with what was typed.
enum Chosen {
    GoInto(PathBuf),
    Open(PathBuf),
}

impl FilePanel {
    /// A panel on a folder.
    pub fn new(folder: &Path, purpose: FilePurpose) -> Self {
        let filter = match purpose {
            FilePurpose::Open => FileFilter::All,
            FilePurpose::SaveScenario { .. } => FileFilter::Scenarios,
            FilePurpose::Compare => FileFilter::Logs,
        };
        let mut panel = Self {
            purpose,
            folder: Folder::default(),
            shipped: if purpose == FilePurpose::Open { Folder::shipped() } else { Vec::new() },
            only_shipped: false,
            typed: String::new(),
            filter,
            marked: 0,
            is_clicked: false,
            scrolls_to_marked: false,
            trouble: None,
            is_new: true,
            replaces: None,
        };
        panel.go_into(folder);
        panel
    }

    fn go_into(&mut self, folder: &Path) {
        let from = std::mem::replace(&mut self.folder, Folder::read(folder));
        self.only_shipped = false;
        let path = self.folder.path.display().to_string();
        self.typed = if path.ends_with(MAIN_SEPARATOR) { path } else { format!("{path}{MAIN_SEPARATOR}") };
        self.trouble = self.folder.trouble.clone();
        // Whoever goes up finds the folder marked that was left.
        let left = self.listed().iter().position(|entry| entry.path == from.path);
        (self.marked, self.is_clicked, self.scrolls_to_marked) = (left.unwrap_or(0), false, true);
    }

    fn go_up(&mut self) {
        if let Some(parent) = self.folder.path.parent().map(Path::to_path_buf) {
            self.go_into(&parent);
        }
    }

    /// The beginning of a name that stands behind the folder in the field.
    fn typed_name(&self) -> &str {
        self.typed.rsplit_once(MAIN_SEPARATOR).map_or(self.typed.as_str(), |(_, name)| name)
    }

    fn listed(&self) -> Vec<&FolderEntry> {
        let typed = self.typed_name();
        let mut listed =
            if self.only_shipped { Vec::new() } else { self.folder.matching(self.filter, typed) };
        listed.extend(matching(&self.shipped, self.filter, typed));
        listed
    }

    /// Follows what is typed into another folder.
    fn follow_typed(&mut self) {
        // Whoever types a whole path behind the one that is there means the new one.
        if let Some(at) = self.typed.rfind(ROOT_AGAIN) {
            self.typed.drain(..=at);
        }
        if let Some(rest) = self.typed.strip_prefix("~/")
            && let Some(home) = std::env::home_dir()
        {
            self.typed = home.join(rest).display().to_string();
        }
        let folder =
            self.typed.rsplit_once(MAIN_SEPARATOR).map(|(folder, _)| format!("{folder}{MAIN_SEPARATOR}"));
        if let Some(folder) = folder.map(PathBuf::from).filter(|folder| folder.is_dir())
            && folder.components().ne(self.folder.path.components())
        {
            self.folder = Folder::read(&folder);
        }
        (self.marked, self.is_clicked, self.trouble) = (0, false, self.folder.trouble.clone());
    }

    /// Completes what is typed to the marked entry.
    fn complete(&mut self) {
        let Some(entry) = self.listed().get(self.marked).map(|entry| (entry.path.clone(), entry.kind)) else {
            return;
        };
        let end = if matches!(entry.1, EntryKind::Folder | EntryKind::Run) { "/" } else { "" };
        self.typed = format!("{}{end}", entry.0.display());
        self.follow_typed();
    }

    fn mark(&mut self, by: isize) {
        let last = self.listed().len().saturating_sub(1);
        self.marked = self.marked.saturating_add_signed(by).min(last);
        (self.is_clicked, self.scrolls_to_marked) = (false, true);
    }

    /// What is wrong with the folder that was typed; `None` where it can be gone into.
    fn missing_folder(&self) -> Option<String> {
        let (folder, _) = self.typed.rsplit_once(MAIN_SEPARATOR)?;
        let folder = Path::new(if folder.is_empty() { "/" } else { folder });
        if folder.is_dir() {
            return None;
        }
        // The longest part of the path that is there.
        let near = folder.ancestors().skip(1).find(|above| above.is_dir()).unwrap_or(Path::new("/"));
        Some(format!(
            "There is no folder {}. Correct the path, which is right up to {}, or choose a folder of the list.",
            folder.display(),
            near.display()
        ))
    }

    /// What Enter means now.
    fn choose(&mut self) -> Option<Chosen> {
        let typed = PathBuf::from(&self.typed);
        if let Some(missing) = self.missing_folder() {
            self.trouble = Some(missing);
            return None;
        }
        if self.saves() && !self.typed_name().is_empty() && !typed.is_dir() {
            return self.chosen_to_save(&typed);
        }
        if !self.typed_name().is_empty() && typed.exists() {
            return self.chosen(&typed);
        }
        if has_run(&typed) && self.listed().iter().all(|entry| entry.kind == EntryKind::Shipped) {
            return Some(Chosen::Open(typed));
        }
        if let Some(entry) = self.listed().get(self.marked).map(|&entry| entry.clone()) {
            return self.chosen_entry(&entry);
        }
        self.trouble = Some(match self.typed_name() {
            "" => format!("{} has nothing to open.", self.folder.path.display()),
            name => format!("{} has no \"{name}\"; choose one of the list.", self.folder.path.display()),
        });
        None
    }

    fn saves(&self) -> bool {
        matches!(self.purpose, FilePurpose::SaveScenario { .. })
    }

    /// The file that a name means; the ending of scenarios need not be typed.
    fn file_to_save(path: &Path) -> PathBuf {
        if path.extension().is_some() { path.to_path_buf() } else { path.with_extension("toml") }
    }

    /// What saving does with what is typed.
    fn saving_words(&self) -> String {
        let typed = Path::new(&self.typed);
        if self.typed_name().is_empty() || typed.is_dir() {
            return "Type a name: a new file is made in this folder. Or mark a scenario to replace it."
                .to_owned();
        }
        let path = Self::file_to_save(typed);
        match path.exists() {
            true => format!("Replaces {}", path.display()),
            false => format!("Makes a new file: {}", path.display()),
        }
    }

    /// A file to write; one that is there is replaced only when it is chosen twice.
    fn chosen_to_save(&mut self, path: &Path) -> Option<Chosen> {
        let path = Self::file_to_save(path);
        if kind_of(&path) != EntryKind::Scenario {
            self.trouble = Some("A scenario is saved as a .toml file.".to_owned());
            return None;
        }
        if path.exists() && self.replaces.as_ref() != Some(&path) {
            self.trouble =
                Some(format!("{} is there already. Press Save again to replace it.", path.display()));
            self.replaces = Some(path);
            return None;
        }
        Some(Chosen::Open(path))
    }

    fn chosen_entry(&mut self, entry: &FolderEntry) -> Option<Chosen> {
        match entry.kind {
            // By its name, whatever files have the same.
            EntryKind::Shipped => Some(Chosen::Open(entry.path.clone())),
            _ => self.chosen(&entry.path),
        }
    }

    fn chosen(&mut self, path: &Path) -> Option<Chosen> {
        if self.saves() && kind_of(path) == EntryKind::Scenario {
            return self.chosen_to_save(path);
        }
        match kind_of(path) {
            EntryKind::Folder => Some(Chosen::GoInto(path.to_path_buf())),
            EntryKind::Run | EntryKind::Scenario | EntryKind::Map | EntryKind::Log | EntryKind::Shipped => {
                Some(Chosen::Open(path.to_path_buf()))
            }
            EntryKind::Other => {
                let name = path.file_name().unwrap_or_default().display();
                self.trouble =
                    Some(format!("{name} is not a file that City3D reads: it reads a {READABLE}."));
                None
            }
        }
    }
}

/// The layer that it is drawn to.
pub(super) fn layer() -> LayerId {
    LayerId::new(Order::Foreground, Id::unique("files"))
}

/// Shows the panel while it is open.
pub(super) fn show(ui: &Ui, panels: &mut RunPanels, lists: &StartLists, actions: &mut Vec<UiAction>) {
    let Some(panel) = &mut panels.files else { return };
    let room = ui.ctx().content_rect().size();
    let mut chosen = None;
    let mut is_cancelled = false;
    if std::mem::take(&mut panel.is_new) {
        // The list has the keyboard, not what had it before.
        ui.memory_mut(|memory| memory.focused().into_iter().for_each(|id| memory.surrender_focus(id)));
    }
    let modal = Modal::new(layer().id).show(ui.ctx(), |ui| {
        ui.set_width(680.0_f32.min(room.x - 40.0));
        ui.heading(match panel.purpose {
            FilePurpose::Open => "Open a scenario, a map or a log",
            FilePurpose::Compare => "Compare with a recorded run",
            FilePurpose::SaveScenario { .. } => "Save the scenario as a file",
        });
        // Its own keys come before those of the field: the field would take them.
        chosen = keys(ui, panel);
        path(ui, panel);
        places(ui, panel, lists);
        ui.separator();
        let height = (room.y - 260.0).clamp(80.0, 340.0);
        let clicked =
            ScrollArea::vertical().max_height(height).min_scrolled_height(height).auto_shrink(false);
        let clicked = clicked.show(ui, |ui| list(ui, panel)).inner;
        chosen = chosen.take().or(clicked);
        ui.separator();
        match &panel.trouble {
            Some(trouble) => _ = ui.colored_label(ui.visuals().error_fg_color, trouble),
            None if panel.saves() => _ = ui.label(panel.saving_words()),
            None => {}
        }
        ui.horizontal(|ui| {
            let (verb, tip) = match panel.saves() {
                true => ("Save", "Under the name above (Enter)"),
                false => ("Open", "What is marked (Enter)"),
            };
            if ui.button(verb).on_hover_text(tip).clicked() {
                chosen = chosen.take().or_else(|| panel.choose());
            }
            is_cancelled = ui.button("Cancel").on_hover_text("Esc").clicked();
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let enter = verb.to_lowercase();
                ui.small(format!(
                    "up down mark   Enter {enter}   Backspace folder above   type a name, Tab completes it"
                ));
            });
        });
    });
    is_cancelled |= modal.should_close();
    panels.last_folder = Some(panel.folder.path.clone());
    match chosen {
        Some(Chosen::GoInto(folder)) => panel.go_into(&folder),
        Some(Chosen::Open(what)) => {
            match panel.purpose {
                FilePurpose::Open => {
                    // The fields are on the start page alone.
                    let fields =
                        Some(&panels.start_page).filter(|page| page.is_open).map(|page| &page.fields);
                    let overrides = fields.and_then(|fields| fields.overrides().ok()).unwrap_or_default();
                    let hours = fields.and_then(|fields| fields.hours);
                    actions.push(UiAction::Open(OpenRequest { what, overrides, hours, starts: false }));
                }
                FilePurpose::Compare => actions.push(UiAction::CompareWith(what)),
                FilePurpose::SaveScenario { runs } => {
                    actions.push(UiAction::Edit(EditAction::SaveAs(what)));
                    actions.extend(runs.then_some(UiAction::Edit(EditAction::Run)));
                }
            }
            panels.files = None;
            panels.start_page.is_open = false;
        }
        None if is_cancelled => panels.files = None,
        None => {}
    }
}

fn field_id() -> Id {
    Id::unique("path of the file panel")
}

/// Keys of the list, and those of the field that it leaves alone.
fn keys(ui: &Ui, panel: &mut FilePanel) -> Option<Chosen> {
    let focused = ui.memory(egui::Memory::focused);
    let (is_list, is_field) = (focused.is_none(), focused == Some(field_id()));
    if !is_list && !is_field {
        return None;
    }
    let events = ui.input(|input| input.events.clone());
    let mut chosen = None;
    for event in events {
        match event {
            Event::Key { key, pressed: true, modifiers, .. } if !modifiers.command && !modifiers.alt => {
                match key {
                    Key::ArrowDown => panel.mark(1),
                    Key::ArrowUp => panel.mark(-1),
                    Key::PageDown => panel.mark(10),
                    Key::PageUp => panel.mark(-10),
                    Key::Enter => chosen = chosen.take().or_else(|| panel.choose()),
                    Key::Backspace if is_list => panel.go_up(),
                    Key::Tab if is_field => {
                        panel.complete();
                        put_cursor_at_end(ui.ctx(), &panel.typed);
                    }
                    _ => {}
                }
            }
            // Whoever types means a name: the field, which comes below, takes the letter.
            Event::Text(_) if is_list => {
                ui.memory_mut(|memory| memory.request_focus(field_id()));
                put_cursor_at_end(ui.ctx(), &panel.typed);
            }
            _ => {}
        }
    }
    chosen
}

fn put_cursor_at_end(context: &Context, text: &str) {
    let mut state = TextEdit::load_state(context, field_id()).unwrap_or_default();
    let end = CCursor::new(text.chars().count());
    state.cursor.set_char_range(Some(CCursorRange::one(end)));
    TextEdit::store_state(context, field_id(), state);
}

fn path(ui: &mut Ui, panel: &mut FilePanel) {
    let field = TextEdit::singleline(&mut panel.typed)
        .id(field_id())
        .lock_focus(true)
        .desired_width(ui.available_width() - 8.0);
    if ui.add(field).on_hover_text("Folder and name; Tab completes the name").changed() {
        panel.follow_typed();
    }
}

/// The filter, and shortcuts to folders.
fn places(ui: &mut Ui, panel: &mut FilePanel, lists: &StartLists) {
    ui.horizontal_wrapped(|ui| {
        // A scenario is saved among scenarios.
        let filters = if panel.saves() { &[] } else { &FileFilter::ALL[..] };
        for (filter, name) in filters.iter().copied() {
            let choice = ui.selectable_label(panel.filter == filter, name).on_hover_text(filter.endings());
            if choice.clicked() {
                (panel.filter, panel.marked, panel.is_clicked) = (filter, 0, false);
            }
        }
        if !panel.saves() {
            ui.separator();
        }
        if ui.button("Folder above").on_hover_text("Backspace").clicked() {
            panel.go_up();
        }
        let places = [
            ("Home", std::env::home_dir()),
            ("Working folder", std::env::current_dir().ok()),
            ("Recorded runs", lists.runs_folder.clone()),
        ];
        for (name, folder) in places {
            let Some(folder) = folder.filter(|folder| folder.is_dir()) else { continue };
            if ui.button(name).on_hover_text(folder.display().to_string()).clicked() {
                panel.go_into(&folder);
            }
        }
        let tip = "The scenarios that come with the program, also listed below those of a folder";
        if !panel.shipped.is_empty() && ui.button("Shipped scenarios").on_hover_text(tip).clicked() {
            let folder = panel.folder.path.clone();
            panel.go_into(&folder);
            panel.only_shipped = true;
        }
    });
}

/// Shows the entries; returns what a click on one chooses. A click marks a file, a second one opens it.
fn list(ui: &mut Ui, panel: &mut FilePanel) -> Option<Chosen> {
    let listed: Vec<FolderEntry> = panel.listed().into_iter().cloned().collect();
    if listed.is_empty() && panel.trouble.is_none() {
        let text = match panel.saves() {
            true => "No scenario (.toml) here begins with this name.".to_owned(),
            false => format!("Nothing to open here: no {}.", panel.filter.endings()),
        };
        ui.label(RichText::new(text).weak());
    }
    let mut clicked = None;
    for (index, entry) in listed.iter().enumerate() {
        let FolderEntry { name, kind, .. } = entry;
        let is_marked = index == panel.marked;
        let row = ui.horizontal(|ui| {
            let row = ui.selectable_label(is_marked, name);
            ui.label(RichText::new(kind.label()).small().weak());
            row
        });
        let row = row.inner;
        if is_marked && panel.scrolls_to_marked {
            row.scroll_to_me(None);
        }
        if row.clicked() {
            let opens = *kind == EntryKind::Folder || (is_marked && panel.is_clicked);
            (panel.marked, panel.is_clicked) = (index, true);
            clicked = opens.then_some(entry);
        }
    }
    panel.scrolls_to_marked = false;
    clicked.and_then(|entry| panel.chosen_entry(entry))
}
