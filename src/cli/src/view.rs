//! `city3d view` and the window of `city3d replay`: their options.

use super::overwrite::OverwriteArgs;
use super::say::{complain, say};
use super::signals::at_end;
use super::window_ends::{WindowEnds, WindowEndsArgs};
use super::{ChangeArgs, Failure, LinkArgs, ScenarioArgs, load, look, on_end};
use city3d_logbook::record::{LogOrigin, LogReader};
use city3d_outputs::refuse_inputs;
use city3d_render::{AdapterPreference, write_png};
use city3d_session::pictures::lower_priority;
use city3d_session::remote::{self, RemoteCity, RemoteOptions};
use city3d_session::{FileOptions, Host, RunFiles, RunFolders, Session, SessionHandle, Speed};
use city3d_simulation::scenario::Experiment;
use city3d_viewer::ui::{CameraMode, CityKind, QualityPreset, Theme};
use city3d_viewer::window::{
    self, CitySubject, LogLocation, QualityChoice, QuitSignal, ScenarioSubject, SessionEnds, WindowError,
    WindowOptions, WindowPicture, WindowSubject,
};
use clap::{Args, ValueEnum};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Longest wait for a city that is asked which scenario it serves.
const ASKING: Duration = Duration::from_secs(2);
/// Default scenario of the window.
const FIRST_SCENARIO: &str = "roundabout";

#[derive(Debug, Default, Args)]
pub struct ViewArgs {
    /// A scenario file, or a shipped one: roundabout, mixed, city, straight, student, intersection and others [default: roundabout, or the one
    /// that --city serves]
    scenario: Option<String>,
    #[command(flatten)]
    changed: ChangeArgs,
    /// Folder for the logs: run-1 for the first run, run-2 after a reset [default: a new one in the user's data folder].
    /// With --city: the folder itself, part-2 after a reset [default: nothing is written]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Write no log
    #[arg(long, conflicts_with = "out")]
    no_log: bool,
    /// Speed as a multiple of real time, or "fastest"
    #[arg(long, value_name = "X", value_parser = speed)]
    speed: Option<Speed>,
    /// Start the run at once
    #[arg(long)]
    start: bool,
    /// With --picture: a person drives the selected vehicle
    #[arg(long, requires = "select", requires = "picture")]
    driven: bool,
    #[command(flatten)]
    elsewhere: ElsewhereArgs,
    #[command(flatten)]
    ends: WindowEndsArgs,
    #[command(flatten)]
    window: WindowArgs,
}

/// A city that runs elsewhere.
#[derive(Debug, Default, Args)]
struct ElsewhereArgs {
    /// Watch the city that is served there, instead of running one here
    #[arg(long, value_name = "ADDR", conflicts_with_all = ["start", "speed", "no_log", "model", "environment", "driven"])]
    city: Option<String>,
    /// With --city: bring a car of your own and drive it there; the city needs --guests [default name: guest]
    #[arg(long, value_name = "NAME", num_args = 0..=1, require_equals = true, requires = "city")]
    guest: Option<Option<String>>,
    /// With --city: its world number; 0 matches any [default: 1]
    #[arg(long, value_name = "N", requires = "city")]
    world: Option<u32>,
    /// With --city: file with the shared key
    #[arg(long, value_name = "FILE", requires = "city")]
    key: Option<PathBuf>,
}

/// Options of the windows of scenarios and of logs.
#[derive(Debug, Default, Args)]
pub struct WindowArgs {
    #[command(flatten)]
    look: look::LookArgs,
    /// Size of the window in pixels [default: the last one]
    #[arg(long, value_name = "WxH", value_parser = super::values::size)]
    size: Option<[u32; 2]>,
    /// Neither read nor write the stored settings: layout, quality, previews, gamepads
    #[arg(long)]
    fresh: bool,
    #[command(flatten)]
    picture: WindowPictureArgs,
}

fn speed(text: &str) -> Result<Speed, String> {
    match text.parse::<f64>() {
        _ if text == "fastest" => Ok(Speed::Unlimited),
        Ok(factor) if (Speed::SLOWEST..=Speed::FASTEST).contains(&factor) => Ok(Speed::Times(factor)),
        _ => Err("a factor between 0.1 and 100, or \"fastest\" is needed".to_owned()),
    }
}

#[derive(Debug, Default, Args)]
struct WindowPictureArgs {
    /// Write a picture of the window as a PNG file instead of opening it; needs no display
    #[arg(long, value_name = "FILE", value_parser = png)]
    picture: Option<PathBuf>,
    /// Simulated time of the picture in seconds [default: 0]; with a log also the time at which the window opens
    #[arg(long, value_name = "S", value_parser = super::values::not_negative)]
    at: Option<f64>,
    /// Vehicle to select, by name or id
    #[arg(long, value_name = "VEHICLE")]
    select: Option<String>,
    /// Vehicle whose preview to open, by name or id; repeat for several
    #[arg(long, value_name = "VEHICLE")]
    preview: Vec<String>,
    /// Camera of the large view
    #[arg(long, value_name = "MODE")]
    mode: Option<ModeArg>,
    /// Open the panel Traffic
    #[arg(long)]
    traffic: bool,
    /// Theme of the panels: dark, light or high-contrast
    #[arg(long, value_name = "THEME")]
    theme: Option<Theme>,
    /// Size of texts and widgets, 0.8 to 2
    #[arg(long, value_name = "FACTOR")]
    ui_scale: Option<f32>,
}

/// The name of a PNG file.
fn png(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        return Ok(path);
    }
    let right = path.with_extension("png");
    Err(format!("pictures are written as PNG: give a name that ends in .png, such as {}", right.display()))
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeArg {
    Orbit,
    Chase,
    Onboard,
    Overhead,
    Free,
}

impl From<ModeArg> for CameraMode {
    fn from(mode: ModeArg) -> Self {
        match mode {
            ModeArg::Orbit => Self::Orbit,
            ModeArg::Chase => Self::Chase,
            ModeArg::Onboard => Self::Onboard,
            ModeArg::Overhead => Self::Overhead,
            ModeArg::Free => Self::Free,
        }
    }
}

impl From<WindowError> for Failure {
    fn from(error: WindowError) -> Self {
        if error.is_bad_input() { Self::bad_input(error) } else { Self::failed(error) }
    }
}

pub fn view(args: &ViewArgs) -> Result<(), Failure> {
    if args.window.picture.at.is_some() && args.window.picture.picture.is_none() {
        return Err(Failure::bad_input("--at needs --picture FILE; the window starts at 0"));
    }
    let ends = args.ends.ends(&args.window.look)?;
    if ends.is_some() && args.window.picture.picture.is_some() {
        return Err(Failure::bad_input(
            "--web, --foxglove and --ros2 need a window, and --picture opens none",
        ));
    }
    if let Some(city) = &args.elsewhere.city {
        if args.ends.has_ros2() {
            return Err(Failure::bad_input(
                "--ros2 publishes the poses of a city that runs here: give it to the city3d serve of that city",
            ));
        }
        let subject = WindowSubject::City(args.watched(city, ends.as_ref())?);
        return show(&subject, &args.window.options(), &args.window);
    }
    // Each run has its own folder: run-1, run-2.
    args.out.iter().try_for_each(|folder| args.overwrite.policy().check_runs(folder, "run-"))?;
    let ends = ends.map(|ends| Arc::new(ends) as Arc<dyn SessionEnds>);
    let options = WindowOptions { ends, ..args.window.options() };
    show(&WindowSubject::Scenario(args.subject()), &options, &args.window)
}

/// Shows a recorded run.
pub fn replay(log: &Path, args: &WindowArgs) -> Result<(), Failure> {
    // Reports a bad log before the display is opened.
    LogReader::open(log).map_err(Failure::bad_input)?;
    show(&WindowSubject::Log(log.to_path_buf()), &args.options(), args)
}

fn show(subject: &WindowSubject, options: &WindowOptions, args: &WindowArgs) -> Result<(), Failure> {
    let Some(file) = &args.picture.picture else {
        if !matches!(subject, WindowSubject::City(_)) {
            // Signals end the session of a city, and its window with it.
            let quit = options.quit.clone();
            at_end(move || quit.give())?;
        }
        let recorded = window::open(subject, options)?;
        for run in &recorded {
            say(format_args!("{}: recorded in {}", run.scenario, run.folder.display()))?;
        }
        return match recorded.last() {
            Some(last) => say(format_args!("city3d replay {} shows it again", last.folder.display())),
            None => Ok(()),
        };
    };
    let input = match subject {
        WindowSubject::Scenario(subject) => PathBuf::from(&subject.request.scenario),
        WindowSubject::City(subject) => PathBuf::from(&subject.request.scenario),
        WindowSubject::Log(log) => log.clone(),
    };
    refuse_inputs(&[input], [file.clone()])?;
    let WindowPicture { image, truncation } = window::picture(subject, options)?;
    if let (Some(why), WindowSubject::Log(log)) = (truncation, subject) {
        complain(format_args!(
            "{}: the log is truncated: {why}; it is shown up to its last whole record",
            log.display()
        ));
    }
    write_png(file, &image).map_err(Failure::failed)?;
    say(file.display())
}

/// Options of the window on a served city.
#[derive(Debug, Default, Args)]
pub struct ServedWindowArgs {
    /// Size of the window in pixels [default: the last one]
    #[arg(long, value_name = "WxH", value_parser = super::values::size)]
    size: Option<[u32; 2]>,
    /// Neither read nor write the stored settings of the window
    #[arg(long)]
    fresh: bool,
}

impl ServedWindowArgs {
    /// Shows a served city until the window is closed, which ends the session; gives it back where no window opens.
    pub fn show(
        &self,
        session: SessionHandle,
        (args, experiment): (&ScenarioArgs, &Arc<Experiment>),
        look: look::LookArgs,
    ) -> Result<Option<SessionHandle>, Failure> {
        // Robots wait for the city, and nobody for its picture. The session's thread has its priority already.
        lower_priority();
        let subject = CitySubject::new(session, (args.request(), Arc::clone(experiment)), CityKind::Served);
        let window =
            WindowArgs { look, size: self.size, fresh: self.fresh, picture: WindowPictureArgs::default() };
        let outcome = window::open(&WindowSubject::City(subject.clone()), &window.options());
        match (subject.take(), outcome) {
            (Some(session), Err(error)) => {
                tracing::warn!("{error}; the city is served without a window");
                Ok(Some(session))
            }
            (session, outcome) => {
                outcome?;
                Ok(session)
            }
        }
    }
}

/// Whether a window may open here. On Linux its server is named by the environment.
pub fn has_display() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(target_os = "linux") || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}

impl WindowArgs {
    /// The looks of the city.
    #[cfg(feature = "web")]
    pub fn look(&self) -> &look::LookArgs {
        &self.look
    }

    fn options(&self) -> WindowOptions {
        WindowOptions {
            adapter: self.look.adapter.as_deref().map(AdapterPreference::parse),
            quality: quality(self.look.quality),
            time: self.look.time,
            weather: self.look.weather,
            size: self.size,
            is_fresh: self.fresh,
            at_s: self.picture.at,
            select: self.picture.select.clone(),
            previews: self.picture.preview.clone(),
            mode: self.picture.mode.map(CameraMode::from),
            traffic: self.picture.traffic,
            theme: self.picture.theme,
            ui_scale: self.picture.ui_scale,
            quit: QuitSignal::default(),
            ends: None,
        }
    }
}

impl ViewArgs {
    fn scenario(&self, usual: &str) -> ScenarioArgs {
        let scenario = self.scenario.clone().unwrap_or_else(|| usual.to_owned());
        ScenarioArgs { scenario, changed: self.changed.clone() }
    }

    /// A session that watches a city elsewhere, or visits it.
    fn watched(&self, city: &str, ends: Option<&WindowEnds>) -> Result<CitySubject, Failure> {
        let (host, stop) = (Host::system(), on_end()?);
        let link = LinkArgs { world: self.elsewhere.world.unwrap_or(1), key: self.elsewhere.key.clone() };
        let options = RemoteOptions {
            city: city.to_owned(),
            world: link.world,
            authenticator: link.authenticator()?,
            stop: Arc::clone(&stop),
        };
        let served = match &self.scenario {
            Some(_) => None,
            None => remote::served_scenario(&options, &host, ASKING)?,
        };
        let args = self.scenario(served.as_deref().unwrap_or(FIRST_SCENARIO));
        let experiment = Arc::new(load::city(&args)?);
        let known = Arc::clone(&experiment);
        let source = match &self.elsewhere.guest {
            None => RemoteCity::watch(options, known, host.clone()),
            Some(name) => {
                let name = name.clone().unwrap_or_else(|| "guest".to_owned());
                RemoteCity::visit(options, known, name, host.clone())
            }
        }?;
        let folders = RunFolders::parts(self.out.clone());
        let options = FileOptions { overwrite: self.overwrite.policy(), ..FileOptions::default() };
        let mut inputs = load::inputs(&args.scenario, &experiment);
        inputs.extend(link.key);
        let claimed = self.out.as_ref().map(|folder| options.claim_folder(folder, &inputs)).transpose()?;
        let files =
            RunFiles::new(folders, LogOrigin::Mainframe, options).in_claimed(claimed).without_waiting();
        let written = files.written();
        let mut session = Session::new(source, host).stopped_by(stop).with_end(Box::new(files));
        if let Some(ends) = ends {
            session = ends.attach_servers(session, &experiment, LogOrigin::Mainframe)?;
        }
        let session = session.spawn(Some(written))?;
        ends.map_or(Ok(()), |ends| ends.open(&session))?;
        Ok(CitySubject::new(session, (args.request(), experiment), CityKind::Elsewhere))
    }

    fn subject(&self) -> ScenarioSubject {
        let args = self.scenario(FIRST_SCENARIO);
        let logs = match &self.out {
            _ if self.no_log => LogLocation::Nowhere,
            Some(folder) => LogLocation::In(folder.clone()),
            None => LogLocation::OfTheUser,
        };
        ScenarioSubject {
            request: args.request(),
            logs,
            speed: self.speed,
            starts: self.start,
            has_start_page: self.scenario.is_none() && !self.start,
            is_driven: self.driven,
        }
    }
}

fn quality(asked: Option<look::QualityArg>) -> QualityChoice {
    match asked {
        None => QualityChoice::Stored,
        Some(look::QualityArg::Auto) => QualityChoice::Auto,
        Some(look::QualityArg::Low) => QualityChoice::Preset(QualityPreset::Low),
        Some(look::QualityArg::Medium) => QualityChoice::Preset(QualityPreset::Medium),
        Some(look::QualityArg::High) => QualityChoice::Preset(QualityPreset::High),
        Some(look::QualityArg::Ultra) => QualityChoice::Preset(QualityPreset::Ultra),
    }
}

#[derive(Debug, Args)]
pub struct BenchArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// Number of open previews
    #[arg(long, value_name = "N", default_value_t = 1)]
    previews: usize,
    /// Duration of the measurement in seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct WindowBenchReport {
    bench: &'static str,
    vehicles: usize,
    previews: usize,
    w: u32,
    h: u32,
    pictures: usize,
    pictures_per_s: f64,
    median_ms: f64,
    /// 95th percentile of the frame time.
    p95_ms: f64,
    /// Real-time factor of the run, with a target of 1.
    real_time_factor: f64,
    preset: &'static str,
    adapter: String,
}

/// `city3d bench window`: frame rate of the window, drawn offscreen while the run goes on.
pub fn bench(args: &BenchArgs) -> Result<(), Failure> {
    let (subject, options) = (args.view.subject(), args.view.window.options());
    let found = window::frame_times(&subject, &options, args.previews, args.seconds)?;
    let mut sorted = found.times.clone();
    sorted.sort_unstable();
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    let report = WindowBenchReport {
        bench: "city3d_window",
        vehicles: found.vehicles,
        previews: args.previews,
        w: found.extent[0],
        h: found.extent[1],
        pictures: found.times.len(),
        pictures_per_s: found.times.len() as f64 / found.times.iter().sum::<Duration>().as_secs_f64(),
        median_ms: at(0.5),
        p95_ms: at(0.95),
        real_time_factor: found.real_time_factor,
        preset: found.preset,
        adapter: found.adapter,
    };
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_camera_of_the_window_can_be_asked_for() {
        for mode in CameraMode::ALL {
            let asked = ModeArg::from_str(&mode.label().to_lowercase(), false).unwrap();
            assert_eq!(CameraMode::from(asked), mode);
        }
    }
}
