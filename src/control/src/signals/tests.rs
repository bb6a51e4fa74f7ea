//! Tests of the signals: times of the cycle, extension and gap-out, counted flows, what is told.

use super::*;
use city3d_roadmap::{LabMap, load_map};

const STEP_S: f64 = 0.02;

fn heads(ids: &[u32]) -> Vec<SignalHeadId> {
    ids.iter().copied().map(SignalHeadId).collect()
}

fn phase(green: &[u32], green_s: f64) -> SignalPhase {
    SignalPhase { green: heads(green), green_s, yellow_s: 2.0, all_red_s: 1.0 }
}

/// Two phases of two heads each; the cycle has 10 + 2 + 1 + 6 + 2 + 1 seconds.
fn crossing(control: SignalControl) -> SignalPlan {
    let phases = vec![phase(&[0, 1], 10.0), phase(&[2, 3], 6.0)];
    SignalPlan { name: "crossing".to_owned(), phases, control, offset_s: 0.0 }
}

/// A map with so many heads; where they stand does not matter here.
fn map(count: usize) -> LabMap {
    let bytes = include_bytes!("../../../../assets/maps/ids3c.dxf");
    let mut map = load_map(bytes).unwrap().map;
    let lane = map.lanes[0].id;
    map.signals = vec![city3d_roadmap::SignalHead { lane, at_m: 0.0 }; count];
    map
}

fn signals(plan: SignalPlan) -> Signals {
    Signals::new(vec![plan], &map(4))
}

fn aspects(signals: &Signals) -> [Aspect; 4] {
    [0, 1, 2, 3].map(|id| signals.head(SignalHeadId(id)).aspect)
}

/// Times at which a head changes, with what it shows then.
fn changes(
    signals: &mut Signals,
    head: u32,
    to_s: f64,
    traffic: impl Fn(f64) -> Vec<ApproachingVehicle>,
) -> Vec<(f64, Aspect)> {
    let mut found: Vec<(f64, Aspect)> = Vec::new();
    for step in 0..(to_s / STEP_S) as u32 {
        let now_s = f64::from(step) * STEP_S;
        signals.step(now_s, &traffic(now_s));
        let aspect = signals.head(SignalHeadId(head)).aspect;
        if found.last().is_none_or(|(_, last)| *last != aspect) {
            found.push((now_s, aspect));
        }
    }
    found
}

fn assert_changes(found: &[(f64, Aspect)], expected: &[(f64, Aspect)]) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for ((at_s, aspect), (expected_s, expected)) in found.iter().zip(expected) {
        assert!(aspect == expected && (at_s - expected_s).abs() < 1e-6, "{found:?}");
    }
}

use Aspect::{Green, Red, Yellow};

#[test]
fn a_fixed_cycle_changes_at_the_stated_times_and_again_in_each_cycle() {
    let mut of_first = signals(crossing(SignalControl::FixedTime));
    let found = changes(&mut of_first, 0, 45.0, |_| Vec::new());
    let expected = [
        (0.0, Green),
        (10.0, Yellow),
        (12.0, Red),
        (22.0, Green),
        (32.0, Yellow),
        (34.0, Red),
        (44.0, Green),
    ];
    assert_changes(&found, &expected);
    let mut of_second = signals(crossing(SignalControl::FixedTime));
    let found = changes(&mut of_second, 2, 42.0, |_| Vec::new());
    assert_changes(
        &found,
        &[(0.0, Red), (13.0, Green), (19.0, Yellow), (21.0, Red), (35.0, Green), (41.0, Yellow)],
    );
}

#[test]
fn an_offset_shifts_the_cycle_and_a_restart_goes_on_in_it() {
    let plan = SignalPlan { offset_s: 5.0, ..crossing(SignalControl::FixedTime) };
    let found = changes(&mut signals(plan.clone()), 0, 20.0, |_| Vec::new());
    assert_changes(&found, &[(0.0, Red), (5.0, Green), (15.0, Yellow), (17.0, Red)]);
    let mut restarted = signals(plan);
    restarted.step(16.0, &[]);
    assert_eq!(aspects(&restarted), [Yellow, Yellow, Red, Red]);
    assert!((restarted.head(SignalHeadId(0)).left_s - 1.0).abs() < 1e-9);
}

#[test]
fn a_head_of_two_phases_in_a_row_keeps_green_between_them() {
    // Head 0 goes on while head 1 gives way to head 2.
    let phases = vec![phase(&[0, 1], 5.0), phase(&[0, 2], 5.0), phase(&[3], 5.0)];
    let plan = SignalPlan { phases, ..crossing(SignalControl::FixedTime) };
    let found = changes(&mut signals(plan.clone()), 0, 20.0, |_| Vec::new());
    assert_changes(&found, &[(0.0, Green), (13.0, Yellow), (15.0, Red)]);
    let found = changes(&mut signals(plan), 1, 20.0, |_| Vec::new());
    assert_changes(&found, &[(0.0, Green), (5.0, Yellow), (7.0, Red)]);
}

fn actuated() -> SignalPlan {
    let params = ActuatedControl { min_green_s: 5.0, max_green_s: 20.0, max_gap_s: 3.0, detector_m: 0.7 };
    crossing(SignalControl::Actuated(params))
}

/// A vehicle that waits at the line of a head.
fn waiting(head: u32) -> ApproachingVehicle {
    ApproachingVehicle { head: SignalHeadId(head), to_line_m: 0.1, length_m: 0.2, speed_mps: 0.0 }
}

/// A vehicle that drives over the detector of a head.
fn passing(head: u32) -> ApproachingVehicle {
    ApproachingVehicle { head: SignalHeadId(head), to_line_m: 0.6, length_m: 0.2, speed_mps: 0.35 }
}

#[test]
fn an_actuated_phase_rests_in_green_while_nobody_else_waits() {
    let found = changes(&mut signals(actuated()), 0, 120.0, |_| vec![passing(0)]);
    assert_changes(&found, &[(0.0, Green)]);
    let found = changes(&mut signals(actuated()), 0, 120.0, |_| Vec::new());
    assert_changes(&found, &[(0.0, Green)]);
}

#[test]
fn an_actuated_phase_gaps_out_after_its_last_vehicle() {
    // Vehicles pass until 8 s, somebody else waits from the beginning: the gap of 3 s ends at 11 s.
    let traffic = |now_s: f64| {
        let mut all = vec![waiting(2)];
        all.extend((now_s <= 8.0 + 1e-9).then(|| passing(0)));
        all
    };
    let found = changes(&mut signals(actuated()), 0, 15.0, traffic);
    assert_changes(&found, &[(0.0, Green), (11.0, Yellow), (13.0, Red)]);
    // Without any vehicle of its own the shortest green ends it.
    let found = changes(&mut signals(actuated()), 0, 12.0, |_| vec![waiting(3)]);
    assert_changes(&found, &[(0.0, Green), (5.0, Yellow), (7.0, Red)]);
}

#[test]
fn an_actuated_phase_ends_at_the_longest_green_from_the_call_of_another() {
    let traffic = |now_s: f64| {
        let mut all = vec![passing(1)];
        all.extend((now_s >= 10.0 - 1e-9).then(|| waiting(2)));
        all
    };
    let found = changes(&mut signals(actuated()), 1, 36.0, traffic);
    assert_changes(&found, &[(0.0, Green), (30.0, Yellow), (32.0, Red)]);
}

#[test]
fn an_actuated_signal_skips_phases_without_a_call_and_serves_who_called() {
    let phases = vec![phase(&[0], 5.0), phase(&[1], 5.0), phase(&[2, 3], 5.0)];
    let plan = SignalPlan { phases, ..actuated() };
    let mut signals = signals(plan);
    let found =
        changes(&mut signals, 2, 12.0, |now_s| if now_s < 4.0 { vec![waiting(2)] } else { Vec::new() });
    // The call is kept although its vehicle has gone; phase 1 never had green.
    assert_changes(&found, &[(0.0, Red), (8.0, Green)]);
}

#[test]
fn counted_flows_come_to_websters_greens() {
    let params =
        CountedControl { window_s: 120.0, saturation_veh_h: 1500.0, min_green_s: 4.0, max_cycle_s: 120.0 };
    let plan = crossing(SignalControl::Counted(params));
    let mut counted = super::counted::Counted::new(params, &plan);
    // One vehicle each 4 s passes the line of head 0, one each 8 s that of head 2: 900 and 450 an hour.
    for step in 0..30_000_u32 {
        let now_s = f64::from(step) * STEP_S;
        let across = |head: u32, every: u32| {
            let is_across = step % every < 20;
            is_across.then_some(ApproachingVehicle { to_line_m: -0.05, ..waiting(head) })
        };
        let traffic: Vec<_> = across(0, 200).into_iter().chain(across(2, 400)).collect();
        counted.step(now_s, &plan, &traffic);
    }
    // L = 6 s, Y = 0.6 + 0.3: C0 = 140 s, beyond the longest cycle of 120 s, of which 114 s are green.
    let greens = [counted.green_s(0), counted.green_s(1)];
    assert!((greens[0] - 76.0).abs() < 2.0 && (greens[1] - 38.0).abs() < 2.0, "{greens:?}");
}

#[test]
fn changes_are_told_at_once_and_everything_now_and_then() {
    let mut signals = signals(crossing(SignalControl::FixedTime));
    let mut told: Vec<(f64, usize)> = Vec::new();
    for step in 0..=550 {
        let now_s = f64::from(step) * STEP_S;
        signals.step(now_s, &[]);
        for message in signals.messages(now_s) {
            assert_eq!(message.stamp_s, now_s);
            told.push((now_s, message.heads.len()));
        }
    }
    let changes: Vec<_> = told.iter().filter(|(at_s, _)| (at_s - 10.0).abs() < 1e-6).collect();
    assert_eq!(changes.len(), 1);
    let all = told.iter().filter(|(_, count)| *count == 4).count();
    assert_eq!(all, 23, "each half second from 0 to 11 s: {told:?}");
    assert!(told.len() <= 24, "{told:?}");
}

#[test]
fn many_heads_are_told_in_several_messages() {
    let plan = SignalPlan {
        phases: vec![phase(&(0..450).collect::<Vec<_>>(), 5.0)],
        ..crossing(SignalControl::FixedTime)
    };
    let mut signals = Signals::new(vec![plan], &map(450));
    signals.step(0.0, &[]);
    let counts: Vec<usize> = signals.messages(0.0).map(|message| message.heads.len()).collect();
    assert_eq!(counts, [200, 200, 50]);
}

#[test]
fn yellow_and_all_red_follow_their_formulas() {
    assert!((yellow_time_s(1.0, 0.35, 0.20) - 1.875).abs() < 1e-12);
    assert!((all_red_time_s(0.6, 0.2, 0.35) - 2.285_714_285_714).abs() < 1e-9);
}
