//! Render requests and their results: pictures of several kinds (colour, depth, segmentation) for each view.

use super::grid::tile_bytes;
use super::image::{Image, Plane};
use city3d_sensors::{PictureKind, PictureKinds, View};

/// View and the requested kinds of its pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderRequest {
    /// Camera pose, projection and resolution.
    pub view: View,
    /// Kinds of pictures to draw and read back.
    pub kinds: PictureKinds,
}

/// Pictures of one view at one instant; `None` for kinds that were not requested.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pictures {
    /// Colour, sRGB.
    pub rgb: Option<Image>,
    /// Depth map: metres along the optical axis; infinite where nothing is seen.
    pub depth: Option<Plane<f32>>,
    /// Semantic segmentation: numbers of [`city3d_scene::Class`].
    pub semantic: Option<Plane<u8>>,
    /// Instance segmentation: numbers of vehicles, 0 for none.
    pub instance: Option<Plane<u16>>,
}

impl From<&View> for RenderRequest {
    /// Request for colour alone.
    fn from(view: &View) -> Self {
        Self { view: *view, kinds: PictureKinds::RGB }
    }
}

impl RenderRequest {
    /// Bytes of its pictures in the staging buffer.
    pub(super) fn bytes(&self) -> u64 {
        tile_bytes(self.view.extent) * self.planes().into_iter().filter(|&wanted| wanted).count() as u64
    }

    /// Whether colour, depth, and labels have to be read back.
    fn planes(&self) -> [bool; 3] {
        let wants = |kind| self.kinds.contains(kind);
        [
            wants(PictureKind::Rgb),
            wants(PictureKind::Depth),
            wants(PictureKind::Semantic) || wants(PictureKind::Instance),
        ]
    }
}

/// Offsets of the planes of a view in the staging buffer.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReadbackLayout {
    pub(super) extent: [u32; 2],
    pub(super) kinds: PictureKinds,
    pub(super) color: Option<u64>,
    pub(super) depth: Option<u64>,
    pub(super) labels: Option<u64>,
}

/// Layouts of all requests, one after the other, and the size of the staging buffer in bytes.
pub(super) fn readback_layouts(requests: &[RenderRequest]) -> (Vec<ReadbackLayout>, u64) {
    let mut end = 0;
    let of_one = |request: &RenderRequest| {
        let [color, depth, labels] = request.planes().map(|wanted| {
            let begin = end;
            end += if wanted { tile_bytes(request.view.extent) } else { 0 };
            wanted.then_some(begin)
        });
        ReadbackLayout { extent: request.view.extent, kinds: request.kinds, color, depth, labels }
    };
    let layouts = requests.iter().map(of_one).collect();
    (layouts, end)
}
