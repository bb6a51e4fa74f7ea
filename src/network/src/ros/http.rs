//! Minimal HTTP/1.1 for XML-RPC: one call per connection, one body each way, all of it bounded.

use super::xmlrpc::{XmlRpcValue, read_answer, write_call};
use super::{HostPort, RosError};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::node::REQUEST_TIMEOUT;

/// Longest head, bytes, and most header fields.
const MAX_HEAD_BYTES: usize = 16 << 10;
const MAX_HEADERS: usize = 64;
/// Longest body, bytes: those of masters name all publishers of a topic.
const MAX_BODY_BYTES: usize = 1 << 20;
/// Bytes of one read.
const CHUNK: usize = 4096;

/// Makes an XML-RPC call to a master or a node.
///
/// # Errors
/// When the peer cannot be reached, does not answer, or its answer is malformed or a fault.
pub(super) async fn call(
    place: &HostPort,
    method: &str,
    arguments: &[XmlRpcValue],
) -> Result<XmlRpcValue, RosError> {
    let call = write_call(method, arguments);
    let told = || format!("{place}, {method}");
    match timeout(REQUEST_TIMEOUT, exchange(place, &call)).await {
        Err(_) => Err(RosError::NoAnswer { place: told() }),
        Ok(Err(source)) => Err(RosError::Io { place: place.to_string(), source }),
        Ok(Ok(body)) => {
            let answer = body.and_then(|body| read_answer(&body));
            answer.map_err(|why| RosError::Answer { place: told(), why })
        }
    }
}

async fn exchange(place: &HostPort, call: &str) -> std::io::Result<Result<Vec<u8>, String>> {
    let mut stream = TcpStream::connect((place.host.as_str(), place.port)).await?;
    stream.set_nodelay(true)?;
    let head = format!(
        "POST / HTTP/1.1\r\nHost: {place}\r\nUser-Agent: city3d\r\nContent-Type: text/xml\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n",
        call.len()
    );
    stream.write_all((head + call).as_bytes()).await?;
    Ok(read_body(&mut stream, true).await)
}

/// Sends the body of an answer with status 200.
pub(super) async fn answer(stream: &mut TcpStream, body: &str) -> std::io::Result<()> {
    let head = format!(
        "HTTP/1.1 200 OK\r\nServer: city3d\r\nContent-Type: text/xml\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all((head + body).as_bytes()).await?;
    stream.shutdown().await
}

/// Parsed head of a request or an answer.
struct HttpHead {
    /// Length of the head, bytes.
    length: usize,
    /// Length of the body, where it is stated.
    body: Option<usize>,
}

/// Reads the body of a request or of an answer.
///
/// # Errors
/// What is wrong with the head or the body.
pub(super) async fn read_body(
    stream: &mut (impl AsyncRead + Unpin),
    is_answer: bool,
) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let head = loop {
        if let Some(head) = parse(&bytes, is_answer)? {
            break head;
        }
        if bytes.len() > MAX_HEAD_BYTES {
            return Err(format!("headers of more than {MAX_HEAD_BYTES} bytes"));
        }
        if !more(stream, &mut bytes).await? {
            return Err("it ends within its headers".to_owned());
        }
    };
    bytes.drain(..head.length);
    let most = head.body.unwrap_or(MAX_BODY_BYTES);
    if most > MAX_BODY_BYTES {
        return Err(format!("a body of {most} bytes, at most {MAX_BODY_BYTES} are read"));
    }
    while bytes.len() < most {
        if !more(stream, &mut bytes).await? {
            // Without a length, the body ends with the connection.
            return if head.body.is_none() { Ok(bytes) } else { Err("it ends within its body".to_owned()) };
        }
    }
    if head.body.is_none() {
        return Err(format!("a body of more than {MAX_BODY_BYTES} bytes"));
    }
    bytes.truncate(most);
    Ok(bytes)
}

/// Reads on; `false` at the end of the connection.
async fn more(stream: &mut (impl AsyncRead + Unpin), bytes: &mut Vec<u8>) -> Result<bool, String> {
    let mut chunk = [0; CHUNK];
    let length = stream.read(&mut chunk).await.map_err(|error| error.to_string())?;
    bytes.extend(&chunk[..length]);
    Ok(length > 0)
}

/// Parses the head; `None` while it is incomplete.
fn parse(bytes: &[u8], is_answer: bool) -> Result<Option<HttpHead>, String> {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let (status, headers) = if is_answer {
        let mut answer = httparse::Response::new(&mut headers);
        let status = answer.parse(bytes).map_err(|error| error.to_string())?;
        if status.is_complete() && answer.code != Some(200) {
            let (code, reason) = (answer.code.unwrap_or(0), answer.reason.unwrap_or(""));
            return Err(format!("answered {code} {reason}"));
        }
        (status, &*answer.headers)
    } else {
        let mut request = httparse::Request::new(&mut headers);
        let status = request.parse(bytes).map_err(|error| error.to_string())?;
        if status.is_complete() && request.method != Some("POST") {
            return Err(format!("{} is not supported, only POST", request.method.unwrap_or("")));
        }
        (status, &*request.headers)
    };
    let httparse::Status::Complete(length) = status else { return Ok(None) };
    let find = |name: &str| headers.iter().find(|header| header.name.eq_ignore_ascii_case(name));
    if find("Transfer-Encoding").is_some() {
        return Err("chunked transfer encoding is not supported".to_owned());
    }
    let told = find("Content-Length").map(|header| {
        let length =
            std::str::from_utf8(header.value).ok().and_then(|text| text.trim().parse::<usize>().ok());
        length.ok_or_else(|| "its Content-Length is not a number".to_owned())
    });
    let body = told.transpose()?;
    if body.is_none() && !is_answer {
        return Err("a request without a Content-Length".to_owned());
    }
    Ok(Some(HttpHead { length, body }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn heads_are_read_and_what_is_no_call_is_refused() {
        let head = |text: &str, is_answer| parse(text.as_bytes(), is_answer);
        let found = head("POST /RPC2 HTTP/1.1\r\ncontent-length: 12\r\n\r\nrest", false).unwrap().unwrap();
        assert_eq!((found.length, found.body), (43, Some(12)));
        assert!(head("POST / HTTP/1.1\r\nContent-Le", false).unwrap().is_none());
        assert_eq!(head("HTTP/1.0 200 OK\r\n\r\n", true).unwrap().unwrap().body, None);
        for (text, is_answer, told) in [
            ("GET / HTTP/1.1\r\n\r\n", false, "only POST"),
            ("POST / HTTP/1.1\r\n\r\n", false, "without a Content-Length"),
            ("POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n", false, "not a number"),
            ("HTTP/1.1 500 Oh\r\n\r\n", true, "500 Oh"),
            ("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", true, "chunked"),
            ("\u{16}\u{3}\u{1}", false, "invalid"),
        ] {
            let found = head(text, is_answer).err().unwrap();
            assert!(found.contains(told), "{found}");
        }
    }

    proptest! {
        #[test]
        fn no_bytes_are_too_strange(bytes in proptest::collection::vec(any::<u8>(), 0..200), is_answer: bool) {
            // Any input is decoded or refused, without a panic.
            let _ = parse(&bytes, is_answer);
        }
    }
}
