//! The fuzz targets over their corpus, and the seeds of the corpus. `scripts/fuzz.sh` fuzzes them.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]

mod seeds;
mod targets;

use std::collections::BTreeSet;
use std::fs::{read, read_dir, read_to_string};
use std::path::{Path, PathBuf};
use targets::TARGETS;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz")
}

/// Names of the files of a folder, in order.
fn files(folder: &Path) -> BTreeSet<String> {
    let entries = read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn each_input_of_the_corpus_passes_its_target() {
    for (name, target) in TARGETS {
        let corpus = folder().join("corpus").join(name);
        for file in files(&corpus) {
            println!("{name}/{file}");
            target(&read(corpus.join(file)).unwrap());
        }
    }
}

#[test]
fn the_corpus_is_small() {
    /// Files of a target, and bytes of a file.
    const MOST: usize = 24;
    const LARGEST: u64 = 16 << 10;
    for (name, _) in TARGETS {
        let corpus = folder().join("corpus").join(name);
        let found = files(&corpus);
        assert!((1..=MOST).contains(&found.len()), "{name} has {} files, 1 to {MOST} are good", found.len());
        for file in found {
            let length = corpus.join(&file).metadata().unwrap().len();
            assert!(length <= LARGEST, "{name}/{file} has {length} bytes, {LARGEST} at most");
        }
    }
}

#[test]
fn every_target_has_its_program_its_corpus_and_its_limits() {
    let targets: BTreeSet<String> = TARGETS.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(files(&folder().join("corpus")), targets);
    let programs: BTreeSet<String> = targets.iter().map(|name| format!("{name}.rs")).collect();
    assert_eq!(files(&folder().join("fuzz_targets")), programs);
    for name in &targets {
        let program = read_to_string(folder().join(format!("fuzz_targets/{name}.rs"))).unwrap();
        assert!(program.contains(&format!("city3d_fuzz::{name}(data)")), "{program}");
    }
    let package: toml::Table = read_to_string(folder().join("Cargo.toml")).unwrap().parse().unwrap();
    let binaries = package["bin"].as_array().unwrap().iter();
    let binaries: BTreeSet<String> = binaries.map(|bin| bin["name"].as_str().unwrap().to_owned()).collect();
    assert_eq!(binaries, targets);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/fuzz.sh");
    let script = read_to_string(script).unwrap();
    let limits = script.lines().filter_map(|line| line.trim().strip_prefix('[')?.split_once("]="));
    assert_eq!(limits.map(|(name, _)| name.to_owned()).collect::<BTreeSet<_>>(), targets);
}

/// Seeds are good inputs: each is one that its reader takes, so that fuzzing begins behind the first checks. With
/// `CITY3D_RENEW_GOLDEN` set they are written into the corpus.
#[test]
fn seeds_are_taken() {
    let folder_of_seed = tempfile::tempdir().unwrap();
    let path = folder_of_seed.path().join("seed");
    for (target, name, bytes) in seeds::all() {
        std::fs::write(&path, &bytes).unwrap();
        assert!(seeds::is_taken(target, &bytes, &path), "{target}: {name}");
        if std::env::var_os("CITY3D_RENEW_GOLDEN").is_some() {
            let corpus = folder().join("corpus").join(target);
            std::fs::create_dir_all(&corpus).unwrap();
            std::fs::write(corpus.join(format!("seed_{name}")), &bytes).unwrap();
        }
    }
}
