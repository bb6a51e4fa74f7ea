//! Background loading: reads a scenario or a log, and builds the renderer of its city, on a thread.

use super::opening::{OpenTarget, Opening};
use super::{WindowError, painter};
use crate::ui::Look;
use city3d_render::{Context, Renderer};
use city3d_session::LoadError;
use city3d_session::playback::Player;
use city3d_simulation::scenario::{Experiment, ScenarioRequest, is_map, map_alone};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// What to load.
#[derive(Clone, Debug)]
pub enum LoadRequest {
    /// The same city in another light or quality.
    Look(Arc<Experiment>, Look),
    /// Another scenario, or a log.
    Open(Opening, ShownCity),
}

/// The city that a window shows already.
#[derive(Clone, Debug)]
pub struct ShownCity {
    /// Its experiment.
    pub experiment: Arc<Experiment>,
    /// Quality and time of day of its renderer.
    pub look: Look,
}

impl LoadRequest {
    /// What is being loaded, for the user.
    pub fn label(&self) -> String {
        match self {
            Self::Look(_, look) => format!("Preparing {} ...", look.label()),
            Self::Open(opening, _) => format!("Loading {} ...", opening.name()),
        }
    }
}

/// What a load job has opened.
pub enum Opened {
    /// A scenario, and whether its run starts at once.
    Scenario(ScenarioRequest, Arc<Experiment>, bool),
    /// A log.
    Log(PathBuf, Box<Player>),
}

/// The result of a load job.
pub struct LoadedView {
    /// `None` where the scenario stays the same.
    pub opened: Option<Opened>,
    /// Quality and time of day of the pictures.
    pub look: Look,
    /// Renderer of the city in this look; `None` where the one that is there shows it.
    pub city: Option<Renderer>,
}

/// A running load job.
pub struct LoadJob {
    outcome: Receiver<Result<LoadedView, WindowError>>,
}

impl LoadJob {
    /// `on_update` is called on the thread when it is done.
    ///
    /// # Errors
    /// Where no thread can be had.
    pub fn begin(
        request: LoadRequest,
        context: &Context,
        on_update: Arc<dyn Fn() + Send + Sync>,
    ) -> Result<Self, WindowError> {
        let (outbox, outcome) = sync_channel(1);
        let context = context.clone();
        let work = move || {
            // The window may have been closed.
            if outbox.send(load(request, &context, &on_update)).is_ok() {
                on_update();
            }
        };
        let thread = std::thread::Builder::new().name("loading".to_owned()).spawn(work);
        thread.map(|_| Self { outcome }).map_err(WindowError::Thread)
    }

    /// The result, once the job is done.
    pub fn try_finish(&self) -> Option<Result<LoadedView, WindowError>> {
        match self.outcome.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(WindowError::LoadingEnded)),
        }
    }
}

/// Reads a scenario, or a map alone.
///
/// # Errors
/// When it cannot be read, or has problems; each has its place and remedy.
pub fn read(request: &ScenarioRequest) -> Result<Arc<Experiment>, LoadError> {
    if is_map(request) { Ok(Arc::new(map_alone(request)?)) } else { city3d_session::load(request) }
}

fn load(
    request: LoadRequest,
    context: &Context,
    on_update: &Arc<dyn Fn() + Send + Sync>,
) -> Result<LoadedView, WindowError> {
    let (opening, shown) = match request {
        LoadRequest::Look(experiment, look) => {
            let city = Some(painter::renderer(context, &experiment, look)?);
            return Ok(LoadedView { opened: None, look, city });
        }
        LoadRequest::Open(opening, shown) => (opening, shown),
    };
    let (opened, experiment) = match opening.target {
        OpenTarget::Scenario(request) => {
            let experiment = read(&request)?;
            (Opened::Scenario(request, Arc::clone(&experiment), opening.starts), experiment)
        }
        OpenTarget::Log(log) => {
            let on_update = Arc::clone(on_update);
            let player = Player::open(&log, Box::new(move || on_update()))?;
            let experiment = Arc::clone(player.experiment());
            (Opened::Log(log, Box::new(player)), experiment)
        }
    };
    let hours = opening.hours.unwrap_or(experiment.time_of_day.hours);
    let weather = opening.weather.unwrap_or(experiment.weather);
    let look = Look { hours, weather, ..shown.look };
    let is_shown = look == shown.look && have_same_scene(&experiment, &shown.experiment);
    let city = if is_shown { None } else { Some(painter::renderer(context, &experiment, look)?) };
    Ok(LoadedView { opened: Some(opened), look, city })
}

/// Whether two experiments look alike but for their vehicles: the same map with the same lines and signal heads, which scenarios
/// may change, and no models of the user's.
fn have_same_scene(a: &Experiment, b: &Experiment) -> bool {
    let has_models = |experiment: &Experiment| {
        !experiment.models.vehicles.is_empty() || !experiment.models.files.is_empty()
    };
    a.city_map == b.city_map && a.scale == b.scale && !has_models(a) && !has_models(b)
}

/// The software adapter for a test; without one the test is skipped, and fails in CI.
#[cfg(test)]
pub(super) fn software_context() -> Option<Context> {
    match Context::headless(&city3d_render::AdapterPreference::parse("software")) {
        Ok(context) => Some(context),
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "{error}");
            eprintln!("SKIPPED: {error}");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::QualityPreset;
    use city3d_sensors::Weather;
    use std::time::{Duration, Instant};

    fn finish(request: LoadRequest, context: &Context) -> (Duration, Result<LoadedView, WindowError>) {
        let start = Instant::now();
        let loading = LoadJob::begin(request, context, Arc::new(|| {})).unwrap();
        let begun = start.elapsed();
        loop {
            if let Some(outcome) = loading.try_finish() {
                return (begun, outcome);
            }
            assert!(start.elapsed() < Duration::from_secs(120), "it never ends");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn another_scenario_is_loaded_while_nobody_waits_and_a_wrong_one_is_told() {
        let Some(context) = software_context() else { return };
        let look = Look { preset: QualityPreset::Low, hours: 3.0, weather: Weather::Rain };
        let args = |name: &str| ScenarioRequest { scenario: name.to_owned(), ..ScenarioRequest::default() };
        let shown = ShownCity { experiment: read(&args("merge")).unwrap(), look };
        let open = |name: &str, shown: &ShownCity| {
            LoadRequest::Open(Opening::scenario(args(name)), ShownCity::clone(shown))
        };
        let start = Instant::now();
        let (begun, outcome) = finish(open("straight", &shown), &context);
        let loaded = outcome.map_err(|error| error.to_string()).unwrap();
        assert!(begun * 4 < start.elapsed(), "{begun:?} of {:?}", start.elapsed());
        let Some(Opened::Scenario(_, experiment, false)) = loaded.opened else { panic!("a scenario") };
        assert_eq!((experiment.name.as_str(), loaded.look.hours), ("straight", 12.0));
        assert_eq!(loaded.look.weather, Weather::Clear, "that of the scenario");
        assert!(loaded.city.is_some());
        let shown = ShownCity { experiment: Arc::clone(&experiment), look: loaded.look };
        let (_, outcome) = finish(LoadRequest::Look(experiment, look), &context);
        assert!(outcome.is_ok_and(|loaded| loaded.opened.is_none() && loaded.look == look));
        let (_, outcome) = finish(open("nowhere", &shown), &context);
        assert!(outcome.is_err_and(|error| error.to_string().contains("nowhere")));
        // One map, with yield lines in the one scenario and signals in the other.
        let crossing = |name: &str| read(&args(name)).unwrap();
        assert!(!have_same_scene(&crossing("intersection"), &crossing("intersection-signals")));
        // The same streets in the same light are not built again.
        let (_, outcome) = finish(open("roundabout", &shown), &context);
        assert!(outcome.is_ok_and(|loaded| loaded.city.is_none()));
    }
}
