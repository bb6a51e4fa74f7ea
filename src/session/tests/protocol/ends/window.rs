//! A window that nobody looks at, and one that asks for too much.

use super::{Probe, Timed, assert_quick, without_end};
use crate::compare::assert_same;
use crate::lab::{named, scenario};
use city3d_protocol::snapshot::Pedals;
use city3d_session::{
    FileOptions, Host, LocalCity, Order, RunFiles, RunFolders, Session, SessionEnd, Source, Speed,
};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const TICKS: u64 = 600;
const PATIENCE: Duration = Duration::from_secs(30);

#[test]
fn a_window_that_nobody_looks_at_delays_nothing() {
    let (experiment, probe) = (scenario("roundabout", 40.0), Arc::<Mutex<Probe>>::default());
    let host = Host::system();
    let city = LocalCity::new(Arc::clone(&experiment), host.clone()).unwrap().started();
    let files = Box::new(RunFiles::new(RunFolders::None, city.origin(), FileOptions::default()));
    let written = files.written();
    let timed = Timed { end: files, crowd: 0, probe: Arc::clone(&probe) };
    let session = Session::new(city, host)
        .at_speed(Speed::Unlimited)
        .until(SessionEnd::AtTick(TICKS))
        .with_end(Box::new(timed));
    let written = session.spawn(Some(written)).unwrap().wait().unwrap();
    let probe = probe.lock().unwrap();
    assert_quick(&probe.takes);
    assert_same(&probe.runs[0], &without_end(&experiment, TICKS as usize + 1), "city");
    assert_eq!(written.summary.unwrap().simulated_s, 6.0);
}

#[test]
fn more_orders_than_there_is_room_for_are_refused_at_once() {
    let host = Host::system();
    let city = LocalCity::new(scenario("roundabout", 40.0), host.clone()).unwrap();
    let session = Session::new(city, host);
    let orders = session.orders().unwrap();
    let taken = (0..300).filter(|_| orders.send(Order::Pause)).count();
    assert_eq!(taken, 256);
    drop(session);
    assert!(!orders.send(Order::Pause), "the session has ended");
}

#[test]
fn an_order_that_is_refused_shows_with_its_reason() {
    let (experiment, host) = (scenario("mixed", 40.0), Host::system());
    let vehicle = named(&experiment, "path1_b");
    let city = LocalCity::new(experiment, host.clone()).unwrap();
    let session = Session::new(city, host).spawn(None).unwrap();
    let (updates, updated) = channel();
    session.on_update(Arc::new(move || updates.send(()).unwrap_or_default()));
    for count in 1..=2 {
        assert!(session.send(Order::Drive(vehicle, Pedals::default())));
        let refusal = loop {
            updated.recv_timeout(PATIENCE).unwrap();
            if let Some(refusal) = session.run_state().refusal.clone().filter(|refusal| refusal.0 == count) {
                break refusal;
            }
        };
        assert!(refusal.1.contains("is in the laboratory"), "{refusal:?}");
    }
    session.stop().unwrap();
}
