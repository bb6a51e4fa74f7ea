//! Subscribers over the link that are slow, too many, gone, and back.

use crate::compare::assert_same;
use crate::lab::{CITY, Director, Lab, Program, scenario, serving};
use city3d_network::host::Host;
use city3d_network::link::{Client, ClientEvent};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::wire::{Authenticator, Body, Poses, RequestOutcome};
use city3d_simulation::runner::EndSummary;
use std::time::Duration;

/// Datagrams that a socket holds.
const BUFFER: usize = 64;
const SECOND: Duration = Duration::from_secs(1);

/// Somebody who subscribes to the poses of each tick.
struct Subscriber(Client);

impl Subscriber {
    fn new(host: &Host) -> Self {
        Self(Client::on(host, CITY, 0, Authenticator::Checksum).unwrap())
    }

    fn subscribe(&mut self, lease_s: f64) -> (RequestOutcome, String) {
        self.0.request(SECOND, |request| Body::Subscribe { request, every_ticks: 1, lease_s }).unwrap()
    }

    fn next(&mut self) -> Poses {
        loop {
            if let ClientEvent::Body(Body::Poses(poses)) = self.0.receive(SECOND).expect("poses come") {
                return poses;
            }
        }
    }
}

/// What somebody does to a city.
type Script = Box<dyn FnOnce(&Director, &Program) + Send>;

/// Runs the roundabout with subscribers, and without: the city does the same. Gives the account of its end.
fn passes(disturb: impl FnOnce(&Director, &Program) + Send + 'static) -> EndSummary {
    let options = SimulatedOptions { buffer_datagrams: BUFFER, ..SimulatedOptions::default() };
    let run = |disturb: Script| {
        let (lab, experiment) = (Lab::new(options), scenario("roundabout", 8.0));
        let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
        let served = city.clone();
        lab.direct(move |director| {
            director.until(&city, "do they drive", |told| told.driving() >= 5);
            disturb(director, &city);
            director.until(&far, "the end", |told| told.snapshot.tick == 800);
            [far, city].iter().for_each(|program| director.end(program));
        });
        served
    };
    let [without, with] = [run(Box::new(|_, _| {})), run(Box::new(disturb))];
    assert_same(&with.digests()[..801], &without.digests()[..801], "city");
    let summary = with.summary();
    assert_eq!(summary.link.unwrap().time_skipped_s, 0.0);
    let account = summary.ends["udp"].clone();
    assert_eq!((account.failures, &account.failure), (0, &None));
    account
}

#[test]
fn a_subscriber_that_stops_reading_loses_poses_and_delays_nobody() {
    let account = passes(|director, _| {
        let host = director.lab.network.host();
        let mut slow = Subscriber::new(&host);
        assert_eq!(slow.subscribe(60.0).0, RequestOutcome::Done);
        (0..100).for_each(|_| drop(slow.next()));
        let last = slow.next().tick;
        director.pass(4.0);
        let overflowed = director.lab.network.counters().overflowed;
        assert!((300..400).contains(&overflowed), "{overflowed} of 400 datagrams");
        let old: Vec<u64> = (0..BUFFER).map(|_| slow.next().tick).collect();
        assert_eq!(old[0], last + 1, "what its socket holds");
        assert!(slow.next().tick > last + 395, "then what is new");
    });
    assert!(account.delivered > 800 + 500);
    assert_eq!(account.dropped, 0, "the city does not know of full sockets");
}

#[test]
fn a_subscriber_that_is_gone_is_forgotten_and_may_come_back() {
    passes(|director, city| {
        let host = director.lab.network.host();
        let mut first = Subscriber::new(&host);
        assert_eq!(first.subscribe(2.0).0, RequestOutcome::Done);
        first.next();
        let count = |count| {
            director.until_link(city, "so many subscribers", |link| link.subscribers == count);
        };
        count(2);
        drop(first);
        count(1);
        let refused = director.lab.network.counters().refused;
        assert!((150..250).contains(&refused), "{refused} in the two seconds of its lease");
        let mut back = Subscriber::new(&host);
        assert_eq!(back.subscribe(2.0).0, RequestOutcome::Done);
        let tick = back.next().tick;
        assert_eq!(back.next().tick, tick + 1);
        count(2);
        back.subscribe(0.0);
        count(1);
    });
}

#[test]
fn too_many_subscribers_are_refused_and_counted() {
    let account = passes(|director, _| {
        let host = director.lab.network.host();
        // One is the mainframe.
        let mut others: Vec<Subscriber> = (1..64).map(|_| Subscriber::new(&host)).collect();
        for other in &mut others {
            assert_eq!(other.subscribe(60.0).0, RequestOutcome::Done);
        }
        let mut last = Subscriber::new(&host);
        let (outcome, why) = last.subscribe(60.0);
        assert!(outcome == RequestOutcome::Busy && why.contains("64 subscribers"), "{outcome:?} {why}");
        others[0].subscribe(0.0);
        assert_eq!(last.subscribe(60.0).0, RequestOutcome::Done);
        last.next();
    });
    assert!(account.delivered > 64 * 400);
    assert_eq!(account.dropped, 1);
}
