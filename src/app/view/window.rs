//! The window itself: its surface, its events, and when it is drawn.

use super::desk::{Desk, Place, Wish};
use super::settings::log_folder;
use super::stage::{Screen, Stage};
use super::{Failure, Settings, ViewArgs};
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

/// Told to the window from the run's thread: there is something new to see.
#[derive(Clone, Copy, Debug)]
struct News;

/// Opens the window and stays until it is closed.
pub fn open(args: &ViewArgs) -> Result<(), Failure> {
    let no_display = |error: &dyn std::fmt::Display| {
        Failure::failed(format!(
            "no window can be opened: {error}. On a machine without a display use `city3d run` or `city3d frames`, \
             `city3d view --picture FILE` for a picture of the window, or a virtual display (xvfb-run city3d); \
             over ssh, `ssh -X`"
        ))
    };
    let events = EventLoop::<News>::with_user_event().build().map_err(|error| no_display(&error))?;
    let mut app = App { args, proxy: events.create_proxy(), shell: None, outcome: Ok(()) };
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
    args: &'a ViewArgs,
    proxy: EventLoopProxy<News>,
    shell: Option<Shell>,
    outcome: Result<(), Failure>,
}

/// Everything that is there while the window is open.
struct Shell {
    window: Arc<Window>,
    instance: wgpu::Instance,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    stage: Stage,
    desk: Desk,
    egui: egui::Context,
    input: egui_winit::State,
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
        match Shell::open(events, self.args, self.proxy.clone()) {
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
            WindowEvent::CloseRequested => events.exit(),
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
    fn open(events: &ActiveEventLoop, args: &ViewArgs, proxy: EventLoopProxy<News>) -> Result<Self, Failure> {
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
        let config = configuration(&surface, &context, window.inner_size())?;
        let logs = if args.no_log { None } else { args.out.clone().or_else(|| log_folder(&args.scenario)) };
        let on_news = Arc::new(move || {
            // The event loop may have ended before the run.
            let _ = proxy.send_event(News);
        });
        let mut desk = args.desk(&context, &settings, Place { logs, on_news })?;
        desk.set_adapter(&context);
        let stage = Stage::new(context, desk.experiment(), desk.state.look, config.format)?;
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
        if args.start {
            desk.order(Order::Start);
        }
        let mut shell = Self {
            window,
            instance,
            surface,
            config,
            stage,
            desk,
            egui,
            input,
            settings,
            remembers: !args.fresh,
            is_hidden: false,
            wants_shot: false,
            due: Some(Instant::now()),
            drawn: Instant::now(),
            interval_s: 0.0,
        };
        shell.configure();
        Ok(shell)
    }

    fn has_size(&self) -> bool {
        let size = self.window.inner_size();
        size.width > 0 && size.height > 0
    }

    fn configure(&mut self) {
        let most = self.stage.context().device.limits().max_texture_dimension_2d;
        let size = self.window.inner_size();
        if size.width > 0 && size.height > 0 {
            (self.config.width, self.config.height) = (size.width.min(most), size.height.min(most));
            self.surface.configure(&self.stage.context().device, &self.config);
        }
    }

    fn resize(&mut self, size: PhysicalSize<u32>) {
        // A minimised window has no size on some systems: nothing is drawn until it has one again.
        if size.width > 0 && size.height > 0 {
            self.configure();
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
        if self.is_hidden || !self.has_size() {
            return Ok(true);
        }
        self.measure();
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
            self.grant(&wish)?;
        }
        if self.desk.is_moving() {
            self.want(Duration::ZERO);
        } else if let Some(delay) = repaint {
            self.want(delay);
        }
        Ok(true)
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
        use wgpu::CurrentSurfaceTexture::{
            Lost, Occluded, Outdated, Suboptimal, Success, Timeout, Validation,
        };
        let extent = [self.config.width, self.config.height];
        let texture = match self.surface.get_current_texture() {
            Success(texture) | Suboptimal(texture) => texture,
            Timeout | Occluded => {
                self.stage.paint(&self.egui, output, &[]);
                return;
            }
            problem @ (Outdated | Lost | Validation) => {
                self.stage.paint(&self.egui, output, &[]);
                self.recover(matches!(problem, Lost));
                return;
            }
        };
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

    /// Makes the surface usable again; the next picture is drawn soon.
    fn recover(&mut self, is_lost: bool) {
        if is_lost {
            match self.instance.create_surface(Arc::clone(&self.window)) {
                Ok(surface) => self.surface = surface,
                Err(error) => tracing::warn!("the window's surface is lost: {error}"),
            }
        }
        self.configure();
        self.want(Duration::from_millis(50));
    }

    fn grant(&mut self, wish: &Wish) -> Result<(), Failure> {
        let look = self.desk.state.look;
        match wish {
            Wish::Look => {
                self.settings.preset = Some(look.preset);
                self.stage.set_scene(self.desk.experiment(), look)?;
            }
            Wish::Scene => self.stage.set_scene(self.desk.experiment(), look)?,
            Wish::Screenshot => self.wants_shot = true,
            Wish::Quit => {}
        }
        self.want(Duration::ZERO);
        Ok(())
    }

    /// Writes a picture of the window into the working folder.
    fn keep(&mut self, memory: &wgpu::Texture) {
        let file = format!("city3d-{}.png", self.desk.moment().now.tick);
        let written = self.stage.read(memory);
        let written = written.and_then(|image| write_png(file.as_ref(), &image).map_err(Failure::failed));
        let said = written.map_or_else(|failure| failure.message, |()| format!("Screenshot: {file}"));
        self.desk.state.say(said, self.egui.input(|input| input.time));
        self.want(Duration::ZERO);
    }

    fn close(mut self) -> Result<(), Failure> {
        if self.remembers {
            self.settings.layers = self.desk.state.layers;
            self.settings.table = self.desk.state.table.clone();
            self.settings.mode = self.desk.state.viewpoint.mode;
            self.settings.save();
        }
        self.desk.close()
    }
}

/// A surface whose colours are taken as they are: panels and city encode theirs themselves.
fn configuration(
    surface: &wgpu::Surface<'_>,
    context: &Context,
    size: PhysicalSize<u32>,
) -> Result<wgpu::SurfaceConfiguration, Failure> {
    let adapter = &context.adapter;
    let mut config = surface
        .get_default_config(adapter, size.width.max(1), size.height.max(1))
        .ok_or_else(|| Failure::failed(format!("{} cannot draw to this window", context.adapter_name)))?;
    let formats = surface.get_capabilities(adapter).formats;
    let wanted = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
    if let Some(format) = wanted.into_iter().find(|format| formats.contains(format)) {
        config.format = format;
    }
    config.present_mode = wgpu::PresentMode::AutoVsync;
    config.desired_maximum_frame_latency = 1;
    Ok(config)
}
