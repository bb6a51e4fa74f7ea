//! The web page of a city: its options, and the server that they ask for.

use crate::Failure;
use crate::say::say;
use crate::served_at::ServedAt;
use city3d_session::{Session, SessionHandle, Source};
use city3d_simulation::scenario::Experiment;
use city3d_web::{PageOrders, WebOptions, WebServer};
use clap::Args;
use std::sync::Arc;

/// Where the page is served without another address.
const USUAL_ADDRESS: &str = "127.0.0.1:8080";

/// Options of the web page.
#[derive(Clone, Debug, Default, Args)]
pub struct WebArgs {
    /// Serve a web page of the city; the address that is printed gives orders, without its token a page watches
    /// [default: 127.0.0.1:8080, for this machine only]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true)]
    web: Option<Option<String>>,
}

/// What is served of a city.
pub struct PagedCity<'a> {
    pub experiment: &'a Arc<Experiment>,
    /// How its pictures look.
    #[cfg(feature = "render")]
    pub look: &'a crate::look::LookArgs,
}

/// The server, where one is asked for. It ends when this is dropped.
#[derive(Debug)]
pub struct ServedPage(Option<WebServer>);

impl WebArgs {
    /// Where the page is served; `None` where none is asked for.
    pub fn place(&self) -> Result<Option<ServedAt>, Failure> {
        ServedAt::asked(self.web.as_ref(), USUAL_ADDRESS)
    }
}

/// Starts the server.
pub fn start(at: &mut ServedAt, orders: PageOrders, city: &PagedCity<'_>) -> Result<WebServer, Failure> {
    let ServedAt { address, token } = at.clone();
    let experiment = Arc::clone(city.experiment);
    let options = WebOptions::new(address, token, experiment, orders);
    let server = WebServer::start(options).map_err(Failure::bad_input)?;
    at.bound("the web page", server.address());
    #[cfg(feature = "render")]
    server.draw(crate::look::opener(city.look, city.experiment));
    Ok(server)
}

/// Starts the server of a session, where there is a place for it.
pub fn attach<S: Source>(
    at: Option<&mut ServedAt>,
    session: Session<S>,
    city: &PagedCity<'_>,
) -> Result<(Session<S>, ServedPage), Failure> {
    let (Some(at), Some(orders)) = (at, session.orders()) else { return Ok((session, ServedPage(None))) };
    let server = start(at, PageOrders::City(orders), city)?;
    Ok((session.with_end(Box::new(server.end())), ServedPage(Some(server))))
}

impl ServedPage {
    /// Shows the page what the session publishes.
    pub fn open(&self, session: &SessionHandle) {
        self.0.iter().for_each(|server| server.watch(session.published()));
    }

    /// Tells where the page is.
    pub fn say(&self) -> Result<(), Failure> {
        self.0.iter().try_for_each(tell)
    }
}

/// Tells where a page is.
pub fn tell(server: &WebServer) -> Result<(), Failure> {
    say(format_args!("the web page is at {}", server.url()))
}
