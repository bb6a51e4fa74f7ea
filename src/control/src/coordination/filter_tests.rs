//! Tests of the safety filter: published bounds, and vehicles ahead that do the worst.

use super::*;
use proptest::prelude::*;

fn standing(gap_m: f64) -> Preceding {
    Preceding { gap_m, speed_mps: 0.0, min_acceleration_mps2: -0.2, merging: None }
}

/// Without brakes that end, and in continuous time.
fn unbounded() -> FilterParams {
    FilterParams {
        headway_s: 1.8,
        standstill_gap_m: 0.1,
        gain_per_s: 0.7,
        step_s: 1e-9,
        min_acceleration_mps2: -1e6,
        max_acceleration_mps2: 1e6,
        max_mps: 1e9,
        ..FilterParams::default()
    }
}

#[test]
fn in_continuous_time_the_rate_bound_is_the_published_one() {
    let params = unbounded();
    let (v, v_p, z) = (0.3, 0.2, 0.9);
    let ahead = Preceding { gap_m: z, speed_mps: v_p, ..standing(z) };
    // phi u <= v_p - v + k (z - phi v - delta).
    let published = (v_p - v + 0.7 * (z - 1.8 * v - 0.1)) / 1.8;
    assert!((params.rate_bound(v, &ahead) - published).abs() < 1e-6);
    // phi x/L u <= v_p - v - phi v^2/L + k (z - phi x/L v - delta).
    let (x, length_m) = (1.2, 3.0);
    let merging = Some(MergingZone { travelled_m: x, length_m });
    let reach_s = 1.8 * x / length_m;
    let published = (v_p - v - 1.8 * v * v / length_m + 0.7 * (z - reach_s * v - 0.1)) / reach_s;
    assert!((params.rate_bound(v, &Preceding { merging, ..ahead }) - published).abs() < 1e-6);
    // Behind the merge it is the bound of one path.
    let passed = Some(MergingZone { travelled_m: 3.5, length_m });
    assert_eq!(params.rate_bound(v, &Preceding { merging: passed, ..ahead }), params.rate_bound(v, &ahead));
}

#[test]
fn the_step_of_the_rate_bound_decays_the_barrier_exactly() {
    let params = FilterParams { step_s: 0.1, ..FilterParams::default() };
    for merging in [None, Some(MergingZone { travelled_m: 1.0, length_m: 3.0 })] {
        let (v, ahead) = (0.3, Preceding { speed_mps: 0.25, merging, ..standing(0.6) });
        let u = params.rate_bound(v, &ahead);
        let way_m = v * 0.1 + u * 0.005;
        let ahead_m = 0.25 * 0.1 - 0.2 * 0.005;
        let next = Preceding {
            gap_m: ahead.gap_m + ahead_m - way_m,
            merging: merging.map(|zone| MergingZone { travelled_m: zone.travelled_m + way_m, ..zone }),
            ..ahead
        };
        let (h, h_next) = (params.barrier(v, &ahead), params.barrier(v + u * 0.1, &next));
        assert!((h_next - (1.0 - 0.1) * h).abs() < 1e-12, "{h_next} after {h}");
    }
}

#[test]
fn speeds_are_bounded_and_an_empty_box_brakes_and_counts() {
    let params = FilterParams { min_mps: 0.05, max_mps: 0.35, ..FilterParams::default() };
    let mut filter = SafetyFilter::default();
    assert_eq!(filter.limit(0.1, &params, params.bounds(0.35, &[])), 0.0);
    assert_eq!(filter.limit(-0.1, &params, params.bounds(0.05, &[])), 0.0);
    let counts = FilterCounts { steps: 2, limited: 2, ..FilterCounts::default() };
    assert_eq!(filter.counts(), counts);
    // The least speed asks for acceleration, the vehicle ahead for braking.
    assert_eq!(filter.limit(0.0, &params, params.bounds(0.04, &[standing(0.0805)])), -0.2);
    assert_eq!(filter.counts().empty, 1);
    assert!((filter.counts().least_barrier_m.unwrap() - (0.0805 - 0.04 - 0.08)).abs() < 1e-12);
    // Too late to brake: counted, and braked all the same.
    assert_eq!(filter.limit(0.0, &params, params.bounds(0.35, &[standing(0.3)])), -0.2);
    assert_eq!((filter.counts().empty, filter.counts().unsafe_states), (2, 2));
}

#[test]
fn with_bounded_brakes_the_published_bound_alone_is_not_enough() {
    // Towards a vehicle that stands, with a gain that lets the barrier be used up late.
    let params = FilterParams { headway_s: 0.5, gain_per_s: 5.0, max_mps: 0.35, ..FilterParams::default() };
    let run = |is_published: bool| {
        let mut filter = SafetyFilter::default();
        let (mut v, mut ahead, mut least) = (0.35, standing(1.5), f64::INFINITY);
        for _ in 0..1500 {
            let u = if is_published {
                params.rate_bound(v, &ahead).clamp(params.min_acceleration_mps2, 0.0)
            } else {
                filter.limit(0.0, &params, params.bounds(v, &[ahead]))
            };
            v = advance(&mut ahead, v, (u, 0.0), params.step_s);
            least = f64::min(least, params.barrier(v, &ahead));
        }
        least
    };
    assert!(run(true) < -0.05, "{}", run(true));
    assert!(run(false) >= 0.0, "{}", run(false));
}

/// A step of both vehicles at constant accelerations (own, ahead); returns the own speed.
fn advance(ahead: &mut Preceding, v: f64, (u, u_p): (f64, f64), step_s: f64) -> f64 {
    let next_mps = (v + u * step_s).max(0.0);
    let next_ahead_mps = (ahead.speed_mps + u_p * step_s).max(0.0);
    let way_m = (v + next_mps) / 2.0 * step_s;
    ahead.gap_m += (ahead.speed_mps + next_ahead_mps) / 2.0 * step_s - way_m;
    ahead.speed_mps = next_ahead_mps;
    if let Some(zone) = &mut ahead.merging {
        zone.travelled_m += way_m;
    }
    next_mps
}

/// What a vehicle does for some steps.
fn manoeuvres() -> impl Strategy<Value = Vec<(f64, usize)>> {
    let acceleration = prop_oneof![3 => Just(-0.2), 1 => Just(0.12), 1 => Just(0.0), 1 => -0.2..0.12];
    proptest::collection::vec((acceleration, 1_usize..150), 1..12)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// The barrier holds from every feasible start, whatever the vehicle ahead does and whatever is wanted.
    #[test]
    fn no_vehicle_ahead_breaks_the_barrier(
        (v, v_p, spare_m) in (0.0..0.5_f64, 0.0..0.5_f64, 0.0..0.3_f64),
        (headway_s, gain_per_s) in (0.2..2.0_f64, 0.2..50.0_f64),
        zone in proptest::option::of((0.0..1.0_f64, 0.5..6.0_f64)),
        (theirs, wanted) in (manoeuvres(), manoeuvres()),
        parts in prop_oneof![Just(1_u32), Just(10)],
    ) {
        let params = FilterParams { headway_s, gain_per_s, ..FilterParams::default() };
        let merging = zone.map(|(share, length_m)| MergingZone { travelled_m: share * length_m, length_m });
        let mut ahead = Preceding { speed_mps: v_p, merging, ..standing(0.0) };
        ahead.gap_m = params.safe_gap(v, &ahead) + spare_m;
        let (mut v, mut filter) = (v, SafetyFilter::default());
        let each = |parts: &[(f64, usize)]| -> Vec<f64> {
            parts.iter().flat_map(|&(u, steps)| std::iter::repeat_n(u, steps)).collect()
        };
        let wanted = each(&wanted);
        for (step, u_p) in each(&theirs).into_iter().enumerate() {
            let u = filter.limit(wanted[step % wanted.len()], &params, params.bounds(v, &[ahead]));
            // In tenths of a step to see what is between the steps, and whole, as plans are made.
            for _ in 0..parts {
                v = advance(&mut ahead, v, (u, u_p), params.step_s / f64::from(parts));
                let h = params.barrier(v, &ahead);
                prop_assert!(h >= -1e-6, "step {step}: h {h} at {v} m/s, {ahead:?}");
            }
        }
        prop_assert_eq!(filter.counts().unsafe_states, 0);
    }

    /// The closed form of the least barrier is that of braking in small steps.
    #[test]
    fn the_least_barrier_is_that_of_braking(
        (v, v_p) in (0.0..0.5_f64, 0.0..0.5_f64),
        (braking_mps2, headway_s) in (0.05..0.6_f64, 0.2..2.0_f64),
        zone in proptest::option::of((0.0..0.99_f64, 0.5..6.0_f64)),
    ) {
        let params = FilterParams { headway_s, ..FilterParams::default() };
        let merging = zone.map(|(share, length_m)| MergingZone { travelled_m: share * length_m, length_m });
        let ahead = Preceding { speed_mps: v_p, min_acceleration_mps2: -braking_mps2, merging, ..standing(1.0) };
        let way = BrakingWay::new(&params, v, &ahead);
        let closed = way.least_barrier();
        // Beyond the merge the closed form keeps the ramp.
        let barrier = |v: f64, ahead: &Preceding| {
            let share = ahead.merging.map_or(1.0, |zone| zone.travelled_m / zone.length_m);
            ahead.gap_m - headway_s * share * v - params.standstill_gap_m
        };
        let (mut v, mut ahead, mut least) = (v, ahead, barrier(v, &ahead));
        while v > 0.0 {
            v = advance(&mut ahead, v, (-0.2, -braking_mps2), 1e-4);
            least = f64::min(least, barrier(v, &ahead));
        }
        prop_assert!((least - closed).abs() < 1e-5, "{least} and {closed}");
    }
}
