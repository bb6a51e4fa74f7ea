//! Time stamps of a served city, for benchmarks of its link.

use super::{End, EndHealth, Moment, MomentKind, StepTiming};
use city3d_protocol::snapshot::VehicleId;
use std::sync::mpsc::Sender;
use std::time::Instant;

/// Time stamps of an event inside a served city, for benchmarks.
#[derive(Clone, Copy, Debug)]
pub enum TimingMark {
    /// A datagram of trajectories has been queued for the next tick.
    Taken {
        /// The vehicle of the first trajectory of the datagram.
        vehicle: VehicleId,
        /// Sequence number of that trajectory, which counts per vehicle.
        sequence: u32,
        /// When the datagram arrived, wall clock.
        at: Instant,
    },
    /// A tick is done, and the ends before this one have its poses.
    Ticked {
        /// Number of the tick that the world has reached.
        tick: u64,
        /// When its computation was due, began and ended.
        timing: StepTiming,
        /// When its poses had been handed on.
        sent: Instant,
    },
}

/// An end that marks when each tick was told to those before it.
#[derive(Debug)]
pub struct TimingMarks {
    marks: Sender<TimingMark>,
    told: u64,
}

impl TimingMarks {
    /// Sends its marks here.
    pub fn new(marks: Sender<TimingMark>) -> Self {
        Self { marks, told: 0 }
    }
}

impl End for TimingMarks {
    fn name(&self) -> &'static str {
        "marks"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if moment.kind == MomentKind::Tick {
            let (tick, timing) = (moment.snapshot.tick, moment.timing);
            // The bench may have ended.
            let _ = self.marks.send(TimingMark::Ticked { tick, timing, sent: Instant::now() });
            self.told += 1;
        }
    }

    fn health(&self) -> EndHealth {
        EndHealth { delivered: self.told, ..EndHealth::default() }
    }
}
