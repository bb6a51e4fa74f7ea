//! The window's surface: kept usable while the window changes its size, is hidden, or its surface is lost.

use super::Failure;
use crate::render::Context;
use std::sync::Arc;
use wgpu::CurrentSurfaceTexture as Current;
use winit::dpi::PhysicalSize;
use winit::window::Window;

pub struct Surface {
    window: Arc<Window>,
    instance: wgpu::Instance,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    device: wgpu::Device,
}

/// What is to be done about what a surface has given.
#[derive(Debug)]
enum Answer {
    Draw(wgpu::SurfaceTexture),
    /// It cannot be drawn to at present.
    Wait,
    /// It has to be told its size again.
    Configure,
    /// It is gone for good, and another one takes its place.
    Renew,
}

impl Answer {
    fn to(given: Current) -> Self {
        match given {
            Current::Success(texture) | Current::Suboptimal(texture) => Self::Draw(texture),
            Current::Timeout | Current::Occluded => Self::Wait,
            Current::Outdated | Current::Validation => Self::Configure,
            Current::Lost => Self::Renew,
        }
    }
}

/// Pixels that can be drawn of a window; `None` while it has none, as some systems have it when it is minimised.
fn drawable(size: PhysicalSize<u32>, most: u32) -> Option<[u32; 2]> {
    (size.width > 0 && size.height > 0).then(|| [size.width.min(most), size.height.min(most)])
}

impl Surface {
    /// `surface` is one of `window`, made by `instance`, which `context` can draw to.
    ///
    /// # Errors
    /// Where the adapter cannot draw to this window.
    pub fn new(
        window: Arc<Window>,
        instance: wgpu::Instance,
        surface: wgpu::Surface<'static>,
        context: &Context,
    ) -> Result<Self, Failure> {
        let config = configuration(&surface, context, window.inner_size())?;
        let mut surface = Self { window, instance, surface, config, device: context.device.clone() };
        surface.configure();
        Ok(surface)
    }

    pub fn format(&self) -> wgpu::TextureFormat {
        self.config.format
    }

    /// Width and height in pixels.
    pub fn extent(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    /// Whether there is anything to draw to.
    pub fn has_size(&self) -> bool {
        drawable(self.window.inner_size(), u32::MAX).is_some()
    }

    /// Takes the window's present size.
    pub fn configure(&mut self) {
        let most = self.device.limits().max_texture_dimension_2d;
        if let Some([width, height]) = drawable(self.window.inner_size(), most) {
            (self.config.width, self.config.height) = (width, height);
            self.surface.configure(&self.device, &self.config);
        }
    }

    /// The next picture to draw to. `None` where none can be had now: it is to be asked again a little later,
    /// and what stood in the way is mended by then.
    pub fn next(&mut self) -> Option<wgpu::SurfaceTexture> {
        match Answer::to(self.surface.get_current_texture()) {
            Answer::Draw(texture) => return Some(texture),
            Answer::Wait => {}
            Answer::Configure => self.configure(),
            Answer::Renew => {
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

/// A surface whose colours are taken as they are: panels and city encode theirs themselves.
fn configuration(
    surface: &wgpu::Surface<'_>,
    context: &Context,
    size: PhysicalSize<u32>,
) -> Result<wgpu::SurfaceConfiguration, Failure> {
    let adapter = &context.adapter;
    let mut config = surface
        .get_default_config(adapter, size.width.max(1), size.height.max(1))
        .ok_or_else(|| Failure::failed(format!("{} cannot draw to this window", context.adapter_name)))?;
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
        assert!(matches!(Answer::to(Current::Lost), Answer::Renew));
        for outdated in [Current::Outdated, Current::Validation] {
            assert!(matches!(Answer::to(outdated), Answer::Configure));
        }
        for passing in [Current::Timeout, Current::Occluded] {
            assert!(matches!(Answer::to(passing), Answer::Wait));
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
