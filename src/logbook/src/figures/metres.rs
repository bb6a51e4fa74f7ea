//! The metres of figures of paths: of the laboratory or of the city, and their names on axes and in tables.

use super::FigureScale;
use super::views::FigureSet;

impl FigureSet<'_> {
    /// The same in these metres, which its axes and columns name.
    #[must_use]
    pub fn in_metres_of(mut self, scale: FigureScale) -> Self {
        self.scale = Some(scale);
        self
    }

    /// A length or a speed of the city in the metres of the figure.
    pub(super) fn metres(&self, city: f64) -> f64 {
        match self.scale {
            None | Some(FigureScale::Laboratory) => self.runs[0].lab(city),
            Some(FigureScale::City | FigureScale::CityMetresPerSecond) => city,
        }
    }

    /// A unit on an axis, with the name of its metres.
    pub(super) fn unit(&self, unit: &str) -> String {
        match self.scale {
            None => format!("[{unit}]"),
            Some(FigureScale::City | FigureScale::CityMetresPerSecond) => format!("[{unit}, full scale]"),
            Some(FigureScale::Laboratory) => format!("[{unit}, laboratory]"),
        }
    }

    /// Names of the columns of positions and speeds.
    pub(super) fn columns(&self) -> [&'static str; 2] {
        match self.scale {
            None => ["position_m", "speed_mps"],
            Some(FigureScale::City | FigureScale::CityMetresPerSecond) => {
                ["position_city_m", "speed_city_mps"]
            }
            Some(FigureScale::Laboratory) => ["position_lab_m", "speed_lab_mps"],
        }
    }

    /// Columns of the rows of a segment.
    pub(super) fn segment_columns(&self) -> [&'static str; 7] {
        let [position, speed] = self.columns();
        ["run", "path", "vehicle", "name", "time_s", position, speed]
    }
}
