//! Messages of a log come back as they were written, and damaged ones do not.

use super::*;
use city3d_protocol::snapshot::EventKind;

#[test]
fn trajectories_and_ticks_come_back_to_the_last_bit() {
    let point = |time_s: f64| TrajectoryPoint {
        time_s,
        pose: Pose2::new(1.0 / 3.0, -0.0, 0.123_456_789_012_345_6),
        speed_mps: time_s / 7.0,
    };
    let trajectory = Trajectory {
        vehicle: VehicleId(70_000),
        sequence: u32::MAX,
        points: (0..13).map(|k| point(f64::from(k) / 10.0)).collect(),
        yielding: true,
        finished: false,
        indicator: Indicator::Right,
    };
    let bytes = encode_trajectory(3, &trajectory, Vec::new());
    assert_eq!(decode_trajectory(&bytes), Some((3, trajectory)));
    assert_eq!(decode_trajectory(&bytes[..bytes.len() - 1]), None);
    assert_eq!(decode_tick(&encode_tick(4, u64::MAX, Vec::new())), Some((4, u64::MAX)));
}

#[test]
fn events_come_back() {
    for kind in [
        EventKind::Spawn,
        EventKind::Go { stood_s: 0.5 },
        EventKind::Moved { behind: VehicleId(2), by_m: 1.0 / 3.0 },
        EventKind::Collision { with: VehicleId(3) },
        EventKind::CollisionStatic { with: "a \"wall\"".to_owned() },
    ] {
        let event = Event { time_s: 0.1 + 0.2, vehicle: VehicleId(7), kind };
        let bytes = encode_event(&event, Vec::new());
        assert_eq!(decode_event(&bytes), Some(event));
        assert_eq!(decode_event(&bytes[..bytes.len() - 1]), None);
    }
}

#[test]
fn states_come_back_in_the_precision_of_the_log() {
    let state = VehicleState {
        id: VehicleId(9),
        status: Status::Yielding,
        position: DVec3::new(1.0 / 3.0, -2.0, 0.5),
        orientation: DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8),
        speed_mps: 0.1,
        gas: 0.3,
        brake_lights: true,
        indicator: Indicator::Left,
        lateral_error_m: -0.01,
        distance_m: 77.5,
        ..VehicleState::default()
    };
    let logged = LoggedVehicle::of(&state);
    let back = logged.state();
    assert_eq!((back.id, back.status, back.position), (state.id, state.status, state.position));
    assert_eq!((back.brake_lights, back.reverse, back.indicator), (true, false, Indicator::Left));
    for (a, b) in [
        (back.speed_mps, 0.1),
        (back.gas, 0.3),
        (back.lateral_error_m, -0.01),
        (back.distance_m, 77.5),
        (back.pose().yaw_rad, state.pose().yaw_rad),
    ] {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    assert_eq!(LoggedVehicle::of(&back), logged);
}

#[test]
fn network_commands_come_back() {
    let command = NetworkCommand { tick: 9, sender: "[::1]:7".to_owned(), kind: 3, body: vec![0, 255] };
    let bytes = encode_network(&command, Vec::new());
    assert_eq!(decode_network(&bytes), Some(command));
    assert_eq!(decode_network(&bytes[..bytes.len() - 1]), None);
}

#[test]
fn measured_poses_come_back_to_the_last_bit() {
    let position = DVec3::new(1.0 / 3.0, -2e-300, 7.5);
    let orientation = DQuat::from_xyzw(0.1, -0.2, 0.3, 0.9);
    let pose = MeasuredPose { stamp_s: 12.34, position, orientation };
    let bytes = encode_measured(u64::MAX, VehicleId(7), &pose, Vec::new());
    assert_eq!(decode_measured(&bytes), Some((u64::MAX, SimCommand::Measure(VehicleId(7), pose))));
    assert_eq!(decode_measured(&bytes[..bytes.len() - 1]), None);
}

#[test]
fn commands_come_back_to_the_last_bit() {
    let pedals = Pedals {
        gas: 0.1,
        brake: 1.0 / 3.0,
        handbrake: 1.0,
        steering_rad: -0.123_456_789_012_345_6,
        reverse: true,
        indicator: Indicator::Hazard,
    };
    for command in [
        SimCommand::Drive(VehicleId(7), pedals),
        SimCommand::Drive(VehicleId(8), Pedals { indicator: Indicator::Left, ..Pedals::default() }),
        SimCommand::Release(VehicleId(70_000)),
        SimCommand::Remove(VehicleId(0)),
    ] {
        let bytes = encode_command(u64::MAX, PersonCommand::of(&command).unwrap(), Vec::new());
        assert_eq!(decode_command(&bytes), Some((u64::MAX, command)));
        assert_eq!(decode_command(&bytes[..bytes.len() - 1]), None);
    }
    assert_eq!(PersonCommand::of(&SimCommand::Reset), None);
}
