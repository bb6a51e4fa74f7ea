//! Draws a frame of the window: the requested pictures of the city into textures, and the panels over them.

use super::WindowError;
use super::panels::PanelRenderer;
use crate::ui::{self, Look, MORE_VIEWS, PictureRequest, PictureSlot, QualityPreset};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_render::{
    BakedTextures, Context, Daylight, Image, Overlay, Quality, Renderer, Settings, TargetView, read_texture,
};
use city3d_scene::SceneDescription;
use city3d_simulation::scenario::Experiment;
use egui_wgpu::ScreenDescriptor;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Renderers of the city and of the panels, and the textures between them.
pub struct WindowPainter {
    context: Context,
    city: Renderer,
    /// Quality and time of day of the renderer.
    look: Look,
    panels: PanelRenderer,
    /// Format of the targets.
    format: wgpu::TextureFormat,
    slots: BTreeMap<PictureSlot, Texture>,
    /// What is in the textures: an equal frame is not drawn again.
    drawn: Option<CityFrame>,
}

/// Pictures of the city in one frame of the window.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CityFrame {
    /// What all pictures show.
    pub snapshot: FrameSnapshot,
    /// The pictures.
    pub pictures: Vec<PictureRequest>,
    /// Lies over the large view.
    pub overlay: Overlay,
    /// Lie over the views beside it.
    pub view_overlays: [Overlay; MORE_VIEWS],
    /// Colours of bodies in the large views in place of their own; previews show what cameras see.
    pub tints: Vec<(VehicleId, [u8; 3])>,
}

impl CityFrame {
    /// What lies over a picture.
    fn overlay_of(&self, slot: PictureSlot) -> Option<&Overlay> {
        match slot {
            PictureSlot::City => Some(&self.overlay),
            PictureSlot::View(index) => self.view_overlays.get(index),
            PictureSlot::Preview(_) => None,
        }
    }

    /// The snapshot with the colours of the large views.
    fn tinted(&self) -> FrameSnapshot {
        let mut snapshot = self.snapshot.clone();
        let roster = Arc::make_mut(&mut snapshot.roster);
        for (id, colour) in &self.tints {
            if let Ok(place) = roster.binary_search_by_key(id, |info| info.id) {
                roster[place].appearance.colour = *colour;
            }
        }
        snapshot
    }
}

/// Texture of a picture. The city's shaders encode sRGB themselves, so its format is linear.
struct Texture {
    extent: [u32; 2],
    texture: wgpu::Texture,
    id: egui::TextureId,
}

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Render target of the panels.
#[derive(Clone, Copy, Debug)]
pub struct PaintTarget<'a> {
    /// Texture of the swap chain or in memory, in the format of the painter.
    pub view: &'a wgpu::TextureView,
    /// Width and height of the texture, pixels.
    pub extent: [u32; 2],
}

impl WindowPainter {
    /// `format` is that of the targets.
    ///
    /// # Errors
    /// When the renderer of the city cannot be built.
    pub fn new(
        context: Context,
        experiment: &Experiment,
        look: Look,
        format: wgpu::TextureFormat,
    ) -> Result<Self, WindowError> {
        let city = renderer(&context, experiment, look)?;
        let panels = PanelRenderer::new(&context.device, format);
        Ok(Self { context, city, look, panels, format, slots: BTreeMap::new(), drawn: None })
    }

    /// The adapter and the device that draw.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Quality and time of day of what it draws.
    pub fn look(&self) -> Look {
        self.look
    }

    /// Replaces the renderer: another city, or another light.
    pub fn set_city(&mut self, city: Renderer, look: Look) {
        (self.city, self.look) = (city, look);
        self.drawn = None;
    }

    /// The textures of the pictures that have been drawn.
    pub fn textures(&self) -> BTreeMap<PictureSlot, egui::TextureId> {
        self.slots.iter().map(|(slot, texture)| (*slot, texture.id)).collect()
    }

    /// Draws the pictures of a frame; an unchanged one is not drawn again.
    ///
    /// # Errors
    /// When the adapter cannot draw a view or a vehicle.
    pub fn draw(&mut self, frame: CityFrame) -> Result<(), WindowError> {
        if self.drawn.as_ref() == Some(&frame) {
            return Ok(());
        }
        self.drawn = None;
        let CityFrame { pictures, .. } = &frame;
        let gone: Vec<PictureSlot> =
            self.slots.keys().filter(|slot| !pictures.iter().any(|p| p.slot == **slot)).copied().collect();
        for slot in gone {
            if let Some(texture) = self.slots.remove(&slot) {
                self.panels.textures().free_texture(&texture.id);
            }
        }
        for picture in pictures {
            self.make_texture(picture);
        }
        let is_preview = |picture: &&PictureRequest| matches!(picture.slot, PictureSlot::Preview(_));
        let (previews, large): (Vec<_>, Vec<_>) = match frame.tints.as_slice() {
            [] => (pictures.iter().collect(), Vec::new()),
            _ => pictures.iter().partition(is_preview),
        };
        self.draw_pictures(&frame.snapshot, &previews, &frame)?;
        if !large.is_empty() {
            self.draw_pictures(&frame.tinted(), &large, &frame)?;
        }
        self.drawn = Some(frame);
        Ok(())
    }

    fn draw_pictures(
        &mut self,
        snapshot: &FrameSnapshot,
        pictures: &[&PictureRequest],
        frame: &CityFrame,
    ) -> Result<(), WindowError> {
        let views: Vec<wgpu::TextureView> = pictures
            .iter()
            .filter_map(|picture| self.slots.get(&picture.slot))
            .map(|slot| slot.texture.create_view(&wgpu::TextureViewDescriptor::default()))
            .collect();
        let targets: Vec<TargetView<'_>> = views
            .iter()
            .zip(pictures)
            .map(|(color, picture)| TargetView {
                kind: picture.kind,
                overlay: frame.overlay_of(picture.slot),
                ..TargetView::new(color, FORMAT, picture.view.extent)
            })
            .collect();
        let views: Vec<_> = pictures.iter().map(|picture| picture.view).collect();
        self.city.draw(snapshot, &views, &targets)?;
        Ok(())
    }

    fn make_texture(&mut self, picture: &PictureRequest) {
        let extent = picture.view.extent;
        if self.slots.get(&picture.slot).is_some_and(|slot| slot.extent == extent) {
            return;
        }
        let device = &self.context.device;
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture of a panel"),
            size: wgpu::Extent3d { width: extent[0], height: extent[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let id = match self.slots.get(&picture.slot) {
            Some(slot) => {
                let filter = wgpu::FilterMode::Linear;
                let textures = self.panels.textures();
                textures.update_egui_texture_from_wgpu_texture(device, &view, filter, slot.id);
                slot.id
            }
            None => {
                let textures = self.panels.textures();
                textures.register_native_texture(device, &view, wgpu::FilterMode::Linear)
            }
        };
        self.slots.insert(picture.slot, Texture { extent, texture, id });
    }

    /// An offscreen target that can be read back.
    pub fn memory(&self, extent: [u32; 2]) -> wgpu::Texture {
        self.context.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture of the window"),
            size: wgpu::Extent3d { width: extent[0], height: extent[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    /// Paints the picture of the large view alone on a target, as large as its shape allows, with black around it; `false`
    /// until there is one.
    pub fn paint_city(&mut self, screen: PaintTarget<'_>) -> bool {
        let Some(city) = self.slots.get(&PictureSlot::City) else { return false };
        let place = fitted(city.extent, screen.extent);
        let mut mesh = egui::Mesh::with_texture(city.id);
        let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
        mesh.add_rect_with_uv(place, whole, egui::Color32::WHITE);
        let primitive =
            egui::ClippedPrimitive { clip_rect: place, primitive: egui::epaint::Primitive::Mesh(mesh) };
        self.paint_primitives((&[primitive], wgpu::Color::BLACK), 1.0, screen);
        true
    }

    /// Reads an offscreen target back.
    ///
    /// # Errors
    /// When the pixels do not come back from the adapter.
    pub fn read(&self, memory: &wgpu::Texture) -> Result<Image, WindowError> {
        Ok(read_texture(&self.context, memory)?)
    }

    /// Paints the panels of a frame on each target. Without targets it only applies the texture changes, which later
    /// frames need.
    pub fn paint(&mut self, egui: &egui::Context, mut output: egui::FullOutput, screens: &[PaintTarget<'_>]) {
        let (device, queue) = (&self.context.device, &self.context.queue);
        for (id, deltas) in &output.textures_delta.set {
            for delta in deltas {
                self.panels.textures().update_texture(device, queue, *id, delta);
            }
        }
        let gone: Vec<egui::TextureId> = output.textures_delta.free.iter().copied().collect();
        output.textures_delta.clear();
        if !screens.is_empty() {
            let points = output.pixels_per_point;
            let primitives = egui.tessellate(std::mem::take(&mut output.shapes), points);
            let ground = self.clear_colour(ui::ground(egui));
            screens.iter().for_each(|screen| self.paint_primitives((&primitives, ground), points, *screen));
        }
        gone.iter().for_each(|id| self.panels.textures().free_texture(id));
    }

    /// Clear colour under the panels: a clear costs less than a rectangle.
    fn clear_colour(&self, ground: egui::Color32) -> wgpu::Color {
        let [r, g, b, _] = if self.format.is_srgb() {
            egui::Rgba::from(ground).to_array().map(f64::from)
        } else {
            ground.to_array().map(|part| f64::from(part) / 255.0)
        };
        wgpu::Color { r, g, b, a: 1.0 }
    }

    fn paint_primitives(
        &mut self,
        (primitives, ground): (&[egui::ClippedPrimitive], wgpu::Color),
        pixels_per_point: f32,
        screen: PaintTarget<'_>,
    ) {
        let (device, queue) = (&self.context.device, &self.context.queue);
        let size = ScreenDescriptor { size_in_pixels: screen.extent, pixels_per_point };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("panels"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: screen.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(ground), store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        self.panels.paint((device, queue), &mut pass, primitives, &size);
        drop(pass);
        queue.submit([encoder.finish()]);
    }
}

/// Where a picture of one size lies in a rectangle of another: as large as fits, in the middle, in its own shape.
fn fitted(picture: [u32; 2], into: [u32; 2]) -> egui::Rect {
    let [picture, into] = [picture, into].map(|[width, height]| egui::vec2(width as f32, height as f32));
    let scale = (into / picture).min_elem();
    egui::Rect::from_center_size((into / 2.0).to_pos2(), picture * scale)
}

/// The renderer of an experiment's city.
///
/// # Errors
/// When it cannot be built on the adapter.
pub fn renderer(context: &Context, experiment: &Experiment, look: Look) -> Result<Renderer, WindowError> {
    let quality = match look.preset {
        QualityPreset::Low => Quality::LOW,
        QualityPreset::Medium => Quality::MEDIUM,
        QualityPreset::High => Quality::HIGH,
        QualityPreset::Ultra => Quality::ULTRA,
    };
    let daylight = Daylight { hours: look.hours as f32 };
    let settings = Settings { quality, daylight, weather: look.weather, ..Settings::default() };
    // Side by side: each takes as long as the other.
    let (baked, scene) = rayon::join(
        || BakedTextures::new(settings),
        || {
            let models = &experiment.models.placed;
            let has_close_ups = look.preset != QualityPreset::Low;
            SceneDescription::with_close_ups(&experiment.city_map, models, has_close_ups)
        },
    );
    let mut renderer = Renderer::with_textures(context, &scene, baked)?;
    renderer.set_vehicle_models(&experiment.models.vehicles);
    Ok(renderer)
}

#[cfg(test)]
mod tests {
    use super::super::loading::{self, software_context};
    use super::*;
    use crate::ui::{CameraMode, Viewpoint};
    use city3d_sensors::PictureKind;
    use city3d_sensors::Weather;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::ScenarioRequest;

    #[test]
    fn a_picture_keeps_its_shape_and_its_middle_whatever_it_is_fitted_into() {
        let of = |picture, into| {
            let rect = fitted(picture, into);
            [rect.left(), rect.top(), rect.right(), rect.bottom()]
        };
        assert_eq!(of([400, 300], [800, 600]), [0.0, 0.0, 800.0, 600.0]);
        assert_eq!(of([400, 300], [800, 300]), [200.0, 0.0, 600.0, 300.0]);
        assert_eq!(of([400, 300], [400, 600]), [0.0, 150.0, 400.0, 450.0]);
    }

    #[test]
    fn the_city_alone_is_the_picture_of_the_large_view_in_the_size_of_the_video() {
        let Some(context) = software_context() else { return };
        let request = ScenarioRequest { scenario: "straight".to_owned(), ..ScenarioRequest::default() };
        let experiment = loading::read(&request).unwrap();
        let look = Look { preset: QualityPreset::Low, hours: 12.0, weather: Weather::Clear };
        let mut painter = WindowPainter::new(context, &experiment, look, FORMAT).unwrap();
        let extent = [320, 120];
        let memory = painter.memory(extent);
        let target = memory.create_view(&wgpu::TextureViewDescriptor::default());
        assert!(!painter.paint_city(PaintTarget { view: &target, extent }), "there is none yet");
        let snapshot = Run::new(experiment).unwrap().snapshot().clone();
        let view = Viewpoint::around(&snapshot).view(&snapshot, [160, 120]);
        let picture = PictureRequest { slot: PictureSlot::City, view, kind: PictureKind::Rgb };
        painter.draw(CityFrame { snapshot, pictures: vec![picture], ..CityFrame::default() }).unwrap();
        assert!(painter.paint_city(PaintTarget { view: &target, extent }));
        let image = painter.read(&memory).unwrap();
        let at = |x: u32, y: u32| {
            let place = 3 * (y * extent[0] + x) as usize;
            [image.rgb[place], image.rgb[place + 1], image.rgb[place + 2]]
        };
        let rows = || 0..extent[1];
        assert!(rows().all(|y| at(79, y) == [0; 3] && at(240, y) == [0; 3]), "black beside it");
        let colours: std::collections::BTreeSet<[u8; 3]> =
            rows().flat_map(|y| (80..240).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect();
        assert!(colours.len() > 50 && !colours.contains(&[0; 3]), "{} colours of a city", colours.len());
    }

    #[test]
    fn tinted_bodies_are_in_the_large_view_alone() {
        let Some(context) = software_context() else { return };
        let request = ScenarioRequest { scenario: "straight".to_owned(), ..ScenarioRequest::default() };
        let experiment = loading::read(&request).unwrap();
        let look = Look { preset: QualityPreset::Low, hours: 12.0, weather: Weather::Clear };
        let mut painter = WindowPainter::new(context, &experiment, look, FORMAT).unwrap();
        let snapshot = Run::new(experiment).unwrap().snapshot().clone();
        let id = snapshot.vehicles[0].id;
        let mut camera = Viewpoint::around(&snapshot);
        camera.set_mode(CameraMode::Chase, Some(id));
        camera.update(&snapshot);
        let view = camera.view(&snapshot, [160, 120]);
        let picture = |slot| PictureRequest { slot, view, kind: PictureKind::Rgb };
        let pictures = vec![picture(PictureSlot::City), picture(PictureSlot::Preview(id))];
        let mut drawn = |tints: Vec<(VehicleId, [u8; 3])>| {
            let (snapshot, pictures) = (snapshot.clone(), pictures.clone());
            painter.draw(CityFrame { snapshot, pictures, tints, ..CityFrame::default() }).unwrap();
            [PictureSlot::City, PictureSlot::Preview(id)]
                .map(|slot| painter.read(&painter.slots[&slot].texture).unwrap().rgb)
        };
        let (plain, tinted) = (drawn(Vec::new()), drawn(vec![(id, [255, 0, 255])]));
        let [city, preview] = [0, 1].map(|k: usize| {
            let pixels = plain[k].chunks_exact(3).zip(tinted[k].chunks_exact(3));
            // More magenta than before.
            let magenta = |p: &[u8]| i32::from(p[0]) + i32::from(p[2]) - 2 * i32::from(p[1]);
            pixels.filter(|(plain, tinted)| magenta(tinted) > magenta(plain) + 60).count()
        });
        assert!(city > 100 && preview == 0, "{city} and {preview} pixels");
    }
}
