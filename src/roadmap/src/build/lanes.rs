//! Builds the lane graph: a lane is a maximal chain of pieces between branchings.

use super::network::{PieceGraph, Tangency};
use super::{DEFAULT_SPEED_MPS, LANE_WIDTH_M, place};
use crate::dxf::{Drawing, Entity};
use crate::error::{Diagnostics, MapErrorKind};
use crate::{Lane, LaneId, LaneKind};
use city3d_geometry::Lab;
use city3d_geometry::lab::{Curve, Segment};
use std::collections::BTreeMap;

/// The lane graph, with its end nodes and entity handles.
#[derive(Debug)]
pub(super) struct LaneGraph {
    /// By id; the ids follow the first piece of each in the file.
    pub lanes: Vec<Lane<Lab>>,
    /// By lane: the graph nodes where it starts and ends.
    pub nodes: Vec<[usize; 2]>,
    /// By lane: a handle or a line of the file that identifies it.
    pub handles: Vec<String>,
}

pub(super) fn build(network: &PieceGraph, drawing: &Drawing, diagnostics: &mut Diagnostics) -> LaneGraph {
    let count = network.pieces.len();
    let (out, into) = links(network);
    // The unique successor of a piece within one lane.
    let next: Vec<Option<usize>> = (0..count)
        .map(|p| match out[p].as_slice() {
            &[q] if into[q].len() == 1 && network.pieces[p].kind == network.pieces[q].kind => Some(q),
            _ => None,
        })
        .collect();
    let mut has_previous = vec![false; count];
    for &q in next.iter().flatten() {
        has_previous[q] = true;
    }

    let mut chains: Vec<Vec<usize>> = Vec::new();
    let mut chained = vec![false; count];
    // Open chains first; what remains are rings, which begin at their first piece.
    for rings in [false, true] {
        for start in 0..count {
            if chained[start] || (!rings && has_previous[start]) {
                continue;
            }
            let mut chain = Vec::new();
            let mut at = Some(start);
            while let Some(piece) = at.filter(|&p| !chained[p]) {
                chained[piece] = true;
                chain.push(piece);
                at = next[piece];
            }
            chains.push(chain);
        }
    }
    chains.sort_by_key(|chain| chain.iter().copied().min());
    let mut lane_of = vec![LaneId(0); count];
    for (id, chain) in (0..).zip(&chains) {
        for &piece in chain {
            lane_of[piece] = LaneId(id);
        }
    }

    let handles = handles(&chains, network, drawing);
    let mut nodes = Vec::with_capacity(chains.len());
    let mut lanes = Vec::with_capacity(chains.len());
    for ((id, chain), handle) in (0..).zip(&chains).zip(&handles) {
        let (first, last) = (chain[0], chain[chain.len() - 1]);
        let lane_ids = |pieces: &[usize]| {
            let mut ids: Vec<LaneId> = pieces.iter().map(|&p| lane_of[p]).collect();
            ids.sort_unstable();
            ids
        };
        nodes.push([network.node(2 * first), network.node(2 * last + 1)]);
        let segments: Vec<Segment> = chain.iter().map(|&p| network.pieces[p].segment).collect();
        lanes.push(Lane {
            id: LaneId(id),
            name: format!("lane-{handle}"),
            kind: network.pieces[first].kind,
            curve: Curve::new(segments),
            width_m: LANE_WIDTH_M,
            speed_limit_mps: DEFAULT_SPEED_MPS,
            successors: lane_ids(&out[last]),
            predecessors: lane_ids(&into[first]),
            left: None,
            right: None,
        });
    }
    report_ends(&lanes, diagnostics);
    LaneGraph { lanes, nodes, handles }
}

/// Successors and predecessors of each piece.
fn links(network: &PieceGraph) -> (Vec<Vec<usize>>, Vec<Vec<usize>>) {
    let mut out = vec![Vec::new(); network.pieces.len()];
    let mut into = vec![Vec::new(); network.pieces.len()];
    for node in 0..network.node_count() {
        let ends = network.ends_at(node);
        for &a in ends.iter().filter(|&&end| end % 2 == 1) {
            for &b in ends.iter().filter(|&&end| end % 2 == 0) {
                if network.relation(a, b) == Some(Tangency::Through) {
                    out[a / 2].push(b / 2);
                    into[b / 2].push(a / 2);
                }
            }
        }
    }
    (out, into)
}

/// The identifier of each chain: the handle of its first piece in the file, or the line of the file; numbered
/// where several lanes come from one entity.
fn handles(chains: &[Vec<usize>], network: &PieceGraph, drawing: &Drawing) -> Vec<String> {
    let entity_of = |chain: &Vec<usize>| chain.iter().min().map_or(0, |&piece| network.pieces[piece].entity);
    let mut uses: BTreeMap<usize, usize> = BTreeMap::new();
    for chain in chains {
        *uses.entry(entity_of(chain)).or_default() += 1;
    }
    let mut used: BTreeMap<usize, usize> = BTreeMap::new();
    let mut handles = Vec::with_capacity(chains.len());
    for chain in chains {
        let index = entity_of(chain);
        let base = match &drawing.entities[index] {
            Entity { handle, .. } if !handle.is_empty() => handle.clone(),
            Entity { line: 0, .. } => format!("entity-{index}"),
            Entity { line, .. } => format!("line-{line}"),
        };
        let number = used.entry(index).or_default();
        *number += 1;
        handles.push(if uses[&index] > 1 { format!("{base}.{number}") } else { base });
    }
    handles
}

/// Notes lanes without a predecessor or successor: the edge of a map, or a mistake.
fn report_ends(lanes: &[Lane<Lab>], diagnostics: &mut Diagnostics) {
    const SHOWN: usize = 5;
    let list = |ends: &[(&Lane<Lab>, glam::DVec2)]| {
        let mut places: Vec<String> = ends.iter().take(SHOWN).map(|(_, at)| place(*at)).collect();
        if ends.len() > SHOWN {
            places.push("...".to_owned());
        }
        places.join(", ")
    };
    let open: Vec<_> = lanes.iter().filter(|lane| lane.predecessors.is_empty()).collect();
    let dead: Vec<_> = lanes.iter().filter(|lane| lane.successors.is_empty()).collect();
    if !open.is_empty() {
        let places: Vec<_> = open.iter().map(|&lane| (lane, lane.curve.start().position)).collect();
        diagnostics.note_all(format!("{} lanes have no lane before them: {}", open.len(), list(&places)));
    }
    if !dead.is_empty() {
        let places: Vec<_> = dead.iter().map(|&lane| (lane, lane.curve.end().position)).collect();
        diagnostics.note_all(format!("{} lanes have no lane after them: {}", dead.len(), list(&places)));
    }
}

/// Reports names that two lanes share.
pub(super) fn check_names(
    roads: &LaneGraph,
    texts: &BTreeMap<usize, &Entity>,
    diagnostics: &mut Diagnostics,
) {
    let mut first: BTreeMap<&str, usize> = BTreeMap::new();
    for (k, lane) in roads.lanes.iter().enumerate() {
        let Some(&other) = first.get(lane.name.as_str()) else {
            first.insert(&lane.name, k);
            continue;
        };
        let ends = [other, k].map(|k| place(roads.lanes[k].curve.start().position));
        let message = format!("two lanes are named \"{}\", from {} and from {}", lane.name, ends[0], ends[1]);
        let remedy = "give each lane a name of its own";
        match texts.get(&k).or_else(|| texts.get(&other)) {
            Some(text) => diagnostics.error(MapErrorKind::Name, text, message, remedy),
            None => {
                let entity = format!("entity {}", roads.handles[k]);
                diagnostics.error_at(
                    MapErrorKind::Name,
                    1,
                    entity,
                    message,
                    "handles must be unique: save again",
                );
            }
        }
    }
}

/// Runs of road lanes in which each is the only successor of the one before, connectors left aside. Each run
/// is in driving order; a ring begins at its first lane.
pub(super) fn runs(lanes: &[Lane<Lab>]) -> Vec<Vec<usize>> {
    let only = |ids: &[LaneId]| {
        let mut roads = ids.iter().filter(|id| lanes[id.index()].kind == LaneKind::Lane);
        match (roads.next(), roads.next()) {
            (Some(&id), None) => Some(id.index()),
            _ => None,
        }
    };
    let is_road = |k: usize| lanes[k].kind == LaneKind::Lane;
    let next = |k: usize| {
        is_road(k)
            .then(|| only(&lanes[k].successors))
            .flatten()
            .filter(|&n| only(&lanes[n].predecessors) == Some(k))
    };
    let previous = |k: usize| {
        is_road(k)
            .then(|| only(&lanes[k].predecessors))
            .flatten()
            .filter(|&p| only(&lanes[p].successors) == Some(k))
    };
    let mut taken = vec![false; lanes.len()];
    let mut runs = Vec::new();
    for rings in [false, true] {
        for start in 0..lanes.len() {
            if taken[start] || (!rings && previous(start).is_some()) {
                continue;
            }
            let mut run = Vec::new();
            let mut at = Some(start);
            while let Some(k) = at.filter(|&k| !taken[k]) {
                taken[k] = true;
                run.push(k);
                at = next(k);
            }
            runs.push(run);
        }
    }
    runs
}
