//! Slave API: answers the XML-RPC calls of the master and of other nodes.

use super::xmlrpc::{XmlRpcValue, read_call, write_answer, write_fault};
use super::{RosNode, http};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::timeout;

/// Longest time for a call.
const CALL_TIMEOUT: Duration = Duration::from_secs(10);

/// Answers one call.
pub(super) async fn serve(node: RosNode, mut stream: TcpStream) {
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
            Err(why) => Err(format!("not a call: {why}")),
        };
        let text = answer.map_or_else(|why| write_fault(&why), |answer| write_answer(&answer));
        // A caller that hangs up loses the answer.
        let _ = http::answer(&mut stream, &text).await;
    };
    let _ = timeout(CALL_TIMEOUT, exchange).await;
}

fn done(told: &str, value: XmlRpcValue) -> XmlRpcValue {
    XmlRpcValue::List(vec![XmlRpcValue::Int(1), told.into(), value])
}

fn wrong(why: &str) -> XmlRpcValue {
    XmlRpcValue::List(vec![XmlRpcValue::Int(-1), why.into(), XmlRpcValue::Int(0)])
}

/// Carries out a method; the first argument is the name of the caller.
///
/// # Errors
/// When there is no such method.
fn answer(node: &RosNode, method: &str, arguments: &[XmlRpcValue]) -> Result<XmlRpcValue, String> {
    let text = |at: usize| arguments.get(at).and_then(XmlRpcValue::text);
    Ok(match method {
        "getPid" => done("", XmlRpcValue::Int(i32::try_from(std::process::id()).unwrap_or(i32::MAX))),
        "getMasterUri" => done("", node.master_uri().into()),
        "getPublications" => done("publications", topics(node.publications())),
        "getSubscriptions" => done("subscriptions", topics(node.subscriptions())),
        "getBusInfo" => done("bus info", bus_info(node)),
        "getBusStats" => done("bus stats", bus_stats(node)),
        "requestTopic" => match text(1).map(|topic| node.tcpros_address(topic)) {
            Some(Some(place)) => {
                let port = XmlRpcValue::Int(i32::from(place.port));
                done("ready", XmlRpcValue::List(vec!["TCPROS".into(), place.host.as_str().into(), port]))
            }
            Some(None) => wrong("this topic is not published here"),
            None => wrong("caller, topic and protocols are needed"),
        },
        "publisherUpdate" => match (text(1), arguments.get(2).and_then(XmlRpcValue::list)) {
            (Some(topic), Some(publishers)) => {
                let publishers = publishers.iter().filter_map(|uri| uri.text().map(str::to_owned));
                node.update_publishers(topic, publishers);
                done("", XmlRpcValue::Int(0))
            }
            _ => wrong("caller, topic and publishers are needed"),
        },
        // Parameters are not used.
        "paramUpdate" => done("", XmlRpcValue::Int(0)),
        "shutdown" => {
            node.shut_down(text(1).unwrap_or(""));
            done("shutdown", XmlRpcValue::Int(0))
        }
        _ => return Err(format!("there is no method {method:?}")),
    })
}

fn topics(topics: Vec<(String, &'static str)>) -> XmlRpcValue {
    let pair = |(topic, kind): (String, &str)| XmlRpcValue::List(vec![XmlRpcValue::Text(topic), kind.into()]);
    XmlRpcValue::List(topics.into_iter().map(pair).collect())
}

/// One row per connection: id, peer, direction, transport, topic, whether it is connected.
fn bus_info(node: &RosNode) -> XmlRpcValue {
    let row = |id: i32, peer: String, direction: &str, topic: String, is_up: bool| {
        XmlRpcValue::List(vec![
            XmlRpcValue::Int(id),
            XmlRpcValue::Text(peer),
            direction.into(),
            "TCPROS".into(),
            XmlRpcValue::Text(topic),
            XmlRpcValue::Bool(is_up),
        ])
    };
    let outward = node.outboxes().into_iter();
    let outward = outward.map(|(topic, outbox)| row(outbox.id, outbox.peer.clone(), "o", topic, true));
    let inward = node.links().into_iter();
    let inward = inward.map(|(topic, uri, link)| row(link.id, uri, "i", topic, link.is_connected.get()));
    XmlRpcValue::List(outward.chain(inward).collect())
}

/// XML-RPC integers have 32 bits.
fn count(number: u64) -> XmlRpcValue {
    XmlRpcValue::Int(i32::try_from(number).unwrap_or(i32::MAX))
}

/// One row per connection: topic, bytes of messages, and id, bytes, messages, whether it is connected.
fn bus_stats(node: &RosNode) -> XmlRpcValue {
    let row = |topic: String, id: i32, bytes: u64, messages: u64, is_up: bool| {
        let connection = vec![XmlRpcValue::Int(id), count(bytes), count(messages), XmlRpcValue::Bool(is_up)];
        XmlRpcValue::List(vec![
            XmlRpcValue::Text(topic),
            count(bytes),
            XmlRpcValue::List(vec![XmlRpcValue::List(connection)]),
        ])
    };
    let outward = node.outboxes().into_iter();
    let outward =
        outward.map(|(topic, to)| row(topic, to.id, to.sent_bytes.get(), to.sent.get(), true)).collect();
    let inward = node.links().into_iter();
    let inward = inward.map(|(topic, _, from)| {
        row(topic, from.id, from.received_bytes.get(), from.received.get(), from.is_connected.get())
    });
    XmlRpcValue::List(vec![
        XmlRpcValue::List(outward),
        XmlRpcValue::List(inward.collect()),
        XmlRpcValue::List(Vec::new()),
    ])
}
