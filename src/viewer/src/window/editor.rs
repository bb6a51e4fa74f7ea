//! The scenario that is edited: its text with all changes, the checks of it, and the city as it starts.

use super::scenario_info::ScenarioInfo;
use super::unused::unused;
use crate::ui::EditView;
use city3d_control::{CONTROLLERS, PARKED};
use city3d_outputs::WholeFile;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_simulation::scenario::{
    ChangeError, EditError, Library, MovedStart, Overrides, ScenarioDocument, ScenarioError, ScenarioRequest,
    SourceError, StatedVehicle, VehicleEdit, read_experiment, with_changes,
};
use city3d_simulation::sim::World;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use thiserror::Error;

/// Why a scenario cannot be edited or saved.
#[derive(Debug, Error)]
pub enum EditorError {
    /// Its file cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// Its text cannot be edited.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// A value of it cannot be set.
    #[error(transparent)]
    Change(#[from] ChangeError),
    /// The file cannot be written.
    #[error("{}: {reason}", path.display())]
    Unwritable {
        /// Where it was to be written.
        path: PathBuf,
        /// Reason of the operating system.
        reason: std::io::Error,
    },
}

/// A city as the edited scenario starts it.
pub struct EditedCity {
    /// What the panels show of it.
    pub info: ScenarioInfo,
    /// All vehicles at their starts.
    pub start: Arc<FrameSnapshot>,
    /// Starts that were moved, in words.
    warnings: Vec<String>,
    /// Neither it nor an inflow has a vehicle: a run would be refused.
    lacks_vehicles: bool,
}

/// What an edited scenario without vehicles lacks.
const NO_VEHICLES: &str = "no vehicles: add one before it is run";

/// Begins the description of a scenario that was saved as another one.
const MADE_FROM: &str = "Made from ";

/// A version of the text, and the change that led to it, in words; the first one has none.
struct Version {
    text: String,
    change: String,
}

type Outcome = Result<EditedCity, Vec<String>>;

/// A scenario under editing.
pub struct ScenarioEditor {
    name: String,
    file: Option<PathBuf>,
    library: Library,
    overrides: Overrides,
    /// Every version of the text, and which one is edited: changes behind it can be made again.
    versions: Vec<Version>,
    at: usize,
    saved: String,
    document: ScenarioDocument,
    vehicles: Vec<StatedVehicle>,
    types: Vec<String>,
    drivers: Vec<String>,
    /// The text that is being checked, and its result to come.
    check: Option<(String, Receiver<Outcome>)>,
    checked: String,
    problems: Vec<String>,
    /// The last version that could be read.
    city: Option<EditedCity>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl ScenarioEditor {
    /// Begins with a scenario as it is; `wake` is called on another thread when a check is done.
    ///
    /// # Errors
    /// Where its text cannot be read or edited.
    pub fn begin(request: &ScenarioRequest, wake: Arc<dyn Fn() + Send + Sync>) -> Result<Self, EditorError> {
        let (text, library) = Library::scenario(&request.scenario)?;
        let path = PathBuf::from(&request.scenario);
        // What was set otherwise is shown, and not in the file until it is saved.
        let shown = with_changes(&text, &request.changes)?;
        let document = ScenarioDocument::parse(&shown)?;
        let mut editor = Self {
            name: request.scenario.clone(),
            file: path.is_file().then_some(path),
            library,
            overrides: Overrides { allows_no_vehicles: true, ..request.overrides },
            versions: vec![Version { text: shown, change: String::new() }],
            at: 0,
            saved: text,
            vehicles: document.vehicles(),
            types: document.types(),
            drivers: drivers_of(&document),
            document,
            check: None,
            checked: String::new(),
            problems: Vec::new(),
            city: None,
            wake,
        };
        editor.poll();
        Ok(editor)
    }

    /// Whether it edits what a request shows, and nobody else has changed the file since it was saved.
    pub fn is_of(&self, request: &ScenarioRequest) -> bool {
        let is_same_file = self.file.as_deref() == Some(Path::new(&request.scenario));
        let in_file = || self.file.as_deref().and_then(|file| std::fs::read_to_string(file).ok());
        self.is_changed()
            || is_same_file && request.changes.is_empty() && in_file().as_deref() == Some(&self.saved)
    }

    /// The edited text.
    pub fn text(&self) -> &str {
        &self.versions[self.at].text
    }

    /// Whether the text differs from the file.
    pub fn is_changed(&self) -> bool {
        self.text() != self.saved
    }

    /// Where it is saved.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// The city of the last version that could be read.
    pub fn city(&self) -> Option<&EditedCity> {
        self.city.as_ref()
    }

    /// What the panels show.
    pub fn view(&self) -> EditView<'_> {
        EditView {
            vehicles: &self.vehicles,
            types: &self.types,
            drivers: &self.drivers,
            default_driver: self.document.default_controller(),
            problems: &self.problems,
            warnings: self.city.as_ref().map_or(&[], |city| &city.warnings),
            is_checking: self.checked != self.text(),
            is_changed: self.is_changed(),
            undoes: self.change_to(self.at),
            redoes: self.change_to(self.at + 1),
            file: self.file(),
            name: &self.name,
            description: self.document.description(),
        }
    }

    /// The change that led to a version; `None` of the first one and where there is none.
    fn change_to(&self, at: usize) -> Option<&str> {
        self.versions.get(at).filter(|_| at > 0).map(|version| version.change.as_str())
    }

    /// Adds a vehicle on a lane, with a name that is free; returns its id.
    pub fn add(&mut self, lane: String, at_m: f64) -> VehicleId {
        self.put("vehicle", StatedVehicle { route: vec![lane], at_m, ..StatedVehicle::default() })
    }

    /// Adds a vehicle that is parked on a lane; returns its id.
    pub fn add_obstacle(&mut self, lane: String, at_m: f64) -> VehicleId {
        self.document.state_driver(PARKED, PARKED);
        let driver = Some(PARKED.to_owned());
        self.put("obstacle", StatedVehicle { driver, route: vec![lane], at_m, ..StatedVehicle::default() })
    }

    fn put(&mut self, kind: &str, vehicle: StatedVehicle) -> VehicleId {
        let is_taken = |name: &String| self.vehicles.iter().any(|vehicle| vehicle.name == *name);
        let mut names = (self.vehicles.len() + 1..).map(|k| format!("{kind}{k}"));
        let name = names.find(|name| !is_taken(name)).unwrap_or_default();
        let change = format!("add {name}");
        let index = self.document.add_vehicle(&StatedVehicle { name, ..vehicle });
        self.keep(change);
        self.vehicles.get(index).map_or_else(VehicleId::default, |vehicle| vehicle.id)
    }

    /// Starts a vehicle elsewhere; the rest of its route stays.
    pub fn move_to(&mut self, id: VehicleId, lane: String, at_m: f64) {
        let Some(index) = self.index(id) else { return };
        let mut route = self.vehicles[index].route.clone();
        match route.first_mut() {
            Some(first) => *first = lane,
            None => route.push(lane),
        }
        // Two of the same in succession mean a lap, which nobody asked for.
        if route.len() > 1 && route[0] == route[1] {
            route.remove(1);
        }
        self.document.edit_vehicle(index, VehicleEdit::Route(route));
        self.document.edit_vehicle(index, VehicleEdit::At(at_m));
        self.keep(format!("move {}", self.vehicles[index].name));
    }

    /// Changes what is stated of a vehicle.
    pub fn change(&mut self, id: VehicleId, edit: VehicleEdit) {
        let Some(index) = self.index(id) else { return };
        if let VehicleEdit::Driver(Some(name)) = &edit
            && CONTROLLERS.contains(&name.as_str())
        {
            self.document.state_driver(name, name);
        }
        let what = what_of(&edit);
        self.document.edit_vehicle(index, edit);
        self.keep(format!("change the {what} of {}", self.vehicles[index].name));
    }

    /// Changes the description of the scenario.
    pub fn describe(&mut self, description: &str) {
        self.document.set_description(description);
        self.keep("change the description".to_owned());
    }

    /// Removes a vehicle.
    pub fn remove(&mut self, id: VehicleId) {
        let Some(index) = self.index(id) else { return };
        let change = format!("remove {}", self.vehicles[index].name);
        self.document.remove_vehicle(index);
        self.keep(change);
    }

    /// Takes the last change back; returns it in words.
    pub fn undo(&mut self) -> Option<String> {
        let change = self.change_to(self.at)?.to_owned();
        self.go_to(self.at - 1);
        Some(change)
    }

    /// Makes the last change again; returns it in words.
    pub fn redo(&mut self) -> Option<String> {
        let change = self.change_to(self.at + 1)?.to_owned();
        self.go_to(self.at + 1);
        Some(change)
    }

    /// Writes the text to a file, which is the edited one from now on. It is written beside and renamed.
    ///
    /// # Errors
    /// Where the file cannot be written; the one that was there stays.
    pub fn save(&mut self, path: &Path) -> Result<(), EditorError> {
        let unwritable = |reason| EditorError::Unwritable { path: path.to_path_buf(), reason };
        // Two files with runs of one name could not be told apart.
        let before = self.at;
        if self.file.as_deref() != Some(path)
            && let Some(name) = path.file_stem()
        {
            let description = self.description_elsewhere();
            self.document.set_name(&name.to_string_lossy());
            self.document.set_description(&description);
            self.keep(format!("name it {}", name.to_string_lossy()));
        }
        if let Err(reason) = WholeFile::write(path, self.text().as_bytes()) {
            self.versions.truncate(before + 1);
            self.go_to(before);
            return Err(unwritable(reason));
        }
        self.saved = self.text().to_owned();
        self.name = path.display().to_string();
        self.file = Some(path.to_path_buf());
        self.library = Library::beside(path);
        // Maps and models are looked for beside the new file, whatever a check that goes on finds beside the old one.
        self.check = None;
        self.checked.clear();
        self.poll();
        Ok(())
    }

    /// The description in another file. Where it is still that of the file that was opened, the new card says from what it
    /// was made: the two are told apart.
    fn description_elsewhere(&self) -> String {
        let present = self.document.description();
        let opened = ScenarioDocument::parse(&self.saved);
        let is_own = opened.is_ok_and(|opened| opened.description() != present);
        if is_own || present.is_empty() {
            return present.to_owned();
        }
        let from = Path::new(&self.name).file_stem().unwrap_or_default().to_string_lossy();
        // Of several copies the last one is told.
        let first = present.strip_prefix(MADE_FROM).and_then(|rest| Some(rest.split_once(": ")?.1));
        format!("{MADE_FROM}{from}: {}", first.unwrap_or(present))
    }

    /// Takes the result of a check, and begins the next one where the text has changed meanwhile.
    pub fn poll(&mut self) {
        if let Some((text, result)) = &self.check {
            let outcome = match result.try_recv() {
                Err(TryRecvError::Empty) => return,
                Ok(outcome) => outcome,
                // The check has panicked: a defect of ours, which must not take the text away.
                Err(TryRecvError::Disconnected) => {
                    Err(vec!["the scenario could not be checked: save it, and report this".to_owned()])
                }
            };
            self.checked.clone_from(text);
            self.check = None;
            self.problems = match outcome {
                Ok(city) => {
                    // It is shown, and a run of it would be refused.
                    let is_empty = city.lacks_vehicles;
                    self.city = Some(city);
                    if is_empty { vec![NO_VEHICLES.to_owned()] } else { Vec::new() }
                }
                Err(problems) => problems,
            };
        }
        if self.checked != self.text() {
            self.begin_check();
        }
    }

    /// Checks the text on another thread.
    fn begin_check(&mut self) {
        let (sender, receiver) = channel();
        let text = self.text().to_owned();
        self.check = Some((text.clone(), receiver));
        let (name, library, overrides) = (self.name.clone(), self.library.clone(), self.overrides);
        let wake = Arc::clone(&self.wake);
        let check = move || {
            // Whoever waited may have gone.
            let _ = sender.send(check(&name, &text, &library, overrides));
            wake();
        };
        // Without a thread nothing is ever sent, which is told as a check that failed.
        let _ = std::thread::Builder::new().name("scenario check".to_owned()).spawn(check);
    }

    fn index(&self, id: VehicleId) -> Option<usize> {
        self.vehicles.iter().position(|vehicle| vehicle.id == id)
    }

    /// Keeps the changed document as the next version; `change` says what was done.
    fn keep(&mut self, change: String) {
        let text = self.document.to_string();
        if text != self.text() {
            self.versions.truncate(self.at + 1);
            self.versions.push(Version { text, change });
            self.at += 1;
        }
        self.refresh();
    }

    fn go_to(&mut self, version: usize) {
        self.at = version;
        // Every version has been a document before.
        if let Ok(document) = ScenarioDocument::parse(self.text()) {
            self.document = document;
        }
        self.refresh();
    }

    fn refresh(&mut self) {
        self.vehicles = self.document.vehicles();
        self.types = self.document.types();
        self.drivers = drivers_of(&self.document);
        self.poll();
    }
}

/// What a change is about, in words.
fn what_of(edit: &VehicleEdit) -> &'static str {
    match edit {
        VehicleEdit::Name(_) => "name",
        VehicleEdit::Type(_) => "type",
        VehicleEdit::Model(_) => "dynamics model",
        VehicleEdit::Shape(_) => "body",
        VehicleEdit::Driver(_) => "driver",
        VehicleEdit::Route(_) => "route",
        VehicleEdit::At(_) => "start",
        VehicleEdit::Speed(_) => "initial speed",
        VehicleEdit::Leaves(_) => "end",
        VehicleEdit::Cameras(_) => "cameras",
    }
}

/// Names of drivers to choose from: those of the file, and every control algorithm by its own name.
fn drivers_of(document: &ScenarioDocument) -> Vec<String> {
    let mut names = document.drivers();
    let more = CONTROLLERS.iter().filter(|name| !names.iter().any(|known| known == *name));
    let more: Vec<String> = more.map(|name| (*name).to_owned()).collect();
    names.extend(more);
    names
}

/// Reads a scenario, and puts its vehicles at their starts.
fn check(name: &str, text: &str, library: &Library, overrides: Overrides) -> Outcome {
    let experiment = read_experiment(name, text, library, overrides).map_err(|error| match error {
        ScenarioError::Scenario { problems, .. } => {
            problems.into_iter().map(|problem| problem.message).collect()
        }
        other => vec![other.to_string()],
    })?;
    let experiment = Arc::new(experiment);
    let start = Arc::new(World::new(Arc::clone(&experiment)).snapshot());
    let info = ScenarioInfo::of(&experiment);
    let named = |id: VehicleId| info.names.get(&id).cloned().unwrap_or_else(|| id.to_string());
    let moved = |moved: &MovedStart| {
        let (vehicle, behind, by_m) = (named(moved.vehicle), named(moved.behind), moved.by_m);
        format!("{vehicle} starts {by_m:.1} m farther back than stated: {behind} is there")
    };
    let warnings = experiment.moved.iter().map(moved).collect();
    let lacks_vehicles = experiment.vehicles.is_empty() && experiment.inflows.is_empty();
    Ok(EditedCity { info, start, warnings, lacks_vehicles })
}

/// Keeps the text of changes that were not saved; returns where.
pub fn keep_unsaved(editor: &ScenarioEditor, folder: &Path) -> std::io::Result<PathBuf> {
    std::fs::create_dir_all(folder)?;
    let stem = Path::new(&editor.name).file_stem().unwrap_or_default().to_string_lossy();
    let path = unused(folder, &stem, ".toml");
    WholeFile::write(&path, editor.text().as_bytes())?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    fn editor(scenario: &str) -> ScenarioEditor {
        let request = ScenarioRequest { scenario: scenario.to_owned(), ..ScenarioRequest::default() };
        ScenarioEditor::begin(&request, Arc::new(|| {})).unwrap()
    }

    /// Waits until the latest text is checked.
    fn settle(editor: &mut ScenarioEditor) {
        let start = Instant::now();
        while editor.view().is_checking {
            assert!(start.elapsed() < Duration::from_secs(60), "it is never checked");
            editor.poll();
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn there(editor: &ScenarioEditor) -> Vec<VehicleId> {
        editor.city().unwrap().start.vehicles.iter().map(|vehicle| vehicle.id).collect()
    }

    #[test]
    fn changes_are_checked_shown_undone_and_made_again() {
        let mut editor = editor("roundabout");
        settle(&mut editor);
        assert_eq!((there(&editor).len(), editor.is_changed()), (6, false));
        let added = editor.add("north-avenue/east/2".to_owned(), 1.5);
        assert_eq!((added, editor.is_changed()), (VehicleId(7), true));
        assert_eq!((editor.view().undoes, editor.view().redoes), (Some("add vehicle7"), None));
        settle(&mut editor);
        assert_eq!((there(&editor).len(), editor.view().problems), (7, &[] as &[String]));
        editor.change(added, VehicleEdit::Driver(Some("nobody".to_owned())));
        settle(&mut editor);
        let problem = &editor.view().problems[0];
        assert!(problem.contains("nobody") && !problem.contains("line "), "{problem}");
        // The city stays as it was read last.
        assert_eq!(there(&editor).len(), 7);
        assert_eq!(editor.undo().as_deref(), Some("change the driver of vehicle7"));
        assert_eq!(editor.undo().as_deref(), Some("add vehicle7"));
        assert_eq!(editor.undo(), None);
        settle(&mut editor);
        assert_eq!((there(&editor).len(), editor.view().undoes, editor.is_changed()), (6, None, false));
        assert_eq!(editor.redo().as_deref(), Some("add vehicle7"));
        assert_eq!(editor.view().redoes, Some("change the driver of vehicle7"));
        editor.move_to(added, "north-avenue/east/2".to_owned(), 2.0);
        assert!(editor.view().redoes.is_none(), "a change behind an undone one takes its place");
        settle(&mut editor);
        let stated = editor.view().vehicle(added).cloned().unwrap();
        assert_eq!((stated.name.as_str(), stated.at_m, stated.route.len()), ("vehicle7", 2.0, 1));
        editor.remove(VehicleId(1));
        settle(&mut editor);
        assert_eq!(there(&editor).len(), 6);
        let lane = "south-boulevard/east/outer/1".to_owned();
        let obstacle = editor.add_obstacle(lane, 3.0);
        settle(&mut editor);
        assert_eq!(editor.view().problems, &[] as &[String]);
        assert_eq!(editor.city().unwrap().info.drivers[&obstacle], PARKED);
    }

    #[test]
    fn a_scenario_without_vehicles_is_shown_and_cannot_be_run() {
        let mut editor = editor("straight");
        settle(&mut editor);
        while let Some(id) = editor.view().vehicles.first().map(|vehicle| vehicle.id) {
            editor.remove(id);
        }
        settle(&mut editor);
        assert_eq!(editor.view().problems, [NO_VEHICLES]);
        assert_eq!(there(&editor), []);
        editor.undo();
        settle(&mut editor);
        assert_eq!(editor.view().problems, &[] as &[String]);
    }

    #[test]
    fn a_start_where_another_vehicle_is_moves_with_a_warning() {
        let mut editor = editor("roundabout");
        let lane = || "north-avenue/east/2".to_owned();
        editor.add(lane(), 1.5);
        settle(&mut editor);
        assert_eq!(editor.view().warnings, &[] as &[String]);
        editor.add(lane(), 1.51);
        settle(&mut editor);
        let view = editor.view();
        assert_eq!((view.problems, view.warnings.len()), (&[] as &[String], 1));
        assert!(view.warnings[0].contains("farther back"), "{:?}", view.warnings);
    }

    #[test]
    fn every_control_algorithm_can_be_chosen_as_a_driver() {
        let mut editor = editor("straight");
        assert_eq!(editor.view().default_driver, "idm");
        let id = editor.view().vehicles[0].id;
        for name in CONTROLLERS {
            assert!(editor.view().drivers.iter().any(|driver| driver == name), "{name}");
            editor.change(id, VehicleEdit::Driver(Some(name.to_owned())));
            settle(&mut editor);
            assert_eq!(editor.view().problems, &[] as &[String], "{name}");
            assert_eq!(editor.city().unwrap().info.drivers[&id], name);
        }
    }

    #[test]
    fn a_scenario_that_is_saved_as_another_one_has_another_description() {
        let folder = tempfile::tempdir().unwrap();
        let said = |editor: &ScenarioEditor| editor.view().description.to_owned();
        let mut copied = editor("straight");
        let first = said(&copied);
        assert!(!first.is_empty());
        copied.save(&folder.path().join("crash.toml")).unwrap();
        assert_eq!(said(&copied), format!("Made from straight: {first}"));
        copied.save(&folder.path().join("crash.toml")).unwrap();
        assert_eq!(said(&copied), format!("Made from straight: {first}"), "it is the same file");
        copied.save(&folder.path().join("again.toml")).unwrap();
        assert_eq!(said(&copied), format!("Made from crash: {first}"));
        let mut own = editor("straight");
        own.describe("Two cars crash");
        own.save(&folder.path().join("own.toml")).unwrap();
        assert_eq!(said(&own), "Two cars crash");
        let text = std::fs::read_to_string(folder.path().join("own.toml")).unwrap();
        assert!(text.contains("name = \"own\"\ndescription = \"Two cars crash\"\n"), "{text}");
    }

    #[test]
    fn a_file_is_saved_whole_or_not_at_all_and_unsaved_changes_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let mut editor = editor("straight");
        assert_eq!(editor.file(), None);
        editor.add("north-avenue/east/2".to_owned(), 1.0);
        let file = folder.path().join("mine.toml");
        editor.save(&file).unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), editor.text());
        assert_eq!((editor.file(), editor.is_changed()), (Some(&*file), false));
        settle(&mut editor);
        assert_eq!(editor.view().problems, &[] as &[String]);
        let name = |editor: &ScenarioEditor| editor.text().parse::<toml::Table>().unwrap()["name"].clone();
        assert_eq!(
            name(&editor).as_str(),
            Some("mine"),
            "its runs are told apart from those of the other file"
        );
        let nowhere = folder.path().join("none/other.toml");
        let said = editor.save(&nowhere).unwrap_err().to_string();
        assert!(said.contains("none/other.toml") && editor.file() == Some(&*file), "{said}");
        assert_eq!((name(&editor).as_str(), editor.is_changed()), (Some("mine"), false));
        editor.remove(VehicleId(1));
        let kept = [(); 2].map(|()| keep_unsaved(&editor, &folder.path().join("unsaved")).unwrap());
        assert_ne!(kept[0], kept[1]);
        assert!(kept.iter().all(|path| std::fs::read_to_string(path).unwrap() == editor.text()));
        let others = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(others, 2, "no part of a file is left");
    }
}
