//! Verification of a log: its run is simulated again from its commands, and the state compared at every tick.

use crate::replay::{Replay, ReplayError, StateDifferences, TickDigests};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What a verification has found.
#[derive(Clone, Debug, Serialize)]
pub struct VerifyReport {
    /// Path of the log.
    pub log: PathBuf,
    /// Name of the scenario.
    pub scenario: String,
    /// Version of City3D that wrote the log.
    pub version: String,
    /// Simulated time of the last tick that was compared, seconds.
    pub simulated_s: f64,
    /// Ticks whose states are equal, the beginning among them.
    pub ticks_agreeing: u64,
    /// Why the log has no end, as that of a killed process; its ticks up to there were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torn: Option<String>,
    /// Where the log is damaged and why; no tick behind that was compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damage: Option<String>,
    /// Where the states differ, if they do.
    pub first_difference: Option<FirstDifference>,
}

/// The first tick whose states differ.
#[derive(Clone, Debug, Serialize)]
pub struct FirstDifference {
    /// Physics steps since the start.
    pub tick: u64,
    /// Simulated time of the tick, seconds.
    pub time_s: f64,
    /// Digest of the state in the log, hexadecimal.
    pub recorded: String,
    /// Digest of the simulated state, hexadecimal.
    pub simulated: String,
    /// The tick of the snapshot in which the vehicles were compared; none where the log has no later snapshot.
    pub compared_at_tick: Option<u64>,
    /// Vehicles that differ there, in id order.
    pub vehicles: Vec<DifferentVehicle>,
}

/// A vehicle that differs from the log.
#[derive(Clone, Debug, Serialize)]
pub struct DifferentVehicle {
    /// Number of the vehicle.
    pub id: u32,
    /// Name of the vehicle.
    pub name: String,
    /// Distance between the two positions, city metres; none where only one of them exists.
    pub apart_m: Option<f64>,
}

impl VerifyReport {
    /// Simulates a replay of `log` to its end, or to the first difference; `progress` hears the simulated time.
    ///
    /// # Errors
    /// When the log cannot be replayed.
    pub fn of(replay: &mut Replay, log: &Path, progress: &mut dyn FnMut(f64)) -> Result<Self, ReplayError> {
        let mut ticks_agreeing = 0;
        let mut first_difference = None;
        while let Some(ticked) = replay.step()? {
            if !ticked.agrees() {
                first_difference = Some(FirstDifference::of(replay, ticked)?);
                break;
            }
            ticks_agreeing += 1;
            if ticked.tick.is_multiple_of(100) {
                progress(replay.snapshot().time_s);
            }
        }
        let (damage, torn) = match replay.log().truncation() {
            Some(truncation) if truncation.is_damage() => (Some(truncation.to_string()), None),
            truncation => (None, truncation.map(ToString::to_string)),
        };
        Ok(Self {
            log: log.to_path_buf(),
            scenario: replay.experiment().name.clone(),
            version: replay.log().version().to_owned(),
            simulated_s: replay.snapshot().time_s,
            ticks_agreeing,
            torn,
            damage,
            first_difference,
        })
    }

    /// Why the log is not verified; `None` where all of its ticks were compared and agree. A torn log counts up to where it
    /// ends.
    pub fn failure(&self) -> Option<String> {
        if let Some(first) = &self.first_difference {
            return Some(format!("tick {} differs from the log when it is simulated again", first.tick));
        }
        let log = self.log.display();
        if let Some(damage) = &self.damage {
            return Some(format!(
                "{log}: {damage}; what follows was not compared. Copy the log again, or record it again"
            ));
        }
        let torn = self.torn.as_ref().map(|why| format!(": {why}")).unwrap_or_default();
        let is_empty = self.ticks_agreeing == 0;
        is_empty.then(|| format!("{log}: the log has no tick to compare{torn}; record the run again"))
    }
}

impl FirstDifference {
    fn of(replay: &mut Replay, ticked: TickDigests) -> Result<Self, ReplayError> {
        let time_s = replay.snapshot().time_s;
        let found = replay.differences()?;
        let (compared_at_tick, vehicles) = match found {
            Some(StateDifferences { tick, vehicles }) => (Some(tick), vehicles),
            None => (None, Vec::new()),
        };
        let name = |id| replay.snapshot().info(id).map(|info| info.name.clone()).unwrap_or_default();
        let vehicles = vehicles.into_iter().map(|found| DifferentVehicle {
            id: found.vehicle.0,
            name: name(found.vehicle),
            apart_m: found.apart_m,
        });
        Ok(Self {
            tick: ticked.tick,
            time_s,
            recorded: format!("{:016x}", ticked.recorded),
            simulated: format!("{:016x}", ticked.simulated),
            compared_at_tick,
            vehicles: vehicles.collect(),
        })
    }
}
