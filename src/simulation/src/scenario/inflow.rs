//! Inflows: when vehicles arrive at an entry lane, and what each of them is, drawn by seed.
//!
//! Every inflow has random streams of its own, one for the times, one for the roles and one for everything else. What is
//! drawn for one inflow depends on no other, and who is a human driver changes nothing else.

use super::experiment::PlannedVehicle;
use city3d_control::Role;
use city3d_geometry::trig;
use city3d_roadmap::LaneId;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The point process of the arrivals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ArrivalProcess {
    /// Poisson with a minimum headway: headways are exponentially distributed beyond the least one (shifted exponential
    /// distribution; Cowan 1975, M2).
    #[default]
    Poisson,
    /// Equal headways.
    Even,
}

impl ArrivalProcess {
    /// Every process by its name in scenarios.
    pub const NAMES: [(&'static str, Self); 2] = [("poisson", Self::Poisson), ("even", Self::Even)];
}

/// A source of traffic at an entry lane.
#[derive(Clone, Debug, PartialEq)]
pub struct Inflow {
    /// Unique in the experiment.
    pub name: String,
    /// Where its vehicles enter: their rear bumpers at the beginning of this lane.
    pub lane: LaneId,
    /// Mean number of arrivals in an hour.
    pub rate_veh_h: f64,
    /// How they follow one another.
    pub kind: ArrivalProcess,
    /// Least headway of [`ArrivalProcess::Poisson`]; less than the mean one.
    pub min_headway_s: f64,
    /// Simulated time from which vehicles arrive.
    pub from_s: f64,
    /// Simulated time at which the last one may arrive, exclusive.
    pub to_s: f64,
}

/// A vehicle that is to arrive at an entry.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedArrival {
    /// Simulated time at which it wants to enter; it is held while there is no room.
    pub time_s: f64,
    /// Index of its inflow in [`Experiment::inflows`](super::Experiment::inflows).
    pub inflow: usize,
    /// The vehicle at its entry, with the largest speed that it may enter at.
    pub vehicle: PlannedVehicle,
}

/// What is drawn for one arrival.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ArrivalDraw {
    pub time_s: f64,
    pub role: Role,
    /// Uniform in [0, 1): the vehicle type, the destination, the driver as a CAV and as a human.
    pub lots: [f64; 4],
    /// Uniform in [0, 1): the deviations of the driver's parameters.
    pub deviations: [f64; 4],
}

/// Random streams of one inflow.
#[derive(Clone, Copy, Debug)]
enum Stream {
    Times,
    Roles,
    Others,
}

/// Number of a random stream: by the entry lane, and by the number of the inflow among those of that lane. Streams 0 and 1
/// are those of traffic and environment.
fn stream_number(lane: &str, count: u64, stream: Stream) -> u64 {
    // FNV-1a.
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for byte in lane.bytes().chain(count.to_le_bytes()) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
    (1 << 63) | (hash & !0b11) | stream as u64
}

impl Inflow {
    /// Draws the arrivals in order of time, at most so many. `lane` names the entry lane, and `count` is the number of
    /// inflows before this one at that lane.
    pub(super) fn draw(
        &self,
        seed: u64,
        (lane, count): (&str, u64),
        share_cav: f64,
        most: usize,
    ) -> Vec<ArrivalDraw> {
        let stream = |stream| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(stream_number(lane, count, stream));
            rng
        };
        let (mut roles, mut others) = (stream(Stream::Roles), stream(Stream::Others));
        let times = self.arrival_times(&mut stream(Stream::Times), most);
        let draw = |time_s| ArrivalDraw {
            time_s,
            role: if uniform(&mut roles) < share_cav { Role::Cav } else { Role::Human },
            lots: std::array::from_fn(|_| uniform(&mut others)),
            deviations: std::array::from_fn(|_| uniform(&mut others)),
        };
        times.into_iter().map(draw).collect()
    }

    /// Times from [`Self::from_s`] until before [`Self::to_s`]. The process is stationary: the first headway is what is left
    /// of one that has begun earlier, so that the mean rate holds from the beginning.
    fn arrival_times(&self, rng: &mut ChaCha8Rng, most: usize) -> Vec<f64> {
        let mean_s = self.mean_headway_s();
        let mut times = Vec::new();
        match self.kind {
            ArrivalProcess::Even => {
                let all = (0..most).map(|k| self.from_s + k as f64 * mean_s);
                times.extend(all.take_while(|time_s| *time_s < self.to_s));
            }
            ArrivalProcess::Poisson => {
                let least_s = self.min_headway_s;
                // Equilibrium distribution: with probability least / mean uniform up to the least headway.
                let passed_s = uniform(rng) * mean_s;
                let whole_s = least_s + exponential(rng, mean_s - least_s);
                let mut time_s = self.from_s + if passed_s < least_s { passed_s } else { whole_s };
                while time_s < self.to_s && times.len() < most {
                    times.push(time_s);
                    time_s += least_s + exponential(rng, mean_s - least_s);
                }
            }
        }
        times
    }

    /// Mean time from one arrival to the next.
    pub fn mean_headway_s(&self) -> f64 {
        3600.0 / self.rate_veh_h
    }
}

/// The share that a lot in [0, 1) falls to, by weights above 0.
pub(super) fn share_of(lot: f64, weights: impl Iterator<Item = f64> + Clone) -> usize {
    let total: f64 = weights.clone().sum();
    let mut left = lot * total;
    let mut last = 0;
    for (index, weight) in weights.enumerate() {
        last = index;
        left -= weight;
        if left < 0.0 {
            break;
        }
    }
    last
}

/// Exponentially distributed with this mean.
fn exponential(rng: &mut ChaCha8Rng, mean: f64) -> f64 {
    -mean * trig::ln(1.0 - uniform(rng))
}

/// Uniform in [0, 1) with 53 random bits.
pub(super) fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inflow(rate_veh_h: f64, kind: ArrivalProcess, min_headway_s: f64, to_s: f64) -> Inflow {
        let (name, lane) = ("west".to_owned(), LaneId(0));
        Inflow { name, lane, rate_veh_h, kind, min_headway_s, from_s: 0.0, to_s }
    }

    fn times(inflow: &Inflow, seed: u64) -> Vec<f64> {
        let drawn = inflow.draw(seed, ("west", 0), 1.0, usize::MAX);
        drawn.into_iter().map(|draw| draw.time_s).collect()
    }

    /// Renewal process: the number of arrivals in a time T has variance T s^2 / m^3, with mean m and standard deviation s of
    /// the headways; that of a shifted exponential is m less the least headway.
    #[test]
    fn poisson_arrivals_have_their_mean_rate_and_least_headway() {
        for (rate_veh_h, least_s) in [(300.0, 0.0), (900.0, 1.5), (1500.0, 2.0)] {
            let to_s = 2e6;
            let times = times(&inflow(rate_veh_h, ArrivalProcess::Poisson, least_s, to_s), 5);
            let mean_s: f64 = 3600.0 / rate_veh_h;
            let expected = to_s / mean_s;
            let deviation =
                (to_s * (mean_s - least_s) * (mean_s - least_s) / (mean_s * mean_s * mean_s)).sqrt();
            let off = (times.len() as f64 - expected) / deviation;
            assert!(off.abs() < 3.0, "{rate_veh_h}: {} instead of {expected}, {off}", times.len());
            let headways: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let least = headways.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(least >= least_s - 1e-9, "{rate_veh_h}: {least}");
            // Beyond the least headway they are exponential: a share of 1 / e exceeds the mean excess.
            let longer = headways.iter().filter(|headway| **headway > mean_s).count() as f64;
            let share = longer / headways.len() as f64;
            let error = 3.0 * (0.368_f64 * 0.632 / headways.len() as f64).sqrt();
            assert!((share - trig::exp(-1.0)).abs() < error, "{rate_veh_h}: {share}");
        }
    }

    /// With residual life as the first headway the expected number is T / m for every T, however short.
    #[test]
    fn the_mean_rate_holds_from_the_beginning() {
        let to_s = 3.0;
        let short = inflow(900.0, ArrivalProcess::Poisson, 2.0, to_s);
        let seeds = 40_000;
        let arrived: usize = (0..seeds).map(|seed| times(&short, seed).len()).sum();
        let mean = arrived as f64 / seeds as f64;
        // At most two fit: the standard deviation of one number is below 1.
        assert!((mean - 0.75).abs() < 3.0 / (seeds as f64).sqrt(), "{mean}");
    }

    #[test]
    fn even_arrivals_are_evenly_spaced() {
        let drawn = times(&Inflow { from_s: 10.0, ..inflow(1200.0, ArrivalProcess::Even, 0.0, 100.0) }, 1);
        assert_eq!(drawn.len(), 30);
        assert!(drawn.iter().enumerate().all(|(k, time_s)| *time_s == 10.0 + 3.0 * k as f64), "{drawn:?}");
    }

    #[test]
    fn a_larger_share_of_cavs_turns_humans_into_cavs_and_changes_no_other_draw() {
        let inflow = inflow(1200.0, ArrivalProcess::Poisson, 1.0, 3600.0);
        let of = |share_cav| inflow.draw(3, ("west", 0), share_cav, usize::MAX);
        let mut before = of(0.0);
        assert!(before.iter().all(|draw| draw.role == Role::Human));
        for percent in 1..=100 {
            let now = of(f64::from(percent) / 100.0);
            assert_eq!(now.len(), before.len());
            for (a, b) in before.iter().zip(&now) {
                assert!(a.role == b.role || (a.role, b.role) == (Role::Human, Role::Cav));
                assert_eq!(ArrivalDraw { role: b.role, ..*a }, *b);
            }
            let cavs = now.iter().filter(|draw| draw.role == Role::Cav).count() as f64;
            let (share, count) = (f64::from(percent) / 100.0, now.len() as f64);
            assert!((cavs / count - share).abs() <= 4.0 * (share * (1.0 - share) / count).sqrt(), "{cavs}");
            before = now;
        }
        assert!(before.iter().all(|draw| draw.role == Role::Cav));
    }

    #[test]
    fn inflows_of_other_lanes_and_seeds_are_drawn_otherwise() {
        let inflow = inflow(600.0, ArrivalProcess::Poisson, 1.0, 600.0);
        let of = |seed, lane, count| inflow.draw(seed, (lane, count), 0.5, usize::MAX);
        assert_eq!(of(1, "west", 0), of(1, "west", 0));
        for other in [of(2, "west", 0), of(1, "east", 0), of(1, "west", 1)] {
            assert_ne!(of(1, "west", 0), other);
        }
    }

    #[test]
    fn shares_are_those_of_their_weights() {
        let weights = [1.0, 2.0, 1.0];
        let of = |lot| share_of(lot, weights.into_iter());
        assert_eq!([0.0, 0.24, 0.25, 0.74, 0.75, 0.999].map(of), [0, 0, 1, 1, 2, 2]);
    }
}
