//! `city3d bench replay`: time to open a recorded run, and to seek in it.

use super::super::Failure;
use super::super::files::log_argument;
use super::super::say::say;
use city3d_session::playback::{PlaybackCommand, PlaybackError, Player};
use clap::Args;
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct ReplayBenchArgs {
    /// The run.mcap of a run, or its folder
    #[arg(value_parser = log_argument)]
    log: PathBuf,
    /// Number of jumps to random times
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    jumps: u32,
    /// Seed of the random times
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Debug, Serialize)]
struct ReplayReport {
    bench: &'static str,
    log_bytes: u64,
    chunks: usize,
    vehicles: usize,
    simulated_s: f64,
    /// Time until the first snapshot is available.
    open_median_ms: f64,
    open_max_ms: f64,
    jumps: usize,
    /// Time until the snapshot at the target of a seek is available.
    jump_median_ms: f64,
    jump_p99_ms: f64,
    jump_max_ms: f64,
    /// Time until all events of the log are read in the background.
    events_s: f64,
    events: usize,
    /// Simulated seconds per second at the highest speed, with 60 pictures per second.
    played_forwards_x: f64,
    played_backwards_x: f64,
    /// Chunks decoded for the seeks, with read-ahead in both directions.
    decoded_chunks: u64,
    /// Most snapshots in memory.
    kept_snapshots: usize,
}

/// Times that the log is opened.
const OPENED: usize = 9;

pub fn replay(args: &ReplayBenchArgs) -> Result<(), Failure> {
    let mut opened = Vec::new();
    for _ in 1..OPENED {
        let start = Instant::now();
        let player = open(&args.log)?;
        opened.push(start.elapsed());
        drop(player);
    }
    let start = Instant::now();
    let mut player = open(&args.log)?;
    opened.push(start.elapsed());
    while !player.is_settled() {
        player.advance(Instant::now());
        std::thread::sleep(Duration::from_millis(1));
    }
    let events_s = start.elapsed().as_secs_f64();
    let before = player.stats().decoded;
    let (jumped, kept) = jump(&mut player, args);
    let decoded_chunks = player.stats().decoded - before;
    let played_forwards_x = play(&mut player, PlaybackCommand::Play);
    let played_backwards_x = play(&mut player, PlaybackCommand::Reverse);
    let ms = |times: &[Duration], share: f64| {
        let mut sorted = times.to_vec();
        sorted.sort_unstable();
        sorted[((sorted.len() - 1) as f64 * share).ceil() as usize].as_secs_f64() * 1e3
    };
    let (effort, head) = (player.stats(), player.head());
    let report = ReplayReport {
        bench: "city3d_replay",
        log_bytes: std::fs::metadata(&args.log).map_err(Failure::failed)?.len(),
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
    };
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

fn open(log: &Path) -> Result<Player, Failure> {
    Player::open(log, Box::new(|| {})).map_err(|error| match error {
        PlaybackError::Thread(_) => Failure::failed(error),
        _ => Failure::bad_input(error),
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
fn jump(player: &mut Player, args: &ReplayBenchArgs) -> (Vec<Duration>, usize) {
    let mut draw = ChaCha12Rng::seed_from_u64(args.seed);
    let head = player.head();
    let (mut times, mut kept) = (Vec::new(), 0);
    for _ in 0..args.jumps {
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
