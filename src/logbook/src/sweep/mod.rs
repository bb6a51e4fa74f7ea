//! Results of parameter sweeps: tables and their shards, maps of the outcome, and delays by curves.

mod delay;
mod delay_figure;
mod identity;
mod interval;
mod map;
mod parquet;
mod recorded;
mod shard;
mod table;

pub use delay::{DelayAxis, DelayCurves, DelayPoint, DifferentAxes};
pub use delay_figure::DELAY_FLOW;
pub use identity::SweepIdentity;
pub use interval::MeanInterval;
pub use map::{MAPS, SweepResults};
pub use parquet::write_parquet;
pub use recorded::{RecordedSweep, RecordedSweepError};
pub use shard::{FoundShards, SHARD_TABLE, SHARDS, ShardError, ShardFolder, ShardHead, ShardOrigin};
pub use table::{SweepHeader, SweepRow, SweepTable, SweepTableError, row};
