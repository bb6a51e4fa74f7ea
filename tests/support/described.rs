//! Columns of tables as the documents describe them.

/// The names in the first column of the table of columns in a section of a document.
pub fn columns(document: &'static str, section: &str) -> Vec<&'static str> {
    let (_, section) = document.split_once(&format!("\n## {section}\n")).expect("a section");
    let rows = section
        .lines()
        .skip_while(|line| !line.starts_with("| column"))
        .take_while(|line| line.starts_with('|'));
    rows.flat_map(|row| row.split('|').nth(1).unwrap_or_default().split('`').skip(1).step_by(2)).collect()
}
