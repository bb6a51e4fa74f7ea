//! The window: a live run or a log, its settings, event loop and painter, and pictures of it without a display.

mod body_colours;
mod compared_curves;
mod display_loss;
mod editor;
mod error;
mod event_loop;
mod figures;
mod frame_times;
mod gamepads;
mod loading;
mod opening;
mod painter;
mod panels;
mod path_figures;
mod picture;
mod recorded_runs;
mod recording;
mod scenario_info;
mod settings;
mod surface;
mod unused;
mod video;
mod viewer;

pub use error::WindowError;
pub use event_loop::open;
pub use frame_times::{FrameTimes, frame_times};
pub use picture::{WindowPicture, picture};
pub use recording::{LogLocation, RecordedRun, SessionEnds};

use crate::ui::{CameraMode, CityKind, Look, QualityPreset, Theme};
use city3d_render::{AdapterPreference, Context};
use city3d_sensors::Weather;
use city3d_session::playback::Player;
use city3d_session::{SessionError, SessionHandle, Speed};
use city3d_simulation::scenario::{Experiment, ScenarioRequest, TimeOfDay};
use recording::RecordingOptions;
use settings::ViewSettings;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use viewer::ViewerState;

/// What the window shows.
#[derive(Clone, Debug)]
pub enum WindowSubject {
    /// A live run of a scenario.
    Scenario(ScenarioSubject),
    /// A session that somebody else has started: a served city, or one elsewhere.
    City(CitySubject),
    /// The log of a recorded run.
    Log(PathBuf),
}

/// A session that was started before the window.
#[derive(Clone, Debug)]
pub struct CitySubject {
    /// The scenario with its vehicles: what the window knows of the city before it is told.
    pub experiment: Arc<Experiment>,
    /// The scenario as it was requested.
    pub request: ScenarioRequest,
    /// Where the city runs.
    pub kind: CityKind,
    /// The session; a window that opens takes it.
    pub session: Arc<Mutex<Option<SessionHandle>>>,
}

impl CitySubject {
    /// A subject of a session.
    pub fn new(
        session: SessionHandle,
        (request, experiment): (ScenarioRequest, Arc<Experiment>),
        kind: CityKind,
    ) -> Self {
        Self { experiment, request, kind, session: Arc::new(Mutex::new(Some(session))) }
    }

    /// Takes the session, once.
    pub fn take(&self) -> Option<SessionHandle> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// A scenario that the window runs.
#[derive(Clone, Debug)]
pub struct ScenarioSubject {
    /// The scenario, and the settings that replace its own.
    pub request: ScenarioRequest,
    /// Where its runs are recorded.
    pub logs: LogLocation,
    /// Multiple of real time; `None` for the stored one.
    pub speed: Option<Speed>,
    /// Whether the run starts at once.
    pub starts: bool,
    /// Whether the window begins with its start page: nobody has named a scenario.
    pub has_start_page: bool,
    /// Whether a person drives the selected vehicle in a picture of the window.
    pub is_driven: bool,
}

/// Quality of the pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum QualityChoice {
    /// The stored one, or else that of the adapter.
    #[default]
    Stored,
    /// By the adapter: low without a GPU, high with one.
    Auto,
    /// This preset; the stored one and the adapter do not matter.
    Preset(QualityPreset),
}

/// How the window looks at first.
#[derive(Clone, Debug, Default)]
pub struct WindowOptions {
    /// The adapter; by default that of the environment.
    pub adapter: Option<AdapterPreference>,
    /// How the quality preset is chosen.
    pub quality: QualityChoice,
    /// Time of day; by default the scenario's.
    pub time: Option<TimeOfDay>,
    /// Weather; by default the scenario's.
    pub weather: Option<Weather>,
    /// Pixels; by default the last one.
    pub size: Option<[u32; 2]>,
    /// Stored settings are neither read nor written.
    pub is_fresh: bool,
    /// Simulated time of a picture, or at which a log opens.
    pub at_s: Option<f64>,
    /// Vehicle to select, by name or id.
    pub select: Option<String>,
    /// Vehicles whose previews to open, by name or id.
    pub previews: Vec<String>,
    /// Camera of the large view; by default the last one, or the chase camera of a driven vehicle.
    pub mode: Option<CameraMode>,
    /// The panel Traffic is open.
    pub traffic: bool,
    /// Theme of the panels; by default the stored one.
    pub theme: Option<Theme>,
    /// Size of texts and widgets, 1 is usual; by default the stored one.
    pub ui_scale: Option<f32>,
    /// Closes the window from elsewhere.
    pub quit: QuitSignal,
    /// Who else is told of the sessions that the window starts.
    pub ends: Option<Arc<dyn SessionEnds>>,
}

/// Tells a window to close. It may come before the window.
#[derive(Clone, Default)]
pub struct QuitSignal(Arc<Mutex<QuitState>>);

#[derive(Default)]
struct QuitState {
    is_given: bool,
    told: Option<Box<dyn Fn() + Send>>,
}

impl QuitSignal {
    /// Closes the window.
    pub fn give(&self) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        state.is_given = true;
        if let Some(told) = &state.told {
            told();
        }
    }

    /// Calls this when the signal is given, at once if it was.
    fn tell(&self, told: Box<dyn Fn() + Send>) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if state.is_given {
            told();
        }
        state.told = Some(told);
    }
}

impl std::fmt::Debug for QuitSignal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("QuitSignal")
    }
}

impl WindowSubject {
    /// Builds the viewer state from options and stored settings.
    fn viewer(
        &self,
        options: &WindowOptions,
        context: &Context,
        settings: &ViewSettings,
        recording: RecordingOptions,
    ) -> Result<ViewerState, WindowError> {
        let mut viewer = match self {
            Self::Scenario(subject) => subject.viewer(options, context, settings, recording)?,
            Self::City(subject) => {
                let look = options.look(context, settings, &subject.experiment);
                let session = subject.take().ok_or(WindowError::End(SessionError::Ended))?;
                ViewerState::on_city(session, subject, look, recording)
            }
            Self::Log(log) => {
                let on_update = Arc::clone(&recording.on_update);
                let player = Player::open(log, Box::new(move || on_update()))?;
                let look = options.look(context, settings, player.experiment());
                ViewerState::on_log(player, log.display().to_string(), look, recording)
            }
        };
        viewer.restore(settings);
        let preferences = &mut viewer.state.preferences;
        preferences.theme = options.theme.unwrap_or(preferences.theme);
        preferences.scale = options.ui_scale.unwrap_or(preferences.scale);
        *preferences = preferences.sane();
        if let Self::Scenario(subject) = self
            && let Some(speed) = subject.speed.or(settings.speed.map(Speed::sane))
        {
            viewer.set_speed(speed);
        }
        viewer.set_adapter(context);
        Ok(viewer)
    }

    /// Where runs are recorded.
    fn logs(&self) -> LogLocation {
        match self {
            Self::Scenario(subject) => subject.logs.clone(),
            // Scenarios that are opened after the log are recorded.
            Self::Log(_) => LogLocation::OfTheUser,
            Self::City(_) => LogLocation::Nowhere,
        }
    }
}

impl ScenarioSubject {
    fn viewer(
        &self,
        options: &WindowOptions,
        context: &Context,
        settings: &ViewSettings,
        recording: RecordingOptions,
    ) -> Result<ViewerState, WindowError> {
        let experiment = loading::read(&self.request)?;
        let look = options.look(context, settings, &experiment);
        ViewerState::new(self.request.clone(), experiment, look, recording)
    }
}

impl WindowOptions {
    fn preference(&self) -> AdapterPreference {
        self.adapter.clone().unwrap_or_else(AdapterPreference::from_environment)
    }

    fn settings(&self) -> ViewSettings {
        if self.is_fresh { ViewSettings::default() } else { ViewSettings::load() }
    }

    fn look(&self, context: &Context, settings: &ViewSettings, usual: &Experiment) -> Look {
        let of_the_adapter = if context.is_software { QualityPreset::Low } else { QualityPreset::High };
        let preset = match self.quality {
            QualityChoice::Stored => settings.preset.unwrap_or(of_the_adapter),
            QualityChoice::Auto => of_the_adapter,
            QualityChoice::Preset(preset) => preset,
        };
        Look {
            preset,
            hours: self.time.unwrap_or(usual.time_of_day).hours,
            weather: self.weather.unwrap_or(usual.weather),
        }
    }
}
