//! Problems of a scenario in the units of the fields: the file has laboratory units.

use crate::ui::{DecimalSeparator, SpeedUnit};
use city3d_geometry::LengthScale;

/// A problem with its lengths and speeds at full scale, where they have a unit; `None` where nothing is told by a unit.
pub(super) fn full_scale(
    problem: &str,
    scale: LengthScale,
    (units, decimal): (SpeedUnit, DecimalSeparator),
) -> Option<String> {
    let words: Vec<&str> = problem.split(' ').collect();
    let mut told: Vec<String> = Vec::new();
    let mut has_changed = false;
    for (k, word) in words.iter().enumerate() {
        let unit = words.get(k + 1).map_or("", |next| next.trim_end_matches([',', ';', '.', ':']));
        let before = k.checked_sub(1).map_or("", |before| words[before]);
        let changed = match (word.parse::<f64>(), unit) {
            (Ok(mps), "m/s") => Some(units.number(scale.city_from_lab(mps), scale, decimal)),
            (Ok(m), "m") => Some(decimal.fixed(scale.city_from_lab(m), 1)),
            _ if word.starts_with("m/s") && before.parse::<f64>().is_ok() => {
                Some(word.replacen("m/s", units.label(), 1))
            }
            _ if word.starts_with("min_acceleration_mps2") => {
                Some(word.replacen("min_acceleration_mps2", "its driver does", 1))
            }
            _ => None,
        };
        has_changed |= changed.is_some();
        told.push(changed.unwrap_or_else(|| (*word).to_owned()));
    }
    has_changed.then(|| told.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_is_told_in_the_units_of_the_fields() {
        let scale = LengthScale::new(25.0).unwrap();
        let style = (SpeedUnit::KmPerHour, DecimalSeparator::Point);
        let problem = "leader: at 0.2 m/s and 0.20 m behind obstacle4 it would have to brake harder than \
                       min_acceleration_mps2; start further back, or at 0.11 m/s or slower";
        let told = "leader: at 18.0 km/h and 5.0 m behind obstacle4 it would have to brake harder than its driver \
                    does; start further back, or at 9.9 km/h or slower";
        assert_eq!(full_scale(problem, scale, style).as_deref(), Some(told));
        assert_eq!(full_scale("at_m is 30; vehicle4 is unknown", scale, style), None);
    }
}
