//! Contrast and colour blindness, computed from the colours of the themes.

use super::{StatusColours, Theme, dark, ground_of, light, readable, status_colour};
use city3d_geometry::trig;
use city3d_protocol::snapshot::Status;
use egui::{Color32, Visuals};

const THEMES: [(Theme, fn() -> Visuals); 2] = [(Theme::Dark, dark), (Theme::Light, light)];
const COLOURS: [StatusColours; 2] = [StatusColours::Usual, StatusColours::ColourBlind];
/// Level AA for text of usual size (WCAG 2.2, success criterion 1.4.3).
const LEAST_CONTRAST: f64 = 4.5;

/// Linear red, green and blue (IEC 61966-2-1).
fn linear(colour: Color32) -> [f64; 3] {
    [colour.r(), colour.g(), colour.b()].map(|channel| {
        let c = f64::from(channel) / 255.0;
        if c <= 0.040_45 { c / 12.92 } else { trig::pow((c + 0.055) / 1.055, 2.4) }
    })
}

fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Contrast ratio of WCAG 2.2.
fn contrast(text: Color32, background: Color32) -> f64 {
    let [a, b] = [text, background].map(|colour| luminance(linear(colour)) + 0.05);
    a.max(b) / a.min(b)
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
            assert!(ratio >= LEAST_CONTRAST, "{theme:?}, {name}: {ratio:.2}");
        }
    }
}

#[test]
fn names_of_control_zones_can_be_read_on_panels() {
    for (theme, _) in THEMES {
        for zone in 0..4 {
            let colour = readable(theme, crate::ui::control_zones::zone_colour(zone));
            let ratio = contrast(colour, ground_of(theme));
            assert!(ratio >= LEAST_CONTRAST, "{theme:?}, zone {zone}: {ratio:.2}");
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

/// What a deuteranope sees (Machado, Oliveira and Fernandes 2009, severity 1), linear.
fn deuteranope([r, g, b]: [f64; 3]) -> [f64; 3] {
    [
        0.367_322 * r + 0.860_646 * g - 0.227_968 * b,
        0.280_085 * r + 0.672_501 * g + 0.047_413 * b,
        -0.011_820 * r + 0.042_940 * g + 0.968_881 * b,
    ]
    .map(|channel| channel.clamp(0.0, 1.0))
}

/// CIE L*a*b* of a linear colour, white point D65.
fn lab([r, g, b]: [f64; 3]) -> [f64; 3] {
    let f = |t: f64| if t > 0.008_856 { trig::pow(t, 1.0 / 3.0) } else { 7.787 * t + 16.0 / 116.0 };
    let x = f((0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505);
    let y = f(luminance([r, g, b]));
    let z = f((0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.0890);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Colour difference (CIE 1976) of two colours as a deuteranope sees them.
fn difference(a: Color32, b: Color32) -> f64 {
    let [a, b] = [a, b].map(|colour| lab(deuteranope(linear(colour))));
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
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
                    least = least.min(difference(*a, *b));
                }
            }
            least
        };
        assert!(least(StatusColours::ColourBlind) > 20.0, "{theme:?}: {}", least(StatusColours::ColourBlind));
        // The usual colours are why there are others: the test sees the difference.
        assert!(least(StatusColours::Usual) < 10.0, "{theme:?}: {}", least(StatusColours::Usual));
    }
}
