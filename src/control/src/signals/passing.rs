//! Who may pass a signal head: everybody on green, on yellow who cannot stop comfortably any more.

use super::{HeadState, Signals};
use crate::Cav;
use crate::right_of_way::{COMFORTABLE_BRAKING, FIRM_BRAKING};
use city3d_protocol::snapshot::{Aspect, SignalHeadId};

/// Whether a vehicle that has not been admitted may pass a head whose line is at `hold_s` of its route.
pub fn may_pass(cav: &Cav, hold_s: f64, head: HeadState) -> bool {
    match head.aspect {
        Aspect::Green => true,
        Aspect::Yellow => passes_on_yellow(cav, hold_s - cav.front_s(), head.left_s),
        Aspect::Red | Aspect::Dark => false,
    }
}

/// Whether a vehicle cannot stop comfortably, and reaches the line before red.
fn passes_on_yellow(cav: &Cav, to_line_m: f64, left_s: f64) -> bool {
    to_line_m < stopping_distance(cav, COMFORTABLE_BRAKING) && to_line_m <= cav.speed_mps() * left_s
}

/// Stopping distance at a share of full braking, after the response time.
fn stopping_distance(cav: &Cav, share: f64) -> f64 {
    cav.driver.stopping_distance(cav.speed_mps()) / share + cav.speed_mps() * cav.driver.response_time_s
}

/// An admitted vehicle before a line at which it has to wait.
#[derive(Clone, Copy)]
struct Revoked {
    head: SignalHeadId,
    to_line_m: f64,
}

/// Revokes the admissions of vehicles before a line whose green has ended and which can still stop, and of all behind
/// them in their lane, so that numbers keep the order of the lane.
pub fn revoke_admissions(cavs: &mut [Cav], signals: &Signals) {
    let mut revoked: Vec<Revoked> = Vec::new();
    for is_behind in [false, true] {
        for cav in cavs.iter_mut().filter(|cav| cav.is_on_route()) {
            let Some((position, head, to_line_m)) = first_before_line(cav) else { continue };
            let state = signals.head(head);
            if state.aspect == Aspect::Green {
                continue;
            }
            let goes = if is_behind {
                !revoked.iter().any(|other| other.head == head && other.to_line_m < to_line_m)
            } else {
                let makes_it = passes_on_yellow(cav, to_line_m, state.left_s);
                (state.aspect == Aspect::Yellow && makes_it)
                    || to_line_m < stopping_distance(cav, FIRM_BRAKING)
            };
            if !goes {
                cav.passage.revoke_from(position);
                revoked.push(Revoked { head, to_line_m });
            }
        }
    }
}

/// The first admission of a vehicle to a section whose signal head is ahead of it: its index, the head, and the
/// distance to the line.
fn first_before_line(cav: &Cav) -> Option<(usize, SignalHeadId, f64)> {
    let admissions = cav.passage.admissions.iter().enumerate();
    admissions
        .filter_map(|(position, admission)| {
            let section = &cav.route.sections[admission.section];
            Some((position, section.signal?, section.hold_s - cav.front_s()))
        })
        .find(|(.., to_line_m)| *to_line_m > 0.0)
}
