//! NVIDIA's driver, loaded at run time: the program builds and runs without it.
//!
//! Source: CUDA Driver API (NVIDIA). The kernel is stored as PTX for compute capability 7.0, which the driver compiles
//! for the device when it is first used and stores in its own cache.

#![allow(unsafe_code, reason = "calls functions of the driver, whose signatures are declared here")]

use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::sync::Mutex;

use libloading::Library;

use super::accelerator::{Accelerator, RolloutImages};
use super::arena::ARENA_SIZES_KB;
use crate::error::{Error, Result};

/// The kernel: see `gpu/build.sh`.
const KERNEL: &str = include_str!("../../../../gpu/kernel.ptx");
/// File names of the driver.
const DRIVER_FILES: [&str; 2] = ["libcuda.so.1", "libcuda.so"];
/// Threads of a block: the kernel needs many registers.
const THREADS_PER_BLOCK: usize = 64;
/// Least compute capability: that of the kernel.
const MIN_CAPABILITY: [c_int; 2] = [7, 0];

const ATTRIBUTE_MULTIPROCESSORS: c_int = 16;
const ATTRIBUTE_THREADS_PER_MULTIPROCESSOR: c_int = 39;
const ATTRIBUTE_CAPABILITY_MAJOR: c_int = 75;
const ATTRIBUTE_CAPABILITY_MINOR: c_int = 76;
const FUNCTION_ATTRIBUTE_LOCAL_BYTES: c_int = 3;

type Status = c_int;
type DevicePointer = u64;
type Handle = *mut c_void;

/// Declares the functions of the driver that are used, and loads them by name.
macro_rules! driver {
    ($($name:ident $symbol:literal ($($argument:ty),*);)*) => {
        struct Driver {
            $($name: unsafe extern "C" fn($($argument),*) -> Status,)*
            /// Stays loaded while its functions are used.
            _library: Library,
        }

        impl Driver {
            fn load(library: Library) -> std::result::Result<Driver, String> {
                $(
                    // SAFETY: the signature is the one of the driver's documentation.
                    let $name = *unsafe { library.get($symbol) }
                        .map_err(|e| format!("the driver is too old: {e}"))?;
                )*
                Ok(Driver { $($name,)* _library: library })
            }
        }
    };
}

driver! {
    init b"cuInit\0" (c_uint);
    device_count b"cuDeviceGetCount\0" (*mut c_int);
    device b"cuDeviceGet\0" (*mut c_int, c_int);
    device_attribute b"cuDeviceGetAttribute\0" (*mut c_int, c_int, c_int);
    retain_context b"cuDevicePrimaryCtxRetain\0" (*mut Handle, c_int);
    set_context b"cuCtxSetCurrent\0" (Handle);
    load_module b"cuModuleLoadData\0" (*mut Handle, *const c_void);
    function b"cuModuleGetFunction\0" (*mut Handle, Handle, *const c_char);
    free_memory b"cuMemGetInfo_v2\0" (*mut usize, *mut usize);
    allocate b"cuMemAlloc_v2\0" (*mut DevicePointer, usize);
    free b"cuMemFree_v2\0" (DevicePointer);
    upload b"cuMemcpyHtoD_v2\0" (DevicePointer, *const c_void, usize);
    download b"cuMemcpyDtoH_v2\0" (*mut c_void, DevicePointer, usize);
    function_attribute b"cuFuncGetAttribute\0" (*mut c_int, c_int, Handle);
    occupancy b"cuOccupancyMaxActiveBlocksPerMultiprocessor\0" (*mut c_int, Handle, c_int, usize);
    launch b"cuLaunchKernel\0" (Handle, c_uint, c_uint, c_uint, c_uint, c_uint, c_uint, c_uint, Handle, *mut *mut c_void, *mut *mut c_void);
    synchronize b"cuCtxSynchronize\0" ();
    error_text b"cuGetErrorString\0" (Status, *mut *const c_char);
}

/// The driver's library, if it is installed.
pub fn load_driver() -> Option<Library> {
    // SAFETY: the driver's own initialisation.
    DRIVER_FILES.iter().find_map(|file| unsafe { Library::new(file) }.ok())
}

/// A device with the kernel loaded.
pub struct Cuda {
    driver: Driver,
    /// The context, which is current on one thread at a time.
    context: Mutex<Context>,
}

struct Context {
    handle: Handle,
    /// The entry points, in the order of [`ARENA_SIZES_KB`].
    entries: [EntryPoint; ARENA_SIZES_KB.len()],
    /// Bytes that the driver keeps for the threads of the largest entry point so far.
    kept_bytes: usize,
}

/// An entry point of the kernel.
#[derive(Clone, Copy)]
struct EntryPoint {
    function: Handle,
    /// Blocks that run at the same time; further ones would only wait.
    max_blocks: usize,
    /// Memory that the driver reserves for all threads that the device can hold, bytes.
    thread_bytes: usize,
}

// SAFETY: the driver's handles may be used from any thread; a lock is held while they are.
unsafe impl Send for Context {}

impl Cuda {
    /// The first device; an error says why there is none.
    pub fn open() -> std::result::Result<Cuda, String> {
        let driver = Driver::load(load_driver().ok_or("no NVIDIA driver is installed")?)?;
        let (mut count, mut device) = (0, 0);
        // SAFETY: pointers to variables of the declared types, here and below.
        driver.check("initialising", unsafe { (driver.init)(0) })?;
        driver.check("counting devices", unsafe { (driver.device_count)(&mut count) })?;
        if count == 0 {
            return Err("the driver finds no device".into());
        }
        driver.check("opening the device", unsafe { (driver.device)(&mut device, 0) })?;
        let capability = [
            driver.attribute(device, ATTRIBUTE_CAPABILITY_MAJOR)?,
            driver.attribute(device, ATTRIBUTE_CAPABILITY_MINOR)?,
        ];
        if capability < MIN_CAPABILITY {
            let [a, b] = capability;
            return Err(format!("the device has compute capability {a}.{b}; 7.0 or more is needed"));
        }
        let mut handle: Handle = std::ptr::null_mut();
        driver.check("creating a context", unsafe { (driver.retain_context)(&mut handle, device) })?;
        driver.check("creating a context", unsafe { (driver.set_context)(handle) })?;
        let text = std::ffi::CString::new(KERNEL).map_err(|e| e.to_string())?;
        let mut module: Handle = std::ptr::null_mut();
        driver.check("compiling the kernel", unsafe {
            (driver.load_module)(&mut module, text.as_ptr().cast())
        })?;
        let multiprocessors = driver.attribute(device, ATTRIBUTE_MULTIPROCESSORS)?;
        let threads = multiprocessors * driver.attribute(device, ATTRIBUTE_THREADS_PER_MULTIPROCESSOR)?;
        let none = EntryPoint { function: std::ptr::null_mut(), max_blocks: 1, thread_bytes: 0 };
        let mut entries = [none; ARENA_SIZES_KB.len()];
        for (entry, kb) in entries.iter_mut().zip(ARENA_SIZES_KB) {
            *entry = driver.entry_point(module, &format!("rollout_{kb}"), multiprocessors as usize)?;
            entry.thread_bytes *= threads as usize;
        }
        Ok(Cuda { driver, context: Mutex::new(Context { handle, entries, kept_bytes: 0 }) })
    }

    fn launch(&self, context: &mut Context, work: &RolloutImages) -> std::result::Result<Vec<f64>, String> {
        let driver = &self.driver;
        // SAFETY: the context of the device.
        driver.check("selecting the device", unsafe { (driver.set_context)(context.handle) })?;
        let (entry, count) = (context.entry(work.arena_kb)?, work.rollouts());
        let blocks = count.div_ceil(THREADS_PER_BLOCK).min(entry.max_blocks);
        let threads = blocks * THREADS_PER_BLOCK;
        let mut outputs = vec![0.0f64; count * work.output_len];
        let bytes = 8 * (work.images.len() + work.starts.len() + outputs.len() + threads);
        let free = driver.free()? + context.kept_bytes;
        if bytes + entry.thread_bytes > free {
            let [data, own, free] = [bytes, entry.thread_bytes, free].map(|bytes| bytes >> 20);
            return Err(format!(
                "the rollouts need {data} MB and the threads {own} MB, and the device has {free} MB free"
            ));
        }
        context.kept_bytes = context.kept_bytes.max(entry.thread_bytes);
        let topology = driver.copy(&work.topology)?;
        let images = driver.copy(&work.images)?;
        let starts = driver.copy(&work.starts)?;
        let results = driver.memory(8 * outputs.len())?;
        let arenas = driver.memory(8 * threads)?;
        let taken = driver.copy(&[0u32])?;
        // `Launch` in `gpu/src/launch.rs`.
        let parameters: [u64; 9] = [
            topology.address,
            work.topology.len() as u64,
            images.address,
            starts.address,
            count as u64,
            results.address,
            work.output_len as u64,
            arenas.address,
            taken.address,
        ];
        let launch = driver.copy(&parameters)?;
        driver.start(entry, blocks, launch.address)?;
        // SAFETY: waits for the launch; then the results fill the vector.
        driver.check("running rollouts", unsafe { (driver.synchronize)() })?;
        let to = outputs.as_mut_ptr().cast();
        driver
            .check("copying results", unsafe { (driver.download)(to, results.address, 8 * outputs.len()) })?;
        Ok(outputs)
    }
}

impl Accelerator for Cuda {
    fn run(&self, work: &RolloutImages) -> Result<Vec<f64>> {
        let mut context = crate::sync::lock(&self.context);
        self.launch(&mut context, work)
            .map_err(|reason| Error::Failed(format!("graphics processor: {reason}")))
    }

    fn capacity(&self, arena_kb: usize) -> usize {
        let entry = crate::sync::lock(&self.context).entry(arena_kb);
        entry.map_or(0, |entry| entry.max_blocks * THREADS_PER_BLOCK)
    }
}

impl Context {
    /// The entry point for a thread memory, kB.
    fn entry(&self, arena_kb: usize) -> std::result::Result<EntryPoint, String> {
        let kind = ARENA_SIZES_KB.iter().position(|kb| *kb == arena_kb);
        kind.map(|kind| self.entries[kind]).ok_or("the kernel has no entry point of this size".into())
    }
}

/// Device memory; freed on drop.
struct DeviceMemory<'a> {
    driver: &'a Driver,
    address: DevicePointer,
}

impl Drop for DeviceMemory<'_> {
    fn drop(&mut self) {
        // SAFETY: allocated by `Driver::memory`. A failure means that the device is lost.
        _ = unsafe { (self.driver.free)(self.address) };
    }
}

impl Driver {
    fn check(&self, activity: &str, status: Status) -> std::result::Result<(), String> {
        if status == 0 {
            return Ok(());
        }
        let mut text: *const c_char = std::ptr::null();
        // SAFETY: the driver returns a static string, or null for a code that it does not have.
        let reason = unsafe {
            (self.error_text)(status, &mut text);
            if text.is_null() {
                "unspecified".into()
            } else {
                CStr::from_ptr(text).to_string_lossy().into_owned()
            }
        };
        Err(format!("error {status} in {activity}: {reason}"))
    }

    /// The function of a module with this name; its memory is that of one thread.
    fn entry_point(
        &self,
        module: Handle,
        name: &str,
        multiprocessors: usize,
    ) -> std::result::Result<EntryPoint, String> {
        let name = std::ffi::CString::new(name).map_err(|e| e.to_string())?;
        let (mut function, mut blocks): (Handle, c_int) = (std::ptr::null_mut(), 0);
        // SAFETY: pointers to variables of the declared types.
        self.check("loading the kernel", unsafe { (self.function)(&mut function, module, name.as_ptr()) })?;
        let status = unsafe { (self.occupancy)(&mut blocks, function, THREADS_PER_BLOCK as c_int, 0) };
        self.check("reading the occupancy", status)?;
        let mut bytes: c_int = 0;
        let status =
            unsafe { (self.function_attribute)(&mut bytes, FUNCTION_ATTRIBUTE_LOCAL_BYTES, function) };
        self.check("reading the memory of a thread", status)?;
        let max_blocks = multiprocessors * blocks.max(1) as usize;
        Ok(EntryPoint { function, max_blocks, thread_bytes: bytes as usize })
    }

    /// Starts blocks of an entry point with the address of their parameters.
    fn start(
        &self,
        entry: EntryPoint,
        blocks: usize,
        mut parameters: DevicePointer,
    ) -> std::result::Result<(), String> {
        let mut arguments = [(&raw mut parameters).cast::<c_void>()];
        let (blocks, threads) = (blocks as c_uint, THREADS_PER_BLOCK as c_uint);
        let (stream, extra) = (std::ptr::null_mut(), std::ptr::null_mut());
        // SAFETY: the kernel takes one pointer to device memory, which is copied before the call returns.
        let status = unsafe {
            let arguments = arguments.as_mut_ptr();
            (self.launch)(entry.function, blocks, 1, 1, threads, 1, 1, 0, stream, arguments, extra)
        };
        self.check("starting rollouts", status)
    }

    fn attribute(&self, device: c_int, attribute: c_int) -> std::result::Result<c_int, String> {
        let mut value = 0;
        // SAFETY: a pointer to a variable of the declared type.
        self.check("reading attributes", unsafe { (self.device_attribute)(&mut value, attribute, device) })?;
        Ok(value)
    }

    /// Free memory of the device, bytes.
    fn free(&self) -> std::result::Result<usize, String> {
        let (mut free, mut total) = (0, 0);
        // SAFETY: pointers to variables of the declared types.
        self.check("reading the free memory", unsafe { (self.free_memory)(&mut free, &mut total) })?;
        Ok(free)
    }

    fn memory(&self, bytes: usize) -> std::result::Result<DeviceMemory<'_>, String> {
        let mut address = 0;
        // SAFETY: a pointer to a variable of the declared type.
        let status = unsafe { (self.allocate)(&mut address, bytes.max(8)) };
        self.check(&format!("allocating {} MB", bytes >> 20), status)?;
        Ok(DeviceMemory { driver: self, address })
    }

    /// A copy of numbers in the device's memory.
    fn copy<T: Copy>(&self, values: &[T]) -> std::result::Result<DeviceMemory<'_>, String> {
        let bytes = size_of_val(values);
        let memory = self.memory(bytes)?;
        // SAFETY: both sides have so many bytes.
        let status = unsafe { (self.upload)(memory.address, values.as_ptr().cast(), bytes) };
        self.check("copying rollouts", status)?;
        Ok(memory)
    }
}
