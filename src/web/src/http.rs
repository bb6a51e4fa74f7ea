//! HTTP/1.1, as much as the page needs: its files, and the upgrade to a WebSocket (RFC 9112, RFC 6455).

use std::net::{IpAddr, SocketAddr};
use tokio_tungstenite::tungstenite::handshake::derive_accept_key;

/// Longest head of a request, bytes.
pub(crate) const MAX_HEAD_BYTES: usize = 8192;
/// Most header fields of a request.
const MAX_HEADERS: usize = 64;

/// Nothing of the page comes from elsewhere, and nothing else shows it in a frame.
const SECURITY: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nCache-Control: no-store\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\nCross-Origin-Resource-Policy: same-origin\r\n";

const FILES: [(&str, &str, &str); 3] = [
    ("/", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("page/page.js")),
    ("/page.css", "text/css; charset=utf-8", include_str!("page/page.css")),
];

/// What a request comes to.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// Send this and close.
    Response { text: String, is_refusal: bool },
    /// Send this; what follows is a WebSocket.
    Upgrade(String),
}

/// Reads the head of a request; `None` while it is incomplete. `own` is the address that the client has connected to,
/// `name` a host name that the page may be opened by besides addresses.
pub(crate) fn answer(head: &[u8], own: SocketAddr, name: Option<&str>) -> Option<Answer> {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut request = httparse::Request::new(&mut headers);
    match request.parse(head) {
        Ok(httparse::Status::Complete(_)) => {}
        Ok(httparse::Status::Partial) if head.len() < MAX_HEAD_BYTES => return None,
        Ok(httparse::Status::Partial) => return Some(refusal("431 Request Header Fields Too Large")),
        Err(_) => return Some(refusal("400 Bad Request")),
    }
    let Some(fields) = Fields::of(request.headers) else { return Some(refusal("400 Bad Request")) };
    // A name that somebody else's page resolves to this machine (DNS rebinding) is none of ours.
    if !is_own_host(fields.host, own, name) {
        return Some(refusal("421 Misdirected Request"));
    }
    if request.method != Some("GET") {
        return Some(refusal("405 Method Not Allowed"));
    }
    let path = request.path.unwrap_or_default().split('?').next().unwrap_or_default();
    if path == "/socket" {
        return Some(upgrade(&fields));
    }
    let file = FILES.iter().find(|(file, ..)| *file == path);
    Some(match file {
        Some((_, kind, text)) => response("200 OK", kind, text, false),
        None => response("404 Not Found", "text/plain", "there is no such page\n", false),
    })
}

/// The header fields that matter; none of them may come twice.
#[derive(Debug, Default)]
struct Fields<'a> {
    host: &'a str,
    origin: &'a str,
    upgrade: &'a str,
    key: &'a str,
    version: &'a str,
}

impl<'a> Fields<'a> {
    fn of(headers: &[httparse::Header<'a>]) -> Option<Self> {
        let mut fields = Self::default();
        for header in headers {
            let field = match header.name.to_ascii_lowercase().as_str() {
                "host" => &mut fields.host,
                "origin" => &mut fields.origin,
                "upgrade" => &mut fields.upgrade,
                "sec-websocket-key" => &mut fields.key,
                "sec-websocket-version" => &mut fields.version,
                _ => continue,
            };
            if !field.is_empty() {
                return None;
            }
            *field = std::str::from_utf8(header.value).ok()?.trim();
        }
        Some(fields)
    }
}

fn is_own_host(host: &str, own: SocketAddr, name: Option<&str>) -> bool {
    let (host_name, port) = match host.rsplit_once(':') {
        Some((before, port)) if !port.ends_with(']') => (before, port.parse().ok()),
        _ => (host, Some(80)),
    };
    let bare = host_name.trim_start_matches('[').trim_end_matches(']');
    let is_known = bare.parse::<IpAddr>().is_ok()
        || bare.eq_ignore_ascii_case("localhost")
        || name.is_some_and(|name| bare.eq_ignore_ascii_case(name));
    is_known && port == Some(own.port())
}

fn upgrade(fields: &Fields<'_>) -> Answer {
    if !fields.upgrade.eq_ignore_ascii_case("websocket") || fields.key.is_empty() {
        return refusal("426 Upgrade Required");
    }
    if fields.version != "13" {
        return refusal("400 Bad Request");
    }
    if fields.origin.strip_prefix("http://") != Some(fields.host) {
        return refusal("403 Forbidden");
    }
    let accept = derive_accept_key(fields.key.as_bytes());
    Answer::Upgrade(format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {accept}\r\n\r\n"
    ))
}

/// A refusal without many words.
pub(crate) fn refusal(status: &str) -> Answer {
    response(status, "text/plain", &format!("{status}\n"), true)
}

fn response(status: &str, kind: &str, body: &str, is_refusal: bool) -> Answer {
    let text = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n{SECURITY}\r\n{body}",
        body.len()
    );
    Answer::Response { text, is_refusal }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(text: &str) -> String {
        let own = SocketAddr::from(([127, 0, 0, 1], 8080));
        match answer(text.as_bytes(), own, Some("lab-pc")) {
            None => "incomplete".to_owned(),
            Some(Answer::Upgrade(text) | Answer::Response { text, .. }) => {
                text.lines().next().unwrap_or_default().to_owned()
            }
        }
    }

    fn socket(host: &str, origin: &str) -> String {
        asked(&format!(
            "GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        ))
    }

    #[test]
    fn files_are_sent_to_who_asks_by_an_own_address() {
        for host in ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "192.168.1.5:8080", "LAB-PC:8080"] {
            assert_eq!(
                asked(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n")),
                "HTTP/1.1 200 OK",
                "{host}"
            );
        }
        for host in ["evil.example:8080", "127.0.0.1:8081", "127.0.0.1", "", "localhost.evil.example:8080"] {
            let told = asked(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n"));
            assert_eq!(told, "HTTP/1.1 421 Misdirected Request", "{host}");
        }
    }

    #[test]
    fn a_socket_is_opened_for_the_own_page_alone() {
        assert_eq!(socket("127.0.0.1:8080", "http://127.0.0.1:8080"), "HTTP/1.1 101 Switching Protocols");
        for origin in ["http://evil.example", "https://127.0.0.1:8080", "null", "http://127.0.0.1:80", ""] {
            assert_eq!(socket("127.0.0.1:8080", origin), "HTTP/1.1 403 Forbidden", "{origin}");
        }
    }

    #[test]
    fn what_is_no_request_is_refused() {
        assert_eq!(asked("GET / HTTP/1.1\r\nHost: 127.0.0.1:8080\r\n"), "incomplete");
        assert_eq!(asked("\x16\x03\x01\x02 garbage\r\n\r\n"), "HTTP/1.1 400 Bad Request");
        let twice = "GET / HTTP/1.1\r\nHost: 127.0.0.1:8080\r\nHost: localhost:8080\r\n\r\n";
        assert_eq!(asked(twice), "HTTP/1.1 400 Bad Request");
        let long = format!("GET /{} HTTP/1.1\r\n", "a".repeat(MAX_HEAD_BYTES));
        assert_eq!(asked(&long), "HTTP/1.1 431 Request Header Fields Too Large");
        let post = asked("POST / HTTP/1.1\r\nHost: 127.0.0.1:8080\r\n\r\n");
        assert_eq!(post, "HTTP/1.1 405 Method Not Allowed");
    }
}
