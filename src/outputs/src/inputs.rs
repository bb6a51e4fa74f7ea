//! Inputs of a command that its outputs would write over.

use super::OutputError;
use same_file::is_same_file;
use std::path::{Path, PathBuf};

/// Refuses outputs that are a file which the command reads, under whatever name: another spelling, a symbolic link or a
/// hard link.
///
/// # Errors
/// [`OutputError::Input`] with both names.
pub fn refuse_inputs(
    inputs: &[PathBuf],
    outputs: impl IntoIterator<Item = PathBuf>,
) -> Result<(), OutputError> {
    // Only regular files can be lost, and opening a pipe to compare it would wait.
    let inputs: Vec<&PathBuf> = inputs.iter().filter(|input| input.is_file()).collect();
    for output in outputs.into_iter().filter(|output| output.is_file()) {
        let is_output = |input: &&&PathBuf| is_same(input, &output);
        if let Some(input) = inputs.iter().find(is_output) {
            return Err(OutputError::Input { input: input.to_path_buf(), path: output });
        }
    }
    Ok(())
}

/// Whether two names are of one file. Files that cannot be opened are compared by their paths.
fn is_same(a: &Path, b: &Path) -> bool {
    is_same_file(a, b)
        .unwrap_or_else(|_| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn an_input_is_found_under_each_of_its_names() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir(at("folder")).unwrap();
        for name in ["log", "other"] {
            std::fs::write(at(name), "precious").unwrap();
        }
        std::fs::hard_link(at("log"), at("hard")).unwrap();
        std::os::unix::fs::symlink("log", at("soft")).unwrap();
        for output in ["log", "folder/../log", "hard", "soft"] {
            let refused = refuse_inputs(&[at("other"), at("log")], [at("other-output"), at(output)]);
            let refused = refused.unwrap_err();
            assert!(refused.is_bad_input(), "{refused}");
            assert!(refused.to_string().contains("choose another --out"), "{refused}");
        }
        refuse_inputs(&[at("log"), at("missing")], [at("other"), at("missing"), at("folder")]).unwrap();
        refuse_inputs(&["/dev/null".into()], ["/dev/null".into()]).unwrap();
    }
}
