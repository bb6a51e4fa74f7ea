//! The layer names of a map drawing and their CAD colours.

use super::SceneryKind;

/// Centre lines of the lanes of roads, which have markings.
pub const LANES: &str = "LANES";
/// Centre lines of lanes across a junction, without markings.
pub const CONNECTORS: &str = "CONNECTORS";
/// Stop lines, drawn across lanes.
pub const STOP_LINES: &str = "STOP_LINES";
/// Yield lines, drawn across lanes.
pub const YIELD_LINES: &str = "YIELD_LINES";
/// Lines across lanes at which their traffic waits for a traffic signal.
pub const SIGNALS: &str = "SIGNALS";
/// Lines from tail to tip: the direction of travel of arcs that get none from a line.
pub const ARROWS: &str = "ARROWS";
/// Texts that name the lanes that they are placed on.
pub const NAMES: &str = "NAMES";
/// Texts with the posted speeds of lanes, laboratory m/s.
pub const SPEEDS: &str = "SPEEDS";
/// Texts that name model files, each at the place where its model stands.
pub const MODELS: &str = "MODELS";
/// What every scenery layer starts with; see [`SceneryKind::layer`].
pub const SCENERY_PREFIX: &str = "SCENERY_";

/// The kind of scenery a layer holds. DXF layer names do not tell capitals from small letters.
pub fn scenery_kind(layer: &str) -> Option<SceneryKind> {
    SceneryKind::ALL.into_iter().find(|kind| kind.layer().eq_ignore_ascii_case(layer))
}

/// AutoCAD colour index of a layer: 7 is black on white and white on black.
pub fn colour(layer: &str) -> u8 {
    match layer.to_ascii_uppercase().as_str() {
        CONNECTORS => 8,
        STOP_LINES => 1,
        YIELD_LINES => 2,
        SIGNALS => 30,
        ARROWS => 3,
        NAMES => 4,
        SPEEDS => 5,
        MODELS => 6,
        _ => scenery_kind(layer).map_or(7, scenery_colour),
    }
}

fn scenery_colour(kind: SceneryKind) -> u8 {
    match kind {
        SceneryKind::Building => 33,
        SceneryKind::Wall => 252,
        SceneryKind::Hedge => 94,
        SceneryKind::Tree => 96,
        SceneryKind::Lamp => 41,
        SceneryKind::Bench => 35,
        SceneryKind::Grass => 72,
        SceneryKind::Bed => 220,
        SceneryKind::Water => 150,
        SceneryKind::Paving => 254,
        SceneryKind::Parking => 250,
        SceneryKind::Playground => 30,
        SceneryKind::PicnicTable => 37,
    }
}
