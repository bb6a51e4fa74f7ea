//! Cuts centre lines into lanes at their branchings, marks connectors, and names the lanes.

use super::path::Fillet;
use city3d_geometry::lab::{Curve, Segment};
use city3d_roadmap::ControlLineKind;
use glam::DVec2;

/// Lane width, laboratory metres.
pub(super) const LANE_WIDTH: f64 = 0.1524;
/// The usual target speed of the testbed, for connectors and for lanes that bend from end to end.
pub(super) const BEND_SPEED: f64 = 0.35;
/// Distance of a stop or yield line from the junction.
pub(super) const LINE_SETBACK: f64 = 0.015;

/// A span of a centre line that crosses a junction.
#[derive(Clone, Debug)]
struct JunctionSpan {
    from_s: f64,
    to_s: f64,
    name: String,
}

/// A designed centre line: a whole lane of a road, or a turn.
#[derive(Clone, Debug)]
pub(super) struct CentreLine {
    pub(super) name: String,
    pub(super) curve: Curve,
    pub(super) speed_mps: Option<f64>,
    crossings: Vec<JunctionSpan>,
}

/// A turn that the layout omits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OmittedTurn {
    /// "junction-centre-south/north-to-east".
    pub turn: String,
    pub reason: String,
}

/// A stop or yield line of the design.
#[derive(Clone, Copy, Debug)]
pub(super) struct DraftControlLine {
    pub(super) kind: ControlLineKind,
    pub(super) ends: [DVec2; 2],
}

/// A lane of the design: a chain of segments without branching.
#[derive(Clone, Debug)]
pub(super) struct DraftLane {
    pub(super) name: String,
    pub(super) connector: bool,
    pub(super) speed_mps: Option<f64>,
    pub(super) curve: Curve,
}

#[derive(Clone, Debug, Default)]
pub(super) struct RoadNetwork {
    pub(super) centre_lines: Vec<CentreLine>,
    pub(super) lines: Vec<DraftControlLine>,
    pub(super) omitted: Vec<OmittedTurn>,
}

/// A part of a centre line between two cuts.
struct CentreLinePiece {
    track: usize,
    segments: Curve,
    /// The junction span that it belongs to.
    crossing: Option<String>,
}

impl CentreLinePiece {
    fn leads_to(&self, next: &Self) -> bool {
        let (end, start) = (self.segments.end(), next.segments.start());
        end.position.distance(start.position) < 1e-7 && end.forward().dot(start.forward()) > 1.0 - 1e-9
    }
}

impl RoadNetwork {
    pub(super) fn add(&mut self, name: &str, speed_mps: Option<f64>, curve: Curve) {
        self.centre_lines.push(CentreLine { name: name.to_owned(), curve, speed_mps, crossings: Vec::new() });
    }

    /// # Panics
    /// If the tables name a centre line that does not exist.
    pub(super) fn track(&self, name: &str) -> usize {
        let found = self.centre_lines.iter().position(|track| track.name == name);
        found.unwrap_or_else(|| panic!("no centre line is called {name}"))
    }

    pub(super) fn curve(&self, name: &str) -> &Curve {
        &self.centre_lines[self.track(name)].curve
    }

    pub(super) fn add_turn(&mut self, name: String, speed_mps: f64, fillet: &Fillet) {
        let length = fillet.arc.length;
        let crossings = vec![JunctionSpan { from_s: 0.0, to_s: length, name: name.clone() }];
        let curve = Curve::new(vec![fillet.arc]);
        self.centre_lines.push(CentreLine { name, curve, speed_mps: Some(speed_mps), crossings });
    }

    /// Marks a part of a centre line as a connector.
    pub(super) fn cross(&mut self, track: &str, from_s: f64, to_s: f64, name: String) {
        let index = self.track(track);
        self.centre_lines[index].crossings.push(JunctionSpan { from_s, to_s, name });
    }

    /// Adds a control line across a centre line, a little before the junction that starts at arc length `s`.
    pub(super) fn line(&mut self, kind: ControlLineKind, track: &str, s: f64) {
        let pose = self.curve(track).at(s - LINE_SETBACK).pose;
        let ends = [0.5, -0.5].map(|side| pose.point_at(0.0, side * LANE_WIDTH));
        self.lines.push(DraftControlLine { kind, ends });
    }

    /// Adds a yield line, and marks the rest of the centre line as the connector into the priority traffic.
    /// The line is as late as it is still `clear_m` away from the others.
    pub(super) fn yield_before(&mut self, track: &str, others: &[&str], clear_m: f64, name: &str) {
        let curve = self.curve(track).clone();
        let others: Vec<&Curve> = others.iter().map(|other| self.curve(other)).collect();
        let steps = (curve.length() / 1e-3) as usize;
        let backwards = (0..steps).map(|k| curve.length() - k as f64 * 1e-3);
        let near = |s: f64| {
            let at = curve.at(s).pose.position;
            others.iter().any(|o| o.at(o.project(at).s).pose.position.distance(at) < clear_m)
        };
        let s = backwards.take_while(|&s| near(s)).last().unwrap_or(curve.length()) - 1e-3;
        self.yield_at(track, s, name);
    }

    pub(super) fn yield_at(&mut self, track: &str, s: f64, name: &str) {
        let length = self.curve(track).length();
        self.line(ControlLineKind::Yield, track, s + LINE_SETBACK);
        self.cross(track, s + LINE_SETBACK, length, name.to_owned());
    }

    /// Marks the start of a centre line as a connector out of a junction, until it is `clear_m` away from the
    /// others.
    pub(super) fn leave(&mut self, track: &str, others: &[&str], clear_m: f64, name: &str) {
        let curve = self.curve(track).clone();
        let others: Vec<&Curve> = others.iter().map(|other| self.curve(other)).collect();
        let near = |s: f64| {
            let at = curve.at(s).pose.position;
            others.iter().any(|o| o.at(o.project(at).s).pose.position.distance(at) < clear_m)
        };
        let steps = (curve.length() / 1e-3) as usize;
        let s = (0..steps).map(|k| k as f64 * 1e-3).take_while(|&s| near(s)).last().unwrap_or(0.0) + 1e-3;
        self.cross(track, 0.0, s, name.to_owned());
    }

    /// All cuts of a centre line: its ends, the ends of other centre lines on it, and those of its junction
    /// spans.
    fn cuts(&self, index: usize) -> Vec<f64> {
        let track = &self.centre_lines[index];
        let length = track.curve.length();
        let mut cuts = vec![0.0, length];
        cuts.extend(track.crossings.iter().flat_map(|c| [c.from_s, c.to_s]));
        for (k, other) in self.centre_lines.iter().enumerate() {
            if k == index {
                continue;
            }
            for pose in [other.curve.start(), other.curve.end()] {
                let s = track.curve.project(pose.position).s;
                let foot = track.curve.at(s).pose;
                let meets = foot.position.distance(pose.position) < 1e-7;
                if meets && foot.forward().dot(pose.forward()) > 1.0 - 1e-9 {
                    cuts.push(s);
                }
            }
        }
        cuts.sort_by(f64::total_cmp);
        // Snapped to the ends, so that rounding leaves no sliver.
        cuts.iter_mut().for_each(|s| {
            if *s < 1e-6 {
                *s = 0.0;
            } else if *s > length - 1e-6 {
                *s = length;
            }
        });
        cuts.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
        cuts
    }

    fn pieces(&self) -> Vec<CentreLinePiece> {
        let mut pieces = Vec::new();
        for (index, track) in self.centre_lines.iter().enumerate() {
            for cut in self.cuts(index).windows(2) {
                let middle = (cut[0] + cut[1]) / 2.0;
                let inside = track.crossings.iter().find(|c| (c.from_s..c.to_s).contains(&middle));
                pieces.push(CentreLinePiece {
                    track: index,
                    segments: track.curve.slice(cut[0], cut[1]),
                    crossing: inside.map(|c| c.name.clone()),
                });
            }
        }
        prune(&mut pieces);
        pieces
    }

    /// The lanes, by centre line and in driving order. Dead ends, drawn beyond the last turn of a junction,
    /// are pruned.
    pub(super) fn lanes(&self) -> Vec<DraftLane> {
        let pieces = self.pieces();
        let next: Vec<Vec<usize>> = pieces
            .iter()
            .map(|piece| (0..pieces.len()).filter(|&k| piece.leads_to(&pieces[k])).collect())
            .collect();
        let mut arrivals = vec![0; pieces.len()];
        next.iter().flatten().for_each(|&k| arrivals[k] += 1);
        let goes_on = |k: usize| match next[k][..] {
            [only] if arrivals[only] == 1 => {
                (pieces[only].crossing.is_some() == pieces[k].crossing.is_some()).then_some(only)
            }
            _ => None,
        };
        let continued: Vec<usize> = (0..pieces.len()).filter_map(goes_on).collect();
        let mut runs: Vec<(String, DraftLane)> = Vec::new();
        for first in (0..pieces.len()).filter(|k| !continued.contains(k)) {
            let mut chain = vec![first];
            while let Some(k) = goes_on(chain[chain.len() - 1]) {
                chain.push(k);
            }
            let longest = chain
                .iter()
                .copied()
                .reduce(|a, b| if pieces[b].segments.length() > pieces[a].segments.length() { b } else { a });
            let chief = &pieces[longest.unwrap_or(first)];
            let track = &self.centre_lines[chief.track];
            let segments: Vec<Segment> =
                chain.iter().flat_map(|&k| pieces[k].segments.segments().to_vec()).collect();
            let base = chief.crossing.clone().unwrap_or_else(|| track.name.clone());
            let (connector, curve) = (chief.crossing.is_some(), Curve::new(segments));
            let bends = curve.min_radius(0.0, curve.length()).is_finite();
            let speed_mps = track.speed_mps.or((connector && bends).then_some(BEND_SPEED));
            let run = DraftLane { name: String::new(), connector, speed_mps, curve };
            runs.push((base, run));
        }
        number(runs)
    }
}

/// Removes dead ends until every piece has a predecessor and a successor.
fn prune(pieces: &mut Vec<CentreLinePiece>) {
    loop {
        let whole = |k: usize| {
            let piece = &pieces[k];
            pieces.iter().any(|other| other.leads_to(piece)) && pieces.iter().any(|o| piece.leads_to(o))
        };
        let keep: Vec<bool> = (0..pieces.len()).map(whole).collect();
        if keep.iter().all(|&k| k) {
            return;
        }
        let mut kept = keep.into_iter();
        pieces.retain(|_| kept.next().unwrap_or(false));
    }
}

/// Numbers lanes of a road in driving order, and connectors that share a name.
fn number(runs: Vec<(String, DraftLane)>) -> Vec<DraftLane> {
    let bases: Vec<String> = runs.iter().map(|(base, _)| base.clone()).collect();
    let mut numbered = Vec::with_capacity(runs.len());
    for (k, (base, run)) in runs.into_iter().enumerate() {
        let place = bases[..k].iter().filter(|&other| *other == base).count() + 1;
        let alone = run.connector && bases.iter().filter(|&other| *other == base).count() == 1;
        let name = if alone { base } else { format!("{base}/{place}") };
        numbered.push(DraftLane { name, ..run });
    }
    numbered
}
