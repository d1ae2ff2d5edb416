//! Renders egui without a window: into a texture, which is then read back into memory.

use anyhow::{Context as _, anyhow};
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};
use std::time::Duration;

/// Texture format with gamma-space colours, as egui expects.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Timeout for rendering: a software driver may take seconds for a large image, and a lost device never finishes.
const PATIENCE: Duration = Duration::from_mins(1);

/// Renders egui output into a texture.
pub struct Painter {
    device: wgpu::Device,
    queue: wgpu::Queue,
    renderer: Renderer,
    /// Name and kind of the graphics adapter.
    pub adapter: String,
}

impl Painter {
    /// Selects an adapter; a software one if there is no other.
    pub fn new() -> anyhow::Result<Self> {
        let instance = instance();
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|error| {
            anyhow!(
                "no Vulkan driver was found to draw with: install a graphics driver, or the package \
                 mesa-vulkan-drivers, which draws in software ({error})"
            )
        })?;
        let limits = adapter.limits();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("ocu offscreen"),
            required_limits: wgpu::Limits {
                max_texture_dimension_2d: limits.max_texture_dimension_2d,
                ..wgpu::Limits::downlevel_defaults()
            },
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .context("the graphics driver gave no device")?;
        let renderer = Renderer::new(&device, FORMAT, RendererOptions::PREDICTABLE);
        let info = adapter.get_info();
        Ok(Self { device, queue, renderer, adapter: format!("{} ({:?})", info.name, info.device_type) })
    }

    /// Maximum side of a texture, pixels.
    pub fn max_texture_side(&self) -> usize {
        self.device.limits().max_texture_dimension_2d as usize
    }

    /// Uploads the new textures of a pass. Call it for every pass, painted or not.
    pub fn take_textures(&mut self, delta: &mut egui::TexturesDelta) {
        let mut set: Vec<_> = delta.set.drain().collect();
        set.sort_by_key(|(id, _)| *id);
        for (id, images) in set {
            for image in images {
                self.renderer.update_texture(&self.device, &self.queue, id, &image);
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
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let user = self.renderer.update_buffers(&self.device, &self.queue, &mut encoder, primitives, &screen);
        let extent = wgpu::Extent3d { width: size_px[0], height: size_px[1], depth_or_array_layers: 1 };
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("ocu picture"),
            size: extent,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
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
        // Rows of a buffer are padded to a multiple of 256 bytes.
        let row_bytes = size_px[0] * 4;
        let padded = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ocu picture"),
            size: u64::from(padded) * u64::from(size_px[1]),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None };
        let target = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, extent);
        let submission = self.queue.submit(user.into_iter().chain(std::iter::once(encoder.finish())));

        let (sender, receiver) = std::sync::mpsc::channel();
        buffer.slice(..).map_async(wgpu::MapMode::Read, move |result| drop(sender.send(result)));
        self.device
            .poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(PATIENCE) })
            .context("the graphics driver did not finish the picture")?;
        receiver
            .recv()
            .context("the picture was not handed over")?
            .context("the picture cannot be read back")?;
        let mapped = buffer
            .slice(..)
            .get_mapped_range()
            .map_err(|error| anyhow!("the picture cannot be read back: {error}"))?;
        Ok(mapped.chunks_exact(padded as usize).flat_map(|row| &row[..row_bytes as usize]).copied().collect())
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

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN;
    wgpu::Instance::new(descriptor)
}
