//! Reader of bags of ROS 2 in SQLite (`.db3`), the default storage of rosbag2 up to Iron.
//!
//! Tables: `topics(id, name, type, serialization_format, ...)` and `messages(id, topic_id, timestamp, data)`, see
//! <https://github.com/ros2/rosbag2>, `rosbag2_storage_sqlite3`. A database can state more than it has: views compute without an
//! end, and pages that are used many times hold any number of rows. So only tables are read, nothing is written, and the
//! work of SQLite and the sum of the rows are bounded by the size of the file.

use super::message::is_pose_type;
use crate::record::{RecordError, input};
use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, Error, ErrorCode, OpenFlags};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use thiserror::Error as ThisError;

/// Longest message of a topic with poses, bytes.
const LARGEST_MESSAGE: u64 = 1 << 20;
/// Longest text or blob that SQLite makes, bytes: a message and what the query computes of it.
const LARGEST_VALUE: i32 = 2 << 20;
/// Longest name of a topic or type, bytes.
const LONGEST_NAME: usize = 1024;
const MOST_TOPICS: usize = 10_000;

/// Steps of SQLite's virtual machine between two looks at what is left of the work, and their number for any file. A
/// row takes about 20 steps, and at least 20 bytes.
const STEPS: u64 = 10_000;
const FREE_LOOKS: u64 = 1_000;
const STEPS_PER_BYTE: u64 = 8;

/// What is wrong with a database.
#[derive(Debug, ThisError)]
enum Fault {
    #[error(
        "its header is that of no SQLite database: it is cut off or damaged; copy it again, or record it again"
    )]
    NoDatabase,
    #[error(
        "the database is damaged or cut off ({said}): copy it again, or save what is whole of it with sqlite3 '{}' .dump | \
         sed 's/^ROLLBACK.*/COMMIT;/' | sqlite3 rescued.db3",
        path.display()
    )]
    Damaged { path: PathBuf, said: String },
    #[error(
        "it was not closed, and {} has its last messages: end the recording, then close it with sqlite3 '{}' \"pragma \
         journal_mode = delete\"",
        beside.display(), path.display()
    )]
    NotClosed { path: PathBuf, beside: PathBuf },
    #[error(
        "it has no table {0} as rosbag2 writes it ({1}); give a .db3 file of rosbag2, or the folder of the bag"
    )]
    Schema(&'static str, String),
    #[error("the {column} of topic {row} is not {right}: the bag was not written by rosbag2, or is damaged")]
    Topic { row: usize, column: &'static str, right: String },
    #[error("it has more than {MOST_TOPICS} topics; keep those with poses (ros2 bag convert)")]
    Topics,
    #[error(
        "the messages of {topic} are serialized as \"{format}\"; convert the bag to cdr (ros2 bag convert)"
    )]
    Serialization { topic: String, format: String },
    #[error("message {row} ({topic}) has {found} where bytes are expected: record or convert the bag again")]
    NoBytes { row: u64, topic: String, found: String },
    #[error(
        "message {row} ({topic}) has {length} bytes, and poses have at most {LARGEST_MESSAGE}: record {topic} again"
    )]
    TooLong { row: u64, topic: String, length: u64 },
    #[error("its tables have more than the file can hold: it is damaged, or made to do harm")]
    Endless,
    #[error("SQLite: {0}")]
    Other(Error),
}

/// Calls `take` with type, topic and bytes of each message of the types that have poses, in the order in which they were
/// recorded.
///
/// # Errors
/// [`RecordError::Unreadable`] where the file is no regular file, [`RecordError::NoBag`] where it is damaged, has other
/// tables, or exceeds a limit.
pub fn read(path: &Path, take: impl FnMut(&str, &str, &[u8])) -> Result<(), RecordError> {
    let unreadable = |reason| RecordError::Unreadable { path: path.to_path_buf(), reason };
    let (file, size) = input::open(path).map_err(unreadable)?;
    let wrong = |fault: Fault| RecordError::NoBag { path: path.to_path_buf(), reason: fault.to_string() };
    if !has_whole_pages(file, size).map_err(unreadable)? {
        let said = "its last page is not whole".to_owned();
        return Err(wrong(Fault::Damaged { path: path.to_path_buf(), said }));
    }
    for ending in ["-wal", "-journal"] {
        let beside = with_ending(path, ending);
        if std::fs::metadata(&beside).is_ok_and(|beside| beside.len() > 0) {
            return Err(wrong(Fault::NotClosed { path: path.to_path_buf(), beside }));
        }
    }
    Database::open(path, size).and_then(|database| database.messages(take)).map_err(wrong)
}

/// Whether a file ends with a page: SQLite takes what a last page lacks for zeros.
fn has_whole_pages(file: File, size: u64) -> std::io::Result<bool> {
    const PLACE: usize = 16;
    let mut header = Vec::new();
    file.take(PLACE as u64 + 2).read_to_end(&mut header)?;
    let page =
        header.get(PLACE..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u16::from_be_bytes(*bytes));
    // 1 stands for 65536; a size that no page has is left to SQLite to refuse.
    let page = if page == 1 { 65_536 } else { u64::from(page) };
    Ok(!page.is_power_of_two() || size.is_multiple_of(page))
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(ending);
    PathBuf::from(name)
}

/// The address by which SQLite neither locks the file nor makes another one beside it.
fn immutable_uri(path: &Path) -> std::io::Result<String> {
    let mut uri = "file://".to_owned();
    for &byte in std::path::absolute(path)?.as_os_str().as_encoded_bytes() {
        if byte.is_ascii_alphanumeric() || b"/._-".contains(&byte) {
            uri.push(char::from(byte));
        } else {
            // Writing to a string does not fail.
            let _ = write!(uri, "%{byte:02x}");
        }
    }
    Ok(uri + "?immutable=1")
}

/// Bounds what a database may cost, and trusts nothing that it defines.
fn bound(connection: &mut Connection, size: u64) -> rusqlite::Result<()> {
    connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, LARGEST_VALUE)?;
    connection.set_limit(Limit::SQLITE_LIMIT_ATTACHED, 0)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    let mut looks = FREE_LOOKS.saturating_add(size.saturating_mul(STEPS_PER_BYTE) / STEPS);
    let is_enough = move || {
        looks = looks.saturating_sub(1);
        looks == 0
    };
    connection.progress_handler(STEPS as i32, Some(is_enough))?;
    connection.pragma_update(None, "cell_size_check", true)
}

struct Topic {
    kind: String,
    name: String,
}

/// A database that is open for reading.
struct Database<'a> {
    path: &'a Path,
    size: u64,
    connection: Connection,
}

impl<'a> Database<'a> {
    fn open(path: &'a Path, size: u64) -> Result<Self, Fault> {
        let uri = immutable_uri(path).map_err(|_| Fault::Other(Error::InvalidPath(path.to_path_buf())))?;
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
            | OpenFlags::SQLITE_OPEN_URI
            | OpenFlags::SQLITE_OPEN_NO_MUTEX
            | OpenFlags::SQLITE_OPEN_EXRESCODE;
        let mut connection = Connection::open_with_flags(uri, flags).map_err(Fault::Other)?;
        bound(&mut connection, size).map_err(|error| fault_of(error, path))?;
        Ok(Self { path, size, connection })
    }

    fn fault(&self, error: Error) -> Fault {
        fault_of(error, self.path)
    }

    /// Refuses views and virtual tables, whose rows are computed.
    fn check_table(&self, name: &'static str) -> Result<(), Fault> {
        let query = "SELECT type FROM pragma_table_list WHERE schema = 'main' AND name = ?1";
        match self.connection.query_row(query, [name], |row| row.get::<_, String>(0)) {
            Ok(kind) if kind == "table" => Ok(()),
            Ok(kind) => Err(Fault::Schema(name, format!("it is a {kind}"))),
            Err(Error::QueryReturnedNoRows) => Err(Fault::Schema(name, "there is none".to_owned())),
            Err(error) => Err(self.fault(error)),
        }
    }

    fn prepare(&self, table: &'static str, query: &str) -> Result<rusqlite::Statement<'_>, Fault> {
        self.check_table(table)?;
        self.connection.prepare(query).map_err(|error| match error {
            Error::SqlInputError { msg, .. } => Fault::Schema(table, msg),
            error => self.fault(error),
        })
    }

    /// The topics of the types that have poses.
    fn topics(&self) -> Result<BTreeMap<i64, Topic>, Fault> {
        let query = "SELECT id, name, type, serialization_format FROM topics";
        let mut statement = self.prepare("topics", query)?;
        let mut rows = statement.query([]).map_err(|error| self.fault(error))?;
        let mut topics = BTreeMap::new();
        let mut count = 0;
        while let Some(row) = rows.next().map_err(|error| self.fault(error))? {
            count += 1;
            if count > MOST_TOPICS {
                return Err(Fault::Topics);
            }
            let wrong = |column, right: &str| Fault::Topic { row: count, column, right: right.to_owned() };
            let value = |place| row.get_ref(place).map_err(|error| self.fault(error));
            let ValueRef::Integer(id) = value(0)? else { return Err(wrong("id", "an integer")) };
            let name = |place, column| {
                let right = || wrong(column, &format!("a name in UTF-8 of at most {LONGEST_NAME} bytes"));
                name_of(value(place)?).ok_or_else(right)
            };
            let (topic, kind, format) =
                (name(1, "name")?, name(2, "type")?, name(3, "serialization_format")?);
            if !is_pose_type(&kind) {
                continue;
            }
            if format != "cdr" {
                return Err(Fault::Serialization { topic, format });
            }
            topics.insert(id, Topic { kind, name: topic });
        }
        Ok(topics)
    }

    fn messages(&self, mut take: impl FnMut(&str, &str, &[u8])) -> Result<(), Fault> {
        let topics = self.topics()?;
        // Long messages, such as pictures, are not read: their type and length are in the row's header.
        let query = format!(
            "SELECT topic_id, typeof(data), length(data), CASE WHEN length(data) <= {LARGEST_MESSAGE} THEN data END \
             FROM messages"
        );
        let mut statement = self.prepare("messages", &query)?;
        let mut rows = statement.query([]).map_err(|error| self.fault(error))?;
        let (mut count, mut bytes) = (0_u64, 0_u64);
        while let Some(row) = rows.next().map_err(|error| self.fault(error))? {
            let value = |place| row.get_ref(place).map_err(|error| self.fault(error));
            count += 1;
            let length = if let ValueRef::Integer(length) = value(2)? { length.max(0) as u64 } else { 0 };
            bytes = bytes.saturating_add(length);
            if count.saturating_add(bytes) > self.size {
                return Err(Fault::Endless);
            }
            let ValueRef::Integer(id) = value(0)? else { continue };
            let Some(Topic { kind, name }) = topics.get(&id) else { continue };
            match value(3)? {
                ValueRef::Blob(data) => take(kind, name, data),
                _ => return Err(no_bytes(count, name, value(1)?, length)),
            }
        }
        Ok(())
    }
}

/// The fault of a message without bytes.
fn no_bytes(row: u64, topic: &str, kind: ValueRef<'_>, length: u64) -> Fault {
    let topic = topic.to_owned();
    match kind.as_str() {
        Ok("blob") => Fault::TooLong { row, topic, length },
        Ok(found) => Fault::NoBytes { row, topic, found: found.to_owned() },
        Err(_) => Fault::NoBytes { row, topic, found: "nothing".to_owned() },
    }
}

fn name_of(value: ValueRef<'_>) -> Option<String> {
    let ValueRef::Text(bytes) = value else { return None };
    let text = std::str::from_utf8(bytes).ok().filter(|text| text.len() <= LONGEST_NAME)?;
    (!text.chars().any(char::is_control)).then(|| text.to_owned())
}

fn fault_of(error: Error, path: &Path) -> Fault {
    match error.sqlite_error_code() {
        Some(ErrorCode::NotADatabase) => Fault::NoDatabase,
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::SystemIoFailure | ErrorCode::TooBig) => {
            Fault::Damaged { path: path.to_path_buf(), said: error.to_string() }
        }
        Some(ErrorCode::OperationInterrupted) => Fault::Endless,
        _ => Fault::Other(error),
    }
}

#[cfg(test)]
mod tests;
