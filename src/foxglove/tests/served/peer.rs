//! A city that is offered, and clients of it.

use city3d_foxglove::{FoxgloveOptions, FoxgloveServer, PATIENCE};
use city3d_logbook::record::LogOrigin;
use city3d_network::listener::Patience;
use city3d_session::{Host, LocalCity, Session, SessionHandle, Token};
use city3d_simulation::scenario::ScenarioRequest;
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Bytes, Error, Message as Packet};
use tokio_tungstenite::{WebSocketStream, client_async};

pub const LONG: Duration = Duration::from_secs(20);

pub struct City {
    pub foxglove: FoxgloveServer,
    pub session: SessionHandle,
}

/// A scenario with its control framework, offered to Foxglove.
pub fn city(scenario: &str) -> City {
    city_with(scenario, PATIENCE)
}

/// The same, with another patience.
pub fn city_with(scenario: &str, patience: Patience) -> City {
    let request = ScenarioRequest { scenario: scenario.to_owned(), ..ScenarioRequest::default() };
    let experiment = city3d_session::load(&request).unwrap();
    let host = Host::system();
    let session = Session::new(LocalCity::new(Arc::clone(&experiment), host.clone()).unwrap(), host);
    let options = FoxgloveOptions {
        address: "127.0.0.1:0".to_owned(),
        token: Token::draw().unwrap(),
        origins: Vec::new(),
        experiment,
        origin: LogOrigin::Run,
        snapshot_hz: 100,
        orders: session.orders().unwrap(),
        patience,
    };
    let (foxglove, end) = FoxgloveServer::start(options).unwrap();
    let session = session.with_end(Box::new(end)).spawn(None).unwrap();
    foxglove.watch(session.published());
    City { foxglove, session }
}

impl City {
    /// The address without the token.
    pub fn watched(&self) -> String {
        self.foxglove.url().split('?').next().unwrap().to_owned()
    }
}

pub async fn open(url: &str, headers: &[(&'static str, &str)]) -> Result<Peer, Error> {
    let mut request = url.into_client_request().unwrap();
    for (name, value) in headers {
        request.headers_mut().insert(*name, value.parse().unwrap());
    }
    let address: SocketAddr = request.uri().authority().unwrap().as_str().parse().unwrap();
    let stream = TcpStream::connect(address).await.unwrap();
    let (socket, _) = client_async(request, stream).await?;
    Ok(Peer {
        socket,
        channels: BTreeMap::new(),
        topics: BTreeMap::new(),
        texts: Vec::new(),
        times_ns: Vec::new(),
    })
}

/// A message of the server.
#[derive(Debug)]
pub enum Heard {
    Text,
    Message { topic: String, stamp_ns: u64, payload: Bytes },
    Time,
    Response { call: u32, answer: Value },
}

pub struct Peer {
    pub socket: WebSocketStream<TcpStream>,
    /// Channels by topic.
    channels: BTreeMap<String, Value>,
    /// Topics by subscription.
    topics: BTreeMap<u32, String>,
    /// All texts that came.
    texts: Vec<Value>,
    /// All times that came.
    pub times_ns: Vec<u64>,
}

impl Peer {
    pub async fn new(url: &str) -> Self {
        open(url, &[("sec-websocket-protocol", "foxglove.sdk.v1")]).await.unwrap()
    }

    pub async fn send(&mut self, message: Value) {
        self.socket.send(Packet::text(message.to_string())).await.unwrap();
    }

    pub async fn heard(&mut self) -> Heard {
        let number = |bytes: &[u8]| u32::from_le_bytes(bytes[..4].try_into().unwrap());
        let long = |bytes: &[u8]| u64::from_le_bytes(bytes[..8].try_into().unwrap());
        let look = async {
            loop {
                match self.socket.next().await.unwrap().unwrap() {
                    Packet::Text(text) => {
                        let message: Value = serde_json::from_str(&text).unwrap();
                        for channel in message["channels"].as_array().into_iter().flatten() {
                            let topic = channel["topic"].as_str().unwrap().to_owned();
                            self.channels.insert(topic, channel.clone());
                        }
                        self.texts.push(message);
                        return Heard::Text;
                    }
                    Packet::Binary(bytes) => {
                        return match bytes[0] {
                            1 => Heard::Message {
                                topic: self.topics[&number(&bytes[1..])].clone(),
                                stamp_ns: long(&bytes[5..]),
                                payload: bytes.slice(13..),
                            },
                            2 => {
                                self.times_ns.push(long(&bytes[1..]));
                                Heard::Time
                            }
                            3 => {
                                let encoding = number(&bytes[9..]) as usize;
                                let answer = serde_json::from_slice(&bytes[13 + encoding..]).unwrap();
                                Heard::Response { call: number(&bytes[5..]), answer }
                            }
                            other => panic!("opcode {other}"),
                        };
                    }
                    _ => {}
                }
            }
        };
        timeout(LONG, look).await.unwrap()
    }

    /// The first text that this is true of, of those that have come or will come.
    pub async fn text(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        loop {
            if let Some(text) = self.texts.iter().find(|text| wanted(text)) {
                return text.clone();
            }
            self.heard().await;
        }
    }

    /// The channel of a topic.
    pub async fn channel(&mut self, topic: &str) -> Value {
        while !self.channels.contains_key(topic) {
            self.heard().await;
        }
        self.channels[topic].clone()
    }

    pub async fn subscribe(&mut self, topic: &str) {
        let channel = self.channel(topic).await["id"].clone();
        let id = self.topics.len() as u32 + 1000;
        self.topics.insert(id, topic.to_owned());
        self.send(json!({ "op": "subscribe", "subscriptions": [{ "id": id, "channelId": channel }] })).await;
    }

    /// The next message on a topic: its stamp in seconds, and its bytes.
    pub async fn message(&mut self, wanted: &str) -> (f64, Bytes) {
        loop {
            if let Heard::Message { topic, stamp_ns, payload } = self.heard().await
                && topic == wanted
            {
                return (stamp_ns as f64 / 1e9, payload);
            }
        }
    }

    /// Calls a service.
    pub async fn ask(&mut self, service: u32, request: Value) {
        let mut message = vec![2];
        for number in [service, CALL, 4] {
            message.extend(number.to_le_bytes());
        }
        message.extend_from_slice(b"json");
        message.extend_from_slice(request.to_string().as_bytes());
        self.socket.send(Packet::binary(message)).await.unwrap();
    }

    /// The answer of a service.
    pub async fn call(&mut self, service: u32, request: Value) -> Value {
        self.ask(service, request).await;
        loop {
            if let Heard::Response { call, answer } = self.heard().await {
                assert_eq!(call, CALL);
                return answer;
            }
        }
    }

    /// The code that the server closes with; `None` where it just ends.
    pub async fn closed(&mut self) -> Option<u16> {
        let look = async {
            loop {
                match self.socket.next().await {
                    Some(Ok(Packet::Close(frame))) => return frame.map(|frame| frame.code.into()),
                    Some(Ok(_)) => {}
                    Some(Err(_)) | None => return None,
                }
            }
        };
        timeout(LONG, look).await.unwrap()
    }
}

/// Number of all calls.
const CALL: u32 = 77;
pub const START: u32 = 1;
pub const PAUSE: u32 = 2;
pub const RESET: u32 = 4;
pub const SET_SPEED: u32 = 5;
