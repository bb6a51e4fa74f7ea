//! Foxglove and Lichtblick on a city that runs: options, and the server that they ask for.

use crate::Failure;
use crate::say::say;
use crate::served_at::ServedAt;
use city3d_foxglove::{FoxgloveEnd, FoxgloveOptions, FoxgloveServer, PATIENCE};
use city3d_logbook::record::LogOrigin;
use city3d_session::{Session, SessionHandle, Source};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use std::sync::Arc;

/// Where it is served without another address: where the applications look first.
const USUAL_ADDRESS: &str = "127.0.0.1:8765";

/// Options of Foxglove.
#[derive(Clone, Debug, Default, Args)]
pub struct FoxgloveArgs {
    /// Offer the city to Foxglove and Lichtblick; the address that is printed gives orders, without its token one watches
    /// [default: 127.0.0.1:8765, for this machine only]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true)]
    foxglove: Option<Option<String>>,
    /// Page that may connect besides those of this machine and app.foxglove.dev, such as https://lab.example; repeat for
    /// several
    #[arg(long, value_name = "ORIGIN", requires = "foxglove")]
    foxglove_origin: Vec<String>,
}

/// What the server is told of a city.
pub struct OfferedCity<'a> {
    pub experiment: &'a Arc<Experiment>,
    pub origin: LogOrigin,
    /// Snapshots per simulated second, as in the log.
    pub snapshot_hz: u32,
    /// How pictures of cameras look.
    #[cfg(feature = "render")]
    pub look: crate::look::LookArgs,
}

/// The server, where one is asked for. It ends when this is dropped.
#[derive(Debug)]
pub struct ServedFoxglove(Option<FoxgloveServer>);

impl FoxgloveArgs {
    /// Where Foxglove connects; `None` where it is not asked for.
    pub fn place(&self) -> Result<Option<ServedAt>, Failure> {
        ServedAt::asked(self.foxglove.as_ref(), USUAL_ADDRESS)
    }

    /// Starts the server and attaches it to a session, where there is a place for it.
    pub fn attach<S: Source>(
        &self,
        at: Option<&mut ServedAt>,
        session: Session<S>,
        city: OfferedCity<'_>,
    ) -> Result<(Session<S>, ServedFoxglove), Failure> {
        let (Some(at), Some(orders)) = (at, session.orders()) else {
            return Ok((session, ServedFoxglove(None)));
        };
        let ServedAt { address, token } = at.clone();
        let options = FoxgloveOptions {
            address,
            token,
            origins: self.foxglove_origin.clone(),
            experiment: Arc::clone(city.experiment),
            origin: city.origin,
            snapshot_hz: city.snapshot_hz,
            orders,
            patience: PATIENCE,
        };
        let (server, end) = FoxgloveServer::start(options).map_err(Failure::bad_input)?;
        at.bound("Foxglove", server.address());
        let end = with_cameras(end, &city)?;
        Ok((session.with_end(Box::new(end)), ServedFoxglove(Some(server))))
    }
}

#[cfg(feature = "render")]
fn with_cameras(end: FoxgloveEnd, city: &OfferedCity<'_>) -> Result<FoxgloveEnd, Failure> {
    use city3d_foxglove::NamedCamera;
    let cameras = crate::cameras::scenario_cameras(city.experiment, None).into_iter();
    let named =
        cameras.map(|of| NamedCamera { name: format!("{}/{}", of.vehicle, of.name), camera: of.camera });
    let open = crate::look::opener(&city.look, city.experiment);
    Ok(end.with_cameras(named.collect(), open)?)
}

#[cfg(not(feature = "render"))]
#[allow(clippy::unnecessary_wraps, reason = "the same call with and without pictures")]
fn with_cameras(end: FoxgloveEnd, _: &OfferedCity<'_>) -> Result<FoxgloveEnd, Failure> {
    Ok(end)
}

impl ServedFoxglove {
    /// Shows the server what a session on a thread of its own publishes.
    pub fn open(&self, session: &SessionHandle) {
        self.0.iter().for_each(|server| server.watch(session.published()));
    }

    /// Shows the server what a session publishes that its caller runs, and tells where it is.
    pub fn publishing<S: Source>(&self, session: Session<S>) -> Result<Session<S>, Failure> {
        let Some(server) = &self.0 else { return Ok(session) };
        let (session, state) = session.publishing();
        server.watch(state);
        self.say()?;
        Ok(session)
    }

    /// Tells where Foxglove connects.
    pub fn say(&self) -> Result<(), Failure> {
        self.0.iter().try_for_each(|server| say(format_args!("Foxglove connects to {}", server.url())))
    }
}
