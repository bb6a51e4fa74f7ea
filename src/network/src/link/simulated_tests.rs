//! The link in simulated time: handshake, requests, denials, replay protection, rate limit, restarts and partitions.

use super::{Client, ClientEvent, PhysicalFleet, Server, ServerOptions};
use crate::host::{DatagramSocket, Host};
use crate::simulated::{Participant, SimulatedNetwork, SimulatedOptions};
use city3d_geometry::Pose2;
use city3d_protocol::snapshot::{Trajectory, TrajectoryPoint, VehicleId};
use city3d_protocol::wire::{
    Authenticator, Body, CityClock, DatagramHeader, Denial, DenialReason, DropReason, ExperimentAction,
    ExperimentPhase, MAX_DATAGRAM_BYTES, RequestOutcome,
};
use std::time::{Duration, Instant};

pub(super) const ADDRESS: &str = "127.0.0.1:9870";
pub(super) const LONG: Duration = Duration::from_secs(60);

pub(super) fn options(authenticator: Authenticator) -> ServerOptions {
    ServerOptions {
        address: ADDRESS.to_owned(),
        world: 1,
        authenticator,
        allowed: Vec::new(),
        rate_per_s: 1000.0,
        takes_clock: true,
    }
}

fn server(host: &Host, rate_per_s: f64) -> Server {
    let options = ServerOptions { rate_per_s, ..options(Authenticator::Checksum) };
    Server::on(host, &options).unwrap()
}

pub(super) fn client(host: &Host) -> Client {
    Client::on(host, ADDRESS, 1, Authenticator::Checksum).unwrap()
}

pub(super) fn clock(token: u64) -> CityClock {
    CityClock {
        token,
        tick: 0,
        time_s: 0.0,
        physics_hz: 100,
        length_scale: 25.0,
        phase: ExperimentPhase::Ready,
        is_lockstep: false,
    }
}

/// A city that answers handshakes and commands, until it is stopped.
pub(super) fn city(host: Host) {
    answer_all(&server(&host, 1000.0));
}

/// A city with these settings, until it is stopped.
fn city_with(options: ServerOptions) -> impl FnOnce(Host) + Send + 'static {
    move |host| answer_all(&Server::on(&host, &options).unwrap())
}

fn answer_all(server: &Server) {
    loop {
        let Some(inbound) = server.receive(LONG) else { continue };
        let answer = match inbound.body {
            Body::Hello { token } => Body::Clock(clock(token)),
            Body::Command { request, .. } => {
                Body::Ack { request, outcome: RequestOutcome::Done, tick: 0, detail: String::new() }
            }
            _ => continue,
        };
        server.send(inbound.sender, &answer);
    }
}

pub(super) fn start(request: u32) -> Body {
    Body::Command { request, action: ExperimentAction::Start }
}

/// Sends a handshake every 100 ms for this long, and gives the virtual times of the answers with their tokens.
fn handshakes(host: &Host, client: &mut Client, lasting: Duration) -> Vec<(Duration, u64)> {
    let begun = host.clock.now();
    let mut answers = Vec::new();
    for token in 1..=lasting.as_millis() as u64 / 100 {
        client.send(&Body::Hello { token });
        let next = begun + Duration::from_millis(100) * token as u32;
        while let Some(event) = client.receive(next - host.clock.now()) {
            let ClientEvent::Body(Body::Clock(clock)) = event else { panic!("{event:?}") };
            answers.push((host.clock.now() - begun, clock.token));
        }
    }
    answers
}

#[test]
fn requests_get_through_a_network_that_loses_a_fifth() {
    let lab = SimulatedNetwork::new(SimulatedOptions { loss: 0.2, ..SimulatedOptions::default() });
    lab.spawn("city", city);
    let other = lab.clone();
    let vehicle = lab.spawn("vehicle", move |host| {
        let mut client = client(&host);
        let answers = handshakes(&host, &mut client, LONG);
        let outcomes: Vec<_> = (0..100).map(|_| client.request(Duration::from_secs(10), start)).collect();
        other.stop("city");
        (answers, outcomes)
    });
    lab.run();
    let (answers, outcomes) = vehicle.join();
    // Both ways get through with 0.8 * 0.8: 384 of 600, with a standard deviation of 12.
    assert!((340..430).contains(&answers.len()), "{}", answers.len());
    assert!(outcomes.iter().all(|outcome| matches!(outcome, Some((RequestOutcome::Done, _)))));
    assert!((LONG..2 * LONG).contains(&lab.elapsed()), "{:?}", lab.elapsed());
}

#[test]
fn a_request_to_nobody_ends_after_its_timeout() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    let vehicle = lab.spawn("vehicle", |host| client(&host).request(Duration::from_secs(7), start));
    lab.run();
    assert_eq!((vehicle.join(), lab.elapsed()), (None, Duration::from_secs(7)));
    // At first, and after each 100 ms, but the send that tells of a refusal sends nothing.
    assert!((35..=70).contains(&lab.counters().refused), "{:?}", lab.counters());
}

#[test]
fn datagrams_that_come_twice_are_taken_once() {
    let lab = SimulatedNetwork::new(SimulatedOptions { duplication: 1.0, ..SimulatedOptions::default() });
    let city = lab.spawn("city", |host| {
        let server = server(&host, 1000.0);
        let mut tokens = Vec::new();
        while let Some(inbound) = server.receive(Duration::from_secs(1)) {
            if let Body::Hello { token } = inbound.body {
                tokens.push(token);
                server.send(inbound.sender, &Body::Clock(clock(token)));
            }
        }
        let dropped = server.counters().dropped;
        (tokens, dropped.of(DropReason::Duplicate), dropped.total())
    });
    let vehicle = lab.spawn("vehicle", |host| {
        let mut client = client(&host);
        let answers = handshakes(&host, &mut client, Duration::from_secs(1));
        let (_, last) = client.prepare(&Body::Hello { token: 11 }).unwrap();
        (0..3).for_each(|_| client.resend(&last));
        answers.into_iter().map(|(_, token)| token).collect::<Vec<_>>()
    });
    lab.run();
    assert_eq!(city.join(), ((1..=11).collect(), 10 + 5, 10 + 5));
    assert_eq!(vehicle.join(), (1..=10).collect::<Vec<_>>());
}

#[test]
fn a_datagram_that_cannot_be_decoded_has_come_and_is_not_missing() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    let city = lab.spawn("city", |host| {
        let server = server(&host, 1000.0);
        while server.receive(Duration::from_secs(1)).is_some() {}
        let counters = server.counters();
        (counters.received, counters.used, counters.dropped.total(), counters.missing)
    });
    lab.spawn("vehicle", |host| {
        let mut client = client(&host);
        client.send(&Body::Hello { token: 0 });
        assert_eq!(client.receive(Duration::from_millis(500)), None);
        assert!(client.is_connected());
        let endless = Body::Subscribe { request: 1, every_ticks: 1, lease_s: f64::NAN };
        (0..3).for_each(|_| _ = client.send(&endless));
        client.send(&Body::Hello { token: 1 });
    });
    lab.run();
    // The question for a challenge, the first datagram of the session, and the last one are used.
    assert_eq!(city.join(), (3 + 3, 3, 3, 0));
}

#[test]
fn a_sender_that_is_too_fast_is_held_to_its_rate() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    let city = lab.spawn("city", |host| {
        let server = server(&host, 50.0);
        while server.receive(Duration::from_secs(3)).is_some() {}
        let counters = server.counters();
        (counters.received, counters.used, counters.dropped.of(DropReason::TooFast))
    });
    lab.spawn("vehicle", |host| {
        let mut client = client(&host);
        client.send(&Body::Hello { token: 0 });
        assert_eq!(client.receive(Duration::from_secs(2)), None);
        assert!(client.is_connected());
        (0..200).for_each(|token| _ = client.send(&Body::Hello { token }));
        host.clock.sleep(Duration::from_millis(100));
        (0..200).for_each(|token| _ = client.send(&Body::Hello { token }));
    });
    lab.run();
    // The handshake, the burst, and what a tenth of a second refills.
    assert_eq!(city.join(), (2 + 400, 2 + 50 + 5, 345));
}

#[test]
fn a_city_that_was_restarted_is_noticed() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    lab.spawn("city", city);
    let other = lab.clone();
    let vehicle = lab.spawn("vehicle", move |host| {
        let mut client = client(&host);
        let before = handshakes(&host, &mut client, Duration::from_secs(1)).len();
        other.stop("city");
        assert_eq!(handshakes(&host, &mut client, Duration::from_secs(1)), []);
        other.spawn("city", city);
        // The new city drops datagrams for the old one, but for a probe.
        assert_eq!(handshakes(&host, &mut client, Duration::from_secs(1)), []);
        client.probe();
        assert_eq!(client.receive(LONG), Some(ClientEvent::Restarted));
        client.reset_session();
        let after = handshakes(&host, &mut client, Duration::from_secs(1)).len();
        other.stop("city");
        (before, after)
    });
    lab.run();
    assert_eq!(vehicle.join(), (10, 10));
}

#[test]
fn a_link_goes_on_after_a_partition() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    lab.spawn("city", city);
    let (other, switch) = (lab.clone(), lab.clone());
    let vehicle = lab.spawn("vehicle", move |host| {
        let answers = handshakes(&host, &mut client(&host), Duration::from_secs(20));
        other.stop("city");
        answers.into_iter().map(|(_, token)| token).collect::<Vec<_>>()
    });
    lab.spawn("switch", move |host| {
        host.clock.sleep(Duration::from_millis(5050));
        switch.partition("vehicle", "city");
        host.clock.sleep(Duration::from_secs(5));
        switch.repair();
    });
    lab.run();
    // One handshake per 100 ms, the first at 0 s.
    assert_eq!(vehicle.join(), (1..=51).chain(102..=200).collect::<Vec<_>>());
    assert_eq!(lab.counters().lost, 50);
}

#[test]
fn a_simulation_repeats_by_its_seed() {
    let trace = |seed| {
        let jitter = Duration::from_millis(30);
        let lab = SimulatedNetwork::new(SimulatedOptions {
            seed,
            jitter,
            loss: 0.1,
            ..SimulatedOptions::default()
        });
        lab.spawn("city", city);
        let other = lab.clone();
        let vehicles = ["first", "second"].map(|name| {
            lab.spawn(name, |host| (handshakes(&host, &mut client(&host), LONG / 10), host.network.session()))
        });
        lab.spawn("switch", move |host| {
            host.clock.sleep(LONG / 5);
            other.stop("city");
        });
        lab.run();
        (vehicles.map(Participant::join), lab.counters())
    };
    let first = trace(1);
    assert_eq!(first, trace(1));
    assert_ne!(first, trace(2));
}

#[test]
fn only_urgent_datagrams_and_many_wake_a_city() {
    let lab =
        SimulatedNetwork::new(SimulatedOptions { delay: Duration::ZERO, ..SimulatedOptions::default() });
    let city = lab.spawn("city", |host| {
        let (server, begun) = (server(&host, 1000.0), host.clock.now());
        assert!(server.receive(Duration::from_millis(500)).is_some(), "the handshake");
        [10; 4].map(|wait_s| {
            server.wait_for_urgent(Duration::from_secs(wait_s));
            let woken = host.clock.now() - begun;
            let found = std::iter::from_fn(|| server.receive(Duration::ZERO)).count();
            (woken.as_secs(), found)
        })
    });
    lab.spawn("vehicle", |host| {
        let mut client = client(&host);
        client.send(&Body::Hello { token: 0 });
        assert_eq!(client.receive(Duration::from_millis(10)), None);
        assert!(client.is_connected());
        let points = vec![TrajectoryPoint { time_s: 3.5, pose: Pose2::new(1.0, -2.0, 0.4), speed_mps: 0.35 }];
        let trajectory = Body::Trajectories(vec![Trajectory { points, ..Trajectory::default() }]);
        let mut send_at = |at_s: u64, body: &Body, count: usize| {
            host.clock.sleep(Duration::from_secs(at_s).saturating_sub(since_begin(&host)));
            (0..count).for_each(|_| _ = client.send(body));
        };
        send_at(1, &Body::Hello { token: 1 }, 1);
        send_at(2, &trajectory, 63);
        send_at(12, &trajectory, 64);
        send_at(13, &trajectory, 1);
        send_at(14, &Body::Hello { token: 2 }, 1);
    });
    lab.run();
    // A request wakes it at 1 s, few trajectories do not until 11 s, many do at 12 s, and a request at 14 s.
    assert_eq!(city.join(), [(1, 1), (11, 63), (12, 64), (14, 2)]);
}

/// Virtual time since the beginning, by the wall clock of the host.
fn since_begin(host: &Host) -> Duration {
    Duration::from_secs_f64(host.clock.unix_s() - 1.7e9)
}

#[test]
fn a_vehicle_gets_heartbeats_and_the_clock() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    let vehicle = lab.spawn("vehicle", |host| {
        let server = server(&host, 1000.0);
        let (mut clocks, mut hellos, mut leases) = (0, 0, 0);
        while let Some(inbound) = server.receive(Duration::from_secs(2)) {
            match inbound.body {
                Body::Clock(_) => clocks += 1,
                Body::Hello { .. } => hellos += 1,
                Body::Subscribe { .. } => leases += 1,
                body => panic!("{body:?}"),
            }
        }
        (clocks, hellos, leases)
    });
    lab.spawn("city", |host| {
        let vehicles = [(VehicleId(1), ADDRESS.to_owned())].into_iter();
        let mut fleet = PhysicalFleet::on(&host, vehicles, true, 1, &Authenticator::Checksum).unwrap();
        let begun = host.clock.now();
        for tick in 0..1000 {
            let due = begun + Duration::from_millis(10) * tick;
            host.clock.sleep(due.saturating_duration_since(host.clock.now()));
            fleet.poll(&mut Vec::new());
            fleet.send_clock(clock(0));
        }
    });
    let begun = Instant::now();
    lab.run();
    // A clock begins the first session. The vehicle answers nothing but handshakes, so that the client begins two more,
    // each with a subscription in the place of a heartbeat.
    assert_eq!(vehicle.join(), (100, 7, 11));
    assert!(begun.elapsed() < lab.elapsed());
}

pub(super) fn key(text: &str) -> Authenticator {
    Authenticator::Key(text.as_bytes().to_vec())
}

/// Handshakes without an answer, and what the client then says of the city.
fn trouble(host: &Host, client: &mut Client) -> Option<String> {
    assert_eq!(handshakes(host, client, Duration::from_millis(300)), []);
    client.trouble()
}

pub(super) const KEY: &str = "a key of the laboratory";
const KEY_NEEDED: &str = "it requires a shared key: give --key FILE";

#[test]
fn a_client_says_why_the_city_rejects_it() {
    let plain = || Authenticator::Checksum;
    for (of_city, of_client, world, expected) in [
        (key(KEY), plain(), 1, KEY_NEEDED),
        (plain(), key(KEY), 1, "it has no shared key: leave out --key"),
        (key(KEY), key("the key of another one"), 1, "it has another shared key: --key names the wrong file"),
        (plain(), plain(), 2, "it is another world: see --world"),
        (key(KEY), key(KEY), 2, "it is another world: see --world"),
    ] {
        let lab = SimulatedNetwork::new(SimulatedOptions::default());
        lab.spawn("city", city_with(options(of_city)));
        let other = lab.clone();
        let visitor = lab.spawn("visitor", move |host| {
            let mut client = Client::on(&host, ADDRESS, world, of_client).unwrap();
            let before = client.trouble();
            let found = trouble(&host, &mut client);
            other.stop("city");
            (before, found)
        });
        lab.run();
        assert_eq!(visitor.join(), (None, Some(expected.to_owned())));
    }
}

#[test]
fn a_client_says_that_nothing_listens() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    let visitor = lab.spawn("visitor", |host| {
        let found = trouble(&host, &mut client(&host));
        // A client that only sends is told so by its next send, and one that polls by its next poll.
        let (mut sender, mut poller) = (client(&host), client(&host));
        sender.send(&Body::Hello { token: 1 });
        poller.send(&Body::Hello { token: 1 });
        host.clock.sleep(Duration::from_millis(1));
        sender.send(&Body::Hello { token: 2 });
        assert_eq!(poller.receive(Duration::ZERO), None);
        [found, sender.trouble(), poller.trouble()]
    });
    lab.run();
    assert_eq!(visitor.join(), [(); 3].map(|()| Some("nothing listens there".to_owned())));
}

#[test]
fn a_good_handshake_clears_the_trouble() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    let other = lab.clone();
    let visitor = lab.spawn("visitor", move |host| {
        let mut client = client(&host);
        let nobody = trouble(&host, &mut client);
        other.spawn("city", city_with(options(key(KEY))));
        let denied = trouble(&host, &mut client);
        client.reset_session();
        let kept = client.trouble();
        other.stop("city");
        let nobody_again = trouble(&host, &mut client);
        other.spawn("city", city_with(options(Authenticator::Checksum)));
        let answers = handshakes(&host, &mut client, Duration::from_millis(300)).len();
        other.stop("city");
        assert!(answers > 0 && client.trouble().is_none(), "{:?}", client.trouble());
        [nobody, denied, kept, nobody_again].map(Option::unwrap)
    });
    lab.run();
    let nobody = "nothing listens there";
    assert_eq!(visitor.join(), [nobody, KEY_NEEDED, KEY_NEEDED, nobody]);
}

#[test]
fn a_foreign_address_gets_no_denial() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    let allowed = vec!["10.0.0.0/8".parse().unwrap()];
    lab.spawn("city", city_with(ServerOptions { allowed, ..options(key(KEY)) }));
    let other = lab.clone();
    let visitor = lab.spawn("visitor", move |host| {
        let found = trouble(&host, &mut client(&host));
        other.stop("city");
        found
    });
    lab.run();
    assert_eq!(visitor.join(), None);
    assert_eq!(lab.counters().sent, 3, "the three handshakes and nothing else");
}

/// The denials that have come to a socket.
fn denials(socket: &dyn DatagramSocket) -> usize {
    let mut bytes = [0; MAX_DATAGRAM_BYTES];
    let mut count = 0;
    while let Some((length, _)) = socket.receive(&mut bytes, Duration::from_millis(10)).unwrap() {
        Denial::decode(&bytes[..length]).unwrap();
        count += 1;
    }
    count
}

#[test]
fn denials_answer_handshakes_only_and_not_more_than_a_hundred_per_second() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    lab.spawn("city", city_with(options(key(KEY))));
    let other = lab.clone();
    let visitor = lab.spawn("visitor", move |host| {
        let socket = host.network.connect(ADDRESS.parse().unwrap()).unwrap();
        let header = DatagramHeader { session: 7, ..DatagramHeader::default() };
        let encode = |body: &Body| body.encode(header, &Authenticator::Checksum).unwrap();
        let hello = encode(&Body::Hello { token: 1 });
        let denial = Denial { reason: DenialReason::OtherKey }.encode(header);
        let mut other_version = hello.clone();
        other_version[4] += 1;
        for silent in [&encode(&start(1)), &hello[..47], &denial, &other_version, b"C3DL", b""] {
            socket.send(silent).unwrap();
        }
        let silent = denials(&*socket);
        let flood = |count| (0..count).for_each(|_| socket.send(&hello).unwrap());
        flood(300);
        let burst = denials(&*socket);
        host.clock.sleep(Duration::from_millis(500));
        flood(300);
        let later = denials(&*socket);
        other.stop("city");
        (silent, burst, later)
    });
    lab.run();
    let (silent, burst, later) = visitor.join();
    assert_eq!((silent, burst), (0, 100));
    // What half a second refills, and the waits for the last denials.
    assert!((50..=55).contains(&later), "{later}");
}

#[test]
fn a_denial_counts_only_for_the_session_now_and_the_one_before() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    lab.spawn("forger", |host| {
        let socket = host.network.bind(ADDRESS.parse().unwrap()).unwrap();
        let mut bytes = [0; MAX_DATAGRAM_BYTES];
        // Its denials name no session, an unknown one, the one before the last, and at last the one before.
        let mut sessions = Vec::new();
        while let Some((length, from)) = socket.receive(&mut bytes, Duration::from_secs(1)).unwrap() {
            let (header, _) = Body::decode(&bytes[..length], &Authenticator::Checksum).unwrap();
            sessions.push(header.session);
            let peer = match sessions[..] {
                [_] => 0,
                [_, _] => !header.session,
                [first, _, _] => first,
                [.., before, _] => before,
                [] => unreachable!(),
            };
            let header = DatagramHeader { session: 9, peer, ..header };
            socket.send_burst(from, &[Denial { reason: DenialReason::KeyNeeded }.encode(header)]).unwrap();
        }
    });
    let visitor = lab.spawn("visitor", |host| {
        let mut client = client(&host);
        [(); 4].map(|()| {
            client.send(&Body::Hello { token: 1 });
            let event = client.receive(Duration::from_millis(100));
            let found = client.trouble();
            client.reset_session();
            (event, found)
        })
    });
    lab.run();
    let none = || (None, None);
    assert_eq!(visitor.join(), [none(), none(), none(), (None, Some(KEY_NEEDED.to_owned()))]);
}

#[test]
fn an_old_client_is_told_and_others_get_nothing() {
    let lab = SimulatedNetwork::new(SimulatedOptions::default());
    lab.spawn("city", city);
    let other = lab.clone();
    let visitor = lab.spawn("visitor", move |host| {
        let socket = host.network.connect(ADDRESS.parse().unwrap()).unwrap();
        let header = DatagramHeader { session: 7, sequence: 1, ..DatagramHeader::default() };
        let mut bytes = [0; MAX_DATAGRAM_BYTES];
        let found = [0, 1, 3].map(|version| {
            let mut hello = Body::Hello { token: 1 }.encode(header, &Authenticator::Checksum).unwrap();
            hello[4] = version;
            socket.send(&hello).unwrap();
            socket.receive(&mut bytes, Duration::from_millis(10)).unwrap().map(|_| (bytes[4], bytes[36]))
        });
        other.stop("city");
        found
    });
    lab.run();
    // In its own version: reason 5.
    assert_eq!(visitor.join(), [None, Some((1, 5)), None]);
}
