//! What the pixels of a picture say.

use serde::{Deserialize, Serialize};

/// One way to look at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PictureKind {
    /// Colour as an eye sees it.
    Rgb,
    /// Metres from the camera along its optical axis.
    Depth,
    /// What a pixel shows: a number of the city's classes.
    Semantic,
    /// Which vehicle a pixel shows: its number, 0 for none.
    Instance,
}

impl PictureKind {
    pub const ALL: [Self; 4] = [Self::Rgb, Self::Depth, Self::Semantic, Self::Instance];

    /// As scenarios, arguments and tables write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Depth => "depth",
            Self::Semantic => "semantic",
            Self::Instance => "instance",
        }
    }
}

/// A set of kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Kinds(u8);

impl Kinds {
    pub const NONE: Self = Self(0);
    pub const RGB: Self = Self(1 << PictureKind::Rgb as u8);

    #[must_use]
    pub fn with(self, kind: PictureKind) -> Self {
        Self(self.0 | 1 << kind as u8)
    }

    pub fn contains(self, kind: PictureKind) -> bool {
        self.0 & 1 << kind as u8 != 0
    }

    /// Those that are there, in the order of [`PictureKind::ALL`].
    pub fn iter(self) -> impl Iterator<Item = PictureKind> {
        PictureKind::ALL.into_iter().filter(move |kind| self.contains(*kind))
    }

    pub fn len(self) -> usize {
        self.iter().count()
    }

    pub fn is_empty(self) -> bool {
        self == Self::NONE
    }
}

impl FromIterator<PictureKind> for Kinds {
    fn from_iter<I: IntoIterator<Item = PictureKind>>(kinds: I) -> Self {
        kinds.into_iter().fold(Self::NONE, Self::with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_has_each_kind_once_and_in_order() {
        let kinds: Kinds =
            [PictureKind::Instance, PictureKind::Rgb, PictureKind::Instance].into_iter().collect();
        assert_eq!(kinds.iter().collect::<Vec<_>>(), [PictureKind::Rgb, PictureKind::Instance]);
        assert!(!kinds.contains(PictureKind::Depth) && kinds.len() == 2);
        assert!(Kinds::NONE.is_empty() && !Kinds::RGB.is_empty());
    }
}
