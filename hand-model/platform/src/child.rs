//! Child processes that do not inherit this program's secrets.
//!
//! A child (a user's policy, a viewer, a cluster job) started by [`command`] does not see the environment variables
//! that hold secrets of this program: those whose names begin with `FTAC_` and contain `PASSWORD`, `SECRET` or `TOKEN`.

use std::ffi::OsStr;
use std::process::Command;

/// Words that mark a variable of ours as secret, such as `FTAC_ARM_PASSWORD`.
const SECRET_WORDS: [&str; 3] = ["PASSWORD", "SECRET", "TOKEN"];

/// Returns a command that inherits this program's environment without its secrets.
///
/// ```
/// let output = ftac_platform::child::command("echo").arg("hello").output()?;
/// assert_eq!(output.stdout, b"hello\n");
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn command(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(program);
    for (name, _) in std::env::vars_os() {
        if is_secret(&name.to_string_lossy()) {
            command.env_remove(name);
        }
    }
    command
}

/// True if an environment variable is ours and secret.
fn is_secret(name: &str) -> bool {
    name.starts_with("FTAC_") && SECRET_WORDS.iter().any(|word| name.contains(word))
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
