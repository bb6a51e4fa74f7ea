//! Kinds of camera pictures: colour, depth map, semantic and instance segmentation.

use serde::{Deserialize, Serialize};

/// What the pixels of a picture mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PictureKind {
    /// Colour, sRGB.
    Rgb,
    /// Depth map: metres along the optical axis.
    Depth,
    /// Semantic segmentation: class of each pixel.
    Semantic,
    /// Instance segmentation: vehicle of each pixel, 0 for none.
    Instance,
}

impl PictureKind {
    /// All kinds, in the order of [`PictureKinds::iter`].
    pub const ALL: [Self; 4] = [Self::Rgb, Self::Depth, Self::Semantic, Self::Instance];

    /// Name in scenarios, arguments and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Depth => "depth",
            Self::Semantic => "semantic",
            Self::Instance => "instance",
        }
    }
}

/// A set of picture kinds, as a bit set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PictureKinds(u8);

impl PictureKinds {
    /// The empty set.
    pub const NONE: Self = Self(0);
    /// Only colour: what a camera takes unless its scenario says otherwise.
    pub const RGB: Self = Self(1 << PictureKind::Rgb as u8);

    /// The set with one more kind.
    #[must_use]
    pub const fn with(self, kind: PictureKind) -> Self {
        Self(self.0 | 1 << kind as u8)
    }

    /// Whether a kind is a member.
    pub fn contains(self, kind: PictureKind) -> bool {
        self.0 & 1 << kind as u8 != 0
    }

    /// The members in the order of [`PictureKind::ALL`].
    pub fn iter(self) -> impl Iterator<Item = PictureKind> {
        PictureKind::ALL.into_iter().filter(move |kind| self.contains(*kind))
    }

    /// Number of members.
    pub fn len(self) -> usize {
        self.iter().count()
    }

    /// Whether no kind is a member.
    pub fn is_empty(self) -> bool {
        self == Self::NONE
    }
}

impl FromIterator<PictureKind> for PictureKinds {
    fn from_iter<I: IntoIterator<Item = PictureKind>>(kinds: I) -> Self {
        kinds.into_iter().fold(Self::NONE, Self::with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_has_each_kind_once_and_in_order() {
        let kinds: PictureKinds =
            [PictureKind::Instance, PictureKind::Rgb, PictureKind::Instance].into_iter().collect();
        assert_eq!(kinds.iter().collect::<Vec<_>>(), [PictureKind::Rgb, PictureKind::Instance]);
        assert!(!kinds.contains(PictureKind::Depth) && kinds.len() == 2);
        assert!(PictureKinds::NONE.is_empty() && !PictureKinds::RGB.is_empty());
    }
}
