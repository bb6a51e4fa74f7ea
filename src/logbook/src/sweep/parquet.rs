//! Tables of sweeps as Apache Parquet (format version 1, <https://parquet.apache.org/docs/file-format/>): the small part of it
//! that a flat table of numbers and words needs. Pages are plain and compressed by Zstandard.
//! `tests/python` reads a table by Apache Arrow; its crate `parquet` would make the program larger by 0.8 MB.

use super::table::{COLUMNS, SweepRow};
use city3d_outputs::WholeFile;
use city3d_simulation::sweep::Grid;
use std::io::{self, Write};
use std::path::Path;
use toml::Value;

/// First and last bytes of a file.
const MAGIC: &[u8; 4] = b"PAR1";
/// Rows of a group, which readers take into memory at once.
const ROWS_OF_GROUP: usize = 1 << 16;
/// Columns that are words.
const WORDS: [&str; 2] = ["merge_order", "state_hash"];
/// Columns that are whole numbers; all others are numbers.
const COUNTS: [&str; 15] = [
    "squeezed_in",
    "collisions",
    "stops",
    "merges",
    "entered",
    "left",
    "passages",
    "slow_stops",
    "max_queue",
    "order_inversions",
    "plans",
    "replans",
    "infeasible",
    "filter_limited",
    "seed",
];

/// What the values of a column are; its number is that of the format (`Type` in `parquet.thrift`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Bool = 0,
    Integer = 2,
    Number = 5,
    Word = 6,
}

/// Codes of the format's enumerations.
const OPTIONAL: i64 = 1;
const UTF8: i64 = 0;
const PLAIN: i64 = 0;
const RLE: i64 = 3;
const ZSTD: i64 = 6;
const DATA_PAGE: i64 = 0;

/// A page of a column that has been written.
struct Chunk {
    offset: u64,
    /// Bytes with the head of the page, and what they are without compression.
    bytes: i64,
    plain_bytes: i64,
    rows: i64,
}

/// Writes a table: a column for each axis, the seed, and the columns of the outcome; empty values are null. `told` is kept
/// with it, as keys and values.
///
/// # Errors
/// When the file cannot be written.
pub fn write_parquet(path: &Path, grid: &Grid, rows: &[SweepRow], told: &[(&str, &str)]) -> io::Result<()> {
    let columns = columns_of(grid);
    let mut file = Counted { file: WholeFile::create(path)?, written: 0 };
    file.write_all(MAGIC)?;
    let mut groups = Vec::new();
    for group in rows.chunks(ROWS_OF_GROUP) {
        let chunks =
            columns.iter().enumerate().map(|(k, (_, kind))| write_column(&mut file, group, k, *kind));
        groups.push(chunks.collect::<io::Result<Vec<Chunk>>>()?);
    }
    let footer = footer(&columns, &groups, told);
    file.write_all(&footer)?;
    file.write_all(&(footer.len() as u32).to_le_bytes())?;
    file.write_all(MAGIC)?;
    file.file.commit()
}

/// Names and kinds of the columns.
fn columns_of(grid: &Grid) -> Vec<(String, Kind)> {
    let kind_of = |name: &str| match name {
        _ if WORDS.contains(&name) => Kind::Word,
        _ if COUNTS.contains(&name) => Kind::Integer,
        _ => Kind::Number,
    };
    let axes = grid.axes.iter().map(|axis| (axis.key.clone(), kind_of_values(&axis.values)));
    let outcome = std::iter::once("seed").chain(COLUMNS).map(|name| (name.to_owned(), kind_of(name)));
    axes.chain(outcome).collect()
}

fn kind_of_values(values: &[Value]) -> Kind {
    let all = |is: fn(&Value) -> bool| values.iter().all(is);
    if all(Value::is_bool) {
        Kind::Bool
    } else if all(Value::is_integer) {
        Kind::Integer
    } else if all(|value| value.is_integer() || value.is_float()) {
        Kind::Number
    } else {
        Kind::Word
    }
}

/// Writes the values of a column of some rows, as one page.
fn write_column(file: &mut Counted, rows: &[SweepRow], index: usize, kind: Kind) -> io::Result<Chunk> {
    let cells = || rows.iter().map(|row| row.get(index).unwrap_or_default());
    let mut plain = levels(cells().map(|cell| !cell.is_empty()));
    let values = cells().filter(|cell| !cell.is_empty());
    let wrong =
        |cell: &str| io::Error::new(io::ErrorKind::InvalidData, format!("\"{cell}\" is not {kind:?}"));
    if kind == Kind::Bool {
        let bits: Vec<bool> = values.map(|cell| cell == "true").collect();
        plain.extend(
            bits.chunks(8).map(|byte| byte.iter().rev().fold(0, |byte, &bit| (byte << 1) | u8::from(bit))),
        );
    } else {
        for cell in values {
            match kind {
                Kind::Integer => {
                    plain.extend(cell.parse::<i64>().map_err(|_| wrong(cell))?.to_le_bytes());
                }
                Kind::Number => plain.extend(cell.parse::<f64>().map_err(|_| wrong(cell))?.to_le_bytes()),
                Kind::Word | Kind::Bool => {
                    plain.extend((cell.len() as u32).to_le_bytes());
                    plain.extend(cell.as_bytes());
                }
            }
        }
    }
    let packed = zstd::bulk::compress(&plain, 3)?;
    let mut head = Thrift::default();
    head.integer(1, DATA_PAGE);
    head.integer(2, plain.len() as i64);
    head.integer(3, packed.len() as i64);
    head.structure(5, |page| {
        page.integer(1, rows.len() as i64);
        page.integer(2, PLAIN);
        page.integer(3, RLE);
        page.integer(4, RLE);
    });
    let head = head.end();
    let offset = file.written;
    file.write_all(&head)?;
    file.write_all(&packed)?;
    let sized = |body: usize| (head.len() + body) as i64;
    Ok(Chunk { offset, bytes: sized(packed.len()), plain_bytes: sized(plain.len()), rows: rows.len() as i64 })
}

/// Definition levels, which tell the values from nulls: runs of equal ones, with the length of them all in front.
fn levels(are_there: impl Iterator<Item = bool>) -> Vec<u8> {
    let mut runs: Vec<(bool, u64)> = Vec::new();
    for is_there in are_there {
        match runs.last_mut() {
            Some((same, count)) if *same == is_there => *count += 1,
            _ => runs.push((is_there, 1)),
        }
    }
    let mut bytes = vec![0; 4];
    for (is_there, count) in runs {
        varint(&mut bytes, count << 1);
        bytes.push(u8::from(is_there));
    }
    let length = (bytes.len() - 4) as u32;
    bytes[..4].copy_from_slice(&length.to_le_bytes());
    bytes
}

/// The description of the file (`FileMetaData`).
fn footer(columns: &[(String, Kind)], groups: &[Vec<Chunk>], told: &[(&str, &str)]) -> Vec<u8> {
    let rows = |group: &[Chunk]| group.first().map_or(0, |chunk| chunk.rows);
    let mut footer = Thrift::default();
    footer.integer(1, 1);
    footer.list(2, STRUCTURE, columns.len() + 1, |list| {
        list.element(|root| {
            root.word(4, "sweep");
            root.integer(5, columns.len() as i64);
        });
        for (name, kind) in columns {
            list.element(|column| {
                column.integer(1, *kind as i64);
                column.integer(3, OPTIONAL);
                column.word(4, name);
                if *kind == Kind::Word {
                    column.integer(6, UTF8);
                }
            });
        }
    });
    footer.long(3, groups.iter().map(|group| rows(group)).sum());
    footer.list(4, STRUCTURE, groups.len(), |list| {
        for group in groups {
            list.element(|entry| {
                entry.list(1, STRUCTURE, group.len(), |list| {
                    for ((name, kind), chunk) in columns.iter().zip(group) {
                        list.element(|entry| column_chunk(entry, name, *kind, chunk));
                    }
                });
                entry.long(2, group.iter().map(|chunk| chunk.plain_bytes).sum());
                entry.long(3, rows(group));
            });
        }
    });
    footer.list(5, STRUCTURE, told.len(), |list| {
        for (key, value) in told {
            list.element(|entry| {
                entry.word(1, key);
                entry.word(2, value);
            });
        }
    });
    footer.word(6, concat!("City3D version ", env!("CARGO_PKG_VERSION")));
    footer.end()
}

fn column_chunk(entry: &mut Thrift, name: &str, kind: Kind, chunk: &Chunk) {
    entry.long(2, chunk.offset as i64);
    entry.structure(3, |data| {
        data.integer(1, kind as i64);
        data.list(2, INTEGER, 2, |list| {
            list.number(PLAIN);
            list.number(RLE);
        });
        data.list(3, BINARY, 1, |list| list.text(name));
        data.integer(4, ZSTD);
        data.long(5, chunk.rows);
        data.long(6, chunk.plain_bytes);
        data.long(7, chunk.bytes);
        data.long(9, chunk.offset as i64);
    });
}

/// Types of Thrift's compact protocol.
const INTEGER: u8 = 5;
const LONG: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCTURE: u8 = 12;

/// A structure in Thrift's compact protocol
/// (<https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md>). Fields come in the order of their ids.
#[derive(Default)]
struct Thrift {
    bytes: Vec<u8>,
    last_id: u8,
}

impl Thrift {
    fn field(&mut self, id: u8, kind: u8) {
        // No two ids that follow one another are more than 15 apart.
        self.bytes.push(((id - self.last_id) << 4) | kind);
        self.last_id = id;
    }

    fn integer(&mut self, id: u8, value: i64) {
        self.field(id, INTEGER);
        self.number(value);
    }

    fn long(&mut self, id: u8, value: i64) {
        self.field(id, LONG);
        self.number(value);
    }

    fn word(&mut self, id: u8, text: &str) {
        self.field(id, BINARY);
        self.text(text);
    }

    fn structure(&mut self, id: u8, fill: impl FnOnce(&mut Self)) {
        self.field(id, STRUCTURE);
        self.element(fill);
    }

    fn list(&mut self, id: u8, kind: u8, length: usize, fill: impl FnOnce(&mut Self)) {
        self.field(id, LIST);
        match length {
            0..=14 => self.bytes.push(((length as u8) << 4) | kind),
            _ => {
                self.bytes.push(0xf0 | kind);
                varint(&mut self.bytes, length as u64);
            }
        }
        fill(self);
    }

    /// A structure that is an element of a list, or follows the head of its field.
    fn element(&mut self, fill: impl FnOnce(&mut Self)) {
        let mut inner = Self::default();
        fill(&mut inner);
        self.bytes.extend(inner.end());
    }

    /// A number in zigzag coding.
    fn number(&mut self, value: i64) {
        varint(&mut self.bytes, ((value << 1) ^ (value >> 63)) as u64);
    }

    fn text(&mut self, text: &str) {
        varint(&mut self.bytes, text.len() as u64);
        self.bytes.extend(text.as_bytes());
    }

    /// Its bytes, with the mark of its end.
    fn end(mut self) -> Vec<u8> {
        self.bytes.push(0);
        self.bytes
    }
}

/// Seven bits to a byte, the lowest first.
fn varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// A file that knows how much was written.
struct Counted {
    file: WholeFile,
    written: u64,
}

impl Counted {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.written += bytes.len() as u64;
        self.file.write_all(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_the_table_are_known_by_their_names() {
        let known = |name: &&str| *name == "seed" || COLUMNS.contains(name);
        assert!(WORDS.iter().chain(&COUNTS).all(known));
    }

    #[test]
    fn axes_have_the_kind_of_their_values() {
        let axes = ["a=0,0.5", "b=1,2", "c=true,false", "d=fifo,1"].map(|axis| axis.parse().unwrap());
        let grid = Grid::new(axes.into(), None).unwrap();
        let kinds: Vec<Kind> = columns_of(&grid).into_iter().take(5).map(|(_, kind)| kind).collect();
        assert_eq!(kinds, [Kind::Number, Kind::Integer, Kind::Bool, Kind::Word, Kind::Integer]);
    }

    #[test]
    fn numbers_are_coded_as_the_specifications_say() {
        // The example of LEB128 (DWARF 4, figure 22), and zigzag coding of the Thrift compact protocol.
        let coded = |value| {
            let mut bytes = Vec::new();
            varint(&mut bytes, value);
            bytes
        };
        assert_eq!((coded(127), coded(128), coded(12857)), (vec![0x7f], vec![0x80, 1], vec![0xb9, 0x64]));
        let zigzag = |value| {
            let mut thrift = Thrift::default();
            thrift.number(value);
            thrift.bytes
        };
        assert_eq!([0, -1, 1, -2].map(zigzag), [[0], [1], [2], [3]]);
        // Three values, a null, a value (bit width 1): the runs of the RLE and bit-packing hybrid.
        assert_eq!(levels([true, true, true, false, true].into_iter()), [6, 0, 0, 0, 6, 1, 2, 0, 2, 1]);
    }
}
