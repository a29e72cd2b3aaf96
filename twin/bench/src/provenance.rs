//! Provenance of data: command line, program, machine, source tree.

use ftac_platform::child;

use serde::{Deserialize, Serialize};

/// Provenance of data.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// Words of the command line. A word that is not Unicode is stored lossily.
    pub command: Vec<String>,
    /// Version of the program.
    pub version: String,
    pub machine: String,
    /// Commit of the source tree: see [`commit`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
}

impl Provenance {
    /// Returns the provenance of data that this process makes.
    pub fn now() -> Self {
        Self {
            command: std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            machine: machine(),
            commit: commit(),
        }
    }

    /// Returns the command as one line for a shell.
    pub fn command_line(&self) -> String {
        report::run::shell_line(&self.command)
    }
}

/// Returns processor, number of cores and operating system.
pub fn machine() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model =
        text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": ").map(|(_, name)| name.trim()));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {cores} cores, {}", model.unwrap_or(std::env::consts::ARCH), std::env::consts::OS)
}

/// Returns the present commit of the source tree that the program was built from, if that tree still exists.
pub fn commit() -> Option<String> {
    let git = |arguments: &[&str]| {
        let output = child::command("git").args(["-C", env!("CARGO_MANIFEST_DIR")]).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let commit = git(&["rev-parse", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_none_or(|changes| !changes.is_empty());
    Some(if changed { format!("{commit}, with changes") } else { commit })
}
