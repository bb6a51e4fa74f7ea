//! Reads a TOML table field by field. Every problem is recorded with line and column, and reading continues,
//! so that a user sees all problems at once.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt;
use std::ops::{Range, RangeInclusive};
use toml::Spanned;
use toml::de::{DeInteger, DeString, DeTable, DeValue};

/// A problem of a scenario file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// From 1.
    pub line: usize,
    /// From 1, in characters.
    pub column: usize,
    /// What is wrong, and the remedy.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, column {}: {}", self.line, self.column, self.message)
    }
}

/// Most problems that are kept.
const MOST_PROBLEMS: usize = 30;

/// Collects the problems of one file.
#[derive(Debug)]
pub struct Problems<'a> {
    text: &'a str,
    found: RefCell<Vec<Problem>>,
}

impl<'a> Problems<'a> {
    /// A collection without problems; `text` is the content of the file.
    pub fn new(text: &'a str) -> Self {
        Self { text, found: RefCell::new(Vec::new()) }
    }

    /// Adds a problem at a byte range of the text; those beyond a limit are dropped.
    pub fn add(&self, at: &Range<usize>, message: impl Into<String>) {
        let mut found = self.found.borrow_mut();
        if found.len() < MOST_PROBLEMS {
            let mut start = at.start.min(self.text.len());
            while !self.text.is_char_boundary(start) {
                start -= 1;
            }
            let before = &self.text[..start];
            let line = before.matches('\n').count() + 1;
            let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
            found.push(Problem { line, column, message: message.into() });
        }
    }

    /// Whether no problem has been found.
    pub fn is_empty(&self) -> bool {
        self.found.borrow().is_empty()
    }

    /// All problems in the order of the file.
    pub fn into_sorted(self) -> Vec<Problem> {
        let mut found = self.found.into_inner();
        found.sort_by_key(|problem| (problem.line, problem.column));
        found.dedup();
        found
    }
}

/// Reader of a TOML table. Fields that no caller reads are unknown and reported by [`TableFields::finish`].
#[derive(Debug)]
pub struct TableFields<'a, 'p> {
    table: &'a DeTable<'a>,
    /// Position of the table, for missing fields.
    pub span: Range<usize>,
    known: RefCell<BTreeSet<&'static str>>,
    /// Problems of the file that holds the table.
    pub problems: &'p Problems<'p>,
}

type TableEntry<'a> = (&'a Spanned<DeString<'a>>, &'a Spanned<DeValue<'a>>);

impl<'a, 'p> TableFields<'a, 'p> {
    /// Reader of a table at a byte range of the file; no field has been read yet.
    pub fn new(table: &'a DeTable<'a>, span: Range<usize>, problems: &'p Problems<'p>) -> Self {
        Self { table, span, known: RefCell::default(), problems }
    }

    /// Value of a field, which is known from now on; `None` if it is missing.
    pub fn entry(&self, key: &'static str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.known.borrow_mut().insert(key);
        self.table.get(key)
    }

    /// All entries of a table with arbitrary keys.
    pub fn entries(&self) -> impl Iterator<Item = TableEntry<'a>> {
        self.table.iter()
    }

    /// Position of a field, or of the table if it is missing.
    pub fn span_of(&self, key: &str) -> Range<usize> {
        self.table.get(key).map_or(self.span.clone(), Spanned::span)
    }

    /// Position of a nested field, as far as the path exists.
    pub fn span_of_path<'k>(&self, path: impl Iterator<Item = &'k str>) -> Range<usize> {
        let mut span = self.span.clone();
        let mut table = Some(self.table);
        for key in path {
            let Some(value) = table.and_then(|table| table.get(key)) else { break };
            span = value.span();
            table = value.get_ref().as_table();
        }
        span
    }

    /// Adds a problem at a field, or at the table if the field is missing.
    pub fn wrong(&self, key: &str, message: impl Into<String>) {
        self.problems.add(&self.span_of(key), message);
    }

    fn wrong_type(&self, key: &str, value: &Spanned<DeValue<'_>>, expected: &str) {
        let found = match value.get_ref() {
            // Right type, but not finite, negative, or beyond 64 bits.
            DeValue::Integer(number) => written(number).chars().take(32).collect(),
            DeValue::Float(number) => number.as_str().chars().take(32).collect(),
            other => format!("{} {}", article(other.type_str()), other.type_str()),
        };
        self.problems.add(&value.span(), format!("{key} is {found}; it must be {expected}"));
    }

    /// Reads an optional number within a range.
    pub fn number(&self, key: &'static str, range: RangeInclusive<f64>, into: &mut f64) {
        let Some(value) = self.entry(key) else { return };
        match number_of(value.get_ref()) {
            Some(number) if range.contains(&number) => *into = number,
            _ => {
                let (low, high) = (range.start(), range.end());
                self.wrong_type(key, value, &format!("a number between {low} and {high}"));
            }
        }
    }

    /// Reads a required number.
    pub fn required_number(&self, key: &'static str, range: RangeInclusive<f64>) -> f64 {
        let mut number = *range.start();
        if self.entry(key).is_none() {
            self.problems.add(
                &self.span,
                format!("{key} is missing: a number between {} and {}", range.start(), range.end()),
            );
        }
        self.number(key, range, &mut number);
        number
    }

    /// Reads an optional integer.
    pub fn integer(&self, key: &'static str, range: RangeInclusive<u64>) -> Option<u64> {
        let value = self.entry(key)?;
        let number = match value.get_ref() {
            DeValue::Integer(integer) => u64::from_str_radix(integer.as_str(), integer.radix()).ok(),
            _ => None,
        };
        match number {
            Some(number) if range.contains(&number) => Some(number),
            _ => {
                let (low, high) = (range.start(), range.end());
                self.wrong_type(key, value, &format!("a whole number between {low} and {high}"));
                None
            }
        }
    }

    /// Reads an optional truth value.
    pub fn boolean(&self, key: &'static str, into: &mut bool) {
        let Some(value) = self.entry(key) else { return };
        match value.get_ref().as_bool() {
            Some(found) => *into = found,
            None => self.wrong_type(key, value, "true or false"),
        }
    }

    /// Reads an optional text.
    pub fn string(&self, key: &'static str) -> Option<&'a str> {
        let value = self.entry(key)?;
        let text = value.get_ref().as_str();
        if text.is_none() {
            self.wrong_type(key, value, "a text in quotes");
        }
        text
    }

    /// Reads a required text; `meaning` describes it where it is missing.
    pub fn required_string(&self, key: &'static str, meaning: &str) -> Option<&'a str> {
        if self.entry(key).is_none() {
            self.problems.add(&self.span, format!("{key} is missing: {meaning}"));
        }
        self.string(key)
    }

    /// Reads one of several words.
    pub fn choice<T: Copy>(&self, key: &'static str, choices: &[(&str, T)], into: &mut T) {
        let Some(text) = self.string(key) else { return };
        if let Some((_, choice)) = choices.iter().find(|(name, _)| *name == text) {
            *into = *choice;
        } else {
            let names = choices.iter().map(|(name, _)| *name);
            self.wrong(key, format!("{key} is \"{text}\"; {}", one_of(text, names)));
        }
    }

    /// Reads an optional table.
    pub fn table(&self, key: &'static str) -> Option<Self> {
        let value = self.entry(key)?;
        self.table_of(key, value)
    }

    /// Tables of an array of tables (`[[key]]`), in the order of the file.
    pub fn tables(&self, key: &'static str) -> Vec<Self> {
        let Some(value) = self.entry(key) else { return Vec::new() };
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(key, value, &format!("one or more [[{key}]] tables"));
            return Vec::new();
        };
        array.iter().filter_map(|value| self.table_of(key, value)).collect()
    }

    /// An entry that is itself a table.
    pub fn table_of(&self, key: &str, value: &'a Spanned<DeValue<'a>>) -> Option<Self> {
        match value.get_ref().as_table() {
            Some(table) => Some(Self::new(table, value.span(), self.problems)),
            None => {
                self.wrong_type(key, value, "a table");
                None
            }
        }
    }

    /// Reads an array of strings, each with its position.
    pub fn strings(&self, key: &'static str) -> Option<Vec<(&'a str, Range<usize>)>> {
        let value = self.entry(key)?;
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(key, value, "an array of texts");
            return None;
        };
        let texts = array.iter().filter_map(|item| {
            let text = item.get_ref().as_str();
            if text.is_none() {
                self.wrong_type(key, item, "an array of texts");
            }
            Some((text?, item.span()))
        });
        Some(texts.collect())
    }

    /// Reads `N` numbers; `example` describes them.
    pub fn numbers<const N: usize>(
        &self,
        key: &'static str,
        range: RangeInclusive<f64>,
        example: &str,
    ) -> Option<[f64; N]> {
        let value = self.entry(key)?;
        let all = |array: &[Spanned<DeValue<'_>>]| -> Option<[f64; N]> {
            let numbers: Vec<f64> = array.iter().filter_map(|n| number_of(n.get_ref())).collect();
            if numbers.len() == array.len() { <[f64; N]>::try_from(numbers).ok() } else { None }
        };
        let numbers = value.get_ref().as_array().and_then(|array| all(array));
        let within = numbers.filter(|numbers| numbers.iter().all(|number| range.contains(number)));
        if within.is_none() {
            let (low, high) = (range.start(), range.end());
            let what = format!("{N} numbers between {low} and {high}, such as {example}");
            match numbers {
                Some(_) => self.wrong(key, format!("{key} is out of range; it must be {what}")),
                None => self.wrong_type(key, value, &what),
            }
        }
        within
    }

    /// Reads an array of number pairs.
    pub fn pairs(&self, key: &'static str) -> Option<Vec<[f64; 2]>> {
        let value = self.entry(key)?;
        let pair = |item: &Spanned<DeValue<'_>>| {
            let pair = item.get_ref().as_array()?;
            let numbers: Vec<f64> = pair.iter().filter_map(|n| number_of(n.get_ref())).collect();
            (pair.len() == 2).then(|| <[f64; 2]>::try_from(numbers).ok())?
        };
        let pairs = value.get_ref().as_array().and_then(|array| array.iter().map(pair).collect());
        if pairs.is_none() {
            self.wrong_type(key, value, "an array of pairs of numbers, such as [[0, 280], [6000, 250]]");
        }
        pairs
    }

    /// Reports every field that was not read.
    pub fn finish(self) {
        let known = self.known.into_inner();
        for (key, _) in self.table {
            let name: &str = key.get_ref();
            if !known.contains(name) {
                let remedy = one_of(name, known.iter().copied());
                self.problems.add(&key.span(), format!("unknown key \"{name}\"; {remedy}"));
            }
        }
    }
}

/// An integer as TOML writes it, with the prefix of its radix.
fn written(integer: &DeInteger<'_>) -> String {
    let prefix = match integer.radix() {
        16 => "0x",
        8 => "0o",
        2 => "0b",
        _ => "",
    };
    format!("{prefix}{}", integer.as_str())
}

/// A finite number of 64 bits.
pub(super) fn number_of(value: &DeValue<'_>) -> Option<f64> {
    let number = match value {
        DeValue::Float(float) => float.as_str().parse::<f64>().ok()?,
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix()).ok()? as f64,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

fn article(noun: &str) -> &'static str {
    if noun.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" }
}

/// Suggestion for an unknown name: the nearest name by edit distance, or all names.
pub fn one_of<'n>(found: &str, names: impl Iterator<Item = &'n str>) -> String {
    let names: Vec<&str> = names.collect();
    if let Some(question) = did_you_mean(found, names.iter().copied()) {
        return question;
    }
    let nearest = names.iter().map(|name| (edit_distance(found, name), *name)).min();
    match nearest {
        Some(_) if names.len() <= 24 => format!("there are: {}", names.join(", ")),
        Some((_, name)) => format!("there are {} names, the nearest is \"{name}\"", names.len()),
        None => "there are none".to_owned(),
    }
}

/// Suggestion of the nearest name by edit distance, if it is near.
pub fn did_you_mean<'n>(found: &str, names: impl Iterator<Item = &'n str>) -> Option<String> {
    let (distance, name) = names.map(|name| (edit_distance(found, name), name)).min()?;
    (distance <= 1 + name.len() / 4).then(|| format!("did you mean \"{name}\"?"))
}

fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().take(64).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let cost = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = cost.min(row[j] + 1).min(row[j + 1] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems_of(text: &str, read: impl Fn(&TableFields<'_, '_>)) -> Vec<String> {
        let problems = Problems::new(text);
        let table = DeTable::parse(text).unwrap();
        let fields = TableFields::new(table.get_ref(), 0..0, &problems);
        read(&fields);
        fields.finish();
        problems.into_sorted().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn several_problems_are_found_at_once_each_with_its_place() {
        let text = "mass_kg = \"heavy\"\nwith_typo = 1\n  friction = -3.0\n";
        let found = problems_of(text, |fields| {
            fields.number("mass_kg", 1.0..=10.0, &mut 0.0);
            fields.number("friction", 0.0..=2.0, &mut 0.0);
            fields.number("width_typo", 0.0..=2.0, &mut 0.0);
        });
        assert_eq!(
            found,
            [
                "line 1, column 11: mass_kg is a string; it must be a number between 1 and 10",
                "line 2, column 1: unknown key \"with_typo\"; did you mean \"width_typo\"?",
                "line 3, column 14: friction is -3.0; it must be a number between 0 and 2",
            ]
        );
    }

    #[test]
    fn integers_are_told_as_they_are_written() {
        for (text, told) in [
            ("x = 0xff_ff", "x is 0xffff; it must be a number between 0 and 1"),
            ("x = 0o17", "x is 0o17; it must be a number between 0 and 1"),
            ("x = 0b11", "x is 0b11; it must be a number between 0 and 1"),
            ("x = 12", "x is 12; it must be a number between 0 and 1"),
        ] {
            let found = problems_of(text, |fields| fields.number("x", 0.0..=1.0, &mut 0.0));
            assert_eq!(found, [format!("line 1, column 5: {told}")]);
        }
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        for text in ["x = nan", "x = inf", "x = 1979-05-27", "x = 99999999999999999999999"] {
            let parsed = DeTable::parse(text);
            let Ok(table) = parsed else { continue };
            let problems = Problems::new(text);
            TableFields::new(table.get_ref(), 0..0, &problems).number("x", 0.0..=1.0, &mut 0.0);
            assert!(!problems.is_empty(), "{text}");
        }
    }
}
