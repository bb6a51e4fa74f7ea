//! Numbers as the user writes them: with a decimal point or a decimal comma.

use serde::{Deserialize, Serialize};

/// The sign between the whole part and the fraction of a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DecimalSeparator {
    /// As in 12.5.
    #[default]
    Point,
    /// As in 12,5.
    Comma,
}

impl DecimalSeparator {
    /// A number with so many decimals; what rounds to zero has no minus.
    pub fn fixed(self, number: f64, decimals: usize) -> String {
        self.written(signed_as(format!("{number:.decimals$}"), ""))
    }

    /// The same, with a sign also where it is positive.
    pub fn signed(self, number: f64, decimals: usize) -> String {
        self.written(signed_as(format!("{number:+.decimals$}"), "+"))
    }

    /// With one decimal: all panels show a number alike.
    pub fn tenths(self, number: f64) -> String {
        self.fixed((number * 10.0).round() / 10.0, 1)
    }

    /// With as many decimals as it has.
    pub fn plain(self, number: f64) -> String {
        self.written(signed_as(number.to_string(), ""))
    }

    /// A number that was written with a point.
    pub fn written(self, number: String) -> String {
        match self {
            Self::Point => number,
            Self::Comma => number.replace('.', ","),
        }
    }
}

/// A number in digits; where it is a negative zero, with this sign.
fn signed_as(text: String, sign: &str) -> String {
    let is_zero = text.contains('0') && !text.contains(|digit| matches!(digit, '1'..='9'));
    match text.strip_prefix('-') {
        Some(zero) if is_zero => format!("{sign}{zero}"),
        _ => text,
    }
}

/// A number that was typed. Point and comma both begin the fraction, whichever the window shows: no number here is
/// written in groups of digits.
pub fn typed(text: &str) -> Option<f64> {
    let text: String = text
        .chars()
        .filter(|c| !c.is_whitespace())
        .map(|c| match c {
            ',' => '.',
            '\u{2212}' => '-',
            c => c,
        })
        .collect();
    text.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_has_no_minus() {
        let point = DecimalSeparator::Point;
        assert_eq!(
            [point.fixed(-0.04, 1), point.fixed(-0.05, 0), point.fixed(-0.06, 1)],
            ["0.0", "0", "-0.1"]
        );
        assert_eq!(
            [point.signed(-0.004, 2), point.signed(-0.01, 2), point.plain(-0.0)],
            ["+0.00", "-0.01", "0"]
        );
        assert_eq!([point.fixed(-10.0, 0), point.plain(f64::NEG_INFINITY)], ["-10", "-inf"]);
    }

    #[test]
    fn numbers_are_written_with_the_chosen_sign_and_read_with_both() {
        let written =
            |of: DecimalSeparator| [of.fixed(1.26, 1), of.signed(2.0, 2), of.plain(0.5), of.tenths(-0.01)];
        assert_eq!(written(DecimalSeparator::Point), ["1.3", "+2.00", "0.5", "0.0"]);
        assert_eq!(written(DecimalSeparator::Comma), ["1,3", "+2,00", "0,5", "0,0"]);
        assert_eq!(
            [" 12,5 ", "12.5", "\u{2212}3", "1,2,3", "x"].map(typed),
            [Some(12.5), Some(12.5), Some(-3.0), None, None]
        );
    }
}
