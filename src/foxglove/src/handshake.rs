//! Who may connect: the request of a client, its origin, subprotocol and token.

use crate::protocol::SUBPROTOCOLS;
use city3d_session::Token;
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tokio_tungstenite::tungstenite::http::{HeaderMap, HeaderValue, StatusCode, Uri};

/// Pages that may connect besides those of this machine: Foxglove's own.
const KNOWN_ORIGINS: [&str; 2] = ["https://app.foxglove.dev", "https://app.foxglove.com"];
/// Applications that are installed come from a file.
const FILE_ORIGIN: &str = "file://";

/// What a client may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    /// It has shown no token.
    Watch,
    /// It has shown a token that is not the city's: it may watch.
    WrongToken,
    /// It has shown the token.
    Order,
}

/// Looks at the request of a client.
///
/// # Errors
/// The refusal of one that is let in neither to watch nor to give orders.
#[allow(clippy::result_large_err, reason = "tungstenite's own type")]
pub(crate) fn admit(
    request: &Request,
    mut response: Response,
    (token, origins): (&Token, &[String]),
) -> Result<(Response, Access), ErrorResponse> {
    if !is_known_origin(request.headers(), origins) {
        // For who wonders why an application does not connect.
        tracing::info!("a page of {:?} may not connect", request.headers().get("origin"));
        return Err(refusal(StatusCode::FORBIDDEN, "this page may not connect: see --foxglove-origin"));
    }
    let Some(subprotocol) = subprotocol(request.headers()) else {
        return Err(refusal(StatusCode::BAD_REQUEST, "the subprotocol foxglove.sdk.v1 is needed"));
    };
    response.headers_mut().insert("sec-websocket-protocol", HeaderValue::from_static(subprotocol));
    Ok((response, access(request.uri(), token)))
}

fn refusal(code: StatusCode, why: &str) -> ErrorResponse {
    let mut refusal = ErrorResponse::new(Some(why.to_owned()));
    *refusal.status_mut() = code;
    refusal
}

/// Programs that are no browser name no origin. A browser names that of the page, which nobody else can set.
fn is_known_origin(headers: &HeaderMap, others: &[String]) -> bool {
    let mut offered = headers.get_all("origin").iter();
    let Some(origin) = offered.next() else { return true };
    let Ok(origin) = origin.to_str() else { return false };
    if offered.next().is_some() {
        return false;
    }
    let is_listed = |known: &str| known.trim_end_matches('/').eq_ignore_ascii_case(origin);
    origin == FILE_ORIGIN
        || KNOWN_ORIGINS.contains(&origin)
        || is_of_this_machine(origin)
        || others.iter().any(|known| is_listed(known))
}

/// Whether a page comes from this machine, by a name that no name server resolves elsewhere.
fn is_of_this_machine(origin: &str) -> bool {
    let bare = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    let Some(authority) = bare else { return false };
    let host = match authority.rsplit_once(':') {
        Some((host, port)) if port.bytes().all(|digit| digit.is_ascii_digit()) => host,
        _ => authority,
    };
    ["localhost", "127.0.0.1", "[::1]"].contains(&host)
}

fn subprotocol(headers: &HeaderMap) -> Option<&'static str> {
    let offered: Vec<&str> = headers
        .get_all("sec-websocket-protocol")
        .iter()
        .filter_map(|header| header.to_str().ok())
        .flat_map(|header| header.split(','))
        .map(str::trim)
        .collect();
    SUBPROTOCOLS.into_iter().find(|spoken| offered.contains(spoken))
}

fn access(uri: &Uri, token: &Token) -> Access {
    let fields = uri.query().unwrap_or_default().split('&');
    match fields.filter_map(|field| field.strip_prefix("token=")).next() {
        None => Access::Watch,
        Some(offered) if token.is(offered) => Access::Order,
        Some(_) => Access::WrongToken,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(name: &'static str, values: &[&str]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for value in values {
            headers.append(name, value.parse().unwrap());
        }
        headers
    }

    #[test]
    fn pages_from_elsewhere_are_not_let_in() {
        let others = ["https://lab.example/".to_owned()];
        let may = |origins: &[&str]| is_known_origin(&headers("origin", origins), &others);
        assert!(may(&[]), "a program");
        for known in [
            "http://localhost:8080",
            "https://localhost",
            "http://127.0.0.1:3000",
            "http://[::1]:3000",
            "https://app.foxglove.dev",
            "file://",
            "https://lab.example",
        ] {
            assert!(may(&[known]), "{known}");
        }
        for strange in [
            "http://evil.example",
            "https://app.foxglove.dev.evil.example",
            "http://localhost.evil.example:8080",
            "http://127.0.0.1.evil.example",
            "http://localhost:80@evil.example",
            "null",
            "",
        ] {
            assert!(!may(&[strange]), "{strange}");
        }
        assert!(!may(&["http://localhost", "http://localhost"]), "twice");
    }

    #[test]
    fn the_preferred_subprotocol_is_chosen_and_one_is_needed() {
        let chosen = |offered: &[&str]| subprotocol(&headers("sec-websocket-protocol", offered));
        assert_eq!(chosen(&["foxglove.websocket.v1, foxglove.sdk.v1"]), Some("foxglove.sdk.v1"));
        assert_eq!(chosen(&["foxglove.sdk.v1.1", "foxglove.websocket.v1"]), Some("foxglove.websocket.v1"));
        assert_eq!(chosen(&["foxglove.sdk.v1.1"]), None);
        assert_eq!(chosen(&[]), None);
    }

    #[test]
    fn who_has_the_token_gives_orders() {
        let token = Token::draw().unwrap();
        let of = |path: &str| access(&path.parse().unwrap(), &token);
        assert_eq!(of("/"), Access::Watch);
        assert_eq!(of("/?token=0"), Access::WrongToken);
        assert_eq!(of(&format!("/?view=1&token={}", token.text())), Access::Order);
    }
}
