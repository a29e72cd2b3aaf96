//! `ftac report --lab-book`: checks the figures and writes the page made from them.

use std::path::Path;

use anyhow::{Context as _, Result};
use ftac::terminal::{Outcome, Terminal};
use ftac_platform::data::write_atomically;
use lab::lab_book::command::CommandCheck;
use lab::lab_book::{page, table};
use schemars::JsonSchema;
use serde::Serialize;

/// Checks that `ftac` accepts these arguments; the error is the reason if it does not.
pub type ArgumentParser = dyn Fn(&[&str]) -> Result<(), String>;

/// Default path of the page without `--out`.
const DEFAULT_PAGE: &str = "BENCHMARKS.md";

/// Output once the page is written.
#[derive(Debug, Serialize, JsonSchema)]
pub struct LabBook<'a> {
    /// Path of the page (Markdown).
    page: &'a Path,
    /// Number of figures on the page.
    figures: usize,
}

/// Makes the page from `figures`. The workspace's folder is the current directory.
pub fn run(terminal: &Terminal, figures: &Path, out: Option<&Path>, parse: &ArgumentParser) -> Outcome {
    let (page, count) = checked_page(figures, Path::new("."), parse)?;
    let out = out.unwrap_or(Path::new(DEFAULT_PAGE));
    write_atomically(out, page.as_bytes())?;
    terminal.print(&LabBook { page: out, figures: count }, &format!("{}: {count} figures\n", out.display()))?;
    Ok(None)
}

/// Returns the page and the number of figures on it. `root` is the folder in which commands are run.
fn checked_page(figures: &Path, root: &Path, parse: &ArgumentParser) -> Result<(String, usize)> {
    let text = std::fs::read_to_string(figures).with_context(|| figures.display().to_string())?;
    let rows = table::parse(figures, &text)?;
    CommandCheck::new(root, parse)?.check_all(figures, &rows)?;
    Ok((page::page(&rows), rows.len()))
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use ftac::cli::parse_arguments;
    use lab::lab_book::error::FieldError;

    fn root() -> PathBuf {
        // The folder of this run, not of the build, which may have been made in another checkout.
        PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").expect("set by cargo")).join("../..")
    }

    fn check(command: &str) -> Result<(), FieldError> {
        let file = Path::new("figures.csv");
        let text = format!("{}\na.b,1,,,,,,,2 cores,yes,{command},,Group,figure,,,\n", table::COLUMNS.join(","));
        let rows = table::parse(file, &text).unwrap();
        CommandCheck::new(&root(), &parse_arguments).unwrap().check_all(file, &rows)
    }

    #[test]
    fn commands_that_can_be_run_again_are_taken() {
        for command in [
            "ftac bench --combos 6 --trials 2 --noise-scale 1.2",
            "ftac --seed 2 touch eval --combos 60",
            "ftac hand export --mjcf DIR; python3 tests/mujoco/compare.py DIR",
            "cargo run --release -- bench --record none",
            "cargo run --release -p kinova-kortex --example arm_cycle -- 10",
            "cargo test --release -p sim --test integration statics -- --nocapture",
            "cargo test --release --workspace",
            "cargo bench -p tactile-optics --features gpu",
            "cargo test --release --manifest-path hardware-bridge/other-hosts/Cargo.toml",
        ] {
            check(command).unwrap_or_else(|error| panic!("{command}: {error}"));
        }
    }

    #[test]
    fn commands_that_cannot_be_run_again_are_refused() {
        for command in [
            "ftac",
            "ftac benchmark",
            "ftac bench --combinations 6",
            "ftac bench --noise-scale much",
            "ftac trial",
            "ftac bench; ftac bench --combinations 6",
            "bench",
            "the same run",
            "make all",
            "cargo build --release",
            "cargo test -p no-such-package",
            "cargo test -p",
            "cargo test --relase -p sim",
            "cargo test -p sim --test no_such_test",
            "cargo test -p sim --test integration -p no-such-package",
            "cargo run --release -- benchmark",
            "cargo run --release -p hardware-bridge --example no_such_example",
            "cargo test --manifest-path no/such/Cargo.toml",
            "python3 tests/mujoco/no_such_script.py",
            "python3 Cargo.toml",
            "python3 -m pip",
        ] {
            let error = check(command).expect_err(command);
            assert_eq!((error.line, error.field), (2, "command"), "{error}");
        }
    }

    #[test]
    fn benchmarks_md_is_what_the_checked_in_figures_make() {
        let (page, count) = checked_page(&root().join("recordings/figures.csv"), &root(), &parse_arguments).unwrap();
        assert!(count >= 40, "only {count} figures");
        let checked_in = std::fs::read_to_string(root().join(DEFAULT_PAGE)).unwrap();
        assert!(page == checked_in, "{DEFAULT_PAGE} is out of date: run `ftac report --lab-book`");
    }

    #[test]
    fn no_line_of_the_page_is_too_long_to_read() {
        let (page, _) = checked_page(&root().join("recordings/figures.csv"), &root(), &parse_arguments).unwrap();
        for line in page.lines() {
            assert!(line.chars().count() <= 300, "{} characters: {line}", line.chars().count());
        }
    }

    #[test]
    fn the_page_is_refused_with_the_place_of_the_mistake() {
        let folder = tempfile::tempdir().unwrap();
        let figures = folder.path().join("figures.csv");
        let row = "bench.wall,440,s,,,,1,,2 cores,yes,ftac bench --quick,,Benchmark,wall time,,600,";
        std::fs::write(&figures, format!("{}\n{row}\n", table::COLUMNS.join(","))).unwrap();
        let error = checked_page(&figures, &root(), &parse_arguments).unwrap_err().to_string();
        assert!(error.contains("figures.csv:2: command: found `ftac bench --quick`"), "{error}");
    }
}
