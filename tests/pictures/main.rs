//! Pictures as the program takes them: camera frames, video, the window, and the golden pictures.

mod frames;
#[path = "../support/mod.rs"]
mod support;
mod video;
mod visual;
mod window;
mod window_pictures;
