//! Encodes plans of coordinated vehicles: control zones and vehicles together in as few datagrams as possible.

use super::bytes::{ByteReader, ByteWriter};
use super::description::cut;
use super::envelope::MAX_BODY_BYTES;
use super::setup::MAX_NAME_BYTES;
use super::trajectories::{read_point, read_pose, write_point};
use super::{
    DecodeError, DecodeFault, EncodeError, MAX_ANGLE_RAD, MAX_COORDINATE_M, MAX_SPEED_MPS, MAX_TIME_S,
};
use crate::snapshot::{
    CoordinationUpdate, NoPlan, PlanPoint, PlannedPassage, TrajectoryPoint, VehicleId, ZoneCounts, ZoneState,
    ZoneVehicle,
};
use city3d_geometry::{City, Lab, LengthScale, Pose2};
use glam::DVec2;

/// Control zones have numbers below this.
pub const MAX_ZONES: u16 = 1000;
/// Most zones, vehicles, and vehicles that have left, each, of a datagram.
pub const MAX_PLAN_ENTRIES: usize = 250;
/// Points of a plan are no farther than this from the time at which it is told, seconds: a plan's longest time, and the
/// difference of clocks.
pub const MAX_PLAN_AHEAD_S: f64 = PlannedPassage::<Lab>::LONGEST_S + 1.0;

/// Bytes of the time and of three numbers of entries.
const HEAD_BYTES: usize = 11;
/// Bytes of a zone without its name.
const ZONE_BYTES: usize = 27;
/// Bytes of a vehicle without its plan, of a plan without its points, and of a point.
const VEHICLE_BYTES: usize = 16;
const PLAN_BYTES: usize = 41;
const POINT_BYTES: usize = 40;
/// Bytes of a vehicle that has left.
const LEFT_BYTES: usize = 4;

/// What stands in place of a reason for a vehicle with a plan.
const PLANNED: u8 = 0;
/// Bit of a vehicle that stands.
const STANDING: u8 = 1;

/// Plans at one instant, or some of them. Laboratory metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Plans {
    /// Time of the city's clock at which they held.
    pub time_s: f64,
    /// Up to [`MAX_PLAN_ENTRIES`] of each list.
    pub update: CoordinationUpdate<Lab>,
}

impl Plans {
    /// Plans of the city at one instant, within the ranges of the wire and in as many parts as they need; none where there
    /// are none.
    pub fn parts(time_s: f64, update: &CoordinationUpdate, scale: LengthScale) -> Vec<Self> {
        let mut parts = PlanPacker { time_s, parts: Vec::new(), bytes: 0 };
        for zone in update.zones.iter().filter(|zone| zone.number < MAX_ZONES) {
            let zone = ZoneState { name: cut(&zone.name, MAX_NAME_BYTES).to_owned(), ..zone.clone() };
            let part = parts.with_room(ZONE_BYTES + zone.name.len(), |part| part.zones.len());
            part.zones.push(zone);
        }
        for vehicle in update.vehicles.iter().filter(|vehicle| vehicle.zone < MAX_ZONES) {
            let vehicle = on_the_wire(vehicle, time_s, scale);
            parts.with_room(bytes_of(&vehicle), |part| part.vehicles.len()).vehicles.push(vehicle);
        }
        for id in &update.left {
            parts.with_room(LEFT_BYTES, |part| part.left.len()).left.push(*id);
        }
        parts.parts
    }

    pub(super) fn write(&self, out: &mut ByteWriter) -> Result<(), EncodeError> {
        let CoordinationUpdate { zones, vehicles, left } = &self.update;
        out.f64(self.time_s);
        out.count("zones", zones.len(), MAX_PLAN_ENTRIES)?;
        out.count("vehicles", vehicles.len(), MAX_PLAN_ENTRIES)?;
        out.count("vehicles that have left", left.len(), MAX_PLAN_ENTRIES)?;
        for zone in zones {
            out.u16(zone.number);
            out.text("zone name", &zone.name, MAX_NAME_BYTES)?;
            let ZoneCounts { plans, replans, infeasible } = zone.counts;
            [plans, replans, infeasible].into_iter().for_each(|count| out.u64(count));
        }
        vehicles.iter().try_for_each(|vehicle| write_vehicle(vehicle, out))?;
        left.iter().for_each(|id| out.u32(id.0));
        Ok(())
    }

    pub(super) fn read(from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        let time_s = from.number("time", 0.0, MAX_TIME_S)?;
        let [zones, vehicles, left] = [
            read_count(from, "zones")?,
            read_count(from, "vehicles")?,
            read_count(from, "vehicles that have left")?,
        ];
        let update = CoordinationUpdate {
            zones: (0..zones).map(|_| read_zone(from)).collect::<Result<_, _>>()?,
            vehicles: (0..vehicles).map(|_| read_vehicle(from, time_s)).collect::<Result<_, _>>()?,
            left: (0..left).map(|_| from.u32("vehicle id").map(VehicleId)).collect::<Result<_, _>>()?,
        };
        Ok(Self { time_s, update })
    }

    /// The plans in the full-scale city.
    pub fn in_city(&self, scale: LengthScale) -> CoordinationUpdate<City> {
        let CoordinationUpdate { zones, vehicles, left } = &self.update;
        let to_city = |pose: Pose2<Lab>| pose.to_city(scale);
        let in_city = |vehicle: &ZoneVehicle<Lab>| vehicle.in_frame(to_city, |mps| scale.city_from_lab(mps));
        CoordinationUpdate {
            zones: zones.clone(),
            vehicles: vehicles.iter().map(in_city).collect(),
            left: left.clone(),
        }
    }
}

/// Parts that are filled one after the other.
struct PlanPacker {
    time_s: f64,
    parts: Vec<Plans>,
    /// Of the last part.
    bytes: usize,
}

impl PlanPacker {
    /// The last part if another entry of this size, and in a list of that length, fits in it; else a new one.
    fn with_room(
        &mut self,
        more: usize,
        entries: impl Fn(&CoordinationUpdate<Lab>) -> usize,
    ) -> &mut CoordinationUpdate<Lab> {
        let fits =
            |part: &Plans| self.bytes + more <= MAX_BODY_BYTES && entries(&part.update) < MAX_PLAN_ENTRIES;
        if !self.parts.last().is_some_and(fits) {
            self.parts.push(Plans { time_s: self.time_s, update: CoordinationUpdate::default() });
            self.bytes = HEAD_BYTES;
        }
        self.bytes += more;
        let last = self.parts.len() - 1;
        &mut self.parts[last].update
    }
}

fn bytes_of(vehicle: &ZoneVehicle<Lab>) -> usize {
    let plan_bytes = |plan: &PlannedPassage<Lab>| PLAN_BYTES + plan.motion.len() * POINT_BYTES;
    VEHICLE_BYTES + vehicle.plan.as_ref().map_or(0, plan_bytes)
}

/// A vehicle of the full-scale city within the ranges of the wire; of its motion what is near the time.
fn on_the_wire(vehicle: &ZoneVehicle, time_s: f64, scale: LengthScale) -> ZoneVehicle<Lab> {
    let most = DVec2::splat(MAX_COORDINATE_M);
    let pose = |pose: Pose2<City>| {
        let pose = pose.to_lab(scale);
        let yaw_rad = pose.yaw_rad.clamp(-MAX_ANGLE_RAD, MAX_ANGLE_RAD);
        Pose2::at(pose.position.clamp(-most, most), yaw_rad)
    };
    let speed = |mps: f64| scale.lab_from_city(mps).clamp(0.0, MAX_SPEED_MPS);
    let mut vehicle = vehicle.in_frame(pose, speed);
    vehicle.entered_s = vehicle.entered_s.clamp(0.0, MAX_TIME_S);
    if let Ok(plan) = &mut vehicle.plan {
        plan.enters_s = plan.enters_s.clamp(0.0, MAX_TIME_S);
        plan.leaves_s = plan.leaves_s.clamp(plan.enters_s, MAX_TIME_S);
        let (least_s, most_s) = times_of_points(time_s);
        plan.motion.retain(|point| (least_s..=most_s).contains(&point.time_s));
        plan.motion.dedup_by(|later, before| later.time_s <= before.time_s);
        plan.motion.truncate(PlannedPassage::<Lab>::MAX_POINTS);
    }
    vehicle
}

fn times_of_points(time_s: f64) -> (f64, f64) {
    ((time_s - MAX_PLAN_AHEAD_S).max(0.0), time_s + MAX_PLAN_AHEAD_S)
}

fn write_vehicle(vehicle: &ZoneVehicle<Lab>, out: &mut ByteWriter) -> Result<(), EncodeError> {
    out.u32(vehicle.id.0);
    out.u16(vehicle.zone);
    out.u8(vehicle.plan.as_ref().err().map_or(PLANNED, |why| *why as u8));
    out.u8(u8::from(vehicle.is_standing) * STANDING);
    out.f64(vehicle.entered_s);
    let Ok(plan) = &vehicle.plan else { return Ok(()) };
    let Pose2 { position, yaw_rad, .. } = plan.entry;
    let numbers = [plan.enters_s, plan.leaves_s, position.x, position.y, yaw_rad];
    numbers.into_iter().for_each(|number| out.f64(number));
    out.count("points", plan.motion.len(), PlannedPassage::<Lab>::MAX_POINTS)?;
    for &PlanPoint { time_s, pose, speed_mps } in &plan.motion {
        write_point(TrajectoryPoint { time_s, pose, speed_mps }, out);
    }
    Ok(())
}

fn read_count(from: &mut ByteReader<'_>, field: &'static str) -> Result<u8, DecodeError> {
    let count = from.u8(field)?;
    from.within(field, count, (0, MAX_PLAN_ENTRIES as u8))
}

fn read_zone_number(from: &mut ByteReader<'_>) -> Result<u16, DecodeError> {
    let number = from.u16("zone")?;
    from.within("zone", number, (0, MAX_ZONES - 1))
}

fn read_zone(from: &mut ByteReader<'_>) -> Result<ZoneState, DecodeError> {
    let number = read_zone_number(from)?;
    let name = from.text("zone name", MAX_NAME_BYTES)?;
    let counts = ZoneCounts {
        plans: from.u64("plans")?,
        replans: from.u64("replans")?,
        infeasible: from.u64("infeasible")?,
    };
    Ok(ZoneState { number, name, counts })
}

fn read_vehicle(from: &mut ByteReader<'_>, told_s: f64) -> Result<ZoneVehicle<Lab>, DecodeError> {
    let id = VehicleId(from.u32("vehicle id")?);
    let zone = read_zone_number(from)?;
    let reason = match from.u8("plan")? {
        PLANNED => None,
        number => match NoPlan::ALL.get(usize::from(number) - 1) {
            Some(why) => Some(*why),
            None => {
                let known = "0 (a plan), and 1 (not coordinated) to 4 (infeasible)";
                return Err(from.error("plan", 1, DecodeFault::Unknown { found: number.into(), known }));
            }
        },
    };
    let flags = from.u8("vehicle flags")?;
    let is_standing = from.within("vehicle flags", flags, (0, STANDING))? == STANDING;
    let entered_s = from.number("time of entry", 0.0, MAX_TIME_S)?;
    let plan = match reason {
        Some(why) => Err(why),
        None => Ok(read_plan(from, told_s)?),
    };
    Ok(ZoneVehicle { id, zone, entered_s, is_standing, plan })
}

fn read_plan(from: &mut ByteReader<'_>, told_s: f64) -> Result<PlannedPassage<Lab>, DecodeError> {
    let enters_s = from.number("enters", 0.0, MAX_TIME_S)?;
    let leaves_s = from.number("leaves", enters_s, MAX_TIME_S)?;
    let entry = read_pose(from)?;
    let count = from.u8("points")?;
    let count = from.within("points", count, (0, PlannedPassage::<Lab>::MAX_POINTS as u8))?;
    let mut motion: Vec<PlanPoint<Lab>> = Vec::with_capacity(count.into());
    for _ in 0..count {
        let before_s = motion.last().map(|before| before.time_s);
        let TrajectoryPoint { time_s, pose, speed_mps } =
            read_point(from, times_of_points(told_s), before_s)?;
        motion.push(PlanPoint { time_s, pose, speed_mps });
    }
    Ok(PlannedPassage { enters_s, leaves_s, entry, motion })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_S: f64 = 12.5;

    fn zone(number: u16, name: &str) -> ZoneState {
        let counts = ZoneCounts { plans: 7, replans: 2, infeasible: 1 };
        ZoneState { number, name: name.to_owned(), counts }
    }

    fn planned(id: u32, points: usize) -> ZoneVehicle {
        let point = |k: usize| PlanPoint {
            time_s: NOW_S + k as f64,
            pose: Pose2::new(50.0 - 25.0 * k as f64, 25.0, 0.5),
            speed_mps: 25.0,
        };
        let plan = PlannedPassage {
            enters_s: 14.0,
            leaves_s: 16.25,
            entry: Pose2::new(-50.0, 12.5, 1.5),
            motion: (0..points).map(point).collect(),
        };
        ZoneVehicle { id: VehicleId(id), zone: 1, entered_s: 11.0, is_standing: id == 4, plan: Ok(plan) }
    }

    fn written(part: &Plans) -> Vec<u8> {
        let mut out = ByteWriter::default();
        part.write(&mut out).unwrap();
        out.bytes
    }

    fn read(bytes: &[u8]) -> Result<Plans, DecodeError> {
        let mut from = ByteReader::new(bytes, 0);
        Plans::read(&mut from)
    }

    fn update() -> CoordinationUpdate {
        let without = ZoneVehicle { plan: Err(NoPlan::AmongUncoordinated), ..planned(5, 0) };
        CoordinationUpdate {
            zones: vec![zone(0, "west"), zone(1, "")],
            vehicles: vec![planned(3, 4), planned(4, 25), without],
            left: vec![VehicleId(8), VehicleId(9)],
        }
    }

    #[test]
    fn plans_come_back_at_full_scale() {
        let scale = LengthScale::TESTBED;
        let parts = Plans::parts(NOW_S, &update(), scale);
        let mut told = CoordinationUpdate::default();
        for part in &parts {
            assert_eq!(read(&written(part)).as_ref(), Ok(part));
            let CoordinationUpdate { zones, vehicles, left } = part.in_city(scale);
            told.zones.extend(zones);
            told.vehicles.extend(vehicles);
            told.left.extend(left);
        }
        assert_eq!(told, update());
        let plan = parts[0].update.vehicles[0].plan.as_ref().unwrap();
        assert_eq!((plan.motion[1].pose.position, plan.motion[1].speed_mps), (DVec2::new(1.0, 1.0), 1.0));
    }

    #[test]
    fn many_are_split_over_datagrams_and_each_is_filled() {
        let scale = LengthScale::TESTBED;
        let name = "a-name-of-a-zone-that-is-longer-than-names-of-control-zones-may-be";
        let many = CoordinationUpdate {
            zones: (0..30).map(|number| zone(number, name)).collect(),
            vehicles: (1..=40).map(|id| planned(id, 12)).collect(),
            left: (100..700).map(VehicleId).collect(),
        };
        let parts = Plans::parts(NOW_S, &many, scale);
        let sizes: Vec<usize> = parts.iter().map(|part| written(part).len()).collect();
        assert!(sizes.iter().all(|size| *size <= MAX_BODY_BYTES), "{sizes:?}");
        let largest = VEHICLE_BYTES + PLAN_BYTES + 12 * POINT_BYTES;
        let is_filled = |size: &usize| size + largest > MAX_BODY_BYTES;
        let up_to_vehicles = parts.iter().position(|part| !part.update.left.is_empty()).unwrap();
        assert!(sizes[..up_to_vehicles].iter().all(is_filled), "{sizes:?}");
        let vehicles = parts.iter().flat_map(|part| &part.update.vehicles);
        assert!(vehicles.map(|vehicle| vehicle.id.0).eq(1..=40));
        assert_eq!(parts.iter().map(|part| part.update.left.len()).sum::<usize>(), 600);
        assert_eq!(parts[0].update.zones[0].name.len(), MAX_NAME_BYTES);
        assert!(Plans::parts(NOW_S, &CoordinationUpdate::default(), scale).is_empty());
        // The longest plan has a datagram to itself.
        let longest = CoordinationUpdate { vehicles: vec![planned(1, 25)], ..CoordinationUpdate::default() };
        let [part] = &Plans::parts(NOW_S, &longest, scale)[..] else { panic!("one part") };
        assert_eq!(part.update.vehicles[0].plan.as_ref().unwrap().motion.len(), 25);
        assert!(written(part).len() <= MAX_BODY_BYTES);
    }

    #[test]
    fn numbers_beyond_the_ranges_of_the_wire_are_brought_into_them() {
        let mut wild = planned(3, 0);
        let far = |time_s: f64| PlanPoint { time_s, pose: Pose2::new(1e9, -1e9, 1e9), speed_mps: -1.0 };
        let times = [-40.0, NOW_S, NOW_S, NOW_S + 1.0, NOW_S + 0.5, NOW_S + 100.0];
        wild.plan = Ok(PlannedPassage {
            enters_s: -5.0,
            leaves_s: -7.0,
            entry: Pose2::new(-1e9, 1e9, -1e9),
            motion: times.into_iter().map(far).collect(),
        });
        let elsewhere = ZoneVehicle { zone: MAX_ZONES, ..planned(4, 1) };
        let told = CoordinationUpdate {
            zones: vec![zone(MAX_ZONES, "nowhere")],
            vehicles: vec![wild, elsewhere],
            left: Vec::new(),
        };
        let [part] = &Plans::parts(NOW_S, &told, LengthScale::TESTBED)[..] else { panic!("one part") };
        assert_eq!(read(&written(part)).as_ref(), Ok(part));
        assert!(part.update.zones.is_empty() && part.update.vehicles.len() == 1);
        let motion = &part.update.vehicles[0].plan.as_ref().unwrap().motion;
        assert_eq!(motion.iter().map(|point| point.time_s).collect::<Vec<_>>(), [NOW_S, NOW_S + 1.0]);
    }

    /// The error of plans in which some bytes are others.
    fn refused(offset: usize, bytes: &[u8]) -> String {
        let one = CoordinationUpdate { vehicles: vec![planned(3, 2)], ..CoordinationUpdate::default() };
        let mut damaged = written(&Plans::parts(NOW_S, &one, LengthScale::TESTBED)[0]);
        damaged[offset..offset + bytes.len()].copy_from_slice(bytes);
        read(&damaged).unwrap_err().to_string()
    }

    #[test]
    fn what_cannot_be_is_refused_with_its_place() {
        let number = |number: f64| number.to_le_bytes();
        let vehicle = HEAD_BYTES;
        let plan = vehicle + VEHICLE_BYTES;
        let points = plan + PLAN_BYTES;
        assert_eq!(refused(8, &[251]), "zones, byte 8: 251; it must be between 0 and 250");
        assert_eq!(refused(vehicle + 4, &[0xe8, 3]), "zone, byte 15: 1000; it must be between 0 and 999");
        let said = refused(vehicle + 6, &[5]);
        assert_eq!(
            said,
            "plan, byte 17: 5 is unknown; there are 0 (a plan), and 1 (not coordinated) to 4 (infeasible)"
        );
        assert_eq!(refused(vehicle + 7, &[2]), "vehicle flags, byte 18: 2; it must be between 0 and 1");
        let said = refused(plan + 8, &number(13.0));
        assert!(said.starts_with("leaves, byte 35: 13; it must be between 14 and"), "{said}");
        assert_eq!(refused(points - 1, &[26]), "points, byte 67: 26; it must be between 0 and 25");
        assert_eq!(
            refused(points + POINT_BYTES, &number(NOW_S)),
            "time, byte 108: not later than the one before"
        );
        let said = refused(points + POINT_BYTES, &number(NOW_S + 32.0));
        assert_eq!(said, "time, byte 108: 44.5; it must be between 0 and 43.5");
        assert_eq!(refused(points + 8, &number(f64::NAN)), "x, byte 76: not a finite number");
        let short = written(&Plans::parts(NOW_S, &update(), LengthScale::TESTBED)[0]);
        assert!((0..short.len()).all(|end| read(&short[..end]).is_err()), "none of a part");
    }
}
