//! Stands in for NVIDIA's driver in tests: the functions that the program calls, with the kernel on the processor.
//!
//! It checks that the program passes what the driver and the kernel expect; it says nothing about a device.

#![allow(clippy::missing_safety_doc, reason = "the driver's functions, called by the program alone")]

use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::sync::Mutex;

use iplw_gpu::{Launch, rollouts};

type Handle = *mut c_void;

/// Sizes of allocated memory by address.
static MEMORY: Mutex<Vec<(u64, usize)>> = Mutex::new(Vec::new());
/// Codes of the driver: success, invalid value.
const OK: c_int = 0;
const INVALID: c_int = 1;

/// Whether so many bytes from an address are allocated.
fn is_allocated(address: u64, bytes: usize) -> bool {
    let memory = MEMORY.lock().unwrap();
    memory.iter().any(|(from, size)| *from <= address && address + bytes as u64 <= from + *size as u64)
}

#[unsafe(no_mangle)]
pub extern "C" fn cuInit(_: c_uint) -> c_int {
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuDeviceGetCount(count: *mut c_int) -> c_int {
    unsafe { *count = 1 };
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuDeviceGet(device: *mut c_int, _: c_int) -> c_int {
    unsafe { *device = 0 };
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuDeviceGetAttribute(value: *mut c_int, attribute: c_int, _: c_int) -> c_int {
    // Multiprocessors, threads of each, and compute capability 9.0.
    unsafe {
        *value = [(16, 2), (39, 64), (75, 9), (76, 0)].iter().find(|(a, _)| *a == attribute).map_or(0, |(_, v)| *v)
    };
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuDevicePrimaryCtxRetain(context: *mut Handle, _: c_int) -> c_int {
    unsafe { *context = 8 as Handle };
    OK
}

#[unsafe(no_mangle)]
pub extern "C" fn cuCtxSetCurrent(context: Handle) -> c_int {
    if context as usize == 8 { OK } else { INVALID }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuModuleLoadData(module: *mut Handle, image: *const c_void) -> c_int {
    let text = unsafe { CStr::from_ptr(image.cast()) };
    unsafe { *module = 16 as Handle };
    if text.to_bytes().starts_with(b"// Sources: ") { OK } else { INVALID }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuModuleGetFunction(function: *mut Handle, _: Handle, name: *const c_char) -> c_int {
    let name = unsafe { CStr::from_ptr(name) }.to_string_lossy();
    let Some(kilobytes) = name.strip_prefix("rollout_").and_then(|n| n.parse::<usize>().ok()) else {
        return INVALID;
    };
    unsafe { *function = (kilobytes * 1024) as Handle };
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuFuncGetAttribute(value: *mut c_int, attribute: c_int, function: Handle) -> c_int {
    // The memory of a thread, which is in place of the function.
    unsafe { *value = function as c_int };
    if attribute == 3 { OK } else { INVALID }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuMemGetInfo_v2(free: *mut usize, total: *mut usize) -> c_int {
    unsafe { (*free, *total) = (4 << 30, 8 << 30) };
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuMemAlloc_v2(address: *mut u64, bytes: usize) -> c_int {
    let memory: &mut [u64] = Vec::leak(vec![u64::MAX; bytes.div_ceil(8)]);
    unsafe { *address = memory.as_ptr() as u64 };
    MEMORY.lock().unwrap().push((memory.as_ptr() as u64, bytes));
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuMemFree_v2(address: u64) -> c_int {
    let mut memory = MEMORY.lock().unwrap();
    let Some(at) = memory.iter().position(|(from, _)| *from == address) else { return INVALID };
    let (_, bytes) = memory.swap_remove(at);
    drop(unsafe { Vec::from_raw_parts(address as *mut u64, bytes.div_ceil(8), bytes.div_ceil(8)) });
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuMemcpyHtoD_v2(to: u64, from: *const c_void, bytes: usize) -> c_int {
    if !is_allocated(to, bytes) {
        return INVALID;
    }
    unsafe { std::ptr::copy_nonoverlapping(from.cast::<u8>(), to as *mut u8, bytes) };
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuMemcpyDtoH_v2(to: *mut c_void, from: u64, bytes: usize) -> c_int {
    if !is_allocated(from, bytes) {
        return INVALID;
    }
    unsafe { std::ptr::copy_nonoverlapping(from as *const u8, to.cast::<u8>(), bytes) };
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuOccupancyMaxActiveBlocksPerMultiprocessor(
    blocks: *mut c_int,
    _: Handle,
    _: c_int,
    _: usize,
) -> c_int {
    unsafe { *blocks = 1 };
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuLaunchKernel(
    _function: Handle,
    blocks: c_uint,
    y: c_uint,
    z: c_uint,
    threads: c_uint,
    b: c_uint,
    c: c_uint,
    shared: c_uint,
    _stream: Handle,
    arguments: *mut *mut c_void,
    _extra: *mut *mut c_void,
) -> c_int {
    if [y, z, b, c, shared] != [1, 1, 1, 1, 0] {
        return INVALID;
    }
    let address = unsafe { *(*arguments).cast::<u64>() };
    if !is_allocated(address, size_of::<Launch>()) {
        return INVALID;
    }
    let launch = unsafe { &*(address as *const Launch) };
    let room = [
        (launch.topology as u64, 8 * launch.topology_len),
        (launch.starts as u64, 8 * (launch.rollouts + 1)),
        (launch.outputs as u64, 8 * launch.rollouts * launch.output_len),
        (launch.images as u64, 8 * unsafe { *launch.starts.add(launch.rollouts) }),
        (launch.arenas as u64, 8 * (blocks * threads) as usize),
        (launch.taken as u64, 4),
    ];
    if room.iter().any(|(address, bytes)| !is_allocated(*address, *bytes)) {
        return INVALID;
    }
    // One after the other; the first takes all rollouts.
    unsafe { rollouts(launch) };
    OK
}

#[unsafe(no_mangle)]
pub extern "C" fn cuCtxSynchronize() -> c_int {
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn cuGetErrorString(status: c_int, text: *mut *const c_char) -> c_int {
    unsafe { *text = if status == INVALID { c"invalid value".as_ptr() } else { std::ptr::null() } };
    OK
}
