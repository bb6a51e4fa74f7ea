//! Notices of third-party software: they are those of the crates that the program is built from.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use xtask::notices::{FILE, listed, shipped_crates};

#[test]
fn the_notices_are_of_the_crates_that_the_program_consists_of() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let shipped: BTreeSet<String> = shipped_crates(root).unwrap().iter().map(|it| it.title()).collect();
    let listed = listed(&std::fs::read_to_string(root.join(FILE)).unwrap());
    let missing: Vec<&String> = shipped.difference(&listed).collect();
    let gone: Vec<&String> = listed.difference(&shipped).collect();
    assert!(
        missing.is_empty() && gone.is_empty() && shipped.len() > 100,
        "{FILE}: {missing:?} are missing, {gone:?} are gone: cargo xtask generate notices"
    );
}

#[test]
fn the_program_prints_its_notices() {
    let output = Command::new(env!("CARGO_BIN_EXE_city3d")).arg("licenses").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    for words in
        ["rapier3d-f64 ", "SIL OPEN FONT LICENSE", "UBUNTU FONT LICENCE", "Bitstream Vera", "Apache License"]
    {
        assert!(printed.contains(words), "{words} is missing");
    }
}
