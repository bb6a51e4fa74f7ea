//! The settings in which two runs differ.

use super::run::RunLog;
use std::collections::{BTreeMap, BTreeSet};

/// Keys and tables of a scenario that are told elsewhere, or that are no settings.
const TOLD_ELSEWHERE: [&str; 5] = ["environment", "seed", "duration_s", "name", "description"];

/// The settings that differ, such as "environment.loss: 0, 0.01".
pub(super) fn settings(a: &RunLog, b: &RunLog) -> Vec<String> {
    let (x, y) = (&a.experiment, &b.experiment);
    let mut found = Vec::new();
    let mut note = |what: &str, values: [String; 2]| {
        if values[0] != values[1] {
            found.push(format!("{what}: {}, {}", values[0], values[1]));
        }
    };
    note("seed", [x.seed, y.seed].map(|seed| seed.to_string()));
    note("duration_s", [x.duration_s, y.duration_s].map(|seconds| seconds.to_string()));
    note("model", [x.model, y.model].map(|model| format!("{model:?}").to_lowercase()));
    note("version", [a, b].map(|run| run.version.clone()));
    note("origin", [a.origin, b.origin].map(|origin| format!("{origin:?}").to_lowercase()));
    let environment =
        [x, y].map(|experiment| leaves(&serde_json::to_value(experiment.environment).unwrap_or_default()));
    note_leaves("environment", &environment, &mut note);
    // Comments and order do not count.
    let scenario = [x, y].map(|experiment| {
        let text: toml::Table = experiment.scenario_text.parse().unwrap_or_default();
        let mut leaves = leaves(&serde_json::to_value(text).unwrap_or_default());
        leaves.retain(|key, _| !TOLD_ELSEWHERE.contains(&key.split('.').next().unwrap_or(key)));
        leaves
    });
    note_leaves("", &scenario, &mut note);
    found
}

fn note_leaves(
    under: &str,
    leaves: &[BTreeMap<String, String>; 2],
    note: &mut impl FnMut(&str, [String; 2]),
) {
    let keys: BTreeSet<&String> = leaves.iter().flat_map(BTreeMap::keys).collect();
    for key in keys {
        let value =
            |leaves: &BTreeMap<String, String>| leaves.get(key).cloned().unwrap_or_else(|| "none".to_owned());
        let name = if under.is_empty() { key.clone() } else { format!("{under}.{key}") };
        note(&name, [value(&leaves[0]), value(&leaves[1])]);
    }
}

/// Values of a document by their dotted paths.
fn leaves(value: &serde_json::Value) -> BTreeMap<String, String> {
    fn walk(value: &serde_json::Value, path: &str, found: &mut BTreeMap<String, String>) {
        let under = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
        match value {
            serde_json::Value::Object(map) => {
                map.iter().for_each(|(key, value)| walk(value, &under(key), found));
            }
            serde_json::Value::Array(list) => {
                list.iter()
                    .enumerate()
                    .for_each(|(index, value)| walk(value, &under(&(index + 1).to_string()), found));
            }
            leaf => drop(found.insert(path.to_owned(), leaf.to_string())),
        }
    }
    let mut found = BTreeMap::new();
    walk(value, "", &mut found);
    found
}
