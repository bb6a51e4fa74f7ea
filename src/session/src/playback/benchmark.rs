//! Benchmark of the playback: time to open a log, and to seek in it.

use super::{PlaybackCommand, PlaybackError, Player};
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;
use std::path::Path;
use std::time::{Duration, Instant};

/// What the playback of a log costs.
#[derive(Debug, Serialize)]
pub struct PlaybackReport {
    /// Name of the benchmark.
    pub bench: &'static str,
    /// Size of the log.
    pub log_bytes: u64,
    /// Chunks of the log.
    pub chunks: usize,
    /// Vehicles at the end of the benchmark.
    pub vehicles: usize,
    /// Simulated seconds of the log.
    pub simulated_s: f64,
    /// Time until the first snapshot is available.
    pub open_median_ms: f64,
    /// The longest time to open it.
    pub open_max_ms: f64,
    /// Number of seeks.
    pub jumps: usize,
    /// Time until the snapshot at the target of a seek is available.
    pub jump_median_ms: f64,
    /// 99th percentile of the same.
    pub jump_p99_ms: f64,
    /// The longest of them.
    pub jump_max_ms: f64,
    /// Time until all events of the log are read in the background.
    pub events_s: f64,
    /// Number of these events.
    pub events: usize,
    /// Simulated seconds per second at the highest speed, with 60 pictures per second.
    pub played_forwards_x: f64,
    /// The same backwards.
    pub played_backwards_x: f64,
    /// Chunks decoded for the seeks, with read-ahead in both directions.
    pub decoded_chunks: u64,
    /// Most snapshots in memory.
    pub kept_snapshots: usize,
}

/// Times that the log is opened.
const OPENED: usize = 9;

/// Opens a log several times, seeks to random times that the seed draws, and plays it both ways.
///
/// # Errors
/// When it cannot be opened.
pub fn benchmark(log: &Path, jumps: u32, seed: u64) -> Result<PlaybackReport, PlaybackError> {
    let mut opened = Vec::new();
    for _ in 1..OPENED {
        let start = Instant::now();
        let player = Player::open(log, Box::new(|| {}))?;
        opened.push(start.elapsed());
        drop(player);
    }
    let start = Instant::now();
    let mut player = Player::open(log, Box::new(|| {}))?;
    opened.push(start.elapsed());
    while !player.is_settled() {
        player.advance(Instant::now());
        std::thread::sleep(Duration::from_millis(1));
    }
    let events_s = start.elapsed().as_secs_f64();
    let before = player.stats().decoded;
    let (jumped, kept) = jump(&mut player, jumps, seed);
    let decoded_chunks = player.stats().decoded - before;
    let played_forwards_x = play(&mut player, PlaybackCommand::Play);
    let played_backwards_x = play(&mut player, PlaybackCommand::Reverse);
    let ms = |times: &[Duration], share: f64| {
        let mut sorted = times.to_vec();
        sorted.sort_unstable();
        sorted[((sorted.len() - 1) as f64 * share).ceil() as usize].as_secs_f64() * 1e3
    };
    let (effort, head) = (player.stats(), player.head());
    Ok(PlaybackReport {
        bench: "city3d_replay",
        log_bytes: std::fs::metadata(log).map_or(0, |found| found.len()),
        chunks: effort.chunks,
        vehicles: player.run_state().now.vehicles.len(),
        simulated_s: head.to_s - head.from_s,
        open_median_ms: ms(&opened, 0.5),
        open_max_ms: ms(&opened, 1.0),
        jumps: jumped.len(),
        jump_median_ms: ms(&jumped, 0.5),
        jump_p99_ms: ms(&jumped, 0.99),
        jump_max_ms: ms(&jumped, 1.0),
        events_s,
        events: player.info().marks.len(),
        played_forwards_x,
        played_backwards_x,
        decoded_chunks,
        kept_snapshots: kept,
    })
}

/// Plays for two seconds, or to the end; returns the real-time factor.
fn play(player: &mut Player, cue: PlaybackCommand) -> f64 {
    const FOR: Duration = Duration::from_secs(2);
    const PICTURE: Duration = Duration::from_micros(16_667);
    let head = player.head();
    let from_s = if cue == PlaybackCommand::Play { head.from_s } else { head.to_s };
    player.command(PlaybackCommand::Seek(from_s));
    player.command(PlaybackCommand::Speed(f64::MAX));
    player.command(cue);
    let start = Instant::now();
    while start.elapsed() < FOR && player.head().is_playing {
        player.advance(Instant::now());
        std::thread::sleep(PICTURE);
    }
    let passed_s = start.elapsed().as_secs_f64();
    player.command(PlaybackCommand::Pause);
    (player.head().at_s - from_s).abs() / passed_s
}

/// Seeks to random times; returns the duration of each seek, and the most snapshots in memory.
fn jump(player: &mut Player, jumps: u32, seed: u64) -> (Vec<Duration>, usize) {
    let mut draw = ChaCha12Rng::seed_from_u64(seed);
    let head = player.head();
    let (mut times, mut kept) = (Vec::new(), 0);
    for _ in 0..jumps {
        let share = f64::from(draw.next_u32()) / f64::from(u32::MAX);
        let start = Instant::now();
        player.command(PlaybackCommand::Seek(head.from_s + share * (head.to_s - head.from_s)));
        player.advance(Instant::now());
        while player.is_late() {
            std::thread::sleep(Duration::from_micros(50));
            player.advance(Instant::now());
        }
        times.push(start.elapsed());
        kept = kept.max(player.stats().kept);
    }
    (times, kept)
}
