//! Guests' cars: what a guest brings into a served city, over the link or by the city's own web page.

use city3d_geometry::{Lab, Pose2};
use city3d_protocol::snapshot::{Appearance, BodyType, ModelKind, VehicleId, VehicleSpec};
use city3d_protocol::wire::{PERSON, RequestOutcome, VehicleBuild, VehicleSetup};
use city3d_simulation::scenario::Experiment;
use std::time::Duration;

/// A city that has no room is asked again at this interval.
pub(crate) const RETRY_INTERVAL: Duration = Duration::from_secs(2);
/// Why a city takes no guest by its own page.
pub(crate) const NO_GUESTS: &str =
    "guests come to a served city: city3d serve --web --guests N, or city3d view --city ADDR --guest";
/// First id that a guest tries: ids of scenarios are small.
const FIRST_ID: u32 = 901;
/// Ids that it tries before it gives up.
const MOST_TRIES: u32 = 64;
/// Colour of the car, so that its driver finds it.
const COLOUR: [u8; 3] = [245, 190, 40];

/// A guest's car before it is in a city.
#[derive(Clone, Debug)]
pub(crate) struct GuestSetup {
    /// Name in the city; a number is added where it is taken.
    name: String,
    /// Behind the first vehicle of the scenario: the city finds free space from there.
    start: Pose2<Lab>,
    spec: VehicleSpec,
}

impl GuestSetup {
    /// A car of a guest's name in the city of an experiment.
    pub fn of(experiment: &Experiment, name: String) -> Self {
        let start = match (experiment.vehicles.first(), experiment.lab_map.lanes.first()) {
            (Some(planned), _) => planned.pose_in_lab(&experiment.city_map, experiment.scale),
            (None, Some(lane)) => lane.curve.at(lane.curve.length() / 2.0).pose,
            (None, None) => Pose2::default(),
        };
        let simulated = experiment.vehicles.iter().find(|planned| planned.spec.model != ModelKind::Measured);
        let spec = simulated.map_or_else(VehicleSpec::default, |planned| planned.spec.clone());
        Self { name, start, spec }
    }

    /// Asks a city to take the car, for one number after the other from that of `before`, at a pose where it has one.
    /// `None` where the city does not answer.
    ///
    /// # Errors
    /// Why the city does not take it, as a sentence.
    pub fn bring(
        &self,
        (before, pose): (Option<VehicleId>, Option<Pose2<Lab>>),
        mut ask: impl FnMut(VehicleSetup) -> Option<(RequestOutcome, String)>,
    ) -> Result<Option<VehicleId>, String> {
        let first = before.map_or(FIRST_ID, |vehicle| vehicle.0);
        for number in first..first + MOST_TRIES {
            match ask(self.numbered(number, pose.unwrap_or(self.start))) {
                Some((RequestOutcome::Done, _)) => return Ok(Some(VehicleId(number))),
                // Another guest has the number or the name,
                Some((RequestOutcome::Refused, detail)) if detail.contains("choose another") => {}
                // or both; what was this guest's is free again soon.
                Some((RequestOutcome::Busy, detail))
                    if before.is_none() && detail.contains("has set up vehicle") => {}
                Some((_, detail)) => return Err(format!("your car waits outside: {detail}")),
                None => return Ok(None),
            }
        }
        Err(format!("your car waits outside: {MOST_TRIES} other guests are there"))
    }

    fn numbered(&self, number: u32, pose: Pose2<Lab>) -> VehicleSetup {
        let name = match number {
            FIRST_ID => self.name.clone(),
            number => format!("{}_{}", self.name, number - FIRST_ID + 1),
        };
        VehicleSetup {
            id: VehicleId(number),
            name,
            controller: PERSON.to_owned(),
            parameters: Default::default(),
            appearance: Appearance { body: BodyType::Hatchback, colour: COLOUR },
            pose,
            speed_mps: 0.0,
            build: VehicleBuild::Spec(Box::new(self.spec.clone())),
        }
    }
}
