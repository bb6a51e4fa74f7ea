//! The view model: what the panels show in one frame, and the pictures that they ask for.

use super::{ChartView, ControlZoneArea, EditView, LiveTraffic, ScenarioCamera, VideoStatus, runs};
use crate::cockpit::SteeringGeometry;
use city3d_control::Route;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_roadmap::{CityMap, LaneId};
use city3d_scene::{RoadsOut, Wall};
use city3d_sensors::{PictureKind, View};
use city3d_session::playback::{Playhead, TimelineMark};
use city3d_session::{RunHistory, RunState};
use city3d_simulation::measures::Tracked;
use std::collections::BTreeMap;
use std::path::Path;

/// Names of the control algorithms, by vehicle.
pub type DriverNames = BTreeMap<VehicleId, String>;

/// Names of vehicles, also of those that have left or are still to come.
pub type VehicleNames = BTreeMap<VehicleId, String>;

/// The view model: the data that the panels show in one frame.
#[derive(Debug)]
pub struct ViewModel<'a> {
    /// The state that tables and numbers show.
    pub run_state: &'a RunState,
    /// The snapshot that the pictures show, interpolated between the last two while the run goes on.
    pub interpolated: &'a FrameSnapshot,
    /// Past states of the run.
    pub history: &'a RunHistory,
    /// Events of the run, of a live one those so far.
    pub events: &'a [TimelineMark],
    /// Live measures of the run.
    pub traffic: &'a LiveTraffic,
    /// Lane graph of the city, city frame.
    pub map: &'a CityMap,
    /// Control zones of the scenario.
    pub control_zones: &'a [ControlZoneArea],
    /// Walls that occlude vehicles.
    pub walls: &'a [Wall],
    /// The roads that lead out of the town.
    pub roads_out: &'a RoadsOut,
    /// Names of all vehicles of the run.
    pub names: &'a VehicleNames,
    /// Control algorithm of each vehicle; it drives while no person does.
    pub drivers: &'a DriverNames,
    /// Planned lanes of each vehicle, by the scenario.
    pub routes: &'a BTreeMap<VehicleId, Vec<LaneId>>,
    /// Cameras that the scenario gives vehicles.
    pub cameras: &'a BTreeMap<VehicleId, Vec<ScenarioCamera>>,
    /// Geometry for manual driving.
    pub steering_geometry: &'a BTreeMap<VehicleId, SteeringGeometry>,
    /// The scenario as it was requested: a shipped name or a file. In a replay, the path of the log.
    pub scenario: &'a str,
    /// Seed and environment of the run, in words.
    pub conditions: &'a str,
    /// Duration that the scenario sets, simulated seconds; a run may go on beyond it.
    pub duration_s: f64,
    /// Scenarios to choose from.
    pub scenarios: &'a [ScenarioChoice],
    /// What is being loaded, in words; nothing changes until it is loaded.
    pub loading: Option<&'a str>,
    /// Textures of the requested pictures.
    pub textures: &'a BTreeMap<PictureSlot, egui::TextureId>,
    /// Text of the footer: the adapter, the folder of the log.
    pub footer: &'a str,
    /// Frames of the window per second.
    pub frames_per_s: f64,
    /// Pixel budget of the large view while it moves; above it the resolution is reduced.
    pub most_moving_pixels: Option<u32>,
    /// Pedals, steering and lateral errors are known; otherwise only poses are.
    pub has_control_data: bool,
    /// Where the city runs, and so what can be asked of it.
    pub city: CityKind,
    /// The playback, where a recorded run is shown.
    pub replay: Option<ReplayView<'a>>,
    /// Recent files, recorded runs, and what can be run again.
    pub runs: runs::RunsView<'a>,
    /// Which time of a run that goes on is shown.
    pub past: PastView,
    /// Duration of a step of the simulation, seconds.
    pub step_s: f64,
    /// The chart, where one is open.
    pub chart: ChartView<'a>,
    /// The video that is being recorded.
    pub video: Option<VideoStatus>,
    /// The video that was written last.
    pub last_video: Option<&'a Path>,
    /// The scenario that is edited; then the vehicles are shown as it starts them.
    pub edit: Option<EditView<'a>>,
}

/// Which time of a run that goes on the window shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PastView {
    /// The playhead; it ends at the present.
    pub head: Playhead,
    /// The past is shown, while the city drives on.
    pub is_shown: bool,
}

/// Where a city runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CityKind {
    /// In this window's process, with its control framework.
    #[default]
    Local,
    /// In this window's process, for controllers that connect.
    Served,
    /// Somewhere else; it is watched over the link.
    Elsewhere,
}

impl ViewModel<'_> {
    /// The lanes that a vehicle is to follow: those of the control framework where it is known, for it reroutes who leaves its
    /// own; else those of the scenario. Empty where neither is known.
    pub fn route_of(&self, id: VehicleId) -> &[LaneId] {
        let told = self.traffic.measures().vehicle(id).filter(|_| self.edit.is_none());
        let told = told.and_then(Tracked::route).map(Route::lanes);
        told.unwrap_or_else(|| self.routes.get(&id).map_or(&[][..], Vec::as_slice))
    }

    /// Whether the user may take control of a vehicle.
    pub fn may_drive(&self, vehicle: VehicleId) -> bool {
        let own = self.run_state.link.as_ref().and_then(|link| link.own_vehicle);
        let is_physical = self.run_state.now.info(vehicle).is_some_and(|info| info.is_physical());
        !is_physical && self.edit.is_none() && (self.city != CityKind::Elsewhere || own == Some(vehicle))
    }

    /// Whether the present of the run is beyond its start.
    pub fn has_begun(&self) -> bool {
        let present_s = if self.past.is_shown { self.past.head.to_s } else { self.run_state.now.time_s };
        present_s > 0.0
    }

    /// Scale of the laboratory.
    pub(super) fn scale(&self) -> city3d_geometry::LengthScale {
        self.traffic.measures().scale()
    }

    pub(super) fn cameras_of(&self, vehicle: VehicleId) -> &[ScenarioCamera] {
        self.cameras.get(&vehicle).map_or(&[], Vec::as_slice)
    }
}

/// A scenario that the user can choose.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ScenarioChoice {
    /// A shipped name, or a file.
    pub name: String,
    /// Its description.
    pub description: String,
}

/// A recorded run and its playhead.
#[derive(Clone, Copy, Debug)]
pub struct ReplayView<'a> {
    /// Name of the recorded scenario.
    pub name: &'a str,
    /// Position, direction and speed of the playback in this frame.
    pub head: Playhead,
    /// Events in order of time.
    pub marks: &'a [TimelineMark],
    /// Fraction of the log that has been scanned for events, 0 to 1.
    pub searched: f64,
    /// Why the log is truncated, if it is.
    pub truncation: Option<&'a str>,
    /// It waits for a chunk of the log (buffering).
    pub is_late: bool,
}

/// Where a picture is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PictureSlot {
    /// The large view of the city.
    City,
    /// The preview of this vehicle.
    Preview(VehicleId),
    /// One of the views beside the first one, from 0.
    View(usize),
}

/// A picture that the panels request for this frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureRequest {
    /// The panel that shows the picture.
    pub slot: PictureSlot,
    /// Camera and resolution of the picture, city frame.
    pub view: View,
    /// What its pixels show.
    pub kind: PictureKind,
}
