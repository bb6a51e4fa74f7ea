//! Schedule of the pictures: the ticks at which each camera is due.

use super::super::Failure;
use super::shots::Shot;
use city3d_simulation::scenario::Experiment;

/// The ticks at which the shots of a run are due.
#[derive(Clone, Debug)]
pub(super) struct Schedule {
    from_s: f64,
    physics_hz: f64,
    last: u64,
    /// Pictures taken so far, by camera.
    taken: Vec<u64>,
}

impl Schedule {
    pub(super) fn new(from_s: f64, shots: &[Shot], experiment: &Experiment) -> Result<Self, Failure> {
        let (rates, last) = (experiment.rates, experiment.ticks());
        if from_s > rates.time_s(last) {
            return Err(Failure::bad_input(format!(
                "--from {from_s} s lies after the end of the run at {} s; take an earlier time or a longer --duration",
                experiment.duration_s
            )));
        }
        Ok(Self { from_s, physics_hz: f64::from(rates.physics_hz), last, taken: vec![0; shots.len()] })
    }

    /// The tick nearest to the time at which a shot is due for the `count`-th time.
    fn tick(&self, every_s: f64, count: u64) -> u64 {
        ((self.from_s + count as f64 * every_s) * self.physics_hz).round() as u64
    }

    /// Whether at least `count` pictures follow.
    pub(super) fn has(mut self, shots: &[Shot], count: usize) -> bool {
        let mut found = 0;
        while found < count {
            let Some((_, due)) = self.next(shots) else { return false };
            found += due.len();
        }
        true
    }

    /// The next due tick with the indices of its cameras; `None` at the end of the run.
    pub(super) fn next(&mut self, shots: &[Shot]) -> Option<(u64, Vec<usize>)> {
        let due: Vec<u64> =
            shots.iter().zip(&self.taken).map(|(shot, &count)| self.tick(shot.every_s, count)).collect();
        let next = due.iter().copied().min().filter(|&tick| tick <= self.last)?;
        let taken: Vec<usize> = (0..due.len()).filter(|&index| due[index] == next).collect();
        for &index in &taken {
            self.taken[index] += 1;
        }
        Some((next, taken))
    }
}
