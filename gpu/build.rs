//! Marks the sources that this crate shares with the program as compiled for one rollout at a time.

fn main() {
    println!("cargo:rustc-cfg=kernel");
    println!("cargo:rerun-if-changed=build.rs");
}
