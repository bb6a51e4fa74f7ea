//! Publishing end of TCPROS: handshake with subscribers, and a bounded queue of messages for each.

use super::{MessageType, RosNode, header};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::time::timeout;

/// Messages in the queue of a subscriber; the oldest are dropped (load shedding).
const OUTBOX_CAPACITY: usize = 64;
/// Bytes of one write, except for longer messages.
const BATCH_BYTES: usize = 32 << 10;
/// Send buffer of each connection, which bounds what the kernel queues for slow subscribers.
const SOCKET_BYTES: usize = 64 << 10;
/// Longest wait for the connection header of a subscriber.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(5);

/// A published topic and its subscribers.
#[derive(Debug)]
pub(super) struct Publication {
    /// Message type that subscribers must agree on.
    pub kind: MessageType,
    /// One queue for each connected subscriber.
    pub outboxes: Vec<Rc<Outbox>>,
}

/// Bounded queue of messages for one subscriber.
#[derive(Debug)]
pub(super) struct Outbox {
    /// Id of the connection.
    pub id: i32,
    /// Name of the subscriber.
    pub peer: String,
    queue: RefCell<VecDeque<Rc<[u8]>>>,
    /// A message was queued, or the topic was unadvertised.
    is_changed: Notify,
    is_closed: Cell<bool>,
    /// Messages that were taken from the queue to be sent.
    pub sent: Cell<u64>,
    /// Bytes of these messages with their length prefixes.
    pub sent_bytes: Cell<u64>,
}

impl Outbox {
    pub(super) fn new(id: i32, peer: String) -> Self {
        Self {
            id,
            peer,
            queue: RefCell::default(),
            is_changed: Notify::new(),
            is_closed: Cell::new(false),
            sent: Cell::new(0),
            sent_bytes: Cell::new(0),
        }
    }

    /// Queues a message; `false` when the oldest one was dropped for it.
    pub(super) fn push(&self, message: Rc<[u8]>) -> bool {
        let mut queue = self.queue.borrow_mut();
        let has_room = queue.len() < OUTBOX_CAPACITY;
        if !has_room {
            queue.pop_front();
        }
        queue.push_back(message);
        self.is_changed.notify_one();
        has_room
    }

    pub(super) fn close(&self) {
        self.is_closed.set(true);
        self.is_changed.notify_one();
    }

    /// Moves waiting messages into a batch, up to its size.
    fn drain(&self, batch: &mut Vec<u8>) {
        batch.clear();
        let mut queue = self.queue.borrow_mut();
        while let Some(message) = queue.front()
            && (batch.is_empty() || batch.len() + message.len() <= BATCH_BYTES)
        {
            batch.extend(&**message);
            queue.pop_front();
            self.sent.set(self.sent.get() + 1);
        }
        self.sent_bytes.set(self.sent_bytes.get() + batch.len() as u64);
    }
}

/// Encodes a message with its length prefix.
pub(super) fn framed(write: impl FnOnce(&mut Vec<u8>)) -> Rc<[u8]> {
    let mut bytes = vec![0; 4];
    write(&mut bytes);
    let length = (bytes.len() - 4) as u32;
    bytes[..4].copy_from_slice(&length.to_le_bytes());
    bytes.into()
}

/// Serves a subscriber until one end closes the connection.
pub(super) async fn serve(node: RosNode, mut stream: TcpStream) {
    // Nagle's algorithm would delay each message until the one before is acknowledged. An error means a closed socket.
    let _ = stream.set_nodelay(true);
    let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SOCKET_BYTES);
    let header = match timeout(HANDSHAKE_TIMEOUT, header::read(&mut stream)).await {
        Ok(header) => header,
        Err(_) => Err(format!("no header within {} s", HANDSHAKE_TIMEOUT.as_secs())),
    };
    let admitted = header.and_then(|fields| {
        let topic = fields.get("topic").cloned().ok_or("a header without a topic")?;
        let (outbox, kind) = node.add_subscriber(&topic, &fields)?;
        Ok((topic, outbox, kind))
    });
    match admitted {
        Ok((topic, outbox, kind)) => {
            let fields = [
                ("callerid", node.name()),
                ("latching", "0"),
                ("md5sum", kind.md5sum),
                ("message_definition", kind.definition),
                ("topic", &topic),
                ("type", kind.name),
            ];
            let ended = match stream.write_all(&header::encode(&fields)).await {
                Ok(()) => send_messages(&mut stream, &outbox).await,
                Err(error) => Err(error),
            };
            tracing::debug!("{} no longer receives {topic}: {ended:?}", outbox.peer);
            node.remove_subscriber(&topic, outbox.id);
        }
        Err(why) => {
            tracing::debug!("a subscriber is refused: {why}");
            // The subscriber may not read the error.
            let _ = timeout(HANDSHAKE_TIMEOUT, stream.write_all(&header::encode(&[("error", &why)]))).await;
        }
    }
}

async fn send_messages(stream: &mut TcpStream, outbox: &Outbox) -> std::io::Result<()> {
    let (mut from, mut to) = stream.split();
    let mut batch = Vec::new();
    let mut received = [0; 64];
    while !outbox.is_closed.get() {
        outbox.drain(&mut batch);
        if !batch.is_empty() {
            to.write_all(&batch).await?;
            continue;
        }
        tokio::select! {
            () = outbox.is_changed.notified() => {}
            // A subscriber sends nothing more; the end of its stream shows that it is gone.
            _ = from.read(&mut received) => return Ok(()),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_more_messages_than_a_queue_holds_the_oldest_go() {
        let outbox = Outbox::new(1, String::new());
        let message = |k: usize| framed(|out| out.extend((k as u32).to_le_bytes()));
        let dropped = (0..OUTBOX_CAPACITY + 10).filter(|k| !outbox.push(message(*k))).count();
        let mut batch = Vec::new();
        outbox.drain(&mut batch);
        assert_eq!((dropped, batch.len()), (10, OUTBOX_CAPACITY * 8));
        assert_eq!(batch[..8], [4, 0, 0, 0, 10, 0, 0, 0]);
        outbox.drain(&mut batch);
        assert!(batch.is_empty());
    }

    #[test]
    fn a_batch_is_bounded_but_a_long_message_is_sent() {
        let outbox = Outbox::new(1, String::new());
        for _ in 0..3 {
            outbox.push(framed(|out| out.resize(4 + 2 * BATCH_BYTES, 7)));
        }
        let mut batch = Vec::new();
        for _ in 0..3 {
            outbox.drain(&mut batch);
            assert_eq!(batch.len(), 4 + 2 * BATCH_BYTES);
        }
    }
}
