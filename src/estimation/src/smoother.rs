//! Smoothing of recorded poses: a Rauch-Tung-Striebel smoother (Rauch, Tung and Striebel 1965) on the model
//! of the live filter.
//!
//! It uses the modified Bryson-Frazier form (Bierman, "Fixed interval smoothing with discrete measurements",
//! Int. J. Control 18, 1973), which is equivalent and inverts no matrix, so poses without noise cause no
//! singularity. Headings are smoothed first: velocities rotate with the smoothed yaw rate.

use super::filter::{FilterState, MotionFilter, PoseUpdate};
use super::noise::{NoiseModel, local_variances};
use super::singer::{Covariance2, Covariance3, Gain3, Information3, SingerTransition};
use super::{MotionEstimate, MotionStd};
use city3d_geometry::{Frame, Pose2, trig, wrap_angle};
use glam::DVec2;

/// No motion is estimated in gaps longer than this.
pub const LONGEST_GAP_S: f64 = 1.0;
/// Longest prediction step.
const LONGEST_STEP_S: f64 = 0.05;
/// Times closer than this are equal.
const SAME_S: f64 = 1e-9;
/// Fewer poses between two gaps are strays and are dropped.
const FEWEST: usize = 3;

/// Estimated motion at the given times, from all poses; `None` before the first pose, after the last one, and
/// in long gaps. Poses and times are in increasing order.
pub fn smooth<F: Frame>(
    noise: &NoiseModel<F>,
    poses: &[(f64, Pose2<F>)],
    times_s: &[f64],
) -> Vec<Option<MotionEstimate<F>>> {
    let variances = local_variances(noise, poses);
    let mut motions = vec![None; times_s.len()];
    for piece in pieces(noise, poses, &variances) {
        let (Some(first), Some(last)) = (piece.first(), piece.last()) else { continue };
        if piece.len() < FEWEST {
            continue;
        }
        let from = times_s.partition_point(|time_s| *time_s < first.time_s - SAME_S);
        let to = times_s.partition_point(|time_s| *time_s <= last.time_s + SAME_S);
        let nodes = nodes(&piece, &times_s[from..to]);
        let turns = smoothed_headings(noise, &nodes);
        let found = smoothed_motions(noise, &nodes, &turns);
        let mut node = 0;
        for (time_s, motion) in times_s[from..to].iter().zip(&mut motions[from..to]) {
            while nodes[node].time_s < time_s - SAME_S {
                node += 1;
            }
            *motion = Some(found[node]);
        }
    }
    motions
}

/// An accepted pose; each measurement with its variance, if accepted.
#[derive(Clone, Copy, Debug)]
struct InlierPose {
    time_s: f64,
    position: Option<(DVec2, f64)>,
    heading: Option<(f64, f64)>,
}

/// Poses without outliers, split at long gaps.
fn pieces<F: Frame>(
    noise: &NoiseModel<F>,
    poses: &[(f64, Pose2<F>)],
    variances: &[[f64; 2]],
) -> Vec<Vec<InlierPose>> {
    let mut pieces: Vec<Vec<InlierPose>> = Vec::new();
    let mut filter = MotionFilter::new(*noise);
    // Consecutive outliers.
    let mut outliers: Vec<InlierPose> = Vec::new();
    let mut last_s = f64::NEG_INFINITY;
    for (&(time_s, pose), &variances) in poses.iter().zip(variances) {
        if time_s <= last_s + SAME_S {
            continue;
        }
        if time_s - last_s > LONGEST_GAP_S {
            filter = MotionFilter::new(*noise);
        }
        last_s = time_s;
        let (taken, has_turned) = filter.correct(time_s, pose, variances);
        let counted = InlierPose {
            time_s,
            position: Some((pose.position, variances[0])),
            heading: (has_turned || taken != PoseUpdate::Used).then_some((pose.yaw_rad, variances[1])),
        };
        match taken {
            PoseUpdate::Outlier => outliers.push(counted),
            PoseUpdate::Restarted => {
                let mut piece = std::mem::take(&mut outliers);
                piece.push(counted);
                pieces.push(piece);
            }
            PoseUpdate::Used | PoseUpdate::Stale => {
                outliers.clear();
                if let Some(piece) = pieces.last_mut() {
                    piece.push(counted);
                }
            }
        }
    }
    pieces
}

/// A time at which the motion is estimated: of a pose, requested, or between distant poses.
#[derive(Clone, Copy, Debug)]
struct SmootherNode {
    time_s: f64,
    position: Option<(DVec2, f64)>,
    heading: Option<(f64, f64)>,
}

fn nodes(piece: &[InlierPose], times_s: &[f64]) -> Vec<SmootherNode> {
    let mut nodes: Vec<SmootherNode> = Vec::with_capacity(piece.len() + times_s.len());
    let mut times = times_s.iter().copied().peekable();
    let mut add = |node: SmootherNode| {
        if let Some(last_s) = nodes.last().map(|last: &SmootherNode| last.time_s) {
            let between = ((node.time_s - last_s) / LONGEST_STEP_S).ceil().max(1.0) as u32;
            for k in 1..between {
                let time_s = last_s + (node.time_s - last_s) * f64::from(k) / f64::from(between);
                nodes.push(SmootherNode { time_s, position: None, heading: None });
            }
        }
        nodes.push(node);
    };
    for pose in piece {
        while let Some(time_s) = times.next_if(|time_s| *time_s < pose.time_s - SAME_S) {
            add(SmootherNode { time_s, position: None, heading: None });
        }
        while times.next_if(|time_s| *time_s <= pose.time_s + SAME_S).is_some() {}
        add(SmootherNode { time_s: pose.time_s, position: pose.position, heading: pose.heading });
    }
    nodes
}

/// Heading and yaw rate at a node, and their variances.
#[derive(Clone, Copy, Debug)]
struct HeadingEstimate {
    yaw_rad: f64,
    rate_radps: f64,
    yaw_variance: f64,
    rate_variance: f64,
}

/// Forward pass: the filtered heading state at a node.
struct HeadingStep {
    filtered: (f64, f64, Covariance2),
    /// Innovation, its variance and the gains, where there was a pose.
    measured: Option<(f64, f64, [f64; 2])>,
}

fn smoothed_headings<F: Frame>(noise: &NoiseModel<F>, nodes: &[SmootherNode]) -> Vec<HeadingEstimate> {
    let first = FilterState::unknown(noise, 0.0);
    let begin = nodes.iter().find_map(|node| node.heading).map_or(0.0, |(yaw_rad, _)| yaw_rad);
    let (mut yaw_rad, mut rate_radps, mut covariance) = (begin, 0.0, first.yaw_covariance);
    let mut steps: Vec<HeadingStep> = Vec::with_capacity(nodes.len());
    for (k, node) in nodes.iter().enumerate() {
        if k > 0 {
            let dt_s = node.time_s - nodes[k - 1].time_s;
            yaw_rad += rate_radps * dt_s;
            covariance = covariance.after(dt_s, noise.yaw_density);
        }
        let mut measured = None;
        if let Some((told_rad, variance)) = node.heading {
            let off = wrap_angle(told_rad - yaw_rad);
            let total = covariance.pp + variance;
            let (after, gain) = covariance.measured(variance);
            (yaw_rad, rate_radps, covariance) = (yaw_rad + off * gain[0], rate_radps + off * gain[1], after);
            measured = Some((off, total, gain));
        }
        steps.push(HeadingStep { filtered: (yaw_rad, rate_radps, covariance), measured });
    }
    // Backward pass: information of later poses about angle and rate.
    let (mut angle, mut rate) = (0.0, 0.0);
    let (mut pp, mut pv, mut vv) = (0.0, 0.0, 0.0);
    let mut turns = Vec::with_capacity(nodes.len());
    for (k, step) in steps.iter().enumerate().rev() {
        let (yaw_rad, rate_radps, p) = step.filtered;
        let left =
            |a: f64, b: f64, own: f64| (own - (a * (pp * a + pv * b) + b * (pv * a + vv * b))).max(0.0);
        turns.push(HeadingEstimate {
            yaw_rad: wrap_angle(yaw_rad - p.pp * angle - p.pv * rate),
            rate_radps: rate_radps - p.pv * angle - p.vv * rate,
            yaw_variance: left(p.pp, p.pv, p.pp),
            rate_variance: left(p.pv, p.vv, p.vv),
        });
        if let Some((off, total, gain)) = step.measured {
            angle -= gain[0] * angle + gain[1] * rate + off / total;
            let kept = 1.0 - gain[0];
            let (a, b) = (pp * kept - pv * gain[1], pv * kept - vv * gain[1]);
            (pp, pv) = (kept * a - gain[1] * b + 1.0 / total, b);
        }
        if k > 0 {
            let dt_s = nodes[k].time_s - nodes[k - 1].time_s;
            rate += dt_s * angle;
            (pv, vv) = (pv + dt_s * pp, vv + dt_s * (2.0 * pv + dt_s * pp));
        }
    }
    turns.reverse();
    turns
}

/// Planar position, velocity and acceleration.
#[derive(Clone, Copy, Debug, Default)]
struct Planar {
    position: DVec2,
    velocity: DVec2,
    acceleration: DVec2,
}

/// A prediction step between two nodes, with half of its rotation.
struct NodeTransition {
    singer: SingerTransition,
    half_turn: DVec2,
}

/// Forward pass of the position, as [`HeadingStep`].
struct PositionStep {
    /// From the node before.
    step: Option<NodeTransition>,
    filtered: (Planar, Covariance3),
    measured: Option<(DVec2, f64, Gain3)>,
}

fn smoothed_motions<F: Frame>(
    noise: &NoiseModel<F>,
    nodes: &[SmootherNode],
    turns: &[HeadingEstimate],
) -> Vec<MotionEstimate<F>> {
    let steps = filtered_positions(noise, nodes, turns);
    // Backward pass: information of later poses about each state.
    let (mut later, mut information) = (Planar::default(), Information3::default());
    let mut motions = Vec::with_capacity(nodes.len());
    for (k, step) in steps.iter().enumerate().rev() {
        let (state, p) = &step.filtered;
        let Planar { position: lp, velocity: lv, acceleration: la } = later;
        let smoothed = Planar {
            position: state.position - (lp * p.pp + lv * p.pv + la * p.pa),
            velocity: state.velocity - (lp * p.pv + lv * p.vv + la * p.va),
            acceleration: state.acceleration - (lp * p.pa + lv * p.va + la * p.aa),
        };
        motions.push(motion(nodes[k].time_s, &smoothed, p.smoothed(&information), &turns[k]));
        if let Some((off, total, gain)) = step.measured {
            later.position -= lp * gain.p + lv * gain.v + la * gain.a + off / total;
            information = information.with(gain, total);
        }
        if let Some(NodeTransition { singer, half_turn }) = &step.step {
            let back = DVec2::new(half_turn.x, -half_turn.y);
            let once = back.rotate(later.position);
            let turned = |vector: DVec2| back.rotate(back.rotate(vector));
            let (velocity, acceleration) = (turned(later.velocity), turned(later.acceleration));
            later.velocity = once * singer.dt_s + velocity;
            later.acceleration =
                once * singer.position_s2 + velocity * singer.velocity_s + acceleration * singer.remains;
            information = information.before(singer);
        }
    }
    motions.reverse();
    motions
}

fn filtered_positions<F: Frame>(
    noise: &NoiseModel<F>,
    nodes: &[SmootherNode],
    turns: &[HeadingEstimate],
) -> Vec<PositionStep> {
    let begin = nodes.iter().find_map(|node| node.position).map_or(DVec2::ZERO, |(position, _)| position);
    let mut state = Planar { position: begin, ..Planar::default() };
    let mut covariance = FilterState::unknown(noise, 0.0).covariance;
    let mut steps = Vec::with_capacity(nodes.len());
    for (k, node) in nodes.iter().enumerate() {
        let step = (k > 0).then(|| {
            let dt_s = node.time_s - nodes[k - 1].time_s;
            let rate_radps = (turns[k - 1].rate_radps + turns[k].rate_radps) / 2.0;
            let (sin, cos) = trig::sin_cos(rate_radps * dt_s / 2.0);
            let singer = SingerTransition::new(dt_s, noise.acceleration_std_mps2, noise.acceleration_time_s);
            NodeTransition { singer, half_turn: DVec2::new(cos, sin) }
        });
        if let Some(NodeTransition { singer, half_turn }) = &step {
            let turned = |vector: DVec2| half_turn.rotate(half_turn.rotate(vector));
            let way = state.velocity * singer.dt_s + state.acceleration * singer.position_s2;
            state.position += half_turn.rotate(way);
            state.velocity = turned(state.velocity + state.acceleration * singer.velocity_s);
            state.acceleration = turned(state.acceleration * singer.remains);
            covariance = covariance.after(singer);
        }
        let mut measured = None;
        if let Some((position, variance)) = node.position {
            let (off, total) = (position - state.position, covariance.pp + variance);
            let (after, gain) = covariance.measured(variance);
            state.position += off * gain.p;
            state.velocity += off * gain.v;
            state.acceleration += off * gain.a;
            covariance = after;
            measured = Some((off, total, gain));
        }
        steps.push(PositionStep { step, filtered: (state, covariance), measured });
    }
    steps
}

fn motion<F: Frame>(
    time_s: f64,
    state: &Planar,
    variances: [f64; 3],
    turn: &HeadingEstimate,
) -> MotionEstimate<F> {
    let pose = Pose2::at(state.position, turn.yaw_rad);
    let [position, velocity, acceleration] = variances.map(f64::sqrt);
    MotionEstimate {
        time_s,
        pose,
        velocity_mps: state.velocity,
        speed_mps: state.velocity.dot(pose.forward()),
        acceleration_mps2: state.acceleration.dot(pose.forward()),
        yaw_rate_radps: turn.rate_radps,
        std: MotionStd {
            position_m: position,
            heading_rad: turn.yaw_variance.sqrt(),
            speed_mps: velocity,
            yaw_rate_radps: turn.rate_variance.sqrt(),
            acceleration_mps2: acceleration,
        },
    }
}
