//! Log messages of plans of coordinated vehicles: their schema in the ROS 2 interface definition language, and their CDR
//! encoding.

use city3d_geometry::Pose2;
use city3d_protocol::cdr::{CdrReader, CdrWriter};
use city3d_protocol::snapshot::{
    CoordinationUpdate, NoPlan, PlanPoint, PlannedPassage, VehicleId, ZoneCounts, ZoneState, ZoneVehicle,
};

/// Topic of the plans.
pub const PLANS_TOPIC: &str = "/city3d/plans";
/// Name of the ROS 2 type of plans.
pub const PLANS_TYPE: &str = "city3d_msgs/msg/Plans";
/// Definition of [`PLANS_TYPE`].
pub const PLANS_SCHEMA: &str = "\
# Plans of vehicles through control zones, as the control framework tells them. City frame: full-scale metres, x east,
# y north. They hold in the snapshot of this tick, and until the next ones of the same zone or vehicle, but no longer than 2.2 s.
uint64 tick
# Simulated time, seconds.
float64 time
# In the order of their numbers; zones that are as they were told before may be missing.
city3d_msgs/Zone[] zones
# Vehicles in control zones, in id order; those that are as they were told before may be missing.
city3d_msgs/ZoneVehicle[] vehicles
# Ids of vehicles that are in no control zone any more.
uint32[] left
================================================================================
MSG: city3d_msgs/Zone
# Number and name in the scenario of the control framework.
uint32 number
string name
# So far: plans given, plans dropped, and requests for which no plan was feasible.
uint64 plans
uint64 replans
uint64 infeasible
================================================================================
MSG: city3d_msgs/ZoneVehicle
uint32 vehicle
# Number of its zone.
uint32 zone
# 0 it has a plan; or why it has none: 1 not coordinated, 2 has left its plans, 3 among vehicles without, 4 infeasible
uint8 plan
bool standing
# Times are seconds after the time of this message: when it entered the zone, when its front bumper enters the first
# conflict, and when its rear bumper leaves the last one.
float32 entered
float32 enters
float32 leaves
# Where its front bumper enters the first conflict.
float32 entry_x
float32 entry_y
float32 entry_yaw
# Motion of its front bumper, up to 30 s ahead.
city3d_msgs/PlanPoint[] motion
================================================================================
MSG: city3d_msgs/PlanPoint
float32 time
float32 x
float32 y
float32 yaw
float32 speed
";

/// What stands in place of a reason for a vehicle with a plan.
const PLANNED: u8 = 0;

/// Plans in a log, in its precision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoggedPlans {
    /// Physics steps since the start or the last reset.
    pub tick: u64,
    /// Simulated time, seconds.
    pub time_s: f64,
    /// What is told, full scale.
    pub update: CoordinationUpdate,
}

/// Appends the message of plans to a buffer.
pub fn encode_plans(tick: u64, time_s: f64, update: &CoordinationUpdate, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::behind(buffer);
    cdr.u64(tick);
    cdr.f64(time_s);
    cdr.u32(update.zones.len() as u32);
    for zone in &update.zones {
        cdr.u32(zone.number.into());
        cdr.string(&zone.name);
        let ZoneCounts { plans, replans, infeasible } = zone.counts;
        [plans, replans, infeasible].into_iter().for_each(|count| cdr.u64(count));
    }
    cdr.u32(update.vehicles.len() as u32);
    update.vehicles.iter().for_each(|vehicle| encode_vehicle(vehicle, time_s, &mut cdr));
    cdr.u32(update.left.len() as u32);
    update.left.iter().for_each(|id| cdr.u32(id.0));
    cdr.into_bytes()
}

fn encode_vehicle(vehicle: &ZoneVehicle, time_s: f64, cdr: &mut CdrWriter) {
    let none = PlannedPassage { enters_s: time_s, leaves_s: time_s, ..PlannedPassage::default() };
    let plan = vehicle.plan.as_ref().unwrap_or(&none);
    cdr.u32(vehicle.id.0);
    cdr.u32(vehicle.zone.into());
    cdr.u8(vehicle.plan.as_ref().err().map_or(PLANNED, |why| *why as u8));
    cdr.u8(u8::from(vehicle.is_standing));
    let times = [vehicle.entered_s, plan.enters_s, plan.leaves_s].map(|at_s| at_s - time_s);
    let entry = [plan.entry.position.x, plan.entry.position.y, plan.entry.yaw_rad];
    times.into_iter().chain(entry).for_each(|number| cdr.f32(number as f32));
    cdr.u32(plan.motion.len() as u32);
    for point in &plan.motion {
        let Pose2 { position, yaw_rad, .. } = point.pose;
        let numbers = [point.time_s - time_s, position.x, position.y, yaw_rad, point.speed_mps];
        numbers.into_iter().for_each(|number| cdr.f32(number as f32));
    }
}

/// `None` for a damaged message.
pub fn decode_plans(bytes: &[u8]) -> Option<LoggedPlans> {
    let mut cdr = CdrReader::new(bytes)?;
    let (tick, time_s) = (cdr.u64()?, cdr.f64()?);
    if !time_s.is_finite() {
        return None;
    }
    let mut update = CoordinationUpdate::default();
    for _ in 0..cdr.u32()? {
        update.zones.push(decode_zone(&mut cdr)?);
    }
    for _ in 0..cdr.u32()? {
        update.vehicles.extend(decode_vehicle(time_s, &mut cdr)?);
    }
    for _ in 0..cdr.u32()? {
        update.left.push(VehicleId(cdr.u32()?));
    }
    Some(LoggedPlans { tick, time_s, update })
}

fn decode_zone(cdr: &mut CdrReader<'_>) -> Option<ZoneState> {
    let number = u16::try_from(cdr.u32()?).ok()?;
    let name = cdr.string()?.to_owned();
    let counts = ZoneCounts { plans: cdr.u64()?, replans: cdr.u64()?, infeasible: cdr.u64()? };
    Some(ZoneState { number, name, counts })
}

/// `Some(None)` for a vehicle without a plan for a reason of a later version: of that nothing is known here.
fn decode_vehicle(time_s: f64, cdr: &mut CdrReader<'_>) -> Option<Option<ZoneVehicle>> {
    let (id, zone) = (VehicleId(cdr.u32()?), u16::try_from(cdr.u32()?).ok()?);
    let (reason, is_standing) = (cdr.u8()?, cdr.u8()? != 0);
    let [entered, enters, leaves] = numbers(cdr)?;
    let [x, y, yaw_rad] = numbers(cdr)?;
    let mut motion: Vec<PlanPoint> = Vec::new();
    for _ in 0..cdr.u32()? {
        let [time, x, y, yaw_rad, speed_mps] = numbers(cdr)?;
        let point = PlanPoint { time_s: time_s + time, pose: Pose2::new(x, y, yaw_rad), speed_mps };
        // In the precision of the log two points may have one time.
        if motion.last().is_none_or(|before| before.time_s < point.time_s) {
            motion.push(point);
        }
    }
    let plan = match reason {
        PLANNED => Ok(PlannedPassage {
            enters_s: time_s + enters,
            leaves_s: time_s + leaves,
            entry: Pose2::new(x, y, yaw_rad),
            motion,
        }),
        number => match NoPlan::ALL.get(usize::from(number) - 1) {
            Some(why) => Err(*why),
            None => return Some(None),
        },
    };
    Some(Some(ZoneVehicle { id, zone, entered_s: time_s + entered, is_standing, plan }))
}

/// Finite numbers.
fn numbers<const N: usize>(cdr: &mut CdrReader<'_>) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = f64::from(cdr.f32()?);
    }
    numbers.iter().all(|number| number.is_finite()).then_some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_S: f64 = 2.5;

    fn planned(id: u32) -> ZoneVehicle {
        let point = |k: u32| PlanPoint {
            time_s: NOW_S + f64::from(k),
            pose: Pose2::new(12.5 - f64::from(k), -3.25, 0.5),
            speed_mps: 8.75,
        };
        let plan = PlannedPassage {
            enters_s: NOW_S + 2.0,
            leaves_s: NOW_S + 3.5,
            entry: Pose2::new(10.5, -3.25, 0.5),
            motion: (0..4).map(point).collect(),
        };
        ZoneVehicle { id: VehicleId(id), zone: 1, entered_s: 1.25, is_standing: id == 8, plan: Ok(plan) }
    }

    fn update() -> CoordinationUpdate {
        let counts = ZoneCounts { plans: 7, replans: 2, infeasible: 1 };
        let zone = |number: u16| ZoneState { number, name: format!("zone-{number}"), counts };
        let without = |id, why| ZoneVehicle { plan: Err(why), ..planned(id) };
        CoordinationUpdate {
            zones: vec![zone(0), zone(1)],
            vehicles: vec![planned(7), planned(8), without(9, NoPlan::LeftItsPlans)],
            left: vec![VehicleId(3)],
        }
    }

    #[test]
    fn plans_are_read_as_they_were_written() {
        let bytes = encode_plans(250, NOW_S, &update(), Vec::new());
        let read = decode_plans(&bytes);
        assert_eq!(read, Some(LoggedPlans { tick: 250, time_s: NOW_S, update: update() }));
        assert!((0..bytes.len()).all(|end| decode_plans(&bytes[..end]).is_none()), "none of a part");
    }

    #[test]
    fn a_reason_of_a_later_version_is_left_out_and_what_is_not_finite_is_damage() {
        let only = |vehicle| CoordinationUpdate { vehicles: vec![vehicle], ..CoordinationUpdate::default() };
        let bytes = encode_plans(250, NOW_S, &only(planned(7)), Vec::new());
        // Behind header, tick, time, no zones, one vehicle with its id and its zone.
        let reason = 4 + 8 + 8 + 4 + 4 + 4 + 4;
        assert_eq!(bytes[reason], PLANNED);
        let mut later = bytes.clone();
        later[reason] = 200;
        assert_eq!(decode_plans(&later).map(|read| read.update), Some(CoordinationUpdate::default()));
        let damaged = |offset: usize, number: f32| {
            let mut damaged = bytes.clone();
            damaged[offset..offset + 4].copy_from_slice(&number.to_le_bytes());
            decode_plans(&damaged)
        };
        let motion = reason + 4 + 6 * 4 + 4;
        assert_eq!(damaged(motion, f32::NAN), None);
        let points = |read: Option<LoggedPlans>| {
            read.unwrap().update.vehicles[0].plan.clone().map(|plan| plan.motion.len())
        };
        assert_eq!(points(damaged(motion + 20, 0.5)), Ok(4));
        assert_eq!(points(damaged(motion + 20, 0.0)), Ok(3), "a point of the same time as the one before");
    }
}
