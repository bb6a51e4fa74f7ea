//! The window: event loop, surface and frame pacing.

use super::display_loss::{catch_display_loss, guard_session};
use super::gamepads::Gamepads;
use super::loading::{LoadJob, LoadRequest, Opened, ShownCity};
use super::painter::{PaintTarget, WindowPainter};
use super::recording::{RecordedRun, RecordingOptions};
use super::settings::{load_profiles, save_profiles};
use super::surface::WindowSurface;
use super::unused::{name_of_moment, unused, written};
use super::video::WindowVideos;
use super::viewer::{ViewerState, WindowRequest};
use super::{ViewSettings, WindowError, WindowOptions, WindowSubject};
use crate::cockpit::Devices;
use crate::ui::runs::Problem;
use crate::ui::{CityKind, Look, UiAction, VideoSubject};
use city3d_render::{Context, Image, write_png};
use city3d_session::Order;
use std::mem::ManuallyDrop;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::{Window, WindowId};

const USUAL_SIZE: [u32; 2] = [1280, 720];
/// Least time between two frames; without a GPU, frames leave CPU time to the run.
const FRAME: Duration = Duration::from_millis(1000 / 60);
const SOFTWARE_FRAME: Duration = Duration::from_millis(1000 / 30);
/// Robots and controllers wait for a served city, which shares the processors with its window.
const SERVED_FRAME: Duration = Duration::from_millis(1000 / 15);

/// Retry interval of a surface that cannot be drawn to.
const RETRY_DELAY: Duration = Duration::from_millis(50);

/// User event from other threads.
#[derive(Clone, Copy, Debug)]
enum WindowNews {
    /// There is something new to draw.
    Redraw,
    /// The window closes, as when its user closes it.
    Quit,
}

/// Opens the window and stays until it is closed; returns the runs that it recorded.
///
/// # Errors
/// When there is no display or no adapter, when the subject is wrong, or when a log could not be written.
pub fn open(subject: &WindowSubject, options: &WindowOptions) -> Result<Vec<RecordedRun>, WindowError> {
    let no_display = |error: &dyn std::fmt::Display| {
        // winit's messages begin with their source location.
        let error = error.to_string();
        let error = error
            .rsplit_once(".rs:")
            .and_then(|(_, rest)| rest.split_once(": "))
            .map_or(&*error, |(_, why)| why);
        WindowError::NoDisplay(error.trim_end_matches('.').to_owned())
    };
    let events = EventLoop::<WindowNews>::with_user_event().build().map_err(|error| no_display(&error))?;
    let proxy = events.create_proxy();
    options.quit.tell(Box::new(move || {
        // The event loop may have ended before.
        let _ = proxy.send_event(WindowNews::Quit);
    }));
    let mut app =
        App { subject, options, proxy: events.create_proxy(), open_window: None, outcome: Ok(Vec::new()) };
    match catch_display_loss(|| events.run_app(&mut app)) {
        Ok(ended) => ended.map_err(|error| no_display(&error))?,
        Err(why) => app.lose_display(why),
    }
    app.outcome
}

/// The egui context with the style of the panels.
pub fn egui_context() -> egui::Context {
    let context = egui::Context::default();
    context.set_theme(egui::Theme::Dark);
    // Slow frames lengthen clicks.
    context.options_mut(|options| options.input_options.max_click_duration = 2.0);
    context
}

struct App<'a> {
    subject: &'a WindowSubject,
    options: &'a WindowOptions,
    proxy: EventLoopProxy<WindowNews>,
    open_window: Option<OpenWindow>,
    outcome: Result<Vec<RecordedRun>, WindowError>,
}

/// State of an open window.
struct OpenWindow {
    window: Arc<Window>,
    surface: WindowSurface,
    painter: WindowPainter,
    viewer: ViewerState,
    egui: egui::Context,
    input: egui_winit::State,
    gamepads: Gamepads,
    /// The load job, and the request that follows it.
    loading: Option<LoadJob>,
    next: Option<WindowRequest>,
    on_update: Arc<dyn Fn() + Send + Sync>,
    settings: ViewSettings,
    remembers: bool,
    is_hidden: bool,
    /// As the window system was told.
    title: String,
    /// The next frame is saved as a screenshot.
    wants_shot: bool,
    videos: WindowVideos,
    /// When the next frame is due, if one is.
    due: Option<Instant>,
    drawn: Instant,
    /// Mean frame time (exponential moving average).
    interval_s: f64,
}

impl App<'_> {
    fn fail(&mut self, events: &ActiveEventLoop, error: WindowError) {
        if self.outcome.is_ok() {
            self.outcome = Err(error);
        }
        events.exit();
    }
}

impl App<'_> {
    /// Stops what the window showed, after its display is gone.
    fn lose_display(&mut self, why: String) {
        let closed = self.open_window.take().map_or(Ok(Vec::new()), OpenWindow::abandon);
        self.outcome = closed.and(Err(WindowError::DisplayLost(why)));
    }
}

impl ApplicationHandler<WindowNews> for App<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.open_window.is_some() {
            return;
        }
        match OpenWindow::open(events, (self.subject, self.options), self.proxy.clone()) {
            Ok(open_window) => self.open_window = Some(open_window),
            Err(error) => self.fail(events, error),
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, news: WindowNews) {
        match (news, &mut self.open_window) {
            (WindowNews::Quit, _) => events.exit(),
            (WindowNews::Redraw, Some(open_window)) => open_window.schedule_frame(Duration::ZERO),
            (WindowNews::Redraw, None) => {}
        }
    }

    fn new_events(&mut self, _events: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(open_window)) = (cause, &mut self.open_window) {
            open_window.window.request_redraw();
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        let Some(open_window) = &mut self.open_window else { return };
        if open_window.input.on_window_event(&open_window.window, &event).repaint {
            open_window.schedule_frame(Duration::ZERO);
        }
        match event {
            // Some systems destroy the window without asking.
            WindowEvent::CloseRequested if open_window.viewer.asks_before(&UiAction::Quit) => {
                open_window.schedule_frame(Duration::ZERO);
            }
            WindowEvent::CloseRequested | WindowEvent::Destroyed => events.exit(),
            WindowEvent::Resized(size) => open_window.resize(size),
            WindowEvent::Occluded(is_hidden) => open_window.is_hidden = is_hidden,
            WindowEvent::RedrawRequested => match open_window.redraw() {
                Ok(true) => {}
                Ok(false) => events.exit(),
                Err(error) => self.fail(events, error),
            },
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let flow =
            self.open_window.as_ref().and_then(|open_window| open_window.due).map(ControlFlow::WaitUntil);
        events.set_control_flow(flow.unwrap_or(ControlFlow::Wait));
    }

    fn exiting(&mut self, _events: &ActiveEventLoop) {
        if let Some(open_window) = self.open_window.take() {
            let closed = open_window.close();
            if self.outcome.is_ok() {
                self.outcome = closed;
            }
        }
    }
}

/// A remembered size, no larger than the largest monitor: that of another day may have been larger.
fn fitting([width, height]: [u32; 2], events: &ActiveEventLoop) -> [u32; 2] {
    let monitors = events.available_monitors().map(|monitor| monitor.size());
    let largest = monitors.max_by_key(|size| u64::from(size.width) * u64::from(size.height));
    largest.map_or([width, height], |size| [width.min(size.width), height.min(size.height)])
}

impl OpenWindow {
    fn open(
        events: &ActiveEventLoop,
        (subject, options): (&WindowSubject, &WindowOptions),
        proxy: EventLoopProxy<WindowNews>,
    ) -> Result<Self, WindowError> {
        let settings = options.settings();
        let remembered = settings.size.map(|size| fitting(size, events));
        let [width, height] = options.size.or(remembered).unwrap_or(USUAL_SIZE);
        let attributes = Window::default_attributes()
            .with_title("City3D")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_min_inner_size(PhysicalSize::new(320, 240));
        let window = Arc::new(events.create_window(attributes)?);
        let mut descriptor =
            wgpu::InstanceDescriptor::new_with_display_handle(Box::new(events.owned_display_handle()));
        descriptor.backends = wgpu::Backends::PRIMARY;
        descriptor.flags = Context::instance_flags();
        let instance = wgpu::Instance::new(descriptor);
        let surface = instance.create_surface(Arc::clone(&window))?;
        let context = Context::for_surface(&instance, &surface, &options.preference())?;
        let surface = WindowSurface::new(Arc::clone(&window), instance, surface, &context)?;
        let on_update: Arc<dyn Fn() + Send + Sync> = Arc::new(move || {
            // The event loop may have ended before the run.
            let _ = proxy.send_event(WindowNews::Redraw);
        });
        let (logs, ends) = (subject.logs(), options.ends.clone());
        let recording = RecordingOptions { logs, ends, on_update: Arc::clone(&on_update) };
        let mut viewer = subject.viewer(options, &context, &settings, recording)?;
        super::picture::arrange(&mut viewer, options)?;
        if matches!(subject, WindowSubject::Scenario(scenario) if scenario.has_start_page) {
            viewer.state.runs.start_page.open();
        }
        if !options.is_fresh {
            viewer.state.devices = Devices::new(load_profiles());
        }
        guard_session(viewer.stopper());
        let gamepads = Gamepads::listen(Arc::clone(&on_update));
        let painter = WindowPainter::new(context, viewer.experiment(), viewer.state.look, surface.format())?;
        let egui = egui_context();
        let most = painter.context().device.limits().max_texture_dimension_2d as usize;
        let input = egui_winit::State::new(
            egui.clone(),
            egui::ViewportId::ROOT,
            &window,
            Some(window.scale_factor() as f32),
            None,
            Some(most),
        );
        if matches!(subject, WindowSubject::Scenario(scenario) if scenario.starts) {
            viewer.send(Order::Start);
        }
        Ok(Self {
            window,
            surface,
            painter,
            viewer,
            egui,
            input,
            gamepads,
            loading: None,
            next: None,
            on_update,
            settings,
            remembers: !options.is_fresh,
            is_hidden: false,
            title: String::new(),
            wants_shot: false,
            videos: WindowVideos::default(),
            due: Some(Instant::now()),
            drawn: Instant::now(),
            interval_s: 0.0,
        })
    }

    fn resize(&mut self, size: PhysicalSize<u32>) {
        if self.surface.has_size() {
            self.surface.configure();
            self.settings.size = Some(size.into());
            self.schedule_frame(Duration::ZERO);
        }
    }

    fn frame(&self) -> Duration {
        match (self.painter.context().is_software, self.viewer.city()) {
            (true, CityKind::Served) => SERVED_FRAME,
            (true, _) => SOFTWARE_FRAME,
            (false, _) => FRAME,
        }
    }

    /// Schedules a frame, not before the least frame time.
    fn schedule_frame(&mut self, after: Duration) {
        let earliest = self.drawn + self.frame();
        let Some(wanted) = Instant::now().checked_add(after) else { return };
        let at = wanted.max(earliest);
        self.due = Some(self.due.map_or(at, |due| due.min(at)));
    }

    /// Lays out and draws one frame; `false` when the user quits.
    fn redraw(&mut self) -> Result<bool, WindowError> {
        self.due = None;
        if self.viewer.has_ended() {
            return Ok(false);
        }
        if self.is_hidden || !self.surface.has_size() {
            return Ok(true);
        }
        self.measure();
        self.hear_gamepads();
        self.take_loaded();
        self.tell_of_videos();
        let textures = self.painter.textures();
        let input = self.input.take_egui_input(&self.window);
        // A message, such as that of a video, is no part of what a screenshot shows.
        let said = if self.wants_shot { self.viewer.state.notice.take() } else { None };
        let (viewer, frames_per_s) = (&mut self.viewer, 1.0 / self.interval_s.max(1e-3));
        let mut actions = Vec::new();
        // A panic of the window system may unwind from here: textures that nobody took would make that two.
        let output = ManuallyDrop::new(
            self.egui.run_ui(input, |ui| actions.extend(viewer.pass(ui, &textures, frames_per_s))),
        );
        self.viewer.state.notice = self.viewer.state.notice.take().or(said);
        self.input.handle_platform_output(&self.window, output.platform_output.clone());
        let repaint =
            output.viewport_output.get(&egui::ViewportId::ROOT).map(|viewport| viewport.repaint_delay);
        let title = self.viewer.title();
        if title != self.title {
            self.window.set_title(&title);
            self.title = title;
        }
        self.painter.draw(self.viewer.city_frame())?;
        self.present(output);
        let requests = self.viewer.act(actions, self.egui.input(|input| input.time));
        for request in requests {
            if request == WindowRequest::Quit {
                return Ok(false);
            }
            self.fulfil(request);
        }
        if self.viewer.is_moving() {
            self.schedule_frame(Duration::ZERO);
        } else if let Some(delay) = repaint {
            self.schedule_frame(delay);
        }
        if let Some(delay) = self.videos.next_in() {
            self.schedule_frame(delay);
        }
        Ok(true)
    }

    /// Shows how the recording of a video does, and says what has become of it.
    fn tell_of_videos(&mut self) {
        self.viewer.video = self.videos.status();
        self.viewer.last_video = self.videos.last().map(Path::to_path_buf);
        if let Some(said) = self.videos.try_said(self.viewer.state.preferences.decimal) {
            self.say(said);
        }
        if self.videos.is_finishing() {
            self.schedule_frame(RETRY_DELAY);
        }
    }

    fn hear_gamepads(&mut self) {
        let now_s = self.egui.input(|input| input.time);
        while let Some(event) = self.gamepads.try_next() {
            if let Some(text) = self.viewer.state.devices.take(event, now_s) {
                self.viewer.state.say(text, now_s);
            }
        }
    }

    fn measure(&mut self) {
        let now = Instant::now();
        let interval_s = now.duration_since(self.drawn).as_secs_f64();
        self.drawn = now;
        // An idle window does not measure the frame rate.
        if interval_s < 0.5 {
            let share = if self.interval_s > 0.0 { 0.1 } else { 1.0 };
            self.interval_s += (interval_s - self.interval_s) * share;
        }
    }

    /// Presents a frame, if the surface is available.
    fn present(&mut self, output: ManuallyDrop<egui::FullOutput>) {
        let Some(texture) = self.surface.next() else {
            self.painter.paint(&self.egui, ManuallyDrop::into_inner(output), &[]);
            self.schedule_frame(RETRY_DELAY);
            return;
        };
        let extent = self.surface.extent();
        let view_of = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let view = view_of(&texture.texture);
        let simulated_s = self.viewer.interpolated().time_s;
        let subject = self.videos.subject_of_next(simulated_s);
        let (is_shot, is_filmed) =
            (std::mem::take(&mut self.wants_shot), subject == Some(VideoSubject::Window));
        let memory = (is_shot || is_filmed).then(|| self.painter.memory(extent));
        let copy = memory.as_ref().map(view_of);
        let screens: Vec<_> = [Some(&view), copy.as_ref()]
            .into_iter()
            .flatten()
            .map(|view| PaintTarget { view, extent })
            .collect();
        self.painter.paint(&self.egui, ManuallyDrop::into_inner(output), &screens);
        self.window.pre_present_notify();
        self.painter.context().queue.present(texture);
        if subject == Some(VideoSubject::City) {
            self.film_city(simulated_s);
        }
        let Some(memory) = memory else { return };
        let image = self.painter.read(&memory);
        if let (true, Ok(image)) = (is_filmed, &image) {
            self.videos.add(image.clone(), simulated_s);
        }
        if is_shot {
            self.keep(image);
        }
    }

    /// Adds the picture of the city to the video, in the size of the video: while the city moves it may be smaller.
    fn film_city(&mut self, simulated_s: f64) {
        let Some(extent) = self.videos.extent() else { return };
        let memory = self.painter.memory(extent);
        let view = memory.create_view(&wgpu::TextureViewDescriptor::default());
        if self.painter.paint_city(PaintTarget { view: &view, extent })
            && let Ok(image) = self.painter.read(&memory)
        {
            self.videos.add(image, simulated_s);
        }
    }

    fn fulfil(&mut self, request: WindowRequest) {
        match request {
            WindowRequest::Look | WindowRequest::Open(_) => self.load(request),
            WindowRequest::Screenshot => self.wants_shot = true,
            WindowRequest::Video(request) => {
                let file = self.unused_file(".mp4");
                let extent = match request.subject {
                    VideoSubject::Window => self.surface.extent(),
                    VideoSubject::City => self.viewer.state.city_pixels,
                };
                self.videos.toggle(request, &file, extent);
            }
            WindowRequest::KeepDevices if self.remembers => {
                save_profiles(self.viewer.state.devices.profiles());
            }
            WindowRequest::KeepDevices | WindowRequest::Quit => {}
        }
        self.schedule_frame(Duration::ZERO);
    }

    /// Starts a load job, or queues the request behind the running one.
    fn load(&mut self, request: WindowRequest) {
        if self.loading.is_some() {
            // A queued scenario takes the look of that time.
            if !matches!((&self.next, &request), (Some(WindowRequest::Open(_)), WindowRequest::Look)) {
                self.next = Some(request);
            }
            return;
        }
        let look = self.viewer.state.look;
        let request = match request {
            WindowRequest::Open(opening) => {
                let Look { hours, weather, .. } = self.painter.look();
                let shown = ShownCity {
                    experiment: Arc::clone(self.viewer.experiment()),
                    look: Look { hours, weather, ..look },
                };
                LoadRequest::Open(opening, shown)
            }
            _ => {
                self.settings.preset = Some(look.preset);
                LoadRequest::Look(Arc::clone(self.viewer.experiment()), look)
            }
        };
        self.viewer.loading = Some(request.label());
        match LoadJob::begin(request, self.painter.context(), Arc::clone(&self.on_update)) {
            Ok(loading) => self.loading = Some(loading),
            Err(error) => self.say(error.to_string()),
        }
    }

    /// Shows the result of a finished load job.
    fn take_loaded(&mut self) {
        let Some(outcome) = self.loading.as_ref().and_then(LoadJob::try_finish) else { return };
        self.loading = None;
        let what = self.viewer.loading.take();
        let now_s = self.egui.input(|input| input.time);
        let shown = outcome.and_then(|loaded| -> Result<(), WindowError> {
            match loaded.opened {
                Some(Opened::Scenario(request, experiment, starts)) => {
                    self.viewer.enter(request, experiment, now_s)?;
                    guard_session(self.viewer.stopper());
                    if starts {
                        self.viewer.send(Order::Start);
                    }
                    self.viewer.state.look.show_light_of(loaded.look);
                }
                Some(Opened::Log(log, player)) => {
                    self.viewer.enter_log(&log, *player, now_s);
                    guard_session(self.viewer.stopper());
                    self.viewer.state.look.show_light_of(loaded.look);
                }
                None => {}
            }
            if let Some(city) = loaded.city {
                self.painter.set_city(city, loaded.look);
            }
            Ok(())
        });
        if let Err(error) = shown {
            let title = what.map_or_else(|| "This cannot be loaded".to_owned(), |what| failed_title(&what));
            self.viewer.state.runs.problem = Some(Problem::of_file(title, error.to_string()));
        }
        if let Some(request) = self.next.take() {
            self.load(request);
        }
    }

    fn say(&mut self, text: String) {
        self.viewer.state.say(text, self.egui.input(|input| input.time));
    }

    /// An unused name in the folder of the run for a file that shows the present moment.
    fn unused_file(&self, ending: &str) -> std::path::PathBuf {
        let (scenario, time_s) = (&self.viewer.experiment().name, self.viewer.clock_s());
        unused(&self.viewer.files_folder(), &name_of_moment(scenario, time_s), ending)
    }

    /// Writes a screenshot into the folder of the run.
    fn keep(&mut self, image: Result<Image, WindowError>) {
        let file = self.unused_file(".png");
        let saved = image.and_then(|image| Ok(write_png(&file, &image)?));
        let said =
            saved.map_or_else(|error| error.to_string(), |()| format!("Screenshot: {}", written(&file)));
        self.say(said);
        self.schedule_frame(Duration::ZERO);
    }

    /// Closes what the window shows, without the window: its display is gone, and what would tell it so panics.
    fn abandon(self) -> Result<Vec<RecordedRun>, WindowError> {
        let Self { window, surface, painter, viewer, egui: _, input, videos, .. } = self;
        drop(videos);
        std::mem::forget((window, surface, painter, input));
        viewer.close()
    }

    fn close(mut self) -> Result<Vec<RecordedRun>, WindowError> {
        if self.remembers {
            self.viewer.remember(&mut self.settings);
            self.settings.save();
        }
        self.viewer.close()
    }
}

/// The title of a failure, from what was said while it was loading.
fn failed_title(what: &str) -> String {
    let what = what.trim_end_matches(" ...");
    let name = what.strip_prefix("Loading ").unwrap_or(what);
    format!("{name} cannot be opened")
}
