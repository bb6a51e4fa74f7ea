//! Background loading: reads a scenario and builds its renderer on a thread.

use super::{WindowError, painter};
use crate::ui::Look;
use city3d_render::{Context, Renderer};
use city3d_simulation::scenario::{Experiment, ScenarioRequest};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// What to load.
#[derive(Clone, Debug)]
pub enum LoadRequest {
    /// The same city in another light or quality.
    Look(Arc<Experiment>, Look),
    /// Another scenario, at its own time of day.
    Scenario(ScenarioRequest, Look),
}

impl LoadRequest {
    /// What is being loaded, for the user.
    pub fn label(&self) -> String {
        match self {
            Self::Look(_, look) => format!("Preparing {} ...", look.label()),
            Self::Scenario(request, _) => format!("Loading {} ...", request.scenario),
        }
    }
}

/// The result of a load job.
pub struct LoadedView {
    /// `None` where the scenario stays the same.
    pub scenario: Option<(ScenarioRequest, Arc<Experiment>)>,
    /// Quality and time of day that the renderer was built for.
    pub look: Look,
    /// Renderer of the scenario's city in this look.
    pub city: Renderer,
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
            if outbox.send(load(request, &context)).is_ok() {
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

fn load(request: LoadRequest, context: &Context) -> Result<LoadedView, WindowError> {
    let (scenario, experiment, look) = match request {
        LoadRequest::Look(experiment, look) => (None, experiment, look),
        LoadRequest::Scenario(request, look) => {
            let experiment = city3d_session::load(&request)?;
            let look = Look { hours: experiment.time_of_day.hours, ..look };
            (Some((request, Arc::clone(&experiment))), experiment, look)
        }
    };
    let city = painter::renderer(context, &experiment, look)?;
    Ok(LoadedView { scenario, look, city })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::QualityPreset;
    use city3d_render::AdapterPreference;
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
        let context = match Context::headless(&AdapterPreference::parse("software")) {
            Ok(context) => context,
            Err(error) => {
                assert!(std::env::var_os("CI").is_none(), "{error}");
                eprintln!("SKIPPED: {error}");
                return;
            }
        };
        let look = Look { preset: QualityPreset::Low, hours: 3.0 };
        let args = |name: &str| ScenarioRequest { scenario: name.to_owned(), ..ScenarioRequest::default() };
        let start = Instant::now();
        let (begun, outcome) = finish(LoadRequest::Scenario(args("straight"), look), &context);
        let loaded = outcome.map_err(|error| error.to_string()).unwrap();
        assert!(begun * 4 < start.elapsed(), "{begun:?} of {:?}", start.elapsed());
        let (_, experiment) = loaded.scenario.unwrap();
        assert_eq!((experiment.name.as_str(), loaded.look.hours), ("straight", 12.0));
        let (_, outcome) = finish(LoadRequest::Look(experiment, look), &context);
        assert!(outcome.is_ok_and(|loaded| loaded.scenario.is_none() && loaded.look == look));
        let (_, outcome) = finish(LoadRequest::Scenario(args("nowhere"), look), &context);
        assert!(outcome.is_err_and(|error| error.to_string().contains("nowhere")));
    }
}
