//! A person at the city's own window, while a mainframe leads.

use crate::compare::{assert_same, replayed};
use crate::lab::{Lab, named, scenario, serving};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::{Pedals, Status};
use city3d_protocol::wire::ExperimentPhase;
use city3d_session::Order;

#[test]
fn a_person_takes_a_vehicle_from_the_mainframe_and_gives_it_back_and_the_log_replays() {
    let folder = tempfile::tempdir().unwrap();
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 30.0);
    let vehicle = named(&experiment, "path1_b");
    let city = lab.serve(&experiment, serving(), Some(folder.path()));
    let far = lab.mainframe(&experiment, None);
    let driven = city.clone();
    lab.direct(move |director| {
        director.until(&city, "do they drive", |told| told.driving() >= 5 && told.snapshot.time_s > 2.0);
        let pedals = Pedals { gas: 0.25, steering_rad: 0.01, ..Pedals::default() };
        city.order(Order::Drive(vehicle, pedals));
        let taken = director
            .until(&city, "the wheel is taken", |told| told.vehicle(vehicle).status == Status::Manual);
        let used = far.last().snapshot.tick;
        let later = director
            .until(&city, "a second by hand", |told| told.snapshot.time_s > taken.snapshot.time_s + 1.0);
        let state = later.vehicle(vehicle);
        assert_eq!((state.status, state.gas), (Status::Manual, pedals.gas), "whatever the mainframe says");
        assert!((state.position - taken.vehicle(vehicle).position).length() > 2.0, "the person drives");
        assert!(later.driving() >= 4, "the others go on");
        assert!(far.last().snapshot.tick > used + 90, "the mainframe goes on");

        city.order(Order::Release(vehicle));
        let given =
            director.until(&city, "it is given back", |told| told.vehicle(vehicle).status == Status::Driving);
        let later = director.until(&city, "it goes on", |told| {
            told.snapshot.time_s > given.snapshot.time_s + 5.0
                && told.vehicle(vehicle).status == Status::Driving
        });
        let state = later.vehicle(vehicle);
        assert!(state.lateral_error_m.abs() < 0.65, "it is back on its path: {state:?}");
        assert!((state.position - given.vehicle(vehicle).position).length() > 10.0);
        director.end(&far);
        director.end(&city);
    });
    let orders: Vec<bool> = driven.desk().answers.iter().map(|(_, answer)| answer.is_ok()).collect();
    assert_eq!(orders, [true, true]);
    assert_eq!(driven.summary().collisions, 0);
    assert_same(&replayed(&folder.path().join("run.mcap")), &driven.digests(), "replay");
}

#[test]
fn the_window_pauses_and_starts_whoever_leads_and_a_watcher_is_told_why_it_may_not() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 30.0);
    let city = lab.serve(&experiment, serving(), None);
    let far = lab.mainframe(&experiment, None);
    let watcher = lab.watcher(&experiment);
    lab.direct(move |director| {
        director.until(&watcher, "do they drive", |told| told.driving() >= 5);
        city.order(Order::Pause);
        let paused = director.until(&city, "the pause", |told| told.phase == ExperimentPhase::Paused);
        director.until(&watcher, "it is seen", |told| told.phase == ExperimentPhase::Paused);
        director.pass(2.0);
        assert_eq!(city.last().snapshot.tick, paused.snapshot.tick, "time stands");

        for order in [Order::Start, Order::Reset] {
            watcher.order(order.clone());
            let answer = director.wait("an answer", || {
                let desk = watcher.desk();
                desk.answers.iter().find(|(asked, _)| *asked == order).map(|(_, answer)| answer.clone())
            });
            let why = answer.unwrap_err();
            assert!(why.contains("the city refuses") && why.contains("leads the experiment"), "{why}");
        }
        assert_eq!(city.last().phase, ExperimentPhase::Paused);

        city.order(Order::Start);
        director.until(&city, "it goes on", |told| {
            told.driving() >= 5 && told.snapshot.tick > paused.snapshot.tick + 300
        });
        director.end(&far);
        director.end(&city);
        assert_eq!(city.summary().collisions, 0);
        for (order, answer) in &city.desk().answers {
            assert_eq!(answer, &Ok(()), "{order:?}");
        }
    });
}
