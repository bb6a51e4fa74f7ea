//! The program as its users meet it: commands, files, documents, and readers of other hands.

mod cli;
mod docs;
mod figures;
mod fork;
mod golden;
mod models;
mod peers;
mod playback;
mod recorded;
mod replay;
mod scenarios;
#[path = "../support/mod.rs"]
mod support;
mod sweep;
