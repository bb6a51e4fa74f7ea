//! Contrast of colours, by the relative luminance of the Web Content Accessibility Guidelines 2.2, and how far colours are
//! apart, by CIE L*a*b*.

use city3d_geometry::trig;
use egui::Color32;

/// Linear red, green and blue (IEC 61966-2-1).
pub fn linear(colour: Color32) -> [f64; 3] {
    [colour.r(), colour.g(), colour.b()].map(|channel| {
        let c = f64::from(channel) / 255.0;
        if c <= 0.040_45 { c / 12.92 } else { trig::pow((c + 0.055) / 1.055, 2.4) }
    })
}

pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Contrast ratio, 1 to 21.
pub fn contrast(one: Color32, other: Color32) -> f64 {
    let [a, b] = [one, other].map(|colour| luminance(linear(colour)) + 0.05);
    a.max(b) / a.min(b)
}

/// The colour with as much white on a dark ground, or black on a light one, as the contrast needs; its hue stays.
pub fn legible(colour: Color32, ground: Color32, least_contrast: f64) -> Color32 {
    const STEPS: u16 = 20;
    /// At this luminance, black and white have the same contrast.
    const MIDDLE: f64 = 0.179;
    let end: u16 = if luminance(linear(ground)) < MIDDLE { 255 } else { 0 };
    let mixed = |step: u16| {
        let of = |channel: u8| ((u16::from(channel) * (STEPS - step) + end * step) / STEPS) as u8;
        Color32::from_rgb(of(colour.r()), of(colour.g()), of(colour.b()))
    };
    let mut steps = (0..=STEPS).map(mixed);
    steps.find(|mixed| contrast(*mixed, ground) >= least_contrast).unwrap_or_else(|| mixed(STEPS))
}

/// CIE L*a*b* of a linear colour, white point D65.
fn lab([r, g, b]: [f64; 3]) -> [f64; 3] {
    let f = |t: f64| if t > 0.008_856 { trig::pow(t, 1.0 / 3.0) } else { 7.787 * t + 16.0 / 116.0 };
    let x = f((0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505);
    let y = f(luminance([r, g, b]));
    let z = f((0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.0890);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Colour difference (CIE 1976) of two colours.
pub fn difference(a: Color32, b: Color32) -> f64 {
    difference_of([a, b].map(linear))
}

fn difference_of(linear: [[f64; 3]; 2]) -> f64 {
    let [a, b] = linear.map(lab);
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// Colours as colour-blind people see them.
#[cfg(test)]
pub mod vision {
    use super::{difference_of, linear};
    use egui::Color32;

    /// From linear colours to what is seen (Machado, Oliveira and Fernandes 2009, severity 1).
    type Vision = [[f64; 3]; 3];
    pub const DEUTERANOPE: Vision = [
        [0.367_322, 0.860_646, -0.227_968],
        [0.280_085, 0.672_501, 0.047_413],
        [-0.011_820, 0.042_940, 0.968_881],
    ];
    pub const PROTANOPE: Vision = [
        [0.152_286, 1.052_583, -0.204_868],
        [0.114_503, 0.786_281, 0.099_216],
        [-0.003_882, -0.048_116, 1.051_998],
    ];

    /// Colour difference (CIE 1976) of two colours as somebody sees them.
    pub fn difference_to(vision: Vision, a: Color32, b: Color32) -> f64 {
        let seen = |colour: Color32| {
            let channels = linear(colour);
            vision.map(|row| row.iter().zip(channels).map(|(k, c)| k * c).sum::<f64>().clamp(0.0, 1.0))
        };
        difference_of([a, b].map(seen))
    }

    /// The least difference of two colours of a list, to whoever tells them apart least.
    pub fn least_difference(colours: &[Color32]) -> f64 {
        let pairs = colours.iter().enumerate().flat_map(|(k, a)| colours[k + 1..].iter().map(|b| (*a, *b)));
        let seen = |(a, b)| {
            let blind = [DEUTERANOPE, PROTANOPE].map(|vision| difference_to(vision, a, b));
            blind.into_iter().fold(super::difference(a, b), f64::min)
        };
        pairs.map(seen).fold(f64::INFINITY, f64::min)
    }
}
