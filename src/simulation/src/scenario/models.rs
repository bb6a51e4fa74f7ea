//! User models: car bodies named by vehicles, and models placed by the map.

use super::Library;
use city3d_models::{FURNITURE, Model, glb, is_other_lod};
use city3d_protocol::snapshot::BodyType;
use city3d_roadmap::PlacedModel;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// User models of an experiment; all others are shipped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UserModels {
    /// By body type: user models, and shipped ones replaced by a file beside the scenario.
    pub vehicles: BTreeMap<BodyType, Arc<Model>>,
    /// By map name, and street furniture replaced by a file beside the scenario.
    pub placed: BTreeMap<String, Arc<Model>>,
    /// Files that are not shipped, by requested name, as read, for logs.
    pub files: BTreeMap<String, Arc<Vec<u8>>>,
}

/// Loads models while a scenario is read, each file once.
pub(super) struct ModelReader<'l> {
    library: &'l Library,
    own: RefCell<Vec<(String, Arc<Model>)>>,
    files: RefCell<BTreeMap<String, Arc<Vec<u8>>>>,
}

impl<'l> ModelReader<'l> {
    pub(super) fn new(library: &'l Library) -> Self {
        Self { library, own: RefCell::default(), files: RefCell::default() }
    }

    fn load(&self, name: &str) -> Result<Arc<Model>, String> {
        let bytes = self.library.model(name).map_err(|error| error.to_string())?;
        let model = glb::read(&bytes).map_err(|error| format!("{name}: {error}"))?;
        if self.library.has_own_model(name) {
            self.files.borrow_mut().insert(name.to_owned(), Arc::new(bytes));
        }
        Ok(Arc::new(model))
    }

    /// The body type of a user model.
    pub(super) fn own(&self, name: &str) -> Result<BodyType, String> {
        let mut own = self.own.borrow_mut();
        let index = match own.iter().position(|(known, _)| known == name) {
            Some(index) => index,
            None => {
                let model = self.load(name)?;
                if model.node("wheel").is_none() && model.bounds(|node| !is_other_lod(node)).is_none() {
                    return Err(format!(
                        "{name}: all its meshes are for a distance (far_, farther_); name the body's node \"body\""
                    ));
                }
                own.push((name.to_owned(), model));
                own.len() - 1
            }
        };
        u16::try_from(index).map(BodyType::Own).map_err(|_| "more models than 65536".to_owned())
    }

    /// All models of vehicles and map, and shipped ones that a file replaces; and the problems of unusable
    /// ones.
    pub(super) fn finish(self, placed: &[PlacedModel]) -> (UserModels, Vec<String>) {
        let (mut models, mut problems) = (UserModels::default(), Vec::new());
        for (name, body) in BodyType::SHIPPED {
            let file = format!("{name}.glb");
            if self.library.has_own_model(&file) {
                match self.load(&file) {
                    Ok(model) => drop(models.vehicles.insert(body, model)),
                    Err(problem) => problems.push(problem),
                }
            }
        }
        for file in FURNITURE.into_iter().filter(|file| self.library.has_own_model(file)) {
            match self.load(file) {
                Ok(model) => drop(models.placed.insert(file.to_owned(), model)),
                Err(problem) => problems.push(problem),
            }
        }
        for place in placed {
            if models.placed.contains_key(&place.file) {
                continue;
            }
            match self.load(&place.file) {
                Ok(model) => drop(models.placed.insert(place.file.clone(), model)),
                Err(problem) => {
                    let line = if place.line > 0 { format!("line {}: ", place.line) } else { String::new() };
                    problems.push(format!("{line}{problem}"));
                }
            }
        }
        models.files = self.files.into_inner();
        let own = self.own.into_inner().into_iter();
        models.vehicles.extend((0..).map(BodyType::Own).zip(own.map(|(_, model)| model)));
        (models, problems)
    }
}
