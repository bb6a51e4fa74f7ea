//! Holds the table of modules in `tests/architecture/modules.md` against the sources: who uses whom, which
//! outside crates and which parts of the standard library, and how long files get.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]

#[path = "architecture/paths.rs"]
mod paths;

use paths::{Named, paths_of};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The table of modules.
const MODULES: &str = "tests/architecture/modules.md";
/// A file of more lines has more than one subject.
const MOST_LINES: usize = 600;
const MOST_LINES_OF_MAIN: usize = 40;

/// The row that speaks for all modules.
const EVERY_MODULE: &str = "every module";
/// The word of a row without fences.
const EVERYTHING: &str = "everything";

#[derive(Clone, Debug, Default)]
struct Row {
    may_use: BTreeSet<String>,
    never: BTreeSet<String>,
}

#[derive(Clone, Debug)]
struct Table {
    rows: BTreeMap<String, Row>,
    /// Outside crates that the package depends on.
    crates: BTreeSet<String>,
}

impl Table {
    /// Reads the rows `| module | may use | never |` of a document; words count where they stand in
    /// back quotes.
    fn read(document: &str, crates: BTreeSet<String>) -> Self {
        let mut lines = document.lines().skip_while(|line| !line.starts_with("| module | may use | never |"));
        assert!(lines.next().is_some(), "{MODULES} has no table `| module | may use | never |`");
        let mut rows = BTreeMap::new();
        for line in lines.skip(1).take_while(|line| line.starts_with('|')) {
            let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
            let [name, may_use, never] = cells[..] else { panic!("three cells are needed: {line}") };
            let name = name.trim_matches('`').to_owned();
            let mut row = Row { may_use: words(may_use), never: words(never) };
            if may_use == EVERYTHING {
                row.may_use.insert(EVERYTHING.to_owned());
            }
            assert!(rows.insert(name, row).is_none(), "a module has two rows: {line}");
        }
        Self { rows, crates }
    }

    fn modules(&self) -> impl Iterator<Item = &String> {
        self.rows.keys().filter(|name| *name != EVERY_MODULE)
    }

    fn may_use(&self, module: &str, used: &str) -> bool {
        let allows = |row: &Row| row.may_use.contains(used) || row.may_use.contains(EVERYTHING);
        module == used || [module, EVERY_MODULE].iter().any(|name| self.rows.get(*name).is_some_and(allows))
    }

    /// What a path of a file does that the table does not allow.
    fn violation(&self, file: &[String], path: &Named) -> Option<String> {
        let module = file.first().map_or("", String::as_str);
        let place = [file, &path.within].concat();
        let written = path.segments.join("::");
        let first = path.segments[0].as_str();
        if matches!(first, "crate" | "self" | "super") {
            let target = resolve(&place, &path.segments);
            return match target.first().map(String::as_str) {
                None | Some("*") => Some(format!("`{written}` names the whole crate; name a module")),
                Some(used) if self.rows.contains_key(used) && !self.may_use(module, used) => {
                    Some(format!("`{written}`: `{module}` may not use `{used}`"))
                }
                _ => None,
            };
        }
        // What is not of std begins with a crate, or with something of the file's own module.
        if first == "std"
            && let Some(row) = self.rows.get(module)
        {
            let is_within =
                |fence: &&String| written == **fence || written.starts_with(&format!("{fence}::"));
            if let Some(fence) = row.never.iter().find(is_within) {
                return Some(format!("`{written}`: `{module}` never uses `{fence}`"));
            }
        }
        (self.crates.contains(first) && !self.may_use(module, first))
            .then(|| format!("`{written}`: `{module}` may not use the crate `{first}`"))
    }

    fn violations(&self, file: &[String], source: &str) -> Vec<String> {
        let paths = paths_of(source);
        let found = paths.iter().filter_map(|path| Some((path.line, self.violation(file, path)?)));
        found.map(|(line, text)| format!("line {line}: {text}")).collect()
    }
}

/// Words in back quotes.
fn words(cell: &str) -> BTreeSet<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// A path that begins with `crate`, `self` or `super`, from the root of the crate.
fn resolve(place: &[String], segments: &[String]) -> Vec<String> {
    let mut at = place.to_vec();
    for segment in segments {
        match segment.as_str() {
            "crate" => at.clear(),
            "self" => {}
            "super" => {
                at.pop();
            }
            name => at.push(name.to_owned()),
        }
    }
    at
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All files of a folder and its folders with an extension, in order.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|found| found == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The module of a source file, from the root of the crate.
fn module_of(path: &Path) -> Vec<String> {
    let path = path.strip_prefix(root().join("src")).unwrap().with_extension("");
    let mut module: Vec<String> = path.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
    if matches!(module.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        module.pop();
    }
    module
}

/// Names of the dependencies of the package, as sources write them.
fn dependencies() -> BTreeSet<String> {
    let manifest: toml::Table = read(&root().join("Cargo.toml")).parse().unwrap();
    // Those of some systems alone as well.
    let targets = manifest.get("target").and_then(|targets| targets.as_table());
    let tables = targets.into_iter().flat_map(|targets| targets.values()).filter_map(toml::Value::as_table);
    let names = tables
        .chain([&manifest])
        .filter_map(|table| table.get("dependencies")?.as_table())
        .flat_map(|table| table.keys());
    names.map(|name| name.replace('-', "_")).collect()
}

fn table() -> Table {
    Table::read(&read(&root().join(MODULES)), dependencies())
}

#[test]
fn modules_use_what_the_table_allows() {
    let table = table();
    let mut found = Vec::new();
    for path in files(&root().join("src"), "rs") {
        for violation in table.violations(&module_of(&path), &read(&path)) {
            found.push(format!("{}: {violation}", path.strip_prefix(root()).unwrap().display()));
        }
    }
    assert!(found.is_empty(), "against the table of {MODULES}:\n{}", found.join("\n"));
}

#[test]
fn the_table_names_every_module_and_nothing_that_is_not_there() {
    let table = table();
    let folders: BTreeSet<String> =
        files(&root().join("src"), "rs").iter().filter_map(|path| module_of(path).first().cloned()).collect();
    let rows: BTreeSet<String> = table.modules().cloned().collect();
    assert_eq!(rows, folders, "rows of the table, and modules of src/");
    for (name, row) in &table.rows {
        let both: Vec<_> = row.may_use.intersection(&row.never).collect();
        assert!(both.is_empty(), "{name} both may and never uses {both:?}");
        for word in row.may_use.union(&row.never) {
            let is_known = rows.contains(word)
                || table.crates.contains(word)
                || word.starts_with("std::")
                || word == EVERYTHING;
            assert!(is_known, "row {name}: `{word}` is neither a module nor a dependency nor of std");
        }
    }
}

#[test]
fn no_module_uses_itself_through_others() {
    let table = table();
    let mut left: BTreeMap<&String, BTreeSet<&String>> = BTreeMap::new();
    for module in table.modules() {
        let used = table.rows[module].may_use.iter().filter(|used| table.rows.contains_key(*used));
        left.insert(module, used.collect());
    }
    while let Some(free) =
        left.iter().find(|(_, used)| used.iter().all(|used| !left.contains_key(used))).map(|(name, _)| *name)
    {
        left.remove(free);
    }
    assert!(left.is_empty(), "a circle among {:?}", left.keys());
}

#[test]
fn files_are_short() {
    let folders = ["src", "tests", "benches", "examples"].map(|folder| files(&root().join(folder), "rs"));
    let sources = folders.into_iter().flatten().chain(files(&root().join("shaders"), "wgsl"));
    let mut long = Vec::new();
    for path in sources {
        let is_main = path == root().join("src/main.rs");
        let (lines, most) =
            (read(&path).lines().count(), if is_main { MOST_LINES_OF_MAIN } else { MOST_LINES });
        if lines > most {
            long.push(format!("{}: {lines} lines, at most {most}", path.display()));
        }
    }
    assert!(long.is_empty(), "{}", long.join("\n"));
}

mod the_test_itself {
    use super::*;

    const DOCUMENT: &str = "
# Words

| module | may use | never |
|---|---|---|
| every module | `glam` | |
| `geom` | | |
| `city` | `geom` | `std::time` |
| `render` | `city` and `geom`; `wgpu` | |
| `app` | everything | |
";

    fn violations(module: &[&str], source: &str) -> Vec<String> {
        let crates = ["glam", "wgpu"].map(str::to_owned).into();
        let module: Vec<String> = module.iter().map(|name| (*name).to_owned()).collect();
        Table::read(DOCUMENT, crates).violations(&module, source)
    }

    #[test]
    fn what_the_table_allows_is_no_violation() {
        let source = "use crate::geom::{Pose2, trig};\nuse super::map;\nuse glam::DVec2;\nuse std::fs;\n\
                      // crate::render\n/* wgpu::Device /* */ crate::app */\n\
                      const A: &str = \"crate::app::x\";\nconst B: &str = r#\"a \" crate::app\"#;\n\
                      fn f<'a>(x: &'a u8) -> char { 'x' }\nfn g() { self::here(); crate::geom::f::<u8>() }";
        assert_eq!(violations(&["city", "dxf"], source), [""; 0]);
        assert_eq!(violations(&["app"], "use crate::{city, render::Renderer};\nuse wgpu as gpu;"), [""; 0]);
    }

    #[test]
    fn planted_violations_are_found_with_their_line() {
        for (module, source, expected) in [
            (
                &["geom"][..],
                "\nuse crate::city::Lane;",
                "line 2: `crate::city::Lane`: `geom` may not use `city`",
            ),
            (
                &["city"],
                "fn f() { crate::render::draw(); }",
                "line 1: `crate::render::draw`: `city` may not use `render`",
            ),
            (&["city"], "use crate::{geom::Pose2, app};", "line 1: `crate::app`: `city` may not use `app`"),
            (
                &["city"],
                "use crate::{geom, render::{self, X}};",
                "line 1: `crate::render`: `city` may not use `render`",
            ),
            (
                &["city", "map"],
                "use super::super::app;",
                "line 1: `super::super::app`: `city` may not use `app`",
            ),
            (
                &["city"],
                "mod tests { use super::super::app::X; }",
                "line 1: `super::super::app::X`: `city` may not use `app`",
            ),
            (&["city"], "use super::{geom, render};", "line 1: `super::render`: `city` may not use `render`"),
            (&["city"], "use crate as all;", "line 1: `crate` names the whole crate; name a module"),
            (&["city"], "use crate::*;", "line 1: `crate::*` names the whole crate; name a module"),
            (
                &["city"],
                "fn f(d: &wgpu::Device) {}",
                "line 1: `wgpu::Device`: `city` may not use the crate `wgpu`",
            ),
            (&["city"], "use wgpu as gpu;", "line 1: `wgpu`: `city` may not use the crate `wgpu`"),
            (&["city"], "use ::wgpu::Device;", "line 1: `wgpu::Device`: `city` may not use the crate `wgpu`"),
            (
                &["city"],
                "use std::{fs, time::Instant};",
                "line 1: `std::time::Instant`: `city` never uses `std::time`",
            ),
            (
                &["city"],
                "let t = std::time::Instant::now();",
                "line 1: `std::time::Instant::now`: `city` never uses `std::time`",
            ),
        ] {
            let found = violations(module, source);
            assert!(found.iter().any(|text| text == expected), "{source}\n{found:?}");
        }
    }

    #[test]
    fn quotes_and_lifetimes_hide_nothing() {
        let source = "fn f<'a>(c: char) -> bool { c == '\"' || c == '\\'' || crate::app::g(c) }";
        assert_eq!(violations(&["city"], source).len(), 1);
    }
}
