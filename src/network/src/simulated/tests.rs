use super::*;
use std::io::ErrorKind;
use std::sync::mpsc;

fn lab() -> SimulatedNetwork {
    SimulatedNetwork::new(SimulatedOptions::default())
}

fn address(port: u16) -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], port))
}

fn seconds(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

/// What the panic of a simulation says.
fn failure(lab: &SimulatedNetwork) -> String {
    let payload = catch_unwind(AssertUnwindSafe(|| lab.run())).unwrap_err();
    let text = payload.downcast_ref::<String>().cloned();
    text.unwrap_or_else(|| (*payload.downcast_ref::<&str>().unwrap()).to_owned())
}

#[test]
fn participants_take_turns_in_virtual_time() {
    let (lab, (told, order)) = (lab(), mpsc::channel());
    for (name, step_s) in [("a", 3), ("b", 2)] {
        let told = told.clone();
        lab.spawn(name, move |host| {
            let begun = host.clock.now();
            for _ in 0..3 {
                host.clock.sleep(seconds(step_s));
                told.send((name, (host.clock.now() - begun).as_secs())).unwrap();
            }
        });
    }
    lab.run();
    // At the same time, who was spawned first.
    let order: Vec<_> = order.try_iter().collect();
    assert_eq!(order, [("b", 2), ("a", 3), ("b", 4), ("a", 6), ("b", 6), ("a", 9)]);
    assert_eq!(lab.elapsed(), seconds(9));
}

#[test]
fn a_participant_spawns_another_and_waits_for_it() {
    let lab = lab();
    let other = lab.clone();
    let outer = lab.spawn("outer", move |host| {
        host.clock.sleep(seconds(1));
        let inner = other.spawn("inner", |host| {
            host.clock.sleep(seconds(2));
            host.clock.unix_s()
        });
        assert!(!inner.has_ended());
        inner.join()
    });
    lab.run();
    assert_eq!(outer.join(), 1.7e9 + 3.0);
    // Another run goes on where the first has ended.
    lab.spawn("late", |host| host.clock.sleep(seconds(1)));
    lab.run();
    assert_eq!(lab.elapsed(), seconds(4));
}

#[test]
fn sockets_are_like_those_of_a_loopback_interface() {
    let lab = lab();
    lab.spawn("one", |host| {
        let network = &host.network;
        let server = network.bind("0.0.0.0:9870".parse().unwrap()).unwrap();
        assert_eq!(network.bind(address(9870)).unwrap_err().kind(), ErrorKind::AddrInUse);
        let client = network.connect(address(9870)).unwrap();
        let mut bytes = [0; 3];
        client.send(b"long").unwrap();
        let (length, from) = server.receive(&mut bytes, seconds(1)).unwrap().unwrap();
        assert_eq!((&bytes[..length], Ok(from)), (&b"lon"[..], client.local_address().map_err(drop)));
        // A connected socket hears its peer alone.
        let stranger = network.bind(address(0)).unwrap();
        stranger.send_burst(from, &[b"no".to_vec()]).unwrap();
        server.try_clone().unwrap().send_burst(from, &[b"yes".to_vec()]).unwrap();
        assert_eq!(client.receive(&mut bytes, seconds(1)).unwrap(), Some((3, address(9870))));
        assert_eq!(client.receive(&mut bytes, seconds(1)).unwrap(), None);
        // What comes to a closed socket is told to a connected sender, once.
        drop(server);
        client.send(b"gone").unwrap();
        let told = client.receive(&mut bytes, seconds(1)).unwrap_err();
        assert_eq!(told.kind(), ErrorKind::ConnectionRefused);
        assert_eq!(client.receive(&mut bytes, seconds(1)).unwrap(), None);
        stranger.send_burst(address(9870), &[b"gone".to_vec()]).unwrap();
        assert_eq!(stranger.receive(&mut bytes, seconds(1)).unwrap(), None);
        assert!(network.bind(address(9870)).is_ok());
    });
    lab.run();
    let SimulatedCounters { sent, delivered, refused, .. } = lab.counters();
    assert_eq!((sent, delivered, refused), (5, 2, 3));
}

#[test]
fn a_full_buffer_drops_the_newest() {
    let lab = SimulatedNetwork::new(SimulatedOptions { buffer_datagrams: 3, ..SimulatedOptions::default() });
    let reader = lab.spawn("reader", |host| {
        let socket = host.network.bind(address(1)).unwrap();
        host.clock.sleep(seconds(1));
        let mut bytes = [0; 1];
        let mut found = Vec::new();
        while socket.receive(&mut bytes, Duration::ZERO).unwrap().is_some() {
            found.push(bytes[0]);
        }
        found
    });
    lab.spawn("writer", |host| {
        let socket = host.network.connect(address(1)).unwrap();
        (0..10).for_each(|k| socket.send(&[k]).unwrap());
    });
    lab.run();
    assert_eq!((reader.join(), lab.counters().overflowed), (vec![0, 1, 2], 7));
}

#[test]
fn conditions_change_while_it_runs() {
    let lab = lab();
    let other = lab.clone();
    lab.spawn("one", move |host| {
        let server = host.network.bind(address(1)).unwrap();
        let (conditions, asked) = (other.clone(), other.clone());
        let writer = other.spawn("other", move |host| {
            let client = host.network.connect(address(1)).unwrap();
            let send_after = |change: &dyn Fn()| {
                change();
                client.send(&[0]).unwrap();
                host.clock.sleep(seconds(10));
            };
            send_after(&|| conditions.set_delay(seconds(2), Duration::ZERO));
            send_after(&|| conditions.isolate("other"));
            send_after(&|| conditions.repair());
            send_after(&|| conditions.set_loss(1.0));
            send_after(&|| conditions.set_loss(0.0));
            send_after(&|| conditions.partition("other", "another"));
        });
        let arrivals = (0..4).map(|_| {
            server.receive(&mut [0], seconds(60)).unwrap();
            asked.elapsed().as_secs()
        });
        assert_eq!(arrivals.collect::<Vec<_>>(), [2, 22, 42, 52]);
        writer.join();
    });
    lab.run();
    assert_eq!((lab.counters().sent, lab.counters().lost), (6, 2));
}

#[test]
fn a_loop_that_polls_comes_to_its_end() {
    let lab = lab();
    let polls = lab.spawn("poller", |host| {
        let socket = host.network.bind(address(1)).unwrap();
        let until = host.clock.now() + Duration::from_millis(1);
        let polls = (0..).take_while(|_| {
            host.clock.now() < until && socket.receive(&mut [0], Duration::ZERO).unwrap().is_none()
        });
        polls.count()
    });
    lab.run();
    assert_eq!(polls.join(), 1000);
}

#[test]
fn a_stopped_participant_closes_its_sockets() {
    let lab = lab();
    let other = lab.clone();
    let city = lab.spawn("city", |host| {
        let socket = host.network.bind(address(1)).unwrap();
        loop {
            let _ = socket.receive(&mut [0], seconds(60));
        }
    });
    lab.spawn("killer", move |host| {
        host.clock.sleep(seconds(1));
        other.stop("city");
        assert!(city.has_ended() && host.network.bind(address(1)).is_ok());
    });
    lab.run();
    assert_eq!(lab.elapsed(), seconds(1));
}

#[test]
fn a_panic_ends_the_simulation_and_is_passed_on() {
    let lab = lab();
    lab.spawn("waiting", |host| host.clock.sleep(seconds(60)));
    lab.spawn("wrong", |host| {
        host.clock.sleep(seconds(1));
        panic!("as it should")
    });
    assert_eq!(failure(&lab), "as it should");
    assert_eq!(lab.elapsed(), seconds(1));
}

#[test]
fn a_deadlock_names_who_waits_for_what() {
    let lab = lab();
    let deaf = lab.spawn("deaf", |host| {
        let socket = host.network.bind(address(9870)).unwrap();
        socket.receive(&mut [0], Duration::MAX).map(drop)
    });
    lab.spawn("patient", |_| deaf.join());
    let told = failure(&lab);
    assert!(
        told.contains("deaf waits for a datagram at 127.0.0.1:9870 for ever")
            && told.contains("patient waits for the end of deaf"),
        "{told}"
    );
}

#[test]
fn a_simulation_without_end_is_told() {
    let lab =
        SimulatedNetwork::new(SimulatedOptions { longest: seconds(100), ..SimulatedOptions::default() });
    lab.spawn("sleeper", |host| {
        loop {
            host.clock.sleep(seconds(1));
        }
    });
    assert!(failure(&lab).contains("goes on after 100s: sleeper sleeps until 101s"));
}
