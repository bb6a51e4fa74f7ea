//! Parameter grid of a sweep: axes over values of a scenario, seeds, the runs of their combinations, and shards of them.

use crate::scenario::{ChangeError, MOST_SEED, ScenarioChange, literal, with_changes};
use std::fmt;
use std::ops::Range;
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
    /// A shard is not an index and a number.
    #[error("\"{0}\" is not a shard; write I/N, such as 0/16 for the first of 16")]
    Shard(String),
    /// The index of a shard is too large.
    #[error("shards count from 0: the last of {count} is {last}/{count}, and there is no {index}/{count}")]
    ShardIndex {
        /// Its index.
        index: usize,
        /// Number of shards.
        count: usize,
        /// The largest index.
        last: usize,
    },
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
pub struct Seeds(SeedList);

#[derive(Clone, Debug, PartialEq, Eq)]
enum SeedList {
    /// Seeds that follow one another: a million of them take no memory.
    Range { first: u64, count: usize },
    /// Others.
    Single(Vec<u64>),
}

impl Seeds {
    fn of(seeds: Vec<u64>) -> Self {
        let follow = seeds.windows(2).all(|pair| pair[0].checked_add(1) == Some(pair[1]));
        match seeds.first() {
            Some(&first) if follow => Self(SeedList::Range { first, count: seeds.len() }),
            _ => Self(SeedList::Single(seeds)),
        }
    }

    fn count(&self) -> usize {
        match &self.0 {
            SeedList::Range { count, .. } => *count,
            SeedList::Single(seeds) => seeds.len(),
        }
    }

    /// The seed of this index, less than their number.
    fn get(&self, index: usize) -> u64 {
        match &self.0 {
            SeedList::Range { first, .. } => first + index as u64,
            SeedList::Single(seeds) => seeds[index],
        }
    }
}

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
                Some(more) if more < MAX_RUNS as u64 => {
                    Ok(Self(SeedList::Range { first, count: more as usize + 1 }))
                }
                Some(_) => Err(GridError::TooManySeeds),
                None => Err(GridError::SeedOrder),
            };
        }
        text.split(',').map(number).collect::<Result<_, _>>().map(Self::of)
    }
}

impl fmt::Display for Seeds {
    /// As they are parsed: `1..20` where each is one more than the last, else `1,4,9`.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            SeedList::Range { first, count: 1 } => write!(out, "{first}"),
            SeedList::Range { first, count } => write!(out, "{first}..{}", first + (*count as u64 - 1)),
            SeedList::Single(seeds) => {
                let words: Vec<String> = seeds.iter().map(ToString::to_string).collect();
                out.write_str(&words.join(","))
            }
        }
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

/// All combinations of the values of axes and of seeds, in a fixed order: seeds change fastest, then the last axis. Its runs
/// are made one by one, so that a grid of a million takes no time and no memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// The parameters that vary, each with its values.
    pub axes: Vec<Axis>,
    /// The seeds; without any, all runs have the scenario's.
    pub seeds: Option<Seeds>,
    runs: usize,
}

impl Grid {
    /// The grid over these axes and seeds.
    ///
    /// # Errors
    /// [`GridError::TooManyRuns`].
    pub fn new(axes: Vec<Axis>, seeds: Option<Seeds>) -> Result<Self, GridError> {
        let seeds_of_each = seeds.as_ref().map_or(1, Seeds::count);
        let runs = axes.iter().try_fold(seeds_of_each, |count, axis| count.checked_mul(axis.values.len()));
        let runs = runs.filter(|&runs| runs <= MAX_RUNS).ok_or(GridError::TooManyRuns)?;
        Ok(Self { axes, seeds, runs })
    }

    /// Number of runs.
    pub fn runs(&self) -> usize {
        self.runs
    }

    /// The run of this index, less than [`runs`](Self::runs).
    pub fn job(&self, index: usize) -> Job {
        let each = self.seeds.as_ref().map_or(1, Seeds::count);
        let seed = self.seeds.as_ref().map(|seeds| seeds.get(index % each));
        let mut rest = index / each;
        let mut settings: Vec<ScenarioChange> = Vec::with_capacity(self.axes.len());
        for axis in self.axes.iter().rev() {
            let value = axis.values[rest % axis.values.len()].clone();
            settings.push(ScenarioChange { key: axis.key.clone(), value });
            rest /= axis.values.len();
        }
        settings.reverse();
        Job { settings, seed }
    }

    /// All runs, in their order.
    pub fn jobs(&self) -> impl Iterator<Item = Job> {
        (0..self.runs).map(|index| self.job(index))
    }
}

/// One of several parts of a sweep, each of consecutive runs. It is parsed from `I/N`: its index, from 0, and the number of
/// parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Shard {
    /// Less than the number.
    pub index: usize,
    /// Number of parts, at least 1.
    pub count: usize,
}

impl Shard {
    /// The runs of this part of a sweep of so many. All parts have the same number of runs, or one more.
    pub fn runs(&self, of: usize) -> Range<usize> {
        self.index * of / self.count..(self.index + 1) * of / self.count
    }
}

impl FromStr for Shard {
    type Err = GridError;

    fn from_str(text: &str) -> Result<Self, GridError> {
        let parts = text.split_once('/').and_then(|(index, count)| {
            let number = |text: &str| text.trim().parse::<usize>().ok().filter(|&number| number <= MAX_RUNS);
            Some((number(index)?, number(count)?))
        });
        let (index, count) =
            parts.filter(|&(_, count)| count > 0).ok_or_else(|| GridError::Shard(text.to_owned()))?;
        if index >= count {
            return Err(GridError::ShardIndex { index, count, last: count - 1 });
        }
        Ok(Self { index, count })
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}/{}", self.index, self.count)
    }
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
        let all = |text: &str| {
            let seeds: Seeds = text.parse().unwrap();
            (0..seeds.count()).map(|k| seeds.get(k)).collect::<Vec<_>>()
        };
        assert_eq!((all("3..5"), all("3,4,5"), all("7, 2")), (vec![3, 4, 5], vec![3, 4, 5], vec![7, 2]));
        for (text, again) in [("3..5", "3..5"), ("3,4,5", "3..5"), ("7, 2", "7,2"), ("5", "5"), ("2..2", "2")]
        {
            assert_eq!(text.parse::<Seeds>().unwrap().to_string(), again);
        }
        for wrong in ["5..3", "a", "1..x", "-1", "1..99999999999", ""] {
            assert!(wrong.parse::<Seeds>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn shards_are_all_runs_once_in_parts_of_nearly_one_size() {
        for (runs, count) in [(10, 3), (1, 1), (3, 8), (MAX_RUNS, 1000), (MAX_RUNS, 999_983)] {
            let parts: Vec<Range<usize>> =
                (0..count).map(|index| Shard { index, count }.runs(runs)).collect();
            assert!(parts.windows(2).all(|pair| pair[0].end == pair[1].start));
            assert_eq!((parts[0].start, parts[count - 1].end), (0, runs));
            assert!(parts.iter().all(|part| [runs / count, runs.div_ceil(count)].contains(&part.len())));
        }
        assert_eq!("3/16".parse(), Ok(Shard { index: 3, count: 16 }));
        for (wrong, told) in
            [("3", "write I/N"), ("3/0", "write I/N"), ("-1/4", "write I/N"), ("4/4", "last of 4 is 3/4")]
        {
            let error = wrong.parse::<Shard>().unwrap_err().to_string();
            assert!(error.contains(told), "{error}");
        }
    }

    #[test]
    fn runs_are_all_combinations_in_a_stated_order() {
        let axes = [axis("a=1,2"), axis("b=3,4")];
        let grid = Grid::new(axes.to_vec(), Some("8,9".parse().unwrap())).unwrap();
        let told: Vec<String> = grid
            .jobs()
            .map(|job| format!("{}{}{}", job.settings[0].value, job.settings[1].value, job.seed.unwrap()))
            .collect();
        assert_eq!(told, ["138", "139", "148", "149", "238", "239", "248", "249"]);
        let single = Grid::new(Vec::new(), None).unwrap();
        assert_eq!((single.runs(), single.job(0)), (1, Job { settings: Vec::new(), seed: None }));
        let thousand = || "0..999".parse().unwrap();
        assert_eq!(Grid::new(vec![axis("a=0:1000:1")], Some(thousand())), Err(GridError::TooManyRuns));
        assert_eq!(Grid::new(vec![axis("a=1:1000:1")], Some(thousand())).unwrap().runs(), MAX_RUNS);
    }
}
