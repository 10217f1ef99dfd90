use std::{
    fmt,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
};

use bevy::tasks::block_on;
use thiserror::Error;

use crate::pipeline::Side;

/// A device and its queue. Clones refer to the same device.
#[derive(Clone, Debug)]
pub struct GpuDevice {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    info: Arc<wgpu::AdapterInfo>,
}

/// An error of the GPU back end.
#[derive(Debug, Error)]
pub enum GpuError {
    /// There is no adapter.
    #[error("no GPU adapter: {0}; install a driver, for software rendering on Debian `mesa-vulkan-drivers`")]
    NoAdapter(#[from] wgpu::RequestAdapterError),
    /// The adapter returned no device.
    #[error("the adapter `{adapter}` returned no device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// The error of wgpu.
        reason: wgpu::RequestDeviceError,
    },
    /// A limit of the device is too small.
    #[error("the GPU `{adapter}` allows {found} {limit}, {wanted} are needed")]
    Limit {
        /// Name of the adapter.
        adapter: String,
        /// Name of the limit.
        limit: &'static str,
        /// Value that the device allows.
        found: u64,
        /// Value that is needed.
        wanted: u64,
    },
    /// The device has no memory left.
    #[error("the GPU `{adapter}` has no memory left for {bytes} bytes")]
    Memory {
        /// Name of the adapter.
        adapter: String,
        /// Size of the refused buffer.
        bytes: u64,
    },
    /// A body or a static cannot be culled, because its numbers are NaN or infinite.
    #[error("{0:?}: its place, motion or size is not finite")]
    NotFinite(Side),
    /// The device refused a shader, a buffer or a step.
    #[error("the GPU `{adapter}` refuses {what}: {reason}")]
    Refused {
        /// Name of the adapter.
        adapter: String,
        /// The refused object.
        what: String,
        /// The error of wgpu.
        reason: String,
    },
    /// The only adapter is a software implementation.
    #[error("`{adapter}` is a software implementation of a GPU")]
    Software {
        /// Name of the adapter.
        adapter: String,
    },
    /// The device is lost: it was reset, removed or destroyed, or had no memory for a necessary allocation.
    #[error("the GPU `{adapter}` is lost")]
    Lost {
        /// Name of the adapter.
        adapter: String,
    },
}

impl GpuError {
    /// Returns true if the next step may succeed.
    pub fn is_of_one_step(&self) -> bool {
        matches!(self, Self::Limit { .. } | Self::Memory { .. } | Self::NotFinite(_))
    }
}

impl GpuDevice {
    /// Requests a device for programs without a renderer, from the fastest adapter.
    ///
    /// # Errors
    /// If there is no adapter, or if it returns no device.
    pub fn request() -> Result<Self, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            // The others have no compute shaders, or few storage buffers.
            backends: wgpu::Backends::PRIMARY,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = block_on(instance.request_adapter(&options))?;
        let info = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("bevy_medial"),
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: adapter.limits(),
            ..Default::default()
        };
        let (device, queue) = block_on(adapter.request_device(&descriptor))
            .map_err(|reason| GpuError::NoDevice { adapter: info.name.clone(), reason })?;
        Self::new(device, queue, info)
    }

    /// Requests a device that is not a software implementation, for programs without a renderer.
    ///
    /// # Errors
    /// If there is no such adapter, or if it returns no device.
    pub fn request_hardware() -> Result<Self, GpuError> {
        let gpu = Self::request()?;
        if gpu.is_software() { Err(GpuError::Software { adapter: gpu.name().into() }) } else { Ok(gpu) }
    }

    /// Uses an existing device, such as that of the renderer.
    ///
    /// # Errors
    /// If a limit of the device is too small.
    pub fn new(device: wgpu::Device, queue: wgpu::Queue, info: wgpu::AdapterInfo) -> Result<Self, GpuError> {
        let limits = device.limits();
        let gpu = Self { device, queue, info: info.into() };
        gpu.require("storage buffers in a pass", limits.max_storage_buffers_per_shader_stage.into(), 8)?;
        gpu.require("invocations in a workgroup", limits.max_compute_invocations_per_workgroup.into(), 256)?;
        Ok(gpu)
    }

    /// Returns an error if a limit is less than wanted.
    pub(super) fn require(&self, limit: &'static str, found: u64, wanted: u64) -> Result<(), GpuError> {
        if found >= wanted {
            return Ok(());
        }
        Err(GpuError::Limit { adapter: self.name().into(), limit, found, wanted })
    }

    /// The device of wgpu.
    pub fn wgpu_device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The adapter's name.
    pub fn name(&self) -> &str {
        &self.info.name
    }

    /// Returns true if it is a software implementation on the CPU.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    pub(super) fn limits(&self) -> wgpu::Limits {
        self.device.limits()
    }

    /// Runs `make` and returns the errors that wgpu reports meanwhile. Error scopes keep them from other handlers, such as that of the renderer,
    /// which would end the app. Errors of other threads are not returned, because wgpu with its feature `std` has error scopes for each thread.
    pub(super) fn checked<T>(
        &self,
        what: fmt::Arguments,
        make: impl FnOnce(&wgpu::Device) -> T,
    ) -> Result<T, GpuError> {
        self.scoped(make).map_err(|error| match error {
            // Out of memory, wgpu loses the device, except when it creates a buffer.
            wgpu::Error::OutOfMemory { .. } => self.lost(),
            error => self.refusal(what, &error),
        })
    }

    fn scoped<T>(&self, make: impl FnOnce(&wgpu::Device) -> T) -> Result<T, wgpu::Error> {
        use wgpu::ErrorFilter::{Internal, OutOfMemory, Validation};
        let scopes = [OutOfMemory, Validation, Internal].map(|filter| self.device.push_error_scope(filter));
        let made = make(&self.device);
        let error = scopes.into_iter().rev().fold(None, |error, scope| block_on(scope.pop()).or(error));
        error.map_or(Ok(made), Err)
    }

    fn refusal(&self, what: fmt::Arguments, error: &wgpu::Error) -> GpuError {
        GpuError::Refused { adapter: self.name().into(), what: what.to_string(), reason: error.to_string() }
    }

    /// Creates a buffer of at least this many bytes, and at least 16.
    pub(super) fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, GpuError> {
        let descriptor = wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.max(16).next_multiple_of(16),
            usage,
            mapped_at_creation: false,
        };
        self.scoped(|device| device.create_buffer(&descriptor)).map_err(|error| match error {
            wgpu::Error::OutOfMemory { .. } => GpuError::Memory { adapter: self.name().into(), bytes },
            error => self.refusal(format_args!("the buffer `{label}`"), &error),
        })
    }

    /// Returns the error for a lost device.
    pub(crate) fn lost(&self) -> GpuError {
        GpuError::Lost { adapter: self.name().into() }
    }

    /// Runs the callbacks of finished work. Returns an error if the device is lost; wgpu panics if the driver reports the loss.
    pub(crate) fn poll(&self, until: wgpu::PollType) -> Result<(), GpuError> {
        let polled = catch_unwind(AssertUnwindSafe(|| self.device.poll(until)));
        if matches!(polled, Ok(Ok(_))) { Ok(()) } else { Err(self.lost()) }
    }

    /// Creates a buffer for reading back this many bytes.
    pub(super) fn staging(&self, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        let size = bytes.next_power_of_two();
        self.require("bytes in a buffer", self.limits().max_buffer_size, size)?;
        self.buffer("staging", size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)
    }

    /// Waits for a submission, and returns the first bytes of a buffer that it wrote.
    pub(super) fn read(
        &self,
        buffer: &wgpu::Buffer,
        bytes: u64,
        submission: wgpu::SubmissionIndex,
    ) -> Result<Vec<u8>, GpuError> {
        let (sender, receiver) = std::sync::mpsc::channel();
        copy_when_mapped(buffer, bytes, move |data| {
            // After an error the receiver is gone, and the data are not needed.
            let _ = sender.send(data);
        });
        self.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None })?;
        receiver.recv().ok().flatten().ok_or_else(|| self.lost())
    }
}

/// Calls `done` with the first bytes of a buffer when they can be read, or with none if the device is lost.
pub(crate) fn copy_when_mapped(buffer: &wgpu::Buffer, bytes: u64, done: impl FnOnce(Option<Vec<u8>>) + Send + 'static) {
    let mapped = buffer.clone();
    buffer.slice(..bytes).map_async(wgpu::MapMode::Read, move |result| {
        // The device may be lost even now. wgpu panics then, and offers no check before.
        let copy = AssertUnwindSafe(|| mapped.slice(..bytes).get_mapped_range().to_vec());
        let data = result.ok().and_then(|()| catch_unwind(copy).ok());
        if data.is_some() {
            mapped.unmap();
        }
        done(data);
    });
}
