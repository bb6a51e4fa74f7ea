//! The page of gamepads and steering wheels, and driving with them.

use super::desk::{Desk, click, fleet, harness, press};
use city3d_protocol::snapshot::{Indicator, Pedals, VehicleId};
use city3d_session::{Order, RunPhase};
use city3d_viewer::cockpit::{ControlFunction, DeviceControl, DeviceEvent, DeviceInfo, DeviceProfile};
use city3d_viewer::ui::{ManualDrive, UiAction};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

const STICK: DeviceControl = DeviceControl::Axis(0);
const GAS: DeviceControl = DeviceControl::Button(7);
const BRAKE: DeviceControl = DeviceControl::Button(6);
const REVERSE: DeviceControl = DeviceControl::Button(3);
const START: DeviceControl = DeviceControl::Button(11);

fn gamepad() -> DeviceEvent {
    let buttons = [
        (ControlFunction::Gas, GAS),
        (ControlFunction::Brake, BRAKE),
        (ControlFunction::Reverse, REVERSE),
        (ControlFunction::IndicateLeft, DeviceControl::Button(4)),
        (ControlFunction::LookBack, DeviceControl::Button(5)),
        (ControlFunction::TakeWheel, START),
    ];
    let usual = DeviceProfile::usual(Some(STICK), false, &buttons);
    DeviceEvent::Plugged(1, DeviceInfo { key: "pad".to_owned(), name: "A gamepad".to_owned(), usual })
}

fn wheel() -> DeviceEvent {
    let usual = DeviceProfile::usual(Some(STICK), true, &[]);
    DeviceEvent::Plugged(2, DeviceInfo { key: "wheel".to_owned(), name: "A wheel".to_owned(), usual })
}

fn with_device(event: DeviceEvent) -> Desk {
    let mut desk = Desk::with(fleet(6));
    desk.run_state.phase = RunPhase::Running;
    desk.state.devices.take(event, 0.0);
    desk
}

/// Moves a control through values, a pass for each, and waits.
fn go(harness: &mut Harness<'static, Desk>, device: usize, control: DeviceControl, values: &[f64]) {
    for value in values {
        let now_s = harness.ctx.input(|input| input.time);
        harness.state_mut().state.devices.take(DeviceEvent::Moved(device, control, *value), now_s);
        harness.run_steps(1);
    }
}

fn last(harness: &Harness<'static, Desk>) -> Pedals {
    let pedals = |action: &UiAction| match action {
        UiAction::Order(Order::Drive(VehicleId(1), pedals)) => Some(*pedals),
        _ => None,
    };
    harness.state().actions.iter().rev().find_map(pedals).unwrap()
}

#[test]
fn without_a_device_the_page_says_so_and_keys_drive_on() {
    let mut desk = Desk::with(fleet(1));
    desk.state
        .devices
        .take(DeviceEvent::Missing("Gamepads cannot be read here: no /dev/input".to_owned()), 0.0);
    let mut harness = harness(desk);
    press(&mut harness, egui::Key::F2);
    harness.run_steps(5);
    assert_eq!(harness.query_all_by_label_contains("No gamepad or steering wheel is plugged in").count(), 1);
    assert_eq!(harness.query_all_by_label_contains("no /dev/input").count(), 1);
    press(&mut harness, egui::Key::Escape);
    harness.run_steps(5);
    assert_eq!(harness.query_all_by_label_contains("is plugged in").count(), 0);
    assert_eq!(harness.state().actions, []);
}

#[test]
fn a_gamepad_takes_the_wheel_drives_and_gives_back() {
    let mut harness = harness(with_device(gamepad()));
    go(&mut harness, 1, START, &[1.0, 0.0]);
    assert_eq!(harness.state().actions, [], "nothing is selected");
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    go(&mut harness, 1, START, &[1.0, 0.0]);
    assert_eq!(harness.state().actions, [UiAction::Drive(VehicleId(1))]);
    harness.state_mut().state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    go(&mut harness, 1, GAS, &[0.2, 0.6]);
    go(&mut harness, 1, STICK, &[-1.0]);
    let pedals = last(&harness);
    assert!((pedals.gas - 0.6).abs() < 1e-9 && pedals.steering_rad > 0.3, "{pedals:?}");
    go(&mut harness, 1, DeviceControl::Button(4), &[1.0, 0.0]);
    assert_eq!(last(&harness).indicator, Indicator::Left);
    go(&mut harness, 1, DeviceControl::Button(5), &[1.0]);
    assert!(harness.state().state.viewpoint.rear);
    go(&mut harness, 1, DeviceControl::Button(5), &[0.0]);
    assert!(!harness.state().state.viewpoint.rear);
    // Keys take over from it, and it from them.
    harness.key_down(egui::Key::S);
    harness.run_steps(20);
    assert!(last(&harness).gas == 0.0 && last(&harness).brake > 0.2);
    harness.key_up(egui::Key::S);
    harness.run_steps(30);
    assert_eq!(last(&harness).brake, 0.0);
    go(&mut harness, 1, BRAKE, &[0.5]);
    assert_eq!((last(&harness).brake, last(&harness).gas), (0.5, 0.6));
    harness.state_mut().actions.clear();
    go(&mut harness, 1, START, &[1.0]);
    assert_eq!(harness.state().actions, [UiAction::GiveBack], "no pedal comes after it");
}

#[test]
fn a_device_that_is_unplugged_while_driving_releases_the_pedals() {
    let mut desk = with_device(gamepad());
    desk.state.driving = Some(ManualDrive::take_over(VehicleId(1), 1, 0.0));
    let mut harness = harness(desk);
    go(&mut harness, 1, GAS, &[1.0]);
    assert_eq!(last(&harness).gas, 1.0);
    let said = harness.state_mut().state.devices.take(DeviceEvent::Unplugged(1), 1.0).unwrap();
    assert!(said.contains("pedals are released"), "{said}");
    harness.run_steps(1);
    assert_eq!(last(&harness).gas, 0.0);
    assert_eq!(harness.state().state.driven(), Some(VehicleId(1)), "the person still drives, by keys");
    harness.key_down(egui::Key::W);
    harness.run_steps(20);
    assert!(last(&harness).gas > 0.2);
}

#[test]
fn a_wheel_with_inverted_pedals_is_assigned_by_moving_it() {
    let mut desk = with_device(wheel());
    desk.state.open.controllers = true;
    let mut harness = harness(desk);
    assert_eq!(harness.get_all_by_label("not assigned").count(), 9, "all but the steering");
    let pedal = DeviceControl::Axis(5);
    click(&mut harness, "Assign Gas");
    assert_eq!(harness.query_all_by_label_contains("as far as it goes").count(), 1);
    go(&mut harness, 2, pedal, &[0.99, 0.0, -1.0, 0.5, 1.0]);
    assert_eq!(harness.state().actions, [], "not before it has been let go");
    harness.run_steps(4);
    assert_eq!(harness.state().actions, [UiAction::KeepDevices]);
    harness.get_by_label("axis 5");
    harness.get_by_label("Gas 0.00");
    go(&mut harness, 2, pedal, &[-1.0]);
    harness.get_by_label("Gas 1.00");
    let profile = &harness.state().state.devices.profiles()["wheel"];
    assert_eq!(profile.control(ControlFunction::Gas), Some(pedal));
    // Another function takes the pedal, and the user is told.
    go(&mut harness, 2, pedal, &[1.0]);
    click(&mut harness, "Assign Brake");
    go(&mut harness, 2, pedal, &[-1.0, 1.0]);
    harness.run_steps(4);
    let (said, _) = harness.state().state.notice.clone().unwrap();
    assert!(said.contains("no control now: Gas"), "{said}");
    click(&mut harness, "Assign Gas");
    press(&mut harness, egui::Key::Escape);
    assert!(harness.state().state.devices.learning().is_none() && harness.state().state.open.controllers);
    click(&mut harness, "Restore");
    assert!(harness.state().state.devices.profiles().is_empty());
}

#[test]
fn controls_are_inverted_cleared_and_eased() {
    let mut desk = with_device(gamepad());
    desk.state.open.controllers = true;
    let mut harness = harness(desk);
    go(&mut harness, 1, STICK, &[-1.0]);
    harness.get_by_label("Steering 1.00");
    let invert =
        |harness: &Harness<'static, Desk>| harness.get_all_by_label("Invert").next().unwrap().click();
    invert(&harness);
    harness.run_steps(3);
    harness.get_by_label("Steering -1.00");
    harness.get_all_by_label("x").last().unwrap().click();
    harness.run_steps(3);
    assert_eq!(harness.state().state.devices.profiles()["pad"].control(ControlFunction::TakeWheel), None);
    click(&mut harness, "Steers less the faster the car is");
    assert!(!harness.state().state.devices.profiles()["pad"].speed_sensitive);
    assert_eq!(harness.state().actions, vec![UiAction::KeepDevices; 3]);
}
