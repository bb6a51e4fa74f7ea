//! The program as its users meet it: commands, files, documents, and readers of other hands.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "looks at what a run came to; no state depends on it"
)]

mod changes;
mod cli;
mod damage;
mod demand;
mod docs;
mod figures;
mod fork;
mod golden;
mod models;
mod notices;
mod outputs;
mod peers;
mod playback;
mod recorded;
mod replay;
mod scenarios;
mod shards;
#[path = "../support/mod.rs"]
mod support;
mod sweep;
