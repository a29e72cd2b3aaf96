//! Secrets in a configuration: their permitted places, and their removal from recordings and messages.

use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use serde::Deserialize;

use super::{ArmConfig, BridgeConfig, ConfigError};

/// Environment variable with the arm's password; it takes precedence over all files.
pub const PASSWORD_VARIABLE: &str = "FTAC_ARM_PASSWORD";
/// Text that replaces a password in a recording.
const REDACTED: &str = "(not recorded)";

/// Password that is neither printed nor written.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct Password(String);

impl Password {
    pub fn reveal(&self) -> &str {
        &self.0
    }
}

impl From<String> for Password {
    fn from(text: String) -> Self {
        Self(text)
    }
}

impl std::fmt::Debug for Password {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Password")
    }
}

/// Returns the permissions of a file, such as `644`, if others than its owner have any.
fn readable_by_others(path: &Path) -> io::Result<Option<String>> {
    let mode = std::fs::metadata(path)?.permissions().mode() & 0o777;
    Ok((mode & 0o077 != 0).then(|| format!("{mode:o}")))
}

/// Reads the password from a file of its own, without the line end.
fn read_password(path: &Path) -> io::Result<Password> {
    Ok(Password(std::fs::read_to_string(path)?.trim_end_matches(['\n', '\r']).to_owned()))
}

impl BridgeConfig {
    /// Finds the arm's password. The environment takes precedence over the file named, and that over the configuration
    /// itself. A file with a password that others may read is refused.
    pub(super) fn find_password(&mut self, path: &Path) -> Result<(), ConfigError> {
        let ArmConfig::Kortex { password, password_file, .. } = &mut self.arm else { return Ok(()) };
        let private = |field: &str, file: &Path| {
            let io = |source| ConfigError::Io { path: file.to_owned(), source };
            match readable_by_others(file).map_err(io)? {
                None => Ok(()),
                Some(mode) => Err(ConfigError::Field {
                    path: path.to_owned(),
                    field: field.to_owned(),
                    found: format!("a password in {}, which others may read (mode {mode})", file.display()),
                    expected: format!("mode 600 (chmod 600 {}), or {PASSWORD_VARIABLE}", file.display()),
                }),
            }
        };
        if password.is_some() {
            private("arm.password", path)?;
        }
        if let Some(file) = password_file {
            let file = path.parent().unwrap_or(Path::new("")).join(&*file);
            private("arm.password_file", &file)?;
            *password = Some(read_password(&file).map_err(|source| ConfigError::Io { path: file, source })?);
        }
        if let Ok(found) = std::env::var(PASSWORD_VARIABLE) {
            *password = Some(found.into());
        }
        if password.is_none() {
            return Err(ConfigError::Field {
                path: path.to_owned(),
                field: "arm".into(),
                found: "no password".into(),
                expected: format!("password_file = \"FILE\", or {PASSWORD_VARIABLE} in the environment"),
            });
        }
        Ok(())
    }
}

/// Returns a configuration's text as a recording may keep it. Comments are lost if there was a password.
pub fn without_secrets(text: &str) -> String {
    let Ok(mut table) = text.parse::<toml::Table>() else { return String::new() };
    let arm = table.get_mut("arm").and_then(toml::Value::as_table_mut);
    match arm.and_then(|arm| arm.get_mut("password")) {
        Some(password) => *password = toml::Value::String(REDACTED.to_owned()),
        None => return text.to_owned(),
    }
    table.to_string()
}

/// Returns a parser's message with the line's number instead of the line, which may hold a password.
pub fn syntax_message(text: &str, error: &toml::de::Error) -> String {
    let Some(span) = error.span() else { return error.message().to_owned() };
    let before = text.get(..span.start).unwrap_or_default();
    let number = before.matches('\n').count() + 1;
    let line = text.lines().nth(number - 1).unwrap_or_default();
    let what = if line.contains("password") { "what follows `password` is no text" } else { error.message() };
    format!("line {number}: {what}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_stays_out_of_what_is_kept_or_said() {
        let text = "version = 1 # first\n[arm]\nuser = \"ftac\"\npassword = \"hunter2\"\n";
        let kept = without_secrets(text);
        assert!(!kept.contains("hunter2") && kept.contains("user = \"ftac\"") && kept.contains(REDACTED), "{kept}");
        let without = "version = 1 # first\n[arm]\nuser = \"ftac\"\n";
        assert_eq!(without_secrets(without), without);
        let inline = "arm = { user = \"a\", password = 'hunter2' }";
        assert!(!without_secrets(inline).contains("hunter2"));
        assert!(!format!("{:?}", Password("hunter2".into())).contains("hunter2"));
        for wrong in ["[arm]\npassword = hunter2\n", "[arm]\npassword = \"hunter2\n", "a = 1\npassword = 7 hunter2"] {
            let error = wrong.parse::<toml::Table>().expect_err("no TOML");
            let message = syntax_message(wrong, &error);
            assert!(!message.contains("hunter2") && message.starts_with("line 2: "), "{message}");
        }
    }
}
