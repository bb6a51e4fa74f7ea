//! Files that are damaged, or made to do harm: logs, bags and tables of poses. Nothing comes down, memory and work stay
//! bounded by the file, and what is wrong is told with its place.

use crate::support::link::city3d;
use crate::support::live::roundabout;

use city3d_logbook::record::{LogOrigin, LogWriter};
use city3d_session::playback::{PlaybackCommand, Player};
use city3d_simulation::runner::Run;
use mcap::records::op;
use serde_json::Value;
use std::fs::File;
use std::io::Cursor;
use std::ops::Range;
use std::path::Path;
use std::process::{Command, Output};
use std::time::Instant;

/// A log of 1.5 s of the roundabout in chunks of half a second.
fn log() -> Vec<u8> {
    let mut run = Run::new(roundabout(1.5)).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    let mut writer =
        LogWriter::new(&mut bytes, run.experiment(), LogOrigin::Run, &std::env::temp_dir()).unwrap();
    loop {
        let snapshot = run.snapshot().clone();
        writer.tick(snapshot.tick, snapshot.time_s, snapshot.state_hash).unwrap();
        if snapshot.tick.is_multiple_of(2) {
            writer.snapshot(&snapshot).unwrap();
        }
        if snapshot.tick % 50 == 49 {
            writer.flush().unwrap();
        }
        if snapshot.tick == 150 {
            break;
        }
        run.step();
        for command in run.commands() {
            writer.command(snapshot.tick, snapshot.time_s, command).unwrap();
        }
    }
    writer.finish().unwrap();
    bytes.into_inner()
}

/// Places of the records of a kind outside of chunks, with opcode and length.
fn records(log: &[u8], kind: u8) -> Vec<Range<usize>> {
    let (mut found, mut at) = (Vec::new(), mcap::MAGIC.len());
    while at + 9 <= log.len() - mcap::MAGIC.len() {
        let length = u64::from_le_bytes(log[at + 1..at + 9].try_into().unwrap()) as usize;
        if log[at] == kind {
            found.push(at..at + 9 + length);
        }
        at += 9 + length;
    }
    found
}

/// The log with other bytes at a place of its summary section, whose checksum is right.
fn with_index(log: &[u8], at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut log = log.to_vec();
    log[at..at + bytes.len()].copy_from_slice(bytes);
    let start = records(&log, op::DATA_END)[0].end;
    let checksum = log.len() - mcap::MAGIC.len() - 4;
    let crc = crc32fast::hash(&log[start..checksum]);
    log[checksum..checksum + 4].copy_from_slice(&crc.to_le_bytes());
    log
}

fn outcome(output: &Output) -> (i32, String) {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!said.contains("panicked"), "{said}");
    (output.status.code().unwrap(), said)
}

/// Exit code, report and what was complained of.
fn verify(log: &[u8]) -> (i32, Value, String) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("run.mcap"), log).unwrap();
    let output = city3d(&["replay", "run.mcap", "--verify", "--json"], folder.path()).output().unwrap();
    let (code, said) = outcome(&output);
    (code, serde_json::from_slice(&output.stdout).unwrap_or_default(), said)
}

/// Exit code and complaints of a command that plays a log as the window does.
fn play(log: &[u8]) -> (i32, String) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("run.mcap"), log).unwrap();
    outcome(&city3d(&["bench", "replay", "run.mcap", "--jumps", "3"], folder.path()).output().unwrap())
}

#[test]
fn a_log_with_a_damaged_index_is_read_from_its_front() {
    let log = log();
    let chunks = records(&log, op::CHUNK_INDEX);
    assert!(chunks.len() >= 3 && play(&log) == (0, String::new()));
    let field = |index: usize, number: usize| chunks[index].start + 9 + 8 * number;
    let footer = records(&log, op::FOOTER)[0].start + 9;
    let statistics = records(&log, op::STATISTICS)[0].start + 9;
    let mut flipped = log.clone();
    flipped[field(1, 0)] ^= 1;
    for (name, damaged, why) in [
        ("checksum", flipped, "Summary section CRC failed"),
        ("start", with_index(&log, field(1, 0), &[0xff; 8]), "ends before it begins"),
        ("offset", with_index(&log, field(1, 2), &[0xff; 8]), "reaches beyond the data"),
        ("length", with_index(&log, field(2, 3), &[0xff; 8]), "has 18446744073709551615 bytes"),
        ("text", with_index(&log, field(0, 4), &[0xff; 4]), "a length that exceeds its record"),
        ("count", with_index(&log, statistics + 8 + 2 + 4 + 4 + 4, &[9, 0, 0, 0]), "of 9 chunks"),
        ("place", with_index(&log, footer, &[0xff; 8]), "it begins at byte 18446744073709551615"),
        ("no place", with_index(&log, footer, &[5, 0, 0, 0, 0, 0, 0, 0]), "it begins at byte 5"),
    ] {
        let (code, said) = play(&damaged);
        assert!(code == 0 && said.contains("the log is read from its front"), "{name}: {code} {said}");
        assert!(said.contains(why), "{name}: {said}");
    }
    // The index of another chunk: told when that chunk is read.
    let mut swapped = log[chunks[1].clone()].to_vec();
    swapped[9..25].copy_from_slice(&log[chunks[0].start + 9..chunks[0].start + 25]);
    let mut player = open(&with_index(&log, chunks[1].start, &swapped)).unwrap();
    seek(&mut player, 1.4);
    let why = player.info().truncation.unwrap();
    assert!(why.contains("it is not what the index of the log states"), "{why}");
}

fn open(log: &[u8]) -> Result<Player, String> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), log).unwrap();
    Player::open(file.path(), Box::new(|| {})).map_err(|error| error.to_string())
}

fn seek(player: &mut Player, to_s: f64) {
    player.command(PlaybackCommand::Seek(to_s));
    while !player.is_settled() {
        player.advance(Instant::now());
        std::thread::yield_now();
    }
}

#[test]
fn chunks_that_end_before_they_begin_bring_no_player_down() {
    let log = log();
    let chunks = records(&log, op::CHUNK);
    // Without a summary, so that chunks are found by their heads.
    let mut torn = log[..records(&log, op::DATA_END)[0].start].to_vec();
    let begin = chunks[1].start + 9;
    torn[begin..begin + 8].copy_from_slice(&[0xff; 8]);
    let player = open(&torn).unwrap();
    let told = player.info().truncation.unwrap();
    assert!(told.contains("ends before it begins"), "{told}");
    // Other times than those of its snapshots.
    let mut early = log[..chunks[2].start].to_vec();
    early[begin..begin + 16].copy_from_slice(&[0; 16]);
    let mut player = open(&early).unwrap();
    seek(&mut player, 0.9);
    let head = player.head();
    assert!(head.from_s <= head.to_s && player.info().truncation.is_some(), "{head:?}");
}

#[test]
fn a_verification_tells_damage_from_a_torn_end_and_from_nothing() {
    let log = log();
    let (code, report, said) = verify(&log);
    assert_eq!((code, &report["ticks_agreeing"]), (0, &151.into()), "{said}");
    assert!(report.get("torn").is_none() && report.get("damage").is_none(), "{report}");

    let chunks = records(&log, op::CHUNK);
    let message_index = records(&log, op::MESSAGE_INDEX)[0].clone();
    let flipped = |at: usize| {
        let mut log = log.clone();
        log[at] ^= 1;
        log
    };
    for (name, damaged, ticks, why) in [
        ("first chunk", flipped(chunks[0].end - 9), 0, format!("damaged at byte {}", chunks[0].start)),
        ("second chunk", flipped(chunks[1].end - 9), 50, format!("damaged at byte {}", chunks[1].start)),
        ("length", flipped(chunks[1].start + 6), 50, format!("damaged at byte {}", chunks[1].start)),
        ("message index", flipped(message_index.end - 1), 151, "Data section CRC failed".to_owned()),
        ("cut out", [&log[..chunks[1].end - 40], &log[chunks[1].end..]].concat(), 50, "damaged".to_owned()),
    ] {
        let (code, report, said) = verify(&damaged);
        assert_eq!((code, &report["ticks_agreeing"]), (1, &ticks.into()), "{name}: {said}");
        assert!(said.contains(&why) && said.contains("what follows was not compared"), "{name}: {said}");
        assert!(report["damage"].is_string() && report.get("torn").is_none(), "{name}: {report}");
    }

    let (code, report, said) = verify(&log[..chunks[2].start + 100]);
    assert_eq!((code, &report["ticks_agreeing"]), (0, &100.into()), "{said}");
    assert_eq!(report["torn"], "it ends in the middle of a record");
    let (code, report, said) = verify(&log[..chunks[0].start + 100]);
    assert!(code == 1 && said.contains("no tick to compare: it ends in the middle of a record"), "{said}");
    assert_eq!(report["torn"], "it ends in the middle of a record");

    let mut bytes = Cursor::new(Vec::new());
    LogWriter::new(&mut bytes, &roundabout(1.0), LogOrigin::Run, &std::env::temp_dir())
        .unwrap()
        .finish()
        .unwrap();
    let (code, _, said) = verify(&bytes.into_inner());
    assert!(code == 1 && said.contains("the log has no tick to compare; record the run again"), "{said}");
}

/// Runs the program with so much address space at most.
fn within(kilobytes: u32, arguments: &[&str], folder: &Path) -> Output {
    let script = format!("ulimit -v {kilobytes} && exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_city3d")]).args(arguments).current_dir(folder);
    command.output().unwrap()
}

/// Enough for any small file.
const MOST_KILOBYTES: u32 = 1_500_000;

#[test]
fn lengths_beyond_the_file_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let log = log();
    let chunk = records(&log, op::CHUNK)[0].clone();
    let index = records(&log, op::MESSAGE_INDEX)[0].start;
    let patched = |at: usize, bytes: &[u8]| {
        let mut log = log.clone();
        log[at..at + bytes.len()].copy_from_slice(bytes);
        log
    };
    for (name, damaged) in [
        // Read as channels, attachments and metadata, whose texts are of any length.
        ("channel", patched(index, &[op::CHANNEL])),
        ("attachment", patched(index, &[op::ATTACHMENT])),
        ("metadata", patched(index, &[op::METADATA])),
        ("schema", patched(index, &[op::SCHEMA])),
        ("record", patched(index + 1, &[0xff; 8])),
        ("most of a record", patched(index + 1, &[0xff, 0xff, 0xff, 0x0f])),
        ("chunk of 2^62 bytes", patched(chunk.start + 9 + 16, &[0, 0, 0, 0, 0, 0, 0, 0x40])),
        ("compression", patched(chunk.start + 9 + 28, &[0xff; 4])),
        ("compressed size", patched(chunk.start + 9 + 32 + 4, &[0xff; 8])),
    ] {
        std::fs::write(folder.path().join("run.mcap"), damaged).unwrap();
        let output = within(MOST_KILOBYTES, &["replay", "run.mcap", "--verify"], folder.path());
        let (code, said) = outcome(&output);
        assert!(code == 1 && said.contains("it is damaged at byte"), "{name}: {code} {said}");
        let output = within(MOST_KILOBYTES, &["bench", "replay", "run.mcap", "--jumps", "1"], folder.path());
        assert!(outcome(&output).0 < 3, "{name}: {output:?}");
    }
}

/// An MCAP file with messages of zeros, so many MiB.
fn bomb(mebibytes: usize) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd)).disable_seeking(true);
    let mut writer = options.chunk_size(Some(64 << 20)).compression_threads(0).create(&mut bytes).unwrap();
    let channel = writer.add_channel(0, "/zeros", "cdr", &Default::default()).unwrap();
    let header =
        mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 0, publish_time: 0 };
    for _ in 0..mebibytes {
        writer.write_to_known_channel(&header, &[0; 1 << 20]).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

#[test]
fn compressed_data_that_grow_without_end_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let zeros = bomb(300);
    assert!(zeros.len() < 1 << 20);
    std::fs::write(folder.path().join("zeros.mcap"), &zeros).unwrap();
    let replay = ["replay", "zeros.mcap", "--scenario", "roundabout", "--out", "o"];
    let (code, said) = outcome(&within(MOST_KILOBYTES, &replay, folder.path()));
    assert!(code == 2 && said.contains("decompress the file first"), "{code} {said}");
    // The same chunks in a log of City3D.
    let log = log();
    let first = records(&log, op::CHUNK)[0].start;
    let chunks: Vec<u8> = records(&zeros, op::CHUNK).into_iter().flat_map(|at| zeros[at].to_vec()).collect();
    let spliced = [&log[..first], &chunks, &log[first..records(&log, op::DATA_END)[0].start]].concat();
    let (code, _, said) = verify(&spliced);
    assert!(code == 1 && said.contains("decompress the file first"), "{code} {said}");
    let (code, said) = play(&spliced);
    assert!(code == 2 && said.contains("decompress the file first"), "{code} {said}");
}

#[test]
fn poses_are_known_by_their_first_bytes_and_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let replay = |file: &str| {
        let arguments = ["replay", file, "--scenario", "roundabout", "--out", "o"];
        outcome(&within(MOST_KILOBYTES, &arguments, folder.path()))
    };
    let sparse = |name: &str, start: &[u8]| {
        std::fs::write(folder.path().join(name), start).unwrap();
        File::options().write(true).open(folder.path().join(name)).unwrap().set_len(20 << 30).unwrap();
    };
    for name in ["z.mcap", "z.bag", "z.csv"] {
        sparse(name, b"");
        let (code, said) = replay(name);
        assert!(code == 2 && said.contains("of no bag") && said.contains("of no table"), "{name}: {said}");
    }
    sparse("magic.mcap", mcap::MAGIC);
    sparse("magic.bag", b"#ROSBAG V2.0\n");
    for (name, why) in [("magic.mcap", "damaged at byte 8"), ("magic.bag", "damaged at byte 13")] {
        let (code, said) = replay(name);
        assert!(code == 2 && said.contains(why), "{name}: {code} {said}");
        let (code, said) = outcome(&city3d(&["replay", name, "--verify"], folder.path()).output().unwrap());
        assert_eq!(code, 2, "{name}: {said}");
    }
    sparse("text.csv", &[b'1'; 2000]);
    let (code, said) = replay("text.csv");
    assert!(code == 2 && said.contains("at most 1024 MiB are read"), "{code} {said}");
    assert!(replay("/dev/zero").1.contains("a pipe or a device"));
    let fifo = Command::new("mkfifo").arg(folder.path().join("fifo")).status().unwrap();
    assert!(fifo.success());
    for arguments in [&["replay", "fifo", "--verify"][..], &["replay", "fifo"], &["frames", "fifo"]] {
        let (code, said) = outcome(&city3d(arguments, folder.path()).output().unwrap());
        assert_eq!(code, 2, "{arguments:?}: {said}");
    }
}

#[test]
fn of_many_unknown_vehicles_a_few_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let mut table = "time,id,x,y,yaw\n0,1,0,0,0\n1,1,0,0,0\n".to_owned();
    table.extend((101..=300).map(|id| format!("0.5,{id},0,0,0\n")));
    std::fs::write(folder.path().join("poses.csv"), &table).unwrap();
    let replay = ["replay", "poses.csv", "--scenario", "roundabout", "--out", "o"];
    let (code, said) = outcome(&city3d(&replay, folder.path()).output().unwrap());
    assert!(code == 0 && said.contains("no vehicle 101, 102,") && said.contains("and 180 more"), "{said}");
    assert!(!said.contains("121,"), "{said}");
    table.extend((301..=1200).map(|id| format!("0.5,{id},0,0,0\n")));
    std::fs::write(folder.path().join("poses.csv"), &table).unwrap();
    let (code, said) = outcome(&city3d(&replay, folder.path()).output().unwrap());
    assert!(code == 2 && said.contains("1100 vehicles that the scenario does not have"), "{code} {said}");
    table.extend((1201..=70_000).map(|id| format!("0.5,{id},0,0,0\n")));
    std::fs::write(folder.path().join("poses.csv"), &table).unwrap();
    let (code, said) = outcome(&city3d(&replay, folder.path()).output().unwrap());
    assert!(code == 2 && said.contains("more than 10000 vehicles"), "{code} {said}");
}

#[test]
fn a_file_that_may_not_be_read_says_so() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    std::fs::write(&log, mcap::MAGIC).unwrap();
    std::fs::set_permissions(&log, std::fs::Permissions::from_mode(0o0)).unwrap();
    let may_read = File::open(&log).is_ok();
    let (code, said) = outcome(&city3d(&["replay", "run.mcap", "--verify"], folder.path()).output().unwrap());
    // An administrator may read anything.
    let told =
        if may_read { "it ends in the middle of a record" } else { "cannot be read: Permission denied" };
    assert!(code == 2 && said.contains(told), "{code} {said}");
    // What nobody may read.
    std::os::unix::fs::symlink("loop", folder.path().join("loop")).unwrap();
    let (code, said) = outcome(&city3d(&["replay", "loop", "--verify"], folder.path()).output().unwrap());
    assert!(
        code == 2 && said.contains("loop: cannot be read: Too many levels of symbolic links"),
        "{code} {said}"
    );
}

#[test]
fn cameras_beyond_all_measure_are_refused_by_their_option() {
    let folder = tempfile::tempdir().unwrap();
    for (option, value) in [
        ("--distance", "1e308"),
        ("--distance", "1e-300"),
        ("--at", "1e308,0"),
        ("--at", "0,-100001"),
        ("--azimuth", "1e308"),
    ] {
        let arguments = ["frames", "roundabout", "--camera", "orbit", option, value, "--out", "o"];
        let (code, said) = outcome(&city3d(&arguments, folder.path()).output().unwrap());
        assert!(code == 2 && said.contains(option) && said.contains("needed"), "{option} {value}: {said}");
    }
}
