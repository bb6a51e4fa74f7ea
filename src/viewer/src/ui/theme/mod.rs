//! Themes: colours of panels, texts and statuses.

mod contrast;
mod decimal;
mod preferences;

pub use contrast::difference;
use contrast::legible;
#[cfg(test)]
pub use contrast::vision;
pub use decimal::{DecimalSeparator, typed};
pub use preferences::{Preferences, SCALES, SpeedUnit, StatusColours, Theme};

use city3d_geometry::trig;
use city3d_protocol::snapshot::Status;
use egui::{Color32, Context, FontId, Id, Rangef, Shadow, Stroke, TextStyle, Ui, Visuals};
use egui_plot::AxisHints;

/// Gives the context the user's theme and scale, once after a change.
pub(super) fn apply(context: &Context, preferences: Preferences) {
    if of(context) == Some(preferences) {
        return;
    }
    let (theme, visuals) = match preferences.theme {
        Theme::Dark => (egui::Theme::Dark, dark()),
        Theme::Light => (egui::Theme::Light, light()),
        Theme::HighContrast => (egui::Theme::Dark, high_contrast()),
    };
    context.set_theme(theme);
    context.set_visuals_of(theme, Visuals { window_shadow: SHADOW, ..visuals });
    context.set_zoom_factor(preferences.scale);
    let decimal = preferences.decimal;
    context.all_styles_mut(|style| {
        let written = move |number: f64, decimals: std::ops::RangeInclusive<usize>| {
            decimal.written(egui::emath::format_with_decimals_in_range(number, decimals))
        };
        style.number_formatter = egui::style::NumberFormatter::new(written);
        style.text_styles.insert(TextStyle::Small, FontId::proportional(SMALL));
        // A bar over the last digit of a column hides it.
        style.spacing.scroll.floating_allocated_width = SCROLL_BAR;
        // Without it nothing says that a list goes on.
        style.spacing.scroll.dormant_handle_opacity = 0.5;
        // A faded entry at the edge of a list looks as if it could not be chosen.
        style.spacing.scroll.fade.strength = 0.0;
    });
    // Ctrl with + and - are actions.
    context.options_mut(|options| options.zoom_with_keyboard = false);
    context.data_mut(|data| data.insert_temp(Id::unique(KEY), preferences));
}

/// Shadow of windows. That of egui reaches 35 points down: widgets in it look as if they could not be used.
const SHADOW: Shadow = Shadow { offset: [0, 2], blur: 6, spread: 0, color: Color32::from_black_alpha(96) };

/// Size of the smallest texts, points.
pub const SMALL: f32 = 11.0;
/// Room beside what is scrolled for its bar, points.
const SCROLL_BAR: f32 = 9.0;

/// Where a context has the preferences that were applied to it.
const KEY: &str = "preferences";

fn of(context: &Context) -> Option<Preferences> {
    context.data(|data| data.get_temp(Id::unique(KEY)))
}

/// How numbers are written in a context.
pub fn decimal(context: &Context) -> DecimalSeparator {
    of(context).unwrap_or_default().decimal
}

/// An axis of a small plot.
pub fn small_axis(ui: &Ui, axis: AxisHints<'static>) -> AxisHints<'static> {
    axis.tick_label_font(FontId::proportional(SMALL))
        .tick_label_color(ui.visuals().text_color())
        .label_spacing(Rangef::new(6.0, 8.0))
}

/// The axis of the values of a small plot, in the user's decimals.
pub fn value_axis(ui: &Ui) -> AxisHints<'static> {
    let decimal = decimal(ui.ctx());
    let axis = small_axis(ui, AxisHints::new_y()).min_thickness(28.0);
    axis.formatter(move |mark, _| {
        // Multiples of a step have its decimals.
        let decimals = (-trig::log10(mark.step_size)).ceil().clamp(0.0, 3.0) as usize;
        decimal.fixed(mark.value + 0.0, decimals)
    })
}

/// A field for a number, which takes a decimal point and a decimal comma.
pub fn number_field<N: egui::emath::Numeric>(number: &mut N) -> egui::DragValue<'_> {
    egui::DragValue::new(number).custom_parser(typed)
}

/// Background of the panels in a context. The painter clears to it; the panels do not paint it.
pub fn ground(context: &Context) -> Color32 {
    ground_of(of(context).unwrap_or_default().theme)
}

fn ground_of(theme: Theme) -> Color32 {
    match theme {
        Theme::Dark => Color32::from_gray(27),
        Theme::Light => Color32::from_gray(248),
        Theme::HighContrast => Color32::BLACK,
    }
}

/// The background behind labels over the city, in every theme: dark and nearly opaque.
pub const ON_PICTURE: Color32 = Color32::from_black_alpha(215);
/// What [`ON_PICTURE`] leaves of a white picture.
const BRIGHTEST_LABEL: Color32 = Color32::from_gray(40);
/// Least contrast of texts (WCAG 2.2, success criterion 1.4.3).
const TEXT_CONTRAST: f64 = 4.5;
/// Lines of charts have the contrast of texts, for their names in the legend have their colours.
const LINE_CONTRAST: f64 = TEXT_CONTRAST;
/// Least contrast of texts in the theme of high contrast (success criterion 1.4.6, level AAA).
const HIGH_CONTRAST: f64 = 7.0;

fn dark() -> Visuals {
    let mut visuals = Visuals::dark();
    let ground = ground_of(Theme::Dark);
    (visuals.panel_fill, visuals.window_fill) = (ground, ground);
    visuals.weak_text_color = Some(Color32::from_gray(160));
    visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(205);
    visuals.widgets.inactive.fg_stroke.color = Color32::from_gray(215);
    visuals.selection.bg_fill = Color32::from_rgb(16, 48, 74);
    visuals.selection.stroke = Stroke::new(1.0, Color32::from_rgb(205, 230, 255));
    visuals.faint_bg_color = Color32::from_gray(33);
    visuals
}

fn light() -> Visuals {
    let mut visuals = Visuals::light();
    let ground = ground_of(Theme::Light);
    (visuals.panel_fill, visuals.window_fill) = (ground, ground);
    visuals.weak_text_color = Some(Color32::from_gray(95));
    visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(50);
    visuals.widgets.inactive.fg_stroke.color = Color32::from_gray(40);
    visuals.selection.bg_fill = Color32::from_rgb(200, 226, 250);
    visuals.selection.stroke = Stroke::new(1.0, Color32::from_rgb(0, 50, 100));
    visuals.faint_bg_color = Color32::from_gray(238);
    visuals.warn_fg_color = Color32::from_rgb(150, 75, 0);
    visuals.error_fg_color = Color32::from_rgb(180, 0, 25);
    visuals.hyperlink_color = Color32::from_rgb(0, 85, 155);
    visuals
}

/// White on black with visible edges of all widgets.
fn high_contrast() -> Visuals {
    let mut visuals = Visuals::dark();
    let ground = ground_of(Theme::HighContrast);
    (visuals.panel_fill, visuals.window_fill) = (ground, ground);
    (visuals.extreme_bg_color, visuals.faint_bg_color) = (ground, Color32::from_gray(18));
    visuals.text_edit_bg_color = Some(ground);
    visuals.weak_text_color = Some(Color32::from_gray(215));
    visuals.window_stroke = Stroke::new(2.0, Color32::from_gray(200));
    visuals.selection.bg_fill = SELECTED_IN_HIGH_CONTRAST;
    visuals.selection.stroke = Stroke::new(1.5, Color32::from_rgb(255, 240, 120));
    visuals.warn_fg_color = Color32::from_rgb(255, 205, 60);
    visuals.error_fg_color = Color32::from_rgb(255, 165, 165);
    visuals.hyperlink_color = Color32::from_rgb(150, 205, 255);
    let widgets = &mut visuals.widgets;
    for (widget, fill, edge) in [
        (&mut widgets.noninteractive, 0, 150),
        (&mut widgets.inactive, 22, 190),
        (&mut widgets.hovered, 45, 255),
        (&mut widgets.active, 65, 255),
        (&mut widgets.open, 45, 255),
    ] {
        (widget.bg_fill, widget.weak_bg_fill) = (Color32::from_gray(fill), Color32::from_gray(fill));
        widget.bg_stroke = Stroke::new(1.0, Color32::from_gray(edge));
        widget.fg_stroke = Stroke::new(1.5, Color32::WHITE);
    }
    visuals
}

/// The lightest ground of texts in the theme of high contrast.
const SELECTED_IN_HIGH_CONTRAST: Color32 = Color32::from_rgb(0, 34, 78);

/// The colour of a status on a panel.
pub fn on_panel(context: &Context, status: Status) -> Color32 {
    let preferences = of(context).unwrap_or_default();
    status_colour(preferences.theme, preferences.colours, status)
}

/// The colour of a status on a picture of the city, which is as dark in every theme.
pub fn on_picture(context: &Context, status: Status) -> Color32 {
    let Preferences { theme, colours, .. } = of(context).unwrap_or_default();
    let theme = if theme == Theme::HighContrast { theme } else { Theme::Dark };
    status_colour(theme, colours, status)
}

/// A colour of the city, as of a body, for a text on the dark ground of labels over a picture.
pub fn text_on_picture(colour: Color32) -> Color32 {
    legible(colour, BRIGHTEST_LABEL, TEXT_CONTRAST)
}

/// A colour of a body for lines on a panel.
pub fn line_on_ground(context: &Context, colour: Color32) -> Color32 {
    legible_line(colour, ground(context))
}

/// A colour of a body for lines on any ground.
pub fn legible_line(colour: Color32, ground: Color32) -> Color32 {
    legible(colour, ground, LINE_CONTRAST)
}

/// A bright colour of the city, as of a control zone or of a body, for texts and lines on a panel.
pub fn on_ground(context: &Context, colour: Color32) -> Color32 {
    readable(of(context).unwrap_or_default().theme, colour)
}

fn readable(theme: Theme, colour: Color32) -> Color32 {
    /// Share of a bright colour's light that is left on a light ground.
    const DARKER: f32 = 0.43;
    match theme {
        Theme::Dark => colour,
        Theme::HighContrast => legible(colour, SELECTED_IN_HIGH_CONTRAST, HIGH_CONTRAST),
        Theme::Light => {
            let [r, g, b] = [colour.r(), colour.g(), colour.b()].map(|c| (f32::from(c) * DARKER) as u8);
            Color32::from_rgb(r, g, b)
        }
    }
}

fn status_colour(theme: Theme, colours: StatusColours, status: Status) -> Color32 {
    if theme == Theme::HighContrast {
        return readable(theme, status_colour(Theme::Dark, colours, status));
    }
    let [r, g, b] = match (theme, colours) {
        (Theme::Dark | Theme::HighContrast, StatusColours::Usual) => match status {
            Status::Waiting => [165, 165, 165],
            Status::Driving => [120, 200, 120],
            Status::Yielding => [235, 195, 80],
            Status::Stopped => [235, 140, 80],
            Status::Manual => [110, 175, 255],
            Status::LinkLost => [230, 120, 230],
            Status::Collided => [255, 105, 105],
            Status::Finished => [150, 170, 190],
            Status::Physical => [90, 210, 210],
            Status::Unseen => [200, 135, 135],
        },
        (Theme::Light, StatusColours::Usual) => match status {
            Status::Waiting => [85, 85, 85],
            Status::Driving => [20, 100, 30],
            Status::Yielding => [115, 80, 0],
            Status::Stopped => [150, 60, 0],
            Status::Manual => [0, 75, 170],
            Status::LinkLost => [140, 20, 140],
            Status::Collided => [180, 0, 25],
            Status::Finished => [70, 85, 105],
            Status::Physical => [0, 95, 100],
            Status::Unseen => [120, 50, 50],
        },
        (Theme::Dark | Theme::HighContrast, StatusColours::ColourBlind) => match status {
            Status::Waiting => [160, 160, 160],
            Status::Driving => [86, 180, 233],
            Status::Yielding => [250, 240, 150],
            Status::Stopped => [255, 175, 0],
            Status::Manual => [235, 235, 255],
            Status::LinkLost => [225, 135, 180],
            Status::Collided => [255, 115, 105],
            Status::Finished => [135, 165, 165],
            Status::Physical => [80, 200, 160],
            Status::Unseen => [200, 140, 90],
        },
        (Theme::Light, StatusColours::ColourBlind) => match status {
            Status::Waiting => [85, 85, 85],
            Status::Driving => [0, 85, 170],
            Status::Yielding => [130, 85, 0],
            Status::Stopped => [100, 25, 0],
            Status::Manual => [85, 0, 200],
            Status::LinkLost => [60, 45, 105],
            Status::Collided => [185, 25, 70],
            Status::Finished => [15, 15, 15],
            Status::Physical => [0, 75, 0],
            Status::Unseen => [150, 55, 110],
        },
    };
    Color32::from_rgb(r, g, b)
}

#[cfg(test)]
mod tests;
