//! Parsers of option values, with what would be right in place of a wrong one.

#![cfg_attr(not(feature = "render"), allow(dead_code, reason = "some are of commands that draw"))]

use city3d_simulation::scenario::MOST_SEED;

/// Longest edge of a picture that can be asked for.
const LARGEST_EDGE: u32 = 8192;

pub fn size(text: &str) -> Result<[u32; 2], String> {
    let edge = |text: &str| text.parse().ok().filter(|edge| (1..=LARGEST_EDGE).contains(edge));
    let parts = text.split_once(['x', 'X']).and_then(|(w, h)| edge(w).zip(edge(h)));
    parts.map(|(w, h)| [w, h]).ok_or_else(|| {
        format!("a width and a height from 1 to {LARGEST_EDGE} pixels are needed, as in 640x480")
    })
}

pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("a number above 0 is needed".to_owned()),
    }
}

/// Farthest place from the middle of the city, and longest distance, that a camera can be given.
const FARTHEST_M: f64 = 100_000.0;

/// A coordinate in the city.
pub fn coordinate(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|metres: &f64| metres.abs() <= FARTHEST_M)
}

pub fn camera_distance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(metres) if (0.1..=FARTHEST_M).contains(&metres) => Ok(metres),
        _ => Err(format!("a number of metres between 0.1 and {FARTHEST_M} is needed")),
    }
}

pub fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number >= 0.0 => Ok(number),
        _ => Err("a number of at least 0 is needed".to_owned()),
    }
}

pub fn pace(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(factor) if (0.001..=1e6).contains(&factor) => Ok(factor),
        _ => Err("a factor between 0.001 and 1000000 is needed".to_owned()),
    }
}

pub fn duration(text: &str) -> Result<f64, String> {
    // As in a scenario: traffic draws its routes for the whole of it.
    match text.parse::<f64>() {
        Ok(seconds) if (0.01..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("a number of seconds between 0.01 and 86400 is needed".to_owned()),
    }
}

/// A seed, as a scenario may have it: TOML has no larger integers.
pub fn seed(text: &str) -> Result<u64, String> {
    match text.parse::<u64>() {
        Ok(seed) if seed <= MOST_SEED => Ok(seed),
        _ => Err(format!("a whole number from 0 to {MOST_SEED} is needed")),
    }
}
