//! Parameter grid of a sweep: axes, seeds and their combinations.

use std::str::FromStr;
use toml::Value;

/// A parameter of the scenario with its values.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Dotted path in the scenario.
    pub key: String,
    pub values: Vec<Value>,
}

/// Limit of values on one axis and of runs: more are a typing error.
const MAX_RUNS: usize = 1_000_000;

impl FromStr for Axis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (key, values) = text.split_once('=').ok_or("write KEY=VALUES, such as environment.loss=0,0.1")?;
        let key = key.trim();
        if key.is_empty() || key.split('.').any(str::is_empty) {
            return Err(format!(
                "\"{key}\" is not a key of a scenario; write a dotted path, such as environment.loss"
            ));
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
fn steps(from: &str, to: &str, step: &str) -> Result<Vec<Value>, String> {
    let number = |text: &str| -> Result<f64, String> {
        let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| format!("\"{text}\" is not a number; write FROM:TO:STEP, such as 0:0.3:0.05"))
    };
    let (from, to, step) = (number(from)?, number(to)?, number(step)?);
    if step <= 0.0 || to < from {
        return Err("FROM:TO:STEP needs a positive STEP, and TO must not be less than FROM".to_owned());
    }
    let count = ((to - from) / step + 1e-6).floor();
    if count >= MAX_RUNS as f64 {
        return Err(format!("more than {MAX_RUNS} values"));
    }
    // Rounding makes 0.1 + 0.2 equal 0.3.
    let value = |k: usize| ((from + k as f64 * step) * 1e9).round() / 1e9;
    Ok((0..=count as usize).map(|k| Value::Float(value(k))).collect())
}

/// Seeds in their order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seeds(pub Vec<u64>);

impl FromStr for Seeds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| -> Result<u64, String> {
            let seed = text.trim().parse::<u64>().ok().filter(|seed| i64::try_from(*seed).is_ok());
            seed.ok_or_else(|| format!("\"{text}\" is not a seed; write 1..20 or 1,4,9"))
        };
        if let Some((first, last)) = text.split_once("..") {
            let (first, last) = (number(first)?, number(last)?);
            return match last.checked_sub(first) {
                Some(more) if more < MAX_RUNS as u64 => Ok(Self((first..=last).collect())),
                Some(_) => Err(format!("more than {MAX_RUNS} seeds")),
                None => Err("the last seed comes before the first".to_owned()),
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
    pub seed: Option<u64>,
}

/// All combinations in a fixed order: seeds change fastest, then the last axis.
pub fn jobs(axes: &[Axis], seeds: Option<&Seeds>) -> Result<Vec<Job>, String> {
    let seeds: Vec<Option<u64>> =
        seeds.map_or(vec![None], |seeds| seeds.0.iter().copied().map(Some).collect());
    let count = axes.iter().try_fold(seeds.len(), |count, axis| count.checked_mul(axis.values.len()));
    if count.is_none_or(|count| count > MAX_RUNS) {
        return Err(format!("more than {MAX_RUNS} runs"));
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
    pub fn scenario(&self, document: &toml::Table) -> Result<String, String> {
        let mut changed = document.clone();
        for (key, value) in &self.settings {
            set(&mut changed, key, value)?;
        }
        toml::to_string(&changed).map_err(|error| error.to_string())
    }
}

/// Sets a value at a dotted path. Missing tables are created; an entry of a list is chosen by its `name` or its number
/// from 1.
fn set(document: &mut toml::Table, key: &str, value: &Value) -> Result<(), String> {
    let parts: Vec<&str> = key.split('.').collect();
    let Some((last, before)) = parts.split_last() else { return Ok(()) };
    let mut table = document;
    let mut parts = before.iter();
    while let Some(part) = parts.next() {
        let entry = table.entry((*part).to_owned()).or_insert_with(|| Value::Table(toml::Table::new()));
        table = match entry {
            Value::Table(table) => table,
            Value::Array(list) => {
                let which =
                    parts.next().ok_or_else(|| format!("{key}: {part} is a list; write {part}.1.{last}"))?;
                entry_of(list, which).ok_or_else(|| {
                    format!("{key}: {part} has no entry \"{which}\"; give a name, or a number from 1")
                })?
            }
            _ => return Err(format!("{key}: {part} is a value and has no key {last}")),
        };
    }
    table.insert((*last).to_owned(), value.clone());
    Ok(())
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
        assert_eq!(with("environment.loss").unwrap()["environment"]["loss"], Value::Integer(5));
        assert!(with("vehicle.c.at_m").unwrap_err().contains("\"c\""));
        assert!(with("vehicle.at_m").is_err() && with("vehicle.b.name.x").is_err());
    }
}
