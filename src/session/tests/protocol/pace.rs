//! A local city keeps the speed that is asked for, by the clock that it is given.

use crate::lab::scenario;
use city3d_network::host::Host;
use city3d_network::simulated::{SimulatedNetwork, SimulatedOptions};
use city3d_session::{LocalCity, Order, Session, SessionEnd, Source, Speed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Runs a city for so many ticks at a speed; gives the wall-clock time that it took, and the factor that it reported.
fn paced(speed: Speed, ticks: u64) -> (Duration, f64) {
    let network = SimulatedNetwork::new(SimulatedOptions::default());
    let told = Arc::new(Mutex::new(0.0));
    let reported = Arc::clone(&told);
    network.spawn("city", move |host: Host| {
        let city = LocalCity::new(scenario("roundabout", 60.0), host.clone()).unwrap();
        let session = Session::new(city, host)
            .until(SessionEnd::AtTick(ticks))
            .reporting(Box::new(move |report| *reported.lock().unwrap() = report.real_time_factor));
        let orders = session.orders().unwrap();
        assert!(orders.send(Order::Speed(speed)) && orders.send(Order::Start));
        let city = session.run().unwrap();
        assert_eq!(city.snapshot().tick, ticks);
    });
    network.run();
    let factor = *told.lock().unwrap();
    (network.elapsed(), factor)
}

#[test]
fn simulated_time_goes_by_the_speed_that_is_asked_for() {
    for (factor, ticks) in [(0.1, 50), (1.0, 500), (4.0, 2000)] {
        let (elapsed, reported) = paced(Speed::times(factor), ticks);
        let expected_s = ticks as f64 / 100.0 / factor;
        let error_s = elapsed.as_secs_f64() - expected_s;
        // Orders are looked for every ten milliseconds, and the last tick begins when the one before is over.
        assert!(error_s.abs() < 0.03 + 0.01 / factor, "{elapsed:?} instead of {expected_s} s");
        assert!((reported / factor - 1.0).abs() < 0.03, "it says {reported} instead of {factor}");
    }
}
