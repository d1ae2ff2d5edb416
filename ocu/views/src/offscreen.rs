//! A graphics device that draws into textures, and reads them back.

use std::time::Duration;

/// Timeout of a picture: a software driver may take seconds for a large one, and a lost device never finishes.
const PATIENCE: Duration = Duration::from_mins(1);

/// A device of the graphics driver, without a window.
pub struct Offscreen {
    /// Allocates textures and buffers.
    pub device: wgpu::Device,
    /// Takes what is to be drawn.
    pub queue: wgpu::Queue,
}

impl Offscreen {
    /// Selects an adapter; a software one if there is no other. An error says why there is none.
    pub fn new() -> Result<Self, String> {
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = pollster::block_on(instance().request_adapter(&options)).map_err(|error| {
            format!(
                "no Vulkan driver was found to draw with: install a graphics driver, or the package \
                 mesa-vulkan-drivers, which draws in software ({error})"
            )
        })?;
        let limits = adapter.limits();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("ocu offscreen"),
            required_limits: wgpu::Limits {
                max_texture_dimension_2d: limits.max_texture_dimension_2d,
                max_buffer_size: limits.max_buffer_size,
                ..wgpu::Limits::downlevel_defaults()
            },
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| format!("the graphics driver gave no device: {error}"))?;
        Ok(Self { device, queue })
    }

    /// A texture to draw into; `size` is its width and height, pixels.
    pub fn target(&self, format: wgpu::TextureFormat, size: [u32; 2]) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("ocu offscreen"),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    /// Appends the copy of a texture of four bytes per pixel into memory.
    pub fn copy(&self, encoder: &mut wgpu::CommandEncoder, texture: &wgpu::Texture) -> Copied {
        let size = texture.size();
        let row_bytes = size.width * 4;
        let padded_bytes = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ocu offscreen"),
            size: u64::from(padded_bytes) * u64::from(size.height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(padded_bytes),
            rows_per_image: None,
        };
        let target = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, size);
        Copied { buffer, row_bytes: row_bytes as usize, padded_bytes: padded_bytes as usize }
    }

    /// Waits until a submission is done, and returns the copied texture: its rows from the top.
    pub fn bytes(&self, copied: &Copied, submission: wgpu::SubmissionIndex) -> Result<Vec<u8>, String> {
        let (sender, receiver) = std::sync::mpsc::channel();
        copied.buffer.slice(..).map_async(wgpu::MapMode::Read, move |result| drop(sender.send(result)));
        let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(PATIENCE) };
        self.device
            .poll(wait)
            .map_err(|error| format!("the graphics driver did not finish the picture: {error}"))?;
        let failed = |error: String| format!("the picture cannot be read back: {error}");
        receiver
            .recv()
            .map_err(|error| failed(error.to_string()))?
            .map_err(|error| failed(error.to_string()))?;
        let mapped = copied.buffer.slice(..).get_mapped_range().map_err(|error| failed(error.to_string()))?;
        let rows = mapped.chunks_exact(copied.padded_bytes);
        Ok(rows.flat_map(|row| &row[..copied.row_bytes]).copied().collect())
    }
}

/// A texture in memory, whose rows are padded.
pub struct Copied {
    buffer: wgpu::Buffer,
    row_bytes: usize,
    padded_bytes: usize,
}

/// The graphics drivers of this machine: those of Vulkan.
pub fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN;
    wgpu::Instance::new(descriptor)
}
