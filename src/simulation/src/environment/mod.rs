//! Environment between control framework and vehicles: an emulator of the network (delay, jitter, packet loss), of
//! motion capture (noise, occlusion) and of the robots' drives (lag, speed disturbance), in simulated time and seeded.
//!
//! Running one scenario under two profiles compares the virtual with the physical city; nothing else differs.

mod channel;

pub use channel::DelayQueue;

use city3d_geometry::trig;
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::{Measurement, Message};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Parameters of an environment. All zero is `ideal`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EnvironmentSpec {
    /// From the measurement of a pose to its arrival at the control framework.
    pub measurement_delay_s: f64,
    /// From sending a message to its arrival at the vehicle.
    pub command_delay_s: f64,
    /// Added to each delay, uniform between 0 and this.
    pub jitter_s: f64,
    /// Probability that a measurement or a message is lost.
    pub loss: f64,
    /// Standard deviation of a measured coordinate, laboratory metres.
    pub position_noise_m: f64,
    /// Standard deviation of a measured heading.
    pub yaw_noise_rad: f64,
    /// Mean time between two occlusions of a vehicle from motion capture; 0 where there are none.
    pub occlusion_every_s: f64,
    /// Mean duration of an occlusion.
    pub occlusion_s: f64,
    /// Lag of a robot's drive behind its trajectory.
    pub actuator_lag_s: f64,
    /// Standard deviation of the relative error of a robot's speed.
    pub speed_disturbance: f64,
    /// Correlation time of that error.
    pub disturbance_time_s: f64,
}

impl EnvironmentSpec {
    /// No delay, loss, noise, occlusion or lag: what is sent arrives unchanged in the same step.
    pub const IDEAL: Self = Self {
        measurement_delay_s: 0.0,
        command_delay_s: 0.0,
        jitter_s: 0.0,
        loss: 0.0,
        position_noise_m: 0.0,
        yaw_noise_rad: 0.0,
        occlusion_every_s: 0.0,
        occlusion_s: 0.0,
        actuator_lag_s: 0.0,
        speed_disturbance: 0.0,
        disturbance_time_s: 0.0,
    };

    /// Motion capture, wireless link and robots of a laboratory: 20 ms of capture latency, 30 ms to the
    /// robot, some jitter, one datagram in a hundred lost, noise of a millimetre and half a degree, a marker hidden
    /// for a fifth of a second each twenty seconds, drives that are 80 ms late and off by 4 % for a second at a time.
    /// `docs/roundabout.md` has the reasons.
    pub const TESTBED: Self = Self {
        measurement_delay_s: 0.02,
        command_delay_s: 0.03,
        jitter_s: 0.01,
        loss: 0.01,
        position_noise_m: 0.001,
        yaw_noise_rad: 0.009,
        occlusion_every_s: 20.0,
        occlusion_s: 0.2,
        actuator_lag_s: 0.08,
        speed_disturbance: 0.04,
        disturbance_time_s: 1.0,
    };
}

/// Named environment of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EnvironmentProfile {
    /// No disturbances but those that the scenario adds: [`EnvironmentSpec::IDEAL`].
    Ideal,
    /// A laboratory: [`EnvironmentSpec::TESTBED`], with the changes of the scenario.
    Testbed,
}

impl EnvironmentProfile {
    /// Every profile.
    pub const ALL: [Self; 2] = [Self::Ideal, Self::Testbed];

    /// Name in scenarios, arguments and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Testbed => "testbed",
        }
    }
}

/// The environment of all vehicles, in both directions. It draws from a random stream of its own, so that the traffic
/// does not depend on it.
#[derive(Clone, Debug)]
pub struct Environment {
    spec: EnvironmentSpec,
    seed: u64,
    rng: ChaCha8Rng,
    measurements: DelayQueue<Measurement>,
    messages: DelayQueue<Message>,
    /// Present effects on each vehicle.
    effects: BTreeMap<VehicleId, VehicleEffects>,
}

/// Occlusion and speed disturbance of one vehicle.
#[derive(Clone, Copy, Debug, Default)]
struct VehicleEffects {
    /// Start and end of the present or next occlusion.
    occluded_s: Option<(f64, f64)>,
    /// Relative error of the speed, and when it was drawn.
    speed_offset: Option<(f64, f64)>,
}

/// Random stream of environments, separate from that of the traffic.
fn random_stream(seed: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(1);
    rng
}

impl Environment {
    /// An environment with nothing in transit; `seed` sets its random stream.
    pub fn new(spec: EnvironmentSpec, seed: u64) -> Self {
        let rng = random_stream(seed);
        let (measurements, messages) = (DelayQueue::default(), DelayQueue::default());
        Self { spec, seed, rng, measurements, messages, effects: BTreeMap::new() }
    }

    /// Switches to another environment. Items in transit keep their arrival times; the random stream continues unless
    /// the seed differs.
    pub fn change(&mut self, spec: EnvironmentSpec, seed: u64) {
        self.spec = spec;
        if seed != self.seed {
            (self.seed, self.rng) = (seed, random_stream(seed));
        }
    }

    /// Sends the measurements of now; adds those that have arrived at the control framework.
    pub fn measure(
        &mut self,
        now_s: f64,
        seen: impl Iterator<Item = Measurement>,
        arrived: &mut Vec<Measurement>,
    ) {
        for measurement in seen {
            if self.is_occluded(measurement.vehicle, now_s) || self.is_lost() {
                continue;
            }
            let at = now_s + self.delay(self.spec.measurement_delay_s);
            let measurement = self.with_noise(measurement);
            self.measurements.send(at, measurement);
        }
        self.measurements.receive(now_s, arrived);
    }

    /// Sends the messages of now; adds those that have arrived at the vehicles.
    pub fn command(&mut self, now_s: f64, sent: impl Iterator<Item = Message>, arrived: &mut Vec<Message>) {
        for message in sent {
            if self.is_lost() {
                continue;
            }
            let at = now_s + self.delay(self.spec.command_delay_s);
            let message = self.disturbed(message, now_s);
            self.messages.send(at, message);
        }
        self.messages.receive(now_s, arrived);
    }

    /// Whether a vehicle is hidden from motion capture. Times between occlusions, and their lengths, are uniform
    /// between 0 and twice their means.
    fn is_occluded(&mut self, vehicle: VehicleId, now_s: f64) -> bool {
        let EnvironmentSpec { occlusion_every_s, occlusion_s, .. } = self.spec;
        if occlusion_every_s <= 0.0 || occlusion_s <= 0.0 {
            return false;
        }
        let mut effects = self.effects.get(&vehicle).copied().unwrap_or_default();
        if effects.occluded_s.is_none_or(|(_, to_s)| now_s >= to_s) {
            let from_s = now_s + 2.0 * occlusion_every_s * self.uniform();
            effects.occluded_s = Some((from_s, from_s + 2.0 * occlusion_s * self.uniform()));
            self.effects.insert(vehicle, effects);
        }
        effects.occluded_s.is_some_and(|(from_s, to_s)| (from_s..to_s).contains(&now_s))
    }

    /// Applies the lag and the speed disturbance of a robot to its trajectory.
    fn disturbed(&mut self, message: Message, now_s: f64) -> Message {
        if self.spec.actuator_lag_s == 0.0 && self.spec.speed_disturbance <= 0.0 {
            return message;
        }
        let Message::Follow(mut trajectory) = message else { return message };
        let factor = 1.0 + self.disturbance(trajectory.vehicle, now_s);
        for point in &mut trajectory.points {
            point.time_s += self.spec.actuator_lag_s;
            point.speed_mps *= factor;
        }
        Message::Follow(trajectory)
    }

    /// The present relative speed error of a vehicle: a first-order Gauss-Markov process.
    fn disturbance(&mut self, vehicle: VehicleId, now_s: f64) -> f64 {
        let EnvironmentSpec { speed_disturbance, disturbance_time_s, .. } = self.spec;
        if speed_disturbance <= 0.0 {
            return 0.0;
        }
        let drawn = self.gaussian();
        let effects = self.effects.entry(vehicle).or_default();
        let speed_offset = effects.speed_offset.map_or(speed_disturbance * drawn, |(before, since_s)| {
            let kept = if disturbance_time_s > 0.0 {
                trig::exp((since_s - now_s) / disturbance_time_s)
            } else {
                0.0
            };
            kept * before + (1.0 - kept * kept).max(0.0).sqrt() * speed_disturbance * drawn
        });
        effects.speed_offset = Some((speed_offset, now_s));
        speed_offset
    }

    fn is_lost(&mut self) -> bool {
        self.spec.loss > 0.0 && self.uniform() < self.spec.loss
    }

    fn delay(&mut self, fixed_s: f64) -> f64 {
        if self.spec.jitter_s > 0.0 { fixed_s + self.spec.jitter_s * self.uniform() } else { fixed_s }
    }

    fn with_noise(&mut self, mut measurement: Measurement) -> Measurement {
        if self.spec.position_noise_m > 0.0 {
            measurement.position.x += self.spec.position_noise_m * self.gaussian();
            measurement.position.y += self.spec.position_noise_m * self.gaussian();
        }
        if self.spec.yaw_noise_rad > 0.0 {
            let half = self.spec.yaw_noise_rad * self.gaussian() / 2.0;
            let (sin, cos) = trig::sin_cos(half);
            let turn = glam::DQuat::from_xyzw(0.0, 0.0, sin, cos);
            measurement.orientation = turn * measurement.orientation;
        }
        measurement
    }

    /// Uniform in [0, 1) with 53 random bits.
    fn uniform(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Approximately standard normal: sum of twelve uniform numbers less six (Irwin-Hall distribution), bit-exact on
    /// every machine.
    fn gaussian(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::{Trajectory, TrajectoryPoint};
    use glam::{DQuat, DVec3};

    fn at(x: f64, stamp_s: f64) -> Measurement {
        let position = DVec3::new(x, 0.0, 0.0);
        Measurement { vehicle: VehicleId(1), stamp_s, position, orientation: DQuat::IDENTITY }
    }

    #[test]
    fn ideal_passes_everything_on_at_once_and_unchanged() {
        let mut environment = Environment::new(EnvironmentSpec::IDEAL, 1);
        let mut arrived = Vec::new();
        environment.measure(0.5, [at(1.0, 0.5)].into_iter(), &mut arrived);
        assert_eq!(arrived, [at(1.0, 0.5)]);
    }

    #[test]
    fn a_delay_holds_measurements_back_in_order() {
        let spec = EnvironmentSpec { measurement_delay_s: 0.2, ..EnvironmentSpec::IDEAL };
        let mut environment = Environment::new(spec, 1);
        let mut stamps = Vec::new();
        for tick in 0..100 {
            let now = f64::from(tick) * 0.01;
            let mut arrived = Vec::new();
            environment.measure(now, [at(now, now)].into_iter(), &mut arrived);
            assert!(arrived.iter().all(|m| (now - m.stamp_s - 0.2).abs() < 1e-9), "{now} {arrived:?}");
            stamps.extend(arrived.iter().map(|m| m.stamp_s));
        }
        assert_eq!(stamps.len(), 80);
        assert!(stamps.is_sorted());
    }

    #[test]
    fn noise_and_loss_have_the_stated_size_and_repeat_with_the_seed() {
        let spec = EnvironmentSpec { loss: 0.25, position_noise_m: 0.002, ..EnvironmentSpec::IDEAL };
        let run = |seed| {
            let mut environment = Environment::new(spec, seed);
            let mut arrived = Vec::new();
            for _ in 0..4000 {
                environment.measure(0.0, [at(0.0, 0.0)].into_iter(), &mut arrived);
            }
            arrived.iter().map(|m| m.position.x).collect::<Vec<_>>()
        };
        let noise = run(5);
        assert_eq!(noise, run(5));
        assert_ne!(noise, run(6));
        assert!((noise.len() as f64 - 3000.0).abs() < 120.0, "{}", noise.len());
        let deviation = (noise.iter().map(|x| x * x).sum::<f64>() / noise.len() as f64).sqrt();
        assert!((deviation - 0.002).abs() < 0.0002, "{deviation}");
    }

    #[test]
    fn occlusions_take_their_share_and_come_in_runs() {
        let spec = EnvironmentSpec { occlusion_every_s: 2.0, occlusion_s: 0.5, ..EnvironmentSpec::IDEAL };
        let mut environment = Environment::new(spec, 3);
        let mut seen = Vec::new();
        for tick in 0..50_000 {
            let now = f64::from(tick) * 0.01;
            let mut arrived = Vec::new();
            environment.measure(now, [at(now, now)].into_iter(), &mut arrived);
            seen.push(!arrived.is_empty());
        }
        let share = seen.iter().filter(|seen| !**seen).count() as f64 / seen.len() as f64;
        assert!((share - 0.2).abs() < 0.04, "{share}");
        let begun = seen.windows(2).filter(|pair| pair[0] && !pair[1]).count();
        assert!((120..=280).contains(&begun), "{begun}");
    }

    #[test]
    fn robots_are_late_and_their_speed_wanders_as_stated() {
        let spec = EnvironmentSpec {
            actuator_lag_s: 0.08,
            speed_disturbance: 0.05,
            disturbance_time_s: 1.0,
            ..EnvironmentSpec::IDEAL
        };
        let mut environment = Environment::new(spec, 3);
        let mut off = Vec::new();
        for tick in 0..200_000 {
            let now = f64::from(tick) * 0.02;
            let point = TrajectoryPoint { time_s: now, speed_mps: 1.0, ..TrajectoryPoint::default() };
            let trajectory =
                Trajectory { vehicle: VehicleId(1), points: vec![point], ..Trajectory::default() };
            let mut arrived = Vec::new();
            environment.command(now, [Message::Follow(trajectory)].into_iter(), &mut arrived);
            let [Message::Follow(trajectory)] = &arrived[..] else { panic!("{arrived:?}") };
            assert!((trajectory.points[0].time_s - now - 0.08).abs() < 1e-9);
            off.push(trajectory.points[0].speed_mps - 1.0);
        }
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / off.len() as f64;
        let deviation = mean(&mut off.iter().map(|x| x * x)).sqrt();
        assert!((deviation - 0.05).abs() < 0.004, "{deviation}");
        // After a second the correlation has fallen to 1 / e.
        let after = mean(&mut off.iter().zip(&off[50..]).map(|(a, b)| a * b)) / (deviation * deviation);
        assert!((after - 0.368).abs() < 0.08, "{after}");
    }
}
