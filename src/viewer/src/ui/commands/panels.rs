//! Actions on panels, overlays and the window itself.

use super::{Availability, Command, CommandContext, Hint, ctrl, key, registry};
use crate::ui::{ColourBy, OpenPanels, Panel, SettingsPage, UiAction, VideoKind, VideoRequest, preview};
use egui::Key;

registry!(
    PALETTE = Command::always("Find an action", &[ctrl(Key::P)], |c| c.state.palette.open()),
    HELP = Command::always("Help: all keys and statuses", &[key(Key::F1), key(Key::Questionmark)], |c| {
        c.state.open.help = !c.state.open.help;
    })
    .known_as("shortcuts manual documentation"),
    VEHICLES = Command::always("Show or hide the table of vehicles", &[ctrl(Key::B)], |c| {
        toggle(c, Panel::Vehicles, |open| &mut open.vehicles);
    })
    .known_as("cars list"),
    CAMERAS = Command::always("Show or hide the cameras", &[ctrl(Key::B).with_shift()], cameras)
        .known_as("previews camera pictures sensors"),
    EVENTS = Command::always("List of events", &[key(Key::F3)], |c| {
        toggle(c, Panel::Events, |open| &mut open.events);
    })
    .known_as("collisions crashes jump history"),
    TRAFFIC = Command::always("Traffic: delay, safety, space-time diagram", &[key(Key::F4)], |c| {
        toggle(c, Panel::Traffic, |open| &mut open.traffic);
    })
    .known_as("queue throughput flow fuel energy stops metrics statistics"),
    LAYERS = Command::always("Layers: overlays of the city", &[], |c| {
        toggle(c, Panel::Layers, |open| &mut open.layers);
    })
    .known_as("labels lanes routes display"),
    SETTINGS = Command::always("Settings: theme, size, units", &[ctrl(Key::Comma)], |c| {
        c.state.open.settings = !c.state.open.settings;
    })
    .known_as("preferences options dark light language"),
    KEYS = Command::always("Settings: assign keys", &[], |c| {
        (c.state.open.settings, c.state.settings_page) = (true, SettingsPage::Keys);
    })
    .known_as("shortcuts bindings"),
    SECOND_VIEW = Command::always("Show or hide a second view of the city", &[], |c| view(c, 0))
        .known_as("split camera window"),
    THIRD_VIEW = Command::always("Show or hide a third view of the city", &[], |c| view(c, 1))
        .known_as("split camera window"),
    RESTORE_LAYOUT = Command::always("Restore the layout", &[], |c| c.state.restore_layout())
        .known_as("reset windows panels default"),
    FLOAT_VEHICLES =
        Command::always("Float or dock the table of vehicles", &[], |c| float(c, Panel::Vehicles)),
    FLOAT_CAMERAS = Command::always("Float or dock the cameras", &[], |c| float(c, Panel::Cameras)),
    FLOAT_EVENTS = Command::always("Float or dock the list of events", &[], |c| float(c, Panel::Events)),
    FLOAT_TRAFFIC = Command::always("Float or dock the traffic", &[], |c| float(c, Panel::Traffic)),
    FLOAT_CHARTS = Command::always("Float or dock the charts", &[], |c| float(c, Panel::Charts)),
    FLOAT_LAYERS = Command::always("Float or dock the layers", &[], |c| float(c, Panel::Layers)),
    FLOAT_CONTROLLERS = Command::always("Float or dock the gamepad and steering wheel", &[], |c| float(
        c,
        Panel::Controllers
    )),
    FLOAT_EDITOR = Command::always("Float or dock the editor", &[], |c| float(c, Panel::Editor)),
    FLOAT_SECOND_VIEW =
        Command::always("Float or dock the second view", &[], |c| float(c, Panel::SecondView)),
    FLOAT_THIRD_VIEW = Command::always("Float or dock the third view", &[], |c| float(c, Panel::ThirdView)),
    FLOAT_INSPECTOR = Command::always("Float or dock the inspector", &[], |c| float(c, Panel::Inspector)),
    INSPECTOR =
        Command::always("Inspector: why the selected vehicle does what it does", &[key(Key::I)], |c| {
            toggle(c, Panel::Inspector, |open| &mut open.inspector);
        })
        .known_as("reason details yield slow stop wait brake stand is it"),
    LABELS = Command::always("Show or hide labels over vehicles", &[key(Key::L)], |c| {
        c.state.layers.labels = !c.state.layers.labels;
    })
    .known_as("names"),
    MAP = Command::always("Show or hide the map", &[key(Key::M)], |c| {
        c.state.layers.map = !c.state.layers.map;
    }),
    LANES = Command::always("Show or hide lanes", &[], |c| c.state.layers.lanes = !c.state.layers.lanes),
    ROUTES = Command::always("Show or hide the route of the selected vehicle", &[], |c| {
        c.state.layers.routes = !c.state.layers.routes;
    }),
    ALL_ROUTES = Command::always("Show or hide the routes of all vehicles", &[], |c| {
        c.state.layers.all_routes = !c.state.layers.all_routes;
    }),
    CONFLICT_ZONES = Command::always("Show or hide conflict zones", &[], |c| {
        c.state.layers.zones = !c.state.layers.zones;
    }),
    CONTROL_ZONES = Command::always("Show or hide control zones", &[], |c| {
        c.state.layers.control_zones = !c.state.layers.control_zones;
    })
    .known_as("coordination"),
    PLANS = Command::always("Show or hide plans of coordinated vehicles", &[], |c| {
        c.state.layers.plans = !c.state.layers.plans;
    })
    .known_as("coordination"),
    CHARTS = Command::always("Charts of several vehicles", &[key(Key::F6)], |c| {
        toggle(c, Panel::Charts, |open| &mut open.charts);
    })
    .known_as("plot graph figure diagram speed acceleration"),
    VIDEO = Command::always("Record a video, or end it", &[key(Key::F9)], |c| {
        video(c, VideoKind::AsSeen);
    })
    .known_as("export film movie mp4"),
    END_VIDEO = Command::always("End the video or time-lapse", &[], |c| video(c, VideoKind::AsSeen))
        .known_as("stop recording finish timelapse film movie")
        .only(|_, shown| Availability::when(shown.video.is_some())),
    VIDEO_SUBJECT = Command::always("Switch videos between the whole window and the city alone", &[], |c| {
        c.state.video_subject = c.state.video_subject.other();
    }),
    TIME_LAPSE = Command::always("Record a time-lapse", &[], |c| {
        video(c, VideoKind::TimeLapse { every_s: c.state.lapse_s });
    })
    .known_as("export film video timelapse lapse")
    .only(|_, shown| Availability::when(shown.video.is_none())),
    SAVE_CHART = Command::always("Save the chart as SVG, PNG and CSV", &[], |c| {
        c.actions.push(UiAction::SaveChart);
    })
    .known_as("export plot figure")
    .only(|state, _| match state.open.charts {
        true => Availability::Now,
        false => Availability::After(Hint::by("Open the charts first", &CHARTS)),
    }),
    BOXES = Command::always("Show or hide boxes", &[], |c| c.state.layers.boxes = !c.state.layers.boxes),
    TRACKS = Command::always("Show or hide driven paths", &[], |c| {
        c.state.layers.tracks = !c.state.layers.tracks;
    })
    .known_as("trajectory trail"),
    PATH = Command::always("Show or hide the way ahead", &[], |c| {
        c.state.layers.path = !c.state.layers.path;
    })
    .known_as("trajectory"),
    GAPS = Command::always("Show or hide gaps and headways", &[], |c| {
        c.state.layers.gaps = !c.state.layers.gaps;
    }),
    MEASURED = Command::always("Show or hide measured poses", &[], |c| {
        c.state.layers.measured = !c.state.layers.measured;
    }),
    FRUSTA = Command::always("Show or hide what cameras see", &[], |c| {
        c.state.layers.frusta = !c.state.layers.frusta;
    })
    .known_as("field of view"),
    LEGEND = Command::always("Show or hide the legend", &[], |c| {
        c.state.layers.legend = !c.state.layers.legend;
    }),
    RULERS = Command::always("Show or hide scale, north and place under the mouse", &[], |c| {
        c.state.layers.rulers = !c.state.layers.rulers;
    })
    .known_as("coordinates compass"),
    COLOUR_STATUS = Command::always("Colour labels by status", &[], |c| {
        c.state.layers.colour = ColourBy::Status;
    }),
    COLOUR_SPEED = Command::always("Colour labels by speed", &[], |c| {
        c.state.layers.colour = ColourBy::Speed;
    }),
    COLOUR_WAITING = Command::always("Colour labels by waiting time", &[], |c| {
        c.state.layers.colour = ColourBy::Waiting;
    }),
    MEASURE =
        Command::always("Measure lengths", &[], |c| c.state.measure.begin(None)).known_as("distance ruler"),
    SCREENSHOT = Command::always("Save a screenshot", &[key(Key::F12)], |c| {
        c.actions.push(UiAction::Screenshot);
    })
    .known_as("export picture image photo")
    .in_dialogs(),
    QUIT = Command::always("Quit", &[ctrl(Key::Q)], |c| c.actions.push(UiAction::Quit))
        .known_as("exit close")
        .in_dialogs(),
);

/// The other large views, which the menu lists, too.
pub static VIEWS: [&Command; 2] = [&SECOND_VIEW, &THIRD_VIEW];

/// Panels and pages that the menu of the bar lists.
pub static MENU: [&Command; 7] = [&VEHICLES, &CAMERAS, &EVENTS, &TRAFFIC, &CHARTS, &INSPECTOR, &LAYERS];

fn video(context: &mut CommandContext<'_, '_>, kind: VideoKind) {
    context.actions.push(UiAction::Video(VideoRequest {
        subject: context.state.video_subject,
        kind,
        lasts_s: None,
    }));
}

fn view(context: &mut CommandContext<'_, '_>, index: usize) {
    let is_open = &mut context.state.open.views[index];
    *is_open = !*is_open;
}

/// Shows or hides a panel; one that is open behind another tab comes to the front.
fn toggle(context: &mut CommandContext<'_, '_>, panel: Panel, of: fn(&mut OpenPanels) -> &mut bool) {
    let state = &mut *context.state;
    let is_open = of(&mut state.open);
    if !(*is_open && state.layout.raise(panel)) {
        *is_open = !*is_open;
    }
}

fn float(context: &mut CommandContext<'_, '_>, panel: Panel) {
    context.state.layout.toggle_floating(panel);
}

/// Shows or hides the previews; where there is none, opens one.
fn cameras(context: &mut CommandContext<'_, '_>) {
    let state = &mut *context.state;
    if state.previews.is_empty() {
        preview::open_first(state, context.shown);
    } else {
        state.open.cameras = !state.open.cameras;
    }
}
