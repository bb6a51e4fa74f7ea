//! Settings that a window keeps for the next one.

use super::{CityKind, ViewedRun, ViewerState};
use crate::ui::{self, Preview};
use crate::window::settings::{ViewSettings, WatchedVehicles};
use city3d_protocol::snapshot::VehicleId;
use std::sync::Arc;

impl ViewerState {
    /// Restores the stored settings.
    pub fn restore(&mut self, settings: &ViewSettings) {
        self.lists.recent.clone_from(&settings.recent);
        let state = &mut self.state;
        (state.table, state.layers) = (settings.table.clone(), settings.layers);
        state.preferences = settings.preferences.sane();
        state.video_subject = settings.video_subject;
        state.keys = Arc::new(settings.keys.clone());
        if let Some(stored) = &settings.layout {
            (state.layout, state.open) = (ui::Layout::from(stored), stored.open);
        }
        let views = Some(&settings.views).filter(|views| views.scenario == self.request.scenario);
        let find = |name: &String| self.experiment.vehicles.iter().find(|v| v.name == *name).map(|v| v.id);
        let previews = views.into_iter().flat_map(|views| &views.previews);
        state.previews = previews
            .filter_map(|(name, eye)| Some(Preview { eye: *eye, ..Preview::new(find(name)?) }))
            .collect();
        state.opens_preview = views.is_none();
        state.bookmarks = settings.bookmarks.clone();
        // A driver keeps the chase view.
        if state.driving.is_none() {
            let followed = views.and_then(|views| views.followed.as_ref()).and_then(find);
            state.selection.vehicle = followed;
            state.set_mode(settings.mode);
            state.viewpoint.follow = followed;
        }
    }

    /// Stores the settings.
    pub fn remember(&self, settings: &mut ViewSettings) {
        let state = &self.state;
        (settings.table, settings.layers) = (state.table.clone(), state.layers);
        settings.preferences = state.preferences;
        settings.video_subject = state.video_subject;
        settings.keys.clone_from(&state.keys);
        settings.layout = state.layout.stored(state.open);
        (settings.mode, settings.bookmarks) = (state.viewpoint.mode, state.bookmarks.clone());
        settings.recent.clone_from(&self.lists.recent);
        // Settings of a replay, or of a city that keeps its own time, are not stored for the next run.
        let (ViewedRun::Run(live), CityKind::Local) = (&self.source, self.city) else { return };
        settings.speed = Some(live.run_state().speed);
        let name = |id: VehicleId| self.experiment.planned(id).map(|v| v.name.clone());
        let previews = state.previews.iter().filter_map(|p| Some((name(p.vehicle)?, p.eye)));
        settings.views = WatchedVehicles {
            scenario: self.request.scenario.clone(),
            followed: state.viewpoint.follow.and_then(name),
            previews: previews.collect(),
        };
    }
}
