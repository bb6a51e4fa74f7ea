//! Overlays in the city, as geometry that the renderer hides behind what is in front of it: roads, routes, paths, and what
//! belongs to vehicles. Texts are painted by [`super::layers`].

mod roads;
mod vehicles;

pub(super) use roads::{
    CROSSING, EDITED, LANE, MANY_ROUTES, MERGE, ROUTE, ROUTES_APART, body_colour, has_many_routes, whole_lane,
};
pub(super) use vehicles::{CLOSE_GAP, CLOSE_S, DRIVEN, FRUSTUM, GAP, MEASURED, PLANNED, bumper_gap};

use super::layers::Canvas;
use super::{UiState, ViewModel};
use city3d_geometry::trig;
use city3d_render::{Overlay, OverlayPaint};
use egui::Color32;
use glam::{DVec2, DVec3};

/// Height of overlays above the road.
pub(super) const ABOVE_ROAD_M: f64 = 0.12;
/// Share of the opacity of the outline of the selected vehicle behind walls.
const OUTLINE_BEHIND: f32 = 0.35;

/// The overlay of a frame: what the layers show.
pub fn build(state: &UiState, shown: &ViewModel<'_>, canvas: &Canvas<'_>) -> Overlay {
    // Widths of lines are points; the picture may be coarser than the screen.
    let pixels_per_point = canvas.view().extent[0] as f32 / canvas.rect().width().max(1.0);
    let mut overlay = Overlay::new(pixels_per_point);
    roads::add(&mut overlay, state, shown);
    super::plans::add(&mut overlay, state, shown);
    vehicles::add(&mut overlay, state, shown, canvas);
    state.measure.add(&mut overlay);
    overlay
}

/// A paint that is hidden by what is in front; `opacity` multiplies that of the colour.
pub(super) fn paint(colour: Color32, opacity: f32) -> OverlayPaint {
    let [r, g, b, a] = colour.to_srgba_unmultiplied();
    OverlayPaint::hidden([r, g, b, (f32::from(a) * opacity).round() as u8])
}

/// A point above the road.
pub(super) fn above(point: DVec2) -> DVec3 {
    point.extend(ABOVE_ROAD_M)
}

/// A disc on the road.
pub(super) fn disc(overlay: &mut Overlay, middle: DVec2, radius_m: f64, paint: OverlayPaint) {
    const CORNERS: u8 = 8;
    let corner = |k: u8| {
        let (sin, cos) = trig::sin_cos(std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS));
        above(middle + DVec2::new(cos, sin) * radius_m)
    };
    let rim: Vec<DVec3> = (0..CORNERS).map(corner).collect();
    for k in 0..rim.len() {
        overlay.triangle([above(middle), rim[k], rim[(k + 1) % rim.len()]], paint);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::colour_difference;
    use crate::ui::colouring::scale;
    use crate::ui::theme::vision::least_difference;

    const COLOURS: [Color32; 11] =
        [LANE, CROSSING, MERGE, ROUTE, MANY_ROUTES, DRIVEN, PLANNED, GAP, CLOSE_GAP, MEASURED, FRUSTUM];
    /// Least difference (CIE 1976) of colours that one tells apart without comparing them.
    const LEAST: f64 = 30.0;

    #[test]
    fn colours_that_are_shown_together_are_far_apart() {
        for (place, one) in COLOURS.iter().enumerate() {
            for other in COLOURS[place + 1..].iter().chain([&EDITED]) {
                let apart = colour_difference(*one, *other);
                assert!(apart > LEAST, "{one:?} and {other:?}: {apart:.1}");
            }
            // Slowest and fastest vehicles.
            for end in [0.0, 1.0] {
                let apart = colour_difference(*one, scale(end));
                assert!(apart > LEAST, "{one:?} and {end} of the scale: {apart:.1}");
            }
        }
        // Of one and the same vehicle, whatever its speed.
        for step in 0..=20 {
            let apart = colour_difference(MEASURED, scale(f64::from(step) / 20.0));
            assert!(apart > LEAST, "a measured pose at {step} of 20: {apart:.1}");
        }
        // What was taken for one another.
        for (one, other) in [(CROSSING, CLOSE_GAP), (MERGE, FRUSTUM)] {
            let apart = colour_difference(one, other);
            assert!(apart > 45.0, "{one:?} and {other:?}: {apart:.1}");
        }
    }

    #[test]
    fn everybody_tells_the_colours_of_the_legend_apart() {
        let least = least_difference(&COLOURS);
        assert!(least > 25.0, "{least:.1}");
        let reds = [[255, 90, 80], [255, 110, 80]].map(|[r, g, b]| Color32::from_rgb(r, g, b));
        assert!(least_difference(&reds) < 15.0, "the measure sees what is alike");
    }
}
