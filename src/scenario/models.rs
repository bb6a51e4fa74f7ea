//! Models of the user's: cars that vehicles name as their shape, buildings that the map places.

use super::Library;
use super::read_vehicles::BODIES;
use crate::city::PlacedModel;
use crate::model::{Model, glb, is_stand_in, street};
use crate::snapshot::BodyType;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The models that an experiment brings along; all others are the program's own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Models {
    /// Of body types: those of the user's, and shipped ones for which a file lies beside the scenario.
    pub vehicles: BTreeMap<BodyType, Arc<Model>>,
    /// Those that the map places, by the name that it gives, and street furniture for which a file lies
    /// beside the scenario.
    pub placed: BTreeMap<String, Arc<Model>>,
    /// The files that do not come with the program, by the name by which they were asked for, as they were
    /// read: what a log keeps.
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

    /// The body type of a vehicle's own model.
    pub(super) fn own(&self, name: &str) -> Result<BodyType, String> {
        let mut own = self.own.borrow_mut();
        let index = match own.iter().position(|(known, _)| known == name) {
            Some(index) => index,
            None => {
                let model = self.load(name)?;
                if model.node("wheel").is_none() && model.bounds(|node| !is_stand_in(node)).is_none() {
                    return Err(format!(
                        "{name}: no mesh but of distant views; name the body's node \"body\""
                    ));
                }
                own.push((name.to_owned(), model));
                own.len() - 1
            }
        };
        u16::try_from(index).map(BodyType::Own).map_err(|_| "more models than 65536".to_owned())
    }

    /// All models that the vehicles named, the map's, and shipped ones that a file replaces; and what is
    /// wrong with those that cannot be used.
    pub(super) fn finish(self, placed: &[PlacedModel]) -> (Models, Vec<String>) {
        let (mut models, mut problems) = (Models::default(), Vec::new());
        for (name, body) in BODIES {
            let file = format!("{name}.glb");
            if self.library.has_own_model(&file) {
                match self.load(&file) {
                    Ok(model) => drop(models.vehicles.insert(body, model)),
                    Err(problem) => problems.push(problem),
                }
            }
        }
        for file in street::FURNITURE.into_iter().filter(|file| self.library.has_own_model(file)) {
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
