//! What has happened in a recorded run: its events, and who took a wheel.

use crate::record::Entry;
use crate::scenario::Rates;
use crate::snapshot::{EventKind, SimCommand, VehicleId};
use std::collections::BTreeSet;

/// Something that happened, at its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Simulated time.
    pub time_s: f64,
    pub vehicle: VehicleId,
    pub what: What,
}

#[derive(Clone, Debug, PartialEq)]
pub enum What {
    Event(EventKind),
    /// A person took its wheel.
    TakeOver,
    GiveBack,
}

/// What marks are told apart by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// It is there or not: spawn, moved, finish, remove, go.
    Usual,
    Stop,
    Yield,
    Merge,
    Person,
    /// Its link, or the sight of it, was lost or came back.
    Link,
    Collision,
}

impl What {
    pub fn kind(&self) -> Kind {
        match self {
            Self::TakeOver | Self::GiveBack => Kind::Person,
            Self::Event(event) => match event {
                EventKind::Collision { .. } | EventKind::CollisionStatic { .. } => Kind::Collision,
                EventKind::LinkLost | EventKind::LinkBack | EventKind::Unseen | EventKind::SeenAgain => {
                    Kind::Link
                }
                EventKind::Merge => Kind::Merge,
                EventKind::Yield => Kind::Yield,
                EventKind::Stop => Kind::Stop,
                EventKind::Spawn
                | EventKind::Moved { .. }
                | EventKind::Go { .. }
                | EventKind::Finish
                | EventKind::Remove => Kind::Usual,
            },
        }
    }

    /// In words.
    pub fn label(&self) -> String {
        let event = match self {
            Self::TakeOver => return "take-over".to_owned(),
            Self::GiveBack => return "given back".to_owned(),
            Self::Event(event) => event,
        };
        match event {
            EventKind::Spawn => "spawn".to_owned(),
            EventKind::Moved { behind, by_m } => format!("moved {by_m:.1} m behind {behind}"),
            EventKind::Stop => "stop".to_owned(),
            EventKind::Go { stood_s } => format!("go after {stood_s:.1} s"),
            EventKind::Yield => "yield".to_owned(),
            EventKind::Merge => "merge".to_owned(),
            EventKind::Collision { with } => format!("collision with {with}"),
            EventKind::CollisionStatic { with } => format!("collision with {with}"),
            EventKind::LinkLost => "link lost".to_owned(),
            EventKind::LinkBack => "link back".to_owned(),
            EventKind::Unseen => "unseen".to_owned(),
            EventKind::SeenAgain => "seen again".to_owned(),
            EventKind::Finish => "finish".to_owned(),
            EventKind::Remove => "removed".to_owned(),
        }
    }
}

/// Makes marks of what a log tells, in its order.
#[derive(Debug)]
pub(super) struct Marker {
    rates: Rates,
    /// At whose wheels persons are.
    driven: BTreeSet<VehicleId>,
}

impl Marker {
    pub(super) fn new(rates: Rates) -> Self {
        Self { rates, driven: BTreeSet::new() }
    }

    /// `None` for what is no news.
    pub(super) fn mark(&mut self, entry: &Entry) -> Option<Mark> {
        match entry {
            Entry::Event(event) => {
                let what = What::Event(event.kind.clone());
                Some(Mark { time_s: event.time_s, vehicle: event.vehicle, what })
            }
            Entry::Command { tick, command } => {
                let what = match *command {
                    SimCommand::Drive(vehicle, _) if self.driven.insert(vehicle) => What::TakeOver,
                    SimCommand::Release(vehicle) if self.driven.remove(&vehicle) => What::GiveBack,
                    _ => return None,
                };
                Some(Mark { time_s: self.rates.time_s(*tick), vehicle: command.vehicle()?, what })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::{Event, Pedals};

    #[test]
    fn of_the_pedals_of_a_person_only_taking_and_giving_back_are_marked() {
        let id = VehicleId(3);
        let mut marker = Marker::new(Rates::default());
        let mut mark = |tick, command| {
            marker.mark(&Entry::Command { tick, command }).map(|mark| (mark.time_s, mark.what))
        };
        let drive = |gas| SimCommand::Drive(id, Pedals { gas, ..Pedals::default() });
        assert_eq!(mark(150, drive(0.1)), Some((1.5, What::TakeOver)));
        assert_eq!(mark(160, drive(0.2)), None);
        assert_eq!(mark(250, SimCommand::Release(id)), Some((2.5, What::GiveBack)));
        assert_eq!(mark(251, SimCommand::Release(id)), None);
        assert_eq!(mark(300, drive(0.0)), Some((3.0, What::TakeOver)));
    }

    #[test]
    fn events_are_told_in_words_and_kinds() {
        let mut marker = Marker::new(Rates::default());
        let mut of = |kind| {
            let event = Event { time_s: 2.0, vehicle: VehicleId(1), kind };
            marker.mark(&Entry::Event(event)).map(|mark| (mark.what.label(), mark.what.kind()))
        };
        let collision = of(EventKind::Collision { with: VehicleId(7) });
        assert_eq!(collision, Some(("collision with 7".to_owned(), Kind::Collision)));
        assert_eq!(of(EventKind::Go { stood_s: 2.24 }), Some(("go after 2.2 s".to_owned(), Kind::Usual)));
        assert_eq!(of(EventKind::LinkBack), Some(("link back".to_owned(), Kind::Link)));
    }
}
