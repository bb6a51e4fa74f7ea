//! The publishing end of TCPROS: subscribers connect, greet, and get messages by bounded queues.

use super::{MessageType, Node, header};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::time::timeout;

/// Messages that wait for a subscriber; of more, the oldest are dropped.
const QUEUE: usize = 64;
/// Bytes that are written at once, but for longer messages.
const BATCH: usize = 32 << 10;
/// Asked of the system for each connection, so that what waits for slow ones is bounded there too.
const SOCKET_BYTES: usize = 64 << 10;
/// Whoever connects has to say what for within this.
const GREETING: Duration = Duration::from_secs(5);

/// A topic that is published.
#[derive(Debug)]
pub(super) struct Publication {
    pub kind: MessageType,
    pub outboxes: Vec<Rc<Outbox>>,
}

/// What waits for one subscriber.
#[derive(Debug)]
pub(super) struct Outbox {
    /// Of the connection.
    pub id: i32,
    /// Name of the subscriber.
    pub peer: String,
    queue: RefCell<VecDeque<Rc<[u8]>>>,
    /// Something has come in, or the topic is no longer published.
    is_changed: Notify,
    is_closed: Cell<bool>,
    pub sent: Cell<u64>,
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

    /// Takes a message in; `false` where another one had to go for it.
    pub(super) fn push(&self, message: Rc<[u8]>) -> bool {
        let mut queue = self.queue.borrow_mut();
        let has_room = queue.len() < QUEUE;
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

    /// Moves what waits into a batch, as far as it holds it.
    fn drain(&self, batch: &mut Vec<u8>) {
        batch.clear();
        let mut queue = self.queue.borrow_mut();
        while let Some(message) = queue.front()
            && (batch.is_empty() || batch.len() + message.len() <= BATCH)
        {
            batch.extend(&**message);
            queue.pop_front();
            self.sent.set(self.sent.get() + 1);
        }
        self.sent_bytes.set(self.sent_bytes.get() + batch.len() as u64);
    }
}

/// A message as it is sent: its length first.
pub(super) fn framed(write: impl FnOnce(&mut Vec<u8>)) -> Rc<[u8]> {
    let mut bytes = vec![0; 4];
    write(&mut bytes);
    let length = (bytes.len() - 4) as u32;
    bytes[..4].copy_from_slice(&length.to_le_bytes());
    bytes.into()
}

/// Serves one who has connected, until either of both has enough.
pub(super) async fn serve(node: Node, mut stream: TcpStream) {
    // Without it each message would wait for the answer to the one before; a socket that refuses is gone.
    let _ = stream.set_nodelay(true);
    let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SOCKET_BYTES);
    let greeting = match timeout(GREETING, header::read(&mut stream)).await {
        Ok(greeting) => greeting,
        Err(_) => Err(format!("no header within {} s", GREETING.as_secs())),
    };
    let admitted = greeting.and_then(|fields| {
        let topic = fields.get("topic").cloned().ok_or("a header without a topic")?;
        let (outbox, kind) = node.admit(&topic, &fields)?;
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
                Ok(()) => feed(&mut stream, &outbox).await,
                Err(error) => Err(error),
            };
            tracing::debug!("{} no longer hears {topic}: {ended:?}", outbox.peer);
            node.dismiss(&topic, outbox.id);
        }
        Err(why) => {
            tracing::debug!("a subscriber is refused: {why}");
            // Who does not read it loses nothing.
            let _ = timeout(GREETING, stream.write_all(&header::encode(&[("error", &why)]))).await;
        }
    }
}

async fn feed(stream: &mut TcpStream, outbox: &Outbox) -> std::io::Result<()> {
    let (mut from, mut to) = stream.split();
    let mut batch = Vec::new();
    let mut said = [0; 64];
    while !outbox.is_closed.get() {
        outbox.drain(&mut batch);
        if !batch.is_empty() {
            to.write_all(&batch).await?;
            continue;
        }
        tokio::select! {
            () = outbox.is_changed.notified() => {}
            // A subscriber has nothing to say; that there is nothing more to read tells that it is gone.
            _ = from.read(&mut said) => return Ok(()),
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
        let dropped = (0..QUEUE + 10).filter(|k| !outbox.push(message(*k))).count();
        let mut batch = Vec::new();
        outbox.drain(&mut batch);
        assert_eq!((dropped, batch.len()), (10, QUEUE * 8));
        assert_eq!(batch[..8], [4, 0, 0, 0, 10, 0, 0, 0]);
        outbox.drain(&mut batch);
        assert!(batch.is_empty());
    }

    #[test]
    fn a_batch_is_bounded_but_a_long_message_is_sent() {
        let outbox = Outbox::new(1, String::new());
        for _ in 0..3 {
            outbox.push(framed(|out| out.resize(4 + 2 * BATCH, 7)));
        }
        let mut batch = Vec::new();
        for _ in 0..3 {
            outbox.drain(&mut batch);
            assert_eq!(batch.len(), 4 + 2 * BATCH);
        }
    }
}
