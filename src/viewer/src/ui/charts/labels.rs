//! Names in a plot that do not overlap: each takes the first of its places that is free, or is left out, for a line tells its
//! name under the mouse too.

use super::super::theme;
use egui::{Align2, Color32, FontId, Pos2, Rect, Ui, Vec2, pos2};
use egui_plot::PlotPoint;

/// Between names one below the other, points.
const APART: f32 = 2.0;
/// Names at one point have an edge in common, points.
const TOUCHES: f32 = 1.0;
/// A name that hides more pieces of lines is left out.
const MOST_CROSSED: usize = 4;
/// How far down from its place a name may be, in lines.
const MOST_LINES: u8 = 4;

/// The room of a plot for names: its axes in points, and what is taken.
pub(super) struct LabelRoom {
    x: (f64, f64),
    y: (f64, f64),
    size: Vec2,
    taken: Vec<Rect>,
    /// Pieces of the lines of the plot: names do not lie on them where they find another place.
    lines: Vec<[Pos2; 2]>,
}

impl LabelRoom {
    /// The free room of a plot with these ends of its axes and of about that size.
    pub(super) fn new(x: (f64, f64), y: (f64, f64), size: Vec2) -> Self {
        Self { x, y, size, taken: Vec::new(), lines: Vec::new() }
    }

    /// Adds a line that is drawn.
    pub(super) fn add_line(&mut self, points: &[[f64; 2]]) {
        let places: Vec<Pos2> = points.iter().map(|&[x, y]| self.point(PlotPoint::new(x, y))).collect();
        self.lines.extend(places.windows(2).map(|pair| [pair[0], pair[1]]));
    }

    /// Where a name finds room at a point of the plot, by one of its anchors; `None` where none is free. Of those that are free
    /// it takes the first that is inside and lies on no line.
    pub(super) fn place(
        &mut self,
        ui: &Ui,
        (name, at): (&str, PlotPoint),
        anchors: &[Align2],
    ) -> Option<Align2> {
        let (point, size) = (self.point(at), size_of(ui, name));
        let rect = |anchor: Align2| anchor.anchor_size(point, size);
        let free = anchors.iter().copied().filter(|anchor| self.is_free(rect(*anchor)));
        let ranked = free.map(|anchor| (self.trouble(rect(anchor)), anchor));
        let ((_, crossed), anchor) = ranked.min_by_key(|(trouble, _)| *trouble)?;
        if crossed > MOST_CROSSED {
            return None;
        }
        self.taken.push(rect(anchor));
        Some(anchor)
    }

    /// Whether a name is cut by the edge of the plot, and how often lines cross it.
    fn trouble(&self, rect: Rect) -> (bool, usize) {
        let plot = Rect::from_min_size(Pos2::ZERO, self.size).expand(TOUCHES);
        let inner = rect.shrink(TOUCHES);
        (!plot.contains_rect(rect), self.lines.iter().filter(|line| crosses(inner, **line)).count())
    }

    /// The same, at the place or some lines below it: by how much of the vertical axis. `None` where none is free.
    pub(super) fn place_below(
        &mut self,
        ui: &Ui,
        (name, at): (&str, PlotPoint),
        anchor: Align2,
    ) -> Option<f64> {
        let (point, size) = (self.point(at), size_of(ui, name));
        let step = size.y + APART;
        let lower = |lines: u8| anchor.anchor_size(point + Vec2::new(0.0, f32::from(lines) * step), size);
        let lines = (0..MOST_LINES).find(|lines| self.is_free(lower(*lines)))?;
        self.taken.push(lower(lines));
        Some(f64::from(f32::from(lines) * step / self.size.y.max(1.0)) * (self.y.1 - self.y.0))
    }

    fn is_free(&self, rect: Rect) -> bool {
        self.taken.iter().all(|taken| !taken.intersects(rect.shrink(TOUCHES)))
    }

    fn point(&self, at: PlotPoint) -> Pos2 {
        let share = |value: f64, (from, to): (f64, f64)| ((value - from) / (to - from).max(1e-9)) as f32;
        pos2(share(at.x, self.x) * self.size.x, (1.0 - share(at.y, self.y)) * self.size.y)
    }
}

/// Whether a straight piece of a line goes through a rectangle: what is left of it between its sides, one after the other.
fn crosses(rect: Rect, [from, to]: [Pos2; 2]) -> bool {
    let (mut first, mut last) = (0.0_f32, 1.0_f32);
    for (at, way, low, high) in [
        (from.x, to.x - from.x, rect.left(), rect.right()),
        (from.y, to.y - from.y, rect.top(), rect.bottom()),
    ] {
        if way == 0.0 {
            if !(low..=high).contains(&at) {
                return false;
            }
            continue;
        }
        let shares = [(low - at) / way, (high - at) / way];
        first = first.max(shares[0].min(shares[1]));
        last = last.min(shares[0].max(shares[1]));
    }
    first <= last
}

/// Size of a name, points.
pub(super) fn size_of(ui: &Ui, name: &str) -> Vec2 {
    ui.painter().layout_no_wrap(name.to_owned(), FontId::proportional(theme::SMALL), Color32::WHITE).size()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_lies_on_no_line_where_there_is_another_place() {
        let context = egui::Context::default();
        let mut output = context.run_ui(egui::RawInput::default(), |ui| {
            let (all, at) = ([Align2::RIGHT_TOP, Align2::LEFT_TOP], PlotPoint::new(5.0, 5.0));
            let place = |points: &[[f64; 2]], at: PlotPoint| {
                let mut room = LabelRoom::new((0.0, 10.0), (0.0, 10.0), Vec2::new(400.0, 200.0));
                room.add_line(points);
                room.place(ui, ("7 path1_a", at), &all)
            };
            assert_eq!(place(&[[0.0, 9.0], [5.0, 5.0]], at), Some(Align2::RIGHT_TOP), "it comes from above");
            assert_eq!(place(&[[0.0, 3.0], [5.0, 5.0]], at), Some(Align2::LEFT_TOP), "it comes from below");
            let edge = PlotPoint::new(9.9, 5.0);
            assert_eq!(
                place(&[[0.0, 3.0], [9.9, 5.0]], edge),
                Some(Align2::RIGHT_TOP),
                "not cut by the edge"
            );
        });
        output.textures_delta.clear();
    }

    #[test]
    fn names_at_one_place_stand_around_it_and_the_fifth_is_left_out() {
        let context = egui::Context::default();
        let mut output = context.run_ui(egui::RawInput::default(), |ui| {
            let mut room = LabelRoom::new((0.0, 10.0), (0.0, 10.0), Vec2::new(400.0, 200.0));
            let all = [Align2::LEFT_TOP, Align2::LEFT_BOTTOM, Align2::RIGHT_TOP, Align2::RIGHT_BOTTOM];
            let mut place = |x: f64| room.place(ui, ("7 path1_a", PlotPoint::new(x, 5.0)), &all);
            let placed: Vec<Option<Align2>> = (0..5).map(|_| place(5.0)).collect();
            assert!(placed[..4].iter().all(Option::is_some), "{placed:?}");
            assert!((1..4).all(|k| !placed[..k].contains(&placed[k])), "{placed:?}");
            assert_eq!((placed[4], place(9.0).is_some()), (None, true));
            let mut below =
                || room.place_below(ui, ("yield line", PlotPoint::new(1.0, 10.0)), Align2::LEFT_TOP);
            let lower: Vec<Option<f64>> = (0..5).map(|_| below()).collect();
            assert!(lower[..4].windows(2).all(|pair| pair[0] < pair[1]) && lower[4].is_none(), "{lower:?}");
        });
        output.textures_delta.clear();
    }
}
