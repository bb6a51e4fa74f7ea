//! Past states of a run: what a window needs to look back and to draw figures, for every source, with a log or without.

use super::plan_history::PlanHistory;
use city3d_dynamics::vehicle::set_wheels;
use city3d_logbook::record::{LoggedPlans, LoggedSnapshot, LoggedVehicle};
use city3d_protocol::snapshot::{CoordinationState, FrameSnapshot, VehicleId, VehicleInfo, VehicleState};
use city3d_simulation::scenario::Experiment;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Least simulated time between two kept states, unless something grave happens between them, or the run is over.
pub const KEPT_EVERY_S: f64 = 0.1;
/// Most memory of the states of one run, bytes. Beyond it, the older half of them is thinned.
pub const HISTORY_LIMIT: usize = 192 << 20;
/// Rounding error of times.
const ROUNDING_S: f64 = 1e-6;

/// A city at an instant, in the precision of a log.
#[derive(Clone, Debug)]
pub struct PastState {
    snapshot: LoggedSnapshot,
    roster: Arc<Vec<VehicleInfo>>,
}

impl PastState {
    /// The kept part of a snapshot.
    pub fn of(snapshot: &FrameSnapshot) -> Self {
        Self {
            snapshot: LoggedSnapshot {
                tick: snapshot.tick,
                time_s: snapshot.time_s,
                state_hash: snapshot.state_hash,
                vehicles: snapshot.vehicles.iter().map(LoggedVehicle::of).collect(),
                signals: snapshot.signals.clone(),
            },
            roster: Arc::clone(&snapshot.roster),
        }
    }

    /// Simulated time, seconds.
    pub fn time_s(&self) -> f64 {
        self.snapshot.time_s
    }

    /// State of a vehicle, without velocity across the heading and wheel lift; `None` where it was not in the city.
    pub fn vehicle(&self, id: VehicleId) -> Option<VehicleState> {
        let index = self.snapshot.vehicles.binary_search_by_key(&id, |vehicle| vehicle.id).ok()?;
        Some(self.snapshot.vehicles[index].state())
    }

    /// The vehicles in id order, each with its static data.
    pub fn vehicles(&self) -> impl Iterator<Item = (VehicleState, &VehicleInfo)> {
        self.snapshot.vehicles.iter().map(LoggedVehicle::state).zip(self.roster.iter())
    }

    /// The whole snapshot, without events.
    pub fn snapshot(&self, experiment: &Experiment) -> FrameSnapshot {
        let logged = &self.snapshot;
        let state = |logged: &LoggedVehicle| {
            let mut state = logged.state();
            if let Some(planned) = experiment.planned(state.id) {
                set_wheels(&planned.spec, &mut state);
            }
            state
        };
        FrameSnapshot {
            tick: logged.tick,
            time_s: logged.time_s,
            state_hash: logged.state_hash,
            vehicles: logged.vehicles.iter().map(state).collect(),
            roster: Arc::clone(&self.roster),
            events: Vec::new(),
            signals: logged.signals.clone(),
        }
    }

    /// Memory that it takes, bytes; the roster is shared.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>() + self.snapshot.vehicles.len() * size_of::<LoggedVehicle>()
    }
}

/// Past states of one run as a session writes them. Copies share them; another run has another feed.
#[derive(Clone, Default)]
pub struct HistoryFeed(Arc<Mutex<KeptStates>>);

/// States in order of time, within a limit of memory.
#[derive(Debug)]
struct KeptStates {
    states: Vec<Arc<PastState>>,
    bytes: usize,
    limit: usize,
    /// Least time between states of the older half, once it has been thinned.
    coarse_s: f64,
    /// How often states were left out, after which their places are others.
    thinned: u32,
    plans: PlanHistory,
}

impl Default for KeptStates {
    fn default() -> Self {
        Self {
            states: Vec::new(),
            bytes: 0,
            limit: HISTORY_LIMIT,
            coarse_s: 2.0 * KEPT_EVERY_S,
            thinned: 0,
            plans: PlanHistory::default(),
        }
    }
}

impl KeptStates {
    fn push(&mut self, mut state: PastState) {
        if let Some(last) = self.states.last()
            && *last.roster == *state.roster
        {
            state.roster = Arc::clone(&last.roster);
        }
        self.bytes += state.bytes();
        self.states.push(Arc::new(state));
        if self.bytes > self.limit {
            self.thin();
        }
    }

    /// Leaves out states of the older half, evenly, so that the whole run stays covered.
    fn thin(&mut self) {
        let (before, half) = (self.states.len(), self.states.len() / 2);
        loop {
            let (mut place, mut last_s) = (0, f64::NEG_INFINITY);
            let coarse_s = self.coarse_s - ROUNDING_S;
            self.states.retain(|state| {
                place += 1;
                let is_kept = place > half || state.time_s() - last_s > coarse_s;
                if is_kept {
                    last_s = state.time_s();
                }
                is_kept
            });
            // Thinned by less, it would be full again soon.
            if before - self.states.len() > before / 8 || before < 8 {
                break;
            }
            self.coarse_s *= 2.0;
        }
        self.bytes = self.states.iter().map(|state| state.bytes()).sum();
        self.thinned += 1;
    }
}

impl std::fmt::Debug for HistoryFeed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "HistoryFeed({} states)", self.lock().states.len())
    }
}

impl HistoryFeed {
    fn lock(&self) -> MutexGuard<'_, KeptStates> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps a state when it is due, or when it matters: something grave has happened in it, or it is the last one.
    pub(crate) fn take(&self, snapshot: &FrameSnapshot, matters: bool) {
        let last_s = self.lock().states.last().map_or(f64::NEG_INFINITY, |last| last.time_s());
        let since_s = snapshot.time_s - last_s;
        if since_s > KEPT_EVERY_S - ROUNDING_S || (matters && since_s > ROUNDING_S) {
            let state = PastState::of(snapshot);
            self.lock().push(state);
        }
    }

    /// Keeps what was told of plans.
    pub(crate) fn take_plans(&self, told: LoggedPlans) {
        self.lock().plans.push(told);
    }
}

/// Past states of a run as a window reads them, in order of time.
#[derive(Clone, Debug, Default)]
pub struct RunHistory {
    states: Vec<Arc<PastState>>,
    feed: HistoryFeed,
    thinned: u32,
    revision: u64,
}

impl RunHistory {
    /// Takes the states that have come since; those of a run before are dropped.
    pub fn read(&mut self, feed: &HistoryFeed) {
        let is_same = Arc::ptr_eq(&self.feed.0, &feed.0);
        if !is_same {
            self.feed = feed.clone();
        }
        let kept = self.feed.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !is_same || kept.thinned != self.thinned || kept.states.len() < self.states.len() {
            self.states.clear();
            self.thinned = kept.thinned;
            self.revision += 1;
        }
        let known = self.states.len();
        self.states.extend_from_slice(&kept.states[known..]);
    }

    /// Replaces all states, as where other parts of a log have been read.
    pub(crate) fn replace(&mut self, states: Vec<Arc<PastState>>) {
        self.states = states;
        self.revision += 1;
    }

    /// Adds a later state; an earlier one begins another run.
    pub fn push(&mut self, snapshot: &FrameSnapshot) {
        match self.states.last().map(|last| last.time_s()) {
            Some(last_s) if last_s == snapshot.time_s => return,
            Some(last_s) if last_s > snapshot.time_s => {
                self.states.clear();
                self.revision += 1;
            }
            _ => {}
        }
        self.states.push(Arc::new(PastState::of(snapshot)));
    }

    /// The plans of coordinated vehicles that held at a time; `None` where nobody had told any, and for those of a log, which
    /// its player knows.
    pub fn plans_at(&self, time_s: f64) -> Option<CoordinationState> {
        self.feed.lock().plans.at(time_s)
    }

    /// All states.
    pub fn states(&self) -> &[Arc<PastState>] {
        &self.states
    }

    /// Changes when states have changed other than by later ones that were added.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The states of a time span, both ends included.
    pub fn between(&self, from_s: f64, to_s: f64) -> &[Arc<PastState>] {
        let first = self.states.partition_point(|state| state.time_s() < from_s);
        let end = self.states.partition_point(|state| state.time_s() <= to_s).max(first);
        &self.states[first..end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(tick: u64, vehicles: u32) -> FrameSnapshot {
        let vehicles = (1..=vehicles).map(|id| VehicleState { id: VehicleId(id), ..VehicleState::default() });
        let vehicles: Vec<_> = vehicles.collect();
        let info = |v: &VehicleState| {
            VehicleInfo::of(
                v.id,
                "car",
                Default::default(),
                &city3d_protocol::snapshot::VehicleSpec::default(),
            )
        };
        let roster = Arc::new(vehicles.iter().map(info).collect());
        FrameSnapshot { tick, time_s: tick as f64 * 0.01, vehicles, roster, ..FrameSnapshot::default() }
    }

    #[test]
    fn ten_states_a_second_are_kept_and_those_of_grave_events_exactly() {
        let feed = HistoryFeed::default();
        (0..=100).for_each(|tick| feed.take(&at(tick, 1), tick == 57));
        let mut history = RunHistory::default();
        history.read(&feed);
        let ticks: Vec<u64> = history.states().iter().map(|state| state.snapshot.tick).collect();
        assert_eq!(ticks, [0, 10, 20, 30, 40, 50, 57, 67, 77, 87, 97]);
    }

    #[test]
    fn beyond_the_limit_the_whole_run_stays_covered_and_the_last_part_is_as_fine_as_ever() {
        let feed = HistoryFeed::default();
        feed.lock().limit = 200 * PastState::of(&at(0, 4)).bytes();
        let mut history = RunHistory::default();
        for tick in 0..20_000 {
            feed.take(&at(tick, 4), false);
            if tick % 1000 == 0 {
                history.read(&feed);
            }
        }
        history.read(&feed);
        let states = history.states();
        assert!((100..=200).contains(&states.len()), "{}", states.len());
        assert_eq!(states[0].time_s(), 0.0, "the start is kept");
        let gaps: Vec<f64> = states.windows(2).map(|pair| pair[1].time_s() - pair[0].time_s()).collect();
        assert!(gaps[gaps.len() - 40..].iter().all(|gap_s| (gap_s - 0.1).abs() < 1e-6), "{gaps:?}");
        assert!(gaps.iter().all(|gap_s| *gap_s > 0.0 && *gap_s < 7.0), "evenly: {gaps:?}");
    }

    #[test]
    fn another_run_has_another_history_and_equal_rosters_are_one() {
        let (first, second) = (HistoryFeed::default(), HistoryFeed::default());
        (0..50).for_each(|tick| first.take(&at(tick, 2), false));
        second.take(&at(0, 2), false);
        let mut history = RunHistory::default();
        history.read(&first);
        assert!(Arc::ptr_eq(&history.states()[0].roster, &history.states()[4].roster));
        assert_eq!(history.between(0.1, 0.3).len(), 3);
        let before = history.revision();
        history.read(&second);
        assert_eq!(history.states().len(), 1);
        assert!(history.revision() > before);
    }
}
