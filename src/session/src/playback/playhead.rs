//! The playhead: position, direction and speed of the playback.

use std::time::Instant;

/// The selectable speeds, simulated seconds per second.
pub const SPEEDS: [f64; 10] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];

/// A transport command: play, pause, step, seek or set the speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlaybackCommand {
    /// Plays forwards at the present speed; restarts at the end.
    Play,
    /// Plays backwards at the present speed; restarts at the start.
    Reverse,
    /// Stops at the recorded snapshot nearest to the time on display.
    Pause,
    /// Moves to the next or the previous recorded snapshot and pauses.
    Step {
        /// To the next snapshot; otherwise to the previous one.
        forward: bool,
    },
    /// Moves to the recorded snapshot nearest to a time; playback goes on from there.
    Seek(f64),
    /// Moves to the first recorded snapshot not before a time, the one that shows an event of that time, and pauses.
    Show(f64),
    /// Sets the speed as a multiple of real time.
    Speed(f64),
    /// Shows the present of a run that goes on; of a log, its end.
    Live,
}

/// The target of a seek that is not resolved yet, simulated seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SeekTarget {
    Nearest(f64),
    NotBefore(f64),
    After(f64),
    Before(f64),
}

/// Times this close are equal, seconds.
pub(super) const TIME_TOLERANCE_S: f64 = 1e-6;

/// Position, direction and speed of the playback.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playhead {
    /// Simulated times of the first and the last recorded snapshot.
    pub from_s: f64,
    /// A damaged log ends before its first damaged chunk.
    pub to_s: f64,
    /// Simulated time on display.
    pub at_s: f64,
    /// Simulated time of the recorded snapshot before it.
    pub before_s: f64,
    /// Whether the log is being played, forwards or backwards.
    pub is_playing: bool,
    /// Whether playback goes backwards in time.
    pub is_reverse: bool,
    /// Simulated seconds per second, in either direction.
    pub speed: f64,
}

impl Playhead {
    /// A paused playhead at the first snapshot. Times are finite; the last snapshot of a damaged log may precede the first.
    pub(super) fn new(from_s: f64, to_s: f64) -> Self {
        Self {
            from_s,
            to_s: to_s.max(from_s),
            at_s: from_s,
            before_s: from_s,
            is_playing: false,
            is_reverse: false,
            speed: 1.0,
        }
    }

    /// Simulated seconds per second; negative when playing backwards.
    pub fn rate(&self) -> f64 {
        if self.is_reverse { -self.speed } else { self.speed }
    }

    /// Whether the first snapshot is on display.
    pub fn is_at_start(&self) -> bool {
        self.at_s <= self.from_s + TIME_TOLERANCE_S
    }

    /// Whether the last snapshot is on display.
    pub fn is_at_end(&self) -> bool {
        self.at_s >= self.to_s - TIME_TOLERANCE_S
    }

    /// The position after playing for some seconds, clamped to the ends of the log.
    pub(super) fn after(&self, seconds: f64) -> f64 {
        (self.at_s + self.rate() * seconds).clamp(self.from_s, self.to_s)
    }

    /// Applies a command; returns the seek that has to be resolved in the log.
    pub(super) fn apply(&mut self, command: PlaybackCommand) -> Option<SeekTarget> {
        let within = |time_s: f64| time_s.clamp(self.from_s, self.to_s);
        match command {
            PlaybackCommand::Play | PlaybackCommand::Reverse => {
                self.is_reverse = command == PlaybackCommand::Reverse;
                self.is_playing = self.from_s < self.to_s;
                let (is_over, start_s) = if self.is_reverse {
                    (self.is_at_start(), self.to_s)
                } else {
                    (self.is_at_end(), self.from_s)
                };
                is_over.then_some(SeekTarget::Nearest(start_s))
            }
            PlaybackCommand::Pause => {
                self.is_playing = false;
                Some(SeekTarget::Nearest(self.at_s))
            }
            PlaybackCommand::Step { forward } => {
                self.is_playing = false;
                Some(if forward { SeekTarget::After(self.at_s) } else { SeekTarget::Before(self.at_s) })
            }
            PlaybackCommand::Seek(time_s) => Some(SeekTarget::Nearest(within(time_s))),
            PlaybackCommand::Show(time_s) => {
                self.is_playing = false;
                Some(SeekTarget::NotBefore(within(time_s)))
            }
            PlaybackCommand::Live => Some(SeekTarget::Nearest(self.to_s)),
            PlaybackCommand::Speed(speed) => {
                let [slowest, .., fastest] = SPEEDS;
                self.speed = if speed.is_finite() { speed.abs().clamp(slowest, fastest) } else { 1.0 };
                None
            }
        }
    }

    /// Applies a command without resolving its seek: the base of the next command in the same frame.
    pub fn predict(&mut self, command: PlaybackCommand) {
        match self.apply(command) {
            Some(SeekTarget::Nearest(time_s) | SeekTarget::NotBefore(time_s)) => self.at_s = time_s,
            Some(SeekTarget::After(_) | SeekTarget::Before(_)) | None => {}
        }
    }

    /// The next speed up or down the list, or the present one at its end.
    pub fn other_speed(&self, faster: bool) -> f64 {
        let next = if faster {
            SPEEDS.iter().find(|speed| **speed > self.speed * 1.001)
        } else {
            SPEEDS.iter().rev().find(|speed| **speed < self.speed * 0.999)
        };
        next.copied().unwrap_or(self.speed)
    }
}

/// Measures the frame time: wall-clock seconds between two frames. A late frame does not cause a jump.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameTimer(Option<Instant>);

/// Longest frame time that advances the playback.
const MAX_FRAME_TIME_S: f64 = 0.25;

impl FrameTimer {
    pub(super) fn stopped() -> Self {
        Self(None)
    }

    pub(super) fn pass(&mut self, now: Instant) -> f64 {
        let before = self.0.replace(now).unwrap_or(now);
        now.saturating_duration_since(before).as_secs_f64().min(MAX_FRAME_TIME_S)
    }

    pub(super) fn stop(&mut self) {
        self.0 = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_plays_both_ways_at_its_speed_and_stands_at_the_ends() {
        let mut head = Playhead::new(0.0, 40.0);
        assert_eq!(head.apply(PlaybackCommand::Speed(2.0)), None);
        assert_eq!(head.apply(PlaybackCommand::Play), None);
        assert!(head.is_playing);
        assert_eq!(head.after(3.0), 6.0);
        assert_eq!(head.after(300.0), 40.0);
        head.at_s = 10.0;
        head.apply(PlaybackCommand::Reverse);
        assert_eq!((head.after(3.0), head.after(30.0), head.rate()), (4.0, 0.0, -2.0));
    }

    #[test]
    fn at_an_end_it_begins_again_at_the_other() {
        let mut head = Playhead::new(0.0, 40.0);
        assert_eq!(head.apply(PlaybackCommand::Reverse), Some(SeekTarget::Nearest(40.0)));
        head.at_s = 40.0;
        assert_eq!(head.apply(PlaybackCommand::Reverse), None);
        assert_eq!(head.apply(PlaybackCommand::Play), Some(SeekTarget::Nearest(0.0)));
    }

    #[test]
    fn cues_of_one_pass_go_by_those_before() {
        let mut head = Playhead::new(0.0, 40.0);
        for _ in 0..2 {
            head.predict(PlaybackCommand::Seek(head.at_s + 5.0));
            head.predict(PlaybackCommand::Speed(head.other_speed(true)));
        }
        assert_eq!((head.at_s, head.speed), (10.0, 5.0));
    }

    #[test]
    fn a_log_of_one_snapshot_does_not_play() {
        let mut head = Playhead::new(3.0, 3.0);
        head.apply(PlaybackCommand::Play);
        assert!(!head.is_playing);
    }

    #[test]
    fn a_log_that_ends_before_it_begins_stands() {
        let mut head = Playhead::new(5.0, 1.0);
        assert_eq!((head.after(3.0), head.to_s), (5.0, 5.0));
        assert_eq!(head.apply(PlaybackCommand::Seek(2.0)), Some(SeekTarget::Nearest(5.0)));
        head.apply(PlaybackCommand::Play);
        assert!(!head.is_playing);
    }

    #[test]
    fn seeking_stays_inside_and_stepping_holds() {
        let mut head = Playhead::new(1.0, 5.0);
        head.apply(PlaybackCommand::Play);
        assert_eq!(head.apply(PlaybackCommand::Seek(99.0)), Some(SeekTarget::Nearest(5.0)));
        assert!(head.is_playing, "a jump goes on playing");
        assert_eq!(head.apply(PlaybackCommand::Show(-1.0)), Some(SeekTarget::NotBefore(1.0)));
        assert!(!head.is_playing, "an event is looked at");
        head.apply(PlaybackCommand::Play);
        assert_eq!(head.apply(PlaybackCommand::Step { forward: false }), Some(SeekTarget::Before(1.0)));
        assert!(!head.is_playing);
    }

    #[test]
    fn speeds_go_up_and_down_the_list_to_its_ends() {
        let mut head = Playhead::new(0.0, 1.0);
        assert_eq!((head.other_speed(true), head.other_speed(false)), (2.0, 0.5));
        for (requested, speed) in [(-3.0, 3.0), (0.0, 0.1), (1e9, 100.0), (f64::NAN, 1.0)] {
            head.apply(PlaybackCommand::Speed(requested));
            assert_eq!(head.speed, speed);
        }
        head.speed = 100.0;
        assert_eq!(head.other_speed(true), 100.0);
    }
}
