//! Behaviour of commands for every family.

use std::process::Command;

use iplw::policy::Dqn;
use iplw::task::families;

/// Regression test: bowling's batch size was used for every family.
#[test]
fn train_uses_the_batch_size_of_the_family() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    for family in families() {
        let task = format!("{}:000", family.name);
        let file = path.to_str().unwrap();
        let said = Command::new(env!("CARGO_BIN_EXE_iplw"))
            .args(["train", "--task", &task, "--batches", "1", "--out", file])
            .output()
            .unwrap();
        assert!(said.status.success(), "{task}: {}", String::from_utf8_lossy(&said.stderr));
        let policy = Dqn::from_safetensors(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(policy.card().trained[0].batch_size, family.learning.batch_size, "{task}");
    }
}
