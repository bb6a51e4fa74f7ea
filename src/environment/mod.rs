//! What stands between the control framework and the vehicles: delay, jitter, loss and noise, in
//! simulated time and seeded. Running one scenario under two profiles is the comparison of the
//! virtual with the physical city; nothing else differs between the two.

mod channel;

pub use channel::Channel;

use crate::snapshot::VehicleId;
use crate::wire::{Measurement, Message};
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
    /// How often a vehicle gets out of sight of motion capture, per second.
    pub occlusions_hz: f64,
    /// How long it stays so on average; each time between half and one and a half times as long.
    pub occlusion_s: f64,
    /// Time constant by which pedals and steering follow what is asked of them: of `city3d testbed` alone.
    pub actuator_lag_s: f64,
}

impl EnvironmentSpec {
    pub const IDEAL: Self = Self {
        measurement_delay_s: 0.0,
        command_delay_s: 0.0,
        jitter_s: 0.0,
        loss: 0.0,
        position_noise_m: 0.0,
        yaw_noise_rad: 0.0,
        occlusions_hz: 0.0,
        occlusion_s: 0.0,
        actuator_lag_s: 0.0,
    };

    /// Motion capture and wireless link of a laboratory: 20 ms of capture latency, 30 ms to the
    /// robot, some jitter, one datagram in a hundred lost, noise of a millimetre and half a degree, a vehicle out of
    /// sight now and then.
    pub const TESTBED: Self = Self {
        measurement_delay_s: 0.02,
        command_delay_s: 0.03,
        jitter_s: 0.01,
        loss: 0.01,
        position_noise_m: 0.001,
        yaw_noise_rad: 0.009,
        occlusions_hz: 0.02,
        occlusion_s: 0.3,
        actuator_lag_s: 0.05,
    };
}

/// Both directions of the link. Its random draws come from its own stream, so that no draw of the
/// traffic depends on it.
#[derive(Clone, Debug)]
pub struct Environment {
    spec: EnvironmentSpec,
    rng: ChaCha8Rng,
    measurements: Channel<Measurement>,
    messages: Channel<Message>,
    /// Until when vehicles are out of sight.
    hidden_until_s: BTreeMap<VehicleId, f64>,
    measured_s: f64,
}

impl Environment {
    pub fn new(spec: EnvironmentSpec, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(1);
        Self {
            spec,
            rng,
            measurements: Channel::default(),
            messages: Channel::default(),
            hidden_until_s: BTreeMap::new(),
            measured_s: 0.0,
        }
    }

    /// Takes what motion capture sees now and gives what has arrived at the control framework.
    pub fn measure(
        &mut self,
        now_s: f64,
        seen: impl Iterator<Item = Measurement>,
        arrived: &mut Vec<Measurement>,
    ) {
        let dt_s = now_s - std::mem::replace(&mut self.measured_s, now_s);
        for measurement in seen {
            if self.is_hidden(measurement.vehicle, now_s, dt_s) || self.is_lost() {
                continue;
            }
            let at = now_s + self.delay(self.spec.measurement_delay_s);
            let measurement = self.with_noise(measurement);
            self.measurements.send(at, measurement);
        }
        self.measurements.receive(now_s, arrived);
    }

    /// Takes what the control framework sends now and gives what has arrived at the vehicles.
    pub fn command(&mut self, now_s: f64, sent: impl Iterator<Item = Message>, arrived: &mut Vec<Message>) {
        for message in sent {
            if self.is_lost() {
                continue;
            }
            let at = now_s + self.delay(self.spec.command_delay_s);
            self.messages.send(at, message);
        }
        self.messages.receive(now_s, arrived);
    }

    /// Whether a vehicle is out of sight, after so long since the poses before.
    fn is_hidden(&mut self, vehicle: VehicleId, now_s: f64, dt_s: f64) -> bool {
        if self.spec.occlusions_hz <= 0.0 {
            return false;
        }
        if self.hidden_until_s.get(&vehicle).is_some_and(|until_s| now_s < *until_s) {
            return true;
        }
        let begins = self.uniform() < self.spec.occlusions_hz * dt_s;
        if begins {
            let lasts_s = self.spec.occlusion_s * (0.5 + self.uniform());
            self.hidden_until_s.insert(vehicle, now_s + lasts_s);
        }
        begins
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
            let (sin, cos) = crate::geom::trig::sin_cos(half);
            let turn = glam::DQuat::from_xyzw(0.0, 0.0, sin, cos);
            measurement.orientation = turn * measurement.orientation;
        }
        measurement
    }

    /// Uniform in [0, 1) with 53 random bits.
    fn uniform(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal: the sum of twelve uniform numbers less six, exact on every machine.
    fn gaussian(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
}
