//! Pictures that nobody can draw.

use city3d_render::RenderError;
use city3d_session::pictures::{PictureError, PictureStamps, PictureThread};
use std::sync::Arc;

#[test]
fn a_renderer_that_cannot_be_opened_is_an_error_at_the_start() {
    let open = Box::new(|_| Err(RenderError::NoAdapter { wanted: " of the kind none".to_owned() }));
    let cameras = (Vec::new(), PictureStamps::Simulated);
    let started = PictureThread::start(open, cameras, Arc::new([]), |_| panic!("there are no pictures"));
    match started {
        Err(PictureError::Renderer(error)) => {
            assert!(error.to_string().contains("of the kind none"), "{error}");
        }
        other => panic!("{other:?}"),
    }
}
