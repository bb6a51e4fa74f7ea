//! Who may do what in a served city: setups, owners, keys, and addresses.

use crate::lab::{CITY, Director, Lab, scenario, serving};
use city3d_geometry::lab::Pose2;
use city3d_network::link::{Client, ClientEvent};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::{Appearance, Trajectory, TrajectoryPoint, VehicleId};
use city3d_protocol::wire::{
    Authenticator, Body, DropReason, ExperimentAction, RequestOutcome, VehicleBuild, VehicleSetup,
};
use city3d_session::served::ServeOptions;
use city3d_simulation::runner::Summary;
use std::time::Duration;

const SOON: Duration = Duration::from_secs(5);
/// A quarter of a second: three tries.
const TRIES: Duration = Duration::from_millis(250);

fn setup_of(id: u32, name: &str, x: f64) -> VehicleSetup {
    VehicleSetup {
        id: VehicleId(id),
        name: name.to_owned(),
        controller: "by hand".to_owned(),
        parameters: vec![("patience".to_owned(), 0.5)],
        appearance: Appearance::default(),
        pose: Pose2::new(x, 1.793, 0.0),
        speed_mps: 0.0,
        build: VehicleBuild::Type(String::new()),
    }
}

fn setup(id: u32, name: &str, x: f64) -> impl Fn(u32) -> Body {
    let setup = Box::new(setup_of(id, name, x));
    move |request| Body::Setup { request, setup: setup.clone() }
}

fn start(request: u32) -> Body {
    Body::Command { request, action: ExperimentAction::Start }
}

fn client(director: &Director, authenticator: Authenticator) -> Client {
    Client::on(&director.lab.network.host(), CITY, 0, authenticator).unwrap()
}

/// Serves an empty street, and lets senders do something there; gives the city's summary.
fn serve(options: ServeOptions, script: impl FnOnce(&Director) + Send + 'static) -> Summary {
    let lab = Lab::new(SimulatedOptions::default());
    let city = lab.serve(&scenario("straight", 60.0), options, None);
    let served = city.clone();
    lab.direct(move |director| {
        script(director);
        director.end(&city);
    });
    served.summary()
}

#[test]
fn setups_are_checked_and_vehicles_belong_to_who_has_set_them_up() {
    let served = serve(ServeOptions { guests: 1, ..serving() }, |director| {
        let [mut leader, mut guest, mut third] = [(); 3].map(|()| client(director, Authenticator::Checksum));
        let told = |client: &mut Client, body: &dyn Fn(u32) -> Body| client.request(SOON, body).unwrap();
        let done = (RequestOutcome::Done, String::new());
        assert_eq!(told(&mut leader, &setup(1, "first", 0.5)), done);
        let refused = |(outcome, detail): (RequestOutcome, String), words: &str| {
            assert!(outcome == RequestOutcome::Refused && detail.contains(words), "{outcome:?} {detail}");
        };
        refused(told(&mut leader, &setup(0, "nobody", 0.0)), "between 1 and 65535");
        refused(told(&mut leader, &setup(2, "first", 0.0)), "choose another");
        refused(told(&mut leader, &setup(2, "a b", 0.0)), "a letter first");
        refused(told(&mut leader, &setup(2, "far", 500.0)), "outside of the map");
        let mut odd = setup_of(2, "odd", 0.0);
        odd.build = VehicleBuild::Type("lorry".to_owned());
        let body = |request| Body::Setup { request, setup: Box::new(odd.clone()) };
        refused(told(&mut leader, &body), "vehicle type \"lorry\" is not defined; there are default");

        // On the place of another: behind it on the lane.
        let (outcome, detail) = told(&mut guest, &setup(2, "second", 0.52));
        assert!(outcome == RequestOutcome::Done && detail.contains("taken by vehicle 1"), "{detail}");
        let (outcome, detail) = told(&mut third, &setup(3, "third", -0.2));
        assert!(outcome == RequestOutcome::Busy && detail.contains("--guests"), "{outcome:?} {detail}");
        assert_eq!(told(&mut guest, &start).0, RequestOutcome::Busy);
        let remove = |vehicle| move |request| Body::Remove { request, vehicle: VehicleId(vehicle) };
        assert_eq!(told(&mut guest, &remove(1)).0, RequestOutcome::Busy);
        refused(told(&mut guest, &remove(9)), "no vehicle 9");
        assert_eq!(told(&mut guest, &remove(2)), done);
        assert_eq!(told(&mut leader, &start), done);
    });
    assert!(served.vehicles.contains_key(&1) && !served.vehicles.contains_key(&3));
}

/// A trajectory along the street.
fn follow(vehicle: u32, sequence: u32) -> Trajectory<city3d_geometry::Lab> {
    let point = |k: u32| TrajectoryPoint {
        time_s: 1.0 + 0.1 * f64::from(k),
        pose: Pose2::new(0.5 + 0.02 * f64::from(k), 1.793, 0.0),
        speed_mps: 0.2,
    };
    let points = (0..13).map(point).collect();
    Trajectory { vehicle: VehicleId(vehicle), sequence, points, ..Trajectory::default() }
}

#[test]
fn with_a_key_nobody_else_is_heard_and_strangers_are_told_why() {
    let key = Authenticator::Key(b"a key that only the laboratory knows".to_vec());
    let options = ServeOptions { authenticator: key.clone(), ..serving() };
    let served = serve(options, move |director| {
        let other = Authenticator::Key(b"another key of the same length......".to_vec());
        for (authenticator, why) in
            [(Authenticator::Checksum, "requires a shared key"), (other, "another shared key")]
        {
            let mut stranger = client(director, authenticator);
            stranger.send(&Body::Hello { token: 1 });
            assert_eq!(stranger.request(TRIES, setup(1, "intruder", 0.5)), None);
            let trouble = stranger.trouble().unwrap();
            assert!(trouble.contains(why), "{trouble}");
        }
        let mut friend = client(director, key);
        friend.send(&Body::Hello { token: 1 });
        assert!(matches!(friend.receive(SOON), Some(ClientEvent::Body(Body::Clock(_)))));
        assert_eq!(friend.request(SOON, setup(1, "friend", 0.5)).unwrap().0, RequestOutcome::Done);
        // The same datagram again does nothing.
        let (_, bytes) = friend.prepare(&Body::Trajectories(vec![follow(1, 1)])).unwrap();
        (0..3).for_each(|_| friend.resend(&bytes));
        assert_eq!(friend.request(SOON, start).unwrap().0, RequestOutcome::Done);
        director.pass(0.2);
    });
    let dropped = served.link.unwrap().dropped;
    assert!(dropped.of(DropReason::Unauthenticated) >= 2, "{dropped:?}");
    assert!(dropped.of(DropReason::Malformed) >= 2, "of another key: {dropped:?}");
    assert_eq!(dropped.of(DropReason::Duplicate), 2, "{dropped:?}");
}

#[test]
fn addresses_that_are_not_on_the_list_are_foreign() {
    let options = ServeOptions { allowed: vec!["10.0.0.0/8".parse().unwrap()], ..serving() };
    let served = serve(options, |director| {
        let mut foreign = client(director, Authenticator::Checksum);
        assert_eq!(foreign.request(TRIES, setup(1, "foreign", 0.5)), None);
    });
    assert_eq!((served.vehicles.len(), served.simulated_s), (0, 0.0));
    assert!(served.link.unwrap().dropped.of(DropReason::ForeignSender) >= 3);
}

#[test]
fn who_leads_keeps_its_place_whoever_else_comes() {
    let served = serve(ServeOptions { guests: 1, ..serving() }, |director| {
        let hello = Body::Hello { token: 1 };
        let subscribe = |request| Body::Subscribe { request, every_ticks: 100, lease_s: 60.0 };
        let mut leader = client(director, Authenticator::Checksum);
        assert_eq!(leader.request(SOON, setup(1, "first", 0.5)).unwrap().0, RequestOutcome::Done);
        assert_eq!(leader.request(SOON, start).unwrap().0, RequestOutcome::Done);
        let mut strangers = Vec::new();
        for number in 0..300 {
            let mut stranger = client(director, Authenticator::Checksum);
            if number < 64 {
                assert_eq!(stranger.request(SOON, subscribe).unwrap().0, RequestOutcome::Done);
            } else {
                stranger.send(&hello);
                assert!(
                    matches!(stranger.receive(SOON), Some(ClientEvent::Body(Body::Clock(_)))),
                    "{number}"
                );
            }
            strangers.push(stranger);
            // A heartbeat of who leads.
            leader.send(&hello);
        }
        assert_eq!(strangers[299].request(SOON, subscribe).unwrap().0, RequestOutcome::Busy);
        assert_eq!(leader.request(SOON, subscribe).unwrap().0, RequestOutcome::Done, "a place is kept");
        // The oldest that did nothing has made room, and notices it.
        strangers[64].send(&hello);
        let answers = std::iter::from_fn(|| strangers[64].receive(TRIES)).count();
        assert_eq!(answers, 0);
        let begins_anew = (0..10).any(|_| {
            strangers[64].probe();
            strangers[64].receive(TRIES) == Some(ClientEvent::Restarted)
        });
        assert!(begins_anew);
        let mut next = client(director, Authenticator::Checksum);
        assert_eq!(
            next.request(SOON, setup(2, "next", -3.0)).unwrap().0,
            RequestOutcome::Done,
            "and so may others"
        );
    });
    assert_eq!(served.link.unwrap().dropped.of(DropReason::Full), 0);
}
