//! What people look like: how they wear their hair, what they have on their heads, and the colours of their clothes.

use super::super::hash_to_unit;
use super::super::mesh::Finish;
use super::figure::{
    BAG, BELT, COAT, COLLAR, CROWN, Dress, HAIR, HAT, LEGS, MOUTH, Model, NOSE, PHONE, SHIRT, SHOES, SKIN,
    SLEEVE, TROUSERS,
};

/// How hair is worn, or what is worn over it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cut {
    Short,
    /// Combed up from the forehead.
    Swept,
    /// Short, with a beard.
    Bearded,
    /// With a beard and no other hair.
    Bald,
    Cap,
    Beanie,
    /// The hood of a jacket.
    Hood,
    Bob,
    Loose,
    Bun,
    Tail,
    /// Loose hair under a beanie.
    LooseBeanie,
}

impl Cut {
    /// Whether hair falls around the neck.
    pub(super) fn is_loose(self) -> bool {
        matches!(self, Self::Bob | Self::Loose | Self::LooseBeanie)
    }
}

/// All cuts, and whether they are those of models with long hair.
#[cfg(test)]
pub(super) const CUTS: [(bool, Cut); 12] = [
    (false, Cut::Short),
    (false, Cut::Swept),
    (false, Cut::Bearded),
    (false, Cut::Bald),
    (false, Cut::Cap),
    (false, Cut::Beanie),
    (false, Cut::Hood),
    (true, Cut::Bob),
    (true, Cut::Loose),
    (true, Cut::Bun),
    (true, Cut::Tail),
    (true, Cut::LooseBeanie),
];

/// What differs between near levels of the same model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Look {
    pub(super) cut: Cut,
    /// Over a coat, which else has a collar.
    pub(super) has_scarf: bool,
}

impl Look {
    /// A drawn one that suits a model: nobody wears wool on a warm day.
    pub(super) fn drawn(seed: u32, model: Model) -> Self {
        let cuts: &[Cut] = match (model.has_long_hair, model.dress()) {
            (true, Dress::Frock | Dress::Shirt) => &[Cut::Bob, Cut::Loose, Cut::Bun, Cut::Tail],
            (true, _) => &[Cut::Bob, Cut::Loose, Cut::Bun, Cut::Tail, Cut::LooseBeanie],
            (false, Dress::Jacket | Dress::Coat) => &[
                Cut::Short,
                Cut::Swept,
                Cut::Bearded,
                Cut::Short,
                Cut::Bald,
                Cut::Cap,
                Cut::Beanie,
                Cut::Hood,
            ],
            (false, _) => &[Cut::Short, Cut::Swept, Cut::Bearded, Cut::Short, Cut::Bald, Cut::Cap],
        };
        Self { cut: cuts[pick(seed, 21, cuts.len())], has_scarf: hash_to_unit(seed, 22) < 0.5 }
    }
}

/// Colours of a figure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outfit {
    coat: [u8; 3],
    trousers: [u8; 3],
    hair: [u8; 3],
    crown: [u8; 3],
    hat: [u8; 3],
    skin: [u8; 3],
    bag: [u8; 3],
    shirt: [u8; 3],
    shoes: [u8; 3],
    legs: [u8; 3],
}

/// Muted, with a few stronger ones.
const COATS: [[u8; 3]; 14] = [
    [64, 76, 98],
    [114, 68, 66],
    [176, 164, 138],
    [68, 90, 80],
    [164, 132, 92],
    [84, 88, 96],
    [196, 194, 186],
    [94, 78, 96],
    [62, 66, 78],
    [122, 92, 68],
    [98, 122, 140],
    [50, 56, 68],
    [102, 108, 78],
    [86, 108, 112],
];
const TROUSERS_OF: [[u8; 3]; 7] =
    [[44, 46, 54], [70, 72, 80], [92, 74, 58], [58, 70, 98], [36, 38, 44], [84, 100, 130], [110, 98, 80]];
const HAIRS: [[u8; 3]; 7] =
    [[46, 33, 25], [26, 22, 21], [206, 202, 194], [84, 54, 32], [60, 42, 30], [152, 116, 72], [92, 54, 40]];
const SKINS: [[u8; 3]; 6] =
    [[222, 180, 150], [232, 194, 166], [168, 122, 92], [226, 186, 156], [200, 152, 120], [142, 100, 74]];
const BAGS: [[u8; 3]; 5] = [[70, 52, 40], [196, 172, 120], [40, 42, 48], [142, 58, 52], [214, 208, 194]];
const HATS: [[u8; 3]; 6] =
    [[178, 140, 70], [46, 56, 78], [136, 62, 54], [112, 114, 118], [60, 84, 68], [206, 198, 180]];
const SHIRTS: [[u8; 3]; 5] = [[226, 226, 224], [186, 200, 216], [60, 62, 70], [218, 206, 182], [138, 70, 64]];
const SHOES_OF: [[u8; 3]; 5] = [[28, 28, 30], [176, 174, 168], [84, 58, 40], [44, 40, 38], [70, 74, 84]];
/// Tights; others have bare legs.
const TIGHTS: [[u8; 3]; 2] = [[44, 42, 46], [74, 60, 54]];

/// One of so many by a seed.
fn pick(seed: u32, salt: u32, of: usize) -> usize {
    (hash_to_unit(seed, salt) * of as f32) as usize % of
}

fn luma(colour: [u8; 3]) -> f32 {
    let [r, g, b] = colour.map(f32::from);
    0.30 * r + 0.59 * g + 0.11 * b
}

impl Outfit {
    /// A drawn one, with another coat than that of the last person.
    pub(super) fn drawn(seed: u32, look: Look, last_coat: &mut usize) -> Self {
        /// Between hair and skin, so that both are told apart in dim light too.
        const APART: f32 = 62.0;
        let pick = |salt: u32, of: usize| pick(seed, salt, of);
        let mut coat = pick(8, COATS.len());
        if coat == *last_coat {
            coat = (coat + 1) % COATS.len();
        }
        *last_coat = coat;
        let coat = COATS[coat];
        let skin = SKINS[pick(14, SKINS.len())];
        let hairs = HAIRS.iter().cycle().skip(pick(13, HAIRS.len())).take(HAIRS.len());
        let is_apart = |hair: &&[u8; 3]| (luma(**hair) - luma(skin)).abs() > APART;
        let hair = hairs.into_iter().find(is_apart).copied().unwrap_or(HAIRS[1]);
        let hat = HATS[pick(23, HATS.len())];
        let crown = match look.cut {
            Cut::Bald => skin,
            Cut::Cap | Cut::Beanie | Cut::LooseBeanie => hat,
            Cut::Hood => coat,
            _ => hair,
        };
        Self {
            coat,
            trousers: TROUSERS_OF[pick(12, TROUSERS_OF.len())],
            hair,
            crown,
            hat,
            skin,
            bag: BAGS[pick(15, BAGS.len())],
            shirt: SHIRTS[pick(17, SHIRTS.len())],
            shoes: SHOES_OF[pick(18, SHOES_OF.len())],
            legs: TIGHTS.get(pick(19, 4)).copied().unwrap_or(skin),
        }
    }

    /// The finish of a part.
    pub(super) fn dressed(&self, part: Finish) -> Finish {
        let (colour, tone) = match part {
            COAT => (self.coat, 1.0),
            SLEEVE => (self.coat, 0.96),
            TROUSERS => (self.trousers, 1.0),
            SHOES => (self.shoes, 1.0),
            SKIN => (self.skin, 1.0),
            NOSE => (self.skin, 0.95),
            MOUTH => ([self.skin[0], self.skin[1] - 36, self.skin[2] - 30], 0.78),
            HAIR => (self.hair, 1.0),
            CROWN => (self.crown, 1.0),
            HAT => (self.hat, 1.0),
            BAG => (self.bag, 1.0),
            COLLAR => (self.coat, 0.76),
            SHIRT => (self.shirt, 1.0),
            BELT => ([46, 36, 30], 1.0),
            LEGS => (self.legs, 1.0),
            PHONE => ([26, 28, 32], 1.0),
            _ => ([38, 30, 28], 1.0),
        };
        Finish { colour, ..part }.shaded(tone)
    }
}
