//! The Slave API: what the master and other nodes ask of this one.

use super::xmlrpc::{Value, read_call, write_answer, write_fault};
use super::{Node, http};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::timeout;

/// Whoever calls has to be done within this.
const PATIENCE: Duration = Duration::from_secs(10);

/// Answers one call.
pub(super) async fn serve(node: Node, mut stream: TcpStream) {
    let exchange = async {
        let body = match http::read_body(&mut stream, false).await {
            Ok(body) => body,
            Err(why) => {
                tracing::debug!("a call is refused: {why}");
                return;
            }
        };
        let answer = match read_call(&body) {
            Ok((method, arguments)) => answer(&node, &method, &arguments),
            Err(why) => Err(format!("no call: {why}")),
        };
        let text = answer.map_or_else(|why| write_fault(&why), |answer| write_answer(&answer));
        // Who hangs up has no use for it.
        let _ = http::answer(&mut stream, &text).await;
    };
    let _ = timeout(PATIENCE, exchange).await;
}

fn done(told: &str, value: Value) -> Value {
    Value::List(vec![Value::Int(1), told.into(), value])
}

fn wrong(why: &str) -> Value {
    Value::List(vec![Value::Int(-1), why.into(), Value::Int(0)])
}

/// What a method answers; each is called with the name of the caller first.
///
/// # Errors
/// Where there is no such method.
fn answer(node: &Node, method: &str, arguments: &[Value]) -> Result<Value, String> {
    let text = |at: usize| arguments.get(at).and_then(Value::text);
    Ok(match method {
        "getPid" => done("", Value::Int(i32::try_from(std::process::id()).unwrap_or(i32::MAX))),
        "getMasterUri" => done("", node.master_uri().into()),
        "getPublications" => done("publications", topics(node.publications())),
        "getSubscriptions" => done("subscriptions", topics(node.subscriptions())),
        "getBusInfo" => done("bus info", bus_info(node)),
        "getBusStats" => done("bus stats", bus_stats(node)),
        "requestTopic" => match text(1).map(|topic| node.offer(topic)) {
            Some(Some(place)) => {
                let port = Value::Int(i32::from(place.port));
                done("ready", Value::List(vec!["TCPROS".into(), place.host.as_str().into(), port]))
            }
            Some(None) => wrong("this topic is not published here"),
            None => wrong("caller, topic and protocols are needed"),
        },
        "publisherUpdate" => match (text(1), arguments.get(2).and_then(Value::list)) {
            (Some(topic), Some(publishers)) => {
                let publishers = publishers.iter().filter_map(|uri| uri.text().map(str::to_owned));
                node.take_publishers(topic, publishers);
                done("", Value::Int(0))
            }
            _ => wrong("caller, topic and publishers are needed"),
        },
        // Parameters are not listened to.
        "paramUpdate" => done("", Value::Int(0)),
        "shutdown" => {
            node.shut(text(1).unwrap_or(""));
            done("shutdown", Value::Int(0))
        }
        _ => return Err(format!("there is no method {method:?}")),
    })
}

fn topics(topics: Vec<(String, &'static str)>) -> Value {
    let pair = |(topic, kind): (String, &str)| Value::List(vec![Value::Text(topic), kind.into()]);
    Value::List(topics.into_iter().map(pair).collect())
}

/// One row for each connection: id, the other end, direction, transport, topic, whether it is up.
fn bus_info(node: &Node) -> Value {
    let row = |(id, peer, direction, topic, is_up): (i32, String, &str, String, bool)| {
        Value::List(vec![
            Value::Int(id),
            Value::Text(peer),
            direction.into(),
            "TCPROS".into(),
            Value::Text(topic),
            Value::Bool(is_up),
        ])
    };
    let outward = node.outboxes().into_iter();
    let outward = outward.map(|(topic, outbox)| (outbox.id, outbox.peer.clone(), "o", topic, true));
    let inward = node.links().into_iter();
    let inward = inward.map(|(topic, uri, link)| (link.id, uri, "i", topic, link.is_connected.get()));
    Value::List(outward.chain(inward).map(row).collect())
}

/// Numbers on the wire have 32 bits.
fn count(number: u64) -> Value {
    Value::Int(i32::try_from(number).unwrap_or(i32::MAX))
}

/// Of each connection: topic, bytes of messages, and id, bytes, messages, whether it is up.
fn bus_stats(node: &Node) -> Value {
    let row = |topic: String, id: i32, bytes: u64, messages: u64, is_up: bool| {
        let connection = vec![Value::Int(id), count(bytes), count(messages), Value::Bool(is_up)];
        Value::List(vec![Value::Text(topic), count(bytes), Value::List(vec![Value::List(connection)])])
    };
    let outward = node.outboxes().into_iter();
    let outward =
        outward.map(|(topic, to)| row(topic, to.id, to.sent_bytes.get(), to.sent.get(), true)).collect();
    let inward = node.links().into_iter();
    let inward = inward.map(|(topic, _, from)| {
        row(topic, from.id, from.received_bytes.get(), from.received.get(), from.is_connected.get())
    });
    Value::List(vec![Value::List(outward), Value::List(inward.collect()), Value::List(Vec::new())])
}
