//! The web page of a served city: its options, and the server that they ask for.

use crate::Failure;
use crate::say::say;
use city3d_session::{OrderSender, SessionHandle, Token};
use city3d_simulation::scenario::Experiment;
use city3d_web::{WebOptions, WebServer};
use clap::Args;
use std::sync::Arc;

/// Where the page is served without another address.
const USUAL_ADDRESS: &str = "127.0.0.1:8080";

/// Options of the web page.
#[derive(Clone, Debug, Args)]
pub struct WebArgs {
    /// Serve a web page of the city; the address that is printed gives orders, without its token a page watches
    /// [default: 127.0.0.1:8080, for this machine only]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true)]
    web: Option<Option<String>>,
}

impl WebArgs {
    /// Starts the server, where it is asked for.
    pub fn start(
        &self,
        experiment: &Arc<Experiment>,
        orders: Option<OrderSender>,
    ) -> Result<Option<WebServer>, Failure> {
        let (Some(address), Some(orders)) = (&self.web, orders) else { return Ok(None) };
        let address = address.clone().unwrap_or_else(|| USUAL_ADDRESS.to_owned());
        let token = Token::draw().map_err(Failure::failed)?;
        let experiment = Arc::clone(experiment);
        let server = WebServer::start(WebOptions { address, token, experiment, orders })
            .map_err(Failure::bad_input)?;
        if !server.address().ip().is_loopback() {
            tracing::warn!(
                "the web page at {} can be reached from other machines, and is not encrypted: whoever can read the \
                 network can read its token",
                server.address()
            );
        }
        Ok(Some(server))
    }
}

/// Shows the page what the session publishes, and tells where it is.
pub fn open(server: &WebServer, session: &SessionHandle) -> Result<(), Failure> {
    server.watch(session.published());
    say(format_args!("the web page is at {}", server.url()))
}
