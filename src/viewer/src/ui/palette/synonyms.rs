//! Words that users of other programs type, and those that actions of this one are called by.

/// What is typed, and what its action has in its name or among its other words.
const SYNONYMS: [(&str, &str); 76] = [
    ("accident", "collision"),
    ("agent", "vehicle"),
    ("autopilot", "release"),
    ("bbox", "boxes"),
    ("bird's", "overhead"),
    ("birds", "overhead"),
    ("bounding", "boxes"),
    ("brightness", "contrast"),
    ("brightness", "theme"),
    ("brightness", "time of day"),
    ("browse", "file"),
    ("capture", "screenshot"),
    ("car", "vehicle"),
    ("clock", "time of day"),
    ("compass", "north"),
    ("crash", "collision"),
    ("day", "time of day"),
    ("daylight", "time of day"),
    ("debug", "inspector"),
    ("destination", "route"),
    ("directory", "file"),
    ("directory", "recorded runs"),
    ("distance", "gaps"),
    ("dpi", "interface"),
    ("ego", "selected vehicle"),
    ("excel", "csv"),
    ("explain", "inspector"),
    ("find", "select"),
    ("folder", "file"),
    ("folder", "recorded runs"),
    ("font", "interface"),
    ("fps", "quality"),
    ("graph", "chart"),
    ("graphics", "quality"),
    ("heatmap", "colour labels"),
    ("hotkey", "keys"),
    ("hour", "time of day"),
    ("hud", "labels"),
    ("info", "inspector"),
    ("joystick", "gamepad"),
    ("kmh", "km/h"),
    ("kph", "km/h"),
    ("latency", "environment"),
    ("locate", "select"),
    ("log", "recorded runs"),
    ("metric", "traffic"),
    ("minimap", "map"),
    ("mph", "km/h"),
    ("mps", "m/s"),
    ("noise", "environment"),
    ("overlay", "layers"),
    ("performance", "quality"),
    ("plot", "chart"),
    ("pov", "onboard"),
    ("resolution", "quality"),
    ("rewind", "back"),
    ("satellite", "overhead"),
    ("shortcut", "keys"),
    ("slow", "inspector"),
    ("snapshot", "screenshot"),
    ("snow", "weather"),
    ("spreadsheet", "csv"),
    ("statistics", "traffic"),
    ("storm", "weather"),
    ("sunny", "time of day"),
    ("sunny", "weather"),
    ("sunset", "time of day"),
    ("take", "screenshot"),
    ("takeover", "take control"),
    ("text size", "interface"),
    ("trajectory", "way ahead"),
    ("unit", "speeds in"),
    ("velocity", "speed"),
    ("visibility", "weather"),
    ("wheel", "gamepad"),
    ("why", "inspector"),
];

/// Words of questions, which say nothing of what is asked for.
pub(super) const OF_QUESTIONS: [&str; 17] = [
    "is", "are", "my", "the", "a", "an", "how", "to", "do", "does", "i", "can", "what", "of", "it", "me",
    "want",
];

/// Shorter beginnings of words would mean too much.
pub(super) const LEAST_LETTERS: usize = 3;

/// Whether a typed word, or the beginning of one, means something that a text says in other words. All in lower case.
pub(super) fn means(word: &str, text: &str) -> bool {
    word.len() >= LEAST_LETTERS
        && SYNONYMS.iter().any(|(typed, called)| typed.starts_with(word) && text.contains(called))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beginnings_of_usual_words_mean_what_this_program_calls_otherwise() {
        assert!(means("folder", "open a scenario, a map or a log load import file"));
        assert!(means("bright", "time of day: noon") && means("mph", "speeds in km/h"));
        assert!(!means("br", "time of day: noon") && !means("brightest", "time of day: noon"));
        assert!(!means("folder", "weather: fog"));
    }
}
