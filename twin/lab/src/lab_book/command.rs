//! Check that a figure's command could be run again: it parses as a command of `ftac`, or it names a package, target or
//! script that exists.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::error::FieldError;
use super::figure::LabBookFigure;

/// Options of `cargo` without a value, and with a value.
const CARGO_FLAGS: [&str; 5] = ["--release", "--lib", "--workspace", "--all-targets", "--no-run"];
const CARGO_OPTIONS: [&str; 8] =
    ["-p", "--package", "--test", "--bench", "--example", "--bin", "--features", "--manifest-path"];
/// Package of the program `ftac`, which `cargo run` uses without `-p`.
const FTAC_PACKAGE: &str = "ftac";

/// Parser of the arguments of `ftac` (without its name); the error is the reason for a refusal.
pub type ParseArguments = dyn Fn(&[&str]) -> Result<(), String>;

/// Reference against which commands are checked.
pub struct CommandCheck<'a> {
    /// Root folder of the workspace: commands are run there, and paths are relative to it.
    root: &'a Path,
    /// Folder of each package of the workspace, by its name.
    packages: BTreeMap<String, PathBuf>,
    parse: &'a ParseArguments,
}

impl<'a> CommandCheck<'a> {
    /// Reads the workspace's manifest in `root` and those of its members.
    pub fn new(root: &'a Path, parse: &'a ParseArguments) -> std::io::Result<Self> {
        let manifest = read_manifest(&root.join("Cargo.toml"))?;
        let members = manifest.get("workspace").and_then(|workspace| workspace.get("members")?.as_array());
        let mut packages = BTreeMap::new();
        for member in members.into_iter().flatten().filter_map(toml::Value::as_str) {
            let folder = root.join(member);
            if let Some(name) = package_name(&read_manifest(&folder.join("Cargo.toml"))?) {
                packages.insert(name, folder);
            }
        }
        Ok(Self { root, packages, parse })
    }

    /// Checks all figures of `file`; the error is about the first one whose command is refused.
    pub fn check_all(&self, file: &Path, figures: &[LabBookFigure]) -> Result<(), FieldError> {
        for figure in figures {
            for command in figure.command.split(';').map(str::trim) {
                self.check_command(command).map_err(|RefusedCommand { found, expected }| {
                    FieldError::new((file, figure.line), "command", format!("`{command}`: {found}"), expected)
                })?;
            }
        }
        Ok(())
    }

    fn check_command(&self, command: &str) -> Result<(), RefusedCommand> {
        let words: Vec<&str> = command.split_whitespace().collect();
        match words.as_slice() {
            [FTAC_PACKAGE, arguments @ ..] => self.check_program(arguments),
            ["cargo", "test" | "bench" | "run", ..] => self.check_cargo(words[1], &words[2..]),
            ["python3", script, ..] => {
                let exists = script.ends_with(".py") && self.root.join(script).is_file();
                require(exists, format!("no script {script}"), "the path of a script in the workspace")
            }
            _ => Err(RefusedCommand::new("another program", "ftac, cargo test, cargo bench, cargo run or python3")),
        }
    }

    fn check_program(&self, arguments: &[&str]) -> Result<(), RefusedCommand> {
        (self.parse)(arguments).map_err(|found| RefusedCommand::new(found, "arguments of ftac"))
    }

    fn check_cargo(&self, verb: &str, arguments: &[&str]) -> Result<(), RefusedCommand> {
        let end = arguments.iter().position(|word| *word == "--").unwrap_or(arguments.len());
        let (own, passed) = (&arguments[..end], arguments.get(end + 1..).unwrap_or_default());
        let mut packages: Vec<&str> = Vec::new();
        let mut targets: Vec<(&str, &str)> = Vec::new();
        let mut elsewhere = false;
        let mut words = own.iter();
        while let Some(word) = words.next() {
            if CARGO_FLAGS.contains(word) {
                continue;
            }
            if !CARGO_OPTIONS.contains(word) {
                // A filter of tests or benchmarks.
                let filter = !word.starts_with('-') && verb != "run";
                require(filter, format!("`{word}`"), format!("an option of cargo {verb}"))?;
                continue;
            }
            let value =
                words.next().ok_or_else(|| RefusedCommand::new(format!("{word} without a value"), "its value"))?;
            match *word {
                "-p" | "--package" => packages.push(value),
                "--test" => targets.push(("tests", value)),
                "--bench" => targets.push(("benches", value)),
                "--example" => targets.push(("examples", value)),
                "--manifest-path" => {
                    elsewhere = true;
                    require(self.root.join(value).is_file(), format!("no manifest {value}"), "a Cargo.toml")?;
                }
                _ => {}
            }
        }
        for package in &packages {
            require(
                self.packages.contains_key(*package),
                format!("no package {package}"),
                "a package of the workspace",
            )?;
        }
        let default = packages.is_empty() && !elsewhere;
        for (kind, name) in targets.iter().filter(|_| !elsewhere) {
            let packages = if default { &[FTAC_PACKAGE][..] } else { &packages[..] };
            let found = packages.iter().any(|package| self.has_target(package, kind, name));
            require(found, format!("no {name} in {kind}"), format!("a target in {kind} of {}", packages.join(", ")))?;
        }
        if verb == "run" && targets.is_empty() && (default || packages == [FTAC_PACKAGE]) {
            return self.check_program(passed);
        }
        Ok(())
    }

    fn has_target(&self, package: &str, kind: &str, name: &str) -> bool {
        let Some(package) = self.packages.get(package) else { return false };
        let manifest = read_manifest(&package.join("Cargo.toml")).unwrap_or_default();
        // If the manifest lists tests, there are no others.
        let named = manifest.get("test").and_then(toml::Value::as_array).filter(|_| kind == "tests");
        if let Some(named) = named {
            return named.iter().any(|test| test.get("name").and_then(toml::Value::as_str) == Some(name));
        }
        let folder = package.join(kind);
        folder.join(format!("{name}.rs")).is_file() || folder.join(name).join("main.rs").is_file()
    }
}

/// Reason why a command is refused.
#[derive(Debug)]
struct RefusedCommand {
    found: String,
    expected: String,
}

impl RefusedCommand {
    fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { found: found.into(), expected: expected.into() }
    }
}

fn require(holds: bool, found: String, expected: impl Into<String>) -> Result<(), RefusedCommand> {
    if holds { Ok(()) } else { Err(RefusedCommand::new(found, expected)) }
}

fn read_manifest(path: &Path) -> std::io::Result<toml::Table> {
    let named = |message: String| std::io::Error::other(format!("{}: {message}", path.display()));
    let text = fs::read_to_string(path).map_err(|error| named(error.to_string()))?;
    text.parse().map_err(|error: toml::de::Error| named(error.message().to_owned()))
}

fn package_name(manifest: &toml::Table) -> Option<String> {
    Some(manifest.get("package")?.get("name")?.as_str()?.to_owned())
}
