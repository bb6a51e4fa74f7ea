//! Names and colours of segmentation classes.

use super::Class;

impl Class {
    /// In the order of their numbers.
    pub const ALL: [Self; 14] = [
        Self::Sky,
        Self::Road,
        Self::Marking,
        Self::Pavement,
        Self::Grass,
        Self::Building,
        Self::Wall,
        Self::Vegetation,
        Self::Pole,
        Self::Furniture,
        Self::Water,
        Self::Vehicle,
        Self::Sign,
        Self::Person,
    ];

    /// The name used in files and documents.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sky => "sky",
            Self::Road => "road",
            Self::Marking => "marking",
            Self::Pavement => "pavement",
            Self::Grass => "grass",
            Self::Building => "building",
            Self::Wall => "wall",
            Self::Vegetation => "vegetation",
            Self::Pole => "pole",
            Self::Furniture => "furniture",
            Self::Water => "water",
            Self::Vehicle => "vehicle",
            Self::Sign => "sign",
            Self::Person => "person",
        }
    }

    /// Its colour in segmentation images, sRGB; the Cityscapes colour (Cordts et al. 2016) if Cityscapes has
    /// the class.
    pub fn colour(self) -> [u8; 3] {
        match self {
            Self::Sky => [70, 130, 180],
            Self::Road => [128, 64, 128],
            Self::Marking => [250, 250, 250],
            Self::Pavement => [244, 35, 232],
            Self::Grass => [152, 251, 152],
            Self::Building => [70, 70, 70],
            Self::Wall => [102, 102, 156],
            Self::Vegetation => [107, 142, 35],
            Self::Pole => [153, 153, 153],
            Self::Furniture => [220, 160, 60],
            Self::Water => [30, 80, 220],
            Self::Vehicle => [0, 0, 142],
            Self::Sign => [220, 220, 0],
            Self::Person => [220, 20, 60],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn classes_stand_at_their_numbers_and_can_be_told_apart() {
        for (number, class) in Class::ALL.into_iter().enumerate() {
            assert_eq!(class as usize, number);
        }
        let different = |count: usize| assert_eq!(count, Class::ALL.len());
        different(Class::ALL.map(Class::name).into_iter().collect::<BTreeSet<_>>().len());
        different(Class::ALL.map(Class::colour).into_iter().collect::<BTreeSet<_>>().len());
    }
}
