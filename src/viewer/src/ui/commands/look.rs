//! Actions on the appearance: quality and time of day.

use super::{Command, CommandContext, registry};
use crate::ui::{QualityPreset, UiAction};

registry!(
    LOW = Command::always("Quality: low", &[], |c| quality(c, QualityPreset::Low)),
    MEDIUM = Command::always("Quality: medium", &[], |c| quality(c, QualityPreset::Medium)),
    HIGH = Command::always("Quality: high", &[], |c| quality(c, QualityPreset::High)),
    ULTRA = Command::always("Quality: ultra", &[], |c| quality(c, QualityPreset::Ultra)),
    MORNING = Command::always("Time of day: morning", &[], |c| time(c, 8.0)),
    NOON = Command::always("Time of day: noon", &[], |c| time(c, 12.0)),
    LOW_SUN = Command::always("Time of day: low sun", &[], |c| time(c, 16.5)),
    DUSK = Command::always("Time of day: dusk", &[], |c| time(c, 17.6)),
    NIGHT = Command::always("Time of day: night", &[], |c| time(c, 22.0)),
);

fn quality(context: &mut CommandContext<'_, '_>, preset: QualityPreset) {
    context.state.look.preset = preset;
    context.actions.push(UiAction::Look(context.state.look));
}

fn time(context: &mut CommandContext<'_, '_>, hours: f64) {
    context.state.look.hours = hours;
    context.actions.push(UiAction::Look(context.state.look));
}
