//! Other programs, without our secrets.
//!
//! Every program of this workspace that starts another one starts it with [`command`]: what runs in it (somebody's policy, a viewer, a job of a cluster)
//! is not told what is in the environment for this program alone.

use std::ffi::OsStr;
use std::process::Command;

/// Words in the name of a variable of ours that holds a secret, such as `FTAC_ARM_PASSWORD`.
const SECRET: [&str; 3] = ["PASSWORD", "SECRET", "TOKEN"];

/// A command whose environment is this program's without its secrets.
pub fn command(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(program);
    for (name, _) in std::env::vars_os() {
        if is_secret(&name.to_string_lossy()) {
            command.env_remove(name);
        }
    }
    command
}

/// Whether a variable of the environment is ours and secret.
fn is_secret(name: &str) -> bool {
    name.starts_with("FTAC_") && SECRET.iter().any(|word| name.contains(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_of_ours_are_known_by_their_names() {
        for (name, secret) in [
            ("FTAC_ARM_PASSWORD", true),
            ("FTAC_EYES_TOKEN", true),
            ("FTAC_POLICY_PYTHON", false),
            ("PATH", false),
            ("SSH_ASKPASS_PASSWORD", false),
        ] {
            assert_eq!(is_secret(name), secret, "{name}");
        }
    }
}
