//! Events of a recorded run for the timeline: logged events, and take-overs by a person.

use crate::LONG_STOP_S;
use city3d_logbook::record::LogEntry;
use city3d_protocol::snapshot::{ControlDecision, DecisionReason, Event, EventKind, SimCommand, VehicleId};
use city3d_simulation::scenario::{Experiment, Rates};
use std::collections::{BTreeMap, BTreeSet};

/// An event on the timeline.
#[derive(Clone, Debug, PartialEq)]
pub struct TimelineMark {
    /// Simulated time.
    pub time_s: f64,
    /// The vehicle that it concerns.
    pub vehicle: VehicleId,
    /// The logged event, or the change of the driver.
    pub what: Occurrence,
}

/// What happened to a vehicle of a recorded run.
#[derive(Clone, Debug, PartialEq)]
pub enum Occurrence {
    /// An event that the run has logged.
    Event(EventKind),
    /// It began to give way to this vehicle, as the control framework has told.
    YieldTo(VehicleId),
    /// It began to give way there, and to no vehicle that the control framework has told.
    YieldAt(DecisionReason),
    /// A person took control of the vehicle.
    TakeOver,
    /// The person handed the vehicle back to its control algorithm.
    GiveBack,
    /// It has stood for [`LONG_STOP_S`](crate::LONG_STOP_S) where it should be on its way.
    LongStop,
    /// It has left the road, by its poses.
    LeftRoad,
    /// It has left where it stood after a collision: it was pushed, or a person drives it.
    Displaced {
        /// How long it had stood.
        stood_s: f64,
    },
}

/// The class of an event, in rising order of severity: it sets the colour of the mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MarkKind {
    /// Spawn, moved, finish, remove, go.
    Usual,
    /// It came to a stop.
    Stop,
    /// It began to give way.
    Yield,
    /// It passed the point where lanes merge.
    Merge,
    /// A person took control or handed it back.
    Person,
    /// It has stood for a long time.
    LongStop,
    /// It has left the road.
    LeftRoad,
    /// Its link, or the sight of it, was lost or came back.
    Link,
    /// It collided with a vehicle or a static obstacle.
    Collision,
}

impl Occurrence {
    /// Class that sets the colour of the mark.
    pub fn kind(&self) -> MarkKind {
        match self {
            Self::TakeOver | Self::GiveBack => MarkKind::Person,
            Self::Displaced { .. } => MarkKind::Usual,
            Self::LongStop => MarkKind::LongStop,
            Self::LeftRoad => MarkKind::LeftRoad,
            Self::YieldTo(_) | Self::YieldAt(_) => MarkKind::Yield,
            Self::Event(event) => match event {
                EventKind::Collision { .. } | EventKind::CollisionStatic { .. } => MarkKind::Collision,
                EventKind::LinkLost | EventKind::LinkBack | EventKind::Unseen | EventKind::SeenAgain => {
                    MarkKind::Link
                }
                EventKind::Merge => MarkKind::Merge,
                EventKind::Yield => MarkKind::Yield,
                EventKind::Stop => MarkKind::Stop,
                EventKind::Spawn
                | EventKind::Moved { .. }
                | EventKind::Go { .. }
                | EventKind::Finish
                | EventKind::Remove => MarkKind::Usual,
            },
        }
    }

    /// Whether it is reported at once: a collision, a long stop, a lost link, a vehicle that leaves the road.
    pub fn is_grave(&self) -> bool {
        match self {
            Self::LongStop | Self::LeftRoad => true,
            Self::Event(event) => event.is_collision() || *event == EventKind::LinkLost,
            Self::TakeOver
            | Self::GiveBack
            | Self::YieldTo(_)
            | Self::YieldAt(_)
            | Self::Displaced { .. } => false,
        }
    }

    /// The event in words.
    pub fn label(&self) -> String {
        let event = match self {
            Self::TakeOver => return "take-over".to_owned(),
            Self::GiveBack => return "given back".to_owned(),
            Self::LongStop => return format!("stood for {LONG_STOP_S:.0} s"),
            Self::LeftRoad => return "left the road".to_owned(),
            Self::Displaced { stood_s } => return format!("moved, stood for {stood_s:.1} s"),
            Self::YieldTo(other) => return format!("yield to {other}"),
            Self::YieldAt(reason) => return format!("yield{}", place_of(*reason)),
            Self::Event(event) => event,
        };
        match event {
            EventKind::Spawn => "spawn".to_owned(),
            EventKind::Moved { behind, by_m } => format!("moved {by_m:.1} m behind {behind}"),
            EventKind::Stop => "standstill".to_owned(),
            EventKind::Go { stood_s } => format!("go, stood for {stood_s:.1} s"),
            EventKind::Yield => "yield".to_owned(),
            EventKind::Merge => "passed a merge".to_owned(),
            EventKind::Collision { with } => format!("collision with {with}"),
            EventKind::CollisionStatic { with } => format!("collision with {with}"),
            EventKind::LinkLost => "link lost".to_owned(),
            EventKind::LinkBack => "link back".to_owned(),
            EventKind::Unseen => "not tracked".to_owned(),
            EventKind::SeenAgain => "tracked again".to_owned(),
            EventKind::Finish => "finish".to_owned(),
            EventKind::Remove => "removed".to_owned(),
        }
    }
}

impl From<&Event> for TimelineMark {
    fn from(event: &Event) -> Self {
        let what = Occurrence::Event(event.kind.clone());
        Self { time_s: event.time_s, vehicle: event.vehicle, what }
    }
}

impl TimelineMark {
    /// The event of a vehicle that has collided, or of one that has not: a wreck does not set off.
    pub(crate) fn of_event(event: &Event, has_collided: bool) -> Self {
        match event.kind {
            EventKind::Go { stood_s } if has_collided => {
                let what = Occurrence::Displaced { stood_s };
                Self { time_s: event.time_s, vehicle: event.vehicle, what }
            }
            _ => event.into(),
        }
    }
}

/// At what a vehicle gives way, as the end of an event in words; empty for reasons that are none to give way.
fn place_of(reason: DecisionReason) -> &'static str {
    match reason {
        DecisionReason::StopLine => " at its stop line",
        DecisionReason::YieldLine => " at its yield line",
        DecisionReason::Signal => " at its signal",
        DecisionReason::Junction => " at a junction",
        DecisionReason::NoRoom => ": no room behind the junction",
        DecisionReason::Crossing => " at a crossing of lanes",
        DecisionReason::Merging => " at a merge",
        _ => "",
    }
}

/// Names whom a vehicle yields to, by the first of its decisions that does; where none does, at what.
pub(crate) fn with_priority<'a>(
    mark: &mut TimelineMark,
    of_vehicle: impl Iterator<Item = &'a ControlDecision>,
) {
    use DecisionReason::{Crossing, Junction, Merging, StopLine, YieldLine};
    if mark.what != Occurrence::Event(EventKind::Yield) {
        return;
    }
    let mut place = None;
    for decision in of_vehicle.filter(|decision| !place_of(decision.reason).is_empty()) {
        let is_for_others = matches!(decision.reason, StopLine | YieldLine | Junction | Crossing | Merging);
        if let Some(other) = decision.other.filter(|_| is_for_others) {
            mark.what = Occurrence::YieldTo(other);
            return;
        }
        place = place.or(Some(decision.reason));
    }
    if let Some(reason) = place {
        mark.what = Occurrence::YieldAt(reason);
    }
}

/// Finds the changes between persons and algorithms in the commands of a run.
#[derive(Debug, Default)]
pub(crate) struct DriverChanges {
    /// Vehicles that persons drive.
    driven: BTreeSet<VehicleId>,
}

impl DriverChanges {
    /// A command by which a person drives a vehicle or gives it back; `None` where that changes nothing.
    pub(crate) fn mark(&mut self, time_s: f64, vehicle: VehicleId, drives: bool) -> Option<TimelineMark> {
        let (changes, what) = if drives {
            (self.driven.insert(vehicle), Occurrence::TakeOver)
        } else {
            (self.driven.remove(&vehicle), Occurrence::GiveBack)
        };
        changes.then_some(TimelineMark { time_s, vehicle, what })
    }

    /// As [`Self::mark`] for any command.
    pub(crate) fn mark_command(&mut self, time_s: f64, command: &SimCommand) -> Option<TimelineMark> {
        match *command {
            SimCommand::Drive(vehicle, _) => self.mark(time_s, vehicle, true),
            SimCommand::Release(vehicle) => self.mark(time_s, vehicle, false),
            _ => None,
        }
    }
}

/// Turns log entries, in their order, into timeline marks.
#[derive(Debug)]
pub(super) struct MarkCollector {
    rates: Rates,
    drivers: DriverChanges,
    /// When vehicles stopped that still stand.
    stopped: BTreeMap<VehicleId, f64>,
    /// Vehicles of the laboratory, which feel nothing of a collision with a virtual one.
    physical: BTreeSet<VehicleId>,
    /// Vehicles that have collided, which stand from then on, wherever they are pushed.
    collided: BTreeSet<VehicleId>,
}

impl MarkCollector {
    /// Of the log of an experiment.
    pub(super) fn of(experiment: &Experiment) -> Self {
        Self::new(experiment.rates, experiment.physical().map(|(planned, _)| planned.id).collect())
    }

    fn new(rates: Rates, physical: BTreeSet<VehicleId>) -> Self {
        Self {
            rates,
            drivers: DriverChanges::default(),
            stopped: BTreeMap::new(),
            physical,
            collided: BTreeSet::new(),
        }
    }

    /// The marks of an entry: none for one that is no event, two where it ends a long stop.
    pub(super) fn marks(&mut self, entry: &LogEntry) -> Vec<TimelineMark> {
        match entry {
            LogEntry::Event(event) => {
                let has_collided = self.collided.contains(&event.vehicle);
                let mut marks = vec![TimelineMark::of_event(event, has_collided)];
                marks.extend(self.long_stop(event));
                marks
            }
            LogEntry::Command { tick, command } => {
                let mark = self.drivers.mark_command(self.rates.time_s(*tick), command);
                if let Some(mark) = &mark {
                    self.stopped.remove(&mark.vehicle);
                }
                mark.into_iter().collect()
            }
            _ => Vec::new(),
        }
    }

    /// The long stop that an event ends. What ends a stop otherwise than by moving off makes it none.
    fn long_stop(&mut self, event: &Event) -> Option<TimelineMark> {
        match event.kind {
            EventKind::Stop => {
                if !self.collided.contains(&event.vehicle) {
                    self.stopped.insert(event.vehicle, event.time_s);
                }
                None
            }
            // An occlusion neither starts nor ends a stand.
            EventKind::Yield
            | EventKind::LinkLost
            | EventKind::LinkBack
            | EventKind::Unseen
            | EventKind::SeenAgain => None,
            EventKind::Go { .. } => {
                let since_s = self.stopped.remove(&event.vehicle)?;
                long_stop(event.vehicle, since_s, event.time_s)
            }
            EventKind::Collision { with } => self.wreck(&[event.vehicle, with]),
            EventKind::CollisionStatic { .. } => self.wreck(&[event.vehicle]),
            EventKind::Spawn | EventKind::Remove => {
                self.collided.remove(&event.vehicle);
                self.stopped.remove(&event.vehicle);
                None
            }
            _ => {
                self.stopped.remove(&event.vehicle);
                None
            }
        }
    }

    /// Virtual vehicles that have collided: theirs is no stop.
    fn wreck(&mut self, vehicles: &[VehicleId]) -> Option<TimelineMark> {
        for id in vehicles.iter().filter(|id| !self.physical.contains(id)) {
            self.stopped.remove(id);
            self.collided.insert(*id);
        }
        None
    }

    /// Long stops that go on at the end of the log.
    pub(super) fn finish(&mut self, end_s: f64) -> Vec<TimelineMark> {
        let stopped = std::mem::take(&mut self.stopped);
        stopped.into_iter().filter_map(|(vehicle, since_s)| long_stop(vehicle, since_s, end_s)).collect()
    }
}

fn long_stop(vehicle: VehicleId, since_s: f64, to_s: f64) -> Option<TimelineMark> {
    let time_s = since_s + LONG_STOP_S;
    (time_s <= to_s).then_some(TimelineMark { time_s, vehicle, what: Occurrence::LongStop })
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::Pedals;

    #[test]
    fn of_the_pedals_of_a_person_only_taking_and_giving_back_are_marked() {
        let id = VehicleId(3);
        let mut marker = MarkCollector::new(Rates::default(), BTreeSet::new());
        let mut mark = |tick, command| {
            let marks = marker.marks(&LogEntry::Command { tick, command });
            marks.first().map(|mark| (mark.time_s, mark.what.clone()))
        };
        let drive = |gas| SimCommand::Drive(id, Pedals { gas, ..Pedals::default() });
        assert_eq!(mark(150, drive(0.1)), Some((1.5, Occurrence::TakeOver)));
        assert_eq!(mark(160, drive(0.2)), None);
        assert_eq!(mark(250, SimCommand::Release(id)), Some((2.5, Occurrence::GiveBack)));
        assert_eq!(mark(251, SimCommand::Release(id)), None);
        assert_eq!(mark(300, drive(0.0)), Some((3.0, Occurrence::TakeOver)));
    }

    #[test]
    fn events_are_told_in_words_and_kinds() {
        let mut marker = MarkCollector::new(Rates::default(), BTreeSet::new());
        let mut of = |kind| {
            let event = Event { time_s: 2.0, vehicle: VehicleId(1), kind };
            let marks = marker.marks(&LogEntry::Event(event));
            marks.first().map(|mark| (mark.what.label(), mark.what.kind()))
        };
        assert_eq!(
            of(EventKind::Go { stood_s: 2.24 }),
            Some(("go, stood for 2.2 s".to_owned(), MarkKind::Usual))
        );
        let collision = of(EventKind::Collision { with: VehicleId(7) });
        assert_eq!(collision, Some(("collision with 7".to_owned(), MarkKind::Collision)));
        assert_eq!(of(EventKind::LinkBack), Some(("link back".to_owned(), MarkKind::Link)));
        assert_eq!(
            of(EventKind::Go { stood_s: 2.24 }),
            Some(("moved, stood for 2.2 s".to_owned(), MarkKind::Usual)),
            "it has collided: it is pushed, or a person drives it"
        );
    }

    #[test]
    fn a_vehicle_yields_to_another_one_or_at_a_place() {
        let decision = |reason, other: Option<u32>| {
            let (vehicle, other) = (VehicleId(1), other.map(VehicleId));
            ControlDecision { vehicle, reason, other, ..ControlDecision::default() }
        };
        let told = |decisions: &[ControlDecision]| {
            let what = Occurrence::Event(EventKind::Yield);
            let mut mark = TimelineMark { time_s: 2.0, vehicle: VehicleId(1), what };
            with_priority(&mut mark, decisions.iter());
            assert_eq!(mark.what.kind(), MarkKind::Yield);
            mark.what.label()
        };
        let (line, leader) =
            (decision(DecisionReason::YieldLine, None), decision(DecisionReason::Leader, Some(3)));
        let crossing = decision(DecisionReason::Crossing, Some(4));
        assert_eq!(told(&[leader, line]), "yield at its yield line");
        assert_eq!(told(&[line, crossing]), "yield to 4", "a vehicle says more");
        assert_eq!(told(&[leader]), "yield");
    }

    #[test]
    fn stops_of_half_a_minute_are_found_in_the_events_of_a_log() {
        let mut marker = MarkCollector::new(Rates::default(), [VehicleId(7)].into());
        let mut found = Vec::new();
        let mut take = |time_s, id, kind| {
            let entry = LogEntry::Event(Event { time_s, vehicle: VehicleId(id), kind });
            let marks = marker.marks(&entry).into_iter().filter(|mark| mark.what == Occurrence::LongStop);
            found.extend(marks.map(|mark| (mark.time_s, mark.vehicle.0)));
        };
        (1..=8).for_each(|id| take(2.0, id, EventKind::Stop));
        take(20.0, 8, EventKind::Collision { with: VehicleId(7) });
        take(20.5, 8, EventKind::Go { stood_s: 18.5 });
        take(21.0, 8, EventKind::Stop);
        take(20.0, 6, EventKind::Unseen);
        take(21.0, 6, EventKind::SeenAgain);
        take(12.0, 1, EventKind::Go { stood_s: 10.0 });
        take(40.0, 2, EventKind::Go { stood_s: 38.0 });
        take(40.0, 3, EventKind::Finish);
        take(50.0, 5, EventKind::Stop);
        found.extend(marker.finish(60.0).into_iter().map(|mark| (mark.time_s, mark.vehicle.0)));
        assert_eq!(
            found,
            [(32.0, 2), (32.0, 4), (32.0, 6), (32.0, 7)],
            "neither an occlusion nor who runs into a lab vehicle ends a stand, and who has collided makes none"
        );
    }
}
