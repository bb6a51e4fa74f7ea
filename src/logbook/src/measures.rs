//! The measures of a run as its `summary.json` states them, and those of two runs side by side.

use city3d_protocol::snapshot::Status;
use city3d_simulation::runner::Summary;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Largest summary that is read: a day of a busy city has less.
const LARGEST_BYTES: u64 = 256 << 20;

/// A folder whose measures cannot be read.
#[derive(Debug, Error)]
pub enum MeasuresError {
    /// The folder has no summary.
    #[error(
        "{0}: there is no summary.json; only runs that have ended have one. Close the window or reset the run that \
         writes it, or record it again"
    )]
    Missing(PathBuf),
    /// The summary cannot be read.
    #[error("{path}: {reason}")]
    Unreadable {
        /// Path of the summary.
        path: PathBuf,
        /// Reason of the operating system.
        reason: std::io::Error,
    },
    /// The file is no summary of a run.
    #[error("{path}: this is no summary of a run: {reason}")]
    Damaged {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with it, with its place.
        reason: serde_json::Error,
    },
}

/// Measures of a whole run, and of its vehicles; full-scale SI units.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct RunMeasures {
    /// Name of the scenario.
    pub scenario: String,
    /// SHA-256 of the scenario's text; empty in a summary of an earlier version, which does not say.
    #[serde(default)]
    pub scenario_digest: String,
    /// Seed of the random draws.
    pub seed: u64,
    /// Environment between control framework and vehicles; empty in a summary of an earlier version, which does not say.
    #[serde(default)]
    pub environment: String,
    /// Vehicles of the laboratory are measured with noise and losses, though the environment is ideal.
    #[serde(default)]
    pub ideal_but_for_lab: bool,
    /// Simulated time at the end.
    pub simulated_s: f64,
    /// One between two vehicles counts once.
    pub collisions: u64,
    /// Mean over the vehicles.
    pub mean_speed_mps: f64,
    /// Of the whole city.
    #[serde(default)]
    pub traffic: CityMeasures,
    /// By vehicle id.
    #[serde(default)]
    pub vehicles: BTreeMap<u32, VehicleMeasures>,
    /// Of a run that went on beyond the end of its scenario: what it had come to there.
    #[serde(default)]
    pub at_scenario_end: Option<Box<Self>>,
}

/// Simulated times that differ by less are the same.
const SAME_TIME_S: f64 = 0.5;

/// Delay, fuel and surrogate safety of the whole city; `None` where a run has no value.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct CityMeasures {
    /// Vehicles at the end of their routes.
    pub arrived: Option<u64>,
    /// How often vehicles came to stand, as the panel Traffic counts it.
    pub stops: Option<u64>,
    /// Mean delay of the trips.
    pub mean_delay_s: Option<f64>,
    /// Vehicles that arrive in an hour, where at least two have.
    pub throughput_per_h: Option<f64>,
    /// Time that all vehicles stood.
    pub stood_s: Option<f64>,
    /// Fuel of all vehicles.
    pub fuel_ml: Option<f64>,
    /// Least time to collision.
    pub min_ttc_s: Option<f64>,
    /// Least post-encroachment time.
    pub min_pet_s: Option<f64>,
    /// Least gap to a leader.
    pub min_gap_m: Option<f64>,
}

/// Measures of one vehicle.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct VehicleMeasures {
    /// Name in the scenario.
    pub name: String,
    /// Distance driven.
    pub distance_m: f64,
    /// Distance over the time in the city.
    pub mean_speed_mps: f64,
    /// Its share of the traffic's measures.
    #[serde(default)]
    pub traffic: VehicleTrafficMeasures,
    /// Status at the end; a summary of an earlier version does not say.
    #[serde(default)]
    pub status: Option<Status>,
    /// It has left the city, without a stop at its end; a summary of an earlier version does not say.
    #[serde(default)]
    pub has_left: bool,
    /// How often it stood, by its events, the end of its route among them; a summary of an earlier version does not say.
    #[serde(default)]
    pub stops: Option<u64>,
    /// Longest standstill.
    pub longest_stand_s: f64,
    /// One between two vehicles counts for both.
    pub collisions: u64,
    /// It is parked, and nobody has driven it off; a summary of an earlier version does not say.
    #[serde(default)]
    pub is_obstacle: bool,
    /// A person has driven it; a summary of an earlier version does not say.
    #[serde(default)]
    pub driven_by_hand: bool,
}

/// The part of one vehicle in the traffic's measures; `None` where a run has no value.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct VehicleTrafficMeasures {
    /// How often it came to stand.
    pub slow_stops: Option<u64>,
}

/// Unit of a measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeasureUnit {
    /// A number of things.
    Count,
    /// Seconds.
    Seconds,
    /// Metres of the full-scale city.
    Metres,
    /// Metres per second of the full-scale city.
    MetresPerSecond,
    /// Millilitres.
    Millilitres,
}

/// A measure of two runs.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasurePair {
    /// The measure in words.
    pub quantity: &'static str,
    /// Unit of the values.
    pub unit: MeasureUnit,
    /// Digits after the point that mean something.
    pub digits: usize,
    /// The vehicle, where it is not a measure of the whole run.
    pub vehicle: Option<String>,
    /// Of the first run and the second; `None` without a value.
    pub values: [Option<f64>; 2],
}

impl MeasurePair {
    /// Second value minus first, where both are known.
    pub fn difference(&self) -> Option<f64> {
        let [first, second] = self.values;
        Some(second? - first?)
    }
}

impl RunMeasures {
    /// The measures of a run that has just ended.
    pub fn of(summary: &Summary) -> Self {
        let vehicle = |vehicle: &city3d_simulation::runner::VehicleSummary| VehicleMeasures {
            name: vehicle.name.clone(),
            distance_m: vehicle.distance_m,
            mean_speed_mps: vehicle.mean_speed_mps,
            traffic: VehicleTrafficMeasures {
                slow_stops: vehicle.traffic.as_ref().map(|traffic| traffic.slow_stops.into()),
            },
            status: Some(vehicle.status),
            has_left: vehicle.has_left,
            stops: Some(vehicle.stops.into()),
            longest_stand_s: vehicle.longest_stand_s,
            collisions: vehicle.collisions.into(),
            is_obstacle: vehicle.is_obstacle,
            driven_by_hand: vehicle.driven_by_hand,
        };
        let (trips, safety) = (&summary.traffic.trips, &summary.traffic.safety);
        Self {
            scenario: summary.scenario.clone(),
            scenario_digest: summary.scenario_digest.clone(),
            seed: summary.seed,
            environment: summary.environment.to_owned(),
            ideal_but_for_lab: summary.ideal_but_for_lab,
            simulated_s: summary.simulated_s,
            collisions: summary.collisions as u64,
            mean_speed_mps: summary.mean_speed_mps,
            traffic: CityMeasures {
                arrived: Some(summary.traffic.arrived as u64),
                stops: Some(trips.stops.into()),
                mean_delay_s: trips.mean_delay_s,
                throughput_per_h: trips.throughput_per_h,
                stood_s: Some(trips.stood_s),
                fuel_ml: Some(summary.traffic.effort.fuel_ml),
                min_ttc_s: safety.min_ttc_s,
                min_pet_s: safety.min_pet_s,
                min_gap_m: safety.min_gap_m,
            },
            vehicles: summary.vehicles.iter().map(|(id, of)| (*id, vehicle(of))).collect(),
            at_scenario_end: summary.at_scenario_end.as_deref().map(|summary| Box::new(Self::of(summary))),
        }
    }

    /// Reads the measures of a recorded run from its folder, or beside its log.
    ///
    /// # Errors
    /// Where there is no summary, or none that can be read.
    pub fn read(run: &Path) -> Result<Self, MeasuresError> {
        let folder = if run.is_dir() { run } else { run.parent().unwrap_or(run) };
        let path = folder.join("summary.json");
        if !path.is_file() {
            return Err(MeasuresError::Missing(folder.to_path_buf()));
        }
        let unreadable = |reason| MeasuresError::Unreadable { path: path.clone(), reason };
        let mut text = String::new();
        let file = std::fs::File::open(&path).map_err(unreadable)?;
        file.take(LARGEST_BYTES).read_to_string(&mut text).map_err(unreadable)?;
        serde_json::from_str(&text).map_err(|reason| MeasuresError::Damaged { path: path.clone(), reason })
    }

    /// Whether two runs lasted equally long.
    pub fn lasted_as(&self, other: &Self) -> bool {
        (self.simulated_s - other.simulated_s).abs() <= SAME_TIME_S
    }

    /// Two runs over the same time, where they have one: the whole of both, else one of them or both at the end of the scenario.
    pub fn over_common_time<'m>(&'m self, other: &'m Self) -> [&'m Self; 2] {
        let times_of = |run: &'m Self| [Some(run), run.at_scenario_end.as_deref()].into_iter().flatten();
        let pairs = times_of(self).flat_map(|own| times_of(other).map(move |of_other| [own, of_other]));
        let mut common = pairs.filter(|[own, of_other]| own.lasted_as(of_other));
        common.next().unwrap_or([self, other])
    }

    /// What tells runs of one scenario apart, in words: its seed, and its environment where that is known.
    pub fn conditions(&self) -> String {
        match self.environment.as_str() {
            "" => format!("seed {}", self.seed),
            environment if self.ideal_but_for_lab => {
                format!("seed {}, {environment} environment but for lab vehicles", self.seed)
            }
            environment => format!("seed {}, {environment} environment", self.seed),
        }
    }

    /// How often vehicles came to stand; 0 of a run that did not count it.
    pub fn stops(&self) -> u64 {
        self.traffic.stops.unwrap_or_default()
    }

    /// How often vehicles stood before the ends of their routes; `None` of a run that does not say.
    pub fn standstills(&self) -> Option<u64> {
        let on_its_way = |of: &VehicleMeasures| {
            // To arrive is to stand, but nothing has held it up.
            let arrival = u64::from(of.status == Some(Status::Finished) && !of.has_left);
            Some(of.stops?.saturating_sub(arrival))
        };
        self.vehicles.values().map(on_its_way).sum()
    }

    /// Names of the vehicles that a person has driven.
    pub fn driven_by_hand(&self) -> Vec<&str> {
        let driven = self.vehicles.values().filter(|vehicle| vehicle.driven_by_hand);
        driven.map(|vehicle| vehicle.name.as_str()).collect()
    }

    /// Names of the vehicles that another run does not have.
    pub fn only(&self, other: &Self) -> Vec<&str> {
        let is_there = |name: &str| other.vehicles.values().any(|vehicle| vehicle.name == name);
        let names = self.vehicles.values().map(|vehicle| vehicle.name.as_str());
        names.filter(|name| !is_there(name)).collect()
    }

    /// The measures of this run and of another: those of the whole run, then those of each vehicle by name:
    /// first of those that both have, then of those that one has alone.
    pub fn beside(&self, other: &Self) -> Vec<MeasurePair> {
        use MeasureUnit::{Count, Metres, MetresPerSecond, Millilitres, Seconds};
        let runs = [self, other];
        let mut pairs = Vec::new();
        let mut of_run = |quantity, unit, digits, value: &dyn Fn(&Self) -> Option<f64>| {
            let values = runs.map(value);
            if values.iter().any(Option::is_some) {
                pairs.push(MeasurePair { quantity, unit, digits, vehicle: None, values });
            }
        };
        of_run("simulated", Seconds, 1, &|run| Some(run.simulated_s));
        of_run("collisions", Count, 0, &|run| Some(run.collisions as f64));
        of_run("slow stops", Count, 0, &|run| run.traffic.stops.map(|count| count as f64));
        of_run("mean speed", MetresPerSecond, 1, &|run| Some(run.mean_speed_mps));
        of_run("arrived", Count, 0, &|run| run.traffic.arrived.map(|count| count as f64));
        of_run("mean delay", Seconds, 1, &|run| run.traffic.mean_delay_s);
        of_run("time standing, the start too", Seconds, 1, &|run| run.traffic.stood_s);
        of_run("fuel, none while braking", Millilitres, 1, &|run| run.traffic.fuel_ml);
        of_run("least time to collision", Seconds, 2, &|run| run.traffic.min_ttc_s);
        of_run("least post-encroachment time", Seconds, 2, &|run| run.traffic.min_pet_s);
        of_run("least gap", Metres, 2, &|run| run.traffic.min_gap_m);
        let named: BTreeMap<&str, &VehicleMeasures> =
            other.vehicles.values().map(|vehicle| (vehicle.name.as_str(), vehicle)).collect();
        let (both, alone): (Vec<_>, Vec<_>) = self
            .vehicles
            .values()
            .map(|first| [Some(first), named.get(first.name.as_str()).copied()])
            .partition(|of| of[1].is_some());
        let own: BTreeSet<&str> = self.vehicles.values().map(|vehicle| vehicle.name.as_str()).collect();
        let others = other.vehicles.values().filter(|vehicle| !own.contains(vehicle.name.as_str()));
        let others = others.map(|second| [None, Some(second)]);
        pairs.extend(both.into_iter().chain(alone).chain(others).flat_map(VehicleMeasures::pairs));
        pairs
    }
}

impl VehicleMeasures {
    /// The measures of a vehicle in two runs, of which one may be without it.
    fn pairs(runs: [Option<&Self>; 2]) -> impl Iterator<Item = MeasurePair> {
        use MeasureUnit::{Count, Metres, MetresPerSecond, Seconds};
        let name = runs.iter().flatten().next().map(|vehicle| vehicle.name.clone());
        let pair = |quantity, unit, digits, value: fn(&Self) -> Option<f64>| MeasurePair {
            quantity,
            unit,
            digits,
            vehicle: name.clone(),
            values: runs.map(|of| of.and_then(value)),
        };
        [
            pair("mean speed", MetresPerSecond, 1, |of| Some(of.mean_speed_mps)),
            pair("distance", Metres, 1, |of| Some(of.distance_m)),
            pair("slow stops", Count, 0, |of| of.traffic.slow_stops.map(|count| count as f64)),
            pair("longest stand", Seconds, 1, |of| Some(of.longest_stand_s)),
            pair("collisions", Count, 0, |of| Some(of.collisions as f64)),
        ]
        .into_iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::Event;
    use city3d_simulation::environment::EnvironmentProfile;
    use city3d_simulation::runner::{Observer, Run};
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use std::sync::Arc;

    fn summary(seed: u64) -> Summary {
        summary_of("straight", Overrides { seed: Some(seed), duration_s: Some(4.0), ..Overrides::default() })
    }

    fn summary_of(scenario: &str, overrides: Overrides) -> Summary {
        let (text, library) = Library::scenario(scenario).unwrap();
        let experiment = Arc::new(read_experiment(scenario, &text, &library, overrides).unwrap());
        let mut run = Run::new(Arc::clone(&experiment)).unwrap();
        let (mut observer, mut events) = (Observer::new(&experiment), Vec::<Event>::new());
        while run.snapshot().tick < experiment.ticks() {
            run.step();
            observer.observe(Some(run.mainframe()), run.snapshot(), &mut events);
        }
        Summary::new(&experiment, &observer, run.snapshot(), events, 1.0)
    }

    #[test]
    fn a_summary_is_read_as_it_was_written_and_compared() {
        let folder = tempfile::tempdir().unwrap();
        let written = summary(7);
        let path = folder.path().join("summary.json");
        std::fs::write(&path, serde_json::to_string_pretty(&written).unwrap()).unwrap();
        let (known, read) = (RunMeasures::of(&written), RunMeasures::read(folder.path()).unwrap());
        assert_eq!(known, read);
        assert_eq!(read.conditions(), "seed 7, ideal environment");
        assert_eq!(RunMeasures::read(&folder.path().join("run.mcap")).unwrap(), read);
        let mut other = read.clone();
        other.collisions = 3;
        other.vehicles.get_mut(&1).unwrap().mean_speed_mps += 1.0;
        let pairs = read.beside(&other);
        let find = |quantity: &str, vehicle: Option<&str>| {
            let is_it = |pair: &&MeasurePair| pair.quantity == quantity && pair.vehicle.as_deref() == vehicle;
            pairs.iter().find(is_it).unwrap()
        };
        assert_eq!(find("collisions", None).values, [Some(0.0), Some(3.0)]);
        let name = read.vehicles[&1].name.as_str();
        assert!((find("mean speed", Some(name)).difference().unwrap() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_summary_of_an_earlier_version_is_read_without_its_environment() {
        let folder = tempfile::tempdir().unwrap();
        let testbed = Overrides {
            environment: Some(EnvironmentProfile::Testbed),
            duration_s: Some(0.5),
            ..Overrides::default()
        };
        let written = summary_of("straight", testbed);
        assert_eq!(RunMeasures::of(&written).conditions(), "seed 1, testbed environment");
        let mut fields = serde_json::to_value(&written).unwrap();
        assert_eq!(fields.as_object_mut().unwrap().remove("environment").unwrap(), "testbed");
        std::fs::write(folder.path().join("summary.json"), fields.to_string()).unwrap();
        assert_eq!(RunMeasures::read(folder.path()).unwrap().conditions(), "seed 1");
    }

    #[test]
    fn a_stop_is_that_of_the_traffic_for_a_run_and_for_its_vehicles() {
        let written = summary_of("roundabout", Overrides::default());
        let stands: u32 = written.vehicles.values().map(|vehicle| vehicle.stops).sum();
        let slow = written.traffic.trips.stops;
        assert!(slow > 0 && slow != stands, "the two thresholds differ here: {slow}, {stands}");
        let read = RunMeasures::of(&written);
        let pairs = read.beside(&read);
        let stops = |of_run: bool| -> f64 {
            let is_it =
                |pair: &&MeasurePair| pair.quantity == "slow stops" && pair.vehicle.is_none() == of_run;
            pairs.iter().filter(is_it).filter_map(|pair| pair.values[0]).sum()
        };
        assert_eq!((read.stops(), stops(true), stops(false)), (slow.into(), slow.into(), slow.into()));
        // Who stands at the end of its route has arrived.
        let arrived = written.vehicles.values().filter(|vehicle| vehicle.status == Status::Finished).count();
        assert!(arrived > 0);
        assert_eq!(read.standstills(), Some(u64::from(stands) - arrived as u64));
    }

    #[test]
    fn who_leaves_the_city_stands_at_no_end() {
        let of = |status, has_left, stops| VehicleMeasures {
            status: Some(status),
            has_left,
            stops: Some(stops),
            ..VehicleMeasures::default()
        };
        let vehicles =
            [of(Status::Finished, true, 2), of(Status::Finished, false, 2), of(Status::Driving, false, 1)];
        let run = RunMeasures { vehicles: (1..).zip(vehicles).collect(), ..RunMeasures::default() };
        assert_eq!(run.standstills(), Some(4));
    }

    #[test]
    fn vehicles_are_paired_by_name_whatever_their_numbers() {
        let named = |name: &str| VehicleMeasures { name: name.to_owned(), ..VehicleMeasures::default() };
        let run = |vehicles: &[(u32, &str)]| RunMeasures {
            vehicles: vehicles.iter().map(|(id, name)| (*id, named(name))).collect(),
            ..RunMeasures::default()
        };
        let (a, b) = (run(&[(1, "van"), (2, "bus")]), run(&[(1, "bus"), (7, "tram")]));
        let pairs = a.beside(&b);
        let vehicles: Vec<&str> = pairs.iter().filter_map(|pair| pair.vehicle.as_deref()).collect();
        assert_eq!(vehicles, [["bus"; 5], ["van"; 5], ["tram"; 5]].concat());
        let distances: Vec<[bool; 2]> = pairs
            .iter()
            .filter(|pair| pair.vehicle.is_some() && pair.quantity == "distance")
            .map(|pair| pair.values.map(|value| value.is_some()))
            .collect();
        assert_eq!(distances, [[true, true], [true, false], [false, true]]);
        assert_eq!((a.only(&b), b.only(&a)), (vec!["van"], vec!["tram"]));
    }

    #[test]
    fn folders_without_a_summary_say_so() {
        let folder = tempfile::tempdir().unwrap();
        let said = RunMeasures::read(folder.path()).unwrap_err().to_string();
        assert!(said.contains("there is no summary.json"), "{said}");
        std::fs::write(folder.path().join("summary.json"), "{ \"scenario\": 7 }").unwrap();
        let said = RunMeasures::read(folder.path()).unwrap_err().to_string();
        assert!(said.contains("no summary of a run") && said.contains("line 1"), "{said}");
    }
}
