//! Pictures of the shipped scenarios for their cards. `scripts/cards.sh` renders them.

use egui::{ColorImage, Context, Id, TextureHandle, TextureOptions};
use std::io::Cursor;

/// Size of a picture on its card, points.
pub(super) const SIZE: egui::Vec2 = egui::vec2(200.0, 112.0);

macro_rules! pictures {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_bytes!(concat!("../../../../../assets/cards/", $name, ".png")).as_slice())),*]
    };
}

const PICTURES: [(&str, &[u8]); 11] = pictures![
    "roundabout",
    "roundabout-coordinated",
    "mixed",
    "city",
    "straight",
    "student",
    "intersection",
    "intersection-signals",
    "corridor",
    "merge",
    "platoon",
];

/// The picture of a shipped scenario, decoded once; `None` where there is none.
pub(super) fn picture(context: &Context, scenario: &str) -> Option<TextureHandle> {
    let (name, file) = PICTURES.iter().find(|(name, _)| *name == scenario)?;
    let id = Id::unique(("picture of a scenario", name));
    if let Some(known) = context.data(|data| data.get_temp::<TextureHandle>(id)) {
        return Some(known);
    }
    let texture = context.load_texture(*name, decode(file)?, TextureOptions::LINEAR);
    context.data_mut(|data| data.insert_temp(id, texture.clone()));
    Some(texture)
}

fn decode(file: &[u8]) -> Option<ColorImage> {
    let mut decoder = png::Decoder::new(Cursor::new(file));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().ok()?;
    let mut pixels = vec![0; reader.output_buffer_size()?];
    let frame = reader.next_frame(&mut pixels).ok()?;
    let size = [frame.width as usize, frame.height as usize];
    match frame.color_type {
        png::ColorType::Rgb => Some(ColorImage::from_rgb(size, &pixels)),
        png::ColorType::Rgba => Some(ColorImage::from_rgba_unmultiplied(size, &pixels)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_simulation::scenario::shipped_scenarios;

    #[test]
    fn every_shipped_scenario_has_a_small_picture() {
        let mut bytes = 0;
        for name in shipped_scenarios() {
            let (_, file) = PICTURES.iter().find(|(known, _)| *known == name).expect(name);
            let image = decode(file).expect(name);
            assert_eq!(image.size, [200, 112], "{name}");
            bytes += file.len();
        }
        assert!(bytes < 400_000, "{bytes} bytes of pictures in the program");
    }
}
