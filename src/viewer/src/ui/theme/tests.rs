//! Contrast and colour blindness, computed from the colours of the themes.

use super::contrast::vision::{DEUTERANOPE, difference_to};
use super::contrast::{contrast, difference, legible};
use super::{StatusColours, Theme, dark, ground_of, high_contrast, light, readable, status_colour};
use city3d_protocol::snapshot::Status;
use egui::{Color32, Visuals};

const THEMES: [(Theme, fn() -> Visuals); 3] =
    [(Theme::Dark, dark), (Theme::Light, light), (Theme::HighContrast, high_contrast)];
const COLOURS: [StatusColours; 2] = [StatusColours::Usual, StatusColours::ColourBlind];
/// Level AA for text of usual size (WCAG 2.2, success criterion 1.4.3).
const LEAST_CONTRAST: f64 = 4.5;

/// The theme of high contrast reaches level AAA (success criterion 1.4.6).
fn least_contrast(theme: Theme) -> f64 {
    if theme == Theme::HighContrast { 7.0 } else { LEAST_CONTRAST }
}

#[test]
fn the_contrast_of_known_pairs_is_that_of_the_definition() {
    assert!((contrast(Color32::BLACK, Color32::WHITE) - 21.0).abs() < 1e-9);
    // #767676 on white is the usual example of the least grey that passes.
    assert!((contrast(Color32::from_gray(0x76), Color32::WHITE) - 4.54).abs() < 0.01);
}

/// Backgrounds of texts in tables and panels.
fn backgrounds(theme: Theme, visuals: &Visuals) -> [(&'static str, Color32); 3] {
    [
        ("ground", ground_of(theme)),
        ("striped row", visuals.faint_bg_color),
        ("selected row", visuals.selection.bg_fill),
    ]
}

#[test]
fn every_text_can_be_read_on_its_background() {
    for (theme, visuals) in THEMES {
        let visuals = visuals();
        let mut pairs: Vec<(String, Color32, Color32)> = Vec::new();
        for (name, background) in backgrounds(theme, &visuals) {
            for (text, colour) in [
                ("text", visuals.text_color()),
                ("weak text", visuals.weak_text_color()),
                ("strong text", visuals.strong_text_color()),
                ("warning", visuals.warn_fg_color),
                ("link", visuals.hyperlink_color),
            ] {
                pairs.push((format!("{text} on {name}"), colour, background));
            }
            for (colours, status) in COLOURS.iter().flat_map(|c| Status::ALL.map(|status| (c, status))) {
                let colour = status_colour(theme, *colours, status);
                pairs.push((format!("{colours:?} {status:?} on {name}"), colour, background));
            }
        }
        pairs.push(("hint in a field".to_owned(), visuals.weak_text_color(), visuals.text_edit_bg_color()));
        pairs.push(("text in a field".to_owned(), visuals.text_color(), visuals.text_edit_bg_color()));
        let selection = visuals.selection;
        pairs.push(("selected button".to_owned(), selection.stroke.color, selection.bg_fill));
        for (name, widget) in [
            ("button", visuals.widgets.inactive),
            ("hovered button", visuals.widgets.hovered),
            ("pressed button", visuals.widgets.active),
            ("open menu", visuals.widgets.open),
        ] {
            pairs.push((name.to_owned(), widget.text_color(), widget.weak_bg_fill));
        }
        for (name, text, background) in pairs {
            let ratio = contrast(text, background);
            assert!(ratio >= least_contrast(theme), "{theme:?}, {name}: {ratio:.2}");
        }
    }
}

#[test]
fn names_of_control_zones_can_be_read_on_panels() {
    for (theme, _) in THEMES {
        for zone in 0..4 {
            let colour = readable(theme, crate::ui::control_zones::zone_colour(zone));
            let ratio = contrast(colour, ground_of(theme));
            assert!(ratio >= least_contrast(theme), "{theme:?}, zone {zone}: {ratio:.2}");
        }
    }
}

#[test]
fn labels_over_the_city_can_be_read_whatever_is_below() {
    // The worst is a white wall below the label.
    let below = f64::from(255 - super::ON_PICTURE.a()).round() as u8;
    let background = Color32::from_gray(below);
    for status in Status::ALL {
        for colours in COLOURS {
            let ratio = contrast(status_colour(Theme::Dark, colours, status), background);
            assert!(ratio >= LEAST_CONTRAST, "{colours:?} {status:?}: {ratio:.2}");
        }
    }
}

#[test]
fn a_deuteranope_tells_apart_what_matters() {
    let urgent = [Status::Driving, Status::Yielding, Status::Stopped, Status::Manual, Status::Collided];
    for (theme, _) in THEMES {
        let least = |colours: StatusColours| {
            let colours = urgent.map(|status| status_colour(theme, colours, status));
            let mut least = f64::INFINITY;
            for (k, a) in colours.iter().enumerate() {
                for b in &colours[k + 1..] {
                    least = least.min(difference_to(DEUTERANOPE, *a, *b));
                }
            }
            least
        };
        assert!(least(StatusColours::ColourBlind) > 20.0, "{theme:?}: {}", least(StatusColours::ColourBlind));
        // The usual colours are why there are others: the test sees the difference.
        assert!(least(StatusColours::Usual) < 10.0, "{theme:?}: {}", least(StatusColours::Usual));
    }
}

#[test]
fn on_light_ground_no_status_that_matters_looks_like_text() {
    let text = light().text_color();
    for colours in COLOURS {
        for status in [Status::Driving, Status::Yielding, Status::Stopped, Status::Manual, Status::Collided] {
            let apart = difference(status_colour(Theme::Light, colours, status), text);
            assert!(apart > 40.0, "{colours:?} {status:?}: {apart:.0}");
        }
    }
}

#[test]
fn a_body_of_any_colour_is_legible_over_the_city_and_in_charts() {
    for body in [[20, 20, 25], [30, 40, 150], [235, 235, 235], [240, 220, 60], [150, 20, 30]] {
        let body = Color32::from_rgb(body[0], body[1], body[2]);
        let ratio = contrast(super::text_on_picture(body), super::BRIGHTEST_LABEL);
        assert!(ratio >= LEAST_CONTRAST, "{body:?} in a label: {ratio:.2}");
        for (theme, _) in THEMES {
            let ratio = contrast(legible(body, ground_of(theme), super::LINE_CONTRAST), ground_of(theme));
            assert!(ratio >= super::LINE_CONTRAST, "{theme:?}, {body:?} in a chart: {ratio:.2}");
        }
    }
    let green = Color32::from_rgb(120, 220, 130);
    assert_eq!(super::text_on_picture(green), green, "what is legible stays");
}

#[test]
fn the_theme_of_high_contrast_shows_errors_and_the_edges_of_widgets() {
    let visuals = high_contrast();
    for (name, background) in backgrounds(Theme::HighContrast, &visuals) {
        for (text, colour) in [("error", visuals.error_fg_color), ("link", visuals.hyperlink_color)] {
            let ratio = contrast(colour, background);
            assert!(ratio >= 7.0, "{text} on {name}: {ratio:.2}");
        }
    }
    // Success criterion 1.4.11, with the margin of the theme.
    let widgets = &visuals.widgets;
    for widget in [widgets.inactive, widgets.hovered, widgets.active, widgets.open] {
        assert!(contrast(widget.bg_stroke.color, ground_of(Theme::HighContrast)) >= 4.5);
    }
    let is_edged = |of: fn() -> Visuals| of().widgets.inactive.bg_stroke.width > 0.0;
    assert!(
        is_edged(high_contrast) && !is_edged(dark),
        "the other themes tell buttons by their ground alone"
    );
}
