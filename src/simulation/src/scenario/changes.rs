//! Values of a scenario that are set otherwise from the command line, by dotted path: `--set coordination.algorithm=fifo`.

use std::fmt;
use std::str::FromStr;
use thiserror::Error;
use toml_edit::{ArrayOfTables, DocumentMut, Item, Table, TableLike, TomlError, Value};

/// A value of a scenario and where it belongs. It is parsed from `KEY=VALUE`: a dotted path, and a TOML value or a text.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioChange {
    /// Dotted path in the scenario; an entry of a list is chosen by its `name` or its number from 1, all of them by `*`.
    pub key: String,
    /// In the unit of the key.
    pub value: toml::Value,
}

/// Why a value cannot be set.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ChangeError {
    /// There is no value.
    #[error("\"{0}\" sets nothing; write KEY=VALUE, such as coordination.algorithm=fifo")]
    NoValue(String),
    /// The key is empty, or has an empty part.
    #[error("\"{0}\" is not a key of a scenario; write a dotted path, such as environment.loss")]
    Key(String),
    /// The key leads to a list without choosing an entry.
    #[error("{key}: {list} is a list; write {list}.1.{rest}")]
    WholeList {
        /// The dotted path.
        key: String,
        /// The part of it that is a list.
        list: String,
        /// The last part of it.
        rest: String,
    },
    /// The key chooses an entry that its list does not have.
    #[error("{key}: {list} has no entry \"{entry}\"; give a name, or a number from 1")]
    NoEntry {
        /// The dotted path.
        key: String,
        /// The part of it that is a list.
        list: String,
        /// Name or number of the missing entry.
        entry: String,
    },
    /// The key leads into a value that is neither a table nor a list.
    #[error("{key}: {value} is a value and has no key {rest}")]
    NoTable {
        /// The dotted path.
        key: String,
        /// The part of it that is a value.
        value: String,
        /// The last part of it.
        rest: String,
    },
    /// The scenario is no TOML.
    #[error("this is not TOML: {0}")]
    Syntax(String),
}

impl FromStr for ScenarioChange {
    type Err = ChangeError;

    fn from_str(text: &str) -> Result<Self, ChangeError> {
        let (key, value) = text.split_once('=').ok_or_else(|| ChangeError::NoValue(text.to_owned()))?;
        let key = key.trim();
        if key.split('.').any(str::is_empty) {
            return Err(ChangeError::Key(key.to_owned()));
        }
        Ok(Self { key: key.to_owned(), value: literal(value.trim()) })
    }
}

impl fmt::Display for ScenarioChange {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}={}", self.key, self.value)
    }
}

/// Parses a TOML value, or takes the text as a string.
pub(crate) fn literal(text: &str) -> toml::Value {
    let table: Option<toml::Table> = format!("x = {text}").parse().ok();
    let value = table.filter(|table| table.len() == 1).and_then(|mut table| table.remove("x"));
    value.unwrap_or_else(|| toml::Value::String(text.to_owned()))
}

/// The text of a scenario with these values; all else stays as it was written, so that places in it stay the same.
///
/// # Errors
/// When a key does not lead to a value, or the text is no TOML.
pub fn with_changes(text: &str, changes: &[ScenarioChange]) -> Result<String, ChangeError> {
    let mut document: DocumentMut =
        text.parse().map_err(|error: TomlError| ChangeError::Syntax(error.to_string()))?;
    for change in changes {
        set(&mut document, change)?;
    }
    Ok(document.to_string())
}

/// Sets a value at its dotted path. Missing tables are created.
fn set(document: &mut DocumentMut, change: &ScenarioChange) -> Result<(), ChangeError> {
    let path: Vec<&str> = change.key.split('.').collect();
    Setting { key: &change.key, value: &change.value }.set_in(document.as_table_mut(), &path)
}

/// A value on its way down a path.
#[derive(Clone, Copy)]
struct Setting<'c> {
    /// The whole path.
    key: &'c str,
    value: &'c toml::Value,
}

impl Setting<'_> {
    /// Sets the value at a path below a table.
    fn set_in(self, table: &mut dyn TableLike, path: &[&str]) -> Result<(), ChangeError> {
        let (at, below) = match path {
            [] => return Ok(()),
            [last] => {
                self.replace(table, last);
                return Ok(());
            }
            [at, below @ ..] => (*at, below),
        };
        let entry = table.entry(at).or_insert_with(|| Item::Table(Table::new()));
        match entry {
            Item::ArrayOfTables(list) => self.set_in_tables(list, at, below),
            Item::Value(Value::Array(list)) => {
                let mut entries: Vec<&mut dyn TableLike> = Vec::new();
                for value in list.iter_mut() {
                    entries.extend(value.as_inline_table_mut().map(|table| table as &mut dyn TableLike));
                }
                self.set_in_entries(entries, at, below)
            }
            entry => match entry.as_table_like_mut() {
                Some(table) => self.set_in(table, below),
                None => Err(ChangeError::NoTable {
                    key: self.key.to_owned(),
                    value: at.to_owned(),
                    rest: last_of(path),
                }),
            },
        }
    }

    fn set_in_tables(self, list: &mut ArrayOfTables, at: &str, below: &[&str]) -> Result<(), ChangeError> {
        let entries = list.iter_mut().map(|table| table as &mut dyn TableLike).collect();
        self.set_in_entries(entries, at, below)
    }

    /// Sets the value in the entries of a list that the first part of the path chooses.
    fn set_in_entries(
        self,
        mut entries: Vec<&mut dyn TableLike>,
        list: &str,
        path: &[&str],
    ) -> Result<(), ChangeError> {
        let (key, list) = (self.key.to_owned(), list.to_owned());
        let ([which, below @ ..], false) = (path, path.len() < 2) else {
            return Err(ChangeError::WholeList { key, list, rest: last_of(path) });
        };
        if *which == "*" {
            return entries.into_iter().try_for_each(|entry| self.set_in(entry, below));
        }
        let is_called = |entry: &&mut dyn TableLike| entry.get("name").and_then(Item::as_str) == Some(which);
        let number = || which.parse::<usize>().ok()?.checked_sub(1);
        let index = entries.iter().position(is_called).or_else(number);
        match index.and_then(|index| entries.get_mut(index)) {
            Some(entry) => self.set_in(*entry, below),
            None => Err(ChangeError::NoEntry { key, list, entry: (*which).to_owned() }),
        }
    }

    /// Puts the value in the place of the one before, with the comment beside it.
    fn replace(self, table: &mut dyn TableLike, name: &str) {
        let mut value = edited(self.value);
        match table.get_mut(name) {
            Some(Item::Value(before)) => {
                *value.decor_mut() = before.decor().clone();
                *before = value;
            }
            _ => {
                table.insert(name, Item::Value(value));
            }
        }
    }
}

fn last_of(path: &[&str]) -> String {
    path.last().map(|part| (*part).to_owned()).unwrap_or_default()
}

/// The value for a document that keeps its layout.
fn edited(value: &toml::Value) -> Value {
    // What one writer of TOML has written the other one reads; a text is always right.
    value.to_string().parse().unwrap_or_else(|_| Value::from(value.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(text: &str, change: &str) -> Result<String, String> {
        let change: ScenarioChange = change.parse().map_err(|error: ChangeError| error.to_string())?;
        with_changes(text, &[change]).map_err(|error| error.to_string())
    }

    #[test]
    fn only_the_value_changes() {
        let text = "# mine\nseed   = 1  # as always\n\n[[vehicle]] # first\nname = \"a\"\nat_m=1.5\n";
        assert_eq!(changed(text, "seed=7").unwrap(), text.replace("= 1 ", "= 7 "));
        assert_eq!(changed(text, "vehicle.a.at_m = 0.25").unwrap(), text.replace("1.5", "0.25"));
    }

    #[test]
    fn keys_lead_into_tables_and_lists() {
        let tables = "[[vehicle]]\nname = \"a\"\n[[vehicle]]\nname = \"b\"\n";
        let inline = "vehicle = [{ name = \"a\" }, { name = \"b\" }]\n";
        for text in [tables, inline] {
            let with = |key: &str| {
                changed(text, &format!("{key}=5")).map(|text| text.parse::<toml::Table>().unwrap())
            };
            let five = toml::Value::Integer(5);
            assert_eq!(with("vehicle.b.at_m").unwrap()["vehicle"][1]["at_m"], five);
            assert_eq!(with("vehicle.1.at_m").unwrap()["vehicle"][0]["at_m"], five);
            let all = with("vehicle.*.at_m").unwrap();
            assert!(all["vehicle"].as_array().unwrap().iter().all(|of| of["at_m"] == five));
            assert_eq!(with("environment.loss").unwrap()["environment"]["loss"], five);
            let said = with("vehicle.c.at_m").unwrap_err();
            assert_eq!(said, "vehicle.c.at_m: vehicle has no entry \"c\"; give a name, or a number from 1");
            let said = with("vehicle.at_m").unwrap_err();
            assert_eq!(said, "vehicle.at_m: vehicle is a list; write vehicle.1.at_m");
            let said = with("vehicle.b.name.x").unwrap_err();
            assert_eq!(said, "vehicle.b.name.x: name is a value and has no key x");
        }
    }

    #[test]
    fn values_are_toml_or_texts() {
        let value = |text: &str| text.parse::<ScenarioChange>().unwrap().value;
        assert_eq!(value("a=1"), toml::Value::Integer(1));
        assert_eq!(value("a = testbed"), toml::Value::String("testbed".to_owned()));
        assert_eq!(value("a=[1, 2]").as_array().map(Vec::len), Some(2));
        assert_eq!(value("a=1\nb=2"), toml::Value::String("1\nb=2".to_owned()));
        for wrong in ["a", "=1", "a.=1", ""] {
            assert!(wrong.parse::<ScenarioChange>().is_err(), "{wrong}");
        }
        assert!(changed("a = [", "b=1").unwrap_err().starts_with("this is not TOML"));
    }
}
