//! Where a panel opens over the city: where it hides the least.

use egui::{Align2, Pos2, Rect, Vec2};

/// Puts a window to a place in this frame. One that is dragged by its title alone keeps the place that it has: egui 0.37 takes it
/// for a drag of what the window holds.
pub fn moved_to(window: egui::Window<'_>, place: Pos2) -> egui::Window<'_> {
    window.current_pos(place).drag_area(egui::WindowDrag::Anywhere)
}

/// Between a panel and the edges of the city, points.
const MARGIN: f32 = 12.0;
/// A hidden point of the watched vehicle counts as many of another panel.
const VEHICLE_WEIGHT: f32 = 100.0;
/// A point of the other panels of the window that is hidden counts as so much of one over the city.
const BESIDE_WEIGHT: f32 = 0.02;
/// A hidden point of what has to stay in sight, the rows of the table and the previews, counts as many.
const KEPT_WEIGHT: f32 = 8.0;
/// Shares of its usual size in which a panel opens where it would hide what has to stay in sight otherwise.
const SMALLER: [f32; 3] = [1.0, 0.85, 0.7];

/// What a panel that opens should not hide.
#[derive(Clone)]
pub struct FloatingPlaces {
    /// The large view.
    pub city: Rect,
    /// The window between its bars.
    pub room: Rect,
    /// The vehicle that the user looks at.
    pub vehicle: Option<Rect>,
    /// What has to stay in sight beside the city: the rows of the table and the previews.
    pub kept: Vec<Rect>,
}

impl FloatingPlaces {
    /// Where a window of a size hides the least of the vehicle, of other windows, and of what is beside the city; where it was
    /// before, if nothing is better.
    pub fn free(&self, (before, size): (Option<Rect>, Vec2), taken: &[Rect]) -> Pos2 {
        let size = before.map_or(size, |before| before.size());
        let corners = [Align2::LEFT_TOP, Align2::RIGHT_TOP, Align2::LEFT_BOTTOM, Align2::RIGHT_BOTTOM];
        let inside = self.city.shrink(MARGIN);
        let at_corners = |of: Rect| corners.map(move |corner| corner.align_size_within_rect(size, of));
        let beside = taken.iter().chain(&self.vehicle).flat_map(|other| {
            let [left, right] = [other.left() - MARGIN - size.x, other.right() + MARGIN];
            [left, right].map(|x| Rect::from_min_size(Pos2::new(x, inside.top()), size))
        });
        let places = before
            .into_iter()
            .chain(at_corners(inside))
            // From below: tables are empty there.
            .chain(at_corners(self.room).into_iter().rev())
            .chain(beside);
        let places = places.map(|place| self.within(place));
        let best = places.min_by(|a, b| self.hidden(*a, taken).total_cmp(&self.hidden(*b, taken)));
        best.map_or(self.city.min, |best| best.min)
    }

    /// The usual size of a panel, or a smaller one where that alone hides neither the vehicle nor what has to stay in sight.
    pub fn fitting(&self, size: Vec2, taken: &[Rect]) -> Vec2 {
        let hides = |size: &Vec2| {
            let place = Rect::from_min_size(self.free((None, *size), taken), *size);
            let important = self.kept.iter().chain(&self.vehicle);
            important.map(|other| overlap(place, other)).sum::<f32>() > 0.0
        };
        SMALLER.map(|share| size * share).into_iter().find(|size| !hides(size)).unwrap_or(size)
    }

    /// The rectangle moved into the window.
    fn within(&self, rect: Rect) -> Rect {
        let most = (self.room.max - rect.size()).max(self.room.min);
        Rect::from_min_size(rect.min.clamp(self.room.min, most), rect.size())
    }

    /// How much a window at a place hides, weighted points.
    fn hidden(&self, place: Rect, taken: &[Rect]) -> f32 {
        let over = |others: &[Rect]| others.iter().map(|other| overlap(place, other)).sum::<f32>();
        let beside = place.area() - overlap(place, &self.city);
        over(taken)
            + VEHICLE_WEIGHT * over(self.vehicle.as_slice())
            + KEPT_WEIGHT * over(&self.kept)
            + BESIDE_WEIGHT * beside
    }
}

/// Area that two rectangles have in common.
fn overlap(a: Rect, b: &Rect) -> f32 {
    let common = a.intersect(*b).size().max(Vec2::ZERO);
    common.x * common.y
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::vec2;

    #[test]
    fn a_panel_opens_where_it_hides_neither_the_vehicle_nor_another_panel() {
        let city = Rect::from_min_max(Pos2::new(360.0, 40.0), Pos2::new(1000.0, 640.0));
        let room = Rect::from_min_max(Pos2::new(12.0, 48.0), Pos2::new(1268.0, 672.0));
        let vehicle = Rect::from_center_size(city.center(), vec2(60.0, 40.0));
        let places = FloatingPlaces { city, room, vehicle: Some(vehicle), kept: Vec::new() };
        let mut taken: Vec<Rect> = Vec::new();
        for size in [vec2(300.0, 200.0), vec2(280.0, 260.0), vec2(480.0, 250.0)] {
            let place = Rect::from_min_size(places.free((None, size), &taken), size);
            assert!(room.contains_rect(place) && !place.intersects(vehicle), "{place:?}");
            assert!(taken.iter().all(|other| !other.intersects(place)), "{place:?} over {taken:?}");
            taken.push(place);
        }
        // It comes back to where the user has put it, unless something else is there now.
        let before = Rect::from_min_size(Pos2::new(400.0, 400.0), vec2(150.0, 120.0));
        assert_eq!(places.free((Some(before), before.size()), &[]), before.min);
        let place = places.free((Some(before), before.size()), &[before]);
        assert!(!Rect::from_min_size(place, before.size()).intersects(before));
    }

    #[test]
    fn a_panel_leaves_the_table_and_the_previews_in_sight_and_is_smaller_where_it_has_to_be() {
        let city = Rect::from_min_max(Pos2::new(360.0, 40.0), Pos2::new(985.0, 640.0));
        let room = Rect::from_min_max(Pos2::new(12.0, 48.0), Pos2::new(1268.0, 672.0));
        let vehicle = Rect::from_center_size(city.center(), vec2(60.0, 40.0));
        let columns = |rows: f32| {
            let table = Rect::from_min_size(Pos2::new(12.0, 48.0), vec2(340.0, rows));
            vec![table, Rect::from_min_max(Pos2::new(990.0, 48.0), Pos2::new(1268.0, 640.0))]
        };
        for rows in [180.0, 590.0] {
            let places = FloatingPlaces { city, room, vehicle: Some(vehicle), kept: columns(rows) };
            let size = places.fitting(vec2(480.0, 340.0), &[]);
            let place = Rect::from_min_size(places.free((None, size), &[]), size);
            assert!(places.kept.iter().all(|kept| overlap(place, kept) == 0.0), "{rows}: {place:?}");
            assert!(!place.intersects(vehicle) && (size.x < 480.0) == (rows > 500.0), "{rows}: {place:?}");
        }
    }
}
