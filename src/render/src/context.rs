//! GPU context: selects a wgpu adapter and opens device and queue, with a window or headless.

use super::threads;
use super::{Overlay, RenderError};
use city3d_sensors::PictureKind;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};
use tracing::{error, info};

/// Preferred adapter.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterPreference {
    /// A GPU if there is one, otherwise the software adapter.
    #[default]
    Best,
    /// The software adapter: the same pixels on every machine with the same driver.
    Software,
    /// The first adapter whose name contains this, ignoring case.
    Named(String),
}

impl AdapterPreference {
    /// The environment variable that [`AdapterPreference::from_environment`] reads.
    pub const VARIABLE: &'static str = "CITY3D_ADAPTER";

    /// `software`, `best` or a part of an adapter's name.
    pub fn parse(text: &str) -> Self {
        match text.trim().to_lowercase().as_str() {
            "" | "best" => Self::Best,
            "software" | "cpu" => Self::Software,
            name => Self::Named(name.to_owned()),
        }
    }

    /// From `CITY3D_ADAPTER`; the best adapter if the variable is not set.
    pub fn from_environment() -> Self {
        std::env::var(Self::VARIABLE).map_or(Self::Best, |text| Self::parse(&text))
    }
}

/// GPU context: an open adapter with its device and queue.
#[derive(Clone, Debug)]
pub struct Context {
    /// Logical device that creates buffers, textures and pipelines.
    pub device: wgpu::Device,
    /// Queue that takes the command buffers of the device.
    pub queue: wgpu::Queue,
    /// Name and driver, for logs and reports.
    pub adapter_name: String,
    /// Whether the adapter draws on the CPU.
    pub is_software: bool,
    /// The adapter that the device was opened on.
    pub adapter: wgpu::Adapter,
    /// First error that the device reported outside of the result of a call.
    fault: Arc<OnceLock<String>>,
    /// Further devices of the same adapter: see [`Context::for_batches`].
    pub(super) peers: Arc<[Context]>,
}

/// Render target of a view: a window's surface or a texture.
#[derive(Clone, Copy, Debug)]
pub struct TargetView<'a> {
    /// Texture view that is drawn into.
    pub color: &'a wgpu::TextureView,
    /// Pixel format of the texture view.
    pub format: wgpu::TextureFormat,
    /// Width and height in pixels.
    pub extent: [u32; 2],
    /// What its pixels show. Depth, classes and instances come in colours for people.
    pub kind: PictureKind,
    /// Lines and surfaces over a picture in colour.
    pub overlay: Option<&'a Overlay>,
}

impl<'a> TargetView<'a> {
    /// A target for a picture in colour, with nothing over it.
    pub fn new(color: &'a wgpu::TextureView, format: wgpu::TextureFormat, extent: [u32; 2]) -> Self {
        Self { color, format, extent, kind: PictureKind::Rgb, overlay: None }
    }
}

impl Context {
    /// How an instance is checked: without debugging data in shaders, which validation layers of Debian 12 do not know.
    /// `WGPU_DEBUG` and `WGPU_VALIDATION` choose otherwise.
    pub fn instance_flags() -> wgpu::InstanceFlags {
        wgpu::InstanceFlags::from_build_config().difference(wgpu::InstanceFlags::DEBUG).with_env()
    }

    /// Opens an adapter without a window (headless).
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] where the machine has none, which names the package to install;
    /// [`RenderError::NoSuchAdapter`] with those there are; [`RenderError::NoDevice`].
    pub fn headless(preference: &AdapterPreference) -> Result<Self, RenderError> {
        pollster::block_on(async { Self::open(find(&instance(), preference, None).await?).await })
    }

    /// Opens an adapter without a window for many pictures. A software adapter is opened once per processor, and each
    /// device draws pictures of its own with one thread. One device with all threads would be slower: its vertex stage
    /// is single-threaded, and its threads wait for one another after each pass.
    ///
    /// # Errors
    /// As [`Context::headless`].
    pub fn for_batches(preference: &AdapterPreference) -> Result<Self, RenderError> {
        let before = threads::llvmpipe_threads();
        let adapter = threads::with_few_threads(|| pollster::block_on(find(&instance(), preference, None)))?;
        let mut first = pollster::block_on(Self::open(adapter))?;
        let count = if first.is_software { threads::adapter_count(before) } else { 1 };
        let open = |_| Self::headless(preference);
        let peers: Result<Vec<Self>, RenderError> = (1..count).into_par_iter().map(open).collect();
        first.peers = peers?.into();
        Ok(first)
    }

    /// Opens an adapter that can present on a window's surface.
    ///
    /// # Errors
    /// As [`Context::headless`].
    pub fn for_surface(
        instance: &wgpu::Instance,
        surface: &wgpu::Surface<'_>,
        preference: &AdapterPreference,
    ) -> Result<Self, RenderError> {
        pollster::block_on(async { Self::open(find(instance, preference, Some(surface)).await?).await })
    }

    /// Whether the device works.
    ///
    /// # Errors
    /// [`RenderError::Device`] where it has reported an error, such as memory that ran out.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        let adapter = &self.adapter_name;
        self.fault.get().map_or(Ok(()), |problem| {
            Err(RenderError::Device { adapter: adapter.clone(), problem: problem.clone() })
        })
    }

    /// Number of devices opened on the adapter.
    pub fn device_count(&self) -> usize {
        1 + self.peers.len()
    }

    async fn open(adapter: wgpu::Adapter) -> Result<Self, RenderError> {
        let about = adapter.get_info();
        let is_software = about.device_type == wgpu::DeviceType::Cpu;
        let adapter_name = format!("{} ({:?}, {})", about.name, about.backend, about.driver_info);
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("city3d"),
                required_features: adapter.features() & super::gpu_timer::FEATURES,
                required_limits: wgpu::Limits {
                    max_buffer_size: adapter.limits().max_buffer_size,
                    ..wgpu::Limits::default().using_resolution(adapter.limits())
                },
                ..Default::default()
            })
            .await
            .map_err(|source| RenderError::NoDevice { adapter: adapter_name.clone(), source })?;
        if is_software {
            info!(adapter = adapter_name, "drawing on the CPU with the software adapter");
        } else {
            info!(adapter = adapter_name, "drawing");
        }
        let fault = Arc::new(OnceLock::new());
        let slot = Arc::clone(&fault);
        device.on_uncaptured_error(Arc::new(move |problem: wgpu::Error| {
            let problem = problem.to_string();
            error!(problem, "the graphics device reports an error");
            // The first one tells the cause.
            let _ = slot.set(problem);
        }));
        let peers = Arc::default();
        Ok(Self { device, queue, adapter_name, is_software, adapter, fault, peers })
    }
}

/// A buffer with contents. Where memory does not suffice it is of no use, and [`Context::check`] tells.
pub(super) fn filled_buffer(
    device: &wgpu::Device,
    label: &str,
    contents: &[u8],
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: (contents.len() as u64).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
        usage,
        mapped_at_creation: !contents.is_empty(),
    });
    if let Ok(mut mapped) = buffer.get_mapped_range_mut(..) {
        mapped.slice(..contents.len()).copy_from_slice(contents);
        drop(mapped);
        buffer.unmap();
    }
    buffer
}

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::PRIMARY;
    descriptor.flags = Context::instance_flags();
    wgpu::Instance::new(descriptor)
}

async fn find(
    instance: &wgpu::Instance,
    preference: &AdapterPreference,
    surface: Option<&wgpu::Surface<'_>>,
) -> Result<wgpu::Adapter, RenderError> {
    let mut adapters = instance.enumerate_adapters(wgpu::Backends::PRIMARY).await;
    adapters.retain(|adapter| surface.is_none_or(|surface| adapter.is_surface_supported(surface)));
    let rank = |kind: wgpu::DeviceType| match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    };
    adapters.sort_by_key(|a| rank(a.get_info().device_type));
    let names = || adapters.iter().map(|a| a.get_info().name).collect::<Vec<_>>().join(", ");
    let found = match preference {
        AdapterPreference::Best => adapters.first(),
        AdapterPreference::Software => {
            adapters.iter().find(|a| a.get_info().device_type == wgpu::DeviceType::Cpu)
        }
        AdapterPreference::Named(wanted) => {
            let wanted = wanted.to_lowercase();
            adapters.iter().find(|a| a.get_info().name.to_lowercase().contains(&wanted))
        }
    };
    let Some(adapter) = found else {
        return Err(match preference {
            AdapterPreference::Named(wanted) if !adapters.is_empty() => {
                RenderError::NoSuchAdapter { wanted: wanted.clone(), present: names() }
            }
            AdapterPreference::Software if !adapters.is_empty() => {
                RenderError::NoAdapter { wanted: format!(" that draws on the CPU (there are: {})", names()) }
            }
            _ => RenderError::NoAdapter { wanted: String::new() },
        });
    };
    Ok(adapter.clone())
}
