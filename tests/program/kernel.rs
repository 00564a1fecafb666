//! The kernel for graphics processors is built from the current sources.

use std::collections::BTreeSet;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};

use proc_macro2::{TokenStream, TokenTree};

use crate::sources::text;

/// First line of the kernel, before the digest of its sources.
const LABEL: &str = "// Sources: ";

/// The kernel's sources: files of `gpu/src`, and the modules of the program that `gpu/src/lib.rs` lists.
fn kernel_sources() -> BTreeSet<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let lib = text("gpu/src/lib.rs".as_ref());
    let mut files = BTreeSet::from(
        [
            "gpu/src/lib.rs",
            "gpu/build.rs",
            "gpu/build.sh",
            "gpu/Cargo.toml",
            "gpu/Cargo.lock",
            "src/names.rs",
        ]
        .map(PathBuf::from),
    );
    let mut folder = PathBuf::from("gpu/src");
    for line in lib.lines().map(str::trim) {
        if let Some(path) = line.strip_prefix("#[path = \"../../").and_then(|rest| rest.strip_suffix("\"]")) {
            folder = path.into();
        } else if line == "pub mod lanes {" {
            folder.push("lanes");
        } else if let Some(name) =
            line.trim_start_matches("pub ").strip_prefix("mod ").and_then(|rest| rest.strip_suffix(';'))
        {
            let single = folder.join(name).with_extension("rs");
            if root.join(&single).exists() {
                files.insert(single);
            } else if root.join(&folder).join(name).is_dir() {
                files.extend(
                    crate::sources::files().into_iter().filter(|file| file.starts_with(folder.join(name))),
                );
            }
        }
    }
    files
}

/// A digest of the sources' code, without comments.
fn digest() -> String {
    // FNV-1a, which is the same on every machine.
    struct Fnv(u64);
    impl Hasher for Fnv {
        fn finish(&self) -> u64 {
            self.0
        }
        fn write(&mut self, bytes: &[u8]) {
            for byte in bytes {
                self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
    fn add(tokens: TokenStream, to: &mut impl Hasher) {
        let mut tokens = tokens.into_iter().peekable();
        while let Some(token) = tokens.next() {
            match token {
                TokenTree::Punct(p) if p.as_char() == '#' => {
                    let inner = matches!(tokens.peek(), Some(TokenTree::Punct(p)) if p.as_char() == '!');
                    if inner {
                        tokens.next();
                    }
                    let Some(TokenTree::Group(attribute)) = tokens.next() else { continue };
                    let text = attribute.stream().to_string();
                    if !text.starts_with("doc") {
                        text.hash(to);
                    }
                }
                TokenTree::Group(group) => {
                    format!("{:?}", group.delimiter()).hash(to);
                    add(group.stream(), to);
                }
                other => other.to_string().hash(to),
            }
        }
    }
    let mut hasher = Fnv(0xcbf2_9ce4_8422_2325);
    for file in kernel_sources() {
        let text = text(&file);
        match file.extension().is_some_and(|e| e == "rs") {
            true => add(text.parse().unwrap(), &mut hasher),
            false => text.hash(&mut hasher),
        }
    }
    format!("{:016x}", hasher.finish())
}

#[test]
fn the_kernel_is_built_from_the_current_sources() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("gpu/kernel.ptx");
    let kernel = std::fs::read_to_string(&path).unwrap();
    let wanted = format!("{LABEL}{}\n", digest());
    if std::env::var_os("SIGN_KERNEL").is_some() {
        let code = kernel.split_once("//\n// Generated").map_or(kernel.as_str(), |(_, rest)| rest);
        std::fs::write(&path, format!("{wanted}//\n// Generated{code}")).unwrap();
        return;
    }
    assert!(kernel.starts_with(&wanted), "gpu/kernel.ptx is older than its sources: run `make gpu-kernel`");
    assert!(kernel_sources().len() > 60, "{:?}", kernel_sources());
}

/// Sines and exponentials have the same bits only from the same version.
#[test]
fn the_kernel_and_the_program_use_one_version_of_libm() {
    let version = |lock: &str| {
        let text = text(lock.as_ref());
        let (_, rest) = text.split_once("name = \"libm\"\nversion = ").unwrap();
        rest.lines().next().unwrap().to_string()
    };
    assert_eq!(version("gpu/Cargo.lock"), version("Cargo.lock"));
    assert_eq!(version("gpu/stand_in/Cargo.lock"), version("Cargo.lock"));
}
