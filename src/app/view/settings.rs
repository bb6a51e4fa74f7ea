//! What the window remembers between runs, in a file of the user's.

use crate::ui::{Layers, Mode, Preset, Table};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Of the window, pixels.
    pub size: Option<[u32; 2]>,
    /// `None` as long as the user has not chosen: what suits the adapter.
    pub preset: Option<Preset>,
    pub mode: Mode,
    pub layers: Layers,
    pub table: Table,
}

impl Settings {
    /// Those of the last time, or the usual ones where there are none that can be read.
    pub fn load() -> Self {
        let Some(path) = file() else { return Self::default() };
        let Ok(text) = std::fs::read_to_string(&path) else { return Self::default() };
        toml::from_str(&text).unwrap_or_else(|error| {
            tracing::warn!("{}: not used: {error}", path.display());
            Self::default()
        })
    }

    /// Keeps them for the next time. A folder that cannot be written is no reason to fail.
    pub fn save(&self) {
        let Some(path) = file() else { return };
        if let Err(error) = self.write(&path) {
            tracing::warn!("{}: settings are not kept: {error}", path.display());
        }
    }

    fn write(&self, path: &Path) -> std::io::Result<()> {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let text = toml::to_string_pretty(self).map_err(std::io::Error::other)?;
        std::fs::write(path, text)
    }
}

fn file() -> Option<PathBuf> {
    folder("XDG_CONFIG_HOME", ".config").map(|folder| folder.join("city3d").join("view.toml"))
}

/// A new folder for the logs of a window on a scenario.
pub fn log_folder(scenario: &str) -> Option<PathBuf> {
    let stem = Path::new(scenario).file_stem()?.to_string_lossy().into_owned();
    let seconds = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).ok()?.as_secs();
    let [year, month, day] = date(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    let name = format!("{stem}-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}");
    folder("XDG_DATA_HOME", ".local/share").map(|folder| folder.join("city3d").join("runs").join(name))
}

/// A folder of the user's: by a variable, else in the home folder, on Windows in `APPDATA`.
fn folder(variable: &str, in_home: &str) -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    set(variable).or_else(|| set("APPDATA")).or_else(|| Some(set("HOME")?.join(in_home)))
}

/// Year, month and day of a number of days since 1 January 1970 (UTC).
fn date(days: u64) -> [u64; 3] {
    let is_leap =
        |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let (mut year, mut left) = (1970, days);
    loop {
        let length = if is_leap(year) { 366 } else { 365 };
        if left < length {
            break;
        }
        left -= length;
        year += 1;
    }
    let february = if is_leap(year) { 29 } else { 28 };
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        if left < length {
            break;
        }
        left -= length;
        month += 1;
    }
    [year, month, left + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_become_dates() {
        assert_eq!(date(0), [1970, 1, 1]);
        assert_eq!(date(59), [1970, 3, 1]);
        assert_eq!(date(11_016), [2000, 2, 29]);
        assert_eq!(date(20_819), [2027, 1, 1]);
    }

    #[test]
    fn settings_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new").join("view.toml");
        let settings = Settings {
            size: Some([1600, 900]),
            preset: Some(Preset::Medium),
            mode: Mode::Overhead,
            layers: Layers { lanes: true, labels: false, ..Layers::default() },
            table: Table { descending: true, ..Table::default() },
        };
        settings.write(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(toml::from_str::<Settings>(&text).unwrap(), settings);
        assert_eq!(toml::from_str::<Settings>("from_a_later_version = 1").unwrap(), Settings::default());
    }
}
