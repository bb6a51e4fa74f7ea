//! Phases and times of a signal: stated, by Webster's formula, or actuated.

use super::approaches::Approaches;
use crate::scenario::fields::{TableFields, number_of, one_of};
use city3d_control::{
    ActuatedControl, CountedControl, DriverParams, SignalControl, SignalPhase, SignalPlan, WebsterLimits,
    all_red_time_s, webster, yellow_time_s,
};
use city3d_protocol::snapshot::SignalHeadId;
use city3d_roadmap::{LabMap, LaneId, ZoneKind};

/// Reaction time for which the yellow time is made.
const REACTION_S: f64 = 1.0;
/// Share of full braking with which everybody stops who does not reach the line before red.
const FIRM_BRAKING: f64 = 0.8;
/// Length of the testbed's car, laboratory metres.
const VEHICLE_LENGTH_M: f64 = 0.20;
/// From an actuated signal's detector to its line: two seconds at the usual speed, as SUMO's default.
const DETECTOR_M: f64 = 0.7;

/// Fields of one kind of control alone, with the words for it.
const OF_KINDS: [(&str, &str, &[Kind]); 9] = [
    ("offset_s", "fixed or webster", &[Kind::Fixed, Kind::Webster]),
    ("flows_veh_h", "webster", &[Kind::Webster]),
    ("saturation_veh_h", "webster", &[Kind::Webster]),
    ("count_s", "webster", &[Kind::Webster]),
    ("max_cycle_s", "webster", &[Kind::Webster]),
    ("min_green_s", "webster or actuated", &[Kind::Webster, Kind::Actuated]),
    ("max_green_s", "actuated", &[Kind::Actuated]),
    ("max_gap_s", "actuated", &[Kind::Actuated]),
    ("detector_m", "actuated", &[Kind::Actuated]),
];

/// Makes the fields of all kinds known, so that a wrong name is told all of them.
pub fn know_fields(fields: &TableFields<'_, '_>) {
    const OTHERS: [&str; 6] = ["name", "kind", "phases", "yellow_s", "all_red_s", "approaches"];
    for key in OTHERS.into_iter().chain(OF_KINDS.map(|(key, ..)| key)) {
        fields.entry(key);
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Fixed,
    Webster,
    Actuated,
}

/// A phase as far as the file states it.
struct StatedPhase {
    lanes: Vec<LaneId>,
    green_s: Option<f64>,
    yellow_s: f64,
    all_red_s: f64,
}

/// Reads the phases and times of a signal; `None` where they cannot be used.
pub fn read_plan(
    fields: &TableFields<'_, '_>,
    (map, approaches): (&LabMap, &Approaches),
    driver: &DriverParams,
    (name, head_of): (String, &dyn Fn(LaneId) -> SignalHeadId),
) -> Option<SignalPlan> {
    let mut kind = Kind::Fixed;
    let kinds = [("fixed", Kind::Fixed), ("webster", Kind::Webster), ("actuated", Kind::Actuated)];
    fields.choice("kind", &kinds, &mut kind);
    for (key, of, kinds) in OF_KINDS {
        if fields.entry(key).is_some() && !kinds.contains(&kind) {
            fields.wrong(key, format!("{key} belongs to a signal of kind {of}; leave it out, or set kind"));
        }
    }
    let phases = read_phases(fields, (map, approaches), driver)?;
    let lost_s: f64 = phases.iter().map(|phase| phase.yellow_s + phase.all_red_s).sum();
    let mut limits = WebsterLimits { lost_s, min_green_s: 4.0, max_cycle_s: 120.0 };
    let (mut saturation_veh_h, mut window_s, mut offset_s) = (1500.0, 300.0, 0.0);
    let mut actuated =
        ActuatedControl { min_green_s: 5.0, max_green_s: 45.0, max_gap_s: 3.0, detector_m: DETECTOR_M };
    let mut flows = None;
    match kind {
        Kind::Fixed => fields.number("offset_s", -3600.0..=3600.0, &mut offset_s),
        Kind::Webster => {
            fields.number("min_green_s", 0.5..=300.0, &mut limits.min_green_s);
            fields.number("max_cycle_s", lost_s + 1.0..=3600.0, &mut limits.max_cycle_s);
            fields.number("saturation_veh_h", 1.0..=10_000.0, &mut saturation_veh_h);
            flows = read_flows(fields, map, approaches);
            match flows {
                Some(_) => fields.number("offset_s", -3600.0..=3600.0, &mut offset_s),
                None => fields.number("count_s", 30.0..=86_400.0, &mut window_s),
            }
        }
        Kind::Actuated => {
            fields.number("min_green_s", 0.5..=300.0, &mut actuated.min_green_s);
            fields.number("max_green_s", actuated.min_green_s..=3600.0, &mut actuated.max_green_s);
            fields.number("max_gap_s", 0.1..=60.0, &mut actuated.max_gap_s);
            fields.number("detector_m", 0.1..=5.0, &mut actuated.detector_m);
        }
    }
    let greens: Vec<f64> = match kind {
        Kind::Fixed => {
            if phases.iter().any(|phase| phase.green_s.is_none()) {
                let message =
                    "each phase of a fixed signal needs green_s, seconds; or set kind = \"webster\"";
                fields.wrong("phases", message);
            }
            phases.iter().map(|phase| phase.green_s.unwrap_or(1.0)).collect()
        }
        Kind::Webster => {
            let ratio = |phase: &StatedPhase| {
                let flow = |lane: &LaneId| flows.as_ref().map_or(0.0, |flows: &Flows| flows.of(*lane));
                phase.lanes.iter().map(flow).fold(0.0, f64::max) / saturation_veh_h
            };
            webster(limits, &phases.iter().map(ratio).collect::<Vec<_>>()).green_s
        }
        Kind::Actuated => phases.iter().map(|_| actuated.min_green_s).collect(),
    };
    let control = match kind {
        Kind::Webster if flows.is_none() => SignalControl::Counted(CountedControl {
            window_s,
            saturation_veh_h,
            min_green_s: limits.min_green_s,
            max_cycle_s: limits.max_cycle_s,
        }),
        Kind::Fixed | Kind::Webster => SignalControl::FixedTime,
        Kind::Actuated => SignalControl::Actuated(actuated),
    };
    let phase = |(stated, green_s): (StatedPhase, f64)| SignalPhase {
        green: stated.lanes.iter().map(|lane| head_of(*lane)).collect(),
        green_s,
        yellow_s: stated.yellow_s,
        all_red_s: stated.all_red_s,
    };
    let phases: Vec<SignalPhase> = phases.into_iter().zip(greens).map(phase).collect();
    Some(SignalPlan { name, phases, control, offset_s })
}

/// Reads the phases, and checks that each approach has green in one and that no phase has greens that conflict.
fn read_phases(
    fields: &TableFields<'_, '_>,
    (map, approaches): (&LabMap, &Approaches),
    driver: &DriverParams,
) -> Option<Vec<StatedPhase>> {
    let (mut yellow_s, mut all_red_s) = (f64::NAN, f64::NAN);
    fields.number("yellow_s", 0.1..=30.0, &mut yellow_s);
    fields.number("all_red_s", 0.0..=60.0, &mut all_red_s);
    let tables = fields.tables("phases");
    if tables.is_empty() {
        let example =
            "phases = [{ green = [\"lane\"], green_s = 10 }, { green = [\"other lane\"], green_s = 10 }]";
        fields.wrong("phases", format!("a signal needs phases: {example}"));
        return None;
    }
    let mut phases = Vec::new();
    for table in tables {
        let names = table.strings("green").unwrap_or_default();
        if names.is_empty() {
            table
                .problems
                .add(&table.span, "a phase needs green = [...], the approaches that have green in it");
        }
        let mut lanes: Vec<LaneId> =
            names.iter().flat_map(|(name, span)| approaches.named(&table, map, (name, span))).collect();
        lanes.sort_unstable();
        lanes.dedup();
        let mut phase = StatedPhase { lanes, green_s: None, yellow_s, all_red_s };
        let mut green_s = f64::NAN;
        table.number("green_s", 0.1..=3600.0, &mut green_s);
        phase.green_s = Some(green_s).filter(|green_s| green_s.is_finite());
        table.number("yellow_s", 0.1..=30.0, &mut phase.yellow_s);
        table.number("all_red_s", 0.0..=60.0, &mut phase.all_red_s);
        complete(&table, map, driver, &mut phase);
        check_conflicts(&table, map, &phase.lanes);
        table.finish();
        phases.push(phase);
    }
    for lane in &approaches.lanes {
        if !phases.iter().any(|phase| phase.lanes.contains(lane)) {
            let name = &map.lane(*lane).name;
            fields.wrong("phases", format!("lane \"{name}\" has green in no phase; add it to one"));
        }
    }
    phases.iter().all(|phase| !phase.lanes.is_empty()).then_some(phases)
}

/// Fills in yellow and all-red times by their formulas; a yellow time must let everybody pass who cannot stop.
fn complete(fields: &TableFields<'_, '_>, map: &LabMap, driver: &DriverParams, phase: &mut StatedPhase) {
    let limit_mps = phase.lanes.iter().map(|lane| map.lane(*lane).speed_limit_mps).fold(0.05, f64::max);
    let speed_mps = limit_mps.min(driver.desired_speed_mps);
    let braking_mps2 = driver.min_acceleration_mps2.abs();
    let least_s = yellow_time_s(driver.response_time_s, speed_mps, FIRM_BRAKING * braking_mps2);
    if phase.yellow_s.is_nan() {
        phase.yellow_s = yellow_time_s(REACTION_S, speed_mps, braking_mps2).max(least_s);
    } else if phase.yellow_s < least_s {
        let message = format!(
            "yellow_s is {}; at {speed_mps:.2} m/s a vehicle that cannot stop needs {least_s:.2} s to pass: set it to at \
             least that, or leave it out",
            phase.yellow_s
        );
        fields.problems.add(&fields.span, message);
    }
    if phase.all_red_s.is_nan() {
        let width_m = phase.lanes.iter().map(|lane| width_across(map, *lane)).fold(0.0, f64::max);
        phase.all_red_s = all_red_time_s(width_m, VEHICLE_LENGTH_M, speed_mps);
    }
}

/// The longest way from the line of an approach to the end of the last crossing on it.
fn width_across(map: &LabMap, approach: LaneId) -> f64 {
    let line = map.signals.iter().find(|head| head.lane == approach);
    let before_m = line.map_or(0.0, |head| map.lane(approach).curve.length() - head.at_m);
    let across = |way: &Vec<LaneId>| {
        let (mut start_m, mut end_m) = (before_m, 0.0);
        for lane in way {
            let zones = map.zones_on(*lane).filter(|zone| zone.kind == ZoneKind::Cross);
            let sides = zones.flat_map(|zone| zone.sides).filter(|side| side.lane == *lane);
            end_m = sides.map(|side| start_m + side.to_m).fold(end_m, f64::max);
            start_m += map.lane(*lane).curve.length();
        }
        end_m
    };
    map.ways_across(approach).iter().map(across).fold(0.0, f64::max)
}

fn check_conflicts(fields: &TableFields<'_, '_>, map: &LabMap, lanes: &[LaneId]) {
    for (index, one) in lanes.iter().enumerate() {
        for other in &lanes[index + 1..] {
            if map.approaches_conflict(*one, *other) {
                let [one, other] = [one, other].map(|lane| &map.lane(*lane).name);
                fields.wrong(
                    "green",
                    format!(
                        "\"{one}\" and \"{other}\" cross and have green together; put them into two phases"
                    ),
                );
            }
        }
    }
}

/// Flows of approaches, vehicles an hour.
struct Flows(Vec<(LaneId, f64)>);

impl Flows {
    fn of(&self, lane: LaneId) -> f64 {
        self.0.iter().find(|(known, _)| *known == lane).map_or(0.0, |(_, flow)| *flow)
    }
}

/// Reads `flows_veh_h`; `None` where it is not stated, and flows are counted.
fn read_flows(fields: &TableFields<'_, '_>, map: &LabMap, approaches: &Approaches) -> Option<Flows> {
    let table = fields.table("flows_veh_h")?;
    let mut flows = Vec::new();
    for (key, value) in table.entries() {
        let name: &str = key.get_ref();
        let lane = approaches.lanes.iter().find(|lane| map.lane(**lane).name == name);
        let flow = number_of(value.get_ref()).filter(|flow| (0.0..=10_000.0).contains(flow));
        match (lane, flow) {
            (Some(lane), Some(flow)) => flows.push((*lane, flow)),
            (None, _) => {
                let names: Vec<&str> = approaches.lanes.iter().map(|l| map.lane(*l).name.as_str()).collect();
                let remedy = one_of(name, names.into_iter());
                let message = format!("\"{name}\" is no approach of this signal; {remedy}");
                fields.problems.add(&key.span(), message);
            }
            (_, None) => {
                let message =
                    format!("the flow of \"{name}\" must be a number of vehicles an hour up to 10000");
                fields.problems.add(&value.span(), message);
            }
        }
    }
    Some(Flows(flows))
}
