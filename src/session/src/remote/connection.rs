//! The link to a city elsewhere: requests until they are carried out, the subscription, and which scenario is served.

use super::RemoteOptions;
use crate::SessionError;
use city3d_network::host::Host;
use city3d_network::link::{Client, ClientEvent};
use city3d_protocol::wire::{Body, RequestOutcome};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest wait for the answer to a request.
pub(super) const REQUEST_TIMEOUT: Duration = Duration::from_secs(2);
/// Interval of handshakes with a city that does not answer.
pub(super) const HANDSHAKE_INTERVAL: Duration = Duration::from_millis(200);
/// In lockstep, the last commands are retransmitted when poses do not come within this time.
pub(super) const RETRANSMIT_INTERVAL: Duration = Duration::from_millis(50);
/// Orders of a window are looked for at this interval.
pub(super) const ORDER_INTERVAL: Duration = Duration::from_millis(10);
/// Lease of the subscription.
const LEASE_S: f64 = 10.0;

/// The link to the city.
pub(super) struct Connection {
    pub client: Client,
    pub host: Host,
    pub stop: Arc<AtomicBool>,
}

/// What a city says to a request that may take several tries.
pub(super) enum Reply {
    /// Carried out, with a remark.
    Done(String),
    /// No answer, because the city is gone, was restarted, or this process is stopped.
    Nothing,
}

impl Connection {
    /// Repeats a request until the city carries it out.
    pub fn request_until_done(
        &mut self,
        what: &str,
        body: impl Fn(u32) -> Body,
    ) -> Result<Reply, SessionError> {
        let mut has_logged = false;
        while !self.stop.load(Ordering::Relaxed) {
            let Some((outcome, detail)) = self.client.request(REQUEST_TIMEOUT, &body) else {
                return Ok(Reply::Nothing);
            };
            match outcome {
                RequestOutcome::Done => return Ok(Reply::Done(detail)),
                RequestOutcome::Refused => {
                    return Err(SessionError::Refused { what: what.to_owned(), detail });
                }
                RequestOutcome::Busy => {
                    if !has_logged {
                        tracing::warn!("{what} has to wait: {detail}");
                        has_logged = true;
                    }
                    self.host.clock.sleep(RETRANSMIT_INTERVAL);
                }
            }
        }
        Ok(Reply::Nothing)
    }
}

/// Asks a city which scenario it serves, and waits at most so long for the answer.
///
/// # Errors
/// When the address is wrong.
pub fn served_scenario(
    options: &RemoteOptions,
    host: &Host,
    most: Duration,
) -> Result<Option<String>, SessionError> {
    let mut client = Client::on(host, &options.city, options.world, options.authenticator.clone())?;
    let until = host.clock.now() + most;
    client.send(&Body::Hello { token: 0 });
    let mut asked_at = host.clock.now();
    while host.clock.now() < until {
        match client.receive(ORDER_INTERVAL) {
            // From here on the client names the city's session, as requests under a key have to.
            Some(ClientEvent::Body(Body::Clock(_))) => {
                client.send(&Body::Describe { request: 1 });
            }
            Some(ClientEvent::Body(Body::Description(description))) => {
                return Ok(Some(description.scenario).filter(|name| !name.is_empty()));
            }
            _ => {}
        }
        let now = host.clock.now();
        if now.saturating_duration_since(asked_at) >= HANDSHAKE_INTERVAL {
            asked_at = now;
            client.send(&Body::Hello { token: 0 });
        }
    }
    Ok(None)
}

/// The subscription to the poses of each tick, and its renewal where the request is 0.
pub(super) fn subscription(request: u32) -> Body {
    Body::Subscribe { request, every_ticks: 1, lease_s: LEASE_S }
}
