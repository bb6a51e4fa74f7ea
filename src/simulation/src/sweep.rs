//! Parameter grid of a sweep: axes over values of a scenario, seeds, and the runs of their combinations.

use crate::scenario::MOST_SEED;
use std::str::FromStr;
use thiserror::Error;
use toml::Value;

/// A parameter of the scenario with its values. It is parsed from `KEY=VALUES`: a dotted path, and values separated by
/// commas or a range `FROM:TO:STEP` with both ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Dotted path in the scenario.
    pub key: String,
    /// Values in the order of the runs, in the unit of the key.
    pub values: Vec<Value>,
}

/// Limit of values on one axis and of runs: more are a typing error.
const MAX_RUNS: usize = 1_000_000;

/// Why there is no such grid.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum GridError {
    /// An axis has no values.
    #[error("write KEY=VALUES, such as environment.loss=0,0.1")]
    NoValues,
    /// The key of an axis is empty, or has an empty part.
    #[error("\"{0}\" is not a key of a scenario; write a dotted path, such as environment.loss")]
    Key(String),
    /// A bound or the step of a range is no finite number.
    #[error("\"{0}\" is not a number; write FROM:TO:STEP, such as 0:0.3:0.05")]
    Number(String),
    /// A range has no values.
    #[error("FROM:TO:STEP needs a positive STEP, and TO must not be less than FROM")]
    Range,
    /// An axis has more values than the limit.
    #[error("more than {MAX_RUNS} values")]
    TooManyValues,
    /// A seed is not a whole number from 0 to the largest of a scenario.
    #[error("\"{0}\" is not a seed; write 1..20 or 1,4,9, each from 0 to {MOST_SEED}")]
    Seed(String),
    /// A range of seeds ends before it begins.
    #[error("the last seed comes before the first")]
    SeedOrder,
    /// There are more seeds than the limit.
    #[error("more than {MAX_RUNS} seeds")]
    TooManySeeds,
    /// There are more combinations than the limit.
    #[error("more than {MAX_RUNS} runs")]
    TooManyRuns,
    /// A key leads to a list without choosing an entry.
    #[error("{key}: {list} is a list; write {list}.1.{rest}")]
    WholeList {
        /// The dotted path.
        key: String,
        /// The part of it that is a list.
        list: String,
        /// The last part of it.
        rest: String,
    },
    /// A key chooses an entry that its list does not have.
    #[error("{key}: {list} has no entry \"{entry}\"; give a name, or a number from 1")]
    NoEntry {
        /// The dotted path.
        key: String,
        /// The part of it that is a list.
        list: String,
        /// Name or number of the missing entry.
        entry: String,
    },
    /// A key leads into a value that is neither a table nor a list.
    #[error("{key}: {value} is a value and has no key {rest}")]
    NoTable {
        /// The dotted path.
        key: String,
        /// The part of it that is a value.
        value: String,
        /// The last part of it.
        rest: String,
    },
    /// The changed scenario cannot be written as TOML.
    #[error(transparent)]
    Toml(#[from] toml::ser::Error),
}

impl FromStr for Axis {
    type Err = GridError;

    fn from_str(text: &str) -> Result<Self, GridError> {
        let (key, values) = text.split_once('=').ok_or(GridError::NoValues)?;
        let key = key.trim();
        if key.is_empty() || key.split('.').any(str::is_empty) {
            return Err(GridError::Key(key.to_owned()));
        }
        let values = match values.split(':').collect::<Vec<_>>()[..] {
            [from, to, step] => steps(from, to, step)?,
            _ => values.split(',').map(|value| literal(value.trim())).collect(),
        };
        Ok(Self { key: key.to_owned(), values })
    }
}

/// Parses a TOML value, or takes the text as a string.
fn literal(text: &str) -> Value {
    let table: Option<toml::Table> = format!("x = {text}").parse().ok();
    table.and_then(|mut table| table.remove("x")).unwrap_or_else(|| Value::String(text.to_owned()))
}

/// Values of a range, with both ends if the steps meet them.
fn steps(from: &str, to: &str, step: &str) -> Result<Vec<Value>, GridError> {
    let number = |text: &str| {
        let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| GridError::Number(text.to_owned()))
    };
    let (from, to, step) = (number(from)?, number(to)?, number(step)?);
    if step <= 0.0 || to < from {
        return Err(GridError::Range);
    }
    let count = ((to - from) / step + 1e-6).floor();
    if count >= MAX_RUNS as f64 {
        return Err(GridError::TooManyValues);
    }
    // Rounding makes 0.1 + 0.2 equal 0.3.
    let value = |k: usize| ((from + k as f64 * step) * 1e9).round() / 1e9;
    Ok((0..=count as usize).map(|k| Value::Float(value(k))).collect())
}

/// Seeds in their order. They are parsed from a range `1..20` with both ends, or a list `1,4,9`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seeds(pub Vec<u64>);

impl FromStr for Seeds {
    type Err = GridError;

    fn from_str(text: &str) -> Result<Self, GridError> {
        let number = |text: &str| {
            let seed = text.trim().parse::<u64>().ok().filter(|seed| *seed <= MOST_SEED);
            seed.ok_or_else(|| GridError::Seed(text.to_owned()))
        };
        if let Some((first, last)) = text.split_once("..") {
            let (first, last) = (number(first)?, number(last)?);
            return match last.checked_sub(first) {
                Some(more) if more < MAX_RUNS as u64 => Ok(Self((first..=last).collect())),
                Some(_) => Err(GridError::TooManySeeds),
                None => Err(GridError::SeedOrder),
            };
        }
        text.split(',').map(number).collect::<Result<_, _>>().map(Self)
    }
}

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Keys with their values, in the order of the axes.
    pub settings: Vec<(String, Value)>,
    /// Its seed, where it is not the scenario's.
    pub seed: Option<u64>,
}

/// All combinations in a fixed order: seeds change fastest, then the last axis.
///
/// # Errors
/// [`GridError::TooManyRuns`].
pub fn jobs(axes: &[Axis], seeds: Option<&Seeds>) -> Result<Vec<Job>, GridError> {
    let seeds: Vec<Option<u64>> =
        seeds.map_or(vec![None], |seeds| seeds.0.iter().copied().map(Some).collect());
    let count = axes.iter().try_fold(seeds.len(), |count, axis| count.checked_mul(axis.values.len()));
    if count.is_none_or(|count| count > MAX_RUNS) {
        return Err(GridError::TooManyRuns);
    }
    let mut settings: Vec<Vec<(String, Value)>> = vec![Vec::new()];
    for axis in axes {
        let with = |before: &Vec<(String, Value)>, value: &Value| {
            before.iter().cloned().chain([(axis.key.clone(), value.clone())]).collect::<Vec<_>>()
        };
        settings = settings
            .iter()
            .flat_map(|before| axis.values.iter().map(move |value| with(before, value)))
            .collect();
    }
    let job = |settings: Vec<(String, Value)>| {
        seeds.iter().map(move |&seed| Job { settings: settings.clone(), seed }).collect::<Vec<_>>()
    };
    Ok(settings.into_iter().flat_map(job).collect())
}

impl Job {
    /// The scenario with its settings.
    ///
    /// # Errors
    /// When a key does not lead to a value.
    pub fn scenario(&self, document: &toml::Table) -> Result<String, GridError> {
        let mut changed = document.clone();
        for (key, value) in &self.settings {
            set(&mut changed, key, value)?;
        }
        Ok(toml::to_string(&changed)?)
    }
}

/// Sets a value at a dotted path. Missing tables are created; an entry of a list is chosen by its `name` or its number
/// from 1, all of them by `*`.
fn set(document: &mut toml::Table, key: &str, value: &Value) -> Result<(), GridError> {
    set_at(document, &key.split('.').collect::<Vec<_>>(), key, value)
}

/// Sets a value at a path below a table; `key` is the whole path.
fn set_at(table: &mut toml::Table, path: &[&str], key: &str, value: &Value) -> Result<(), GridError> {
    let (at, below) = match path {
        [] => return Ok(()),
        [last] => {
            table.insert((*last).to_owned(), value.clone());
            return Ok(());
        }
        [at, below @ ..] => ((*at).to_owned(), below),
    };
    let (whole, rest) = (key.to_owned(), path[path.len() - 1].to_owned());
    let entry = table.entry(at.clone()).or_insert_with(|| Value::Table(toml::Table::new()));
    match (entry, below) {
        (Value::Table(table), _) => set_at(table, below, key, value),
        (Value::Array(list), ["*", below @ ..]) if !below.is_empty() => {
            list.iter_mut().filter_map(Value::as_table_mut).try_for_each(|of| set_at(of, below, key, value))
        }
        (Value::Array(list), [which, below @ ..]) if !below.is_empty() => {
            let missing = || GridError::NoEntry { key: whole, list: at, entry: (*which).to_owned() };
            set_at(entry_of(list, which).ok_or_else(missing)?, below, key, value)
        }
        (Value::Array(_), _) => Err(GridError::WholeList { key: whole, list: at, rest }),
        _ => Err(GridError::NoTable { key: whole, value: at, rest }),
    }
}

fn entry_of<'l>(list: &'l mut [Value], which: &str) -> Option<&'l mut toml::Table> {
    let is_called = |value: &Value| value.get("name").and_then(Value::as_str) == Some(which);
    let number = || which.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
    let index = list.iter().position(is_called).or_else(number)?;
    list.get_mut(index)?.as_table_mut()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(text: &str) -> Axis {
        text.parse().unwrap()
    }

    #[test]
    fn steps_meet_their_end_and_have_no_crumbs() {
        let values = axis("environment.command_delay_s=0:0.3:0.05").values;
        let expected = [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3].map(Value::Float);
        assert_eq!(values, expected);
        assert_eq!(axis("a.b=1:2:0.4").values.len(), 3);
        assert_eq!(
            axis("a=1, 0.5,true,testbed").values,
            [Value::Integer(1), Value::Float(0.5), Value::Boolean(true), Value::String("testbed".to_owned())]
        );
        for wrong in ["a", "=1", "a.=1", "a=1:0:1", "a=0:1:0", "a=0:x:1", "a=0:1:1e-9"] {
            assert!(wrong.parse::<Axis>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn seeds_are_ranges_or_lists() {
        assert_eq!("3..5".parse(), Ok(Seeds(vec![3, 4, 5])));
        assert_eq!("7, 2".parse(), Ok(Seeds(vec![7, 2])));
        for wrong in ["5..3", "a", "1..x", "-1", "1..99999999999", ""] {
            assert!(wrong.parse::<Seeds>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn runs_are_all_combinations_in_a_stated_order() {
        let axes = [axis("a=1,2"), axis("b=3,4")];
        let all = jobs(&axes, Some(&Seeds(vec![8, 9]))).unwrap();
        let told: Vec<String> = all
            .iter()
            .map(|job| format!("{}{}{}", job.settings[0].1, job.settings[1].1, job.seed.unwrap()))
            .collect();
        assert_eq!(told, ["138", "139", "148", "149", "238", "239", "248", "249"]);
        assert_eq!(jobs(&[], None).unwrap().len(), 1);
    }

    #[test]
    fn keys_lead_into_tables_and_lists() {
        let document: toml::Table = "[[vehicle]]\nname = \"a\"\n[[vehicle]]\nname = \"b\"\n".parse().unwrap();
        let with = |key: &str| {
            let job = Job { settings: vec![(key.to_owned(), Value::Integer(5))], seed: None };
            job.scenario(&document).map(|text| text.parse::<toml::Table>().unwrap())
        };
        assert_eq!(with("vehicle.b.at_m").unwrap()["vehicle"][1]["at_m"], Value::Integer(5));
        assert_eq!(with("vehicle.1.at_m").unwrap()["vehicle"][0]["at_m"], Value::Integer(5));
        let all = with("vehicle.*.at_m").unwrap();
        assert!(all["vehicle"].as_array().unwrap().iter().all(|of| of["at_m"] == Value::Integer(5)));
        assert_eq!(with("environment.loss").unwrap()["environment"]["loss"], Value::Integer(5));
        assert!(with("vehicle.c.at_m").unwrap_err().to_string().contains("\"c\""));
        assert!(with("vehicle.at_m").is_err() && with("vehicle.b.name.x").is_err());
    }
}
