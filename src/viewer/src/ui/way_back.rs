//! The way back from a jump into the past of a run: the camera and the selected vehicle from before.

use super::{Selection, UiAction, UiState, ViewModel};
use city3d_session::playback::PlaybackCommand;

impl UiState {
    /// Keeps camera and selected vehicle for the way back from a jump into the past.
    pub(super) fn keep_view(&mut self) {
        let view = (self.viewpoint.clone(), self.selection.vehicle);
        self.view_before_jump.get_or_insert(view);
    }

    /// Who goes back to the present sees what they saw before they jumped into the past.
    pub(super) fn look_back_at_present(&mut self, shown: &ViewModel<'_>, actions: &[UiAction]) {
        let goes_live = actions.contains(&UiAction::PlaybackCommand(PlaybackCommand::Live));
        if !(goes_live && shown.past.is_shown) || self.driving.is_some() {
            return;
        }
        if let Some((viewpoint, selected)) = self.view_before_jump.take() {
            (self.viewpoint, self.selection) = (viewpoint, Selection { vehicle: selected, follow: None });
            self.table.reveal = true;
        }
    }

    /// In the present there is no way back.
    pub(super) fn forget_view(&mut self, shown: &ViewModel<'_>) {
        if !shown.past.is_shown {
            self.view_before_jump = None;
        }
    }
}
