use super::*;

/// As rosbag2 of Humble makes them.
const SCHEMA: &str = "
    CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
        serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
    CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);";
const TOPICS: &str = "
    INSERT INTO topics VALUES (1, '/a/pose', 'geometry_msgs/msg/PoseStamped', 'cdr', ''), (2, '/image', 'sensor_msgs/msg/Image', 'cdr', '');";

struct Bag {
    folder: tempfile::TempDir,
}

impl Bag {
    fn of(statements: &[&str]) -> Self {
        let bag = Self { folder: tempfile::tempdir().unwrap() };
        let database = Connection::open(bag.path()).unwrap();
        for statement in statements {
            database.execute_batch(statement).unwrap();
        }
        bag
    }

    fn path(&self) -> PathBuf {
        // Letters that mean something in addresses.
        self.folder.path().join("a bag?mode=rw&x=%41#\u{fc}.db3")
    }

    fn read(&self) -> Result<Vec<String>, String> {
        let mut found = Vec::new();
        let taken = read(&self.path(), |kind, topic, data| {
            found.push(format!("{kind} {topic} {}", String::from_utf8_lossy(&data[..data.len().min(9)])));
        });
        taken.map(|()| found).map_err(|error| error.to_string())
    }

    fn assert_refused(&self, why: &str) {
        let said = self.read().map(|found| found.len()).unwrap_err();
        assert!(said.contains(why) && said.contains(&self.path().display().to_string()), "{said}");
    }
}

#[test]
fn messages_of_poses_come_in_their_order_and_nothing_is_written() {
    let long = "INSERT INTO messages VALUES (1, 1, 7, x'6f6e65'), (2, 2, 8, zeroblob(5000000)), (3, 2, 9, 'text'), (4, 1, 1, x'74776f')";
    let bag = Bag::of(&[SCHEMA, TOPICS, long]);
    let expected = ["geometry_msgs/msg/PoseStamped /a/pose one", "geometry_msgs/msg/PoseStamped /a/pose two"];
    assert_eq!(bag.read().unwrap(), expected);
    // One that was kept with a write-ahead log, and was closed.
    let bag = Bag::of(&["PRAGMA journal_mode = wal", SCHEMA, TOPICS, long]);
    assert_eq!(bag.read().unwrap(), expected);
    assert_eq!(std::fs::read_dir(bag.folder.path()).unwrap().count(), 1);
}

#[test]
fn a_bag_that_was_not_closed_is_named() {
    let bag = Bag::of(&["PRAGMA journal_mode = wal", SCHEMA, TOPICS]);
    let writer = Connection::open(bag.path()).unwrap();
    writer.execute_batch("INSERT INTO messages VALUES (1, 1, 7, x'6f6e65')").unwrap();
    bag.assert_refused("was not closed");
    // The remedy.
    writer.pragma_update(None, "journal_mode", "delete").unwrap();
    assert_eq!(bag.read().unwrap().len(), 1);
}

#[test]
fn what_is_no_bag_is_refused_with_its_remedy() {
    for (statements, why) in [
        (vec!["CREATE TABLE other(id INTEGER)"], "no table topics as rosbag2 writes it (there is none)"),
        (vec!["CREATE TABLE topics(id, name)"], "no such column: type"),
        (vec![SCHEMA, "DROP TABLE messages"], "no table messages"),
        (
            vec![SCHEMA, TOPICS, "DROP INDEX timestamp_idx", "ALTER TABLE messages DROP COLUMN data"],
            "no such column: data",
        ),
        (
            vec![SCHEMA, TOPICS, "INSERT INTO messages VALUES (1, 1, 7, 'text')"],
            "message 1 (/a/pose) has text where bytes",
        ),
        (vec![SCHEMA, TOPICS, "INSERT INTO messages VALUES (1, 1, 7, 5)"], "has integer where bytes"),
        (
            vec![SCHEMA, TOPICS, "INSERT INTO messages VALUES (1, 1, 7, zeroblob(1048577))"],
            "has 1048577 bytes",
        ),
        (vec![SCHEMA, "INSERT INTO topics VALUES (1, x'ff', 'a', 'cdr', '')"], "the name of topic 1 is not"),
        (
            vec![SCHEMA, "INSERT INTO topics VALUES (1, CAST(x'ff' AS TEXT), 'a', 'cdr', '')"],
            "the name of topic 1 is not",
        ),
        (
            vec![SCHEMA, "INSERT INTO topics VALUES (1, '/a' || char(27), 'a', 'cdr', '')"],
            "the name of topic 1 is not",
        ),
        (
            vec![SCHEMA, "INSERT INTO topics VALUES (1, '/a', hex(zeroblob(600)), 'cdr', '')"],
            "the type of topic 1 is not",
        ),
        (
            vec![SCHEMA, "INSERT INTO topics VALUES (1, '/a', 'tf2_msgs/msg/TFMessage', 'ros1', '')"],
            "serialized as \"ros1\"",
        ),
        (
            vec![
                SCHEMA,
                "WITH n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 10001) INSERT INTO topics SELECT i, '/a', 'b', 'cdr', '' FROM n",
            ],
            "more than 10000 topics",
        ),
        (
            vec![
                SCHEMA,
                TOPICS,
                "DROP TABLE messages",
                "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT 1 topic_id, x'00' data FROM n",
            ],
            "it is a view",
        ),
        (
            vec![
                SCHEMA,
                "DROP TABLE topics",
                "CREATE VIRTUAL TABLE topics USING fts5(id, name, type, serialization_format)",
            ],
            "it is a virtual",
        ),
    ] {
        Bag::of(&statements).assert_refused(why);
    }
}

#[test]
fn rows_that_are_computed_are_bounded() {
    // 100 kB of real rows, each of which computes a blob of 1 MB.
    let computed = "DROP TABLE messages; CREATE TABLE messages(topic_id, data AS (zeroblob(1000000)));
        WITH n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 20000) INSERT INTO messages(topic_id) SELECT 1 FROM n";
    Bag::of(&[SCHEMA, TOPICS, computed]).assert_refused("more than the file can hold");
    let large = "DROP TABLE messages; CREATE TABLE messages(topic_id, data AS (zeroblob(3000000)));
        INSERT INTO messages(topic_id) VALUES (1)";
    Bag::of(&[SCHEMA, TOPICS, large]).assert_refused("too big");
}

#[test]
fn damaged_databases_end_with_an_error_or_their_messages() {
    let rows = "WITH n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 300) INSERT INTO messages SELECT i, 1, i, randomblob(100) FROM n";
    let bag = Bag::of(&[SCHEMA, TOPICS, rows]);
    let whole = std::fs::read(bag.path()).unwrap();
    assert_eq!(bag.read().unwrap().len(), 300);
    for length in [17, 100, 101, 4096, 5000, whole.len() / 2, whole.len() - 1, whole.len() - 4096] {
        std::fs::write(bag.path(), &whole[..length]).unwrap();
        bag.assert_refused("copy it again");
    }
    std::fs::write(bag.path(), [&b"SQLite format 3\0"[..], &[7; 9000]].concat()).unwrap();
    bag.assert_refused("that of no SQLite database");
    for at in (16..whole.len()).step_by(37) {
        for byte in [0, 0x0d, 0x7f, 0xff] {
            let mut damaged = whole.clone();
            damaged[at] = byte;
            std::fs::write(bag.path(), damaged).unwrap();
            let _ = bag.read();
        }
    }
}

#[test]
fn a_page_that_is_used_many_times_is_no_endless_bag() {
    let rows = "WITH n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 20000) INSERT INTO messages SELECT i, 1, i, randomblob(100) FROM n";
    let bag = Bag::of(&[SCHEMA, "DROP INDEX timestamp_idx", TOPICS, rows]);
    let database = Connection::open(bag.path()).unwrap();
    let root: u32 = database
        .query_row("SELECT rootpage FROM sqlite_schema WHERE name = 'messages'", [], |row| row.get(0))
        .unwrap();
    drop(database);
    let mut bytes = std::fs::read(bag.path()).unwrap();
    let page = |number: usize| (number - 1) * 4096;
    // Interior pages (5) of the table: each of their cells points to one child; let all children of the root be its first.
    let child = |bytes: &[u8], at: usize| -> [u8; 4] { bytes[at..at + 4].try_into().unwrap() };
    let cells = |bytes: &[u8], at: usize| -> Vec<usize> {
        let count = usize::from(u16::from_be_bytes(bytes[at + 3..at + 5].try_into().unwrap()));
        (0..count)
            .map(|cell| {
                at + usize::from(u16::from_be_bytes(
                    bytes[at + 12 + cell * 2..at + 14 + cell * 2].try_into().unwrap(),
                ))
            })
            .collect()
    };
    let root = page(root as usize);
    assert_eq!(bytes[root], 5);
    // Each cell of the interior pages leads back to an interior page, four levels deep.
    let first_leaf = child(&bytes, cells(&bytes, root)[0]);
    let copies: Vec<usize> = (0..3).map(|level| bytes.len() / 4096 + 1 + level).collect();
    let interior = bytes[root..root + 4096].to_vec();
    for _ in 0..3 {
        bytes.extend_from_slice(&interior);
    }
    let levels: Vec<usize> = [root].into_iter().chain(copies.iter().map(|&number| page(number))).collect();
    for (level, &at) in levels.iter().enumerate() {
        let target = copies.get(level).map_or(first_leaf, |&number| (number as u32).to_be_bytes());
        for cell in cells(&bytes, at) {
            bytes[cell..cell + 4].copy_from_slice(&target);
        }
        bytes[at + 8..at + 12].copy_from_slice(&target);
    }
    let count = (bytes.len() / 4096) as u32;
    bytes[28..32].copy_from_slice(&count.to_be_bytes());
    std::fs::write(bag.path(), bytes).unwrap();
    bag.assert_refused("more than the file can hold");
}
