//! Series of numbers out of the samples of traces.

use super::chart::{Line, Stroke, viridis};
use super::run::{Sample, Trace};

/// Speeds are means over so long, centred (the paper, section III).
pub const AVERAGED_S: f64 = 0.1;
/// Steps of colour on the scale of speed.
const SPEED_STEPS: f64 = 24.0;

/// A line in pieces of one colour each.
pub(super) fn by_speed(trace: &Trace, points: &[(usize, f64, f64)], fastest: f64) -> Vec<Line> {
    let step = |speed: f64| (speed / fastest * SPEED_STEPS).round();
    let mut lines: Vec<Line> = Vec::new();
    let mut last: Option<(f64, (f64, f64))> = None;
    for &(k, position, speed) in points {
        let (here, point) = (step(speed), (trace.samples[k].time_s, position));
        match (last, lines.last_mut()) {
            (Some((before, _)), Some(line)) if before == here => line.points.push(point),
            (before, _) => {
                let from = before.map(|(_, point)| point);
                let stroke = Stroke { width_pt: 1.3, ..Stroke::solid(viridis(here / SPEED_STEPS)) };
                lines.push(Line { points: from.into_iter().chain([point]).collect(), stroke });
            }
        }
        last = Some((here, point));
    }
    lines
}

/// Speeds of a trace, each the mean of those within half of [`AVERAGED_S`] of it.
pub fn moving_average(trace: &Trace) -> Vec<f64> {
    const ROUNDING_S: f64 = 1e-9;
    let samples = &trace.samples;
    let (mut from, mut to, mut sum) = (0, 0, 0.0);
    let mean = |sample: &Sample| {
        while to < samples.len() && samples[to].time_s <= sample.time_s + AVERAGED_S / 2.0 + ROUNDING_S {
            sum += samples[to].speed_mps;
            to += 1;
        }
        while samples[from].time_s < sample.time_s - AVERAGED_S / 2.0 - ROUNDING_S {
            sum -= samples[from].speed_mps;
            from += 1;
        }
        sum / (to - from) as f64
    };
    samples.iter().map(mean).collect()
}

/// Distance between two traces at the times that both have, city metres.
pub fn differences(a: &Trace, b: &Trace) -> Vec<(f64, f64)> {
    const SAME_S: f64 = 1e-6;
    let mut other = b.samples.iter().peekable();
    let mut found = Vec::new();
    for sample in &a.samples {
        while other.next_if(|next| next.time_s < sample.time_s - SAME_S).is_some() {}
        if let Some(same) = other.peek().filter(|next| (next.time_s - sample.time_s).abs() <= SAME_S) {
            found.push((sample.time_s, sample.pose.position.distance(same.pose.position)));
        }
    }
    found
}
