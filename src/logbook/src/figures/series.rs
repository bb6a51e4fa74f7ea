//! Time series from the samples of traces: moving averages, step speeds, differences and RMS.

use super::chart::{ChartLine, LineStyle, viridis};
use super::run::{Trace, TraceSample};
use super::views::PathSegment;
use city3d_geometry::trig;
use std::collections::BTreeMap;

/// Window of the centred moving average of speeds, seconds (the paper, section III).
pub const AVERAGED_S: f64 = 0.1;
/// Rounding error of times, seconds.
const ROUNDING_S: f64 = 1e-9;
/// Colour steps of the speed scale.
const SPEED_STEPS: f64 = 24.0;

/// Splits a line into pieces of one colour by speed.
pub(super) fn by_speed(trace: &Trace, points: &[(usize, f64, f64)], fastest: f64) -> Vec<ChartLine> {
    let step = |speed: f64| (speed / fastest * SPEED_STEPS).round();
    let mut lines: Vec<ChartLine> = Vec::new();
    let mut last: Option<(f64, (f64, f64))> = None;
    for &(k, position, speed) in points {
        // A gap.
        if !position.is_finite() {
            last = None;
            continue;
        }
        let (here, point) = (step(speed), (trace.samples[k].time_s, position));
        match (last, lines.last_mut()) {
            (Some((before, _)), Some(line)) if before == here => line.points.push(point),
            (before, _) => {
                let from = before.map(|(_, point)| point);
                let stroke = LineStyle { width_pt: 1.3, ..LineStyle::solid(viridis(here / SPEED_STEPS)) };
                lines.push(ChartLine { points: from.into_iter().chain([point]).collect(), stroke });
            }
        }
        last = Some((here, point));
    }
    lines
}

/// Positions of a median, over the range of all segments.
const MEDIAN_POSITIONS: usize = 240;
/// A median is over at least so many vehicles, and half of them.
const MEDIAN_OF: usize = 3;

/// Median of the speeds at equidistant positions, over the segments that reach there.
pub(super) fn median_speeds(segments: &[PathSegment<'_>]) -> Vec<(f64, f64)> {
    let positions = || segments.iter().flat_map(|segment| &segment.points).map(|(_, position, _)| *position);
    let from = positions().fold(f64::INFINITY, f64::min);
    let to = positions().fold(f64::NEG_INFINITY, f64::max);
    let at = |place: usize| from + (to - from) * place as f64 / MEDIAN_POSITIONS as f64;
    let median = |position: f64| {
        let mut speeds: Vec<f64> =
            segments.iter().filter_map(|segment| speed_at(segment, position)).collect();
        speeds.sort_by(f64::total_cmp);
        let middle = speeds.len() / 2;
        let speed = match speeds.len() % 2 {
            _ if speeds.len() < MEDIAN_OF || 2 * speeds.len() < segments.len() => f64::NAN,
            0 => f64::midpoint(speeds[middle - 1], speeds[middle]),
            _ => speeds[middle],
        };
        (position, speed)
    };
    (0..=MEDIAN_POSITIONS).map(at).map(median).collect()
}

/// Speed where a segment first reaches a position, interpolated.
fn speed_at(segment: &PathSegment<'_>, position: f64) -> Option<f64> {
    let step = segment.points.windows(2).find(|pair| pair[0].1 <= position && pair[1].1 >= position)?;
    let [(_, a, from), (_, b, to)] = [step[0], step[1]];
    Some(if b > a { from + (to - from) * (position - a) / (b - a) } else { from })
}

/// Centred moving average of the speeds of a trace, with a window of [`AVERAGED_S`]; NaN where it was not measured.
pub fn moving_average(trace: &Trace) -> Vec<f64> {
    let samples = &trace.samples;
    let (mut from, mut to, mut sum, mut count) = (0, 0, 0.0, 0_u32);
    let mean = |sample: &TraceSample| {
        while to < samples.len() && samples[to].time_s <= sample.time_s + AVERAGED_S / 2.0 + ROUNDING_S {
            if samples[to].is_seen {
                (sum, count) = (sum + samples[to].speed_mps, count + 1);
            }
            to += 1;
        }
        while samples[from].time_s < sample.time_s - AVERAGED_S / 2.0 - ROUNDING_S {
            if samples[from].is_seen {
                (sum, count) = (sum - samples[from].speed_mps, count - 1);
            }
            from += 1;
        }
        if sample.is_seen { sum / f64::from(count) } else { f64::NAN }
    };
    samples.iter().map(mean).collect()
}

/// Samples farther apart than this, and than the median interval of the log, have a gap between them, seconds.
const GAP_S: f64 = 0.25;

/// Mean speeds of a trace over steps of [`AVERAGED_S`], by step number since time 0; full scale. The distance at the
/// ends of steps is interpolated with cubic Hermite splines from distances and speeds, so that the result hardly
/// depends on the rate of the log.
///
/// `is_told`: the distances are those of the vehicle. Otherwise they are estimates, and the distance is the
/// trapezoidal integral of the speeds.
pub fn step_speeds(trace: &Trace, is_told: bool) -> BTreeMap<i64, f64> {
    // What was not measured is a gap.
    let samples: Vec<TraceSample> = trace.samples.iter().filter(|sample| sample.is_seen).copied().collect();
    let mut ways: Vec<f64> = samples.iter().map(|sample| sample.distance_m).collect();
    for k in 1..if is_told { 0 } else { samples.len() } {
        let dt_s = samples[k].time_s - samples[k - 1].time_s;
        ways[k] = ways[k - 1] + dt_s * (samples[k - 1].speed_mps.abs() + samples[k].speed_mps.abs()) / 2.0;
    }
    let mut gaps: Vec<f64> = samples.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
    gaps.sort_by(f64::total_cmp);
    let longest_s = gaps.get(gaps.len() / 2).map_or(GAP_S, |usual_s| GAP_S.max(1.5 * usual_s));
    let mut found = BTreeMap::new();
    // The last end of a step, with its distance.
    let mut last: Option<(i64, f64)> = None;
    for (k, pair) in samples.windows(2).enumerate() {
        let dt_s = pair[1].time_s - pair[0].time_s;
        if dt_s > longest_s {
            last = None;
            continue;
        }
        let first = ((pair[0].time_s - ROUNDING_S) / AVERAGED_S).ceil() as i64;
        let end = ((pair[1].time_s - ROUNDING_S) / AVERAGED_S).ceil() as i64;
        for number in first..end {
            let u = ((number as f64 * AVERAGED_S - pair[0].time_s) / dt_s).clamp(0.0, 1.0);
            let [a, b] = [&pair[0], &pair[1]].map(|sample| sample.speed_mps.abs() * dt_s);
            let way = ways[k + 1] - ways[k];
            let at = ways[k] + u * (a + u * (3.0 * way - 2.0 * a - b + u * (a + b - 2.0 * way)));
            if let Some((before, from)) = last
                && before + 1 == number
            {
                found.insert(number, (at - from) / AVERAGED_S);
            }
            last = Some((number, at));
        }
    }
    found
}

/// Backward differences per second of values by step number.
pub fn step_changes(steps: &BTreeMap<i64, f64>) -> BTreeMap<i64, f64> {
    let change =
        |(number, value): (&i64, &f64)| Some((*number, (value - steps.get(&(number - 1))?) / AVERAGED_S));
    steps.iter().filter_map(change).collect()
}

/// The samples of a trace nearest to the ends of steps.
pub fn step_samples(trace: &Trace) -> impl Iterator<Item = &TraceSample> {
    let off_s = |sample: &TraceSample| {
        let number = (sample.time_s / AVERAGED_S).round();
        (number as i64, (sample.time_s - number * AVERAGED_S).abs())
    };
    let mut nearest: BTreeMap<i64, &TraceSample> = BTreeMap::new();
    for sample in &trace.samples {
        let (number, here_s) = off_s(sample);
        let kept = nearest.entry(number).or_insert(sample);
        if here_s < off_s(kept).1 {
            *kept = sample;
        }
    }
    nearest.into_values()
}

/// RMS (root mean square) of the speed difference of two traces at their common times, full scale; NaN without common
/// times.
pub fn rms_speed_difference(a: &Trace, b: &Trace) -> f64 {
    let seen = pairs(a, b).filter(|(one, other)| one.is_seen && other.is_seen);
    let (sum, count) = seen.fold((0.0, 0.0), |(sum, count), (one, other)| {
        (sum + trig::powi(one.speed_mps - other.speed_mps, 2), count + 1.0)
    });
    f64::sqrt(sum / count)
}

/// Samples of two traces at their common times.
fn pairs<'t>(a: &'t Trace, b: &'t Trace) -> impl Iterator<Item = (&'t TraceSample, &'t TraceSample)> {
    const SAME_S: f64 = 1e-6;
    let mut other = b.samples.iter().peekable();
    a.samples.iter().filter_map(move |sample| {
        while other.next_if(|next| next.time_s < sample.time_s - SAME_S).is_some() {}
        let same = other.peek().filter(|next| (next.time_s - sample.time_s).abs() <= SAME_S);
        same.map(|same| (sample, *same))
    })
}

/// Distance between two traces at their common times, city metres; NaN where one of them was not measured.
pub fn differences(a: &Trace, b: &Trace) -> Vec<(f64, f64)> {
    let apart = |(one, other): (&TraceSample, &TraceSample)| {
        let is_seen = one.is_seen && other.is_seen;
        let apart_m = one.pose.position.distance(other.pose.position);
        (one.time_s, if is_seen { apart_m } else { f64::NAN })
    };
    pairs(a, b).map(apart).collect()
}
