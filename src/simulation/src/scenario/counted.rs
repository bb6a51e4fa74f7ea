//! Counts in words.

/// A count with its noun, which gets an s unless there is exactly one: "1 vehicle", "2 vehicles".
pub fn counted(count: usize, noun: &str) -> String {
    let s = if count == 1 { "" } else { "s" };
    format!("{count} {noun}{s}")
}

#[cfg(test)]
mod tests {
    use super::counted;

    #[test]
    fn only_one_is_singular() {
        assert_eq!(
            [0, 1, 2].map(|count| counted(count, "vehicle")),
            ["0 vehicles", "1 vehicle", "2 vehicles"]
        );
    }
}
