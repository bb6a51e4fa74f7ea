//! What a log says of a run besides its pictures: the commands of persons, which make it again.

use super::RecordError;
use super::log::{COMMAND_TOPIC, NETWORK_TOPIC};
use super::schema::{NetworkCommand, decode_command, decode_network};
use crate::snapshot::SimCommand;
use std::path::Path;

/// The commands of persons in a log, each with the tick at which the step began that applied it.
///
/// # Errors
/// [`RecordError::NoLog`] where the file cannot be read or is damaged.
pub fn read_commands(path: &Path) -> Result<Vec<(u64, SimCommand)>, RecordError> {
    read_topic(path, COMMAND_TOPIC, decode_command)
}

/// What came over the laboratory's link, in the order in which it was carried out.
///
/// # Errors
/// [`RecordError::NoLog`] where the file cannot be read or is damaged.
pub fn read_network(path: &Path) -> Result<Vec<NetworkCommand>, RecordError> {
    read_topic(path, NETWORK_TOPIC, decode_network)
}

fn read_topic<T>(
    path: &Path,
    topic: &str,
    decode: impl Fn(&[u8]) -> Option<T>,
) -> Result<Vec<T>, RecordError> {
    let no_log = |reason: &dyn std::fmt::Display| RecordError::NoLog {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    };
    let bytes = std::fs::read(path).map_err(|error| no_log(&error))?;
    let mut found = Vec::new();
    for message in mcap::MessageStream::new(&bytes).map_err(|error| no_log(&error))? {
        let message = message.map_err(|error| no_log(&error))?;
        if message.channel.topic == topic {
            found.push(decode(&message.data).ok_or_else(|| no_log(&"a command is damaged"))?);
        }
    }
    Ok(found)
}
