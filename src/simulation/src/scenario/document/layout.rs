//! How edited values are laid out: as a person would have written them, with the comments that were there.

use toml_edit::visit_mut::{VisitMut, visit_table_mut};
use toml_edit::{Array, DocumentMut, Item, RawString, Table, Value};

/// Columns within which a route stays on one line.
const MOST_COLUMNS: usize = 100;
/// Before each lane of a route with one line for each.
const INDENT: &str = "\n    ";

/// Replaces a value; a comment behind it stays.
pub fn replace_value(table: &mut Table, key: &str, mut new: Value) {
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => {
            *new.decor_mut() = old.decor().clone();
            *old = new;
        }
        None => _ = table.insert(key, Item::Value(new)),
    }
}

/// Moves a value of a table behind another one.
pub fn put_behind(table: &mut Table, key: &str, other: &str) {
    let Some(place) = table.iter().position(|(name, _)| name == other) else { return };
    let order: Vec<String> =
        table.iter().map(|(name, _)| name.to_owned()).filter(|name| name != key).collect();
    let rank = |name: &str| match order.iter().position(|known| known == name) {
        Some(at) => 2 * at,
        None => 2 * place + 1,
    };
    table.sort_values_by(|a, _, b, _| rank(a.get()).cmp(&rank(b.get())));
}

/// Writes the names of lanes. Those that stay at the beginning keep their lines and comments.
pub fn set_route(table: &mut Table, lanes: &[String]) {
    let old = table.get("route").and_then(Item::as_array);
    let had_lines = old.is_some_and(|old| old.iter().any(|lane| has_newline(lane.decor().prefix())));
    let mut route = old.cloned().unwrap_or_default();
    let kept = route.iter().zip(lanes).take_while(|(old, new)| old.as_str() == Some(new.as_str())).count();
    while route.len() > kept {
        route.remove(route.len() - 1);
    }
    // A comment behind the last lane belongs to the end of the list: it stays with its lane.
    let mut comment = if kept < lanes.len() { comment_at_end(&mut route) } else { String::new() };
    for lane in &lanes[kept..] {
        // An own layout for each: the usual one of `push` does not follow that of its neighbours.
        let mut lane = Value::from(lane);
        lane.decor_mut().set_prefix(match (had_lines, route.is_empty()) {
            (true, _) => std::mem::take(&mut comment) + INDENT,
            (false, true) => String::new(),
            (false, false) => " ".to_owned(),
        });
        route.push_formatted(lane);
    }
    let is_long = "route = ".len() + route.to_string().trim().chars().count() > MOST_COLUMNS;
    if !had_lines && is_long {
        put_on_lines(&mut route);
    }
    replace_value(table, "route", Value::Array(route));
}

/// Takes a comment from the end of a list of lanes, with the space before it.
fn comment_at_end(route: &mut Array) -> String {
    let end = route.trailing().as_str().unwrap_or_default().to_owned();
    let Some((comment, _)) = end.rsplit_once('\n').filter(|(comment, _)| comment.contains('#')) else {
        return String::new();
    };
    route.set_trailing("\n");
    comment.to_owned()
}

fn put_on_lines(route: &mut Array) {
    route.iter_mut().for_each(|lane| lane.decor_mut().set_prefix(INDENT));
    route.set_trailing("\n");
    route.set_trailing_comma(true);
}

fn has_newline(text: Option<&RawString>) -> bool {
    text.and_then(RawString::as_str).is_some_and(|text| text.contains('\n'))
}

/// Puts the comments above a removed table before what comes after it.
pub fn keep_comments(document: &mut DocumentMut, removed: &Table) {
    let prefix = removed.decor().prefix().and_then(RawString::as_str).unwrap_or_default();
    if !prefix.contains('#') {
        return;
    }
    let position = removed.position().unwrap_or(isize::MAX);
    let mut next = NextTable { after: position, found: None };
    next.visit_document_mut(document);
    match next.found {
        Some(position) => Prepend { position, text: prefix }.visit_document_mut(document),
        None => {
            let trailing = format!("{prefix}{}", document.trailing().as_str().unwrap_or_default());
            document.set_trailing(trailing);
        }
    }
}

/// Finds the first table behind a position.
struct NextTable {
    after: isize,
    found: Option<isize>,
}

impl VisitMut for NextTable {
    fn visit_table_mut(&mut self, table: &mut Table) {
        let is_written = !table.is_implicit() && !table.is_dotted();
        if let Some(at) = table.position().filter(|at| is_written && *at > self.after) {
            self.found = Some(self.found.map_or(at, |found| found.min(at)));
        }
        visit_table_mut(self, table);
    }
}

/// Puts a text before the table at a position.
struct Prepend<'a> {
    position: isize,
    text: &'a str,
}

impl VisitMut for Prepend<'_> {
    fn visit_table_mut(&mut self, table: &mut Table) {
        if table.position() == Some(self.position) && !table.is_implicit() {
            let own = table.decor().prefix().and_then(RawString::as_str).unwrap_or_default().to_owned();
            let own = if own.contains('#') { own.as_str() } else { "" };
            table.decor_mut().set_prefix(format!("{}{own}", self.text));
        }
        visit_table_mut(self, table);
    }
}
