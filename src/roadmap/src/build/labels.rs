//! Applies texts to lanes: names and posted speeds.

use super::lanes::{LaneGraph, check_names, runs};
use super::{EntitiesByLayer, nearest_lane, place};
use crate::dxf::{Entity, EntityShape};
use crate::error::{Diagnostics, MapErrorKind};
use crate::layers;
use std::collections::BTreeMap;

/// Faster values are likely full-scale speeds or kilometres per hour.
const MAX_SPEED_MPS: f64 = 5.0;

/// Gives lanes the names and speeds of the texts placed on them.
///
/// The only text of its layer on a run of lanes holds for the whole run; the lanes of a named run of several
/// get `/a`, `/b` and so on in driving order. Otherwise a text holds for its own lane.
pub(super) fn apply(
    roads: &mut LaneGraph,
    by_layer: &EntitiesByLayer,
    metres: f64,
    diagnostics: &mut Diagnostics,
) {
    let runs = runs(&roads.lanes);
    let names = texts(roads, by_layer, layers::NAMES, metres, diagnostics);
    let mut texts_of_names: BTreeMap<usize, &Entity> = BTreeMap::new();
    for (lanes, (name, entity)) in spread(&names, &runs) {
        for (k, &lane) in lanes.iter().enumerate() {
            roads.lanes[lane].name =
                if lanes.len() > 1 { format!("{name}/{}", letters(k)) } else { (*name).to_owned() };
            texts_of_names.insert(lane, entity);
        }
    }
    check_names(roads, &texts_of_names, diagnostics);

    let speeds = texts(roads, by_layer, layers::SPEEDS, metres, diagnostics);
    for (lanes, (text, entity)) in spread(&speeds, &runs) {
        let number = text.strip_suffix("m/s").unwrap_or(text).trim();
        match number.parse::<f64>() {
            Ok(speed) if speed > 0.0 && speed <= MAX_SPEED_MPS => {
                for lane in lanes {
                    roads.lanes[lane].speed_limit_mps = speed;
                }
            }
            _ => {
                let message = format!("\"{}\" is not a speed", shorten(text));
                let remedy = "write laboratory metres per second, at most 5, such as \"0.35 m/s\"";
                diagnostics.error(MapErrorKind::Text, entity, message, remedy);
            }
        }
    }
}

/// The texts of a layer, by lane.
fn texts<'a>(
    roads: &LaneGraph,
    by_layer: &EntitiesByLayer<'a>,
    layer: &str,
    metres: f64,
    diagnostics: &mut Diagnostics,
) -> BTreeMap<usize, (&'a str, &'a Entity)> {
    let mut texts = BTreeMap::new();
    for &entity in by_layer.get(layer).into_iter().flatten() {
        let EntityShape::Text { at, text, .. } = &entity.shape else {
            diagnostics.note(entity, format!("layer {layer} takes texts only: ignored"));
            continue;
        };
        let text = text.trim();
        let Some(lane) = nearest_lane(&roads.lanes, *at * metres) else {
            let message =
                format!("the text \"{}\" at {} is not on a lane", shorten(text), place(*at * metres));
            let remedy = "put its insertion point within half a lane width of a centre line";
            diagnostics.error(MapErrorKind::Stray, entity, message, remedy);
            continue;
        };
        if text.is_empty() || text.len() > 200 || text.chars().any(char::is_control) {
            let message = format!("\"{}\" is not a valid text for layer {layer}", shorten(text));
            let remedy = "write one line of 1 to 200 characters";
            diagnostics.error(MapErrorKind::Text, entity, message, remedy);
            continue;
        }
        if let Some((other, _)) = texts.insert(lane, (text, entity)) {
            let message = format!("\"{}\" and \"{}\" are on the same lane", shorten(other), shorten(text));
            let remedy = "delete one, or move it to where it is nearest to its own lane";
            diagnostics.error(MapErrorKind::Name, entity, message, remedy);
        }
    }
    texts
}

/// For each text the lanes that it holds for.
fn spread<'t, T>(texts: &'t BTreeMap<usize, T>, runs: &[Vec<usize>]) -> Vec<(Vec<usize>, &'t T)> {
    let mut spread = Vec::new();
    for run in runs {
        let on_run: Vec<_> =
            run.iter().filter_map(|lane| texts.get(lane).map(|text| (*lane, text))).collect();
        match on_run.as_slice() {
            &[(_, text)] => spread.push((run.clone(), text)),
            several => spread.extend(several.iter().map(|&(lane, text)| (vec![lane], text))),
        }
    }
    spread
}

/// a, b, ... z, aa, ab, ...
fn letters(index: usize) -> String {
    let mut letters = Vec::new();
    let mut rest = index + 1;
    while rest > 0 {
        letters.insert(0, char::from(b'a' + ((rest - 1) % 26) as u8));
        rest = (rest - 1) / 26;
    }
    letters.into_iter().collect()
}

pub(super) fn shorten(text: &str) -> String {
    let mut short: String = text.chars().take(40).map(|c| if c.is_control() { '?' } else { c }).collect();
    if short.len() < text.len() {
        short.push_str("...");
    }
    short
}

#[cfg(test)]
mod tests {
    use super::letters;

    #[test]
    fn letters_go_on_after_z() {
        let all: Vec<String> = [0, 1, 25, 26, 27, 701, 702].into_iter().map(letters).collect();
        assert_eq!(all, ["a", "b", "z", "aa", "ab", "zz", "aaa"]);
    }
}
