//! One client that is connected: what it is sent, and what it may ask for.

use crate::channel::Channel;
use crate::control::{self, PARAMETERS, Service};
use crate::handshake::Access;
use crate::hub::Offered;
use crate::outbox::{Next, Outbox};
use crate::protocol::{self, Level, Parameter, Request, ServiceCall, Subscription};
use crate::server::Shared;
use city3d_network::listener::{Patience, count};
use city3d_session::{MessageRate, Order};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, mpsc};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::protocol::CloseFrame;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::{Bytes, Message as Packet};

/// How long the server waits for a client. It asks for a sign of life at a third of the longest silence.
pub const PATIENCE: Patience = Patience {
    request: Duration::from_secs(5),
    send: Duration::from_secs(5),
    silence: Duration::from_secs(50),
};
/// Messages that are handed to the socket before it has to have taken them.
const BATCH: usize = 64;
/// Messages of a client in a second, at most.
const MAX_RATE: u32 = 200;
/// Orders of a client that wait for their answers, at most.
const MAX_CALLS: usize = 8;
/// Interval at which changes of parameters are told.
const PARAMETER_INTERVAL: Duration = Duration::from_millis(250);
/// Channels in one advertisement.
const ADVERTISED_AT_ONCE: usize = 100;
/// Why a client gives no orders.
const WATCHES: &str = "this connection watches; the address with the token gives orders";
const BUSY: &str = "too many orders at once";

type Socket = WebSocketStream<TcpStream>;

/// Why a client is disconnected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Parting {
    /// It has gone by itself.
    Gone,
    Invalid(&'static str),
    Slow,
}

/// Serves a client until it goes.
pub(crate) async fn serve(socket: Socket, access: Access, shared: &Arc<Shared>) {
    let (sink, mut from) = socket.split();
    let number = shared.next_client();
    let (replies, answers) = mpsc::channel(MAX_CALLS);
    let mut client = Client {
        shared,
        access,
        sink,
        outbox: shared.hub.enter(number),
        advertised: Offered::default(),
        parameters: BTreeSet::new(),
        told: Vec::new(),
        replies,
        calls: Arc::new(Semaphore::new(MAX_CALLS)),
        rate: MessageRate::new(MAX_RATE, Instant::now().into_std()),
    };
    shared.counters.peers.enter();
    let parting = client.exchange(&mut from, answers).await;
    shared.counters.peers.leave();
    shared.hub.leave(number);
    client.part(parting).await;
}

struct Client<'a> {
    shared: &'a Arc<Shared>,
    access: Access,
    sink: SplitSink<Socket, Packet>,
    outbox: Arc<Outbox>,
    /// The channels that it knows of.
    advertised: Offered,
    /// The parameters whose changes it wants to be told.
    parameters: BTreeSet<&'static str>,
    /// What it was told of them last.
    told: Vec<(&'static str, Value)>,
    /// Answers of orders that are carried out beside the exchange.
    replies: mpsc::Sender<Packet>,
    calls: Arc<Semaphore>,
    rate: MessageRate,
}

impl Client<'_> {
    async fn exchange(
        &mut self,
        from: &mut SplitStream<Socket>,
        mut answers: mpsc::Receiver<Packet>,
    ) -> Parting {
        let mut offered = self.shared.hub.offered();
        if let Err(parting) = self.greet().await {
            return parting;
        }
        offered.mark_changed();
        let silence = self.shared.patience.silence;
        let (mut pings, mut looks) = (interval(silence / 3), interval(PARAMETER_INTERVAL));
        pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut silent_at = Instant::now() + silence;
        let outbox = Arc::clone(&self.outbox);
        loop {
            let outcome = tokio::select! {
                packet = from.next() => {
                    silent_at = Instant::now() + silence;
                    match packet {
                        Some(Ok(packet)) => self.take(packet).await,
                        Some(Err(error)) => Err(parting_of(&error)),
                        None => Err(Parting::Gone),
                    }
                }
                next = outbox.next() => self.deliver(next).await,
                changed = offered.changed() => match changed {
                    Ok(()) => {
                        let latest = Arc::clone(&offered.borrow_and_update());
                        self.advertise(latest).await
                    }
                    Err(_) => Err(Parting::Gone),
                },
                Some(answer) = answers.recv() => self.send(answer).await,
                _ = looks.tick(), if !self.parameters.is_empty() => self.tell_parameters().await,
                _ = pings.tick() => self.send(Packet::Ping(Bytes::new())).await,
                () = sleep_until(silent_at) => Err(Parting::Slow),
            };
            if let Err(parting) = outcome {
                return parting;
            }
        }
    }

    async fn greet(&mut self) -> Result<(), Parting> {
        let control = &self.shared.control;
        let may_order = self.access == Access::Order;
        let info = protocol::server_info(control.scenario(), &self.shared.session, may_order);
        self.send_text(info).await?;
        self.send_text(protocol::advertise_services(&Service::ALL.map(Service::advertisement))).await?;
        if self.access == Access::WrongToken {
            count(&self.shared.counters.peers.wrong_tokens, 1);
            return self.warn("the token of this address is wrong: this connection only watches").await;
        }
        Ok(())
    }

    /// Tells what has been added to the channels, and what has gone.
    async fn advertise(&mut self, latest: Offered) -> Result<(), Parting> {
        let is_in = |known: &Offered, channel: &Arc<Channel>| known.contains_key(&channel.id);
        let gone: Vec<Arc<Channel>> =
            self.advertised.values().filter(|channel| !is_in(&latest, channel)).cloned().collect();
        if !gone.is_empty() {
            for channel in &gone {
                if let Some(subscription) = self.outbox.subscription(channel.id) {
                    self.shared.hub.unsubscribe(&self.outbox, subscription);
                }
            }
            let ids: Vec<u32> = gone.iter().map(|channel| channel.id).collect();
            self.send_text(protocol::unadvertise(&ids)).await?;
        }
        let come: Vec<Value> = latest
            .values()
            .filter(|channel| !is_in(&self.advertised, channel))
            .map(|channel| channel.advertisement())
            .collect();
        self.advertised = latest;
        for channels in come.chunks(ADVERTISED_AT_ONCE) {
            self.send_text(protocol::advertise(channels)).await?;
        }
        Ok(())
    }

    async fn take(&mut self, packet: Packet) -> Result<(), Parting> {
        if !self.rate.admits(Instant::now().into_std()) {
            return Err(Parting::Invalid("too many messages"));
        }
        match packet {
            Packet::Text(text) => match serde_json::from_str(&text) {
                Ok(request) => self.handle(request).await,
                Err(_) => Err(Parting::Invalid("no message of the protocol")),
            },
            Packet::Binary(message) => match ServiceCall::read(&message) {
                Some(call) => self.call(&call).await,
                None => Err(Parting::Invalid("no message of the protocol")),
            },
            Packet::Close(_) => Err(Parting::Gone),
            Packet::Ping(_) | Packet::Pong(_) | Packet::Frame(_) => Ok(()),
        }
    }

    async fn handle(&mut self, request: Request) -> Result<(), Parting> {
        match request {
            Request::Subscribe { subscriptions } => {
                for subscription in subscriptions {
                    self.subscribe(subscription).await?;
                }
                Ok(())
            }
            Request::Unsubscribe { subscription_ids } => {
                subscription_ids.iter().for_each(|id| self.shared.hub.unsubscribe(&self.outbox, *id));
                Ok(())
            }
            Request::GetParameters { parameter_names, id } => {
                let is_asked = |name: &str| {
                    parameter_names.is_empty() || parameter_names.iter().any(|asked| asked == name)
                };
                let values = self.shared.control.parameters().into_iter();
                let values: Vec<Value> =
                    values.filter(|(name, _)| is_asked(name)).map(|(_, value)| value).collect();
                self.send_text(protocol::parameter_values(&values, id.as_deref())).await
            }
            Request::SetParameters { parameters, id } => self.set(&parameters, id).await,
            Request::SubscribeParameterUpdates { parameter_names } => {
                self.parameters.extend(known(&parameter_names));
                Ok(())
            }
            Request::UnsubscribeParameterUpdates { parameter_names } => {
                known(&parameter_names).for_each(|name| _ = self.parameters.remove(name));
                Ok(())
            }
            Request::Advertise {}
            | Request::Unadvertise {}
            | Request::SubscribeConnectionGraph {}
            | Request::UnsubscribeConnectionGraph {}
            | Request::FetchAsset {} => self.warn("a city does not offer this").await,
        }
    }

    async fn subscribe(&mut self, subscription: Subscription) -> Result<(), Parting> {
        let Subscription { id, channel_id } = subscription;
        // The hub's own map: a client has no subscription to what is gone.
        let channel = self.advertised.get(&channel_id).cloned();
        let Some(channel) = channel else {
            return self.warn(&format!("there is no channel {channel_id}")).await;
        };
        if !self.shared.hub.subscribe(&self.outbox, &channel, id) {
            return self.warn(&format!("channel {channel_id} or subscription {id} is taken already")).await;
        }
        Ok(())
    }

    /// Sets parameters, and answers with what they are then.
    async fn set(&mut self, parameters: &[Parameter], id: Option<String>) -> Result<(), Parting> {
        let orders: Result<Vec<Order>, String> =
            parameters.iter().take(PARAMETERS.len()).map(control::parameter_order).collect();
        let Some(orders) = self.allowed(orders) else {
            self.warn(WATCHES).await?;
            return self.send_text(self.parameter_answer(id.as_deref())).await;
        };
        let (shared, replies) = (Arc::clone(self.shared), self.replies.clone());
        let is_begun = self.beside(async move {
            let mut outcome = orders.as_ref().map(|_| ()).map_err(Clone::clone);
            for order in orders.unwrap_or_default() {
                outcome = outcome.and(shared.control.carry_out(order).await);
            }
            let values: Vec<Value> =
                shared.control.parameters().into_iter().map(|(_, value)| value).collect();
            if let Err(why) = outcome {
                let status = protocol::status(Level::Error, &why);
                // A client that has gone needs no answer.
                let _ = replies.send(Packet::text(status)).await;
            }
            let answer = protocol::parameter_values(&values, id.as_deref());
            let _ = replies.send(Packet::text(answer)).await;
        });
        if is_begun { Ok(()) } else { self.warn(BUSY).await }
    }

    fn parameter_answer(&self, id: Option<&str>) -> String {
        let values: Vec<Value> =
            self.shared.control.parameters().into_iter().map(|(_, value)| value).collect();
        protocol::parameter_values(&values, id)
    }

    /// What a client of the right token wants; `None` of others.
    fn allowed<T>(&self, wanted: T) -> Option<T> {
        if self.access != Access::Order {
            count(&self.shared.counters.peers.forbidden, 1);
            return None;
        }
        Some(wanted)
    }

    async fn call(&mut self, call: &ServiceCall<'_>) -> Result<(), Parting> {
        let (number, id) = (call.service, call.call);
        let Some(service) = Service::of(number) else {
            return self.send_text(protocol::service_failure(number, id, "there is no such service")).await;
        };
        if call.encoding != protocol::JSON {
            return self.send_text(protocol::service_failure(number, id, "requests have to be JSON")).await;
        }
        let order = match self.allowed(service.order(call.request)) {
            Some(Ok(order)) => order,
            Some(Err(why)) => return self.send(Packet::Binary(answer(number, id, Err(why)))).await,
            None => return self.send(Packet::Binary(answer(number, id, Err(WATCHES.to_owned())))).await,
        };
        let (shared, replies) = (Arc::clone(self.shared), self.replies.clone());
        let is_begun = self.beside(async move {
            let outcome = shared.control.carry_out(order).await;
            // A client that has gone needs no answer.
            let _ = replies.send(Packet::Binary(answer(number, id, outcome))).await;
        });
        if is_begun {
            return Ok(());
        }
        self.send(Packet::Binary(answer(number, id, Err(BUSY.to_owned())))).await
    }

    /// Does something beside the exchange; `false` where too much is done already.
    fn beside(&self, work: impl Future<Output = ()> + Send + 'static) -> bool {
        let Ok(place) = Arc::clone(&self.calls).try_acquire_owned() else {
            count(&self.shared.counters.peers.lost_orders, 1);
            return false;
        };
        tokio::spawn(async move {
            work.await;
            drop(place);
        });
        true
    }

    async fn tell_parameters(&mut self) -> Result<(), Parting> {
        let now = self.shared.control.parameters();
        let changed: Vec<Value> = now
            .iter()
            .filter(|(name, _)| self.parameters.contains(name))
            .filter(|value| !self.told.contains(value))
            .map(|(_, value)| value.clone())
            .collect();
        self.told = now;
        if changed.is_empty() {
            return Ok(());
        }
        self.send_text(protocol::parameter_values(&changed, None)).await
    }

    /// Sends what waits, one message behind another.
    async fn deliver(&mut self, first: Next) -> Result<(), Parting> {
        let (sink, outbox) = (&mut self.sink, &self.outbox);
        let mut count = 0;
        let work = async {
            let mut next = Some(first);
            while let Some(message) = next {
                sink.feed(Packet::Binary(match message {
                    Next::Time(stamp_ns) => protocol::time(stamp_ns),
                    Next::Message(message) => {
                        protocol::message_data(message.subscription, message.stamp_ns, &message.payload)
                    }
                }))
                .await?;
                count += 1;
                next = if count < BATCH { outbox.take() } else { None };
            }
            sink.flush().await
        };
        let outcome = timeout(self.shared.patience.send, work).await;
        self.sent(outcome.map(|sent| sent.map_err(|_| Parting::Gone)), count as u64)
    }

    async fn warn(&mut self, why: &str) -> Result<(), Parting> {
        self.send_text(protocol::status(Level::Warning, why)).await
    }

    async fn send_text(&mut self, text: String) -> Result<(), Parting> {
        self.send(Packet::text(text)).await
    }

    async fn send(&mut self, packet: Packet) -> Result<(), Parting> {
        let outcome = timeout(self.shared.patience.send, self.sink.send(packet)).await;
        self.sent(outcome.map(|sent| sent.map_err(|_| Parting::Gone)), 1)
    }

    fn sent<E>(&self, outcome: Result<Result<(), Parting>, E>, sent: u64) -> Result<(), Parting> {
        match outcome {
            Ok(Ok(())) => {
                count(&self.shared.counters.peers.messages, sent);
                Ok(())
            }
            Ok(Err(parting)) => Err(parting),
            Err(_) => Err(Parting::Slow),
        }
    }

    /// Says why it is disconnected where that may be heard.
    async fn part(mut self, parting: Parting) {
        let counters = &self.shared.counters.peers;
        match parting {
            // Who says goodbye is answered; who has gone does not mind.
            Parting::Gone => drop(timeout(self.shared.patience.send, self.sink.close()).await),
            Parting::Slow => count(&counters.slow, 1),
            Parting::Invalid(why) => {
                count(&counters.invalid, 1);
                let frame = CloseFrame { code: CloseCode::Policy, reason: why.into() };
                // Who sends nonsense need not hear of it.
                let _ = timeout(self.shared.patience.send, self.sink.send(Packet::Close(Some(frame)))).await;
            }
        }
    }
}

/// The names of parameters that a city has.
fn known(names: &[String]) -> impl Iterator<Item = &'static str> {
    PARAMETERS.into_iter().filter(move |known| names.iter().any(|name| name == known))
}

/// The answer of a service.
fn answer(service: u32, call: u32, outcome: Result<(), String>) -> Bytes {
    let response = match outcome {
        Ok(()) => json!({ "success": true, "message": "" }),
        Err(why) => json!({ "success": false, "message": why }),
    };
    protocol::service_response(service, call, &response)
}

fn parting_of(error: &tokio_tungstenite::tungstenite::Error) -> Parting {
    use tokio_tungstenite::tungstenite::Error;
    use tokio_tungstenite::tungstenite::error::ProtocolError;
    match error {
        Error::Capacity(_) => Parting::Invalid("the message is too long"),
        Error::Protocol(ProtocolError::ResetWithoutClosingHandshake) => Parting::Gone,
        Error::Protocol(_) | Error::Utf8(_) => Parting::Invalid("no WebSocket"),
        _ => Parting::Gone,
    }
}
