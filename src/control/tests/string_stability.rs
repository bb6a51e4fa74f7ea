//! String stability: how much of a leader's oscillation is left in the speed of each vehicle of a platoon.
//!
//! The gain is measured as the Fourier component of the speed at the leader's frequency, after transients, and compared
//! with the closed form of the linearised model.

#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(clippy::disallowed_methods, reason = "measures motion, and no state depends on it")]

use city3d_control::{CONTROLLERS, DriverParams, LeaderState, OwnMotion, PlatoonBroadcast, controller};
use city3d_control::{CaccGains, CaccInputs, PloegGains, PloegInputs};
use std::f64::consts::TAU;

/// Control step of the mainframe, about.
const STEP_S: f64 = 0.02;
const LENGTH_M: f64 = 0.2;
/// Small enough for the linearised model.
const AMPLITUDE_MPS: f64 = 0.002;

#[derive(Clone, Copy, Debug)]
struct Car {
    front_m: f64,
    speed_mps: f64,
    acceleration_mps2: f64,
}

/// A column behind a leader of sinusoidal speed.
struct Column {
    name: &'static str,
    driver: DriverParams,
    spacing_m: f64,
    headway_s: f64,
    mean_mps: f64,
    frequency_hz: f64,
    cars: usize,
    /// Gap in equilibrium.
    gap_m: f64,
    /// How much larger the gaps are at the beginning.
    disturbed_m: f64,
}

impl Column {
    fn new(name: &'static str, mean_mps: f64, frequency_hz: f64, cars: usize) -> Self {
        let driver = DriverParams::default();
        let (spacing_m, headway_s) = (0.2, 0.5);
        let gap_m = match name {
            "cacc" => spacing_m,
            "ploeg" => driver.standstill_gap_m + headway_s * mean_mps,
            _ => equilibrium_gap(&driver, mean_mps),
        };
        Self { name, driver, spacing_m, headway_s, mean_mps, frequency_hz, cars, gap_m, disturbed_m: 0.01 }
    }

    /// Ratio of the speed amplitude of each car to that of the one ahead, from front to back; the first is the leader.
    fn gains(&self) -> Vec<f64> {
        let per_period = (1.0 / (self.frequency_hz * STEP_S)).ceil() as usize;
        let step_s = 1.0 / (self.frequency_hz * per_period as f64);
        // The modes of CACC decay by e in 5 s, and are as many as there are cars.
        let settling = (400.0 * self.frequency_hz).ceil() as usize + 2;
        let (mut sums, mut cars) = (vec![(0.0_f64, 0.0_f64); self.cars + 1], self.at_start());
        let controller = controller(self.name, self.driver).unwrap();
        for step in 0..(settling + 3) * per_period {
            let leader_mps = |step: usize| {
                self.mean_mps + AMPLITUDE_MPS * (TAU * (step % per_period) as f64 / per_period as f64).sin()
            };
            if step >= settling * per_period {
                let phase = TAU * (step % per_period) as f64 / per_period as f64;
                for (sum, car) in sums.iter_mut().zip(&cars) {
                    let deviation_mps = car.speed_mps - self.mean_mps;
                    *sum = (sum.0 + deviation_mps * phase.cos(), sum.1 + deviation_mps * phase.sin());
                }
            }
            // From front to back, as the mainframe does: each knows what has been planned for those ahead.
            let before = cars.clone();
            for index in 0..cars.len() {
                let u = if index == 0 {
                    (leader_mps(step + 1) - before[0].speed_mps) / step_s
                } else {
                    let own = OwnMotion {
                        planned_mps: before[index].speed_mps,
                        planned_mps2: before[index].acceleration_mps2,
                        measured_mps: before[index].speed_mps,
                        margin_m: 0.0,
                        step_s,
                        now_s: step as f64 * step_s,
                    };
                    let predecessor = LeaderState {
                        gap_m: before[index - 1].front_m - LENGTH_M - before[index].front_m,
                        speed_mps: before[index - 1].speed_mps,
                    };
                    let platoon = PlatoonBroadcast {
                        predecessor,
                        predecessor_mps2: cars[index - 1].acceleration_mps2,
                        leader_mps: before[0].speed_mps,
                        leader_mps2: cars[0].acceleration_mps2,
                        spacing_m: self.spacing_m,
                        headway_s: self.headway_s,
                    };
                    controller.platoon_acceleration(own, self.driver.desired_speed_mps, &platoon)
                };
                let car = &mut cars[index];
                let next_mps = (car.speed_mps + u * step_s).max(0.0);
                car.front_m += (car.speed_mps + next_mps) / 2.0 * step_s;
                (car.speed_mps, car.acceleration_mps2) = (next_mps, u);
            }
        }
        let amplitudes: Vec<f64> = sums.iter().map(|(c, s)| c.hypot(*s)).collect();
        amplitudes.windows(2).map(|pair| pair[1] / pair[0]).collect()
    }

    fn at_start(&self) -> Vec<Car> {
        let pitch_m = self.gap_m + LENGTH_M + self.disturbed_m;
        let car = |index: usize| Car {
            front_m: -(index as f64) * pitch_m,
            speed_mps: self.mean_mps,
            acceleration_mps2: 0.0,
        };
        (0..=self.cars).map(car).collect()
    }
}

/// s_e(v) of the IDM (Treiber and Kesting 2013, Traffic Flow Dynamics, eq. 11.17).
fn equilibrium_gap(driver: &DriverParams, v: f64) -> f64 {
    let ratio = v / driver.desired_speed_mps;
    (driver.standstill_gap_m + v * driver.headway_s) / (1.0 - ratio.powi(4)).sqrt()
}

/// Gain from the speed of one vehicle to that of the next in the linearised IDM.
///
/// Around the equilibrium `dv/dt = f_s s + f_v v + f_l v_l` with `ds/dt = v_l - v` (Treiber and Kesting 2013, section 15.4),
/// so `G(i w) = (f_s + i w f_l) / (f_s - w^2 - i w f_v)`. The derivatives are those of
/// `f = a (1 - (v/v0)^4 - (s*/s)^2)`, `s* = s0 + v T + v (v - v_l) / (2 sqrt(a b))`.
fn idm_gain(driver: &DriverParams, v: f64, frequency_hz: f64) -> f64 {
    let (a, b) = (driver.max_acceleration_mps2, -driver.min_acceleration_mps2);
    let (s, s_star) = (equilibrium_gap(driver, v), driver.standstill_gap_m + v * driver.headway_s);
    let approach = v / (2.0 * (a * b).sqrt());
    let f_s = 2.0 * a * s_star * s_star / s.powi(3);
    let f_l = 2.0 * a * s_star / (s * s) * approach;
    let free = 4.0 / driver.desired_speed_mps * (v / driver.desired_speed_mps).powi(3);
    let f_v = -a * (free + 2.0 * s_star / (s * s) * (driver.headway_s + approach));
    let w = TAU * frequency_hz;
    f_s.hypot(w * f_l) / (f_s - w * w).hypot(w * f_v)
}

const FREQUENCIES_HZ: [f64; 9] = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0];

#[test]
fn every_controller_is_here_but_those_that_follow_nobody() {
    let tried = ["idm", "cacc", "ploeg"];
    assert!(
        CONTROLLERS
            .iter()
            .all(|name| ["cruise", "sinusoid", "parked"].contains(name) || tried.contains(name))
    );
}

#[test]
fn idm_amplifies_as_its_linearised_model_says() {
    // Headway, speed, frequency and the gain of the closed form.
    for (headway_s, mean_mps, frequency_hz, expected) in
        [(1.0, 0.2, 0.2, 0.46), (0.5, 0.2, 0.2, 0.71), (0.5, 0.15, 0.108, 1.053)]
    {
        let mut column = Column::new("idm", mean_mps, frequency_hz, 2);
        column.driver.headway_s = headway_s;
        column.gap_m = equilibrium_gap(&column.driver, mean_mps);
        let closed = idm_gain(&column.driver, mean_mps, frequency_hz);
        assert!((closed - expected).abs() < 0.005, "{closed} instead of {expected}");
        for (car, gain) in column.gains().into_iter().enumerate() {
            assert!((gain / closed - 1.0).abs() < 0.02, "car {}: {gain} instead of {closed}", car + 1);
        }
    }
}

#[test]
fn no_member_of_a_cacc_platoon_amplifies() {
    for frequency_hz in FREQUENCIES_HZ {
        for cars in [1, 3, 7] {
            let gains = Column::new("cacc", 0.2, frequency_hz, cars).gains();
            // Each moves as the leader does.
            assert!(gains.iter().all(|gain| (gain - 1.0).abs() < 1e-6), "{frequency_hz} Hz: {gains:?}");
            assert!(gains.iter().all(|gain| *gain <= 1.0 + 1e-9), "{frequency_hz} Hz: {gains:?}");
        }
    }
}

#[test]
fn no_member_of_a_ploeg_platoon_amplifies() {
    for frequency_hz in FREQUENCIES_HZ {
        for cars in [1, 3, 7] {
            let column = Column::new("ploeg", 0.2, frequency_hz, cars);
            // |1/(1 + i w h)|
            let closed = 1.0 / 1.0_f64.hypot(TAU * frequency_hz * column.headway_s);
            for gain in column.gains() {
                assert!(gain <= 1.0, "{frequency_hz} Hz: {gain}");
                assert!(
                    (gain - closed).abs() < 0.05 * closed.max(0.2),
                    "{frequency_hz} Hz: {gain}, {closed}"
                );
            }
        }
    }
}

/// The laws behind a drive of first order, `tau a' = u - a`, as they are published. Plexe's drive has 0.5 s.
#[test]
fn a_lagging_drive_amplifies_no_more() {
    let (tau_s, step_s) = (0.5_f64, 0.01_f64);
    for frequency_hz in [0.02_f64, 0.05, 0.1, 0.2, 0.5, 1.0] {
        for law in ["cacc", "ploeg"] {
            let (per_period, w) = ((1.0 / (frequency_hz * step_s)).round() as usize, TAU * frequency_hz);
            let step_s = 1.0 / (frequency_hz * per_period as f64);
            let settling = (400.0 * frequency_hz).ceil() as usize + 2;
            let decay = (-step_s / tau_s).exp();
            // Position, speed, acceleration, command; in full-scale metres around 20 m/s.
            let mut cars = [[0.0_f64, 20.0, 0.0, 0.0]; 8];
            let gap_m = if law == "cacc" { 5.0 } else { 2.0 + 0.5 * 20.0 };
            cars.iter_mut().enumerate().for_each(|(index, car)| car[0] = -(index as f64) * (gap_m + 0.1));
            let mut sums = [(0.0_f64, 0.0_f64); 8];
            for step in 0..(settling + 3) * per_period {
                let phase = TAU * (step % per_period) as f64 / per_period as f64;
                let before = cars;
                for index in 0..cars.len() {
                    let [position_m, v, a, u] = before[index];
                    let command = if index == 0 {
                        (w * (phase + TAU / per_period as f64 / 2.0).cos()) * 0.1
                    } else {
                        let (ahead, gap) = (before[index - 1], before[index - 1][0] - position_m);
                        let predecessor = (ahead[1], cars[index - 1][3]);
                        if law == "cacc" {
                            CaccGains::default().acceleration(CaccInputs {
                                spacing_error_m: gap - 5.0,
                                speed_mps: v,
                                predecessor,
                                leader: (before[0][1], cars[0][3]),
                            })
                        } else {
                            let inputs = PloegInputs {
                                distance_m: gap - 2.0,
                                headway_s: 0.5,
                                speed_mps: v,
                                acceleration_mps2: a,
                                commanded_mps2: u,
                                predecessor,
                            };
                            PloegGains::default().acceleration(inputs, step_s)
                        }
                    };
                    // Exact for a command that is constant over the step.
                    let next_a = command + (a - command) * decay;
                    let gained_mps = command * step_s + (a - command) * tau_s * (1.0 - decay);
                    let way_m = v * step_s
                        + command * step_s * step_s / 2.0
                        + (a - command) * tau_s * (step_s - tau_s * (1.0 - decay));
                    cars[index] = [position_m + way_m, v + gained_mps, next_a, command];
                }
                if step >= settling * per_period {
                    for (sum, car) in sums.iter_mut().zip(&before) {
                        let deviation = car[1] - 20.0;
                        *sum = (sum.0 + deviation * phase.cos(), sum.1 + deviation * phase.sin());
                    }
                }
            }
            let amplitudes = sums.map(|(c, s)| c.hypot(s));
            for pair in amplitudes.windows(2) {
                let gain = pair[1] / pair[0];
                assert!(gain <= 1.0 + 1e-6, "{law}, {frequency_hz} Hz: {gain}");
                let closed = if law == "cacc" { 1.0 } else { 1.0 / 1.0_f64.hypot(w * 0.5) };
                assert!(
                    (gain - closed).abs() < 0.05 * closed.max(0.2),
                    "{law}, {frequency_hz} Hz: {gain}, {closed}"
                );
            }
        }
    }
}
