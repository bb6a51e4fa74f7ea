//! Motion of one vehicle from its snapshots: effort, stops, and the audit of displacement.

use super::fuel::Effort;
use city3d_protocol::snapshot::{Status, VehicleState};
use glam::DVec2;

/// A vehicle below this speed stands, laboratory m/s.
pub const STANDS_MPS: f64 = 0.02;
/// A vehicle that stands moves again above this speed, laboratory m/s.
const MOVES_MPS: f64 = 0.04;
/// Accelerations are differences of mean speeds over steps of this duration, as in `city3d compare`.
const STEP_S: f64 = 0.1;
/// Rounding error of times.
const ROUNDING_S: f64 = 1e-6;
/// Snapshots farther apart have a gap between them.
const GAP_S: f64 = 1.0;

/// Motion of a vehicle so far. City metres.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// What it has spent.
    pub effort: Effort,
    /// How often it came to stand.
    pub stops: u32,
    /// How long it has stood, also from the start on, until it collides.
    pub stood_s: f64,
    /// Displacement along its heading, from successive positions.
    pub displacement_m: f64,
    /// Integral of its speed over the same time.
    pub integral_of_speed_m: f64,
    stands: bool,
    last: Option<Last>,
    step: Option<SpeedStep>,
    /// Mean speed of the step before.
    before_mps: Option<f64>,
}

/// The last snapshot of a vehicle.
#[derive(Clone, Copy, Debug)]
struct Last {
    time_s: f64,
    position: DVec2,
    forward: DVec2,
    speed_mps: f64,
}

/// The step whose mean speed is being formed.
#[derive(Clone, Copy, Debug)]
struct SpeedStep {
    since_s: f64,
    moved_m: f64,
}

impl Motion {
    /// Takes the next snapshot of the vehicle. `stands_mps` and `moves_mps` are at full scale.
    pub fn observe(&mut self, time_s: f64, state: &VehicleState, factor: f64) {
        if state.status == Status::Unseen {
            // The true motion is unknown.
            (self.last, self.step, self.before_mps) = (None, None, None);
            return;
        }
        let now = Last {
            time_s,
            position: state.position.truncate(),
            forward: state.forward(),
            speed_mps: state.speed_mps,
        };
        let last = self.last.replace(now).filter(|last| (0.0..GAP_S).contains(&(time_s - last.time_s)));
        let Some(last) = last else {
            self.stands = now.speed_mps.abs() < STANDS_MPS * factor;
            (self.step, self.before_mps) = (None, None);
            return;
        };
        let dt_s = time_s - last.time_s;
        let way_m = dt_s * (last.speed_mps + now.speed_mps) / 2.0;
        self.displacement_m += (now.position - last.position).dot(last.forward + now.forward) / 2.0;
        self.integral_of_speed_m += way_m;
        if state.status == Status::Finished {
            (self.step, self.before_mps) = (None, None);
            return;
        }
        self.time_stand(now.speed_mps.abs() / factor, dt_s, state.status == Status::Collided);
        let step = self.step.get_or_insert(SpeedStep { since_s: last.time_s, moved_m: 0.0 });
        step.moved_m += way_m;
        let lasted_s = time_s - step.since_s;
        if lasted_s > STEP_S - ROUNDING_S {
            let mean_mps = step.moved_m / lasted_s;
            let u = self.before_mps.map_or(0.0, |before_mps| (mean_mps - before_mps) / lasted_s);
            self.effort += Effort::of(lasted_s, mean_mps, u);
            (self.step, self.before_mps) = (None, Some(mean_mps));
        }
    }

    /// Who has collided comes to stand in no traffic, whatever it is pushed or driven against: neither its stops nor the
    /// time that it stands count.
    fn time_stand(&mut self, speed_in_lab_mps: f64, dt_s: f64, has_collided: bool) {
        if self.stands {
            self.stands = speed_in_lab_mps < MOVES_MPS;
        } else if speed_in_lab_mps < STANDS_MPS {
            (self.stands, self.stops) = (true, self.stops + u32::from(!has_collided));
        }
        if self.stands && !has_collided {
            self.stood_s += dt_s;
        }
    }

    /// Its speed in the snapshot of a time; `None` where it was not seen then, or not measured.
    pub fn speed_at(&self, time_s: f64) -> Option<f64> {
        self.last.filter(|last| last.time_s == time_s).map(|last| last.speed_mps)
    }

    /// Whether it stands now.
    pub fn stands(&self) -> bool {
        self.stands
    }

    /// Displacement divided by the integral of speed: 1 in a consistent run. `None` for a vehicle that has hardly moved,
    /// `least_m` at full scale.
    pub fn displacement_ratio(&self, least_m: f64) -> Option<f64> {
        (self.integral_of_speed_m.abs() > least_m).then(|| self.displacement_m / self.integral_of_speed_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn drive(speed_mps: impl Fn(f64) -> f64, until_s: f64) -> Motion {
        let mut motion = Motion::default();
        let mut x = 0.0;
        for tick in 0..=(until_s * 100.0).round() as u32 {
            let time_s = f64::from(tick) / 100.0;
            let state = VehicleState {
                status: Status::Driving,
                position: DVec3::new(x, 0.0, 0.0),
                speed_mps: speed_mps(time_s),
                ..VehicleState::default()
            };
            motion.observe(time_s, &state, 25.0);
            x += 0.01 * (speed_mps(time_s) + speed_mps(time_s + 0.01)) / 2.0;
        }
        motion
    }

    #[test]
    fn the_glide_of_the_closed_form_has_its_effort() {
        // Experiment 1 of the framework's closed forms at full scale: u from -.38818 to 0 in 10.0714 s.
        let t1_s = 10.0714;
        let glide = |t: f64| 8.75 - 0.38818 * t * (1.0 - t / (2.0 * t1_s));
        let motion = drive(glide, 10.0);
        assert!((motion.effort.int_u2_m2ps3 / 2.0 - 0.252939).abs() < 0.005, "{motion:?}");
        assert!((motion.displacement_ratio(1.0).unwrap() - 1.0).abs() < 1e-9, "{motion:?}");
        assert_eq!((motion.stops, motion.stood_s), (0, 0.0));
    }

    #[test]
    fn a_stop_counts_once_and_its_time_is_waiting() {
        // Creeping between the two thresholds does not end it.
        let speed = |t: f64| match t {
            t if t < 2.0 => 8.0,
            t if t < 4.0 => 0.0,
            t if t < 5.0 => 0.8,
            t if t < 6.0 => 0.0,
            _ => 8.0,
        };
        let motion = drive(speed, 8.0);
        assert_eq!(motion.stops, 1);
        assert!((motion.stood_s - 4.0).abs() < 0.03, "{}", motion.stood_s);
    }

    #[test]
    fn a_vehicle_that_is_moved_twice_a_step_is_found_out() {
        let mut motion = Motion::default();
        for tick in 0..200 {
            let x = 2.0 * 8.0 * 0.01 * f64::from(tick);
            let position = DVec3::new(x, 0.0, 0.0);
            let state = VehicleState { position, speed_mps: 8.0, ..VehicleState::default() };
            motion.observe(0.01 * f64::from(tick), &state, 25.0);
        }
        assert!((motion.displacement_ratio(1.0).unwrap() - 2.0).abs() < 1e-9);
    }

    #[test]
    fn a_constant_speed_burns_the_fuel_of_that_speed() {
        let motion = drive(|_| 13.4, 20.0);
        assert!((motion.effort.fuel_ml - 20.0 * 0.49582).abs() < 0.01, "{motion:?}");
        assert_eq!(motion.effort.fuel_ml, motion.effort.fuel_with_cruise_ml);
        assert!(motion.effort.int_u2_m2ps3 < 1e-12);
    }
}
