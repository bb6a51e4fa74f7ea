//! The units of figures of paths: metres of the laboratory or of the city, speeds in m/s or km/h, and their names on axes and
//! in tables.

use super::FigureScale;
use super::views::FigureSet;
use city3d_geometry::KMH_PER_MPS;

impl FigureSet<'_> {
    /// The same in these metres, which its axes and columns name.
    #[must_use]
    pub fn in_metres_of(mut self, scale: FigureScale) -> Self {
        self.scale = Some(scale);
        self
    }

    /// A length of the city in the metres of the figure.
    pub(super) fn metres(&self, city: f64) -> f64 {
        match self.scale {
            None | Some(FigureScale::Laboratory) => self.runs[0].lab(city),
            Some(FigureScale::City | FigureScale::CityMetresPerSecond) => city,
        }
    }

    /// A speed of the city in the unit of the figure.
    pub(super) fn speed_of(&self, city_mps: f64) -> f64 {
        match self.scale {
            Some(FigureScale::City) => city_mps * KMH_PER_MPS,
            None | Some(FigureScale::CityMetresPerSecond | FigureScale::Laboratory) => self.metres(city_mps),
        }
    }

    /// The unit of speeds on an axis.
    pub(super) fn speed_unit(&self) -> String {
        match self.scale {
            Some(FigureScale::City) => "[km/h]".to_owned(),
            _ => self.unit("m/s"),
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
            Some(FigureScale::City) => ["position_city_m", "speed_city_kmh"],
            Some(FigureScale::CityMetresPerSecond) => ["position_city_m", "speed_city_mps"],
            Some(FigureScale::Laboratory) => ["position_lab_m", "speed_lab_mps"],
        }
    }

    /// Columns of the rows of a segment.
    pub(super) fn segment_columns(&self) -> [&'static str; 7] {
        let [position, speed] = self.columns();
        ["run", "path", "vehicle", "name", "time_s", position, speed]
    }
}
