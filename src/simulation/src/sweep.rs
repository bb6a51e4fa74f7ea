//! Parameter grid of a sweep: axes over values of a scenario, seeds, and the runs of their combinations.

use crate::scenario::{ChangeError, MOST_SEED, ScenarioChange, literal, with_changes};
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
    /// The key of an axis is none, or does not lead to a value.
    #[error(transparent)]
    Change(#[from] ChangeError),
}

impl FromStr for Axis {
    type Err = GridError;

    fn from_str(text: &str) -> Result<Self, GridError> {
        Self::of(&text.parse()?)
    }
}

impl Axis {
    /// The axis that a change names: its value has the values of the axis if it is a text.
    ///
    /// # Errors
    /// [`GridError::Number`], [`GridError::Range`] or [`GridError::TooManyValues`] for a range.
    pub fn of(change: &ScenarioChange) -> Result<Self, GridError> {
        let values = match &change.value {
            Value::String(text) => match text.split(':').collect::<Vec<_>>()[..] {
                [from, to, step] => steps(from, to, step)?,
                _ => text.split(',').map(|value| literal(value.trim())).collect(),
            },
            value => vec![value.clone()],
        };
        Ok(Self { key: change.key.clone(), values })
    }

    /// The axis of a key with values as they are written in tables of sweeps.
    pub fn of_words<'w>(key: &str, words: impl IntoIterator<Item = &'w str>) -> Self {
        Self { key: key.to_owned(), values: words.into_iter().map(literal).collect() }
    }
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
    pub settings: Vec<ScenarioChange>,
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
    let mut settings: Vec<Vec<ScenarioChange>> = vec![Vec::new()];
    for axis in axes {
        let with = |before: &Vec<ScenarioChange>, value: &Value| {
            let change = ScenarioChange { key: axis.key.clone(), value: value.clone() };
            before.iter().cloned().chain([change]).collect::<Vec<_>>()
        };
        settings = settings
            .iter()
            .flat_map(|before| axis.values.iter().map(move |value| with(before, value)))
            .collect();
    }
    let job = |settings: Vec<ScenarioChange>| {
        seeds.iter().map(move |&seed| Job { settings: settings.clone(), seed }).collect::<Vec<_>>()
    };
    Ok(settings.into_iter().flat_map(job).collect())
}

impl Job {
    /// The text of the scenario with its settings.
    ///
    /// # Errors
    /// When a key does not lead to a value.
    pub fn scenario(&self, text: &str) -> Result<String, ChangeError> {
        with_changes(text, &self.settings)
    }
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
            .map(|job| format!("{}{}{}", job.settings[0].value, job.settings[1].value, job.seed.unwrap()))
            .collect();
        assert_eq!(told, ["138", "139", "148", "149", "238", "239", "248", "249"]);
        assert_eq!(jobs(&[], None).unwrap().len(), 1);
    }
}
