//! Looking back in a run that goes on: its past states are played like a log, while the city drives on.

use super::playhead::{FrameTimer, PlaybackCommand, Playhead, SeekTarget, TIME_TOLERANCE_S};
use crate::{ControlInsight, PastState, RunHistory, RunState};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;
use std::time::Instant;

/// A seek this close to the present shows the present, seconds.
const PRESENT_S: f64 = 0.02;

/// Plays the past of a run, or follows the present.
#[derive(Debug)]
pub struct PastPlayer {
    /// `None` while the present is shown.
    head: Option<Playhead>,
    /// The run that the playhead is in: a reset begins another one.
    run: u32,
    ticker: FrameTimer,
    /// What was shown last: states that need not be built again.
    shown: Option<ShownPair>,
}

/// Two successive past states, and the state of the run that shows them.
#[derive(Debug)]
struct ShownPair {
    states: [Arc<PastState>; 2],
    run_state: Arc<RunState>,
}

impl Default for PastPlayer {
    fn default() -> Self {
        Self { head: None, run: 0, ticker: FrameTimer::stopped(), shown: None }
    }
}

impl PastPlayer {
    /// Whether the past is shown, not the present.
    pub fn is_past(&self) -> bool {
        self.head.is_some()
    }

    /// Shows the present again.
    pub fn go_live(&mut self) {
        (self.head, self.shown) = (None, None);
        self.ticker.stop();
    }

    /// The playhead; in the present, it stands at the end of the history.
    pub fn head(&self, live: &RunState, history: &RunHistory) -> Playhead {
        let end_s = live.now.time_s;
        let from_s = history.states().first().map_or(end_s, |first| first.time_s().min(end_s));
        match self.head {
            Some(head) => Playhead { from_s, to_s: end_s.max(from_s), ..head },
            None => {
                // A step back leads to the last state that is kept.
                let states = history.states();
                let kept = states.partition_point(|state| state.time_s() < end_s - TIME_TOLERANCE_S);
                let before_s = kept.checked_sub(1).map_or(from_s, |last| states[last].time_s());
                Playhead { at_s: end_s, before_s, ..Playhead::new(from_s, end_s) }
            }
        }
    }

    /// Applies a transport command. From the present, a seek, a step back and playing backwards lead into the past.
    pub fn command(&mut self, command: PlaybackCommand, live: &RunState, history: &RunHistory) {
        let mut head = self.head(live, history);
        let leads_back = match command {
            PlaybackCommand::Live => return self.go_live(),
            PlaybackCommand::Seek(_) | PlaybackCommand::Show(_) | PlaybackCommand::Reverse => true,
            PlaybackCommand::Step { forward } => !forward,
            PlaybackCommand::Play | PlaybackCommand::Pause | PlaybackCommand::Speed(_) => false,
        };
        if history.states().is_empty() || (self.head.is_none() && !leads_back) {
            return;
        }
        self.run = live.run;
        if let (None, PlaybackCommand::Reverse, Some(last)) = (self.head, command, history.states().last()) {
            head.at_s = last.time_s();
        }
        let is_at_end = head.is_at_end();
        let target = head.apply(command);
        if !head.is_playing {
            self.ticker.stop();
        }
        match (command, target) {
            // At the end of the past is the present.
            (PlaybackCommand::Play, _) if is_at_end => return self.go_live(),
            (PlaybackCommand::Seek(time_s) | PlaybackCommand::Show(time_s), _)
                if time_s >= head.to_s - PRESENT_S =>
            {
                return self.go_live();
            }
            // An event is shown at its very time, also between two kept states.
            (PlaybackCommand::Show(_), Some(SeekTarget::NotBefore(time_s))) => head.at_s = time_s,
            (_, Some(target)) => {
                let place = place_of(target, history.states());
                head.at_s = history.states()[place].time_s();
            }
            (_, None) => {}
        }
        self.head = Some(head);
    }

    /// Advances to an instant: the past state to show, and the interpolation weight between its `before` (0) and `now`
    /// (1). `None` while the present is shown.
    pub fn advance(
        &mut self,
        now: Instant,
        live: &RunState,
        history: &RunHistory,
        experiment: &Experiment,
    ) -> Option<(Arc<RunState>, f64)> {
        self.head?;
        let mut head = self.head(live, history);
        let states = history.states();
        if live.run != self.run || states.is_empty() {
            self.go_live();
            return None;
        }
        if head.is_playing {
            head.at_s = head.after(self.ticker.pass(now));
            if !head.is_reverse && head.is_at_end() {
                // A run that has ended goes no further.
                self.go_live();
                return None;
            }
            if head.is_reverse && head.is_at_start() {
                head.is_playing = false;
                self.ticker.stop();
            }
        }
        // What is thinned or not yet kept has no state of its own.
        let next = states.partition_point(|state| state.time_s() < head.at_s - TIME_TOLERANCE_S);
        if next == states.len() && !head.is_reverse {
            self.go_live();
            return None;
        }
        let next = next.min(states.len() - 1);
        let pair = [&states[next.saturating_sub(1)], &states[next]].map(Arc::clone);
        let (from_s, to_s) = (pair[0].time_s(), pair[1].time_s());
        let weight =
            if to_s > from_s { ((head.at_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0) } else { 1.0 };
        let is_between = !head.is_playing && to_s - head.at_s > TIME_TOLERANCE_S && weight > 0.0;
        // Between two kept states a neighbouring event may be nearer than a state.
        head.before_s = if is_between { head.at_s - 2.0 * TIME_TOLERANCE_S } else { from_s };
        self.head = Some(head);
        let shown = self.show(pair, live, (history, experiment));
        Some(if is_between { (between(&shown, weight), 1.0) } else { (shown, weight) })
    }

    /// The state of the run with past snapshots in place of the present ones.
    fn show(
        &mut self,
        states: [Arc<PastState>; 2],
        live: &RunState,
        (history, experiment): (&RunHistory, &Experiment),
    ) -> Arc<RunState> {
        let is_same = |shown: &&ShownPair| {
            shown.states.iter().zip(&states).all(|(known, wanted)| Arc::ptr_eq(known, wanted))
        };
        let known = self.shown.as_ref().filter(is_same);
        let (before, now, coordination, insight) = match known.map(|known| &known.run_state) {
            Some(known) => {
                let (coordination, insight) = (known.coordination.clone(), known.insight.clone());
                (Arc::clone(&known.before), Arc::clone(&known.now), coordination, insight)
            }
            None => {
                let [before, now] =
                    [&states[0], &states[1]].map(|state| Arc::new(state.snapshot(experiment)));
                let told =
                    |told| Arc::new(ControlInsight { decisions: Some(told), ..ControlInsight::default() });
                let insight = live.decisions.at(now.time_s).map(told);
                (before, now, history.plans_at(states[1].time_s()).map(Arc::new), insight)
            }
        };
        let past = RunState { before, now, clock: None, coordination, insight, ..live.clone() };
        let run_state = Arc::new(past);
        self.shown = Some(ShownPair { states, run_state: Arc::clone(&run_state) });
        run_state
    }
}

/// A state between `before` and `now`, at the time of an event: numbers and picture are of that time.
fn between(shown: &RunState, weight: f64) -> Arc<RunState> {
    let mut now = FrameSnapshot::default();
    now.blend(&shown.before, &shown.now, weight);
    Arc::new(RunState { now: Arc::new(now), ..shown.clone() })
}

/// The place of the state that a seek is for; there is at least one.
fn place_of(target: SeekTarget, states: &[Arc<PastState>]) -> usize {
    let last = states.len() - 1;
    let before = |time_s: f64| states.partition_point(|state| state.time_s() < time_s);
    match target {
        SeekTarget::NotBefore(time_s) => before(time_s - TIME_TOLERANCE_S).min(last),
        SeekTarget::After(time_s) => before(time_s + TIME_TOLERANCE_S).min(last),
        SeekTarget::Before(time_s) => before(time_s - TIME_TOLERANCE_S).saturating_sub(1),
        SeekTarget::Nearest(time_s) => {
            let next = before(time_s).min(last);
            let distance = |place: usize| (states[place].time_s() - time_s).abs();
            let earlier = next.saturating_sub(1);
            if distance(earlier) < distance(next) { earlier } else { next }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RunPhase;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use std::time::Duration;

    /// A run of some seconds with its history.
    struct Past {
        run: Run,
        history: RunHistory,
        player: PastPlayer,
        now: Instant,
    }

    impl Past {
        fn after(ticks: u64) -> Self {
            let (text, library) = Library::scenario("straight").unwrap();
            let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
            let run = Run::new(Arc::new(experiment)).unwrap();
            let mut past = Self {
                run,
                history: RunHistory::default(),
                player: PastPlayer::default(),
                now: Instant::now(),
            };
            past.go_on(ticks);
            past
        }

        fn go_on(&mut self, ticks: u64) {
            for _ in 0..ticks {
                if self.run.snapshot().tick.is_multiple_of(10) {
                    self.history.push(self.run.snapshot());
                }
                self.run.step();
            }
        }

        fn live(&self) -> RunState {
            RunState::standing(Arc::new(self.run.snapshot().clone()), RunPhase::Running)
        }

        fn command(&mut self, command: PlaybackCommand) {
            let live = self.live();
            self.player.command(command, &live, &self.history);
        }

        /// Time and first position that are shown after so many milliseconds; `None` for the present.
        fn shown(&mut self, ms: u64) -> Option<(f64, f64)> {
            self.now += Duration::from_millis(ms);
            let live = self.live();
            let experiment = Arc::clone(self.run.experiment());
            let (state, weight) = self.player.advance(self.now, &live, &self.history, &experiment)?;
            let mut between = state.now.as_ref().clone();
            between.blend(&state.before, &state.now, weight);
            Some((between.time_s, between.vehicles[0].position.x))
        }
    }

    #[test]
    fn one_looks_back_while_the_run_goes_on_and_comes_back() {
        let mut past = Past::after(500);
        assert_eq!(past.shown(0), None, "the present at first");
        let mut reference = Run::new(Arc::clone(past.run.experiment())).unwrap();
        (0..200).for_each(|_| _ = reference.step());
        past.command(PlaybackCommand::Seek(2.0));
        let (time_s, x) = past.shown(10).unwrap();
        assert!((time_s - 2.0).abs() < 1e-9);
        assert!((x - reference.snapshot().vehicles[0].position.x).abs() < 1e-6, "as it was then");
        past.go_on(300);
        assert_eq!(past.shown(10).map(|(time_s, _)| time_s), Some(2.0), "it stands while the city drives on");
        let head = past.player.head(&past.live(), &past.history);
        assert!((head.to_s - 8.0).abs() < 1e-9 && head.at_s == 2.0);
        past.command(PlaybackCommand::Live);
        assert_eq!(past.shown(10), None);
    }

    #[test]
    fn the_past_plays_both_ways_and_ends_in_the_present() {
        let mut past = Past::after(500);
        past.command(PlaybackCommand::Reverse);
        past.shown(0);
        let times: Vec<f64> = (0..10).map(|_| past.shown(50).unwrap().0).collect();
        assert!(times.is_sorted_by(|a, b| a > b) && (times[9] - 4.4).abs() < 0.06, "{times:?}");
        past.command(PlaybackCommand::Step { forward: false });
        let stepped = past.shown(50).unwrap().0;
        assert_eq!(past.shown(50).unwrap().0, stepped, "a step pauses");
        past.command(PlaybackCommand::Speed(5.0));
        past.command(PlaybackCommand::Play);
        let mut last_s = stepped;
        let mut passes = 0;
        while let Some((time_s, _)) = past.shown(50) {
            assert!(time_s >= last_s);
            (last_s, passes) = (time_s, passes + 1);
            assert!(passes < 20, "it never comes to the present");
        }
        assert!(last_s > 4.5 && !past.player.is_past());
    }

    #[test]
    fn the_past_of_a_run_that_has_ended_plays_to_its_end_and_no_further() {
        let mut past = Past::after(500);
        // Its last state is kept.
        past.history.push(past.run.snapshot());
        past.command(PlaybackCommand::Seek(4.0));
        past.command(PlaybackCommand::Play);
        past.shown(0);
        assert!((0..40).any(|_| past.shown(50).is_none()), "it never comes to the end");
        assert!(!past.player.is_past());
    }

    #[test]
    fn an_event_between_two_kept_states_is_shown_at_its_time_in_picture_and_numbers() {
        let mut past = Past::after(300);
        let mut reference = Run::new(Arc::clone(past.run.experiment())).unwrap();
        (0..123).for_each(|_| _ = reference.step());
        past.command(PlaybackCommand::Show(1.23));
        let (time_s, x) = past.shown(10).unwrap();
        let true_x = reference.snapshot().vehicles[0].position.x;
        assert!((time_s - 1.23).abs() < 1e-9 && (x - true_x).abs() < 0.02, "{time_s} s: {x}, {true_x} m");
        let (live, experiment) = (past.live(), Arc::clone(past.run.experiment()));
        let (state, _) = past.player.advance(past.now, &live, &past.history, &experiment).unwrap();
        assert!((state.now.time_s - 1.23).abs() < 1e-9, "the numbers too: {}", state.now.time_s);
        let head = past.player.head(&live, &past.history);
        assert!((head.at_s - 1.23).abs() < 1e-9 && head.at_s - head.before_s < 0.01, "{head:?}");
        // Steps lead to the states around it, and the playback goes on from there.
        past.command(PlaybackCommand::Step { forward: false });
        assert!((past.shown(10).unwrap().0 - 1.2).abs() < 1e-9);
        past.command(PlaybackCommand::Show(1.23));
        past.command(PlaybackCommand::Step { forward: true });
        assert!((past.shown(10).unwrap().0 - 1.3).abs() < 1e-9);
    }

    #[test]
    fn in_the_present_only_what_leads_back_does_and_another_run_is_seen_live() {
        let mut past = Past::after(300);
        for command in [
            PlaybackCommand::Play,
            PlaybackCommand::Pause,
            PlaybackCommand::Speed(2.0),
            PlaybackCommand::Step { forward: true },
            PlaybackCommand::Seek(3.0),
            PlaybackCommand::Show(99.0),
        ] {
            past.command(command);
            assert_eq!(past.shown(10), None, "{command:?}");
        }
        past.command(PlaybackCommand::Show(1.23));
        assert!((past.shown(10).unwrap().0 - 1.23).abs() < 1e-9, "its very time");
        let next_run = RunState { run: 2, ..past.live() };
        let experiment = Arc::clone(past.run.experiment());
        assert!(past.player.advance(past.now, &next_run, &past.history, &experiment).is_none());
        assert!(!past.player.is_past());
    }
}
