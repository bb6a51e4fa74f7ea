//! The window itself: its surface, its events, and when it is drawn.

use super::desk::{Desk, Place, Wish};
use super::gamepads::Gamepads;
use super::loading::{Loading, Request};
use super::settings::{load_profiles, save_profiles};
use super::stage::{Screen, Stage};
use super::surface::Surface;
use super::{Failure, Settings, Subject};
use crate::cockpit::Devices;
use crate::live::Order;
use crate::render::{Context, write_png};
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::{Window, WindowId};

const USUAL_SIZE: [u32; 2] = [1280, 720];
/// Pictures follow one another no faster than this; without a GPU they leave the run some of the processor.
const FRAME: Duration = Duration::from_millis(1000 / 60);
const SOFTWARE_FRAME: Duration = Duration::from_millis(1000 / 30);

/// A window that cannot be drawn to is tried again after this.
const AGAIN: Duration = Duration::from_millis(50);

/// Told to the window from other threads: there is something new to see.
#[derive(Clone, Copy, Debug)]
struct News;

/// Opens the window and stays until it is closed.
pub fn open(subject: &Subject<'_>) -> Result<(), Failure> {
    let no_display = |error: &dyn std::fmt::Display| {
        // What winit tells of the operating system begins with the place in its source.
        let error = error.to_string();
        let error = error
            .rsplit_once(".rs:")
            .and_then(|(_, rest)| rest.split_once(": "))
            .map_or(&*error, |(_, why)| why);
        let error = error.trim_end_matches('.');
        Failure::failed(format!(
            "no window can be opened: {error}. On a machine without a display use `city3d run` or `city3d frames`, \
             `city3d view --picture FILE` (`city3d replay LOG --picture FILE`) for a picture of the window, or a virtual display (xvfb-run city3d); \
             over ssh, `ssh -X`"
        ))
    };
    let events = EventLoop::<News>::with_user_event().build().map_err(|error| no_display(&error))?;
    let mut app = App { subject, proxy: events.create_proxy(), shell: None, outcome: Ok(()) };
    events.run_app(&mut app).map_err(|error| no_display(&error))?;
    app.outcome
}

/// The look of the panels.
pub fn egui_context() -> egui::Context {
    let context = egui::Context::default();
    context.set_theme(egui::Theme::Dark);
    // Where pictures take long, a click does too.
    context.options_mut(|options| options.input_options.max_click_duration = 2.0);
    context
}

struct App<'a> {
    subject: &'a Subject<'a>,
    proxy: EventLoopProxy<News>,
    shell: Option<Shell>,
    outcome: Result<(), Failure>,
}

/// Everything that is there while the window is open.
struct Shell {
    window: Arc<Window>,
    surface: Surface,
    stage: Stage,
    desk: Desk,
    egui: egui::Context,
    input: egui_winit::State,
    gamepads: Gamepads,
    /// What is being loaded, and what is to be done then.
    loading: Option<Loading>,
    next: Option<Wish>,
    on_news: Arc<dyn Fn() + Send + Sync>,
    settings: Settings,
    remembers: bool,
    is_hidden: bool,
    /// The next picture is kept as a file.
    wants_shot: bool,
    /// When the next picture shall be drawn, if one shall.
    due: Option<Instant>,
    drawn: Instant,
    /// Mean time between pictures.
    interval_s: f64,
}

impl App<'_> {
    fn finish(&mut self, events: &ActiveEventLoop, outcome: Result<(), Failure>) {
        if self.outcome.is_ok() {
            self.outcome = outcome;
        }
        events.exit();
    }
}

impl ApplicationHandler<News> for App<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.shell.is_some() {
            return;
        }
        match Shell::open(events, self.subject, self.proxy.clone()) {
            Ok(shell) => self.shell = Some(shell),
            Err(failure) => self.finish(events, Err(failure)),
        }
    }

    fn user_event(&mut self, _events: &ActiveEventLoop, _news: News) {
        if let Some(shell) = &mut self.shell {
            shell.want(Duration::ZERO);
        }
    }

    fn new_events(&mut self, _events: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(shell)) = (cause, &mut self.shell) {
            shell.window.request_redraw();
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        let Some(shell) = &mut self.shell else { return };
        if shell.input.on_window_event(&shell.window, &event).repaint {
            shell.want(Duration::ZERO);
        }
        match event {
            // Some systems take the window away without asking.
            WindowEvent::CloseRequested | WindowEvent::Destroyed => events.exit(),
            WindowEvent::Resized(size) => shell.resize(size),
            WindowEvent::Occluded(is_hidden) => shell.is_hidden = is_hidden,
            WindowEvent::RedrawRequested => match shell.redraw() {
                Ok(true) => {}
                Ok(false) => events.exit(),
                Err(failure) => self.finish(events, Err(failure)),
            },
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let flow = self.shell.as_ref().and_then(|shell| shell.due).map(ControlFlow::WaitUntil);
        events.set_control_flow(flow.unwrap_or(ControlFlow::Wait));
    }

    fn exiting(&mut self, _events: &ActiveEventLoop) {
        if let Some(shell) = self.shell.take() {
            let closed = shell.close();
            if self.outcome.is_ok() {
                self.outcome = closed;
            }
        }
    }
}

impl Shell {
    fn open(
        events: &ActiveEventLoop,
        subject: &Subject<'_>,
        proxy: EventLoopProxy<News>,
    ) -> Result<Self, Failure> {
        let args = subject.window();
        let settings = args.settings();
        let [width, height] = args.size.or(settings.size).unwrap_or(USUAL_SIZE);
        let attributes = Window::default_attributes()
            .with_title("City3D")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_min_inner_size(PhysicalSize::new(320, 240));
        let window = Arc::new(events.create_window(attributes).map_err(Failure::failed)?);
        let mut descriptor =
            wgpu::InstanceDescriptor::new_with_display_handle(Box::new(events.owned_display_handle()));
        descriptor.backends = wgpu::Backends::PRIMARY;
        let instance = wgpu::Instance::new(descriptor);
        let surface = instance.create_surface(Arc::clone(&window)).map_err(Failure::failed)?;
        let context =
            Context::for_surface(&instance, &surface, &args.preference()).map_err(super::look::failure)?;
        let surface = Surface::new(Arc::clone(&window), instance, surface, &context)?;
        let on_news: Arc<dyn Fn() + Send + Sync> = Arc::new(move || {
            // The event loop may have ended before the run.
            let _ = proxy.send_event(News);
        });
        let place = Place { logs: subject.logs(), on_news: Arc::clone(&on_news) };
        let mut desk = subject.desk(&context, &settings, place)?;
        super::picture::arrange(&mut desk, subject)?;
        if !args.fresh {
            desk.state.devices = Devices::new(load_profiles());
        }
        let gamepads = Gamepads::listen(Arc::clone(&on_news));
        let stage = Stage::new(context, desk.experiment(), desk.state.look, surface.format())?;
        let egui = egui_context();
        let most = stage.context().device.limits().max_texture_dimension_2d as usize;
        let input = egui_winit::State::new(
            egui.clone(),
            egui::ViewportId::ROOT,
            &window,
            Some(window.scale_factor() as f32),
            None,
            Some(most),
        );
        if matches!(subject, Subject::Scenario(args) if args.start) {
            desk.order(Order::Start);
        }
        Ok(Self {
            window,
            surface,
            stage,
            desk,
            egui,
            input,
            gamepads,
            loading: None,
            next: None,
            on_news,
            settings,
            remembers: !args.fresh,
            is_hidden: false,
            wants_shot: false,
            due: Some(Instant::now()),
            drawn: Instant::now(),
            interval_s: 0.0,
        })
    }

    fn resize(&mut self, size: PhysicalSize<u32>) {
        if self.surface.has_size() {
            self.surface.configure();
            self.settings.size = Some(size.into());
            self.want(Duration::ZERO);
        }
    }

    fn frame(&self) -> Duration {
        if self.stage.context().is_software { SOFTWARE_FRAME } else { FRAME }
    }

    /// Asks for a picture after a while, or as soon as the last one is old enough.
    fn want(&mut self, after: Duration) {
        let earliest = self.drawn + self.frame();
        let Some(wanted) = Instant::now().checked_add(after) else { return };
        let at = wanted.max(earliest);
        self.due = Some(self.due.map_or(at, |due| due.min(at)));
    }

    /// One pass of the panels, drawn. `false` when the user wants to quit.
    fn redraw(&mut self) -> Result<bool, Failure> {
        self.due = None;
        if self.is_hidden || !self.surface.has_size() {
            return Ok(true);
        }
        self.measure();
        self.hear_gamepads();
        self.take_loaded();
        let textures = self.stage.textures();
        let input = self.input.take_egui_input(&self.window);
        let (desk, frames_per_s) = (&mut self.desk, 1.0 / self.interval_s.max(1e-3));
        let mut actions = Vec::new();
        let output = self.egui.run_ui(input, |ui| actions.extend(desk.pass(ui, &textures, frames_per_s)));
        self.input.handle_platform_output(&self.window, output.platform_output.clone());
        let repaint =
            output.viewport_output.get(&egui::ViewportId::ROOT).map(|viewport| viewport.repaint_delay);
        self.stage.draw(self.desk.seen(), self.desk.pictures())?;
        self.present(output);
        let wishes = self.desk.act(actions, self.egui.input(|input| input.time));
        for wish in wishes {
            if wish == Wish::Quit {
                return Ok(false);
            }
            self.grant(wish);
        }
        if self.desk.is_moving() {
            self.want(Duration::ZERO);
        } else if let Some(delay) = repaint {
            self.want(delay);
        }
        Ok(true)
    }

    fn hear_gamepads(&mut self) {
        let now_s = self.egui.input(|input| input.time);
        while let Some(event) = self.gamepads.try_next() {
            if let Some(text) = self.desk.state.devices.take(event, now_s) {
                self.desk.state.say(text, now_s);
            }
        }
    }

    fn measure(&mut self) {
        let now = Instant::now();
        let interval_s = now.duration_since(self.drawn).as_secs_f64();
        self.drawn = now;
        // A window that waited says nothing about how fast it can draw.
        if interval_s < 0.5 {
            let share = if self.interval_s > 0.0 { 0.1 } else { 1.0 };
            self.interval_s += (interval_s - self.interval_s) * share;
        }
    }

    /// Shows a pass on the window, if that can be drawn to.
    fn present(&mut self, output: egui::FullOutput) {
        let Some(texture) = self.surface.next() else {
            self.stage.paint(&self.egui, output, &[]);
            self.want(AGAIN);
            return;
        };
        let extent = self.surface.extent();
        let view_of = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let view = view_of(&texture.texture);
        let memory = std::mem::take(&mut self.wants_shot).then(|| self.stage.memory(extent));
        let copy = memory.as_ref().map(view_of);
        let screens: Vec<_> =
            [Some(&view), copy.as_ref()].into_iter().flatten().map(|view| Screen { view, extent }).collect();
        self.stage.paint(&self.egui, output, &screens);
        self.window.pre_present_notify();
        self.stage.context().queue.present(texture);
        if let Some(memory) = memory {
            self.keep(&memory);
        }
    }

    fn grant(&mut self, wish: Wish) {
        match wish {
            Wish::Look | Wish::Scenario(_) => self.load(wish),
            Wish::Screenshot => self.wants_shot = true,
            Wish::KeepDevices if self.remembers => save_profiles(self.desk.state.devices.profiles()),
            Wish::KeepDevices | Wish::Quit => {}
        }
        self.want(Duration::ZERO);
    }

    /// Begins to load what is wished, or does so once what is being loaded is there.
    fn load(&mut self, wish: Wish) {
        if self.loading.is_some() {
            // A scenario comes with the look that is chosen by then.
            if !matches!((&self.next, &wish), (Some(Wish::Scenario(_)), Wish::Look)) {
                self.next = Some(wish);
            }
            return;
        }
        let look = self.desk.state.look;
        let request = match wish {
            Wish::Scenario(args) => Request::Scenario(args, look),
            _ => {
                self.settings.preset = Some(look.preset);
                Request::Look(Arc::clone(self.desk.experiment()), look)
            }
        };
        self.desk.loading = Some(request.label());
        match Loading::begin(request, self.stage.context(), Arc::clone(&self.on_news)) {
            Ok(loading) => self.loading = Some(loading),
            Err(failure) => self.say(failure.message),
        }
    }

    /// Shows what has been loaded.
    fn take_loaded(&mut self) {
        let Some(outcome) = self.loading.as_ref().and_then(Loading::try_finish) else { return };
        (self.loading, self.desk.loading) = (None, None);
        let shown = outcome.and_then(|loaded| {
            if let Some((args, experiment)) = loaded.scenario {
                self.desk.enter(args, experiment, self.egui.input(|input| input.time))?;
                self.desk.state.look.hours = loaded.look.hours;
            }
            self.stage.set_city(loaded.city);
            Ok(())
        });
        if let Err(failure) = shown {
            self.say(failure.message);
        }
        if let Some(wish) = self.next.take() {
            self.load(wish);
        }
    }

    fn say(&mut self, text: String) {
        self.desk.state.say(text, self.egui.input(|input| input.time));
    }

    /// Writes a picture of the window into the working folder.
    fn keep(&mut self, memory: &wgpu::Texture) {
        let file = unused(self.desk.moment().now.tick);
        let written = self.stage.read(memory);
        let written = written.and_then(|image| write_png(&file, &image).map_err(Failure::failed));
        let whole = std::path::absolute(&file).unwrap_or(file);
        let said =
            written.map_or_else(|failure| failure.message, |()| format!("Screenshot: {}", whole.display()));
        self.say(said);
        self.want(Duration::ZERO);
    }

    fn close(mut self) -> Result<(), Failure> {
        if self.remembers {
            self.desk.remember(&mut self.settings);
            self.settings.save();
        }
        self.desk.close()
    }
}

/// A name for a screenshot of a tick that no file has yet.
fn unused(tick: u64) -> std::path::PathBuf {
    let first = std::iter::once(format!("city3d-{tick}.png"));
    let others = (2..).map(|k| format!("city3d-{tick}-{k}.png"));
    let mut names = first.chain(others).map(std::path::PathBuf::from);
    names.find(|name| !name.exists()).unwrap_or_else(|| format!("city3d-{tick}.png").into())
}
