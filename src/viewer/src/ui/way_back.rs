//! The way back from a jump into the past of a run: the camera from before. What was selected in the past stays selected.

use super::{UiAction, UiState, ViewModel};
use city3d_session::playback::PlaybackCommand;

impl UiState {
    /// Keeps the camera for the way back from a jump into the past.
    pub(super) fn keep_view(&mut self) {
        self.view_before_jump.get_or_insert_with(|| self.viewpoint.clone());
    }

    /// Who goes back to the present sees what they saw before they jumped into the past.
    pub(super) fn look_back_at_present(&mut self, shown: &ViewModel<'_>, actions: &[UiAction]) {
        let goes_live = actions.contains(&UiAction::PlaybackCommand(PlaybackCommand::Live));
        if !(goes_live && shown.past.is_shown) || self.driving.is_some() {
            return;
        }
        if let Some(viewpoint) = self.view_before_jump.take() {
            (self.viewpoint, self.selection.follow) = (viewpoint, None);
        }
    }

    /// In the present there is no way back.
    pub(super) fn forget_view(&mut self, shown: &ViewModel<'_>) {
        if !shown.past.is_shown {
            self.view_before_jump = None;
        }
    }
}
