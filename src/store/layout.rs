//! Names of the files in a data directory. A file with another name belongs to somebody else and is never changed.

pub const DATABASE: &str = "iplw.sqlite";
pub const POLICIES: &str = "policies";
pub const TOKENS: &str = "tokens.json";
/// Process id of the server, for messages.
pub const PROCESS: &str = "lock";
/// The locked file where directories cannot be locked.
#[cfg(not(unix))]
pub const SERVER_LOCK: &str = "server.lock";
/// Marks an unfinished restore.
pub const RESTORING: &str = "restoring";
/// An unfinished restore.
pub const RESTORED: &str = "restored.part";
/// A file that tests whether the disk can be written.
pub const PROBE: &str = "probe";

/// Name of a policy's weights. Weights that replace others have another number.
pub fn blob_name(policy: &str, number: i64) -> String {
    format!("{policy}.{number}.safetensors")
}

/// Whether a name is that of weights, complete or not.
pub fn is_blob_name(name: &str) -> bool {
    let numbered = complete_name(name).strip_suffix(".safetensors").and_then(|n| n.rsplit_once('.'));
    numbered.is_some_and(|(policy, number)| !policy.is_empty() && is_number(number))
}

/// Name of a file that is renamed to `name` when it is complete.
pub fn temporary_name(name: &str, number: usize) -> String {
    format!(".{name}.{}.{number}.part", std::process::id())
}

/// Whether a name in a data directory is one of this program's.
pub fn is_own_name(name: &str) -> bool {
    let name = complete_name(name);
    let names = [POLICIES, TOKENS, "tokens.lock", PROCESS, "server.lock", RESTORING, RESTORED, PROBE];
    let of_database = name.strip_prefix(DATABASE);
    names.contains(&name) || of_database.is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '-']))
}

/// The name without the parts added by [`temporary_name`]; earlier versions added one number only.
fn complete_name(name: &str) -> &str {
    let numbered = name.strip_prefix('.').and_then(|n| n.strip_suffix(".part"));
    let Some((rest, last)) = numbered.and_then(|n| n.rsplit_once('.')) else { return name };
    match rest.rsplit_once('.') {
        Some((first, process)) if is_number(process) && is_number(last) => first,
        _ if is_number(last) => rest,
        _ => name,
    }
}

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recognises_names_of_this_program_only() {
        for name in
            [&blob_name("a.b", 3), &temporary_name(&blob_name("a", 12), 0), ".a.3.safetensors.77.part"]
        {
            assert!(is_blob_name(name), "{name}");
        }
        for name in
            ["model.safetensors", ".3.safetensors", "a.x.safetensors", "a.3.safetensors.bak", "a.3.part"]
        {
            assert!(!is_blob_name(name), "{name}");
        }
        let database =
            ["iplw.sqlite", "iplw.sqlite-wal", "iplw.sqlite.damaged.2", "iplw.sqlite.part-journal"];
        for name in
            database.into_iter().chain(["tokens.json", &temporary_name(TOKENS, 1), "lock", "policies"])
        {
            assert!(is_own_name(name), "{name}");
        }
        for name in
            ["tokens.txt", "lockers", "policies.bak", "iplw.sqlite2", "restored.part.old", "notes.txt"]
        {
            assert!(!is_own_name(name), "{name}");
        }
    }
}
