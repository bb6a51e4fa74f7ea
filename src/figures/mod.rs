//! Numbers and figures of recorded runs, from their logs alone.

pub mod chart;
mod compare;
mod draw;
mod paths;
mod plan;
mod run;
mod series;
mod table;
mod track;
mod views;

pub use compare::{Apart, CompareError, Comparison, Head, Row, Value};
pub use draw::{DrawError, Size, WriteError, png, svg, write};
pub use paths::{Layout, Member, Merge, PathError, Stream, crossings, merges};
pub use run::{RunError, RunLog, Sample, Trace};
pub use series::{AVERAGED_S, differences, moving_average, speed_difference};
pub use table::{Table, number};
pub use track::{Track, Visit};
pub use views::Views;
