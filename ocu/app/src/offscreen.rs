//! Renders egui without a window: into a texture, which is then read back into memory.

use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};
use ocu_views::offscreen::{Offscreen, instance};

/// Texture format with gamma-space colours, as egui expects.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Renders egui output into a texture.
pub struct Painter {
    offscreen: Offscreen,
    renderer: Renderer,
}

impl Painter {
    /// Selects an adapter; a software one if there is no other.
    pub fn new() -> anyhow::Result<Self> {
        let offscreen = Offscreen::new().map_err(anyhow::Error::msg)?;
        let renderer = Renderer::new(&offscreen.device, FORMAT, RendererOptions::PREDICTABLE);
        Ok(Self { offscreen, renderer })
    }

    /// Maximum side of a texture, pixels.
    pub fn max_texture_side(&self) -> usize {
        self.offscreen.device.limits().max_texture_dimension_2d as usize
    }

    /// Uploads the new textures of a pass. Call it for every pass, painted or not.
    pub fn take_textures(&mut self, delta: &mut egui::TexturesDelta) {
        let mut set: Vec<_> = delta.set.drain().collect();
        set.sort_by_key(|(id, _)| *id);
        for (id, images) in set {
            for image in images {
                self.renderer.update_texture(&self.offscreen.device, &self.offscreen.queue, id, &image);
            }
        }
    }

    /// Frees the textures that a pass was the last to use. Call it after the pass has been painted.
    pub fn free_textures(&mut self, delta: &mut egui::TexturesDelta) {
        let mut free: Vec<_> = delta.free.drain().collect();
        free.sort_unstable();
        for id in free {
            self.renderer.free_texture(&id);
        }
    }

    /// Renders one pass and returns its pixels: rgba8 rows, from the top.
    pub fn paint(
        &mut self,
        primitives: &[egui::ClippedPrimitive],
        size_px: [u32; 2],
        pixels_per_point: f32,
    ) -> anyhow::Result<Vec<u8>> {
        let screen = ScreenDescriptor { size_in_pixels: size_px, pixels_per_point };
        let Offscreen { device, queue, .. } = &self.offscreen;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let user = self.renderer.update_buffers(device, queue, &mut encoder, primitives, &screen);
        let texture = self.offscreen.target(FORMAT, size_px);
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let attachment = wgpu::RenderPassColorAttachment {
            view: &view,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                store: wgpu::StoreOp::Store,
            },
            depth_slice: None,
        };
        {
            let mut pass = encoder
                .begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("ocu picture"),
                    color_attachments: &[Some(attachment)],
                    ..wgpu::RenderPassDescriptor::default()
                })
                .forget_lifetime();
            self.renderer.render(&mut pass, primitives, &screen);
        }
        let copied = self.offscreen.copy(&mut encoder, &texture);
        let submission = queue.submit(user.into_iter().chain(std::iter::once(encoder.finish())));
        self.offscreen.bytes(&copied, submission).map_err(anyhow::Error::msg)
    }
}

/// What draws on this machine, as far as Vulkan knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Adapters {
    /// No adapter was found; there may be one of OpenGL.
    Unknown,
    /// The processor draws.
    Software,
    /// There is a graphics processor.
    Hardware,
}

/// Asks for the graphics adapters.
pub fn adapters() -> Adapters {
    let adapters = pollster::block_on(instance().enumerate_adapters(wgpu::Backends::VULKAN));
    let is_software = |adapter: &wgpu::Adapter| adapter.get_info().device_type == wgpu::DeviceType::Cpu;
    match adapters.as_slice() {
        [] => Adapters::Unknown,
        all if all.iter().all(is_software) => Adapters::Software,
        _ => Adapters::Hardware,
    }
}
