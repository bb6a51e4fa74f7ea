//! What takes a second is done on a thread: reading another scenario, building what draws its city.

use super::super::{Failure, ScenarioArgs, load};
use super::stage;
use crate::render::{Context, Renderer};
use crate::scenario::Experiment;
use crate::ui::Look;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// What is to be shown from now on.
#[derive(Clone, Debug)]
pub enum Request {
    /// The same city in another light or quality.
    Look(Arc<Experiment>, Look),
    /// Another scenario, at its own time of day.
    Scenario(ScenarioArgs, Look),
}

impl Request {
    pub fn label(&self) -> String {
        match self {
            Self::Look(_, look) => format!("Preparing {} ...", look.label()),
            Self::Scenario(args, _) => format!("Loading {} ...", args.scenario),
        }
    }
}

/// What has been loaded.
pub struct Loaded {
    /// `None` where it is the same as before.
    pub scenario: Option<(ScenarioArgs, Arc<Experiment>)>,
    pub look: Look,
    pub city: Renderer,
}

/// Something that is being loaded.
pub struct Loading {
    outcome: Receiver<Result<Loaded, Failure>>,
}

impl Loading {
    /// `on_news` is called on the thread when it is done.
    ///
    /// # Errors
    /// Where no thread can be had.
    pub fn begin(
        request: Request,
        context: &Context,
        on_news: Arc<dyn Fn() + Send + Sync>,
    ) -> Result<Self, Failure> {
        let (outbox, outcome) = sync_channel(1);
        let context = context.clone();
        let work = move || {
            // Whoever closed the window does not want it any more.
            if outbox.send(load(request, &context)).is_ok() {
                on_news();
            }
        };
        let thread = std::thread::Builder::new().name("loading".to_owned()).spawn(work);
        thread.map(|_| Self { outcome }).map_err(Failure::failed)
    }

    /// What came of it, once it is done.
    pub fn try_finish(&self) -> Option<Result<Loaded, Failure>> {
        match self.outcome.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(Failure::failed("loading ended early"))),
        }
    }
}

fn load(request: Request, context: &Context) -> Result<Loaded, Failure> {
    let (scenario, experiment, look) = match request {
        Request::Look(experiment, look) => (None, experiment, look),
        Request::Scenario(args, look) => {
            let experiment = load::experiment(&args)?;
            let look = Look { hours: experiment.time_of_day.hours, ..look };
            (Some((args, Arc::clone(&experiment))), experiment, look)
        }
    };
    let city = stage::renderer(context, &experiment, look)?;
    Ok(Loaded { scenario, look, city })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::AdapterPreference;
    use crate::ui::Preset;
    use std::time::{Duration, Instant};

    fn finish(request: Request, context: &Context) -> (Duration, Result<Loaded, Failure>) {
        let start = Instant::now();
        let loading = Loading::begin(request, context, Arc::new(|| {})).unwrap();
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
        let look = Look { preset: Preset::Low, hours: 3.0 };
        let args = |name: &str| ScenarioArgs { scenario: name.to_owned(), ..ScenarioArgs::default() };
        let start = Instant::now();
        let (begun, outcome) = finish(Request::Scenario(args("straight"), look), &context);
        let loaded = outcome.map_err(|failure| failure.message).unwrap();
        assert!(begun * 4 < start.elapsed(), "{begun:?} of {:?}", start.elapsed());
        let (_, experiment) = loaded.scenario.unwrap();
        assert_eq!((experiment.name.as_str(), loaded.look.hours), ("straight", 12.0));
        let (_, outcome) = finish(Request::Look(experiment, look), &context);
        assert!(outcome.is_ok_and(|loaded| loaded.scenario.is_none() && loaded.look == look));
        let (_, outcome) = finish(Request::Scenario(args("nowhere"), look), &context);
        assert!(outcome.is_err_and(|failure| failure.message.contains("nowhere")));
    }
}
