//! Metrics and figures of runs, from their logs alone, or while they go on.

pub mod chart;
mod compare;
mod draw;
mod gap;
mod labels;
mod metres;
mod occupancy;
mod pair;
mod path_views;
mod paths;
mod plan;
mod quantity;
mod run;
mod series;
mod settings;
mod style;
mod table;
mod track;
mod vehicle_views;
mod views;
mod way;

pub use compare::{Comparison, ComparisonRow, ComparisonValue, RunHeader, RunSeparation};
pub use draw::{DrawError, FigureSize, WriteError, png, svg, write};
pub use occupancy::{ZoneStay, zone_stays};
pub use pair::{CompareError, RunPair, some_names};
pub use paths::{
    GiveWayKind, GiveWayLine, MergingPoint, PathError, Stream, StreamLayout, StreamMember, crossings, merges,
    passing,
};
pub use quantity::{FigureScale, Quantity, SeriesFigure, compared};
pub use run::{RunError, RunLog, Trace, TraceBuilder, TraceSample};
pub use series::{AVERAGED_S, differences, moving_average, rms_speed_difference};
pub use style::distinct_styles;
pub use table::{TidyTable, number};
pub use track::{LaneVisit, MatchedPath};
pub use views::FigureSet;
pub use way::{WAY_AHEAD_M, WAY_BEHIND_M, WayFigure};
