//! What is asked of the renderer and what it gives back: pictures of several kinds for each view.

use super::grid::tile_bytes;
use super::image::{Image, Plane};
use crate::camera::{Kinds, PictureKind, View};

/// A view and the kinds of pictures that are wanted of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    pub view: View,
    pub kinds: Kinds,
}

/// The pictures of one view at one instant: those that were asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pictures {
    pub rgb: Option<Image>,
    /// Metres along the optical axis; infinite where nothing is seen.
    pub depth: Option<Plane<f32>>,
    /// Numbers of [`crate::city::scene::Class`].
    pub semantic: Option<Plane<u8>>,
    /// Numbers of vehicles, 0 for none.
    pub instance: Option<Plane<u16>>,
}

impl From<&View> for Request {
    /// In colour.
    fn from(view: &View) -> Self {
        Self { view: *view, kinds: Kinds::RGB }
    }
}

impl Request {
    /// Bytes of its pictures in the read-back buffer.
    pub(super) fn bytes(&self) -> u64 {
        tile_bytes(self.view.extent) * self.planes().into_iter().filter(|&wanted| wanted).count() as u64
    }

    /// Whether colours, depths, and classes with vehicles have to be read back.
    fn planes(&self) -> [bool; 3] {
        let wants = |kind| self.kinds.contains(kind);
        [
            wants(PictureKind::Rgb),
            wants(PictureKind::Depth),
            wants(PictureKind::Semantic) || wants(PictureKind::Instance),
        ]
    }
}

/// Where the pictures of a view lie in the read-back buffer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Places {
    pub(super) extent: [u32; 2],
    pub(super) kinds: Kinds,
    pub(super) color: Option<u64>,
    pub(super) depth: Option<u64>,
    pub(super) meaning: Option<u64>,
}

/// One after the other, and how many bytes they are.
pub(super) fn places(requests: &[Request]) -> (Vec<Places>, u64) {
    let mut end = 0;
    let of_one = |request: &Request| {
        let [color, depth, meaning] = request.planes().map(|wanted| {
            let begin = end;
            end += if wanted { tile_bytes(request.view.extent) } else { 0 };
            wanted.then_some(begin)
        });
        Places { extent: request.view.extent, kinds: request.kinds, color, depth, meaning }
    };
    let places = requests.iter().map(of_one).collect();
    (places, end)
}
