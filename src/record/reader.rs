//! What a log says of a run besides its pictures: the commands of persons, which make it again.

use super::RecordError;
use super::log::COMMAND_TOPIC;
use super::schema::decode_command;
use crate::snapshot::SimCommand;
use std::path::Path;

/// The commands of persons in a log, each with the tick at which the step began that applied it.
///
/// # Errors
/// [`RecordError::NoLog`] where the file cannot be read or is damaged.
pub fn read_commands(path: &Path) -> Result<Vec<(u64, SimCommand)>, RecordError> {
    let no_log = |reason: &dyn std::fmt::Display| RecordError::NoLog {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    };
    let bytes = std::fs::read(path).map_err(|error| no_log(&error))?;
    let mut commands = Vec::new();
    for message in mcap::MessageStream::new(&bytes).map_err(|error| no_log(&error))? {
        let message = message.map_err(|error| no_log(&error))?;
        if message.channel.topic == COMMAND_TOPIC {
            let command = decode_command(&message.data).ok_or_else(|| no_log(&"a command is damaged"))?;
            commands.push(command);
        }
    }
    Ok(commands)
}
