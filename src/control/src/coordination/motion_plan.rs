//! Motion plans: pieces of a motion along a route, each a cubic or a drive under the route's speed profile.

use super::cubic::{Cubic, MotionState};

/// A drive under a speed profile: constant acceleration between neighbouring nodes. Few nodes keep it in the processor's
/// caches, where every control step looks it up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProfileDrive {
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    time_s: f64,
    position_m: f64,
    speed_mps: f64,
}

/// How a vehicle drives under a speed profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveStyle {
    /// Largest speed, wherever the profile permits more.
    pub cap_mps: f64,
    /// Acceleration up to profile or cap.
    pub accelerating_mps2: f64,
    /// Deceleration down to the cap and before bends, positive; where it is too late for that, as the profile brakes.
    pub braking_mps2: f64,
    /// Hardest deceleration, positive, for a start above the profile.
    pub hardest_braking_mps2: f64,
}

/// Distance of samples, as of the route's speed profile.
const STEP_M: f64 = 0.02;
/// A drive does not get slower: it would never arrive.
const LEAST_MPS: f64 = 1e-3;

/// A way under a speed profile: its start, and from there what the profile permits at each of its samples and at the end.
#[derive(Clone, Debug)]
pub struct ProfiledWay {
    start: MotionState,
    /// Positions and permitted speeds.
    samples: Vec<(f64, f64)>,
}

impl ProfiledWay {
    /// The way from a state to a position. `speed_at` is the profile, which can be braked for.
    pub fn new(start: MotionState, end_m: f64, speed_at: impl Fn(f64) -> f64) -> Self {
        let mut position_m = start.position_m;
        let count = ((end_m - position_m) / STEP_M).max(0.0) as usize + 2;
        let mut samples = Vec::with_capacity(count);
        while position_m < end_m - STEP_M * 1e-6 {
            position_m = (whole(position_m / STEP_M + 1e-6) * STEP_M + STEP_M).min(end_m);
            samples.push((position_m, speed_at(position_m)));
        }
        Self { start, samples }
    }

    /// Speeds at the samples, from the last to the first, from which a style keeps profile and cap.
    fn speeds_to_brake_from(&self, style: DriveStyle) -> Vec<f64> {
        let mut next: Option<(f64, f64)> = None;
        let speeds = self.samples.iter().rev().map(|&(position_m, profile_mps)| {
            let braking = next.map_or(f64::INFINITY, |(next_m, next_mps)| {
                (next_mps * next_mps + 2.0 * style.braking_mps2 * (next_m - position_m)).sqrt()
            });
            let speed_mps = profile_mps.min(style.cap_mps).min(braking);
            next = Some((position_m, speed_mps));
            speed_mps
        });
        speeds.collect()
    }
}

/// Builds a drive sample by sample: samples at which the acceleration stays the same make no node.
#[derive(Debug)]
struct DriveBuilder {
    nodes: Vec<Node>,
    /// The last sample, and the square of its speed.
    position_m: f64,
    speed_mps: f64,
    square: f64,
    /// Twice the acceleration since the last node; `None` at the start.
    slope: Option<f64>,
}

/// Squares of speeds that differ by less are the same, m2/s2.
const SAME_SQUARE: f64 = 1e-10;

impl DriveBuilder {
    fn at(start: Node) -> Self {
        let Node { position_m, speed_mps, .. } = start;
        Self { nodes: vec![start], position_m, speed_mps, square: speed_mps * speed_mps, slope: None }
    }

    fn go_on(&mut self, position_m: f64, speed_mps: f64) {
        let square = speed_mps * speed_mps;
        let node = self.nodes[self.nodes.len() - 1];
        let goes_on = self.slope.is_some_and(|slope| {
            let expected = node.speed_mps * node.speed_mps + slope * (position_m - node.position_m);
            (square - expected).abs() < SAME_SQUARE
        });
        if !goes_on {
            self.add_node();
            self.slope = Some((square - self.square) / (position_m - self.position_m));
        }
        (self.position_m, self.speed_mps, self.square) = (position_m, speed_mps, square);
    }

    /// Adds a node at the last sample, unless there is one.
    fn add_node(&mut self) {
        let before = self.nodes[self.nodes.len() - 1];
        let way_m = self.position_m - before.position_m;
        if way_m > 0.0 {
            let time_s = before.time_s + 2.0 * way_m / (before.speed_mps + self.speed_mps);
            self.nodes.push(Node { time_s, position_m: self.position_m, speed_mps: self.speed_mps });
        }
    }

    fn end(mut self) -> ProfileDrive {
        self.add_node();
        ProfileDrive { nodes: self.nodes }
    }
}

/// `f64::floor`, which is a library call for x86-64 processors without SSE 4.1, the target of our builds.
fn whole(steps: f64) -> f64 {
    let towards_zero = steps as i64 as f64;
    if towards_zero > steps { towards_zero - 1.0 } else { towards_zero }
}

impl ProfileDrive {
    /// The drive along a way.
    pub fn new(way: &ProfiledWay, style: DriveStyle) -> Self {
        let start = way.start;
        let mut drive = DriveBuilder::at(Node {
            time_s: start.time_s,
            position_m: start.position_m,
            speed_mps: start.speed_mps.max(LEAST_MPS),
        });
        let speeds = way.speeds_to_brake_from(style);
        for (&(position_m, profile_mps), &permitted_mps) in way.samples.iter().zip(speeds.iter().rev()) {
            let way_m = position_m - drive.position_m;
            let square = drive.square;
            let fastest = (square + 2.0 * style.accelerating_mps2 * way_m).sqrt();
            let slowest = |braking_mps2: f64| (square - 2.0 * braking_mps2 * way_m).max(0.0).sqrt();
            // A start above what the style permits slows down gently, above the profile as hard as it has to.
            let wanted = permitted_mps.max(slowest(style.braking_mps2).min(profile_mps));
            let speed_mps = fastest.min(wanted).max(slowest(style.hardest_braking_mps2)).max(LEAST_MPS);
            drive.go_on(position_m, speed_mps);
        }
        drive.end()
    }

    fn at(&self, time_s: f64) -> MotionState {
        let after = self.first_beyond(|node| node.time_s > time_s);
        let (from, to) = (self.nodes[after - 1], self.nodes[after]);
        let acceleration_mps2 = (to.speed_mps - from.speed_mps) / (to.time_s - from.time_s);
        let t = time_s - from.time_s;
        MotionState {
            time_s,
            position_m: from.position_m + (from.speed_mps + acceleration_mps2 / 2.0 * t) * t,
            speed_mps: from.speed_mps + acceleration_mps2 * t,
            acceleration_mps2,
        }
    }

    /// Index of the first node beyond a place, at least 1 and at most that of the last node.
    fn first_beyond(&self, is_beyond: impl Fn(&Node) -> bool) -> usize {
        self.nodes.partition_point(|node| !is_beyond(node)).clamp(1, self.nodes.len() - 1)
    }

    fn time_at(&self, position_m: f64) -> f64 {
        let after = self.first_beyond(|node| node.position_m > position_m);
        let (from, to) = (self.nodes[after - 1], self.nodes[after]);
        let way_m = position_m - from.position_m;
        let square = to.speed_mps * to.speed_mps - from.speed_mps * from.speed_mps;
        let share = way_m / (to.position_m - from.position_m);
        let speed_mps = (from.speed_mps * from.speed_mps + square * share).max(0.0).sqrt();
        from.time_s + 2.0 * way_m / (from.speed_mps + speed_mps)
    }

    fn cost(&self) -> f64 {
        let squares = self.nodes.windows(2).map(|pair| {
            let duration_s = pair[1].time_s - pair[0].time_s;
            let gained_mps = pair[1].speed_mps - pair[0].speed_mps;
            gained_mps * gained_mps / duration_s
        });
        squares.sum::<f64>() / 2.0
    }
}

/// A piece of a plan.
#[derive(Clone, Debug, PartialEq)]
pub enum Piece {
    /// The way to a junction.
    Cubic(Cubic),
    /// Through a junction, and wherever the profile binds.
    Profile(ProfileDrive),
}

impl Piece {
    fn delay(&mut self, by_s: f64) {
        match self {
            Self::Cubic(cubic) => {
                cubic.from_s += by_s;
                cubic.to_s += by_s;
            }
            Self::Profile(drive) => drive.nodes.iter_mut().for_each(|node| node.time_s += by_s),
        }
    }

    fn begins_s(&self) -> f64 {
        match self {
            Self::Cubic(cubic) => cubic.from_s,
            Self::Profile(drive) => drive.nodes[0].time_s,
        }
    }

    fn at(&self, time_s: f64) -> MotionState {
        match self {
            Self::Cubic(cubic) => cubic.at(time_s),
            Self::Profile(drive) => drive.at(time_s),
        }
    }

    fn time_at(&self, position_m: f64) -> f64 {
        match self {
            Self::Cubic(cubic) => cubic.time_at(position_m),
            Self::Profile(drive) => drive.time_at(position_m),
        }
    }

    fn start(&self) -> MotionState {
        self.at(self.begins_s())
    }

    /// The motion at its end.
    pub fn end(&self) -> MotionState {
        match self {
            Self::Cubic(cubic) => cubic.end(),
            Self::Profile(drive) => drive.at(drive.nodes[drive.nodes.len() - 1].time_s),
        }
    }

    /// Half of the integral of squared acceleration.
    pub fn cost(&self) -> f64 {
        match self {
            Self::Cubic(cubic) => cubic.cost(),
            Self::Profile(drive) => drive.cost(),
        }
    }
}

/// The planned motion of a vehicle along its route: positions of its front-axle centre, laboratory metres. Speeds are
/// positive, positions continuous and strictly increasing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionPlan {
    pieces: Vec<Piece>,
    /// The motion where each piece begins.
    starts: Vec<MotionState>,
    /// The motion where the last one ends.
    end: MotionState,
}

impl MotionPlan {
    /// A plan of pieces that follow one another.
    pub fn new(pieces: Vec<Piece>) -> Self {
        let starts = pieces.iter().map(Piece::start).collect();
        Self { starts, end: pieces.last().map_or_else(MotionState::default, Piece::end), pieces }
    }

    /// Adds a piece that begins where the plan ends.
    pub fn push(&mut self, piece: Piece) {
        self.starts.push(piece.start());
        self.end = piece.end();
        self.pieces.push(piece);
    }

    /// Its pieces in order.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// State at the beginning; the default one of a plan without pieces.
    pub fn start(&self) -> MotionState {
        self.starts.first().copied().unwrap_or_default()
    }

    /// State at the end.
    pub fn end(&self) -> MotionState {
        self.end
    }

    /// Delays the whole motion by a time, seconds.
    pub fn delay(&mut self, by_s: f64) {
        self.pieces.iter_mut().for_each(|piece| piece.delay(by_s));
        self.starts.iter_mut().for_each(|start| start.time_s += by_s);
        self.end.time_s += by_s;
    }

    /// The motion at a time. Before the start it stands there; after the end the speed of the end goes on.
    pub fn at(&self, time_s: f64) -> MotionState {
        let (start, end) = (self.start(), self.end());
        if time_s >= end.time_s {
            let position_m = end.position_m + end.speed_mps * (time_s - end.time_s);
            return MotionState { time_s, position_m, acceleration_mps2: 0.0, ..end };
        }
        if time_s <= start.time_s {
            return MotionState { time_s, ..start };
        }
        let after = self.starts.partition_point(|start| start.time_s <= time_s);
        self.pieces[after.max(1) - 1].at(time_s)
    }

    /// When a position is reached: the start for positions behind it; beyond the end the speed of the end goes on.
    pub fn time_at(&self, position_m: f64) -> f64 {
        let (start, end) = (self.start(), self.end());
        if position_m <= start.position_m {
            return start.time_s;
        }
        if position_m >= end.position_m {
            return end.time_s + (position_m - end.position_m) / end.speed_mps.max(LEAST_MPS);
        }
        let after = self.starts.partition_point(|start| start.position_m <= position_m);
        self.pieces[after.max(1) - 1].time_at(position_m)
    }

    /// Half of the integral of squared acceleration, m2/s3.
    pub fn cost(&self) -> f64 {
        self.pieces.iter().map(Piece::cost).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start(speed_mps: f64) -> MotionState {
        MotionState { time_s: 3.0, position_m: 1.003, speed_mps, acceleration_mps2: 0.0 }
    }

    fn style(cap_mps: f64) -> DriveStyle {
        DriveStyle { cap_mps, accelerating_mps2: 0.1, braking_mps2: 0.05, hardest_braking_mps2: 0.2 }
    }

    #[test]
    fn a_drive_accelerates_to_its_cap_and_goes_on() {
        // 0.2 to 0.35 m/s at 0.1 m/s2: 1.5 s over 0.4125 m, then 0.35 m/s.
        let drive = ProfileDrive::new(&ProfiledWay::new(start(0.2), 4.0, |_| 1.0), style(0.35));
        let end = Piece::Profile(drive.clone()).end();
        // The step across the end of the acceleration averages: no more than a step's time.
        let exact_s = 3.0 + 1.5 + (4.0 - 1.003 - 0.4125) / 0.35;
        assert!((end.time_s - exact_s).abs() < 0.002, "{} {exact_s}", end.time_s);
        assert!((end.speed_mps - 0.35).abs() < 1e-12 && (end.position_m - 4.0).abs() < 1e-12);
        assert!((drive.cost() - 0.1 * 0.15 / 2.0).abs() < 1e-4, "{}", drive.cost());
    }

    #[test]
    fn a_drive_brakes_to_a_cap_and_stays_under_a_profile() {
        let profile = |s: f64| if s > 3.0 { 0.15 } else { (0.15 * 0.15 + 0.24 * (3.0 - s)).sqrt() };
        let drive = ProfileDrive::new(&ProfiledWay::new(start(0.35), 4.0, profile), style(0.3));
        for pair in drive.nodes.windows(2) {
            assert!(pair[1].speed_mps <= profile(pair[1].position_m) + 1e-12);
            let u = (pair[1].speed_mps - pair[0].speed_mps) / (pair[1].time_s - pair[0].time_s);
            assert!((-0.1201..=0.1001).contains(&u), "{u}");
        }
        assert!((Piece::Profile(drive).end().speed_mps - 0.15).abs() < 1e-12);
    }

    #[test]
    fn a_delayed_plan_is_the_same_motion_later() {
        let cubic = Cubic::with_free_exit(start(0.3), 3.0, 3.0 + 8.0);
        let mut plan = MotionPlan::new(vec![Piece::Cubic(cubic)]);
        let drive = ProfileDrive::new(&ProfiledWay::new(plan.end(), 6.0, |_| 1.0), style(0.35));
        plan.push(Piece::Profile(drive));
        let before = plan.clone();
        plan.delay(0.25);
        for position_m in [0.5, 2.9, 3.0, 4.7, 6.0] {
            assert!(
                (plan.time_at(position_m) - before.time_at(position_m) - 0.25).abs() < 1e-9,
                "{position_m}"
            );
        }
        for time_s in [4.0, 9.0, 14.0, 30.0] {
            let (late, sooner) = (plan.at(time_s + 0.25), before.at(time_s));
            assert!((late.position_m - sooner.position_m).abs() < 1e-9, "{time_s}");
            assert!((late.speed_mps - sooner.speed_mps).abs() < 1e-9, "{time_s}");
        }
        assert!((plan.end().time_s - before.end().time_s - 0.25).abs() < 1e-12);
    }

    #[test]
    fn times_and_positions_of_a_plan_are_inverse_and_it_is_continuous() {
        let cubic = Cubic::with_free_exit(start(0.3), 3.0, 3.0 + 8.0);
        let drive = ProfileDrive::new(&ProfiledWay::new(cubic.end(), 4.5, |_| 0.4), style(0.35));
        let plan = MotionPlan::new(vec![Piece::Cubic(cubic), Piece::Profile(drive)]);
        let mut last_m = f64::NEG_INFINITY;
        for k in 0..400 {
            let time_s = 3.0 + f64::from(k) * 0.04;
            let here = plan.at(time_s);
            assert!(here.position_m > last_m);
            assert!((plan.time_at(here.position_m) - time_s).abs() < 1e-9, "{time_s}");
            last_m = here.position_m;
        }
        assert!((plan.at(11.0 - 1e-9).speed_mps - plan.at(11.0 + 1e-9).speed_mps).abs() < 1e-6);
        assert_eq!(plan.time_at(0.0), 3.0);
        assert_eq!(plan.at(0.0).position_m, 1.003);
    }
}
