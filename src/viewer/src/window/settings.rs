//! Settings of the window that are stored between sessions, in the user's configuration folder.

use super::unused::unused;
use crate::cockpit::DeviceProfile;
use crate::ui::{
    Bookmarks, CameraMode, KeyMap, Layers, Preferences, PreviewCamera, QualityPreset, StoredLayout,
    TableState, VideoSubject,
};
use city3d_outputs::WholeFile;
use city3d_session::Speed;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Shortest and longest edge of a window, pixels.
const SMALLEST_EDGE: u32 = 240;
const LARGEST_EDGE: u32 = 8192;

/// Layout and choices of the last window: `view.toml`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewSettings {
    /// Size of the window, pixels.
    pub size: Option<[u32; 2]>,
    /// `None` until the user chooses: the adapter decides.
    pub preset: Option<QualityPreset>,
    /// Camera of the large view.
    pub mode: CameraMode,
    /// Files that were opened last, the latest first.
    pub recent: Vec<PathBuf>,
    /// `None` until the user chooses.
    pub speed: Option<Speed>,
    /// What videos show.
    pub video_subject: VideoSubject,
    /// Overlays of the city view.
    pub layers: Layers,
    /// Sort column and direction of the table of vehicles; its filter is not stored.
    pub table: TableState,
    /// Theme, status colours, size of the interface and units.
    pub preferences: Preferences,
    /// Keys that the user has assigned.
    pub keys: KeyMap,
    /// Places of the panels, and which are open; the usual ones until the user has closed a window.
    pub layout: Option<StoredLayout>,
    /// What was watched in the last live run.
    pub views: WatchedVehicles,
    /// Stored cameras of the large view.
    pub bookmarks: Bookmarks,
}

/// Followed vehicle and open previews of one scenario, by vehicle name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct WatchedVehicles {
    /// The scenario as it was requested; the views apply to no other.
    pub scenario: String,
    /// `None` where the camera followed no vehicle.
    pub followed: Option<String>,
    /// Vehicle and camera of each open preview, from top to bottom.
    pub previews: Vec<(String, PreviewCamera)>,
}

impl ViewSettings {
    /// Loads the stored settings, or the defaults.
    pub fn load() -> Self {
        let settings: Self = file("view.toml").map(|path| read(&path)).unwrap_or_default();
        settings.with_sane_size()
    }

    /// The settings, with a size that a window can have.
    fn with_sane_size(self) -> Self {
        let size = self.size.map(|[width, height]| {
            let sane = [width, height].map(|edge| edge.clamp(SMALLEST_EDGE, LARGEST_EDGE));
            if sane != [width, height] {
                let [w, h] = sane;
                tracing::warn!("view.toml: no window is {width} x {height} pixels; it opens with {w} x {h}");
            }
            sane
        });
        Self { size, ..self }
    }

    /// Stores the settings.
    pub fn save(&self) {
        keep("view.toml", self);
    }
}

/// Device mappings by device key.
pub type Profiles = BTreeMap<String, DeviceProfile>;

/// Loads the mappings from `devices.toml`; none where the file is missing or cannot be read.
pub fn load_profiles() -> Profiles {
    file("devices.toml").map(|path| read(&path)).unwrap_or_default()
}

/// Stores the mappings in `devices.toml`; a failure is only logged.
pub fn save_profiles(profiles: &Profiles) {
    keep("devices.toml", profiles);
}

/// Reads a file, or returns the default.
fn read<T: Default + DeserializeOwned>(path: &Path) -> T {
    let Ok(text) = std::fs::read_to_string(path) else { return T::default() };
    toml::from_str(&text).unwrap_or_else(|error| {
        tracing::warn!("{}: the stored settings are ignored: {error}", path.display());
        T::default()
    })
}

/// Writes a file of the user's. A folder that cannot be written is no reason to fail.
fn keep(name: &str, value: &impl Serialize) {
    let Some(path) = file(name) else { return };
    if let Err(error) = write(&path, value) {
        tracing::warn!("{}: the settings cannot be stored: {error}", path.display());
    }
}

fn write(path: &Path, value: &impl Serialize) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let text = toml::to_string_pretty(value).map_err(std::io::Error::other)?;
    WholeFile::write(path, text.as_bytes())
}

fn file(name: &str) -> Option<PathBuf> {
    folder("XDG_CONFIG_HOME", ".config").map(|folder| folder.join("city3d").join(name))
}

/// The folder of the runs that windows have recorded.
pub fn runs_folder() -> Option<PathBuf> {
    Some(folder("XDG_DATA_HOME", ".local/share")?.join("city3d").join("runs"))
}

/// A new folder for the logs of a window on a scenario.
pub fn log_folder(scenario: &str) -> Option<PathBuf> {
    let stem = Path::new(scenario).file_stem()?.to_string_lossy().into_owned();
    let seconds = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).ok()?.as_secs();
    let [year, month, day] = date(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    let name = format!("{stem}-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}");
    Some(unused(&runs_folder()?, &name, ""))
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
    use crate::cockpit::{ControlFunction, DeviceControl, LeverCalibration};
    use crate::ui::{DecimalSeparator, Layout, OpenPanels, Theme, Viewpoint, bindings};
    use city3d_protocol::snapshot::FrameSnapshot;

    #[test]
    fn no_stored_size_is_one_that_a_window_cannot_have() {
        let of = |size| ViewSettings { size, ..ViewSettings::default() }.with_sane_size().size;
        assert_eq!(of(Some([u32::MAX, u32::MAX])), Some([8192, 8192]));
        assert_eq!(of(Some([0, 900])), Some([240, 900]));
        assert_eq!(of(Some([1600, 900])), Some([1600, 900]));
        assert_eq!(of(None), None);
    }

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
        let mut bookmarks = Bookmarks::default();
        bookmarks.set(3, &Viewpoint::around(&FrameSnapshot::default()));
        let mut keys = KeyMap::default();
        let quit = bindings().find(|binding| binding.name == "Quit").unwrap();
        keys.assign(&quit, crate::ui::commands::HELP.usual_keys.to_vec());
        let settings = ViewSettings {
            size: Some([1600, 900]),
            preset: Some(QualityPreset::Medium),
            mode: CameraMode::Overhead,
            recent: vec!["/home/me/mine.toml".into()],
            layers: Layers { lanes: true, labels: false, ..Layers::default() },
            table: TableState { descending: true, ..TableState::default() },
            speed: Some(Speed::Times(2.0)),
            preferences: Preferences {
                theme: Theme::Light,
                scale: 1.5,
                decimal: DecimalSeparator::Comma,
                ..Preferences::default()
            },
            video_subject: VideoSubject::City,
            keys,
            layout: Layout::default().stored(OpenPanels { traffic: true, ..OpenPanels::default() }),
            views: WatchedVehicles {
                scenario: "roundabout".to_owned(),
                followed: Some("path1_a".to_owned()),
                previews: vec![
                    ("path1_b".to_owned(), PreviewCamera::Rear),
                    ("path1_a".to_owned(), PreviewCamera::Own(1)),
                ],
            },
            bookmarks,
        };
        write(&path, &settings).unwrap();
        assert_eq!(read::<ViewSettings>(&path), settings);
        std::fs::write(&path, "from_a_later_version = 1").unwrap();
        assert_eq!(read::<ViewSettings>(&path), ViewSettings::default());
        std::fs::write(&path, "size = [").unwrap();
        assert_eq!(read::<ViewSettings>(&path), ViewSettings::default());
    }

    #[test]
    fn what_was_assigned_on_a_device_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("devices.toml");
        let axis = DeviceControl::Axis(0x0003_0002);
        let pedal = LeverCalibration { control: axis, rest: 0.987_654_321, full: -0.9, dead_zone: 0.03 };
        let buttons = [(ControlFunction::TakeWheel, DeviceControl::Button(0x0001_0120))];
        let mut profile = DeviceProfile::usual(Some(DeviceControl::Axis(0x0003_0000)), true, &buttons);
        profile.levers.insert(ControlFunction::Gas, pedal);
        let profiles = Profiles::from([("Wheel \"G\" 0300".to_owned(), profile)]);
        write(&path, &profiles).unwrap();
        assert_eq!(read::<Profiles>(&path), profiles);
    }
}
