//! One page that is connected: what it is told, and what it may ask for.

use crate::feed::Told;
use crate::h264::IS_BUILT;
use crate::message::{MAX_MESSAGE_BYTES, PageMessage, PageView, SLOTS};
use crate::picture::{Picture, PictureKind};
use crate::pictures::Look;
use crate::server::Shared;
use city3d_network::listener::{Patience, count};
use city3d_protocol::snapshot::{Pedals, VehicleId};
use city3d_session::{GuestAct, MessageRate, Order, Speed};
use futures_util::stream::SplitSink;
use futures_util::{SinkExt, StreamExt};
use serde_json::json;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::{Instant, sleep_until, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, Role, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Message as Packet, Utf8Bytes};

/// How long the server waits for a page. It sends something every two seconds, in the background of a browser once a minute.
pub const PATIENCE: Patience = Patience {
    request: Duration::from_secs(5),
    send: Duration::from_secs(5),
    silence: Duration::from_secs(120),
};
/// A vehicle is handed back when no pedals have come for this long.
const PEDALS_TIMEOUT: Duration = Duration::from_millis(500);
/// Messages of a page in a second, at most.
const MAX_RATE: u32 = 200;
/// Close code for a wrong token: the page then goes on as a spectator.
const WRONG_TOKEN: u16 = 4401;

type Sink = SplitSink<WebSocketStream<TcpStream>, Packet>;

/// Why a page is disconnected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Parting {
    /// It has gone by itself.
    Gone,
    WrongToken,
    Invalid(&'static str),
    Slow,
}

/// Serves a page until it goes.
pub(crate) async fn serve(stream: TcpStream, shared: &Shared) {
    let config = WebSocketConfig::default()
        .max_message_size(Some(MAX_MESSAGE_BYTES))
        .max_frame_size(Some(MAX_MESSAGE_BYTES));
    let socket = WebSocketStream::from_raw_socket(stream, Role::Server, Some(config)).await;
    let (sink, mut from) = socket.split();
    let mut page = Page {
        shared,
        number: shared.next_page(),
        sink,
        may_order: None,
        driven: None,
        is_guest: false,
        own: None,
        looks: std::array::from_fn(|_| None),
        told: [0; 3],
        rate: MessageRate::new(MAX_RATE, Instant::now().into_std()),
    };
    shared.counters.peers.enter();
    let parting = page.exchange(&mut from).await;
    shared.counters.peers.leave();
    page.part(parting).await;
}

struct Page<'a> {
    shared: &'a Shared,
    number: u64,
    sink: Sink,
    /// Has it shown the token? `None` before its first message.
    may_order: Option<bool>,
    /// The vehicle that it drives, and when its pedals end.
    driven: Option<(VehicleId, Instant)>,
    /// It has come as a guest.
    is_guest: bool,
    /// Its car, once the city has it.
    own: Option<VehicleId>,
    looks: [Option<Look>; SLOTS],
    /// Versions of the texts that it has.
    told: [u64; 3],
    rate: MessageRate,
}

impl Page<'_> {
    async fn exchange(
        &mut self,
        from: &mut futures_util::stream::SplitStream<WebSocketStream<TcpStream>>,
    ) -> Parting {
        let mut told = self.shared.told.subscribe();
        told.mark_changed();
        let patience = self.shared.patience;
        let mut silent_at = Instant::now() + patience.request;
        loop {
            let pedals_end = self.driven.map_or(silent_at, |(_, until)| until);
            let is_known = self.may_order.is_some();
            let [large, small] = &mut self.looks;
            let outcome = tokio::select! {
                packet = from.next() => {
                    silent_at = Instant::now() + patience.silence;
                    match packet {
                        Some(Ok(packet)) => self.take(packet).await,
                        Some(Err(error)) => Err(parting_of(&error)),
                        None => Err(Parting::Gone),
                    }
                }
                changed = told.changed(), if is_known => match changed {
                    Ok(()) => {
                        let latest = told.borrow_and_update().clone();
                        self.tell(latest).await
                    }
                    Err(_) => Err(Parting::Gone),
                },
                picture = next_picture(large) => self.show(0, picture).await,
                picture = next_picture(small) => self.show(1, picture).await,
                () = sleep_until(pedals_end), if self.driven.is_some() => {
                    self.release();
                    Ok(())
                }
                () = sleep_until(silent_at) => Err(Parting::Slow),
            };
            if let Err(parting) = outcome {
                return parting;
            }
        }
    }

    async fn take(&mut self, packet: Packet) -> Result<(), Parting> {
        if !self.rate.admits(Instant::now().into_std()) {
            return Err(Parting::Invalid("too many messages"));
        }
        match packet {
            Packet::Text(text) => match serde_json::from_str(&text) {
                Ok(message) => self.handle(message).await,
                Err(_) => Err(Parting::Invalid("no message of the page")),
            },
            Packet::Close(_) => Err(Parting::Gone),
            Packet::Ping(_) | Packet::Pong(_) | Packet::Frame(_) => Ok(()),
            Packet::Binary(_) => Err(Parting::Invalid("no message of the page")),
        }
    }

    async fn handle(&mut self, message: PageMessage) -> Result<(), Parting> {
        match (self.may_order, message) {
            (None, PageMessage::Hello { token }) => self.greet(token.as_deref()).await,
            (None, _) | (Some(_), PageMessage::Hello { .. }) => {
                Err(Parting::Invalid("hello comes first, once"))
            }
            (Some(_), PageMessage::Look { slot, view, width, height, h264 }) => {
                self.look(slot, (view, h264 && IS_BUILT), [width, height]).await
            }
            (Some(_), PageMessage::Seen { slot }) => {
                if let Some(Some(look)) = self.looks.get_mut(slot) {
                    look.seen();
                }
                Ok(())
            }
            (Some(_), PageMessage::Ping { sent_ms }) => {
                self.send_text(json!({ "t": "pong", "sent_ms": sent_ms }).to_string().into()).await
            }
            (Some(true), order) => self.order(&order).await,
            (Some(false), _) => {
                count(&self.shared.counters.peers.forbidden, 1);
                self.say("this page watches; the address with the token gives orders").await
            }
        }
    }

    async fn greet(&mut self, token: Option<&str>) -> Result<(), Parting> {
        let may_order = token.is_some_and(|token| self.shared.token.is(token));
        if token.is_some() && !may_order {
            return Err(Parting::WrongToken);
        }
        self.may_order = Some(may_order);
        let is_log = self.shared.control.head().is_some();
        let welcome = json!({ "t": "welcome", "version": env!("CARGO_PKG_VERSION"), "may_order": may_order, "is_log": is_log,
            "guest": self.guest(), "has_h264": IS_BUILT, "has_pictures": self.shared.pictures.are_drawn(), "no_pictures": self.shared.pictures.failure() });
        self.send_text(welcome.to_string().into()).await?;
        let map = Utf8Bytes::from(&*self.shared.map);
        self.send_text(map).await
    }

    async fn order(&mut self, order: &PageMessage) -> Result<(), Parting> {
        let control = &self.shared.control;
        match *order {
            PageMessage::Start => control.order(Order::Start),
            PageMessage::Pause => control.order(Order::Pause),
            PageMessage::Reset => control.order(Order::Reset),
            PageMessage::Step => control.order(Order::Step),
            PageMessage::Speed { factor } => control.order(Order::Speed(Speed::times(factor))),
            PageMessage::Seek { time_s } => control.seek(time_s),
            PageMessage::Release => self.release(),
            PageMessage::Join => return self.join().await,
            PageMessage::Leave => self.leave(),
            PageMessage::Drive { vehicle, pedals } => {
                return self.drive(VehicleId(vehicle), pedals.pedals()).await;
            }
            _ => {}
        }
        Ok(())
    }

    async fn drive(&mut self, vehicle: VehicleId, pedals: Pedals) -> Result<(), Parting> {
        if self.driven.is_some_and(|(driven, _)| driven != vehicle) {
            self.release();
        }
        if self.shared.control.head().is_some() {
            return self.say("this is a log: nobody drives in it").await;
        }
        if self.own == Some(vehicle) {
            self.shared.control.guest(self.guest(), GuestAct::Drive(pedals));
        } else if !self.shared.control.drive(self.number, vehicle, pedals) {
            return self.say("somebody else drives this vehicle").await;
        }
        self.driven = Some((vehicle, Instant::now() + PEDALS_TIMEOUT));
        Ok(())
    }

    fn release(&mut self) {
        let Some((vehicle, _)) = self.driven.take() else { return };
        if self.own == Some(vehicle) {
            self.shared.control.guest(self.guest(), GuestAct::Release);
        } else {
            self.shared.control.release(self.number, vehicle);
        }
    }

    /// Its number as a guest: pages that are connected at once have different ones.
    fn guest(&self) -> u16 {
        (self.number % 0x1_0000) as u16
    }

    async fn join(&mut self) -> Result<(), Parting> {
        if self.shared.control.head().is_some() {
            return self.say("this is a log: nobody drives in it").await;
        }
        if !std::mem::replace(&mut self.is_guest, true) {
            self.shared.control.guest(self.guest(), GuestAct::Join);
        }
        Ok(())
    }

    fn leave(&mut self) {
        self.release();
        if std::mem::take(&mut self.is_guest) {
            self.shared.control.guest(self.guest(), GuestAct::Leave);
        }
    }

    async fn look(
        &mut self,
        slot: usize,
        (view, is_video): (Option<PageView>, bool),
        extent: [u32; 2],
    ) -> Result<(), Parting> {
        let Some(place) = self.looks.get_mut(slot) else {
            return Err(Parting::Invalid("there is no such picture"));
        };
        *place = None;
        let Some(view) = view else { return Ok(()) };
        *place = self.shared.pictures.look(view, extent, is_video);
        if place.is_none() {
            return self.say("no more pictures can be drawn").await;
        }
        Ok(())
    }

    async fn tell(&mut self, told: Option<Told>) -> Result<(), Parting> {
        let Some(told) = told else { return Ok(()) };
        self.own = told.car_of(self.guest()).filter(|_| self.is_guest);
        let Told { roster, events, state, .. } = told;
        for (k, text) in [roster, events, state].into_iter().enumerate() {
            if self.told[k] != text.version {
                if k == 2 && self.told[k] > 0 {
                    let missed = text.version.saturating_sub(self.told[k] + 1);
                    count(&self.shared.counters.skipped_states, missed);
                }
                self.told[k] = text.version;
                self.send_text(Utf8Bytes::from(&*text.text)).await?;
            }
        }
        Ok(())
    }

    /// Sends a picture behind a byte with its place on the page (0 and 1) and its kind (JPEG 0, H.264: key frame 2, other
    /// frame 4).
    async fn show(&mut self, slot: u8, picture: Option<(Picture, u64)>) -> Result<(), Parting> {
        let Some((picture, skipped)) = picture else {
            self.looks[usize::from(slot)] = None;
            return Ok(());
        };
        let kind = match picture.kind {
            PictureKind::Jpeg => 0,
            PictureKind::KeyFrame => 2,
            PictureKind::DeltaFrame => 4,
        };
        let mut bytes = Vec::with_capacity(picture.bytes.len() + 1);
        bytes.push(slot + kind);
        bytes.extend_from_slice(&picture.bytes);
        count(&self.shared.counters.pictures, 1);
        count(&self.shared.counters.skipped_pictures, skipped);
        self.send(Packet::Binary(bytes.into())).await
    }

    async fn say(&mut self, text: &str) -> Result<(), Parting> {
        self.send_text(json!({ "t": "notice", "text": text }).to_string().into()).await
    }

    async fn send_text(&mut self, text: Utf8Bytes) -> Result<(), Parting> {
        self.send(Packet::Text(text)).await
    }

    async fn send(&mut self, packet: Packet) -> Result<(), Parting> {
        match timeout(self.shared.patience.send, self.sink.send(packet)).await {
            Ok(Ok(())) => {
                count(&self.shared.counters.peers.messages, 1);
                Ok(())
            }
            Ok(Err(_)) => Err(Parting::Gone),
            Err(_) => Err(Parting::Slow),
        }
    }

    /// Hands its vehicle back, takes its own away, and says why it is disconnected where that may be heard.
    async fn part(mut self, parting: Parting) {
        self.leave();
        let counters = &self.shared.counters.peers;
        let (counter, code, reason) = match parting {
            Parting::Gone => return,
            Parting::Slow => return count(&counters.slow, 1),
            Parting::WrongToken => (&counters.wrong_tokens, WRONG_TOKEN, "wrong token"),
            Parting::Invalid(why) => (&counters.invalid, CloseCode::Policy.into(), why),
        };
        count(counter, 1);
        let frame = CloseFrame { code: CloseCode::from(code), reason: reason.into() };
        // Who sends nonsense need not hear of it.
        let _ = timeout(self.shared.patience.send, self.sink.send(Packet::Close(Some(frame)))).await;
    }
}

fn parting_of(error: &tokio_tungstenite::tungstenite::Error) -> Parting {
    use tokio_tungstenite::tungstenite::Error;
    match error {
        Error::Capacity(_) => Parting::Invalid("the message is too long"),
        Error::Protocol(
            tokio_tungstenite::tungstenite::error::ProtocolError::ResetWithoutClosingHandshake,
        ) => Parting::Gone,
        Error::Protocol(_) | Error::Utf8(_) => Parting::Invalid("no WebSocket"),
        _ => Parting::Gone,
    }
}

/// The next picture of a look; waits for ever where nothing is looked at.
async fn next_picture(look: &mut Option<Look>) -> Option<(Picture, u64)> {
    match look {
        Some(look) => look.next().await,
        None => std::future::pending().await,
    }
}
