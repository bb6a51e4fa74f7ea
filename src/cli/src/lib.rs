//! The command line: arguments, subcommands and exit codes.

#![allow(clippy::disallowed_types, reason = "wires clocks, threads and files together")]

#[cfg(feature = "render")]
mod bench;
#[cfg(all(feature = "render", any(feature = "foxglove", feature = "ros", feature = "ros2")))]
mod cameras;
mod check;
mod compare;
mod compare_sweeps;
mod files;
mod fork;
#[cfg_attr(not(feature = "foxglove"), path = "no_foxglove.rs")]
mod foxglove;
#[cfg(feature = "render")]
mod frames;
mod generate;
mod licenses;
mod load;
#[cfg(feature = "render")]
mod look;
mod mainframe;
#[cfg(all(feature = "render", any(feature = "ros", feature = "ros2")))]
mod onboard;
mod overwrite;
mod plot;
mod progress;
mod recorded;
mod repair;
mod replay;
#[cfg_attr(not(feature = "ros"), path = "no_ros.rs")]
mod ros;
#[cfg_attr(not(feature = "ros2"), path = "no_ros2.rs")]
mod ros2;
mod run;
#[cfg(feature = "render")]
mod runtime_folder;
mod say;
mod serve;
mod served_at;
mod signals;
mod status;
mod sweep;
mod testbed;
mod values;
#[cfg(feature = "window")]
mod view;
#[cfg_attr(not(feature = "web"), path = "no_web.rs")]
mod web;
#[cfg(feature = "window")]
mod window_ends;

use city3d_dynamics::vehicle::ModelKind;
use city3d_network::link::read_key;
use city3d_outputs::OutputError;
use city3d_protocol::wire::Authenticator;
use city3d_session::{ExistingResults, SessionError};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::{Overrides, ScenarioChange, ScenarioRequest};
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use signals::on_end;
use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The run failed: a collision where the scenario forbids one, a file that cannot be written.
const EXIT_FAILED: u8 = 1;
/// The input is wrong.
const EXIT_BAD_INPUT: u8 = 2;

#[derive(Debug, Parser)]
#[command(
    version,
    about,
    max_term_width = 110,
    after_help = "Without a command the window opens. Try: city3d run roundabout --out out"
)]
#[cfg_attr(not(feature = "window"), command(subcommand_required = true, arg_required_else_help = true))]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// Write more messages: -v for information, -vv for debugging
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
}

#[cfg(feature = "render")]
impl Cli {
    /// Whether the command may open an adapter.
    fn draws(&self) -> bool {
        match self.command {
            #[cfg(feature = "window")]
            Some(Command::View(_)) => true,
            Some(Command::Frames(_) | Command::Bench(_) | Command::Replay(_) | Command::Serve(_)) => true,
            // For cameras in Foxglove.
            Some(Command::Run(_) | Command::Mainframe(_)) => true,
            // The window.
            None => true,
            Some(_) => false,
        }
    }
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Open the window to watch and drive [default without a command]
    #[cfg(feature = "window")]
    View(Box<view::ViewArgs>),
    /// Run a scenario without a window and write its log, vehicles.csv and summary.json
    Run(run::RunArgs),
    /// Draw the figures of recorded runs: SVG, PNG, and their data as CSV
    Plot(plot::PlotArgs),
    /// Compare two runs on the same map, or sweeps: figures with all, and a table of what came out
    Compare(compare::CompareArgs),
    /// Watch a recorded run in the window or on a web page, or simulate it again from its log and compare it
    Replay(Box<replay::ReplayArgs>),
    /// Run a scenario for all combinations of parameters and seeds, on all cores: a table, and a map of the outcome
    Sweep(sweep::SweepArgs),
    /// Serve the city alone: receive vehicles and commands over UDP, send poses
    Serve(Box<serve::ServeArgs>),
    /// Run the control framework alone, and drive the vehicles of a served city
    Mainframe(Box<mainframe::MainframeArgs>),
    /// Emulate the laboratory: robots for the physical vehicles, and motion capture
    Testbed(Box<testbed::TestbedArgs>),
    /// Take camera pictures of a scenario or of the log of a run: PNG files and frames.csv
    #[cfg(feature = "render")]
    Frames(Box<frames::FramesArgs>),
    /// Validate scenarios (.toml) and maps (.dxf)
    Check(check::CheckArgs),
    /// Benchmark this machine: one line of JSON per measurement
    #[cfg(feature = "render")]
    #[command(subcommand)]
    Bench(Box<bench::BenchCommand>),
    /// Write files that the program carries: the map and the models
    Generate(generate::GenerateArgs),
    /// Print the licences of the software that the program contains
    Licenses,
}

/// Options that both ends of the laboratory's link must agree on.
#[derive(Clone, Debug, Args)]
struct LinkArgs {
    /// World number, which tells several cities on one network apart; 0 matches any city
    #[arg(long, value_name = "N", default_value_t = 1)]
    world: u32,
    /// File with a shared key of at least 16 bytes; datagrams without its tag are dropped
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
}

impl LinkArgs {
    /// What seals and verifies datagrams.
    fn authenticator(&self) -> Result<Authenticator, Failure> {
        read_key(self.key.as_deref()).map_err(Failure::bad_input)
    }
}

/// Scenario and overrides of several commands.
#[derive(Clone, Debug, Default, PartialEq, Args)]
struct ScenarioArgs {
    /// A scenario file, or a shipped one: roundabout, mixed, city, straight, student, intersection and others
    scenario: String,
    #[command(flatten)]
    changed: ChangeArgs,
}

/// What is set otherwise than in a scenario.
#[derive(Clone, Debug, Default, PartialEq, Args)]
struct ChangeArgs {
    /// Seed of all random draws, instead of the scenario's
    #[arg(long, value_parser = values::seed)]
    seed: Option<u64>,
    /// Simulated seconds, instead of the scenario's
    #[arg(long, value_name = "S", value_parser = values::duration)]
    duration: Option<f64>,
    /// Dynamics model of all vehicles, instead of the scenario's
    #[arg(long)]
    model: Option<ModelArg>,
    /// Environment profile (delay, loss, noise, disturbance), instead of the scenario's
    #[arg(long)]
    environment: Option<ProfileArg>,
    /// Another value of the scenario, by its dotted path: coordination.algorithm=fifo, vehicle.path1_a.at_m=0.4 or
    /// inflow.*.rate_veh_h=300; repeat for several
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<ScenarioChange>,
}

/// An environment on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ProfileArg {
    Ideal,
    Testbed,
}

impl ProfileArg {
    fn profile(self) -> EnvironmentProfile {
        match self {
            Self::Ideal => EnvironmentProfile::Ideal,
            Self::Testbed => EnvironmentProfile::Testbed,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ModelArg {
    Raycast,
    Bicycle,
}

impl ScenarioArgs {
    /// The scenario with what is set otherwise.
    fn request(&self) -> ScenarioRequest {
        let (overrides, changes) = (self.changed.overrides(), self.changed.set.clone());
        ScenarioRequest { scenario: self.scenario.clone(), overrides, changes }
    }
}

impl ChangeArgs {
    /// Whether more than the duration is set, which a recorded run cannot take.
    fn has_more_than_duration(&self) -> bool {
        self.seed.is_some() || self.model.is_some() || self.environment.is_some() || !self.set.is_empty()
    }

    fn overrides(&self) -> Overrides {
        let model = self.model.map(|model| match model {
            ModelArg::Raycast => ModelKind::Raycast,
            ModelArg::Bicycle => ModelKind::Bicycle,
        });
        Overrides {
            seed: self.seed,
            duration_s: self.duration,
            model,
            environment: self.environment.map(ProfileArg::profile),
            allows_no_vehicles: false,
        }
    }
}

/// An error with the exit code that it ends the program with.
#[derive(Debug)]
struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    #[allow(clippy::needless_pass_by_value, reason = "the shape that map_err wants")]
    fn bad_input(message: impl ToString) -> Self {
        Self { code: EXIT_BAD_INPUT, message: message.to_string() }
    }

    #[allow(clippy::needless_pass_by_value, reason = "the shape that map_err wants")]
    fn failed(message: impl ToString) -> Self {
        Self { code: EXIT_FAILED, message: message.to_string() }
    }
}

impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Exists(existing) => existing.into(),
            error if error.is_bad_input() => Self::bad_input(error),
            error => Self::failed(error),
        }
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        if error.is_bad_input() { Self::bad_input(error) } else { Self::failed(error) }
    }
}

impl From<ExistingResults> for Failure {
    fn from(existing: ExistingResults) -> Self {
        Self::bad_input(format!("{existing}; choose another --out, or --force writes over it"))
    }
}

/// Runs the program with the arguments of the process, which may begin anew with another environment.
pub fn main() -> ExitCode {
    ExitCode::from(run(std::env::args_os(), ProcessUse::Own))
}

/// Runs the program with these arguments, of which the first is its name, as a part of another program; returns the code that
/// it would exit with.
pub fn run_program(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    run(arguments, ProcessUse::Shared)
}

/// Whose process it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ProcessUse {
    /// The program's alone.
    Own,
    /// Of another program, such as an interpreter, which would run its script twice if the process began anew.
    Shared,
}

fn run(arguments: impl IntoIterator<Item = OsString>, process: ProcessUse) -> u8 {
    let matches = with_negative_numbers(Cli::command()).try_get_matches_from(arguments);
    let cli = match matches.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => {
            // Help goes to standard output, which may be closed.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(BAD_USAGE);
        }
    };
    #[cfg(feature = "render")]
    if cli.draws() && process == ProcessUse::Own {
        runtime_folder::provide();
    }
    #[cfg(not(feature = "render"))]
    let _ = process;
    start_logging(cli.verbose);
    let result = signals::survive_file_limit().and_then(|()| match cli.command {
        None => without_command(),
        Some(command) => run_command(command),
    });
    match result {
        Ok(()) => 0,
        Err(failure) => {
            say::complain(failure.message);
            failure.code
        }
    }
}

/// Exit code for arguments that are no command.
const BAD_USAGE: u8 = 2;

/// `--distance -5` is an invalid value, not an unknown option.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command
        .mut_args(|argument| {
            let takes_value = argument.get_action().takes_values();
            argument.allow_negative_numbers(takes_value)
        })
        .mut_subcommands(with_negative_numbers)
}

#[cfg(feature = "window")]
fn without_command() -> Result<(), Failure> {
    view::view(&view::ViewArgs::default())
}

#[cfg(not(feature = "window"))]
fn without_command() -> Result<(), Failure> {
    Err(Failure::bad_input("this program was built without the window; see city3d --help"))
}

fn run_command(command: Command) -> Result<(), Failure> {
    match command {
        #[cfg(feature = "window")]
        Command::View(args) => view::view(&args),
        Command::Run(args) => run::run(&args),
        Command::Plot(args) => plot::plot(&args),
        Command::Compare(args) => compare::compare(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Sweep(args) => sweep::sweep(&args),
        Command::Serve(args) => serve::serve(&args),
        Command::Mainframe(args) => mainframe::mainframe(&args),
        Command::Testbed(args) => testbed::testbed(&args),
        #[cfg(feature = "render")]
        Command::Frames(args) => frames::frames(&args),
        Command::Check(args) => check::check(&args),
        #[cfg(feature = "render")]
        Command::Bench(command) => bench::bench(&command),
        Command::Generate(args) => generate::generate(&args),
        Command::Licenses => licenses::licenses(),
    }
}

fn start_logging(verbose: u8) {
    use tracing_subscriber::EnvFilter;
    use tracing_subscriber::field::MakeExt;
    use tracing_subscriber::fmt::format;
    let level = ["warn", "info", "debug"][usize::from(verbose.min(2))];
    // Whatever a stranger sends is an error to RustDDS.
    let filter = EnvFilter::try_from_env("CITY3D_LOG")
        .unwrap_or_else(|_| EnvFilter::new(format!("error,rustdds=off,city3d={level}")));
    // Names in fields come from files and from the network.
    let fields = format::debug_fn(|writer, field, value| {
        let value = format!("{value:?}");
        match field.name() {
            "message" => write!(writer, "{}", say::visible(&value)),
            name => write!(writer, "{name}={}", say::visible(&value)),
        }
    });
    // A second command in one process, as of Python, logs as the first one does.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .fmt_fields(fields.delimited(" "))
        .with_writer(std::io::stderr)
        .with_ansi(has_colours())
        .without_time()
        .try_init();
}

/// Whether standard error shows colours: a terminal that can, unless `NO_COLOR` (<https://no-color.org>) asks for none.
fn has_colours() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    std::io::stderr().is_terminal() && !is_set("NO_COLOR") && !is_dumb
}

/// Creates the folder that a command writes into.
fn create_folder(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| {
        Failure::failed(format!("{}: the folder cannot be created: {error}", folder.display()))
    })
}
