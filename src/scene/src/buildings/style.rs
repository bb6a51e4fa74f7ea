//! Style of a building by its name: walls and roof.

use super::super::SeededScenery;
use super::super::mesh::{Class, Finish, Surface};

pub(super) const fn wall(surface: Surface, colour: [u8; 3]) -> Finish {
    Finish::new(surface, colour, Class::Building)
}

const PLASTERS: [[u8; 3]; 7] = [
    [236, 226, 204],
    [222, 206, 178],
    [206, 214, 216],
    [232, 208, 176],
    [214, 186, 160],
    [226, 226, 220],
    [196, 206, 190],
];
/// Tints of brick, multiplied with its red texture.
const BRICKS: [[u8; 3]; 3] = [[255, 250, 244], [236, 216, 200], [255, 236, 214]];
const TILES: [[u8; 3]; 4] = [[199, 108, 77], [171, 96, 75], [122, 119, 124], [157, 115, 91]];
/// Board colours, light enough for dark letters.
const SIGNS: [[u8; 3]; 6] =
    [[150, 176, 150], [206, 122, 104], [140, 168, 196], [226, 186, 96], [226, 214, 190], [184, 166, 190]];
/// Tints of house doors.
const DOORS: [[u8; 3]; 8] = [
    [128, 52, 42],
    [52, 100, 74],
    [56, 82, 128],
    [88, 92, 98],
    [150, 106, 70],
    [186, 66, 50],
    [226, 222, 212],
    [96, 140, 152],
];
pub(super) const TRIM: Finish = wall(Surface::Concrete, [206, 202, 194]);
pub(super) const FLAT_ROOF: Finish = wall(Surface::Gravel, [150, 148, 144]);
pub(crate) const DARK: Finish = wall(Surface::Metal, [72, 76, 80]);

/// The style of a building.
pub(super) struct Style {
    pub(super) upper: Finish,
    pub(super) ground: Finish,
    pub(super) tiles: Finish,
    pub(super) door: Finish,
    pub(super) gabled: bool,
    /// Without storeys, chimney and roof windows.
    pub(super) is_church: bool,
    /// A small roof over the door of a house.
    pub(super) has_porch: bool,
    pub(super) sign: Option<Finish>,
    /// Wide doors on the front instead of one entrance.
    pub(super) gates: Option<[u8; 3]>,
}

pub(super) fn has(name: &str, words: &[&str]) -> bool {
    words.iter().any(|word| name.contains(word))
}

/// Shop-window surface by the name of the shop.
fn shop_of(name: &str) -> Surface {
    if has(name, &["cafe", "bakery", "hotel", "restaurant", "theatre", "cinema"]) {
        Surface::Tearoom
    } else if has(name, &["shoe", "hat", "department", "fashion", "tailor"]) {
        Surface::Boutique
    } else {
        Surface::Shopfront
    }
}

pub(super) fn style(place: &SeededScenery<'_>, name: &str, short_m: f32, height: f32) -> Style {
    let pick = |colours: &[[u8; 3]], salt: u32| {
        colours[(place.hash_to_unit(salt) * colours.len() as f32) as usize % colours.len()]
    };
    let plaster = wall(Surface::Windows, pick(&PLASTERS, 1));
    let tiles = wall(Surface::RoofTiles, pick(&TILES, 2));
    let sign = Some(wall(Surface::Plain, pick(&SIGNS, 3)));
    let shop = wall(shop_of(name), pick(&SIGNS, 3));
    let dwelling = has(name, &["house", "villa", "terrace", "cottage", "chapel", "school", "farm"])
        && !has(name, &["warehouse"]);
    let base = Style {
        upper: plaster,
        ground: plaster.shaded(0.95),
        tiles,
        door: wall(Surface::Door, pick(&DOORS, 7)),
        gabled: dwelling && short_m < 11.0 && height < 16.0,
        is_church: false,
        has_porch: place.hash_to_unit(86) < 0.55,
        sign: None,
        gates: None,
    };
    let sash = wall(Surface::Sash, pick(&BRICKS, 6));
    let balcony = wall(Surface::Balcony, pick(&PLASTERS, 1));
    if has(name, &["fire station"]) {
        let sign = Some(wall(Surface::Plain, [232, 226, 214]));
        let brick = Finish { colour: BRICKS[0], ..sash };
        return Style { upper: brick, ground: brick, sign, gates: Some([196, 34, 30]), ..base };
    }
    if super::church::is_one(name) {
        let stone = wall(Surface::Concrete, [214, 204, 182]);
        let tiles = wall(Surface::RoofTiles, TILES[2]);
        return Style { upper: stone, ground: stone, tiles, is_church: true, ..base };
    }
    if has(name, &["hose tower"]) {
        return Style { upper: BARE_BRICK, ground: BARE_BRICK, ..base };
    }
    if has(name, &["mill"]) {
        let brick = Finish { colour: BRICKS[0], ..sash };
        return Style { upper: brick, ground: brick, gates: Some([74, 92, 84]), ..base };
    }
    if has(name, &["warehouse", "factory", "depot", "workshop"]) {
        let sheet = wall(Surface::Concrete, pick(&[[186, 190, 190], [170, 182, 188], [196, 188, 174]], 4));
        let upper = wall(Surface::Windows, sheet.colour);
        return Style { upper, ground: upper, sign, gates: Some([112, 124, 134]), ..base };
    }
    let glazing = wall(Surface::Glazing, [214, 218, 220]);
    if has(name, &["office"]) {
        return Style { upper: glazing, ground: glazing, sign, ..base };
    }
    if has(name, &["department"]) {
        return Style { upper: glazing, ground: shop, sign, ..base };
    }
    if has(name, &["theatre", "hotel", "cinema"]) {
        let stone =
            wall(Surface::Windows, if has(name, &["hotel"]) { [214, 196, 168] } else { [228, 218, 198] });
        return Style { upper: stone, ground: shop, sign, ..base };
    }
    if has(name, &["shop", "bakery", "pharmacy", "cafe", "cinema", "theatre", "hotel", "store", "station"]) {
        let upper = if place.hash_to_unit(5) < 0.3 { sash } else { plaster };
        return Style { upper, ground: shop, sign, ..base };
    }
    if has(name, &["town hall", "observatory", "school"]) {
        let stone = wall(Surface::Windows, [222, 208, 182]);
        return Style { upper: stone, ground: stone, sign, ..base };
    }
    if has(name, &["apartments"]) {
        let upper = match place.hash_to_unit(5) {
            d if d < 0.40 => balcony,
            d if d < 0.75 => sash,
            _ => plaster,
        };
        let ground =
            if upper.surface == Surface::Balcony { wall(Surface::Windows, balcony.colour) } else { upper };
        return Style { upper, ground: ground.shaded(0.95), ..base };
    }
    if has(name, &["row house", "terrace"]) && place.hash_to_unit(5) < 0.55 {
        return Style { upper: sash, ground: sash, ..base };
    }
    if dwelling && !has(name, &["chapel", "terrace"]) && place.hash_to_unit(5) < 0.5 {
        let shutters = Finish { surface: Surface::Shutters, ..plaster };
        return Style { upper: shutters, ground: shutters.shaded(0.97), ..base };
    }
    base
}

/// Brick in the colour of [`Surface::Sash`].
pub(super) const BARE_BRICK: Finish = wall(Surface::Brick, [203, 126, 102]);
