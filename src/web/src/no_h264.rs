//! Pictures as H.264, in a program that makes none.

/// This program makes no H.264.
pub(crate) const IS_BUILT: bool = false;

/// There is none.
#[cfg(feature = "render")]
pub(crate) enum ViewEncoder {}

#[cfg(feature = "render")]
impl ViewEncoder {
    pub(crate) fn new() -> Result<Self, String> {
        Err("this program was built without H.264".to_owned())
    }

    pub(crate) fn encode(
        &mut self,
        _: &city3d_render::Image,
        _: bool,
    ) -> Result<crate::picture::Picture, String> {
        match *self {}
    }
}
