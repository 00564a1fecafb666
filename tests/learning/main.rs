//! Learning from trials: estimation, diagnosis, posteriors and trial files.

#[path = "../discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with other test programs that use the rest")]
mod worlds;

mod contacts;
mod coverage;
mod discover;
mod estimate;
mod fit_quality;
mod posterior;
mod recorded;
mod setups;
mod tracks;
mod trials;

/// Whether all cases of the statistical tests run (`make verify`); by default a few of each do.
fn all_cases() -> bool {
    std::env::var_os("ALL_CASES").is_some()
}

/// The number of cases of a statistical test: `few` by default, `all` for `make verify`.
fn cases(few: usize, all: usize) -> usize {
    if all_cases() { all } else { few }
}
