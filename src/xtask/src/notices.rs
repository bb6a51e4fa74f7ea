//! Third-party notices: the crates that the program and the Python package consist of, with their copyright lines and licence texts.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The file in the root of the repository.
pub const FILE: &str = "THIRD-PARTY-NOTICES.txt";

const HEADING: &str = "\
Third-party software in City3D

City3D is licensed under MIT or Apache-2.0, at your option. The program and the Python package contain crates, fonts and C
libraries of those below, and the Rust standard library (Copyright The Rust Project Contributors, MIT OR Apache-2.0). Where
a licence may be chosen, MIT is. `cargo xtask generate notices` writes this file.
";

const MIT: &str = "\
Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated documentation
files (the \"Software\"), to deal in the Software without restriction, including without limitation the rights to use, copy,
modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to permit persons to whom the
Software is furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial portions of the
Software.

THE SOFTWARE IS PROVIDED \"AS IS\", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE,
ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
";

/// A crate that is linked into the program.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ShippedCrate {
    pub name: String,
    pub version: String,
    /// SPDX expression.
    license: String,
    authors: Vec<String>,
    folder: PathBuf,
}

impl ShippedCrate {
    /// Name and version, as the list of the file begins its lines.
    pub fn title(&self) -> String {
        format!("{} {}", self.name, self.version)
    }

    fn may_be_mit(&self) -> bool {
        let expression = self.license.replace('/', " OR ");
        !expression.contains("AND") && expression.split(" OR ").any(|option| option.trim() == "MIT")
    }
}

/// Crates of the program and of the Python package on Linux by normal dependencies, without those that only run in the compiler.
/// Build dependencies of our own crates count: `build.rs` puts what is in them, such as fonts, into the program.
///
/// # Errors
/// When `cargo metadata` fails; it needs no network where the program was built.
pub fn shipped_crates(root: &Path) -> Result<BTreeSet<ShippedCrate>, String> {
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(["--filter-platform", "x86_64-unknown-linux-gnu"])
        .current_dir(root)
        .output()
        .map_err(|error| format!("cargo metadata: {error}"))?;
    if !output.status.success() {
        return Err(format!("cargo metadata: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let metadata: Value = serde_json::from_slice(&output.stdout).map_err(|error| error.to_string())?;
    let packages = list(&metadata["packages"]).map(|package| (text(&package["id"]), package));
    let packages: BTreeMap<&str, &Value> = packages.collect();
    let nodes = list(&metadata["resolve"]["nodes"]).map(|node| (text(&node["id"]), node));
    let nodes: BTreeMap<&str, &Value> = nodes.collect();
    let of_name = |name: &str| {
        let is_it = |package: &&&Value| package["name"] == name && package["source"].is_null();
        let package = packages.values().find(is_it).ok_or(format!("there is no package {name}"))?;
        Ok::<_, String>(text(&package["id"]))
    };
    let ours: BTreeSet<&str> = list(&metadata["workspace_members"]).map(text).collect();
    let (mut open, mut known) = (vec![of_name("city3d")?, of_name("city3d-python")?], BTreeSet::new());
    while let Some(id) = open.pop() {
        let (Some(package), Some(node)) = (packages.get(id), nodes.get(id)) else { continue };
        if is_proc_macro(package) || !known.insert(id) {
            continue;
        }
        let is_in = |kind: &Value| kind["kind"].is_null() || (kind["kind"] == "build" && ours.contains(id));
        let shipped = list(&node["deps"]).filter(|dep| list(&dep["dep_kinds"]).any(is_in));
        open.extend(shipped.map(|dep| text(&dep["pkg"])));
    }
    let of_others = known.iter().filter(|id| !ours.contains(*id)).map(|id| packages[id]);
    Ok(of_others.map(shipped).collect())
}

fn is_proc_macro(package: &Value) -> bool {
    list(&package["targets"]).any(|target| list(&target["kind"]).any(|kind| kind == "proc-macro"))
}

fn shipped(package: &Value) -> ShippedCrate {
    let manifest = Path::new(text(&package["manifest_path"]));
    ShippedCrate {
        name: text(&package["name"]).to_owned(),
        version: text(&package["version"]).to_owned(),
        license: text(&package["license"]).to_owned(),
        authors: list(&package["authors"]).map(|author| text(author).to_owned()).collect(),
        folder: manifest.parent().unwrap_or(manifest).to_path_buf(),
    }
}

fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// Names and versions that a file of notices lists.
pub fn listed(notices: &str) -> BTreeSet<String> {
    let crates = notices.split("\n== Crates ==\n").nth(1).and_then(|rest| rest.split("\n== ").next());
    let lines = crates.unwrap_or_default().lines().filter_map(|line| line.split_once("  "));
    lines.map(|(title, _)| title.to_owned()).collect()
}

/// A licence text without its copyright lines, and who is under it.
#[derive(Default)]
struct LicenceText {
    text: String,
    /// Crate and file, with the copyright lines.
    holders: Vec<(String, Vec<String>)>,
}

/// Lines that some of the same texts have.
const TITLES: [&str; 5] =
    ["mit license", "the mit license", "the mit license (mit)", "all rights reserved.", "# mit license"];

/// The contents of the file.
///
/// # Errors
/// When a licence text cannot be read, or a crate has neither a text nor a licence of which one is known.
pub fn notices(root: &Path) -> Result<String, String> {
    let crates = shipped_crates(root)?;
    let apache = read(&root.join("LICENSE-APACHE"))?;
    let mut texts: BTreeMap<String, LicenceText> = BTreeMap::new();
    for shipped in &crates {
        let mut found = Vec::new();
        for path in licence_files(shipped)? {
            let inside = path.strip_prefix(&shipped.folder).unwrap_or(&path).display().to_string();
            let whole = read(&path)?;
            // A link to the licence of the repository that the crate is part of is packed as its target.
            if whole.contains(' ') {
                found.push((format!("{}: {inside}", shipped.title()), whole));
            }
        }
        if found.is_empty() {
            found.push((format!("{}: {}", shipped.title(), shipped.license), usual_text(shipped, &apache)?));
        }
        for (holder, whole) in found {
            let (copyright, body) = split_copyright(&whole);
            let lines = body.lines().filter(|line| !TITLES.contains(&line.trim().to_lowercase().as_str()));
            let key = lines.flat_map(str::split_whitespace).collect::<String>().to_lowercase();
            let entry = texts.entry(key).or_default();
            if entry.text.is_empty() {
                entry.text = body;
            }
            entry.holders.push((holder, copyright));
        }
    }
    let mut file = format!("{HEADING}\n== Crates ==\n");
    for shipped in &crates {
        file += &format!("{}  {}\n", shipped.title(), shipped.license);
    }
    // The most frequent first.
    let mut texts: Vec<LicenceText> = texts.into_values().collect();
    texts.sort_by_key(|licence| std::cmp::Reverse(licence.holders.len()));
    for (number, LicenceText { text, holders }) in (1..).zip(&texts) {
        file += &format!("\n== Licence text {number} ==\n\n");
        for (holder, copyright) in holders {
            file += &format!("{holder}\n");
            copyright.iter().for_each(|line| file += &format!("    {line}\n"));
        }
        file += &format!("\n{}\n", text.trim_matches('\n'));
    }
    Ok(file)
}

/// The text for a crate that has none.
fn usual_text(shipped: &ShippedCrate, apache: &str) -> Result<String, String> {
    match &*shipped.license {
        _ if shipped.may_be_mit() => Ok(format!("Copyright (c) {}\n{MIT}", shipped.authors.join(", "))),
        "Apache-2.0" => Ok(apache.to_owned()),
        other => Err(format!("{}: no text of {other} is known", shipped.title())),
    }
}

fn read(path: &Path) -> Result<String, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let text = String::from_utf8_lossy(&bytes).replace(['\r', '\u{c}'], "");
    Ok(text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n"))
}

/// Folders of what is not shipped.
const ELSEWHERE: [&str; 8] = ["tests", "examples", "programs", "benches", "doc", "docs", "contrib", "target"];

/// Files with the texts of the licences that apply: of a crate that may be had under MIT that one, and those of what it
/// contains, such as fonts and C libraries.
fn licence_files(shipped: &ShippedCrate) -> Result<Vec<PathBuf>, String> {
    let mut own = Vec::new();
    let mut contained = Vec::new();
    collect(&shipped.folder, 0, &mut |path, depth| {
        if depth == 0 { own.push(path) } else { contained.push(path) }
    })?;
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().to_uppercase();
    let others = ["APACHE", "BSD", "ZLIB", "BOOST", "UNLICENSE", "COPYRIGHT"];
    if shipped.may_be_mit() {
        let is_mit = |path: &PathBuf| name(path).contains("MIT");
        if own.iter().any(is_mit) {
            own.retain(is_mit);
        } else {
            own.retain(|path| !others.iter().any(|other| name(path).contains(other)));
        }
    }
    own.append(&mut contained);
    own.sort();
    Ok(own)
}

fn collect(folder: &Path, depth: u32, found: &mut impl FnMut(PathBuf, u32)) -> Result<(), String> {
    const DEEPEST: u32 = 3;
    let place = |error: std::io::Error| format!("{}: {error}", folder.display());
    for entry in std::fs::read_dir(folder).map_err(place)? {
        let path = entry.map_err(place)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_uppercase();
        if path.is_dir() {
            if depth < DEEPEST && !ELSEWHERE.contains(&&*name.to_lowercase()) {
                collect(&path, depth + 1, found)?;
            }
        } else if is_licence(&name) {
            found(path, depth);
        }
    }
    Ok(())
}

/// Whether a file of this name, in capitals, has a licence text. The `COPYING` of a C library is that of its programs.
fn is_licence(name: &str) -> bool {
    let is_code = [".RS", ".C", ".H", ".PY", ".TOML", ".YML", ".HTML", ".TTF"]
        .iter()
        .any(|ending| name.ends_with(ending));
    let starts = ["LICENSE", "LICENCE", "NOTICE", "UNLICENSE", "COPYRIGHT", "OFL", "UFL"];
    let contains = name.contains("MIT-LICENSE") || name.ends_with("-MIT");
    !is_code && (starts.iter().any(|start| name.starts_with(start)) || contains)
}

/// Copyright lines of a licence text, and the rest of it.
fn split_copyright(text: &str) -> (Vec<String>, String) {
    let is_copyright = |line: &&str| {
        let line = line.trim().to_lowercase();
        let is_notice = line.starts_with("copyright (c)") || line.starts_with("copyright \u{a9}");
        let has_year = line.starts_with("copyright") && line.contains(|c: char| c.is_ascii_digit());
        line.starts_with("copyright the ") || is_notice || has_year
    };
    let is_template = |line: &&str| line.contains("yyyy") || line.contains("<year>");
    let (copyright, rest): (Vec<&str>, Vec<&str>) =
        text.lines().partition(|line| is_copyright(line) && !is_template(line));
    (copyright.into_iter().map(|line| line.trim().to_owned()).collect(), rest.join("\n"))
}
