//! A picture as a page gets it.

use tokio_tungstenite::tungstenite::Bytes;

/// How a picture is encoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(not(feature = "h264"), allow(dead_code, reason = "there are no frames of H.264"))]
pub enum PictureKind {
    /// By itself.
    #[default]
    Jpeg,
    /// H.264, by itself (IDR), with the parameter sets of what follows; Annex B.
    KeyFrame,
    /// H.264, as the difference to the frame before.
    DeltaFrame,
}

/// An encoded picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Picture {
    /// How it is encoded.
    pub kind: PictureKind,
    /// Its bytes.
    pub bytes: Bytes,
}
