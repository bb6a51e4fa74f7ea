//! Camera pictures: the GPU renderer, its read-back and the PNG writer.
//!
//! [`Context`] finds an adapter, [`Renderer`] draws snapshots of a scene into [`Image`]s or into a
//! [`TargetView`] of anyone's, [`PngStream`] writes pictures to disk while the next ones are drawn.
//!
//! Bind groups are numbered by how often they change: 0 frame and view, 1 pass (the shadow map),
//! 2 materials. What differs between objects comes as instances.

mod atlas;
mod bonnet;
mod cells;
mod clock;
mod context;
mod daylight;
mod develop;
mod error;
mod files;
mod fleet;
mod frustum;
mod grid;
mod horizon;
mod image;
mod kinds;
mod passes;
mod png;
mod readback;
mod renderer;
mod request;
mod settings;
mod shader;
mod sides;
mod stage;
mod standing;
mod stream;
mod textures;
mod threads;
mod vehicle;

pub use context::{AdapterPreference, Context, TargetView};
pub use daylight::Daylight;
pub use error::RenderError;
pub use files::Format;
pub use image::{Image, Plane};
pub use png::{encode_png, write_png};
pub use readback::{Arrived, Pending, read_texture};
pub use renderer::Renderer;
pub use request::{Pictures, Request};
pub use settings::{FlatLight, Quality, Settings};
pub use stream::{Order, PngStream};
pub use textures::Paintings;
