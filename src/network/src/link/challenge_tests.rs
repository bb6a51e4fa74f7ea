//! Challenges in simulated time: what was recorded cannot be played back, a stranger gets no more bytes than it has sent,
//! and a client whose answers are in vain begins a new session.

use super::simulated_tests::{ADDRESS, KEY, LONG, city, client, clock, key, options, start};
use super::{Client, ClientEvent, Server};
use crate::host::{DatagramSocket, Host};
use crate::simulated::{SimulatedNetwork, SimulatedOptions};
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, DropReason, MAX_DATAGRAM_BYTES, RequestOutcome,
};
use std::time::Duration;

/// Somebody between a client and its city, who reads what passes and knows no key. It stands at its own address, where
/// the city takes it for the client.
struct Eavesdropper {
    socket: Box<dyn DatagramSocket>,
    recorded: Vec<Vec<u8>>,
}

const BETWEEN: &str = "127.0.0.1:9999";

impl Eavesdropper {
    fn new(host: &Host) -> Self {
        Self { socket: host.network.bind(BETWEEN.parse().unwrap()).unwrap(), recorded: Vec::new() }
    }

    /// Passes on what comes, until nothing comes for this long.
    fn pass_on(&mut self, quiet: Duration) {
        let city = ADDRESS.parse().unwrap();
        let (mut bytes, mut client) = ([0; MAX_DATAGRAM_BYTES], None);
        while let Some((length, from)) = self.socket.receive(&mut bytes, quiet).unwrap() {
            let datagram = bytes[..length].to_vec();
            if from == city {
                if let Some(to) = client {
                    self.socket.send_burst(to, &[datagram]).unwrap();
                }
            } else {
                client = Some(from);
                self.recorded.push(datagram.clone());
                self.socket.send_burst(city, &[datagram]).unwrap();
            }
        }
    }

    /// Sends everything again from a socket; gives the number and the bytes of the answers.
    fn replay(&self, socket: &dyn DatagramSocket) -> (usize, usize) {
        socket.send_burst(ADDRESS.parse().unwrap(), &self.recorded).unwrap();
        let (mut bytes, mut answers) = ([0; MAX_DATAGRAM_BYTES], (0, 0));
        while let Some((length, _)) = socket.receive(&mut bytes, Duration::from_millis(100)).unwrap() {
            answers = (answers.0 + 1, answers.1 + length);
        }
        answers
    }

    fn sent(&self) -> usize {
        self.recorded.iter().map(Vec::len).sum()
    }
}

#[test]
fn what_was_recorded_cannot_be_played_back_from_anywhere() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    let city = lab.spawn("city", |host| {
        let server = Server::on(&host, &options(key(KEY))).unwrap();
        let mut commands = 0;
        while let Some(inbound) = server.receive(Duration::from_secs(50)) {
            match inbound.body {
                Body::Hello { token } => server.send(inbound.sender, &Body::Clock(clock(token))),
                Body::Command { request, .. } => {
                    commands += 1;
                    let (outcome, detail) = (RequestOutcome::Done, String::new());
                    server.send(inbound.sender, &Body::Ack { request, outcome, tick: 0, detail });
                }
                body => panic!("{body:?}"),
            }
        }
        (commands, server.counters().dropped)
    });
    let between = lab.spawn("between", |host| {
        let mut between = Eavesdropper::new(&host);
        between.pass_on(Duration::from_secs(2));
        let elsewhere = host.network.bind("127.0.0.1:5000".parse().unwrap()).unwrap();
        let found = [between.replay(&*elsewhere), between.replay(&*between.socket)];
        // Not either when the city has no reason any more to remember the session.
        host.clock.sleep(Duration::from_secs(40));
        (found, between.replay(&*elsewhere), between.recorded.len(), between.sent())
    });
    lab.spawn("client", |host| {
        let mut client = Client::on(&host, BETWEEN, 1, key(KEY)).unwrap();
        for _ in 0..3 {
            assert_eq!(client.request(LONG, start), Some((RequestOutcome::Done, String::new())));
        }
    });
    lab.run();
    let ((commands, dropped), ([elsewhere, there], later, count, sent)) = (city.join(), between.join());
    assert_eq!((commands, count), (3, 4), "a handshake and three requests");
    // Only the first datagram is answered: with a challenge that nobody can answer without the key.
    for (answers, bytes) in [elsewhere, there, later] {
        assert!(answers == 1 && bytes < sent / count + 16, "{answers} answers of {bytes} bytes to {sent}");
    }
    assert_eq!(
        dropped.of(DropReason::OtherCity),
        3 + 3,
        "from elsewhere, where its challenge counts for nothing"
    );
    assert_eq!(dropped.of(DropReason::Duplicate), 3, "from the same address");
}

#[test]
fn a_stranger_gets_no_more_bytes_than_it_has_sent() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    lab.spawn("city", city);
    let other = lab.clone();
    let visitor = lab.spawn("visitor", move |host| {
        let socket = host.network.connect(ADDRESS.parse().unwrap()).unwrap();
        let mut bytes = [0; MAX_DATAGRAM_BYTES];
        let mut ask = |body: &Body, header: DatagramHeader| {
            let datagram = body.encode(header, &Authenticator::Checksum).unwrap();
            socket.send(&datagram).unwrap();
            let answer = socket.receive(&mut bytes, Duration::from_millis(10)).unwrap();
            answer.map(|(length, _)| (length <= datagram.len(), bytes[..length].to_vec()))
        };
        let header = DatagramHeader { session: 7, sequence: 1, ..DatagramHeader::default() };
        let hello = Body::Hello { token: 9 };
        let subscribe = Body::Subscribe { request: 1, every_ticks: 1, lease_s: 60.0 };
        assert_eq!(ask(&subscribe, header), None);
        assert_eq!(ask(&start(1), header), None);
        let (is_short, challenge) = ask(&hello, header).unwrap();
        let (_, body) = Body::decode(&challenge, &Authenticator::Checksum).unwrap();
        let Body::Challenge { token: 9, challenge } = body else { panic!("{body:?}") };
        // The challenge is for this session; another one, or a wrong guess, gets nothing.
        assert_eq!(ask(&start(1), DatagramHeader { session: 8, peer: challenge, ..header }), None);
        assert_eq!(ask(&start(1), DatagramHeader { peer: challenge ^ 1 << 40, ..header }), None);
        let answered = ask(&start(1), DatagramHeader { peer: challenge, ..header }).is_some();
        other.stop("city");
        (is_short, answered)
    });
    lab.run();
    assert_eq!(visitor.join(), (true, true));
}

#[test]
fn who_is_not_answered_begins_a_new_session() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    // It challenges everybody, and has forgotten them at once.
    lab.spawn("city", |host| {
        let socket = host.network.bind(ADDRESS.parse().unwrap()).unwrap();
        let mut bytes = [0; MAX_DATAGRAM_BYTES];
        while let Some((length, from)) = socket.receive(&mut bytes, Duration::from_secs(5)).unwrap() {
            let (header, body) = Body::decode(&bytes[..length], &Authenticator::Checksum).unwrap();
            let Body::Hello { token } = body else { continue };
            if header.peer == 0 {
                let header = DatagramHeader { session: 5, peer: header.session, ..DatagramHeader::default() };
                let challenge = Body::Challenge { token, challenge: 77 };
                let challenge = challenge.encode(header, &Authenticator::Checksum).unwrap();
                socket.send_burst(from, &[challenge]).unwrap();
            }
        }
    });
    let visitor = lab.spawn("visitor", |host| {
        let mut client = client(&host);
        let restarted = (1..).find(|_| {
            client.probe();
            client.receive(Duration::from_secs(1)) == Some(ClientEvent::Restarted)
        });
        client.reset_session();
        (restarted, client.is_connected())
    });
    lab.run();
    assert_eq!(visitor.join(), (Some(4), false));
}
