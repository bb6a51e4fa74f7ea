//! The window's swap chain surface: handles resize, occlusion and surface loss.

use super::WindowError;
use city3d_render::Context;
use std::sync::Arc;
use wgpu::CurrentSurfaceTexture as Current;
use winit::dpi::PhysicalSize;
use winit::window::Window;

/// Surface of one window, with its configuration.
pub struct WindowSurface {
    window: Arc<Window>,
    instance: wgpu::Instance,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    device: wgpu::Device,
}

/// How to handle the result of acquiring a surface texture.
#[derive(Debug)]
enum AcquireOutcome {
    Draw(wgpu::SurfaceTexture),
    /// It cannot be drawn to now.
    Wait,
    /// It must be configured again.
    Configure,
    /// It is lost and must be created again.
    Renew,
}

impl AcquireOutcome {
    fn to(given: Current) -> Self {
        match given {
            Current::Success(texture) | Current::Suboptimal(texture) => Self::Draw(texture),
            Current::Timeout | Current::Occluded => Self::Wait,
            Current::Outdated | Current::Validation => Self::Configure,
            Current::Lost => Self::Renew,
        }
    }
}

/// Drawable size of a window; `None` while it is zero, as for minimised windows on some systems.
fn drawable(size: PhysicalSize<u32>, most: u32) -> Option<[u32; 2]> {
    (size.width > 0 && size.height > 0).then(|| [size.width.min(most), size.height.min(most)])
}

impl WindowSurface {
    /// `surface` belongs to `window` and `instance`, and is compatible with `context`.
    ///
    /// # Errors
    /// Where the adapter cannot draw to this window.
    pub fn new(
        window: Arc<Window>,
        instance: wgpu::Instance,
        surface: wgpu::Surface<'static>,
        context: &Context,
    ) -> Result<Self, WindowError> {
        let config = configuration(&surface, context, window.inner_size())?;
        let mut surface = Self { window, instance, surface, config, device: context.device.clone() };
        surface.configure();
        Ok(surface)
    }

    /// Pixel format of the surface textures.
    pub fn format(&self) -> wgpu::TextureFormat {
        self.config.format
    }

    /// Width and height in pixels.
    pub fn extent(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    /// Whether the window has pixels to draw.
    pub fn has_size(&self) -> bool {
        drawable(self.window.inner_size(), u32::MAX).is_some()
    }

    /// Configures the surface for the window's present size.
    pub fn configure(&mut self) {
        let most = self.device.limits().max_texture_dimension_2d;
        if let Some([width, height]) = drawable(self.window.inner_size(), most) {
            (self.config.width, self.config.height) = (width, height);
            self.surface.configure(&self.device, &self.config);
        }
    }

    /// Acquires the next surface texture. `None` where none is available: the cause is handled, and the caller
    /// retries later.
    pub fn next(&mut self) -> Option<wgpu::SurfaceTexture> {
        match AcquireOutcome::to(self.surface.get_current_texture()) {
            AcquireOutcome::Draw(texture) => return Some(texture),
            AcquireOutcome::Wait => {}
            AcquireOutcome::Configure => self.configure(),
            AcquireOutcome::Renew => {
                match self.instance.create_surface(Arc::clone(&self.window)) {
                    Ok(surface) => self.surface = surface,
                    Err(error) => tracing::warn!("the window's surface is lost: {error}"),
                }
                self.configure();
            }
        }
        None
    }
}

/// Configuration with a linear format: panels and city encode sRGB themselves.
fn configuration(
    surface: &wgpu::Surface<'_>,
    context: &Context,
    size: PhysicalSize<u32>,
) -> Result<wgpu::SurfaceConfiguration, WindowError> {
    let adapter = &context.adapter;
    let mut config = surface
        .get_default_config(adapter, size.width.max(1), size.height.max(1))
        .ok_or_else(|| WindowError::NoFormat { adapter: context.adapter_name.clone() })?;
    let formats = surface.get_capabilities(adapter).formats;
    let wanted = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
    if let Some(format) = wanted.into_iter().find(|format| formats.contains(format)) {
        config.format = format;
    }
    config.present_mode = wgpu::PresentMode::AutoVsync;
    config.desired_maximum_frame_latency = 1;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_surface_lacks_is_mended_and_what_passes_is_waited_for() {
        assert!(matches!(AcquireOutcome::to(Current::Lost), AcquireOutcome::Renew));
        for outdated in [Current::Outdated, Current::Validation] {
            assert!(matches!(AcquireOutcome::to(outdated), AcquireOutcome::Configure));
        }
        for passing in [Current::Timeout, Current::Occluded] {
            assert!(matches!(AcquireOutcome::to(passing), AcquireOutcome::Wait));
        }
    }

    #[test]
    fn a_window_without_size_is_not_drawn_and_a_huge_one_only_in_part() {
        for size in [PhysicalSize::new(0, 0), PhysicalSize::new(800, 0), PhysicalSize::new(0, 600)] {
            assert_eq!(drawable(size, 8192), None);
        }
        assert_eq!(drawable(PhysicalSize::new(9000, 600), 8192), Some([8192, 600]));
    }
}
