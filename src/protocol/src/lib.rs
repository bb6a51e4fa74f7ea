//! What the parts of a city tell each other: snapshots, commands and events inside of a process, and the messages of
//! the UDP link between processes.

pub mod snapshot;
pub mod wire;
