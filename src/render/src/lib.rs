//! GPU renderer of camera pictures (wgpu), with asynchronous read-back and PNG encoding.
//!
//! [`Context`] opens an adapter, [`Renderer`] draws snapshots of a scene into [`Image`]s or into the caller's
//! [`TargetView`], [`PngStream`] writes pictures to disk while the next ones are drawn,
//! [`PictureTable`] lists them, [`video`] writes them as a stream.
//!
//! Bind groups are numbered by how often they change: 0 frame and view, 1 light (shadow map, light map, environment
//! map), 2 materials. Vehicles differ by instance data alone.

#![allow(clippy::disallowed_types, reason = "writes picture files")]

mod atlas;
pub mod benchmark;
mod box_table;
mod cells;
mod context;
mod daylight;
mod device_renderer;
mod ego_occlusion;
mod error;
mod export;
mod files;
mod fleet;
mod flow;
mod frame_constants;
mod frustum;
mod geometry;
mod gpu_timer;
mod grid;
mod ground_truth;
mod image;
mod instances;
mod jitter;
mod normal_clusters;
mod occlusion_horizon;
mod overlay;
mod passes;
mod picture_table;
mod png;
mod post_process;
mod readback;
mod renderer;
mod request;
mod settings;
mod shader;
mod static_scene;
mod stream;
mod textures;
mod threads;
mod vehicle;
pub mod video;
mod weather;

pub use box_table::{BoxTable, BoxTableError};
pub use context::{AdapterPreference, Context, TargetView};
pub use daylight::Daylight;
pub use error::RenderError;
pub use export::{LACQUER, SceneLight, SurfaceTexture, VehicleVertex, vehicle_triangles};
pub use files::{FlowFormat, PictureFormat};
pub use flow::Motion;
pub use image::{Image, Plane};
pub use overlay::{Overlay, OverlayLine, OverlayPaint, OverlayTriangle};
pub use passes::palette::instance_colour;
pub use picture_table::{PictureCamera, PictureRow, PictureTable, PictureTableError};
pub use png::{encode_png, write_png};
pub use readback::{MappedReadback, PendingReadback, read_texture};
pub use renderer::Renderer;
pub use request::{Pictures, RenderRequest};
pub use settings::{FlatLight, Quality, Settings};
pub use stream::{CaptureJob, FlowJob, PngStream};
pub use textures::BakedTextures;
