//! Vehicles that do not go: those that stall although they were admitted, and those that a signal holds.

use super::{ASKS_AGAIN_S, Reservation, RightOfWay, STALLED_AFTER_S};
use crate::Cav;
use crate::signals::{self, Signals};
use city3d_protocol::snapshot::Aspect;

/// Revokes the admissions of a stalled vehicle to sections that it has not entered, so that nobody waits for
/// it. Vehicles that follow their plan start at once.
pub(super) fn revoke_stalled_admissions(now_s: f64, cav: &mut Cav) {
    let front_s = cav.front_s();
    let is_ahead = |admission: &Reservation| cav.route.sections[admission.section].from_s > front_s;
    let stands = cav.speed_mps() < crate::STANDS_MPS && cav.plan.acceleration_mps2 > 0.0;
    let first = cav.passage.admissions.iter().position(is_ahead).filter(|_| stands);
    let Some(first) = first else {
        cav.passage.stalled_since_s = None;
        return;
    };
    let since_s = *cav.passage.stalled_since_s.get_or_insert(now_s);
    if now_s - since_s > STALLED_AFTER_S {
        let passage = &mut cav.passage;
        passage.revoke_from(first);
        (passage.stalled_since_s, passage.asks_from_s) = (None, now_s + ASKS_AGAIN_S);
    }
}

impl RightOfWay {
    /// The nearest vehicle that has the right of way in the next section of another one, or is on its way through.
    pub(crate) fn holder(&self, vehicle: usize, cavs: &[Cav]) -> Option<usize> {
        let cav = &cavs[vehicle];
        let section = cav.route.sections.get(cav.passage.next_section)?;
        let crossings = cav.route.crossings[section.crossings.clone()].iter();
        let users = crossings.flat_map(|crossing| {
            let others = self.users[crossing.zone.index()].iter();
            others.filter(move |user| user.side != crossing.side && user.vehicle != vehicle)
        });
        let holds = |user: &&super::ZoneUser| {
            user.order.is_some() || !self.leaves_room(user, section.rank, &cavs[user.vehicle])
        };
        users.filter(holds).min_by(|a, b| a.to_entry_m.total_cmp(&b.to_entry_m)).map(|user| user.vehicle)
    }
}

/// Notes whether the signal at the next line holds a vehicle, and whether it has stood there through a green.
pub(super) fn note_signal(cav: &mut Cav, signals: &Signals) {
    let next = cav.route.sections.get(cav.passage.next_section);
    let held = next.and_then(|section| {
        let state = signals.head(section.signal?);
        (!signals::may_pass(cav, section.hold_s, state)).then_some(state.aspect)
    });
    let passage = &mut cav.passage;
    let stood_on_green = passage.standing_since_s.is_some() && !passage.is_held_by_signal;
    passage.missed_green |= stood_on_green && held == Some(Aspect::Yellow);
    passage.is_held_by_signal = held.is_some();
    if passage.is_held_by_signal {
        passage.blocked_since_s = None;
    }
}
