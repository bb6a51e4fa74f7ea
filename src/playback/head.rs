//! Where a recorded run is shown, and how that place moves.

use std::time::Instant;

/// Speeds that are offered, simulated seconds in a second.
pub const SPEEDS: [f64; 10] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];

/// What a player is told to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cue {
    /// Forwards at the present speed; from the start where it stands at the end.
    Play,
    /// The same backwards.
    Reverse,
    Pause,
    /// To the next recorded snapshot, or to the one before, and hold.
    Step {
        forward: bool,
    },
    /// To the recorded snapshot nearest to a time; goes on from there where it plays.
    Seek(f64),
    /// To the first recorded snapshot that is not before a time: the one that shows what happened then.
    Show(f64),
    /// Times real time, either way.
    Speed(f64),
}

/// A place that is wanted and not shown yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Aim {
    Nearest(f64),
    NotBefore(f64),
    After(f64),
    Before(f64),
}

/// Times that lie no further apart are the same, seconds.
pub(super) const SAME_S: f64 = 1e-6;

/// Where a recorded run is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playhead {
    /// Simulated times of the first and the last recorded snapshot.
    pub from_s: f64,
    pub to_s: f64,
    /// Simulated time that is shown.
    pub at_s: f64,
    /// That of the recorded snapshot before it.
    pub before_s: f64,
    pub is_playing: bool,
    pub is_reverse: bool,
    /// Simulated seconds in a second, whichever way.
    pub speed: f64,
}

impl Playhead {
    /// Stands at the first snapshot.
    pub(super) fn new(from_s: f64, to_s: f64) -> Self {
        Self {
            from_s,
            to_s,
            at_s: from_s,
            before_s: from_s,
            is_playing: false,
            is_reverse: false,
            speed: 1.0,
        }
    }

    /// Simulated seconds in a second, negative backwards.
    pub fn rate(&self) -> f64 {
        if self.is_reverse { -self.speed } else { self.speed }
    }

    pub fn is_at_start(&self) -> bool {
        self.at_s <= self.from_s + SAME_S
    }

    pub fn is_at_end(&self) -> bool {
        self.at_s >= self.to_s - SAME_S
    }

    /// Where it is to be after playing for some seconds; it goes no further than the ends.
    pub(super) fn after(&self, seconds: f64) -> f64 {
        (self.at_s + self.rate() * seconds).clamp(self.from_s, self.to_s)
    }

    /// Does what can be done at once; what has to be looked up in the log comes back.
    pub(super) fn obey(&mut self, cue: Cue) -> Option<Aim> {
        let within = |time_s: f64| time_s.clamp(self.from_s, self.to_s);
        match cue {
            Cue::Play | Cue::Reverse => {
                self.is_reverse = cue == Cue::Reverse;
                self.is_playing = self.from_s < self.to_s;
                let (is_over, start_s) = if self.is_reverse {
                    (self.is_at_start(), self.to_s)
                } else {
                    (self.is_at_end(), self.from_s)
                };
                is_over.then_some(Aim::Nearest(start_s))
            }
            Cue::Pause => {
                self.is_playing = false;
                Some(Aim::Nearest(self.at_s))
            }
            Cue::Step { forward } => {
                self.is_playing = false;
                Some(if forward { Aim::After(self.at_s) } else { Aim::Before(self.at_s) })
            }
            Cue::Seek(time_s) => Some(Aim::Nearest(within(time_s))),
            Cue::Show(time_s) => Some(Aim::NotBefore(within(time_s))),
            Cue::Speed(speed) => {
                let [slowest, .., fastest] = SPEEDS;
                self.speed = if speed.is_finite() { speed.abs().clamp(slowest, fastest) } else { 1.0 };
                None
            }
        }
    }

    /// Where it is told to be, before that is looked up: what the next cue of the same pass goes by.
    pub fn foresee(&mut self, cue: Cue) {
        match self.obey(cue) {
            Some(Aim::Nearest(time_s) | Aim::NotBefore(time_s)) => self.at_s = time_s,
            Some(Aim::After(_) | Aim::Before(_)) | None => {}
        }
    }

    /// The next speed up or down the list.
    pub fn other_speed(&self, faster: bool) -> f64 {
        let next = if faster {
            SPEEDS.iter().find(|speed| **speed > self.speed * 1.001)
        } else {
            SPEEDS.iter().rev().find(|speed| **speed < self.speed * 0.999)
        };
        next.copied().unwrap_or(self.speed)
    }
}

/// Seconds that have gone by between passes; a pass that came late is not made good.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ticker(Option<Instant>);

/// What a pass takes at most, as far as playing is concerned.
const LONGEST_PASS_S: f64 = 0.25;

impl Ticker {
    pub(super) fn stopped() -> Self {
        Self(None)
    }

    pub(super) fn pass(&mut self, now: Instant) -> f64 {
        let before = self.0.replace(now).unwrap_or(now);
        now.saturating_duration_since(before).as_secs_f64().min(LONGEST_PASS_S)
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
        assert_eq!(head.obey(Cue::Speed(2.0)), None);
        assert_eq!(head.obey(Cue::Play), None);
        assert!(head.is_playing);
        assert_eq!(head.after(3.0), 6.0);
        assert_eq!(head.after(300.0), 40.0);
        head.at_s = 10.0;
        head.obey(Cue::Reverse);
        assert_eq!((head.after(3.0), head.after(30.0), head.rate()), (4.0, 0.0, -2.0));
    }

    #[test]
    fn at_an_end_it_begins_again_at_the_other() {
        let mut head = Playhead::new(0.0, 40.0);
        assert_eq!(head.obey(Cue::Reverse), Some(Aim::Nearest(40.0)));
        head.at_s = 40.0;
        assert_eq!(head.obey(Cue::Reverse), None);
        assert_eq!(head.obey(Cue::Play), Some(Aim::Nearest(0.0)));
    }

    #[test]
    fn cues_of_one_pass_go_by_those_before() {
        let mut head = Playhead::new(0.0, 40.0);
        for _ in 0..2 {
            head.foresee(Cue::Seek(head.at_s + 5.0));
            head.foresee(Cue::Speed(head.other_speed(true)));
        }
        assert_eq!((head.at_s, head.speed), (10.0, 5.0));
    }

    #[test]
    fn a_log_of_one_snapshot_does_not_play() {
        let mut head = Playhead::new(3.0, 3.0);
        head.obey(Cue::Play);
        assert!(!head.is_playing);
    }

    #[test]
    fn seeking_stays_inside_and_stepping_holds() {
        let mut head = Playhead::new(1.0, 5.0);
        head.obey(Cue::Play);
        assert_eq!(head.obey(Cue::Seek(99.0)), Some(Aim::Nearest(5.0)));
        assert_eq!(head.obey(Cue::Show(-1.0)), Some(Aim::NotBefore(1.0)));
        assert!(head.is_playing, "a jump goes on playing");
        assert_eq!(head.obey(Cue::Step { forward: false }), Some(Aim::Before(1.0)));
        assert!(!head.is_playing);
    }

    #[test]
    fn speeds_go_up_and_down_the_list_to_its_ends() {
        let mut head = Playhead::new(0.0, 1.0);
        assert_eq!((head.other_speed(true), head.other_speed(false)), (2.0, 0.5));
        for (asked, speed) in [(-3.0, 3.0), (0.0, 0.1), (1e9, 100.0), (f64::NAN, 1.0)] {
            head.obey(Cue::Speed(asked));
            assert_eq!(head.speed, speed);
        }
        head.speed = 100.0;
        assert_eq!(head.other_speed(true), 100.0);
    }
}
