//! A guest who brings a car into a city elsewhere, and drives it there.

use crate::compare::assert_same;
use crate::lab::{Director, Lab, Program, scenario, serving};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::{Pedals, Status, VehicleId};
use city3d_session::served::ServeOptions;
use city3d_session::{GuestAct, Order};
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;

/// The car of a guest, once the city has it.
fn car_of(director: &Director, guest: &Program) -> VehicleId {
    director.until_link(guest, "the car is there", |link| link.own_vehicle.is_some()).own_vehicle.unwrap()
}

#[test]
fn a_guest_drives_its_own_car_and_no_other_and_loses_the_wheel_when_it_is_gone() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 60.0);
    let city = lab.serve(&experiment, ServeOptions { guests: 1, ..serving() }, None);
    let far = lab.mainframe(&experiment, None);
    lab.direct(move |director| {
        director.until(&city, "do they drive", |told| told.driving() >= 5);
        let guest = director.lab.guest("visitor", &experiment);
        let car = car_of(director, &guest);
        let begun = director.until(&city, "the car", |told| told.snapshot.vehicle(car).is_some());
        assert_eq!(begun.snapshot.info(car).unwrap().name, "visitor");

        guest.order(Order::Drive(car, Pedals { gas: 0.4, ..Pedals::default() }));
        let is_fast =
            |told: &crate::lab::Told| told.snapshot.vehicle(car).is_some_and(|state| state.speed_mps > 1.5);
        let drives = director.until(&city, "the car moves", is_fast);
        assert_eq!(drives.vehicle(car).status, Status::Manual);
        director.until(&guest, "the guest sees it move", is_fast);
        let other = experiment.vehicles[0].id;
        guest.order(Order::Drive(other, Pedals::default()));
        let refused = director.wait("an answer", || guest.desk().answers.get(1).cloned());
        assert!(refused.1.unwrap_err().contains("is not yours"));
        assert_ne!(city.last().vehicle(other).status, Status::Manual);

        // Gone without a word: a guest that ends in order takes its car with it.
        director.lab.network.isolate("visitor");
        director.kill(&guest);
        let lost = director
            .until(&city, "the wheel is taken away", |told| told.vehicle(car).status != Status::Manual);
        assert!(lost.vehicle(car).speed_mps > 1.0);
        let stands = director.until(&city, "the car brakes", |told| told.vehicle(car).speed_mps.abs() < 0.01);
        assert!(stands.snapshot.time_s - lost.snapshot.time_s < 5.0);
        assert!(stands.driving() >= 4, "the others go on");
        [far, city].iter().for_each(|program| director.end(program));
    });
}

#[test]
fn a_guest_that_leaves_takes_its_car_with_it() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 60.0);
    let city = lab.serve(&experiment, ServeOptions { guests: 1, ..serving() }, None);
    let far = lab.mainframe(&experiment, None);
    lab.direct(move |director| {
        director.until(&city, "do they drive", |told| told.driving() >= 5);
        let guest = director.lab.guest("visitor", &experiment);
        let car = car_of(director, &guest);
        director.end(&guest);
        director.until(&city, "the car is gone", |told| told.snapshot.vehicle(car).is_none());
        [far, city].iter().for_each(|program| director.end(program));
    });
}

#[test]
fn guests_of_the_same_name_have_cars_of_their_own() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 60.0);
    let city = lab.serve(&experiment, ServeOptions { guests: 2, ..serving() }, None);
    lab.direct(move |director| {
        let guest = director.lab.guest("guest", &experiment);
        let first = car_of(director, &guest);
        city.order(Order::Guest(7, GuestAct::Join));
        let named = |told: &crate::lab::Told| {
            told.snapshot.roster.iter().map(|info| info.name.clone()).collect::<Vec<_>>()
        };
        let seen = director.until(&city, "both", |told| named(told).len() == 2);
        assert_eq!(named(&seen), ["guest", "guest_2"]);
        assert!(seen.snapshot.vehicle(first).is_some());
        [guest, city].iter().for_each(|program| director.end(program));
    });
}

#[test]
fn a_guest_without_room_is_told_why_and_disturbs_nobody() {
    let experiment = scenario("roundabout", 7.0);
    let run = |has_visitor: bool| {
        let lab = Lab::new(SimulatedOptions::default());
        let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
        let (served, of_guest) = (city.clone(), experiment.clone());
        lab.direct(move |director| {
            director.until(&city, "do they drive", |told| told.driving() >= 5);
            if has_visitor {
                let guest = director.lab.guest("visitor", &of_guest);
                let link = director.until_link(&guest, "the reason", |link| {
                    link.trouble.as_ref().is_some_and(|trouble| trouble.contains("your car waits outside"))
                });
                assert!(link.trouble.unwrap().contains("--guests"), "it says what would help");
                assert_eq!(link.own_vehicle, None);
                director.until(&guest, "it sees the city all the same", |told| told.snapshot.time_s > 5.0);
            }
            director.until(&far, "the end", |told| told.snapshot.tick == 700);
            [far, city].iter().for_each(|program| director.end(program));
        });
        served
    };
    let [without, with] = [false, true].map(run);
    assert_eq!(with.summary().vehicles.len(), experiment.vehicles.len());
    assert_same(&with.digests()[..701], &without.digests()[..701], "city");
}

#[test]
fn the_vehicles_of_the_mainframe_wait_behind_a_guest_who_stands() {
    let lab = Lab::new(SimulatedOptions::default());
    let mut experiment = Experiment::clone(&scenario("roundabout", 60.0));
    experiment.vehicles.truncate(1);
    let experiment = Arc::new(experiment);
    let city = lab.serve(&experiment, ServeOptions { guests: 1, ..serving() }, None);
    lab.direct(move |director| {
        let guest = director.lab.guest("visitor", &experiment);
        let car = car_of(director, &guest);
        director.until(&city, "the car", |told| told.snapshot.vehicle(car).is_some());
        // Its place is taken, so that the vehicle starts behind it.
        let far = director.lab.mainframe(&experiment, None);
        let first = experiment.vehicles[0].id;
        let waits = |told: &crate::lab::Told| {
            told.snapshot.time_s > 8.0 && told.vehicle(first).speed_mps.abs() < 0.05
        };
        let seen = director.until(&city, "it waits behind the guest", waits);
        let [own, others] = [first, car].map(|vehicle| seen.vehicle(vehicle).position);
        let gap_m = own.distance(others) - 5.0;
        assert!((0.5..8.0).contains(&gap_m), "{gap_m} m between the bumpers");
        assert_eq!(seen.count(Status::Collided), 0);

        guest.order(Order::Drive(car, Pedals { gas: 0.4, ..Pedals::default() }));
        director.until(&city, "it goes on behind the guest", |told| told.vehicle(first).speed_mps > 2.0);
        [far, guest, city].iter().for_each(|program| director.end(program));
    });
}

#[test]
fn a_guest_of_the_page_has_a_car_of_its_own_while_there_is_room_and_takes_it_along() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 60.0);
    let city = lab.serve(&experiment, ServeOptions { guests: 1, ..serving() }, None);
    let far = lab.mainframe(&experiment, None);
    lab.direct(move |director| {
        let begun = director.until(&city, "do they drive", |told| told.driving() >= 5);
        let guest_of = |link: &city3d_session::LinkStatus, number| {
            link.page_guests.iter().flatten().find(|guest| guest.number == number).cloned()
        };
        city.order(Order::Guest(7, GuestAct::Join));
        let inside = |number| {
            move |link: &city3d_session::LinkStatus| {
                guest_of(link, number).is_some_and(|guest| guest.vehicle.is_some())
            }
        };
        let link = director.until_link(&city, "the car is there", inside(7));
        let car = guest_of(&link, 7).unwrap().vehicle.unwrap();
        let there = director.until(&city, "the car", |told| told.snapshot.vehicle(car).is_some());
        assert_eq!(there.snapshot.info(car).unwrap().name, "guest");
        assert!(begun.snapshot.vehicle(car).is_none());

        let gas = GuestAct::Drive(Pedals { gas: 0.4, ..Pedals::default() });
        let drives = director.wait("the car moves", || {
            city.order(Order::Guest(7, gas));
            Some(city.last()).filter(|told| told.vehicle(car).speed_mps > 1.5)
        });
        assert_eq!(drives.vehicle(car).status, Status::Manual);
        assert_eq!(link.leader, city.desk().link.as_ref().unwrap().leader, "guests lead nothing");

        // A second one waits outside, also while the first one drives no more.
        city.order(Order::Guest(8, GuestAct::Join));
        city.order(Order::Guest(7, GuestAct::Release));
        director.until(&city, "the car brakes", |told| told.vehicle(car).speed_mps.abs() < 0.01);
        director.pass(5.0);
        let link = city.desk().link.clone().unwrap();
        assert!(guest_of(&link, 8).unwrap().trouble.unwrap().contains("--guests"), "it says what would help");
        assert_eq!(guest_of(&link, 7).unwrap().vehicle, Some(car));

        city.order(Order::Guest(7, GuestAct::Leave));
        director.until(&city, "the car is gone", |told| told.snapshot.vehicle(car).is_none());
        let link = director.until_link(&city, "the second one is let in", inside(8));
        assert_eq!(guest_of(&link, 7), None);
        director.until(&city, "its car", |told| told.snapshot.vehicle(car).is_some());

        // Who has left comes again by the same number.
        city.order(Order::Guest(8, GuestAct::Leave));
        director.until(&city, "nobody is there", |told| told.snapshot.vehicle(car).is_none());
        city.order(Order::Guest(7, GuestAct::Join));
        director.until_link(&city, "the first one is there again", inside(7));
        director.until(&city, "its car, too", |told| told.snapshot.vehicle(car).is_some());
        [far, city].iter().for_each(|program| director.end(program));
    });
}
