//! The WebSocket protocol of Foxglove's SDK, subprotocol `foxglove.sdk.v1`, as much as a city needs: JSON texts, and
//! binary messages that begin with an opcode. <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>

use serde::Deserialize;
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Bytes;

/// Subprotocols that are spoken, the preferred one first; the second is what older clients call the same.
pub(crate) const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Longest message of a client, bytes: subscriptions to a thousand channels.
pub(crate) const MAX_MESSAGE_BYTES: usize = 64 << 10;
/// Encoding of service calls.
pub(crate) const JSON: &str = "json";

mod opcode {
    pub const MESSAGE_DATA: u8 = 1;
    pub const TIME: u8 = 2;
    pub const SERVICE_CALL_REQUEST: u8 = 2;
    pub const SERVICE_CALL_RESPONSE: u8 = 3;
}

/// A text of a client.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(crate) enum Request {
    Subscribe { subscriptions: Vec<Subscription> },
    Unsubscribe { subscription_ids: Vec<u32> },
    GetParameters { parameter_names: Vec<String>, id: Option<String> },
    SetParameters { parameters: Vec<Parameter>, id: Option<String> },
    SubscribeParameterUpdates { parameter_names: Vec<String> },
    UnsubscribeParameterUpdates { parameter_names: Vec<String> },
    // Of the protocol, but nothing that a city offers.
    Advertise {},
    Unadvertise {},
    SubscribeConnectionGraph {},
    UnsubscribeConnectionGraph {},
    FetchAsset {},
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Subscription {
    /// The client's own number.
    pub id: u32,
    pub channel_id: u32,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(crate) struct Parameter {
    pub name: String,
    pub value: Option<Value>,
}

/// A call of a service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ServiceCall<'a> {
    pub service: u32,
    pub call: u32,
    pub encoding: &'a str,
    pub request: &'a [u8],
}

impl<'a> ServiceCall<'a> {
    /// Reads a binary message of a client; `None` for any other.
    pub(crate) fn read(message: &'a [u8]) -> Option<Self> {
        let rest = message.strip_prefix(&[opcode::SERVICE_CALL_REQUEST])?;
        let (service, rest) = number(rest)?;
        let (call, rest) = number(rest)?;
        let (length, rest) = number(rest)?;
        let (encoding, request) = rest.split_at_checked(length as usize)?;
        Some(Self { service, call, encoding: std::str::from_utf8(encoding).ok()?, request })
    }
}

fn number(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u32::from_le_bytes(*number), rest))
}

/// How grave a status is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    Warning = 1,
    Error = 2,
}

/// What the server is and offers.
pub(crate) fn server_info(scenario: &str, session: &str, may_order: bool) -> String {
    json!({
        "op": "serverInfo",
        "name": format!("City3D: {scenario}"),
        "capabilities": ["time", "parameters", "parametersSubscribe", "services"],
        "supportedEncodings": [JSON],
        "metadata": {
            "city3d": env!("CARGO_PKG_VERSION"),
            "scenario": scenario,
            "may_order": may_order.to_string(),
        },
        "sessionId": session,
    })
    .to_string()
}

pub(crate) fn advertise(channels: &[Value]) -> String {
    json!({ "op": "advertise", "channels": channels }).to_string()
}

pub(crate) fn unadvertise(ids: &[u32]) -> String {
    json!({ "op": "unadvertise", "channelIds": ids }).to_string()
}

pub(crate) fn advertise_services(services: &[Value]) -> String {
    json!({ "op": "advertiseServices", "services": services }).to_string()
}

pub(crate) fn parameter_values(values: &[Value], id: Option<&str>) -> String {
    let mut message = json!({ "op": "parameterValues", "parameters": values });
    if let Some(id) = id {
        message["id"] = id.into();
    }
    message.to_string()
}

pub(crate) fn status(level: Level, message: &str) -> String {
    json!({ "op": "status", "level": level as u8, "message": message }).to_string()
}

pub(crate) fn service_failure(service: u32, call: u32, message: &str) -> String {
    json!({ "op": "serviceCallFailure", "serviceId": service, "callId": call, "message": message })
        .to_string()
}

/// A message on a channel; times are nanoseconds.
pub(crate) fn message_data(subscription: u32, stamp_ns: u64, payload: &[u8]) -> Bytes {
    let mut bytes = Vec::with_capacity(payload.len() + 13);
    bytes.push(opcode::MESSAGE_DATA);
    bytes.extend(subscription.to_le_bytes());
    bytes.extend(stamp_ns.to_le_bytes());
    bytes.extend_from_slice(payload);
    bytes.into()
}

pub(crate) fn time(stamp_ns: u64) -> Bytes {
    let mut bytes = vec![opcode::TIME];
    bytes.extend(stamp_ns.to_le_bytes());
    bytes.into()
}

pub(crate) fn service_response(service: u32, call: u32, response: &Value) -> Bytes {
    let mut bytes = vec![opcode::SERVICE_CALL_RESPONSE];
    for number in [service, call, JSON.len() as u32] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend_from_slice(JSON.as_bytes());
    bytes.extend_from_slice(response.to_string().as_bytes());
    bytes.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_as_the_protocol_writes_them() {
        let read = |text: &str| serde_json::from_str::<Request>(text);
        assert_eq!(
            read(r#"{"op":"subscribe","subscriptions":[{"id":3,"channelId":7}]}"#).unwrap(),
            Request::Subscribe { subscriptions: vec![Subscription { id: 3, channel_id: 7 }] }
        );
        let value = Some(Value::from(2.0));
        let parameters = vec![Parameter { name: "/city3d/speed".to_owned(), value }];
        assert_eq!(
            read(r#"{"op":"setParameters","parameters":[{"name":"/city3d/speed","value":2.0,"type":"float64"}],"id":"a"}"#)
                .unwrap(),
            Request::SetParameters { parameters, id: Some("a".to_owned()) }
        );
        assert_eq!(
            read(r#"{"op":"advertise","channels":[{"id":1,"topic":"/t"}]}"#).unwrap(),
            Request::Advertise {}
        );
        for wrong in
            ["", "{}", "[1]", r#"{"op":"launch"}"#, r#"{"op":"subscribe","subscriptions":[{"id":-1}]}"#]
        {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn calls_are_read_and_torn_ones_are_not() {
        let mut message = vec![2];
        for number in [5_u32, 9, 4] {
            message.extend(number.to_le_bytes());
        }
        message.extend_from_slice(b"json{}");
        let call = ServiceCall { service: 5, call: 9, encoding: "json", request: b"{}" };
        assert_eq!(ServiceCall::read(&message), Some(call));
        assert!((0..17).all(|length| ServiceCall::read(&message[..length]).is_none()));
        message[9] = 255;
        assert_eq!(ServiceCall::read(&message), None);
        message[0] = 1;
        assert_eq!(ServiceCall::read(&message), None);
    }
}
