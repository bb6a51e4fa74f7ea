//! Golden values: texts that change only on purpose, in `tests/golden/`.

use std::path::Path;

/// Holds a text against a file of golden values, line by line; with `CITY3D_RENEW_GOLDEN` set it writes the file.
pub fn is_golden(path: &Path, found: &str) {
    if std::env::var_os("CITY3D_RENEW_GOLDEN").is_some() {
        std::fs::write(path, found).unwrap();
    }
    let expected = std::fs::read_to_string(path).unwrap();
    for (expected, found) in expected.lines().zip(found.lines()) {
        assert_eq!(expected, found, "{}", path.display());
    }
    assert_eq!(expected.lines().count(), found.lines().count(), "lines of {}", path.display());
}
