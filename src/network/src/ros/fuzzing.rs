//! Readers of what peers send over ROS, for fuzzing (`tests/fuzz/`) alone: not covered by semantic versioning.

pub use super::bridge::fuzzing::BridgeInput;

use super::xmlrpc::{read_answer, read_call, write_answer, write_call};
use super::{header, http};
use std::pin::pin;
use std::task::{Context, Poll, Waker};
use tokio::io::AsyncReadExt;

/// Reads an XML-RPC call and writes it again.
///
/// # Errors
/// The reason, when it is malformed.
pub fn rewritten_call(bytes: &[u8]) -> Result<String, String> {
    read_call(bytes).map(|(method, arguments)| write_call(&method, &arguments))
}

/// Reads an XML-RPC answer and writes it again.
///
/// # Errors
/// The reason, when it is malformed or a fault.
pub fn rewritten_answer(bytes: &[u8]) -> Result<String, String> {
    read_answer(bytes).map(|answer| write_answer(&answer))
}

/// Reads a TCPROS connection header with its length prefix and encodes it again.
///
/// # Errors
/// The reason, when it is too long, incomplete or malformed.
pub fn rewritten_header(mut bytes: &[u8]) -> Result<Vec<u8>, String> {
    let fields = at_once(header::read(&mut bytes))?;
    let fields: Vec<(&str, &str)> =
        fields.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
    Ok(header::encode(&fields))
}

/// The body of an HTTP answer or request that arrives in two parts.
///
/// # Errors
/// What is wrong with the head or the body.
pub fn http_body(first: &[u8], rest: &[u8], is_answer: bool) -> Result<Vec<u8>, String> {
    at_once(http::read_body(&mut first.chain(rest), is_answer))
}

/// The result of a future that waits for nothing, as one that reads from memory.
fn at_once<T>(future: impl Future<Output = Result<T, String>>) -> Result<T, String> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => Err("it waits for more than its input".to_owned()),
    }
}
