//! Background loading: reads a scenario and builds its renderer on a thread.

use super::super::{Failure, ScenarioArgs, load};
use super::painter;
use crate::render::{Context, Renderer};
use crate::scenario::Experiment;
use crate::ui::Look;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// What to load.
#[derive(Clone, Debug)]
pub enum LoadRequest {
    /// The same city in another light or quality.
    Look(Arc<Experiment>, Look),
    /// Another scenario, at its own time of day.
    Scenario(ScenarioArgs, Look),
}

impl LoadRequest {
    pub fn label(&self) -> String {
        match self {
            Self::Look(_, look) => format!("Preparing {} ...", look.label()),
            Self::Scenario(args, _) => format!("Loading {} ...", args.scenario),
        }
    }
}

/// The result of a load job.
pub struct LoadedView {
    /// `None` where the scenario stays the same.
    pub scenario: Option<(ScenarioArgs, Arc<Experiment>)>,
    pub look: Look,
    pub city: Renderer,
}

/// A running load job.
pub struct LoadJob {
    outcome: Receiver<Result<LoadedView, Failure>>,
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
    ) -> Result<Self, Failure> {
        let (outbox, outcome) = sync_channel(1);
        let context = context.clone();
        let work = move || {
            // The window may have been closed.
            if outbox.send(load(request, &context)).is_ok() {
                on_update();
            }
        };
        let thread = std::thread::Builder::new().name("loading".to_owned()).spawn(work);
        thread.map(|_| Self { outcome }).map_err(Failure::failed)
    }

    /// The result, once the job is done.
    pub fn try_finish(&self) -> Option<Result<LoadedView, Failure>> {
        match self.outcome.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(Failure::failed("loading ended early"))),
        }
    }
}

fn load(request: LoadRequest, context: &Context) -> Result<LoadedView, Failure> {
    let (scenario, experiment, look) = match request {
        LoadRequest::Look(experiment, look) => (None, experiment, look),
        LoadRequest::Scenario(args, look) => {
            let experiment = load::experiment(&args)?;
            let look = Look { hours: experiment.time_of_day.hours, ..look };
            (Some((args, Arc::clone(&experiment))), experiment, look)
        }
    };
    let city = painter::renderer(context, &experiment, look)?;
    Ok(LoadedView { scenario, look, city })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::AdapterPreference;
    use crate::ui::QualityPreset;
    use std::time::{Duration, Instant};

    fn finish(request: LoadRequest, context: &Context) -> (Duration, Result<LoadedView, Failure>) {
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
        let args = |name: &str| ScenarioArgs { scenario: name.to_owned(), ..ScenarioArgs::default() };
        let start = Instant::now();
        let (begun, outcome) = finish(LoadRequest::Scenario(args("straight"), look), &context);
        let loaded = outcome.map_err(|failure| failure.message).unwrap();
        assert!(begun * 4 < start.elapsed(), "{begun:?} of {:?}", start.elapsed());
        let (_, experiment) = loaded.scenario.unwrap();
        assert_eq!((experiment.name.as_str(), loaded.look.hours), ("straight", 12.0));
        let (_, outcome) = finish(LoadRequest::Look(experiment, look), &context);
        assert!(outcome.is_ok_and(|loaded| loaded.scenario.is_none() && loaded.look == look));
        let (_, outcome) = finish(LoadRequest::Scenario(args("nowhere"), look), &context);
        assert!(outcome.is_err_and(|failure| failure.message.contains("nowhere")));
    }
}
