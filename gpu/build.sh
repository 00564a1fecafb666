#!/usr/bin/env bash
# Builds the kernel for graphics processors, `kernel.ptx`, from the sources of the batched engine.
#
# Needs Rust's nightly toolchain with its component `rust-src`. Without a linker for the target the optimised module of
# the whole crate is the result.
set -euo pipefail
cd "$(dirname "$0")"
export RUSTFLAGS="-C target-cpu=sm_70 -Z unstable-options -C linker=true --emit=asm"
env -u CARGO_TARGET_DIR cargo +nightly rustc --quiet --locked --crate-type cdylib --release --target nvptx64-nvidia-cuda -Z build-std=core,alloc -Z build-std-features= --target-dir "${1:-target}"
cp "${1:-target}/nvptx64-nvidia-cuda/release/deps/iplw_gpu.s" kernel.ptx
